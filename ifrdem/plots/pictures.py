"""Pictures of a trajectory by their names: figures for files, panels for given axes."""

from __future__ import annotations

import re
import textwrap
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from ..analysis.names import OPTIONS
from ..errors import InputError, option_name, shortened, there_are
from ..tools.checked import Count, Positive, instance, validated
from .names import PICTURES as PICTURES
from .names import Ends

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..analysis.result import Evaluation
    from ..trajectory.reader import Trajectory

OVER = ("temperatures", "energy", "ledger", "mechanisms", "walls", "piston", "species")
"""Pictures that can be drawn over time or collisions per disk."""
UPPER_AND_LOWER: dict[str, Any] = {"nrows": 2, "sharex": True, "height_ratios": (3.0, 1.0)}
LAYOUTS: dict[str, dict[str, Any]] = {
    "piston": {"nrows": 2, "sharex": True},
    "dissipation": {"ncols": 2, "width_ratios": (1.4, 1.0)}, "disks": {}, "energy": {}, "mechanisms": {},
}  # fmt: skip
"""Arguments of `Figure.subplots` for pictures other than analyses, if they do not depend on the trajectory."""


@validated
def figure(
    trajectory: Trajectory, what: str, *, frames: Sequence[int] | None = None, over: str | None = None,
    color: str | None = None, make: Callable[..., Any] | None = None, size: tuple[Positive, ...] | None = None,
    dpi: Count = 200, title: bool = True, xlim: Ends = None, ylim: Ends = None,
    panels: Sequence[Count] | None = None, **options: Any,
) -> Figure:  # fmt: skip
    """A figure by its name, with a title, and the warnings of the analysis below it.

    Parameters
    ----------
    trajectory : Trajectory
    what : str
        A name that `ifrdem plot --list` lists.
    frames : sequence of int, optional
        Of which frames; by default of those that suit it.
    over : {"t", "tau"}, optional
        Time, or collisions per disk: of temperatures, energy, ledger, mechanisms, walls, piston and species. By default
        time, of species collisions per disk where the file counts them.
    color : str, optional
        Of the disks, as `Frame.plot` has it.
    make : callable, optional
        Makes the figure of a size (width, height) [inches], instead of `matplotlib.figure.Figure`.
    size : (float,) or (float, float), optional
        Width, and height if not that of the usual shape [inches]. Below a width of 5, panels stand in one
        column.
    dpi : int
        Points an inch.
    title : bool
        False leaves the title out; warnings of the analysis are then warnings of Python.
    xlim, ylim : (float or None, float or None), optional
        Ends of the axes of all panels; None for an end that stays.
    panels : sequence of int, optional
        Numbers of the panels that are drawn, from 1, in the order in which they are read.
    **options
        Of profiles `axis`, `bins`, `windows` and `phases`, of fields `cells` and `average`, of transport `lag`.

    Raises
    ------
    InputError
        If there is no such picture or panel, or the file does not hold what it takes.

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import plots
    >>> with ifrdem.Trajectory("cooling.h5") as run:  # of `ifrdem run cooling`
    ...     plots.figure(run, "rdf").savefig("rdf.png")
    ...
    """
    from matplotlib.figure import Figure

    from ..trajectory.reader import Trajectory
    from .disks import figure_size
    from .style import (
        NARROW,
        chosen_panels,
        fit_to_column,
        frame_axes,
        is_poster,
        keep_panels,
        part_from_legends,
        text_for,
    )

    instance("trajectory", trajectory, Trajectory)
    layout, given = _layout(trajectory, what, options.get("axis")), size
    frames = _numbers(trajectory, frames)
    _check_over(what, over)
    if is_poster.get():
        return _poster(trajectory, what, frames, color, make, size, dpi, options)
    wide = layout.get("ncols", 1) > 1
    usual = (12.0, 8.0) if layout.get("nrows", 1) > 1 and wide else (12.0, 5.2) if wide else (7.5, 6.2)
    if what == "disks" and "position" in trajectory.fields:
        usual = figure_size(trajectory, trajectory[frames[-1] if frames else -1].position)
    layout, size = _sized(layout, usual, size)
    with text_for(size[0], usual[0]):
        drawn: Figure = make(size) if make is not None else Figure(size, dpi=dpi, layout="constrained")
        axes = [*drawn.subplots(squeeze=False, **layout).ravel()]
        chosen = chosen_panels(len(axes), panels)
        evaluation = _draw(axes, trajectory, what, frames, over, color, **options)
        if panels is not None:
            columns, rows = layout.get("ncols", 1), layout.get("nrows", 1)
            axes = keep_panels(drawn, axes, chosen, columns)
            layout = layout | {"ncols": min(columns, len(axes))}
            if make is None and (given is None or len(given) == 1):
                drawn.set_figheight(size[1] * (HEADS + (1.0 - HEADS) * -(-len(axes) // columns) / rows))
        _tidy(axes, layout, narrow=size[0] < NARROW)
        frame_axes(axes, xlim, ylim)
        fit_to_column(drawn, axes, taller=make is None and given is not None and len(given) == 1)
        if make is None:
            part_from_legends(drawn, axes)
        return _titled(drawn, axes, trajectory, what, evaluation, title=title, width=size[0])


def _titled(
    drawn: Figure, axes: Sequence[Axes], trajectory: Trajectory, what: str, evaluation: Evaluation | None, *,
    title: bool, width: float,
) -> Figure:  # fmt: skip
    """The figure with its title, and the warnings of the analysis below it, or as warnings of Python."""
    from matplotlib import rcParams

    from ..analysis.result import span_text
    from .run import title as title_of
    from .style import DEFAULT_FONT, ROTATION, plain

    if not title:
        for one in axes:
            one.set_title("")
        for warning in evaluation.warnings if evaluation is not None else ():
            warnings.warn(f"{what}: {warning}", stacklevel=2)
        return drawn
    head = title_of(trajectory)
    if width < 7.0:
        head = ",\n".join(head.rsplit(", ", 1))
    if evaluation is not None:
        head += f"\n{span_text(trajectory, evaluation)}"
        letters = int(LETTERS * width * DEFAULT_FONT / rcParams["font.size"])
        marks = (
            textwrap.fill(f"! {warning}", letters, subsequent_indent="   ") for warning in evaluation.warnings
        )
        if text := "\n".join(marks):
            drawn.supxlabel(plain(text), x=0.01, ha="left", fontsize="small", color=ROTATION)
    drawn.suptitle(head, fontsize="medium")
    return drawn


HEADS = 0.15
"""Part of the height of a picture that its title takes."""
LETTERS = 12.5
"""Letters in an inch of warnings below a picture, in text of the usual size."""
LONG_LABEL = 22
"""Letters of the label of a vertical axis above which its unit goes into a second line, in narrow figures."""


def _tidy(axes: Sequence[Axes], layout: dict[str, Any], *, narrow: bool) -> None:
    """Label a shared horizontal axis in the lowest panels only; break long labels in narrow figures."""
    columns = layout.get("ncols", 1)
    for column in range(columns if layout.get("sharex") else 0):
        *upper, lowest = [one for one in axes[column::columns] if one.get_visible()]
        lowest.tick_params(axis="x", labelbottom=True)
        for one in upper:
            one.set_xlabel("")
    for one in axes if narrow else ():
        for each in (one, *one.child_axes):
            text = each.get_ylabel()
            if len(text) > LONG_LABEL:
                each.set_ylabel(re.sub(r" (\([^()$\n]*\))$", r"\n\1", text))  # units, no formula


def _poster(
    trajectory: Trajectory, what: str, frames: Sequence[int] | None, color: str | None,
    make: Callable[..., Any] | None, size: tuple[float, ...] | None, dpi: int, options: dict[str, Any],
) -> Figure:  # fmt: skip
    """A figure in the style "poster"; see `poster`."""
    from matplotlib.figure import Figure

    from . import poster
    from .disks import View, colour_of, default_color, shown_region

    if what not in poster.PICTURES:
        raise InputError(
            f"style = poster: cannot be combined with {what}; must be {', '.join(poster.PICTURES)}"
        )
    trajectory.require("position")
    frame = trajectory[frames[-1] if frames else -1]
    count = _layout(trajectory, what).get("ncols", 1)
    usual = poster.sides(trajectory, frame.position, count)
    if size is not None:
        usual = (size[0], size[1] if len(size) > 1 else size[0] * usual[1] / usual[0])
    drawn: Figure = make(usual) if make is not None else Figure(usual, dpi=dpi)
    axes = list(drawn.subplots(1, count, squeeze=False).ravel())
    if what == "disks":
        view = View.of(frame)
        if (colour := colour_of(name := color or default_color(view))) is not None:
            trajectory.require(colour.field)
        poster.frame(axes[0], view, name)
    else:
        _draw(list(axes), trajectory, what, frames, color=color, **options)
        for one in axes:
            poster.finish(one, trajectory, shown_region(trajectory, frame.position), len(axes))
    poster.arrange(drawn, axes)
    return drawn


def _sized(
    layout: dict[str, Any], usual: tuple[float, float], size: tuple[float, ...] | None
) -> tuple[dict[str, Any], tuple[float, float]]:
    """The arguments of `Figure.subplots` and the size of a figure; panels of a narrow one are above each other."""
    from .style import NARROW

    if size is None:
        return layout, usual
    if len(size) not in (1, 2):
        raise InputError(f"size = {size}: must be (width,) or (width, height)")
    width = size[0]
    shape = usual[1] / usual[0]
    if width < NARROW and (columns := layout.get("ncols", 1)) > 1:
        rows = layout.get("nrows", 1) * columns
        layout = {"nrows": rows, **{key: layout[key] for key in ("sharex",) if key in layout}}
        shape = 0.85 * rows if rows == 2 else 0.42 * rows
    return layout, (width, size[1] if len(size) > 1 else shape * width)


def panels(
    trajectory: Trajectory, what: str, axes: Any, frames: Sequence[int] | None = None, **options: Any
) -> None:
    """Draw into given axes, with options as for `figure`.

    InputError if there are not as many as the picture has panels; a lower one, and that of ratios of stresses, may lack.
    """
    layout = _layout(trajectory, what, options.get("axis"))
    count = layout.get("ncols", 1) * layout.get("nrows", 1)
    least = (
        1 if layout is UPPER_AND_LOWER else 2 if what == "stress" else count
    )  # without the ratios of a flow
    given = checked_axes(f"the picture {what}", axes, count, least)
    _check_over(what, options.get("over"))
    _draw(given, trajectory, what, _numbers(trajectory, frames), **options)


def checked_axes(what: str, axes: Any, most: int, least: int) -> list[Axes]:
    """Axes as a list, from one or an array; refuses what are no axes, and fewer or more of them than panels."""
    import numpy as np
    from matplotlib.axes import Axes

    given = list(np.ravel(np.asarray(axes, dtype=object)))
    for one in given:
        if not isinstance(one, Axes):
            raise InputError(f"ax = {shortened(one)}: must be Axes of Matplotlib")
    if not least <= len(given) <= most:
        needed = (
            "ax=(left, right)" if least == 2 else "ax=axes" if most == 1 else "ax=axes or ax=(upper, lower)"
        )
        raise InputError(
            f"{what} has {most} panel{'s' * (most > 1)}: must be {needed}, not {len(given)} axes"
        )
    return given


def _layout(trajectory: Trajectory, what: str, axis: str | None = None) -> dict[str, Any]:
    """Arguments of `Figure.subplots`; `axis` is that of profiles."""
    if not isinstance(what, str) or what not in PICTURES:
        raise InputError(f"no picture is called '{what}'{there_are(str(what), tuple(PICTURES))}")
    if len(trajectory) == 0:
        raise InputError(f"{trajectory.path}: no frame to draw")
    if what == "temperatures":
        return {} if trajectory.free_area.all_walls or not _turned(trajectory) else UPPER_AND_LOWER
    if what == "cooling" and not _turned(trajectory):
        return {}
    if what == "walls":
        from .series import given_by_walls, has_torques

        count = 1 + has_torques(trajectory) + len(given_by_walls(trajectory))
        return {"nrows": 2, "ncols": 2, "sharex": True} if count == 4 else {"ncols": count, "sharex": True}
    if what == "ledger":  # only runs that count every collision have a residual
        known = "ledger_residual" in {*trajectory.series, *trajectory.observables}
        return UPPER_AND_LOWER if known else {}
    if what == "stress" and trajectory.box.shear_rate:
        return {"ncols": 3}
    if what in LAYOUTS:
        return LAYOUTS[what]
    from .analyses import PANELS

    if what == "profiles" and trajectory.box.is_open and axis != "r":
        return {"ncols": 3}  # strips without an end have no area, and so no density, P and q
    if what == "velocity" and not _spins(trajectory):
        return {}
    return PANELS[what].layout


def _turned(trajectory: Trajectory) -> bool:
    """True if any frame has a rotational temperature that is not 0, or the file has none."""
    found = trajectory.observables
    return "rotational_temperature" not in found or bool(found["rotational_temperature"].any())


def _spins(trajectory: Trajectory) -> bool:
    """True if disks spin in the first, the middle or the last frame."""
    if "angular_velocity" not in trajectory.fields:
        return False
    return any(trajectory[i].spin.any() for i in {0, len(trajectory) // 2, len(trajectory) - 1})


def _numbers(trajectory: Trajectory, frames: Sequence[int] | None) -> list[int] | None:
    """Numbers of frames, from 0; InputError if they are no list of them."""
    from ..analysis.result import FramesFrom

    if frames is None or isinstance(frames, FramesFrom):
        return frames
    if isinstance(frames, str) or not isinstance(frames, Iterable):
        raise InputError(
            f"frames = {shortened(frames)}: must be a list of frame numbers, [{shortened(frames)}] for one"
        )
    return [trajectory[i].index for i in frames]


def _draw(
    axes: Sequence[Axes], trajectory: Trajectory, what: str, frames: Sequence[int] | None = None,
    over: str | None = None, color: str | None = None, **options: Any,
) -> Evaluation | None:  # fmt: skip
    """Draw a picture into its axes; return the result if it is an analysis."""
    from . import disks, dissipation, series, temperatures

    if color is not None and what != "disks":
        raise InputError(f"color = {color}: cannot be combined with {what}; it is an option of disks")
    for name, value in options.items():
        if OPTIONS[name] != what:
            raise InputError(
                f"{name} = {value}: cannot be combined with {what}; it is an option of {OPTIONS[name]}"
            )
    if what == "disks":
        disks.last_frame(axes[0], trajectory, frames[-1] if frames else -1, color)
    elif what == "dissipation":
        dissipation.draw(axes[0], axes[1], trajectory, frames)
    elif what in OVER and what != "species":
        draw = temperatures.draw if what == "temperatures" else getattr(series, what)
        draw(trajectory, over or "t", *axes)
    else:
        from ..analysis.catalogue import FUNCTIONS
        from .analyses import PANELS, stress_in_flow

        evaluation = FUNCTIONS[what](trajectory, frames, **options)
        of_flow = what == "stress" and len(axes) == 3
        panels = PANELS[what]._replace(draw=stress_in_flow) if of_flow else PANELS[what]
        panels.draw(*axes, trajectory, evaluation, **({"over": over} if what == "species" else {}))
        return evaluation
    return None


def _check_over(what: str, over: str | None) -> None:
    """Refuse an axis that a picture has not got."""
    from ..tools import checked
    from . import series

    if over is None:
        return
    checked.choice("over", over, tuple(series.AXES))
    if what not in OVER:
        option = option_name("--over", "over =")
        raise InputError(
            f"{option} {over}: cannot be combined with {what}; it is an option of {', '.join(OVER)}"
        )
