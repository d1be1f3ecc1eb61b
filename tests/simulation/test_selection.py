"""The number of a rank is the one that sorting all of them gives."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem.simulation import selection
from ifrdem.simulation.selection import FEW, nth_smallest

RNG = np.random.default_rng(5)
MANY = 5 * FEW
FAR = 1e30

KINDS = {
    "even": RNG.random(MANY),
    "few": RNG.random(50),
    "in order": np.sort(RNG.random(MANY)),
    "backwards": np.sort(RNG.random(MANY))[::-1],
    "much the same": RNG.integers(0, 3, MANY).astype(float),
    "all the same": np.ones(MANY),
    "with gaps": np.where(RNG.random(MANY) < 0.3, FAR, RNG.random(MANY)),
    # What the sample sees is not what there is: its numbers stand at every 97th place.
    "misleading": np.where(np.arange(MANY) % selection.EVERY == 0, 7.0, RNG.random(MANY)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_that_of_sorting(kind: str) -> None:
    values = KINDS[kind]
    before, ordered, last = values.copy(), np.sort(values), len(values)
    for rank in {1, 2, last // 7 + 1, last // 2, last - 1, last, *RNG.integers(1, last, 40).tolist()}:
        assert nth_smallest(values, rank) == ordered[rank - 1]
    assert np.array_equal(values, before)


def test_it_goes_through_few_of_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 1031 in a sample, five standard deviations are 5 sqrt(1031 / 4) = 80 at most, 16 % with both sides."""
    lengths = []
    partition = np.partition

    def counted(values, kth):  # type: ignore[no-untyped-def]
        lengths.append(len(values))
        return partition(values, kth)

    monkeypatch.setattr(np, "partition", counted)
    for rank in range(1, MANY, MANY // 20):
        nth_smallest(KINDS["even"], rank)
    assert max(lengths) < 0.25 * MANY
