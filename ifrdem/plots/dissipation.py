"""Map of the dissipated energy and its mechanisms, from frames with the field `dissipated`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..errors import InputError
from ..quantities import MECHANISMS
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .disks import collisions_of, draw_walls, shown_region
from .series import DISSIPATED
from .style import color_bar, label, place_axes, with_unit

PER_CELL = 60
"""Disks, over all frames, in a cell of the map, about."""
MOST_CELLS = 200  # along a side


@dataclass(frozen=True, eq=False)
class DissipationMap:
    """Power that collisions took, over the time between the first and the last of some frames."""

    region: Array  # ends of x and of y [length], shape (2, 2)
    power: Array  # per area [energy/(length^2 time)], shape (cells along x, along y)
    mechanisms: Array  # energy by mechanism [energy], shape (7,)
    times: tuple[float, float]  # [time]


def of(trajectory: Trajectory, frames: Sequence[int] | None = None) -> DissipationMap:
    """Add up what disks lost between two frames and the next, where they are at the second.

    Raises
    ------
    InputError
        If the file does not hold what disks lost, or there are fewer than two frames.
    """
    if "dissipated" not in trajectory.fields:
        raise InputError(
            f"{trajectory.path} does not hold what each disk lost: output.fields must have 'dissipated' (in Python "
            'record=["dissipated"], and the field in TrajectoryWriter)'
        )
    every = range(len(trajectory))
    used = sorted({every[i] for i in (every if frames is None else frames)})
    if len(used) < 2:
        raise InputError(f"{trajectory.path}: must have two frames or more")
    region = shown_region(trajectory, trajectory[used[-1]].position)
    lengths = np.ptp(region, axis=1)
    cell = np.sqrt(np.prod(lengths) * PER_CELL / max(trajectory.n * (len(used) - 1), 1))
    cells = np.clip(np.rint(lengths / cell), 1, MOST_CELLS).astype(int)
    before = trajectory[used[0]]
    start_time, lost, total = before.time, before["dissipated"], np.zeros(cells)
    first = lost
    for index in used[1:]:
        frame = trajectory[index]
        now, position = frame["dissipated"], frame.position
        x, y = position.T
        weights = (now - lost).sum(axis=1)
        total += np.histogram2d(x, y, bins=cells.tolist(), range=region.tolist(), weights=weights)[0]
        lost = now
    end = trajectory[used[-1]].time
    if not end > start_time:
        raise InputError(
            f"{trajectory.path}: all frames are at one time, t = {end:g}: must be at two times or more"
        )
    power = total * float(cells.prod() / np.prod(lengths)) / (end - start_time)
    return DissipationMap(region, power, (lost - first).sum(axis=0), (start_time, end))


def draw(left: Axes, right: Axes, trajectory: Trajectory, frames: Sequence[int] | None = None) -> None:
    """A map of the power per area, and bars with the share of each mechanism."""
    found = of(trajectory, frames)
    high = float(np.quantile(found.power, 0.995))
    drawn = left.imshow(
        found.power.T, origin="lower", extent=(*found.region[0], *found.region[1]), cmap="YlOrRd", vmin=0.0,
        vmax=high if high > 0.0 else 1.0, interpolation="nearest",
    )  # fmt: skip
    place_axes(left, trajectory)
    color_bar(
        left, drawn, label(trajectory, "energy dissipated, per area and time", "energy/length^2/time"), "max"
    )
    last = trajectory[int(np.searchsorted(trajectory.times, found.times[1]))]
    draw_walls(left, trajectory, last.time, collisions_of(last), last.walls)
    span = with_unit(trajectory, f"$t$ = {found.times[0]:.4g} to {found.times[1]:.4g}", "time")
    left.set_title(span, fontsize="medium")
    total = float(found.mechanisms.sum())
    acted = found.mechanisms != 0.0
    names = [name.replace("_", " ") for name, used in zip(MECHANISMS, acted, strict=False) if used]
    share = 100.0 * found.mechanisms[acted] / total if total else 0.0 * found.mechanisms[acted]
    right.barh(names, share, color=DISSIPATED)
    style: dict[str, Any] = {"textcoords": "offset points", "va": "center"}
    for name, each in zip(names, share.tolist(), strict=True):
        right.annotate(f"{each:.3g} %", (max(each, 0.0), name), (4.0, 0.0), **style)
    right.invert_yaxis()
    ends = 1.4 * min(float(share.min(initial=0.0)), 0.0), 1.4 * max(float(share.max(initial=0.0)), 1.0)
    right.set(xlabel="share of the energy dissipated (%)", xlim=ends)
