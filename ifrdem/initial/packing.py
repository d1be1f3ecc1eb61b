"""Dense random packings: soft disks are cooled until they are as large as hard ones, and none overlaps any more.

Random sequential addition ends at packing fraction 0.55, where hard disks still have much room. To come close to
random packing (0.84), disks are first soft: two that overlap repel each other by the overlap, all with one
stiffness. At a temperature T they push into each other by some sqrt(T / stiffness), and so move like hard disks of a
smaller effective radius. Cooling lets this radius grow to the real one while the motion finds room, much as in the
growth of hard disks (Lubachevsky and Stillinger, doi:10.1007/BF01025983), but in steps that NumPy and SciPy do for all
disks at once. In the end the energy is minimised (FIRE: Bitzek et al., doi:10.1103/PhysRevLett.97.170201), with radii a
little larger than the given ones (MARGIN), until no two disks overlap, by a check without tolerance.

Without the motion (minimising the energy from random places alone) a bidisperse gas jams at 0.842 and takes ever more
steps near it: at 0.84, 20,000 steps left overlaps of 0.3 %. With it, a few dozen steps remain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.box import Box
from ..model.overlaps import checked_radii, close_pairs, refuse_no_free_area, refuse_wider_than_box
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall
from ..mpi import collective, current
from ..simulation.start.overlaps import check_no_overlap, close_ones, replace_rows
from ..tools import seeds
from ..tools.checked import Array, PositiveColumn, Seed, Vectors, validated

MARGIN = 1e-4
"""Part by which radii are made larger while overlaps are removed: what is left then is still a gap."""
SEPARATED = 1e-9
"""Largest overlap of disks whose positions were rounded."""

# In units of the mean diameter, the mass of a disk and the stiffness: a disk with six neighbours swings at 2.4.
STEP = 0.5
HOT, COLD = 2e-4, 1e-7
COOLING_STEPS = 1000
MIXING_STEPS = 400  # at low density: steps that decorrelate the disks
HELD = 0.3  # part of the steps before the temperature falls
FIRST_STEPS = 150  # of minimising, which is enough up to some 0.8
LAST_STEPS = 1500
SKIN = 0.5  # extra listing distance
PLATEAU = 200  # steps in which the overlaps must become less
JAMMED_BELOW = 0.98  # of their squares this part or less must be left
NEARLY = 1e-3  # mean overlap of jammed disks, as a part of contact, up to which another attempt may do

Progress = Callable[[float], None]


@validated
def grown_positions(
    box: Box,
    radius: PositiveColumn,
    *,
    seed: Seed,
    walls: Sequence[Wall] = (),
    progress: Progress = lambda _: None,
) -> Array:
    """Place disks at random as densely as random packing: to about 0.84 of the area, or a little less between walls.

    Bidisperse disks (as many of each, 1 to 1.4) reach 0.842 and a lognormal gas with a deviation of 30 % 0.84. Equal
    disks crystallise on the way, in grains that do not fit together: 0.86 was reached, above it only a lattice helps.
    InputError if they do not fit; the message says which packing fraction the same disks reached.

    Arguments and what is returned as for `initial.random_positions`; walls push disks away as other disks do, and
    `progress` is called with the fraction done, 0 to 1. The result is the same for the same seed on one machine. Pairs
    that almost touch are about as frequent as in a gas at equilibrium (by 20 % more or less up to 0.7); a few
    collisions per disk make it one.

    Examples
    --------
    >>> import ifrdem
    >>> radius = [0.5] * 100
    >>> box = ifrdem.Box.from_packing_fraction(radius, 0.7)
    >>> ifrdem.initial.grown_positions(box, radius, seed=1).shape
    (100, 2)
    """
    radii = checked_radii(radius)
    n = len(radii)
    if n == 0:
        return np.empty((0, 2))
    refuse_wider_than_box(box, radii)
    free_area = FreeArea(box, tuple(walls))
    refuse_no_free_area(free_area, radii)
    phi = free_area.packing_fraction(radii)
    if phi >= 1.0:
        region = "free area between walls" if free_area.all_walls else "box"
        raise InputError(f"packing fraction = {phi:.4f}: the disks cover more than the {region} has")
    soft = _SoftDisks(free_area, radii, _scattered(free_area, n, seeds.stream(seed, seeds.POSITIONS)))
    agitation = seeds.stream(seed, seeds.AGITATION)
    easy = soft.minimise(FIRST_STEPS)
    most = 3 + 20_000 // (n + 1000)  # few disks jam earlier or later by chance
    for attempt in range(most):
        # The number of attempts is unknown: each gets half of the rest of the bar.
        before, share = 1.0 - 0.5**attempt, 0.5 ** (attempt + 1)

        def report(part: float, before: float = before, share: float = share) -> None:
            progress(before + share * part)

        soft.cool(agitation, MIXING_STEPS if easy and attempt == 0 else COOLING_STEPS, report)
        done = soft.minimise(LAST_STEPS)
        if done or soft.mean_overlap() > NEARLY:
            break
    if not done:
        attained = _attained(soft, free_area, radii)
        raise InputError(
            f"packing fraction = {phi:.4f}: growth ended at {attained:.4f} with these disks; use fewer disks, "
            'a larger box or, for disks of about one size, positions = "hexagonal"'
        )
    progress(1.0)
    position = soft.wrapped()
    check_no_overlap(box, radii, position, tolerance=0.0)
    return position


@validated
@collective
def separate(
    box: Box, radius: PositiveColumn, position: Vectors, *, walls: Sequence[Wall] = (), time: float = 0.0,
) -> Array:  # fmt: skip
    """Positions [length], shape (n, 2), near the given ones, without overlaps of disks or with walls at a `time`.

    For positions that were rounded, as those of a trajectory in single precision: disks that touched overlap then. Only
    disks that overlap, and those near them, are moved. InputError if overlaps remain: names the worst of them. Of ranks
    of MPI (`Communicator`), each gives the disks of its slice, and the root moves those that almost touch.

    Examples
    --------
    >>> import ifrdem
    >>> box = ifrdem.Box((10.0, 10.0))
    >>> apart = ifrdem.initial.separate(box, [0.5, 0.5], [[4.0, 5.0], [4.99999, 5.0]])
    >>> bool(apart[1, 0] - apart[0, 0] >= 1.0)
    True
    """
    radii, centres = checked_radii(radius), np.asarray(position, dtype=np.float64)
    if len(centres) != len(radii):
        raise InputError(f"position has {len(centres)} disks, radius {len(radii)}: must be the same number")
    comm = current()
    n, largest = comm.number(len(radii))[1], comm.largest(float(radii.max(initial=0.0)))
    free_area = FreeArea(box, tuple(walls), time)
    free = free_area.gap(centres, radii)  # from walls
    near = close_ones(box, radii, centres, 0.0, free < 0.0)
    gap = 4.0 * comm.root_result(lambda: _largest_overlap(free_area, near)) + SEPARATED * largest
    while True:
        near = close_ones(box, radii, centres, gap, free < gap)
        ids, moved, longest = comm.root_result(lambda near=near: _separated(free_area, near))  # type: ignore[misc]
        if 2.0 * longest < gap or len(ids) == n or gap > largest:  # others cannot be met
            break
        gap *= 4.0
    comm.run_on_root(lambda: check_no_overlap(box, near[1], moved, tolerance=0.0, ids=ids))  # type: ignore[index]
    return replace_rows(centres, ids, moved)


Near = tuple[NDArray[np.int64], Array, Array] | None
"""Ids, radii and places of disks, on the first rank."""


def _largest_overlap(free_area: FreeArea, near: Near) -> float:
    """Largest overlap [length] of these disks."""
    assert near is not None
    _, radius, position = near
    centres = free_area.box.wrap(position)
    i, j = close_pairs(free_area.box, radius, centres).T
    apart = np.linalg.norm(free_area.box.minimum_image(centres[j] - centres[i]), axis=-1)
    overlaps = np.concatenate((radius[i] + radius[j] - apart, -free_area.gap(position, radius)))
    return float(np.max(overlaps, initial=0.0))


def _separated(free_area: FreeArea, near: Near) -> tuple[NDArray[np.int64], Array, float]:
    """Ids of these disks, places at which they do not overlap, and the longest way [length]."""
    assert near is not None
    ids, radius, position = near
    if not len(ids):
        return ids, position, 0.0
    soft = _SoftDisks(free_area, radius, position, margin=SEPARATED)
    soft.minimise(LAST_STEPS)
    found = soft.wrapped()
    return ids, found, float(np.abs(free_area.box.minimum_image(found - position)).max()) * math.sqrt(2.0)


def _scattered(free_area: FreeArea, n: int, random: np.random.Generator) -> Array:
    """Random points in the free area, shape (n, 2)."""
    position = random.random((n, 2)) * free_area.box.lengths
    low, high = free_area.bounds()
    while len(wrong := np.flatnonzero(free_area.gap(position, np.zeros(n)) < 0.0)):
        position[wrong] = low + random.random((len(wrong), 2)) * (high - low)
    return position


class _SoftDisks:
    """Disks that repel each other, and are repelled by walls, by their overlap, in units of their mean diameter.

    Disks are numbered along the rows of a grid meanwhile, so that neighbours lie close in memory.
    """

    def __init__(self, free_area: FreeArea, radius: Array, position: Array, margin: float = MARGIN) -> None:
        self.unit = 2.0 * float(radius.mean())
        box, self.walls, self.time = free_area.box, free_area.all_walls, free_area.time
        self.box = Box((box.lengths[0] / self.unit, box.lengths[1] / self.unit), box.periodic)
        self.margin = margin
        scaled = self.box.wrap(position / self.unit)
        row = np.floor(scaled / 2.0)
        self.order = np.lexsort((scaled[:, 0], row[:, 1]))
        self.x = scaled[self.order]
        self.true_radius = radius[self.order] / self.unit
        self.radius = self.true_radius * (1.0 + margin)
        # Around a large disk stand many others that push: with more mass it swings no faster than the rest.
        self.per_mass = np.minimum(1.0, 1.0 / (2.0 * self.true_radius) ** 2)[:, None]
        self._list()

    def wrapped(self) -> Array:
        """The positions in the order and unit of the caller."""
        position = np.empty_like(self.x)
        position[self.order] = self.box.wrap(self.x) * self.unit
        lengths = np.array(self.box.lengths) * self.unit
        return np.where((position >= lengths) & self.box.periodic, 0.0, position)

    def _list(self) -> None:
        """List the pairs that can touch before some disk has moved half of SKIN, as the differences that they are.

        Row p of `difference` holds -1 at the first disk of pair p and +1 at the second; positions are not wrapped
        meanwhile, so that a pair's periodic image stays what it is.
        """
        from scipy.sparse import csr_matrix

        self.x = self.box.wrap(self.x)
        pairs = close_pairs(self.box, self.radius, self.x, SKIN)
        raw = self.x[pairs[:, 1]] - self.x[pairs[:, 0]]
        nearest = self.box.minimum_image(raw)
        contact = self.radius[pairs[:, 0]] + self.radius[pairs[:, 1]]
        near = _squared(nearest) < (contact + SKIN) ** 2
        pairs, self.contact = pairs[near], contact[near]
        self.at_contact = np.concatenate((self.contact, np.tile(self.radius, len(self.walls))))
        self.image = (nearest - raw)[near]
        count = len(pairs)
        rows = (np.tile([-1.0, 1.0], count), pairs.ravel(), np.arange(0, 2 * count + 1, 2))
        self.difference = csr_matrix(rows, shape=(count, len(self.x)))
        self.to_disks = self.difference.T.tocsr()
        self.listed_at = self.x.copy()

    def force(self) -> tuple[Array, Array]:
        """Forces on the disks, shape (n, 2), and overlaps, 0 where none, in the order of `at_contact`.

        These are of the listed pairs first, and then of all disks with each wall.
        """
        moved = self.x - self.listed_at
        if _squared(moved).max() > (0.5 * SKIN) ** 2:
            self._list()
        apart = self.difference @ self.x + self.image
        distance = np.sqrt(_squared(apart))
        overlap = np.maximum(self.contact - distance, 0.0)
        # Two disks at one and the same place push nowhere; others will part them.
        push = apart * (overlap / np.maximum(distance, 1e-300))[:, None]
        force = self.to_disks @ push
        if not self.walls:
            return force, overlap
        overlaps = [overlap]
        position = self.box.wrap(self.x) * self.unit
        for wall in self.walls:
            away, distance = wall.normal(position, self.time)
            overlaps.append(np.maximum(self.radius - distance / self.unit, 0.0))
            force += away * overlaps[-1][:, None]
        return force, np.concatenate(overlaps)

    def worst(self, overlap: Array) -> float:
        """The largest overlap as a part of the contact distance."""
        return float(np.max(overlap / self.at_contact, initial=0.0))

    def mean_overlap(self) -> float:
        """The mean overlap of those that overlap, as a part of the contact distance."""
        _, overlap = self.force()
        touching = overlap > 0.0
        return float(np.mean(overlap[touching] / self.at_contact[touching])) if touching.any() else 0.0

    def minimise(self, most: int) -> bool:
        """Move the disks downhill (FIRE) until none overlaps with its true radius; False if they jam before."""
        enough = 0.999 * self.margin / (1.0 + self.margin)
        velocity = np.zeros_like(self.x)
        step, mixing, downhill = 0.3, 0.1, 0
        plateau = math.inf
        for done in range(most):
            force, overlap = self.force()
            if self.worst(overlap) < enough:
                return True
            if done % PLATEAU == 0:
                energy = float(np.sum(overlap * overlap))
                if energy > JAMMED_BELOW * plateau:
                    return False
                plateau = energy
            if _product(force, velocity) > 0.0:
                downhill += 1
                if downhill > 5:
                    step, mixing = min(1.1 * step, 0.6), 0.99 * mixing
            else:
                velocity[:] = 0.0
                step, mixing, downhill = max(0.5 * step, 0.02), 0.1, 0
            velocity += step * self.per_mass * force
            along = math.sqrt(_product(velocity, velocity) / max(_product(force, force), 1e-300))
            velocity = (1.0 - mixing) * velocity + mixing * along * force
            self.x = self.x + step * velocity
        return False

    def cool(self, random: np.random.Generator, steps: int, progress: Progress) -> None:
        """Move the disks (velocity Verlet) at temperature HOT, then while it falls to COLD, by scaling velocities."""
        velocity = random.standard_normal(self.x.shape) * np.sqrt(HOT * self.per_mass)
        force, _ = self.force()
        for done in range(steps):
            velocity += 0.5 * STEP * self.per_mass * force
            self.x = self.x + STEP * velocity
            force, _ = self.force()
            velocity += 0.5 * STEP * self.per_mass * force
            if done % 10 == 0:
                temperature = HOT * (COLD / HOT) ** max(0.0, (done / steps - HELD) / (1.0 - HELD))
                present = 0.5 * float(np.mean(np.sum(velocity**2 / self.per_mass, axis=1)))
                velocity *= math.sqrt(temperature / present)
                progress(done / steps)


def _product(a: Array, b: Array) -> float:
    """Sum of a_ik b_ik, in one order whatever number of threads a library for linear algebra has."""
    return float(np.sum(a * b))


def _squared(vectors: Array) -> Array:
    return vectors[:, 0] * vectors[:, 0] + vectors[:, 1] * vectors[:, 1]


def _attained(soft: _SoftDisks, free_area: FreeArea, radius: Array) -> float:
    """The packing fraction that jammed disks reach: that of smaller radii at which they do not overlap any more."""
    shrunk = 1.0
    while True:
        # As much as makes the mean overlap vanish, and something on top, or it would never end.
        shrunk *= 1.0 - soft.mean_overlap() - 5e-4
        smaller = _SoftDisks(free_area, radius * shrunk, soft.wrapped())
        if smaller.minimise(LAST_STEPS):
            return shrunk**2 * free_area.packing_fraction(radius)
        soft = smaller
