"""Notebook displays of objects: pictures in Matplotlib axes, tables and thumbnails."""

from __future__ import annotations

import base64
import html as escape
import io
from collections.abc import Mapping
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.box import Box
from ..model.state import State
from ..simulation.simulation import Simulation
from ..trajectory.reader import Frame, Trajectory
from . import disks as plot_disks
from . import pictures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

THUMBNAIL = (2.6, 2.6)
"""Width and height [inches]."""


def disks(source: Frame | Simulation, axes: Any, color: str) -> Axes:
    """Draw disks at one time; see `DisksRepr.plot`."""
    view = plot_disks.View.of(source)
    if axes is None:
        axes = _new(plot_disks.figure_size(view, view.moving.position)).subplots()
    (one,) = pictures.checked_axes("a picture of disks", axes, 1, 1)
    plot_disks.draw(one, view, color)
    return one


def trajectory(source: Trajectory, what: str, axes: Any, **options: Any) -> Any:
    """Draw a picture of a trajectory; see `Trajectory.plot`."""
    if axes is not None:
        pictures.panels(source, what, axes, **options)
        return axes
    made = pictures.figure(source, what, make=_new, **options)
    return _one_or_all(np.array(made.axes))


def result(found: Any, axes: Any) -> Any:
    """Draw a result of an analysis; see `ResultPlot.plot`."""
    from .analyses import RESULTS

    panels = RESULTS[type(found)]
    count = panels.layout.get("ncols", 1)
    if axes is None:
        size = (10.0, 4.4) if count == 2 else (6.4, 4.8)
        axes = _one_or_all(_new(size).subplots(squeeze=False, **panels.layout).ravel())
    panels.draw(*pictures.checked_axes(f"a picture of {type(found).__name__}", axes, count, count), found)
    return axes


def _one_or_all(axes: Any) -> Any:
    return axes[0] if len(axes) == 1 else axes


def _new(size: tuple[float, float]) -> Figure:
    """A figure of `pyplot`, which notebooks show."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained")


@singledispatch
def html(source: Any) -> str:
    """A small table and a thumbnail of an object, for a notebook."""
    raise TypeError(type(source))


@html.register
def _(source: Simulation) -> str:
    now, n = source.measure(), source.disks.n
    rows = {
        "disks": n, "box": _box(source.box), "time": f"{source.time:.6g}",
        "collisions": f"{source.collisions} ({2.0 * source.collisions / max(n, 1):.4g} per disk)",
        "T": f"{now.temperature:.5g}", "T_rot": f"{now.rotational_temperature:.5g}",
    }  # fmt: skip
    return page("Simulation", rows, _thumbnail(plot_disks.View.of(source)))


@html.register
def _(source: Frame) -> str:
    whole = source.trajectory
    rows = {
        "of": whole.path, "time": whole.with_unit(f"{source.time:.6g}", "time"), "disks": whole.disks.n,
        "box": _box(whole.box), "fields": ", ".join(whole.fields),
    }  # fmt: skip
    picture = _thumbnail(plot_disks.View.of(source)) if whole.file and "position" in whole.fields else None
    return page(f"Frame {source.index} of {len(whole)}", rows, picture)


@html.register
def _(source: Trajectory) -> str:
    rows: dict[str, Any] = {
        "file": source.path,
        "disks": source.disks.n,
        "box": _box(source.box),
        "frames": len(source),
    }
    if len(source):
        span = f"{source.times[0]:.6g} to {source.times[-1]:.6g}"
        rows |= {"time": source.with_unit(span, "time"), "fields": ", ".join(source.fields)}
    rows["observables"] = ", ".join(source.observables)
    there = source.file and len(source) and "position" in source.fields
    return page("Trajectory", rows, _thumbnail(plot_disks.View.of(source[-1])) if there else None)


@html.register
def _(source: State) -> str:
    if not source.n:
        return page("State", {"disks": 0})
    rms = [np.sqrt(np.mean(np.sum(one**2, axis=-1))) for one in (source.velocity, source.spin[:, None])]
    rows = {
        "disks": source.n, "time": f"{source.time:.6g}", "root mean square velocity": f"{rms[0]:.5g}",
        "root mean square spin": f"{rms[1]:.5g}",
    }  # fmt: skip
    from matplotlib.figure import Figure

    figure = Figure(figsize=THUMBNAIL, layout="constrained")
    axes = figure.subplots()
    x, y = source.position.T
    axes.scatter(x, y, s=min(4e3 / source.n, 30.0), lw=0.0, rasterized=True)  # radii are not in a state
    axes.set_aspect("equal")
    axes.tick_params(labelsize="x-small")
    return page("State", rows, figure)


def _box(box: Box) -> str:
    if box.is_open:
        return "open"
    shear = f", shear rate {box.shear_rate:.5g}" if box.shear_rate else ""
    sides = " and ".join(axis for axis, is_periodic in zip("xy", box.periodic, strict=True) if is_periodic)
    return f"{box.lengths[0]:.5g} x {box.lengths[1]:.5g}, {f'periodic along {sides}' if sides else 'walls'}{shear}"


def _thumbnail(view: plot_disks.View) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=THUMBNAIL, layout="constrained")
    axes = figure.subplots()
    plot_disks.draw(axes, view, plot_disks.default_color(view))
    axes.set(title="", xlabel="", ylabel="", xticks=[], yticks=[])
    for bar in axes.child_axes:
        bar.remove()
    return figure


def page(title: str, rows: Mapping[str, Any], figure: Figure | None = None) -> str:
    """A title, a table and a figure side by side, as HTML."""
    lines = "".join(
        f"<tr><th style='text-align:left'>{escape.escape(str(name))}</th>"
        f"<td style='text-align:left'>{escape.escape(str(value))}</td></tr>"
        for name, value in rows.items()
    )
    picture = ""
    if figure is not None:
        held = io.BytesIO()
        figure.savefig(held, format="png", dpi=80)
        picture = f"<img alt='' src='data:image/png;base64,{base64.b64encode(held.getvalue()).decode()}'>"
    return (
        f"<div style='display:flex;gap:1em;align-items:center'><div><b>{escape.escape(title)}</b>"
        f"<table>{lines}</table></div>{picture}</div>"
    )
