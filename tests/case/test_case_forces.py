"""Forces in case files: allowed keys, refusals, `check`, `run`, and their picture."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.cases import MakeCase, Problems, case_text, changed

from ifrdem import forces
from ifrdem.case import file as case_file
from ifrdem.case.case import CaseSections, Force
from ifrdem.case.estimate import RunEstimate
from ifrdem.case.gas import CaseGas
from ifrdem.case.messages import kind_of, models_in
from ifrdem.cli.main import main
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.plots import run
from ifrdem.theory.driven_gas import Driving, steady_state
from ifrdem.trajectory.reader import Trajectory

ROOT = Path(__file__).parents[2]

CASE = case_text({
    "run.name": "kicked", "run.t_end": 2.0, "run.seed": 4, "box.packing_fraction": 0.1,
    "material[0].e_n": 0.87, "material[0].e_t": -0.88, "material[0].mu": 0.21, "species[0].number": 200,
    "species[0].mass": 2.0, "species[0].speed_rms": None,
    "force": [{"kind": "random_kicks", "step": 0.05, "power": 3.0}], "output": {"frames": 8},
})  # fmt: skip


AT_RANDOM_TIMES = ["force[0].kind=poisson_kicks", "force[0].step=", "force[0].rate=20.0"]


def test_the_case_is_in_order(problems: Problems) -> None:
    """At rest at the start, which kicks allow even where collisions end the run."""
    assert problems() == []
    assert problems("run.t_end=", "run.collisions_per_disk=5.0") == []
    (found,) = problems("run.t_end=", "run.collisions_per_disk=5.0", "force=[]")
    assert "nothing moves at the start" in found


@pytest.mark.parametrize(
    ("overrides", "key", "says"),
    [
        (["force[0].kind=random_kick"], 'force[0].kind = "random_kick"', "did you mean 'random_kicks'"),
        (["force[0].powr=1.0"], "force[0].powr = 1.0", "did you mean 'power'"),
        (["force[0].power="], "force[0]", "must have exactly one of power, diffusion; given: none"),
        (["force[0].diffusion=1.0"], "force[0]", "given: power, diffusion"),
        (["force[0].power=0"], "force[0].power = 0", "must be"),
        (["force[0].step=-1.0"], "force[0].step = -1.0", "must be"),
        (["force[0].step="], "force[0].step", "missing"),
        (
            ["force[0].rate=1.0"],
            "force[0].rate = 1",
            "requires kind = 'poisson_kicks', 'poisson_spin_kicks', 'lang",
        ),
        (
            [AT_RANDOM_TIMES[0], AT_RANDOM_TIMES[2]],
            "force[0].step = 0.05",
            "requires kind = 'random_kicks', ",
        ),
        ([*AT_RANDOM_TIMES, "force[0].rate=0.0"], "force[0].rate = 0", "must be"),
        (
            ["force[0].quadratic=1.0"],
            "force[0].quadratic = 1",
            "requires kind = 'drag', not with 'random_kicks'",
        ),
        (
            ["force[0].kind=drag", "force[0].power="],
            "force[0]",
            "at least one of rate, quadratic, spin_rate must be above 0",
        ),
        (
            ["force[0].kind=langevin", "force[0].power=", "force[0].rate=1.0"],
            "force[0]",
            "missing: of the heat bath",
        ),
        (
            ["force[0].step=5.0"],
            "force[0].step = 5",
            "must have its middle, when the force acts, before run.t_end = 2",
        ),
        (
            ["species[0].number=1", "box.lengths=[9.0, 9.0]", "box.packing_fraction="],
            "force[0].kind",
            "2 disks",
        ),
        (
            ["force[0].kind=rescale", "force[0].power=", "force[0].temperature=0.0"],
            "force[0]",
            "temperature = 0.0: must be",
        ),
    ],
)
def test_a_wrong_force_is_named_with_what_is_allowed(
    problems: Problems, overrides: list[str], key: str, says: str
) -> None:
    found = problems(*overrides)
    assert len(found) == 1, found
    assert found[0].startswith(key)
    assert re.search(says, found[0])


def test_mistakes_of_a_force_come_with_all_others(problems: Problems) -> None:
    found = problems(
        "force[0].kind=drag", "force[0].power=", "force[0].step=x", "run.sede=1", "material[0].e_n=2.0"
    )
    assert {line.split(" ")[0].rstrip(":") for line in found} == {
        "run.sede",
        "material[0].e_n",
        "force[0]",
        "force[0].step",
    }


def test_every_kind_of_force_reaches_its_class() -> None:
    given = {
        "random_kicks": ({"diffusion": 0.5}, forces.RandomKicks(0.1, diffusion=0.5)),
        "poisson_kicks": ({"rate": 3.0, "power": 0.5}, forces.PoissonKicks(3.0, power=0.5)),
        "spin_kicks": ({"power": 0.5}, forces.SpinKicks(0.1, power=0.5)),
        "poisson_spin_kicks": ({"rate": 3.0, "power": 0.5}, forces.PoissonSpinKicks(3.0, power=0.5)),
        "langevin": (
            {"temperature": 1.0, "spin_temperature": 2.0, "spin_rate": 0.5},
            forces.Langevin(0.1, temperature=1.0, spin_temperature=2.0, spin_rate=0.5),
        ),
        "drag": ({"rate": 0.1, "quadratic": 0.2}, forces.Drag(0.1, rate=0.1, quadratic=0.2)),
        "rescale": ({"energy": 2.0}, forces.Rescale(0.1, energy=2.0)),
        "table_friction": ({"mu": 0.2, "gravity": 2.0}, forces.TableFriction(0.1, mu=0.2, gravity=2.0)),
    }
    assert given.keys() == {kind_of(each) for each in models_in(Force)}
    raw = changed(text=CASE)
    raw["force"] = [
        {"kind": kind} | ({} if "poisson" in kind else {"step": 0.1}) | keys
        for kind, (keys, _) in given.items()
    ]
    made = [each.made() for each in CaseSections.model_validate(raw).force]
    for one, (_, other) in zip(made, given.values(), strict=True):
        assert type(one) is type(other)
        assert (one.step, one.values) == (other.step, other.values)


def test_kicks_at_random_times_have_a_rate_in_place_of_a_step(problems: Problems, case: MakeCase) -> None:
    raw = changed(*AT_RANDOM_TIMES, "force[0].rate=25.0", text=CASE)
    raw["force"].append({"kind": "poisson_spin_kicks", "rate": 3.0, "diffusion": 0.5})
    made = CaseSections.model_validate(raw)
    made = [each.made() for each in made.force]
    assert [repr(each) for each in made] == [
        "<PoissonKicks: rate 25, power 3, diffusion 0>",
        "<PoissonSpinKicks: rate 3, power 0, diffusion 0.5>",
    ]
    # The same power as in steps: theory has the same steady state.
    one, other = (RunEstimate.of(CaseGas.from_case(case(*more)))
                  for more in ([], [*AT_RANDOM_TIMES, "force[0].rate=25.0"]))  # fmt: skip
    assert one.steady_state == other.steady_state is not None
    assert other.force_steps == {"at random times": {0.04: pytest.approx(50.0)}}
    assert problems(*AT_RANDOM_TIMES, "species[0].number=1", "box.lengths=[9.0, 9.0]",
                    "box.packing_fraction=") == []  # fmt: skip


@pytest.mark.full
def test_a_run_with_a_rate_records_it_and_keeps_its_ledger(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("kicked.toml").write_text(CASE)
    sets = [word for each in AT_RANDOM_TIMES for word in ("--set", each)]
    assert main(["run", "kicked.toml", "--no-picture", *sets]) == 0
    with Trajectory("kicked.h5") as whole:
        assert json.loads(str(whole.parameters["forces"])) == [
            {"kind": "poisson_kicks", "power": 3.0, "rate": 20.0}
        ]
        totals = {name: values[:] for name, values in whole.observables.items()}
    # As in steps, and the energy of each kick scatters too: 40 of each disk, sqrt(200 x 40 x 2) 3 / 20 = 19.
    assert totals["energy_input"][-1] == pytest.approx(1200.0, abs=440.0)
    np.testing.assert_allclose(
        totals["energy"] + totals["dissipated_energy"], totals["energy_input"], rtol=1e-12
    )


def test_check_predicts_a_driven_gas(toml: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(toml), "--set", "species[0].speed_rms=2.0"]) == 0
    shown = capsys.readouterr().out
    assert re.search(
        r"force 0 +random_kicks \(power = 3\)\n +force 0: step +0\.05\n"
        r" +force 0: acts +within windows\n"
        r" +force 0: step / shortest mean free time at the start +[\d.]+\n",
        shown,
    )
    free_time = re.search(r"mean free time at the start +([\d.]+)\n", shown)
    assert free_time
    for part, warned in ((0.19, False), (0.25, True)):
        sets = ["species[0].speed_rms=2.0", f"force[0].step={part * float(free_time[1])}"]
        assert main(["check", str(toml), *(word for each in sets for word in ("--set", each))]) == 0
        err = capsys.readouterr().err
        assert ("force[0].step = " in err) == warned
    most = re.search(r"0\.25 mean free times at the start; use at most ([\d.]+) \(0\.05 mean", err)
    assert most
    assert float(most[1]) == pytest.approx(0.05 * float(free_time[1]), rel=2e-3)
    at_random = [word for each in AT_RANDOM_TIMES for word in ("--set", each)]
    assert main(["check", str(toml), *at_random]) == 0
    assert re.search(
        r"force 0 +poisson_kicks \(power = 3\)\n +force 0: mean time between two kicks of a disk +0\.05\n"
        r" +force 0: acts +within windows, on each disk at random times\n",
        capsys.readouterr().out,
    )
    T, T_rot = steady_state(IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21), 2.0, 0.5, 2.0, 0.1, Driving(power=3.0)) or (
        0,
        0,
    )
    assert re.search(rf"kinetic theory: T +{T:.4g}\n.*kinetic theory: T_rot +{T_rot:.4g}\n", shown)
    assert main(["check", str(toml), "--set", "force[0].kind=random_kick"]) == 2
    assert "did you mean 'random_kicks'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("overrides", "known"),
    [
        ([], True),
        (
            ["force[0].power=", "force[0].kind=drag", "force[0].quadratic=0.1", "species[0].speed_rms=1.0"],
            False,
        ),
    ],
)
def test_collisions_are_estimated_for_drives_that_theory_covers(
    case: MakeCase, overrides: list[str], known: bool
) -> None:
    made = case(*overrides)
    estimate = RunEstimate.of(CaseGas.from_case(made))
    assert np.isfinite(estimate.collisions) == known
    assert estimate.collisions_are == ""


@pytest.mark.full
def test_a_run_keeps_its_ledger(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("kicked.toml").write_text(CASE)
    assert main(["run", "kicked.toml"]) == 0
    assert re.search(r"forces put in [\d.]+, collisions dissipated [\d.]+", capsys.readouterr().out)
    assert Path("kicked.png").stat().st_size > 100_000
    with Trajectory("kicked.h5") as trajectory:
        totals = {name: values[:] for name, values in trajectory.observables.items()}
        assert json.loads(str(trajectory.parameters["forces"])) == [
            {"kind": "random_kicks", "step": 0.05, "power": 3.0}
        ]
    assert totals["energy"][0] == 0.0
    # 200 disks get 3 x 2 each; work on velocities of T < 3 scatters by sqrt(200 x 2 x 6 x 3) = 85 at most.
    assert totals["energy_input"][-1] == pytest.approx(1200.0, abs=425.0)
    assert np.all(np.diff(totals["dissipated_energy"]) > 0.0)
    np.testing.assert_allclose(
        totals["energy"] + totals["dissipated_energy"], totals["energy_input"], rtol=1e-12
    )


@pytest.mark.full
def test_the_picture_shows_theory_and_its_steady_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("kicked.toml").write_text(CASE)
    assert main(["run", "kicked.toml", "--no-picture"]) == 0
    figures: list[Figure] = []
    monkeypatch.setattr(run, "save", lambda figure, path: figures.append(figure))
    run.driven("kicked.h5", "kicked.png")
    upper, lower = figures[0].axes[:2]
    T, T_rot = steady_state(IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21), 2.0, 0.5, 2.0, 0.1, Driving(power=3.0)) or (
        0,
        0,
    )
    for axes, values in ((upper, [T, T_rot]), (lower, [T_rot / T])):
        level = [line.get_ydata()[0] for line in axes.lines if [*line.get_xdata()] == [0, 1]]
        np.testing.assert_allclose(level, values, rtol=1e-10)
    dashed = next(line for line in upper.lines if line.get_marker() == "None" and len(line.get_xdata()) > 2)
    # At first the kicks alone: T = power t.
    assert dashed.get_ydata()[1] == pytest.approx(3.0 * dashed.get_xdata()[1], rel=0.02)


def test_the_shipped_cases_are_in_order() -> None:
    driven = case_file.read(ROOT / "cases" / "driven.toml").case
    estimate = RunEstimate.of(CaseGas.from_case(driven))
    assert estimate.steady_state == pytest.approx(
        (2.9e-4, 8.7e-5), rel=0.01
    )  # what its comments say: theta 0.30
    assert driven.force[0].step * 30.3 < 0.1  # of the collision rate in the steady state
    elastic = case_file.read(ROOT / "cases" / "elastic.toml").case
    estimate = RunEstimate.of(CaseGas.from_case(elastic))
    assert estimate.collision_rate == pytest.approx(
        [2.40], rel=2e-3
    )  # of the comments, which tests of the engine confirm
