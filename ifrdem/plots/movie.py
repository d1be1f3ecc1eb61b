"""Movies of trajectories, a picture a frame: MP4, and WebP or GIF for web pages."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from PIL import Image

from ..errors import InputError, option_name, printable
from ..tools.checked import Array
from ..tools.files import REMEDIES, check_apart, write_aside
from ..trajectory import tables
from ..trajectory.reader import Trajectory
from . import disks as plot_disks
from . import poster, run
from .style import color_bar, is_dark, is_poster, place_axes

MARK_WIDTH = 0.18  # half the width of an orientation mark, in radii
LEAST_MARKED = 2.5  # radius [pixels] below which no mark would be seen
ANGLES = ("angle", "orientation")  # names of fields that say how far a disk has turned
SAMPLES = 9  # frames that decide on the range of the colours
DPI = 100
LARGEST = (1200, 1080)
"""Width and height that a movie has at most, unless its size is given [pixels]."""
SMALL = 480
"""Width or height below which letters shrink [pixels]."""
MARGIN = 0.08  # around everything [inches]
FORMATS = (".mp4", ".webp", ".gif")
CRF = "15"  # constant rate factor of H.264, 0 to 51: 18 is held for visually lossless


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
        color: str = "spin",
    ) -> None:
        self._trajectory, self._colour = (
            trajectory,
            plot_disks.colour_of(color, option_name("--color", "color =")),
        )
        self._is_map = trajectory.n > plot_disks.MOST_DISKS
        trajectory.require("position")
        if self._colour is not None:
            trajectory.require(self._colour.field)
        self._angle = next((name for name in ANGLES if name in trajectory.fields), None)
        samples = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, SAMPLES).astype(int))]
        regions = [plot_disks.shown_region(trajectory, trajectory[i].position) for i in samples]
        self._region = np.column_stack([np.min(regions, axis=0)[:, 0], np.max(regions, axis=0)[:, 1]])
        self._low, self._high = self._range(samples)
        small = min(*(size or LARGEST), SMALL) / SMALL  # letters shrink with a small picture
        with rc_context({"font.size": small * rcParams["font.size"]}):
            self._compose(size or self._fitting())

    def _fitting(self) -> tuple[int, int]:
        """The size of the picture without empty margins [pixels]: both even, as movies want them."""
        if is_poster.get():
            across, up = np.ptp(self._region, axis=1)
            shape = float(up / across) + poster.STRIP
            width = min(LARGEST[0], LARGEST[1] / shape)
            return 2 * int(0.5 * width), 2 * int(0.5 * width * shape)
        self._compose(LARGEST)
        needed = self._canvas.figure.get_tightbbox(self._canvas.get_renderer())
        width, height = needed.width, needed.height + self._head
        return tuple(
            min(most, 2 * int(0.5 * DPI * (side + 2.0 * MARGIN) + 1.0))
            for most, side in zip(LARGEST, (width, height), strict=True)
        )  # type: ignore[return-value]

    def _compose(self, size: tuple[int, int]) -> None:
        """Draw all but the disks, walls and time."""
        figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
        self._canvas = FigureCanvasAgg(figure)
        self._axes = axes = figure.add_subplot()
        place_axes(axes, self._trajectory, self._region)
        self._head = 0.0
        if is_poster.get():
            self._add_colours(axes)
            poster.finish(axes, self._trajectory, self._region)
            poster.arrange(figure, [axes])
            self._title = axes.annotate("", (0.5, 0.5), visible=False, animated=True)
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(figure.bbox)
            return
        self._add_colours(axes)
        self._add_head(figure, axes, size)

    def _add_colours(self, axes: Axes) -> None:
        """Choose the colours of the disks or the map, and draw the colour bar."""
        self._style: dict[str, Any] = {"norm": Normalize(self._low, self._high)}
        if self._is_map:
            self._style["cmap"] = colormaps[plot_disks.DENSITIES]
            color_bar(axes, ScalarMappable(**self._style), "area fraction", "max")
        elif self._colour is not None:
            scale, view = self._colour.scale, plot_disks.View.of(self._trajectory[0])
            kinds = round(self._high + 0.5)
            self._style["cmap"] = plot_disks.colour_map(scale, dark=is_dark(axes), kinds=kinds)
            label, names = self._colour.label(view), self._colour.names(view)
            color_bar(axes, ScalarMappable(**self._style), label, plot_disks.extend(scale), names)

    def _add_head(self, figure: Figure, axes: Axes, size: tuple[int, int]) -> None:
        """Lay out the figure with the name of the gas and the time above the axes."""
        points = float(axes.title.get_fontsize())
        above = rcParams["axes.titlepad"]
        # Two lines, which may be wider than the axes: the layout leaves room above, and does not know of them.
        self._head = (above + 3.0 * points) / 72.0
        figure.set_layout_engine(
            ConstrainedLayoutEngine(
                w_pad=MARGIN, h_pad=MARGIN, rect=(0.0, 0.0, 1.0, 1.0 - self._head * DPI / size[1])
            )
        )
        style: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "ha": "center"}
        texts = (("$t$ = 0", above), (run.gas(self._trajectory), above + 1.5 * points))
        self._title, name = (
            axes.annotate(text, (0.5, 1.0), (0.0, up), fontsize=points, **style) for text, up in texts
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
        if self._colour is None or not self._trajectory.n:
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
        assert self._colour is not None
        return self._colour.values(plot_disks.View.of(self._trajectory[index]))

    def _covered(self, index: int) -> Array:
        return plot_disks.area_fraction(self._trajectory, self._trajectory[index].position, self._region)

    def draw(self, index: int) -> NDArray[np.uint8]:
        """The picture of a frame, shape (height, width, 3)."""
        frame, before = self._trajectory[index], set(self._axes.get_children())
        about = self._draw_map(index) if self._is_map else self._draw_disks(index)
        done = plot_disks.collisions_of(frame)
        plot_disks.draw_walls(self._axes, self._trajectory, frame.time, done, frame.walls)
        self._title.set_text(f"$t$ = {self._trajectory.with_unit(f'{frame.time:.4g}', 'time')}{about}")
        drawn = [each for each in self._axes.get_children() if each not in before]
        self._canvas.restore_region(self._background)
        # Walls lie above the disks, and the frame above walls.
        for artist in (*drawn, *self._axes.spines.values(), self._title):
            self._axes.draw_artist(artist)
        for artist in drawn:
            artist.remove()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _draw_map(self, index: int) -> str:
        """Draw the area fraction; return text about it for the title."""
        covered = self._covered(index)
        extent = (*self._region[0], *self._region[1])
        self._axes.imshow(covered.T, origin="lower", extent=extent, interpolation="nearest", **self._style)
        cells = self._trajectory.with_unit(f"{plot_disks.cell_side(covered, self._region):.3g}", "length")
        return f", cells of {cells}"

    def _draw_disks(self, index: int) -> str:
        """Draw disks and their angles; return text about them for the title."""
        frame, radius, box = self._trajectory[index], self._trajectory.disks.radius, self._axes.bbox
        pixel = float(np.mean(np.ptp(self._region, axis=1) / (box.width, box.height)))
        drawn, owner = plot_disks.add_disks(self._axes, plot_disks.View.of(frame), pixel)
        if self._colour is None:
            drawn.set_facecolor(plot_disks.PLAIN)
        else:
            drawn.set(array=self._values(index)[owner], **self._style)
        if self._angle is not None and radius.max(initial=0.0) > LEAST_MARKED * pixel:
            angle = frame[self._angle][owner, None]
            along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            across = MARK_WIDTH * np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
            corners = np.concatenate([-across, across, along + across, along - across], axis=1)
            marks = np.asarray(drawn.get_offsets())[:, None] + radius[owner, None, None] * corners
            self._axes.add_collection(PolyCollection(marks, color=self._axes.get_facecolor(), linewidths=0.0))
        return ", small disks enlarged" if 2.0 * radius.min(initial=np.inf) < pixel else ""


def write(
    trajectory: Trajectory,
    output: Path,
    frames: Sequence[int],
    *,
    fps: int = 25,
    size: tuple[int, int] | None = None,
    color: str = "spin",
    quality: int = 70,
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> int:
    """Write a movie, a picture for each of `frames` in their order, `fps` a second; returns its bytes.

    H.264 in MP4, or an animation that web pages show, by the ending: .mp4 (or none), .webp, .gif. The file appears
    whole or not at all, and replaces one that is there. `size` and `color` as for `Scene`, both sides even; `quality`
    of WebP, 1 to 100; `progress` wraps the frames, to show how far it is. InputError if the ending is another one,
    imageio-ffmpeg is not installed (.mp4), there is nothing to draw, or the file cannot be written: a folder, a device,
    the trajectory.
    """
    kind = output.suffix.lower() or FORMATS[0]
    if kind not in FORMATS:
        raise InputError(f"output {output}: a movie is a file with the ending {', '.join(FORMATS)}")
    if len(frames) == 0 or trajectory.n == 0:
        raise InputError(f"{trajectory.path}: no {'disks' if len(frames) else 'frames'} to draw")
    check_apart(output, trajectory.path)
    encode = _ffmpeg(fps) if kind == FORMATS[0] else _pillow(kind[1:], fps, quality)
    scene = Scene(trajectory, frames, size, color)
    pictures = (scene.draw(index) for index in progress(frames))
    write_aside(output, lambda aside: encode(aside, scene.size, pictures))
    return output.stat().st_size


Encoder = Callable[[Path, tuple[int, int], Iterable[NDArray[np.uint8]]], None]


def _ffmpeg(fps: int) -> Encoder:
    """H.264 in MP4, by the program that imageio-ffmpeg brings; its `write_frames` does not tell of a full disk."""
    program: str = tables.optional_import("imageio_ffmpeg", "movie").get_ffmpeg_exe()

    def encode(aside: Path, size: tuple[int, int], pictures: Iterable[NDArray[np.uint8]]) -> None:
        words = [
            program, "-y", "-f", "rawvideo", "-vcodec", "rawvideo", "-s", f"{size[0]}x{size[1]}", "-pix_fmt", "rgb24",
            "-r", str(fps), "-i", "-", "-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-crf", CRF, "-v", "error",
            "-movflags", "+faststart", "-f", "mp4", str(aside),
        ]  # fmt: skip
        # Ctrl-C is for this process, which then ends the other one. A limit on files is an error there, no signal.
        process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            start_new_session=True, restore_signals=False,
        )  # fmt: skip
        try:
            with contextlib.suppress(BrokenPipeError):  # the program has ended, and says why
                for picture in pictures:
                    process.stdin.write(picture.tobytes())  # type: ignore[union-attr]  # a pipe
            messages = process.communicate()[1].decode(errors="replace")
        except BaseException:
            process.kill()
            process.communicate()
            raise
        if process.returncode:
            known = (one for one in REMEDIES if os.strerror(one) in messages)
            if (number := next(known, None)) is not None:
                raise OSError(number, os.strerror(number))
            raise OSError(f"ffmpeg: {printable((messages.strip().splitlines() or ['it has failed'])[0])}")

    return encode


def _pillow(kind: str, fps: int, quality: int) -> Encoder:
    """An animation that plays again and again."""

    def encode(aside: Path, size: tuple[int, int], pictures: Iterable[NDArray[np.uint8]]) -> None:
        first, *others = (Image.fromarray(picture) for picture in pictures)
        how: dict[str, Any] = {"quality": quality, "method": 4} if kind == "webp" else {"optimize": True}
        held = io.BytesIO()
        first.save(held, kind, save_all=True, append_images=others, duration=round(1000 / fps), loop=0, **how)
        aside.write_bytes(held.getbuffer())

    return encode
