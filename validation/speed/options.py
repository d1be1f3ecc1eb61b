"""Options of `ifrdem bench`, checked before anything runs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

from ...errors import InputError
from ...kernels.limits import MOST_DISKS
from ...simulation import device

DENSEST = 0.9068  # packing fraction, nearly that of equal disks that touch on a hexagonal lattice
THINNEST = 1e-5  # thinner gases hardly ever collide


def parse(given: argparse.Namespace, overrides: list[str]) -> dict[str, Any]:
    """Keyword arguments of `bench.bench`, from the texts of the command line; `overrides` are those of a case.

    Raises
    ------
    InputError
        With a line for each option that is wrong.
    """
    wrong = _conflicts(given)
    chosen: dict[str, Any] = {"profile": given.profile}

    def read(name: str, kind: Callable[[str], float], right: Callable[[float], bool], need: str) -> None:
        text = getattr(given, name)
        if text is None:
            return
        try:
            if right(kind(text)):
                chosen[name] = kind(text)
                return
        except (ValueError, OverflowError):
            pass
        wrong.append(f"--{name} {text}: {need} is needed")

    def count(name: str, least: int, most: int, noun: str = "whole number") -> None:
        read(name, _whole, lambda value: least <= value <= most, f"a {noun} from {least} to {most}")

    count("n", 2, MOST_DISKS, "whole number of disks")
    read("phi", float, lambda value: THINNEST <= value <= DENSEST,
         f"a packing fraction from {THINNEST} to {DENSEST}")  # fmt: skip
    count("runs", 1, 10_000)
    read("seconds", float, lambda value: 0.0 < value < math.inf, "a positive number of seconds")
    read("skin", float, lambda value: 1e-3 <= value <= 1e3, "a length from 0.001 to 1000 diameters")
    count("seed", 0, 2**63 - 1)
    read("after", float, lambda value: 0.0 <= value < math.inf, "a number of collisions per disk, 0 or more,")
    count("threads", 1, device.cores())
    try:
        device.check(given.arch or "cpu", None, given.precision or "f64")
    except InputError as error:
        wrong.append(f"--{error}")
    if wrong:
        raise InputError("\n".join(wrong))
    if given.case is not None:
        own = ("arch", "threads", "precision", "seed")  # in the overrides
        chosen = {name: value for name, value in chosen.items() if name not in own}
        return chosen | {"case": given.case, "overrides": overrides}
    texts = {name: getattr(given, name) for name in ("arch", "precision")}
    return chosen | {name: text for name, text in texts.items() if text is not None}


def _whole(text: str) -> int:
    """A whole number, 1e6 as well as 1000000."""
    try:
        return int(text)
    except ValueError:
        if not float(text).is_integer():
            raise
        return int(float(text))


def _conflicts(given: argparse.Namespace) -> list[str]:
    """A line for each option that says nothing beside the others."""
    if given.case is None:
        found = ["--after"] * (given.after is not None) + ["--set"] * bool(given.overrides)
        return [f"{each}: only beside --case" for each in found]
    keys = {"n": "number of a species", "phi": "box.packing_fraction"}
    return [
        f"--{each}: not beside --case; --set changes the case's {keys[each]}"
        for each in keys
        if getattr(given, each) is not None
    ]
