"""Random numbers: one seed for a run, and a stream of its own for every purpose and species.

The same seed for positions and velocities must not tie the two together, nor that of one species to another.
"""

from __future__ import annotations

import operator

import numpy as np

from ..errors import InputError

POSITIONS, SITES, VELOCITIES, SPINS, RADII, AGITATION, HISTORIES = range(7)
"""Purposes of random numbers."""


def stream(seed: int, purpose: int) -> np.random.Generator:
    """The random numbers of a seed for one purpose, independent of those for another.

    Raises InputError if the seed is not a whole number of 0 or more.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed = {seed}: a whole number, 0 or more, is needed")
    return np.random.default_rng(np.random.SeedSequence(int(seed), spawn_key=(purpose,)))


def of_species(seed: int, i: int) -> int:
    """The seed of species i, counted from 0: with one seed for all, disk j of each would draw the same numbers."""
    return int(np.random.SeedSequence([seed, i]).generate_state(1, np.uint64)[0]) if i else seed


def of_device(seed: int) -> int:
    """The seed as the key of random numbers on the device (`kernels/random.py`).

    Raises InputError if it is not a whole number from 0 to 2^64 - 1.
    """
    if not (hasattr(seed, "__index__") and 0 <= seed < 2**64):
        raise InputError(f"seed = {seed}: a whole number from 0 to 2^64 - 1 is needed")
    return operator.index(seed)
