"""Radii by distribution: samples have the moments of theory; keys of cases."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from support.cases import MakeCase, Problems, case_gas, case_text

from ifrdem.case import report, starts
from ifrdem.case.estimate import RunEstimate
from ifrdem.case.gas import CaseGas
from ifrdem.errors import InputError
from ifrdem.initial import radii

N = 40_000
SAMPLING = 5.0 / math.sqrt(N)  # five standard errors of a mean, in standard deviations

CASE = case_text({
    "run.seed": 3, "run.collisions_per_disk": 5.0, "run.t_end": None, "run.units": None,
    "box.packing_fraction": 0.3, "material[0].e_t": -0.9, "material[0].mu": 0.15,
    "species[0].number": 1000, "species[0].areal_density": 3.5, "species[0].mass": None,
    "species[0].radius": None,
})  # fmt: skip
LOGNORMAL = {"distribution": "lognormal", "mean": 0.01, "deviation": 0.002}


# --- the samples ------------------------------------------------------------------------------------------


def test_uniform_radii_have_the_moments_of_a_uniform_distribution() -> None:
    radius = radii.uniform(N, low=1.0, high=3.0, seed=1)
    width = 2.0 / math.sqrt(12.0)
    assert np.mean(radius) == pytest.approx(2.0, abs=SAMPLING * width)
    # <(x - 2)^2> = (high - low)^2 / 12, and its standard error is sqrt(4/5) of that over sqrt(N).
    assert np.var(radius) == pytest.approx(width**2, rel=SAMPLING)
    assert radius.min() >= 1.0
    assert radius.max() <= 3.0


def test_gaussian_radii_are_cut_off_at_three_deviations() -> None:
    radius = radii.gaussian(N, mean=2.0, deviation=0.5, seed=1)
    assert np.mean(radius) == pytest.approx(2.0, abs=SAMPLING * 0.5)
    # Cut off at +-a deviations: variance 1 - 2 a pdf(a) / (cdf(a) - cdf(-a)), a = 3: 1 - 6 * 0.0044318 / 0.9973.
    assert np.var(radius) == pytest.approx(0.25 * (1.0 - 6.0 * 0.0044318 / 0.9973), rel=2.0 * SAMPLING)
    assert 0.5 <= radius.min() < 0.7
    assert 3.3 < radius.max() <= 3.5


def test_gaussian_radii_cut_off_at_the_mean_are_half_normal() -> None:
    radius = radii.gaussian(N, mean=2.0, deviation=0.5, low=2.0, high=100.0, seed=1)
    assert radius.min() >= 2.0
    assert np.mean(radius) == pytest.approx(2.0 + 0.5 * math.sqrt(2.0 / math.pi), abs=SAMPLING * 0.5)


def test_lognormal_mean_and_deviation_are_those_of_the_radius() -> None:
    radius = radii.lognormal(N, mean=2.0, deviation=0.6, seed=1)
    s = math.sqrt(math.log(1.0 + 0.09))
    assert np.mean(radius) == pytest.approx(2.0, abs=SAMPLING * 0.6)
    assert np.std(radius) == pytest.approx(0.6, rel=3.0 * SAMPLING)  # its kurtosis is above a Gaussian's
    assert np.std(np.log(radius)) == pytest.approx(s, rel=SAMPLING)
    assert np.mean(np.log(radius)) == pytest.approx(math.log(2.0) - s**2 / 2.0, abs=SAMPLING * s)


def test_bidisperse_has_exactly_the_fraction_in_random_order() -> None:
    radius = radii.bidisperse(1001, low=1.0, high=1.4, large_fraction=0.25, seed=1)
    assert np.count_nonzero(radius == 1.4) == 250  # 250.25 rounded
    assert np.count_nonzero(radius == 1.0) == 751
    assert 80 < np.count_nonzero(radius[:500] == 1.4) < 170  # 125 +- 10


@pytest.mark.parametrize("name", radii.PARAMETERS)
def test_a_seed_decides_the_radii(name: str) -> None:
    numbers = {"mean": 2.0, "deviation": 0.5, "low": 1.0, "high": 3.0, "large_fraction": 0.3}
    parameters = {key: numbers[key] for key in radii.PARAMETERS[name][0]}
    one, again, other = (radii.sample(name, 500, seed=seed, **parameters) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(
    ("name", "parameters", "says"),
    [
        (
            "exponential",
            {},
            "distribution = 'exponential': must be one of 'uniform', 'gaussian', 'lognormal', 'bidisperse'",
        ),
        ("gausian", {}, "did you mean 'gaussian'"),
        ("uniform", {"low": 1.0}, '"uniform" requires low, high; missing: high'),
        ("uniform", {"low": 1.0, "high": 2.0, "mean": 1.5}, "not for it: mean"),
        ("uniform", {"low": 2.0, "high": 2.0}, "low = 2: must lie below high = 2"),
        ("uniform", {"low": -1.0, "high": 2.0}, "low = -1.0: must be a positive number"),
        ("gaussian", {"mean": 1.0, "deviation": 0.4}, "deviation = 0.4: above a third of mean = 1"),
        ("gaussian", {"mean": 1.0, "deviation": 0.1, "low": 1.5}, "low = 1.5: must lie below high = 1.3"),
        (
            "lognormal",
            {"mean": 1.0, "deviation": 0.1, "low": 2.0},
            "only .* of the distribution lies between",
        ),
        ("lognormal", {"mean": math.inf, "deviation": 0.1}, "mean = inf"),
        (
            "bidisperse",
            {"low": 1.0, "high": 2.0, "large_fraction": 1.5},
            "large_fraction = 1.5: must lie between",
        ),
    ],
)
def test_parameters_that_describe_no_radii_are_refused(name: str, parameters: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        radii.sample(name, 10, seed=1, **parameters)


# --- in a case --------------------------------------------------------------------------------------------


def test_packing_fraction_is_exact_and_masses_follow_the_radii(case: MakeCase) -> None:
    made = case({"species[0].radii": LOGNORMAL})
    gas = CaseGas.from_case(made)
    assert gas.disks.n == len(np.unique(gas.disks.radius)) == 1000
    covered = math.pi * math.fsum(gas.disks.radius**2) / (gas.box.lengths[0] * gas.box.lengths[1])
    assert covered == pytest.approx(0.3, rel=1e-14)  # sums of 1000 numbers
    np.testing.assert_allclose(gas.disks.mass, 3.5 * math.pi * gas.disks.radius**2, rtol=1e-15)
    np.testing.assert_array_equal(gas.disks.radius, CaseGas.from_case(made).disks.radius)
    state = starts.start(gas)
    # Maxwellian with one temperature for all: m v^2 does not depend on the mass. 333 disks each: 5 % errors.
    energy = gas.disks.mass * np.sum(state.velocity**2, axis=1)
    order = np.argsort(gas.disks.mass)
    assert np.mean(energy[order[:333]]) == pytest.approx(np.mean(energy[order[-333:]]), rel=0.3)


def test_species_with_one_distribution_draw_apart_and_another_seed_others() -> None:
    two = CASE + CASE[CASE.index("[[species]]") :].replace("coins", "more")
    both = {"species[0].radii": LOGNORMAL, "species[1].radii": LOGNORMAL}
    radius, other = (case_gas(both, f"run.seed={seed}", text=two).disks.radius for seed in (3, 4))
    assert not np.array_equal(radius[:1000], radius[1000:])
    assert not np.intersect1d(radius, other).size


def test_a_coefficient_pair_is_checked_for_the_extreme_masses_of_both_species(problems: Problems) -> None:
    # e_n = 1, e_t = -0.25, percussion centre: admissible up to e_s = e_t + (1 + k)/2 = 1, so for a mean k <= 1.5
    # (k alone enters at e_n = 1). Hoops (k = 1) with disks (k = 2): k = (m_1 2 + m_2 1)/(m_1 + m_2) of hoops m_1 and
    # disks m_2, which is 1.5 for equal masses and more where the hoop is the heavier one.
    steel = {"name": "steel", "e_n": 0.9, "e_t": -0.9, "mu": 0.1}
    disks = {
        "name": "disks",
        "number": 100,
        "material": "steel",
        "mass": 1.0,
        "radius": 0.01,
        "k": 2.0,
        "speed_rms": 1.0,
    }
    hoops = disks | {"name": "hoops", "number": 1000, "material": "coin", "k": 1.0}
    pair = {"materials": ["coin", "steel"], "e_n": 1.0, "e_t": -0.25, "mu": 0.2}
    coin = steel | {"name": "coin", "mu": 0.15}
    two = {"material": [coin, steel], "species": [hoops, disks], "pair": [pair]}
    assert problems(two) == []
    # Masses 0.76 to 1.14, on average below 1: some hoops are heavier than the disks.
    spread = {"distribution": "uniform", "low": 0.009, "high": 0.011}
    (found,) = problems(two, "species[0].mass=", "species[0].radius=", "species[0].areal_density=3000.0",
                        {"species[0].radii": spread})  # fmt: skip
    assert found.startswith("pair[0]: ")
    assert "would add energy" in found


@pytest.mark.parametrize(
    ("given", "key", "says"),
    [
        ({"distribution": "lognorml"}, "species[0].radii.distribution", "did you mean 'lognormal'"),
        ({"distribution": "lognormal", "mena": 0.01, "deviation": 0.1}, "species[0].radii.mean", "missing"),
        ({"distribution": "uniform", "low": 0.02, "high": 0.01}, "species[0].radii", "low = 0.02: must"),
        ({"distribution": "uniform", "low": -1.0, "high": 0.01}, "species[0].radii.low = -1.0", "must be a positive number"),
        (0.01, "species[0].radii = 0.01", r"must be a table \(radii = "),
    ],
)  # fmt: skip
def test_wrong_radii_are_named_with_what_is_allowed(
    problems: Problems, given: Any, key: str, says: str
) -> None:
    found = problems({"species[0].radii": given})
    assert any(line.startswith(key) and re.search(says, line) for line in found), found


def test_a_radius_and_radii_cannot_both_be_given(problems: Problems) -> None:
    (found,) = problems({"species[0].radii": LOGNORMAL, "species[0].radius": 0.01})
    assert found.startswith("species[0]: must have exactly one of radius, diameter, radii")


def test_a_misspelt_parameter_gets_the_nearest(problems: Problems) -> None:
    found = problems({"species[0].radii": LOGNORMAL | {"hihg": 1.0}})
    assert any("radii.hihg" in line and "did you mean 'high'" in line for line in found)


def test_check_prints_the_radii_their_ratio_and_what_it_costs() -> None:
    both = {"distribution": "bidisperse", "low": 0.01, "high": 0.05, "large_fraction": 0.1}
    gas = case_gas({"species[0].radii": both}, text=CASE)
    table = report.report(gas, RunEstimate.of(gas))
    rows = {row.quantity: row for row in table.rows}
    assert rows["radii"][1:] == ("0.01 to 0.05 (mean 0.014)", "m")
    assert rows["largest / smallest radius"].value == "5"
    assert rows["time of a collision, relative to equal disks"].value == "about 2.1"  # measured at 5
    assert rows["packing fraction"].value == "0.3"
    # Areal density 3.5: masses 3.5 pi R^2.
    (mass,) = (row for name, row in rows.items() if name.endswith(": mass"))
    assert mass[1:] == ("0.0010996 to 0.027489 (mean 0.0037385)", "kg")


def test_collision_rate_of_two_sizes_is_that_of_two_species() -> None:
    both = {"distribution": "bidisperse", "low": 0.01, "high": 0.02, "large_fraction": 0.5}
    rate = RunEstimate.of(case_gas({"species[0].radii": both}, text=CASE)).collision_rate[0]
    # At one temperature: speeds as R^-1, and 1/m averages to (1 + 1/4)/2 of the small disks'.
    speed = [math.sqrt(1.0 / 0.625), math.sqrt(0.25 / 0.625)]
    one = {"number": 500, "material": "coin", "areal_density": 3.5}
    small, large = (
        one | {"name": f"{radius}", "radius": radius, "speed_rms": v}
        for radius, v in zip((0.01, 0.02), speed, strict=True)
    )
    rates = RunEstimate.of(case_gas({"species": [small, large]}, text=CASE)).collision_rate
    assert rate == pytest.approx(np.mean(rates), rel=1e-12)
