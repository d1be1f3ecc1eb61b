"""Errors that users see, and the spelling help inside them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Input that cannot be used: says what is wrong, where, and what is allowed.

    The command line prints the message and exits with status 2.
    """


class EngineError(RuntimeError):
    """The engine found itself in a state that its guarantees exclude, and stopped instead of going on."""


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
