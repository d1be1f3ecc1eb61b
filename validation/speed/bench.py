"""Benchmarks: how fast a gas runs, timed over whole epochs with warm kernels.

A timed run goes from the end of an epoch to the end of another, so that no epoch is cut short for it. The process
does nothing else meanwhile; what other processes do to it shows in the range of the runs. A run is long enough to
make the clock's own cost (1 us an epoch) not count.
"""

from __future__ import annotations

import contextlib
import gc
import itertools
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...case import summary
from ...case.case import UNITS, Case
from ...case.gas import Gas
from ...run.progress import Progress
from ...simulation import device
from ...simulation.simulation import Simulation
from ...tools.versions import __version__
from . import compile_time, equilibrium, profiler
from .compile_time import CompileTimes
from .options import Timing
from .profiler import KernelTime

LEAST_EPOCHS = 3  # in a timed run

Note = Callable[[str], None]


@dataclass(frozen=True)
class Run:
    """One timed run of whole epochs.

    Attributes
    ----------
    seconds : float
        Real time [s].
    collisions : int
        Collisions that stand.
    done : dict
        What the engine's `Statistics` grew by: epochs, rounds, undone, violations, cut_for_...
    slowest : float
        The longest epoch [s].
    """

    seconds: float
    collisions: int
    done: dict[str, int]
    slowest: float

    @property
    def rate(self) -> float:
        """Collisions per second."""
        return self.collisions / self.seconds


@dataclass(frozen=True)
class Profile:
    """Where the time of one run under the profiler went; `outside` [s] is Python and launches."""

    run: Run
    kernels: list[KernelTime]

    @property
    def outside(self) -> float:
        return self.run.seconds - sum(each.seconds for each in self.kernels)


@dataclass(frozen=True)
class Benchmark:
    """What was measured of one gas.

    Attributes
    ----------
    gas : str
        What it is.
    n, phi : int, float
        Disks and packing fraction.
    collisions_before : int
        Collisions before the first timed run.
    bytes_per_disk : float
        Memory of the engine's arrays at the end [bytes].
    runs : list of Run
        The timed runs.
    """

    gas: str
    n: int
    phi: float
    arch: str
    threads: int
    precision: str
    seed: int
    skin: float | None
    collisions_before: int
    bytes_per_disk: float
    runs: list[Run]
    profile: Profile | None = None
    compiling: CompileTimes | None = None
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def rates(self) -> list[float]:
        """Collisions per second of each run."""
        return [run.rate for run in self.runs]

    @property
    def rate(self) -> float:
        """Median of the collisions per second."""
        return statistics.median(self.rates)

    @property
    def slowest_epoch(self) -> float:
        """The longest epoch of all runs [s]."""
        return max(run.slowest for run in self.runs)

    def total(self, name: str) -> int:
        """Sum over the runs of one of the engine's statistics."""
        return sum(run.done[name] for run in self.runs)

    def figures(self) -> dict[str, Any]:
        """Everything, flat and by the names that the JSON has."""
        epochs = self.total("epochs")
        collisions = sum(run.collisions for run in self.runs)
        seconds = sum(run.seconds for run in self.runs)
        disk_epochs = self.n * max(epochs, 1)
        undone = self.total("undone")
        return {
            "gas": self.gas,
            "n": self.n,
            "phi": self.phi,
            "arch": self.arch,
            "threads": self.threads,
            "precision": self.precision,
            "seed": self.seed,
            "skin": self.skin,
            "collisions_per_second": self.rate,
            "collisions_per_second_min": min(self.rates),
            "collisions_per_second_max": max(self.rates),
            "ns_per_collision": 1e9 / self.rate if self.rate else None,
            "thread_ns_per_disk_and_epoch": 1e9 * seconds * self.threads / disk_epochs,
            "collisions_per_disk_and_epoch": 2.0 * collisions / disk_epochs,
            "collisions_before": self.collisions_before,
            "collisions": collisions,
            "epochs": epochs,
            "rounds_per_epoch": self.total("rounds") / max(epochs, 1),
            "undone_share": undone / max(collisions + undone, 1),
            "epochs_cut": {
                name: self.total(name) for name in self.runs[0].done if name.startswith("cut_for")
            },
            "seconds_per_epoch": seconds / max(epochs, 1),
            "slowest_epoch_seconds": self.slowest_epoch,
            "bytes_per_disk": self.bytes_per_disk,
            "runs": [
                {
                    "seconds": run.seconds,
                    "collisions": run.collisions,
                    "collisions_per_second": run.rate,
                    "slowest_epoch_seconds": run.slowest,
                    **run.done,
                }
                for run in self.runs
            ],
            "compile": asdict(self.compiling) if self.compiling is not None else None,
            "profile": _profile_figures(self.profile) if self.profile is not None else None,
            **self.environment,
        }

    def report(self) -> str:
        """Everything as lines to read."""
        own = self.figures()
        threads = (
            f", {self.threads} {'thread' if self.threads == 1 else 'threads'}" if self.arch == "cpu" else ""
        )
        cut = ", ".join(
            f"{name.removeprefix('cut_for_')} {count}" for name, count in own["epochs_cut"].items()
        )
        range_ = f"{min(self.rates):.4g} to {max(self.rates):.4g}, {len(self.runs)} runs"
        lines = [
            f"{self.gas}: {self.n} disks, packing fraction {self.phi:.4g}, "
            f"after {2.0 * self.collisions_before / self.n:.4g} collisions per disk",
            f"on {self.arch}{threads}, {self.precision}; {self.environment['processor']}",
            _row("collisions/s", f"{self.rate:.4g} (median; {range_})"),
            _row("time a collision", f"{1e9 / self.rate:.4g} ns" if self.rate else "none happened"),
            _row("time a disk and epoch", f"{own['thread_ns_per_disk_and_epoch']:.4g} ns, times threads"),
            _row("collisions", f"{own['collisions_per_disk_and_epoch']:.4g} per disk and epoch"),
            _row("epochs", f"{own['epochs']}, {own['rounds_per_epoch']:.4g} rounds each; cut short: {cut}"),
            _row(
                "time an epoch",
                f"{1e3 * own['seconds_per_epoch']:.4g} ms, the slowest {1e3 * self.slowest_epoch:.4g} ms",
            ),
            _row("undone", f"{100.0 * own['undone_share']:.3g} % of all collisions processed"),
            _row("memory", f"{self.bytes_per_disk:.4g} bytes a disk"),
        ]
        if self.compiling is not None:
            for name, start in (("cold", self.compiling.cold), ("warm", self.compiling.warm)):
                lines.append(
                    _row(
                        f"start, kernels {name}",
                        f"{start.first_epoch:.3g} s to the first epoch, {start.all_kernels:.3g} s to the "
                        f"last kernel ({start.imports:.2g} s of it imports)",
                    )
                )
        if self.profile is not None:
            lines += _profile_lines(self.profile)
        return "\n".join(lines)


def measure(
    case: Case,
    folder: Path | str = ".",
    *,
    timing: Timing = Timing(),  # noqa: B008  (frozen)
    after: float | None = None,
    note: Note = lambda _: None,
) -> Benchmark:
    """Time the gas of a case.

    Parameters
    ----------
    case : Case
        The gas, device, threads and precision. What ends the case does not matter.
    folder : path
        Where a start file's path begins.
    timing : Timing
        How to time it.
    after : float, optional
        Collisions per disk before it is timed; without it the gas is taken to be `equilibrium.elastic_gas`, and
        runs for its mixing time.
    note : callable
        Takes lines that say how far it is. A bar of `Progress` stands on the standard error stream meanwhile.

    Notes
    -----
    A profile ends Taichi, and with it every other simulation of the process.

    Raises
    ------
    InputError
        If the device is not there, the memory does not suffice, or the disks do not fit the box.
    EngineError
        If the engine stops, as it does where nothing ever collides.
    """
    run = case.run
    device.check(run.arch, run.threads, run.precision)
    summary.refuse_beyond_memory(sum(each.number for each in case.species), run.arch, case.start.positions)
    gas = Gas.from_case(case, folder)
    phi = gas.room.packing_fraction(gas.disks.radius)
    compiling = None
    if timing.compiling:
        note("starting fresh processes, for the times of a cold and of a warm start")
        compiling = compile_time.measure(
            gas.disks.n, phi, arch=run.arch, threads=run.threads, precision=run.precision
        )
    skin = None if timing.skin is None else timing.skin * 2.0 * float(gas.disks.radius.max())
    simulation = gas.simulation(case, skin=skin)
    _prepare(simulation, gas, case, after)
    before = simulation.collisions
    runs = []
    for i in range(timing.runs):
        runs.append(timed(simulation, timing.seconds))
        note(f"run {i + 1} of {timing.runs}: {runs[-1].rate:.4g} collisions/s")
    size = simulation.bytes_allocated / gas.disks.n
    profile = None
    if timing.profile:
        state = simulation.state
        del simulation  # its arrays end with the Taichi that they belong to
        gc.collect()
        try:
            device.start(run.arch, threads=run.threads, precision=run.precision, profile=True)
            simulation = gas.simulation(case, state, skin=skin)
            warm_up(simulation)
            profiler.forget()
            profiled = timed(simulation, timing.seconds)
            profile = Profile(profiled, profiler.kernel_times())
        finally:
            device.stop()
    return Benchmark(
        gas="elastic gas" if after is None else run.name,
        n=gas.disks.n,
        phi=phi,
        arch=run.arch,
        threads=(run.threads or device.cores()) if run.arch == "cpu" else 1,
        precision=run.precision,
        seed=run.seed,
        skin=timing.skin,
        collisions_before=before,
        bytes_per_disk=size,
        runs=runs,
        profile=profile,
        compiling=compiling,
        environment=environment(),
    )


class _LongEnough(Exception):
    """Ends a timed run between two epochs."""


def warm_up(simulation: Simulation) -> None:
    """Run every kernel once at least, and a few epochs."""
    # An epoch that ends at a number of collisions is cut short; what that needs runs seldom otherwise.
    few = max(1, simulation.disks.n // 20)
    simulation.run(collisions_per_disk=2.0 * (simulation.collisions + few) / simulation.disks.n)
    timed(simulation, 0.0)


def timed(simulation: Simulation, seconds: float) -> Run:
    """Run whole epochs for at least so many seconds, and `LEAST_EPOCHS`."""
    import taichi as ti

    endless = 1e6 + 2.0 * simulation.collisions / simulation.disks.n
    collisions, before = simulation.collisions, asdict(simulation.statistics)
    ti.sync()
    marks = [time.perf_counter()]

    def after_epoch(*_: object) -> None:
        ti.sync()  # a GPU may still be at it
        marks.append(time.perf_counter())
        if marks[-1] - marks[0] >= seconds and len(marks) > LEAST_EPOCHS:
            raise _LongEnough

    with contextlib.suppress(_LongEnough):
        simulation.run(collisions_per_disk=endless, progress=after_epoch)
    return Run(
        seconds=marks[-1] - marks[0],
        collisions=simulation.collisions - collisions,
        done={name: value - before[name] for name, value in asdict(simulation.statistics).items()},
        slowest=max(end - begin for begin, end in itertools.pairwise(marks)),
    )


def environment() -> dict[str, str]:
    """Versions, processor and date of a measurement."""
    from importlib.metadata import version

    return {
        "ifrdem": __version__,
        "taichi": version("taichi"),
        "python": platform.python_version(),
        "processor": device.cpu_name(),
        "cores": str(device.cores()),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _prepare(simulation: Simulation, gas: Gas, case: Case, after: float | None) -> None:
    """Run to where the timing begins."""
    if after is None:
        # To a time: while the lattice's disks have not met yet, a run by collisions would give up.
        end = equilibrium.mixing_time(gas)
        with Progress(gas.disks.n, t_end=end, unit="") as progress:
            simulation.run(t_end=end, progress=progress)
    elif after > 0.0:
        unit = UNITS[case.run.units]["time"] if case.run.units == "SI" else ""
        with Progress(gas.disks.n, collisions_per_disk=after, unit=unit) as progress:
            simulation.run(collisions_per_disk=after, progress=progress)
    warm_up(simulation)


def _profile_figures(profile: Profile) -> dict[str, Any]:
    seconds = profile.run.seconds
    return {
        "seconds": seconds,
        "collisions_per_second": profile.run.rate,
        "outside_kernels_seconds": profile.outside,
        "outside_kernels_share": profile.outside / seconds,
        "kernels": [{**asdict(each), "share": each.seconds / seconds} for each in profile.kernels],
    }


def _profile_lines(profile: Profile) -> list[str]:
    seconds = profile.run.seconds
    lines = [
        f"share of each kernel, in a run of {seconds:.3g} s under the profiler "
        f"({profile.run.rate:.4g} collisions/s)",
        f"  {'kernel':<32} {'calls':>9} {'seconds':>10} {'share':>8}",
    ]
    for each in profile.kernels:
        share = 100.0 * each.seconds / seconds
        lines.append(f"  {each.kernel:<32} {each.calls:>9} {each.seconds:>10.4g} {share:>6.1f} %")
    share = 100.0 * profile.outside / seconds
    lines.append(f"  {'outside: Python, launches':<32} {'':>9} {profile.outside:>10.4g} {share:>6.1f} %")
    return lines


def _row(name: str, text: str) -> str:
    return f"  {name:<22} {text}"
