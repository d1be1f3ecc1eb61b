"""Kinetic theory between the swept values of a study, of gases that are not run."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from support.cases import case_text

from ifrdem import IFRLaw, theory
from ifrdem.study.figure import AT_POINTS, draw
from ifrdem.study.lines import TheoryLine, theory_between
from ifrdem.study.results import Results
from ifrdem.study.task import Variable

FLOW: dict[str, Any] = {
    "material[0].e_n": 0.8, "material[0].e_t": -1.0, "material[0].mu": 0.0, "box.shear_rate": 0.02,
    "box.packing_fraction": 0.05, "run.collisions_per_disk": 40.0, "run.t_end": None,
}  # fmt: skip


def results(key: str, values: Any, changes: dict[str, Any], end: float = 40.0, **more: Any) -> Results:
    """Results of a study over one key, with rows at 0 to `end` collisions per disk and the quantities in `more`."""
    x, tau = key.rpartition(".")[2], np.linspace(0.0, end, 5)
    variables = {
        x: Variable((x,), np.array(values)),
        "collisions_per_disk": Variable(("collisions_per_disk",), tau),
        "time_mean": Variable((x, "collisions_per_disk"), np.tile(1e3 * tau, (len(values), 1))),
    }
    for name, value in more.items():
        variables[name] = Variable((x,), np.full(len(values), value))
    attributes = {
        "axes": json.dumps({x: [x]}),
        "keys": json.dumps({x: key}),
        "path": "gas.toml",
        "overrides": "",
    }
    return Results(variables, attributes | {"case": case_text(changes)})


@pytest.mark.full
def test_stresses_of_a_flow_over_a_coefficient_and_over_the_density() -> None:
    """`theory.steady_flow` of the gas between the points, which is no straight line."""
    for key, values, e_n_phi in (
        ("material[0].e_n", [0.7, 0.95], lambda x: (x, 0.05)),
        ("box.packing_fraction", [0.01, 0.3], lambda x: (0.8, x)),
    ):
        of = results(key, values, FLOW)
        x = key.rpartition(".")[2]
        for name, of_stress in (("stress_N_1", "normal_difference"), ("stress_friction", "friction")):
            found = theory_between(of, name, x, {})
            assert isinstance(found, TheoryLine)
            assert found.values[[0, -1]] == pytest.approx(values)
            for i in (0, 13, 40):
                e_n, phi = e_n_phi(float(found.values[i]))
                flow = theory.steady_flow(IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), 1.0, 0.5, 2.0, phi, 0.02)
                assert flow is not None
                assert found.theory[i] == pytest.approx(getattr(flow.stress, of_stress), rel=1e-9)
            straight = np.interp(found.values, values, found.theory[[0, -1]])
            assert np.abs(found.theory - straight).max() > 1e-3


def test_transport_of_elastic_disks_over_the_density() -> None:
    """Enskog's viscosity at T = m v_rms^2 / 2, which elastic disks keep."""
    elastic = FLOW | {"material[0].e_n": 1.0, "box.shear_rate": None, "species[0].speed_rms": 2.0}
    of = results("box.packing_fraction", [0.05, 0.4], elastic)
    found = theory_between(of, "transport_eta", "packing_fraction", {})
    assert isinstance(found, TheoryLine)
    expected = [theory.shear_viscosity(float(phi), 2.0, 1.0, 0.5) for phi in found.values]
    assert found.theory == pytest.approx(expected)
    kicked = elastic | {"force": [{"kind": "random_kicks", "power": 0.1, "step": 1.0}]}
    of_kicked = theory_between(
        results("box.packing_fraction", [0.05, 0.4], kicked), "transport_eta", "packing_fraction", {}
    )
    assert isinstance(of_kicked, str)
    assert "the gas is driven" in of_kicked
    assert isinstance(
        of_e_n := theory_between(results("material[0].e_n", [0.8, 0.9], elastic), "transport_eta", "e_n", {}),
        str,
    )
    assert "no theory of transport_eta" in of_e_n


def test_velocities_and_diffusion_of_smooth_disks() -> None:
    smooth = FLOW | {"box.shear_rate": None}
    of = results("material[0].e_n", [0.7, 1.0], smooth)
    for name, formula in (("velocity_a20", theory.cooling_sonine), ("msd_D_reduced", theory.self_diffusion)):
        found = theory_between(of, name, "e_n", {})
        assert isinstance(found, TheoryLine)
        assert found.theory == pytest.approx([formula(float(e_n)) for e_n in found.values])


DISKS = {"material": "coin", "number": 50, "diameter": 1.0}
MIXTURE = FLOW | {
    "box.shear_rate": None, "box.packing_fraction": 0.02,
    "species": [{"name": "light", "mass": 1.0, "speed_rms": 1.0, **DISKS}, {"name": "heavy", "mass": 4.0, "speed_rms": 0.5, **DISKS}],
}  # fmt: skip


def mixture(e_n: float) -> theory.Mixture:
    return theory.Mixture([1.0, 4.0], [0.5, 0.5], IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), 0.02)


@pytest.mark.full
def test_ratios_of_species_are_those_of_equal_cooling_rates() -> None:
    """The second half of 40 collisions per disk is steady."""
    of = results("material[0].e_n", [0.6, 0.9], MIXTURE)
    found = theory_between(of, "species_T_ratio_heavy", "e_n", {})
    assert isinstance(found, TheoryLine)
    assert np.isfinite(found.theory).all()
    T, _ = theory.mixture_cooling_ratios(mixture(0.6))
    assert found.theory[0] == pytest.approx(float(T[1] / T[0]), rel=1e-3)


@pytest.mark.full
def test_ratios_of_species_are_means_over_the_rows_of_the_analysis() -> None:
    """`analyse species` takes the second half of a gas that cools, rows 2 to 4 of 5; all rows count the same.

    Its frames begin at 0 (`analyses_from`), which is no steady window: the ratio begins at 1, and relaxes over these
    rows. With a window, which has a number of independent values, rows count from its start on.
    """
    steps = np.linspace(0.0, 200.0, 4001)
    cooling = theory.mixture_cooling(mixture(0.6), [0.5, 0.5], 0.0, steps)
    at_rows = np.interp(np.linspace(0.0, 4.0, 5), cooling.collisions_per_disk.mean(axis=1), cooling.temperature[:, 1] / cooling.temperature[:, 0])  # fmt: skip
    for start, n_eff, first in ((0.0, np.nan, 2), (0.0, 9.0, 0), (1.0, 9.0, 1)):
        of = results("material[0].e_n", [0.6, 0.9], MIXTURE, end=4.0, analyses_from=start)
        of.variables["temperature_n_eff"] = Variable(("e_n", "seed"), np.full((2, 1), n_eff))
        found = theory_between(of, "species_T_ratio_heavy", "e_n", {})
        assert isinstance(found, TheoryLine)
        assert found.theory[0] == pytest.approx(at_rows[first:].mean(), rel=1e-4)


def test_a_single_value_has_a_mark_of_theory_and_no_line() -> None:
    assert (
        theory_between(results("material[0].e_n", [0.8], FLOW), "stress_N_1", "e_n", {})
        == "e_n has one value"
    )


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"equilibrate": "{}"}, "runs begin with the ends of others"),
        ({"path": None}, "the results hold no case"),
        ({"axes": '{"e_n": ["e_n", "mu"]}'}, "e_n is not one numeric key"),
        ({}, "stress_p has no closed form between swept values"),
        ({"case": case_text({**FLOW, "material[0].rho": 0.1})}, "rolling friction"),
    ],
)
def test_where_there_is_no_line_the_reason_is_said(change: dict[str, Any], reason: str) -> None:
    of = results("material[0].e_n", [0.7, 0.9], FLOW, stress_p_mean=1.0, stress_N_1_mean=0.3, stress_p_theory_mean=1.1,
                 stress_N_1_theory_mean=0.3)  # fmt: skip
    of.attributes.update({name: value for name, value in change.items() if value is not None})
    for name, value in change.items():
        if value is None:
            del of.attributes[name]
    said: list[str] = []
    name = "stress_N_1" if change else "stress_p"
    figure = draw(of, name, "e_n", note=said.append)
    assert [line.get_gid() for line in figure.axes[0].lines].count(AT_POINTS) == 1
    (text,) = said
    assert text.startswith(f"theory of {name} stands at the swept values only: ")
    assert reason in text
