"""Tiles among ranks: each owns a block of them, with about as many disks as the others."""

from __future__ import annotations

import contextlib

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError


def owners(count: NDArray[np.number], tiles: tuple[int, int], size: int) -> NDArray[np.int32]:
    """The rank that owns each tile, shape (tiles,): blocks with about as many disks (`count`) each.

    The rectangle is cut in two across its longer side, and each part again, so that any number of ranks gets blocks.
    InputError if there are fewer tiles than ranks.
    """
    total = tiles[0] * tiles[1]
    if size > total:
        raise InputError(
            f"{size} ranks: {int(count.sum())} disks make {counted_tiles(tiles)}, and each rank requires one: "
            + (f"start {total} or fewer (mpiexec -n)" if total > 1 else "run it without mpiexec")
        )
    weight = count.reshape(tiles).astype(np.float64) + 1e-9
    owner = np.empty(tiles, dtype=np.int32)

    def divide(x: slice, y: slice, first: int, last: int) -> None:
        if last - first == 1:
            owner[x, y] = first
            return
        wide, high = x.stop - x.start, y.stop - y.start
        low = (last - first) // 2
        for axis in (0, 1) if wide >= high else (1, 0):
            length, across = (wide, high) if axis == 0 else (high, wide)
            cuts = np.arange(1, length)
            cuts = cuts[(cuts * across >= low) & ((length - cuts) * across >= last - first - low)]
            if len(cuts):
                share = np.cumsum(weight[x, y].sum(axis=1 - axis))
                cut = int(cuts[np.argmin(np.abs(share[cuts - 1] / share[-1] - low / (last - first)))])
                if axis == 0:
                    divide(slice(x.start, x.start + cut), y, first, first + low)
                    divide(slice(x.start + cut, x.stop), y, first + low, last)
                else:
                    divide(x, slice(y.start, y.start + cut), first, first + low)
                    divide(x, slice(y.start + cut, y.stop), first + low, last)
                return
        raise InputError(  # a block of few tiles that no straight cut divides
            f"{size} ranks: {counted_tiles(tiles)} cannot be divided into so many blocks: start fewer (mpiexec -n)"
        )

    divide(slice(0, tiles[0]), slice(0, tiles[1]), 0, size)
    return owner.reshape(-1)


def most_ranks(tiles: tuple[int, int], size: int) -> int:
    """The largest number of ranks, up to so many, among which equally full tiles can be divided."""
    for count in range(min(size, tiles[0] * tiles[1]), 1, -1):
        with contextlib.suppress(InputError):
            owners(np.ones(tiles[0] * tiles[1]), tiles, count)
            return count
    return 1


def counted_tiles(tiles: tuple[int, int]) -> str:
    """Number of tiles, for a message."""
    total = tiles[0] * tiles[1]
    return f"{tiles[0]} x {tiles[1]} tiles" if total > 1 else "one tile"
