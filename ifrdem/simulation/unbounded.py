"""Open boundaries: when no disk can meet another one any more.

Disks in open space lie in tiles over what they fill. Cells and tiles at its edge have no end there; once the disks have
spread, they are laid anew. So cells get wider as the gas gets thinner, and once no two disks approach each other,
nothing more can happen: the rest of the run is one flight.
"""

from __future__ import annotations

import numpy as np

from ..model.state import Disks, State

MOST_COMPARED = 200_000
"""Disks of which all pairs are compared at most: some ten seconds. More fly on in windows, which get longer."""


def nobody_meets(state: State, disks: Disks) -> bool:
    """True if no two disks approach each other in a way that they could touch: nothing will happen without forces.

    Every pair is looked at, until one is found; up to MOST_COMPARED disks. Imports the kernels.
    """
    from ..kernels.flights import approaching

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
