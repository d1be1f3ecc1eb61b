"""Speed of a gas: collisions a second over whole windows with warm kernels, medians of several runs.

A timed run goes from the end of a window to the end of another. The process does nothing else meanwhile; the range of
the runs shows the load by other processes. The clock's own cost is 1 us a launch: a window, or up to 64 of a small gas.
"""

from __future__ import annotations

import contextlib
import gc
import math
import platform
import re
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ... import theory
from ...case import file as case_file
from ...case import shipped, summary
from ...case.case import UNITS, CaseSections
from ...case.gas import CaseGas
from ...errors import InputError
from ...kernels.columns import bytes_per_disk
from ...kernels.compiler import runtime
from ...mpi import SERIAL, Communicator
from ...simulation import backend
from ...simulation.simulation import Simulation
from ...tools.progress import Progress
from ...tools.versions import __version__, revision

RUNS, SECONDS = 5, 0.5
LEAST_LAUNCHES = 3  # in a timed run
SENT = ("messages", "rounds", "ghosts", "hashes", "sums", "seconds")
PIECES = 20  # of what passes before the first timed run, for its progress
RADIUS, MASS, TEMPERATURE = 0.5, 1.0, 1.0  # reduced units: lengths are in diameters

# run_windows_c80_0_kernel_11_range_for: kernel, its number, that of the instance, that of the loop, the kind of loop
_TASK = re.compile(r"(?P<instance>(?P<kernel>.+)_c\d+_\d+)_kernel_\d+_\w+")

Note = Callable[[str], None]


@dataclass(frozen=True)
class TimedRun:
    """One timed run of whole windows."""

    seconds: float  # real time
    collisions: int  # that stand
    done: dict[str, int]  # growth of the engine's `Statistics`: windows, in_order, run_again, elastic
    slowest: float  # the longest window [s]; where one launch runs several, their mean

    @property
    def rate(self) -> float:
        """Collisions per second."""
        return self.collisions / self.seconds


@dataclass(frozen=True)
class KernelTime:
    """A kernel: number of calls and seconds of all of them."""

    kernel: str
    calls: int
    seconds: float


@dataclass(frozen=True)
class Profile:
    """Kernel times of one run under the runtime's profiler; `outside` [s] is Python and launches."""

    run: TimedRun
    kernels: list[KernelTime]

    @property
    def outside(self) -> float:
        return self.run.seconds - sum(each.seconds for each in self.kernels)

    def figures(self) -> dict[str, Any]:
        """All figures, by the names of the JSON."""
        seconds = self.run.seconds
        return {
            "seconds": seconds,
            "collisions_per_second": self.run.rate,
            "outside_kernels_seconds": self.outside,
            "outside_kernels_share": self.outside / seconds,
            "kernels": [{**asdict(each), "share": each.seconds / seconds} for each in self.kernels],
        }

    def lines(self) -> list[str]:
        """The figures as lines of text."""
        rows = [(each.kernel, each.calls, each.seconds) for each in self.kernels]
        return [
            f"share of each kernel, in a run of {self.run.seconds:.3g} s under the profiler "
            f"({self.run.rate:.4g} collisions/s)",
            f"  {'kernel':<32} {'calls':>9} {'seconds':>10} {'share':>8}",
            *(
                f"  {name:<32} {calls:>9} {seconds:>10.4g} {100.0 * seconds / self.run.seconds:>6.1f} %"
                for name, calls, seconds in [*rows, ("outside: Python, launches", "", self.outside)]
            ),
        ]


@dataclass(frozen=True)
class Benchmark:
    """Measured speed and memory of one gas."""

    gas: str  # its name
    n: int
    phi: float
    device: str
    threads: int
    precision: str
    seed: int
    collisions_before: int  # before the first timed run
    bytes_per_disk: float  # memory of the engine's arrays at the end
    runs: list[TimedRun]
    ranks: int = 1
    low_memory: bool = False  # of the run
    sent: dict[str, float] | None = None  # by a rank in a window, of several: messages, rounds, bytes
    profile: Profile | None = None
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def rates(self) -> list[float]:
        """Collisions per second of each run."""
        return [run.rate for run in self.runs]

    @property
    def rate(self) -> float:
        """Median of the collisions per second."""
        return statistics.median(self.rates)

    def total(self, name: str) -> int:
        """Sum over the runs of one of the engine's statistics."""
        return sum(run.done[name] for run in self.runs)

    def figures(self) -> dict[str, Any]:
        """All figures, by the names of the JSON."""
        windows = max(self.total("windows"), 1)
        collisions = sum(run.collisions for run in self.runs)
        seconds = sum(run.seconds for run in self.runs)
        settings = ("gas", "n", "phi", "device", "threads", "precision", "seed", "collisions_before")
        return {
            **{name: getattr(self, name) for name in settings},
            "collisions_per_second": self.rate,
            "collisions_per_second_min": min(self.rates),
            "collisions_per_second_max": max(self.rates),
            "ns_per_collision": 1e9 / self.rate if self.rate else None,
            "thread_ns_per_disk_and_window": 1e9 * seconds * self.threads / (self.n * windows),
            "collisions_per_disk_and_window": 2.0 * collisions / (self.n * windows),
            "collisions": collisions,
            "windows": self.total("windows"),
            "windows_in_order": self.total("in_order"),
            "tiles_run_again": self.total("run_again"),
            "seconds_per_window": seconds / windows,
            "slowest_window_seconds": max(run.slowest for run in self.runs),
            "bytes_per_disk": self.bytes_per_disk,
            "ranks": self.ranks,
            "sent_by_a_rank_and_window": self.sent,
            "runs": [
                {
                    "seconds": run.seconds,
                    "collisions": run.collisions,
                    "collisions_per_second": run.rate,
                    "slowest_window_seconds": run.slowest,
                    **run.done,
                }
                for run in self.runs
            ],
            "profile": self.profile.figures() if self.profile is not None else None,
            **self.environment,
        }

    def report(self) -> str:
        """All figures as lines to read."""
        own = self.figures()
        threads = f", {self.threads} thread{'s' * (self.threads > 1)}" if self.device == "cpu" else ""
        range_ = f"{min(self.rates):.4g} to {max(self.rates):.4g}, {len(self.runs)} runs"
        rows = {
            "collisions/s": f"{self.rate:.4g} (median; {range_})",
            "time a collision": f"{1e9 / self.rate:.4g} ns" if self.rate else "none happened",
            "time a disk and window": f"{own['thread_ns_per_disk_and_window']:.4g} ns, times threads",
            "collisions": f"{own['collisions_per_disk_and_window']:.4g} per disk and window",
            "windows": f"{own['windows']}; tiles run again: {own['tiles_run_again']}, "
            f"windows of the whole box in order instead: {own['windows_in_order']}",
            "time a window": f"{1e3 * own['seconds_per_window']:.4g} ms, "
            f"the slowest {1e3 * own['slowest_window_seconds']:.4g} ms",
            "memory": f"{bytes_per_disk(self.low_memory)} bytes per disk of a large gas; {self.bytes_per_disk:.4g} here, with scratch "
            "space of threads, room for moments and records",
        }
        if self.sent is not None:
            kinds = (("ghosts", "disks"), ("hashes", "hashes and ways"), ("sums", "sums"))
            sizes = ", ".join(f"{self.sent[name] / 1e3:.4g} kB of {what}" for name, what in kinds)
            rows["ranks"] = (
                f"{self.ranks}; in a window one sends {self.sent['messages']:.3g} messages: {sizes}"
            )
            seconds = f"{1e3 * self.sent['seconds']:.4g} ms a window"
            rows["exchanges"] = f"{seconds}, verifying and waiting included"
        return "\n".join(
            [
                f"{self.gas}: {self.n} disks, packing fraction {self.phi:.4g}, "
                f"after {2.0 * self.collisions_before / self.n:.4g} collisions per disk",
                f"on {self.device}{threads}, {self.precision}; {self.environment['processor']}",
                *(f"  {name:<22} {text}" for name, text in rows.items()),
                *(self.profile.lines() if self.profile is not None else ()),
            ]
        )


def bench(
    case: str | None = None,
    *,
    overrides: Sequence[str] = (),
    after: float = 0.0,
    n: int = 100_000,
    phi: float = 0.3,
    device: str = "cpu",
    threads: int | None = None,
    precision: str = "f64",
    seed: int = 1,
    **timing: Any,
) -> Benchmark:
    """Time (`measure`) a case file or a shipped case, or else the elastic gas of n disks at packing fraction phi.

    A case, with `overrides` of its keys, has its own device, threads, precision and seed; it is timed after so many
    collisions per disk. InputError as `measure`, and if the case file is wrong.
    """
    if case is not None:
        file = case_file.read(shipped.find(case), list(overrides))
        return measure(file.case, file.folder, after=after, **timing)
    gas = elastic_gas(n, phi, device=device, threads=threads, precision=precision, seed=seed)
    try:
        return measure(gas, **timing)
    except InputError as error:  # of a case that the user does not see
        raise InputError(f"--n {n} --phi {phi:g}: {error}") from None


def measure(
    case: CaseSections,
    folder: Path | str = ".",
    *,
    after: float | None = None,
    runs: int = RUNS,
    seconds: float = SECONDS,
    profile: bool = False,
    note: Note = lambda _: None,
    comm: Communicator = SERIAL,
) -> Benchmark:
    """Time the gas of a case.

    Parameters
    ----------
    case : CaseSections
        The gas, device, threads and precision. The end of the case does not matter.
    folder : path
        Where a start file's path begins.
    after : float, optional
        Collisions per disk before it is timed; without it, the gas is `elastic_gas` and runs for its `mixing_time`.
    runs : int
        Timed runs.
    seconds : float
        Least length of each.
    profile : bool
        Measure the share of each kernel too. That ends Taichi, and with it every other simulation of the process.
    note : callable
        Takes progress lines. A bar of `Progress` stands on the standard error stream meanwhile.
    comm : mpi4py.MPI.Comm, optional
        Ranks of MPI that share the gas.

    Raises
    ------
    InputError
        If the device is not there, the memory does not suffice, or the disks do not fit the box.
    EngineError
        If the engine stops, as it does where nothing ever collides.
    """
    run = case.run
    if comm.size > 1 and profile:
        raise InputError("--profile: cannot be combined with several ranks; run it without mpiexec")
    gas, simulation = prepared(case, folder, after=after, comm=comm)
    before = simulation.collisions
    done, sent = [], _sent(simulation)
    for i in range(runs):
        done.append(timed(simulation, seconds))
        note(f"run {i + 1} of {runs}: {done[-1].rate:.4g} collisions/s")
    size, profiled = simulation.bytes_allocated / gas.n, None
    if sent is not None:
        size = comm.allreduce(size)
        sent = np.array(
            comm.allgather((_sent(simulation) - sent) / sum(each.done["windows"] for each in done))
        ).max(axis=0)
    if profile:
        state = simulation.state
        del simulation  # its arrays end with the Taichi that they belong to
        gc.collect()
        try:
            backend.start(run.made_device(), profile=True)
            simulation = gas.simulation(state)
            warm_up(simulation)
            profiled = _profiled(simulation, seconds)
        finally:
            backend.stop()
    return Benchmark(
        gas="elastic gas" if after is None else run.name,
        n=gas.n,
        phi=gas.free_area.covered_part(gas.kinds.covered),
        device=run.device,
        threads=run.threads or comm.share_of_cores(backend.cores()) if run.device == "cpu" else 1,
        precision=run.precision,
        seed=run.seed,
        collisions_before=before,
        bytes_per_disk=size,
        low_memory=run.low_memory,
        runs=done,
        ranks=comm.size,
        sent=None if sent is None else dict(zip(SENT, sent.tolist(), strict=True)),
        profile=profiled,
        environment=environment(),
    )


def _sent(simulation: Simulation) -> Any:
    """Counts of what this rank has sent so far, an array of `SENT`; None if it is the only one."""
    traffic = simulation.communication
    return None if traffic is None else np.array([getattr(traffic, name) for name in SENT], dtype=float)


def prepared(
    case: CaseSections, folder: Path | str = ".", *, after: float | None = None, comm: Communicator = SERIAL
) -> tuple[CaseGas, Simulation]:
    """The gas of a case and its simulation, warm; arguments and errors as for `measure`."""
    run = case.run
    run.choose_runtime()  # before the check of a GPU, which imports a runtime
    backend.check(run.made_device())
    summary.refuse_beyond_memory(sum(each.number for each in case.species), run.device, case.start.positions)
    gas = CaseGas.from_case(case, folder)
    simulation = gas.simulation(comm=comm)
    if after is None:
        # To a time: while the lattice's disks have not met yet, a run by collisions would give up.
        end: dict[str, Any] = {"t_end": mixing_time(gas)}
    else:
        end = {"collisions_per_disk": after}
    if after != 0.0:
        unit = UNITS[run.units]["time"] if run.units == "SI" else ""
        shown = Progress(gas.n, unit=unit, **end) if comm.is_root else None
        with shown or contextlib.nullcontext():
            simulation.run(progress=shown or False, frames=PIECES, **end)
    warm_up(simulation)
    return gas, simulation


class LongEnough(Exception):
    """Ends a timed run between two windows."""


def warm_up(simulation: Simulation) -> None:
    """Run every kernel once at least, and a few windows."""
    # To a number of collisions, so that there is room for a state within a window, as in any run.
    few = max(1, simulation.disks.n // 20)
    simulation.run(collisions_per_disk=2.0 * (simulation.collisions + few) / simulation.disks.n)
    timed(simulation, 0.0)


def timed(simulation: Simulation, seconds: float) -> TimedRun:
    """Run whole windows for at least so many seconds, and `LEAST_LAUNCHES`."""
    from ...kernels.compiler.language import ti

    endless = 1e6 + 2.0 * simulation.collisions / simulation.disks.n
    collisions, before = simulation.collisions, asdict(simulation.statistics)
    ti.sync()
    marks, windows = [time.perf_counter()], [simulation.statistics.windows]

    def after_launch(*_: object) -> None:
        ti.sync()  # a GPU may still be at it
        marks.append(time.perf_counter())
        windows.append(simulation.statistics.windows)
        enough = marks[-1] - marks[0] >= seconds and len(marks) > LEAST_LAUNCHES
        if simulation.comm.bcast(enough):
            raise LongEnough

    with contextlib.suppress(LongEnough):
        simulation.run(collisions_per_disk=endless, progress=after_launch)
    return TimedRun(
        seconds=marks[-1] - marks[0],
        collisions=simulation.collisions - collisions,
        done={name: value - before[name] for name, value in asdict(simulation.statistics).items()},
        slowest=float(
            np.max(np.diff(marks) / np.maximum(np.diff(windows), 1))
        ),  # the rest of one counts as one
    )


def _profiled(simulation: Simulation, seconds: float) -> Profile:
    """A timed run under the runtime's profiler, which clocks each loop of a kernel (on a CPU 1 us fine)."""
    from ...kernels.compiler.language import ti

    ti.sync()
    ti.profiler.clear_kernel_profiler_info()
    run = timed(simulation, seconds)
    program = ti.lang.impl.get_runtime().prog
    program.update_kernel_profiler()  # brings in what a GPU has measured
    records = program.get_kernel_profiler_records()
    return Profile(run, kernel_times([(record.name, record.kernel_time) for record in records]))


def kernel_times(records: list[tuple[str, float]]) -> list[KernelTime]:
    """Times by kernel, the longest first, from name and milliseconds of each time that a loop ran."""
    calls: dict[str, dict[str, int]] = {}
    seconds: defaultdict[str, float] = defaultdict(float)
    ran = Counter(task for task, _ in records)
    for task, milliseconds in records:
        found = _TASK.fullmatch(task)
        kernel, instance = (found["kernel"], found["instance"]) if found else (task, task)
        seconds[kernel] += 1e-3 * milliseconds
        # Every call runs each of its loops once.
        own = calls.setdefault(kernel, {})
        own[instance] = max(own.get(instance, 0), ran[task])
    times = [KernelTime(kernel, sum(calls[kernel].values()), seconds[kernel]) for kernel in seconds]
    return sorted(times, key=lambda each: (-each.seconds, each.kernel))


def environment() -> dict[str, str]:
    """Versions, processor and date of a measurement."""
    return {
        "ifrdem": __version__,
        "git": revision(),
        "runtime": runtime.describe(),
        "python": platform.python_version(),
        "processor": backend.cpu_name(),
        "cores": str(backend.cores()),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def elastic_gas(
    n: int,
    phi: float,
    *,
    device: str = "cpu",
    threads: int | None = None,
    precision: str = "f64",
    seed: int = 1,
) -> CaseSections:
    """The case of n equal, smooth, elastic disks at packing fraction phi: a hexagonal lattice, Maxwellian at T = 1."""
    run = {"name": "elastic", "seed": seed, "units": "reduced", "device": device, "precision": precision}
    if threads is not None:
        run["threads"] = threads
    disk = {"mass": MASS, "radius": RADIUS, "speed_rms": math.sqrt(2.0 * TEMPERATURE / MASS)}
    return CaseSections.model_validate(
        {
            # The end is the benchmark's; a case needs one.
            "run": {**run, "collisions_per_disk": 1.0},
            "box": {"packing_fraction": phi},
            "material": [{"name": "elastic", "e_n": 1.0, "e_t": -1.0, "mu": 0.0}],
            "species": [{"name": "disks", "number": n, "material": "elastic", **disk}],
            "start": {"positions": "hexagonal"},
            "output": {"ledger": False},  # the engine alone; `output_cost` times output
        }
    )


def mean_free_time(gas: CaseGas) -> float:
    """Time between two collisions of a disk at equilibrium [time], by theory (25 % too long in the solid)."""
    phi = gas.kinds.covered / gas.box.area
    return 1.0 / theory.collision_rate(phi, TEMPERATURE, MASS, RADIUS)


def mixing_time(gas: CaseGas) -> float:
    """Time [time] after which the lattice and its too few collisions are forgotten, with room to spare.

    Seen with 10,000 disks: the collision rate is within 1 % of its last value from 3 mean free times on at phi = 0.1
    and 0.3, from 6 on at 0.7, and from 15 on at 0.6, where the lattice melts slowly. Very large gases, whose
    equilibration takes minutes, get less of the room to spare.
    """
    n, phi = gas.n, gas.kinds.covered / gas.box.area
    times = 15.0 if phi > 0.5 else 10.0 if n <= 2_000_000 else 5.0
    return times * mean_free_time(gas)
