"""The paper's closed-form equations, corrected, and as printed where the print is wrong.

Source: A. Domenech-Carbo et al., "Independent friction-restitution modeling of two-disk collisions".

A disk 1 with velocity v_o and spin omega_o hits a disk 2 that is at rest. These are the paper's own results,
written out independently of `ifrdem.model.laws.ifr.collide`, to compare that with them. A function is named after what
it gives, in the paper's symbols; `Printed` has the printed forms of those that are wrong. Every function takes an
`Impact`, whose fields may be arrays, and returns an array.

Conventions of the paper: t points along the tangential approach velocity, so V_ot > 0; omega_1 is
counter-clockwise, omega_2 **clockwise**; angles are measured from the line of centres. `delta_1` exceeds 90
degrees where M < e_n, so that its tangent alone does not fix it: use arctan2(v_1t, v_1n).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from ...errors import InputError
from ...tools.checked import Array


@dataclass(frozen=True)
class Impact:
    """An impact of disk 1 on disk 2 at rest. Every field is a number or an array; arrays broadcast."""

    psi: Any  # angle of impact, from the line of centres to v_o [rad], 0 to pi/2
    e_n: Any
    e_t: Any
    mu: Any
    M: Any = 1.0  # mass ratio m_1 / m_2
    m_1: Any = 1.0  # [mass]
    R_1: Any = 1.0  # [length]
    R_2: Any = 1.0
    k_1: Any = 2.0  # in I = m R^2 / k
    k_2: Any = 2.0
    v_o: Any = 1.0  # speed of disk 1 before [length/time]
    # Its spin before, counter-clockwise [rad/time]; v_o sin psi + R_1 w_o must not be negative.
    w_o: Any = 0.0
    rho: Any = 0.0  # rolling friction [length]

    @property
    def V_on(self) -> Array:
        """Normal velocity of the contact before the impact, v_o cos psi."""
        return np.asarray(self.v_o * np.cos(self.psi))

    @property
    def V_ot(self) -> Array:
        """Tangential velocity of the contact before the impact, v_o sin psi + R_1 omega_o."""
        return np.asarray(self.v_o * np.sin(self.psi) + self.R_1 * self.w_o)

    @property
    def D(self) -> Array:
        """1 + k_1 + M (1 + k_2), the paper's tangential denominator."""
        return np.asarray(1.0 + self.k_1 + self.M * (1.0 + self.k_2))

    @property
    def r(self) -> Array:
        """2 R_1 R_2 / (R_1 + R_2) [length], below Eq. 32."""
        return np.asarray(2.0 * self.R_1 * self.R_2 / (self.R_1 + self.R_2))

    @property
    def lever(self) -> Array:
        """(1/R_1 + M/R_2) / (1 + M) [1/length], which is 1/r only for equal radii or equal masses."""
        return np.asarray((1.0 / self.R_1 + self.M / self.R_2) / (1.0 + self.M))


Law = Callable[[Impact], Array]


def homogeneous(law: Callable[..., Array]) -> Callable[..., Array]:
    """An equation of Sections II D and II G, which hold for homogeneous disks without spin before the impact."""

    @wraps(law)
    def checked(c: Impact, *more: Array) -> Array:
        if any(np.any(np.not_equal(*pair)) for pair in ((c.k_1, 2.0), (c.k_2, 2.0), (c.w_o, 0.0))):
            raise InputError("k_1, k_2, w_o: this equation holds for k_1 = k_2 = 2 and w_o = 0 only")
        return law(c, *more)

    return checked


# -- The normal motion, and what all regimes share ---------------------------------------------------------


def inertia(m: Any, R: Any, k: Any) -> Array:
    """Moment of inertia m R^2 / k, as Eq. 3 needs it [mass length^2]."""
    return np.asarray(m * R**2 / k)


def separation(c: Impact) -> Array:
    """Eq. 4: v_2 cos(delta_2) - v_1 cos(delta_1) after the impact."""
    return c.e_n * c.V_on


def P_n(c: Impact) -> Array:
    """Eq. 5: normal impulse."""
    return c.m_1 * (1.0 + c.e_n) / (1.0 + c.M) * c.V_on


def v_1n(c: Impact) -> Array:
    """Eq. 6: normal velocity of disk 1 after the impact."""
    return (c.M - c.e_n) / (1.0 + c.M) * c.V_on


def v_2n(c: Impact) -> Array:
    """Eq. 7: normal velocity of disk 2 after the impact."""
    return c.M * (1.0 + c.e_n) / (1.0 + c.M) * c.V_on


def P_et(c: Impact) -> Array:
    """Eq. 8: tangential impulse of restitution."""
    return c.m_1 * (1.0 + c.e_t) * c.V_ot / c.D


def contact_slip(v_1t: Any, v_2t: Any, R_1: Any, w_1: Any, R_2: Any, w_2: Any) -> Array:
    """Slip of the contact points, 0 where they stick: (v_1t + R_1 w_1) - (v_2t + R_2 w_2), w_2 clockwise."""
    return np.asarray((v_1t + R_1 * w_1) - (v_2t + R_2 * w_2))


def balance(v_1: Any, alpha_1: Any, v_2: Any, alpha_2: Any) -> Array:
    """Eq. 30: m_1 / m_2 from speeds and angles to the incoming direction (alpha_1 = delta_1 - psi,
    alpha_2 = psi - delta_2). The print calls the same expression m_2 / m_1.
    """
    return np.asarray(v_2 * np.sin(alpha_2) / (v_1 * np.sin(alpha_1)))


def T_rolling(c: Impact) -> Array:
    """Eq. 31: torque impulse of rolling friction, rolling."""
    return c.rho * P_n(c)


@homogeneous
def T_nonrolling(c: Impact) -> Array:
    """Eq. 32: torque impulse of rolling friction, nonrolling."""
    return c.m_1 * c.r * c.V_ot / (3.0 * (1.0 + c.M))


@homogeneous
def e_t_apparent_rolling(c: Impact, without: Array) -> Array:
    """Table I, rolling: what rolling friction leaves of the e_t* `without` it (Eq. 26, 27 or 28).

    The torque rho P_n on both disks changes the slip by 2 rho P_n (1/(m_1 R_1) + 1/(m_2 R_2)).
    """
    return without - 2.0 * c.rho * c.lever * (1.0 + c.e_n) / np.tan(c.psi)


@homogeneous
def e_t_apparent_nonrolling(c: Impact, without: Array) -> Array:
    """Table I, nonrolling: what rolling friction leaves of the e_t* `without` it (Eq. 26, 27 or 28).

    The torque of Eq. 32 changes the slip by its 2 T (1/(m_1 R_1) + 1/(m_2 R_2)), which is 2/3 of the slip
    before for R_1 = R_2 or M = 1, and in general 2/3 r (1/R_1 + M/R_2) / (1 + M) of it.
    """
    return without - 2.0 / 3.0 * c.r * c.lever


def _friction(c: Impact) -> Array:
    """Friction impulse over m_1, the common part of Eqs. 9 to 11."""
    return c.mu * (1.0 + c.e_n) / (1.0 + c.M) * c.V_on


def _percussion(c: Impact) -> Array:
    """The factor of Eqs. 16 and 17."""
    return (2.0 * (1.0 + c.e_t) * (1.0 + c.M) + c.D) / (2.0 * (1.0 + c.M) * c.D)


def _a(c: Impact) -> Array:
    """m_n / m_t = D / (1 + M): 3 for homogeneous disks, 7/2 for a sphere (k = 5/2) on a plane (M = 0)."""
    return c.D / (1.0 + c.M)


def _P_t(c: Impact, tangential: Any) -> Array:
    """m_1 / (1 + M) tangential V_ot, the common form of Eqs. 33, 36 and 39."""
    return c.m_1 / (1.0 + c.M) * tangential * c.V_ot


def _Rw_2(c: Impact, tangential: Any, normal: Any) -> Array:
    """M / (1 + M) v_o (tangential sin psi + normal (1 + e_n) cos psi), the common form of Eqs. 34 to 41."""
    return c.M / (1.0 + c.M) * (tangential * c.V_ot + normal * (1.0 + c.e_n) * c.V_on)


# -- The three regimes of the tangential motion ------------------------------------------------------------


class Equations(NamedTuple):
    """Equations of a regime of the tangential motion, the paper's, corrected."""

    text: str
    P_f: Law  # friction impulse
    v_1t: Law  # tangential velocities
    v_2t: Law
    tan_delta_1: Law  # angles after the impact from the line of centres
    tan_delta_2: Law
    e_t_apparent: Law  # -(slip after) / (slip before), for any k
    P_t: Law  # tangential impulse
    Rw_2_rolling: Law  # R_2 omega_2, clockwise
    Rw_2_nonrolling: Law
    tan_psi_transit: Law  # where sliding turns into this regime
    number: dict[str, str]  # of these equations


SLIDING = Equations(
    "sliding",
    P_f=lambda c: c.m_1 * _friction(c),  # Eq. 9
    v_1t=lambda c: c.v_o * np.sin(c.psi) - (1.0 + c.e_t) * c.V_ot / c.D - _friction(c),  # Eq. 10
    v_2t=lambda c: (1.0 + c.e_t) * c.M * c.V_ot / c.D + c.M * _friction(c),  # Eq. 11
    tan_delta_1=homogeneous(  # Eq. 18
        lambda c: (
            (3.0 * (1.0 + c.M) - (1.0 + c.e_t)) / (3.0 * (c.M - c.e_n)) * np.tan(c.psi)
            - c.mu * (1.0 + c.e_n) / (c.M - c.e_n)
        )
    ),
    tan_delta_2=homogeneous(lambda c: c.mu + (1.0 + c.e_t) / (3.0 * (1.0 + c.e_n)) * np.tan(c.psi)),  # Eq. 19
    e_t_apparent=lambda c: c.e_t + _a(c) * c.mu * (1.0 + c.e_n) / np.tan(c.psi),  # Eq. 26
    P_t=homogeneous(lambda c: _P_t(c, (1.0 + c.e_t) / 3.0) + c.mu * P_n(c)),  # Eq. 33
    Rw_2_rolling=homogeneous(  # Eq. 34
        lambda c: _Rw_2(c, 2.0 / 3.0 * (1.0 + c.e_t), 2.0 * (c.mu - c.rho / c.R_2))
    ),
    Rw_2_nonrolling=homogeneous(lambda c: _Rw_2(c, 2.0 / 3.0 * (1.0 + c.e_t - c.r / c.R_2), 2.0 * c.mu)),  # Eq. 35
    tan_psi_transit=lambda c: np.asarray(np.nan * c.mu),
    number={"P_f": "9", "v_1t": "10, corrected", "v_2t": "11", "e_t_apparent": "26", "rolling": "34",
            "nonrolling": "35, corrected"},
)  # fmt: skip
CONTACT_POINT = Equations(
    "contact point",
    P_f=lambda c: c.m_1 * c.V_ot / c.D,  # Eq. 12
    v_1t=lambda c: c.v_o * np.sin(c.psi) - (2.0 + c.e_t) * c.V_ot / c.D,  # Eq. 13
    v_2t=lambda c: c.M * (2.0 + c.e_t) * c.V_ot / c.D,  # Eq. 14
    tan_delta_1=homogeneous(  # Eq. 20
        lambda c: (3.0 * (1.0 + c.M) - (2.0 + c.e_t)) / (3.0 * (c.M - c.e_n)) * np.tan(c.psi)
    ),
    tan_delta_2=homogeneous(lambda c: (2.0 + c.e_t) / (3.0 * (1.0 + c.e_n)) * np.tan(c.psi)),  # Eq. 21
    # Eq. 27. It is 0, Brach's model without sliding, for e_t = -1; the paper's text says for e_t = 0.
    e_t_apparent=lambda c: np.asarray(1.0 + c.e_t + 0.0 * c.psi),
    P_t=homogeneous(lambda c: _P_t(c, (2.0 + c.e_t) / 3.0)),  # Eq. 36
    Rw_2_rolling=homogeneous(lambda c: _Rw_2(c, 2.0 / 3.0 * (2.0 + c.e_t), -2.0 * c.rho / c.R_2)),  # Eq. 37
    Rw_2_nonrolling=homogeneous(lambda c: _Rw_2(c, 2.0 / 3.0 * (2.0 + c.e_t - c.r / c.R_2), 0.0)),  # Eq. 38
    tan_psi_transit=homogeneous(lambda c: np.asarray(3.0 * c.mu * (1.0 + c.e_n))),  # Eq. 24: Eqs. 19 and 21 are equal
    number={"P_f": "12", "v_1t": "13", "v_2t": "14, corrected", "tan_delta": "20, 21", "tan_delta_1": "20",
            "tan_psi_transit": "24, corrected", "e_t_apparent": "27", "rolling": "37", "nonrolling": "38, corrected"},
)  # fmt: skip
PERCUSSION_CENTER = Equations(
    "percussion centre",
    P_f=lambda c: c.m_1 * c.V_ot / (2.0 * (1.0 + c.M)),  # Eq. 15
    v_1t=lambda c: c.v_o * np.sin(c.psi) - _percussion(c) * c.V_ot,  # Eq. 16
    v_2t=lambda c: c.M * _percussion(c) * c.V_ot,  # Eq. 17
    tan_delta_1=homogeneous(  # Eq. 22
        lambda c: (6.0 * (1.0 + c.M) - (5.0 + 2.0 * c.e_t)) / (6.0 * (c.M - c.e_n)) * np.tan(c.psi)
    ),
    tan_delta_2=homogeneous(lambda c: (5.0 + 2.0 * c.e_t) / (6.0 * (1.0 + c.e_n)) * np.tan(c.psi)),  # Eq. 23
    e_t_apparent=lambda c: c.e_t + 0.5 * _a(c) + 0.0 * c.psi,  # Eq. 28
    P_t=homogeneous(lambda c: _P_t(c, (5.0 + 2.0 * c.e_t) / 6.0)),  # Eq. 39
    Rw_2_rolling=homogeneous(lambda c: _Rw_2(c, 1.0 / 3.0 * (5.0 + 2.0 * c.e_t), -2.0 * c.rho / c.R_2)),  # Eq. 40
    Rw_2_nonrolling=homogeneous(  # Eq. 41
        lambda c: _Rw_2(c, 1.0 / 3.0 * (5.0 + 2.0 * c.e_t - 2.0 * c.r / c.R_2), 0.0)
    ),
    tan_psi_transit=lambda c: np.asarray(2.0 * c.mu * (1.0 + c.e_n)),  # Eq. 25, whatever masses and k
    number={"P_f": "15", "v_1t": "16", "v_2t": "17", "tan_delta": "22, 23", "tan_delta_1": "22",
            "tan_psi_transit": "25", "e_t_apparent": "28", "rolling": "40", "nonrolling": "41, corrected"},
)  # fmt: skip
CLOSURES = {"percussion_center": PERCUSSION_CENTER, "contact_point": CONTACT_POINT}
"""The two ways to stick."""


# -- As printed, where the print is wrong ------------------------------------------------------------------


class Printed:
    """Equations as printed, by number; each comment gives the error."""

    # Above Eq. 3, with R for R^2: not even a moment of inertia by its unit.
    inertia: Callable[..., Array] = staticmethod(lambda m, R, k: np.asarray(m * R / k))
    # Eq. 10 has a factor M in the friction: against Eq. 2 and Eq. 18 unless M = 1.
    eq_10: Law = staticmethod(
        lambda c: c.v_o * np.sin(c.psi) - (1.0 + c.e_t) * c.V_ot / c.D - c.M * _friction(c)
    )
    # Above Eq. 12, with - R_1 w_1; Eq. 12 does not follow from it.
    contact_slip: Callable[..., Array] = staticmethod(
        lambda v_1t, v_2t, R_1, w_1, R_2, w_2: contact_slip(v_1t, v_2t, -R_1, w_1, R_2, w_2)
    )
    # Eq. 14 has no factor M: against Eq. 2 and Eq. 21 unless M = 1.
    eq_14: Law = staticmethod(lambda c: (2.0 + c.e_t) * c.V_ot / c.D)
    # Eq. 24 is divided by 1 + e_t: Eqs. 19 and 21 are not equal there.
    eq_24: Law = staticmethod(lambda c: np.asarray(3.0 * c.mu * (1.0 + c.e_n) / (1.0 + c.e_t)))
    # Eq. 26 has the 3 of homogeneous disks for every k: Fig. 3 uses it for spheres on a plane.
    eq_26: Law = staticmethod(lambda c: c.e_t + 3.0 * c.mu * (1.0 + c.e_n) / np.tan(c.psi))
    # Eq. 33 has - mu M for + mu: against Eq. 34.
    eq_33: Law = staticmethod(lambda c: _P_t(c, (1.0 + c.e_t) / 3.0) - c.mu * c.M * P_n(c))
    # Eqs. 35 and 38 have (r/R_2) M for r/R_2, which does not follow from Eqs. 32, 33 and 36 unless M = 1.
    eq_35: Law = staticmethod(lambda c: _Rw_2(c, 2.0 / 3.0 * (1.0 + c.e_t - c.r / c.R_2 * c.M), 2.0 * c.mu))
    eq_38: Law = staticmethod(lambda c: _Rw_2(c, 2.0 / 3.0 * (2.0 + c.e_t - c.r / c.R_2 * c.M), 0.0))
    # Eq. 41 has 2/3 (5 + 2 e_t - (r/R_2) M): does not follow from Eqs. 32 and 39, nor match Eq. 40.
    eq_41: Law = staticmethod(lambda c: _Rw_2(c, 2.0 / 3.0 * (5.0 + 2.0 * c.e_t - c.r / c.R_2 * c.M), 0.0))
    # Table I: rolling with 1/r, right only for R_1 = R_2 or M = 1; nonrolling with 2, three times too much there.
    rolling: Callable[..., Array] = staticmethod(
        lambda c, without: without - 2.0 * c.rho / c.r * (1.0 + c.e_n) / np.tan(c.psi)
    )
    nonrolling: Callable[..., Array] = staticmethod(lambda c, without: without - 2.0)


# -- Table II ----------------------------------------------------------------------------------------------


class Table2Row(NamedTuple):
    """A row of Table II as printed; `psi_transit` in degrees, names of `coins` as in `model.laws.coin_table`."""

    disks: str
    material: str
    M: float
    e_n: float
    e_t: float
    mu: float
    psi_transit: float
    coins: tuple[str, str]


# Misprints kept here: "25 cts" is the 50 cts coin of Sec. III; the masses of Sec. III give M = 1.300 and
# 0.769 for 500 and 100 pts; Eq. 25 gives 29.68 degrees, not 29.6, for them.
LARGE_BRONZE = (0.90, -0.90, 0.15, 29.6)
TABLE_II = (
    Table2Row("25 cts-25 cts coins", "Copper-nickel", 1.00, 0.86, -0.99, 0.19, 35.2, ("50 cts", "50 cts")),
    Table2Row("1 pta-1 pta coins", "Aluminum", 1.00, 0.87, -0.88, 0.21, 38.1, ("1 pta", "1 pta")),
    Table2Row("5 pts-5 pts coins", "Bronze-aluminum", 1.00, 0.80, -0.98, 0.11, 21.6, ("5 pts", "5 pts")),
    Table2Row("200 pts-200 pts coins", "Copper-nickel", 1.00, 0.77, -0.96, 0.15, 28.0, ("200 pts",) * 2),
    Table2Row("500 pts-100 pts coins", "Bronze-aluminum", 1.28, *LARGE_BRONZE, ("500 pts", "100 pts")),
    Table2Row("100 pts-100 pts coins", "Bronze-aluminum", 1.00, *LARGE_BRONZE, ("100 pts", "100 pts")),
    Table2Row("100 pts-500 pts coins", "Bronze-aluminum", 0.79, *LARGE_BRONZE, ("100 pts", "500 pts")),
    Table2Row("Polyester resin disks", "Polyester resin", 1.00, 0.67, -0.95, 0.14, 25.1, ("polyester",) * 2),
)

# Fig. 5a is captioned "copper-aluminum", a coin that the paper does not have; its coefficients e_n, e_t, mu
# are those of one row of Table II.
FIGURE_5A = (0.80, -0.98, 0.11)
