"""Options of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass

from ...kernels.limits import MOST_DISKS

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
