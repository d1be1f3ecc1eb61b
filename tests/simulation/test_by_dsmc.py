"""Temperatures by DSMC in place of kinetic theory, in predictions, pictures and studies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.cases import case_text

import ifrdem
from ifrdem.analysis.gas_theory import TheoryGas, gas_of
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks
from ifrdem.plots.temperatures import theory as theory_of_picture
from ifrdem.simulation import backend, by_dsmc
from ifrdem.simulation.by_dsmc import dsmc_prediction, theory_by
from ifrdem.study.results import Results, with_theory
from ifrdem.theory import prediction

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
TIMES = [0.0, 1.0, 2.0]


@pytest.fixture(autouse=True, scope="module")
def ended() -> Iterator[None]:
    yield
    backend.stop()


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(by_dsmc, "LEAST_DISKS", 4000)


def test_a_young_mixture_cools_as_theory_says() -> None:
    """One or two collisions per disk after a Gaussian start, before cumulants count: to the noise of 2,000 disks."""
    disks = Disks(40, np.repeat([1.0, 4.0], 20), np.repeat([0.5, 1.0], 20))
    by = [of(disks, COIN, 0.2, [1.0, 3.0], [0.0, 0.5], TIMES) for of in (dsmc_prediction, prediction)]
    assert by[0].velocities == "dsmc"
    assert by[0].temperature[0] == pytest.approx(2.0, rel=1e-6)  # less that of its mean velocity
    assert by[0].species is not None
    assert by[1].species is not None
    np.testing.assert_allclose(by[0].species.temperature, by[1].species.temperature, rtol=0.04)
    np.testing.assert_allclose(by[0].rotational_temperature, by[1].rotational_temperature, rtol=0.06)
    np.testing.assert_allclose(by[0].collisions_per_disk, by[1].collisions_per_disk, rtol=0.04, atol=1e-12)


@pytest.mark.full
def test_driven_and_sheared_gases_are_followed() -> None:
    disks = Disks(100, 1.0, 0.5)
    kicks = [{"kind": "random_kicks", "power": 1.0, "step": 0.1}]
    for given in ({"forces": kicks}, {"shear_rate": 1.0}):
        found, right = (
            of(disks, COIN, 0.2, 1.0, 0.0, TIMES, **given) for of in (dsmc_prediction, prediction)
        )
        assert found.kind == right.kind
        np.testing.assert_allclose(found.temperature, right.temperature, rtol=0.06)
    with pytest.raises(InputError, match="linear ones only"):
        dsmc_prediction(disks, COIN, 0.2, 1.0, 0.0, TIMES, forces=[{"kind": "drag", "quadratic": 1.0}])
    with pytest.raises(InputError, match="nothing moves"):
        dsmc_prediction(disks, COIN, 0.2, 0.0, 0.0, TIMES)


@pytest.mark.full
def test_stresses_of_a_flow_are_those_of_dsmc() -> None:
    """Smooth disks, e_n = 0.8: anisotropic Gaussians are within 6 % of Enskog's equation (`theory.steady_flow`), and
    below it in all ratios: 20,000 disks over 40 times have N_1 = 0.308(6) for 0.297, friction 0.434(3) for 0.426."""
    disks = Disks(100, 1.0, 0.5)
    smooth = IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0)
    gas = TheoryGas(
        disks, [[smooth]], 0.1, np.array([1.2]), np.array([0.0]), [], np.zeros(100, dtype=np.int64)
    )
    closed = gas.of_flow(0.5)
    with theory_by(dsmc=True):
        found = gas.of_flow(0.5, (15.0, 40.0))
    assert {*found} == {*closed}
    for key, of in found.items():
        assert np.isnan(closed[key].error)
        assert 0.005 < of.error / of.mean < 0.05  # by 25 times, of which 3 to 8 are independent
        assert of.mean == pytest.approx(closed[key].mean, abs=4.0 * of.error)
        assert (of.mean > closed[key].mean) == (key != "viscosity")


@pytest.mark.full
def test_pictures_take_dsmc_also_of_laws_without_theory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rolling friction has no closed theory; DSMC has it. In a young gas it changes T by little."""
    monkeypatch.chdir(tmp_path)
    text = case_text({
        "run.name": "rolls", "run.collisions_per_disk": 2.0, "run.t_end": None, "species[0].number": 100,
        "material[0].rho": 0.001, "output": {"frames": 4, "picture": False},
    })  # fmt: skip
    Path("rolls.toml").write_text(text)
    assert cli.main(["run", "rolls.toml"]) == 0
    with ifrdem.Trajectory("rolls.h5") as run:
        assert theory_of_picture(run)[0] is None
        assert isinstance(gas_of(run), str)
        with theory_by(dsmc=True):
            curves, steady, text = theory_of_picture(run)
        assert gas_of(run) == "rolling friction: no kinetic theory here"  # as before
        assert curves is not None
        assert steady is None
        assert text == "DSMC (homogeneous gas)"
        T = run.observables["temperature"]
        np.testing.assert_allclose(np.interp(run.times, curves.times, curves.temperature), T, rtol=0.2)
    assert cli.main(["plot", "rolls.h5", "temperatures", "--theory", "dsmc"]) == 0
    assert Path("rolls-temperatures.png").stat().st_size > 10_000
    assert cli.main(["plot", "rolls.h5", "temperatures", "--theory", "dsmd", "--force"]) == 2


@pytest.mark.full
def test_a_study_takes_dsmc_at_each_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = case_text({
        "run.collisions_per_disk": 3.0, "run.t_end": None, "species[0].number": 60, "output": {"series": 3},
    })  # fmt: skip
    Path("few.toml").write_text(text)
    study = ifrdem.Study("few.toml", vary=["material[0].e_n=0.7,0.9"], seeds=2)
    study.run(workers=0)
    stored = Results.read(study.output)
    with theory_by(dsmc=True):
        found = with_theory(stored)
    assert found.attributes["velocities_of_theory"] == "DSMC"
    assert stored.attributes["velocities_of_theory"] == "Gaussian"
    dsmc, closed = (each.values("temperature_theory") for each in (found, stored))
    np.testing.assert_allclose(dsmc, closed, rtol=0.05)
    assert not np.array_equal(dsmc, closed)
    assert cli.main(["plot", "few-study.nc", "T", "--over", "e_n", "--theory", "dsmc"]) == 0
