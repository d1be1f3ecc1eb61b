"""The table of `ifrdem bench --table`: the gases, the figures to reach, and Markdown with what was measured."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from ...case import summary
from ...case.case import Case
from ...run import progress
from ...simulation import device
from . import bench, compile_time, equilibrium
from .bench import Benchmark, Note
from .options import BenchOptions

COLUMNS = ("gas", "measured", "to reach", "reached")
REFERENCE = (100_000, 0.3)  # what the cost of a larger gas is compared with
BYTES, BYTES_AT = 250.0, (1_000_000, 0.3)
WARM_START, WARM_START_N = 2.0, 10_000


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
        if self.clustered:
            return (
                f"coins in clusters, N = {self.n:.0e}, phi = {self.phi:g}, after {AFTER:g} per disk".replace(
                    "e+0", "e"
                )
            )
        return f"elastic, N = {self.n:.0e}, phi = {self.phi:g}".replace("e+0", "e")


AFTER = 300.0
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


@dataclass(frozen=True)
class Row:
    """A line of the table: what was measured beside what was to be reached."""

    name: str
    measured: str
    target: str
    reached: bool

    def markdown(self) -> str:
        return f"| {self.name} | {self.measured} | {self.target} | {'yes' if self.reached else 'no'} |"


def entries(most: int, clustered: bool) -> list[Entry]:
    """The gases up to so many disks, in the order in which they run."""
    wanted = [*GRID, CLUSTERED] if clustered else list(GRID)
    return [each for each in wanted if each.n <= most]


def measure(options: BenchOptions, *, say: Callable[[str], None], note: Note) -> None:
    """Measure gas after gas, and say each row as soon as it is known (or JSON at the end).

    Raises
    ------
    InputError
        If a gas does not fit into the memory: before anything runs.
    """
    import json

    chosen = entries(options.most, options.clustered)
    summary.refuse_beyond_memory(max(each.n for each in chosen), options.arch)
    if not options.json:
        say(f"{heading(options)}\n\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    figures: list[dict[str, Any]] = []
    rows: list[Row] = []
    for row, figure in _rows(chosen, options, note):
        rows.append(row)
        figures += [figure] if figure is not None else []
        if not options.json:
            say(row.markdown())
    if options.json:
        table = [dict(zip(COLUMNS, (r.name, r.measured, r.target, r.reached), strict=True)) for r in rows]
        say(json.dumps({"table": table, "benchmarks": figures, **bench.environment()}, indent=2))


def heading(options: BenchOptions) -> str:
    """The line above the table: on what it was measured."""
    own = bench.environment()
    threads = options.threads or int(own["cores"])
    used = f"{threads} {'thread' if threads == 1 else 'threads'} of {own['processor']}"
    return (
        f"{used if options.arch == 'cpu' else options.arch}, {options.precision}; ifrdem {own['ifrdem']}, "
        f"Taichi {own['taichi']}, Python {own['python']}; {own['date']}. "
        f"Collisions/s: median (range) of {options.timing.runs} runs."
    )


def gas_row(entry: Entry, found: Benchmark, reference: float | None) -> Row:
    """The row of a gas; `reference` is the rate of the gas `REFERENCE`, if that was measured."""
    measured = f"{_power(found.rate)} ({_power(min(found.rates))} to {_power(max(found.rates))})"
    if entry.relative:
        target = f"at most {entry.target:g} times the cost per collision at N = {REFERENCE[0]:.0e}".replace(
            "e+0", "e"
        )
        cost = reference / found.rate if reference is not None and found.rate else math.nan
        return Row(entry.name, f"{measured}, {cost:.3g} times the cost", target, cost <= entry.target)
    target = _power(entry.target)
    if entry.clustered:
        epoch = sum(run.seconds for run in found.runs) / max(found.total("epochs"), 1)
        measured += f"; an epoch takes {epoch:.3g} s, the slowest {found.slowest_epoch:.3g} s"
        target += ", no epoch that stalls"
    return Row(entry.name, measured, target, found.rate >= entry.target)


def memory_row(found: Benchmark) -> Row:
    """The row of the memory, of the gas `BYTES_AT`."""
    target = f"{BYTES:g} bytes a disk"
    measured = f"{found.bytes_per_disk:.4g} bytes a disk"
    return Row(
        f"memory at N = {found.n:.0e}".replace("e+0", "e"), measured, target, found.bytes_per_disk <= BYTES
    )


def start_row(cold: float, warm: float) -> Row:
    """The row of the start of `ifrdem run`."""
    name = f"warm start of `ifrdem run` to its first progress, N = {WARM_START_N:.0e}".replace("e+0", "e")
    return Row(name, f"{warm:.3g} s (cold: {cold:.3g} s)", f"{WARM_START:g} s", warm <= WARM_START)


def clustered_coins(entry: Entry, options: BenchOptions) -> Case:
    """Coins of 1 pta that cool from a random start."""
    run: dict[str, Any] = {"name": "coins", "seed": options.seed, "arch": options.arch}
    if options.threads is not None:
        run["threads"] = options.threads
    return Case.model_validate(
        {
            "run": {**run, "precision": options.precision, "collisions_per_disk": AFTER},
            "box": {"packing_fraction": entry.phi},
            "species": [{"name": "1 pta", "number": entry.n, "coin": "1 pta", "speed_rms": 1.0}],
        }
    )


def _rows(
    chosen: list[Entry], options: BenchOptions, note: Note
) -> Iterator[tuple[Row, dict[str, Any] | None]]:
    """Each row, with the figures of a gas where it is one's."""
    run_options: dict[str, Any] = {
        "arch": options.arch,
        "threads": options.threads,
        "precision": options.precision,
    }
    if options.timing.compiling:
        note("timing the start of `ifrdem run`, cold and warm")
        yield start_row(*compile_time.measure_run(WARM_START_N, **run_options)), None
    timing = bench.Timing(options.timing.runs, options.timing.seconds, compiling=False)
    began, reference = time.perf_counter(), None
    for i, entry in enumerate(chosen):
        seconds = time.perf_counter() - began
        done, left = (sum(_expected(each, timing) for each in part) for part in (chosen[:i], chosen[i:]))
        # The first guess goes by the targets; then by how far the guesses were off so far.
        eta = left * (seconds / done if done else 1.0)
        note(f"gas {i + 1} of {len(chosen)}: {entry.name}; ETA of the table {progress.clock_face(eta)}")
        if entry.clustered:
            found = bench.measure(clustered_coins(entry, options), timing=timing, after=AFTER, note=note)
        else:
            case = equilibrium.elastic_gas(entry.n, entry.phi, seed=options.seed, **run_options)
            found = bench.measure(case, timing=timing, note=note)
        elastic = None if entry.clustered else (entry.n, entry.phi)
        if elastic == REFERENCE:
            reference = found.rate
        yield gas_row(entry, found, reference), found.figures()
        if elastic == BYTES_AT:
            yield memory_row(found), None
        device.stop()  # Taichi keeps the memory of arrays of vectors until then


def _expected(entry: Entry, timing: bench.Timing) -> float:
    """Seconds that an entry takes if it just reaches its target."""
    rate = entry.target if not entry.relative else 2e6 / entry.target
    per_disk = AFTER if entry.clustered else 15.0 if entry.phi > 0.5 else 10.0
    epochs = 0.5 * entry.n * bench.LEAST_EPOCHS / rate  # at one collision per disk and epoch
    placing = 5e-6 * entry.n
    return 1.0 + placing + 0.5 * entry.n * per_disk / rate + timing.runs * max(timing.seconds, epochs)


def _power(value: float) -> str:
    """1.23e6."""
    return f"{value:.2e}".replace("e+0", "e").replace("e+", "e")
