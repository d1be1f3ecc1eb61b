"""Starts of a gas: positions without overlap, and velocities at a temperature.

Each function takes a seed and draws from a random stream of its own, so that the same seed for positions and
velocities does not tie the two together.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, shortened
from ..model.box import Box
from ..model.density import disk_area, packing_fraction
from ..model.device import Device
from ..model.overlaps import (
    TOLERANCE,
    checked_radii,
    refuse_no_free_area,
    refuse_wider_than_box,
    size_classes,
)
from ..model.state import NumberOfDisks
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall
from ..mpi import collective, current, distribution
from ..simulation import backend
from ..simulation.start import cells
from ..simulation.start.overlaps import check_no_overlap
from ..tools import progress, seeds
from ..tools.checked import (
    Array,
    NonNegative,
    NonNegativePerDisk,
    PositiveColumn,
    Seed,
    column,
    validated,
)
from .additions import Attempts, Strip, add_by_kernels, add_by_numpy

# Of the diameter among sites, of the radius at walls: room for rounding.
CLOSER, CLEAR = 1.0 - 1e-9, 1.0 + 1e-9
HALVINGS = 40
AT_ONCE = 1 << 18  # sites that are checked together


def check_sites(free_area: FreeArea, n: int, radius: float) -> bool:
    """Return whether rows of sites run along y, for n sites at contact that fit between the walls.

    InputError if fewer do; the message says how many. Sites are counted block by block, by each rank some of them.
    """
    most = {
        upright: _free(free_area, radius, 2.0 * radius * CLOSER, upright).count() for upright in (False, True)
    }
    upright = most[True] > most[False]
    if most[upright] < n:
        covered = free_area.packing_fraction(np.full(most[upright], radius))
        raise InputError(
            f"{n} disks of diameter {2.0 * radius:.6g} do not fit on a hexagonal lattice between the walls: "
            f"at most {most[upright]} do, which is packing fraction {covered:.4f}"
        )
    return upright


def sites(free_area: FreeArea, n: int, radius: float, numbers: NDArray[np.int64] | None = None) -> Array:
    """Sites [length], shape (n, 2), for disks of this radius [length] that overlap neither each other nor a wall.

    Rows along x or along y, which continue across periodic sides. What sites are left over are spread evenly.
    InputError if fewer sites than n find room; the message says how many do. Only those of some `numbers`, 0 to n - 1,
    are returned; each of several ranks requests its part, and tests some of all sites.
    """
    low, high = 2.0 * radius * CLOSER, max(free_area.box.lengths)
    best = _free(free_area, radius, low, check_sites(free_area, n, radius))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        wider = [_free(free_area, radius, middle, upright) for upright in (False, True)]
        counts = [each.count() for each in wider]
        if max(counts) >= n:
            low, best = middle, wider[counts[1] > counts[0]]
        else:
            high = middle
    comm = current()
    here = best.off_walls(comm.slice_of(best.points))
    own, found = comm.number(len(here))
    wanted = _site_numbers(np.arange(n) if numbers is None else numbers, found, n)
    return here[wanted] if comm.size == 1 else _rows_by_number(own.start, here, wanted)


def _rows_by_number(first: int, rows: Array, wanted: NDArray[np.int64]) -> Array:
    """Rows of some numbers that are anywhere; those here are numbered from `first` on, rank by rank."""
    comm = current()
    firsts = np.array(comm.allgather(first if len(rows) else -1))
    firsts[firsts < 0] = np.iinfo(np.int64).max  # ranks without rows own none
    order = np.argsort(firsts, kind="stable")
    owner = order[np.searchsorted(firsts[order], wanted, side="right") - 1]
    (found,) = comm.rows_of_owners(owner, wanted, first, [rows])
    return found


@dataclass(frozen=True)
class _Sites:
    """Sites row by row, numbered from 0 to `points` - 1, walls or not."""

    free_area: FreeArea
    radius: float
    upright: bool
    columns: int
    rows: int
    origin: tuple[float, float]  # along the rows and across
    step: float  # along
    rise: float  # across

    @property
    def points(self) -> int:
        """Number of all sites."""
        return self.columns * self.rows

    def off_walls(self, numbers: range) -> Array:
        """Sites with some numbers at which a disk overlaps no wall; shape (sites, 2)."""
        return np.concatenate([np.empty((0, 2)), *self._blocks_off_walls(numbers)])

    def _blocks_off_walls(self, numbers: range) -> Iterator[Array]:
        along, across = (1, 0) if self.upright else (0, 1)
        for first in range(numbers.start, numbers.stop, AT_ONCE):
            row, column = np.divmod(np.arange(first, min(first + AT_ONCE, numbers.stop)), self.columns)
            position = np.empty((len(row), 2))
            position[:, along] = self.origin[0] + (column + 0.5 * (row % 2)) * self.step
            position[:, across] = self.origin[1] + row * self.rise
            yield position[self.free_area.gap(position, np.full(len(position), self.radius)) >= 0.0]

    def count(self) -> int:
        """Number of sites at which a disk overlaps no wall."""
        comm = current()
        return comm.allreduce(sum(map(len, self._blocks_off_walls(comm.slice_of(self.points)))))


def _free(free_area: FreeArea, radius: float, distance: float, upright: bool) -> _Sites:
    """Sites at this distance from their nearest neighbours, or a little more.

    They keep half of the distance from straight walls along the axes, as if there were sites beyond them, too.
    """
    margin = max(radius * CLEAR, 0.5 * distance)
    low, high = (corner[0] for corner in free_area.spans(np.array([margin])))
    periodic = np.array(free_area.box.periodic) & (low == 0.0) & (high == free_area.box.lengths)
    along, across = (1, 0) if upright else (0, 1)
    side, height = high[along] - low[along], high[across] - low[across]
    columns = int(side / distance) + (0 if periodic[along] else 1)
    step = side / columns if periodic[along] and columns > 0 else distance
    # Neighbours in the next row are half a step away along it; those in the second next are straight across.
    rise = max(0.5 * distance, math.sqrt(max(0.0, distance**2 - 0.25 * step**2)))
    if periodic[across]:
        rows = int(height / rise) // 2 * 2  # every second row is shifted, so their number is even
        rise = height / rows if rows >= 2 else rise
    else:
        rows = int(height / rise) + 1
    origin = (float(low[along]), float(low[across]))
    return _Sites(free_area, radius, upright, max(columns, 0), max(rows, 0), origin, float(step), float(rise))


SATURATION = 0.547
"""Packing fraction where random sequential addition of equal disks ends (doi:10.1103/PhysRevE.74.061308)."""

ATTEMPTS_PER_DISK = 400
"""Attempts of random sequential addition for each disk on average before it gives up."""


WIDTH = 8.0
"""Width of a strip of the box, at the least, in diameters of the largest disk."""


def strips(free_area: FreeArea, n: int, radius: float) -> tuple[int, int]:
    """Axis across which the strips are in which n disks are placed at random, and their number: even, or 1.

    `radius` is the largest one [length].
    """
    low, high = free_area.bounds()
    axis = int(np.argmax(high - low))
    area = free_area.area() if free_area.all_walls else free_area.box.area
    narrowest = area / (high - low)[1 - axis]
    return axis, max(min(n // distribution.BLOCK, int(narrowest / (WIDTH * 2.0 * radius))) // 2 * 2, 1)


@validated
@collective
def random_positions(box: Box, radius: PositiveColumn, *, seed: Seed, walls: Sequence[Wall] = ()) -> Array:
    """Place disks by random sequential addition: uniformly at random, each where it overlaps nothing before it.

    Attempts are drawn and tested in bulk, with the outcome of making them one by one. Large disks go first (in size
    classes of 25 %), which lets mixtures become denser than the equal-disk limit. InputError if the disks do not
    fit: equal disks above packing fraction 0.547 of the free area (`free_area.py`), or any disks when the attempts
    are used up (400 per disk; equal disks reach about 0.53). The message gives the packing fraction reached.

    Of 524,288 disks and more (two blocks, `BLOCK`) each 262,144 to 524,288 are placed in a strip of the box of their
    own, drawn from all at random, whose free area goes as the area that they cover; each strip has random numbers of
    its own. The first, third, ... strips are filled, then those between, which avoid the disks of their neighbours. It
    is not the same as one addition of all: numbers of disks do not fluctuate from strip to strip; and centres of disks
    in strips that are filled first stand within one diameter of their edges a little denser, those in the others
    thinner, the more the nearer to the limit. A few collisions per disk forget the latter.

    More than 100,000 disks are added by kernels, to the same places; the runtime is started unless it runs.

    Of ranks of MPI (`Communicator`), each gives the radii of its slice, and gets its places. Each fills some strips, to
    the bit as one process does. `Simulation` looks for overlaps.

    Parameters
    ----------
    radius : array_like (n,)
        Radii [length].
    seed : int
        Seed of the random positions.
    walls : sequence of Wall
        Further walls that they must not overlap, at t = 0, in addition to the sides of the box that are not periodic.

    Returns
    -------
    array (n, 2)
        Centres [length], inside the box.

    Examples
    --------
    >>> import ifrdem
    >>> radius = [0.5] * 100
    >>> box = ifrdem.Box.from_packing_fraction(radius, 0.3)
    >>> ifrdem.initial.random_positions(box, radius, seed=1).shape
    (100, 2)
    """

    comm = current()
    radii, ids, n = _radii_of_rank(box, radius)
    if n == 0:
        return np.empty((0, 2))
    seeds.stream(seed, seeds.POSITIONS)  # refuses what is no seed
    smallest = -comm.largest(-float(radii.min(initial=np.inf)))
    largest = comm.largest(float(radii.max(initial=0.0)))
    free_area = FreeArea(box, tuple(walls))
    comm.run_on_all(lambda: refuse_no_free_area(free_area, radii, ids.start))
    wanted = free_area.covered_part(math.pi * float(comm.total(np.square(radii))))
    # Few disks have no sharp limit: 4 of them in a box that just holds a square of them reach 0.785.
    if wanted > SATURATION + 0.5 / math.sqrt(n) and smallest == largest:
        limit = f"random positions of equal disks end at {SATURATION}"
        raise InputError(f"packing fraction = {wanted:.4f}: {limit}; {_INSTEAD}")
    axis, count = strips(free_area, n, largest)
    number = np.arange(ids.start, ids.stop)
    if count > 1:
        number = seeds.permuted(seed, seeds.SITES, n, ids)
    firsts = distribution.bounds(n, count)
    owner = np.arange(count) * comm.size // count
    own = [int(each) for each in np.flatnonzero(owner == comm.rank)]
    there: list[NDArray[Any]] = [number, np.arange(ids.start, ids.stop), radii]
    if comm.size > 1:
        there = comm.exchange(owner[np.searchsorted(firsts, number, side="right") - 1], there)
    place = there[0] - (firsts[own[0]] if own else 0)
    ids_there = np.empty(len(place), dtype=np.int64)
    ids_there[place] = there[1]
    # Equal ones are in any order.
    radii_there = there[2] if smallest == largest else there[2][np.argsort(place)]
    del number, there, place
    # Of the disks here, those of each strip.
    rows = {each: slice(firsts[each] - firsts[own[0]], firsts[each + 1] - firsts[own[0]]) for each in own}
    covered = {each: float(np.sum(np.square(radii_there[rows[each]]))) for each in own}
    areas = np.array(
        [each for some in comm.allgather(covered) for each in some.values()]
    )  # ranks own strips in order
    shares = areas / areas.sum()
    edges = _edges(free_area, axis, shares, float(comm.total(radii)) / n)

    position, device = np.empty((len(ids_there), 2)), backend.of_rank(Device())
    nearby: dict[int, tuple[Array, Array]] = {}

    done, filled = progress.stage("placing disks"), 0

    def fill(parity: int) -> None:
        nonlocal filled
        to_fill = [each for each in own if each % 2 == parity]
        with cells.kernels_for(n, device) as by_kernels:
            at_once = backend.lanes() if by_kernels else 1
            for first in range(0, len(to_fill), at_once):
                some = to_fill[first : first + at_once]
                strips = [
                    Strip(
                        radii_there[rows[each]],
                        *nearby.get(each, (np.empty((0, 2)), np.empty(0))),
                        *(edges[each : each + 2]),
                    )
                    for each in some
                ]
                attempts = [
                    _attempts(
                        free_area, strip.radii, seeds.stream(seed, seeds.POSITIONS, each), wanted,
                        (axis, strip.begin, strip.end), float(shares[each]),
                    )
                    for each, strip in zip(some, strips, strict=True)
                ]  # fmt: skip
                add = add_by_kernels if by_kernels else add_by_numpy
                for each, places in zip(some, add(box, axis, strips, attempts), strict=True):
                    position[rows[each]] = places
                    filled += 1
                done(filled / len(own))

    comm.run_on_all(lambda: fill(0))
    if count > 1:
        nearby = _neighbors_of_strips(axis, edges, owner, rows, position, radii_there)
        comm.run_on_all(lambda: fill(1))
    (found,) = comm.by_id(n, ids_there, [position])
    return found


_INSTEAD = (
    'use fewer disks, a larger box, positions = "grown" or, for disks of about the same size, "hexagonal"'
)
_SCANNED = 128  # strips at least in which the area is known along the box, and even in between


def _edges(free_area: FreeArea, axis: int, shares: Array, inset: float) -> Array:
    """Places [length] across `axis` between which the room for centres has these shares, shape (shares + 1,)."""
    if len(shares) == 1:
        return np.array([-np.inf, np.inf])
    low, high = (corner[axis] for corner in free_area.bounds())
    parts = np.cumsum(shares)[:-1]
    if not free_area.all_walls:
        return np.concatenate([[low], low + parts * (high - low), [high]])
    scanned = np.linspace(low, high, max(_SCANNED, 2 * len(shares)) + 1)
    below = np.concatenate([[0.0], np.cumsum(free_area.strips(axis, scanned, inset))])
    return np.concatenate([[low], np.interp(parts * below[-1], below, scanned), [high]])


def _neighbors_of_strips(
    axis: int, edges: Array, owner: NDArray[np.intp], rows: dict[int, slice], position: Array,
    radius: Array,
) -> dict[int, tuple[Array, Array]]:  # fmt: skip
    """Positions and radii of disks of strips 0, 2, ... near each neighbouring strip, on its owner."""
    count, reach = len(edges) - 1, 2.0 * float(radius.max(initial=0.0)) * (1.0 + 2.0 * TOLERANCE)
    comm = current()
    reach = comm.largest(reach)
    strips, positions, radii = [np.empty(0, np.int64)], [np.empty((0, 2))], [np.empty(0)]
    for each, own in rows.items():
        if each % 2:
            continue
        x = position[own][:, axis]
        # Where the box ends, the strips at its ends are no neighbours, but disks there are in no other strip's way.
        for near, other in ((x < edges[each] + reach, each - 1), (x > edges[each + 1] - reach, each + 1)):
            strips.append(np.full(int(near.sum()), other % count))
            positions.append(position[own][near])
            radii.append(radius[own][near])
    found = [np.concatenate(each) for each in (strips, positions, radii)]
    found = comm.exchange(owner[found[0]], found)
    return {
        int(each): (found[1][found[0] == each], found[2][found[0] == each]) for each in np.unique(found[0])
    }


def _attempts(
    free_area: FreeArea, radii: Array, rng: np.random.Generator, wanted: float, strip: tuple[int, float, float],
    share: float,
) -> Generator[Attempts, NDArray[np.intp], None]:  # fmt: skip
    """Yield attempts to add disks to a strip (axis, from, to), with this share of the free area; and get those that
    succeed, until all are placed.

    InputError if they do not fit; the message gives `wanted`, the packing fraction of all disks.
    """
    box, n = free_area.box, len(radii)
    axis, begin, end = strip
    # One row for all, where they are equal.
    lowest, highest = free_area.spans(radii[:1] if n and radii.min() == radii.max() else radii)
    lowest[:, axis], highest[:, axis] = np.maximum(lowest[:, axis], begin), np.minimum(highest[:, axis], end)
    is_placed = np.zeros(n, dtype=bool)
    attempts_left = ATTEMPTS_PER_DISK * n + 100_000  # the second term matters for few disks
    if free_area.walls:  # some attempts fall beyond a wall
        corners = np.array(free_area.bounds())
        corners[:, axis] = np.clip(corners[:, axis], begin, end)
        attempts_left = int(attempts_left * np.prod(corners[1] - corners[0]) / (free_area.area() * share))
    for members in size_classes(radii, 1.25):
        todo = members
        while len(todo):
            if attempts_left <= 0:
                placed = np.flatnonzero(is_placed)
                covered = free_area.packing_fraction(radii[placed]) / share
                reached = f"random positions ended at {covered:.4f}, with {len(placed)} of {n} disks placed"
                reached += "" if share == 1.0 else " in one of the strips in which so many disks are placed"
                raise InputError(f"packing fraction = {wanted:.4f}: {reached}; {_INSTEAD}")
            # When few disks are left space is scarce: try each of them many times in one go.
            owner = np.resize(todo, max(len(todo), min(n, 50_000), 200))
            attempts_left -= len(owner)
            low, high = (each[owner] if len(each) == n else each for each in (lowest, highest))
            candidate = box.wrap(low + rng.random((len(owner), 2)) * (high - low))
            if free_area.all_walls:
                clear = free_area.gap(candidate, radii[owner]) > TOLERANCE * radii[owner]
                owner, candidate = owner[clear], candidate[clear]
            success = yield owner, candidate
            is_placed[owner[success]] = True
            todo = todo[~is_placed[todo]]


def _hexagonal_fit(
    lengths: tuple[float, float], sites: NDArray[np.int64] | int, columns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Array]:
    """Rows that hold at least `sites` sites in each number of columns, and the distance of nearest sites.

    Every second row is shifted by half a column, so the number of rows is even, or 1.
    """
    rows = -(-np.asarray(sites) // columns)
    rows = np.where(rows > 1, rows + rows % 2, 1)
    along, across = lengths[0] / columns, lengths[1] / rows
    next_row = np.where(rows > 1, np.hypot(along / 2.0, across), across)
    # Straight across, every second row; with two rows that is the box's height.
    return rows, np.minimum.reduce([along, next_row, np.where(rows > 1, 2.0 * across, across)])


def _most_sites(lengths: tuple[float, float], diameter: float) -> int:
    """Sites of the densest hexagonal lattice, rows along x, that the box can hold without overlap."""
    reach = diameter * (1.0 - TOLERANCE)
    columns = np.arange(1, max(1, int(lengths[0] / reach)) + 1)
    along = lengths[0] / columns
    across = np.maximum(reach / 2.0, np.sqrt(np.maximum(0.0, reach**2 - along**2 / 4.0)))
    rows = (lengths[1] / across).astype(np.int64)
    rows = np.where(rows >= 2, rows - rows % 2, 1)
    return int(np.max(columns * rows))


def lattice(box: Box, n: int, diameter: float) -> tuple[int, int, bool]:
    """Columns and rows of the lattice of `hexagonal_positions` for n disks, and if rows are along y.

    InputError if disks of this diameter [length] do not fit.
    """
    best = (0.0, 1, 1, False)  # distance of nearest sites, columns, rows, rows along y?
    for upright in (False, True):
        lengths = box.lengths[::-1] if upright else box.lengths
        # More columns than disks, or columns closer than disks may be, never help.
        columns = np.arange(1, max(1, min(n, int(lengths[0] / (diameter * (1.0 - TOLERANCE))))) + 1)
        rows, nearest = _hexagonal_fit(lengths, n, columns)
        i = int(np.argmax(nearest))
        if nearest[i] > best[0]:
            best = (float(nearest[i]), int(columns[i]), int(rows[i]), upright)
    if best[0] < diameter * (1.0 - TOLERANCE):
        most = max(_most_sites(box.lengths, diameter), _most_sites(box.lengths[::-1], diameter))
        covered = packing_fraction(most * disk_area(np.array([0.5 * diameter])), box.area)
        raise InputError(
            f"{n} disks of diameter {diameter:.6g} do not fit on a hexagonal lattice in a box of "
            f"{box.lengths[0]:.6g} x {box.lengths[1]:.6g}: at most {most} do, which is packing fraction {covered:.4f}. "
            "Sides that are whole numbers of diameters and of pairs of rows (sqrt(3) diameters) hold more"
        )
    return best[1:]


def _radii_of_rank(box: Box, radius: ArrayLike) -> tuple[Array, range, int]:
    """Radii of this rank's slice, which fit into the box, its ids, and the number of all disks."""

    comm = current()
    radii = comm.run_on_all(lambda: checked_radii(radius))
    ids, n = comm.number(len(radii))
    comm.run_on_all(lambda: refuse_wider_than_box(box, radii, ids.start))
    return radii, ids, n


def _site_numbers(number: NDArray[np.int64], sites: int, n: int) -> NDArray[np.int64]:
    """Sites of the disks with these numbers, of n that leave some free: number sites // n, in 64 bits for 2^32 too."""
    found: NDArray[np.int64] = number + number * (sites - n) // n
    return found


@validated
@collective
def hexagonal_positions(
    box: Box,
    radius: PositiveColumn,
    *,
    seed: Seed | None = None,
    walls: Sequence[Wall] = (),
) -> Array:
    """Place disks on a hexagonal lattice, stretched so that it continues across the periodic sides.

    Of all such lattices, with rows along x or along y, it takes the one whose nearest sites are farthest apart. Sites
    that are left over are spread evenly. Disks of different radii need the room of the largest. Between walls it
    takes those sites where a disk overlaps none. InputError if the lattice does not fit; the message says how
    many disks of that size would.

    Arguments and what is returned as for `random_positions`; a `seed` deals the disks to the sites in a random order
    (for mixtures), without it disk by disk, row by row. Of ranks of MPI (`Communicator`), each gives the radii of its
    slice and gets its places; `Simulation` looks for overlaps then.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.initial.hexagonal_positions(ifrdem.Box((4.0, 4.0)), [0.5] * 12).shape
    (12, 2)
    """

    comm = current()
    radii, ids, n = _radii_of_rank(box, radius)
    if n == 0:
        return np.empty((0, 2))
    largest = comm.largest(float(radii.max(initial=0.0)))
    free_area = FreeArea(box, tuple(walls))
    number = np.arange(ids.start, ids.stop) if seed is None else seeds.permuted(seed, seeds.SITES, n, ids)
    if free_area.all_walls:
        comm.run_on_all(lambda: refuse_no_free_area(free_area, radii, ids.start))
        found = sites(free_area, n, largest, number)
    else:
        columns, rows, upright = lattice(box, n, 2.0 * largest)
        lengths = box.lengths[::-1] if upright else box.lengths
        row, column = np.divmod(_site_numbers(number, columns * rows, n), columns)
        # A quarter column from the side: both kinds of row then have the same margin.
        x = (column + 0.25 + 0.5 * (row % 2)) * (lengths[0] / columns)
        y = (row + 0.5) * (lengths[1] / rows)
        found = np.column_stack((y, x) if upright else (x, y))
    if comm.size == 1:  # on several ranks, `Simulation` looks for overlaps
        check_no_overlap(box, radii, found)
    return found


@validated
@collective
def maxwellian(
    mass: PositiveColumn, *, speed_rms: NonNegative | None = None,
    temperature: NonNegativePerDisk | None = None, seed: Seed,
) -> Array:  # fmt: skip
    """Draw velocities from a Maxwell distribution, with no total momentum and exactly the given energy.

    Disks of different masses get the same mean energy: each component has variance T / m. The total momentum of the
    sample is then removed, and the rest scaled, so that a disk of mass m among others of total mass M has the mean
    energy T (1 - m / M) N / (N - 1). Of ranks of MPI (`Communicator`), each gives the masses of its slice, and gets its
    velocities. InputError if not exactly one of `speed_rms` and `temperature` is given, or a value is negative or not
    finite.

    Parameters
    ----------
    mass : array_like (n,)
        Masses m [mass].
    speed_rms, temperature : float
        One of them: sqrt(<v^2>) over all disks [length/time], or T = <m v^2> / 2 [energy]; of temperatures of the
        disks, shape (n,), their mean is the exact one. Disks of temperature 0 stay at rest.

    Returns
    -------
    array (n, 2)
        Velocities [length/time]. If one disk alone moves it keeps its speed: it cannot have both energy and no
        momentum.

    Examples
    --------
    >>> import ifrdem
    >>> velocity = ifrdem.initial.maxwellian([1.0] * 1000, temperature=2.0, seed=1)
    >>> round(float((velocity**2).sum(axis=1).mean() / 2), 12)
    2.0
    """
    masses = np.asarray(mass, dtype=np.float64)
    if speed_rms is not None and temperature is None:
        sizes, weight = np.full_like(masses, speed_rms**2), np.ones_like(masses)
    elif temperature is not None and speed_rms is None:
        sizes, weight = column("temperature", temperature, len(masses)), masses / 2.0
    else:
        raise InputError(
            f"speed_rms = {speed_rms}, temperature = {shortened(temperature)}: exactly one of them must be given"
        )
    return _drawn_velocities(masses, sizes, weight, seed)


def thermal(masses: Array, energies: Array, seed: int) -> Array:
    """As `maxwellian`, of a temperature of each disk, unchecked: squares of speeds have a wider range than numbers."""
    return _drawn_velocities(masses, energies, masses / 2.0, seed)


def _drawn_velocities(masses: Array, sizes: Array, weight: Array, seed: int) -> Array:
    """Maxwellian velocities of which the mean of `weight` times the square is that of `sizes`, all (n,)."""
    comm = current()
    ids, n = comm.number(len(masses))
    velocity = seeds.drawn(
        seed, seeds.VELOCITIES, ids, lambda random, count: random.standard_normal((count, 2))
    )
    velocity /= np.sqrt(masses)[:, None]
    largest = comm.largest(float(sizes.max(initial=0.0)))
    shares = (
        sizes / largest if largest > 0.0 else np.ones_like(sizes)
    )  # all 1 where disks have one temperature
    velocity *= np.sqrt(shares)[:, None]
    moving = shares > 0.0
    if comm.total(moving.astype(np.int64)) > 1:
        moved = np.where(moving, masses, 0.0)
        mean = comm.total(moved[:, None] * velocity) / comm.total(moved)
        velocity -= np.where(moving[:, None], mean, 0.0)
    if n > 0:
        wanted = largest * (comm.total(shares) / n)
        velocity *= math.sqrt(wanted / (comm.total(weight * np.sum(velocity**2, axis=1)) / n))
    return velocity


@validated
@collective
def gaussian_spins(n: NumberOfDisks, *, spin_rms: NonNegativePerDisk, seed: Seed) -> Array:
    """Draw spins [rad/time], shape (n,), from a normal distribution with mean 0 and exactly this rms value.

    Of rms values of the disks, shape (n,), the mean of (spin / rms)^2 over those that are not 0 is exactly 1. Of ranks
    of MPI (`Communicator`), each gives the number of disks in its slice, and gets their spins. InputError if `spin_rms`
    is negative or not finite.

    Examples
    --------
    >>> import ifrdem
    >>> spin = ifrdem.initial.gaussian_spins(1000, spin_rms=3.0, seed=1)
    >>> round(float((spin**2).mean()), 12)
    9.0
    """
    comm = current()
    ids, _ = comm.number(n)
    sizes = column("spin_rms", spin_rms, n)
    spin = seeds.drawn(seed, seeds.SPINS, ids, lambda random, count: random.standard_normal(count))
    turning = sizes > 0.0
    number = comm.total(turning.astype(np.int64))
    if number:
        sizes = sizes / math.sqrt(comm.total(np.where(turning, spin, 0.0) ** 2) / number)
    return spin * sizes
