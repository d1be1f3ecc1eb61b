"""The style "poster": a scale bar instead of titles and axes; colours of directions for all kinds of colour vision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from support import layout_files

import ifrdem
from ifrdem.cli import main as cli
from ifrdem.plots import disks, pictures, poster
from ifrdem.plots.style import is_poster


@pytest.fixture
def in_style():
    token = is_poster.set(True)
    yield
    is_poster.reset(token)


@pytest.fixture
def opened(tmp_path: Path):
    layout_files.write(tmp_path / "gas.h5", n=50)
    with ifrdem.Trajectory(tmp_path / "gas.h5") as trajectory:
        yield trajectory


def test_a_snapshot_has_no_title_and_no_axes_but_a_bar_of_its_length(opened, in_style) -> None:
    figure = pictures.figure(opened, "disks", color="speed", size=(4.0,))
    (axes,) = figure.axes
    assert figure.get_suptitle() == axes.get_title() == axes.get_xlabel() == ""
    (key,) = axes.child_axes  # its ends are those of the colours
    speed = np.linalg.norm(opened[-1].velocity, axis=1)
    assert [one.get_text() for one in axes.texts[1:]] == ["0", f"{np.quantile(speed, 0.95):.3g}", "speed"]
    assert list(key.get_xticks()) == list(axes.get_xticks()) == list(axes.get_yticks()) == []
    assert len(axes.findobj(EllipseCollection)) == 1
    (bar,) = (line for line in axes.lines if line.get_transform() == axes.get_xaxis_transform())
    diameter = 2.0 * layout_files.some_disks(50).radius.mean()
    count = float(axes.texts[0].get_text().removesuffix(" mean diameters"))
    assert np.ptp(bar.get_xdata()) == pytest.approx(count * diameter)
    assert count in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
    assert 0.4 * 30.0 / 8.0 <= count * diameter <= 30.0 / 8.0
    # The map fills the figure in width, and its sides have the ratio of the box.
    assert figure.get_size_inches() == pytest.approx((4.0, 4.0 * (20.0 / 30.0 + poster.STRIP)))


def test_the_key_has_arrows_at_the_colours_of_their_directions(opened, in_style) -> None:
    (key,) = pictures.figure(opened, "disks", color="direction").axes[0].child_axes
    (image,) = key.images
    for text, degrees in zip(key.texts, (-180.0, -90.0, 0.0, 90.0, 180.0), strict=True):
        angle = {"←": 180.0, "↓": -90.0, "→": 0.0, "↑": 90.0}[text.get_text()]
        assert np.cos(np.radians(angle - degrees)) == pytest.approx(1.0)
        place = (degrees + 180.0) / 360.0
        assert text.get_position()[0] == pytest.approx(place, abs=0.021)
        np.testing.assert_allclose(image.cmap(place), disks.colour_map("cyclic", dark=True)(place))


def test_without_a_colour_there_is_no_key(opened, in_style) -> None:
    assert not pictures.figure(opened, "disks", color="none").axes[0].child_axes


@pytest.mark.parametrize(
    ("width", "length"), [(8.0, 1.0), (16.0, 2.0), (39.9, 2.0), (40.0, 5.0), (0.7, 0.05)]
)
def test_the_bar_has_a_round_length(width: float, length: float) -> None:
    assert poster.scale_length(width) == pytest.approx(length)


def test_many_disks_are_a_map_that_is_bright_where_they_are(opened, in_style, monkeypatch) -> None:
    monkeypatch.setattr(disks, "MOST_DISKS", 10)
    figure = pictures.figure(opened, "disks", color="direction")
    picture = np.asarray(figure.axes[0].images[0].get_array())  # rows of y
    rows, columns = picture.shape[:2]
    assert columns / rows == pytest.approx(1.5, rel=0.05)
    lit = picture.any(axis=-1)
    position, angle = opened[-1].position, np.arctan2(*opened[-1].velocity.T[::-1])
    cells = np.floor(position / (30.0, 20.0) * (columns, rows)).astype(int)
    assert sorted({(y, x) for x, y in cells.tolist()}) == sorted(zip(*np.nonzero(lit), strict=True))
    # A disk that is alone in its cell has the hue of its direction.
    alone = [i for i, one in enumerate(cells.tolist()) if cells.tolist().count(one) == 1]
    assert len(alone) > 30
    colours = disks.colour_map("cyclic", dark=True)
    for i in alone:
        shade, full = picture[cells[i, 1], cells[i, 0]], np.array(colours((angle[i] / np.pi + 1.0) / 2.0)[:3])
        assert shade / shade.max() == pytest.approx(full / full.max(), rel=1e-9)


def test_only_pictures_of_places_have_the_style(opened, in_style) -> None:
    assert len(pictures.figure(opened, "fields").axes) == 2
    with pytest.raises(ifrdem.InputError, match="style = poster: cannot be combined with rdf"):
        pictures.figure(opened, "rdf")


def test_the_style_ends_with_the_command(opened, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["plot", "gas.h5", "disks", "--style", "poster", "-o", "a.png"]) == 0
    assert Path("a.png").stat().st_size > 1000
    assert not is_poster.get()
    assert cli.main(["plot", "gas.h5", "rdf", "--style", "poster", "-o", "b.png"]) == 2


# Machado, Oliveira and Fernandes, IEEE Trans. Vis. Comput. Graph. 15, 1291 (2009): dichromats, linear RGB.
BLINDNESS = {
    "all": np.eye(3),
    "no red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "no blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


def lab(linear: np.ndarray) -> np.ndarray:
    """CIELAB of linear sRGB, D65."""
    xyz = (
        linear.clip(0.0)
        @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
        / (0.9505, 1.0, 1.089)
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.stack([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("eyes", BLINDNESS)
def test_eight_directions_differ_for_every_kind_of_colour_blindness(eyes: str) -> None:
    colours = disks.colour_map("cyclic", dark=True)
    assert colours(0.0) == pytest.approx(colours(1.0))
    colours_of_eyes = []
    for angle in np.arange(8) / 8.0:
        srgb = np.array(to_rgb(colours(angle)))
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        colours_of_eyes.append(lab(np.asarray(BLINDNESS[eyes]) @ linear))
    apart = [np.linalg.norm(colours_of_eyes[i] - colours_of_eyes[j]) for i in range(8) for j in range(i)]
    assert min(apart) > 18.0  # eight times what is just noticed side by side (2.3)
