"""Movies of trajectories, a picture a frame: MP4, and WebP or GIF for web pages."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..tools.checked import Array
from ..tools.files import check_apart, write_aside
from ..trajectory import tables
from ..trajectory.reader import Frame, Trajectory
from . import disks as plot_disks
from . import run
from .style import bar_beside, is_dark, place_axes

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


ANGLES = ("angle", "orientation")  # names of fields that say how far a disk has turned
SHADES = 256  # numbers of colours; two more follow:
EMPTY, MARK = SHADES, SHADES + 1
FINER = 2  # pixels are drawn so much finer along each axis, and averaged
SAMPLES = 9  # frames that decide on the range of the colours
DPI = 100
LARGEST = (1200, 1080)
"""Width and height that a movie has at most, unless its size is given [pixels]."""
SMALL = 480
"""Width or height below which letters shrink [pixels]."""
MARGIN = 0.08  # around everything [inches]
FORMATS = (".mp4", ".webp", ".gif")


class Scene:
    """The picture of which every frame is a variant: axes, colour bar and walls are drawn once.

    Up to `disks.MOST_DISKS` disks are drawn as disks, in one of `disks.COLOURS`; of more than that a map of the area
    fraction. The range of the colours is that of the whole movie. Without a `size` (width, height) [pixels], the
    picture is as large as `LARGEST` allows, and no larger than the box and what stands around it. InputError if the
    colour is another word, or a field that is needed is not stored.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        frames: Sequence[int],
        size: tuple[int, int] | None = None,
        colour: str = "spin",
    ) -> None:
        self._trajectory, self._colour = trajectory, plot_disks.colour_of(colour, "--colour")
        self._is_map = trajectory.disks.n > plot_disks.MOST_DISKS
        trajectory.dataset("position")  # says that it is missing
        if self._colour is not None:
            trajectory.dataset(self._colour.field)
        self._angle = next((name for name in ANGLES if name in trajectory.fields), None)
        samples = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, SAMPLES).astype(int))]
        regions = [plot_disks.shown_region(trajectory, trajectory[i].position) for i in samples]
        self._region = np.column_stack([np.min(regions, axis=0)[:, 0], np.max(regions, axis=0)[:, 1]])
        self._low, self._high = self._range(samples)
        from matplotlib import rc_context, rcParams

        small = min(*(size or LARGEST), SMALL) / SMALL  # letters shrink with a small picture
        with rc_context({"font.size": small * rcParams["font.size"]}):
            self._compose(size or self._fitting())

    def _fitting(self) -> tuple[int, int]:
        """The size of the picture without empty margins [pixels]: both even, as movies want them."""
        self._compose(LARGEST)
        needed = self._canvas.figure.get_tightbbox(self._canvas.get_renderer())
        width, height = needed.width, needed.height + self._head
        return tuple(
            min(most, 2 * int(0.5 * DPI * (side + 2.0 * MARGIN) + 1.0))
            for most, side in zip(LARGEST, (width, height), strict=True)
        )  # type: ignore[return-value]

    def _compose(self, size: tuple[int, int]) -> None:
        """Draw all but the disks, walls and time."""
        from matplotlib import colormaps, rcParams
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize, to_rgb
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine

        figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
        self._canvas = FigureCanvasAgg(figure)
        self._axes = axes = figure.add_subplot()
        place_axes(axes, self._trajectory, self._region)
        scale = "map" if self._is_map else "none" if self._colour is None else self._colour.scale
        map_ = colormaps[plot_disks.DENSITIES]
        if not self._is_map and self._colour is not None:
            map_ = plot_disks.colour_map(scale, dark=is_dark(axes), kinds=round(self._high + 0.5))
        shades = map_(np.linspace(0.0, 1.0, SHADES))[:, :3]
        if scale == "none":
            shades[:] = to_rgb(plot_disks.PLAIN)
        back = to_rgb(axes.get_facecolor())
        self._shades = (255.0 * np.vstack([shades, back, back])).round().astype(np.uint8)
        if self._is_map or self._colour is not None:
            view = plot_disks.View.of(self._trajectory[0])
            drawn = ScalarMappable(Normalize(self._low, self._high), map_)
            if self._is_map or self._colour is None:
                bar_beside(axes, drawn, "area fraction", "max")
            else:
                names = self._colour.names(view)
                bar_beside(axes, drawn, self._colour.label(view), plot_disks.extend(scale), names)
        points = float(axes.title.get_fontsize())
        above = rcParams["axes.titlepad"]
        # Two lines, which may be wider than the axes: the layout leaves room above, and does not know of them.
        self._head = (above + 3.0 * points) / 72.0
        figure.set_layout_engine(
            ConstrainedLayoutEngine(
                w_pad=MARGIN, h_pad=MARGIN, rect=(0.0, 0.0, 1.0, 1.0 - self._head * DPI / size[1])
            )
        )
        look: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "ha": "center"}
        texts = (("$t$ = 0", above), (run.gas(self._trajectory), above + 1.5 * points))
        self._title, name = (
            axes.annotate(text, (0.5, 1.0), (0.0, up), fontsize=points, **look) for text, up in texts
        )
        for each in (self._title, name):
            each.set_in_layout(False)
        self._canvas.draw()
        while (width := name.get_window_extent().width) > 0.97 * size[0] and points > 3.0:
            points *= 0.95 * size[0] / width  # letters are not of every size
            name.set_fontsize(points)
        box = axes.get_window_extent()
        middle = 0.5 * name.get_window_extent().width / box.width  # of the title, kept on the picture
        at = np.clip(0.5, middle + (5.0 - box.x0) / box.width, (size[0] - 5.0 - box.x0) / box.width - middle)
        name.xy = (float(at), 1.0)
        figure.set_layout_engine("none")  # it stays as it is now
        self._title.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)
        height = self._canvas.get_width_height()[1]
        # Agg counts rows from the top.
        self._rows = slice(height - round(box.y1), height - round(box.y0))
        self._columns = slice(round(box.x0), round(box.x1))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        width, height = self._canvas.get_width_height()
        return width, height

    def _range(self, samples: Sequence[int]) -> tuple[float, float]:
        """Ends of the colours: few of the whole movie's values lie beyond."""
        if self._is_map:
            tops = [np.quantile(self._covered(i), 0.999) for i in samples]
            return 0.0, float(max(tops)) or 1.0
        if self._colour is None or not self._trajectory.disks.n:
            return 0.0, 1.0
        each = [self._values(i) for i in samples]
        if not any(np.any(values) for values in each):  # one colour says nothing
            self._colour = None
            return 0.0, 1.0
        if self._colour.scale in ("signed", "positive"):  # frames in which nothing moves say nothing
            each = [values for values in each if np.any(values)] or each[:1]
        return plot_disks.limits(self._colour.scale, np.concatenate(each))

    def _values(self, index: int) -> Array:
        """Values by which the disks are coloured, shape (n,)."""
        view = plot_disks.View.of(self._trajectory[index])
        return np.zeros(view.disks.n) if self._colour is None else self._colour.values(view)

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
            pixel = float(np.mean(np.ptp(self._region, axis=1) / (columns, rows)))
            if 2.0 * self._trajectory.disks.radius.min(initial=np.inf) < pixel:
                time += ", small disks enlarged"
        self._title.set_text(time)
        self._axes.draw_artist(self._title)
        picture = np.asarray(self._canvas.buffer_rgba())
        picture[self._rows, self._columns, :3] = pixels[::-1]
        self._draw_above(frame)
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
            np.maximum(radius[owner] * float(scale.mean()), 0.5 * FINER),  # a pixel at least
            self._numbers(self._values(index))[owner],
            empty=EMPTY,
            angle=None if self._angle is None else frame[self._angle][owner],
            mark=MARK,
        )
        fine = self._shades[drawn].reshape(rows, FINER, columns, FINER, 3)
        mean = sum(fine[:, i, :, j].astype(np.uint16) for i in range(FINER) for j in range(FINER)) // FINER**2
        return np.asarray(mean, dtype=np.uint8)

    def _draw_above(self, frame: Frame) -> None:
        """Draw what lies above the disks: walls where they are, and the frame."""
        before = set(self._axes.get_children())
        done = plot_disks.collisions_of(frame)
        plot_disks.draw_walls(self._axes, self._trajectory, frame.time, done, frame.walls)
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
    size: tuple[int, int] | None = None,
    colour: str = "spin",
    quality: int = 70,
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> int:
    """Write a movie, a picture for each of `frames` in their order, `fps` a second; returns its bytes.

    H.264 in MP4, or an animation that web pages show, by the ending: .mp4 (or none), .webp, .gif. The file appears
    whole or not at all, and replaces one that is there. `size` and `colour` as for `Scene`, both sides even; `quality`
    of WebP, 1 to 100; `progress` wraps the frames, to show how far it is. InputError if the ending is another one,
    imageio-ffmpeg is not installed (.mp4), there is nothing to draw, or the file cannot be written: a folder, a device,
    the trajectory.
    """
    kind = place.suffix.lower() or FORMATS[0]
    if kind not in FORMATS:
        raise InputError(f"output {place}: a movie is a file with the ending {', '.join(FORMATS)}")
    if len(frames) == 0 or trajectory.disks.n == 0:
        raise InputError(f"{trajectory.path}: no {'disks' if len(frames) else 'frames'} to draw")
    check_apart(place, trajectory.path)
    encode = _ffmpeg(fps) if kind == FORMATS[0] else _pillow(kind[1:], fps, quality)
    scene = Scene(trajectory, frames, size, colour)

    def whole(aside: Path) -> None:
        encode(aside, scene.size, (scene.draw(index) for index in progress(frames)))
        if not aside.exists() or aside.stat().st_size == 0:
            raise InputError(f"output {place}: nothing was written")

    write_aside(place, whole)
    return place.stat().st_size


Encoder = Callable[[Path, tuple[int, int], Iterable[NDArray[np.uint8]]], None]


def _ffmpeg(fps: int) -> Encoder:
    """H.264 in MP4."""
    ffmpeg: Any = tables.needed("imageio_ffmpeg", "movie")

    def encode(aside: Path, size: tuple[int, int], pictures: Iterable[NDArray[np.uint8]]) -> None:
        file = ffmpeg.write_frames(
            str(aside), size, fps=fps, quality=7, macro_block_size=2, ffmpeg_log_level="error",
            output_params=["-movflags", "+faststart", "-f", "mp4"],
        )  # fmt: skip
        file.send(None)
        try:
            for picture in pictures:
                file.send(picture)
        finally:
            file.close()

    return encode


def _pillow(kind: str, fps: int, quality: int) -> Encoder:
    """An animation that plays again and again."""
    from PIL import Image

    def encode(aside: Path, size: tuple[int, int], pictures: Iterable[NDArray[np.uint8]]) -> None:
        first, *others = (Image.fromarray(picture) for picture in pictures)
        how: dict[str, Any] = {"quality": quality, "method": 4} if kind == "webp" else {"optimize": True}
        first.save(
            aside, kind, save_all=True, append_images=others, duration=round(1000 / fps), loop=0, **how
        )

    return encode
