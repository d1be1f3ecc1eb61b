"""Walton's law of rough disks."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ...tools import checked
from ...tools.checked import Array
from ..custom_code import FromKernels
from .ifr import IFRLaw
from .law import CollisionLaw, Key


class Walton(CollisionLaw):
    """Walton's law: constant restitution beta_0 of the slip, up to Coulomb's limit.

    P_n = (1 + e_n) m_n g_n, |P_t| = min(mu P_n, (1 + beta_0) m_t |g_t|), in the symbols of `CollisionLaw.collide`.
    beta_0 = 0 stops the slip (Brach's law), beta_0 = -1 leaves it (smooth disks), mu = inf is not needed: a large mu
    makes each impact stick, which is the law of rough disks of constant restitution. InputError if a coefficient is
    missing, unknown or out of range.

    Parameters
    ----------
    e_n : float
        Normal restitution, 0 to 1.
    beta_0 : float
        Tangential restitution of collisions that stick, -1 to 1: the slip is reversed and multiplied by it.
    mu : float
        Sliding friction, 0 or more.

    Notes
    -----
    No collision adds energy: P_t changes it by P_t^2 / (2 m_t) - P_t g_t, which is 0 or less while |P_t| <= 2 m_t
    |g_t|, and (1 + beta_0) <= 2. In the ledger a collision that sticks loses by tangential restitution, and one that
    slides by friction.

    O. R. Walton, in Particulate Two-Phase Flow, ed. M. C. Roco (1993), chapter 25.

    Examples
    --------
    >>> from ifrdem import laws
    >>> law = laws.Walton(e_n=0.9, beta_0=0.4, mu=0.2)
    >>> law.beta_0
    0.4
    """

    coefficients: ClassVar[tuple[str, ...]] = ("e_n", "beta_0", "mu")
    name_in_cases: ClassVar[str] = "walton"
    keys: ClassVar[Mapping[str, Key]] = MappingProxyType({
        "e_n": IFRLaw.keys["e_n"],
        "beta_0": Key(
            checked.E_T,
            "tangential restitution of impacts that stick [1], -1 (smooth) to 1", 0.4,
        ),
        "mu": IFRLaw.keys["mu"],
    })  # fmt: skip
    is_passive: ClassVar[bool] = True
    has_averages: ClassVar[bool] = True
    has_ifr_symbols: ClassVar[bool] = True
    collide = FromKernels("laws.other_laws", "walton")
    parts = FromKernels("laws.other_laws", "walton_parts")

    def slip_coefficients(self, inverse_a: Array) -> tuple[Array, Array]:
        """As of `CollisionLaw`: no restitution in slides, and at most what reverses the slip by beta_0."""
        return np.zeros_like(inverse_a), (1.0 + self.beta_0) * inverse_a

    @property
    def is_dissipative(self) -> bool:
        """True if e_n is below 1."""
        return self.e_n < 1.0
