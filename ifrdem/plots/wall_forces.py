"""Panels of what walls take from the disks, against time: force, torque, work and heat of each wall or group."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..model.walls import Turn
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .energies import along, axis_label
from .style import KINDS, grid, label, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_CURVES = len(KINDS)
POINTS = 100
"""Spans of time, at most, over which forces are means."""


def names_of(trajectory: Trajectory) -> list[str]:
    """Names of the curves: groups, and walls without one; those of most hits if there are more than `MOST_CURVES`.

    Raises
    ------
    InputError
        If the file does not hold the sums of walls, or fewer than two rows of them.
    """
    series = trajectory.series
    if "walls_hits" not in series:
        raise InputError(
            f"{trajectory.path} does not hold what walls give to the disks: output.wall_sums = true is needed, "
            "as by `ifrdem run CASE --set output.wall_sums=true` (in Python Simulation(wall_sums=True))"
        )
    if len(series.time) < 2:
        raise InputError(f"{trajectory.path}: two rows of the series at least are needed for forces on walls")
    columns = series.columns("walls_hits")
    grouped = {wall.group for wall in trajectory.walls if wall.group}
    names = list(
        dict.fromkeys(
            next((g for g in grouped if re.fullmatch(rf"{re.escape(g)} \d+ .*", c)), c) for c in columns
        )
    )
    hits = {name: float(series[f"walls_hits/{name}"][-1]) for name in names}
    most = sorted(names, key=lambda name: -hits[name])[:MOST_CURVES]
    return [name for name in names if name in most and hits[name] > 0.0] or most


def draw(axes: Sequence[Axes], trajectory: Trajectory, over: str = "t") -> None:
    """Mean force and torque *on* walls between rows of the series, and the work and heat that they gave until then.

    Torques are about the centre of a wall's turn, or the origin.
    """
    series, names = trajectory.series, names_of(trajectory)
    rows = np.unique(np.linspace(0, len(series.time) - 1, POINTS + 1).astype(int))
    rows = rows[np.concatenate(([True], np.diff(series.time[rows]) > 0.0))]
    time = series.time[rows]
    middle = along(trajectory, 0.5 * (time[1:] + time[:-1]), over)

    def rate(quantity: str, name: str) -> Array:
        return np.asarray(-np.diff(series[f"walls_{quantity}/{name}"][rows]) / np.diff(time))

    force, torque, work, heat = axes
    for name, colour in zip(names, KINDS, strict=False):
        force.plot(middle, rate("momentum_y", name), "-", color=colour, lw=1.2, label=name)
        force.plot(middle, rate("momentum_x", name), ":", color=colour, lw=1.2)
        torque.plot(middle, rate("torque", name), "-", color=colour, lw=1.2)
        for panel, quantity in ((work, "work"), (heat, "heat")):
            values = series[f"walls_{quantity}/{name}"]
            panel.plot(along(trajectory, series.time, over), values, "-", color=colour, lw=1.2)
    if not any(np.any(series[f"walls_heat/{name}"]) for name in names):
        text = "no wall here gave heat"
        heat.text(0.5, 0.53, text, ha="center", va="center", color="0.5", transform=heat.transAxes)
        heat.set_yticks([])
    turning = sum(wall.turn != Turn() for wall in trajectory.walls)
    sides = sum(not each for each in trajectory.box.periodic)
    centre = "the centre of its turn"
    if turning < len(trajectory.walls) or sides:
        centre = "(0, 0)" + "\n(walls that turn: its centre)" * (turning > 0)
    left_out = len(series.columns("walls_hits")) > MOST_CURVES == len(names)
    text = "along $x$ (others: $y$)" + ("; those of most hits" if left_out else "")
    force.plot([], [], ":", color="0.5", label=text)
    force.set_ylabel(label(trajectory, "mean force on the wall", "mass length/time^2"))
    torque.set_ylabel(label(trajectory, f"mean torque about {centre}", "mass length^2/time^2"))
    work.set_ylabel(label(trajectory, "work given to disks", "energy"))
    heat.set_ylabel(label(trajectory, "heat given to disks", "energy"))
    for panel in (work, heat):
        panel.set_xlabel(axis_label(trajectory, over))
    grid(*axes)
    legend_above(force, 2)
