"""Cases whose gas drifts as a whole: drawn velocities have no momentum, and that of a file is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from support.cases import case_gas, case_text

from ifrdem import Trajectory, initial
from ifrdem.analysis import catalogue
from ifrdem.case import notices, starts
from ifrdem.case.estimate import RunEstimate
from ifrdem.cli.main import main

CASE = case_text({
    "run.t_end": 4.0, "run.seed": 4, "material[0].e_t": -1.0, "material[0].mu": 0.0,
    "species[0].number": 200, "species[0].speed_rms": 1.4142135623730951,
    "output": {"frames": 20, "fields": ["position", "velocity", "image"]},
})  # fmt: skip
HEAVY = """
[[species]]
name = "heavy"
number = 1
material = "coin"
mass = 100.0
radius = 0.5
speed_rms = 1.0
"""


def moving(folder: Path, drift: tuple[float, float]) -> str:
    """The plain case, from a file in which the same gas moves."""
    gas = case_gas(text=CASE)
    state = starts.start(gas)
    table = np.column_stack((state.position, state.velocity + drift, state.spin))
    np.savetxt(folder / "start.csv", table, fmt="%.17g", delimiter=",", header="x,y,vx,vy,spin", comments="")
    (side, _) = gas.box.lengths
    text = CASE.replace("packing_fraction = 0.2", f"lengths = [{side!r}, {side!r}]")
    return text.replace("speed_rms = 1.4142135623730951\n", '[start]\nfile = "start.csv"\n')


def test_estimates_of_a_gas_in_motion_are_those_of_the_gas_at_rest(tmp_path: Path) -> None:
    """Disks collide by their relative velocities. A drift of 20 has 400 of <v^2> = 402, or 99.50 %."""
    rest, drifting = case_gas(text=CASE), case_gas(text=moving(tmp_path, (20.0, 0.0)), folder=tmp_path)
    expected, found = RunEstimate.of(rest), RunEstimate.of(drifting)
    # Differences of velocities of 20 are rounded by 4e-15.
    assert found.collision_rate == pytest.approx(expected.collision_rate, rel=1e-12)
    assert found.collisions == pytest.approx(expected.collisions, rel=1e-9)
    assert drifting.drift == pytest.approx((20.0, 0.0), rel=1e-13)
    assert drifting.drift_share == pytest.approx(400.0 / 402.0, rel=1e-12)
    (message,) = notices.notices(drifting)
    assert message.startswith("the whole gas drifts at (20, 0)")
    assert "99.5 % of the kinetic energy" in message
    assert notices.notices(rest) == []


def test_with_walls_or_a_medium_the_frame_of_speeds_and_temperatures_is_stated(tmp_path: Path) -> None:
    """Smooth walls leave the drift along them; rough ones stop it, and its energy becomes heat."""
    text = moving(tmp_path, (20.0, 0.0))
    box = text.replace("[[material]]", 'periodic = [true, false]\nmaterial = "coin"\n[[material]]', 1)
    shifted = box.replace("start.csv", "inside.csv")
    table = np.loadtxt(tmp_path / "start.csv", delimiter=",", skiprows=1)
    side = case_gas(text=text, folder=tmp_path).box.lengths[1]
    inside = (table[:, 1] > 0.5) & (table[:, 1] < side - 0.5)
    np.savetxt(
        tmp_path / "inside.csv",
        table[inside],
        fmt="%.17g",
        delimiter=",",
        header="x,y,vx,vy,spin",
        comments="",
    )
    shifted = shifted.replace("number = 200", f"number = {np.count_nonzero(inside)}")
    assert case_gas(text=shifted, folder=tmp_path).drift[0] == pytest.approx(20.0, abs=0.2)
    assert case_gas({"material[0].mu": 0.1}, text=shifted, folder=tmp_path).drift == (0.0, 0.0)
    drag = '[[force]]\nkind = "drag"\nstep = 0.1\nrate = 0.1\n'
    (message,) = notices.notices(case_gas(text=text + drag, folder=tmp_path))
    assert "the medium of drag is at rest" in message


@pytest.mark.parametrize("shear", [0.0, 0.3])
def test_a_start_with_a_single_disk_of_a_species_has_no_momentum(shear: float) -> None:
    """Alone it can have its speed, or no momentum: of 20 disks of mass 1 and one of mass 100 it had 100 of 120.

    The energy, relative to the flow, is the given one: 20 + 50.
    """
    gas = case_gas({"species[0].number": 20, "box.shear_rate": shear}, text=CASE + HEAVY)
    state = starts.start(gas)
    velocity, mass = state.velocity - gas.box.flow(state.position), gas.disks.mass
    assert np.abs(mass @ velocity).max() < 1e-13  # sums of 21 terms of up to 100
    assert float(np.sum(mass * np.sum(velocity**2, axis=1))) == pytest.approx(140.0, rel=1e-13)
    np.testing.assert_array_equal(starts.start(gas).velocity, state.velocity)  # as often as one asks


@pytest.mark.full
def test_species_of_few_disks_are_drawn_from_the_maxwellian_of_the_whole_gas() -> None:
    """An intruder of mass 50 among 300 of mass 1, all at T = 1, spins with <w^2> = 4: over seeds, means and spreads.

    Velocities are uniform on the sphere of given energy N T within the 2 (N - 1) dimensions without momentum. The
    energy of disk i is at most E = N T (1 - m / M), where it alone moves against all others, and 2 dimensions are its
    own: P(energy > x) = (1 - x / E)^(N - 2), an exponential distribution but for 1 / N, with mean E / (N - 1) = .860
    for m / M = 50 / 350. Drawn species by species it was .735 in each seed, and two disks had opposite velocities. A
    species with a temperature of its own keeps its mean: 200 of the 300 have T = 3.
    """
    light = {"species[0].number": 300, "species[0].spin_rms": 1.0}
    heavy = {"mass": 50.0, "speed_rms": None, "temperature": 1.0, "spin_rms": 2.0}
    intruder = case_text(
        light, {f"species[1].{key}": value for key, value in heavy.items()}, text=CASE + HEAVY
    )
    energies, spins = [], []
    for seed in range(150):
        state = starts.start(case_gas(f"run.seed={seed}", text=intruder))
        energies.append(25.0 * float(np.sum(state.velocity[300] ** 2)))
        spins.append(float(state.spin[300]))
    largest = 301.0 * (1.0 - 50.0 / 350.0)
    below = scipy.stats.kstest(energies, lambda x: 1.0 - (1.0 - np.asarray(x) / largest) ** 299)
    assert below.pvalue > 1e-3
    assert scipy.stats.kstest(spins, scipy.stats.norm(scale=2.0).cdf).pvalue > 1e-3
    warm = {"name": "warm", "number": 200, "mass": 1.0, "speed_rms": None, "temperature": 3.0}
    warm = {"species[0].number": 100} | {f"species[2].{key}": value for key, value in warm.items()}
    warm = case_text(warm, text=intruder + HEAVY)
    found = []
    for seed in range(20):
        gas = case_gas(f"run.seed={seed}", text=warm)
        state = starts.start(gas)
        energy = 0.5 * gas.disks.mass * np.sum(state.velocity**2, axis=1)
        assert np.abs(gas.disks.mass @ state.velocity).max() < 1e-12  # 301 terms
        assert energy.sum() == pytest.approx(100.0 + 1.0 + 600.0, rel=1e-12)
        found.append(energy[101:].mean())
    # The share of the 200, 6 / 7 of a fixed sum, is off by 6 / 7 x 1 / 7 x sqrt(1 / 200 + 1 / 101) = .015 a seed.
    spread = 0.015 * 701.0 / 200.0
    assert np.mean(found) == pytest.approx(3.0, abs=4.0 * spread / np.sqrt(20))
    assert 0.4 * spread < np.std(found) < 2.0 * spread


def test_a_single_disk_among_others_at_rest_keeps_its_speed_and_its_drift_is_reported() -> None:
    gas = case_gas({"species[0].number": 20, "species[0].speed_rms": 0.0}, text=CASE + HEAVY)
    velocity = starts.start(gas).velocity
    assert not np.any(velocity[:20])
    assert float(np.hypot(*velocity[20])) == pytest.approx(1.0, rel=1e-15)
    # |P| = 100 of M = 120: P^2 / 2 M over 50.
    assert gas.drift_share == pytest.approx(100.0 / 120.0, rel=1e-13)
    assert len(notices.notices(gas)) == 1


@pytest.mark.full
def test_a_run_of_a_gas_in_motion_is_analysed_as_the_gas_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Temperatures, Haff's time, displacements and velocities about the drift, which `run` and `analyse` print."""
    monkeypatch.chdir(tmp_path)
    Path("rest.toml").write_text(CASE.replace('"gas"', '"rest"'))
    Path("moving.toml").write_text(moving(tmp_path, (20.0, 0.0)).replace('"gas"', '"moving"'))
    assert main(["run", "rest.toml", "--no-picture"]) == main(["check", "moving.toml"]) == 0
    capsys.readouterr()
    assert main(["run", "moving.toml", "--no-picture"]) == 0
    printed = "".join(capsys.readouterr())
    assert printed.count("the whole gas drifts at (20, 0)") == 2  # before it, and at its end
    with Trajectory("rest.h5") as rest, Trajectory("moving.h5") as other:
        T, T_other = (each.observables["temperature"] for each in (rest, other))
        # Shifts by rounding, 1e-15, grow tenfold with each of 3 collisions of a disk and more.
        np.testing.assert_allclose(T_other, T, rtol=1e-9)
        assert T[-1] < 0.8 * T[0]
        # Rows of the series stand at the ends of windows, which are shorter: Haff's law is fitted to other points of T.
        # Positions and velocities are stored in single precision, and the drift makes them 20 times as large.
        for name, rows, rtol in (("cooling", 2, 0.02), ("msd", 2, 1e-4), ("vacf", 2, 1e-4)):
            expected, found = (catalogue.FUNCTIONS[name](each, None) for each in (rest, other))
            for one, another in zip(expected.rows[:rows], found.rows[:rows], strict=True):
                assert another.value == pytest.approx(one.value, rel=rtol, nan_ok=True), (name, one.name)
            assert any(note.startswith("the whole gas drifts at (20, 0)") for note in found.notes)
            assert not any("drift" in note for note in expected.notes)
            assert len(found.warnings) == len(expected.warnings)


def test_the_species_of_a_python_start_can_be_freed_of_momentum_together() -> None:
    """`maxwellian` of all masses at once: each disk has the temperature, and all together no momentum."""
    mass = np.append(np.ones(20), 100.0)
    velocity = initial.maxwellian(mass, temperature=1.0, seed=3)
    assert np.abs(mass @ velocity).max() < 1e-13
