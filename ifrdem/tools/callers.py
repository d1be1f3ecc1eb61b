"""The place of a warning in the code that called this package."""

from __future__ import annotations

import sys


def outside_level() -> int:
    """The `stacklevel` of `warnings.warn` for the line outside of this package that led to the present call."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == "ifrdem":
        level, frame = level + 1, frame.f_back
    return level
