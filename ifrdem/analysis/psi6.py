"""Bond-orientational order of six neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import Array, one_of
from ..tools.pictured import PicturedResult
from ..tools.reprs import Brief
from . import common as libraries
from .common import as_box, each, freud_frame

NEIGHBOURS = ("nearest", "voronoi")


@dataclass(frozen=True, eq=False, repr=False)
class Hexatic(Brief, PicturedResult):
    """psi_6 of disk i: the mean of exp(6 i theta) over the directions theta to its neighbours."""

    psi6: NDArray[np.complex128]
    """Of each disk; shape (n,)."""
    local: float
    whole: float
    """local, whole: mean of |psi_6|, 1 in a perfect hexagonal lattice; |mean of psi_6|, 1 if it is a single crystal,
    about local / sqrt(n) in a fluid."""
    neighbours: str


def hexatic(
    position: Array,
    box: Box | ArrayLike,
    *,
    neighbours: Literal["nearest", "voronoi"] = "nearest",
    time: float = 0.0,
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
    one_of("neighbours", neighbours, NEIGHBOURS)
    box = as_box(box)
    (x,) = each(position)
    if len(x) < 7:
        raise InputError(f"{len(x)} disks: psi_6 needs 7 or more")
    freud = libraries.load("freud", "psi_6")
    # Where sides are walls: wide enough to keep images away from all six neighbours.
    reach = 0.0
    if not all(box.periodic):
        reach = 2.0 * float(np.ptp(x, axis=0).max())
        reach = min(reach, 0.4 * min([side for side in box.periods if side] or [np.inf]))
    frame = freud_frame(x, box, reach, time, "psi_6")
    compute = freud.order.Hexatic(k=6)
    if neighbours == "nearest":
        compute.compute((frame.box, frame.points), neighbors={"num_neighbors": 6, "exclude_ii": True})
    else:
        cells = freud.locality.Voronoi()
        cells.compute((frame.box, frame.points))
        compute.compute((frame.box, frame.points), neighbors=cells.nlist)
    psi6 = np.asarray(compute.particle_order, dtype=np.complex128)
    return Hexatic(psi6, float(np.abs(psi6).mean()), float(np.abs(psi6.mean())), neighbours)
