"""Starts of the gas of a case: the state in which it begins, drawn, placed or read, of ranks in slices.

The functions are of a `CaseGas`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem
from ..initial import packing, placement
from ..model.state import State
from ..model.walls.free_area import FreeArea
from ..mpi import current
from ..simulation import backend
from ..simulation.start import cells
from ..tools import seeds
from . import rules
from .case import GROWN, IMPACT_SCAN

if TYPE_CHECKING:
    from .gas import CaseGas

PLACED_BY_CHECK = {"random": 10_000, GROWN: 2_000}
"""Numbers of disks that are placed in about a second, by `start.positions`; others are faster than random."""


def with_start(gas: CaseGas, folder: Path) -> tuple[CaseGas, list[Problem]]:
    """The gas with the slice of a start that each rank reads (`is_read_in_slices`), and all that is wrong with it.

    All ranks call this, in a `with` block of their communicator, and find the same wrong.
    """
    found: list[Problem] = []
    radius = gas.rows(current().slice_of(gas.n)).radius
    given = rules.given_start(gas.case, radius, gas.free_area, folder, found)
    return replace(gas, given=given), found


def start(gas: CaseGas, progress: Callable[[float], None] = lambda _: None) -> State:
    """The state at the start, without overlaps; `progress` gets the part of growing that is done.

    Of ranks (`Communicator`), each gets its slice of a start that is made so (`is_made_in_slices`).

    Raises InputError if the disks do not fit into the box in the way the case wants: a line with the key.
    """
    gas.case.run.choose_runtime()
    given, device = gas.given, backend.of_rank(gas.case.run.made_device())
    with cells.kernels_for(gas.n, device):  # with the threads of the run
        position = placed(gas, progress) if given is None else given.position
    past: dict[str, Any] = {} if given is None else {"time": given.time, **given.past}
    if given is not None and given.velocity is not None and given.spin is not None:
        return State(position=position, velocity=given.velocity, spin=given.spin, **past)
    velocity, spin = drawn_motion(gas)
    return State(position=position, velocity=velocity + gas.box.flow(position), spin=spin, **past)


def placed(gas: CaseGas, progress: Callable[[float], None]) -> NDArray[np.float64]:
    """Positions that are generated, shape (n, 2) [length]; of ranks, of the slice. InputError with the key if not."""
    mode, seed = gas.case.start.positions, gas.case.run.seed
    assert gas.start_region is not None  # the rules have seen to it
    comm = current()
    disks = gas.disks if comm.size == 1 else gas.rows(comm.slice_of(gas.n))
    radius, options = disks.radius, dict[str, Any](seed=seed, walls=gas.walls)
    try:
        if mode == "hexagonal":
            # Several species would lie in layers else.
            options["seed"] = seed if len(gas.species) > 1 or not gas.species[0].equal else None
            return placement.hexagonal_positions(gas.start_region, radius, **options)
        if mode == GROWN:
            return packing.grown_positions(gas.start_region, radius, progress=progress, **options)
        return placement.random_positions(gas.start_region, radius, **options)
    except InputError as error:
        raise InputError(str(Problem("start.positions", f'"{mode}"', str(error)))) from None


def drawn_motion(gas: CaseGas) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocities relative to the flow, shape (n, 2), and spins, (n,), that are drawn; of ranks, of the slice."""
    own, seed = gas.of_species(current().slice_of(gas.n)), gas.case.run.seed
    numbers, first = [len(ids) for ids in own], gas.species[0]
    mass = np.concatenate([each.columns(ids)[0] for each, ids in zip(gas.species, own, strict=True)])
    if len(gas.species) == 1 and first.temperature is None:  # exact
        velocity = placement.maxwellian(mass, speed_rms=first.speed_rms, seed=seed)
    else:
        energy = np.repeat([each.mean_energy for each in gas.species], numbers)
        velocity = placement.thermal(mass, energy, seed)
    spin_rms = np.repeat([each.spin_rms for each in gas.species], numbers)
    return velocity, placement.gaussian_spins(len(mass), spin_rms=spin_rms, seed=seed)


def fastest_drawn(gas: CaseGas) -> tuple[float, float]:
    """More than the largest speed [length/time] and spin [rad/time] that are drawn: 12 deviations."""
    speeds = [
        each.speed_rms * math.sqrt(each.summary.mass.high / each.summary.mass.low) for each in gas.species
    ]
    return 12.0 * max(speeds), 12.0 * max(each.spin_rms for each in gas.species)


def n_moving(gas: CaseGas) -> int:
    """Number of disks that move at the start."""
    return sum(each.number for each in gas.species if each.speed_rms > 0.0)


def as_moving(gas: CaseGas, velocity: NDArray[np.float64], spin: NDArray[np.float64]) -> CaseGas:
    """The gas with its drift, and its species with their speeds relative to it and their spins.

    Velocities (n, 2) are relative to the flow; of ranks, each gives those of its slice. One disk alone is no gas
    that drifts, and in an open box, where nothing is estimated from speeds, they are those in the lab.
    """
    comm = current()
    ids = comm.slice_of(gas.n)
    drift, share = drift_of(gas, velocity)
    squares = np.column_stack((np.sum((velocity - drift) ** 2, axis=1), spin**2))
    moving, first = [], 0
    for each, own in zip(gas.species, gas.of_species(ids), strict=True):
        mean = comm.total(squares[first : first + len(own)]) / each.number
        first += len(own)
        moving.append(replace(each, speed_rms=float(np.sqrt(mean[0])), spin_rms=float(np.sqrt(mean[1]))))
    return replace(gas, species=tuple(moving), drift=drift, drift_share=share)


def drift_of(gas: CaseGas, velocity: NDArray[np.float64]) -> tuple[tuple[float, float], float]:
    """Mean velocity, weighted by mass, of velocities as in `as_moving`, and its part of their energy."""
    if gas.n == 1 or gas.box.is_open:
        return (0.0, 0.0), 0.0
    comm = current()
    mass = gas.rows(comm.slice_of(gas.n)).mass
    whole = float(comm.total(mass))
    drift = comm.total(mass[:, None] * velocity) / whole * gas.free
    energy = float(comm.total(mass * np.sum(velocity**2, axis=1)))
    share = whole * float(drift @ drift) / energy if energy > 0.0 else 0.0
    return (float(drift[0]), float(drift[1])), min(share, 1.0)


def tracked(gas: CaseGas, start: State) -> NDArray[np.int32]:
    """Disks that have histories, ascending; of ranks (`Communicator`), each gives the start of its slice.

    Raises InputError if no disk starts in the region of the histories.
    """
    comm, output, rng = current(), gas.case.output, seeds.stream(gas.case.run.seed, seeds.HISTORIES)
    own = output.tracked(gas.n, rng, start.position, comm.slice_of(gas.n).start)
    found = np.unique(np.concatenate(comm.allgather(own)))
    if output.tracks and not len(found):
        region = str(output.histories_region)
        raise InputError(str(Problem("output.histories_region", region, "no disk starts there")))
    return found


def strips(gas: CaseGas) -> int:
    """Number of strips of the box in which disks are placed at random, each by one rank; 0 of other starts."""
    start = gas.case.start
    if gas.start_region is None or not start.placed or start.positions != "random":
        return 0
    return placement.strips(FreeArea(gas.start_region, gas.walls), gas.n, float(gas.kinds.radius.max()))[1]


def is_made_in_slices(gas: CaseGas) -> bool:
    """True if ranks make the start in slices: drawn on a lattice or at random, or read from a file.

    Other starts need all disks at once, and are made by one process.
    """
    return gas.case.start.file is not None or gas.case.start.positions not in (GROWN, IMPACT_SCAN)


def is_read_in_slices(gas: CaseGas, ranks: int) -> bool:
    """True if each of so many ranks reads its rows of the file that gives the start."""
    start = gas.case.start
    return (start.file or start.trajectory) is not None and gas.is_distributed(ranks)


def verify_start(gas: CaseGas) -> None:
    """Make the start as a run does, if that takes about a second at most; InputError if it is impossible."""
    positions = gas.case.start.positions if gas.case.start.placed else ""
    if gas.n <= PLACED_BY_CHECK.get(positions, PLACED_BY_CHECK["random"]):
        tracked(gas, start(gas))
