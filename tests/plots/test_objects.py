"""Pictures of objects: axes show the data of the objects, and notebooks get tables and thumbnails."""

from __future__ import annotations

import base64
import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot, style
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.image import imread
from support import grey, layout_files
from support.figures import texts

import ifrdem
from ifrdem import InputError, Trajectory, TrajectoryWriter, analysis, plots
from ifrdem.analysis import averages
from ifrdem.model.box import Box
from ifrdem.model.histograms import Histogram, histogram_edges
from ifrdem.model.state import Disks, State
from ifrdem.plots import analyses, disks, movie, pictures
from ifrdem.plots.style import KINDS, lightness, shades

N = 400
LAW = {
    "law": "ifr",
    "e_n": 0.8,
    "e_t": -0.9,
    "mu": 0.2,
    "sticking": "percussion_center",
    "rho": 0.0,
    "k": 2.0,
}


@pytest.fixture(autouse=True)
def _closed() -> object:
    """Figures of pyplot are forgotten after each test."""
    yield
    pyplot.close("all")


def write_cooling(
    path: Path, *, spin: float = 1.0, frames: int = 6, law: dict[str, object] = LAW, rate: float = 3.0
) -> Path:
    """A cooling gas with T = 2 / (1 + t), T_rot = T / 2 and `rate` t collisions per disk; disks of radius 0.2."""
    rng, box = np.random.default_rng(1), Box((40.0, 30.0))
    parameters = {"laws": json.dumps([[law]])}
    with TrajectoryWriter(
        path, Disks(N, 1.0, 0.2), box, parameters=parameters, units={"length": "m", "time": "s"}
    ) as w:
        for t in np.arange(frames, dtype=float):
            state = State(
                rng.random((N, 2)) * box.lengths, rng.normal(size=(N, 2)), spin * rng.normal(size=N), time=t
            )
            T = 2.0 / (1.0 + t)
            totals = {
                "temperature": T, "rotational_temperature": 0.5 * T, "collisions": int(0.5 * rate * N * t),
                "translational_energy": N * T, "rotational_energy": 0.25 * N * T,
            }  # fmt: skip
            w.write(state, totals)
    return path


@pytest.fixture
def three() -> ifrdem.Simulation:
    """Three disks, one of them across a corner of a periodic box."""
    state = State(
        [[0.1, 0.1], [4.0, 4.0], [7.0, 2.0]], [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], [2.0, -2.0, 0.0]
    )
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2)
    return ifrdem.Simulation(Disks(3, 1.0, [0.5, 0.4, 0.6]), Box((8.0, 8.0)), law, state)


def test_a_simulation_draws_its_disks_to_scale_into_the_axes_that_it_gets(three: ifrdem.Simulation) -> None:
    axes = pyplot.figure().subplots()
    assert three.plot(axes) is axes
    with pytest.raises(InputError, match="a picture of disks has 1 panel: must be ax=axes, not 2 axes"):
        three.plot([axes, axes])
    (drawn,) = axes.findobj(EllipseCollection)
    assert len(drawn.get_offsets()) == 4 + 1 + 1  # that of the corner shows in all four
    np.testing.assert_allclose(np.unique(drawn.get_widths()), [0.8, 1.0, 1.2])
    assert axes.get_xlim() == axes.get_ylim() == (0.0, 8.0)
    assert axes.get_xlabel() == "$x$"  # its units are not known
    (bar,) = axes.child_axes
    assert "spin" in bar.get_ylabel()


def test_without_axes_a_figure_of_pyplot_is_made(three: ifrdem.Simulation) -> None:
    axes = three.plot(color="speed")
    assert isinstance(axes, Axes)
    assert axes.figure.number in pyplot.get_fignums()


def test_colours_are_those_of_the_quantity(three: ifrdem.Simulation) -> None:
    expected = {
        "spin": [2.0, -2.0, 0.0], "speed": [1.0, 1.0, 0.0], "direction": [0.0, 90.0, 0.0],
        "temperature": [0.5, 0.5, 0.0], "radius": [0.5, 0.4, 0.6], "collisions": [0.0, 0.0, 0.0],
        "material": [0.0, 0.0, 0.0], "species": [0.0, 0.0, 0.0],
    }  # fmt: skip
    assert {*expected, "dissipated", "asleep"} == set(disks.COLOURS)
    for color, values in expected.items():
        axes = three.plot(color=color)
        (drawn,) = axes.findobj(EllipseCollection)
        if len(set(values)) == 1:
            assert not axes.child_axes  # a bar of one colour says nothing
        else:
            np.testing.assert_allclose(np.asarray(drawn.get_array())[:3], values, atol=1e-15)
            assert axes.child_axes[0].get_ylabel()
    assert not three.plot(color="none").child_axes
    with pytest.raises(InputError, match=r"color = sped: .*did you mean 'speed'"):
        three.plot(color="sped")


def test_dark_backgrounds_get_light_walls_and_light_disks_without_spin(three: ifrdem.Simulation) -> None:
    for name, walls in (("default", "black"), ("dark_background", "white")):
        with style.context(name):
            axes = three.plot()
        assert disks.foreground(axes) == walls
        middle = disks.colour_map("signed", dark=name != "default")(0.5)[:3]
        assert abs(sum(middle) - sum(to_rgb(axes.get_facecolor()))) > 1.5  # of 3


def test_one_kind_of_disks_has_its_own_colour_and_many_grow_lighter() -> None:
    """One kind was darkened to L* 28."""
    for dark in (False, True):
        assert to_hex(shades(1, dark=dark)[0], keep_alpha=False) == KINDS[0].lower()
        assert np.all(np.diff(lightness(shades(150, dark=dark))) > 0.0)


def test_a_picture_without_spins_has_no_bar(tmp_path: Path) -> None:
    with Trajectory(write_cooling(tmp_path / "still.h5", spin=0.0)) as run:
        assert not run[-1].plot().child_axes
        assert not run.plot("disks").child_axes


def test_frames_without_the_field_of_a_colour_are_refused(tmp_path: Path) -> None:
    layout_files.write(tmp_path / "bare.h5", fields=("position",))
    with Trajectory(tmp_path / "bare.h5") as run:
        with pytest.raises(InputError, match="no field 'angular_velocity'"):
            run[0].plot()
        assert not run[0].plot(color="none").child_axes
        assert run.plot("disks").get_title().startswith("disks at")


def test_temperatures_go_into_one_axes_or_two(tmp_path: Path) -> None:
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        upper, lower = pyplot.figure().subplots(2, 1)
        assert run.plot("temperatures", upper) is upper
        np.testing.assert_allclose(upper.lines[0].get_ydata(), 2.0 / np.arange(2.0, 7.0))
        assert upper.get_xlabel() == "time $t$ (s)"
        run.plot("temperatures", ax=(upper, lower))
        assert "theta" in lower.get_ylabel()
        both = run.plot()
        assert len(both) == 2


def test_temperatures_have_no_band_of_independent_disks(tmp_path: Path) -> None:
    """Its variances 1/n and 2/n were those of no gas: 40 gases differed 1.5 to 1.9 times as much in T_rot at first."""
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        axes = run.plot("temperatures", ax=pyplot.figure().subplots())
    assert not axes.collections
    assert not any("interval" in text.get_text() for text in axes.get_legend().get_texts())


def test_free_flight_is_that_of_the_velocities_and_not_a_line_through_the_first_point(tmp_path: Path) -> None:
    """Disks that fly freely in the first half of the frames, and then stand: the first points lie on <v^2> t^2."""
    rng, box, path = np.random.default_rng(1), Box((40.0, 30.0)), tmp_path / "run.h5"
    start, velocity = rng.random((N, 2)) * box.lengths, rng.normal(size=(N, 2))
    with TrajectoryWriter(path, Disks(N, 1.0, 0.2), box) as w:
        for t in np.arange(12.0):
            way = 0.05 * min(t, 5.0)
            w.write(
                State(np.mod(start + way * velocity, box.lengths), velocity, np.zeros(N), time=0.05 * t),
                {"temperature": 1.0},
            )
    with Trajectory(path) as run:
        axes = run.plot("msd", ax=pyplot.figure().subplots(), frames=range(4))
        (line,) = [each for each in axes.lines if "free flight" in str(each.get_label())]
        square = np.mean(np.sum(velocity**2, axis=1))
        np.testing.assert_allclose(line.get_ydata(), square * np.asarray(line.get_xdata()) ** 2, rtol=1e-5)
        # Over all frames the stop takes from the displacement, even at the first lag, but not from the line.
        axes = run.plot("msd", ax=pyplot.figure().subplots(), frames=range(12))
        (line,) = [each for each in axes.lines if "free flight" in str(each.get_label())]
        np.testing.assert_allclose(line.get_ydata(), square * np.asarray(line.get_xdata()) ** 2, rtol=1e-5)


@pytest.mark.parametrize("what", ["temperatures", "energy"])
def test_over_tau_is_collisions_per_disk(tmp_path: Path, what: str) -> None:
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        axes = run.plot(what, ax=pyplot.figure().subplots(), over="tau")
        assert axes.get_xlabel() == r"collisions per disk $\tau$"
        np.testing.assert_allclose(np.asarray(axes.lines[0].get_xdata())[-5:], 3.0 * np.arange(1.0, 6.0))
        for over in ("t", "tau"):
            with pytest.raises(InputError, match=f"over = {over}: cannot be combined with velocity"):
                run.plot("velocity", over=over)
        with pytest.raises(InputError, match=r"over = 'taw': must be one of 't', 'tau' \(did you mean"):
            run.plot(what, over="taw")


@pytest.mark.parametrize("rate", [3.0, 12.0])
def test_theory_over_tau_goes_from_the_first_collision_to_the_last_of_the_run(
    tmp_path: Path, rate: float
) -> None:
    """Each collision of a smooth disk takes (1 - e_n^2) / 2 of T: T = 2 exp(-0.18 tau) for e_n = 0.8.

    In the time of the run theory has 20 collisions per disk, more or fewer than the run.
    """
    with Trajectory(
        write_cooling(tmp_path / "run.h5", law={**LAW, "e_t": -1.0, "mu": 0.0}, rate=rate)
    ) as run:
        lines = run.plot("temperatures", ax=pyplot.figure().subplots(), over="tau").lines
    dashed = next(one for one in lines if one.get_linestyle() == "--" and len(one.get_xdata()))
    tau, T = (np.asarray(one) for one in dashed.get_data())
    assert tau[0] == 0.0
    assert 5.0 * rate <= tau[-1] < 5.0 * rate + 1.0
    np.testing.assert_allclose(T, 2.0 * np.exp(-0.18 * tau), rtol=1e-6)
    assert np.asarray(lines[0].get_xdata())[0] == 0.0  # and the first frame is there


def test_an_argument_of_another_name_is_refused_with_the_nearest(
    tmp_path: Path, three: ifrdem.Simulation
) -> None:
    message = r"colour = 'speed': there is no such argument \(did you mean 'color'\?\); there are "
    with pytest.raises(InputError, match=message + "ax, color"):
        three.plot(colour="speed")
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        with pytest.raises(InputError, match=message + "ax, color"):
            run[0].plot(colour="speed")
        with pytest.raises(InputError, match=message + "what, ax, frames, over, color"):
            run.plot("disks", colour="speed")


@pytest.mark.parametrize(
    ("units", "message"),
    [({}, "$x$"), ({"length": "reduced"}, "$x$ (reduced units)"), ({"length": "m"}, "$x$ (m)")],
)
def test_units_are_shown_if_the_file_states_them(tmp_path: Path, units: dict[str, str], message: str) -> None:
    state = State([[1.0, 1.0]], [[1.0, 0.0]], [0.0])
    with TrajectoryWriter(tmp_path / "one.h5", Disks(1, 1.0, 0.2), Box((4.0, 4.0)), units=units) as writer:
        writer.write(state)
    with Trajectory(tmp_path / "one.h5") as run:
        assert run[0].plot().get_xlabel() == message
        assert run.units == ({} if units != {"length": "m"} else units)


def test_wrong_axes_are_refused(tmp_path: Path, three: ifrdem.Simulation) -> None:
    axes = pyplot.figure().subplots(1, 3)
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        with pytest.raises(
            InputError, match=r"velocity has 2 panels: must be ax=\(left, right\), not 1 axes"
        ):
            run.plot("velocity", axes[0])
        with pytest.raises(InputError, match=r"temperatures has 2 panels.* not 3 axes"):
            run.plot("temperatures", axes)
        with pytest.raises(
            InputError, match=r"no picture is called 'temperature'.*did you mean 'temperatures'"
        ):
            run.plot("temperature")
    with pytest.raises(InputError, match="ax = 3: must be"):
        three.plot(3)  # type: ignore[arg-type]


@pytest.mark.full
def test_every_result_of_an_analysis_draws_itself(tmp_path: Path) -> None:
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        frames, box, radius = list(run), run.box, run.disks.radius
        positions, velocities = [f.position for f in frames], [f.velocity for f in frames]
        last, times, steps = frames[-1], run.times, np.linspace(0.0, 5.0, 50)
        found = [
            analysis.velocity_distribution(velocities, [f.spin for f in frames]),
            analysis.pair_correlation(positions, box, r_max=5.0),
            analysis.structure_factor(last.position, box, k_max=5.0),
            analysis.clusters(last.position, box, radius=radius, gap=0.5),
            analysis.hexatic(last.position, box),
            analysis.coarse_grain(last.position, last.velocity, last.spin, box=box, cells=(4, 3), mass=run.disks.mass,
                                  radius=radius, inertia=run.disks.inertia),
            analysis.velocity_autocorrelation(times, np.array(velocities)),
            analysis.mean_square_displacement(times, np.array(positions)),
            analysis.impacts(np.random.default_rng(1).uniform(0.0, 1.5, 200)),
            analysis.collision_distribution(
                Histogram("free_time", histogram_edges("free_time"), np.full((1, 320), 5))
            ),
            analysis.haff_fit(steps, 3.0 / (1.0 + steps) ** 2),
            analysis.ratio_fit(steps, 0.6 - 0.5 * np.exp(-steps)),
            analysis.pressure_from_impulses(
                steps, np.tile([1.0, 0.0], (50, 1)), np.tile([2.0, 0.0], (50, 1)), np.ones(50), span=(0.0, 5.0),
                area=100.0, disks=10, tracked=10, temperature=1.0,
            ),
            analysis.mean_stress(steps, np.ones((49, 4)), np.ones((49, 4))),
            analysis.profiles(run),
            analysis.mean_fields(run),
            averages.profiles_of_groups(run, times[[1, 3]], [[0, 1], [2, 3]], "time", None, None),
            analysis.speed_tail(np.random.default_rng(1).normal(size=(4000, 2)), first=1.0),
            analysis.phase_average(steps, np.cos(steps), period=1.0, phases=5),
            analysis.transport_coefficient(
                np.arange(301.0), np.random.default_rng(1).normal(size=(300, 2)), lag=4.0
            ),
            analysis.velocity_correlation(last.position, last.velocity, box, r_max=5.0),
            analysis.velocity_spectrum(last.position, last.velocity, box, k_max=5.0),
        ]  # fmt: skip
    assert {type(one) for one in found} == set(analyses.RESULTS)
    for one in found:
        axes = np.atleast_1d(one.plot())
        for each in axes:
            assert each.get_xlabel()
            assert each.has_data()
        assert grey.least_difference(*axes) > 10.0  # as in test_grey.py
        given = pyplot.figure().subplots(1, len(axes), squeeze=False).ravel()
        one.plot(ax=given if len(given) > 1 else given[0])
        assert [each.get_xlabel() for each in given] == [each.get_xlabel() for each in axes]
        with pytest.raises(InputError, match="panel"):
            one.plot(ax=pyplot.figure().subplots(1, 3))
        pyplot.close("all")


def test_fits_draw_their_results() -> None:
    x = np.linspace(1.0, 6.0, 50)
    haff = analysis.haff_fit(x, 3.0 / (1.0 + (x - 1.0) / 2.0) ** 2).plot().lines[0]
    np.testing.assert_allclose(
        haff.get_ydata()[[0, -1]], [3.0, 3.0 / 3.5**2], rtol=1e-6
    )  # to the fit's accuracy
    ratio = analysis.ratio_fit(x, 0.6 - 0.5 * np.exp(1.0 - x)).plot().lines[0]
    np.testing.assert_allclose(ratio.get_ydata()[[0, -1]], [0.1, 0.6 - 0.5 * np.exp(-5.0)], rtol=1e-6)
    found = analysis.pressure_from_impulses(
        [1.0, 2.0], [[1.0, 0.0]] * 2, [[2.0, 0.0]] * 2, [1.0, 1.0], span=(0.0, 4.0), area=10.0, disks=5, tracked=5,
        temperature=1.0,
    )  # fmt: skip
    # n T = 5 / 10; two collisions, half of each counted: P_xx = 2 J sigma / (2 A t) = 2 / 40, p = P_xx / 2
    assert [bar.get_height() for bar in found.plot().patches] == pytest.approx([0.5, 0.025, 0.525])
    pyplot.close("all")


@pytest.mark.full
def test_pictures_of_runs_take_an_open_trajectory_and_leave_it_open(tmp_path: Path) -> None:
    with Trajectory(write_cooling(tmp_path / "run.h5")) as run:
        figure = plots.cooling(run)
        assert "temperature" in texts(figure)
        plots.cooling(run, tmp_path / "a.png")
        assert len(run[0].position) == N
    assert imread(tmp_path / "a.png").std() > 0.05


def test_the_expansion_of_sonine_ends_where_it_is_negative() -> None:
    """Whatever its roots: all that is drawn is positive, and ends at the first of them."""
    x = np.linspace(-5.0, 5.0, 400)
    for a2 in (-0.3, -0.1):
        whole = analysis.sonine_density(x, a2)
        assert whole.min() < 0.0
        first = np.abs(x[whole <= 0.0]).min()
        rng = np.random.default_rng(1)
        found = analysis.velocity_distribution([rng.normal(size=(N, 2))], [rng.normal(size=N)])
        object.__setattr__(found.sonine, "a20", a2)
        left, _ = found.plot()
        curve = next(line for line in left.lines if line.get_linestyle() == "--")
        drawn, at = np.asarray(curve.get_ydata()), np.asarray(curve.get_xdata())
        assert np.nanmin(drawn) > 0.0
        assert np.abs(at[np.isfinite(drawn)]).max() < first
    object.__setattr__(found.sonine, "a20", 0.87)  # its next terms are as large: only the value is given
    left, _ = found.plot()
    assert not [line for line in left.lines if line.get_linestyle() == "--"]
    assert "$a_{20} = 0.87$" in left.get_legend_handles_labels()[1]


def test_merged_bins_keep_the_pairs_and_lose_the_noise() -> None:
    r = np.arange(0.025, 10.0, 0.05)
    rng = np.random.default_rng(3)
    pairs = np.where(r < 1.0, 0.0, rng.poisson(40.0 * r))
    g, error = pairs / (40.0 * r), np.sqrt(np.maximum(pairs, 1.0)) / (40.0 * r)
    found = analysis.PairCorrelation(r, g, error, pairs, 1)
    at, merged, left = analyses.merged(found)
    assert len(at) < 0.6 * len(r)
    far, much = at > 5.0, r > 5.0
    assert merged[far].std() < 0.6 * g[much].std()
    # Poisson: the scatter of what is merged is what its error says, within four of its own errors.
    assert np.std((merged[far] - 1.0) / left[far]) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * far.sum()))
    np.testing.assert_array_equal(merged[at < 0.95], 0.0)


@pytest.mark.parametrize("clustered", [False, True])
def test_a_plateau_above_one_is_explained(clustered: bool) -> None:
    """All disks in half of the box: g is 2 at distances that are short against it."""
    rng = np.random.default_rng(2)
    position = rng.random((4000, 2)) * ((50.0 if clustered else 100.0), 100.0)
    axes = analysis.pair_correlation(position, (100.0, 100.0), r_max=5.0).plot()
    message = texts(axes.figure)
    assert ("above 1, as the density varies (clusters)" in message) == clustered


def test_warnings_are_shown_below_the_picture(tmp_path: Path) -> None:
    with Trajectory(
        write_cooling(tmp_path / "run.h5", rate=0.0)
    ) as run:  # its temperature falls, and not by collisions
        figure = pictures.figure(run, "vacf")
    figure.draw_without_rendering()
    (note,) = [text for text in figure.texts if text.get_text().startswith("! ")]
    assert "not stationary" in note.get_text()
    assert note.get_window_extent().y1 <= figure.axes[0].get_tightbbox().y0
    assert note.get_window_extent().x1 <= figure.bbox.x1


def png(page: str) -> np.ndarray:
    """The thumbnail of a page."""
    (data,) = re.findall(r"data:image/png;base64,([^']+)'", page)
    return imread(io.BytesIO(base64.b64decode(data)))


def test_objects_show_tables_with_thumbnails(tmp_path: Path, three: ifrdem.Simulation) -> None:
    path = write_cooling(tmp_path / "a<b>.h5")
    with Trajectory(path) as run:
        pages = {
            three._repr_html_(): ["Simulation", "8 x 8, periodic along x and y"],
            three.state._repr_html_(): ["State", "root mean square spin", "1.633"],  # sqrt(8 / 3)
            run._repr_html_(): ["Trajectory", "0 to 5 s", "a&lt;b&gt;.h5"],
            run[2]._repr_html_(): ["Frame 2 of 6", "2 s"],
        }
        for page, words in pages.items():
            for word in words:
                assert word in page
            assert png(page)[..., :3].std() > 0.05
            assert len(page) < 100_000
    closed = run._repr_html_()
    assert "<img" not in closed
    assert "400" in closed
    assert "<img" not in State(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))._repr_html_()


def test_a_study_shows_its_keys_and_whether_it_has_results(tmp_path: Path) -> None:
    study = ifrdem.Study("cooling", vary=["material[0].e_n=0.7,0.8"], seeds=2, output=tmp_path / "s.nc")
    page = study._repr_html_()
    assert "material[0].e_n" in page
    assert "0.7, 0.8" in page
    assert "none yet" in page


@pytest.mark.full
def test_the_table_s_axis_ends_when_all_are_at_rest_and_its_legend_hides_no_curve(tmp_path: Path) -> None:
    """Speeds and spins fall to 0 at t = 3; the file ends at t = 9."""
    with TrajectoryWriter(tmp_path / "table.h5", Disks(3, 1.0, 0.2), Box.open(), units={}) as writer:
        for t in np.arange(10.0):
            v = max(3.0 - t, 0.0)
            state = State([[0.0, t], [2.0, t], [4.0, t]], [[0.0, v]] * 3, [v] * 3, time=t)
            writer.write(state, {"translational_energy": 1.5 * v**2, "rotational_energy": 0.03 * v**2})
    figure = plots.table(tmp_path / "table.h5")
    figure.draw_without_rendering()
    upper, lower = figure.axes[:2]
    assert upper.get_xlim() == lower.get_xlim() == (0.0, 3.0)
    assert upper.get_legend().get_window_extent().y0 >= upper.get_window_extent().y1


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("lengths", [(0.8, 0.5), (0.3, 2.0), (30.0, 20.0)])
def test_pictures_of_disks_are_as_large_as_the_box_and_cut_nothing(
    tmp_path: Path, lengths: tuple[float, float]
) -> None:
    with TrajectoryWriter(
        tmp_path / "run.h5", Disks(2, 1.0, 0.05 * min(lengths)), Box(lengths), units={"length": "m"}
    ) as w:
        w.write(State(np.array([[0.3, 0.3], [0.7, 0.7]]) * lengths, np.zeros((2, 2)), [1.0, -2.0]))
    with Trajectory(tmp_path / "run.h5") as run:
        figure = pictures.figure(run, "disks")
    for _ in range(2):  # as `run.save` does
        figure.draw_without_rendering()
    needed, size = figure.get_tightbbox(), figure.get_size_inches()
    assert needed.x0 >= 0.0
    assert needed.y0 >= 0.0
    assert needed.x1 <= size[0]
    assert needed.y1 <= size[1]
    assert needed.height > 0.8 * size[1]
    bar = figure.axes[0].child_axes[0]
    # right next to the axes: nearer than a tenth of the figure
    assert 0.0 < bar.get_window_extent().x0 - figure.axes[0].get_window_extent().x1 < 0.1 * figure.bbox.width


@pytest.mark.parametrize(
    ("spin", "materials", "expected"), [(1.0, 2, "spin"), (0.0, 2, "material"), (0.0, 1, "none")]
)
def test_disks_of_which_none_turns_show_their_materials(spin: float, materials: int, expected: str) -> None:
    many = Disks(2, 1.0, 0.5, material=[0, materials - 1])
    still = State([[2.0, 2.0], [5.0, 5.0]], [[1.0, 0.0], [0.0, 1.0]], [0.0, spin])
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2)
    laws = law if materials == 1 else [[law, law], [law, law]]
    view = disks.View.of(ifrdem.Simulation(many, Box((8.0, 8.0)), laws, still))
    assert disks.default_color(view) == expected


def test_disks_can_be_coloured_by_asleep(tmp_path: Path) -> None:
    state = State([[2.0, 2.0], [5.0, 5.0]], np.zeros((2, 2)), np.zeros(2), asleep=[0, 1])
    with TrajectoryWriter(
        tmp_path / "a.h5", Disks(2, 1.0, 0.5), Box((8.0, 8.0)), fields=("position", "asleep")
    ) as file:
        file.write(state)
    with Trajectory(tmp_path / "a.h5") as run:
        figure = pictures.figure(run, "disks", color="asleep")
    (drawn,) = (one for one in figure.axes[0].collections if isinstance(one, EllipseCollection))
    np.testing.assert_array_equal(drawn.get_array(), (0.0, 1.0))
    assert {"awake", "asleep"} <= set(texts(figure).splitlines())


def test_the_bar_of_materials_has_their_names(tmp_path: Path) -> None:
    names = json.dumps(["steel", "cork", "rubber"])  # walls are of the first
    many = Disks(2, 1.0, 0.5, material=[1, 2])
    with TrajectoryWriter(tmp_path / "a.h5", many, Box((8.0, 8.0)), parameters={"materials": names}) as file:
        file.write(State([[2.0, 2.0], [5.0, 5.0]], np.zeros((2, 2)), np.zeros(2)))
    with Trajectory(tmp_path / "a.h5") as run:
        (bar,) = pictures.figure(run, "disks", color="material").axes[0].child_axes
    shown = dict(zip(bar.get_yticks(), (one.get_text() for one in bar.get_yticklabels()), strict=True))
    assert shown == {0.0: "steel", 1.0: "cork", 2.0: "rubber"}


def test_disks_below_a_pixel_are_drawn_as_one_and_it_is_said(tmp_path: Path) -> None:
    """A box of 7000 diameters on some 700 pixels: a pixel is 10 wide; the large disk is larger than that."""
    box, radius = Box((7000.0, 7000.0)), np.array([0.5, 0.5, 20.0])
    start = State([[100.0, 100.0], [3000.0, 5000.0], [5000.0, 1000.0]], np.zeros((3, 2)), np.zeros(3))
    with TrajectoryWriter(tmp_path / "a.h5", Disks(3, 1.0, radius), box) as file:
        file.write(start)
    with Trajectory(tmp_path / "a.h5") as run:
        figure = pictures.figure(run, "disks")
        assert "2 disks are enlarged to one pixel" in texts(figure)
        (drawn,) = (one for one in figure.axes[0].collections if isinstance(one, EllipseCollection))
        np.testing.assert_allclose(drawn.get_widths(), (10.0, 10.0, 40.0))
        scene = movie.Scene(run, [0], (400, 400), "none")
        image, plain = scene.draw(0)[..., 0].astype(float), int(disks.PLAIN[1:3], 16)
        box, height = scene._axes.get_window_extent(), scene.size[1]
        row, column = height - round(box.y0 + 5.0 / 7.0 * box.height), round(box.x0 + 3.0 / 7.0 * box.width)
        near = image[row - 4 : row + 4, column - 4 : column + 4]  # the disk at (3000, 5000)
        covered = ((255.0 - near) / (255.0 - plain)).sum()
        assert covered == pytest.approx(math.pi / 4.0, abs=0.1)  # the area of a disk of one pixel
        assert scene.draw(0).shape[2] == 3
        assert "small disks enlarged" in scene._title.get_text()
