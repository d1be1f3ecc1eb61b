"""The IFR law: its coefficients, and whether they can add energy.

Source: A. Domenech-Carbo et al., "Independent friction-restitution modeling of two-disk collisions". The formula
itself is `ifrdem.kernels.laws.law.collide_pair`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from enum import IntEnum
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, outside_level
from ...tools import checked
from ...tools.checked import (
    LEAST,
    Array,
    Friction,
    NonNegative,
    NormalRestitution,
    Number,
    Ratio,
    TangentialRestitution,
    validated,
)
from ..custom_code import FromKernels
from .law import Admissibility, CollisionLaw, EnergyWarning, Key

STICKING = ("percussion_center", "contact_point")

# Two sides of an inequality of admissibility that agree to this are equal: what rounding leaves of values
# that are chosen on the boundary. A collision can gain 1e-12 of its energy by it, no more than rounding does.
ROUND_OFF = 1e-12

FOR_OTHER_DISKS = "; for disks of another shape pass their k"
"""End of the message of a refused law in Python; a case has the k of its disks."""
OTHER_LAWS = (
    "If e_t is meant with friction in it, as beta_0 of Walton's law or beta of rough disks, take those: "
    'law = "walton" or "rough"'
)


class Regime(IntEnum):
    """Regime of a collision. 1 and 2 where the law's rho is 0, 3 to 6 where it is not.

    Examples
    --------
    >>> import ifrdem
    >>> [regime.name for regime in ifrdem.Regime][:3]
    ['SEPARATING', 'SLIDING', 'STICKING']
    """

    SEPARATING = 0
    SLIDING = 1
    STICKING = 2
    SLIDING_ROLLING = 3
    STICKING_ROLLING = 4
    SLIDING_NONROLLING = 5
    STICKING_NONROLLING = 6


ELASTIC = 9
"""In place of a `Regime`: a custom law or a thermal wall; elastic by a remedy for collapse."""


def regime_name(number: int) -> str:
    """Words for a regime as histories number them: -1 not known, 0 none, 9 elastic by a remedy for collapse."""
    special = {-1: "not known", 0: "-", ELASTIC: "elastic"}
    if number not in special and number not in [*Regime]:
        return f"{number}?"
    return special.get(number) or Regime(number).name.lower().replace("_", " ")


_Mass = Annotated[float, Number(LEAST, math.inf, f"a positive number from {LEAST:g}, or inf")]


@validated
@dataclass(frozen=True, kw_only=True)
class IFRLaw(CollisionLaw):
    """The independent friction-restitution law of one pair of materials.

    InputError if a coefficient is out of range by itself, `sticking` is unknown, or the coefficients together can add
    energy in a collision of two disks with this k: the message names the inequality and both its sides. EnergyWarning
    if the tangential impulses alone could add energy and only the loss along the line of centres outweighs it.

    Parameters
    ----------
    e_n : float
        Normal restitution, 0 to 1: the relative normal velocity is reversed and multiplied by it (Eq. 4).
    e_t : float
        Tangential restitution, -1 (none) to 1: without friction, the tangential velocity of the contact is reversed and
        multiplied by it (Eq. 8). Not the apparent coefficient of other laws, which contains friction (Eqs. 26 to 28).
    mu : float
        Sliding friction, 0 or more (Eq. 9).
    sticking : {"percussion_center", "contact_point"}
        Which point's slip friction can stop at most: Eq. 15, the paper's choice, or Eq. 12.
    rho : float
        Rolling friction [length], 0 or more (Eq. 31).
    k : float
        Shape number in I = m R^2 / k of the disks for which the coefficients are examined (2 homogeneous disk, 1 hoop;
        of a pair that differs the larger one): the larger, the sooner they add energy. It enters no collision; `check`
        examines any other pair, and `collide` and the simulation do so for what they collide.

    Notes
    -----
    With kbar = (k_i m_j + k_j m_i) / (m_i + m_j), a = m_n / m_t = 1 + kbar, c = 1/2 (percussion centre) or 1/a (contact
    point) and e_s = e_t + a c, no collision of two disks adds energy if and only if e_n <= 1, -1 <= e_t <= 1, and where
    mu > 0 also e_t < 1 and

    1. a (1 - e_n) >= (e_s^2 - 1) (1 + e_n) mu^2 / c^2, and
    2. where e_t a c > 1 - e_t^2, also (1 - e_n) (1 - e_t^2) >= a mu^2 (1 + e_n).

    Derivation: P_t changes the energy by P_t^2 / (2 m_t) - P_t g_t, and the normal impulse by -P_n^2 (1 -
    e_n) / (2 m_n (1 + e_n)). With x = m_t |g_t| / P_n and P_f = P_n min(mu, a c x) the sum is, but for a
    positive factor, (min(mu, a c x) + e_t x)^2 - x^2 - (1 - e_n) / (a (1 + e_n)). Its largest value lies at
    the boundary of sticking, x = mu / (a c), which is 1, or inside the sliding range, at x = mu e_t / (1 -
    e_t^2), which is 2. The tangential impulses alone never add energy if mu = 0, or e_s <= 1: e_t <= 0 (contact
    point), or e_t <= (1 - kbar) / 2 (percussion centre). Rolling friction only takes energy.

    The sets shrink as kbar grows, and kbar lies between k_i and k_j whatever the masses. In a collision with
    a moving wall energy is meant as seen from the wall.

    Examples
    --------
    >>> import ifrdem
    >>> law = ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15)
    >>> law.e_n, law.sticking
    (0.9, 'percussion_center')
    >>> ifrdem.IFRLaw(e_n=1.2, e_t=-0.9, mu=0.15)
    Traceback (most recent call last):
        ...
    ifrdem.errors.InputError: e_n = 1.2: must be a number from 0 to 1...
    """

    name_in_cases: ClassVar[str] = "ifr"
    keys: ClassVar[Mapping[str, Key]] = MappingProxyType({
        "e_n": Key(checked.E_N, "normal restitution e_n [1], 0 to 1 (elastic)", 0.87),
        "e_t": Key(
            checked.E_T,
            "tangential restitution e_t [1], -1 (smooth but for friction) to 1; with percussion-centre sticking, "
            "homogeneous disks never gain energy up to -0.5", -0.88,
        ),
        "mu": Key(checked.MU, "sliding friction mu [1], 0 or more", 0.21),
        "sticking": Key(
            STICKING,
            'what stops slipping in a sticking collision: "percussion_center" (Eq. 15, the paper\'s choice) or '
            '"contact_point" (Eq. 12)', STICKING[0],
        ),
        "rho": Key(checked.NON_NEGATIVE, "rolling friction rho [m], 0 or more", 0.0),
    })  # fmt: skip
    takes_k: ClassVar[bool] = True
    coefficients: ClassVar[tuple[str, ...]] = ("e_n", "e_t", "mu", "contact_point", "rho")
    is_passive: ClassVar[bool] = True
    has_averages: ClassVar[bool] = True
    has_ifr_symbols: ClassVar[bool] = True
    collide = FromKernels("laws.law", "ifr")
    parts = FromKernels("laws.law", "ifr_parts")

    e_n: NormalRestitution
    e_t: TangentialRestitution
    mu: Friction
    sticking: Literal["percussion_center", "contact_point"] = "percussion_center"
    rho: NonNegative = 0.0
    k: Ratio = field(default=2.0, compare=False)

    def __post_init__(self) -> None:
        verdict = self._admissibility(self.k)  # kbar = k for a like pair, whatever the masses
        if not verdict.admissible:
            raise InputError(f"{verdict.message}{FOR_OTHER_DISKS}")
        self._act_on(verdict)

    @validated
    def admissibility(self, k_i: Ratio, k_j: Ratio, m_i: _Mass = 1.0, m_j: _Mass = 1.0) -> Admissibility:
        """Verdict on collisions of disks with shape numbers k_i, k_j and masses m_i, m_j.

        Masses, in any one unit, matter only where the k differ; one of them may be infinite, a wall. InputError if a k
        is not positive and finite, a mass is not positive, or both masses are infinite.
        """
        if not (m_i > 0.0 and m_j > 0.0) or (math.isinf(m_i) and math.isinf(m_j)):
            raise InputError(
                f"m_i = {m_i}, m_j = {m_j}: must be positive masses, at most one of them infinite"
            )
        return self._admissibility(float(mean_k(k_i, k_j, m_i, m_j)))

    @validated
    def check(self, k_i: Ratio, k_j: Ratio, m_i: _Mass = 1.0, m_j: _Mass = 1.0) -> None:
        """Refuse the law, or warn, for collisions of disks with these k and masses; see `admissibility`.

        InputError if a collision of such a pair can add energy. EnergyWarning if only the loss along the line of
        centres keeps it from that.
        """
        self._act_on(self.admissibility(k_i, k_j, m_i, m_j))

    def table_row(self) -> tuple[float, float, float, float, float]:
        """The numbers that `collide_pair` takes: e_n, e_t, mu, contact_point (1.0 or 0.0), rho [length]."""
        return self.e_n, self.e_t, self.mu, float(self.sticking == "contact_point"), self.rho

    @property
    def is_dissipative(self) -> bool:
        """True if e_n is below 1."""
        return self.e_n < 1.0

    def slip_coefficients(self, inverse_a: Array) -> tuple[Array, Array]:
        """As of `CollisionLaw`: restitution of the slip, and friction up to what stops a point."""
        c = inverse_a if self.sticking == "contact_point" else np.full_like(inverse_a, 0.5)
        return (1.0 + self.e_t) * inverse_a, c

    def _act_on(self, verdict: Admissibility) -> None:
        if not verdict.admissible:
            raise InputError(verdict.message)
        if not verdict.strict:
            warnings.warn(verdict.message, EnergyWarning, stacklevel=outside_level())

    def _admissibility(self, k_bar: float) -> Admissibility:
        e_n, e_t, mu = self.e_n, self.e_t, self.mu
        a = 1.0 + k_bar
        contact_point = self.sticking == "contact_point"
        ac = 1.0 if contact_point else 0.5 * a
        c = ac / a
        e_s = e_t + ac
        law = (
            f"e_n = {e_n:g}, e_t = {e_t:g}, mu = {mu:g}, sticking = '{self.sticking}', "
            f"for disks whose mean k (kbar) is {k_bar:g}"
        )
        if mu == 0.0:
            return Admissibility(
                True, True, f"{law}: no collision adds energy, because mu = 0 and -1 <= e_t <= 1"
            )
        if e_t == 1.0:
            text = (
                f"{law}: a grazing collision would add energy; with mu > 0, e_t must be below 1. {OTHER_LAWS}"
            )
            return Admissibility(False, False, text)
        corner = "where sliding turns into sticking, a (1 - e_n) >= (e_s^2 - 1) (1 + e_n) mu^2 / c^2"
        needed = [(corner, a * (1.0 - e_n), (e_s**2 - 1.0) * (1.0 + e_n) * mu**2 / c**2)]
        if e_t * ac > 1.0 - e_t**2:
            inside = "where it slides, (1 - e_n) (1 - e_t^2) >= a mu^2 (1 + e_n)"
            needed.append((inside, (1.0 - e_n) * (1.0 - e_t**2), a * mu**2 * (1.0 + e_n)))
        broken = "; and ".join(
            f"{words} must hold, but left is {left:.4g} and right {right:.4g} ({right - left:.4g} more)"
            for words, left, right in needed
            if right - left > ROUND_OFF * max(1.0, right)
        )
        with_ = f"with a = 1 + kbar = {a:g}, c = {c:.4g}, e_s = e_t + a c = {e_s:.4g}"
        if broken:
            others = f" {OTHER_LAWS}." if e_t > 0.0 else ""
            text = (
                f"a collision would add energy. {self._remedy(a, ac)}.{others} Now {law}: {broken} ({with_}); "
                "see `ifrdem docs law`"
            )
            return Admissibility(False, False, text)
        if e_s <= 1.0 + ROUND_OFF:
            text = f"{law}: no collision adds energy, nor do its tangential impulses alone ({with_})"
            return Admissibility(True, True, text)
        bound = "e_t <= 0" if contact_point else f"e_t <= (1 - kbar) / 2 = {0.5 * (1.0 - k_bar):g}"
        text = (
            f"{law}: the tangential impulses alone add energy: {bound} is exceeded by {e_s - 1.0:.4g}; "
            f"only the loss along the line of centres, e_n = {e_n:g}, outweighs it ({with_})"
        )
        return Admissibility(True, False, text)

    def _remedy(self, a: float, ac: float) -> str:
        """mu and e_t with which a law would not add energy that does."""
        loss = (1.0 - self.e_n) / (a * (1.0 + self.e_n))
        largest = ac * math.sqrt(loss / ((self.e_t + ac) ** 2 - 1.0))
        if self.e_t * ac > 1.0 - self.e_t**2:
            largest = min(largest, math.sqrt(loss * (1.0 - self.e_t**2)))
        remedies = [f"mu below {largest:.4g}" if largest > 0.0 else "mu = 0"]
        if 1.0 - ac >= -1.0:
            remedies.insert(0, f"e_t <= {1.0 - ac:g}")
        return f"With {' or '.join(remedies)} it would not"


def smooth_disks(e_n: NormalRestitution) -> IFRLaw:
    """The law of smooth disks: normal restitution only, which is the IFR law with e_t = -1 and mu = 0.

    Examples
    --------
    >>> from ifrdem import laws
    >>> laws.smooth_disks(0.9) == laws.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    True
    """
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


@validated
def rough_disks(e_n: NormalRestitution, beta: TangentialRestitution) -> IFRLaw:
    """The law of rough disks of constant normal and tangential restitution: the IFR law with e_t = beta and mu = 0.

    J. T. Jenkins and M. W. Richman, Phys. Fluids 28, 3485 (1985), doi:10.1063/1.865302.

    Parameters
    ----------
    e_n : float
        Normal restitution, 0 to 1.
    beta : float
        Tangential restitution, -1 (smooth) to 1 (perfectly rough): each collision reverses the slip and multiplies it
        by beta.

    Examples
    --------
    >>> from ifrdem import laws
    >>> laws.rough_disks(1.0, beta=1.0).e_t
    1.0
    """
    return IFRLaw(e_n=e_n, e_t=beta, mu=0.0)


def mean_k(k_i: ArrayLike, k_j: ArrayLike, m_i: ArrayLike, m_j: ArrayLike) -> Array:
    """kbar = (k_i m_j + k_j m_i) / (m_i + m_j): exact where k_i = k_j, and for a mass that is infinite."""
    k_i, k_j = np.asarray(k_i, dtype=np.float64), np.asarray(k_j, dtype=np.float64)
    with np.errstate(over="ignore", under="ignore"):
        ratio = np.asarray(m_j, dtype=np.float64) / np.asarray(m_i, dtype=np.float64)
    return k_i + (k_j - k_i) / (1.0 + ratio)


COEFFICIENTS = tuple(each.name for each in fields(IFRLaw) if each.compare)
"""Names of the coefficients of a law in cases, files and tables: all but k, which is one of the disks."""
REQUIRED_COEFFICIENTS = tuple(each.name for each in fields(IFRLaw) if each.default is MISSING)
"""Those without a default: e_n, e_t and mu."""
