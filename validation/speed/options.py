"""What `ifrdem bench` is asked for, checked before anything runs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from ...errors import InputError
from ...kernels.limits import MOST_DISKS
from ...simulation import device

T = TypeVar("T")

COMPRESSIONS = ("none", "gzip")

DENSEST = 0.9068  # packing fraction, nearly that of equal disks that touch on a hexagonal lattice
THINNEST = 1e-5  # thinner gases hardly ever collide
RUNS, SECONDS = 5, 0.5
TURNS = 24  # of short pieces with and without output


@dataclass(frozen=True)
class Timing:
    """How a gas is timed.

    Attributes
    ----------
    runs : int
        Timed runs; turns with and without output.
    seconds : float
        Least length of each [s].
    skin : float or None
        Extra listing distance in largest diameters; the engine's choice without it.
    profile, compiling : bool
        Whether to measure the share of each kernel, and the times of a start.
    """

    runs: int = RUNS
    seconds: float = SECONDS
    skin: float | None = None
    profile: bool = False
    compiling: bool = True


@dataclass(frozen=True)
class BenchOptions:
    """The options, with their defaults: an elastic gas, a case, or the table.

    Attributes
    ----------
    n, phi : int, float
        Disks and packing fraction of the elastic gas.
    arch, threads, precision : str, int or None, str
        See `backend.start`; of a case, its own unless `overrides` say otherwise.
    seed : int
        Of the elastic gas.
    case : str or None
        A case file, and `overrides` of its keys.
    after : float
        Collisions per disk that the case has before it is timed.
    table : bool
        The grid of gases, up to `most` disks, and with the `clustered` one.
    output : str or None
        Time what output of frames costs, with this compression.
    json : bool
        Figures as JSON.
    """

    timing: Timing = Timing()
    n: int = 100_000
    phi: float = 0.3
    arch: str = "cpu"
    threads: int | None = None
    precision: str = "f64"
    seed: int = 1
    case: str | None = None
    overrides: tuple[str, ...] = ()
    after: float = 0.0
    table: bool = False
    most: int = MOST_DISKS
    clustered: bool = False
    output: str | None = None
    json: bool = False

    @classmethod
    def parse(cls, given: argparse.Namespace, overrides: list[str]) -> BenchOptions:
        """From the texts of the command line, None for those not given; `overrides` are those of a case.

        Raises
        ------
        InputError
            With a line for each option that is wrong.
        """
        wrong: list[str] = []

        def read(name: str, kind: Callable[[str], T], right: Callable[[T], bool], need: str, default: T) -> T:
            text = getattr(given, name)
            if text is None:
                return default
            try:
                value = kind(text)
                if right(value):
                    return value
            except ValueError:
                pass
            wrong.append(f"--{name} {text}: {need} is needed")
            return default

        def count(name: str, least: int, most: int, default: int, what: str = "whole number") -> int:
            need = f"a {what} from {least} to {most}"
            return read(name, _whole, lambda value: least <= value <= most, need, default)

        def positive(name: str, need: str, default: float) -> float:
            return read(name, float, lambda value: 0.0 < value < math.inf, need, default)

        wrong += _conflicts(given)
        n = count("n", 2, MOST_DISKS, cls.n, "whole number of disks")
        phi = read(
            "phi",
            float,
            lambda value: THINNEST <= value <= DENSEST,
            f"a packing fraction from {THINNEST} to {DENSEST}",
            cls.phi,
        )
        timing = Timing(
            runs=count("runs", 1, 10_000, RUNS if given.output is None else TURNS),
            seconds=positive("seconds", "a positive number of seconds", SECONDS),
            skin=None
            if given.skin is None
            else read(
                "skin",
                float,
                lambda value: 1e-3 <= value <= 1e3,
                "a length from 0.001 to 1000 diameters",
                1.0,
            ),
            profile=given.profile,
            compiling=not given.no_compile,
        )
        seed = count("seed", 0, 2**63 - 1, cls.seed)
        after = read(
            "after",
            float,
            lambda value: 0.0 <= value < math.inf,
            "a number of collisions per disk, 0 or more,",
            cls.after,
        )
        most = count("most", 1000, MOST_DISKS, cls.most, "whole number of disks")
        threads = count("threads", 1, device.cores(), 0) or None
        arch, precision = given.arch or cls.arch, given.precision or cls.precision
        try:
            device.check(arch, None, precision)
        except InputError as error:
            wrong.append(f"--{error}")
        if wrong:
            raise InputError("\n".join(wrong))
        return cls(
            timing, n, phi, arch, threads, precision, seed, given.case, tuple(overrides), after,
            given.table, most, given.clustered, given.output, given.json,
        )  # fmt: skip


def _whole(text: str) -> int:
    """A whole number, 1e6 as well as 1000000."""
    try:
        return int(text)
    except ValueError:
        value = float(text)
        if value != int(value) if math.isfinite(value) else True:
            raise ValueError(text) from None
        return int(value)


def _conflicts(given: argparse.Namespace) -> list[str]:
    """A line for each option that says nothing beside the others."""

    def named(*names: str) -> list[str]:
        return [f"--{name}" for name in names if getattr(given, name) not in (None, False)]

    found = []
    if given.output is not None:
        if given.output not in COMPRESSIONS:
            found.append(f"--output {given.output}: allowed are {', '.join(COMPRESSIONS)}")
        other = named("table", "case", "after", "skin", "profile", "seconds", "precision")
        found += [f"{each}: not beside --output" for each in other]
    if given.table:
        other = named("n", "phi", "case", "after", "skin", "profile") + ["--set"] * bool(given.overrides)
        found += [f"{each}: not beside --table, which has gases of its own" for each in other]
    else:
        found += [f"{each}: only beside --table" for each in named("most", "clustered")]
        if given.case is not None:
            keys = {"--n": "number of a species", "--phi": "box.packing_fraction"}
            found += [
                f"{each}: not beside --case; --set changes the case's {keys[each]}"
                for each in named("n", "phi")
            ]
        else:
            other = named("after") + ["--set"] * bool(given.overrides)
            found += [f"{each}: only beside --case" for each in other]
    return found
