"""Estimates of a case before it runs: mean free paths, collisions, bytes, time."""

from __future__ import annotations

import contextlib
import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..errors import TheoryError
from ..kernels import columns
from ..kernels.columns import histogram_columns, rows_dtype
from ..model.density import packing_fraction
from ..model.laws.law import EnergyWarning
from ..quantities import (
    EVENT,
    FIELDS,
    HEAT_SERIES,
    LEDGER,
    OBSERVABLES,
    PISTON_SERIES,
    PRECISIONS,
    REGION_SERIES,
    SPECIES_SERIES,
    STRESS_SERIES,
    WALL_SERIES,
    numbers_of,
)
from ..simulation.start.cells import FEW
from ..theory import driven_gas, sheared_gas
from ..theory.cooling_gas import cooling_until
from ..theory.driven_gas import Driving
from ..tools.checked import Array
from . import starts
from .case import GROWN, CaseSections, KicksAtRandomTimes, SteppedForce
from .output_section import OutputSection

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from .gas import CaseGas
    from .species import Species

OVERHEAD = 1.02
"""Of HDF5's groups, indices of chunks and half-filled chunks, as a multiple of the data of a trajectory file."""

COSTS = np.array([[1e-6, 50.0], [1e-4, 6.0], [0.1, 0.85], [0.3, 0.55], [0.6, 0.49]])
"""Packing fractions, and microseconds of one thread for a collision there, of a gas in one tile
(`ifrdem/docs/results/bench.md`). Thinner gases cost phi^(-1/2), for disks pass so many more cells."""
IN_A_WINDOW = 1.2
"""Collisions of a disk in a window of tiles, about."""
IN_TILES = 1.75
"""The same in tiles, with their halos, as a multiple."""


def run_seconds(collisions: float, n: int, phi: float, threads: int) -> float:
    """Time [s] that so many collisions take the machine on which the manual's tables were measured.

    Examples
    --------
    >>> round(run_seconds(1e6, 10_000, 0.1, 1), 2), round(run_seconds(1e6, 10_000, 1e-8, 1) / 1e3, 2)
    (0.85, 0.5)
    """
    if not phi > 0.0:
        return math.nan
    cost = float(np.exp(np.interp(math.log(phi), np.log(COSTS[:, 0]), np.log(COSTS[:, 1]))))
    cost *= math.sqrt(max(COSTS[0, 0] / phi, 1.0))
    return 1e-6 * collisions * cost * (1.0 if n <= columns.SINGLE_TILE else IN_TILES / (0.9 * threads + 0.1))


COST_OF_RATIO: Mapping[float, float] = {
    1.0: 1.0, 2.0: 1.4, 5.0: 2.1, 10.0: 2.4, 20.0: 3.4, 50.0: 5.4,
}  # fmt: skip
"""Processor time of a collision, relative to equal disks, by the ratio of the largest to the smallest radius.

Measured 2026-11-23: 10,000 elastic disks of two sizes with equal areas, phi = 0.5, one thread
(`ifrdem/docs/results/size_ratio.md`). Among walls there is one layer of cells only, and the cost is higher from a ratio
of 5 on."""


def cost_of_ratio(ratio: float) -> float:
    """Cost of a collision for a ratio of radii, by `COST_OF_RATIO`.

    Examples
    --------
    >>> cost_of_ratio(1.0), cost_of_ratio(1000.0)
    (1.0, 5.4)
    """
    return float(np.interp(math.log(ratio), np.log(list(COST_OF_RATIO)), list(COST_OF_RATIO.values())))


STEP_SECONDS, STEP_SECONDS_PER_DISK = 8e-4, 3e-7
"""Time of one thread for a step of forces that ends a window: for the window, and for each disk."""
SEARCH_SECONDS = 6e-8
"""Time of one thread per disk and step within a window, to search for the next collisions."""
FORCE_SECONDS = {
    "drag": 1e-8, "langevin": 6e-8, "spin_kicks": 4e-8, "random_kicks": 1e-7, "table_friction": 9.5e-7,
}  # fmt: skip
"""Time of one thread per disk and step to apply a force, by its kind. Measured 2026-11-26 for 1,000 and 4,000 disks at
phi = 0.3 in steps of 0.05 mean free times (`ifrdem/docs/results/forces.md`)."""
ENDS_WINDOW = "rescale"
"""Kind of a force that ends windows, because it needs sums over all disks at that time."""
AT_RANDOM_TIMES, ACTION_SECONDS = "at random times", 3.4e-7
"""Name of all forces that kick each disk at random times, and time [s] of one thread for such a kick: 0.34 us in
`ifrdem/docs/results/forces.md`."""


RESTING = "table_friction"
"""Kind of a force that stops disks after a finite time: once all are at rest, a run has no further steps."""
STEP, LONG_STEP = 0.05, 0.2
"""Step of a force, in mean free times: an accurate one (`docs/forces.md`), and one above which there is a warning."""


def shortest_free_time(rates: Sequence[float]) -> float:
    """Shortest mean free time [time] of species with these collision rates [1/time]; infinite if there is none."""
    return min((1.0 / rate for rate in rates if rate > 0.0), default=math.inf)


def long_steps(gas: CaseGas) -> list[str]:
    """Texts on forces whose step is long compared with the shortest mean free time at the start, if there is one.

    Forces at random times have no step; that of friction on a table is compared with the time in which it stops a disk.
    """
    case = gas.case
    free_time = shortest_free_time(_rates_and_speeds(gas)[0]) if case.force else math.inf
    texts = []
    for i, force in enumerate(case.force):
        part = force.interval / free_time
        if part > LONG_STEP and isinstance(force, SteppedForce) and force.kind != RESTING:
            most = f"{STEP * free_time:.3g}{case.unit('time')} ({STEP:g} mean free times)"
            texts.append(
                f"force[{i}].step = {force.interval:g}: {part:.3g} mean free times at the start; use at most {most}, "
                "so that errors of second order in the step are small"
            )
    return texts


def step_seconds(steps: Mapping[str, Mapping[float, float]], n: int, threads: int) -> float:
    """Time [s] of one or more threads for steps of forces on n disks: their number by kind and length of the step.

    Forces that act at the same times need one search. A force that acts at the times of `rescale` ends windows, too.

    Examples
    --------
    >>> round(step_seconds({"rescale": {0.1: 1000}}, 100, 1), 2), round(step_seconds({"drag": {0.1: 1000}}, 100, 1), 3)
    (0.83, 0.007)
    """
    ending, shared = steps.get(ENDS_WINDOW, {}), 1.0
    if n > columns.SINGLE_TILE:
        shared = IN_TILES / (0.9 * threads + 0.1)
    found = sum(ending.values()) * (STEP_SECONDS + n * STEP_SECONDS_PER_DISK / (0.9 * threads + 0.1))
    searches: dict[float, float] = {}
    for kind, given in steps.items():
        for step, number in given.items():
            if kind == AT_RANDOM_TIMES:
                found += number * n * ACTION_SECONDS * shared
            elif kind != ENDS_WINDOW and step not in ending:
                found += number * n * FORCE_SECONDS[kind] * shared
                searches[step] = min(number, searches.get(step, number))
    return found + sum(searches.values()) * n * SEARCH_SECONDS * shared


LAUNCH_SECONDS = 3.5e-3
"""Time of one thread to begin and end a window, or to make a frame, without its collisions."""
WINDOW_COLLISIONS = 1.3
"""Collisions of a whole gas in a window, per disk: 0.5 to 5 were measured."""
WINDOW_STRAIN = 0.036
"""Strain of a sheared gas in a window, about."""
PLACING_SECONDS = {"random": (0.5e-6, 0.55e-6), GROWN: (5e-5, 0.0)}
"""Time per disk to place it, by `start.positions`: of one thread, and shared among threads. Others are read or drawn on
a lattice, in less. Growth takes 5e-5 s at phi = 0.4, and three times as much near random packing."""
LAYOUT_SECONDS = 0.9e-6, 0.45e-6
"""Time per disk to compare disks, check them, and lay them out in tiles, in the same parts (`ifrdem/docs/results/starts.md`)."""
FEW_SECONDS = 4e-6
"""Time of NumPy per disk to place few disks at random (`cells.FEW`)."""


def start_seconds(n: int, positions: str, threads: int) -> float:
    """Time [s] to make a start of n disks, and the simulation of it; `positions` is "" where they are read.

    Examples
    --------
    >>> round(start_seconds(3_000_000, "random", 2), 1), round(start_seconds(100_000, "grown", 1), 1)
    (5.7, 5.1)
    """
    single, shared = PLACING_SECONDS.get(positions, (0.0, 0.0))
    if n <= FEW and positions == "random":
        single, shared = FEW_SECONDS, 0.0
    return n * (single + LAYOUT_SECONDS[0] + (shared + LAYOUT_SECONDS[1]) / threads)


BYTE_SECONDS, FILE_SECONDS = 8e-9, 0.05
"""Time to write a byte of a trajectory without compression, and to create and close its file."""


def output_seconds(frames: float, file_bytes: float) -> float:
    """Time [s] to make so many frames and write their file.

    Examples
    --------
    >>> round(output_seconds(100, 160e6), 2)
    1.68
    """
    return frames * LAUNCH_SECONDS + file_bytes * BYTE_SECONDS + FILE_SECONDS


RANK_BYTES = 280_000_000
"""Memory of a rank without disks: Python, Taichi, MPI and their libraries."""
RANK_BYTES_PER_DISK = 700
"""The same for each disk of a rank and of the halos around them, at most: when the start is put together, and later."""
RADIUS_BYTES = 80
"""More for each of them where radii are drawn: their rows of `kinds` (`simulation/windows/ranks.py`)."""
PLACED_BYTES_PER_DISK = 100
"""The same for each disk of its own, or of its strips, while it places random ones; 80 bytes were seen."""
HOST_BYTES_PER_DISK = 300
"""Memory per disk of a strip that is filled, at most."""
PROCESS_BYTES = 280_000_000
"""Memory of a process without disks: Python, the runtime and their libraries, and Matplotlib for the picture."""
KEPT_BYTES, KEPT_BYTES_PER_DISK = 90_000_000, 30
"""Memory that the process keeps of arrays that were there before: at most, and for each disk of fewer. The allocator gives
arrays of more than 32 MB back (DEFAULT_MMAP_THRESHOLD_MAX of glibc)."""
START_BYTES_PER_DISK = 48
"""Memory of a start beside the engine's arrays: 40 bytes of places and motion, and their tiles; 45 were seen
(`ifrdem/docs/results/starts.md`). Before these arrays are there, it takes less in all."""
FRAMES_IN_MEMORY, FRAME_BYTES, WRITER_BYTES_PER_DISK = 4, 36, 200
"""Frames that are made, wait (two) or are written, but with `low_memory`, where one is; memory of one for each disk, at
least: rows with all that the gas keeps, and what is computed of them; memory of all, at most."""
COUNTED_BYTES_PER_DISK = {False: 30, True: 5}
"""Memory of a run that ends at a number of collisions for each disk: what its last window writes down, by whether
`low_memory` keeps only the times of that."""
CHECKPOINT_BYTES_PER_DISK = 30
"""Memory of a checkpoint for each disk: an index, and a third of the present state (`engine.PASSES`)."""
GROWTH_BYTES_PER_DISK = 1000
"""The same for a start by growth: 940 bytes a disk were seen."""
TILE_BYTES, TILE_DISKS = 450, 5000
"""Of each tile of the whole box, on every rank; and its disks."""
RING = 18.0
"""Width of the halos around a rank's disks [mean diameters]."""


def strip_bytes(gas: CaseGas, ranks: int) -> float:
    """Memory [bytes] that one of several ranks needs at most to place strips of random disks; 0 of other starts."""
    if (strips := starts.strips(gas)) == 0:
        return 0.0
    most = max(math.ceil(strips / ranks) / strips, 1.0 / ranks)
    return gas.n * (PLACED_BYTES_PER_DISK * most + HOST_BYTES_PER_DISK / strips)  # one strip at a time


@dataclass(frozen=True)
class RankPlan:
    """Estimated memory and disks of each of several ranks of MPI in a run (`simulation/windows/ranks.py`)."""

    ranks: int
    disks: float
    """Of its own."""
    memory: float
    """[bytes]"""
    file: float
    """Of its part of the trajectory [bytes]."""
    seconds: float
    """Real time, with one thread for each rank [s]."""

    @classmethod
    def of(cls, gas: CaseGas, estimate: RunEstimate, ranks: int) -> RankPlan:
        """The plan for so many ranks: blocks that are squares, and a gas that stays homogeneous.

        With one thread each, as long as for their own disks alone, and for those of the halos.
        """
        n, phi = gas.n, estimate.packing_fraction
        own = n / ranks
        side = math.sqrt(own * math.pi / (4.0 * phi))  # of a block [mean diameters]
        with_halo = own * (1.0 + 2.0 * RING / side) ** 2
        per_disk = RANK_BYTES_PER_DISK + (0 if gas.kinds.every else RADIUS_BYTES)
        return cls(
            ranks=ranks,
            disks=own,
            memory=RANK_BYTES
            + max(per_disk * with_halo, strip_bytes(gas, ranks))
            + TILE_BYTES * n / TILE_DISKS,
            file=estimate.file_bytes / ranks,
            seconds=run_seconds(estimate.computed(n) / ranks, n, phi, 1) * with_halo / own,
        )


@dataclass(frozen=True)
class RunEstimate:
    """Estimates of a gas at its start, and of its run; nan where theory gives none."""

    packing_fraction: (
        float  # part of the area that disks cover, of the free area between walls; 0 in an open box
    )
    number_density: float  # disks per area [1/length^2]; 0 in an open box
    collision_rate: tuple[float, ...]  # per disk [1/time], species by species; 0 in an open box
    # Mean speed over collision rate [length], species by species; nan where nothing moves.
    free_path: tuple[float, ...]
    end_time: float  # simulated time at the end [time]
    collisions: float  # of two disks in the whole run, each counted once
    # "" if given or by theory, "about" if by the rate at the start, "at most" if that rate can only fall.
    collisions_are: Literal["", "about", "at most"]
    steady_state: tuple[float, float] | None  # T and T_rot [energy] at which a driven or sheared gas stays
    wall_collisions: float  # per time [1/time] at the start; 0 without walls
    file_bytes: int  # of the trajectory
    array_bytes: int  # of the engine's arrays
    frames: int  # at most
    rows: int  # of the time series, at most
    tracked: int  # disks with histories
    force_steps: Mapping[str, Mapping[float, float]]  # by kind and length; nan where the end is not known

    def writer_bytes_per_disk(self, case: CaseSections) -> int:
        """Memory [bytes] of frames and checkpoints for each disk, once the start is made."""
        low = case.run.low_memory
        frames = 1 if low else min(self.frames, FRAMES_IN_MEMORY)
        found = frames * max(disk_bytes(case.output), FRAME_BYTES)
        found += COUNTED_BYTES_PER_DISK[low] if case.run.collisions_per_disk is not None else 0
        return min(max(found, CHECKPOINT_BYTES_PER_DISK), WRITER_BYTES_PER_DISK)

    def peak_bytes(self, gas: CaseGas) -> int:
        """Largest memory [bytes] of a run in one process on a CPU: of its start, or later with frames."""
        case = gas.case
        grown = case.start.placed and case.start.positions == GROWN
        start = GROWTH_BYTES_PER_DISK if grown else START_BYTES_PER_DISK
        kept = min(KEPT_BYTES, KEPT_BYTES_PER_DISK * gas.n)
        return PROCESS_BYTES + kept + self.array_bytes + gas.n * max(start, self.writer_bytes_per_disk(case))

    def computed(self, n: int) -> float:
        """Collisions that are computed: tiles compute a window once more for each frame in it."""
        return self.collisions + (self.frames * 0.5 * n * IN_A_WINDOW if n > columns.SINGLE_TILE else 0.0)

    def seconds(self, gas: CaseGas, threads: int) -> float:
        """Time [s] of a run: start, collisions, windows, force steps, frames and output; nan if the end is not known."""
        n, ending = gas.n, sum(self.force_steps.get(ENDS_WINDOW, {}).values())
        windows = self.collisions / (WINDOW_COLLISIONS * n) if self.collisions > 0.0 else 0.0
        if gas.box.shear_rate:
            windows = abs(gas.box.shear_rate) * (self.end_time - gas.begin[0]) / WINDOW_STRAIN
        collisions = 0.0
        if self.collisions > 0.0 and self.packing_fraction > 0.0:
            ratio = float(gas.kinds.radius.max() / gas.kinds.radius.min())
            collisions = cost_of_ratio(ratio) * run_seconds(
                self.computed(n), n, self.packing_fraction, threads
            )
        others = max(windows - ending, 0.0) * LAUNCH_SECONDS + step_seconds(self.force_steps, n, threads)
        start = gas.case.start
        placed = start.positions if start.placed else ""
        return (
            start_seconds(n, placed, threads)
            + collisions
            + others
            + output_seconds(self.frames, self.file_bytes)
        )

    @classmethod
    def of(cls, gas: CaseGas) -> RunEstimate:
        """The estimate for a gas and its case."""
        case, n = gas.case, gas.n
        phi = gas.free_area.covered_part(gas.kinds.covered)
        rates, speeds = _rates_and_speeds(gas)
        paths = [speed / rate if rate > 0.0 else math.nan for speed, rate in zip(speeds, rates, strict=True)]
        mean_rate = sum(each.number * rate for each, rate in zip(gas.species, rates, strict=True)) / n
        begin, steady, end, per_disk = gas.begin[0], *_by_theory(gas, phi, mean_rate)
        # A drive, a flow, a fall or a wall that moves or is hot may raise the rate; in an open box there is none.
        driven = bool(case.force) or any(case.box.gravity) or gas.box.shear_rate != 0.0
        stirring = (each.motion or each.turn or each.piston or each.temperature for each in case.wall)
        driven |= any(one is not None for one in stirring)
        collisions_are: Literal["", "about", "at most"] = ""
        if math.isnan(per_disk) and not driven and not gas.box.is_open:
            collisions_are = "at most" if _only_cools(gas) else "about"
            per_disk = mean_rate * ((case.run.t_end or begin) - begin)
        frames, rows = (
            each.count(duration=end - begin, collisions_per_disk=per_disk) + 1
            for each in (case.frame_cadence, case.series_cadence)
        )
        tracked = _tracked(gas)
        # Every collision of a tracked disk, and each time that forces act on it; unknown ones do not count.
        steps = [(end - begin) / step for step in {force.interval for force in case.force}]
        changes = [per_disk, *steps]
        events = sum(round(tracked * each) for each in changes if not math.isnan(each))
        return cls(
            packing_fraction=phi,
            number_density=n / gas.free_area.area(),
            collision_rate=tuple(rates),
            free_path=tuple(paths),
            end_time=end,
            collisions=0.5 * n * per_disk,
            collisions_are=collisions_are,
            steady_state=steady,
            wall_collisions=_wall_hits(gas),
            file_bytes=_trajectory_bytes(n, case, frames=frames, rows=rows, events=events),
            array_bytes=n
            * (
                columns.bytes_per_disk(case.run.low_memory)
                + (columns.RESTING_BYTES if case.run.resting_speed else 0)
            ),
            frames=frames,
            rows=rows,
            tracked=tracked,
            force_steps=_steps(case, end - begin),
        )


def _steps(case: CaseSections, duration: float) -> dict[str, dict[float, float]]:
    """Steps of forces in a run of this duration [time], by kind and length; actions on a disk at random times."""
    found: dict[str, dict[float, float]] = {}
    for force in case.force:
        kind = AT_RANDOM_TIMES if isinstance(force, KicksAtRandomTimes) else force.kind
        given = found.setdefault(kind, {})
        # Forces of one kind and step are searched for once, but each acts.
        given[force.interval] = given.get(force.interval, 0.0) + duration / force.interval
    return found


def _only_cools(gas: CaseGas) -> bool:
    """True if the rate of collisions of a gas that nothing drives only falls.

    It does if it is the same everywhere and begins with one temperature of translation, none of rotation above it, and
    all collisions dissipate: the highest of its temperatures falls then, and the rate is below that of all at it.
    """
    dissipative = all(each.law is not None and each.law.is_dissipative for each in gas.verdicts)
    start = gas.case.start
    drawn = start.file is None and start.trajectory is None
    if not (drawn and dissipative and gas.case.homogeneous):
        return False
    classes = [one for each in gas.species for one in each.classes()]
    mass, radius = (
        np.array([getattr(one.summary, name).mean for one in classes]) for name in ("mass", "radius")
    )
    speed, spin, k = (
        np.array([getattr(one, name) for one in classes]) for name in ("speed_rms", "spin_rms", "k")
    )
    T, T_rot = 0.5 * mass * speed**2, mass * (radius * spin) ** 2 / k
    return bool(np.ptp(T) <= 1e-9 * T.max() and T_rot.max() <= T.max())


def _tracked(gas: CaseGas) -> int:
    """About how many disks have histories."""
    output = gas.case.output
    if output.histories_region is None or gas.box.is_open:
        listed = len(output.histories or ()) or output.histories_sample or 0
        return gas.n if output.histories_all else listed
    x_low, y_low, x_high, y_high = output.histories_region
    width = min(x_high, gas.box.lengths[0]) - max(x_low, 0.0)
    height = min(y_high, gas.box.lengths[1]) - max(y_low, 0.0)
    return round(gas.n * width * height / gas.box.area)


def _rates_and_speeds(gas: CaseGas) -> tuple[list[float], list[float]]:
    """Collision rate [1/time] and mean speed [length/time] of a disk of each species, means over its radii.

    A disk that is alone meets no other.
    """
    classes = [each.classes() for each in gas.species]
    found = iter(collision_rates([one for group in classes for one in group], gas.free_area.area()))
    rates, speeds = [], []
    for group in classes:
        number = [one.number for one in group]
        rate = float(np.average([next(found) for _ in group], weights=number))
        rates.append(rate if gas.n > 1 else 0.0)
        rms = np.average([one.speed_rms for one in group], weights=number)
        speeds.append(math.sqrt(math.pi / 4.0) * float(rms))  # of a Maxwellian in two dimensions
    return rates, speeds


def collision_rates(species: Sequence[Species], area: float) -> NDArray[np.float64]:
    """Collisions per disk and time [1/time] of each species of equal disks with Maxwellian velocities, in an area."""
    number = np.array([each.number for each in species], dtype=np.float64)
    radius = np.array([each.summary.radius.mean for each in species])
    variance = np.array([0.5 * each.speed_rms**2 for each in species])  # T / m
    phi = packing_fraction(math.pi * float(number @ radius**2), area)
    g = theory.mixture_contact_values(phi, radius, number)
    ones = np.ones(len(number))
    return theory.mixture_collision_rates(variance, ones, radius, number / area, g).sum(axis=1)


def _wall_hits(gas: CaseGas) -> float:
    """Collisions with walls per time [1/time] of a gas with Maxwellian velocities.

    Disks of one kind cross a line one way at n_w sqrt(T / (2 pi m)) per length, where v_x^2 has the mean T / m. At a
    wall, in equilibrium, their density n_w is that of the middle times p / (n T) = 1 + 2 phi g, because the pressure is
    the same; here the mean is taken for the middle, and centres stay a radius off.
    """
    free_area, rate = gas.free_area, 0.0
    if not free_area.all_walls:
        return rate
    phi = free_area.covered_part(gas.kinds.covered)
    wall_contact_value = theory.compressibility(min(phi, 0.9))
    for each in gas.species:
        inset = each.summary.radius.mean
        if (area := free_area.area(inset)) > 0.0:
            along_x = each.speed_rms / math.sqrt(2.0)
            flux = each.number / area * along_x / math.sqrt(2.0 * math.pi)
            rate += wall_contact_value * flux * free_area.wall_length(inset)
    return rate


def _by_theory(gas: CaseGas, phi: float, rate: float) -> tuple[tuple[float, float] | None, float, float]:
    """Steady state, time at the end and collisions per disk of the run, by theory of equal disks.

    Without rolling friction, which is not in it.

    None and nan for what neither the case nor theory gives; `rate` is that of collisions of a disk at the start
    [1/time].
    """
    case, (begin, before) = gas.case, gas.begin
    end = math.nan if case.run.t_end is None else case.run.t_end
    target = case.run.collisions_per_disk
    per_disk = math.nan if target is None else target - 2.0 * before / gas.n
    each, shear_rate = gas.species[0], gas.box.shear_rate
    law: Any = gas.law()
    if gas.box.is_open or len(gas.species) > 1 or not each.equal or getattr(law, "rho", 0.0) > 0.0:
        return None, end, per_disk
    if not law.has_averages:
        return None, end, per_disk
    if law.depends_on_speed and (shear_rate or case.force):  # only its cooling is known
        return None, end, per_disk
    mass, radius = each.summary.mass.low, each.summary.radius.low
    inertia = mass * radius**2 / each.k
    one = (law, mass, radius, each.k, phi)
    T, T_rot = 0.5 * mass * each.speed_rms**2, inertia * each.spin_rms**2
    if shear_rate and case.force:
        return None, end, per_disk
    if shear_rate:
        steady = None
        with contextlib.suppress(TheoryError):
            steady = sheared_gas.steady_state(*one, shear_rate)
            if case.run.t_end is None:
                if steady is not None:  # in which the gas spends most of a run
                    end = begin + per_disk / theory.collision_rate(phi, steady[0], mass, radius)
                return steady, end, per_disk
            if T == 0.0:
                return steady, end, per_disk
            per_disk = float(sheared_gas.sheared(*one, shear_rate, T, T_rot, [end - begin])[2][0])
        if steady is not None and math.isnan(per_disk):  # heats from a start that is too cold to be followed
            hot = theory.collision_rate(phi, steady[0], mass, radius)
            per_disk = hot * (end - begin) if hot > rate else math.nan
        return steady, end, per_disk
    driving = Driving.of([force.model_dump() for force in case.force], mass, inertia) if case.force else None
    if not case.homogeneous or (case.force and driving is None):
        return None, end, per_disk
    steady = None if driving is None else driven_gas.steady_state(*one, driving)
    if steady is not None:
        rate = max(rate, theory.collision_rate(phi, steady[0], mass, radius))
    if rate == 0.0 or (T == 0.0 and (driving is None or driving.power == 0.0)):
        return steady, end, per_disk

    if driving is None and not law.depends_on_speed:
        rate = theory.collision_rate(phi, T, mass, radius)
        if math.isnan(per_disk):
            done, _ = cooling_until(law, each.k, T_rot / T, time=(end - begin) * rate)
            return steady, end, done
        _, passed = cooling_until(law, each.k, T_rot / T, collisions=per_disk)
        return steady, begin + passed / rate if passed < 1e12 * per_disk else end, per_disk

    def collisions(times: Array) -> Array:
        if driving is None:
            with warnings.catch_warnings(action="ignore", category=EnergyWarning):  # the case has its notice
                mixture = theory.Mixture([mass], [radius], law, phi, k=[each.k])
            found: Array = theory.mixture_cooling(mixture, T, T_rot, times).collisions_per_disk[:, 0]
            return found
        return driven_gas.driven(*one, driving, T, T_rot, times)[2]

    if math.isnan(per_disk):
        return steady, end, float(collisions(np.array([end - begin]))[0])
    # Cooling slows the collisions: later times until there are enough. Linear between times 0.2 % apart: to 1e-6.
    times = per_disk / rate * np.geomspace(0.01, 8.0, 3000)
    while (found := collisions(times))[-1] < per_disk:
        times = times * 8.0
        if times[-1] > 1e12 * per_disk / rate:
            return steady, end, per_disk
    return steady, begin + float(np.interp(per_disk, found, times)), per_disk


def disk_bytes(output: OutputSection) -> int:
    """Bytes per disk and frame in a trajectory file without compression."""
    return sum(_field_bytes(output, name) for name in output.fields)


def _field_bytes(output: OutputSection, name: str) -> int:
    return rows_dtype((FIELDS[name],), PRECISIONS[output.precision]).itemsize


def _trajectory_bytes(n: int, case: CaseSections, *, frames: int, rows: int, events: int) -> int:
    """Bytes of a trajectory file of n disks without compression, with so many events of tracked disks, about."""
    from ..trajectory import layout  # imports h5py
    from ..trajectory.file import on_pages

    output = case.output
    pistons = sum(each.piston is not None for each in case.wall)
    totals = numbers_of(OBSERVABLES) + len(PISTON_SERIES) * pistons
    pairs = len(case.species) * (len(case.species) + 1) // 2
    counted = output.histograms or output.free_times
    counts = pairs * histogram_columns(len(case.species) * counted, output.free_times)
    per_chunk = layout.chunk_disks(n)
    chunks = -(-n // per_chunk)
    frame = chunks * sum(on_pages(per_chunk * _field_bytes(output, name)) for name in output.fields)
    walls = len(case.wall) + 2 * sum(not each for each in case.box.periodic)
    row = totals + numbers_of(LEDGER) * output.ledger + walls * len(WALL_SERIES) * output.wall_sums
    row += numbers_of(STRESS_SERIES) * (output.stress or output.heat_flux)
    row += len(REGION_SERIES) * len(output.regions) + 2 * (walls > 0)
    row += numbers_of(HEAT_SERIES) * output.heat_flux + len(SPECIES_SERIES) * len(case.species) * (
        len(case.species) > 1
    )
    event = rows_dtype(EVENT.values(), "f8").itemsize
    constant = 28 * n  # radius, mass and k in 8 bytes, the material in 4
    size = constant + frames * (frame + 8 * (totals + counts)) + rows * 8 * row + events * event
    return round(OVERHEAD * size)
