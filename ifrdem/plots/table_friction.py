"""The picture of disks that slide to rest on a table: energies, how many still move, and their paths."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .disks import shown_region
from .run import save, title
from .style import RATIO, ROTATION, TRANSLATION, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_PATHS = 2000
"""Above this many disks, their paths are a grey haze: only the final places are drawn."""


def table(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw disks on a table: energies (logarithmic) and moving disks against time; paths and final places.

    Parameters
    ----------
    path_h5 : path
        A trajectory with positions, velocities, spins and the observables `translational_energy` and
        `rotational_energy`.
    path_png : path
        The picture to write: it appears whole or not at all. An existing one is replaced.

    Raises
    ------
    InputError
        If the trajectory cannot be read, lacks these, or holds no frame, or the picture cannot be written.
    """
    from matplotlib.figure import Figure

    with Trajectory(path_h5) as trajectory:
        if len(trajectory) == 0:
            raise InputError(f"{path_h5}: no frame to draw")
        figure = Figure(figsize=(13.5, 6.3), dpi=200, layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15), height_ratios=(2.0, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        _energies(upper, trajectory)
        _moving(lower, trajectory)
        upper.tick_params(labelbottom=False)
        _paths(figure, figure.add_subplot(grid[:, 1]), trajectory)
        figure.suptitle(title(trajectory))
        save(figure, Path(path_png))


def _energies(axes: Axes, trajectory: Trajectory) -> None:
    unit = trajectory.units.get("energy")
    for name, colour, label in (
        ("translational_energy", TRANSLATION, r"translational, $\sum m v^2 / 2$"),
        ("rotational_energy", ROTATION, r"rotational, $\sum I \omega^2 / 2$"),
    ):
        values = trajectory.observables[name]
        axes.plot(
            trajectory.times, np.where(values > 0.0, values, np.nan), "-o", ms=3, color=colour, label=label
        )
        if np.any(values > 0.0):
            axes.set_yscale("log")
    axes.set_ylabel(with_unit("energy of all disks", unit))
    axes.grid(True, which="major", lw=0.4, alpha=0.5)
    axes.legend(loc="lower left", frameon=False)


def _moving(axes: Axes, trajectory: Trajectory) -> None:
    moving = [
        int(np.count_nonzero(np.any(frame.velocity != 0.0, axis=1) | (frame.spin != 0.0)))
        for frame in trajectory
    ]
    axes.plot(trajectory.times, moving, "-", color=RATIO)
    axes.set_ylim(0.0, 1.08 * max(*moving, 1))
    axes.set_ylabel("disks not at rest")
    axes.set_xlabel(with_unit("time $t$", trajectory.units.get("time")))
    axes.grid(True, which="major", lw=0.4, alpha=0.5)


def _paths(figure: Any, axes: Axes, trajectory: Trajectory) -> None:
    """Paths from frame to frame, and the final places, coloured by how far away from the start they are."""
    from matplotlib.collections import EllipseCollection, LineCollection

    units, radius, n = trajectory.units, trajectory.disks.radius, trajectory.disks.n
    positions = np.stack([frame.position for frame in trajectory])
    steps = np.diff(positions, axis=0)
    # Across a periodic side, a step is the short way round.
    steps = trajectory.box.minimum_image(steps)
    unwrapped = np.concatenate([positions[:1], positions[:1] + np.cumsum(steps, axis=0)])
    everything = unwrapped.reshape(-1, 2)
    region = shown_region(trajectory, everything)
    if not trajectory.box.is_open:
        region = np.stack(
            [
                np.minimum(region[:, 0], everything.min(axis=0)),
                np.maximum(region[:, 1], everything.max(axis=0)),
            ],
            axis=1,
        )
    (left, right), (bottom, top) = region
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_aspect("equal")
    if n <= MOST_PATHS:
        axes.add_collection(
            LineCollection(list(np.swapaxes(unwrapped, 0, 1)), colors="#999999", linewidths=0.5, alpha=0.7)
        )
    away: Array = np.linalg.norm(unwrapped[-1] - unwrapped[0], axis=1)
    drawn = EllipseCollection(
        2.0 * radius, 2.0 * radius, np.zeros(n), units="xy", offsets=unwrapped[-1],
        offset_transform=axes.transData, array=away, cmap="cividis", linewidths=0.0,
    )  # fmt: skip
    axes.add_collection(drawn)
    figure.colorbar(drawn, ax=axes, shrink=0.85).set_label(
        with_unit("distance from the start", units.get("length"))
    )
    axes.set_xlabel(with_unit("$x$", units.get("length")))
    axes.set_ylabel(with_unit("$y$", units.get("length")))
    time = trajectory.with_unit(f"{trajectory.times[-1]:.4g}", "time")
    axes.set_title(f"disks at $t$ = {time}" + (", and their paths" if n <= MOST_PATHS else ""))
