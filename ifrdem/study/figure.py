"""Figures of a study: a quantity over another, with bands of its standard error and kinetic theory."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.names import ANALYSES, OVER_TIME
from ..analysis.result import identifier
from ..errors import InputError, nearest, option_name
from ..plots.names import Ends
from ..plots.style import (
    KINDS,
    NARROW,
    chosen_panels,
    fit_to_column,
    frame_axes,
    grid,
    is_narrow,
    legend_above,
    legend_of_figure,
    marks,
    plain,
    some_marks,
    text_for,
    written,
)
from ..quantities import SERIES
from ..theory.choose import is_closed
from ..tools.intervals import PERCENT
from ..tools.labels import few_labels
from ..trajectory.descriptions import REDUCED, unit_of_whole_gas
from ..trajectory.reader import Trajectory
from ..trajectory.tables import PER_DISK, at_equal_collisions
from .draws import COEFFICIENTS
from .lines import theory_between
from .plan import VARIANT
from .pooled import half_of_both, is_drawn, is_pooled, parts_of_interval, pooled
from .results import (
    ADDING,
    GIVEN_START,
    PARTS,
    ROWS,
    SERIES_FROM,
    SHORT,
    START,
    THEORY,
    VELOCITY_WORDS,
    Results,
    averaged,
    finite_seeds,
    half_interval,
    theory_of,
    window_starts,
    with_theory,
)
from .task import AT, NOTES, WARNINGS, Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SYMBOLS = {
    "temperature": "$T$",
    "rotational_temperature": r"$T_\mathrm{rot}$",
    "theta": r"$\theta = T_\mathrm{rot} / T$",
    PER_DISK: r"collisions per disk $\tau$",
    "time": "time $t$",
}
KEY_SYMBOLS = {
    "e_n": "$e_n$", "e_t": "$e_t$", "mu": r"$\mu$", "rho": r"$\rho$", "beta": r"$\beta$", "beta_0": r"$\beta_0$",
    "packing_fraction": r"packing fraction $\phi$", "number": "$N$", "shear_rate": r"shear rate $\dot\gamma$",
    "speed_rms": r"$v_\mathrm{rms}$ at the start", "spin_rms": r"$\omega_\mathrm{rms}$ at the start",
}  # fmt: skip
"""Symbols of keys of a case, by their last part."""
MOST_PANELS = 12
PANEL_SHAPE, HEADS = 0.75, 1.2
"""Height over width of a panel of a figure of a given width; height of its title and legends [inches]."""
MOST_OF_ANALYSIS = 4
"""Quantities of an analysis that a message lists."""
MOST_REMARKS = 3
WIDE = 0.15
"""Opacity of the band by coefficients and seeds; that by seeds alone lies in it, and is darker."""
AT_POINTS = "theory at points"
"""Mark of the markers of theory that stand at swept values only."""
WINDOW_START = "steady window"
"""Mark of the lines at which steady windows, or averages of a given start, begin."""
SEVERAL_DECADES = 10.0
"""Ratio of the largest to the smallest value from which on an axis is logarithmic."""
Note = Callable[[str], None]
FILE = "file"


def of_trajectories(trajectories: Sequence[Trajectory]) -> Results:
    """Whole-gas quantities of trajectories at equal collisions per disk, as results with the dimension `file`.

    Raises InputError as `ifrdem.concat`.
    """
    found = at_equal_collisions(trajectories)
    units = trajectories[0].units
    names = np.array([one.path.stem for one in trajectories])
    variables = {FILE: Variable((FILE,), names), PER_DISK: Variable((PER_DISK,), found.pop(PER_DISK))}
    for name, values in found.items():
        if values.ndim == 2:
            unit = unit_of_whole_gas(name, units) or ""
            variables[f"{name}_mean"] = Variable((FILE, PER_DISK), values, unit)
    return Results(variables, {"axes": json.dumps({FILE: [FILE]}), "title": ", ".join(names), "keys": "{}"})


def draw(
    results: Results, what: str, over: str | None = None, by: str | None = None, *, start: float | None = None,
    as_map: bool = False, xlim: Ends = None, ylim: Ends = None, shown: Sequence[int] | None = None, size: tuple[float, ...] | None = None, dpi: int = 200, title: bool = True,
    note: Note = lambda _: None,
) -> Figure:  # fmt: skip
    """Draw a quantity: its mean over seeds, a band of its 95 % interval, and kinetic theory, dashed.

    `what` is its name, or T, T_rot. It is drawn over the rows (tau, t), a column of a table of an analysis over the
    first column of that table, or `over` another of its dimensions, or a swept key: a series is then averaged over the
    steady window of each point, and has its last row where there is none (`averaged`). Each value of the swept key `by`
    (the first one without it) is a curve, every combination of the others a panel; so is each species, or component, of
    a quantity that has some. From `start` on, in what ends the runs, a series is averaged over its rows, and drawn over
    a swept key. Drawn coefficients are averaged over, with a wide band by their errors and seeds and a narrow one by
    seeds, unless `over` or `by` is "coefficients". With `as_map` colours show it over two swept keys, `over` along and `by` upwards (by default the first
    two). `xlim` and `ylim` are ends of the axes, None for one that stays; `shown` are the numbers of the panels that
    are drawn, from 1. `size` is the width, and the height if given, of the figure [inches]. `note` gets the reasons why
    theory is drawn at the swept values only, without a line between them.

    Raises InputError if there is no such quantity or key, it has no axis or no value, or there are too many panels.
    """
    from matplotlib.figure import Figure

    name = SHORT.get(what, what)
    if not is_closed():
        results = with_theory(results)
    if start is not None:
        results = _from(results, name, start)
    whole = results
    if is_drawn(results) and COEFFICIENTS not in (over, by):
        results = pooled(results)
    swept = list(results.axes)
    if f"{name}_mean" not in results.variables:
        known = drawable(results)
        near = nearest(what, [*known, *SHORT])
        raise InputError(f"no quantity is called '{what}'{near}; there are: {_listed(known)}")
    mean = results.variables[f"{name}_mean"]
    if not np.isfinite(mean.values).any():
        raise InputError(f"no run has a value of {name}{_remarks(results, name)}")
    if not mean.dims:
        raise InputError(f"{name}: is one number and has no axis; `ifrdem info` prints it")
    if not _has_axis(results, name):
        text = "is a column of a table, and no other column of it rises from row to row, to be its axis"
        raise InputError(f"{name}: {text}; what can be drawn: {_listed(drawable(results))}")
    if as_map and over is None:
        over = next(iter(swept), None)
    x, curve = _x(results, over, mean.dims), None
    if x in swept and {*mean.dims} & {*ROWS} and np.isfinite(window_starts(whole)).any():
        results = pooled(averaged(whole)) if is_pooled(results) else averaged(whole)
        mean = results.variables[f"{name}_mean"]
    split = [*swept, *(dim for dim in mean.dims if dim in PARTS)]
    if left := [dim for dim in split if dim != x]:
        curve = _dim(results, option_name("--by", "by ="), by, left) if by is not None else left[0]
    elif by is not None:
        raise InputError(f"{option_name('--by', 'by =')} {by}: no dimension is left for curves")
    if as_map and (x not in swept or curve not in swept):
        raise InputError(
            f"{option_name('--map', 'as_map:')} requires two swept keys; there are: {', '.join(swept)}"
        )
    panels = [dim for dim in split if dim not in (x, curve)]
    panels_at = list(itertools.product(*(range(len(results.values(dim))) for dim in panels)))
    panels_at = [panels_at[i] for i in chosen_panels(len(panels_at), shown)]
    if len(panels_at) > MOST_PANELS:
        text = f"{len(panels_at)} panels, one for each {', '.join(panels)}"
        raise InputError(f"{text}: {MOST_PANELS} at most are drawn")
    columns = min(3 if size is None or size[0] >= NARROW else 1, len(panels_at))
    lines = math.ceil(len(panels_at) / columns)
    usual = width, height = 2.2 + 4.4 * columns, 0.9 + 3.9 * lines
    if size is not None:
        width, height = size[0], size[1] if len(size) > 1 else height / width * size[0]
        if len(size) == 1 and NARROW <= width < usual[0]:
            height = max(height, lines * PANEL_SHAPE * width / columns + HEADS)
    notes: dict[str, None] = {}
    with text_for(width, usual[0]):
        figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
        table = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
        all_axes = list(table.ravel())
        for i, (axes, panel) in enumerate(itertools.zip_longest(all_axes, panels_at)):
            if panel is None:
                axes.set_visible(False)
                all_axes[i - columns].tick_params(labelbottom=True)  # the lowest of its column
                all_axes[i - columns].set_xlabel(_label(results, x))
                continue
            fixed = dict(zip(panels, panel, strict=True))
            if as_map and curve is not None:
                _map(axes, results, name, x, curve, fixed)
            else:
                _panel(axes, results, name, x, curve, fixed, notes.setdefault)
            values = ", ".join(_named(results, dim, i) for dim, i in fixed.items())
            axes.set_title(values, fontsize="medium")
        first = all_axes[0]
        if as_map and curve is not None:
            frame_axes(all_axes[: len(panels_at)], xlim, ylim)
            _bar(figure, all_axes[: len(panels_at)], _label(results, name))
            upwards = _label(results, curve)
        else:
            _scales(all_axes[: len(panels_at)])
            frame_axes(all_axes[: len(panels_at)], xlim, ylim)
            _legend(
                first, theory_of(results, name) is not None, _seeds(results, name), x not in swept,
                several=len(panels_at) > 1,
                velocities=results.attributes.get(VELOCITY_WORDS, "") if name in THEORY else "",
                both=parts_of_interval(results) if half_of_both(results, name) is not None else "",
                given_start=GIVEN_START in results.attributes,
            )  # fmt: skip
            upwards = _label(results, name, _power(first))
        for axes in table[-1]:
            axes.set_xlabel(_label(results, x))
        for line in table:
            line[0].set_ylabel(upwards)
        fit_to_column(figure, all_axes[: len(panels_at)], taller=size is not None and len(size) == 1)
        if title:
            texts = (plain(results.attributes.get("title", "")), _window(results, name, x))
            figure.suptitle("; ".join(filter(None, texts)), fontsize="medium")
    for each in notes:
        note(each)
    return figure


def _from(results: Results, name: str, start: float) -> Results:
    """Results whose series are means from a place on; InputError if the quantity is no series, or no row is as late."""
    option = option_name("--from", "start =")
    mean = results.variables.get(f"{name}_mean")
    if mean is not None and not set(mean.dims) & set(ROWS):
        text = f"{name} is no series; [output] analyses_from of the study sets where analyses over time begin"
        raise InputError(f"{option} {start:g}: {text}")
    return averaged(results, start, option)


def _window(results: Results, name: str, x: str) -> str:
    """Text on which part of the runs the values of a quantity belong to, where the axis does not show it."""
    mean, end = results.variables[f"{name}_mean"], "at the end of the runs"
    clock, unit = results.row_axis, results.variables[results.row_axis].unit
    clock = f"{'tau' if clock == PER_DISK else 't'} = {{:.3g}} {written(unit) if unit != REDUCED else ''}".rstrip()

    def means_from(starts: NDArray[np.float64]) -> str:
        low, high = (clock.format(end(starts)) for end in (np.nanmin, np.nanmax))
        return f"means from {low}{f' to {high}' if high != low else ''} on"

    if START in results.variables and name not in SERIES and _is_over_time(name):
        return means_from(results.values(START))
    if x not in results.axes:
        return ""
    if AT in mean.dims:
        return f"at {clock.format(results.values(AT)[-1])}"
    if name not in (*SERIES, *ROWS, "theta"):
        return ""
    if SERIES_FROM not in results.variables or name in ADDING:
        return end
    starts = results.values(SERIES_FROM)
    return f"{means_from(starts)}{f', {end} without a steady part' * bool(np.isnan(starts).any())}"


def _is_over_time(name: str) -> bool:
    """True of what an analysis over time gives."""
    return any(name.startswith(f"{identifier(each)}_") for each in OVER_TIME)


def _listed(names: Sequence[str]) -> str:
    """Names of quantities, the first ones of each analysis."""
    groups: dict[str, list[str]] = {}
    prefixes = sorted((f"{identifier(each)}_" for each in ANALYSES), key=len, reverse=True)
    for name in names:
        groups.setdefault(next((each for each in prefixes if name.startswith(each)), ""), []).append(name)
    found = groups.pop("", [])
    for prefix, each in groups.items():
        found += each[:MOST_OF_ANALYSIS]
        if (others := len(each) - MOST_OF_ANALYSIS) > 0:
            found.append(f"{others} more {prefix}...")
    return ", ".join(found)


def drawable(results: Results) -> list[str]:
    """Names of the quantities that have an axis and a value."""
    return [
        name
        for name in results.quantities
        if results.variables[f"{name}_mean"].dims
        and np.isfinite(results.variables[f"{name}_mean"].values).any()
        and _has_axis(results, name)
    ]


def _row_of_table(results: Results, dims: Sequence[str]) -> str | None:
    """The dimension of rows of a table of an analysis, which alone has no values; None without one."""
    return next((dim for dim in dims if dim not in results.variables), None)


def _axis_of_table(results: Results, row: str) -> str | None:
    """The first column of a table, if its values rise from row to row; else None, such as of cells of a plane."""
    first = next(name for name in results.quantities if row in results.variables[f"{name}_mean"].dims)
    mean = results.variables[f"{first}_mean"]
    steps = np.diff(mean.values, axis=mean.dims.index(row))
    return first if (steps[np.isfinite(steps)] > 0.0).all() else None


def _has_axis(results: Results, name: str) -> bool:
    """False of a column of a table that cannot be drawn over the first one, and of that one itself."""
    row = _row_of_table(results, results.variables[f"{name}_mean"].dims)
    return row is None or _axis_of_table(results, row) not in (None, name)


def _remarks(results: Results, name: str) -> str:
    """Texts of the warnings and notes of the analysis of a quantity, each after a colon."""
    found = [
        line
        for kind in (WARNINGS, NOTES)
        if kind in results.variables
        for text in results.values(kind).ravel()
        for line in str(text).splitlines()
        if f"{name}_".startswith(f"{identifier(line.partition(':')[0].partition(' ')[0])}_")
    ]
    lines = [*dict.fromkeys(found)]
    return f": {'; '.join(lines[:MOST_REMARKS])}" if lines else ""


def _seeds(results: Results, name: str) -> str | None:
    """Text on the intervals: numbers of seeds, or rows of single runs; None if no mean has one."""
    if (half := half_interval(results, name)) is None:
        return None
    known = finite_seeds(results, name)[np.isfinite(half)]
    if not len(known) or not len(known := known[known > 0]):
        return None
    if known.max() == 1:
        return "rows of one run"
    return f"{known.min()} seeds" if known.min() == known.max() else f"{known.min()} to {known.max()} seeds"


def _x(results: Results, over: str | None, dims: tuple[str, ...]) -> str:
    """Coordinate of the axis: a dimension of the quantity, or the time where rows are at collisions per disk."""
    if (row := _row_of_table(results, dims)) is not None:
        own = _axis_of_table(results, row)
        assert own is not None  # see `_has_axis`
        dims = (own, *(dim for dim in dims if dim != row))
    rows = [dim for dim in dims if dim not in results.axes]
    if over is None:
        return rows[0] if rows else dims[-1]
    name = SHORT.get(over, over)
    if name in dims:
        return name
    # Times and collisions per disk are known at the rows of series, and between them, where frames are analysed.
    clocks = [each for each in ROWS if {AT, *ROWS} & {*dims} and _has_clock(results, each)]
    return name if name in clocks else _dim(results, option_name("--over", "over ="), over, [*dims, *clocks])


def _has_clock(results: Results, name: str) -> bool:
    return name in results.variables or f"{name}_mean" in results.variables


def _row_of(results: Results, x: str, dims: Sequence[str]) -> str:
    """The dimension of a quantity that x stands for: a clock for that of series or frames, else that of its table."""
    if x not in ROWS and (row := _row_of_table(results, dims)) is not None:
        return row
    return next(dim for dim in dims if dim in (*ROWS, AT))


def _dim(results: Results, option: str, given: str, allowed: Sequence[str]) -> str:
    """A dimension, by name or by a key of the case that varies along it."""
    keys: Mapping[str, str] = json.loads(results.attributes["keys"])
    names = {name: dim for dim, names in results.axes.items() for name in names}
    names |= {keys[name]: dim for name, dim in list(names.items()) if name in keys}
    names |= {dim: dim for dim in allowed}
    if names.get(given) not in allowed:
        known = [name for name, dim in names.items() if dim in allowed]
        raise InputError(f"{option} {given}: allowed here are {', '.join(known)}{nearest(given, known)}")
    return names[given]


def _panel(
    axes: Axes, results: Results, name: str, x: str, curve: str | None, fixed: Mapping[str, int], note: Note
) -> None:
    """The curves of one panel; of rows that are not drawn over, the last one counts."""
    reasons: set[str] = set()
    count = len(results.values(curve)) if curve is not None else 1
    for i in range(count):
        panel = {**fixed, **({curve: i} if curve is not None else {})}
        kind = KINDS[i % len(KINDS)]
        colour = kind if count <= len(KINDS) else _shade(i, count)
        label = None if curve is None else _named(results, curve, i)

        def along(which: str | Variable, panel: Mapping[str, int] = panel) -> NDArray[Any] | None:
            one = results.variables.get(which) if isinstance(which, str) else which
            if one is None:
                return None
            along_x = x if x in one.dims or x in results.axes else _row_of(results, x, one.dims)
            taken = tuple(slice(None) if dim == along_x else panel.get(dim, -1) for dim in one.dims)
            return one.values[taken]

        y = along(f"{name}_mean")
        half = half_interval(results, name)
        part = None if half is None else along(results.variables[f"{name}_mean"]._replace(values=half))
        both = half_of_both(results, name)
        wide = None if both is None else along(results.variables[f"{name}_mean"]._replace(values=both))
        theory = along(theory_of(results, name) or "")
        own = x in results.variables and results.variables[x].dims == (x,)
        where = results.values(x) if own else along(f"{x}_mean")
        assert y is not None
        assert where is not None
        dims = results.variables[f"{name}_mean"].dims
        if x in ROWS and x not in dims and AT in dims:  # places of frames, in what ends the runs
            where = results.values(AT) if own else np.interp(results.values(AT), results.row_places, where)
        own_numbers = where.dtype.kind in "iuf"
        if not own_numbers:
            where = np.arange(len(where))
            axes.set_xticks(where, [plain(str(each)) for each in results.values(x)])
        rows = x not in results.axes
        look = some_marks(kind, i) if rows else marks(kind, ms=5.0)
        look |= {"color": colour, "mfc": colour if look["mfc"] == kind else "none"}
        if rows and count == 1:
            look["marker"] = ""
        if rows and {*ROWS} & {*dims} and name not in ADDING:
            _start(axes, results, where, panel, colour)
        axes.plot(where, y, lw=1.4, label=label, **look)
        if wide is not None and rows:
            axes.fill_between(where, y - wide, y + wide, color=colour, alpha=WIDE, lw=0)
        elif wide is not None:
            axes.errorbar(where, y, wide, fmt="none", color=colour, capsize=4, lw=0.8)
        if part is not None and np.isfinite(part).any():
            if rows:
                axes.fill_between(where, y - part, y + part, color=colour, alpha=0.25, lw=0)
            else:
                axes.errorbar(where, y, part, fmt="none", color=colour, capsize=2)
        if theory is None or not np.isfinite(theory).any():
            continue
        if rows:
            axes.plot(where, theory, "--", color=colour, lw=1.1)
        elif not isinstance(fine := theory_between(results, name, x, panel), str):
            axes.plot(*fine, "--", color=colour, lw=1.1)
        else:  # only at the swept values: no line joins them
            axes.plot(where, theory, "_", color=colour, ms=12, mew=1.5, gid=AT_POINTS)
            reasons |= {fine} if own_numbers else set()
    for reason in sorted(reasons):
        note(f"theory of {name} stands at the swept values only: {reason}")
    grid(axes)


def _map(axes: Axes, results: Results, name: str, x: str, y: str, fixed: Mapping[str, int]) -> None:
    """Colours of the means at the values of two swept keys; of rows and frames, the last one counts."""
    mean = results.variables[f"{name}_mean"]
    taken = tuple(slice(None) if dim in (x, y) else fixed.get(dim, -1) for dim in mean.dims)
    values = mean.values[taken]
    if mean.dims.index(x) < mean.dims.index(y):
        values = values.T
    ends = []
    for dim, scale, ticks in ((x, axes.set_xscale, axes.set_xticks), (y, axes.set_yscale, axes.set_yticks)):
        places = results.values(dim)
        if places.dtype.kind not in "iuf" or len(places) < 2 or not (np.diff(places) > 0).all():
            ticks(
                np.arange(len(places)),
                [plain(f"{each:.4g}" if places.dtype.kind in "iuf" else str(each)) for each in places],
            )
            ends.append(np.arange(len(places) + 1) - 0.5)
            continue
        logarithmic = places[0] > 0 and places[-1] > SEVERAL_DECADES * places[0]
        at = np.log(places) if logarithmic else places.astype(float)
        middle = 0.5 * (at[1:] + at[:-1])
        edges = np.concatenate(([2.0 * at[0] - middle[0]], middle, [2.0 * at[-1] - middle[-1]]))
        ends.append(np.exp(edges) if logarithmic else edges)
        if logarithmic:
            scale("log")
    shown = np.ma.masked_invalid(values)
    axes.pcolormesh(*ends, shown, cmap="cividis", rasterized=True)  # even in grey
    axes.set_facecolor("0.85")  # of points without a value


def _bar(figure: Figure, panels: Sequence[Axes], text: str) -> None:
    """One colour bar of all maps, which have the same range."""
    meshes = [each for axes in panels for each in axes.collections]
    known = np.concatenate([np.ma.compressed(np.ma.asarray(each.get_array())) for each in meshes])
    for each in meshes:
        each.set_clim(float(known.min()), float(known.max()))
    figure.colorbar(meshes[0], ax=panels, label=text)


def _start(axes: Axes, results: Results, where: NDArray[Any], panel: Mapping[str, int], colour: Any) -> None:
    """A dotted line where averages of a point begin, on the axis of a clock; once for all curves that agree."""
    start = float(window_starts(results)[tuple(panel[dim] for dim in results.axes)])
    place = float(np.interp(start, results.row_places, where))
    drawn = [line for line in axes.lines if line.get_gid() == WINDOW_START]
    if not np.isfinite(start) or place <= where[0]:
        return
    for line in drawn:
        if float(np.asarray(line.get_xdata(), float)[0]) == place:
            line.set_color("0.4")
            return
    axes.axvline(place, ls=":", lw=1.0, color=colour, gid=WINDOW_START)


def _scales(panels: Sequence[Axes]) -> None:
    """Make axes logarithmic where values of any panel span decades; all panels share their axes."""
    lines = [line for axes in panels for line in axes.lines if line.get_gid() != WINDOW_START]
    y = np.concatenate([[], *(np.asarray(line.get_ydata(), float) for line in lines)])
    paths = [path for axes in panels for one in axes.collections for path in one.get_paths()]
    ends = np.concatenate([y, *(np.asarray(path.vertices)[:, 1] for path in paths)])  # of intervals too
    y, ends = y[np.isfinite(y)], ends[np.isfinite(ends)]
    if len(y) and y.min() > 0.0 and y.max() > SEVERAL_DECADES * y.min():
        panels[0].set_yscale("log")
        few_labels(panels[0], "y")
    elif len(y) and ends.min() >= 0.0:
        panels[0].set_ylim(0.0, 1.08 * ends.max() or 1.0)
    each_x = [np.asarray(line.get_xdata(), float) for line in lines]
    x = np.concatenate([[], *each_x])
    x, steps = x[np.isfinite(x)], np.diff(each_x[0]) if lines else np.array([])
    later = x[x > 0.0]
    even = len(steps) > 1 and np.allclose(steps, steps.mean(), rtol=1e-3)
    if len(later) > 2 and not even and later.max() > SEVERAL_DECADES * later.min() and x.min() >= 0.0:
        panels[0].set_xscale("log")
        panels[0].set_xlim(left=float(later.min()))


def _power(axes: Axes) -> int:
    """The power of ten that is taken out of the labels of a linear vertical axis, to be written with its unit.

    Matplotlib writes it above the corner of the axes, into a title or a legend.
    """
    from matplotlib.ticker import FuncFormatter

    largest = max(map(abs, axes.get_ylim()))
    if axes.get_yscale() == "log" or 1e-3 <= largest < 1e5 or largest == 0.0:
        return 0
    power = math.floor(math.log10(largest))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 10.0**power:.4g}"))
    return power


def _legend(
    axes: Axes,
    theory: bool,
    seeds: str | None,
    rows: bool,
    *,
    several: bool,
    velocities: str = "",
    both: str = "",
    given_start: bool = False,
) -> None:
    """`seeds`: of what the intervals are, as text, if means have some; `velocities`: of the theory.

    `both`: of what wide intervals are, by coefficients and seeds. With `given_start` the study sets where averages begin,
    which need not be a steady window.
    """
    if both and rows:
        axes.fill_between([], [], [], color="black", alpha=WIDE, lw=0, label=f"{PERCENT} interval: {both}")
    elif both:
        axes.errorbar(
            [], [], [], fmt="none", color="black", capsize=4, lw=0.8, label=f"{PERCENT} interval: {both}"
        )
    ended = "\n" if is_narrow(axes) and not several else " "  # so that more columns have room
    label = f"{PERCENT} interval of the mean{ended}(Student's $t$, {seeds})"
    if seeds is not None and rows:
        alpha = 1.0 - 0.75 * (1.0 - WIDE) if both else 0.25  # it lies on the wide one
        axes.fill_between([], [], [], color="black", alpha=alpha, lw=0, label=label)
    elif seeds is not None:
        axes.errorbar([], [], [], fmt="none", color="black", capsize=2, label=label)
    if theory:
        at_points = any(line.get_gid() == AT_POINTS for line in axes.lines)
        style: Any = {"marker": "_", "ms": 12, "mew": 1.5, "ls": ""} if at_points else {"ls": "--", "lw": 1.1}
        label = "kinetic theory" if is_narrow(axes) else "kinetic theory (homogeneous)"
        label = ", ".join(filter(None, (label, velocities)))
        axes.plot([], [], color="black", label=label, **style)
    if any(line.get_gid() == WINDOW_START for line in axes.lines):
        label = "averages begin here (analyses_from)" if given_start else "the steady window begins"
        axes.plot([], [], ":", color="0.4", lw=1.0, label=label)
    if several:
        legend_of_figure(axes.get_figure(), axes, 6 if not is_narrow(axes) else 2)
    else:
        legend_above(axes)


def _shade(i: int, count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](0.95 * i / max(count - 1, 1))


def _named(results: Results, dim: str, i: int) -> str:
    """One value of a dimension: $e_n$ = 0.9, and 1 m/s with its unit; of species and other parts their name alone."""
    value, unit = results.values(dim)[i], results.variables[dim].unit
    text = f"{value:.4g}" if isinstance(value, np.floating) else plain(str(value))
    if dim in (FILE, VARIANT, *PARTS):
        return text
    return f"{_symbol(results, dim)} = {text} {written(unit) if unit != REDUCED else ''}".rstrip()


def _label(results: Results, name: str, power: int = 0) -> str:
    """The label of an axis whose numbers are in units of a power of ten; of places of frames, that of their clock."""
    name = results.row_axis if name == AT else name
    key = json.loads(results.attributes["keys"]).get(name)
    one = results.variables.get(name) or results.variables.get(f"{name}_mean")
    parts = [f"$10^{{{power}}}$"] if power else []
    parts += [written(one.unit)] if one is not None and one.unit else []
    unit = f" ({' '.join(parts)})" if parts else ""
    return (_symbol(results, name) if key else _quantity(name, results.texts.get(name))) + unit


def _quantity(name: str, text: str | None = None) -> str:
    """A quantity of the results in words, those of its analysis if given, and symbols: "T of a" as $T$ of a."""
    if name in SYMBOLS:
        return SYMBOLS[name]
    text = name.replace("_", " ") if text is None else plain(text)
    for words, symbol in (
        ("T rot", r"$T_\mathrm{rot}$"),
        ("T", "$T$"),
        ("theta", r"$\theta$"),
        ("psi6", r"$\psi_6$"),
        ("eta", r"$\eta$"),
        ("kappa", r"$\kappa$"),
        ("nu", r"$\nu$"),
        ("D", "$D$"),
    ):
        text = re.sub(rf"(?<![\w$]){words}(?!\w)", symbol.replace("\\", r"\\"), text)
    # a20, P_xy, N_1, T_x
    text = re.sub(r"(?<![\w$])(?:(a)_?(\d+)|([NPT])_(1|[xyrt]{1,2}))(?!\w)", r"$\1\3_{\2\4}$", text)
    if "$" not in text:
        return text
    return text.removeprefix("species ").replace(" -$", " $-").replace(" - ", " $-$ ")  # no hyphens for minus


def _symbol(results: Results, name: str) -> str:
    """The symbol of a swept key by its last part, with what it belongs to where two keys have the same last part."""
    keys: Mapping[str, str] = json.loads(results.attributes["keys"])
    key = keys.get(name, name)
    section, _, last = key.rpartition(".")
    symbol = KEY_SYMBOLS.get(last, last.replace("_", " "))
    if [each.rpartition(".")[2] for each in keys.values()].count(last) > 1:
        return f"{symbol} of {section}"
    return symbol
