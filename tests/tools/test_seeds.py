"""Random numbers of blocks of ids, and random orders of many things."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem.mpi import distribution
from ifrdem.tools import seeds


def normal(random: np.random.Generator, count: int) -> np.ndarray:
    return random.standard_normal((count, 2))


def test_random_numbers_of_a_disk_do_not_depend_on_the_others_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distribution, "BLOCK", 64)
    whole = seeds.drawn(3, seeds.SPINS, range(500), normal)
    assert whole.shape == (500, 2)
    assert len(np.unique(whole)) == 1000  # no block repeats another one
    for first, last in ((0, 1), (63, 65), (64, 128), (130, 450), (499, 500), (200, 200)):
        part = seeds.drawn(3, seeds.SPINS, range(first, last), normal)
        assert np.array_equal(part, whole[first:last])


def test_one_block_draws_the_numbers_of_its_stream() -> None:
    """As before there were blocks: cases of up to 262,144 disks of a species begin as they did."""
    expected = np.random.default_rng(np.random.SeedSequence(3, spawn_key=(seeds.SPINS,))).standard_normal(
        (999, 2)
    )
    assert np.array_equal(seeds.drawn(3, seeds.SPINS, range(999), normal), expected)
    order = np.random.default_rng(np.random.SeedSequence(3, spawn_key=(seeds.SITES,))).permutation(999)
    assert np.array_equal(seeds.permuted(3, seeds.SITES, 999, range(999)), order)


@pytest.mark.parametrize("n", [65, 100, 1000, 4096, 4097])
def test_a_random_order_of_many_has_each_once_and_any_part_alone(
    n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(distribution, "BLOCK", 64)
    order = seeds.permuted(3, seeds.SITES, n, range(n))
    assert np.array_equal(np.sort(order), np.arange(n))
    assert np.array_equal(seeds.permuted(3, seeds.SITES, n, range(n // 3, n // 2)), order[n // 3 : n // 2])
    assert not np.array_equal(seeds.permuted(4, seeds.SITES, n, range(n)), order)


def test_a_random_order_mixes_as_shuffling_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ways |p(i) - i| add up to (n^2 - 1)/3, with variance (n + 1)(2 n^2 + 7)/45 (Diaconis and Graham 1977, footrule).

    Descents are (n - 1)/2, with variance (n + 1)/12. Five deviations of each are allowed.
    """
    monkeypatch.setattr(distribution, "BLOCK", 64)
    n = 100_000
    for seed in range(3):
        order = seeds.permuted(seed, seeds.SITES, n, range(n))
        way = np.abs(order - np.arange(n))
        assert abs(way.mean() / n - 1.0 / 3.0) < 5.0 * np.sqrt(2.0 / 45.0 / n)
        descents = np.count_nonzero(np.diff(order) < 0)
        assert abs(descents - (n - 1) / 2.0) < 5.0 * np.sqrt((n + 1) / 12.0)
