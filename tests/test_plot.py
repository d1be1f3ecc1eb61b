"""The picture of a cooling gas: what is drawn is what the file and the theory say."""

from __future__ import annotations

import json
import math
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.image import imread

from ifrdem import plot, theory
from ifrdem.box import Box
from ifrdem.errors import InputError
from ifrdem.state import Disks, State
from ifrdem.trajectory import TrajectoryWriter

SI = {"length": "m", "mass": "kg", "time": "s", "energy": "J"}
SMOOTH = {"e_n": 0.8, "e_t": -1.0, "mu": 0.0, "sticking": "percussion_center", "rho": 0.0}
MASS, RADIUS, PHI = 2.0, 0.5, 0.1


def write(
    path: Path,
    *,
    n: int = 30,
    radius: float | np.ndarray = RADIUS,
    law: dict[str, object] | None = SMOOTH,
    units: dict[str, str] = SI,
    position: np.ndarray | None = None,
    spin: np.ndarray | None = None,
    frames: int = 11,
) -> tuple[Disks, Box]:
    """A trajectory with made-up temperatures: T = 3/(1+t), T_rot = 1 - 1/(1+t)."""
    disks = Disks(n, MASS, radius)
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


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Collects the figures instead of rendering them, which takes a second each."""
    figures: list[Figure] = []
    monkeypatch.setattr(plot, "_save", lambda figure, path: figures.append(figure))
    return figures


def texts(figure: Figure) -> str:
    return "\n".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def test_picture_is_a_png_and_nothing_else_is_left(tmp_path: Path) -> None:
    write(tmp_path / "a.h5")
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    image = imread(tmp_path / "a.png")
    assert min(image.shape[:2]) > 1000
    assert image[..., :3].std() > 0.05  # not empty
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["a.h5", "a.png"]


def test_circles_are_the_measured_temperatures(tmp_path: Path, drawn: list[Figure]) -> None:
    write(tmp_path / "a.h5")
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    upper, lower = drawn[0].axes[:2]
    time = np.arange(1.0, 11.0)  # time 0 has no place on a logarithmic axis
    for line, expected in ((upper.lines[0], 3.0 / (1.0 + time)), (upper.lines[1], 1.0 - 1.0 / (1.0 + time))):
        # observables are stored in 8 bytes: equal to the last bit
        np.testing.assert_array_equal(line.get_xdata(), time)
        np.testing.assert_array_equal(line.get_ydata(), expected)
    np.testing.assert_allclose(lower.lines[0].get_ydata(), time / 3.0, rtol=1e-14)  # theta, a division


def test_theory_of_smooth_disks_is_haffs_law_in_the_same_colour(tmp_path: Path, drawn: list[Figure]) -> None:
    write(tmp_path / "a.h5")
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
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


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"radius": np.linspace(0.5, 0.6, 30)}, "several kinds of disks"),
        ({"law": {**SMOOTH, "rho": 0.01}}, "rolling friction"),
        ({"law": None}, "no law in the file"),
    ],
)
def test_picture_says_so_where_the_theory_does_not_hold(
    tmp_path: Path, drawn: list[Figure], changes: dict[str, object], reason: str
) -> None:
    write(tmp_path / "a.h5", **changes)  # type: ignore[arg-type]
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert f"{reason}: no kinetic theory here" in texts(drawn[0])
    assert not [line for axes in drawn[0].axes[:2] for line in axes.lines if line.get_linestyle() == "--"]


def test_disks_are_drawn_to_scale_with_their_periodic_images(tmp_path: Path, drawn: list[Figure]) -> None:
    # One disk in the corner shows in all four corners, one on a side on two sides, one inside once.
    radius = np.array([0.5, 0.4, 0.3])
    _, box = write(
        tmp_path / "a.h5",
        n=3,
        radius=radius,
        position=np.array([[0.1, 0.1], [1.5, 0.2], [2.0, 2.0]]),
    )
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    (disk_axes,) = [axes for axes in drawn[0].axes if axes.findobj(EllipseCollection)]
    (collection,) = disk_axes.findobj(EllipseCollection)
    assert len(collection.get_offsets()) == 4 + 2 + 1
    np.testing.assert_allclose(np.sort(collection.get_widths())[[0, 1, 3]], 2.0 * np.sort(radius), rtol=1e-14)
    assert disk_axes.get_aspect() == 1.0
    assert disk_axes.get_xlim() == (0.0, box.lengths[0])
    seen = np.asarray(collection.get_offsets())
    corner = [0.1, 0.1] + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * box.lengths
    for expected in corner:
        # positions are stored in 4 bytes: 6e-8 of the box
        assert np.min(np.linalg.norm(seen - expected, axis=1)) < 1e-6


def test_colours_are_symmetric_and_no_outlier_washes_them_out(tmp_path: Path, drawn: list[Figure]) -> None:
    spin = np.concatenate([np.full(60, -1.0), np.full(39, 1.0), [1e6]])
    write(tmp_path / "a.h5", n=100, spin=spin)
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    (collection,) = drawn[0].findobj(EllipseCollection)
    assert collection.get_clim() == (-1.0, 1.0)


def test_labels_carry_units(tmp_path: Path, drawn: list[Figure]) -> None:
    write(tmp_path / "a.h5")
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    shown = texts(drawn[0])
    for label in ("temperature (J)", "time $t$ (s)", "$x$ (m)", "$y$ (m)", "(rad/s)", "$t$ = 10 s"):
        assert label in shown
    assert "made up: 30 disks, packing fraction 0.1, 90 collisions per disk" in shown  # 2 x 45 n / n


def test_reduced_units_are_called_so(tmp_path: Path, drawn: list[Figure]) -> None:
    write(tmp_path / "a.h5", units=dict.fromkeys(SI, "reduced"))
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert "temperature (reduced units)" in texts(drawn[0])
    assert "(J)" not in texts(drawn[0])


def test_very_many_disks_become_a_density_map_with_a_note(
    tmp_path: Path, drawn: list[Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plot, "MOST_DISKS", 1000)
    write(tmp_path / "a.h5", n=5000)
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert not drawn[0].findobj(EllipseCollection)
    assert "too many disks to draw each" in texts(drawn[0])
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
    plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
    assert "nothing moves: no kinetic theory here" in texts(drawn[0])


def test_picture_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    write(tmp_path / "a.h5")
    with pytest.raises(InputError, match="cannot be written"):
        plot.cooling(tmp_path / "a.h5", tmp_path / "nowhere" / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_missing_trajectory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        plot.cooling(tmp_path / "a.h5", tmp_path / "a.png")
