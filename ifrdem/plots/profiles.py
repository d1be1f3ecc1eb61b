"""Profiles across a gas: packing fraction, temperatures, and the mean velocity if the gas is dragged.

Means over frames in strips, which run across x or y: across gravity, if there is any, else from wall to wall. The area
of each disk is shared out among strips exactly; a strip's packing fraction is that over the area of the room in it,
where moving walls stand where they are in the first frame. Velocities and spins belong to the strip of the disk's
centre. Temperatures are about the strip's mean velocity u, which is weighted by mass: T_x = <m (v_x - u_x)^2>, and so
for y, without bias by the number of disks that u is the mean of; T_rot = <I omega^2>.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .disks import HOT
from .style import ACROSS, RATIO, ROTATION, TRANSLATION, foreground, grid, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_STRIPS, LEAST_STRIPS = 40, 8
FEWEST = 20  # disks, over all frames, for a temperature
MOST_WORK = 20_000_000  # disks x frames x strips


@dataclass(frozen=True, eq=False)
class Strips:
    """Means over frames in s strips across an axis; nan where fewer than `FEWEST` disks were."""

    axis: int  # 0 for x, 1 for y
    edges: Array  # between strips [length], shape (s + 1,)
    packing_fraction: Array  # (s,); nan where walls leave no room
    velocity: Array  # mean velocity [length/time], shape (s, 2)
    temperature: Array  # T_x and T_y [energy], shape (s, 2)
    rotational_temperature: Array  # [energy], shape (s,)
    times: tuple[float, float]  # of the first and last frame that counts [time]

    @property
    def middle(self) -> Array:
        """Middles of the strips [length], shape (s,)."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])


def of(trajectory: Trajectory) -> Strips | None:
    """The profile of the second half of the frames; None if the file lacks positions or velocities.

    Without spins it has no rotational temperature (nan).
    """
    if not {"position", "velocity"} <= set(trajectory.fields):
        return None
    turning = "angular_velocity" in trajectory.fields
    axis = _axis(trajectory)
    frames = trajectory[len(trajectory) // 2 :]
    disks = trajectory.disks
    low, high = (float(corner[axis]) for corner in trajectory.free_area.bounds())
    some = frames[:: max(1, len(frames) // 10)]
    top = max(float(np.max(frame.position[:, axis] + disks.radius)) for frame in some)
    span = min(high, 1.05 * top) - low
    strips = int(np.clip(span / (2.0 * disks.radius.mean()), LEAST_STRIPS, MOST_STRIPS))
    edges = low + span * np.arange(strips + 1) / strips
    step = max(1, len(frames) * disks.n * strips // MOST_WORK)
    used = frames[::step]
    covered = np.zeros(strips)
    sums = np.zeros((7, strips))  # of 1, m, m v_x, m v_y, m v_x^2, m v_y^2, I omega^2
    for frame in used:
        position, velocity = frame.position, frame.velocity
        covered += np.diff([np.sum(_area_below(edge, position[:, axis], disks.radius)) for edge in edges])
        strip = np.clip(np.floor((position[:, axis] - low) / span * strips).astype(np.intp), 0, strips - 1)
        inside = position[:, axis] < edges[-1]
        moving = (
            *(disks.mass * velocity.T),
            *(disks.mass * velocity.T**2),
            disks.inertia * frame.spin**2 if turning else np.full(disks.n, np.nan),
        )
        for row, weight in zip(sums, (np.ones(disks.n), disks.mass, *moving), strict=True):
            row += np.bincount(strip[inside], weight[inside], minlength=strips)
    free_area = trajectory.free_area.strips(axis, edges)
    number, mass, momentum, square, spins = sums[0], sums[1], sums[2:4], sums[4:6], sums[6]
    with np.errstate(divide="ignore", invalid="ignore"):
        number = np.where(number >= FEWEST, number, np.nan)
        velocity = momentum / np.where(np.isnan(number), np.nan, mass)
        # M <u^2> = T in sum m (v - u)^2 = sum m v^2 - M u^2, whatever the masses: N - 1 degrees of freedom.
        temperature = (square - velocity**2 * mass) / (number - 1.0)
        fraction = np.where(free_area > 1e-9 * trajectory.box.area, covered / (len(used) * free_area), np.nan)
    return Strips(
        axis, edges, fraction, velocity.T, temperature.T, spins / number, (used[0].time, used[-1].time)
    )


def _axis(trajectory: Trajectory) -> int:
    """Along gravity; else across the first flat wall that moves or is hot; else from wall to wall."""
    gravity = trajectory.gravity
    if any(gravity):
        return int(abs(gravity[1]) >= abs(gravity[0]))
    for wall in trajectory.walls:
        if wall.shape == "line":
            return int(abs(wall.towards[1]) > abs(wall.towards[0]))
    return int(trajectory.box.periodic[0])


def _area_below(edge: float, center: Array, radius: Array) -> Array:
    """Area of each disk that lies below an edge [length^2], shape (n,): the integral of its chords."""
    u = np.clip((edge - center) / radius, -1.0, 1.0)
    return radius**2 * (u * np.sqrt(1.0 - u * u) + np.arcsin(u) + 0.5 * np.pi)


SLABS = 20  # in which the mean flow is drawn


def draw(figure: Any, cell: Any, trajectory: Trajectory, profile: Strips) -> None:
    """Draw a profile into a cell of the figure's grid: side by side upwards, one above the other across."""
    upwards = profile.axis == 1
    dragged = any(wall.surface_speed != 0.0 or wall.motion.kind == "steady" for wall in trajectory.walls)
    count = 3 if dragged else 2
    cells = cell.subgridspec(1, count) if upwards else cell.subgridspec(count, 1)
    panels: list[Axes] = []
    for i in range(count):
        shared = {("sharey" if upwards else "sharex"): panels[0]} if panels else {}
        panels.append(figure.add_subplot(cells[0, i] if upwards else cells[i, 0], **shared))
    _line(panels[0], profile, profile.packing_fraction, color=RATIO, marker="o", ms=3, lw=1.2)
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


def _line(axes: Axes, profile: Strips, values: Array, **line_style: Any) -> None:
    middle = profile.middle
    axes.plot(*((values, middle) if profile.axis == 1 else (middle, values)), **line_style)


def _value_axis(axes: Axes, profile: Strips, text: str, *, from_zero: bool = True) -> None:
    """Label the axis of the values, and let it begin at 0."""
    if profile.axis == 1:
        axes.set_xlabel(text)
        axes.locator_params(axis="x", nbins=4)  # narrow panels
        axes.ticklabel_format(axis="x", scilimits=(-2, 4))
        if from_zero:
            axes.set_xlim(left=0.0)
    else:
        axes.set_ylabel(text.replace(" (", "\n("))  # flat panels
        if from_zero:
            axes.set_ylim(bottom=0.0)


def _temperatures(axes: Axes, trajectory: Trajectory, profile: Strips) -> None:
    along, across = ("y", "x") if profile.axis == 1 else ("x", "y")
    known = np.isfinite(profile.rotational_temperature).any()
    spins = "" if known else ": the file holds no angular_velocity"
    for values, colour, style, text in (
        (profile.temperature[:, profile.axis], TRANSLATION, "o-", rf"$T_{along}$, along"),
        (profile.temperature[:, 1 - profile.axis], ACROSS, "s--", rf"$T_{across}$, across"),
        (profile.rotational_temperature, ROTATION, "^:", rf"$T_\mathrm{{rot}}${spins}"),
    ):
        _line(axes, profile, values, color=colour, marker=style[0], ls=style[1:], ms=3, lw=1.2, label=text)
    text = "thermal wall"
    for wall in trajectory.walls:
        if wall.temperature is None or wall.shape != "line" or wall.towards[profile.axis] == 0.0:
            continue
        at = wall.origin[profile.axis]
        pair = (wall.temperature, at) if profile.axis == 1 else (at, wall.temperature)
        axes.plot(*pair, "D", color=HOT, ms=7, clip_on=False, zorder=5, label=text)
        text = "_"  # once in the legend
    _value_axis(axes, profile, label(trajectory, "temperature", "energy"))
    axes.legend(loc="best", frameon=False, fontsize="small")


def _velocities(axes: Axes, trajectory: Trajectory, profile: Strips) -> None:
    for i, colour, style in ((0, TRANSLATION, "o-"), (1, ACROSS, "s--")):
        line_style = {"color": colour, "marker": style[0], "ls": style[1:], "ms": 3, "lw": 1.2}
        _line(axes, profile, profile.velocity[:, i], label=rf"$u_{'xy'[i]}$", **line_style)
    _value_axis(axes, profile, label(trajectory, "mean velocity", "length/time"), from_zero=False)
    axes.legend(loc="best", frameon=False, fontsize="small")


def flow(axes: Axes, trajectory: Trajectory) -> None:
    """Mean velocity along x in slabs, over the second half of the frames, with the imposed flow."""
    box, height = trajectory.box, trajectory.box.lengths[1]
    edges = np.array([0.0, height])
    imposed = box.flow(np.stack((np.zeros(2), edges), axis=1))[:, 0]
    if {"position", "velocity"} <= set(trajectory.fields):
        count, sum_ = np.zeros(SLABS), np.zeros(SLABS)
        for frame in trajectory[len(trajectory) // 2 :]:
            slab = np.minimum((frame.position[:, 1] / height * SLABS).astype(int), SLABS - 1)
            count += np.bincount(slab, minlength=SLABS)
            sum_ += np.bincount(slab, frame.velocity[:, 0], minlength=SLABS)
        middles = (np.arange(SLABS) + 0.5) * height / SLABS
        with np.errstate(invalid="ignore"):
            axes.plot(sum_ / count, middles, "o", ms=5, mfc="none", color=TRANSLATION, label="disks")
    axes.plot(imposed, edges, "-", lw=1.0, color=foreground(axes), label=r"$\dot\gamma (y - L_y / 2)$")
    axes.set(ylim=(0.0, height), ylabel=label(trajectory, "$y$", "length"), title="mean flow, second half")
    axes.set_xlabel(label(trajectory, r"$\langle v_x \rangle$", "length/time"))
    grid(axes)
    axes.legend(loc="upper left", frameon=False)
