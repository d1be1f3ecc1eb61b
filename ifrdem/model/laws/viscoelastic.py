"""The law of viscoelastic spheres, whose restitution depends on the speed of impact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError
from ...tools import checked
from ...tools.checked import Array, Number, Positive, validated
from ..custom_code import FromKernels
from .ifr import STICKING, IFRLaw
from .law import CollisionLaw, Key
from .walton import Walton

FRICTION = ("ifr", "walton")
LEAST_E_N = 0.05
"""Least e_n of typical impacts: the approximant is 15 % too high there, and more further down."""


class Viscoelastic(CollisionLaw):
    """Viscoelastic spheres: a restitution e_n that depends on the speed; friction of the IFR law or of Walton's.

    e_n falls with the speed of approach g_n as 1 - 1.15345 b + 0.79826 b^2 - ..., with b = (3/2) A (k / m_n)^(2/5)
    g_n^(1/5), k = 2 Y sqrt(R) / 3, effective mass m_n and radius R = R_i R_j / (R_i + R_j). It is computed by a Pade
    approximant (within 1e-5 of the equation of motion where e_n > 0.93, 1e-3 where e_n > 0.7, 5e-3 at 0.4, 9e-3 down to
    0.05; gases whose typical impacts have less are refused). Slow impacts are elastic: such a gas cools as t^(-5/3).
    InputError if a coefficient is out of range, or the law could add energy.

    Parameters
    ----------
    A : float
        Dissipative time of the material [time], 0 or more.
    Y : float
        Young's modulus over 1 - nu^2 [mass/(length time^2)], positive.
    e_t, mu, sticking, rho
        Tangential restitution and friction, as of `IFRLaw`; smooth disks by default.
    friction : {"ifr", "walton"}
        The law of tangential impulses: that of `IFRLaw`, or that of `Walton`, which takes mu and beta_0 only.
    beta_0 : float
        With Walton's friction, the tangential restitution of impacts that stick; 0 stops the slip.
    k : float
        Shape number of the disks for which the law is examined, as of `IFRLaw`.

    Notes
    -----
    That no collision adds energy is known if the IFR law with e_n = 1, the restitution of slow impacts, adds none
    (`IFRLaw`): each of its conditions is met the better the smaller e_n is. Walton's friction never does. At a wall m_n is the mass of the disk, and
    R is that of Hertz's contact: R_i at a flat wall, R_i r / (r + R_i) outside a circle of radius r, and
    R_i r / (r - R_i) inside. Ends of segments and arcs count as flat. The modulus of a pair of unlike materials is
    twice that of their contact, Y = 2 / (1 / Y_i + 1 / Y_j).

    T. Schwager and T. Poeschel, Phys. Rev. E 57, 650 (1998), doi:10.1103/PhysRevE.57.650; R. Ramirez et al., Phys.
    Rev. E 60, 4465 (1999), doi:10.1103/PhysRevE.60.4465; the approximant: P. Mueller and T. Poeschel, Phys. Rev. E 84,
    021302 (2011), doi:10.1103/PhysRevE.84.021302.

    Examples
    --------
    >>> from ifrdem import laws
    >>> law = laws.Viscoelastic.of_restitution(0.9, g_n=1.0, mass=1.0, radius=0.5)
    >>> [round(law.restitution(g_n, mass=1.0, radius=0.5), 4) for g_n in (1.0, 1e-3)]
    [0.9, 0.9735]

    Contacts of LAMMPS, `hertz/material E eta nu tangential mindlin NULL 1.0 mu damping viscoelastic limit_damping`,
    between disks of mass 1 (`ifrdem docs coming-from`):

    >>> E, eta, nu, mu, m_n = 1e6, 100.0, 0.33, 0.2, 0.5
    >>> Y = E / (1.0 - nu**2)
    >>> law = laws.Viscoelastic(A=eta * m_n / Y, Y=Y, friction="walton", beta_0=0.26, mu=mu)
    >>> law.friction
    'walton'
    """

    coefficients: ClassVar[tuple[str, ...]] = (
        "A", "Y", "e_t", "mu", "contact_point", "rho", "beta_0", "walton",
    )  # fmt: skip
    name_in_cases: ClassVar[str] = "viscoelastic"
    keys: ClassVar[Mapping[str, Key]] = MappingProxyType({
        "A": Key(checked.NON_NEGATIVE, "dissipative time of the material [s]", 1e-5),
        "Y": Key(checked.POSITIVE, "Young's modulus over 1 - nu^2 [Pa]", 1e9),
        **{name: key for name, key in IFRLaw.keys.items() if name != "e_n"},
        "friction": Key(
            FRICTION,
            'tangential impulses: "ifr", of the IFR law, or "walton", of Walton\'s, which takes mu and beta_0 only',
            FRICTION[0],
        ),
        "beta_0": Walton.keys["beta_0"]._replace(example=0.0),
    })  # fmt: skip
    takes_k: ClassVar[bool] = True
    is_passive: ClassVar[bool] = True
    has_averages: ClassVar[bool] = True
    has_ifr_symbols: ClassVar[bool] = True
    depends_on_speed: ClassVar[bool] = True
    collide = FromKernels("laws.other_laws", "viscoelastic")
    parts = FromKernels("laws.other_laws", "viscoelastic_parts")

    def __init__(
        self, *, A: float, Y: float, e_t: float = -1.0, mu: float = 0.0,
        sticking: Literal["percussion_center", "contact_point"] = "percussion_center", rho: float = 0.0,
        friction: Literal["ifr", "walton"] = "ifr", beta_0: float = 0.0, k: float = 2.0,
    ) -> None:  # fmt: skip
        checked.choice("sticking", sticking, STICKING)
        checked.choice("friction", friction, FRICTION)
        contact_point, walton = float(sticking == "contact_point"), float(friction == "walton")
        super().__init__(
            A=A, Y=Y, e_t=e_t, mu=mu, contact_point=contact_point, rho=rho, beta_0=beta_0, walton=walton
        )
        if walton:
            other = {"e_t": (e_t, -1.0), "sticking": (sticking, STICKING[0]), "rho": (rho, 0.0)}
        else:
            other = {"beta_0": (beta_0, 0.0)}
        for name, (value, default) in other.items():
            if value != default:
                needed = FRICTION[not walton]
                raise InputError(f"{name} = {value!r}: requires friction = '{needed}', not with '{friction}'")
        self._k = k
        self._slow(k)

    @property
    def sticking(self) -> Literal["percussion_center", "contact_point"]:
        """As of `IFRLaw`."""
        return "contact_point" if self.contact_point else "percussion_center"

    @property
    def friction(self) -> Literal["ifr", "walton"]:
        """The law of tangential impulses."""
        return "walton" if self.walton else "ifr"

    @property
    def k(self) -> float:
        """Shape number of the disks for which the law was examined."""
        return self._k

    def __repr__(self) -> str:
        """The law as it is made."""
        names = ("A", "Y", "mu", "beta_0") if self.walton else ("A", "Y", "e_t", "mu")
        numbers = ", ".join(f"{name}={getattr(self, name):g}" for name in names)
        if self.walton:
            return f"Viscoelastic({numbers}, friction='walton')"
        return f"Viscoelastic({numbers}, sticking={self.sticking!r}, rho={self.rho:g})"

    def _slow(self, k: float) -> IFRLaw | Walton:
        """The law of its slowest impacts, which are elastic."""
        if self.walton:
            return Walton(e_n=1.0, beta_0=self.beta_0, mu=self.mu)
        return IFRLaw(e_n=1.0, e_t=self.e_t, mu=self.mu, sticking=self.sticking, rho=self.rho, k=k)

    def check(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> None:
        """Refuse the law for disks with these k and masses if a collision could add energy; see `IFRLaw.check`."""
        self._slow(self.k).check(k_i, k_j, m_i, m_j)

    def check_speed(self, g_n: float, m_n: float, R: float) -> None:
        """Refuse the law if e_n of an impact is below `LEAST_E_N`, where the approximant does not hold."""
        e_n = float(self.restitutions(g_n, m_n, R)) if g_n > 0.0 else 1.0
        if e_n < LEAST_E_N:
            raise InputError(
                f"A = {self.A:g}, Y = {self.Y:g}: e_n = {e_n:.3g} at the approach speed {g_n:.4g}: must be at least "
                f"{LEAST_E_N:g}, down to where the approximant holds; decrease A, the dissipative time"
            )

    @property
    def is_dissipative(self) -> bool:
        """True if A is above 0."""
        return self.A > 0.0

    def slip_coefficients(self, inverse_a: Array) -> tuple[Array, Array]:
        """As of `IFRLaw` or `Walton`."""
        return self._slow(self.k).slip_coefficients(inverse_a)

    def restitutions(self, g_n: ArrayLike, m_n: ArrayLike, R: float) -> Array:
        """e_n of pairs of effective masses [mass] and radius [length] that approach at g_n [length/time]; arrays."""
        from ...kernels.laws.other_laws import restitution  # imports Taichi, which is slow

        stiffness = 2.0 * self.Y * math.sqrt(R) / (3.0 * np.asarray(m_n, dtype=np.float64))
        b = 1.5 * self.A * stiffness**0.4 * np.asarray(g_n, dtype=np.float64) ** 0.2
        found: Array = restitution(np.sqrt(b), b)
        return found

    @validated
    def restitution(self, g_n: Positive, *, mass: Positive, radius: Positive) -> float:
        """e_n of two disks of this mass [mass] and radius [length] that approach at g_n [length/time]."""
        return float(self.restitutions(g_n, 0.5 * mass, 0.5 * radius))

    @classmethod
    @validated
    def of_restitution(
        cls, e_n: Annotated[float, Number(LEAST_E_N, 1.0, "a number from 0.05 to 1")], *, g_n: Positive, mass: Positive,
        radius: Positive, Y: Positive = 1.0, **friction: Any,
    ) -> Viscoelastic:  # fmt: skip
        """The law with which two equal disks have the restitution e_n at a speed of approach.

        A and Y enter as A Y^(2/5) only, so that Y is any for disks of one kind.

        Parameters
        ----------
        e_n, g_n : float
            Restitution, 0.05 to 1, and the speed [length/time] at which it is so.
        mass, radius : float
            Of each disk [mass], [length].
        Y : float
            Modulus [mass/(length time^2)].
        **friction
            e_t, mu, sticking, rho, friction, beta_0, k, as for the law.
        """
        from scipy.optimize import brentq

        def excess(A: float) -> float:
            return cls(A=A, Y=Y).restitution(g_n, mass=mass, radius=radius) - e_n

        # b of the law with A = 1; restitution is 0.05 at b = 5.
        unit = 1.5 * (2.0 * Y * math.sqrt(0.5 * radius) / (1.5 * mass)) ** 0.4 * g_n**0.2
        A = brentq(excess, 0.0, 10.0 / unit, xtol=1e-15 / unit) if e_n < 1.0 else 0.0
        return cls(A=A, Y=Y, **friction)
