"""Style of all panels of a picture: colours, units in labels, axes."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from ..errors import InputError, option_name
from ..model.box import Box
from ..model.state import Disks
from ..model.walls.wall import Wall
from ..tools.checked import Array
from ..tools.colours import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from ..tools.labels import few_labels
from ..trajectory.descriptions import REDUCED
from .names import Ends

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Blue and vermilion hardly differ in grey (L* 46 and 54): `marks` and `dashes` tell them apart. The grey stands out against
# black and white.
TRANSLATION, ROTATION, RATIO = BLUE, VERMILION, "#777777"
OPEN: dict[str, Any] = {"mfc": "none", "ls": "none"}
"""Open markers, so that a curve below shows."""
ACROSS = SKY  # the part of the translation that is across an axis
KINDS = (BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, "#8B4513", "#999999")
"""Colours of kinds of disks and of curves."""
LOOKS: dict[str, tuple[str, bool, Any]] = dict(
    zip(
        (*KINDS, RATIO),
        (
            ("o", False, "-"), ("^", True, (0, (6.0, 1.8))), ("s", False, (0, (6.0, 1.5, 1.0, 1.5))), ("D", True, (0, (1.2, 1.2))),
            ("v", False, (0, (9.0, 1.5, 1.0, 1.5, 1.0, 1.5))), ("P", True, (0, (2.5, 1.5))), ("<", False, (0, (5.0, 5.0))),
            ("X", True, (0, (1.0, 3.5))), ("x", False, (0, (3.0, 1.5, 1.0, 1.5, 1.0, 1.5))),
        ),
        strict=True,
    )
)  # fmt: skip
"""Marker of a colour, whether it is filled, and dashes: series of one figure differ without colours, too."""
ENDS = {False: (28.0, 78.0), True: (40.0, 86.0)}
"""Lightness L* of the first and the last kind of disks, by whether the background is dark."""


def lightness(rgb: Any) -> Array:
    """Lightness L* (of 1976) of colours in sRGB (standard 61966-2-1), 0 to 1, shape (..., 3): of black 0, of white 100."""
    rgb = np.asarray(rgb, dtype=float)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    Y = linear @ (0.2126, 0.7152, 0.0722)
    return np.where(Y > (6.0 / 29.0) ** 3, 116.0 * np.cbrt(Y) - 16.0, Y * 24389.0 / 27.0)


def shades(count: int, *, dark: bool = False) -> Array:
    """Colours of so many kinds of disks, shape (count, 3): those of `KINDS`, mixed with black or white if there are several.

    Each is lighter than the one before, in up to 150 kinds, so that they differ without colours, too.
    """
    from matplotlib.colors import to_rgb

    own = np.array([to_rgb(KINDS[i % len(KINDS)]) for i in range(count)])
    if count == 1:
        return own
    wanted = np.linspace(*ENDS[dark], count)
    other = np.where(lightness(own) < wanted, 1.0, 0.0)[:, None]  # white or black
    part = np.linspace(0.0, 1.0, 201)
    mixed = own[:, None] * (1.0 - part[:, None]) + other[..., None] * part[:, None]
    return mixed[np.arange(count), np.abs(lightness(mixed) - wanted[:, None]).argmin(axis=1)]


HATCH = "////"
"""Hatching of the second of two kinds of bars."""


def marks(color: str, **more: Any) -> dict[str, Any]:
    """Markers of a series, by its colour: hollow ones show a curve below, filled ones are smaller; `more` goes before."""
    marker, filled, _ = LOOKS[color]
    if filled and "ms" in more:
        more["ms"] *= 0.8
    return {"color": color, "marker": marker, "mfc": color if filled else "none", "ls": "none", **more}


def dashes(color: str, **more: Any) -> dict[str, Any]:
    """Line of a series, by its colour."""
    return {"color": color, "ls": LOOKS[color][2], **more}


def marked_line(color: str, **more: Any) -> dict[str, Any]:
    """Line and markers of a series, by its colour."""
    return marks(color, **more) | dashes(color, **({"ls": more["ls"]} if "ls" in more else {}))


def some_marks(color: str, place: int, **more: Any) -> dict[str, Any]:
    """A line with a few markers, by its colour, which are at other places for the next `place`."""
    return marks(color, ms=4.0, markevery=(place % 8 / 64.0, 0.125), **{"ls": "-", **more})


class Bounded(Protocol):
    """A thing that has a box and walls."""

    @property
    def box(self) -> Box: ...
    @property
    def walls(self) -> tuple[Wall, ...]: ...


class Gas(Bounded, Protocol):
    """A thing that has disks in a box; its units by quantity, empty for reduced ones, None where they are not known."""

    @property
    def disks(self) -> Disks: ...
    @property
    def stated_units(self) -> dict[str, str] | None: ...


def plain(text: str) -> str:
    """A name or unit of a file as Matplotlib shows it: it would read what stands between dollar signs as a formula."""
    return text.replace("$", r"\$")


def bars(value: Array, ends: tuple[Array, Array]) -> Array:
    """Lengths of error bars below and above a value, (2, n), to the ends of its interval."""
    return np.nan_to_num(np.maximum((value - ends[0], ends[1] - value), 0.0))


def positive(values: Array) -> Array:
    """Values with nan where a logarithmic axis cannot show them, such as the temperature of spins at rest."""
    return np.where(values > 0.0, values, np.nan)


def unit_of(gas: Gas | None, quantity: str) -> str | None:
    """Unit of a quantity such as "length^2/time" in the words of a file; None in reduced or unknown units."""
    units = (gas and gas.stated_units) or {}
    words = re.findall("[a-z]+", quantity)
    if not set(words) <= units.keys():
        return None
    text = re.sub("[a-z]+", lambda word: units[word[0]], quantity)
    text = text.replace("^2", "\N{SUPERSCRIPT TWO}")
    return {"kg m/s\N{SUPERSCRIPT TWO}": "N", "kg m\N{SUPERSCRIPT TWO}/s\N{SUPERSCRIPT TWO}": "N m"}.get(
        text, plain(text)
    )


def label(gas: Gas | None, text: str, quantity: str) -> str:
    """Label of an axis, with the unit of a quantity in brackets if units are known."""
    if gas is None or gas.stated_units is None:
        return text
    return f"{text} ({unit_of(gas, quantity) or 'reduced units'})"


POWERS = str.maketrans("23", "\N{SUPERSCRIPT TWO}\N{SUPERSCRIPT THREE}")


def written(unit: str) -> str:
    """A unit in the notation of H5MD, such as "kg m2 s-2", as on an axis: kg m²/s²; "reduced" as reduced units.

    Examples
    --------
    >>> written("m s-1")
    'm/s'
    """
    if unit == REDUCED:
        return "reduced units"
    factors = [re.fullmatch(r"([^\W\d]+)(-?)(\d*)", each) for each in unit.split()]
    above: list[str] = []
    below: list[str] = []
    for one in factors:
        if one is None:
            return unit
        power = one[3].translate(POWERS) if one[3] != "1" else ""
        (below if one[2] else above).append(one[1] + power)
    return "/".join([" ".join(above) or "1" * bool(below), *below])


def with_unit(gas: Gas | None, text: str, quantity: str) -> str:
    """A text followed by the unit of a quantity, if there is one."""
    return f"{text} {unit_of(gas, quantity) or ''}".rstrip()


def is_dark(axes: Axes) -> bool:
    """True if the background is dark, as in Matplotlib's style "dark_background"."""
    from matplotlib.colors import to_rgb

    return sum(to_rgb(axes.get_facecolor())) < 1.5


def foreground(axes: Axes) -> str:
    """Colour of walls: black, or white on a dark background."""
    return "white" if is_dark(axes) else "black"


def color_bar(axes: Axes, drawn: Any, text: str, extend: str = "neither", names: Sequence[str] = ()) -> Any:
    """A colour bar next to the axes, whatever their aspect; of kinds, with their `names` instead of numbers."""
    from matplotlib.ticker import MaxNLocator

    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    part = min(max(1.0, abs((y1 - y0) / (x1 - x0))), 4.0) if axes.get_aspect() == 1.0 else 1.0
    inset = axes.inset_axes((1.0 + 0.03 * part, 0.05, 0.035 * part, 0.9))
    bar = axes.figure.colorbar(drawn, cax=inset, extend=extend, format="%.3g")
    bar.set_label(text)
    if drawn.get_cmap().N < 20:  # kinds
        bar.locator = MaxNLocator(integer=True)
        if shown := [*map(plain, names[: drawn.get_cmap().N])]:
            bar.set_ticks(range(len(shown)), labels=shown, rotation=90, va="center")
    return bar


def grid(*panels: Axes) -> None:
    """Draw grid lines at the major ticks of linear and logarithmic axes; write powers of ten as such."""
    from matplotlib.ticker import ScalarFormatter

    for axes in panels:
        axes.grid(True, which="major", lw=0.4, alpha=0.5)
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(each := axis.get_major_formatter(), ScalarFormatter):
                each.set_useMathText(True)
                each.set_powerlimits((-3, 4))


def place_axes(axes: Axes, gas: Gas | None, region: Array | None = None) -> None:
    """Make axes those of places in the box; `region`: ends of x and of y [length], shape (2, 2)."""
    if region is not None:
        axes.set(xlim=region[0], ylim=region[1])
    axes.set_aspect("equal")
    axes.set(xlabel=label(gas, "$x$", "length"), ylabel=label(gas, "$y$", "length"))


def from_zero(axes: Axes) -> None:
    """Let the vertical axis begin at 0 and end above all markers."""
    drawn = np.concatenate([[], *(np.asarray(line.get_ydata(), dtype=float) for line in axes.lines)])
    highest = np.max(drawn, where=np.isfinite(drawn), initial=0.0)
    axes.set_ylim(0.0, 1.12 * highest if highest > 0.0 else 1.0)


NARROW = 5.0
"""Width of a figure [inches] below which it has one column of panels, and legends above them."""
PAPER: Any = {
    "font.size": 8.0, "axes.titlesize": 8.0, "axes.labelsize": 8.0, "figure.titlesize": 8.0, "legend.fontsize": 7.0,
    "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "axes.linewidth": 0.6, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "xtick.minor.width": 0.4, "ytick.minor.width": 0.4, "xtick.direction": "in",
    "ytick.direction": "in", "xtick.top": True, "ytick.right": True, "font.family": "serif",
    "font.serif": ["STIX Two Text", "STIXGeneral"], "mathtext.fontset": "stix",
}  # fmt: skip
"""Settings of the style "paper": text of 7 and 8 points, thin axes with ticks on all sides, fonts of journals."""


POSTER: Any = {
    "figure.facecolor": "black", "savefig.facecolor": "black", "axes.facecolor": "black", "axes.edgecolor": "white",
    "axes.labelcolor": "white", "text.color": "white", "xtick.color": "white", "ytick.color": "white",
    "font.size": 10.0,
}  # fmt: skip
"""Settings of the style "poster": white on black."""
is_poster: ContextVar[bool] = ContextVar("is_poster", default=False)
"""True within the style "poster", whose pictures have a scale bar instead of titles and axes."""


def is_narrow(axes: Axes) -> bool:
    """True if the figure of these axes has the width of a column of a journal."""
    figure = axes.get_figure(root=True)
    return figure is not None and figure.get_size_inches()[0] < NARROW


def legend(axes: Axes, location: Literal["best", "lower right"] = "best") -> None:
    """A legend where it covers the least, in narrow figures above the axes; none without entries."""
    if is_narrow(axes):
        legend_above(axes, 2)
    elif axes.get_legend_handles_labels()[1]:
        axes.legend(loc=location, frameon=False)


def legend_above(axes: Axes, columns: int = 3) -> None:
    """A legend over the axes, in rows, where it can hide no curve; figures laid out as "constrained" make the room."""
    figure, labels = axes.get_figure(root=True), axes.get_legend_handles_labels()[1]
    if not labels or figure is None:
        return
    place, room = axes.get_subplotspec(), figure.get_figwidth()
    if place is not None:
        ratios, count = place.get_gridspec().get_width_ratios(), place.get_gridspec().ncols
        widths = np.ones(count) if ratios is None else np.asarray(ratios, dtype=float)
        room *= float(widths[list(place.colspan)].sum() / widths.sum())
    style: Any = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "fontsize": "small"}
    _fitting(
        lambda count: axes.legend(ncols=count, **style, **COMPACT),
        min(columns, len(labels)),
        room - OF_LABELS,
    )


OF_LABELS = 0.55
"""Width of the labels next to axes [inches]: a legend is centred over axes, and ends where they do."""
COMPACT: Any = {"frameon": False, "handlelength": 1.7, "columnspacing": 1.2}


def _fitting(make: Callable[[int], Any], columns: int, room: float) -> None:
    """Make a legend of so many columns, or of as many as a width [inches] has room for."""
    for count in range(columns, 0, -1):
        made = make(count)
        if count == 1 or made.get_window_extent().width <= room * made.get_figure(root=True).dpi:
            return
        made.remove()


def fit_to_column(figure: Any, panels: Sequence[Axes], *, taller: bool) -> None:
    """Draw lines and markers of a narrow figure finer; if it may be `taller`, add the height of its legends."""
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

    if not is_narrow(panels[0]):
        return
    legends = [each for axes in panels if axes.get_visible() and (each := axes.get_legend()) is not None]
    for one in (*panels, *legends):
        for line in one.get_lines() if isinstance(one, Axes) else one.findobj(Line2D):
            line.set_markersize(0.65 * line.get_markersize())
            line.set_linewidth(0.75 * line.get_linewidth())
    if taller:
        heights = (each.get_window_extent().height for each in (*legends, *figure.legends))
        figure.set_figheight(figure.get_figheight() + sum(heights) / figure.dpi)


DEFAULT_FONT, SMALLEST_FONT = 10.0, 7.0
"""Points of text in Matplotlib's own style, and of the smallest one in figures of a given width."""


@contextlib.contextmanager
def text_for(width: float, usual: float) -> Iterator[None]:
    """Smaller text in a figure that is less wide than it usually is, so that labels have the room that they need.

    Only in Matplotlib's own size of text: a style that sets another one has chosen it. Below `NARROW`, panels stand in
    one column, which has that room.
    """
    from matplotlib import rc_context, rcParams

    own = rcParams["font.size"] == DEFAULT_FONT and NARROW <= width < usual
    font = max(SMALLEST_FONT, DEFAULT_FONT * width / usual)
    with rc_context({"font.size": font} if own else {}):
        yield


def part_from_legends(figure: Any, panels: Sequence[Axes]) -> None:
    """Lift legends above axes that the power of ten at the corner of the axes would touch."""
    figure.draw_without_rendering()
    for axes in panels:
        one, offset = axes.get_legend(), axes.yaxis.get_offset_text()
        if one is None or not offset.get_text() or not axes.get_visible():
            continue
        text, box = offset.get_window_extent(), one.get_window_extent()
        if text.overlaps(box):
            height = axes.get_window_extent().height
            one.set_bbox_to_anchor((0.5, 1.0 + 1.3 * text.height / height), transform=axes.transAxes)


def frame_axes(
    panels: Sequence[Axes],
    xlim: Ends,
    ylim: Ends,
) -> None:
    """Give panels ends of their axes, None for those that stay; markers on the frame are drawn whole.

    Raises InputError if an end is not above 0 on a logarithmic axis.
    """
    for axes in panels:
        for name, ends, scale, setter in (
            ("xlim", xlim, axes.get_xscale(), axes.set_xlim), ("ylim", ylim, axes.get_yscale(), axes.set_ylim),
        ):  # fmt: skip
            for end in ends or ():
                if end is not None and scale == "log" and end <= 0.0:
                    raise InputError(
                        f"{option_name(f'--{name}', f'{name}:')} {end:g}: must be above 0 on this axis"
                    )
            if ends is not None:
                setter(*ends)
    for axes in panels:
        for name, ends in (("x", xlim), ("y", ylim)):
            if ends is not None and getattr(axes, f"get_{name}scale")() == "log":
                few_labels(axes, name)  # type: ignore[arg-type]
        _whole_markers(axes)


def _whole_markers(axes: Axes) -> None:
    """Do not cut the markers of curves whose points all lie within the frame or on it."""
    low, high = np.sort([axes.get_xlim(), axes.get_ylim()], axis=1).T
    slack = 1e-9 * (high - low)
    for line in axes.lines:
        points = np.asarray(line.get_xydata(), dtype=float)
        points = points[np.isfinite(points).all(axis=1)]
        inside = (points >= low - slack) & (points <= high + slack)
        if line.get_marker() not in ("None", "", None) and inside.all():
            line.set_clip_on(False)
            line.set_in_layout(False)  # the frame holds it; asked for their room, curves left none for panels


def chosen_panels(count: int, numbers: Sequence[int] | None) -> list[int]:
    """Places of the panels that are drawn, from 0; all without numbers, which count from 1.

    Raises InputError if there is no panel of a number.
    """
    if numbers is None:
        return [*range(count)]
    if wrong := [each for each in numbers if not 1 <= each <= count]:
        what = f"the picture has {count} panel{'s' * (count > 1)}"
        raise InputError(f"{option_name('--panels', 'panels:')} {wrong[0]}: {what}, numbered from 1")
    return [each - 1 for each in dict.fromkeys(numbers)]


def keep_panels(figure: Any, panels: Sequence[Axes], kept: Sequence[int], columns: int) -> list[Axes]:
    """Remove all panels but some, which move up into so many columns."""
    if len(kept) == len(panels):
        return [*panels]
    shown = [panels[i] for i in kept]
    for axes in panels:
        if axes not in shown:
            axes.set_visible(False)
            axes.set_in_layout(False)
    columns = min(columns, len(shown))
    grid = figure.add_gridspec(-(-len(shown) // columns), columns)
    for i, axes in enumerate(shown):
        axes.set_subplotspec(grid[i // columns, i % columns])
        axes.tick_params(axis="both", labelbottom=True, labelleft=True)
    return shown


def legend_of_figure(figure: Any, axes: Axes, columns: int = 2) -> None:
    """The legend of one panel below all panels of a figure that is laid out as "constrained"."""
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        style: Any = {"loc": "outside lower center", **COMPACT}
        _fitting(
            lambda count: figure.legend(handles, labels, ncols=count, **style), min(columns, len(labels)),
            figure.get_figwidth(),
        )  # fmt: skip
