"""Choice of the kinetic theory of a gas: one species or several, cooling, driven or sheared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, nearest
from ..model.state import Disks
from ..tools.checked import Array, NonNegativeColumn, NonNegativePerDisk, Positive, Real, validated
from ..tools.reprs import Brief
from . import mixtures, sheared_gas
from .collisions import KineticLaw, checked_law, closed_law, slip_coefficients
from .contact import PackingFraction
from .driven_gas import LINEAR, Driving
from .mixtures import LawTable, Mixture, MixtureTemperatures
from .rough_gas import rough_cooling


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
    velocities: Literal["gaussian", "sonine", "dsmc"] = "gaussian"
    """Velocities that the theory takes: Gaussian, with cumulants (`rough_cooling`), or those of a DSMC gas."""
    stress: tuple[Array, Array] | None = None
    """Kinetic and collisional pressure tensor of a sheared DSMC gas [energy/length^2], shape (steps, 2, 2) each, the second
    a mean since the time before, nan at first; None of others."""

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
    velocities: Literal["gaussian", "sonine", "best"] = "gaussian",
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
    velocities : str
        Gaussian ones, those of Sonine's expansion to first order (equal rough disks that cool, with constant e_n and
        beta: `constant_beta`), or "best": these where they are known.

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
    driven = bool(forces) or shear_rate != 0.0
    beta = beta_of_cooling(mixture, T0, driven=driven)
    if velocities == "sonine" and beta is None:
        text = 'must be "gaussian" or "best" but for equal rough disks that cool without forces, with constant e_n and beta'
        raise InputError(f'velocities = "sonine": {text}')
    if velocities != "gaussian" and beta is not None:
        return _by_sonine(mixture, beta, float(np.ravel(T0)[0]), float(np.ravel(T_rot0)[0]), times)
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


PREDICT: ContextVar[Callable[..., Prediction]] = ContextVar("predict", default=prediction)
"""Function that predicts the temperatures drawn in figures and analyses: `prediction`, or one with its signature."""


def is_closed() -> bool:
    """True unless `PREDICT` is another theory than `prediction`."""
    return PREDICT.get() is prediction


STICKS = 100.0
"""kappa = mu (1 + e_n) / (c sqrt(S)) from which every collision counts as sticking: 1 / (2 kappa^2) of them slide."""
HOTTEST_SPINS = 10.0
"""theta up to which that must hold."""


@validated
def constant_beta(law: KineticLaw, k: Positive) -> float | None:
    """Ratio of the slip at the contact of equal disks after and before, with its sign changed; None if it varies.

    It is constant if e_n is and every collision sticks, with a mu above some 100, or none has friction (`law = "rough"`
    of cases). Smooth disks have no constant one here.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> law = IFRLaw(e_n=0.9, e_t=-0.5, mu=1e6, sticking="contact_point")
    >>> theory.constant_beta(law, 2.0)
    0.5
    >>> theory.constant_beta(IFRLaw(e_n=0.9, e_t=-0.5, mu=0.2, sticking="contact_point"), 2.0) is None
    True
    """
    inverse_a = 1.0 / (1.0 + k)
    h, c = (float(each) for each in slip_coefficients(law, inverse_a))
    if law.mu == 0.0:
        if h == 0.0:
            return None
        c = 0.0
    if c * math.sqrt(1.0 + k * HOTTEST_SPINS) * STICKS > law.mu * (1.0 + law.e_n):
        return None
    beta = (h + c) / inverse_a - 1.0
    return round(beta, 12) if abs(beta) <= 1.0 else None


def beta_of_cooling(mixture: Mixture, T0: ArrayLike, *, driven: bool) -> float | None:
    """`constant_beta` of a gas of which the expansion is known, with the temperatures T0; None of others."""
    if driven or mixture.species > 1 or not np.all(np.asarray(T0) > 0.0):
        return None
    law = checked_law("law", mixture.law[0][0])
    return None if law.depends_on_speed else constant_beta(law, float(mixture.k[0]))


def _by_sonine(
    mixture: Mixture, beta: float, T0: float, T_rot0: float, times: NonNegativeColumn
) -> Prediction:
    """Cooling of the only species of a mixture with the cumulants of its velocities."""
    law = closed_law("law", mixture.law[0][0])
    mass, radius, k = (float(each[0]) for each in (mixture.mass, mixture.radius, mixture.k))
    found = rough_cooling(law.e_n, beta, mass, radius, k, mixture.packing_fraction, T0, T_rot0, times)
    species = MixtureTemperatures(*(each[:, None] for each in found[:3]))
    return Prediction("cooling", *found[:3], species, "sonine")
