"""Sheared boxes in case files, trajectories and pictures."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.cases import MakeCase, case_text

from ifrdem.case import file as case_file
from ifrdem.case import starts
from ifrdem.case.estimate import RunEstimate
from ifrdem.case.gas import CaseGas
from ifrdem.cli.main import main
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.plots import run
from ifrdem.theory.sheared_gas import steady_state
from ifrdem.trajectory.reader import Trajectory

ROOT = Path(__file__).parents[2]
CASE = case_text({
    "run.name": "flow", "run.seed": 3, "run.t_end": 6.0, "box.packing_fraction": 0.1,
    "box.shear_rate": 0.8, "material[0].name": "m", "material[0].e_n": 0.87, "material[0].e_t": -0.88,
    "material[0].mu": 0.21, "species[0].name": "s", "species[0].number": 300, "species[0].material": "m",
    "species[0].mass": 2.0,
    "output": {
        "frames": 6, "fields": ["position", "velocity", "angular_velocity", "collisions", "image"],
    },
})  # fmt: skip
STEADY = steady_state(IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21), 2.0, 0.5, 2.0, 0.1, 0.8) or (0.0, 0.0)


@pytest.fixture
def flow(toml: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the case above, as the present one."""
    monkeypatch.chdir(toml.parent)
    return toml.parent


@pytest.mark.full
def test_a_run_keeps_the_ledger_and_shows_what_the_flow_put_in(
    flow: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["run", "flow.toml", "--no-picture"]) == 0
    assert re.search(r"the flow put in [\d.]+, collisions dissipated [\d.]+", capsys.readouterr().out)
    with Trajectory("flow.h5") as trajectory:
        totals = {name: values[:] for name, values in trajectory.observables.items()}
        assert trajectory.box.shear_rate == 0.8
        first, last = trajectory[0], trajectory[-1]
        # Lab velocities are stored; temperatures are peculiar.
        assert np.polyfit(first.position[:, 1], first.velocity[:, 0], 1)[0] == pytest.approx(0.8, rel=0.1)
        for frame in (first, last):
            mean_square = np.mean(np.sum(frame.peculiar_velocity**2, axis=1))  # T = m v^2 / 2, m = 2
            assert mean_square == pytest.approx(totals["temperature"][frame.index], rel=1e-5)
        travelled = trajectory.box.unwrap(last.position, last.image, last.time) - first.position
        assert np.abs(travelled[:, 0]).max() > trajectory.box.lengths[0]
    assert totals["temperature"][0] == pytest.approx(1.0, rel=0.01)  # m speed_rms^2 / 2
    assert np.all(np.diff(totals["dissipated_energy"]) > 0.0)
    begin = totals["energy"][0]
    np.testing.assert_allclose(
        totals["energy"] + totals["dissipated_energy"], begin + totals["energy_input"], rtol=1e-12
    )
    assert totals["energy_input"][-1] > begin
    figures: list[Figure] = []
    monkeypatch.setattr(run, "save", lambda figure, path: figures.append(figure))
    run.sheared("flow.h5", "flow.png")
    upper, lower, profile = figures[0].axes[:3]
    for axes, values in ((upper, STEADY), (lower, [STEADY[1] / STEADY[0]])):
        level = [line.get_ydata()[0] for line in axes.lines if [*line.get_xdata()] == [0, 1]]
        np.testing.assert_allclose(level, values, rtol=1e-10)
    imposed = next(line for line in profile.lines if line.get_linestyle() == "-")
    slope = np.diff(imposed.get_xdata()) / np.diff(imposed.get_ydata())
    np.testing.assert_allclose(slope, 0.8, rtol=1e-12)
    measured = next(line for line in profile.lines if line.get_linestyle() == "None")
    assert np.polyfit(measured.get_ydata(), measured.get_xdata(), 1)[0] == pytest.approx(0.8, rel=0.15)


def test_a_frame_of_a_sheared_box_starts_only_a_run_with_the_same_flow_and_clock(
    flow: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "flow.toml", "--no-picture", "--set", "run.t_end=0.1"]) == 0
    Path("again.toml").write_text(CASE + '[start]\npositions = "flow.h5"\n')
    capsys.readouterr()
    assert main(["check", "again.toml"]) == 0
    assert "from t = 0.1, " in capsys.readouterr().out
    for change, says in (
        ("box.shear_rate=0.7", r"its box is sheared \(box\.shear_rate = 0\.8\), .* not 0\.7"),
        ("box.shear_rate=", r"its box is sheared \(box\.shear_rate = 0\.8\), .* not 0"),
        ("start.time=0.05", r"start\.time = 0\.05: the images above and below are where .* by t = 0\.1"),
    ):
        assert main(["check", "again.toml", "--set", change]) == 2
        assert re.search(rf'start.positions = "flow.h5": {says}', capsys.readouterr().err), change


def test_check_predicts_a_sheared_gas(flow: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "flow.toml"]) == 0
    shown = capsys.readouterr().out
    assert ", sheared at the rate 0.8, reduced units" in shown
    assert re.search(
        rf"kinetic theory: T +{STEADY[0]:.4g}\n.*kinetic theory: T_rot +{STEADY[1]:.4g}\n", shown
    )
    assert "at most" not in shown  # the flow raises the rate of collisions
    assert main(["check", "flow.toml", "--set", "box.shear_rates=1"]) == 2
    assert "did you mean 'shear_rate'" in capsys.readouterr().err
    # Also where nothing moves but the flow.
    assert main(["check", "flow.toml", "--set", "species[0].speed_rms=0", "--set", "run.t_end=", "--set",
                 "run.collisions_per_disk=5"]) == 0  # fmt: skip


def test_velocities_of_an_unsheared_start_are_relative_to_the_flow(flow: Path, case: MakeCase) -> None:
    """A gas that another run has mixed is sheared from now on."""
    assert main(["run", "flow.toml", "--no-picture", "--set", "box.shear_rate=0", "--set", "run.t_end=0.1",
                 "--set", "output.precision=f64"]) == 0  # fmt: skip
    changes = {"species[0].speed_rms": None, "start.positions": "flow.h5", "start.motion": True}
    with Trajectory("flow.h5") as trajectory:
        lengths, last = trajectory.box.lengths, trajectory[-1]
        gas = CaseGas.from_case(case(changes))
        state = starts.start(gas)
        np.testing.assert_allclose(
            state.velocity[:, 0],
            last.velocity[:, 0] + 0.8 * (last.position[:, 1] - lengths[1] / 2),
            rtol=1e-12,
        )
        speed = np.sqrt(np.mean(np.sum(last.velocity**2, axis=1)))
        assert gas.species[0].speed_rms == pytest.approx(speed, rel=1e-9)


def test_the_shipped_case_is_in_order() -> None:
    case = case_file.read(ROOT / "cases" / "shear.toml").case
    estimate = RunEstimate.of(CaseGas.from_case(case))
    assert estimate.steady_state is not None
    T, T_rot = estimate.steady_state
    # By Monte Carlo of Enskog's equation T is 2.12e-4 and theta 0.325; the theory of Gaussians is 4 % off.
    assert (T, T_rot / T) == pytest.approx((2.12e-4, 0.325), rel=0.05)
    assert json.loads(case.model_dump_json())["box"]["shear_rate"] == 5.0
