"""The pair correlation g(r), and its value at contact."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import Array
from ..tools.pictured import PicturedResult
from ..tools.reprs import Brief
from . import common as libraries
from .common import Positions, as_box, each, freud_frame, times_of

CONTACT_RANGE = 0.25  # of the diameter, in which the contact value is fitted
CONTACT_BINS = 25


@dataclass(frozen=True, eq=False, repr=False)
class PairCorrelation(Brief, PicturedResult):
    """Frequency of centres at a distance r, relative to an ideal gas of the same density."""

    r: Array
    g: Array
    g_error: Array
    pairs: Array
    """r, g, g_error, pairs: middles of the bins [length]; g(r), and its standard error by the number of pairs, which
    count as independent; pairs counted, each once, over all frames; shape (bins,)."""
    frames: int


@dataclass(frozen=True)
class ContactValue:
    """g at contact, by extrapolation.

    Of inelastic disks it is not the chi that a rate of collisions shows (`pressure.contact_from_rate`): pairs separate
    slower than they approach, and are near contact for longer. Without friction, as many separate at e_n times the
    speed as approach, so that g is (1 + 1 / e_n) / 2 times chi.
    """

    g: float
    error: float
    """g, error: the value and its standard error: counting of pairs, and the fit; not what the fit's form may be off
    by, which is below 1 % up to packing fraction 0.6 (a quarter of a diameter, where ln g is nearly a parabola)."""
    chi_square: float
    degrees: int
    """chi_square, degrees: of the fit: far more than its degrees of freedom means that the form does not fit."""


def pair_correlation(
    position: Positions, box: Box | ArrayLike, *, r_max: float, bins: int = 200, r_min: float = 0.0,
    time: float | Iterable[float] = 0.0,
) -> PairCorrelation:  # fmt: skip
    """g(r) of one or several frames, by freud.

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

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.pair_correlation(100.0 * rng.random((5000, 2)), (100.0, 100.0), r_max=10.0, bins=10)
    >>> bool(abs(found.g[-1] - 1.0) < 0.05)  # points at random: 1
    True
    """
    box = as_box(box)
    if box.is_open:
        raise InputError("g(r) needs a density, and an open box has none: cut out a part and give it a box")
    if not 0.0 <= r_min < r_max:
        raise InputError(f"r_min = {r_min:g}, r_max = {r_max:g}: 0 <= r_min < r_max is needed")
    freud = libraries.load("freud", "g(r)")
    count, ideal, frames = np.zeros(bins), np.zeros(bins), 0
    edges = np.linspace(r_min, r_max, bins + 1)
    rings = np.pi * np.diff(edges**2)
    for points, when in zip(each(position), times_of(time), strict=False):
        if len(points) < 2:
            raise InputError("g(r) needs 2 disks or more")
        frame = freud_frame(points, box, r_max, when, "g(r)")
        inside = np.ones(len(points), dtype=bool)
        for axis in (0, 1):
            if not box.periodic[axis]:
                inside &= (points[:, axis] > r_max) & (points[:, axis] < box.lengths[axis] - r_max)
        rdf = freud.density.RDF(bins, r_max, r_min=r_min)
        pairs = {"exclude_ii": True} if np.all(inside) else {}
        query = frame.points if np.all(inside) else frame.points[inside]
        rdf.compute((frame.box, frame.points), query_points=query, neighbors={"r_max": r_max, **pairs})
        counted = np.asarray(rdf.bin_counts, dtype=float)
        if not pairs and r_min == 0.0:
            counted[0] -= np.count_nonzero(inside)  # each found itself
        count += counted
        ideal += np.count_nonzero(inside) * (len(points) - 1) / box.area * rings
        frames += 1
    if frames == 0:
        raise InputError("no frames: there is no g(r)")
    if not np.any(ideal):
        raise InputError(f"no centre is farther than r_max = {r_max:g} from the walls: choose a shorter one")
    # Each pair of a periodic gas is counted from both ends: its count says only half as much as it shows.
    error = np.sqrt(2.0 * np.maximum(count, 1.0)) / ideal
    return PairCorrelation(0.5 * (edges[1:] + edges[:-1]), count / ideal, error, 0.5 * count, frames)


def contact_value(
    position: Positions, box: Box | ArrayLike, *, radius: ArrayLike, time: float | Iterable[float] = 0.0
) -> ContactValue:
    """g at contact of equal disks: a parabola fitted to ln g from contact to 1.25 diameters, weighted by pairs counted.

    `radius` are their radii [length], one number or shape (n,); the rest as `pair_correlation`. InputError as
    `pair_correlation`; if radii differ, or too few pairs are near contact for a fit.

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
    radii = np.atleast_1d(np.asarray(radius, dtype=float))
    if np.ptp(radii) > 1e-9 * radii[0]:
        raise InputError("radii differ: a contact value is found here for equal disks only")
    sigma = 2.0 * float(radii[0])
    reach = (1.0 + CONTACT_RANGE) * sigma
    found = pair_correlation(position, box, r_min=sigma, r_max=reach, bins=CONTACT_BINS, time=time)
    used = found.pairs >= 5.0
    if np.count_nonzero(used) < 8:
        raise InputError(
            f"{found.pairs.sum():.0f} pairs between 1 and {1.0 + CONTACT_RANGE} diameters are too few to "
            "extrapolate g to contact: more disks or frames are needed"
        )
    x, y = found.r[used] / sigma - 1.0, np.log(found.g[used])
    # Weighted by 1 / error of ln g. Middles of bins stand for their means: off by (width^2 / 24) g'' / g, 1e-4 here.
    weight = np.sqrt(found.pairs[used])
    fit, covariance = np.polyfit(x, y, 2, w=weight, cov="unscaled")
    chi_square = float(np.sum(((y - np.polyval(fit, x)) * weight) ** 2))
    g = float(np.exp(fit[2]))
    return ContactValue(g, g * float(np.sqrt(covariance[2, 2])), chi_square, len(x) - 3)
