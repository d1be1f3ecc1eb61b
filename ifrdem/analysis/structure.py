"""Structure of frames: pair correlation g(r), structure factor S(k), clusters, and hexatic order psi_6."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import (
    Array,
    Integer,
    NonNegative,
    Positive,
    PositivePerDisk,
    Real,
    Vectors,
    must_be,
    rows,
    validated,
)
from ..tools.intervals import of_count, of_intensity, student_t
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from . import common
from .common import BoxLike, Positions, Times, cells_of, freud_frame, load, neighbours, share_in_cell
from .cooling import CHANCE

CONTACT_RANGE = 0.25  # of the diameter, in which the contact value is fitted
CONTACT_BINS = 25
MOST_MODES = 1024
"""Modes along an axis that one transform computes; beyond, only every p-th k that the box allows is taken."""
ONE_THREAD = 100_000
"""Disks up to which a transform takes one thread: more of them wait for each other for longer than they compute."""
LEAST_MODES = 32
"""Modes by whose scatter the error of S(k) is found: rings that hold fewer take those of the next rings too."""
CELLS, DISKS_OF_CELL = (5, 10), 40
"""Cells along a side of the box by whose scatter the error of g(r) is found, and disks in each between."""
SPACINGS = 5.0
"""Distance to a strip, in mean distances of disks, up to which the six nearest of its disks are looked for first."""
Bins = Annotated[int, Integer(1, 1_000_000)]


@dataclass(frozen=True, eq=False, repr=False)
class PairCorrelation(Brief, ResultPlot):
    """Frequency of centres at a distance r, relative to an ideal gas of the same density."""

    r: Array
    g: Array
    g_error: Array
    pairs: Array
    """r, g, g_error, pairs: middles of the bins [length]; g(r), and its standard error, see `pair_correlation`; pairs
    counted, each once, over all frames; shape (bins,)."""
    frames: int

    @property
    def ends(self) -> tuple[Array, Array]:
        """Ends of the 95 % interval of g, of shape (bins,) each.

        They are those of a number of independent events with this relative error (`tools.intervals.of_count`). Of bins
        without pairs only the error of one pair is known, which counts from both ends or from one: it is taken from
        both. Where no pair can be, the error is 0 (`ifrdem analyse FILE rdf`, which knows the radii).
        """
        some = self.pairs > 0.0
        g = np.where(some, self.g, 1.0)
        low, high = of_count(np.where(some, g / np.where(some, self.g_error, 1.0), 0.0) ** 2)
        scale = np.where(some, self.g_error**2 / g, 2.0**0.5 * self.g_error)
        return low * scale, high * scale


@dataclass(frozen=True)
class ContactValue:
    """g at contact, by extrapolation.

    Of inelastic disks it is not the chi that a rate of collisions shows (`pressure.contact_from_rate`): pairs separate
    slower than they approach, and are near contact for longer. Without friction, as many separate at e_n times the
    speed as approach, so that g is (1 + 1 / e_n) / 2 times chi.
    """

    g: float
    error: float
    """g, error: the value and its standard error: of the pairs as in `pair_correlation`, and of the fit; not what the
    fit's form may be off by, which is below 1 % up to packing fraction 0.6 (a quarter of a diameter, where ln g is
    nearly a parabola)."""
    chi_square: float
    degrees: int
    """chi_square, degrees: of the fit: far more than its degrees of freedom means that the form does not fit."""

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the 95 % interval: ln g is what is fitted, with errors that are known from counting."""
        factor = float(np.exp(student_t(np.inf) * self.error / self.g))
        return self.g / factor, self.g * factor

    @property
    def describes(self) -> bool:
        """False if chance would give such deviations from the fit with a probability below 0.001."""
        from scipy.stats import chi2

        return bool(chi2.sf(self.chi_square, self.degrees) >= CHANCE)


@validated
def pair_correlation(
    position: Positions, box: BoxLike, *, r_max: Positive, bins: Bins = 200, r_min: NonNegative = 0.0,
    time: Times = 0.0, others: Positions | None = None,
) -> PairCorrelation:  # fmt: skip
    """g(r) of one or several frames, by freud; g_ab(r) of two species with `others`.

    The standard error is the larger of two: that of counting pairs which are independent, and that of the scatter over
    25 to 100 cells of the box, each summed over the frames, which holds for frames that show nearly the same gas too;
    beyond a cell's side it may be 1.4 times too large.

    InputError if the box is open, r_max is too long, there are fewer than 2 disks, or freud is missing.

    Parameters
    ----------
    position : array (n, 2) or frames of them
        Centres in the box [length].
    box : Box, or two lengths of a periodic one
        Where it is not periodic, only centres farther than `r_max` from the sides count as the first of a pair, and
        what walls inside it take away is not regarded.
    r_max, r_min, bins : float, float, int
        Where the bins end and begin [length]; less than half the shortest side.
    time : float or one for each frame
        Needed for sheared boxes [time].
    others : array (m, 2) or frames of them, optional
        Centres of the second disk of each pair [length]; g is relative to their density.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.pair_correlation(100.0 * rng.random((5000, 2)), (100.0, 100.0), r_max=10.0, bins=10)
    >>> bool(abs(found.g[-1] - 1.0) < 0.05)  # points at random: 1
    True
    """
    if box.is_open:
        raise InputError(
            "box = Box.open(): must have sides, g(r) needs a density: cut out a part and give it a box"
        )
    if not 0.0 <= r_min < r_max:
        raise InputError(f"r_min = {r_min:g}, r_max = {r_max:g}: must satisfy 0 <= r_min < r_max")
    counted = _count_pairs(position, box, r_min, r_max, bins, time, others)
    edges = counted.edges
    error = np.maximum(counted.independent, counted.scatter)
    g = counted.number / counted.ideal
    return PairCorrelation(0.5 * (edges[1:] + edges[:-1]), g, error, counted.pairs, counted.frames)


class _Counted(NamedTuple):
    """Pairs of a g(r): their number from each centre, its expectation in an ideal gas, and errors of the ratio."""

    edges: Array  # (bins + 1,) [length]
    number: Array
    pairs: Array  # each once
    ideal: Array
    independent: Array
    scatter: Array
    frames: int


def _count_pairs(
    position: Iterable[Array], box: Box, r_min: float, r_max: float, bins: int, time: Iterable[float],
    others: Iterable[Array] | None = None,
) -> _Counted:  # fmt: skip
    """Pairs in rings around the centres of frames, cell by cell of the box."""
    freud = load("freud", "g(r)")
    ideal, frames, side = np.zeros(bins), 0, 0
    by_cell, centres = np.zeros((0, bins)), np.zeros(0)
    edges = np.linspace(r_min, r_max, bins + 1)
    rings = np.pi * np.diff(edges**2)
    if not 1e-30 <= r_max <= 1e30:
        raise must_be("r_max", r_max, "from 1e-30 to 1e30: freud computes in single precision")
    rdf = freud.density.RDF(bins, r_max, r_min=r_min)
    seconds = itertools.repeat(None) if others is None else others
    for points, second, when in zip(position, seconds, time, strict=False):
        if second is None and len(points) < 2:
            raise InputError(f"position has a frame of {len(points)} disks: must have 2 or more")
        if second is not None and not (len(points) and len(second)):
            empty = "others" if len(points) else "position"
            raise InputError(f"{empty} has a frame of 0 disks: must have 1 or more")
        if frames == 0:
            side = int(np.clip(np.sqrt(len(points) / DISKS_OF_CELL), *CELLS))
            by_cell, centres = np.zeros((side**2, bins)), np.zeros(side**2)
        where, numbers = np.empty(len(points), dtype=np.int16), np.zeros(side**2 + 1, dtype=np.intp)
        for some in common.blocks(len(points)):
            own_cells = _cells_of_centres(points[some], box, r_max, when, side)
            where[some] = own_cells
            numbers += np.bincount(own_cells + 1, minlength=side**2 + 1)
        aims = points if second is None else second
        for row in range(side):  # a tree of all disks would need much memory
            own_cells = np.array(
                [cell for cell in range(row, side**2, side) if numbers[cell + 1]], dtype=np.intp
            )
            near = (
                common.near_row(aims[:, 1], box, row, side, r_max)
                if len(own_cells)
                else np.zeros(0, dtype=bool)
            )
            aim = freud_frame(aims[near], box, r_max, when, "g(r)") if near.any() else None
            query = None if aim is None else freud.locality.AABBQuery(aim.box, aim.points)
            for cell in own_cells:
                own = freud_frame(points[where == cell], box, r_max, when, "g(r)").points
                centres[cell] += len(own)
                if query is None:
                    continue
                rdf.compute(query, query_points=own, neighbors={"r_max": r_max})
                counts = np.asarray(rdf.bin_counts, dtype=float)
                if r_min == 0.0 and second is None:
                    counts[0] -= len(own)  # each found itself
                by_cell[cell] += counts
        partners = len(points) - 1 if second is None else len(second)
        ideal += numbers[1:].sum() * partners / box.area * rings
        frames += 1
    if frames == 0:
        names = "position" if others is None else "position or others"
        raise InputError(f"{names} has no frames: must have one or more")
    if not np.any(ideal):
        raise InputError(f"no centre is farther than r_max = {r_max:g} from the walls: choose a shorter one")
    count = by_cell.sum(axis=0)
    # Each pair of a periodic gas is counted from both ends: its count says only half as much as it shows.
    ends = 2.0 if others is None else 1.0
    independent = np.sqrt(ends * np.maximum(count, 1.0)) / ideal
    r = 0.5 * (edges[1:] + edges[:-1])
    same = share_in_cell(r, np.array(box.lengths) / side)
    # Contributions of cells to the sum without those of their numbers of centres, which have a fixed sum. Pairs within
    # a cell go with the square of that number, pairs across two cells with the number in each.
    positive = centres > 0.0
    parts = by_cell[positive] - np.outer(centres[positive] / centres.sum(), (1.0 + same) * count)
    cells = len(parts)
    scatter = np.std(parts, axis=0, ddof=1) * np.sqrt(cells) if cells > 1 else np.zeros(bins)
    # A pair across two cells is counted once in each, and their covariance is missing: a half of its variance.
    return _Counted(
        edges, count, count / ends, ideal, independent, scatter / np.sqrt(0.5 + 0.5 * same) / ideal, frames
    )


def _cells_of_centres(points: Array, box: Box, r_max: float, time: float, side: int) -> NDArray[np.intp]:
    """Cell of each centre, -1 for those nearer than `r_max` to a side that is not periodic."""
    inside = np.ones(len(points), dtype=bool)
    for axis in (0, 1):
        if not box.periodic[axis]:
            inside &= (points[:, axis] > r_max) & (points[:, axis] < box.lengths[axis] - r_max)
    return np.where(inside, cells_of(box.wrap(points, time), box, side), -1)


@validated
def contact_value(
    position: Positions, box: BoxLike, *, radius: PositivePerDisk, time: Times = 0.0,
    others: Positions | None = None, radius_of_others: PositivePerDisk | None = None,
) -> ContactValue:  # fmt: skip
    """g at contact of equal disks: a parabola fitted to ln g from contact to 1.25 diameters, weighted by pairs counted.

    `radius` are their radii [length], one number or shape (n,), `radius_of_others` those of `others` (by default the
    same); the rest as `pair_correlation`. InputError as `pair_correlation`; if radii of a species differ, or too few
    pairs are near contact for a fit.

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> radius = np.full(2000, 0.5)
    >>> box = ifrdem.Box.from_packing_fraction(radius, 0.05)
    >>> position = ifrdem.initial.random_positions(box, radius, seed=1)
    >>> found = analysis.contact_value(position, box, radius=radius)
    >>> bool(abs(found.g - 1.0) < 4.0 * found.error + 0.1)
    True
    """
    sigma = 0.0
    for name, given in (
        ("radius", radius), ("radius_of_others", radius if radius_of_others is None else radius_of_others)
    ):  # fmt: skip
        radii = np.atleast_1d(np.asarray(given, dtype=float))
        if not len(radii):
            raise InputError(f"{name} has shape (0,): must be that of one disk or more")
        if np.ptp(radii) > 1e-9 * radii[0]:
            raise InputError(
                f"{name}: must be the same for all: a contact value is found here for equal disks only"
            )
        sigma += float(radii[0])
    reach = (1.0 + CONTACT_RANGE) * sigma
    if box.is_open:
        raise InputError("box = Box.open(): must have sides, g(r) needs a density")
    counted = _count_pairs(position, box, sigma, reach, CONTACT_BINS, time, others)
    pairs = counted.pairs
    used = pairs >= 5.0
    if np.count_nonzero(used) < 8:
        raise InputError(
            f"{pairs.sum():.0f} pairs between 1 and {1.0 + CONTACT_RANGE} diameters are too few to "
            "extrapolate g to contact: take more disks or frames"
        )
    r = 0.5 * (counted.edges[1:] + counted.edges[:-1])
    x, y = r[used] / sigma - 1.0, np.log(counted.number[used] / counted.ideal[used])
    # Frames that show nearly the same gas count as fewer.
    excess = float(np.mean((counted.scatter[used] / counted.independent[used]) ** 2))
    # Weighted by 1 / error of ln g. Middles of bins stand for their means: off by (width^2 / 24) g'' / g, 1e-4 here.
    weight = np.sqrt(pairs[used] / max(excess, 1.0))
    fit, covariance = np.polyfit(x, y, 2, w=weight, cov="unscaled")
    chi_square = float(np.sum(((y - np.polyval(fit, x)) * weight) ** 2))
    g = float(np.exp(fit[2]))
    return ContactValue(g, g * float(np.sqrt(covariance[2, 2])), chi_square, len(x) - 3)


@dataclass(frozen=True, eq=False, repr=False)
class StructureFactor(Brief, ResultPlot):
    """S(k) = <|sum_j exp(-i k r_j)|^2> / n in rings of k."""

    k: Array
    S: Array
    S_error: Array
    """k, S, S_error: mean |k| of the modes in each ring [1/length]; mean of S; its standard error by the scatter over
    modes, each averaged over the frames, which may be correlated; shape (rings,)."""
    modes: NDArray[np.int64]
    frames: int
    """modes, frames: modes counted in a frame, of k and -k one; how many frames there were; shape (rings,)."""

    @property
    def ends(self) -> tuple[Array, Array]:
        """Ends of the 95 % interval of S, of shape (rings,) each, which lie far apart and unevenly for few modes.

        They are those of as many independent intensities as have this error (`tools.intervals.of_intensity`).
        """
        return of_intensity(self.S, self.S_error)


def mode_intensities(
    position: Array, box: Box, modes: tuple[int, int], *, stride: int = 1, time: float = 0.0
) -> tuple[Array, Array]:
    """Vectors k that the box allows [1/length], as `mode_amplitudes`, and |sum_j exp(-i k r_j)|^2 / n at them."""
    k, amplitude = mode_amplitudes(
        position, np.broadcast_to(1.0, len(position)), box, modes, stride=stride, time=time, what="S(k)"
    )
    return k, np.abs(amplitude) ** 2 / len(position)


def mode_amplitudes(
    position: Array, weight: Array, box: Box, modes: tuple[int, int], *, stride: int = 1, time: float = 0.0,
    what: str = "a spectrum",
) -> tuple[Array, NDArray[np.complex128]]:  # fmt: skip
    """Vectors k that the box allows [1/length], shape (2 a + 1, 2 b + 1, 2), and sum_j w_j exp(-i k r_j) at them.

    Weights w are of shape (n,) or, for several sums, (m, n), which gives sums of shape (m, 2 a + 1, 2 b + 1).
    k = 2 pi stride (i / Lx, j / Ly) with i from -a to a and j from -b to b, `modes` = (a, b), by finufft to 1e-9. The
    lattice of a sheared box is skewed: k_y changes by -k_x times the shift of the image above over Ly.
    """
    finufft = load("finufft", what)
    (width, height), (a, b) = box.lengths, modes
    shift = box.image_above(time) if box.shear_rate else 0.0
    shift -= width if shift > 0.5 * width else 0.0

    def sum_of(some: slice) -> NDArray[np.complex128]:
        places = position[some]
        x = places[:, 0] - places[:, 1] * (shift / height)
        # Multiples of the stride repeat themselves in a stride-th of the box.
        phase = [2.0 * np.pi * ((stride * part) % 1.0) - np.pi for part in (x / width, places[:, 1] / height)]
        found: NDArray[np.complex128] = finufft.nufft2d1(
            phase[0],
            phase[1],
            np.ascontiguousarray(weight[..., some], dtype=complex),
            (2 * a + 1, 2 * b + 1),
            isign=-1,
            eps=1e-9,
            nthreads=0 if len(places) > ONE_THREAD else 1,
        )
        return found

    pieces = [*common.blocks(len(position), 4 * common.AT_ONCE)] or [slice(0, 0)]
    amplitude = functools.reduce(operator.add, map(sum_of, pieces))
    i, j = np.meshgrid(np.arange(-a, a + 1), np.arange(-b, b + 1), indexing="ij")
    k_x = 2.0 * np.pi * stride / width * i
    k_y = 2.0 * np.pi * stride / height * j - k_x * (shift / height)
    return np.stack((k_x, k_y), axis=-1), amplitude


def check_periodic(box: Box) -> None:
    """Raise InputError unless the box is periodic along both axes."""
    if box.is_open or not all(box.periodic):
        raise InputError(f"box = {box}: must be periodic along x and y for spectra and S(k)")


def ring_edges(box: Box, k_max: float, rings: int) -> Array:
    """Edges of rings in k up to k_max [1/length], without k = 0, shape (rings + 1,) or fewer.

    InputError if the box is not periodic or k_max is below the smallest k that it allows.
    """
    check_periodic(box)
    least = 2.0 * np.pi / np.array(box.lengths).max()
    if not k_max > least:
        raise InputError(
            f"k_max = {k_max:g}: must be above 2 pi / L = {least:.4g}, the smallest k that the box allows"
        )
    edges = np.linspace(0.0, k_max, min(rings, max(1, int(k_max / least))) + 1)
    edges[0] = 1e-9 * least  # k = 0 is no fluctuation
    return edges


def in_rings(
    k: Array, edges: Array, begin: float, end: float
) -> tuple[NDArray[np.bool_], Array, NDArray[np.intp]]:
    """Modes k (2 a + 1, 2 b + 1, 2), one of k and -k, beyond `begin` and up to `end`; their |k| and rings, (m,)."""
    size = np.hypot(k[..., 0], k[..., 1])
    a, b = (n // 2 for n in size.shape)
    half = np.zeros(size.shape, dtype=bool)
    half[a + 1 :] = True
    half[a, b + 1 :] = True
    chosen = half & (size > begin) & (size <= end)
    ring = np.clip(np.searchsorted(edges, size[chosen]) - 1, 0, len(edges) - 2)
    return chosen, size[chosen], ring


@validated
def structure_factor(
    position: Positions,
    box: BoxLike,
    *,
    k_max: Positive,
    rings: Bins = 200,
    time: Times = 0.0,
) -> StructureFactor:
    """S(k) of one or several frames at the k that a periodic box allows, from 2 pi / L to `k_max` [1/length].

    All of them while there are not more than `MOST_MODES` along an axis; above that, every p-th. InputError if the
    box is not periodic, a frame has no disks, k_max is below 2 pi / L, or finufft is missing.

    Modes are independent of each other, frames need not be: a long wave lives long. The standard error of a ring of M
    modes is S sqrt(q / M), with q the variance of modes that are averaged over the frames, relative to S^2. In a
    homogeneous fluid q is 1 if all frames show the same gas, and 1 / frames if they are independent; it is not taken
    to be less. In a sheared box, where waves turn, it is 1 / frames.

    Parameters
    ----------
    position : array (n, 2) or frames of them
        Centres in the box [length].
    rings : int
        Rings between 0 and `k_max`; they are no narrower than 2 pi / L, and empty ones are left out.
    time : float or one for each frame
        Needed for sheared boxes [time].

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.structure_factor(20.0 * rng.random((2000, 2)), (20.0, 20.0), k_max=10.0, rings=10)
    >>> bool(abs(found.S[-1] - 1.0) < 0.2)  # points at random: 1
    True
    """
    edges = ring_edges(box, k_max, rings)
    lengths, count = np.array(box.lengths), len(edges) - 1
    number, sum_S, sum_k = np.zeros((3, count))
    frames = 0
    by_mode: list[Array] = []  # sums over frames
    rings_of: list[NDArray[np.intp]] = []
    for points, when in zip(position, time, strict=False):
        if not len(points):
            raise InputError("position has a frame of 0 disks: must have 1 or more")
        begin = 0.0
        for i, (stride, end) in enumerate(_passes(lengths, k_max)):
            modes = np.minimum(np.ceil(end * lengths / (2.0 * np.pi * stride)), MOST_MODES // 2).astype(int)
            if box.shear_rate:  # the skew moves k_y by up to k_x / 2 Lx / Ly
                modes[1] += int(np.ceil(0.5 * modes[0])) + 1
            k, S = mode_intensities(points, box, (int(modes[0]), int(modes[1])), stride=stride, time=when)
            chosen, size, ring = in_rings(k, edges, begin, end)
            number += np.bincount(ring, minlength=count)
            sum_S += np.bincount(ring, S[chosen], minlength=count)
            sum_k += np.bincount(ring, size, minlength=count)
            begin = end
            if box.shear_rate:
                continue
            if frames == 0:
                by_mode.append(np.zeros(len(ring)))
                rings_of.append(ring)
            by_mode[i] += S[chosen]
        frames += 1
    if frames == 0:
        raise InputError("position has no frames: must have one or more")
    full = number > 0.0
    S, k, modes = sum_S[full] / number[full], sum_k[full] / number[full], number[full] / frames
    q = np.full(len(S), 1.0 / frames)
    if by_mode:
        ring = np.cumsum(full)[np.concatenate(rings_of)] - 1
        q = np.maximum(q, _relative_variance(np.concatenate(by_mode) / frames, ring, S))
    return StructureFactor(k, S, S * np.sqrt(q / modes), np.rint(modes).astype(np.int64), frames)


def _relative_variance(by_mode: Array, ring: NDArray[np.intp], S: Array) -> Array:
    """Variance of modes of each ring over the square of its mean S; of `LEAST_MODES` at least, with the next rings."""
    modes = np.bincount(ring)
    part = np.divide(by_mode, S[ring], out=np.ones(len(ring)), where=S[ring] > 0.0)
    square = np.bincount(ring, (part - 1.0) ** 2)
    held, found = np.cumsum(modes), np.ones(len(S))
    for r in range(len(S)):
        end = int(np.searchsorted(held, held[r] - modes[r] + LEAST_MODES)) + 1
        degrees = int(modes[r:end].sum()) - len(modes[r:end])
        if degrees > 0:
            found[r] = square[r:end].sum() / degrees
    return found


def _passes(lengths: Array, k_max: float) -> list[tuple[int, float]]:
    """Strides, and up to which k each goes: 1 as far as the modes reach, then one that reaches k_max."""
    half = MOST_MODES // 2
    reach = 2.0 * np.pi * half / float(lengths.max())
    if reach >= k_max:
        return [(1, k_max)]
    return [(1, reach), (int(np.ceil(k_max / reach)), k_max)]


@dataclass(frozen=True, eq=False, repr=False)
class Clusters(Brief, ResultPlot):
    """Disks joined wherever the gap between two surfaces is below `gap`; a disk alone is a cluster of one."""

    label: NDArray[np.intp]
    """The cluster of each disk, from 0, the largest first; shape (n,)."""
    sizes: NDArray[np.intp]
    radius_of_gyration: Array
    spans: NDArray[np.bool_]
    """sizes, radius_of_gyration, spans: of each cluster: number of disks, falling; root of the mean square distance
    from the mean of its centres [length], nan where it spans the box; True if it is connected to its own image
    through periodic sides; shape (c,)."""
    gap: float
    """The criterion [length]."""

    @property
    def largest(self) -> float:
        """Share of all disks that the largest cluster holds."""
        return float(self.sizes[0] / self.sizes.sum()) if len(self.sizes) else 0.0

    @property
    def mean_size(self) -> float:
        """Mean size of the cluster that a disk is in: sum s^2 / sum s."""
        return float(np.sum(self.sizes.astype(float) ** 2) / self.sizes.sum()) if len(self.sizes) else 0.0


@validated
def clusters(
    position: Vectors, box: BoxLike, *, radius: PositivePerDisk, gap: NonNegative, time: Real = 0.0
) -> Clusters:
    """Clusters of one frame: neighbours by freud, connected components by SciPy.

    InputError if the gap is negative, or so long that disks would see themselves through periodic sides.

    Parameters
    ----------
    position, radius : array (n, 2), and float or array (n,)
        Centres and radii [length].
    box : Box, or two lengths of a periodic one
    gap : float
        Disks whose surfaces are nearer than this are joined [length]. In a homogeneous gas of equal disks that are to
        be distinguished from clusters, a tenth of a diameter or less.
    time : float
        Needed for sheared boxes [time].

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> position = np.array([[1.0, 1.0], [2.05, 1.0], [6.0, 6.0]])
    >>> analysis.clusters(position, (10.0, 10.0), radius=0.5, gap=0.1).sizes
    array([2, 1])
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    whole = np.asarray(position, dtype=np.float64)
    radii = rows("radius", radius, len(whole))
    largest = float(radii.max(initial=0.0))
    i, j, vector = neighbours(whole, box, 2.0 * largest + gap, time, "clusters")
    # Touching disks of a file in single precision are apart or overlap by its rounding.
    near = np.hypot(vector[:, 0], vector[:, 1]) <= radii[i] + radii[j] + gap
    i, j, vector = i[near], j[near], vector[near]
    # Most disks of a homogeneous gas are alone: the graph is that of the others.
    alone = np.ones(len(whole), dtype=bool)
    alone[i] = alone[j] = False
    joined = np.flatnonzero(~alone)
    i, j = np.searchsorted(joined, i), np.searchsorted(joined, j)
    x, n = whole[joined], len(joined)
    graph = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(n, n))
    count, label = connected_components(graph, directed=False) if n else (0, np.zeros(0, dtype=np.intp))
    sizes = np.bincount(label, minlength=count)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty(count, dtype=np.intp)
    rank[order] = np.arange(count)
    label = rank[label]
    sizes = sizes[order]

    # Paths along the tree from one disk of each cluster, all trees hung on one more root.
    first = np.unique(label, return_index=True)[1]
    tree = coo_array(
        (np.ones(len(i) + count, dtype=np.int8), (np.append(i, np.full(count, n)), np.append(j, first))),
        shape=(n + 1, n + 1),
    )
    _, parent = breadth_first_order(tree.tocsr(), n, directed=False)
    parent = np.where(parent < 0, n, parent).astype(np.intp)
    offset = np.zeros((n + 1, 2))
    inner = parent[:n] != n
    offset[:n][inner] = box.minimum_image(x[inner] - x[parent[:n][inner]], time)
    offset[first] = 0.0
    while np.any(parent != n):  # each step halves what is left of the way to the root
        offset += offset[parent] * (parent != n)[:, None]
        parent = parent[parent]
    unwrapped = offset[:n]
    # A bond that does not close is one around the box.
    open_bond = np.any(np.abs(unwrapped[j] - unwrapped[i] - vector) > 1e-6 * max(1.0, largest), axis=1)
    mean = np.stack(
        [np.bincount(label, unwrapped[:, axis], minlength=count) / sizes for axis in (0, 1)], axis=1
    )
    square = np.bincount(label, np.sum((unwrapped - mean[label]) ** 2, axis=1), minlength=count) / sizes

    singles = len(whole) - n
    spans = np.zeros(count + singles, dtype=bool)
    spans[label[i[open_bond]]] = True
    radius_of_gyration = np.zeros(count + singles)
    radius_of_gyration[:count] = np.where(spans[:count], np.nan, np.sqrt(square))
    all_labels = np.empty(len(whole), dtype=np.intp)
    all_labels[joined] = label
    all_labels[alone] = np.arange(count, count + singles)
    return Clusters(
        all_labels, np.append(sizes, np.ones(singles, dtype=np.intp)), radius_of_gyration, spans, gap
    )


@dataclass(frozen=True, eq=False, repr=False)
class Hexatic(Brief, ResultPlot):
    """psi_6 of disk i: the mean of exp(6 i theta) over the directions theta to its neighbours."""

    psi6: NDArray[np.complex128]
    """Of each disk; shape (n,)."""
    local: float
    whole: float
    """local, whole: mean of |psi_6|, 1 in a perfect hexagonal lattice; |mean of psi_6|, 1 if it is a single crystal,
    about local / sqrt(n) in a fluid."""
    neighbours: str


@validated
def hexatic(
    position: Vectors,
    box: BoxLike,
    *,
    neighbours: Literal["nearest", "voronoi"] = "nearest",
    time: Real = 0.0,
) -> Hexatic:
    """psi_6 of one frame, by freud.

    InputError for fewer than 7 disks, an unknown kind of neighbours, or without freud.

    Parameters
    ----------
    position : array (n, 2)
        Centres [length], 7 or more.
    box : Box, or two lengths of a periodic one
        Disks at walls count with the neighbours that they have inside.
    neighbours : {"nearest", "voronoi"}
        The six nearest, or those across an edge of the Voronoi cell, all alike (a few 1e5 disks at most).
    time : float
        Needed for sheared boxes [time].

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import analysis
    >>> position = ifrdem.initial.hexagonal_positions(ifrdem.Box((10.0, 10.0 * 3**0.5 / 2)), [0.5] * 100)
    >>> round(analysis.hexatic(position, (10.0, 10.0 * 3**0.5 / 2)).local, 6)
    1.0
    """
    x = np.asarray(position, dtype=np.float64)
    if len(x) < 7:
        raise InputError(f"position has {len(x)} disks: must have 7 or more for psi_6")
    freud = load("freud", "psi_6")
    # Where sides are walls: wide enough to keep images away from all six neighbours.
    reach = 0.0
    if not all(box.periodic):
        reach = 2.0 * float(np.ptp(x, axis=0).max())
        reach = min(reach, 0.4 * min([side for side in box.periods if side] or [np.inf]))
    if neighbours == "voronoi":
        frame = freud_frame(x, box, reach, time, "psi_6")
        cells = freud.locality.Voronoi()
        cells.compute((frame.box, frame.points))
        psi6 = _psi6(frame, cells.nlist)
    else:
        psi6 = np.empty(len(x), dtype=np.complex128)
        count = common.strips_of(len(x), box)
        for row in range(count):
            _of_nearest(psi6, x, box, row, count, reach, time)
    return Hexatic(psi6, float(np.abs(psi6).mean()), float(np.abs(psi6.mean())), neighbours)


def _psi6(frame: common.FreudFrame, neighbours: Any) -> NDArray[np.complex128]:
    """psi_6 of the disks of a frame with a list of neighbours of freud."""
    compute = load("freud", "psi_6").order.Hexatic(k=6)
    compute.compute((frame.box, frame.points), neighbors=neighbours)
    return np.asarray(compute.particle_order, dtype=np.complex128)


def _of_nearest(
    psi6: NDArray[np.complex128], x: Array, box: Box, row: int, count: int, reach: float, time: float
) -> None:
    """Write psi_6, with the six nearest, of the disks of one of `count` strips."""
    freud = load("freud", "psi_6")
    away = SPACINGS * np.sqrt(box.area / len(x)) if count > 1 else 0.0
    while True:
        near, own = common.strip(x, box, row, count, away)
        if not len(own):
            return
        if len(near) >= 7:
            frame = freud_frame(x[near], box, reach, time, "psi_6")
            query = freud.locality.AABBQuery(frame.box, frame.points)
            six = query.query(frame.points, {"num_neighbors": 6, "exclude_ii": True}).toNeighborList()
            # The nearest of all are in the strip or nearer to it than the sixth that was found.
            within = np.isin(six.query_point_indices, own)
            if len(near) == len(x) or six.distances[within].max() < away:
                psi6[near[own]] = _psi6(frame, six)[own]
                return
        away *= 2.0
