"""What a law predicts for an impact of one disk on another at rest: the forward model of `ifrdem.fit`.

The numbers come from `ifrdem.kernels.law.collide_pair`, for many coefficients and angles in one call.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.ifr import STICKING

Array = NDArray[np.float64]
Sticking = Literal["percussion_center", "contact_point"]


class Quantity(NamedTuple):
    """A measured quantity: its symbol in a picture, its unit, what it is, and the values it can have.

    `unit` is "deg" or "1". A value lies from `low` to `high`, above 0 if `low` is 0.
    """

    symbol: str
    unit: str
    about: str
    low: float
    high: float


MEASURED: Mapping[str, Quantity] = {
    "delta_1": Quantity(
        r"$\delta_1$",
        "deg",
        "direction of disk 1 after the impact, from the line of centres; above 90 where it bounces back",
        -180.0,
        180.0,
    ),
    "delta_2": Quantity(
        r"$\delta_2$",
        "deg",
        "direction of disk 2 after the impact, from the line of centres",
        -90.0,
        90.0,
    ),
    "Rw_2": Quantity(
        r"$R_2 \omega_2 / v_o$",
        "1",
        "rim speed of disk 2 after the impact, clockwise positive, over the speed before",
        -math.inf,
        math.inf,
    ),
    "sqrt_d2_d1": Quantity(
        r"$\sqrt{d_2 / d_1}$",
        "1",
        "square root of the ratio of the stopping distances, taken as v_2 / v_1 (Eq. 29)",
        0.0,
        math.inf,
    ),
    "e_t_apparent": Quantity(
        r"$e_t^*$",
        "1",
        "apparent tangential restitution: slip of the contact after the impact over that before, times -1",
        -math.inf,
        math.inf,
    ),
}
"""The quantities that can be fitted, by the names of their columns."""

COEFFICIENTS = ("e_n", "e_t", "mu", "rho")
"""The order of coefficients in every array of them."""

# At psi = 0 nothing slips, and e_t*, a ratio of slips, has only a limit: this [rad] is as good as 0.
SMALLEST, LARGEST = 1e-7, 0.5 * math.pi - 1e-7
_STEEP = 1e12  # a friction coefficient with which every impact sticks


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The two disks: disk 1 hits disk 2, which is at rest; neither spins.

    Attributes
    ----------
    M : float
        Mass ratio m_1 / m_2 [1].
    k_1, k_2 : float
        Shape numbers in I = m R^2 / k: 2 homogeneous disk, 1 hoop.
    R_1, R_2 : float or None
        Radii [length], needed for rolling friction only.

    Raises
    ------
    InputError
        With a line for each value that is not positive and finite, or if one radius is given alone.

    Examples
    --------
    >>> from ifrdem import fit
    >>> pair = fit.Pair(M=1.0)
    >>> pair.M, pair.k_1
    (1.0, 2.0)
    """

    M: float
    k_1: float = 2.0
    k_2: float = 2.0
    R_1: float | None = None
    R_2: float | None = None

    def __post_init__(self) -> None:
        values = {name: getattr(self, name) for name in ("M", "k_1", "k_2", "R_1", "R_2")}
        wrong = [
            f"{name} = {value}: a positive finite number is needed"
            for name, value in values.items()
            if value is not None and not 0.0 < value < math.inf
        ]
        if (self.R_1 is None) != (self.R_2 is None):
            wrong.append("R_1, R_2: both radii are needed, or none")
        if wrong:
            raise InputError("\n".join(wrong))

    @property
    def has_radii(self) -> bool:
        """Whether the radii are known."""
        return self.R_1 is not None

    @property
    def radii(self) -> tuple[float, float]:
        """R_1 and R_2 [length]; 1 and 1 if unknown, which nothing but rolling friction notices."""
        return (1.0, 1.0) if self.R_1 is None or self.R_2 is None else (self.R_1, self.R_2)

    @property
    def r(self) -> float:
        """2 R_1 R_2 / (R_1 + R_2) [length], below Eq. 32."""
        R_1, R_2 = self.radii
        return 2.0 * R_1 * R_2 / (R_1 + R_2)


@dataclass(frozen=True)
class Model:
    """Predictions for a pair of disks with one kind of sticking.

    Attributes
    ----------
    pair : Pair
        The disks.
    sticking : {"percussion_center", "contact_point"}
        As in `IFRLaw`.
    """

    pair: Pair
    sticking: Sticking

    @cached_property
    def stick(self) -> float:
        """c: the impulse of friction that sticks, over m_n g_t; 1/2 (Eq. 15) or m_t/m_n (Eq. 12)."""
        # At 45 degrees, where g_t = g_n, with e_n = 0 (P_n = m_n g_n) and e_t = -1 (P_t = P_f).
        out = _collide(self, np.array([0.0, -1.0, _STEEP, 0.0]), np.array(0.25 * math.pi))
        return float(out[7] / out[6])

    def predict(self, coefficients: Array, psi: Array, names: Sequence[str]) -> Array:
        """Predicted values.

        Parameters
        ----------
        coefficients : array (..., 4)
            e_n, e_t, mu [1] and rho [length]. They are not examined: a fit has to pass through any values.
        psi : array (...)
            Impact angles [rad], above 0 and below pi/2; its axes broadcast against those of `coefficients`.
        names : sequence of str
            Keys of `MEASURED`.

        Returns
        -------
        array (..., len(names))
            In the order of `names`; angles in degrees.
        """
        v_1n, v_1t, w_1, v_2n, v_2t, w_2, *_ = _collide(self, coefficients, psi)
        R_1, R_2 = self.pair.radii
        given = {
            "delta_1": lambda: np.degrees(np.arctan2(v_1t, v_1n)),
            "delta_2": lambda: np.degrees(np.arctan2(v_2t, v_2n)),
            "Rw_2": lambda: -R_2 * w_2,
            "sqrt_d2_d1": lambda: np.hypot(v_2n, v_2t) / np.hypot(v_1n, v_1t),
            "e_t_apparent": lambda: -(v_1t + R_1 * w_1 - v_2t + R_2 * w_2) / np.sin(psi),
        }
        return np.stack([given[name]() for name in names], axis=-1)

    def tan_transition(self, coefficients: Array) -> Array:
        """tan psi where sliding turns into sticking (Eqs. 24, 25, for any k), of coefficients (..., 4)."""
        return np.asarray(coefficients[..., 2] * (1.0 + coefficients[..., 0]) / self.stick)

    def mu_of_transition(self, e_n: Array, tan_psi: Array) -> Array:
        """The mu whose `tan_transition` is `tan_psi`."""
        return np.asarray(tan_psi * self.stick / (1.0 + e_n))

    def edges(self, coefficients: Array, *, rolling: bool) -> Array:
        """Angles [rad] between which predictions are smooth, ascending: (..., 3), with rolling friction (..., 4).

        The first and the last are `SMALLEST` and `LARGEST`; between them the change from sticking to sliding
        and, with `rolling`, that from nonrolling to rolling (Eqs. 31 and 32 equal).
        """
        inner = [np.arctan(self.tan_transition(coefficients))]
        if rolling:
            rho = coefficients[..., 3]
            m_t = Model(self.pair, "contact_point").stick  # over m_n, by Eq. 12
            inner.append(np.arctan(rho * (1.0 + coefficients[..., 0]) / (self.pair.r * m_t)))
        inside = np.clip(np.sort(np.stack(inner, axis=-1), axis=-1), SMALLEST, LARGEST)
        ends = np.broadcast_to([SMALLEST, LARGEST], (*inside.shape[:-1], 2))
        return np.concatenate([ends[..., :1], inside, ends[..., 1:]], axis=-1)

    def regimes(self, coefficients: Array, psi: Array) -> NDArray[np.int8]:
        """Values of `Regime` at impact angles (n,) [rad] for one set of coefficients (4,)."""
        *_, sticks, rolls = _collide(self, coefficients, psi)
        regime = 1 + np.asarray(sticks, dtype=np.int8)
        if coefficients[3] > 0.0:
            regime = np.where(rolls > 0.0, regime + 2, regime + 4)
        return regime.astype(np.int8)


def _collide(model: Model, coefficients: Array, psi: Array) -> tuple[Array, ...]:
    """The output of `collide_pair` for m_1 = 1, v_o = 1, and the line of centres along x."""
    from ..kernels.law import collide_pair  # imports Taichi, which is slow

    e_n, e_t, mu, rho = (coefficients[..., i] for i in range(4))
    pair, (R_1, R_2) = model.pair, model.pair.radii
    contact_point = float(model.sticking == STICKING[1])
    found: tuple[Array, ...] = collide_pair(
        *(e_n, e_t, mu, contact_point, rho, 1.0, 0.0),
        *(1.0, R_1, pair.k_1, np.cos(psi), np.sin(psi), 0.0),
        *(pair.M, R_2, pair.k_2, 0.0, 0.0, 0.0),  # 1/m_2 = M for m_1 = 1
    )
    return found
