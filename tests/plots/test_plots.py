"""The picture of a cooling gas: curves agree with the file and with the theory."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.figures import assert_labels_are_apart, texts

from ifrdem import theory
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.plots import disks as plot_disks
from ifrdem.plots import pictures, run, style
from ifrdem.tools.labels import few_labels
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

SI = {"length": "m", "mass": "kg", "time": "s", "energy": "J"}
SMOOTH = {
    "law": "ifr",
    "e_n": 0.8,
    "e_t": -1.0,
    "mu": 0.0,
    "sticking": "percussion_center",
    "rho": 0.0,
    "k": 2.0,
}
MASS, RADIUS, PHI = 2.0, 0.5, 0.1


def write_relaxing(
    path: Path,
    *,
    n: int = 30,
    radius: float | np.ndarray = RADIUS,
    law: dict[str, object] | None = SMOOTH,
    units: dict[str, str] = SI,
    position: np.ndarray | None = None,
    spin: np.ndarray | None = None,
    frames: int = 11,
    k: float = 2.0,
) -> tuple[Disks, Box]:
    """A trajectory with made-up temperatures: T = 3/(1+t), T_rot = 1 - 1/(1+t)."""
    disks = Disks(n, MASS, radius, k=k)
    box = Box.from_packing_fraction(disks.radius, PHI)
    rng = np.random.default_rng(5)
    position = rng.random((n, 2)) * box.lengths if position is None else position
    spin = rng.normal(size=n) if spin is None else spin
    parameters = {"name": "made up"} | ({} if law is None else {"laws": json.dumps([[law]])})
    with TrajectoryWriter(path, disks, box, parameters=parameters, units=units) as writer:
        for time in np.arange(frames, dtype=float):
            state = State(position, np.zeros((n, 2)), spin, time=time)
            totals = {
                "temperature": 3.0 / (1.0 + time),
                "rotational_temperature": 1.0 - 1.0 / (1.0 + time),
                "collisions": int(4.5 * n * time),
            }
            writer.write(state, totals)
    return disks, box


def test_picture_is_a_png_and_nothing_else_is_left(tmp_path: Path) -> None:
    write_relaxing(tmp_path / "a.h5")
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    image = imread(tmp_path / "a.png")
    assert min(image.shape[:2]) > 1000
    assert image[..., :3].std() > 0.05  # not empty
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["a.h5", "a.png"]


def test_circles_are_the_measured_temperatures(tmp_path: Path, drawn: list[Figure]) -> None:
    write_relaxing(tmp_path / "a.h5")
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    upper, lower = drawn[0].axes[:2]
    time = np.arange(1.0, 11.0)  # time 0 has no place on a logarithmic axis
    for line, expected in ((upper.lines[0], 3.0 / (1.0 + time)), (upper.lines[1], 1.0 - 1.0 / (1.0 + time))):
        # observables are stored in 8 bytes: equal to the last bit
        np.testing.assert_array_equal(line.get_xdata(), time)
        np.testing.assert_array_equal(line.get_ydata(), expected)
    np.testing.assert_allclose(lower.lines[0].get_ydata(), time / 3.0, rtol=1e-14)  # theta, a division


def test_theory_of_smooth_disks_is_haffs_law_in_the_same_colour(tmp_path: Path, drawn: list[Figure]) -> None:
    write_relaxing(tmp_path / "a.h5")
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    upper = drawn[0].axes[0]
    dashed = [line for line in upper.lines if line.get_linestyle() == "--" and len(line.get_xdata())]
    assert [line.get_color() for line in dashed] == [line.get_color() for line in upper.lines[:2]]
    # Haff (1983): T = T0 / (1 + t/t_H)^2 with 1/t_H = (1 - e_n^2) rate / 4, at the initial collision rate
    # 8 phi g sqrt(T0/(pi m)) / sigma.
    rate = 8.0 * PHI * theory.contact_value(PHI) * math.sqrt(3.0 / (math.pi * MASS)) / (2.0 * RADIUS)
    time = np.asarray(dashed[0].get_xdata())
    haff = 3.0 / (1.0 + 0.25 * (1.0 - 0.8**2) * rate * time) ** 2
    np.testing.assert_allclose(dashed[0].get_ydata(), haff, rtol=1e-6)  # the integration has rtol 1e-10
    assert np.all(np.isnan(dashed[1].get_ydata()))  # smooth disks never spin: nothing on a logarithmic axis
    assert "kinetic theory (homogeneous gas)" in texts(drawn[0])


def test_laws_are_checked_for_the_disks_that_have_them(tmp_path: Path, drawn: list[Figure]) -> None:
    """e_n = 1 requires e_t + (1 + k) / 2 <= 1 of the percussion-centre law: -0.3 is right for hoops, k = 1, only."""
    law = {**SMOOTH, "e_n": 1.0, "e_t": -0.3, "mu": 0.2, "k": 1.0}
    write_relaxing(tmp_path / "a.h5", law=law, k=1.0)
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert "kinetic theory (homogeneous gas)" in texts(drawn[0])
    write_relaxing(tmp_path / "b.h5", law={**law, "k": 2.0}, k=2.0)  # such a gas cannot be run
    run.cooling(tmp_path / "b.h5", tmp_path / "b.png")
    assert "no kinetic theory here" in texts(drawn[1])


def test_theory_of_a_mixture_begins_at_the_temperatures_of_its_species(
    tmp_path: Path, drawn: list[Figure]
) -> None:
    """Heavy disks at T = 8, light ones at 2: mean 5; elastic smooth ones exchange energy and keep their mean.

    They relax to 5 at a rate that is 4 m_1 m_2 / (m_1 + m_2)^2 of a collision between species at most, so that after
    50 collisions per disk nothing is left of the difference; each collision has the same mean normal speed then.
    """
    n = 4000
    disks = Disks(n, np.where(np.arange(n) % 2 == 0, 4.0, 1.0), 0.5, material=np.arange(n) % 2)
    box = Box.from_packing_fraction(disks.radius, PHI)
    rng = np.random.default_rng(7)
    T = np.where(np.arange(n) % 2 == 0, 8.0, 2.0)
    velocity = rng.normal(size=(n, 2)) * np.sqrt(T / disks.mass)[:, None]
    for mine in (slice(0, None, 2), slice(1, None, 2)):  # exactly at these temperatures
        mean = 0.5 * disks.mass[mine][0] * np.mean(np.sum(velocity[mine] ** 2, axis=1))
        velocity[mine] *= math.sqrt(T[mine][0] / mean)
    elastic = {**SMOOTH, "e_n": 1.0}
    lossy = {**SMOOTH, "e_n": 0.5}
    table = [[elastic, lossy], [lossy, elastic]]
    totals = {"temperature": 5.0, "rotational_temperature": 0.0, "collisions": 0}
    for name, laws in (("keeps", [[elastic, elastic], [elastic, elastic]]), ("loses", table)):
        with TrajectoryWriter(
            tmp_path / f"{name}.h5", disks, box, parameters={"laws": json.dumps(laws)}
        ) as w:
            for time in (0.0, 1e-3, 60.0):
                w.write(State(rng.random((n, 2)) * box.lengths, velocity, np.zeros(n), time=time), totals)
        run.cooling(tmp_path / f"{name}.h5", tmp_path / "a.png")
    first, second = (
        np.asarray(next(line for line in figure.axes[0].lines if line.get_linestyle() == "--").get_ydata())
        for figure in drawn
    )
    np.testing.assert_allclose(first, 5.0, rtol=1e-6)  # velocities are stored in 4 bytes
    # The laws of both materials are used: only unlike disks lose energy. A collision of the two takes
    # (1 - e_n^2)/2 m_n <g_n^2>, <g_n^2> = 2 (T_1/m_1 + T_2/m_2) at contact; each disk has w of them per time,
    # w = n_2 g 2 sigma sqrt(pi/2) sqrt(T_1/m_1 + T_2/m_2), as many as half of all pairs in the mean over both.
    sum_ = 8.0 / 4.0 + 2.0 / 1.0
    density = PHI / (math.pi * 0.25)
    w = 0.5 * density * theory.contact_value(PHI) * math.sqrt(2.0 * math.pi * sum_)
    loss = 0.5 * w * 0.5 * (1.0 - 0.25) * (4.0 / 5.0) * 2.0 * sum_  # per disk: half a pair's collisions
    when = np.asarray(
        next(line for line in drawn[1].axes[0].lines if line.get_linestyle() == "--").get_xdata()
    )
    assert (5.0 - second[0]) / when[0] == pytest.approx(
        loss, rel=2e-3
    )  # when[0] = 1e-3: the first order in time
    assert "kinetic theory (homogeneous mixture)" in texts(drawn[0])


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"radius": np.linspace(0.5, 0.6, 30)}, "more than 16 kinds of disks"),
        ({"law": {**SMOOTH, "rho": 0.01}}, "rolling friction"),
        ({"law": None}, "no law in the file"),
    ],
)
def test_picture_reports_where_the_theory_does_not_hold(
    tmp_path: Path, drawn: list[Figure], changes: dict[str, object], reason: str
) -> None:
    write_relaxing(tmp_path / "a.h5", **changes)  # type: ignore[arg-type]
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert f"{reason}: no kinetic theory here" in texts(drawn[0])
    assert not [line for axes in drawn[0].axes[:2] for line in axes.lines if line.get_linestyle() == "--"]


def test_disks_are_drawn_to_scale_with_their_periodic_images(tmp_path: Path, drawn: list[Figure]) -> None:
    # One disk in the corner shows in all four corners, one on a side on two sides, one inside once.
    radius = np.array([0.5, 0.4, 0.3])
    _, box = write_relaxing(
        tmp_path / "a.h5",
        n=3,
        radius=radius,
        position=np.array([[0.1, 0.1], [1.5, 0.2], [2.0, 2.0]]),
    )
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    (disk_axes,) = [axes for axes in drawn[0].axes if axes.findobj(EllipseCollection)]
    (collection,) = disk_axes.findobj(EllipseCollection)
    assert len(collection.get_offsets()) == 4 + 2 + 1
    np.testing.assert_allclose(np.sort(collection.get_widths())[[0, 1, 3]], 2.0 * np.sort(radius), rtol=1e-14)
    assert disk_axes.get_aspect() == 1.0
    assert disk_axes.get_xlim() == (0.0, box.lengths[0])
    observed = np.asarray(collection.get_offsets())
    corner = [0.1, 0.1] + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * box.lengths
    for expected in corner:
        # positions are stored in 4 bytes: 6e-8 of the box
        assert np.min(np.linalg.norm(observed - expected, axis=1)) < 1e-6


def test_colours_are_symmetric_and_no_outlier_washes_them_out(tmp_path: Path, drawn: list[Figure]) -> None:
    spin = np.concatenate([np.full(60, -1.0), np.full(39, 1.0), [1e6]])
    write_relaxing(tmp_path / "a.h5", n=100, spin=spin)
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    (collection,) = drawn[0].findobj(EllipseCollection)
    assert collection.get_clim() == (-1.0, 1.0)


def test_labels_carry_units(tmp_path: Path, drawn: list[Figure]) -> None:
    write_relaxing(tmp_path / "a.h5")
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    shown = texts(drawn[0])
    for label in ("temperature (J)", "time $t$ (s)", "$x$ (m)", "$y$ (m)", "(rad/s)", "$t$ = 10 s"):
        assert label in shown
    assert "made up: 30 disks, packing fraction 0.1, 90 collisions per disk" in shown  # 2 x 45 n / n


@pytest.mark.full(keep=10)
@pytest.mark.parametrize("first", [1.0, 0.37, 0.071, 2.6e-7, 4.4e5])
@pytest.mark.parametrize("span", [2.0, 2.5, 4.0, 5.0, 5.4, 7.0, 10.0, 20.0, 60.0, 100.0, 200.0])
def test_labels_of_logarithmic_time_are_apart_and_at_least_two(first: float, span: float) -> None:
    axes = Figure(figsize=(6.0, 1.5)).add_axes((0.1, 0.3, 0.8, 0.6))  # narrower than in the picture
    axes.plot([first, first * span], [1.0, 1.0])
    axes.set_xscale("log")
    few_labels(axes)
    assert_labels_are_apart(axes)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("frames", [2, 21])
def test_time_labels_of_short_runs_are_apart(tmp_path: Path, drawn: list[Figure], frames: int) -> None:
    write_relaxing(tmp_path / "a.h5", frames=frames)
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert_labels_are_apart(drawn[0].axes[1])


def test_there_are_no_time_labels_between_the_panels(tmp_path: Path, drawn: list[Figure]) -> None:
    write_relaxing(tmp_path / "a.h5")
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    drawn[0].draw_without_rendering()
    axis = drawn[0].axes[0].xaxis
    assert not any(tick.label1.get_visible() for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()])


@pytest.mark.parametrize("frames", [2, 6])
def test_no_theta_marker_is_cut_at_the_top(tmp_path: Path, drawn: list[Figure], frames: int) -> None:
    write_relaxing(tmp_path / "a.h5", frames=frames)
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    drawn[0].draw_without_rendering()
    lower = drawn[0].axes[1]
    markers = lower.lines[0]
    top = lower.transData.transform(np.asarray(markers.get_xydata(), dtype=float))[:, 1].max()
    radius = 0.5 * (markers.get_markersize() + markers.get_markeredgewidth()) * drawn[0].dpi / 72.0
    assert top + radius < lower.bbox.y1
    assert lower.get_ylim()[0] == 0.0


def test_reduced_units_are_called_so(tmp_path: Path, drawn: list[Figure]) -> None:
    write_relaxing(tmp_path / "a.h5", units=dict.fromkeys(SI, "reduced"))
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert "temperature (reduced units)" in texts(drawn[0])
    assert "(J)" not in texts(drawn[0])


def test_very_many_disks_become_a_density_map_with_a_note(
    tmp_path: Path, drawn: list[Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plot_disks, "MOST_DISKS", 1000)
    write_relaxing(tmp_path / "a.h5", n=5000)
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert not drawn[0].findobj(EllipseCollection)
    assert "above 1000 disks, single disks are not drawn" in texts(drawn[0])
    image = next(image for axes in drawn[0].axes for image in axes.images)
    # All the disks' area is in the map: its mean is the packing fraction, but for rounding.
    assert float(np.mean(image.get_array())) == pytest.approx(PHI, rel=1e-12)


def test_gas_at_rest_can_be_drawn(tmp_path: Path, drawn: list[Figure]) -> None:
    disks = Disks(2, 1.0, 0.1)
    still = State(np.array([[0.2, 0.2], [0.7, 0.7]]), np.zeros((2, 2)), np.zeros(2))
    with TrajectoryWriter(
        tmp_path / "a.h5", disks, Box((1.0, 1.0)), parameters={"laws": json.dumps([[SMOOTH]])}
    ) as w:
        w.write(still, {"temperature": 0.0, "rotational_temperature": 0.0})
    run.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert "nothing moves: no kinetic theory here" in texts(drawn[0])


def test_picture_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    write_relaxing(tmp_path / "a.h5")
    with pytest.raises(InputError, match="cannot be written"):
        run.cooling(tmp_path / "a.h5", tmp_path / "nowhere" / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_missing_trajectory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        run.cooling(tmp_path / "a.h5", tmp_path / "a.png")


def test_markers_on_the_frame_are_whole_and_points_beyond_it_are_not_drawn() -> None:
    axes = Figure().subplots()
    (on,) = axes.plot([0.0, 1.0, 2.0], [0.0, 1.0, 1.0], "o-")
    (beyond,) = axes.plot([0.0, 1.0, 3.0], [0.0, 1.0, 1.0], "s")
    (line,) = axes.plot([0.0, 2.0], [0.0, 1.0], "-")
    style.frame_axes([axes], (0.0, 2.0), (0.0, 1.0))
    assert [each.get_clip_on() for each in (on, beyond, line)] == [False, True, True]
    (low,) = axes.plot([0.0, 2.0], [0.0, np.nan], "o")
    axes.set_yscale("log")
    style.frame_axes([axes], None, (0.1, None))
    assert low.get_clip_on()


def test_markers_of_a_nearly_constant_theta_are_whole() -> None:
    figure = Figure(figsize=(6.0, 1.5))
    axes = figure.add_subplot()
    axes.plot([1.0, 2.0, 3.0], [0.50, 0.505, 0.51], "o", ms=5)  # the usual margin would be 0.0005 here
    style.from_zero(axes)
    figure.draw_without_rendering()
    top = float(axes.transData.transform((3.0, 0.51))[1])
    assert top + 0.5 * (5.0 + 1.0) * figure.dpi / 72.0 < axes.bbox.y1


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(("what", "color"), [("species", None), ("disks", "species")])
def test_names_with_dollar_signs_are_no_formulas(what: str, color: str | None, tmp_path: Path) -> None:
    """Matplotlib takes what stands between two of them for TeX, and raises an error of its parser."""
    names = [r"$\frac$", "$x^$"]
    species = json.dumps([{"name": name, "number": 2} for name in names])
    rng, gas = np.random.default_rng(1), Disks(4, [1.0, 1.0, 2.0, 2.0], 0.1)
    given = {"species": species, "name": "$n_$", "units/length": "$m^$"}
    with TrajectoryWriter(tmp_path / "a.h5", gas, Box((9.0, 9.0)), parameters=given) as file:
        for time in range(6):
            file.write(
                State(rng.random((4, 2)), rng.normal(size=(4, 2)), np.zeros(4), time=time),
                {"collisions": time},
            )
    with Trajectory(tmp_path / "a.h5") as trajectory:
        figure = pictures.figure(trajectory, what, color=color)
    figure.draw_without_rendering()
    assert r"\$n_\$" in texts(figure)
    assert r"\$\frac\$" in texts(figure)
