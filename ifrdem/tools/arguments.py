"""Command lines."""

from __future__ import annotations

import argparse
import math
from typing import NoReturn

from ..errors import InputError


class Parser(argparse.ArgumentParser):
    """Raises InputError instead of exiting, so that every message leaves in the same way."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see `{self.prog} --help`)")


def as_whole(text: str) -> int | None:
    """A whole number from its text, 1e5 as well as 100000; None if it is none."""
    try:
        return int(text)  # not by way of a float, which would change long ones
    except ValueError:
        pass
    try:
        return int(float(text)) if float(text).is_integer() else None
    except (ValueError, OverflowError):
        return None


def whole(option: str, text: str, least: int, most: float = math.inf) -> int:
    """The value of an option as a whole number from `least` to `most`; InputError names the option."""
    allowed = f"{least} or more" if math.isinf(most) else f"{least} to {most:.0f}"
    value = as_whole(text)
    if value is None or not least <= value <= most:
        raise InputError(f"{option} = {text}: a whole number, {allowed}, is needed")
    return value
