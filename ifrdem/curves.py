"""The curves of kinetic theory that belong beside a trajectory, or why there are none."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import driven_theory, shear_theory, theory
from .driven_theory import Drive
from .law import IFRLaw
from .trajectory import Trajectory

Curves = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Times, and T and T_rot [energy] at them."""


@dataclass(frozen=True)
class _Equal:
    """What kinetic theory needs to know of a trajectory of equal disks."""

    law: IFRLaw
    mass: float
    radius: float
    k: float
    phi: float
    T0: float
    T_rot0: float


def _equal_disks(trajectory: Trajectory) -> _Equal | str:
    """The gas of a trajectory as kinetic theory takes it, or why it does not hold."""
    if trajectory.room.all_walls:
        return "walls: no kinetic theory here"
    if trajectory.parameters.get("collapse", "none") != "none":
        return "elastic exceptions against collapse: no kinetic theory here"
    disks = trajectory.disks
    if trajectory.box.is_open:
        return "open box: no kinetic theory here"
    columns = (disks.mass, disks.radius, disks.k, disks.material)
    if any(np.ptp(column) != 0 for column in columns):
        return "several kinds of disks: no kinetic theory here"
    if "laws" not in trajectory.parameters:
        return "no law in the file: no kinetic theory here"
    material = int(disks.material[0])
    row: dict[str, Any] = json.loads(str(trajectory.parameters["laws"]))[material][material]
    mass, radius, k = (float(column[0]) for column in (disks.mass, disks.radius, disks.k))
    T0 = float(trajectory.observables["temperature"][0])
    T_rot0 = float(trajectory.observables["rotational_temperature"][0])
    law = IFRLaw(**row, k=k)
    if law.rho > 0.0:
        return "rolling friction: no kinetic theory here"
    return _Equal(law, mass, radius, k, trajectory.box.packing_fraction(disks.radius), T0, T_rot0)


def cooling(trajectory: Trajectory) -> tuple[Curves | None, str]:
    """Times, T and T_rot by kinetic theory, and what to say of it; None where it does not hold."""
    gas, times = _equal_disks(trajectory), trajectory.times
    if isinstance(gas, str):
        return None, gas
    if gas.T0 == 0.0 or times[-1] <= times[0]:
        return None, "nothing moves: no kinetic theory here"
    elapsed = times[times > times[0]] - times[0]
    # Of a single frame, a decade before it shows where it comes from.
    when = np.geomspace(elapsed[0] if len(elapsed) > 1 else 0.1 * elapsed[0], elapsed[-1], 300)
    T, T_rot, _ = theory.cooling(gas.law, gas.mass, gas.radius, gas.k, gas.phi, gas.T0, gas.T_rot0, when)
    return (when + times[0], T, T_rot), "kinetic theory (homogeneous gas)"


def driven(trajectory: Trajectory) -> tuple[Curves | None, tuple[float, float] | None, str]:
    """Times, T and T_rot by kinetic theory, the steady state, and what to say; None where it does not hold."""
    gas, times = _equal_disks(trajectory), trajectory.times
    if isinstance(gas, str):
        return None, None, gas
    forces = json.loads(str(trajectory.parameters.get("forces", "[]")))
    drive = Drive.of(forces, gas.mass, gas.mass * gas.radius**2 / gas.k)
    if drive is None:
        return None, None, "a force that is not linear: no kinetic theory here"
    if (gas.T0 == 0.0 and drive.power == 0.0) or times[-1] <= times[0]:
        return None, None, "nothing moves: no kinetic theory here"
    one = (gas.law, gas.mass, gas.radius, gas.k, gas.phi, drive)
    when = np.linspace(0.0, times[-1] - times[0], 400)
    T, T_rot, _ = driven_theory.driven(*one, gas.T0, gas.T_rot0, when)
    T = np.where(T > 0.0, T, np.nan)
    steady = driven_theory.steady_state(*one)
    return (when + times[0], T, T_rot), steady, "kinetic theory (homogeneous gas)"


def sheared(trajectory: Trajectory) -> tuple[Curves | None, tuple[float, float] | None, str]:
    """Times, T and T_rot by kinetic theory, the steady state, and what to say; None where it does not hold."""
    gas, times = _equal_disks(trajectory), trajectory.times
    if isinstance(gas, str):
        return None, None, gas
    if json.loads(str(trajectory.parameters.get("forces", "[]"))):
        return None, None, "forces in a flow: no kinetic theory here"
    one = (gas.law, gas.mass, gas.radius, gas.k, gas.phi, trajectory.box.shear_rate)
    steady = shear_theory.steady_state(*one)
    if gas.T0 == 0.0 or times[-1] <= times[0]:
        return None, steady, "nothing moves at first: no curve of kinetic theory here"
    when = np.linspace(0.0, times[-1] - times[0], 400)
    T, T_rot, _ = shear_theory.sheared(*one, gas.T0, gas.T_rot0, when)
    return (when + times[0], T, T_rot), steady, "kinetic theory (homogeneous flow)"
