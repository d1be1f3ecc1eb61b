"""How far beyond contact neighbours are listed: the *skin*, which decides how long an epoch is."""

from __future__ import annotations

import math

import numpy as np

from ..errors import InputError
from ..kernels.limits import CROWD
from ..model.box import Box
from ..model.state import Disks, State

FEW = 16  # disks that may as well list everybody, and rarely do so
NEIGHBOURS = 4  # whose distance tells the density of an open gas
REACH = 3.0  # of that distance: how far lists of a thin gas go
THIN = 0.05  # packing fraction below which an open gas is a thin one


def default_skin(packing_fraction: float, diameter: float) -> float:
    """Extra listing distance [length] that costs least time, from the mean free path.

    A fit, 2.26 (l / sigma)^(2/3) sigma, to the flat optima that were measured at phi = 0.1, 0.3 and 0.6.
    """
    chi = (1.0 - 7.0 * packing_fraction / 16.0) / (1.0 - packing_fraction) ** 2
    free_path = math.pi / (8.0 * math.sqrt(2.0) * packing_fraction * chi)  # in diameters
    return diameter * min(max(2.26 * free_path ** (2.0 / 3.0), 0.2), 8.0)


def choose(given: float | None, inner: Box, box: Box, disks: Disks, state: State) -> float:
    """The skin [length]: the one that was given, or a good one.

    Parameters
    ----------
    given : float or None
    inner : Box
        The periodic box that is computed in.
    box : Box
        The user's.

    Raises
    ------
    InputError
        If the one that was given is not above 0 or too large, or the disks differ too much in size.
    """
    diameter = 2.0 * float(disks.radius.max()) if disks.n else 0.0
    # Beyond half a side, a pair could be near through two images at once; two cells must fit into a sheared box.
    widest = min(inner.lengths) / (2.01 if box.shear_rate else 2.0) - diameter
    # As many of the smallest disks as can stand around the largest one, within the reach of a fast one's list.
    smallest = 2.0 * float(disks.radius.min()) if disks.n else 1.0
    crowded = 0.5 * (math.sqrt(CROWD) * smallest - diameter - smallest) / 2.5
    if crowded <= 0.05 * smallest:
        raise InputError(
            f"the largest disk is {diameter / smallest:.4g} times as wide as the smallest: at most some "
            f"{math.sqrt(CROWD) - 1.0:.0f} times is supported"
        )
    if not box.is_open:
        widest = min(widest, crowded)
    if given is not None:
        if not 0.0 < given <= widest:
            raise InputError(f"skin = {given}: must lie above 0 and not above {widest:.6g} in this box")
        return given
    if disks.n <= FEW:
        return widest
    if box.is_open:
        return min(_between_neighbours(state, disks), widest)
    mean = 2.0 * float(disks.radius.mean())
    return min(default_skin(box.packing_fraction(disks.radius), mean), widest)


def _between_neighbours(state: State, disks: Disks) -> float:
    """A good listing distance beyond contact [length], from the usual distance between neighbours.

    The middle of what is left of a gas decides: a few disks that have flown ahead are no reason to list all others.
    """
    from scipy.spatial import cKDTree

    near, _ = cKDTree(state.position).query(state.position, NEIGHBOURS + 1)
    distance = float(np.median(near[:, -1]))
    mean_area = math.pi * float(np.mean(disks.radius**2))
    phi = min(NEIGHBOURS * mean_area / (math.pi * distance**2), 0.8)
    usual = default_skin(phi, 2.0 * float(disks.radius.mean()))
    return max(usual, REACH * distance) if phi < THIN else usual
