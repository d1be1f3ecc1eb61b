"""Figures of the size of a column of a journal: legends off the data, fonts, titles, no empty panels."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from support import layout_files

import ifrdem
from ifrdem.cli import main as cli
from ifrdem.plots import pictures, style
from ifrdem.study import figure as study_figure
from ifrdem.study.results import Results
from ifrdem.study.task import Variable

COLUMN = (3.4,)  # inches


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    path = tmp_path / "gas.h5"
    layout_files.write(path, n=50, frames=6)
    layout_files.add_series(path)
    return path


def geometry(figure: Figure) -> tuple[int, int]:
    spec = figure.axes[0].get_subplotspec()
    assert spec is not None
    return spec.get_gridspec().get_geometry()


def assert_legends_are_off_the_data(figure: Figure) -> None:
    figure.draw_without_rendering()
    figure.draw_without_rendering()
    found = [(axes, one) for axes in figure.axes if (one := axes.get_legend()) is not None]
    assert found
    for axes, legend in found:
        data, box = axes.get_window_extent(), legend.get_window_extent()
        assert box.y0 >= data.y1 - 1.0  # pixels
        assert box.height < figure.bbox.height


@pytest.mark.full
def test_two_panels_of_a_column_are_above_each_other_with_legends_off_the_data(trajectory: Path) -> None:
    with ifrdem.Trajectory(trajectory) as run:
        wide = pictures.figure(run, "velocity")
        figure = pictures.figure(run, "velocity", size=COLUMN, dpi=300, title=False)
    assert geometry(wide) == (1, 2)
    assert geometry(figure) == (2, 1)
    width, height = figure.get_size_inches()
    assert width == 3.4
    assert 1.7 * 3.4 < height < 2.1 * 3.4  # two panels, and their legends
    assert figure.dpi == 300
    assert wide.get_suptitle() != ""
    assert figure.get_suptitle() == ""
    assert_legends_are_off_the_data(figure)


def test_labels_of_narrow_figures_break_before_units_only() -> None:
    axes = Figure(figsize=(3.4, 3.0)).subplots()
    for text, broken in (
        ("displacement of the piston (m)", "displacement of the piston\n(m)"),
        (r"$\langle v_i v_j \rangle \, / \, (\langle v^2 \rangle / 2)$", None),
    ):
        axes.set_ylabel(text)
        pictures._tidy([axes], {}, narrow=True)
        assert axes.get_ylabel() == (broken or text)


def test_units_are_written_with_fractions_and_powers() -> None:
    shown = {
        "kg m2 s-2": "kg m²/s²",
        "s-1": "1/s",
        "m s-1": "m/s",
        "1/s": "1/s",
        "": "",
        "reduced": "reduced units",
    }
    assert {each: style.written(each) for each in shown} == shown


def test_disks_without_spins_have_no_panel_of_spins(tmp_path: Path) -> None:
    path, box, disks = tmp_path / "smooth.h5", layout_files.BOX, layout_files.some_disks(50)
    with ifrdem.TrajectoryWriter(path, disks, box) as file:
        state = layout_files.some_state(50, 0)
        file.write(ifrdem.State(state.position, state.velocity, np.zeros(50)))
    with ifrdem.Trajectory(path) as run:
        assert len(pictures.figure(run, "velocity").axes) == 1


def test_a_figure_of_three_sizes_is_refused(trajectory: Path) -> None:
    with ifrdem.Trajectory(trajectory) as run, pytest.raises(ifrdem.InputError, match="size = "):
        pictures.figure(run, "energy", size=(3.0, 2.0, 1.0))


@pytest.mark.full
def test_pdf_of_the_style_paper_has_fonts_of_type_42(
    trajectory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(trajectory.parent)
    words = ["--size", "3.4x3in", "--dpi", "300", "--no-title", "--style", "paper", "-o", "a.pdf"]
    assert cli.main(["plot", "gas.h5", "velocity", *words]) == 0
    pdf = Path("a.pdf").read_bytes()
    assert b"/CIDFontType2" in pdf
    assert b"/Type3" not in pdf
    # Points: 72 an inch.
    assert b"/MediaBox [ 0 0 244.8 216 ]" in pdf


@pytest.mark.parametrize("size", ["3.4", "in", "0.1in", "3.4x2x1in", "3.4.1in", "50in"])
def test_wrong_sizes_are_refused(trajectory: Path, size: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["plot", str(trajectory), "energy", "--size", size]) == 2
    assert "--size" in capsys.readouterr().err


def test_swept_keys_have_symbols_unless_two_keys_share_one() -> None:
    mean = Variable(("e_n", "speed_rms"), np.array([[1.0, 2.0], [3.0, 4.0]]), "J")
    variables = {
        "e_n": Variable(("e_n",), np.array([0.7, 0.9])),
        "speed_rms": Variable(("speed_rms",), np.array([0.1, 0.2]), "m s-1"),
        "temperature_mean": mean,
    }

    def drawn(keys: dict[str, str]) -> Figure:
        axes = json.dumps({"e_n": ["e_n"], "speed_rms": ["speed_rms"]})
        results = Results(variables, {"axes": axes, "title": "a study", "keys": json.dumps(keys)})
        return study_figure.draw(results, "T", "e_n", size=COLUMN, title=False)

    (axes,) = (figure := drawn({"e_n": "material[0].e_n", "speed_rms": "species[0].speed_rms"})).axes
    assert axes.get_xlabel() == "$e_n$"
    symbol = r"$v_\mathrm{rms}$ at the start"
    assert [line.get_label() for line in axes.lines] == [f"{symbol} = 0.1 m/s", f"{symbol} = 0.2 m/s"]
    assert_legends_are_off_the_data(figure)
    (axes,) = drawn({"e_n": "material[0].e_n", "speed_rms": "pair[0].e_n"}).axes
    assert axes.get_xlabel() == "$e_n$ of material[0]"
