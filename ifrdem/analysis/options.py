"""Values of the options of analyses, for commands and studies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from ..errors import InputError, nearest, shortened
from ..tools.values import Integer, Positive, check_in, whole_of
from .names import OPTIONS

Axis = Literal["x", "y", "r"]
MOST_BINS, MOST_CELLS = 10_000, 300
"""Bins of `profiles`, and cells of `fields` along a side, at most."""
Bins = Annotated[int, Integer(1, MOST_BINS)]
Groups = Annotated[int, Integer(2, 1000)]
KINDS = {"axis": Axis, "bins": Bins, "windows": Groups, "phases": Groups, "lag": Positive}
"""Types of the options that are one value."""
CELLS = f"must be two integers from 1 to {MOST_CELLS}, along x and y"


def cells_of(given: Sequence[Any]) -> tuple[int, int] | None:
    """Two numbers of cells; None if they are none."""
    found: list[Any] = [whole_of(each) if isinstance(each, str) else each for each in given]
    whole = all(type(each) is int and 1 <= each <= MOST_CELLS for each in found)
    return (found[0], found[1]) if len(found) == 2 and whole else None


def frames_of(text: str, frames: int) -> range:
    """Numbers of the frames that a text names among so many.

    It is one number, or a:b:c as in Python: from a (or the first) to before b (or the last), every c-th; negative
    numbers count from the end. Raises InputError if it is none of these, or names no frame that is there.
    """
    try:
        given = [part.strip() for part in text.split(":")]
        parts = [whole_of(part) for part in given]
        if (
            not 1 <= len(parts) <= 3
            or given == [""]
            or any(part and number is None for part, number in zip(given, parts, strict=True))
        ):
            raise ValueError
        if len(parts) == 1:
            parts = [parts[0], (parts[0] or 0) + 1 or None]
        found = range(frames)[slice(*parts)]
    except ValueError:
        raise InputError(f"{text}: must be a number or a:b:c, such as 10, 0:100, -5: or ::10") from None
    if len(found) == 0:
        span = f"0 to {frames - 1}" if frames else "none"
        raise InputError(f"{text}: names none of the {frames} frames ({span})")
    return found


def checked_option(analysis: str, option: str, value: Any) -> None:
    """Raise InputError, without the name of the analysis, unless it has the option, and the option this value.

    Each analysis has `frames`.
    """
    own = ["frames", *(name for name, of in OPTIONS.items() if of == analysis)]
    if option not in own:
        raise InputError(f"{option}: no option of {analysis}{nearest(option, own)}; known: {', '.join(own)}")
    if option == "frames":
        if not isinstance(value, str):
            raise InputError(f'frames = {shortened(value)}: must be a text, such as "10:"')
        try:
            frames_of(value, 1)
        except InputError as error:
            if "must be" in str(error):
                raise InputError(f"frames = {error}") from None
    elif option == "average":
        if not isinstance(value, bool):
            raise InputError(f"average = {shortened(value)}: must be true or false")
    elif option == "cells":
        if not isinstance(value, list) or cells_of(value) is None:
            raise InputError(f"cells = {shortened(value)}: {CELLS}, such as [20, 80]")
    else:
        check = check_in(KINDS[option])
        assert check is not None
        check(option, value)
