"""Kinds of disks of a gas on ranks: all if they are few, else those with extremes, however ranks divide the disks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from ifrdem import InputError
from ifrdem.model.state import MOST_KINDS, kinds_among, merge_kinds, merge_species, species_in, unlike


def columns_of(n: int) -> list[np.ndarray]:
    """Masses, radii of two sizes, k and materials of n disks, some of them immovable, some alike."""
    rng = np.random.default_rng(n)
    radius = np.where(rng.random(n) < 0.1, rng.uniform(0.75, 2.5, n), rng.uniform(0.2, 0.33, n)).round(4)
    mass = np.where(rng.random(n) < 0.01, np.inf, rng.uniform(0.5, 1.5, n).round(1))
    return [mass, radius, rng.choice([1.0, 2.0], n), rng.integers(0, 3, n).astype(np.int32)]


def split(columns: list[np.ndarray], size: int) -> list[list[np.ndarray]]:
    owner = np.random.default_rng(size).integers(0, size, len(columns[0]))
    return [[column[owner == rank] for column in columns] for rank in range(size)]


@pytest.mark.parametrize("n", [0, 7, MOST_KINDS + 200, 30_000])
def test_kinds_do_not_depend_on_how_disks_are_divided(n: int) -> None:
    """Kinds of the parts, merged, are those of the whole, and so is the verdict that these are all."""
    columns = columns_of(n)
    rows, every = kinds_among(columns)
    assert every == (n < 1000)
    for size in (1, 2, 5):
        found, same = merge_kinds([kinds_among(part) for part in split(columns, size)])
        assert same == every
        assert [each.tobytes() for each in found] == [each.tobytes() for each in rows]


@pytest.mark.parametrize("bounds", [(0, 10), (0, 3, 10), (0, 0, 5, 5, 7, 10)])
def test_species_of_slices_are_those_of_all_disks_together(bounds: tuple[int, ...]) -> None:
    labels = "aaaaabbccc"
    species = {"a": 5, "b": 2, "c": 3}
    ends = list(itertools.pairwise(bounds))
    slices = [species_in(species, range(*each)) for each in ends]
    for each, (first, last) in zip(slices, ends, strict=True):
        assert each == {name: labels[first:last].count(name) for name in species}
    assert merge_species(slices) == species
    assert merge_species([{}, {}]) == {}


@pytest.mark.parametrize("found", [
    [{"a": 2, "b": 2}, {"a": 1, "b": 3}],  # ids 0, 1, 4 and 2, 3, 5, 6, 7
    [{"a": 2}, {"b": 3}],
    [{"a": 2}, {}],
])  # fmt: skip
def test_species_that_are_not_one_range_of_ids_are_refused(found: list[dict[str, int]]) -> None:
    with pytest.raises(InputError, match=r"species = .*: must be "):
        merge_species(found)


def test_extremes_of_kinds_give_the_verdict_of_all_kinds() -> None:
    """Ends of all that units are judged by, masses of each material and k, and the gap between radii."""
    from ifrdem.simulation.windows.tiling import split_of

    columns = columns_of(30_000)
    rows, every = kinds_among(columns)
    assert not every
    assert len(rows[0]) < 500
    assert {tuple(row) for row in zip(*rows, strict=True)} <= {
        tuple(row) for row in zip(*columns, strict=True)
    }

    def ends(m: np.ndarray, R: np.ndarray, k: np.ndarray, material: np.ndarray) -> list[float]:
        movable = np.isfinite(m)
        found = [float(R.min()), float(R.max()), float(len(np.unique(movable)))]
        for a in np.unique(material):
            for one in np.unique(k):
                own = (material == a) & (k == one)
                found += [float(m[own].min()), float(m[own].max())]
                own &= movable
                for formed in (m, R, k / m / R, k / m / R / R):
                    found += [float(formed[own].min()), float(formed[own].max())]
        return found

    # k/m/R of the largest m R is the least up to its rounding.
    assert ends(*rows) == pytest.approx(ends(*columns), rel=1e-15)
    assert split_of(rows[1]) == split_of(columns[1]) == columns[1][columns[1] < 0.5].max()


def test_few_kinds_are_all_known_of_many_disks() -> None:
    columns = [np.resize(column, 50_000) for column in columns_of(MOST_KINDS)]
    rows, every = kinds_among(columns)
    assert every
    assert [each.tolist() for each in rows] == [each.tolist() for each in unlike(columns)]
