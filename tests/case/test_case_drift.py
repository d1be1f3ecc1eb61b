"""Cases whose gas drifts as a whole: drawn velocities have no momentum, and that of a file is reported."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from ifrdem import Trajectory, initial
from ifrdem.analysis import catalogue
from ifrdem.case import file as case_file
from ifrdem.case import notices, starts
from ifrdem.case.case import CaseSections
from ifrdem.case.estimate import RunEstimate
from ifrdem.case.gas import CaseGas
from ifrdem.cli.main import main

PLAIN = """
[run]
name = "gas"
t_end = 4.0
seed = 4
units = "reduced"
[box]
packing_fraction = 0.2
[[material]]
name = "smooth"
e_n = 0.9
e_t = -1.0
mu = 0.0
[[species]]
name = "disks"
number = 200
material = "smooth"
mass = 1.0
radius = 0.5
speed_rms = 1.4142135623730951
[output]
frames = 20
fields = ["position", "velocity", "image"]
"""
HEAVY = """
[[species]]
name = "heavy"
number = 1
material = "smooth"
mass = 100.0
radius = 0.5
speed_rms = 1.0
"""


def gas_of(text: str, *overrides: str, folder: Path = Path()) -> CaseGas:
    raw = tomllib.loads(text)
    for assignment in overrides:
        case_file.override(raw, assignment)
    return CaseGas.from_case(CaseSections.model_validate(raw), folder)


def moving(folder: Path, drift: tuple[float, float]) -> str:
    """The plain case, from a file in which the same gas moves."""
    gas = gas_of(PLAIN)
    state = starts.start(gas)
    table = np.column_stack((state.position, state.velocity + drift, state.spin))
    np.savetxt(folder / "start.csv", table, fmt="%.17g", delimiter=",", header="x,y,vx,vy,spin", comments="")
    (side, _) = gas.box.lengths
    text = PLAIN.replace("packing_fraction = 0.2", f"lengths = [{side!r}, {side!r}]")
    return text.replace("speed_rms = 1.4142135623730951\n", '[start]\nfile = "start.csv"\n')


def test_estimates_of_a_gas_in_motion_are_those_of_the_gas_at_rest(tmp_path: Path) -> None:
    """Disks collide by their relative velocities. A drift of 20 has 400 of <v^2> = 402, or 99.50 %."""
    rest, drifting = gas_of(PLAIN), gas_of(moving(tmp_path, (20.0, 0.0)), folder=tmp_path)
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
    box = text.replace("[[material]]", 'periodic = [true, false]\nmaterial = "smooth"\n[[material]]', 1)
    shifted = box.replace("start.csv", "inside.csv")
    table = np.loadtxt(tmp_path / "start.csv", delimiter=",", skiprows=1)
    side = gas_of(text, folder=tmp_path).box.lengths[1]
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
    assert gas_of(shifted, folder=tmp_path).drift[0] == pytest.approx(20.0, abs=0.2)
    assert gas_of(shifted.replace("mu = 0.0", "mu = 0.1"), folder=tmp_path).drift == (0.0, 0.0)
    drag = '[[force]]\nkind = "drag"\nstep = 0.1\nrate = 0.1\n'
    (message,) = notices.notices(gas_of(text + drag, folder=tmp_path))
    assert "the medium of drag is at rest" in message


@pytest.mark.parametrize("shear", ["", "shear_rate = 0.3\n"])
def test_a_start_with_a_single_disk_of_a_species_has_no_momentum(shear: str) -> None:
    """Alone it can have its speed, or no momentum: of 20 disks of mass 1 and one of mass 100 it had 100 of 120.

    The energy, relative to the flow, is the given one: 20 + 50.
    """
    text = (
        PLAIN.replace("number = 200", "number = 20").replace("[[material]]", f"{shear}[[material]]", 1)
        + HEAVY
    )
    gas = gas_of(text)
    state = starts.start(gas)
    velocity, mass = state.velocity - gas.box.flow(state.position), gas.disks.mass
    assert np.abs(mass @ velocity).max() < 1e-13  # sums of 21 terms of up to 100
    assert float(np.sum(mass * np.sum(velocity**2, axis=1))) == pytest.approx(140.0, rel=1e-13)
    np.testing.assert_array_equal(starts.start(gas).velocity, state.velocity)  # as often as one asks


def test_species_of_few_disks_are_drawn_from_the_maxwellian_of_the_whole_gas() -> None:
    """An intruder of mass 50 among 300 of mass 1, all at T = 1, spins with <w^2> = 4: over seeds, means and spreads.

    Velocities are uniform on the sphere of given energy N T within the 2 (N - 1) dimensions without momentum. The
    energy of disk i is at most E = N T (1 - m / M), where it alone moves against all others, and 2 dimensions are its
    own: P(energy > x) = (1 - x / E)^(N - 2), an exponential distribution but for 1 / N, with mean E / (N - 1) = .860
    for m / M = 50 / 350. Drawn species by species it was .735 in each seed, and two disks had opposite velocities. A
    species with a temperature of its own keeps its mean: 200 of the 300 have T = 3.
    """
    intruder = PLAIN.replace("number = 200", "number = 300\nspin_rms = 1.0") + HEAVY.replace(
        "100.0", "50.0"
    ).replace("speed_rms = 1.0", "temperature = 1.0\nspin_rms = 2.0")
    energies, spins = [], []
    for seed in range(150):
        state = starts.start(gas_of(intruder, f"run.seed={seed}"))
        energies.append(25.0 * float(np.sum(state.velocity[300] ** 2)))
        spins.append(float(state.spin[300]))
    largest = 301.0 * (1.0 - 50.0 / 350.0)
    below = scipy.stats.kstest(energies, lambda x: 1.0 - (1.0 - np.asarray(x) / largest) ** 299)
    assert below.pvalue > 1e-3
    assert scipy.stats.kstest(spins, scipy.stats.norm(scale=2.0).cdf).pvalue > 1e-3
    warm = intruder.replace("number = 300", "number = 100") + HEAVY.replace("heavy", "warm").replace(
        "number = 1\n", "number = 200\n"
    ).replace("mass = 100.0", "mass = 1.0").replace("speed_rms = 1.0", "temperature = 3.0")
    found = []
    for seed in range(20):
        gas = gas_of(warm, f"run.seed={seed}")
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
    text = PLAIN.replace("number = 200", "number = 20").replace("1.4142135623730951", "0.0") + HEAVY
    gas = gas_of(text)
    velocity = starts.start(gas).velocity
    assert not np.any(velocity[:20])
    assert float(np.hypot(*velocity[20])) == pytest.approx(1.0, rel=1e-15)
    # |P| = 100 of M = 120: P^2 / 2 M over 50.
    assert gas.drift_share == pytest.approx(100.0 / 120.0, rel=1e-13)
    assert len(notices.notices(gas)) == 1


def test_a_run_of_a_gas_in_motion_is_analysed_as_the_gas_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Temperatures, Haff's time, displacements and velocities about the drift, which `run` and `analyse` print."""
    monkeypatch.chdir(tmp_path)
    Path("rest.toml").write_text(PLAIN.replace('"gas"', '"rest"'))
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
