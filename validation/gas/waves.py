r"""The share of waves of velocity in the temperature of a cooling gas, and how well that can be known.

A theory of homogeneous gases has thermal velocities only. A gas has waves, which its noise feeds and which lose energy
by viscosity, not by collisions. With z the part of T that a collision of a disk takes, nu the collision rate,
q = k^2 xi^2 (`ifrdem.theory.hydrodynamics`) and S the energy of a wave in units of its thermal share:

*Transverse waves.* dS/dtau = z S - z q (S - 1): S - 1 = [exp(z tau (1 - q)) - 1] / (1 - q); T. P. C. van Noije, M. H.
Ernst, R. Brito and J. A. G. Orza, Phys. Rev. Lett. 79, 411 (1997), doi:10.1103/PhysRevLett.79.411.

*Longitudinal waves* are sound. As the gas cools their frequency falls like sqrt(T), and energy over frequency is kept:
on thermal velocities they gain z / 2. They decay at [eta / (n m) + (c_p / c_v - 1) kappa / (n c_p)] k^2, in a dilute
gas of smooth disks (c_p / c_v = 2, c_p = 2, kappa = 4 eta / m) at 3 eta k^2 / (n m), 3/2 of the rate of transverse
ones: dS/dtau = (z/2) S - (3/2) z q (S - 1), which is the same with z/2 for z and 3 q for q.

*Energy.* With the share s = (1/2N) sum (S - 1) over all waves, the energy is N T_th (1 + s). Collisions know thermal
velocities only, and take z T_th: d ln T / dtau = -z / (1 + s). So

    T = T_0 exp(-z tau) F,  F = exp(z int s / (1 + s) dtau).

That the mean energy of a cooling gas is not that of the homogeneous one because of waves: J. J. Brey and M. J.
Ruiz-Montero, arXiv:cond-mat/0701249.

*What cannot be known.* Short waves count as well, their sum going like ln(k): up to where hydrodynamics ends. Waves
up to 1 / (2 l) count here, l being the mean free path; what those up to 1 / l would add is how far s and F may be off.
It does not depend on the box: it is of the order 1 / (4 pi n xi^2), proportional to density and losses, and measures
how far the gas is from molecular chaos. Nothing here is fitted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ... import theory
from ...model.laws.ifr import IFRLaw
from ...theory.cooling_gas import changes_per_collision
from ...theory.hydrodynamics import excess, waves
from ...tools.checked import Array

PATHS = 2.0
"""Wave numbers up to 1 / (2 mean free paths) count as hydrodynamic."""
MOST_SHARE = 0.08
"""Largest share of T in waves at which a gas is compared with theories: beyond, they are no small correction."""


class Streams(NamedTuple):
    """Waves at several times: their share s of T_th, and the factor F of T; and how far each may be off."""

    share: Array
    share_error: Array
    factor: Array
    factor_error: Array

    @property
    def theta(self) -> Array:
        """Factor of T_rot / T: between 1 / (1 + s) or 1 / F, where spins follow T_th or nothing, and 1, where T."""
        return 0.5 / np.maximum(1.0 + self.share, self.factor) + 0.5

    @property
    def theta_error(self) -> Array:
        """Its uncertainty: half the difference, and what is uncertain of the share."""
        return np.asarray(1.0 - self.theta + np.maximum(self.share_error, self.factor_error))


def streams(
    collisions_per_disk: ArrayLike, law: IFRLaw, packing_fraction: float, n: int, *, theta: float = 0.0
) -> Streams:
    """Waves in a square box of n disks of diameter 1, homogeneous at 0, after `collisions_per_disk` (steps,).

    `theta` is T_rot / T, its mean if it changes: it decides how fast the gas cools.
    """
    tau = np.atleast_1d(np.asarray(collisions_per_disk, dtype=float))
    free = theory.mean_free_path(packing_fraction, 0.5)
    counted, all_of_them = (
        _until(tau, law, packing_fraction, n, theta, k_max) for k_max in (1.0 / (PATHS * free), 1.0 / free)
    )
    (s, F), (more, larger) = counted, all_of_them
    return Streams(s, more - s, F, larger - F)


def _until(tau: Array, law: IFRLaw, phi: float, n: int, theta: float, k_max: float) -> tuple[Array, Array]:
    """s and F of waves up to k_max."""
    side = math.sqrt(0.25 * math.pi * n / phi)
    z = -float(changes_per_collision(theta, law, 2.0)[0])
    q, times = np.unique(waves((side, side), k_max), return_counts=True)
    q = q * theory.shear_length(law, 0.5, phi, theta=theta) ** 2
    fine = np.linspace(0.0, max(float(tau.max()), 1e-9), 401)
    s = excess(z * fine, 1.0 - q) @ times + excess(0.5 * z * fine, 1.0 - 3.0 * q) @ times
    s = s / (2.0 * n)
    lost = s / (1.0 + s)
    grown = z * np.concatenate([[0.0], np.cumsum(0.5 * (lost[1:] + lost[:-1]) * np.diff(fine))])
    return np.interp(tau, fine, s), np.exp(np.interp(tau, fine, grown))


def driven_streams(law: IFRLaw, packing_fraction: float, n: int, theta: float) -> tuple[float, float]:
    """Share of T that waves hold in a gas that random kicks heat, and how far it may be off.

    Kicks give every wave as much as they give to thermal velocities, and T is constant: dS/dtau = z - z q (S - 1) of a
    transverse wave, z - (3/2) z q (S - 1) of sound. So S - 1 tends to 1 / q and 2 / (3 q).
    """
    side = math.sqrt(0.25 * math.pi * n / packing_fraction)
    free = theory.mean_free_path(packing_fraction, 0.5)
    length = theory.shear_length(law, 0.5, packing_fraction, theta=theta)
    less, more = (
        float(np.sum(5.0 / 3.0 / (waves((side, side), k_max) * length**2))) / (2.0 * n)
        for k_max in (1.0 / (PATHS * free), 1.0 / free)
    )
    return less, more - less
