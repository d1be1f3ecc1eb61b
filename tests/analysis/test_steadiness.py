"""Means over frames are marked if the gas changes over the frames, and only then."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.figures import texts

from ifrdem import Box, Disks, InputError, State, Trajectory, TrajectoryWriter
from ifrdem.analysis import catalogue, steadiness
from ifrdem.analysis.common import MeanValue
from ifrdem.analysis.result import NOT_STATIONARY, TOO_SHORT
from ifrdem.cli import main as cli
from ifrdem.plots import pictures

N, FRAMES = 600, 21
BOX = Box((40.0, 40.0))
SI = {"length": "m", "time": "s", "mass": "kg", "energy": "J"}
OF_FRAMES = ("velocity", "rdf", "structure-factor", "psi6")

Moved = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


def write_ideal(
    path: Path,
    *,
    place: Moved = lambda x, frame: x,
    push: Moved = lambda v, frame: v,
    times: NDArray[np.float64] | None = None,
    temperature: NDArray[np.float64] | None = None,
    **more: str,
) -> Path:
    """An ideal gas in equilibrium that flies freely, but for what is done to it; `more` parameters are stored."""
    rng = np.random.default_rng(12)
    begin, velocity = rng.random((N, 2)) * BOX.lengths, rng.normal(size=(N, 2))
    spin = rng.normal(size=N)
    times = np.linspace(0.0, 4.0, FRAMES) if times is None else times
    temperature = np.ones(len(times)) if temperature is None else temperature
    parameters: dict[str, str | int | float] = {"name": "made up", "seed": 11, **more}
    with TrajectoryWriter(
        path, Disks(N, mass=1.0, radius=0.2), BOX, parameters=parameters, units=SI
    ) as writer:
        for i, time in enumerate(times):
            position = BOX.wrap(place(begin + velocity * time, i), time)
            totals = {"temperature": temperature[i], "rotational_temperature": 1.0, "collisions": 100 * i}
            writer.write(State(position, push(velocity, i), spin, time=time), totals)
    return path


def frozen(x: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
    """From frame 15 on, nearly on a triangular lattice."""
    if frame < 15:
        return x
    row, column = np.divmod(np.arange(N), 24)
    lattice = np.stack((column + 0.5 * (row % 2), row), axis=1) * (40.0 / 24.0, 40.0 / 25.0)
    return lattice + 0.1 * np.random.default_rng(frame).normal(size=(N, 2))


def heavy(v: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
    return v if frame < 15 else v * np.linalg.norm(v, axis=1)[:, None]


@pytest.mark.full
def test_a_steady_gas_has_no_mark_and_a_changing_one_names_the_quantities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_ideal(tmp_path / "steady.h5")
    write_ideal(tmp_path / "changing.h5", place=frozen, push=heavy)
    warnings = {}
    shown = ""
    for name in ("steady", "changing"):
        assert cli.main(["analyse", f"{name}.h5", *OF_FRAMES]) == 0
        record = json.loads(Path(f"{name}-analysis/{name}.json").read_text())["analyses"]
        warnings[name] = {what: record[what]["warnings"] for what in OF_FRAMES}
        shown = capsys.readouterr().out
        assert all(record[what]["frames"] == 11 for what in OF_FRAMES)
    assert warnings["steady"] == {what: [] for what in OF_FRAMES}
    for what, quantity in (
        ("velocity", "a20 goes from "),
        ("rdf", "the mean number of neighbours within"),
        ("structure-factor", "the mean of S over the 32 longest waves"),
        ("psi6", "the mean of |psi_6|"),
    ):
        warning, *others = warnings["changing"][what]
        assert all(each.startswith(TOO_SHORT) for each in others)
        assert warning.startswith(f"{NOT_STATIONARY}: {quantity}")
        assert "from the first half of these frames to the second" in warning
        assert f"  ! {warning}\n" in shown


@pytest.mark.full
def test_a_stretch_of_a_changing_gas_that_is_steady_has_no_mark_and_one_frame_has_none(
    tmp_path: Path,
) -> None:
    with Trajectory(write_ideal(tmp_path / "run.h5", place=frozen, push=heavy)) as trajectory:
        for what in OF_FRAMES:
            of = catalogue.FUNCTIONS[what]
            assert of(trajectory, list(range(15))).warnings == []
            assert of(trajectory, [20]).warnings == []
            assert len(of(trajectory, [0, 20]).warnings) == 1


@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_temperatures_of_species_are_marked_if_their_ratio_changes(tmp_path: Path, factor: float) -> None:
    """A second species gets slower in the second half of the last 11 frames, or not; 2 % up and down in each."""

    def push(v: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
        other = (factor if frame >= 16 else 1.0) * (1.0 + 0.02 * (-1.0) ** frame)
        return v * np.where(np.arange(N) < N // 2, 1.0, other)[:, None]

    halves = json.dumps([{"name": name, "number": N // 2} for name in ("one", "other")])
    with Trajectory(write_ideal(tmp_path / "run.h5", push=push, species=halves)) as trajectory:
        warnings = catalogue.FUNCTIONS["species"](trajectory, None).warnings
    marked = any(each.startswith(f"{NOT_STATIONARY}: T of other / T of one") for each in warnings)
    assert marked == (factor != 1.0)


def test_a_temperature_that_falls_by_itself_marks_no_scaled_distribution(tmp_path: Path) -> None:
    path = write_ideal(tmp_path / "run.h5", push=lambda v, frame: v * 0.7**frame)
    with Trajectory(path) as trajectory:
        assert catalogue.FUNCTIONS["velocity"](trajectory, None).warnings == []


@pytest.mark.full(keep=("0.99",))
@pytest.mark.parametrize("memory", [0.0, 0.99])
def test_marks_of_a_steady_gas_are_as_rare_as_they_are_said_to_be(memory: float) -> None:
    """0.27 % of 1000, 2.7 at most, however much frames know of the ones before; above 9 comes by chance in 0.1 %."""
    rng = np.random.default_rng(3)
    cells = modes = 0
    for _ in range(1000):
        where = [rng.random((200, 2)) * BOX.lengths] * 10
        noise = np.zeros((10, 200))
        waves = np.zeros((10, 32), dtype=complex)
        for i in range(10):
            new, wave = rng.normal(size=200), rng.normal(size=32) + 1j * rng.normal(size=32)
            share = memory if i else 0.0
            noise[i] = share * noise[i - 1] + np.sqrt(1.0 - share**2) * new
            waves[i] = share * waves[i - 1] + np.sqrt(1.0 - share**2) * wave
        strength = np.geomspace(1.0, 100.0, 32)  # S(k) need not be flat
        cells += bool(steadiness.warnings([steadiness.between_cells("x", list(noise), where, BOX)]))
        modes += bool(
            steadiness.warnings([steadiness.between_modes("S", list(strength * np.abs(waves) ** 2))])
        )
    assert cells <= 9
    assert modes <= 9


def test_several_quantities_are_compared_at_the_level_of_one() -> None:
    """Two-sided 0.27 % of a Gaussian is 3 standard errors; a ninth of that 3.6."""
    values = [MeanValue(mean, 1.0, 10**6) for mean in (0.0, 3.3 * 2.0**0.5, 1e-3)]
    one, still = steadiness.between("x", *values[:2]), steadiness.between("y", values[0], values[2])
    assert one.t == pytest.approx(3.3)
    assert len(steadiness.warnings([one])) == 1
    assert steadiness.warnings([one, *[still] * 8]) == []


def test_autocorrelation_of_a_gas_that_heats_up_says_that_it_is_not_stationary(tmp_path: Path) -> None:
    rising = 1.5 / (FRAMES - np.arange(FRAMES)) ** 2
    with Trajectory(write_ideal(tmp_path / "heats.h5", temperature=rising)) as trajectory:
        (warning,) = catalogue.FUNCTIONS["vacf"](trajectory, None).warnings
        assert warning.startswith(
            f"{NOT_STATIONARY}: T goes from 0.003401 J to 1.5 J in that time: velocities shrink"
        )
        assert NOT_STATIONARY in texts(pictures.figure(trajectory, "vacf"))
    with Trajectory(write_ideal(tmp_path / "steady.h5")) as trajectory:
        assert catalogue.FUNCTIONS["vacf"](trajectory, None).warnings == []


def test_time_of_an_autocorrelation_is_logarithmic_where_frames_are_spaced_so(tmp_path: Path) -> None:
    log = np.concatenate(([0.0], np.geomspace(1e-3, 10.0, FRAMES - 1)))
    for times, scale in ((None, "linear"), (log, "log")):
        with Trajectory(write_ideal(tmp_path / f"{scale}.h5", times=times)) as trajectory:
            figure = pictures.figure(trajectory, "vacf")
        axes = figure.axes[0]
        assert axes.get_xscale() == scale
        drawn = np.asarray(axes.lines[0].get_xdata(), dtype=float)
        assert len(drawn) == (FRAMES if times is None else FRAMES - 1)  # no lag 0 on a logarithm


def test_tables_and_pictures_say_how_many_frames_were_averaged_and_of_which_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with Trajectory(write_ideal(tmp_path / "run.h5")) as trajectory:
        assert "\n11 frames, t = 2 to 4 s" in texts(pictures.figure(trajectory, "velocity"))
    assert cli.main(["analyse", "run.h5", "velocity", "fields", "clusters"]) == 0
    shown = capsys.readouterr().out
    assert "Sonine coefficients, 11 frames, t = 2 to 4 s\n" in shown
    assert "coarse-grained fields, 1 frame, t = 4 s\n" in shown
    assert "nearer than 0.04 m (0.1 mean diameters)" in shown


def test_counts_and_seeds_are_whole_in_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_ideal(tmp_path / "run.h5")
    assert cli.main(["analyse", "run.h5", "fields", "clusters", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    for value in (
        record["run"]["seed"],
        record["analyses"]["fields"]["values"]["cells_x"]["value"],
        record["analyses"]["clusters"]["values"]["largest_disks"]["value"],
    ):
        assert isinstance(value, int)
    assert record["run"]["seed"] == 11


def test_rounding_is_no_change(tmp_path: Path) -> None:
    """S(k) of one disk is 1 at every k, and psi_6 of a lattice is 1 wherever the lattice is: both but for rounding."""
    row, column = np.divmod(np.arange(100), 10)
    box = Box((10.0, 10.0 * np.sqrt(0.75)))
    lattice = np.stack((column + 0.5 * (row % 2), row * np.sqrt(0.75)), axis=1)
    for name, position in (("structure-factor", np.array([[1.0, 2.0]])), ("psi6", lattice)):
        path = tmp_path / f"{name}.h5"
        n = len(position)
        with TrajectoryWriter(path, Disks(n, mass=1.0, radius=0.4), box) as writer:
            for i in range(FRAMES):
                shift = i * np.array([0.37, 0.61])
                writer.write(State(box.wrap(position + shift), np.ones((n, 2)), np.zeros(n), time=0.1 * i))
        with Trajectory(path) as file:
            found = catalogue.FUNCTIONS[name](file, None)
            assert found.rows[0].value == pytest.approx(1.0, abs=1e-5)  # single precision
            assert found.warnings == []


@pytest.mark.parametrize(
    ("early", "late", "t"),
    # t = (late - early) / sqrt(0.03^2 + 0.04^2), but 0 for less than 1e-6 of the larger value.
    [(1.0, 1.5, 10.0), (-1.0, 1.0, 40.0), (-1.0, -1.5, -10.0), (1e6, 1e6 + 0.5, 0.0), (1e5, 1e5 + 0.5, 10.0)],
)
def test_a_change_counts_in_standard_errors_beyond_rounding(early: float, late: float, t: float) -> None:
    parts = MeanValue(early, 0.03, 10.0), MeanValue(late, 0.04, 5.0)
    found = steadiness.between("S", *parts)
    assert found.t == pytest.approx(t, rel=1e-9)
    # Welch and Satterthwaite: (0.03^2 + 0.04^2)^2 / (0.03^4 / 9 + 0.04^4 / 4).
    assert found.degrees == pytest.approx(0.05**4 / (0.03**4 / 9.0 + 0.04**4 / 4.0), rel=1e-9)


def test_a_kind_with_one_disk_has_no_distribution_and_the_others_have(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    velocity, spin, position = rng.normal(size=(61, 2)), rng.normal(size=61), 9.0 * rng.random((61, 2))
    radius = np.append(np.full(60, 0.1), 0.4)
    for n in (61, 1):
        path = tmp_path / f"{n}.h5"
        with TrajectoryWriter(path, Disks(n, mass=1.0, radius=radius[-n:]), BOX) as writer:
            writer.write(State(position[:n], velocity[:n], spin[:n]))
    with Trajectory(tmp_path / "61.h5") as file:
        found = catalogue.FUNCTIONS["velocity"](file, None)
    names = [row.name for row in found.rows]
    assert names[:3] == [f"{name} of material 0, R = 0.1" for name in ("a20", "a02", "a11")]
    assert all(name.endswith(" of material 0, R = 0.1") for name in names)
    # By hand: the fourth moment about the mean of the 60, over the square of the second.
    square = np.sum((velocity[:60] - velocity[:60].mean(axis=0)) ** 2, axis=1)
    expected = np.mean(square**2) / (2.0 * np.mean(square) ** 2) - 1.0
    assert found.rows[0].value == pytest.approx(expected, rel=1e-5)  # the file is in single precision
    assert any("no distribution of material 0, R = 0.4: velocity has 1 disks" in note for note in found.notes)
    with Trajectory(tmp_path / "1.h5") as file, pytest.raises(InputError, match="velocity has 1 disks"):
        catalogue.FUNCTIONS["velocity"](file, None)


@pytest.mark.parametrize(
    ("last", "stationary"),
    [(0.764, False), (0.795, False), (0.89, False), (0.91, True), (1.09, True), (1.2, False)],
)
def test_a_temperature_is_steady_if_it_changes_by_less_than_a_tenth(last: float, stationary: bool) -> None:
    """Haff's law, 1 / (1 + a t)^2, from 1 to `last` over 40 frames."""
    T = (1.0 + (last**-0.5 - 1.0) * np.linspace(0.0, 1.0, 41)) ** -2
    assert steadiness.is_stationary(T) is stationary


def test_noise_of_a_temperature_is_no_change() -> None:
    rng = np.random.default_rng(6)
    steady = [steadiness.is_stationary(1.0 + 0.3 * rng.normal(size=41)) for _ in range(300)]
    falling = [
        steadiness.is_stationary(np.linspace(1.0, 0.8, 41) + 0.03 * rng.normal(size=41)) for _ in range(300)
    ]
    assert np.mean(steady) > 0.98
    # Noise that may be correlated is not told apart from a change in every case: 1.6 % of 1000 had no mark.
    assert np.mean(falling) < 0.05


def test_a_jump_from_one_constant_to_another_is_no_chance() -> None:
    """Neither half scatters: the change had nan standard errors and no mark. Equal constants and unknown errors have none."""
    constant = [MeanValue(mean, 0.0, 10.0) for mean in (1.0, 2.0)]
    jump = steadiness.between("T", *constant)
    assert steadiness.beyond_chance([jump], 0.003) == "T goes from 1 to 2 (each is constant)"
    for late in (constant[0], MeanValue(2.0, np.nan, np.nan)):
        assert steadiness.beyond_chance([steadiness.between("T", constant[0], late)], 0.003) == ""
