"""Errors that users see, and the spelling help inside them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class InputError(ValueError):
    """Input that cannot be used: says what is wrong, where, and what is allowed.

    The command line prints the message and exits with status 2.
    """


class AttributeRefused(InputError, AttributeError):
    """An attribute that cannot be set: it is read-only, or there is none of that name."""


class EngineError(RuntimeError):
    """The engine found itself in a state that its guarantees exclude, and stopped instead of going on."""


class TheoryError(RuntimeError):
    """Equations of kinetic theory that cannot be integrated numerically for these coefficients."""


def printable(text: str) -> str:
    """A text of a file with its control characters escaped, so that it can do nothing to a terminal."""
    return "".join(
        one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode("ascii")
        for one in text
    )


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the nearest allowed spelling, or an empty string."""
    found = difflib.get_close_matches(word, list(allowed), n=1, cutoff=0.6)
    return f" (did you mean '{found[0]}'?)" if found else ""


def listed(lines: Sequence[str], most: int = 20) -> str:
    """The lines of a message; of more than `most`, the first ones and the number of the others."""
    if len(lines) <= most:
        return "\n".join(lines)
    return "\n".join((*lines[:most], f"and {len(lines) - most} more mistakes like these"))
