"""Blocks of tiles that ranks own."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.mpi.decomposition import most_ranks, owners


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 12])
def test_every_tile_has_an_owner_and_every_rank_a_block(size: int) -> None:
    owner = owners(np.full(12, 10), (4, 3), size).reshape(4, 3)
    for rank in range(size):
        x, y = np.nonzero(owner == rank)
        assert len(x) == (np.ptp(x) + 1) * (np.ptp(y) + 1) > 0
    # The best that blocks of whole tiles can do for 2 and 3; no rank has more than twice its share.
    assert np.bincount(owner.reshape(-1)).max() <= {2: 6, 3: 6}.get(size, 2 * -(-12 // size))


def test_blocks_have_as_many_disks_each_as_tiles_allow() -> None:
    """All disks in the first quarter of a row of eight tiles: the cut is in the middle of them."""
    assert owners(np.array([50, 50, 1, 1, 1, 1, 1, 1]), (8, 1), 2).tolist() == [0, 1, 1, 1, 1, 1, 1, 1]


def test_more_ranks_than_tiles_are_refused() -> None:
    with pytest.raises(InputError, match=r"3 ranks: 20 disks make 2 x 1 tiles.*start 2 or fewer"):
        owners(np.array([10, 10]), (2, 1), 3)


@pytest.mark.parametrize(
    ("tiles", "size", "most"),
    [((1, 1), 4, 1), ((2, 1), 3, 2), ((4, 3), 12, 12), ((3, 3), 9, 7), ((1, 5), 2, 2)],
)
def test_as_many_ranks_share_tiles_as_straight_cuts_allow(
    tiles: tuple[int, int], size: int, most: int
) -> None:
    """Of 3 x 3 tiles, 8 ranks would be two groups of 4: one gets two rows, and the other has three tiles left."""
    assert most_ranks(tiles, size) == most
