"""Small gases for the tests of the engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ifrdem.initial import placement
from ifrdem.laws import IFRLaw
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.simulation.engine import CollisionTimes, Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of

MakeGas = Callable[..., Simulation]
"""Type of the fixture `gas`."""
ELASTIC = (1.0, -1.0, 0.0, 0.0, 0.0)  # smooth elastic disks: e_n = 1, e_t = -1, mu = 0
COIN = (0.87, -0.88, 0.21, 0.0, 0.0)  # 1 pta coins of the paper's Table II, percussion-centre sticking
ROUGH = IFRLaw(e_n=0.9, e_t=-0.5, mu=0.2)
ROLLING = (0.9, -0.9, 0.15, 1.0, 0.02)  # contact-point sticking and rolling friction: every branch of the law


def equal_disks(n: int) -> Disks:
    """n disks of mass 1 and diameter 1."""
    return Disks(n, mass=1.0, radius=0.5)


def mixture(n: int) -> Disks:
    """Alternating big homogeneous disks and small light hoops."""
    big = np.arange(n) % 2 == 0
    return Disks(n, mass=np.where(big, 1.0, 0.2), radius=np.where(big, 0.5, 0.3), k=np.where(big, 2.0, 1.0))


def start(disks: Disks, packing_fraction: float, seed: int = 1) -> tuple[Box, State]:
    """A hexagonal lattice with Maxwellian velocities at temperature 1 and random spins."""
    box = Box.from_packing_fraction(disks.radius, packing_fraction)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=seed)
    position = placement.hexagonal_positions(box, disks.radius, seed=seed)
    return box, State(position, velocity, placement.gaussian_spins(disks.n, spin_rms=1.0, seed=seed))


def gas_of(
    disks: Disks | int = 100,
    packing_fraction: float = 0.3,
    law: Any = ROUGH,
    box: Box | None = None,
    **options: Any,
) -> Simulation:
    """The simulation of a gas, or of a number of equal disks, that begins as `start` says, or so but in another box."""
    disks = equal_disks(disks) if isinstance(disks, int) else disks
    filled, state = start(disks, packing_fraction)
    return Simulation(disks, box or filled, law, state, **options)


def boxed(
    box: Box, position: Any, velocity: Any, law: Any, *, mass: float = 1.0, **options: Any
) -> Simulation:
    """The simulation of disks of radius 1/2 without spin, at rest if no velocity is given."""
    n = len(position)
    state = State(position, np.zeros((n, 2)) if velocity is None else velocity, np.zeros(n))
    return Simulation(Disks(n, mass=mass, radius=0.5), box, law, state, **options)


def sheared(disks: Disks, packing_fraction: float, rate: float) -> tuple[Box, State]:
    """Like `start`, around the flow of a sheared box."""
    box, state = start(disks, packing_fraction)
    box = Box(box.lengths, shear_rate=rate)
    return box, State(state.position, state.velocity + box.flow(state.position), state.spin)


def equilibrated(disks: Disks, packing_fraction: float, seed: int = 1) -> tuple[Box, State]:
    """Like `start`, but after 20 elastic collisions per disk have mixed it; clock and counts at zero."""
    box, state = start(disks, packing_fraction, seed)
    mixed = run_to(engine_of(disks, box, state, np.array([[ELASTIC]])), collisions=10 * disks.n)
    return box, State(mixed.position, mixed.velocity, mixed.spin)


def touching(box: Box, radius: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Every disk moved to touch the nearest one: by less than any other is away, so that none overlaps."""
    for i in range(len(radius)):
        apart = box.minimum_image(position - position[i])
        distance = np.hypot(*apart.T)
        gap = np.where(distance > 0.0, distance - radius - radius[i], np.inf)
        j = int(np.argmin(gap))
        position[i] += apart[j] / distance[j] * gap[j] * (1.0 - 1e-9)
    return box.wrap(position)


def run_to(engine: Engine, t_end: float = np.inf, *, collisions: int | None = None) -> State:
    """The state at `t_end`, or after as many collisions in all."""
    if collisions is None:
        while engine.time < t_end:
            engine.advance(t_end=t_end)
    else:
        while engine.collisions < collisions:
            engine.advance(collisions=collisions)
    return engine.state()


def run(engine: Engine, count: int) -> CollisionTimes:
    """Exactly `count` further collisions, in order."""
    engine.keep_collisions = True
    target = engine.collisions + count
    parts = []
    while engine.collisions < target:
        engine.advance(collisions=target)
        assert engine.last_collisions is not None
        parts.append(engine.last_collisions)
    return CollisionTimes(np.concatenate([p.time for p in parts]), np.concatenate([p.pair for p in parts]))


def partners(pair: np.ndarray) -> np.ndarray:
    """Partners of each disk in the order of its collisions: rows (disk, partner) by disk.

    Collisions of others at next to the same time may change places by rounding, which changes no history.
    """
    both = np.stack([pair, pair[:, ::-1]], axis=1).reshape(-1, 2)
    found: np.ndarray = both[np.argsort(both[:, 0], kind="stable")]
    return found
