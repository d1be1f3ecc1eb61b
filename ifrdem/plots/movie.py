"""Movies of trajectories: MP4, a picture a frame."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, nearest
from ..tools.checked import Array
from ..tools.files import check_apart, write_aside
from ..trajectory import tables
from ..trajectory.reader import Trajectory
from . import disks as plot_disks
from . import run
from .style import label, place_axes

MARK_WIDTH = 0.18  # half the width of an orientation mark, in radii
LEAST_MARKED = 5.0  # radius [pixels] below which no mark would be seen


def draw(
    shape: tuple[int, int],
    place: Array,
    radius: Array,
    number: NDArray[np.integer],
    *,
    empty: int,
    angle: Array | None = None,
    mark: int = 0,
) -> NDArray[np.uint16]:
    """The number of the disk's colour at each pixel of an image (rows, columns), row 0 at the bottom.

    Centres (n, 2) are in pixels from the lower left corner, and may lie beyond the image; radii (n,) too, half a pixel
    at least. `empty` is the number where there is no disk, `mark` that of the line from the centre to the rim at each
    disk's `angle` (n,) [rad].
    """
    image = np.full(shape, empty, dtype=np.uint16)
    radius = np.maximum(radius, 0.5)
    # Disks of about one size share their window.
    size = np.ceil(2.0 * np.log2(radius)).astype(int)
    for each in np.unique(size):
        some = np.flatnonzero(size == each)
        angles = None if angle is None or radius[some].max() < LEAST_MARKED else angle[some]
        window = int(np.ceil(radius[some].max())) + 1
        stamp = _one_by_one if len(some) < (2 * window + 1) ** 2 else _by_offset
        stamp(image, place[some], radius[some], number[some], window, angles, mark)
    return image


def _by_offset(
    image: NDArray[np.uint16], place: Array, radius: Array, number: NDArray[np.integer], window: int,
    angle: Array | None, mark: int,
) -> None:  # fmt: skip
    """Many small disks: all of them at once for each pixel of a window around the centre."""
    rows, columns = image.shape
    corner = np.floor(place).astype(np.int64)
    inside = place - corner
    steps = range(-window, window + 1)
    for dy, dx in itertools.product(steps, steps):
        x, y = dx + 0.5 - inside[:, 0], dy + 0.5 - inside[:, 1]
        column, row = corner[:, 0] + dx, corner[:, 1] + dy
        hit = (
            (x * x + y * y <= radius * radius)
            & (row >= 0)
            & (row < rows)
            & (column >= 0)
            & (column < columns)
        )
        colour = number[hit]
        if angle is not None:
            colour = np.where(_marked(x[hit], y[hit], radius[hit], angle[hit]), mark, colour)
        image[row[hit], column[hit]] = colour


def _one_by_one(
    image: NDArray[np.uint16], place: Array, radius: Array, number: NDArray[np.integer], window: int,
    angle: Array | None, mark: int,
) -> None:  # fmt: skip
    """Few large disks: all pixels of the window at once for each disk."""
    for i, corner in enumerate(np.floor(place).astype(int) - window):
        (left, bottom), (right, top) = (
            np.maximum(corner, 0),
            np.minimum(corner + 2 * window + 1, image.shape[::-1]),
        )
        if left >= right or bottom >= top:
            continue
        y = (np.arange(bottom, top) + 0.5 - place[i, 1])[:, None]
        x = (np.arange(left, right) + 0.5 - place[i, 0])[None, :]
        hit = x * x + y * y <= radius[i] ** 2
        part = image[bottom:top, left:right]
        part[hit] = number[i]
        if angle is not None:
            part[hit & _marked(x, y, radius[i], angle[i])] = mark


def _marked(x: Array, y: Array, radius: Array | np.float64, angle: Array | np.float64) -> NDArray[np.bool_]:
    """Mask of places (x, y) from the centre that lie on the mark."""
    along = x * np.cos(angle) + y * np.sin(angle)
    across = y * np.cos(angle) - x * np.sin(angle)
    return (along >= 0.0) & (np.abs(across) <= MARK_WIDTH * radius)


COLOURS = ("spin", "temperature")
ANGLES = ("angle", "orientation")  # names of fields that say how far a disk has turned
SHADES = 256  # numbers of colours; two more follow:
EMPTY, MARK = SHADES, SHADES + 1
FINER = 2  # pixels are drawn so much finer along each axis, and averaged
SAMPLES = 9  # frames that decide on the range of the colours
DPI = 100


class Scene:
    """The picture of which every frame is a variant: axes, colour bar and walls are drawn once.

    Up to `disks.MOST_DISKS` disks are drawn as disks, coloured by "spin" or by the "temperature" of each, m c^2 / 2
    with the velocity c relative to the mean flow of a sheared box; of more than that a map of the area fraction. The
    range of the colours is that of the whole movie. InputError if the colour is another word, or a field that is needed
    is not stored.
    """

    def __init__(
        self, trajectory: Trajectory, frames: Sequence[int], size: tuple[int, int], colour: str = "spin"
    ) -> None:
        if colour not in COLOURS:
            raise InputError(f"--colour {colour}: allowed are {', '.join(COLOURS)}{nearest(colour, COLOURS)}")
        from matplotlib import colormaps
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
        from matplotlib.figure import Figure

        self._trajectory, self._colour = trajectory, colour
        self._is_map = trajectory.disks.n > plot_disks.MOST_DISKS
        trajectory.dataset("position")  # says that it is missing
        self._angle = next((name for name in ANGLES if name in trajectory.fields), None)
        samples = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, SAMPLES).astype(int))]
        regions = [plot_disks.shown_region(trajectory, trajectory[i].position) for i in samples]
        self._region = np.column_stack([np.min(regions, axis=0)[:, 0], np.max(regions, axis=0)[:, 1]])
        self._low, self._high = low, high = self._range(samples)
        map_ = colormaps[plot_disks.DENSITIES]
        if colour == "spin" and not self._is_map:
            map_ = LinearSegmentedColormap.from_list("spins", plot_disks.SPINS)
        shades = map_(np.linspace(0.0, 1.0, SHADES))[:, :3]
        self._shades = (
            (255.0 * np.vstack([shades, to_rgb("white"), to_rgb("white")])).round().astype(np.uint8)
        )

        figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI, layout="compressed")
        self._canvas = FigureCanvasAgg(figure)
        self._axes = axes = figure.add_subplot()
        place_axes(axes, trajectory, self._region)
        bar = figure.colorbar(
            ScalarMappable(Normalize(low, high), map_), ax=axes, shrink=0.85,
            extend="both" if colour == "spin" and not self._is_map else "max",
        )  # fmt: skip
        bar.set_label(self._label())
        figure.suptitle(run.gas(trajectory))
        self._title = axes.set_title("$t$ = 0")
        self._canvas.draw()
        figure.set_layout_engine("none")  # it stays as it is now
        self._title.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)
        box = axes.get_window_extent()
        height = self._canvas.get_width_height()[1]
        # Agg counts rows from the top.
        self._rows = slice(height - round(box.y1), height - round(box.y0))
        self._columns = slice(round(box.x0), round(box.x1))

    def _label(self) -> str:
        if self._is_map:
            return "area fraction"
        if self._colour == "spin":
            return plot_disks.spin_label(self._trajectory)
        return label(self._trajectory, "temperature of each disk $m c^2 / 2$", "energy")

    def _range(self, samples: Sequence[int]) -> tuple[float, float]:
        """Ends of the colours: few of the whole movie's values lie beyond."""
        if self._is_map:
            tops = [np.quantile(self._covered(i), 0.999) for i in samples]
            return 0.0, float(max(tops)) or 1.0
        tops = [np.quantile(np.abs(self._values(i)), 0.95) for i in samples if self._trajectory.disks.n]
        top = float(np.median(tops)) if tops else 1.0
        top = top if top > 0.0 else 1.0
        return (-top, top) if self._colour == "spin" else (0.0, top)

    def _values(self, index: int) -> Array:
        """Values by which the disks are coloured, shape (n,)."""
        frame, mass = self._trajectory[index], self._trajectory.disks.mass
        if self._colour == "spin":
            return frame.spin
        movable = self._trajectory.disks.movable
        return 0.5 * np.where(movable, mass, 0.0) * np.sum(frame.peculiar_velocity**2, axis=1)

    def _covered(self, index: int) -> Array:
        return plot_disks.area_fraction(self._trajectory, self._trajectory[index].position, self._region)

    def draw(self, index: int) -> NDArray[np.uint8]:
        """The picture of a frame, shape (height, width, 3)."""
        frame = self._trajectory[index]
        self._canvas.restore_region(self._background)
        time = f"$t$ = {self._trajectory.with_unit(f'{frame.time:.4g}', 'time')}"
        rows, columns = self._rows.stop - self._rows.start, self._columns.stop - self._columns.start
        if self._is_map:
            covered = self._covered(index)
            cells = self._trajectory.with_unit(f"{plot_disks.cell_side(covered, self._region):.3g}", "length")
            time += f", cells of {cells}"
            x = np.arange(columns) * covered.shape[0] // columns
            y = np.arange(rows) * covered.shape[1] // rows
            pixels = self._shades[self._numbers(covered)[x[None, :], y[:, None]]]
        else:
            pixels = self._disks(index, rows, columns)
        self._title.set_text(time)
        self._axes.draw_artist(self._title)
        picture = np.asarray(self._canvas.buffer_rgba())
        picture[self._rows, self._columns, :3] = pixels[::-1]
        self._draw_above(frame.time)
        return picture[..., :3].copy()

    def _numbers(self, values: Array) -> NDArray[np.intp]:
        part = (values - self._low) / (self._high - self._low)
        return (np.clip(part, 0.0, 1.0) * (SHADES - 1) + 0.5).astype(np.intp)

    def _disks(self, index: int, rows: int, columns: int) -> NDArray[np.uint8]:
        trajectory, frame = self._trajectory, self._trajectory[index]
        radius = trajectory.disks.radius
        position, owner = plot_disks.with_images(frame.position, radius, trajectory.box, frame.time)
        scale = FINER * np.array([columns, rows]) / np.ptp(self._region, axis=1)
        drawn = draw(
            (FINER * rows, FINER * columns),
            (position - self._region[:, 0]) * scale,
            radius[owner] * float(scale.mean()),
            self._numbers(self._values(index))[owner],
            empty=EMPTY,
            angle=None if self._angle is None else frame[self._angle][owner],
            mark=MARK,
        )
        fine = self._shades[drawn].reshape(rows, FINER, columns, FINER, 3)
        mean = sum(fine[:, i, :, j].astype(np.uint16) for i in range(FINER) for j in range(FINER)) // FINER**2
        return np.asarray(mean, dtype=np.uint8)

    def _draw_above(self, time: float) -> None:
        """Draw what lies above the disks: walls where they are, and the frame."""
        before = set(self._axes.get_children())
        plot_disks.draw_walls(self._axes, self._trajectory, time)
        walls = [each for each in self._axes.get_children() if each not in before]
        for artist in (*walls, *self._axes.spines.values()):
            self._axes.draw_artist(artist)
        for artist in walls:
            artist.remove()


def write(
    trajectory: Trajectory,
    place: Path,
    frames: Sequence[int],
    *,
    fps: int = 25,
    size: tuple[int, int] = (1200, 1080),
    colour: str = "spin",
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> None:
    """Write a movie (H.264 in MP4), a picture for each of `frames` in their order, `fps` a second.

    The file appears whole or not at all, and replaces one that is there. `size` is (width, height) in pixels, both
    even; `colour` as for `Scene`; `progress` wraps the frames, to show how far it is. InputError if imageio-ffmpeg is
    not installed, there is nothing to draw, or the file cannot be written: a folder, a device, the trajectory itself.
    """
    ffmpeg: Any = tables.needed("imageio_ffmpeg", "movie")
    if len(frames) == 0 or trajectory.disks.n == 0:
        raise InputError(f"{trajectory.path}: no {'disks' if len(frames) else 'frames'} to draw")
    check_apart(place, trajectory.path)
    scene = Scene(trajectory, frames, size, colour)

    def encode(aside: Path) -> None:
        pictures = ffmpeg.write_frames(
            str(aside), size, fps=fps, quality=7, macro_block_size=2, ffmpeg_log_level="error",
            output_params=["-movflags", "+faststart", "-f", "mp4"],
        )  # fmt: skip
        pictures.send(None)
        try:
            for index in progress(frames):
                pictures.send(scene.draw(index))
        finally:
            pictures.close()
        if not aside.exists() or aside.stat().st_size == 0:
            raise InputError(f"output {place}: ffmpeg wrote nothing")

    write_aside(place, encode)
