"""Figures in the style "poster": disks on black, with a scale bar and a key of the colours instead of titles and axes."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..tools.checked import Array
from . import disks
from .style import Gas, color_bar, lightness, unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .disks import Colour, View

PICTURES = ("disks", "fields")
"""Pictures that have this style: maps of the disks."""
STRIP = 0.055
"""Height of the strip below a map, for the scale bar, as part of the width of the map."""
CELL = 1.8
"""Side of the cells of a map of many disks, in mean diameters."""
FULL = 0.6
"""Area fraction at which a cell has its full colour."""


def sides(gas: Gas, position: Array, panels: int = 1) -> tuple[float, float]:
    """Width and height of a figure of maps of the disks [inches]."""
    width, height = np.ptp(disks.shown_region(gas, position), axis=1)
    side = 7.5 / max(1.0, float(height / width) / 1.3)
    return side * panels, side * (float(height / width) + STRIP)


def frame(axes: Axes, view: View, color: str) -> None:
    """Draw the disks of a frame with its walls; of many disks a map, brighter with area fraction."""
    colour = disks.colour_of(color)
    region = disks.shown_region(view, view.moving.position)
    axes.set(xlim=region[0], ylim=region[1], aspect="equal")
    if view.disks.n > disks.MOST_DISKS:
        extent = (*region[0], *region[1])
        picture = cells(view, colour, region).swapaxes(0, 1)
        axes.imshow(picture, origin="lower", extent=extent, interpolation="antialiased")
    else:
        disks.add_colored(axes, view, colour)
    if colour is not None:
        _color_bar(axes, view, colour)
    disks.draw_walls(axes, view, view.time, disks.collisions_of(view.moving))
    finish(axes, view, region)


def _color_bar(axes: Axes, view: View, colour: Colour) -> None:
    """The colour bar of a frame, of which `finish` makes the key; none where all disks have one colour."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    values = colour.values(view)
    if not len(values) or np.all(values == values[:1]):
        return
    low, high = disks.limits(colour.scale, values)
    map_ = disks.colour_map(colour.scale, dark=True, kinds=round(high + 0.5))
    color_bar(axes, ScalarMappable(Normalize(low, high), map_), colour.label(view), names=colour.names(view))


def finish(axes: Axes, gas: Gas, region: Array, panels: int = 1) -> None:
    """Remove titles and axes; add the scale bar and the key of the colours below the map.

    The key is made of the colour bar, which goes. Texts are larger with more `panels`.
    """
    axes.set(title="", xlabel="", ylabel="", xticks=[], yticks=[])
    bars = [bar for each in axes.child_axes if (bar := getattr(each, "_colorbar", None)) is not None]
    for each in (*axes.child_axes,):
        each.remove()
    width = float(np.ptp(region[0]))
    # A round number of what the label counts: units of the file, or mean diameters.
    one = 1.0 if unit_of(gas, "length") else 2.0 * float(gas.disks.radius.mean())
    count = scale_length(width / one)
    length = count * one
    for name, spine in axes.spines.items():
        axis = 0 if name in ("left", "right") else 1
        spine.set_visible(not gas.box.periodic[axis] and not gas.box.is_open)
    style: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "clip_on": False}
    down = -0.4 * STRIP * width / float(np.ptp(region[1]))
    left = float(region[0, 0]) + 0.01 * width
    axes.plot(
        [left, left + length], [down, down], color="white", lw=2.0 * panels, solid_capstyle="butt", **style
    )
    unit = unit_of(gas, "length") or ("mean diameter" if count == 1.0 else "mean diameters")
    text = f"{count:g} {unit}"
    style |= {"color": "white", "va": "center", "fontsize": 10.0 * min(panels, 2)}
    axes.text(left + length + 0.012 * width, down, text, **style)
    points = 72.0 * STRIP * float(axes.get_figure(root=True).get_figwidth()) / panels  # type: ignore[union-attr]
    for bar in bars:
        _key(axes, bar, down, min(0.33 * points, 8.0 * min(panels, 2)))


KEY = (0.66, 0.2)
"""Left end and width of the key of colours, as parts of the width of the map."""
ARROWS = "\N{LEFTWARDS ARROW}\N{DOWNWARDS ARROW}\N{RIGHTWARDS ARROW}\N{UPWARDS ARROW}\N{LEFTWARDS ARROW}"
"""Directions from -180 to 180 degrees."""


def _key(axes: Axes, bar: Any, down: float, size: float) -> None:
    """The colours of a bar, with its label, and its ends, or the directions or kinds that they mean."""
    left, width = KEY
    height = -0.9 * down
    inset = axes.inset_axes((left, down - 0.5 * height, width, height))
    inset.imshow(np.linspace(0.0, 1.0, 256)[None], cmap=bar.cmap, aspect="auto", extent=(0.0, 1.0, 0.0, 1.0))
    inset.set(xticks=[], yticks=[])
    for spine in inset.spines.values():
        spine.set_visible(False)
    style: dict[str, Any] = {"va": "center", "fontsize": size}
    names = [each.get_text() for each in bar.ax.get_yticklabels()] if bar.cmap.N < 20 else []
    if (bar.norm.vmin, bar.norm.vmax) == (-180.0, 180.0):
        for i, arrow in enumerate(ARROWS):
            place, side = (0.02, 0.25, 0.5, 0.75, 0.98)[i], ("left", *["center"] * 3, "right")[i]
            inset.text(place, 0.5, arrow, color=_ink(bar.cmap(0.25 * i)), ha=side, weight="bold", **style)
    elif len(names) == bar.cmap.N:
        for i, name in enumerate(names):
            inset.text((i + 0.5) / len(names), 0.5, name, color=_ink(bar.cmap(i)), ha="center", **style)
    else:
        style |= {"color": "white", "transform": axes.transAxes}
        text = textwrap.fill(str(bar.ax.get_ylabel()).splitlines()[0], 36)
        axes.text(left - 0.01, down, f"{bar.norm.vmin:.3g}", ha="right", **style)
        axes.text(left + width + 0.01, down, f"{bar.norm.vmax:.3g}", ha="left", **style)
        axes.text(left - 0.08, down, text, ha="right", **style | {"fontsize": 0.8 * size})


def _ink(colour: tuple[float, ...]) -> str:
    """The colour of text on a colour."""
    return "black" if lightness(colour[:3]) > 50.0 else "white"


def scale_length(width: float) -> float:
    """The largest length of 1, 2 or 5 times a power of ten that is at most an eighth of a width."""
    power = 10.0 ** math.floor(math.log10(width / 8.0))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= width / 8.0 * (1.0 + 1e-9))


def cells(view: View, colour: Colour | None, region: Array) -> NDArray[np.float64]:
    """RGB of cells of a region, shape (cells along x, along y, 3): means over the disks of each, by their area."""
    from matplotlib.colors import Normalize, to_rgb

    radius, position = view.disks.radius, view.moving.position
    lengths = np.ptp(region, axis=1)
    side = CELL * 2.0 * float(np.sqrt(np.mean(radius**2)))
    counts = np.clip(np.rint(lengths / side), 1, 4000).astype(int)
    part = np.floor((position - region[:, 0]) / lengths * counts).astype(int)
    inside = ((part >= 0) & (part < counts)).all(axis=1)
    which = part[inside, 0] * counts[1] + part[inside, 1]
    area = np.pi * radius[inside] ** 2

    def total(weights: Array) -> Array:
        return np.bincount(which, weights, int(counts.prod())).astype(np.float64)

    covered = total(area)
    bright = np.clip(covered * float(counts.prod() / np.prod(lengths)) / FULL, 0.0, 1.0) ** 0.8
    if colour is None:
        hues = np.array(to_rgb(disks.PLAIN))[None]
    else:
        values = colour.values(view)
        low, high = disks.limits(colour.scale, values)
        mean = _means(values[inside], area, total, covered, cyclic=colour.scale == "cyclic")
        map_ = disks.colour_map(colour.scale, dark=True, kinds=round(high + 0.5))
        hues = map_(Normalize(low, high)(mean))[:, :3]
    return np.asarray((hues * bright[:, None]).reshape(*counts, 3))


def _means(values: Array, area: Array, total: Any, covered: Array, *, cyclic: bool) -> Array:
    """Mean value of each cell by area; of directions [degrees] that of their unit vectors."""
    if cyclic:
        angle = np.radians(values)
        return np.degrees(np.arctan2(total(area * np.sin(angle)), total(area * np.cos(angle))))
    return np.asarray(total(area * values) / np.where(covered > 0.0, covered, 1.0))


def arrange(figure: Figure, panels: Any) -> None:
    """Fill the figure with its maps."""
    figure.set_layout_engine("none")
    count = len(panels)
    strip = STRIP * figure.get_figwidth() / count / figure.get_figheight()
    for i, axes in enumerate(panels):
        axes.set_position((i / count + 0.005, strip, 1.0 / count - 0.01, 1.0 - strip - 0.005))
