"""Errors and warnings that users see, the spelling help inside them, and where warnings point."""

from __future__ import annotations

import contextlib
import difflib
import os
import re
import reprlib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

MOST_LINE = 2000
"""Characters of a line of a message at most."""
MOST_WORD = 300
"""Characters of a path, or of another word without spaces, in a message at most."""
_LONG_WORD = re.compile(rf"\S{{{MOST_WORD + 1},}}")


@dataclass(frozen=True)
class Problem:
    """A mistake: its key, argument or place, the value there as text (None without one), and the reason."""

    key: str
    value: str | None
    text: str

    def __str__(self) -> str:
        place = self.key if self.value is None else f"{self.key} = {self.value}"
        return f"{place}: {self.text}"


class InputError(ValueError):
    """Input that cannot be used: says what is wrong, where, and what is allowed.

    The command line prints the message and exits with status 2. Lines beyond `MOST_LINE` and words beyond `MOST_WORD`
    are cut: files and callers can have names and lists of any length. Of an error that is made of one `Problem`,
    `problem` is that;
    `reason` is the message, without key and value where it is made so.
    """

    problem: Problem | None = None

    def __init__(self, *arguments: object) -> None:
        if len(arguments) == 1 and isinstance(arguments[0], Problem):
            self.problem = arguments[0]
            arguments = (str(self.problem),)
        text = str(arguments[0]) if len(arguments) == 1 else ""
        if len(text) > MOST_WORD:
            text = _LONG_WORD.sub(lambda word: _middle_cut(word[0]), text)
            arguments = ("\n".join(cut(line, MOST_LINE) for line in text.split("\n")),)
        super().__init__(*arguments)
        self.reason = str(self) if self.problem is None else self.problem.text


class AttributeRefused(InputError, AttributeError):
    """An attribute that cannot be set: it is read-only, or there is none of that name."""


class EngineError(RuntimeError):
    """A run that cannot continue: by the gas itself (the classes below), or the engine's state is lost or refuted."""


class InelasticCollapse(EngineError):
    """Collisions without end gain no time, or a disk has come to rest on a wall; `collapse` of a simulation helps."""


class NoMoreCollisions(EngineError):
    """The end is a number of collisions, and no disk will meet another one: nothing moves, or all fly apart."""


class SlowRunWarning(UserWarning):
    """A run that is far from its end at its present pace, or waits for a collision."""


class RunWarning(UserWarning):
    """A run that does nothing: its end, which counts from the start of the gas, was reached before."""


class TheoryWarning(UserWarning):
    """A theory is used outside the range in which it was compared with simulations."""


class Stopped(Exception):
    """A run was stopped before its end; `status` is the exit status of the command, the message says why."""

    def __init__(self, reason: str, status: int) -> None:
        super().__init__(reason)
        self.status = status


class TrajectoryError(RuntimeError):
    """A trajectory cannot be written further (a full disk, a closed file). Its committed frames are kept."""


class DamageError(InputError):
    """A part of a file that is not what it should be."""


class ReadError(InputError):
    """A file that the system does not read: its rights, the drive or the network; of damage nothing is known."""


class DamageWarning(UserWarning):
    """A part of a file is left out, because it cannot be read and nothing else needs it."""


class FrameError(InputError, IndexError):
    """A frame number outside the trajectory."""


class NameMissing(InputError, KeyError):
    """A name that a file, or the table of coins, does not hold."""

    def __str__(self) -> str:  # KeyError would put its message into quotes
        return Exception.__str__(self)


class AttributeMissing(NameMissing, AttributeError):
    """A name that a file does not hold, read as an attribute."""


class TheoryError(RuntimeError):
    """Equations of kinetic theory that cannot be integrated numerically for these coefficients."""


_on_command_line = False


@contextlib.contextmanager
def on_command_line() -> Iterator[None]:
    """Let messages name options of the command line, not arguments of Python."""
    global _on_command_line
    before, _on_command_line = _on_command_line, True
    try:
        yield
    finally:
        _on_command_line = before


def option_name(option: str, argument: str) -> str:
    """An option of a command, or the argument of the same meaning in Python, for a message to the caller."""
    return option if _on_command_line else argument


def install_extra(extra: str) -> str:
    """Clause of a message: how to install the packages of an extra."""
    return f"`pip install 'ifrdem[{extra}]'` adds it"


MOST_QUOTED = 60
"""Characters of a name or a value that messages quote at most."""


def cut(text: str, longest: int = MOST_QUOTED) -> str:
    """The beginning of a long text."""
    return text if len(text) <= longest else text[: longest - 3] + "..."


def _middle_cut(word: str) -> str:
    """Both ends of a long path or word."""
    half = (MOST_WORD - 3) // 2
    return f"{word[:half]}...{word[-half:]}"


class _Texts(reprlib.Repr):
    """Short texts of values, whatever they hold."""

    def repr_int(self, x: int, level: int) -> str:
        """The text of an int; beyond 4,300 digits Python refuses to write it."""
        return f"an int of {x.bit_length()} bits" if x.bit_length() > 256 else super().repr_int(x, level)

    def repr_instance(self, x: object, level: int) -> str:
        """The text of an object; of its class where it has none: a class of users, an array of nested lists."""
        try:
            return super().repr_instance(x, level)
        except Exception:  # of a class of others, whose text a message only quotes
            return f"<{type(x).__name__}>"


_texts = _Texts()
_texts.maxother = _texts.maxlong = _texts.maxstring = MOST_QUOTED


def shortened(value: object) -> str:
    """The repr of anything, on one line."""
    return " ".join(_texts.repr(value).split())


def printable(text: str) -> str:
    """A text of a file with its control characters escaped, so that it can do nothing to a terminal."""
    if text.replace("\n", "").replace("\t", "").isprintable():
        return text
    return "".join(
        one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode("ascii")
        for one in text
    )


RENAMED: Mapping[str, tuple[str, ...]] = {
    "energy": ("ledger",), "disk_energy": ("dissipated",), "partner": ("last_partner",), "wall": ("wall_sums",),
    "tracked": ("histories",), "grow": ("grown_positions",), "tc": ("contact_time",),
    "random_force": ("random_kicks", "poisson_kicks"), "random_torque": ("spin_kicks", "poisson_spin_kicks"),
    "lubachevsky_stillinger": ("grown",), "f4": ("f32",), "f8": ("f64",),
}  # fmt: skip
"""Present words by old ones: of what is recorded, of an argument and a function of Python, and of values in a case.

Of two, the second is that of a force with a rate in place of a step. Old words are refused, where the present one is
allowed, with that (`nearest`); those in files are translated (`tools.old_words`). Rows may go after a release."""
_SYNONYMS = {"gpu": "cuda", "single": "f32", "double": "f64"}
"""Other words for a value."""


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the nearest allowed spelling, or an empty string. The case of letters decides
    only between spellings that differ by nothing else.

    Of an old word, `` (it is called "x" now)``.
    """
    names = list(allowed)
    if renamed := [f'"{each}"' for each in RENAMED.get(word, ()) if each in names]:
        return f" (it is called {' or '.join(renamed)} now)"
    same, longer = _SYNONYMS.get(word), [name for name in names if word and name.startswith(f"{word} ")]
    found = [same] if same in names else longer or _close(word, names)
    return f" (did you mean '{found[0]}'?)" if found else ""


def _close(word: str, names: Iterable[str]) -> list[str]:
    """The name that is most like a word, if one is."""
    folded: dict[str, list[str]] = {}
    for name in names:
        folded.setdefault(name.casefold(), []).append(name)
    close = difflib.get_close_matches(word.casefold(), folded, n=1, cutoff=0.6)
    return difflib.get_close_matches(word, folded[close[0]], n=1, cutoff=0.0) if close else []


def nearest_file(name: str, names: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the file of nearly the same name without its ending, or an empty string."""
    stem, ending = os.path.splitext(name)
    files = sorted(names, key=lambda each: not each.endswith(ending))  # of the same ending first
    stems = [os.path.splitext(each)[0] for each in files]
    found = difflib.get_close_matches(stem, stems, n=1, cutoff=0.65)
    return f" (did you mean '{files[stems.index(found[0])]}'?)" if found else ""


def there_are(word: str, known: Iterable[str]) -> str:
    """Text behind an unknown name: the nearest spelling, and the known ones."""
    names = list(known)
    return f"{nearest(word, names)}; there are {', '.join(names) or 'none'}"


def counted(count: int, noun: str) -> str:
    """A number with its noun: 1 frame, 2 frames."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def refuse(
    problems: Sequence[str | Problem], source: object = "", most: int = 100, count: int | None = None
) -> None:
    """Raise InputError with a line for each thing that is wrong, behind the name of its source; return if none is."""
    if problems:
        lines = [f"{source}: {each}" if source else str(each) for each in problems]
        raise InputError(listed(lines, most, count))


def listed(lines: Sequence[str], most: int = 20, count: int | None = None) -> str:
    """The lines of a message; of more than `most`, the first ones and the number of the others.

    `count` is the number of all, where `lines` are only the first of them.
    """
    more = (len(lines) if count is None else count) - most
    return "\n".join((*lines[:most], *([f"and {more} more mistakes like these"] if more > 0 else [])))


def outside_level() -> int:
    """The `stacklevel` with which `warnings.warn` points at the caller's line outside of this package."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == "ifrdem":
        level, frame = level + 1, frame.f_back
    return level
