"""A GPU against the CPU: the same gas from the same start, in windows of the same length.

All that both compute by +, -, *, / and roots agrees to the last bit (`kernels/compiler/compiler_fixes.py` says how):
the state after many collisions is the same, whatever the tiles. So are normal random numbers (`kernels/random.py`).
Other sines, cosines and logarithms are those of another library: walls that swing and thermal walls give other last
bits, which collisions enlarge some tenfold each. Such gases are compared after two collisions of a disk. In single
precision, divisions and roots of a GPU are approximate too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from ...initial import placement
from ...model.box import Box
from ...model.device import Device
from ...model.forces import Drag, Langevin, PoissonKicks, RandomKicks, Rescale
from ...model.laws.coin_table import coins
from ...model.laws.ifr import IFRLaw
from ...model.overlaps import close_pairs
from ...model.state import Disks, State
from ...model.walls.motion import Motion
from ...model.walls.wall import Wall
from ...simulation import backend
from ...simulation.engine import Engine
from ..report.registry import Result, Skip
from ..rows import engine_of

QUESTION = "Does a GPU give the bits of the CPU, the same again, and keep energy, momentum and gaps?"
REFERENCE = "the same engine on the CPU, and conservation laws"

SEEN = ("position", "velocity", "spin", "image", "collisions", "wall_collisions")
WINDOW = 0.4  # collisions of a disk in a window, on both devices
COIN = coins["1 pta"].law.table_row()
ROLLING = IFRLaw(e_n=0.9, e_t=-0.7, mu=0.2, rho=0.01).table_row()
CLUSTERS, LONGER = "clusters", 6  # the gas that is followed so much longer than others
# Disks of a tile: also more than most blocks of threads have room for (`kernels/windows/blocks.py`).
TILES = (30, 250, 900)
BITS = "the same engine on the CPU"
Gas = tuple[Disks, Box, State, tuple[float, ...], dict[str, Any]]


def _gas(n: int, packing_fraction: float, law: tuple[float, ...], radius: Any = 0.5) -> Gas:
    disks = Disks(n, mass=np.ones(n), radius=np.broadcast_to(radius, n))
    box = Box.from_packing_fraction(disks.radius, packing_fraction)
    position = placement.random_positions(box, disks.radius, seed=1)
    rng = np.random.default_rng(2)
    velocity = rng.normal(size=(n, 2))
    return disks, box, State(position, velocity - velocity.mean(axis=0), rng.normal(size=n)), law, {}


def thin(n: int) -> Gas:
    """Coins at a packing fraction of 0.1."""
    return _gas(n, 0.1, COIN)


def clusters(n: int) -> Gas:
    """Smooth disks that lose so much energy that they gather in clusters."""
    return _gas(n, 0.3, IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0).table_row())


def sheared(n: int) -> Gas:
    """Coins in a sheared box. Its tiles have frames of their own, so that bits depend on tiles."""
    disks, box, state, law, more = _gas(n, 0.3, COIN)
    return disks, Box(box.lengths, (True, True), shear_rate=0.1), state, law, more


def walled(n: int) -> Gas:
    """Between walls at rest, under gravity, around a post."""
    _, box, state, law, _ = _gas(n, 0.2, COIN)
    middle = np.array(box.lengths) / 2.0
    free = np.linalg.norm(state.position - middle, axis=1) > 4.0
    free &= (np.abs(state.position - middle) < middle - 1.0).all(axis=1)
    state = State(state.position[free], state.velocity[free], state.spin[free])
    walls = [Wall.post((middle[0], middle[1]), 3.0)]
    box = Box(box.lengths, (False, False))
    disks = Disks(state.n, mass=np.ones(state.n), radius=np.full(state.n, 0.5))
    return disks, box, state, law, {"walls": walls, "gravity": (0.0, -0.05)}


def driven(n: int) -> Gas:
    """Coins with forces that act within windows: two in the same steps, one in others, and one at random times."""
    forces = [
        Drag(0.04, rate=0.1, quadratic=0.01),
        RandomKicks(0.04, power=0.2),
        Langevin(0.11, temperature=0.5, spin_rate=0.3),
        PoissonKicks(2.0, power=0.1),
    ]
    return (*_gas(n, 0.3, COIN)[:4], {"forces": forces})


def shaken(n: int) -> Gas:
    """A walled gas on an oscillating floor, below a hot wall."""
    disks, box, state, law, more = walled(n)
    floor = Wall.line((0.0, 0.2), (0.0, 1.0), motion=Motion("sine", amplitude=0.2, frequency=0.5))
    hot = Wall.line((0.0, box.lengths[1] - 0.1), (0.0, -1.0), temperature=2.0)
    return disks, box, state, law, more | {"walls": [*more["walls"], floor, hot]}


EXACT: dict[str, Callable[[int], Gas]] = {
    "coins at 0.1": thin,
    "rolling friction at 0.5": lambda n: _gas(n, 0.5, ROLLING),
    "two sizes": lambda n: _gas(n, 0.4, COIN, np.where(np.arange(n) % 2, 0.5, 0.75)),
    "walls and gravity": walled,
    CLUSTERS: clusters,
    "driven": driven,
    # Their energy is set, from a sum over all of them.
    "rescaled": lambda n: (*_gas(n, 0.3, COIN)[:4], {"forces": [Rescale(0.05, energy=1.0)]}),
}


def after(gas: Gas, per_disk: float, device: Literal["cpu", "cuda"], **options: Any) -> Engine:
    """The engine of a gas, when its disks have had so many collisions."""
    disks, box, state, law, more = gas
    engine = engine_of(
        disks,
        box,
        state,
        np.array([[law]]),
        device=Device(device, window_collisions=WINDOW),
        record=["ledger"],
        **more,
        **options,
    )
    wanted = int(per_disk * disks.n / 2)
    while engine.collisions < wanted:
        engine.advance(collisions=wanted)
    return engine


def differing(one: State, other: State) -> int:
    """Number of the numbers of two states that differ in any bit."""
    return sum(int(np.count_nonzero(getattr(one, name) != getattr(other, name))) for name in SEEN)


def run(quick: bool, device: Literal["cpu", "cuda"] = "cuda") -> Result:
    """Compare this device with the CPU; without a GPU the case is skipped."""
    absence = backend.cuda_absence() if device == "cuda" else None
    if absence is not None:
        raise Skip(f"no GPU: {absence}")
    n, most = (2_000, 6.0) if quick else (20_000, 10.0)
    result = Result()
    for name, make in EXACT.items():
        gas, per_disk = make(n), most * (LONGER if name == CLUSTERS else 1)
        engine = after(gas, per_disk, device)
        state = engine.state()
        what = f"numbers that differ after {per_disk:g} collisions of each of {engine.n} disks, {name}"
        result.near(
            f"{what}, run twice", differing(state, after(gas, per_disk, device).state()), 0, 0.0, "bits", BITS
        )
        for tile in TILES:
            other = after(gas, per_disk, device, order="tiled", tile_disks=tile).state()
            result.near(f"{what}, tiles of {tile}", differing(state, other), 0, 0.0, "bits", BITS)
        if "forces" not in gas[-1]:
            _keeps(result, name, gas, engine)
        # Taichi runs on one device at a time: the engine ends with the next line
        cpu = after(gas, per_disk, "cpu").state()
        result.near(f"{what}, CPU", differing(state, cpu), 0, 0.0, "bits", BITS)
    ends = [after(sheared(n), most, each, order="tiled", tile_disks=250).state() for each in (device, "cpu")]
    what = f"numbers that differ after {most:g} collisions of each of {n} disks, sheared, tiles of 250, CPU"
    result.near(what, differing(*ends), 0, 0.0, "bits", BITS)
    gas = shaken(n)
    states = [after(gas, 2.0, each).state() for each in (device, "cpu")]
    reason = "last bits of sines, grown tenfold by each collision of a disk, of which some had ten"
    result.all_near(
        "positions on a floor that swings [diameters]",
        states[0].position,
        states[1].position,
        1e-4,
        reason,
        BITS,
    )
    return result


def _keeps(result: Result, name: str, gas: Gas, engine: Engine) -> None:
    """Rows of what collisions keep: the energy with what the ledger holds, momentum, gaps."""
    disks, box, first, _law, more = gas
    last = engine.state()

    def energy(state: State) -> float:
        kinetic = 0.5 * np.sum(state.velocity**2) + 0.5 * np.sum(disks.radius**2 / disks.k * state.spin**2)
        return float(kinetic) - float(np.sum(state.position @ np.array(more.get("gravity", (0.0, 0.0)))))

    lost = engine.dissipated()[0].sum()
    result.near(
        f"energy that the ledger does not know, of the first one, {name}",
        (energy(last) + lost) / energy(first), 1.0, 1e-11, "rounding of some 1e5 sums", "conservation",
    )  # fmt: skip
    if not more:
        momentum = np.abs(last.velocity.sum(axis=0)).max() / disks.n
        result.near(f"mean momentum, {name}", momentum, 0.0, 1e-13, "rounding", "conservation")
    i, j = close_pairs(box, disks.radius, box.wrap(last.position), 0.1).T
    gap = (
        np.linalg.norm(box.minimum_image(last.position[j] - last.position[i]), axis=1)
        - disks.radius[i]
        - disks.radius[j]
    )
    result.at_least(
        f"least gap between two disks [diameters], {name}",
        gap.min(),
        -1e-12,
        "rounding of places in a box",
        "hard disks",
    )
