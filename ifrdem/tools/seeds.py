"""Random numbers: one seed for a run, and a separate stream for every purpose and species.

The same seed for positions and velocities must not tie the two together, nor that of one species to another.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..mpi import distribution
from .values import is_integer

POSITIONS, SITES, VELOCITIES, SPINS, RADII, AGITATION, HISTORIES, COEFFICIENTS = range(8)
"""Purposes of random numbers."""
PERMUTED_AT_ONCE = 1 << 14
"""Numbers that are permuted together, in the fastest memory of a core."""


def stream(seed: int, purpose: int, number: int = 0) -> np.random.Generator:
    """The random numbers of a seed for one purpose, independent of those for another.

    Above 0, `number` is that of a block of ids, or of a strip of the box.

    Raises InputError if the seed is not a whole number of 0 or more.
    """
    if not is_integer(seed) or seed < 0:
        raise InputError(f"seed = {seed}: must be an integer, 0 or more")
    key = (purpose, number) if number else (purpose,)
    return np.random.default_rng(np.random.SeedSequence(int(seed), spawn_key=key))


def drawn(
    seed: int, purpose: int, ids: range, draw: Callable[[np.random.Generator, int], NDArray[Any]]
) -> NDArray[Any]:
    """Random rows of some ids: the same for an id in any range of ids.

    `draw(random, count)` draws rows of so many ids, one after another. Each block of ids (`BLOCK`) has a stream
    of its own, the first one that of `stream`.
    """
    found = []
    for block in distribution.blocks(ids):
        number, first = divmod(block.start, distribution.BLOCK)
        found.append(draw(stream(seed, purpose, number), first + len(block))[first:])
    return np.concatenate(found) if found else draw(stream(seed, purpose), 0)


def permuted(seed: int, purpose: int, n: int, ids: range) -> NDArray[np.int64]:
    """Numbers of some ids in a random order of n things: the same for an id whatever range it is requested in.

    Of more than a block (`BLOCK`), a Feistel network of eight rounds permutes the numbers of so many bits (M.
    Luby, C. Rackoff, doi:10.1137/0217022), again and again until one is below n (J. Black, P. Rogaway,
    doi:10.1007/3-540-45760-7_9); its rounds mix bits as `SplitMix64` does (doi:10.1145/2660193.2660195).
    """
    random = stream(seed, purpose)
    if n <= distribution.BLOCK:
        return random.permutation(n)[ids.start : ids.stop]
    half = -(-(n - 1).bit_length() // 2)
    low = np.uint64((1 << half) - 1)
    keys = random.integers(0, 2**64, 8, dtype=np.uint64)
    result = np.empty(len(ids), dtype=np.int64)
    for first in range(0, len(ids), PERMUTED_AT_ONCE):
        found = np.arange(
            ids.start + first, min(ids.start + first + PERMUTED_AT_ONCE, ids.stop), dtype=np.uint64
        )
        beyond = np.arange(len(found))
        while len(beyond):
            left, right = found[beyond] >> np.uint64(half), found[beyond] & low
            for key in keys:
                left, right = right, left ^ (_mixed(right ^ key) & low)
            found[beyond] = left << np.uint64(half) | right
            beyond = beyond[found[beyond] >= np.uint64(n)]
        result[first : first + len(found)] = found
    return result


def _mixed(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        words = (words ^ (words >> np.uint64(shift))) * np.uint64(factor)
    return words ^ (words >> np.uint64(31))


def of_species(seed: int, i: int) -> int:
    """The seed of species i, counted from 0: with one seed for all, disk j of each would draw the same numbers."""
    return int(np.random.SeedSequence([seed, i]).generate_state(1, np.uint64)[0]) if i else seed


def of_device(seed: int) -> int:
    """The seed as the key of random numbers on the device (`kernels/random.py`).

    Raises InputError if it is not a whole number from 0 to 2^64 - 1.
    """
    if not (hasattr(seed, "__index__") and 0 <= seed < 2**64):
        raise InputError(f"seed = {seed}: must be an integer from 0 to 2^64 - 1")
    return operator.index(seed)
