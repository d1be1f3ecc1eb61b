"""A grid of gases beside the speeds to reach, as Markdown: `python -m ifrdem.validation.speed.table --most 1000000`."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from ...case import summary
from ...case.case import Case
from ...errors import InputError
from ...simulation import device
from . import bench
from .bench import Benchmark

COLUMNS = ("gas", "measured", "to reach", "reached")
REFERENCE = (100_000, 0.3)  # the gas that the cost of a larger one is compared with
BYTES, BYTES_AT = 250.0, (1_000_000, 0.3)
AFTER = 300.0


@dataclass(frozen=True)
class Entry:
    """A gas of the table.

    Attributes
    ----------
    n, phi : int, float
        Disks and packing fraction.
    target : float
        Collisions per second to reach or, with `relative`, the most that a collision may cost, in units of its
        cost in the gas `REFERENCE`.
    clustered : bool
        Coins, after `AFTER` collisions per disk, instead of elastic disks at equilibrium.
    """

    n: int
    phi: float
    target: float
    relative: bool = False
    clustered: bool = False

    @property
    def name(self) -> str:
        gas, end = ("coins in clusters", f", after {AFTER:g} per disk") if self.clustered else ("elastic", "")
        return f"{gas}, N = {_power(self.n, 0)}, phi = {self.phi:g}{end}"


GRID = (
    Entry(1_000, 0.3, 2e6),
    Entry(10_000, 0.3, 2e6),
    Entry(100_000, 0.3, 2e6),
    Entry(1_000_000, 0.1, 1.0e6),
    Entry(1_000_000, 0.3, 1.7e6),
    Entry(1_000_000, 0.6, 3e6),
    Entry(10_000_000, 0.3, 1.3, relative=True),
)
CLUSTERED = Entry(200_000, 0.3, 5e5, clustered=True)


def entries(most: int, clustered: bool) -> list[Entry]:
    """The gases up to so many disks, in the order in which they run."""
    return [each for each in (*GRID, *([CLUSTERED] if clustered else [])) if each.n <= most]


def table(
    *, most: int = 10_000_000, clustered: bool = False, runs: int = bench.RUNS, seconds: float = bench.SECONDS,
    arch: str = "cpu", threads: int | None = None, precision: str = "f64", seed: int = 1,
) -> None:  # fmt: skip
    """Print a row for each gas of the grid up to `most` disks as soon as it is measured.

    With `clustered`, a cooling gas in clusters too, which takes minutes."""
    chosen = entries(most, clustered)
    if not chosen:
        raise InputError(f"--most {most}: the smallest gas of the table has {GRID[0].n} disks")
    summary.refuse_beyond_memory(max(each.n for each in chosen), arch)
    own = bench.environment()
    number = threads or int(own["cores"])
    used = f"{number} thread{'s' * (number > 1)} of {own['processor']}" if arch == "cpu" else arch
    print(
        f"{used}, {precision}; ifrdem {own['ifrdem']}, Taichi {own['taichi']}, Python {own['python']}; {own['date']}. "
        f"Collisions/s: median (range) of {runs} runs.\n\n{_markdown(*COLUMNS)}\n|{'---|' * len(COLUMNS)}", flush=True
    )  # fmt: skip
    gas: dict[str, Any] = {"arch": arch, "threads": threads, "precision": precision, "seed": seed}
    reference = None
    for entry in chosen:
        case = (
            clustered_coins(entry, **gas) if entry.clustered else bench.elastic_gas(entry.n, entry.phi, **gas)
        )
        found = bench.measure(case, runs=runs, seconds=seconds, after=AFTER if entry.clustered else None)
        elastic = None if entry.clustered else (entry.n, entry.phi)
        if elastic == REFERENCE:
            reference = found.rate
        print(gas_row(entry, found, reference), flush=True)
        if elastic == BYTES_AT:
            print(memory_row(found), flush=True)
        device.stop()  # Taichi keeps the memory of arrays of vectors until then


def gas_row(entry: Entry, found: Benchmark, reference: float | None) -> str:
    """The row of a gas; `reference` is the rate of the gas `REFERENCE`, if that was measured."""
    measured = f"{_power(found.rate)} ({_power(min(found.rates))} to {_power(max(found.rates))})"
    if entry.relative:
        target = f"at most {entry.target:g} times the cost per collision at N = {_power(REFERENCE[0], 0)}"
        cost = reference / found.rate if reference is not None and found.rate else math.nan
        return _row(entry.name, f"{measured}, {cost:.3g} times the cost", target, cost <= entry.target)
    target = _power(entry.target)
    if entry.clustered:
        own = found.figures()
        measured += f"; a window takes {own['seconds_per_window']:.3g} s, "
        measured += f"the slowest {own['slowest_window_seconds']:.3g} s"
        target += ", no window that stalls"
    return _row(entry.name, measured, target, found.rate >= entry.target)


def memory_row(found: Benchmark) -> str:
    """The row of the memory, of the gas `BYTES_AT`."""
    name, size = f"memory at N = {_power(found.n, 0)}", found.bytes_per_disk
    return _row(name, f"{size:.4g} bytes a disk", f"{BYTES:g} bytes a disk", size <= BYTES)


def clustered_coins(entry: Entry, *, threads: int | None, **run: Any) -> Case:
    """Coins of 1 pta that cool from a random start."""
    run |= {"name": "coins", "collisions_per_disk": AFTER} | ({} if threads is None else {"threads": threads})
    coins = {"name": "1 pta", "number": entry.n, "coin": "1 pta", "speed_rms": 1.0}
    return Case.model_validate({"run": run, "box": {"packing_fraction": entry.phi}, "species": [coins]})


def _row(name: str, measured: str, target: str, reached: bool) -> str:
    return _markdown(name, measured, target, "yes" if reached else "no")


def _markdown(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _power(value: float, digits: int = 2) -> str:
    """1.23e6."""
    return f"{value:.{digits}e}".replace("e+0", "e").replace("e+", "e")


if __name__ == "__main__":
    sys.exit(bench.script(table))
