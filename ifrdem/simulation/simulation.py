"""A gas, its law and the engine that moves it: the object users run."""

from __future__ import annotations

import contextlib
import math
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, SlowRunWarning, outside_level, shortened
from ..kernels.columns import READOUT, Named
from ..model.box import Box, describe_sides
from ..model.collapse import Collapse
from ..model.custom_code import check_constants
from ..model.device import Device
from ..model.gravity import RotatingGravity
from ..model.laws.ifr import EnergyWarning
from ..model.laws.law import CollisionLaw, check_law_constants
from ..model.laws.pairs import PairLaws
from ..model.observables import Measure, measure_of_totals, sums
from ..model.overlaps import tolerances
from ..model.setup import Setup, laws_of
from ..model.state import (
    COLUMNS,
    DiskKinds,
    Disks,
    State,
    gather_disks,
    gather_state,
    scatter_state,
    species_in,
)
from ..model.walls import crush
from ..model.walls.checks import check_types
from ..model.walls.wall import Wall, WallSums, at_displacements, sides
from ..mpi import Communicator, current
from ..mpi.distribution import bounds
from ..tools import checked
from ..tools.checked import LATER, Comm, Integer, Real, Seed, validated
from ..tools.notebook import DisksRepr
from ..tools.progress import Progress as Bar
from ..tools.progress import output_is_interactive
from ..tools.read_only import NotCopied, ReadOnlyAttributes
from . import backend
from .checkpoints import checkpoint
from .engine import CollisionTimes, Engine
from .measuring.tracking import Events, Tracking, checked_ids
from .start import checks
from .start.overlaps import check_no_overlap
from .steps.output import Output, OutputOptions
from .steps.schedule import (
    FrameCallback,
    Progress,
    RunPlan,
    RunPoint,
    SeriesCallback,
    Trigger,
    end_after,
    end_at,
    warn_of_end,
)
from .steps.slow_run import SlowRunCheck

if TYPE_CHECKING:
    from ..model.forces import Force
    from .measuring.tracking import Statistics
    from .windows.ranks import CommunicationStats


BAR_STEPS = 100
"""Pauses of a run that shows a bar, unless its series sets others."""


def _check_slices(counts: list[int]) -> None:
    """Raise InputError unless each rank has as many disks as its slice."""
    requested = np.diff(bounds(sum(counts), len(counts))).tolist()
    if counts != requested:
        raise InputError(
            f"comm = Communicator(distributed=True): the ranks give {counts} disks, and their slices of {sum(counts)} "
            f"have {requested}: ifrdem.slice_of(n, comm) says which disks a rank must give"
        )


class _Stopped(Exception):
    """The end of a run by `Simulation.stop`."""


class Simulation(NotCopied, ReadOnlyAttributes, DisksRepr):
    """Rough disks in a box, periodic, sheared or between walls, collided exactly by the IFR law.

    Parameters
    ----------
    disks : Disks
        Masses [mass], radii [length], k and materials of n disks. A disk of infinite mass is immovable.
    box : Box
        Periodic sides must be at least three times the largest diameter. Straight walls of material 0 stand at
        sides that are not periodic. `Box.open()` has no sides: disks that fly apart for ever cost nothing.
        In a sheared box there can be no walls and no immovable disks; forces act on peculiar velocities, relative to
        the flow, and see places in the lab.
    law : CollisionLaw or sequence of sequences of CollisionLaw
        One law for all pairs, whatever their materials, or a symmetric table `[material][material]`: an `IFRLaw`, or a
        custom law.
    state : State
        Start: positions [length], velocities [length/time], spins [rad/time]. In a sheared box velocities are those
        in the lab, such as `initial.maxwellian(...) + box.flow(position)`, and its `time` determines how far the images
        above and below have moved.
    walls : sequence of Wall
        Lines, segments, containers and posts, at rest or moving. Where a wall stands at a side of the box, it is hit
        first.
    gravity : two floats or RotatingGravity
        Acceleration of all disks [length/time^2], only in directions that are not periodic, and not among immovable
        disks (`Wall.post` is an obstacle that stays); or one that rotates, as in
        the frame of a slow drum (`ifrdem docs heaps`), between walls only.
    forces : sequence of forces.Force
        Drives and drag that act between collisions, each at the middle of its own steps; at a time at which several do,
        in this order and in the reverse order by turns (`ifrdem.forces`).
    collapse : VelocityCutoff, ContactTime or Rest, optional
        Remedy for inelastic collapse: some collisions are elastic and without friction, which `statistics.elastic`
        counts, those with walls included; or slow contacts last, and disks rest (`ifrdem docs heaps`).
    device : Device or {"cpu", "cuda"}
        Where it is computed, with how many threads, in which precision; on the CPU by default.
    record : sequence of str
        Quantities to record during the run:

        - "ledger": the energy that collisions dissipate, by mechanism, and collisions by regime, in every `Measure`;
        - "dissipated": also that of each disk's collisions, `State.dissipated`;
        - "last_partner": the disk or wall that each disk hit last, `State.last_partner`;
        - "angle": the angle by which each disk has turned, `State.angle`;
        - "stress": the momentum that collisions transfer, in every `Measure`: `observables.stress` makes a pressure
          tensor of two of these;
        - "heat_flux": also the energy that they transfer: `observables.heat_flux`; includes "stress";
        - "histograms": collisions of each pair of species by angle of impact, normal speed and regime, in every
          `Measure`: `observables.histogram`; includes "ledger";
        - "free_times": also by the time since the latest collision of either disk; includes "histograms";
        - "wall_sums": momentum, torque, work, heat and collisions of each wall, `wall_sums` and in every `Measure`.
    regions : mapping of str to four floats, optional
        Rectangles (x_low, y_low, x_high, y_high) by name [length]: the number, mass and energy of the disks whose
        centres are in each are in every `Measure`.
    histories : sequence of int
        Disks of which every collision is kept, for `take_events`; of ranks, on the root. Not in a sheared box.
    seed : int
        Of the random numbers of forces and thermal walls, 0 to 2^64 - 1.
    comm : mpi4py.MPI.Comm or Communicator, optional
        Ranks of MPI that have a part of the gas each (`ifrdem docs ranks`); bitwise the same trajectory. All make the
        same simulation and call the same methods. `disks` and `state` are taken from the first rank (the root), and may
        be None on the others; callbacks are called on the root only. With `Communicator(comm,
        distributed=True)`, each rank gives `disks` and `state` of its slice (`slice_of`), and no rank ever has all
        disks; `state`, and states for frame callbacks, which are called on all ranks, are those of the slice.
        By default the communicator of the `with` block, if there is one.

    Raises
    ------
    InputError
        If disks overlap at the start, the law could add energy for the disks present (a custom law: would let
        them through each other), the box is too small, arrays do not fit, a force cannot act, the remedy for
        collapse is incomplete, or the device is not there.

    Warns
    -----
    EnergyWarning
        If a custom law adds energy in some of 4096 random collisions. `run` warns again if it has.
    SlowRunWarning
        From `run`, after half a minute: the next collision, or the end, is far away at the present pace.
    WallWarning
        From `run`: two walls come within a diameter of each other, and would crush a disk between them.

    Notes
    -----
    Limits: disks of similar size for speed (the largest sets the grid). Inelastic collapse (smooth disks, e_n well
    below 0.7) takes very many collisions without a remedy; touching disks that approach more slowly than 1e-14 of their
    velocities count as at rest, which ends it, and a run that gains no time at all ends with InelasticCollapse.

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    >>> start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], np.zeros(2))
    >>> gas = ifrdem.Simulation(disks, ifrdem.Box((10.0, 10.0)), ifrdem.IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0), start)
    >>> gas.run(t_end=4.0)
    >>> gas.collisions, gas.dissipated_energy
    (1, 0.1875)
    >>> gas.state.velocity[:, 0]
    array([0.25, 0.75])
    """

    _instead = "Store it by save_checkpoint(path): Simulation.from_checkpoint(path) makes another one of it"

    @validated
    def __init__(
        self,
        disks: Annotated[Disks, LATER],
        box: Annotated[Box, LATER],
        law: Annotated[CollisionLaw | Sequence[Sequence[CollisionLaw]], LATER],
        state: Annotated[State, LATER],
        *,
        walls: Sequence[Wall] = (),
        gravity: tuple[float, float] | RotatingGravity = (0.0, 0.0),
        forces: Annotated[Sequence[Force], LATER] = (),
        collapse: Annotated[Collapse | None, LATER] = None,
        device: Annotated[Device | str | None, LATER] = None,
        record: Iterable[str] = (),
        regions: Annotated[Mapping[str, Sequence[float]] | None, LATER] = None,
        histories: Annotated[Sequence[int] | NDArray[np.integer], LATER] = (),
        seed: Seed = 0,
        comm: Comm = None,
    ) -> None:
        comm = Communicator(current(), distributed=True) if comm is None else comm
        device = Device.of(device)

        def typed() -> State:
            for name, value, kind in (("disks", disks, Disks), ("box", box, Box), ("state", state, State)):
                checked.instance(name, value, kind)
            check_types(walls)
            begin = replace(state)  # the caller may have changed it since: everything is checked again
            if begin.n != disks.n:
                raise InputError(
                    f"the state has {begin.n} disks, the list of disks {disks.n}: they must agree"
                )
            return begin

        begin = comm.run_on_holders(typed) or state
        if comm.is_distributed:
            _check_slices(comm.allgather(disks.n))
        kinds: Disks = comm.result_of_holders(lambda: DiskKinds.of(disks))
        kinds = disks if comm.has_all else kinds
        materials = [wall.material for wall in [*walls, *sides(box)]]
        laws = comm.run_on_all(lambda: PairLaws.of(law, kinds, materials, device.precision))

        given: dict[str, Any] = {
            "box": box, "law": laws.table, "walls": walls, "gravity": gravity, "forces": forces, "collapse": collapse,
            "device": device, "record": record, "regions": {} if regions is None else regions, "seed": seed,
        }  # fmt: skip
        setup = comm.run_on_all(lambda: Setup(**given))

        def apart() -> None:
            near, _ = tolerances(box, disks.radius, begin.position, device.rounding)
            check_no_overlap(
                box, disks.radius, begin.position, tolerance=near, time=begin.time, device=device
            )

        comm.result_of_holders(apart)
        self._tracking = self._follow_disks(histories, kinds.n, setup)
        self._stopping = False
        self._pinches_checked = False
        self._external_energy = 0.0  # from changes between runs
        with backend.sole_use():
            self._engine = Engine(setup, disks, begin, tracking=self._tracking, comm=comm)
            # The engine's state of a sheared gas knows its flow, whose energy does not count.
            known = box.shear_rate == 0.0 and (comm.size == 1 or comm.is_distributed)
            if box.shear_rate:
                self._first = self._energy()
            else:
                self._first = comm.result_of_holders(lambda: self._energy_of(disks, begin))
            self._passive_known = laws.is_passive
            self._check_laws(laws, begin if known else None)

    def _follow_disks(
        self, histories: Sequence[int] | NDArray[np.integer], n: int, setup: Setup
    ) -> Tracking | None:
        ids = checked_ids(histories, n)
        if not len(ids):
            return None

        def disks_of(requested: NDArray[np.int32]) -> Disks:
            rows = [getattr(self.disks_here, name) for name in COLUMNS]
            return Disks(len(requested), *self.comm.rows_of(n, requested, rows))

        return Tracking(ids, n, disks_of, setup.law, setup.all_walls)

    def __repr__(self) -> str:
        """A line on the gas and its law, and one on its present time and collisions."""
        setup, n, box = self.setup, self.disks.n, self.box
        size = (
            "open box"
            if box.is_open
            else f"box {box.lengths[0]:.6g} x {box.lengths[1]:.6g} ({describe_sides(box)})"
        )
        parts = [f"{n} disk{'s' * (n != 1)}", size, setup.law_class.__name__]
        parts += [f"{len(self.walls)} wall{'s' * (len(self.walls) != 1)}"] * bool(self.walls)
        parts += [f"gravity {setup.gravity}"] * any(self.gravity)
        parts += [", ".join(type(force).__name__ for force in self.forces)] * bool(self.forces)
        parts += [str(setup.collapse)] * (setup.collapse is not None)
        parts.append(f"{setup.device.name} {setup.device.precision}")
        count = self.collisions
        now = f"t = {self.time:.6g}, {count} collision{'s' * (count != 1)} ({2.0 * count / max(n, 1):.6g} per disk)"
        of_walls = f", {self.wall_collisions} with walls" if setup.all_walls else ""
        return f"Simulation: {', '.join(parts)}\n{now}{of_walls}"

    @property
    def setup(self) -> Setup:
        """The present setup: what the simulation was made of, and what was set since."""
        return self._engine.setup

    @property
    def has_ledger(self) -> bool:
        """True if the energy that collisions take is added up, by mechanism."""
        return self.setup.has_ledger

    @property
    def gravity(self) -> tuple[float, float]:
        """Present acceleration of all disks [length/time^2]."""
        return self._engine.gravity

    @property
    def forces(self) -> tuple[Force, ...]:
        """Forces that act between collisions, in their order."""
        return self.setup.forces

    @validated
    def set_law(self, law: Annotated[CollisionLaw | Sequence[Sequence[CollisionLaw]], LATER]) -> None:
        """Set another law for later collisions: one for all pairs, or a table, as for a new simulation.

        Raises
        ------
        InputError
            If the law could add energy for the disks present, or the table does not fit; the gas is as it was then.
        """
        materials = [wall.material for wall in self._engine.walls]
        laws = PairLaws.of(law, self.disks, materials, self._engine.precision)
        with backend.sole_use():
            self._check_laws(laws, None)
            self._engine.set_law(laws.table)
        self._passive_known = self._passive_known and laws.is_passive
        if self._tracking is not None:
            self._tracking.laws = self.setup.law

    @validated
    def set_forces(self, forces: Annotated[Sequence[Force], LATER]) -> None:
        """Replace the forces; an empty list for none.

        `energy_inputs` are then those of the new forces; `energy_input` still has what the old ones put in.

        Raises
        ------
        InputError
            If one is none, or cannot act on this gas; the gas is as it was then.
        """
        energy_input = math.fsum(self._engine.force_steps.energy_inputs)
        self._engine.set_forces(forces)
        self._external_energy += energy_input

    @validated
    def set_gravity(self, gravity: tuple[float, float]) -> None:
        """Set another gravity [length/time^2].

        The change of potential energy counts as `energy_input`.

        Raises
        ------
        InputError
            If it is not two finite numbers, acts along a periodic direction, or gravity turns; the gas is as it was
            then.
        """
        before = self.measure()
        self._engine.set_gravity(gravity)
        self._count_change(before)

    @validated
    def set_piston_force(self, wall: Annotated[int, Integer(0)], force: Real) -> None:
        """Set another constant force [mass length/time^2] on a piston; `wall` is its number.

        Raises
        ------
        InputError
            If that wall is no piston, or the force no finite number; the gas is as it was then.
        """
        self._engine.set_piston_force(wall, force)

    def set_velocities(self, velocity: ArrayLike, spin: ArrayLike | None = None) -> None:
        """Give the disks other velocities, and spins if given; the change of energy counts as `energy_input`.

        Parameters
        ----------
        velocity : array_like (n, 2)
            Velocities in the lab [length/time], in a sheared box too.
        spin : array_like (n,), optional
            Spins [rad/time]; the present ones by default.

        Raises
        ------
        InputError
            If a shape does not fit, a value is not finite, or an immovable disk would move; the gas is as it was then.
        """
        present = self.state
        state = State(
            present.position, velocity, present.spin if spin is None else spin, time=self.time  # type: ignore[arg-type]
        )  # fmt: skip
        before = self.measure()
        if not self.comm.is_distributed:
            with self.comm:
                state = scatter_state(self.disks, state)[1]
        self._engine.set_velocities(state)
        self._count_change(before)

    def _count_change(self, before: Measure) -> None:
        after = self.measure()
        self._external_energy += (
            after.energy + after.potential_energy - before.energy - before.potential_energy
        )

    def _check_laws(self, laws: PairLaws, state: State | None) -> None:
        """Check laws at the speeds of a state, by default the present one.

        Custom laws are tried on random pairs of disks as fast as those.
        """
        has_range = laws.kind.check_speed is not CollisionLaw.check_speed
        if not laws.is_sampled and not has_range:
            return
        state = self._engine.state_here() if state is None else state
        if has_range:
            rms = math.sqrt(float(np.sum(np.square(state.velocity))) / max(len(state.velocity), 1))
            rms = self.comm.largest(rms)
            self.comm.run_on_all(lambda: laws.check_speed(self._kinds_of_disks, rms))
        if not laws.is_sampled:
            return
        fastest = self.comm.largest(checks.fastest(self.disks_here, state.velocity, state.spin))
        of_walls = [wall.material for wall in self._engine.walls]
        self.comm.run_on_root(lambda: laws.check_by_sampling(self._kinds_of_disks, of_walls, fastest or 1.0))

    @property
    def _kinds_of_disks(self) -> Disks:
        kinds = self._engine.kinds
        return kinds.rows if isinstance(kinds, DiskKinds) else kinds

    @property
    def tracked(self) -> NDArray[np.int32]:
        """Disks of which every collision is kept, ascending."""
        return np.empty(0, dtype=np.int32) if self._tracking is None else self._tracking.ids

    def take_events(self) -> Events:
        """Every collision of tracked disks since the last call, or the start, and what forces did to them.

        In a frame callback, those until its frame. Of ranks, the root gets all, and the others none.
        """
        if self._tracking is None:
            raise InputError("no disk is tracked: Simulation(..., histories=[0, 1]) follows the first two")
        return self._tracking.take(self.time)

    @property
    def comm(self) -> Communicator:
        """Ranks that have a part of the gas each; of size 1 without MPI."""
        return self._engine.comm

    @property
    def n_kernels(self) -> int:
        """Approximate number of kernels that the first window of a run, its forces and its output need."""
        return self._engine.n_kernels

    @property
    def communication(self) -> CommunicationStats | None:
        """Messages and bytes that this rank has sent to others so far; None if one rank has all of the gas."""
        found: CommunicationStats | None = getattr(self._engine.arrays.domain, "communication", None)
        return found

    @property
    def disks(self) -> Disks:
        """The constant properties of the disks; of their kinds (`DiskKinds`) on ranks that do not have all disks."""
        return self._engine.disks

    @property
    def disks_here(self) -> Disks:
        """The constant properties of the disks of this rank's slice (`slice_of`); without ranks, of all."""
        return self._engine.disks_here

    @property
    def box(self) -> Box:
        """The box."""
        return self.setup.box

    @property
    def walls(self) -> tuple[Wall, ...]:
        """Walls other than those at the sides of the box."""
        return self.setup.walls

    @property
    def time(self) -> float:
        """The present time [time]."""
        return self._engine.time

    @property
    def collisions(self) -> int:
        """Collisions so far; each involves two disks."""
        return self._engine.collisions

    @property
    def _now(self) -> RunPoint:
        return RunPoint(self.time, self.collisions)

    @property
    def wall_collisions(self) -> int:
        """Collisions with walls so far."""
        return self._engine.wall_collisions

    @property
    def asleep(self) -> int:
        """Number of sleeping disks (`resting_speed`)."""
        return self._engine.asleep

    @property
    def wall_work(self) -> float:
        """Energy that moving walls have given to the disks up to the latest `state` [energy]."""
        return self._engine.wall_work

    @property
    def wall_heats(self) -> NDArray[np.float64]:
        """Heat that each of the `walls` has given to the disks up to the latest `state` [energy], shape (walls,)."""
        return self._engine.wall_heats[: len(self.walls)]

    @property
    def wall_sums(self) -> WallSums:
        """Sums of what each wall has given to the disks up to the latest `state`, the sides of the box last.

        Raises
        ------
        InputError
            If this simulation was made without them.
        """
        if "wall_sums" not in self.setup.record:
            raise InputError('wall_sums: not recorded; make the simulation with record=["wall_sums"]')
        return WallSums(self._engine.walls, self._engine.wall_sums)

    @property
    def pistons(self) -> NDArray[np.float64]:
        """Displacement, velocity, energy and constant force of each piston, up to the latest `state`.

        In [length], [length/time], [energy] and [mass length/time^2], shape (pistons, 4), in the order of the walls.
        The energy is that of `Piston.energy`, with its weight; the force is the latest one that was set.
        """
        return self._engine.pistons

    @property
    def wall_heat(self) -> float:
        """Heat that all thermal walls have given to the disks up to the latest `state` [energy]."""
        return math.fsum(self._engine.wall_heats)

    @property
    def statistics(self) -> Statistics:
        """Counts of the engine: windows, those left to one thread, tiles run again."""
        return self._engine.statistics

    @property
    def bytes_allocated(self) -> int:
        """Memory of the engine's arrays [bytes]."""
        return self._engine.bytes_allocated

    @property
    def energy_inputs(self) -> NDArray[np.float64]:
        """Energy that each force has put in since it acts here [energy], shape (forces,)."""
        return self._engine.force_steps.energy_inputs.copy()

    @property
    def shear_work(self) -> float:
        """Energy that the flow of a sheared box has given to peculiar motion up to the latest `state` [energy].

        Its mean power is -shear_rate P_xy Lx Ly: it gives the shear stress, collisions included.
        """
        return self._engine.flow_work

    @property
    def energy_input(self) -> float:
        """Energy that all forces, and the flow of a sheared box, have put in since this simulation was made [energy].

        Less what they took out; of the flow, up to the latest `state`. `set_velocities`, `set_gravity`, forces that
        act no more and the change of potential energy where gravity turns count too.
        """
        done = self._engine.force_steps.energy_inputs
        return math.fsum((*done, self.shear_work, self._engine.rotation.work, self._external_energy))

    @property
    def dissipated_energy(self) -> float:
        """Energy that collisions have taken since this simulation was made [energy].

        It is what is missing of the start and of what forces, a flow, moving and thermal walls and the fall under
        gravity have put in.
        Below 0, beyond rounding, the law adds energy.
        """
        present = self._energy()  # which brings the walls' work up to date
        return self._first + self.energy_input + self.wall_work + self.wall_heat - present

    def _energy(self) -> float:
        """Present kinetic and potential energy [energy]."""
        state = self._engine.state_here()
        with self.comm:
            return self._energy_of(self.disks_here, state)

    def _energy_of(self, disks: Disks, state: State) -> float:
        """Kinetic and potential energy [energy] of a state; gravity acts along walled directions only."""
        totals = Named(sums(disks, state, self._engine.gravity), READOUT)
        return float(totals.translational + totals.rotational - totals.fall)

    def save_checkpoint(
        self,
        path: str | os.PathLike[str],
        extra: Mapping[str, Any] | None = None,
        arrays: Mapping[str, NDArray[Any]] | None = None,
    ) -> None:
        """Write all that decides the future, to the last bit, into a file of its own: it appears whole or not at all.

        It does not contain events of tracked disks that were not taken. Ranks among which the disks are distributed
        write a part each (`checkpoint.write_parts`); any number of ranks can resume from them.

        Parameters
        ----------
        path : path
            The file; an existing one is replaced.
        extra : mapping, optional
            What else belongs there: anything that JSON knows.
        arrays : mapping, optional
            And arrays, by names that begin with "extra_".

        Raises
        ------
        InputError
            If it cannot be written, the path is none, or `extra` holds what JSON does not know.
        """
        from .checkpoints import snapshot

        comm, n = self.comm, self.disks.n
        comm.run_on_root(lambda: checkpoint.check_extra(path, extra, arrays))
        found = snapshot.take(self._engine, by_block=True)
        columns = self._engine.columns_here("position", "velocity", "spin")
        found |= {f"state_{name}": each for name, each in columns.items()}
        found["state_pistons"] = self.pistons
        found |= {f"disks_{name}": getattr(self.disks_here, name) for name in COLUMNS}
        found["tracked"] = self.tracked
        meta: dict[str, Any] = {"gas": self._record(), "n": n}
        meta |= {"first": self._first, "given": self._external_energy, "extra": dict(extra or {})}
        own, small = checkpoint.divided(found)
        small |= arrays or {}
        if comm.is_distributed:
            with comm:
                checkpoint.write_parts(path, own, small, meta)
            return
        rows = comm.gather_rows(n, list(own.values()))
        comm.run_on_root(
            lambda: checkpoint.write(path, small | dict(zip(own, rows or (), strict=True)), meta)
        )

    def load_checkpoint(self, path: str | os.PathLike[str] = "") -> dict[str, Any]:
        """Return to the state at which `save_checkpoint` was called, with the same bits; returns `extra`.

        This simulation must have been made of the same disks, box, laws, walls, forces, seed and precision, from any
        start.

        Raises
        ------
        InputError
            If the file is none, or belongs to another gas; or if it is called on the class.
        """
        if not isinstance(self, Simulation):  # Simulation.load_checkpoint(path)
            raise InputError(
                f"Simulation.load_checkpoint({self!r}): must be called on a simulation; "
                "Simulation.from_checkpoint(path) makes one from the file"
            )
        self._engine.check_valid()
        with self.comm:
            found, meta = checkpoint.read_slice(checked.path("path", path))
        self._restore(path, found, meta)
        extra: dict[str, Any] = meta["extra"]
        return extra

    def _record(self) -> dict[str, Any]:
        """The record of the present setup, with a hash of the disks and their species."""
        engine = self._engine
        disks = [self.comm.digest(getattr(engine.disks_here, name)).hex() for name in COLUMNS]
        return {"disks": disks, **self.setup.to_record(), "species": dict(engine.kinds.species)}

    def _restore(
        self, path: str | os.PathLike[str], found: dict[str, NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Make this gas that of a checkpoint, as `checkpoint.read_slice` gave it: InputError if it is another one."""
        from .checkpoints import snapshot

        with checkpoint.as_damage_error(path, "its record"):
            checkpoint.check_versions(meta, path, meta["gas"]["device"]["name"])
            if different := checkpoint.differences(self._record(), meta["gas"]):
                raise InputError(
                    f"{path}: the checkpoint of another gas: it differs in {', '.join(different)}"
                )
        if self.comm.is_root:
            checkpoint.report_runtime(meta, path)
        snapshot.restore(self._engine, found)
        self._first, self._external_energy = float(meta["first"]), float(meta["given"])

    @classmethod
    @validated
    def from_checkpoint(
        cls,
        path: str | os.PathLike[str],
        *,
        law: Annotated[CollisionLaw | Sequence[Sequence[CollisionLaw]] | None, LATER] = None,
        forces: Annotated[Sequence[Force] | None, LATER] = None,
        device: Annotated[Device | str | None, LATER] = None,
        comm: Comm = None,
    ) -> Simulation:
        """The gas of a checkpoint: it runs on as if it had never been interrupted, to the last bit.

        Parameters
        ----------
        path : str or path
            A file of `save_checkpoint`, or NAME.checkpoint.h5 of an interrupted `ifrdem run`. It holds disks, box, law,
            walls, gravity, forces, `collapse`, device, `record`, tracked disks, seed and the present state.
        law, forces
            The same law and forces as before: only needed if one is a custom class of Python, whose code is not in the
            file. The code of a custom law of a case is executed from its own file, if that has not changed.
        device : Device or str, optional
            The same device with another number of threads, which changes no bit.
        comm : mpi4py.MPI.Comm or Communicator, optional
            Ranks that share the gas, as for a new simulation; any number of them, whatever it was before.

        Raises
        ------
        InputError
            If the file is no checkpoint, is damaged, or was written by another version of ifrdem or Taichi; if a custom
            law or force is not given; if what is given differs from what the gas had.

        Examples
        --------
        >>> import ifrdem
        >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
        >>> start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
        >>> gas = ifrdem.Simulation(disks, ifrdem.Box((10.0, 10.0)), ifrdem.IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0), start)
        >>> gas.run(t_end=1.0)
        >>> gas.save_checkpoint("pair.checkpoint.h5")
        >>> again = ifrdem.Simulation.from_checkpoint("pair.checkpoint.h5")
        >>> again.run(t_end=4.0)
        >>> again.time, again.collisions
        (4.0, 1)
        """
        comm = Communicator(current(), distributed=True) if comm is None else comm
        with comm:
            found, meta = checkpoint.read_slice(path)
        with checkpoint.as_damage_error(path, "its record"):
            checkpoint.check_versions(meta, path, meta["gas"]["device"]["name"])
            if law is None:
                law = comm.root_result(lambda: laws_of(meta["gas"], path))
            setup = Setup.from_record(meta["gas"], path, law=law, forces=forces, device=device)
            pistons = at_displacements(setup.walls, found["state_pistons"][:, 0].tolist())
            given = replace(setup, walls=tuple(pistons)).arguments
            n, state = int(meta["n"]), checkpoint.state_of(found)
            disks = checkpoint.disks_of(found, species_in(meta["gas"]["species"], comm.slice_of(n)))
        whole: Any = disks, state
        if not comm.is_distributed:  # the root gives all
            with comm:
                whole = gather_disks(n, disks), gather_state(n, state)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)  # the gas has warned when it was made
            made = cls(whole[0], state=whole[1], histories=found["tracked"], comm=comm, **given)
        made._restore(path, found, meta)
        return made

    @property
    def state(self) -> State:
        """A copy of the present state, in the order of the disks; of a distributed gas, that of this rank's slice.

        Quantities that are not recorded (`record`) raise InputError when used.
        """
        return self._engine.state().without_all_but(self.setup.recorded)

    @validated
    def run(
        self,
        *,
        t_end: Annotated[float | None, LATER] = None,
        collisions_per_disk: Annotated[float | None, LATER] = None,
        frames: Annotated[int | Trigger, LATER] = 1,
        frame_callbacks: Iterable[FrameCallback] = (),
        series: Annotated[int | Trigger | None, LATER] = None,
        series_callbacks: Iterable[SeriesCallback] = (),
        progress: Annotated[Progress | bool | None, LATER] = None,
    ) -> None:
        """Run to a time, or until each disk has had so many collisions on average since the start.

        Parameters
        ----------
        t_end : float
            End [time], not before the present time.
        collisions_per_disk : float
            End by 2 * collisions / n. Exactly one of the two must be given. Both count from the start of the gas, not
            from this call: to run on, give a later end, or use `run_for`.
        frames : int or Trigger
            Frames after the first one, evenly spaced in the quantity that ends the run, or another cadence
            (`ifrdem.simulation.steps.schedule.Trigger`); a frame at
            a number of collisions stands right after the last of them, and after any others at exactly that time.
        frame_callbacks : iterable of callables
            Each is called as `callback(state, measure)` at the beginning and at every frame. `measure.dissipated`
            and `measure.regimes` are None there: series callbacks get them, and `measure()` gives them at the end. The
            simulation itself is further by then, and cannot be asked or saved there.
        series : int or Trigger, optional
            How often series callbacks are called, likewise.
        series_callbacks : iterable of callables
            Each is called as `callback(measure)` at the beginning, the end, and in between.
        progress : bool or callable, optional
            A bar in a notebook or on a terminal, which says how many kernels it has compiled until the gas moves; by
            default only there, and not of a run below half a second. True writes lines elsewhere, False nothing
            anywhere. A function is called as `progress(time, collisions)` after every window; after some, where those
            of a small gas are short.

        Notes
        -----
        `stop` ends a run early. An exception raised by a callback ends it too, at the frame of a frame callback. So
        does Ctrl-C (KeyboardInterrupt), at the end of the window, or within one of more than a million events in one
        tile; a second one ends it at once, and the state is lost unless a frame callback was just at work. In all
        other cases the gas can be run on.

        Raises
        ------
        InputError
            If not exactly one end is given, or it lies in the past.
        RunWarning
            If the end is reached already, so that nothing moves.
        NoMoreCollisions
            If the end is a number of collisions and no disk can meet another one any more.
        InelasticCollapse
            If collisions pile up without end, or a disk comes to rest on a wall: `collapse` says what helps.
        EngineError
            If another thread runs a simulation, or the process is a forked copy of one that has; or if a guarantee of
            the engine is violated.
        """
        now = self._now
        end = end_at(self.disks.n, now, t_end=t_end, collisions_per_disk=collisions_per_disk)
        if end.reached(*now) and any(now) and self.comm.is_root:
            warn_of_end(t_end=t_end, collisions_per_disk=collisions_per_disk)
        output = Output.of(
            frames=frames, frame_callbacks=frame_callbacks, series=series, series_callbacks=series_callbacks,
            progress=progress,
        )  # fmt: skip
        self._run(now, end, output)

    @validated
    def run_for(
        self,
        *,
        time: Annotated[float | None, LATER] = None,
        collisions_per_disk: Annotated[float | None, LATER] = None,
        **output: Unpack[OutputOptions],
    ) -> None:
        """Run with an end that counts from this call; else as `run`.

        Parameters
        ----------
        time : float
            Further time [time].
        collisions_per_disk : float
            Further collisions of each disk on average. Exactly one of the two must be given.
        **output
            Frames, series, callbacks and progress, as for `run`.

        Raises
        ------
        InputError
            If not exactly one of the two is given, or it is not positive.
        EngineError
            As `run`.

        Examples
        --------
        >>> import ifrdem
        >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
        >>> start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
        >>> gas = ifrdem.Simulation(disks, ifrdem.Box((10.0, 10.0)), ifrdem.IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0), start)
        >>> gas.run_for(time=1.5)
        >>> gas.run_for(time=1.5)
        >>> print(gas)
        Simulation: 2 disks, box 10 x 10 (periodic), IFRLaw, cpu f64
        t = 3, 1 collision (1 per disk)
        """
        now = self._now
        end = end_after(self.disks.n, now, time=time, collisions_per_disk=collisions_per_disk)
        self._run(now, end, Output.of(**output))

    def _run(self, now: RunPoint, end: RunPoint, output: Output) -> None:
        """Run from the present point to the end, with a bar where one is asked for."""
        plan = RunPlan(self.disks.n, now, end, output.frames, output.series)
        self._warn_of_pinches(end.time)
        progress = output.progress
        with contextlib.ExitStack() as stack:
            if progress is True or (progress is None and self.comm.size == 1 and output_is_interactive()):
                plan.series = plan.series or Trigger(number=BAR_STEPS)  # pauses, which change no bit
                progress = None
                if self.comm.is_root:
                    progress = bar = stack.enter_context(self._bar(end))
                    stack.enter_context(backend.announced(bar.compiling))
            self._follow(plan, replace(output, progress=progress))

    def _bar(self, end: RunPoint) -> Bar:
        """A bar of the progress to an end."""
        by_time, n = math.isinf(end.collisions), self.disks.n
        return Bar(
            n, t_end=end.time if by_time else None, unit="",
            collisions_per_disk=None if by_time else 2.0 * end.collisions / max(n, 1),
            begin=(self.time, self.collisions), kernels=self.n_kernels, brief=True,
        )  # fmt: skip

    def _warn_of_pinches(self, t_end: float) -> None:
        """Warn, once, of walls that may crush a disk between them until `t_end` [time]; InputError if they must."""
        if self._pinches_checked or not self.disks.n or self.box.is_open:
            return
        for text in crush.wall_pinch_warnings(
            self._engine.walls, self.box, self.disks.radius, self.time, t_end
        ):
            warnings.warn(text, crush.WallWarning, stacklevel=5)
        self._pinches_checked = True

    def switch_ledger(self, on: bool) -> None:
        """Switch the energy ledger off or on; its sums then cover only the time with it.

        It is there to time what the ledger costs.

        Raises
        ------
        InputError
            If the simulation was made without a ledger, or records what each disk loses, which needs it.
        """
        if not self.has_ledger:
            raise InputError('the ledger is not recorded; make the simulation with record=["ledger"]')
        if "dissipated" in self.setup.record:
            raise InputError('record: "dissipated" needs "ledger", which must stay on')
        self._engine.switch_ledger(on)

    def follow(
        self,
        plan: RunPlan,
        *,
        frame_callbacks: Iterable[FrameCallback] = (),
        series_callbacks: Iterable[SeriesCallback] = (),
        progress: Progress | None = None,
        between: Callable[[], None] | None = None,
        stored: np.dtype[Any] | None = None,
    ) -> None:
        """Run as `run` does, from where a plan is to its end; `between()` is called wherever the run could stop.

        Frame callbacks that write files get what those hold of each disk (`stored`) as `FrameRows`, which is faster.
        The plan is kept up to date: after an exception it has what is due next.
        """
        for name, value in (("progress", progress), ("between", between)):
            if value is not None and not callable(value):
                raise InputError(f"{name} = {shortened(value)}: must be a function")
        output = Output.of(
            frames=plan.frames, frame_callbacks=frame_callbacks, series=plan.series,
            series_callbacks=series_callbacks, progress=progress,
        )  # fmt: skip
        self._follow(plan, output, between, stored)

    def _follow(
        self,
        plan: RunPlan,
        output: Output,
        between: Callable[[], None] | None = None,
        stored: np.dtype[Any] | None = None,
    ) -> None:
        """Check what users can have changed, and follow a plan to its end, or to a stop."""
        self._stopping = False
        check_law_constants(self.setup.law_class)
        for i, force in enumerate(self.forces):
            check_constants(f"forces[{i}] = {type(force).__name__}", type(force), "act", "measure")
        self._engine.check_duration(plan.end.time)
        if (comm := self.comm).size > 1:
            comm.require_equal(repr(plan), "the end of a run, its frames or its series")
            if comm.is_distributed:
                comm.require_equal(str(len(output.frame_callbacks)), "the number of frame callbacks")
            output = output.on(comm)
        asked = backend.stops_asked_by(lambda: self._stopping)
        with backend.sole_use(), backend.handled_interrupts(), asked, contextlib.suppress(_Stopped):
            self._follow_points(plan, output, between, stored)
        if not self._passive_known:
            self._report_gain()

    def stop(self) -> None:
        """End the run at the frame of the calling frame callback; it returns as if that were its end.

        Called by a series callback, `progress` or another thread, it ends the run where Ctrl-C does.
        """
        self._stopping = True

    def _stop_if_asked(self) -> None:
        self._stopping = self.comm.any(self._stopping)
        if self._stopping:
            raise _Stopped

    def _follow_points(
        self,
        plan: RunPlan,
        output: Output,
        between: Callable[[], None] | None,
        stored: np.dtype[Any] | None,
    ) -> None:
        """Run from point to point of a plan, and call what is due there."""
        frames, rows, end = plan.frames, plan.rows, plan.end
        sampling = plan.series is not None and bool(output.series_callbacks)
        exact = sampling and plan.series is not None and plan.series.exact
        if plan.next_row == 0:
            plan.next_row = 1
            if sampling:
                self._call_at_row(output)
        if plan.next_frame == 0:
            plan.next_frame = 1
            self._call_at_frame(output, stored)
            if between is not None:
                between()
        pace, now = SlowRunCheck(end), (self.time, self.collisions)
        while not end.reached(*now) or plan.next_frame == 1:
            while not (frame := plan.point(frames, plan.next_frame)).reached(*now):
                row = plan.point(rows, plan.next_row)
                stop = frame.earlier(row) if exact else frame
                self._engine.advance(
                    t_end=stop.time, collisions=stop.collisions, pause_at=row.time, pause_after=row.collisions,
                    rest_at=frame.time, ends=end.time, next_points=partial(plan.next_points, exact),
                )  # fmt: skip
                now = self.time, self.collisions
                if callable(output.progress):
                    output.progress(*now)
                slow = pace.trouble(*now, self._engine.free_time)
                if slow is not None and self.comm.is_root:
                    warnings.warn(slow, SlowRunWarning, stacklevel=outside_level())
                # A stop that was asked for within a window is no place of a row that comes at a window's end.
                at_row = row.reached(*now) and (exact or not self._engine.windows.stopped_early)
                if plan.series is not None and at_row:
                    plan.next_row = plan.first_not_reached(rows, plan.next_row, *now)
                    if sampling:
                        self._call_at_row(output)
                if between is not None and not frame.reached(*now):
                    between()
                self._stop_if_asked()
            # First: a callback that raises has had its frame.
            plan.next_frame = plan.first_not_reached(frames, plan.next_frame + 1, *now)
            self._call_at_frame(output, stored)
            if between is not None and not end.reached(*now):
                between()

    def _report_gain(self) -> None:
        """Warn if a law without a proof of passivity has added energy."""
        gained = -self.dissipated_energy
        turned_over = abs(self._first) + abs(self.energy_input) + abs(self.wall_work) + abs(self.wall_heat)
        if gained > 1e-9 * turned_over:
            warnings.warn(
                f"t = {self.time:.6g}: collisions have added energy, {gained:.6g} in all: the law is not passive",
                EnergyWarning,
                stacklevel=outside_level(),
            )

    def collide_until(self, t_end: float) -> CollisionTimes:
        """Run to `t_end` [time] and return every collision on the way, in order.

        Raises
        ------
        InputError
            If it is not a finite time, or lies in the past.
        """
        end_at(self.disks.n, self._now, t_end=t_end)  # refuses it
        self._engine.check_duration(t_end)
        return self._recorded(lambda: self.time < t_end, t_end=t_end)

    @validated
    def collide(self, count: Annotated[int, Integer(0, 2**53)]) -> CollisionTimes:
        """Run for `count` collisions and return them, in order.

        More come back only where several happen at one and the same time, as at the end of an inelastic collapse.

        Raises
        ------
        InputError
            If `count` is not a whole number, 0 or more.
        """
        target = self.collisions + count
        return self._recorded(lambda: self.collisions < target, collisions=target)

    def _recorded(self, unfinished: Callable[[], bool], **end: float) -> CollisionTimes:
        found = [CollisionTimes(np.empty(0), np.empty((0, 2), dtype=np.int64))]
        self._engine.keep_collisions = True
        try:
            with backend.sole_use(), backend.handled_interrupts():
                while unfinished():
                    self._engine.advance(**end)  # type: ignore[arg-type]
                    if self._engine.last_collisions is not None:
                        found.append(self._engine.last_collisions)
        finally:
            self._engine.keep_collisions = False
        return CollisionTimes(
            np.concatenate([c.time for c in found]), np.concatenate([c.pair for c in found])
        )

    def _call_at_frame(self, output: Output, stored: np.dtype[Any] | None) -> None:
        if not output.frame_callbacks:
            return
        state, totals = self._engine.observed(stored)
        species = self._engine.species_totals()
        measured = measure_of_totals(
            self.disks, totals, self.time, self.wall_collisions, species=species, **self._energy_terms()
        )
        recorded = self.setup.recorded

        def call_back() -> None:
            assert state is not None
            shown = state.without_all_but(recorded) if isinstance(state, State) else state
            for callback in output.frame_callbacks:
                callback(shown, measured)

        (self.comm.run_on_all if self.comm.is_distributed else self.comm.run_on_root)(call_back)
        self._stop_if_asked()

    def _call_at_row(self, output: Output) -> None:
        measured = self.measure()

        def call_back() -> None:
            for callback in output.series_callbacks:
                callback(measured)

        self.comm.run_on_root(call_back)

    def measure(self) -> Measure:
        """Totals and averages of the present state: `observables.measure`, without copying it from the device."""
        totals = self._engine.totals()  # ends the window
        ledger: dict[str, Any] = {}
        if self.has_ledger:
            ledger["dissipated"], ledger["regimes"] = self._engine.dissipated()
        if "wall_sums" in self.setup.record:
            ledger["walls"] = self._engine.wall_sums
        ledger |= {"species": self._engine.species_totals(), "regions": self._engine.region_totals()}
        return measure_of_totals(
            self.disks, totals, self.time, self.wall_collisions, **self._energy_terms(), **ledger
        )

    def _energy_terms(self) -> dict[str, Any]:
        """Arguments of `measure` that a state does not contain: sums since the start, directions of a free drift."""
        free = self._engine.free if self._engine.force_steps.allow_drift else (False, False)
        return {
            "energy_input": self.energy_input, "wall_work": self.wall_work, "wall_heat": self.wall_heat,
            "asleep": self.asleep, "pistons": self.pistons if self._engine.arrays.uses.pistons else None,
            "about_mean": free, "placed": bool(self.setup.all_walls), "virial": self._engine.virial if "stress" in self.setup.record else None,
            "energy_transfer": self._engine.energy_transfer if "heat_flux" in self.setup.record else None,
            "histograms": self._engine.histograms if "histograms" in self.setup.record else None,
        }  # fmt: skip
