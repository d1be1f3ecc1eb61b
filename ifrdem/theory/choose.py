"""Choice of the kinetic theory of a gas: one species or several, cooling, driven or sheared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..errors import InputError, nearest
from ..model.state import Disks
from ..tools.checked import Array, NonNegativeColumn, NonNegativePerDisk, Real, validated
from ..tools.reprs import Brief
from . import mixtures, sheared_gas
from .collisions import closed_law
from .contact import PackingFraction
from .driven_gas import LINEAR, Driving
from .mixtures import LawTable, Mixture, MixtureTemperatures


@dataclass(frozen=True, repr=False)
class Prediction(Brief):
    """Temperatures of a homogeneous gas over time."""

    kind: Literal["cooling", "driven", "sheared"]
    temperature: Array
    rotational_temperature: Array
    collisions_per_disk: Array
    """temperature, rotational_temperature, collisions_per_disk: of all disks [energy], [energy], [1], as
    `observables.measure` has them; shape (steps,)."""
    species: MixtureTemperatures | None = None
    """Temperatures of each species, in the order of `Mixture.of`; None in a sheared gas."""

    @property
    def theta(self) -> Array:
        """Ratio of the rotational to the translational temperature, shape (steps,)."""
        return self.rotational_temperature / self.temperature


@validated
def prediction(
    disks: Disks,
    law: LawTable,
    packing_fraction: PackingFraction,
    T0: NonNegativePerDisk,
    T_rot0: NonNegativePerDisk,
    times: NonNegativeColumn,
    *,
    forces: Iterable[Mapping[str, Any]] = (),
    shear_rate: Real = 0.0,
) -> Prediction:
    """Return the temperatures of a gas by the applicable kinetic theory.

    InputError if no theory here describes such a gas (rolling friction, a force that is not linear, a sheared
    mixture, forces in a flow), or as the theories do.

    Parameters
    ----------
    disks : Disks
        Of one species if mass, radius, k and material agree; `mixtures.MOST_SPECIES` at most.
    law : law that has averages, or sequence of sequences of them
        One for all, or a table `[material][material]`; in a sheared gas one whose e_n is a constant.
    packing_fraction, shear_rate : float
        Part of the area that the disks cover, and du_x/dy of a mean flow [1/time].
    T0, T_rot0, times : float or array_like (s,), and array_like (steps,)
        Temperatures at time 0 [energy], of all or of each species in the order of `Mixture.of`; times since the start
        [time].
    forces : iterable of mappings
        Forces as a case has them (`driven_gas.Driving.of`).

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import theory
    >>> disks = ifrdem.Disks(100, mass=1.0, radius=0.5)
    >>> law = ifrdem.coins["1 pta"].law
    >>> found = theory.prediction(disks, law, 0.25, 1.0, 0.0, [0.0, 1.0, 10.0])
    >>> found.kind, found.temperature.round(3)
    ('cooling', array([1.   , 0.671, 0.113]))
    """
    mixture, _ = Mixture.of(disks, law, packing_fraction)
    forces = list(forces)
    if shear_rate != 0.0:
        if forces or mixture.species > 1:
            what = "forces" if forces else f"{mixture.species} species"
            raise InputError(f"shear_rate = {shear_rate}: no theory of a sheared gas with {what}")
        one = (
            closed_law("law", mixture.law[0][0]),
            float(mixture.mass[0]),
            float(mixture.radius[0]),
            float(mixture.k[0]),
        )
        start = (float(np.ravel(T0)[0]), float(np.ravel(T_rot0)[0]))
        return Prediction("sheared", *sheared_gas.sheared(*one, packing_fraction, shear_rate, *start, times))
    if not forces:
        found = mixtures.mixture_cooling(mixture, T0, T_rot0, times)
        return Prediction("cooling", *found.mean(mixture), found)
    inertia = mixture.mass * mixture.radius**2 / mixture.k
    driving = [Driving.of(forces, float(m), float(i)) for m, i in zip(mixture.mass, inertia, strict=True)]
    known = [each for each in driving if each is not None]
    if len(known) < len(driving):
        given = [str(force.get("kind")) for force in forces]
        kinds = ", ".join(f"{kind}{nearest(kind, LINEAR)}" * (kind not in LINEAR) or kind for kind in given)
        raise InputError(f"forces = {kinds}: kinetic theory knows linear ones only ({', '.join(LINEAR)})")
    found = mixtures.mixture_driven(mixture, known, T0, T_rot0, times)
    return Prediction("driven", *found.mean(mixture), found)
