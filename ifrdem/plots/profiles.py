"""Panels of profiles across a gas: packing fraction, temperatures, and the mean velocity where something drags it.

Profiles across a gas: packing fraction, mean velocity and temperatures in strips, means over frames.

Strips run across x or y: across gravity, if there is any, else from wall to wall. The area of each disk is shared out
among strips exactly; a strip's packing fraction is that over the area of the room in it, where moving walls stand
where they are at t = 0. Velocities and spins belong to the strip of the disk's centre. Temperatures are about the
strip's mean velocity u, which is weighted by mass: T_x = <m (v_x - u_x)^2>, and so for y; T_rot = <I omega^2>.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .style import ACROSS, RATIO, ROTATION, TRANSLATION, with_unit

MOST_STRIPS, LEAST_STRIPS = 40, 8
FEWEST = 20  # disks, over all frames, that tell a temperature
MOST_WORK = 20_000_000  # disks x frames x strips


@dataclass(frozen=True, eq=False)
class Profile:
    """Means over frames in strips across an axis.

    Attributes
    ----------
    axis : int
        0 for x, 1 for y.
    edges : array (s + 1,)
        Between strips [length].
    packing_fraction : array (s,)
        nan where walls leave no room.
    velocity : array (s, 2)
        Mean velocity [length/time]; nan, as temperatures are, where fewer than `FEWEST` disks were.
    temperature : array (s, 2)
        T_x and T_y [energy].
    rotational_temperature : array (s,)
        [energy]
    times : tuple of two floats
        Of the first and last frame that counts [time].
    """

    axis: int
    edges: Array
    packing_fraction: Array
    velocity: Array
    temperature: Array
    rotational_temperature: Array
    times: tuple[float, float]

    @property
    def middle(self) -> Array:
        """Middles of the strips [length], shape (s,)."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])


def of(trajectory: Trajectory) -> Profile | None:
    """The profile of the second half of the frames; None if the file lacks positions, velocities or spins."""
    if not {"position", "velocity", "angular_velocity"} <= set(trajectory.fields):
        return None
    axis = _axis(trajectory)
    frames = trajectory[len(trajectory) // 2 :]
    disks = trajectory.disks
    low, high = (float(corner[axis]) for corner in trajectory.room.bounds())
    top = max(
        float(np.max(frame.position[:, axis] + disks.radius))
        for frame in frames[:: max(1, len(frames) // 10)]
    )
    span = min(high, 1.05 * top) - low
    strips = int(np.clip(span / (2.0 * disks.radius.mean()), LEAST_STRIPS, MOST_STRIPS))
    edges = low + span * np.arange(strips + 1) / strips
    step = max(1, len(frames) * disks.n * strips // MOST_WORK)
    used = frames[::step]
    covered = np.zeros(strips)
    sums = np.zeros((6, strips))  # of 1, m, m v_x, m v_y, m v_x^2, m v_y^2
    spins = np.zeros(strips)
    for frame in used:
        position, velocity = frame.position, frame.velocity
        covered += np.diff([np.sum(_area_below(edge, position[:, axis], disks.radius)) for edge in edges])
        strip = np.clip(np.floor((position[:, axis] - low) / span * strips).astype(np.intp), 0, strips - 1)
        inside = position[:, axis] < edges[-1]
        weights = (
            np.ones(disks.n),
            disks.mass,
            *(disks.mass[:, None] * velocity).T,
            *(disks.mass[:, None] * velocity**2).T,
        )
        for row, weight in zip(sums, weights, strict=True):
            row += np.bincount(strip[inside], weight[inside], minlength=strips)
        spins += np.bincount(strip[inside], (disks.inertia * frame.spin**2)[inside], minlength=strips)
    room = trajectory.room.strips(axis, edges)
    number, mass, momentum, square = sums[0], sums[1], sums[2:4], sums[4:6]
    with np.errstate(divide="ignore", invalid="ignore"):
        number = np.where(number >= FEWEST, number, np.nan)
        velocity = momentum / np.where(np.isnan(number), np.nan, mass)
        # The mean of the squares less the square of the mean.
        temperature = (square - velocity**2 * mass) / number
        fraction = np.where(room > 1e-9 * trajectory.box.area, covered / (len(used) * room), np.nan)
    return Profile(
        axis=axis,
        edges=edges,
        packing_fraction=fraction,
        velocity=velocity.T,
        temperature=temperature.T,
        rotational_temperature=spins / number,
        times=(used[0].time, used[-1].time),
    )


def gravity_of(trajectory: Trajectory) -> tuple[float, float]:
    """The gravity of a run [length/time^2]: the parameter of that name, a list of two numbers as JSON."""
    return trajectory.gravity


def _axis(trajectory: Trajectory) -> int:
    """Along gravity; else across the first flat wall that moves or is hot; else from wall to wall."""
    gravity = gravity_of(trajectory)
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


if TYPE_CHECKING:
    from matplotlib.axes import Axes

HOT = "#CC79A7"
SLABS = 20  # in which the mean flow is drawn


def draw(figure: Any, place: Any, trajectory: Trajectory, profile: Profile) -> None:
    """Draw a profile into a place of the figure's grid: side by side upwards, one above the other across."""
    upwards = profile.axis == 1
    dragged = any(wall.surface_speed != 0.0 or wall.motion.kind == "steady" for wall in trajectory.walls)
    count = 3 if dragged else 2
    grid = place.subgridspec(1, count) if upwards else place.subgridspec(count, 1)
    panels: list[Axes] = []
    for i in range(count):
        shared = {("sharey" if upwards else "sharex"): panels[0]} if panels else {}
        panels.append(figure.add_subplot(grid[0, i] if upwards else grid[i, 0], **shared))
    units = trajectory.units
    _fraction(panels[0], profile)
    _temperatures(panels[1], trajectory, profile, units)
    if dragged:
        _velocities(panels[2], profile, units)
    name = with_unit("$y$" if upwards else "$x$", units.get("length"))
    if upwards:
        panels[0].set_ylabel(name)
        for axes in panels[1:]:
            axes.tick_params(labelleft=False)
    else:
        panels[-1].set_xlabel(name)
        for axes in panels[:-1]:
            axes.tick_params(labelbottom=False)
    first, last = (trajectory.with_unit(f"{time:.4g}", "time") for time in profile.times)
    panels[0].set_title(f"means from {first} to {last}", fontsize="medium", loc="left")
    for axes in panels:
        axes.grid(True, which="major", lw=0.4, alpha=0.5)


def _line(axes: Axes, profile: Profile, values: Array, **look: Any) -> None:
    places = profile.middle
    axes.plot(*((values, places) if profile.axis == 1 else (places, values)), **look)


def _value_axis(axes: Axes, profile: Profile, text: str, *, from_zero: bool = True) -> None:
    """Label the axis of the values, and let it begin at 0."""
    if profile.axis == 1:
        axes.set_xlabel(text)
        if from_zero:
            axes.set_xlim(left=0.0)
    else:
        axes.set_ylabel(text.replace(" (", "\n("))  # flat panels
        if from_zero:
            axes.set_ylim(bottom=0.0)


def _fraction(axes: Axes, profile: Profile) -> None:
    _line(axes, profile, profile.packing_fraction, color=RATIO, marker="o", ms=3, lw=1.2)
    _value_axis(axes, profile, r"packing fraction $\phi$")


def _temperatures(axes: Axes, trajectory: Trajectory, profile: Profile, units: dict[str, str]) -> None:
    along, across = ("y", "x") if profile.axis == 1 else ("x", "y")
    for values, colour, style, label in (
        (profile.temperature[:, profile.axis], TRANSLATION, "o-", rf"$T_{along}$, along"),
        (profile.temperature[:, 1 - profile.axis], ACROSS, "s--", rf"$T_{across}$, across"),
        (profile.rotational_temperature, ROTATION, "^:", r"$T_\mathrm{rot}$"),
    ):
        _line(axes, profile, values, color=colour, marker=style[0], ls=style[1:], ms=3, lw=1.2, label=label)
    label = "thermal wall"
    for wall in trajectory.walls:
        if wall.temperature is None or wall.shape != "line" or wall.towards[profile.axis] == 0.0:
            continue
        at = wall.place[profile.axis]
        pair = (wall.temperature, at) if profile.axis == 1 else (at, wall.temperature)
        axes.plot(*pair, "D", color=HOT, ms=7, clip_on=False, zorder=5, label=label)
        label = "_"  # once in the legend
    _value_axis(axes, profile, with_unit("temperature", units.get("energy")))
    axes.legend(loc="best", frameon=False, fontsize="small")


def _velocities(axes: Axes, profile: Profile, units: dict[str, str]) -> None:
    for i, colour, style in ((0, TRANSLATION, "o-"), (1, ACROSS, "s--")):
        label = rf"$u_{'xy'[i]}$"
        look = {"color": colour, "marker": style[0], "ls": style[1:], "ms": 3, "lw": 1.2}
        _line(axes, profile, profile.velocity[:, i], label=label, **look)
    unit = f"{units['length']}/{units['time']}" if {"length", "time"} <= units.keys() else None
    _value_axis(axes, profile, with_unit("mean velocity", unit), from_zero=False)
    axes.legend(loc="best", frameon=False, fontsize="small")


def flow(axes: Axes, trajectory: Trajectory) -> None:
    """Mean velocity along x in slabs, over the second half of the frames, beside the flow that the box imposes."""
    units, box = trajectory.units, trajectory.box
    height = box.lengths[1]
    edges = np.array([0.0, height])
    imposed = box.flow(np.stack((np.zeros(2), edges), axis=1))[:, 0]
    speed = units["length"] + "/" + units["time"] if "time" in units else None
    if {"position", "velocity"} <= set(trajectory.fields):
        count, sum_ = np.zeros(SLABS), np.zeros(SLABS)
        for frame in trajectory[len(trajectory) // 2 :]:
            slab = np.minimum((frame.position[:, 1] / height * SLABS).astype(int), SLABS - 1)
            count += np.bincount(slab, minlength=SLABS)
            sum_ += np.bincount(slab, frame.velocity[:, 0], minlength=SLABS)
        middles = (np.arange(SLABS) + 0.5) * height / SLABS
        with np.errstate(invalid="ignore"):
            axes.plot(sum_ / count, middles, "o", ms=5, mfc="none", color=TRANSLATION, label="disks")
    axes.plot(imposed, edges, "-", lw=1.0, color="black", label=r"$\dot\gamma (y - L_y / 2)$")
    axes.set_ylim(0.0, height)
    axes.set_xlabel(with_unit(r"$\langle v_x \rangle$", speed))
    axes.set_ylabel(with_unit("$y$", units.get("length")))
    axes.set_title("mean flow, second half")
    axes.grid(True, which="major", lw=0.4, alpha=0.5)
    axes.legend(loc="upper left", frameon=False)
