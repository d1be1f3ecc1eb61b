"""Pairs that are near each other: those that a comparison of all finds, across periodic sides too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ifrdem.model import near
from ifrdem.model.box import Box

FINDERS = [near.near_pairs, near.near_pairs_by_trees]


def by_comparison(box: Box, reach: float, points: Any, others: Any | None) -> set[tuple[int, int]]:
    """Pairs by the differences of all coordinates, each to its nearest image."""
    apart = points[:, None] - (points if others is None else others)[None]
    for axis in (0, 1):
        if box.periodic[axis]:
            length = box.lengths[axis]
            apart[..., axis] = (apart[..., axis] + 0.5 * length) % length - 0.5 * length
    i, j = np.nonzero(np.hypot(apart[..., 0], apart[..., 1]) <= reach)
    return {(a, b) for a, b in zip(i.tolist(), j.tolist(), strict=True) if others is not None or a < b}


@pytest.mark.parametrize("find", FINDERS)
@pytest.mark.parametrize("periodic", [(True, True), (False, True), (True, False), (False, False)])
@pytest.mark.parametrize(("n", "reach"), [(0, 1.0), (1, 1.0), (5, 3.9), (300, 0.3), (300, 2.0)])
def test_it_finds_what_a_comparison_of_all_finds(
    find: near.Finder, periodic: tuple[bool, bool], n: int, reach: float
) -> None:
    box, rng = Box((8.0, 10.0), periodic), np.random.default_rng(n)
    points, others = (rng.uniform(0.0, 1.0, (m, 2)) * box.lengths for m in (n, n + n // 2))
    for second in (None, others):
        if find is near.near_pairs_by_trees and second is not None and not len(second):
            continue
        i, j = find(box, reach, points, second)
        found = set(zip(i.tolist(), j.tolist(), strict=True))
        assert len(found) == len(i)  # each once
        assert found == by_comparison(box, reach, points, second)


def test_a_few_points_far_away_cost_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """There are as many cells as points at most, however far these are from one another; and searches in parts."""
    monkeypatch.setattr(near, "AT_ONCE", 7)
    points = np.random.default_rng(1).uniform(0.0, 4.0, (50, 2))
    points[:2] = (1e15, -1e15), (1e15, -1e15 + 0.5)
    box = Box((1.0, 1.0), (False, False))
    i, j = near.near_pairs(box, 0.6, points)
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == by_comparison(box, 0.6, points, None)
    assert (0, 1) in set(zip(i.tolist(), j.tolist(), strict=True))
