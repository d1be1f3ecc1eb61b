"""Phases of shaken walls: output at phases, regions, means over a period, profiles over time and at phases."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem import analysis
from ifrdem.analysis import cycle
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.case import file as case_file
from ifrdem.case.notices import aliased
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.plots import pictures

CASE = """
run = { name = "vib", t_end = 12.5, units = "reduced", seed = 1 }
box = { lengths = [8.0, 40.0], periodic = [false, false], gravity = [0.0, -1.0], material = "m" }
material = [{ name = "m", e_n = 0.95, e_t = -1.0, mu = 0.0 }]
species = [{ name = "d", material = "m", mass = 2.0, diameter = 1.0, number = 20, speed_rms = 2.0 }]
wall = [{ shape = "line", material = "m", point = [0.0, 1.0], normal = [0.0, 1.0], motion = { kind = "sine", amplitude = 0.5, frequency = 0.8 } }]
[output]
frames_phases = 4
series_phases = 8
regions = { left = [0.0, 0.0, 3.0, 40.0], low = [0.0, 0.0, 8.0, 4.0] }
picture = false
views = false
precision = "f64"
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """20 disks on a floor that shakes for 10 periods of 1.25."""
    folder = tmp_path_factory.mktemp("cycle")
    (folder / "vib.toml").write_text(CASE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["run", "vib.toml"]) == 0
    return folder / "vib.h5"


@pytest.mark.full
def test_frames_and_rows_are_at_phases(run: Path) -> None:
    with ifrdem.Trajectory(run) as file:
        np.testing.assert_allclose(file.times, 1.25 / 4.0 * np.arange(41), rtol=1e-12)
        np.testing.assert_allclose(file.series.time, 1.25 / 8.0 * np.arange(81), rtol=1e-12)


def test_regions_and_the_centre_of_mass_are_those_of_the_disks(run: Path) -> None:
    """Against the positions, velocities and spins of each frame."""
    with ifrdem.Trajectory(run) as file:
        series, disks = file.series, file.disks
        assert series.columns("region_disks") == ("left", "low")
        counts = set()
        for i, frame in enumerate(file):
            row = int(np.argmin(np.abs(series.time - frame.time)))
            x, y = frame.position.T
            energy = 0.5 * (disks.mass * np.sum(frame.velocity**2, axis=1) + disks.inertia * frame.spin**2)
            for name, inside in (("left", x < 3.0), ("low", y < 4.0)):
                assert series[f"region_disks/{name}"][row] == inside.sum(), (i, name)
                assert series[f"region_mass/{name}"][row] == pytest.approx(2.0 * inside.sum(), rel=1e-12)
                assert series[f"region_energy/{name}"][row] == pytest.approx(energy[inside].sum(), rel=1e-10)
                counts.add(int(inside.sum()))
            np.testing.assert_allclose(series["center_of_mass"][row], frame.position.mean(axis=0), rtol=1e-12)
        assert len(counts) > 3
        found = file.to_xarray()
        assert found["series_region_disks"].sel(region="low").shape == (81,)


def test_a_run_that_is_resumed_counts_on(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ifrdem.runs import resume

    monkeypatch.chdir(tmp_path)
    Path("vib.toml").write_text(CASE)
    assert main(["run", "vib.toml", "--max-hours", "1e-9"]) == 3
    resume.resume("vib.h5", log=lambda _: None)
    with ifrdem.Trajectory("vib.h5") as file, ifrdem.Trajectory(run) as whole:
        for name in ("region_disks", "region_energy", "center_of_mass"):
            np.testing.assert_array_equal(file.series[name], whole.series[name])


def test_means_over_a_period_and_their_errors() -> None:
    """A cosine in noise of 0.5 over 400 periods: amplitude 3, errors 0.5 / 20."""
    t = np.arange(3200) / 8.0 + 5.0
    x = 3.0 * np.cos(2.0 * np.pi * (t - 5.0)) + 0.5 * np.random.default_rng(1).normal(size=3200)
    found = analysis.phase_average(t, x, period=1.0, begin=5.0)
    assert (len(found.phase), found.periods) == (8, 400)
    np.testing.assert_allclose(found.mean, 3.0 * np.cos(2.0 * np.pi * found.phase), atol=0.12)
    # The larger of two estimates, of which that of 20 blocks scatters by a sixth.
    assert 0.85 * 0.5 / 20.0 < found.error.min() <= np.median(found.error) < 1.4 * 0.5 / 20.0
    # The first harmonic of 8 phases has the noise sqrt(2 / 8) 0.5 in a period; the mean sqrt(1 / 8) 0.5.
    assert found.amplitude.mean == pytest.approx(3.0, abs=5.0 * found.amplitude.error)
    assert 0.85 < found.amplitude.error / (0.25 / 20.0) < 1.8
    assert 0.85 < found.whole.error / (0.177 / 20.0) < 1.8
    assert min(found.maximum, 1.0 - found.maximum) < 0.005
    assert cycle.default_phases(np.sort(np.random.default_rng(2).uniform(0.0, 50.0, 1000))) == cycle.PHASES
    with pytest.raises(InputError, match="0 periods have a row at each of 4 phases"):
        analysis.phase_average(np.arange(10.0), np.ones(10), period=1.0, phases=4)


def test_cycle_of_a_run(run: Path) -> None:
    with ifrdem.Trajectory(run) as file:
        found = FUNCTIONS["cycle"](file, list(range(len(file))))
        keys = {row.key or row.name for row in found.rows}
        assert {
            "period",
            "temperature_cycle_mean",
            "center_of_mass/y_amplitude",
            "region_disks/low_phase",
        } <= keys
        rows = file.series["center_of_mass"][:, 1]
        # Each of 8 phases about its middle: of those a period has, rows 8 j + k.
        for k in (0, 3, 7):
            expected = [rows[8 * j + k] for j in range(10)]
            assert found.tables[""]["center_of_mass/y"][k] == pytest.approx(np.mean(expected), rel=1e-12)
        pictures.figure(file, "cycle").draw_without_rendering()


@pytest.mark.full
def test_profiles_at_phases_and_over_time(run: Path) -> None:
    """Those of a phase are those of its frames; all disks of all frames are in the windows."""
    with ifrdem.Trajectory(run) as file:
        every = list(range(len(file)))
        found = FUNCTIONS["profiles"](file, every, axis="y", bins=5, phases=4).result
        span = tuple(found.profiles[0].edges[0][[0, -1]])
        alone = analysis.profiles(file, "y", 5, frames=every[1::4], span=span)
        np.testing.assert_array_equal(found.profiles[1].disks, alone.disks)
        np.testing.assert_array_equal(found.profiles[1].mean.temperature, alone.mean.temperature)
        assert found.places.tolist() == [0.0, 0.25, 0.5, 0.75]
        over_time = FUNCTIONS["profiles"](file, None, axis="y", bins=5, windows=3)
        assert sum(one.disks.sum() for one in over_time.result.profiles) == pytest.approx(20 * 41)
        assert over_time.tables[""]["time"].shape == (15,)
        for option in ({"windows": 3}, {"phases": 4}):
            pictures.figure(file, "profiles", axis="y", **option).draw_without_rendering()
        with pytest.raises(InputError, match="phases = 3: no frame"):
            FUNCTIONS["profiles"](file, [0, 1], axis="y", phases=3)
        with pytest.raises(InputError, match="windows: cannot be combined with phases"):
            FUNCTIONS["profiles"](file, None, windows=3, phases=4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["wall=[]"], "output.frames_phases = 4: must have walls that move or turn to and fro with one frequency; no wall"),
        (["output.regions.left=[5.0,0.0,3.0,1.0]"], "output.regions.left = [5.0, 0.0, 3.0, 1.0]: must be [x_low"),
        (["output.regions.left=[9.0,0.0,11.0,1.0]"], "lies outside of the box"),
        (["output.frames=5"], "must have at most one of frames, frames_interval, frames_collisions, frames_phases"),
    ],
)  # fmt: skip
def test_phases_and_regions_that_cannot_be(tmp_path: Path, changes: list[str], message: str) -> None:
    path = tmp_path / "vib.toml"
    path.write_text(CASE)
    with pytest.raises(InputError) as error:
        case_file.read(path, changes)
    assert message in str(error.value)


@pytest.mark.parametrize(("frames", "said"), [(240, True), (50, False), (25, False), (1000, False)])
def test_frames_that_alias_are_noticed(tmp_path: Path, frames: int, said: bool) -> None:
    """Over 10 periods 240 are 1/24 apart, over 42 they are 7/40; 50, 25 are 0.2 and 0.4 apart: 5 phases."""
    path = tmp_path / "vib.toml"
    path.write_text(CASE.replace("frames_phases = 4", f"frames = {frames}"))
    changes = ["run.t_end=52.5"] if frames == 240 else []
    assert bool(aliased(case_file.read(path, changes).gas)) is said
