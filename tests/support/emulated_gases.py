"""Gases on a CUDA device and on the CPU: `python emulated_gases.py` prints how they differ, as JSON.

All have the same features, so that kernels are compiled once. Run under the emulator (`emulator/emulate`).
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from ifrdem.initial import placement
from ifrdem.model.box import Box
from ifrdem.model.device import Device
from ifrdem.model.forces import Drag, PoissonKicks, RandomKicks
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.steps.schedule import RunPoint
from ifrdem.validation import rows

COIN = (0.87, -0.88, 0.21, 0.0, 0.0)
COMPARED = ("time", "position", "velocity", "spin", "collisions", "wall_collisions", "image")
WINDOW = 0.4  # collisions of a disk in a window


class Gas(NamedTuple):
    """Some n coins at a packing fraction of 0.25, the disks of a tile, and where the gas is looked at."""

    n: int
    tile_disks: int
    points: Sequence[RunPoint]


GASES = {
    # Tiles of which several make the gas, each with a halo that takes most of the box.
    "small tiles": Gas(500, 80, [RunPoint(collisions=600)]),
    # A tile and its halo have more disks than a block has room for.
    "dense tiles": Gas(1100, 550, [RunPoint(collisions=700)]),
    # Several numbers of collisions and several times in each window.
    "moments": Gas(
        400,
        80,
        [*(RunPoint(collisions=20 * i) for i in range(1, 26)), *(RunPoint(0.05 * i) for i in range(1, 12))],
    ),
}


def engine_of(gas: Gas, device: Literal["cpu", "cuda"], **options: Any) -> Engine:
    """The engine of a gas at its start: between a floor and a lid, around a post, under gravity, with forces."""
    radius = np.full(gas.n, 0.5)
    box = Box(Box.from_packing_fraction(radius, 0.25).lengths, periodic=(True, False))
    position = placement.random_positions(box, radius, seed=1)
    middle = np.array(box.lengths) / 2.0
    free = np.linalg.norm(position - middle, axis=1) > 2.5
    free &= np.abs(position[:, 1] - middle[1]) < middle[1] - 0.5
    disks = Disks(int(free.sum()), mass=1.0, radius=0.5)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=2)
    state = State(position[free], velocity, placement.gaussian_spins(disks.n, spin_rms=1.0, seed=3))
    return rows.engine_of(
        disks,
        box,
        state,
        np.array([[COIN]]),
        device=Device(device, window_collisions=WINDOW),
        walls=[Wall.post((middle[0], middle[1]), 2.0)],
        gravity=(0.0, -0.1),
        # Two in the same steps, and one at random times.
        forces=[Drag(0.08, rate=0.1), RandomKicks(0.08, power=0.2), PoissonKicks(1.0, power=0.1)],
        record=["free_times", "heat_flux"],
        regions={"left": (0.0, 0.0, middle[0], box.lengths[1])},
        **options,
    )


def looked_at(engine: Engine, points: Sequence[RunPoint]) -> list[tuple[State, Any, Any, Any, Any, Any, Any]]:
    """States, dissipated energies, gains by forces, histograms, transferred energy, regions, at points of a run in the order in which it comes to them."""
    due, found = list(points), []
    while due:
        stop = functools.reduce(RunPoint.earlier, due)
        engine.advance(t_end=stop.time, collisions=stop.collisions, next_points=functools.partial(list, due))
        if stop.reached(engine.time, engine.collisions):
            given = engine.force_steps.energy_inputs.copy()
            found.append(
                (
                    engine.state(),
                    *engine.dissipated(),
                    given,
                    engine.histograms,
                    engine.energy_transfer,
                    engine.region_totals(),
                )
            )
        due = [each for each in due if not each.reached(engine.time, engine.collisions)]
    return found


def bits_that_differ(one: State, other: State) -> list[str]:
    """Names of what differs in any bit between two states."""
    return [name for name in COMPARED if not np.array_equal(getattr(one, name), getattr(other, name))]


def main() -> None:
    found, report = {}, {}
    for name, gas in GASES.items():  # a runtime has one device at a time
        engine = engine_of(gas, "cuda", order="tiled", tile_disks=gas.tile_disks)
        found[name] = looked_at(engine, gas.points)
        arrays = engine.arrays
        report[name] = {
            "blockwise": arrays.blockwise,
            "dense": int(arrays.counter.n_dense),
            "windows": engine.statistics.windows,
        }
    for name, gas in GASES.items():
        on_cpu = looked_at(engine_of(gas, "cpu", order="serial"), gas.points)
        pairs = list(zip(found[name], on_cpu, strict=True))
        report[name] |= {
            "points": len(pairs),
            "collisions": int(on_cpu[-1][0].collisions.sum()) // 2,
            "wall collisions": int(on_cpu[-1][0].wall_collisions.sum()),
            "differing": sorted({each for (a, *_), (b, *_) in pairs for each in bits_that_differ(a, b)}),
            "regimes": all(np.array_equal(a[2], b[2]) for a, b in pairs),
            "energy inputs": all(np.array_equal(a[3], b[3]) for a, b in pairs),
            "least energy input": float(np.abs(on_cpu[-1][3]).min()),
            "histograms": all(np.array_equal(a[4], b[4]) for a, b in pairs),
            "counts": int(on_cpu[-1][4].sum()),
            "regions": all(
                np.allclose(a[6], b[6], rtol=1e-12) and a[6][0, 0] == b[6][0, 0] for a, b in pairs
            ),
            "disks in the region": int(on_cpu[-1][6][0, 0]),
            "energy transfer": all(np.allclose(a[5], b[5], rtol=1e-10, atol=1e-10) for a, b in pairs),
            "largest energy transfer": float(np.abs(on_cpu[-1][5]).max()),
            # Sums of some hundred terms in another order.
            "losses": all(np.allclose(a[1], b[1], rtol=1e-11, atol=1e-12) for a, b in pairs),
        }
    print(json.dumps(report))


if __name__ == "__main__":
    main()
