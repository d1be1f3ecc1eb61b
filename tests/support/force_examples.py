"""Custom forces, and small systems to test forces."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from ifrdem.kernels.compiler.language import ti
from ifrdem.model.box import Box
from ifrdem.model.forces import Force, uniforms
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.simulation.simulation import Simulation

SMOOTH = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)


class Push(Force):
    """A constant acceleration along x."""

    parameters = ("acceleration",)

    @staticmethod
    def act(disk, step, p):  # type: ignore[no-untyped-def]
        return disk.vx + p.acceleration * step.dt, disk.vy, disk.spin


class Magnus(Force):
    """A side force on what spins and moves, dv/dt = c w (-v_y, v_x): the velocity turns at the rate c w."""

    parameters = ("c",)

    @staticmethod
    @ti.func
    def act(disk, step, p):  # type: ignore[no-untyped-def]
        c, s = ti.cos(p.c * disk.spin * step.dt), ti.sin(p.c * disk.spin * step.dt)
        return c * disk.vx - s * disk.vy, s * disk.vx + c * disk.vy, disk.spin


class Trap(Force):
    """Springs to a point: an acceleration that depends on the position and, through a factor, on time."""

    parameters = ("stiffness", "x", "y", "frequency")

    @staticmethod
    def act(disk, step, p):  # type: ignore[no-untyped-def]
        pull = p.stiffness * ti.cos(p.frequency * step.time) * step.dt
        return disk.vx - pull * (disk.x - p.x), disk.vy - pull * (disk.y - p.y), disk.spin


class Noise(Force):
    """Uniform random velocities and spins between -1 and 1, from two draws."""

    @staticmethod
    def act(disk, step, p):  # type: ignore[no-untyped-def]
        a, b = uniforms(step.random, 0), uniforms(step.random, 1)
        return 2.0 * a[0] - 1.0, 2.0 * a[1] - 1.0, 2.0 * b[0] - 1.0


class Summing(Push):
    """Says that it needs a total, and not of what."""

    totals = 1


def one_disk(
    forces: Sequence[Force], t_end: float, *, time: float = 0.0, gravity: tuple[float, float] = (0.0, 0.0)
) -> State:
    """A free disk from (20, 20) with velocity (1, 0.5) and spin 2, in a box that it does not leave.

    What it gains but for the work of gravity is what the ledger says that forces put in.
    """
    disks = Disks(1, mass=2.0, radius=0.5)
    state = State(np.array([[20.0, 20.0]]), np.array([[1.0, 0.5]]), np.array([2.0]), time=time)
    periodic = not any(gravity)  # without a floor disks would fall for ever
    box = Box((40.0, 40.0), (periodic, periodic))
    simulation = Simulation(disks, box, SMOOTH, state, forces=forces, gravity=gravity)
    simulation.run(t_end=t_end)
    end = simulation.state
    fall = disks.mass[0] * float(np.dot(gravity, end.position[0] - state.position[0]))
    gained = measure(disks, end).energy - measure(disks, state).energy - fall
    assert simulation.energy_input == pytest.approx(gained, rel=1e-12, abs=1e-12)
    return end


def still(
    n: int, *, mass: float | NDArray[np.float64] = 1.0, speed: float = 0.0, kinds: int = 1
) -> tuple[Disks, Box, State]:
    """A dilute lattice of disks, all with the same velocity along x: they do not meet while they keep it.

    Of two `kinds` the last disk is larger: such a gas has the kernels of mixtures.
    """
    disks = Disks(n, mass=mass, radius=np.where(np.arange(n) < n - kinds + 1, 1e-3, 1.5e-3))
    box = Box((float(n), float(n)))
    side = math.ceil(math.sqrt(n))
    place = (np.arange(n)[:, None] // [1, side] % side + 0.5) * n / side
    velocity = np.zeros((n, 2))
    velocity[:, 0] = speed
    return disks, box, State(place, velocity, np.zeros(n))
