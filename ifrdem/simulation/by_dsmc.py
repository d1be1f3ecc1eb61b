"""Temperatures of a homogeneous gas by DSMC of its own law, in place of kinetic theory."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.state import Disks, kinds_of
from ..theory.choose import PREDICT, Prediction, prediction
from ..theory.contact import PackingFraction
from ..theory.driven_gas import Driving
from ..theory.mixtures import LawTable, MixtureTemperatures
from ..tools.checked import NonNegativeColumn, Real
from .dsmc import DSMC

LEAST_DISKS = 8000
"""Disks of the DSMC gas at least: T of it is then known to a percent."""


def dsmc_prediction(
    disks: Disks,
    law: LawTable,
    packing_fraction: PackingFraction,
    T0: ArrayLike,
    T_rot0: ArrayLike,
    times: NonNegativeColumn,
    *,
    forces: Iterable[Mapping[str, Any]] = (),
    shear_rate: Real = 0.0,
    velocities: Literal["gaussian", "sonine", "best"] = "best",
    seed: int = 0,
) -> Prediction:
    """Temperatures of a gas as `theory.prediction` gives them, by `DSMC` of as many copies of its disks as needed.

    It takes rolling friction and laws without averages, too; `velocities` are those that the law makes. InputError
    for forces that are not linear, if nothing moves, or as `DSMC`.
    """
    which, forces = kinds_of(disks), list(forces)
    first = np.unique(which, return_index=True)[1]
    mass, inertia, s = disks.mass[first], disks.inertia[first], len(first)
    driving = [Driving.of(forces, float(m), float(i)) for m, i in zip(mass, inertia, strict=True)]
    known = [each for each in driving if each is not None]
    if len(known) < s:
        raise InputError("forces: DSMC knows linear ones only")
    T, T_rot = (np.broadcast_to(np.asarray(each, dtype=np.float64), (s,)) for each in (T0, T_rot0))
    copies = math.ceil(LEAST_DISKS / disks.n)
    kind = np.tile(which, copies)
    columns: dict[str, Any] = {
        name: np.tile(getattr(disks, name), copies) for name in ("mass", "radius", "k", "material")
    }
    many = Disks(len(kind), **columns)
    rng = np.random.default_rng(seed)
    velocity, spin = rng.normal(size=(many.n, 2)), rng.normal(size=many.n)
    velocity -= many.mass @ velocity / many.mass.sum()
    for each in range(s):  # exactly the given temperatures
        own = kind == each
        v2, w2 = np.mean(np.sum(velocity[own] ** 2, axis=1)), np.mean(spin[own] ** 2)
        velocity[own] *= math.sqrt(2.0 * T[each] / mass[each] / v2)
        spin[own] *= math.sqrt(T_rot[each] / inertia[each] / w2)
    if not velocity.any():
        raise InputError("T0 = 0: nothing moves at first: not by DSMC")
    laws: Any = law  # a table without gaps, which DSMC refuses
    when = np.asarray(times, dtype=np.float64)
    gas = DSMC(
        many, laws, packing_fraction, velocity, spin, seed=seed, species=kind,
        driving=known if forces else None, shear_rate=shear_rate,
    )  # fmt: skip
    found = gas.run(t_end=float(when[-1]) if len(when) else 0.0, samples=when)
    gas.release()
    of = MixtureTemperatures(
        found.temperature_of[1:], found.rotational_temperature_of[1:], found.collisions_per_disk_of[1:]
    )
    name: Literal["cooling", "driven", "sheared"] = (
        "sheared" if shear_rate else "driven" if forces else "cooling"
    )
    whole = found.temperature[1:], found.rotational_temperature[1:], found.collisions_per_disk[1:]
    if not shear_rate:
        return Prediction(name, *whole, of, "dsmc")
    stress = found.kinetic_stress[1:], found.collisional_stress[1:]
    return Prediction(name, *whole, None, "dsmc", stress)


@contextlib.contextmanager
def theory_by(*, dsmc: bool) -> Iterator[None]:
    """Make figures and analyses take DSMC as their theory, or the closed forms."""
    token = PREDICT.set(dsmc_prediction if dsmc else prediction)
    try:
        yield
    finally:
        PREDICT.reset(token)
