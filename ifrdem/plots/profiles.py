"""Profiles across a gas: packing fraction, temperatures, and the mean velocity if the gas is dragged.

They are `analysis.profiles` across gravity, if there is any, else from wall to wall. Temperatures and velocities of
strips with fewer than `analyses.FEWEST` disks over all frames are not drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.averages import BinAverages, default_axis, free_range, profiles
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .analyses import FEWEST
from .disks import HOT
from .style import ACROSS, RATIO, ROTATION, TRANSLATION, foreground, grid, label, marked_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def of(trajectory: Trajectory) -> BinAverages | None:
    """The profile of the second half of the frames; None if the file lacks positions or velocities.

    It goes up to somewhat above the highest disk.
    """
    if not {"position", "velocity"} <= set(trajectory.fields):
        return None
    name = default_axis(trajectory)
    axis, frames = "xy".index(name), trajectory[len(trajectory) // 2 :]
    low, high = free_range(trajectory, name, [frame.index for frame in frames])
    reach = trajectory.disks.radius
    top = max(float(np.max(one.position[:, axis] + reach)) for one in frames[:: max(1, len(frames) // 10)])
    return profiles(trajectory, name, span=(low, min(high, low + 1.05 * (top - low))), collisions=False)


SLABS = 20  # in which the mean flow is drawn


def draw(figure: Any, cell: Any, trajectory: Trajectory, profile: BinAverages) -> None:
    """Draw a profile into a cell of the figure's grid: side by side upwards, one above the other across."""
    upwards = _upwards(profile)
    dragged = any(wall.surface_speed != 0.0 or wall.motion.kind == "steady" for wall in trajectory.walls)
    count = 3 if dragged else 2
    cells = cell.subgridspec(1, count) if upwards else cell.subgridspec(count, 1)
    panels: list[Axes] = []
    for i in range(count):
        shared = {("sharey" if upwards else "sharex"): panels[0]} if panels else {}
        panels.append(figure.add_subplot(cells[0, i] if upwards else cells[i, 0], **shared))
    _line(panels[0], profile, profile.mean.packing_fraction, color=RATIO, marker="o", ms=3, lw=1.2)
    _value_axis(panels[0], profile, r"packing fraction $\phi$")
    _temperatures(panels[1], trajectory, profile)
    if dragged:
        _velocities(panels[2], trajectory, profile)
    if upwards:
        panels[0].set_ylabel(label(trajectory, "$y$", "length"))
        for axes in panels[1:]:
            axes.tick_params(labelleft=False)
    else:
        panels[-1].set_xlabel(label(trajectory, "$x$", "length"))
        for axes in panels[:-1]:
            axes.tick_params(labelbottom=False)
    first, last = (trajectory.with_unit(f"{time:.4g}", "time") for time in profile.times)
    panels[0].set_title(f"means from {first} to {last}", fontsize="medium", loc="left")
    grid(*panels)


def _upwards(profile: BinAverages) -> bool:
    """True if the profile goes along y."""
    return profile.axes == ("y",)


def _line(axes: Axes, profile: BinAverages, values: Array, **line_style: Any) -> None:
    (middle,) = profile.middles
    axes.plot(*((values, middle) if _upwards(profile) else (middle, values)), **line_style)


def _value_axis(axes: Axes, profile: BinAverages, text: str, *, from_zero: bool = True) -> None:
    """Label the axis of the values, and let it begin at 0."""
    if _upwards(profile):
        axes.set_xlabel(text)
        axes.locator_params(axis="x", nbins=4)  # narrow panels
        axes.ticklabel_format(axis="x", scilimits=(-2, 4))
        if from_zero:
            axes.set_xlim(left=0.0)
    else:
        axes.set_ylabel(text.replace(" (", "\n("))  # flat panels
        if from_zero:
            axes.set_ylim(bottom=0.0)


def _temperatures(axes: Axes, trajectory: Trajectory, profile: BinAverages) -> None:
    along, across = ("y", "x") if _upwards(profile) else ("x", "y")
    mean, axis = profile.mean, "xy".index(profile.axes[0])
    known = np.isfinite(mean.rotational_temperature).any()
    spins = "" if known else ": the file holds no angular_velocity"
    for values, colour, text in (
        (mean.temperatures[:, axis], TRANSLATION, rf"$T_{along}$, along"),
        (mean.temperatures[:, 1 - axis], ACROSS, rf"$T_{across}$, across"),
        (mean.rotational_temperature, ROTATION, rf"$T_\mathrm{{rot}}${spins}"),
    ):
        if known and values is mean.rotational_temperature and not np.any(np.nan_to_num(values)):
            continue  # nothing spins
        values = np.where(profile.disks >= FEWEST, values, np.nan)
        _line(axes, profile, values, label=text, **marked_line(colour, ms=3, lw=1.2))
    text = "thermal wall"
    for wall in trajectory.walls:
        if wall.temperature is None or wall.shape != "line" or wall.towards[axis] == 0.0:
            continue
        at = wall.origin[axis]
        pair = (wall.temperature, at) if _upwards(profile) else (at, wall.temperature)
        axes.plot(*pair, "D", color=HOT, ms=7, clip_on=False, zorder=5, label=text)
        text = "_"  # once in the legend
    _value_axis(axes, profile, label(trajectory, "temperature", "energy"))
    axes.legend(loc="best", frameon=False, fontsize="small")


def _velocities(axes: Axes, trajectory: Trajectory, profile: BinAverages) -> None:
    for i, colour in ((0, TRANSLATION), (1, ACROSS)):
        values = np.where(profile.disks >= FEWEST, profile.mean.velocity[:, i], np.nan)
        _line(axes, profile, values, label=rf"$u_{'xy'[i]}$", **marked_line(colour, ms=3, lw=1.2))
    _value_axis(axes, profile, label(trajectory, "mean velocity", "length/time"), from_zero=False)
    axes.legend(loc="best", frameon=False, fontsize="small")


def flow(axes: Axes, trajectory: Trajectory) -> None:
    """Mean velocity along x in slabs, over the second half of the frames, with the imposed flow."""
    box, height = trajectory.box, trajectory.box.lengths[1]
    edges = np.array([0.0, height])
    imposed = box.flow(np.stack((np.zeros(2), edges), axis=1))[:, 0]
    if {"position", "velocity"} <= set(trajectory.fields):
        found = profiles(trajectory, "y", SLABS, collisions=False)
        style: dict[str, Any] = {"ms": 5, "mfc": "none", "color": TRANSLATION, "label": "disks"}
        axes.plot(found.mean.velocity[:, 0], found.middles[0], "o", **style)
    axes.plot(imposed, edges, "-", lw=1.0, color=foreground(axes), label=r"$\dot\gamma (y - L_y / 2)$")
    axes.set(ylim=(0.0, height), ylabel=label(trajectory, "$y$", "length"), title="mean flow, second half")
    axes.set_xlabel(label(trajectory, r"$\langle v_x \rangle$", "length/time"))
    grid(axes)
    axes.legend(loc="upper left", frameon=False)
