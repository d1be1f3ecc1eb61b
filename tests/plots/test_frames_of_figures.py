"""Ends of axes, chosen panels, and room for labels in figures of a given width."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure
from test_objects import write_cooling

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.plots import pictures
from ifrdem.plots.style import grid, legend_above, part_from_legends
from ifrdem.study.figure import draw
from ifrdem.study.results import Results
from ifrdem.study.task import Variable
from ifrdem.trajectory.reader import Trajectory


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_cooling(tmp_path / "run.h5")


@pytest.mark.full
def test_panels_and_ends_of_axes_are_chosen(path: Path) -> None:
    with Trajectory(path) as run:
        whole = pictures.figure(run, "profiles", axis="x", bins=5)
        some = pictures.figure(
            run, "profiles", axis="x", bins=5, panels=[3, 1], xlim=(5.0, None), ylim=(None, 7.0)
        )
    shown = [axes for axes in some.axes if axes.get_visible()]
    labels = [axes.get_ylabel() for axes in whole.axes]
    assert [axes.get_ylabel() for axes in shown] == [labels[0], labels[2]]
    for axes in shown:
        assert axes.get_xlim()[0] == 5.0
        assert axes.get_ylim()[1] == 7.0
        assert axes.get_xlabel() == whole.axes[-1].get_xlabel()
    assert some.get_figheight() < 0.7 * whole.get_figheight()
    with Trajectory(path) as run:
        with pytest.raises(InputError, match="panels: 7: the picture has 6 panels"):
            pictures.figure(run, "profiles", axis="x", bins=5, panels=[7])
        with pytest.raises(InputError, match="ylim: -1: must be above 0 on this axis"):
            pictures.figure(run, "temperatures", ylim=(-1.0, 2.0))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--xlim", "1"], "--xlim 1: must be two different numbers"),
        (["--xlim", "1,1"], "--xlim 1,1: must be two different numbers"),
        (["--ylim", ","], "--ylim ,: must be two different numbers"),
        (["--panels", "0"], "--panels 0: must be numbers of panels from 1"),
        (["--panels", "3"], "--panels 3: the picture has 2 panels"),
    ],
)
def test_wrong_ends_and_panels_are_refused(path, tmp_path, capsys, words, message) -> None:
    assert main(["plot", str(path), "temperatures", "-o", str(tmp_path / "t.png"), *words]) == 2
    assert message in capsys.readouterr().err


def overlaps(figure) -> list[str]:
    """Texts of a figure that touch another one of another axes, or go beyond it."""
    figure.draw_without_rendering()
    found, boxes = [], []
    whole = figure.bbox.padded(1.0)
    for axes in [axes for axes in figure.axes if axes.get_visible()]:
        texts = [axes.xaxis.label, axes.yaxis.label, axes.title, axes.yaxis.get_offset_text()]
        texts += [] if axes.get_legend() is None else axes.get_legend().get_texts()
        boxes += [
            (axes, text, text.get_window_extent()) for text in texts if text.get_text() and text.get_visible()
        ]
    for i, (axes, text, box) in enumerate(boxes):
        if box.x0 < whole.x0 or box.x1 > whole.x1:
            found.append(text.get_text())
        found += [
            f"{text.get_text()} | {other.get_text()}"
            for others, other, with_that in boxes[i + 1 :]
            if box.overlaps(with_that) and (others is not axes or "offset" in str(other))
        ]
    return found


@pytest.mark.full
def test_a_figure_of_seven_inches_has_room_for_its_labels(path: Path) -> None:
    """Text of 10 points made labels of panels touch, and the power of ten touched the legend."""
    with Trajectory(path) as run:
        figure = pictures.figure(run, "profiles", axis="x", bins=9, size=(7.0,))
    assert overlaps(figure) == []
    sizes = {axes.yaxis.label.get_size() for axes in figure.axes}
    assert max(sizes) < 8.0
    with Trajectory(path) as run, rc_context({"font.size": 11.0}):  # a style that sets its size keeps it
        figure = pictures.figure(run, "profiles", axis="x", bins=9, size=(7.0,))
    assert {axes.yaxis.label.get_size() for axes in figure.axes} == {11.0}


def test_a_power_of_ten_at_the_corner_does_not_touch_the_legend() -> None:
    figure = Figure((2.6, 2.2), layout="constrained")
    axes = figure.subplots()
    for name in ("$T_x$", "$T_y$", "$T_r$"):
        axes.plot([0.0, 1.0], [0.0, 3e-4], "o-", label=name)
    grid(axes)
    legend_above(axes, 3)
    figure.draw_without_rendering()
    offset, legend = axes.yaxis.get_offset_text(), axes.get_legend()
    assert offset.get_window_extent().overlaps(legend.get_window_extent())
    part_from_legends(figure, [axes])
    figure.draw_without_rendering()
    assert not offset.get_window_extent().overlaps(legend.get_window_extent())


def test_panels_of_studies_keep_their_shape_in_narrower_figures() -> None:
    rows = np.arange(5.0)
    values = 1e-4 * (1.0 + rows * np.ones((3, 2, 1, 5)))
    variables = {
        "e_n": Variable(("e_n",), np.array([0.7, 0.8, 0.9])), "mu": Variable(("mu",), np.array([0.1, 0.2])),
        "seed": Variable(("seed",), np.array([1])), "time": Variable(("time",), rows),
        "x": Variable(("e_n", "mu", "seed", "time"), values), "x_mean": Variable(("e_n", "mu", "time"), values[:, :, 0]),
        "x_error": Variable(("e_n", "mu", "time"), np.full(values[:, :, 0].shape, np.nan)),
    }  # fmt: skip
    attributes = {
        "axes": '{"e_n": ["e_n"], "mu": ["mu"]}',
        "keys": '{"e_n": "material[0].e_n", "mu": "material[0].mu"}',
    }
    results = Results(variables, attributes)
    figure = draw(results, "x", by="mu", size=(7.0,))
    assert overlaps(figure) == []
    box = figure.axes[0].get_window_extent()
    assert box.height > 0.8 * box.width  # half of it before, and less with a legend
    figure = draw(results, "x", by="mu", shown=[3], xlim=(1.0, 3.0))
    (axes,) = [axes for axes in figure.axes if axes.get_visible()]
    assert axes.get_title() == "$e_n$ = 0.9"
    assert axes.get_xlim() == (1.0, 3.0)
