"""The gas that benchmarks run by default: equal, smooth, elastic disks, at equilibrium after a while."""

from __future__ import annotations

import math

from ... import theory
from ...case.case import Case
from ...case.gas import Gas

RADIUS, MASS, TEMPERATURE = 0.5, 1.0, 1.0  # reduced units: lengths are in diameters


def elastic_gas(
    n: int,
    phi: float,
    *,
    arch: str = "cpu",
    threads: int | None = None,
    precision: str = "f64",
    seed: int = 1,
) -> Case:
    """The case of n disks at packing fraction phi that starts from a hexagonal lattice, Maxwellian at T = 1."""
    run = {"name": "elastic", "seed": seed, "units": "reduced", "arch": arch, "precision": precision}
    if threads is not None:
        run["threads"] = threads
    disk = {"mass": MASS, "radius": RADIUS, "speed_rms": math.sqrt(2.0 * TEMPERATURE / MASS)}
    return Case.model_validate(
        {
            # The end is the benchmark's; a case needs one.
            "run": {**run, "collisions_per_disk": 1.0},
            "box": {"packing_fraction": phi},
            "material": [{"name": "elastic", "e_n": 1.0, "e_t": -1.0, "mu": 0.0}],
            "species": [{"name": "disks", "number": n, "material": "elastic", **disk}],
            "start": {"positions": "hexagonal"},
            "output": {"ledger": False},  # the engine alone; `output_cost.py` times output
        }
    )


def mean_free_time(gas: Gas) -> float:
    """Time between two collisions of a disk at equilibrium [time], by theory (25 % too long in the solid)."""
    phi = gas.box.packing_fraction(gas.disks.radius)
    return 1.0 / theory.collision_rate(phi, TEMPERATURE, MASS, RADIUS)


def mixing_time(gas: Gas) -> float:
    """Time [time] after which the lattice and its too few collisions are forgotten, with room to spare.

    Seen with 10,000 disks: the collision rate is within 1 % of its last value from 3 mean free times on at phi = 0.1
    and 0.3, from 6 on at 0.7, and from 15 on at 0.6, where the lattice melts slowly. Very large gases, whose
    equilibration takes minutes, get less of the room to spare.
    """
    n, phi = gas.disks.n, gas.box.packing_fraction(gas.disks.radius)
    times = 15.0 if phi > 0.5 else 10.0 if n <= 2_000_000 else 5.0
    return times * mean_free_time(gas)
