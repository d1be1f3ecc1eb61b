"""Random packings by growth: as dense as random packing, without a single overlap, the same for the same seed."""

from __future__ import annotations

import math
import re
import tomllib

import numpy as np
import pytest
from numpy.typing import NDArray
from support.gases import touching

from ifrdem.case import starts
from ifrdem.case.case import CaseSections
from ifrdem.case.estimate import RunEstimate, collision_rates
from ifrdem.case.gas import CaseGas
from ifrdem.errors import InputError
from ifrdem.initial import packing, radii
from ifrdem.initial.placement import check_no_overlap
from ifrdem.model.box import Box
from ifrdem.tools.progress import Stage


def bidisperse(n: int) -> NDArray[np.float64]:
    return radii.bidisperse(n, low=0.5, high=0.7, large_fraction=0.5, seed=1)


def least_gap(box: Box, radius: NDArray[np.float64], position: NDArray[np.float64]) -> float:
    """Over all pairs, straight from the definition."""
    apart = box.minimum_image(position[:, None, :] - position[None, :, :])
    gap = np.hypot(apart[..., 0], apart[..., 1]) - (radius[:, None] + radius[None, :])
    np.fill_diagonal(gap, np.inf)
    return float(gap.min())


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    ("radius", "packing_fraction"),
    [
        (bidisperse(600), 0.2),
        (bidisperse(600), 0.7),
        (
            bidisperse(600),
            0.84,
        ),  # random close packing of this mixture is at 0.842 (doi:10.1103/PhysRevE.68.011306)
        (np.full(600, 0.5), 0.84),
        (radii.lognormal(600, mean=0.5, deviation=0.15, seed=2), 0.84),
        (radii.bidisperse(600, low=0.5, high=5.0, large_fraction=0.01, seed=1), 0.84),
    ],
    ids=["dilute", "dense", "bidisperse", "equal", "lognormal", "ratio 10"],
)
def test_growth_reaches_random_packing_without_an_overlap(
    radius: NDArray[np.float64], packing_fraction: float
) -> None:
    box = Box.from_packing_fraction(radius, packing_fraction, 1.3)
    position = packing.grown_positions(box, radius, seed=1)
    assert np.all((position >= 0.0) & (position < box.lengths))
    assert least_gap(box, radius, position) >= 0.0
    check_no_overlap(box, radius, position, tolerance=0.0)


def test_a_seed_decides_the_packing() -> None:
    radius = bidisperse(300)
    box = Box.from_packing_fraction(radius, 0.8)
    one, again, other = (packing.grown_positions(box, radius, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert np.abs(box.minimum_image(one - other)).max() > 0.5


def test_a_packing_is_disordered() -> None:
    # Sixfold bond order <exp(6 i angle)> over near pairs is 1 for a lattice, some 1/sqrt(pairs) for random directions.
    radius = bidisperse(600)
    box = Box.from_packing_fraction(radius, 0.84)
    position = packing.grown_positions(box, radius, seed=1)
    apart = box.minimum_image(position[:, None, :] - position[None, :, :])
    near = np.hypot(apart[..., 0], apart[..., 1]) < 1.05 * (radius[:, None] + radius[None, :])
    np.fill_diagonal(near, False)
    assert 3.5 < near.sum() / 600 < 5.0  # isostatic packings of disks without friction have four contacts
    angle = np.arctan2(apart[near][:, 1], apart[near][:, 0])
    assert abs(np.mean(np.exp(6j * angle))) < 0.25


def test_a_packing_fraction_that_cannot_be_reached_is_refused_with_the_one_reached() -> None:
    radius = bidisperse(300)
    box = Box.from_packing_fraction(radius, 0.88)
    with pytest.raises(InputError, match=r"packing fraction = 0\.8800: growth ended at 0\.\d+") as failure:
        packing.grown_positions(box, radius, seed=1)
    found = re.search(r"ended at (0\.\d+)", str(failure.value))
    assert found is not None
    attained = float(found[1])
    assert 0.82 < attained < 0.855  # random close packing, and what 300 disks differ from it
    packing.grown_positions(Box.from_packing_fraction(radius, attained - 0.01), radius, seed=1)


def test_no_disk_one_disk_and_too_large_ones() -> None:
    assert packing.grown_positions(Box((3.0, 3.0)), np.empty(0), seed=1).shape == (0, 2)
    assert packing.grown_positions(Box((3.0, 3.0)), [0.5], seed=1).shape == (1, 2)
    with pytest.raises(InputError, match="own periodic image"):
        packing.grown_positions(Box((3.0, 3.0)), [1.6], seed=1)
    with pytest.raises(InputError, match="cover more than the box has"):
        packing.grown_positions(Box((3.0, 3.0)), np.full(50, 0.5), seed=1)


def test_rounded_positions_are_moved_apart_by_no_more_than_rounding() -> None:
    radius = bidisperse(400)
    box = Box.from_packing_fraction(radius, 0.75)
    rounded = (
        touching(box, radius, packing.grown_positions(box, radius, seed=1))
        .astype(np.float32)
        .astype(np.float64)
    )
    assert least_gap(box, radius, rounded) < -1e-7
    moved = packing.separate(box, radius, rounded)
    assert least_gap(box, radius, moved) >= 0.0
    # Rounding of single precision: 2^-24 of a box of some 25 in each coordinate, pushed on by a few neighbours.
    assert np.abs(box.minimum_image(moved - rounded)).max() < 20.0 * 2.0**-24 * 25.0


def test_separating_leaves_disks_that_do_not_overlap_where_they_are() -> None:
    box = Box((10.0, 10.0))
    position = np.array([[1.0, 1.0], [2.0 - 1e-7, 1.0], [5.0, 5.0]])
    moved = packing.separate(box, np.full(3, 0.5), position)
    np.testing.assert_array_equal(moved[2], position[2])
    assert moved[1, 0] - moved[0, 0] >= 1.0


CASE = """
run.collisions_per_disk = 2.0
[box]
packing_fraction = 0.84
[[species]]
name = "pesetas"
coin = "1 pta"
number = 300
speed_rms = 1.0
[start]
positions = "grown"
"""


def test_a_case_starts_by_growth_and_refuses_by_key() -> None:
    raw = tomllib.loads(CASE)
    case = CaseSections.model_validate(raw)
    gas = CaseGas.from_case(case)
    check_no_overlap(gas.box, gas.disks.radius, starts.start(gas).position, tolerance=0.0)
    assert math.pi * np.sum(gas.disks.radius**2) / gas.box.area == pytest.approx(0.84, rel=1e-13)
    raw["box"]["packing_fraction"] = 0.9
    case = CaseSections.model_validate(raw)
    with pytest.raises(
        InputError,
        match=r'^start\.positions = "grown": packing fraction = 0\.9000: growth ended at',
    ):
        starts.start(CaseGas.from_case(case))


def test_a_long_stage_reports_progress(capsys: pytest.CaptureFixture[str]) -> None:
    now = iter([0.0, 4.0, 6.0, 8.0, 11.5])  # 6 s for the first fifth: 24 s are left
    stage = Stage("growth", clock=lambda: next(now))
    for part in (0.1, 0.2, 0.3, 0.4):
        stage(part)
    assert capsys.readouterr().err == "growth: 20 % done, ETA 0:24\ngrowth: 40 % done, ETA 0:17\n"


def test_growth_reports_its_progress_in_order() -> None:
    found: list[float] = []
    radius = bidisperse(200)
    packing.grown_positions(Box.from_packing_fraction(radius, 0.83), radius, seed=1, progress=found.append)
    assert found == sorted(found)
    assert found[-1] == 1.0


@pytest.mark.full
def test_a_gas_begins_to_collide_at_the_rate_of_a_mixture_at_equilibrium() -> None:
    """Enskog's rate by 16 classes of radii, on the first half collision per disk; all sizes, and either end."""
    text = CASE.replace('coin = "1 pta"', 'areal_density = 20.0\nmaterial = "smooth"').replace("300", "3000")
    raw = tomllib.loads(text.replace("0.84", "0.4"))
    raw["species"][0]["radii"] = {"distribution": "lognormal", "mean": 0.01, "deviation": 0.003}
    raw["material"] = [{"name": "smooth", "e_n": 1.0, "e_t": -1.0, "mu": 0.0}]
    case = CaseSections.model_validate(raw)
    gas = CaseGas.from_case(case)
    simulation = gas.simulation()
    simulation.run(collisions_per_disk=0.5)
    rate = 0.5 / simulation.time
    # 750 collisions: an error of 4 %; the start's own correlations add some.
    assert rate == pytest.approx(RunEstimate.of(gas).collision_rate[0], rel=0.12)
    group = gas.species[0].classes()
    rates = collision_rates(group, gas.box.area)
    order = np.argsort(gas.disks.radius)
    for disks, classes in ((order[-375:], rates[-2:]), (order[:375], rates[:2])):  # two classes of sixteen
        found = np.mean(simulation.state.collisions[disks]) / simulation.time
        assert found == pytest.approx(np.mean(classes), rel=0.2)  # some 180 collisions: 7 %
