"""Rows of disks by their ids, on one rank and on several."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from support import mpi

from ifrdem.mpi import SERIAL, distribution

SCRIPT = Path(__file__).parents[1] / "support" / "ranks" / "distribution.py"
MISSING = "a disk is on no rank, or on two: please report this"


@pytest.mark.full
@mpi.needed
def test_slices_are_scattered_and_gathered_again() -> None:
    """Rows from anywhere, from and to the first rank; sums, digests and starts are those of one process, to the bit."""
    done = mpi.on(3, sys.executable, "-m", "mpi4py", SCRIPT)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found.pop("lost") == found.pop("twice") == MISSING
    assert len(found) == 49
    assert [name for name, right in found.items() if not right] == []


@pytest.mark.parametrize(("n", "size"), [(0, 3), (2, 3), (10, 1), (10**9, 1024), (2**31 + 5, 7)])
def test_every_id_is_in_one_slice_of_nearly_equal_ones(n: int, size: int) -> None:
    bounds = distribution.bounds(n, size)
    assert bounds[0] == 0
    assert bounds[-1] == n
    assert set(np.diff(bounds).tolist()) <= {n // size, -(-n // size)}


def test_a_sum_of_one_block_has_the_bits_of_numpy_and_one_of_several_those_of_its_blocks() -> None:
    rows = np.random.default_rng(1).normal(size=3 * distribution.BLOCK // 2)
    one = rows[: distribution.BLOCK]
    assert SERIAL.total(one) == np.sum(one)
    assert SERIAL.total(rows) == np.sum(one) + np.sum(rows[distribution.BLOCK :])
    assert SERIAL.total(np.zeros((0, 2))).tolist() == [0.0, 0.0]


def test_blocks_of_ids_begin_at_multiples_of_their_length() -> None:
    block = distribution.BLOCK
    found = list(distribution.blocks(range(block - 1, 2 * block + 1)))
    assert [(each.start, each.stop) for each in found] == [
        (block - 1, block), (block, 2 * block), (2 * block, 2 * block + 1),
    ]  # fmt: skip
    assert list(distribution.blocks(range(0))) == []


def test_a_disk_that_is_missing_is_an_error_in_one_process_too() -> None:
    with pytest.raises(distribution.EngineError, match=MISSING):
        SERIAL.by_id(3, np.array([0, 1, 1]), [])


def test_the_nth_smallest_value_of_one_process_is_that_of_the_sorted_array() -> None:
    values = np.array([0.0, 0.0, 5e-324, 1.0, 2.5, 2.5, 1e300])
    assert SERIAL.nth_smallest(values, [7, 1, 3, 4, 8, 2, 5]) == [1e300, 0.0, 5e-324, 1.0, np.inf, 0.0, 2.5]
    assert SERIAL.nth_smallest(values[:0], [1]) == [np.inf]
    assert SERIAL.nth_smallest(values, []) == []
