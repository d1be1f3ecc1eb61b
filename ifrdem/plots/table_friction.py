"""The picture of disks that slide to rest on a table: energies, how many still move, and their paths."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure

from ..analysis import motion
from ..errors import InputError
from ..tools.checked import Array, validated
from ..trajectory.reader import Trajectory
from .disks import shown_region
from .run import PicturePath, Run, drawing
from .style import (
    RATIO,
    ROTATION,
    TRANSLATION,
    color_bar,
    dashes,
    grid,
    label,
    legend_above,
    place_axes,
    positive,
    some_marks,
)

MOST_PATHS = 2000
"""Above this many disks, their paths are a grey haze: only the final places are drawn."""


@validated
def table(run: Run, path_png: PicturePath = None) -> Figure:
    """Draw disks on a table: energies (logarithmic) and moving disks against time; paths and final places.

    As `run.cooling`, of a trajectory with positions, velocities, spins and the observables `translational_energy` and
    `rotational_energy`. The axis of time ends when all are at rest.

    Examples
    --------
    >>> from ifrdem import plots
    >>> figure = plots.table("coins_on_table.h5")  # doctest: +SKIP
    """
    with drawing(run, path_png) as (trajectory, figure):
        figure.set_size_inches(13.5, 6.3)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15), height_ratios=(2.0, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        _energies(upper, trajectory)
        rest = _moving(figure.add_subplot(grid[1, 0], sharex=upper), trajectory)
        upper.set_xlim(trajectory.times[0], rest)
        upper.tick_params(labelbottom=False)
        _paths(figure.add_subplot(grid[:, 1]), trajectory)
    return figure


def _energies(axes: Axes, trajectory: Trajectory) -> None:
    for i, (name, colour, text) in enumerate((
        ("translational_energy", TRANSLATION, r"translational, $\sum m v^2 / 2$"),
        ("rotational_energy", ROTATION, r"rotational, $\sum I \omega^2 / 2$"),
    )):  # fmt: skip
        values = trajectory.observables[name]
        look = some_marks(colour, i, ls=dashes(colour)["ls"])
        axes.plot(trajectory.times, positive(values), label=text, **look)
        if np.any(values > 0.0):
            axes.set_yscale("log")
    axes.set_ylabel(label(trajectory, "energy of all disks", "energy"))
    grid(axes)
    legend_above(axes)


def _moving(axes: Axes, trajectory: Trajectory) -> float:
    """Draw how many disks are not at rest; returns the time of the first frame after which none moves, or the last."""
    moves = (np.any(each.velocity != 0.0, axis=1) | (each.spin != 0.0) for each in trajectory)
    moving = [int(np.sum(each)) for each in moves]
    axes.plot(trajectory.times, moving, "-", color=RATIO)
    last = max((i for i, count in enumerate(moving) if count), default=0)
    axes.set(
        xlabel=label(trajectory, "time $t$", "time"),
        ylabel="disks not at rest",
        ylim=(0.0, 1.08 * max(*moving, 1)),
    )
    grid(axes)
    return float(trajectory.times[min(last + 1, len(moving) - 1)])


def _paths(axes: Axes, trajectory: Trajectory) -> None:
    """Paths from frame to frame, and the final places, coloured by how far away from the start they are.

    Only the final places if the file does not determine how often disks went around the box.
    """
    radius, n = trajectory.disks.radius, trajectory.n
    try:
        unwrapped = np.concatenate([*motion.unwrapped(trajectory, range(len(trajectory)))], axis=1)
        known = True
    except InputError:
        unwrapped, known = trajectory[-1].position[None], False
    everything = unwrapped.reshape(-1, 2)
    region = shown_region(trajectory, everything)
    if not trajectory.box.is_open:
        low = np.minimum(region[:, 0], everything.min(axis=0))
        region = np.stack([low, np.maximum(region[:, 1], everything.max(axis=0))], axis=1)
    place_axes(axes, trajectory, region)
    if n <= MOST_PATHS and known:
        paths = list(np.swapaxes(unwrapped, 0, 1))
        axes.add_collection(LineCollection(paths, colors="#999999", linewidths=0.5, alpha=0.7))
    away: Array = np.linalg.norm(unwrapped[-1] - unwrapped[0], axis=1)
    drawn = EllipseCollection(
        2.0 * radius, 2.0 * radius, np.zeros(n), units="xy", offsets=unwrapped[-1],
        offset_transform=axes.transData, array=away, cmap="cividis", linewidths=0.0,
    )  # fmt: skip
    axes.add_collection(drawn)
    if np.any(away):
        color_bar(axes, drawn, label(trajectory, "distance from the start", "length"))
    time = trajectory.with_unit(f"{trajectory.times[-1]:.4g}", "time")
    ending = ", and their paths" if known else "; their paths need the field image"
    axes.set_title(f"disks at $t$ = {time}" + (ending if n <= MOST_PATHS or not known else ""))
