"""Profiles across a gas: packing fraction, mean velocity and temperatures in strips, means over frames.

Strips run across x or y: across gravity, if there is any, else from wall to wall. The area of each disk is shared out
among strips exactly; a strip's packing fraction is that over the area of the room in it, where moving walls stand
where they are at t = 0. Velocities and spins belong to the strip of the disk's centre. Temperatures are about the
strip's mean velocity u, which is weighted by mass: T_x = <m (v_x - u_x)^2>, and so for y; T_rot = <I omega^2>.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..trajectory.reader import Trajectory

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
    edges: NDArray[np.float64]
    packing_fraction: NDArray[np.float64]
    velocity: NDArray[np.float64]
    temperature: NDArray[np.float64]
    rotational_temperature: NDArray[np.float64]
    times: tuple[float, float]

    @property
    def middle(self) -> NDArray[np.float64]:
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


def _area_below(edge: float, center: NDArray[np.float64], radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area of each disk that lies below an edge [length^2], shape (n,): the integral of its chords."""
    u = np.clip((edge - center) / radius, -1.0, 1.0)
    return radius**2 * (u * np.sqrt(1.0 - u * u) + np.arcsin(u) + 0.5 * np.pi)
