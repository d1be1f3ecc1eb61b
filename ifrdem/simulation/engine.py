"""The event-exact parallel engine, seen from the host.

Time advances in *windows*, short enough that disks collide about once in each. In a window every tile of the box runs
all events of its own disks and those in a halo around it, by itself and in order (`kernels/events/events.py`); then it
is verified that no tile missed anything, and tiles that may have are run again with wider halos
(`kernels/tiles/tiles.py`, which has the proof). A gas of up to SINGLE_TILE disks is one tile that is the whole box.

Guarantee. The collisions are those of consistent hard disks from the given start, which is unique: what a serial
event-driven code produces, up to rounding. Exact ties in time fall to the smaller pair of ids. And all bits of the
state depend on the gas only: places are on a grid, so that all tiles compute the same from whatever corner; windows end
where the state at their beginning says. Any number of threads, any tiles, any halo that is verified, and the whole box
in order give the same bits; so do frames, series, tracked disks and the ledger, which only look. A run that stops
within a window changes no bit of what comes after: a gas in one tile pauses there, tiles store planned moments as
they pass them, and repeat a window for others: by the events that they have written down, or on a GPU another run.
Only changes from outside (a force that needs sums over all disks, a change by the user) end a window.

Open space. Disks lie in tiles over what they fill, which have no end at its edge. Once they have spread they are
loaded again, into wider cells; once no two of them approach each other the rest is one flight.

Limits. Places are rounded to 2^-52 to 2^-51 of the box. Tiles of a sheared gas have frames of their own: there the bits
depend on the tiles, which depend on the gas only.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InelasticCollapse, InputError, NoMoreCollisions, shortened
from ..kernels import layout as k
from ..kernels.columns import READOUT, TALLY, Named, frame_dtype, named
from ..model.box import Box
from ..model.collapse import advice
from ..model.laws.ifr import IFRLaw
from ..model.laws.law import CollisionLaw, compiled
from ..model.observables import measure_of_totals
from ..model.setup import Setup
from ..model.state import Disks, FrameRows, State, unlike
from ..model.walls.wall import Wall, free_directions, rows_of, smooth_materials
from ..mpi import Communicator
from ..mpi.distribution import RowsByBlock, Table
from ..tools import checked
from . import backend
from .measuring.tracking import Statistics
from .start import checks
from .start.features import features_of
from .start.start import StartCounts, StartSlice
from .steps.rotation import GravityRotation
from .steps.schedule import RunPoint

if TYPE_CHECKING:
    from ..model.forces import Force
    from .measuring.tracking import Tracking
    from .windows.arrays import DeviceArrays
    from .windows.windows import Windows

PATIENCE = 1000  # usual times between collisions without one, after which a run by collisions gives up
ORDERS = ("serial", "tiled")
# Windows of an open gas between checks of its extent, and of whether any disks can still meet.
OPEN_WINDOWS = 32


MOST_AT_ONCE = 2**28
"""Collisions of a disk between two looks at counters: more than a window may have (`runner.TileRunner`)."""
MOST_COMPARED = 200_000
"""Disks of which all pairs are compared at most: some ten seconds. More fly on in windows, which get longer."""
LARGE, PASSES = 1_000_000, 3
"""Disks of which more are read from the device in parts for a checkpoint, and the number of these parts."""


@dataclass(frozen=True)
class CollisionTimes:
    """Collisions in order of time.

    Attributes
    ----------
    time : array (c,)
        Times [time].
    pair : array (c, 2) of int64
        Ids of the two disks, the smaller one first.
    """

    time: NDArray[np.float64]
    pair: NDArray[np.int64]


def no_pair_approaches(state: State, disks: Disks) -> bool:
    """True if no two disks of an open gas approach each other in a way that they could touch: the rest is one flight.

    Every pair is checked, until one is found; up to MOST_COMPARED disks. Imports the kernels.
    """
    from ..kernels.disks.flights import approaching

    if state.n < 2:
        return True
    if state.n > MOST_COMPARED:
        return False
    begin, rows = 0, 64
    while begin < state.n:
        end = min(begin + rows, state.n)
        if approaching(begin, end, state.position, state.velocity, np.ascontiguousarray(disks.radius)):
            return False
        begin, rows = end, 4 * rows
    return True


class Engine:
    """Disks in a box, moved from collision to collision.

    Parameters
    ----------
    setup : Setup
        Whose laws are not checked here: `PairLaws` does that.
    disks, state
        As for `Simulation`; positions must not overlap (`placement.check_no_overlap`).
    tracking : Tracking, optional
        Follows some disks, collision by collision.
    comm : communicator of mpi4py, optional
        Whose ranks have a part of the gas each, if there are several (`windows/ranks.py`); all make the same engine
        and call the same methods.
    order : {"serial", "tiled"} or None
        One tile that is the whole box, by one thread; or many; by default as the number of disks suggests. The same
        bits.
    tile_disks : int or None
        Disks of a tile; by default what is fastest.

    InputError if a disk is larger than a third of a periodic side of the box, one of infinite mass moves, the device is
    not there, or a force cannot act.
    """

    def __init__(
        self,
        setup: Setup,
        disks: Disks,
        state: State,
        *,
        tracking: Tracking | None = None,
        comm: Any = None,
        order: str | None = None,
        tile_disks: int | None = None,
    ) -> None:
        self._released = True  # until there is anything to release
        self._valid = True  # False while a window is run: an interrupt would leave it half done
        if order not in (None, *ORDERS):
            raise InputError(f"order = {shortened(order)}: must be one of {', '.join(ORDERS)}")
        if tile_disks is not None:
            checked.integer("tile_disks", tile_disks, 1)
        self.setup: Setup = setup
        self.comm: Communicator = Communicator.of(comm)
        comm, tracked = self.comm, tracking is not None
        with comm:
            counts = StartCounts.of(disks, state)
        self.n: int = counts.n
        self._facts: dict[str, Any] = {
            "n": self.n,
            "immovable": counts.immovable,
            "histories": tracked,
            "ranks": comm.size,
            "order": order or "",
        }
        comm.run_on_all(lambda: checks.check_exclusions(setup, **self._facts))
        comm.run_on_holders(lambda: checks.check(setup, disks, state, counts, comm.size))
        self._before, self._asleep_before = [counts.collisions, counts.wall_collisions], counts.asleep
        with comm:
            start = StartSlice.of(disks, state)
            self.past: dict[str, Any] = start.history()
        self.disks, self.disks_here, self.kinds = start.disks, start.here, start.kinds
        (self._materials,) = unlike([self.kinds.material])
        time = float(start.state.time)
        self.rotation = GravityRotation(setup.gravity, time)
        self.gravity: tuple[float, float] = self.rotation.gravity
        self._check_collapse(setup, self.gravity)
        for force in setup.forces:
            comm.run_on_all(lambda force=force: force.check(self.disks))
        self._check_alike(setup)
        self.statistics: Statistics = Statistics()
        self.keep_collisions = False
        self.last_collisions: CollisionTimes | None = None
        self.tracking = tracking
        self._resting = 0
        self._no_future_collisions = False
        self._collided_at = time
        # No counter of a disk is full before there are so many collisions and windows.
        begin = 2 * counts.collisions + counts.wall_collisions - self._most_counted(start.state)
        self._counters_hold = begin + checks.MOST_COUNTED - MOST_AT_ONCE
        with comm:
            backend.start_on_ranks(setup.device)
        from .steps.force_steps import ForceSteps
        from .windows.arrays import DeviceArrays
        from .windows.domain import domain_of
        from .windows.windows import Windows

        rows = rows_of(self.walls)
        uses = features_of(setup, rows, histories=tracked, ranks=comm.size, species=len(self.kinds.species))
        domain = domain_of(comm, self.disks_here, self.kinds)
        self.arrays: DeviceArrays = DeviceArrays(
            setup, self.kinds, rows, uses, domain, order=order, tile_disks=tile_disks
        )
        self.apply_gravity()
        self._released = False
        backend.register(self)
        if tracking is not None:
            self.arrays.watch(tracking.rows > 0)
        self.arrays.clock.wall_speed = max((wall.most_speed for wall in self.walls), default=0.0)
        self.windows: Windows = Windows(self.arrays, self.statistics, time)
        self.set_gates(
            np.array([not wall.is_present(time, self._before[0]) for wall in self.walls], dtype=bool)
        )
        self._load(start.state)
        self.force_steps: ForceSteps = ForceSteps(
            setup.forces, self.arrays, self.disks, setup.seed, self.time, self.kinds.species
        )
        self._install_forces()
        # Kinetic energy in the frames of rows of tiles beyond that in the flow, at the start.
        self._flow_excess = self._excess()

    def _load(self, state: State) -> None:
        """Divide the box into tiles and lay a state into them, from which a window begins."""
        self.arrays.load(self.disks, state)
        self._windows_to_check = OPEN_WINDOWS
        self._no_future_collisions = self._all_separate(state)

    def _all_separate(self, state: State) -> bool:
        """True if no disk can collide: all fly apart in an open box, or at one velocity in a box without walls."""
        if self.box.is_open:
            return no_pair_approaches(state, self.disks)
        if self.walls or self.box.shear_rate or self.n < 2:
            return False
        with self.comm:
            return checks.fly_alike(state.velocity)

    # ------------------------------------------------------------------ what it knows

    @property
    def box(self) -> Box:
        """The box."""
        return self.setup.box

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls, those at sides of the box last."""
        return self.setup.all_walls

    @property
    def precision(self) -> str:
        """Precision of the device."""
        return self.setup.device.precision

    @property
    def time(self) -> float:
        """The present time [time]."""
        return self.windows.now

    def _sum(self, column: int) -> float:
        return self.windows.sum(column)

    @property
    def collisions(self) -> int:
        """Collisions of two disks, those before the start included."""
        return self._before[0] + int(self._sum(TALLY.collisions))

    @property
    def wall_collisions(self) -> int:
        """Collisions with walls, those before the start included."""
        return self._before[1] + int(self._sum(TALLY.wall_collisions))

    @property
    def asleep(self) -> int:
        """Number of sleeping disks."""
        return self._asleep_before + self.windows.sleepers

    @property
    def wall_work(self) -> float:
        """Energy that moving walls gave to the disks so far [energy]."""
        return self._sum(TALLY.wall_work)

    @property
    def wall_heats(self) -> NDArray[np.float64]:
        """Heat that each wall, those at sides of the box last, gave so far [energy]."""
        heat = np.zeros(len(self.walls))
        if self.arrays.uses.thermal_walls:
            tally = self.arrays.extra_tally
            heat[tally.thermal] = tally.heats(self.windows.sums)
        return heat

    @property
    def virial(self) -> NDArray[np.float64]:
        """Momentum that collisions transferred so far, shape (2, 2) [energy time]: `Measure.virial`."""
        return np.asarray(self.arrays.extra_tally.transfer(self.windows.sums).momentum.array).reshape(2, 2)

    @property
    def energy_transfer(self) -> NDArray[np.float64]:
        """Energy that they transferred so far, in the lab, shape (2,) [energy length]: `Measure.energy_transfer`."""
        found = self.arrays.extra_tally.transfer(self.windows.sums)
        return np.array([found.energy_x, found.energy_y])

    @property
    def histograms(self) -> NDArray[np.int64]:
        """Counts of collisions so far, shape (pairs of species, columns of `columns.HISTOGRAM`)."""
        return self.arrays.extra_tally.histograms(self.windows.sums).astype(np.int64)

    @property
    def wall_sums(self) -> NDArray[np.float64]:
        """Sums of what each wall gave so far, shape (walls, 6): `model.walls.wall.SUMS`; sides of the box last."""
        return self.arrays.extra_tally.sums(self.windows.sums)

    @property
    def pistons(self) -> NDArray[np.float64]:
        """Displacement, velocity, energy and force of each piston, shape (pistons, 4): `quantities.PISTON_SERIES`."""
        states = self.arrays.extra_tally.piston_states(self.windows.sums).array
        pistons = [(wall.piston, wall.normal_of_piston) for wall in self.walls if wall.piston is not None]
        found = np.empty((len(pistons), 4))
        for row, (piston, normal), (s, speed) in zip(found, pistons, states.tolist(), strict=True):
            pull = piston.mass * (self.gravity[0] * normal[0] + self.gravity[1] * normal[1])
            row[:] = s, speed, piston.energy(s, speed, pull), piston.force
        return found

    # ------------------------------------------------------------------ gates

    @property
    def next_kick(self) -> float:
        """Time of the next event that ends a window [time]: a force acts, gravity turns, a gate opens, a wall
        starts or stops."""
        return self._next_change(self.force_steps.ends_window)

    def _next_change(self, force: float) -> float:
        """Time of the next event that ends a window [time], if a force acts at the time `force`."""
        kick, now = min(force, self.rotation.next_time), self.time
        if self.arrays.uses.timed_walls:
            times = [time for wall in self.walls for time in wall.moving_times]
            times += [wall.opens_at for wall in self.walls if wall.opens_at is not None]
            kick = min((time for time in times if now < time < kick), default=kick)
        return kick

    def set_gates(self, opened: NDArray[np.bool_]) -> None:
        """Set which walls are open gates, shape (walls,)."""
        self.open_gates: NDArray[np.bool_] = np.asarray(opened, dtype=bool)
        if self.arrays.uses.timed_walls or self.arrays.uses.pistons:
            self.arrays.open_walls(self.open_gates)

    def _open_gates(self) -> None:
        """Open the gates whose time or number of collisions has come, which ends the window."""
        if not self.arrays.uses.timed_walls:
            return
        opened = np.array(
            [not wall.is_present(self.time, self.collisions) for wall in self.walls], dtype=bool
        )
        if np.any(opened & ~self.open_gates):
            self._end_window()
            self._wake()  # what held them may be gone
            self.set_gates(opened)
            self._mark_changed()

    @property
    def free(self) -> tuple[bool, bool]:
        """True along x and y where the whole gas can drift (`model.walls.wall.free_directions`)."""
        smooth: Collection[int] = ()
        law = self.setup.law_class
        if self.walls and law.has_ifr_symbols and {"e_t", "mu"} <= {*law.coefficients}:
            e_t, mu = (law.column(self.setup.law_rows, name) for name in ("e_t", "mu"))
            smooth = smooth_materials(e_t, mu, self._materials)
        return free_directions(self.walls, immovable=self.n > self.kinds.n_movable, smooth=smooth)

    @property
    def bytes_allocated(self) -> int:
        """Bytes of all device arrays."""
        return self.arrays.bytes_allocated

    def dissipated(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Energy that collisions took, by mechanism, and collisions by regime, so far; zeros without a ledger.

        EngineError if a collision took no number (NaN), or an infinite one: the law does not hold on to energy.
        """
        sums = Named(self.windows.sums, TALLY)
        losses = sums.losses.array
        if not np.isfinite(losses).all():
            raise EngineError(
                "energy taken by a collision is infinite or not a number: the law does not conserve energy; "
                'output.ledger = false (no "ledger" in record) switches the check off'
            )
        return losses.copy(), sums.regimes.astype(np.int64)

    def switch_ledger(self, on: bool) -> None:
        """Switch the sums of the energy ledger off or on: to time what the ledger costs."""
        with self.exclusive_update():
            self.windows.switch(self.arrays.uses.replace(ledger=on))

    # ------------------------------------------------------------------ changes between runs

    def _end_window(self) -> None:
        """Begin a window at the present time: later bits depend on where windows begin."""
        if self.windows.inside:
            self._restart_from(self._state())
        else:
            self.windows.commit()

    def _restart_from(self, state: State, *, wakes: bool = False) -> None:
        """Begin a window with a state at the present time, in which disks that sleep are woken if it `wakes`."""
        if wakes and self.setup.resting_speed:
            self._asleep_before -= self.asleep
            state.asleep = np.zeros_like(state.asleep)
        if self.tracking is not None:  # what was to follow does not happen
            self.tracking.drop_after(state.time)
        excess = self._excess()
        self.windows.commit_at(state.time)
        self._load(state)
        # Of energies in the frames of rows of tiles: what they are then is none of the flow's doing.
        self._flow_excess += self._excess() - excess

    def _check_alike(self, setup: Setup) -> None:
        """Refuse ranks that were given different gases."""
        if self.comm.size == 1:
            return
        alike = replace(setup, device=replace(setup.device, threads=None))
        # Of a law its coefficients: a record has the text of a custom one, which may differ in each process.
        compared = alike.to_record() | {"law": (setup.law_class, setup.law_rows.tobytes())}
        self.comm.require_equal(repr(compared), "box, law, walls, forces or options")

    def _check_collapse(self, setup: Setup, gravity: tuple[float, float]) -> None:
        """Refuse a law or gravity to which the speed of the remedy for inelastic collapse does not suit."""
        law = setup.law_class
        e_n = law.column(setup.law_rows, "e_n") if law.has_ifr_symbols and "e_n" in law.coefficients else None
        checks.check_collapse(
            setup.collapse, self.kinds, setup.box, setup.all_walls, gravity, e_n, setup.device
        )

    def _wake(self) -> None:
        """Wake all disks at the present time, between windows, before their support changes."""
        if self.setup.resting_speed:
            self._restart_from(self._state(), wakes=True)

    def set_law(self, law: Sequence[Sequence[CollisionLaw]]) -> None:
        """Set another table of laws, which are not checked here, for later collisions."""
        setup = replace(self.setup, law=tuple(map(tuple, law)))
        checks.check_exclusions(setup, **self._facts)
        self._check_collapse(setup, self.gravity)
        with self.exclusive_update():
            self._end_window()
            self._wake()
            self.setup = setup
            kind: Any = setup.law_class  # mypy does not take a class for hashable
            self.arrays.set_law(setup.law_rows, compiled(kind))
            self._mark_changed()

    def set_forces(self, forces: Sequence[Force]) -> None:
        """Set other forces; InputError if one is invalid, or cannot act here."""
        from .steps.force_steps import ForceSteps

        self.check_valid()

        def changed() -> tuple[Setup, ForceSteps]:
            setup = replace(self.setup, forces=forces)  # type: ignore[arg-type]  # checked there
            checks.check_exclusions(setup, **self._facts)
            steps = ForceSteps(
                setup.forces, self.arrays, self.disks, setup.seed, self.time, self.kinds.species
            )
            hottest = checks.hottest(self.walls, setup.forces)
            checks.check_magnitudes(self.disks_here, self.box, 0.0, self.precision, hottest)
            return setup, steps

        setup, steps = self.comm.run_on_all(changed)
        self._check_alike(setup)
        with self.exclusive_update():
            self._end_window()
            self.setup, self.force_steps = setup, steps
            self._install_forces()
            self._mark_changed()

    def _install_forces(self) -> None:
        """Install the forces of `force_steps` at the beginning of a window."""
        mass = self.disks_here.mass
        heaviest = float(mass[np.isfinite(mass)].max(initial=0.0))
        self.force_steps.install(self.windows, self.comm.largest(heaviest))
        self.force_steps.take_values(self.free)

    def take_force_values(self) -> None:
        """End the window if parameters of forces that act within it have been changed."""
        if self.force_steps.any_within and self.force_steps.take_values(self.free):
            self._end_window()

    def set_gravity(self, gravity: tuple[float, float]) -> None:
        """Set another gravity; InputError unless gravity is constant and can act in this direction."""
        if self.rotation.rotating is not None:
            raise InputError(
                f"gravity = {gravity}: cannot be set where gravity rotates ({self.rotation.rotating}); begin a new "
                "simulation from this state"
            )
        setup = replace(self.setup, gravity=checked.PAIR("gravity", gravity))
        checks.check_exclusions(setup, **self._facts)
        self._check_collapse(setup, setup.start_gravity)
        with self.exclusive_update():
            self._end_window()
            self._wake()
            self.setup, self.rotation = setup, GravityRotation(setup.gravity, self.time)
            self.apply_gravity()
            self._mark_changed()

    def set_piston_force(self, number: int, force: float) -> None:
        """Set another constant force on the piston that is wall `number`; InputError if it is not a piston."""
        pistons = [w for w, wall in enumerate(self.walls) if wall.piston is not None]
        if number not in pistons:
            known = ", ".join(map(str, pistons)) or "none"
            raise InputError(
                f"wall = {shortened(number)}: must be the number of a piston; there are: {known}"
            )
        wall = self.walls[number]
        assert wall.piston is not None
        changed = replace(wall, piston=replace(wall.piston, force=force))
        with self.exclusive_update():
            self._end_window()
            walls = (*self.setup.walls[:number], changed, *self.setup.walls[number + 1 :])
            self.setup = replace(self.setup, walls=walls)
            self.arrays.change_wall(number, changed)
            self.set_gates(self.open_gates)
            self._mark_changed()

    def apply_gravity(self) -> None:
        """Apply the present gravity, at a window's beginning."""
        self.gravity = self.rotation.gravity
        self.arrays.set_gravity(self.gravity, self.setup.resting_speed, self.rotation.rotated_at)

    def _turn_gravity(self) -> None:
        """Turn gravity, if it is time. No disk is woken: the next window first checks which disks still rest."""
        if self.time < self.rotation.next_time:
            return
        self._end_window()
        before = self._totals()[READOUT.fall]
        self.rotation.next_step += 1
        self.apply_gravity()
        self.rotation.work += float(before - self._totals()[READOUT.fall])

    def set_velocities(self, state: State) -> None:
        """Set the velocities and spins to those of another state (of ranks, of the slice); positions stay.

        InputError if an immovable disk would move, or they are too large or small to compute with.
        """
        hottest = checks.hottest(self.walls, self.force_steps.forces)
        speed = self.comm.largest(checks.fastest(self.disks_here, state.velocity, state.spin))

        def check_motion() -> None:
            checks.check_motion(self.disks_here, state)
            checks.check_magnitudes(self.disks_here, self.box, speed, self.precision, hottest)

        self.comm.run_on_all(check_motion)
        with self.exclusive_update():
            present = self._state()
            before = self._snapshot(present)
            present.velocity, present.spin = state.velocity, state.spin
            self._restart_from(present, wakes=True)
            self._mark_changed()
            if self.tracking is not None:
                self.tracking.kick(self.time, before, self._snapshot(present))

    def _snapshot(self, state: State) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Positions, velocities and spins of tracked disks, shape (m, 5), and image counts, (m, 2): on the root."""
        if self.tracking is None:
            return np.empty((0, 5)), np.empty((0, 2), dtype=np.int32)
        ids = self.tracking.ids[: None if self.comm.is_root else 0]
        columns: list[NDArray[Any]] = [state.position, state.velocity, state.spin[:, None], state.image]
        *real, image = self.comm.rows_of(self.n, ids, columns)
        return np.column_stack(real).astype(np.float64), image.astype(np.int32)

    def _mark_changed(self) -> None:
        """Note that the gas was changed: earlier results on its collisions and rest do not hold any more."""
        self._resting = 0
        self._collided_at = self.time
        self._no_future_collisions = self._all_separate(self._state())

    # ------------------------------------------------------------------ running

    def advance(
        self,
        *,
        t_end: float = math.inf,
        collisions: float = math.inf,
        pause_at: float = math.inf,
        pause_after: float = math.inf,
        rest_at: float = math.inf,
        ends: float | None = None,
        next_points: Callable[[], Iterable[RunPoint]] = list,
    ) -> None:
        """Run one window, or some of a small gas: to `t_end` [time] or the total number of `collisions` at the latest.

        It ends at the latest where a force acts, after that; and where a window ends at or after `pause_at` [time] or
        the total number of collisions `pause_after`. Without windows, because no disks can collide, it ends
        at `rest_at` [time], too. The run itself `ends` [time] later, if that is not `t_end`. `next_points` gives
        the points of later calls: those in the same window are computed with it.
        Raises NoMoreCollisions, InelasticCollapse or EngineError as `Simulation.run`.
        """
        with self.exclusive_update():
            self.last_collisions = None
            self.take_force_values()
            kick = self.next_kick
            collisions = min(collisions, self._next_gate())
            if self._nothing_happens():
                kick = self._next_change(self.force_steps.next_time)
                self._fly_freely(kick, t_end, rest_at, t_end if ends is None else ends)
            else:
                self._run(RunPoint(t_end, collisions), kick, RunPoint(pause_at, pause_after), next_points)
            self._apply_forces()
            self._turn_gravity()
            self._open_gates()
            self._check_counters()

    def _check_counters(self) -> None:
        """EngineError before a counter of a disk, of 32 bits, may overflow.

        A disk has at most all collisions there are, and comes into the next box at most once in a window: disks are
        only looked at after so many of either that a counter could be full.
        """
        counted = 2 * self.collisions + self.wall_collisions + self.statistics.windows
        if counted < self._counters_hold:
            return
        room = checks.MOST_COUNTED - MOST_AT_ONCE - self._most_counted(self._state())
        if room < 0:
            raise EngineError(
                f"t = {self.time:.9g}: a disk has had nearly as many collisions, or boxes to travel, as its counter of "
                f"32 bits can hold, {checks.MOST_COUNTED}: begin a new run from this state, with counts of 0"
            )
        self._counters_hold = counted + room

    def _most_counted(self, state: State) -> int:
        """The largest count of collisions, or of boxes travelled, of a disk."""
        events = state.collisions + state.wall_collisions.astype(np.int64)
        return int(self.comm.largest(float(max(events.max(initial=0), np.abs(state.image).max(initial=0)))))

    def check_duration(self, t_end: float) -> None:
        """Refuse a run to `t_end` [time] that is too long for this gas (`checks.check_duration`)."""
        self.check_valid()
        lone = not self.box.is_open and (self._no_future_collisions or self._is_alone)
        if not (lone or self.box.shear_rate):
            return
        speed, travelled = 0.0, 0
        if lone:
            state = self._state()
            speed = float(np.hypot(*state.velocity.T).max(initial=0.0))
            travelled = int(np.abs(state.image).max(initial=0))
        radius = float(self.kinds.radius.min(initial=math.inf))
        speed, travelled = self.comm.largest(speed), int(self.comm.largest(float(travelled)))
        checks.check_duration(self.time, t_end, radius, self.box, speed, travelled)

    @property
    def n_kernels(self) -> int:
        """Approximate number of kernels that a first window, its forces and its output need."""
        a = self.arrays
        # Two of the readout, for rows and for sums; a survey, a plan and the window; then its verification.
        found = 5 + (not a.single_tile) + a.uses.ranks + bool(self.kinds.species)
        return found + self.force_steps.n_kernels

    @property
    def _is_alone(self) -> bool:
        """True for a single disk, or none, that can collide with nothing."""
        if self.n == 0:
            return not self.arrays.uses.pistons
        return self.n == 1 and not self.walls and not self.box.shear_rate

    def _next_gate(self) -> float:
        """Number of collisions at which the next gate opens; infinite without one."""
        if not self.arrays.uses.timed_walls:
            return math.inf
        waiting = zip(self.walls, self.open_gates.tolist(), strict=True)
        return min(
            (w.opens_after for w, opened in waiting if w.opens_after is not None and not opened),
            default=math.inf,
        )

    def _nothing_happens(self) -> bool:
        """True if no disk meets another one or a wall before something else sets it in motion."""
        if self.n and self.force_steps.any_alone:
            return False
        if self._no_future_collisions or self._is_alone:
            return True
        self.windows.go_on(self.next_kick)
        walls_move = self.arrays.clock.wall_speed > 0.0 or self.arrays.uses.pistons
        all_sleep = self.setup.resting_speed and not self.windows.inside and self.asleep == self.n
        verified = self.statistics.windows > 0 and self.time != self.rotation.rotated_at
        if all_sleep and verified:  # else the next window first checks whether they may
            return not walls_move
        forced = any(self.gravity) or walls_move or self.box.shear_rate
        return not forced and not self.windows.inside and self.windows.fastest == 0.0

    def _run(
        self, stop: RunPoint, kick: float, pause: RunPoint, next_points: Callable[[], Iterable[RunPoint]]
    ) -> None:
        windows = self.windows
        watching = k.PAIRS if self.keep_collisions else k.TRACKED if self.tracking is not None else 0
        if self.keep_collisions and self.tracking is not None:
            raise EngineError("collisions of all disks cannot be kept while some are tracked")
        before, was = windows.sum(TALLY.collisions), self.time
        first = self._before[0]
        most = 1 if watching else self._windows_to_check if self.box.is_open else self.arrays.burst
        windows_before = self.statistics.windows

        def counted(point: RunPoint) -> tuple[float, float]:
            return point.time, point.collisions - first

        try:
            windows.run(
                counted(stop),
                kick,
                counted(pause),
                most=most,
                watching=watching,
                next_points=lambda: map(counted, next_points()),
            )
        except InelasticCollapse as error:
            raise InelasticCollapse(f"{error}. {self._advice(at_wall=windows.only_walls_hit)}") from None
        if windows.rests and not windows.inside:
            raise InelasticCollapse(
                f"t = {windows.begin:.9g} to {windows.end:.9g}: a disk came to rest on a wall (inelastic collapse); "
                f"there is no next collision. {self._advice(at_wall=True)}"
            )
        if watching:
            self._take_watched(watching, was)
        self.statistics.elastic = windows.elastic
        if windows.sum(TALLY.collisions) > before:  # of several ranks, all ask here: one may later, alone
            self._collided_at = self.time
            self._resting = 0
        elif not math.isfinite(stop.time):
            # Disks of a lattice that all begin to move at once may take a disk's own free time to meet.
            patience = max(PATIENCE, self.n * PATIENCE // 10)
            waited, longest = self.time - self._collided_at, patience * self._free_time(windows.fastest)
            if waited > longest and waited > longest / self._thermal_part():
                raise NoMoreCollisions(
                    f"t = {self.time:.6g}: no collision since t = {self._collided_at:.6g}, {patience} times what is "
                    "usual at this density: these disks seem never to meet"
                )
        if self.box.is_open:
            self._windows_to_check -= self.statistics.windows - windows_before
            if self._windows_to_check <= 0 and not windows.inside:
                self._look_around()

    def _advice(self, *, at_wall: bool) -> str:
        """Sentence on remedies for an inelastic collapse in this gas."""
        law, e_n = self.setup.law_class, None
        if law is IFRLaw:
            rows = self._materials
            of_walls = [wall.material for wall in self.walls if wall.temperature is None]
            columns = np.array(of_walls if at_wall else [*rows, *of_walls], dtype=np.int64)
            e_n = float(law.column(self.setup.law_rows, "e_n")[np.ix_(rows, columns)].min(initial=1.0))
        rests = any(self.gravity) and not self.force_steps.forces and not self.arrays.uses.pistons
        return advice(
            self.setup.collapse, e_n=e_n, can_rest=rests and law is IFRLaw,
            rebounds=e_n is None or e_n >= checks.LEAST_REBOUND[self.precision], at_wall=at_wall,
        )  # fmt: skip

    def _look_around(self) -> None:
        """Reload an open gas into wider cells once it has spread, and check whether any disks can still collide."""
        state = self._state()
        self.windows.commit()
        self._load(state)

    def _take_watched(self, watching: int, was: float) -> None:
        windows = self.windows
        if watching == k.PAIRS:
            times, whole = (
                np.concatenate(each) for each in zip(*self.comm.allgather(windows.pairs()), strict=True)
            )
            ids = named(whole, "pair")
            time = windows.begin + times.astype(np.float64)
            now = ((time > was) | (windows.begin == was)) & (time <= self.time)
            pair = np.sort(np.stack([ids.id, ids.partner], axis=1)[now], axis=1).astype(np.int64)
            pair -= self.arrays.domain.first_id
            order = np.lexsort((pair[:, 1], pair[:, 0], time[now]))
            self.last_collisions = CollisionTimes(time[now][order], pair[order])
        elif self.tracking is not None and windows.watched.fresh:
            # Histories are the root's.
            parts = self.comm.gather(windows.take_events()) or [windows.take_events(none=True)]
            real, whole = (np.concatenate(each) for each in zip(*parts, strict=True))
            if self.comm.bcast(len(real)):
                self.tracking.gather(windows.begin, real, whole, self.box)

    def release(self) -> None:
        """Give all device memory back; the engine cannot be used any more."""
        self._released = True
        self.arrays.release()

    def __del__(self, is_finalizing: Callable[[], bool] = sys.is_finalizing) -> None:
        # Taichi's arrays of vectors do not free themselves. At the end, `sys` itself may have gone already.
        if not getattr(self, "_released", True) and not is_finalizing():
            self.release()

    def check_valid(self) -> None:
        """Raise an error if the engine has ended, or was interrupted half-way through a window."""
        if self._released:
            raise EngineError(
                "this simulation has ended: another one was started with another device, precision or number of "
                "threads, of which a process has one at a time"
            )
        if not self._valid:
            raise EngineError(
                "a window was interrupted half-way, so the state is lost: begin a new simulation from a stored state"
            )

    @contextmanager
    def exclusive_update(self) -> Iterator[None]:
        """Refuse to begin unless the engine is whole, and delay Ctrl-C until it is whole again."""
        self.check_valid()
        with backend.sole_use(), backend.deferred_interrupts():
            self._valid = False
            yield
            self._valid = True

    def _apply_forces(self) -> None:
        acting = self.force_steps.acting(self.time)
        if not acting:
            return
        self._end_window()
        followed = self.tracking
        before = self._snapshot(self._state()) if followed is not None else None
        for index in acting:
            self.windows.add_flow_work(self.force_steps.apply(index, self.time, self.free))
        self.windows.commit()
        if followed is not None and before is not None:
            followed.kick(self.time, before, self._snapshot(self._state()))
        if self._no_future_collisions:
            self._no_future_collisions = self.n < 2

    # ------------------------------------------------------------------ rest

    def _fly_freely(self, kick: float, t_end: float, rest_at: float, ends: float) -> None:
        """Fly without collisions to a `kick` [time], where a force may set disks in motion; else to `t_end`.

        Not beyond `rest_at` [time]: only a rest on the way, which says nothing of whether there is a way.
        """
        state = self._state()
        moving = bool(np.any(state.velocity)) or bool(np.any(state.spin))
        moving = self.comm.any(moving)
        resting = self.force_steps.keeps_rest and not moving
        next_motion = math.inf if resting else kick
        stop = min(t_end, next_motion)
        self._resting += 1
        patience = max(PATIENCE, self.rotation.steps_per_turn)  # after a whole turn all is as it was
        if not math.isfinite(ends) and (not math.isfinite(next_motion) or self._resting > patience):
            how = "have flown apart" if self.box.is_open else "all fly at one velocity"
            apart = f"the disks {how}, and none" if self._no_future_collisions and moving else "no disk"
            raise NoMoreCollisions(
                f"t = {self.time:.6g}: {apart} can meet another one any more, but more collisions are requested"
            )
        stop = min(stop, rest_at)
        if resting:
            self.force_steps.skip_to(stop)
        separated, self._no_future_collisions = self._no_future_collisions, False
        state.position = state.position + state.velocity * (stop - self.time)
        state.angle = (
            state.angle + state.spin * (stop - self.time) if "angle" in self.setup.record else state.angle
        )
        state.time = stop
        self.windows.commit_at(stop)
        self.arrays.clock.recent = 0.0  # disks may be much faster soon
        self.arrays.load(self.disks, state)
        self._no_future_collisions = separated

    def _thermal_part(self) -> float:
        """Thermal speed over the rms speed, which includes a drift; 1 if all velocities are equal, to rounding."""
        found = measure_of_totals(self.kinds, self._totals(), self.time, 0, about_mean=self.free)
        thermal, whole = found.translational_energy - found.drift_energy, found.translational_energy
        return math.sqrt(thermal / whole) if thermal > 1e-12 * whole else 1.0

    def free_time(self) -> float:
        """Estimated time between two collisions of any disks, at the speed of the fastest one [time]."""
        return self._free_time(self.windows.fastest)

    def _free_time(self, speed: float) -> float:
        """Usual time between two collisions anywhere, if all disks moved at this speed: area / (n^2 sigma v)."""
        area = self.box.area if not self.box.is_open else self.arrays.area
        return area / (self.n**2 * 2.0 * self.disks.mean_radius * max(speed, 1e-300))

    # ------------------------------------------------------------------ reading

    def state(self) -> State:
        """The present state, in order of ids; of the own slice, where ranks have distributed disks."""
        with self.exclusive_update():
            if self.comm.is_distributed:
                return self._state()
            return self.comm.bcast(self._checked(self._read_out(whole=True)[0]))

    def state_here(self) -> State:
        """The present state of the own slice, in id order; without ranks, of all disks."""
        with self.exclusive_update():
            return self._state()

    def columns_here(self, *names: str) -> dict[str, Table]:
        """Quantities of the present state of the own slice, by name and in order of ids.

        Of more than LARGE disks without ranks as `RowsByBlock`, which hold until the engine goes on.
        """
        if self.comm.size > 1 or self.n <= LARGE:
            state = self.state_here()
            return {name: getattr(state, name) for name in names}

        def read(name: str, ids: slice) -> NDArray[Any]:
            from .measuring.readout import read_rows

            with self.exclusive_update():
                frame, _ = read_rows(self, rows_of=ids)
            assert frame is not None
            self._check_inside(frame.rows["image"], ids.start)
            found: NDArray[Any] = frame.rows[name]
            return found

        kind = frame_dtype(self.arrays.uses, False)
        return {
            name: RowsByBlock(
                self.n, partial(read, name), kind[name].base, kind[name].shape, -(-self.n // PASSES)
            )
            for name in names
        }

    def _state(self) -> State:
        return self._checked(self._read_out()[0])

    def _checked(self, state: State | None) -> Any:
        def check() -> State | None:
            if state is not None:
                self._check_inside(state.image)
            return state

        return self.comm.run_on_all(check)

    def _check_inside(self, image: NDArray[np.integer], first: int = 0) -> None:
        """EngineError if one of these disks, with ids from `first` on, has left the box where a wall should be."""
        walled = [axis for axis, periodic in enumerate(self.box.periodic) if not periodic]
        if not walled:
            return
        escaped = np.flatnonzero(np.any(image[:, walled] != 0, axis=1))
        if len(escaped):
            raise EngineError(
                f"t = {self.time:.9g}: disk {first + escaped[0]} left the box where a wall should be; please report this"
            )

    def _read_out(self, whole: bool = False) -> tuple[State | None, NDArray[np.float64]]:
        from .measuring.readout import read

        return read(self, whole)

    def observed(
        self, stored: np.dtype[Any] | None = None
    ) -> tuple[State | FrameRows | None, NDArray[np.float64]]:
        """The present state, on the first rank or of the own slice, and its sums (`kernels/tiles/readout.py`).

        For a file that holds this of each disk (`stored`) it is rows for that.
        """
        from .measuring.readout import read_rows

        whole = not self.comm.is_distributed
        with self.exclusive_update():
            return self._read_out(whole) if stored is None else read_rows(self, stored, whole)

    def totals(self) -> NDArray[np.float64]:
        """Sums over all disks (`kernels/tiles/readout.py`). Less costly than a copy of the state."""
        with self.exclusive_update():
            return self._totals()

    def species_totals(self) -> NDArray[np.float64] | None:
        """Sums over each species (`kernels/tiles/readout.py`); None without species."""
        from .measuring.readout import species_totals

        if not self.kinds.species:
            return None
        with self.exclusive_update():
            return species_totals(self)

    def region_totals(self) -> NDArray[np.float64] | None:
        """Sums over the disks in each region (`kernels/tiles/readout.py`); None without regions."""
        from .measuring.readout import region_totals

        if not self.setup.regions:
            return None
        with self.exclusive_update():
            return region_totals(self)

    def _totals(self) -> NDArray[np.float64]:
        from .measuring.readout import totals

        return totals(self)

    def _excess(self) -> float:
        """Kinetic energy in the frames of rows of tiles beyond that in the flow [energy]."""
        return float(self._totals()[READOUT.excess]) if self.box.shear_rate else 0.0

    @property
    def flow_work(self) -> float:
        """Energy that the flow of a sheared box has put in: its work in the frames of rows, less what only they see."""
        if not self.box.shear_rate:
            return 0.0
        excess = self._excess()
        return self._sum(TALLY.flow_work) - (excess - self._flow_excess)
