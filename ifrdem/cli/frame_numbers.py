"""Verbs that go through a trajectory: their option --frames, and how far they are."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TextIO

from ..errors import InputError
from ..run.progress import clock_face


def chosen(text: str | None, frames: int) -> range:
    """Numbers of the frames that `--frames` names among so many.

    Parameters
    ----------
    text : str or None
        One number, or a:b:c as in Python: from a (or the first) to before b (or the last), every c-th; negative
        numbers count from the end. None for all.
    frames : int
        How many there are.

    Raises
    ------
    InputError
        If the text is none of these, or names no frame that is there.
    """
    if text is None:
        return range(frames)
    try:
        parts = [int(part) if part.strip() else None for part in text.split(":")]
        if not 1 <= len(parts) <= 3 or parts == [None]:
            raise ValueError
        if len(parts) == 1:
            number = parts[0]
            assert number is not None
            found = range(frames)[number : number + 1 or None]
        else:
            found = range(frames)[slice(*parts)]
    except ValueError:
        raise InputError(
            f"--frames {text}: a number or a:b:c is needed, such as 10, 0:100, -5: or ::10"
        ) from None
    if len(found) == 0:
        span = f"0 to {frames - 1}" if frames else "none"
        raise InputError(f"--frames {text}: names none of the {frames} frames ({span})")
    return found


def counted(
    what: str,
    *,
    stream: TextIO | None = None,
    interval: float = 5.0,
    clock: Callable[[], float] = time.perf_counter,
) -> Callable[[Sequence[int]], Iterable[int]]:
    """What wraps frames to show how far one is: a bar on a terminal, elsewhere a line every `interval` seconds."""
    out = sys.stderr if stream is None else stream

    def bar(frames: Sequence[int]) -> Iterable[int]:
        from tqdm import tqdm

        return tqdm(frames, desc=what, unit="frame", leave=False, file=out)

    def lines(frames: Sequence[int]) -> Iterator[int]:
        began = printed = clock()
        for done, frame in enumerate(frames):
            now = clock()
            if now - printed >= interval and done:
                left = clock_face((now - began) / done * (len(frames) - done))
                print(f"{what}: {done} of {len(frames)} frames, ETA {left}", file=out, flush=True)
                printed = now
            yield frame

    return bar if out.isatty() else lines
