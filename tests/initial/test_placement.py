"""Start positions and velocities."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from numpy.typing import NDArray

from ifrdem.errors import InputError
from ifrdem.initial.additions import _accepted
from ifrdem.initial.placement import (
    gaussian_spins,
    hexagonal_positions,
    maxwellian,
    random_positions,
)
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.mpi import distribution
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.start import cells, overlaps
from ifrdem.simulation.start.overlaps import check_no_overlap
from ifrdem.tools import progress


def pair_gaps(
    box: Box, radius: NDArray[np.float64], position: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Every pair and its distance less its radii, over the nine nearest images, one by one."""
    i, j = np.triu_indices(len(radius), k=1)
    difference = position[j] - position[i]
    images = [np.array([a, b]) * box.lengths for a in (-1, 0, 1) for b in (-1, 0, 1)]
    distance = np.min([np.hypot(*(difference + image).T) for image in images], axis=0)
    return i, j, distance - radius[i] - radius[j]


RADII = {
    "equal": lambda n, rng: np.full(n, 0.5),
    "two sizes": lambda n, rng: np.where(np.arange(n) % 5 == 0, 0.5, 0.2),
    "all different": lambda n, rng: rng.uniform(0.05, 0.5, n),
}


# --- random positions -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", RADII)
@pytest.mark.parametrize(("n", "packing_fraction"), [(2, 0.2), (40, 0.4), (400, 0.25), (400, 0.45)])
def test_random_positions_do_not_overlap(kind: str, n: int, packing_fraction: float) -> None:
    radius = RADII[kind](n, np.random.default_rng(1))
    box = Box.from_packing_fraction(radius, packing_fraction, aspect=1.7)
    position = random_positions(box, radius, seed=5)
    assert position.shape == (n, 2)
    assert np.all((position >= 0.0) & (position < box.lengths))
    assert pair_gaps(box, radius, position)[2].min() > 0.0  # gaps of 1e-9 are kept, so rounding has no say


def test_attempts_in_bulk_succeed_as_attempts_accepted() -> None:
    rng = np.random.default_rng(2)
    box = Box((12.0, 7.0))
    for _ in range(20):
        candidate = rng.random((120, 2)) * box.lengths
        radius = rng.uniform(0.2, 0.6, 40)
        owner = rng.integers(0, 40, 120)
        expected: list[int] = []
        for c in range(120):
            kept = np.array(expected, dtype=int)
            distance = np.linalg.norm(box.minimum_image(candidate[kept] - candidate[c]), axis=1)
            clear = np.all(distance > radius[owner[kept]] + radius[owner[c]])
            if clear and owner[c] not in owner[kept]:
                expected.append(c)
        assert _accepted(box, candidate, radius[owner], owner).tolist() == expected


@pytest.mark.parametrize(
    ("kind", "box", "walls", "block"),
    [
        ("two sizes", Box((18.0, 11.0)), (), 100),
        ("equal", Box((31.0, 16.0), (True, False)), (), 60),
        ("all different", Box((12.0, 21.0), (False, True)), (Wall.post((6.0, 9.0), 1.5),), 70),
        ("all different", Box((14.0, 13.0)), (), 1000),
    ],
)
def test_kernels_place_each_disk_where_numpy_does(
    kind: str, box: Box, walls: tuple[Wall, ...], block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels and NumPy give the same places, to the bit: in strips and in one, across sides, with levels of radii and between walls.

    Attempts that see no disk of a neighbouring strip, of the other level or beyond a side would place others.
    """
    monkeypatch.setattr(distribution, "BLOCK", block)
    radius = RADII[kind](300, np.random.default_rng(4))
    expected = random_positions(box, radius, seed=5, walls=walls)
    monkeypatch.setattr(cells, "FEW", 0)
    np.testing.assert_array_equal(random_positions(box, radius, seed=5, walls=walls), expected)


def test_each_part_of_a_start_reports_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Placing, the search for overlaps and the first layout: silent, they would seem to hang for minutes."""
    seen: dict[str, list[float]] = {}
    monkeypatch.setattr(progress, "Stage", lambda name: seen.setdefault(name, []).append)
    monkeypatch.setattr(distribution, "BLOCK", 100)
    monkeypatch.setattr(cells, "FEW", 0)
    disks, box = Disks(400, mass=1.0, radius=0.5), Box((60.0, 20.0))
    with progress.shown_stages():
        state = State(random_positions(box, disks.radius, seed=5), np.zeros((400, 2)), np.zeros(400))
        Simulation(disks, box, IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1), state)
    assert [*seen] == ["placing disks", "comparing disks", "laying out disks"]
    assert all(parts == sorted(parts) and len(parts) > 1 and parts[-1] == 1.0 for parts in seen.values())


def test_random_positions_are_uniform() -> None:
    # 4,000 disks in 16 strips of 250: sqrt(250 * 15/16) = 15.3 if independent; exclusion only narrows it.
    radius = np.full(4000, 0.5)
    box = Box.from_packing_fraction(radius, 0.25)
    position = random_positions(box, radius, seed=11)
    for axis in (0, 1):
        counts, _ = np.histogram(position[:, axis], bins=16, range=(0.0, box.lengths[axis]))
        assert np.abs(counts - 250).max() < 4 * 15.3


def test_a_seed_gives_the_same_positions_and_another_seed_others() -> None:
    radius = np.full(100, 0.5)
    box = Box.from_packing_fraction(radius, 0.3)
    first = random_positions(box, radius, seed=7)
    np.testing.assert_array_equal(first, random_positions(box, radius, seed=7))
    assert not np.any(np.all(first == random_positions(box, radius, seed=8), axis=1))


def test_random_positions_above_saturation_are_refused() -> None:
    radius = np.full(2000, 0.5)
    with pytest.raises(InputError, match=r"0\.5700: .* end at 0\.547; .*hexagonal"):
        random_positions(Box.from_packing_fraction(radius, 0.57), radius, seed=1)


def test_random_positions_that_fail_report_the_fraction_placed() -> None:
    radius = np.full(300, 0.5)
    with pytest.raises(InputError, match="hexagonal") as failure:
        random_positions(Box.from_packing_fraction(radius, 0.55), radius, seed=1)
    words = re.search(r"ended at ([\d.]+), with (\d+) of 300 disks placed", str(failure.value))
    assert words is not None
    reached, placed = float(words[1]), int(words[2])
    # 0.547 is the average of large packings without end; 300 disks scatter by some 1 %, and it gives up.
    assert 0.52 < reached < 0.55
    assert reached == pytest.approx(0.55 * placed / 300, abs=5e-5)  # four digits are printed


def test_small_disks_fill_the_gaps_between_large_ones_beyond_the_limit_of_equal_disks() -> None:
    radius = np.concatenate((np.full(1500, 0.05), np.full(20, 0.5)))
    box = Box.from_packing_fraction(radius, 0.6)
    position = random_positions(box, radius, seed=1)
    assert pair_gaps(box, radius, position)[2].min() > 0.0


@pytest.mark.parametrize("place", [lambda b, r: random_positions(b, r, seed=1), hexagonal_positions])
def test_no_disk_and_one_disk_are_placed(place) -> None:
    box = Box((3.0, 1.0))
    assert place(box, np.empty(0)).shape == (0, 2)
    position = place(box, np.array([0.5]))  # just as high as the box
    assert position.shape == (1, 2)
    assert np.all((position >= 0.0) & (position < box.lengths))
    with pytest.raises(InputError, match=r"disk 0 has diameter 1\.02, more than the periodic side 1"):
        place(box, np.array([0.51]))


@pytest.mark.parametrize("seed", [-1, 1.5, True, "x"])
def test_a_seed_that_is_no_whole_number_is_refused(seed) -> None:
    with pytest.raises(InputError, match="seed = "):
        random_positions(Box((9.0, 9.0)), np.array([0.5]), seed=seed)


# --- hexagonal positions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [None, 3])
@pytest.mark.parametrize("aspect", [1.0, 0.3, 2.4])
@pytest.mark.parametrize(("n", "packing_fraction"), [(2, 0.2), (3, 0.3), (7, 0.3), (50, 0.5), (401, 0.75)])
def test_hexagonal_positions_do_not_overlap(
    n: int, packing_fraction: float, aspect: float, seed: int | None
) -> None:
    radius = np.full(n, 0.5)
    box = Box.from_packing_fraction(radius, packing_fraction, aspect)
    position = hexagonal_positions(box, radius, seed=seed)
    assert position.shape == (n, 2)
    assert np.all((position >= 0.0) & (position < box.lengths))
    assert pair_gaps(box, radius, position)[2].min() > 0.0


@pytest.mark.parametrize("upright", [False, True])
def test_the_densest_packing_fits_where_the_box_suits_it(upright: bool) -> None:
    # 6 columns, 4 rows sqrt(3)/2 apart: every disk touches six others, packing fraction pi / (2 sqrt 3).
    lengths = (6.0, 4.0 * math.sqrt(3.0) / 2.0)
    box = Box(lengths[::-1] if upright else lengths)
    radius = np.full(24, 0.5)
    i, j, gap = pair_gaps(box, radius, hexagonal_positions(box, radius))
    assert np.abs(gap).min() < 1e-14
    touching = np.abs(gap) < 1e-12  # a few roundings of lengths of order 10
    assert np.bincount(np.concatenate((i[touching], j[touching]))).tolist() == [6] * 24


@pytest.mark.parametrize("lengths", [(10.3, 9.1), (5.0, 20.0), (3.2, 3.3), (40.0, 1.5)])
def test_the_refusal_of_a_lattice_names_the_number_that_fits(lengths: tuple[float, float]) -> None:
    box = Box(lengths)
    with pytest.raises(InputError, match=r"at most \d+ do") as failure:
        hexagonal_positions(box, np.full(200, 0.5))
    most = int(str(failure.value).split("at most ")[1].split()[0])
    assert hexagonal_positions(box, np.full(most, 0.5)).shape == (most, 2)
    with pytest.raises(InputError, match=f"at most {most} do"):
        hexagonal_positions(box, np.full(most + 1, 0.5))


def test_a_seed_deals_the_disks_of_a_mixture_to_the_sites_at_random() -> None:
    radius = np.where(np.arange(400) < 200, 0.5, 0.4)
    box = Box((25.0, 25.0))
    rows = hexagonal_positions(box, radius)
    shuffled = hexagonal_positions(box, radius, seed=4)
    np.testing.assert_array_equal(rows[np.lexsort(rows.T)], shuffled[np.lexsort(shuffled.T)])
    # Row by row the large disks fill the lower half; in random order half of them do: 100 +- 7 of 200.
    assert np.count_nonzero(rows[:200, 1] < 12.5) > 190
    assert 70 < np.count_nonzero(shuffled[:200, 1] < 12.5) < 130


# --- overlaps ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("few", [0, 100])
@pytest.mark.parametrize("kind", RADII)
@pytest.mark.parametrize("n", [2, 10, 60])
def test_the_worst_overlap_is_the_one_that_all_pairs_give(
    kind: str, n: int, few: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By NumPy, and by kernels, for which no disks are too few."""
    monkeypatch.setattr(cells, "FEW", few)
    rng = np.random.default_rng(n)
    for _ in range(20):
        radius = RADII[kind](n, rng) * 0.3
        box = Box((4.0, 3.0))
        position = rng.uniform(-1.0, 2.0, (n, 2)) * box.lengths  # outside the box as well
        i, j, gap = pair_gaps(box, radius, box.wrap(position))
        worst = int(np.argmin(gap))
        if gap[worst] >= 0.0:
            check_no_overlap(box, radius, position)
            continue
        with pytest.raises(InputError) as failure:
            check_no_overlap(box, radius, position)
        message = str(failure.value)
        assert message.startswith(f"disks {i[worst]} and {j[worst]} overlap by {-gap[worst]:.6g} ")
        count = np.count_nonzero(gap < 0.0)
        assert (f"{count} pairs overlap" in message) == (count > 1)


@pytest.mark.parametrize(
    "box",
    [Box((9.0, 8.0), shear_rate=0.3), Box((9.0, 8.0), (False, True)), Box.open()],
    ids=["sheared", "walls", "open"],
)
def test_kernels_find_the_overlaps_that_numpy_finds(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    """Across the leaning sides of a sheared box; none across walls, where disks may lie outside; and in an open box."""
    rng = np.random.default_rng(6)
    for time in (0.0, 1.7, 40.3):
        radius, position = rng.uniform(0.05, 0.4, 150), rng.uniform(-3.0, 11.0, (150, 2))
        messages = []
        for few in (0, 1000):
            monkeypatch.setattr(cells, "FEW", few)
            with pytest.raises(InputError, match="pairs overlap") as failure:
                check_no_overlap(box, radius, position, time=time)
            messages.append(str(failure.value))
        assert messages[0] == messages[1]
        near = []
        for few in (0, 1000):
            monkeypatch.setattr(cells, "FEW", few)
            near.append(overlaps.close_ones(box, radius, position, 0.03, time=time))
        for one, other in zip(*near, strict=True):
            np.testing.assert_array_equal(one, other)


def test_kernels_stop_where_too_many_pairs_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Places that are all alike would be n^2 / 2 pairs, more than any memory holds for a large gas."""
    monkeypatch.setattr(cells, "FEW", 0)
    monkeypatch.setattr(overlaps, "MOST_PAIRS", 5000)
    with pytest.raises(InputError, match=r"; at least 5000 pairs overlap, this one the most$"):
        check_no_overlap(Box((100.0, 100.0)), np.full(2000, 0.5), np.full((2000, 2), 3.0))


def test_disks_overlap_across_sides_and_corners() -> None:
    box = Box((10.0, 8.0))
    for first, second in (([0.1, 4.0], [9.5, 4.0]), ([5.0, 0.2], [5.0, 7.8]), ([0.2, 0.2], [9.8, 7.8])):
        with pytest.raises(InputError, match="disks 0 and 1 overlap by"):
            check_no_overlap(box, [0.5, 0.5], [first, second])


def test_touching_disks_pass_and_more_than_rounding_does_not() -> None:
    box = Box((10.0, 10.0))
    check_no_overlap(box, [1.0, 0.5], [[2.0, 2.0], [3.5 - 1e-12, 2.0]])
    with pytest.raises(InputError, match=r"overlap by 1e-06 \(distance 1\.5, sum of radii 1\.5\)$"):
        check_no_overlap(box, [1.0, 0.5], [[2.0, 2.0], [3.5 - 1e-6, 2.0]])
    check_no_overlap(box, [1.0, 0.5], [[2.0, 2.0], [3.5 - 1e-6, 2.0]], tolerance=1e-5)


@pytest.mark.parametrize(
    ("radius", "position", "message"),
    [
        ([0.5, 0.5], [[1.0, 1.0], [np.nan, 3.0]], r"position\[1\] = \[nan  3\.\]"),
        ([0.5, -0.5], [[1.0, 1.0], [3.0, 3.0]], r"radius\[1\] = -0\.5: must be a positive"),
        ([0.5, 0.5], [[1.0, 1.0]], r"position has shape \(1, 2\): must be \(2, 2\)"),
        (0.5, [[1.0, 1.0]], r"radius has shape \(\)"),
        ([2.6], [[1.0, 1.0]], "own periodic image"),
    ],
)
def test_positions_that_are_no_positions_are_refused(radius, position, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_no_overlap(Box((5.0, 5.0)), radius, position)


# --- velocities -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 1000])
def test_maxwellian_has_no_momentum_and_the_given_temperature(n: int) -> None:
    mass = np.linspace(1.0, 3.0, n)
    velocity = maxwellian(mass, temperature=2.5, seed=1)
    speed = np.sqrt(np.mean(np.sum(velocity**2, axis=1)))
    # f64: sums of n terms of either sign
    np.testing.assert_allclose(np.sum(mass[:, None] * velocity, axis=0), 0.0, atol=1e-15 * n * 3.0 * speed)
    assert np.mean(0.5 * mass * np.sum(velocity**2, axis=1)) == pytest.approx(2.5, rel=1e-14)


def test_maxwellian_has_the_given_rms_speed() -> None:
    velocity = maxwellian(np.full(1000, 1.19e-3), speed_rms=1.5, seed=1)
    assert math.sqrt(np.mean(np.sum(velocity**2, axis=1))) == pytest.approx(1.5, rel=1e-14)


def test_maxwellian_components_are_gaussian_with_variance_T_over_m() -> None:
    n = 40_000
    mass = np.where(np.arange(n) < n // 2, 1.0, 9.0)
    velocity = maxwellian(mass, temperature=2.0, seed=3)
    for m, part in ((1.0, velocity[: n // 2]), (9.0, velocity[n // 2 :])):
        for component in part.T:
            # <v^2> = T/m, <v^4> = 3 (T/m)^2; their standard errors are sqrt(2/n), sqrt(96/9/n): 1 and 2.3 %.
            assert np.mean(component**2) == pytest.approx(2.0 / m, rel=0.04)
            assert np.mean(component**4) == pytest.approx(3.0 * (2.0 / m) ** 2, rel=0.1)
        assert abs(np.mean(part[:, 0] * part[:, 1])) < 4.0 * (2.0 / m) / math.sqrt(n / 2)


def test_maxwellian_of_no_disk_and_of_one() -> None:
    assert maxwellian(np.empty(0), temperature=1.0, seed=1).shape == (0, 2)
    velocity = maxwellian(np.array([2.0]), temperature=9.0, seed=1)
    assert np.hypot(*velocity[0]) == pytest.approx(3.0, rel=1e-15)
    np.testing.assert_array_equal(maxwellian(np.ones(5), speed_rms=0.0, seed=1), np.zeros((5, 2)))


def test_disks_with_temperatures_of_their_own_share_momentum_and_energy_and_those_at_zero_stay() -> None:
    """Energies of 900 disks each are exponential: their mean is within 4 / sqrt(900) of T; the sum is exact."""
    T, mass = np.repeat([1.0, 4.0, 0.0], 900), np.repeat([1.0, 2.0, 5.0], 900)
    velocity = maxwellian(mass, temperature=T, seed=1)
    assert not np.any(velocity[1800:])
    np.testing.assert_allclose(mass @ velocity, 0.0, atol=1e-10)  # sums of 1800 terms
    energy = (0.5 * mass * np.sum(velocity**2, axis=1)).reshape(3, 900)
    assert energy.sum() == pytest.approx(4500.0, rel=1e-13)
    np.testing.assert_allclose(energy.mean(axis=1), [1.0, 4.0, 0.0], rtol=4.0 / 30.0)
    spin_rms = np.repeat([0.0, 1.0, 3.0], 10)
    spin = np.array([gaussian_spins(30, spin_rms=spin_rms, seed=seed) for seed in range(100)])
    assert not np.any(spin[:, :10])
    np.testing.assert_allclose(np.sum((spin[:, 10:] / spin_rms[10:]) ** 2, axis=1), 20.0, rtol=1e-13)
    assert np.std(spin[:, 20]) == pytest.approx(3.0, rel=0.3)  # of one disk alone: 4 / sqrt(200)


@pytest.mark.parametrize(
    "options",
    [{}, {"speed_rms": 1.0, "temperature": 1.0}, {"speed_rms": -1.0}, {"temperature": math.nan}],
)
def test_maxwellian_needs_one_size(options: dict[str, float]) -> None:
    with pytest.raises(
        InputError,
        match=r"exactly one of them must be given|must be 0 or more|must be 0, or (a number )?from 1e-50",
    ):
        maxwellian(np.ones(4), seed=1, **options)


def test_gaussian_spins_have_the_given_rms_value() -> None:
    spin = gaussian_spins(500, spin_rms=40.0, seed=2)
    assert math.sqrt(np.mean(spin**2)) == pytest.approx(40.0, rel=1e-14)
    assert abs(np.mean(spin)) < 4.0 * 40.0 / math.sqrt(500)
    assert gaussian_spins(0, spin_rms=1.0, seed=2).shape == (0,)


def test_velocities_and_spins_of_one_seed_are_independent() -> None:
    # In the order in which they are drawn: one stream for both would make spins equal velocities but for a
    # scale. 20 seeds of 20 numbers each.
    draws = [
        (
            maxwellian(np.ones(10), temperature=1.0, seed=seed).ravel(),
            gaussian_spins(20, spin_rms=1.0, seed=seed),
        )
        for seed in range(20)
    ]
    velocity, spin = np.concatenate(draws, axis=1)
    assert abs(np.corrcoef(velocity, spin)[0, 1]) < 4.0 / math.sqrt(400)
    assert abs(np.corrcoef(np.abs(velocity), np.abs(spin))[0, 1]) < 4.0 / math.sqrt(400)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("walls", [(), (Wall.container((60.0, 60.0), 58.0),)])
def test_strips_of_a_random_start_have_one_density_and_all_kinds(
    walls: tuple[Wall, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of 200 disks: no border of a strip shows, and no overlap."""
    monkeypatch.setattr(distribution, "BLOCK", 200)
    box, n = Box((120.0, 120.0)), 4000
    radius = np.where(np.arange(n) < n // 2, 0.6, 0.4)
    position = np.concatenate([random_positions(box, radius, seed=seed, walls=walls) for seed in range(4)])
    for places in np.split(position, 4):
        check_no_overlap(box, radius, places)
    small = np.tile(radius < 0.5, 4)
    inside = np.hypot(*(position - 60.0).T) < 50.0 if walls else np.ones(len(position), dtype=bool)
    edges = np.linspace(10.0, 110.0, 51) if walls else np.linspace(0.0, 120.0, 61)
    for kind in (small, ~small):
        count = np.histogram(position[kind & inside, 0], edges)[0]
        x = np.clip(edges - 60.0, -50.0, 50.0)
        half = 0.5 * (x * np.sqrt(2500.0 - x * x) + 2500.0 * np.arcsin(x / 50.0))  # of a disk, left of x
        share = np.diff(half) / (half[-1] - half[0]) if walls else np.full(60, 1.0 / 60.0)
        z = (count - share * count.sum()) / np.sqrt(share * count.sum())
        # Hard disks fluctuate less than points do; a gap of one radius at a border would be 0.4 of a bin of 130.
        assert np.abs(z).max() < 4.0
        assert np.mean(z * z) < 1.3
