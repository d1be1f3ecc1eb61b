"""Gases compared with target speeds, as Markdown: `python -m ifrdem.validation.speed.table --most 1000000`."""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...case import summary
from ...case.case import CaseSections
from ...errors import InputError
from ...simulation import backend
from ...tools.arguments import script
from . import bench
from .bench import Benchmark, TimedRun

COLUMNS = ("gas", "measured", "target", "reached")
AFTER = 300.0  # collisions per disk, after which coins are in clusters
BIG = 10.0  # radius of the larger disks of two sizes, of the smaller one's
Timed = Callable[[float], TimedRun]
"""A function that times a run of so many seconds."""


@dataclass(frozen=True)
class Speed:
    """Collisions per second to reach, by elastic disks at equilibrium or by coins in clusters."""

    n: int
    phi: float
    target: float  # collisions per second
    threads: int | None = None  # by default as many as the table is for
    # Makes it coins after `AFTER` collisions per disk, no window of which may take longer [s].
    slowest: float | None = None

    @property
    def name(self) -> str:
        gas, end = (
            ("elastic", "") if self.slowest is None else ("coins in clusters", f", after {AFTER:g} per disk")
        )
        return f"{gas}, N = {_power(self.n, 0)}, phi = {self.phi:g}{end}{', one thread' if self.threads == 1 else ''}"

    def measure(self, runs: int, seconds: float, **gas: Any) -> str:
        """Its row."""
        gas |= {} if self.threads is None else {"threads": self.threads}
        make, after = (bench.elastic_gas, None) if self.slowest is None else (coins, AFTER)
        return self.row(bench.measure(make(self.n, self.phi, **gas), runs=runs, seconds=seconds, after=after))

    def row(self, found: Benchmark) -> str:
        measured, target = f"{_power(found.rate)} {_range(found.rates, _power)}", _power(self.target)
        reached = found.rate >= self.target
        if self.slowest is not None:
            slowest = max(run.slowest for run in found.runs)
            measured += f"; the slowest window took {slowest:.3g} s"
            target += f", no window above {self.slowest:g} s"
            reached &= slowest <= self.slowest
        return _row(self.name, measured, target, reached)


@dataclass(frozen=True)
class Cost:
    """Time a collision in one gas, in units of that in another, at most: one run of each in turn."""

    name: str
    n: int
    target: float  # the most that it may be
    make: Callable[..., tuple[Timed, Timed]]  # of both gases

    def measure(self, runs: int, seconds: float, **gas: Any) -> str:
        """Its row."""
        one, other = self.make(self.n, **gas)
        return self.row([other(seconds).rate / one(seconds).rate for _ in range(runs)])

    def row(self, costs: list[float]) -> str:
        cost = statistics.median(costs)
        measured = f"{cost:.3g} times {_range(costs, lambda value: f'{value:.3g}')}"
        return _row(
            f"{self.name}, N = {_power(self.n, 0)}", measured, f"{self.target:g} times", cost <= self.target
        )


@dataclass(frozen=True)
class Memory:
    """Bytes a disk that the engine's arrays may take, with the energy ledger."""

    n: int
    target: float

    def measure(self, runs: int, seconds: float, **gas: Any) -> str:
        """Its row."""
        case = with_ledger(bench.elastic_gas(self.n, 0.3, **gas))
        return self.row(bench.measure(case, runs=1, seconds=0.0))

    def row(self, found: Benchmark) -> str:
        size = found.bytes_per_disk
        name = f"memory at N = {_power(self.n, 0)}, ledger included"
        return _row(
            name, f"{size:.4g} bytes per disk", f"{self.target:g} bytes per disk", size <= self.target
        )


def coins(n: int, phi: float, *, device: str, threads: int | None, **run: Any) -> CaseSections:
    """Coins of 1 pta that cool from a random start."""
    run |= {"name": "coins", "device": device, "collisions_per_disk": AFTER} | (
        {} if threads is None else {"threads": threads}
    )
    species = {"name": "1 pta", "number": n, "coin": "1 pta", "speed_rms": 1.0}
    return CaseSections.model_validate({"run": run, "box": {"packing_fraction": phi}, "species": [species]})


def two_sizes(n: int, phi: float, **gas: Any) -> CaseSections:
    """Elastic disks of two sizes with equal areas."""
    case = bench.elastic_gas(n, phi, **gas).model_dump(exclude_none=True, exclude_unset=True)
    (disks,) = case["species"]
    del disks["radius"], disks["mass"]
    disks["areal_density"] = bench.MASS / (math.pi * bench.RADIUS**2)
    share = round(n / (1.0 + BIG**2)) / n
    radii = {"low": bench.RADIUS, "high": BIG * bench.RADIUS, "large_fraction": share}
    disks["radii"] = {"distribution": "bidisperse", **radii}
    return CaseSections.model_validate(case | {"start": {"positions": "grown"}})


def with_ledger(case: CaseSections) -> CaseSections:
    """A copy of a case with the energy ledger."""
    return case.model_copy(update={"output": case.output.model_copy(update={"ledger": True})})


def timing(case: CaseSections, after: float | None = None) -> Timed:
    """A function that times a run of the gas of a case, which is warm."""
    _, simulation = bench.prepared(case, after=after)
    return lambda seconds: bench.timed(simulation, seconds)


def thin(phi: float, target: float) -> Cost:
    """The cost of a collision in a thin gas against phi = 0.1."""

    def make(n: int, **gas: Any) -> tuple[Timed, Timed]:
        return timing(bench.elastic_gas(n, phi, **gas)), timing(bench.elastic_gas(n, 0.1, **gas))

    return Cost(f"a collision at phi = {phi:g}, against phi = 0.1", 10_000, target, make)


def unequal(n: int, **gas: Any) -> tuple[Timed, Timed]:
    """Two sizes against one."""
    return timing(two_sizes(n, 0.5, **gas), 5.0), timing(bench.elastic_gas(n, 0.5, **gas))


def accounted(n: int, **gas: Any) -> tuple[Timed, Timed]:
    """The IFR law with the ledger against the same gas without."""
    _, simulation = bench.prepared(with_ledger(coins(n, 0.3, **gas)), after=2.0)

    def switched(on: bool) -> Timed:
        def run(seconds: float) -> TimedRun:
            simulation.switch_ledger(on)
            bench.timed(simulation, 0.0)  # compiles its kernels
            return bench.timed(simulation, seconds)

        return run

    return switched(True), switched(False)


ROWS: tuple[Speed | Cost | Memory, ...] = (
    Speed(1_000, 0.3, 2.2e6, threads=1),
    Speed(10_000, 0.3, 2.2e6, threads=1),
    thin(1e-4, 8.0),
    thin(1e-6, 70.0),
    Cost("two sizes 1 : 10 of equal areas, against one, phi = 0.5", 10_000, 2.0, unequal),
    Speed(100_000, 0.1, 1.5e6),
    Speed(100_000, 0.3, 2.4e6),
    Speed(100_000, 0.6, 2.8e6),
    Cost("the IFR law with the energy ledger, against the same without", 100_000, 1.1, accounted),
    Speed(200_000, 0.3, 1e6, slowest=0.3),
    Speed(1_000_000, 0.1, 1.6e6),
    Speed(1_000_000, 0.3, 2.4e6),
    Speed(1_000_000, 0.6, 3.0e6),
    Memory(1_000_000, 150.0),
    Speed(10_000_000, 0.3, 2.2e6),
)


def table(
    *, most: int = 10_000_000, runs: int = bench.RUNS, seconds: float = bench.SECONDS,
    device: str = "cpu", threads: int | None = None, precision: str = "f64", seed: int = 1,
) -> None:  # fmt: skip
    """Print a row for each gas of up to `most` disks, as soon as it is measured. All take some twenty minutes."""
    chosen = [each for each in ROWS if each.n <= most]
    if not chosen:
        raise InputError(
            f"--most {most}: the smallest gas of the table has {min(each.n for each in ROWS)} disks"
        )
    summary.refuse_beyond_memory(max(each.n for each in chosen), device)
    own = bench.environment()
    number = threads or int(own["cores"])
    used = f"{number} thread{'s' * (number > 1)} of {own['processor']}" if device == "cpu" else device
    print(
        f"{used}, {precision}; ifrdem {own['ifrdem']}, {own['runtime']}, Python {own['python']}; {own['date']}. "
        f"Collisions/s, or the time of one as a multiple: median (range) of {runs} runs.\n\n"
        f"{_markdown(*COLUMNS)}\n|{'---|' * len(COLUMNS)}", flush=True
    )  # fmt: skip
    for each in chosen:
        print(
            each.measure(runs, seconds, device=device, threads=threads, precision=precision, seed=seed),
            flush=True,
        )
        backend.stop()  # the runtime keeps the memory of arrays of vectors until then


def _row(name: str, measured: str, target: str, reached: bool) -> str:
    return _markdown(name, measured, target, "yes" if reached else "no")


def _markdown(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _range(values: list[float], text: Callable[[float], str]) -> str:
    return f"({text(min(values))} to {text(max(values))})"


def _power(value: float, digits: int = 2) -> str:
    """1.23e6."""
    return f"{value:.{digits}e}".replace("e+0", "e").replace("e+", "e")


if __name__ == "__main__":
    sys.exit(script(table))
