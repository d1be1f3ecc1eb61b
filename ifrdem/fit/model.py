"""Measured quantities as functions of the true motion before an impact: the forward models of `ifrdem.fit`.

Every impact has latent coordinates x, its true motion before, from which a law gives everything that was
measured. The first is the angle of incidence chi at the contact, tan chi = g_t / g_n: at fixed coefficients a
law of friction changes its regime at fixed chi, so that predictions are smooth between these angles in all
coordinates. A table of angles has no other.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.laws.ifr import Regime
from ..tools.checked import FINITE, RATIO, NonNegative, Number, Positive, validated
from .laws import LARGEST, SMALLEST, Law

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOTION = ("vx_1", "vy_1", "spin_1", "vx_2", "vy_2", "spin_2")
"""The motion of two disks, by the names of its columns."""
DIRECTION = "normal"
"""The normal as one quantity, whose errors are in radians."""


class Measurable(NamedTuple):
    """A measured quantity: its symbol in a picture, its unit, "deg" or "1", and the check of its values."""

    symbol: str
    unit: str
    check: Number = replace(FINITE, gaps=True, units=False)


_ANY = Number(-180.0, 180.0, "an angle from -180 to 180 degrees", gaps=True)
_FORWARD = Number(-90.0, 90.0, "an angle from -90 to 90 degrees", gaps=True)
MEASURED: Mapping[str, Measurable] = {
    "delta_1": Measurable(r"$\delta_1$", "deg", _ANY),
    "delta_2": Measurable(r"$\delta_2$", "deg", _FORWARD),
    "Rw_2": Measurable(r"$R_2 \omega_2 / v_o$", "1"),
    "sqrt_d2_d1": Measurable(r"$\sqrt{d_2 / d_1}$", "1", replace(RATIO, gaps=True)),
    "rebound": Measurable(r"$\delta_r$", "deg", _ANY),
    "rebound_contact": Measurable(r"$\delta_c$", "deg", _FORWARD),
    "v_t_ratio": Measurable(r"$v_{1t}'/v_{1t}$", "1"),
    "Rw_1": Measurable(r"$R_1 \omega_1 / v_o$", "1"),
    "e_t_apparent": Measurable(r"$e_t^*$", "1"),
}
"""The quantities that can be fitted, by the names of their columns."""


@validated
@dataclass(frozen=True, kw_only=True)
class Pair:
    """The two disks of a table of angles: disk 1 hits disk 2, which is at rest; neither spins.

    Raises InputError with a line for each value that is not positive and finite, or if one radius is given alone.

    Examples
    --------
    >>> from ifrdem import fit
    >>> pair = fit.Pair(M=1.0)
    >>> pair.M, pair.k_1
    (1.0, 2.0)
    """

    M: NonNegative
    """Mass ratio m_1 / m_2 [1]; 0 for a wall or a fixed disk 2."""
    k_1: Positive = 2.0
    k_2: Positive = 2.0
    """k_1, k_2: shape numbers in I = m R^2 / k: 2 homogeneous disk, 1 hoop."""
    R_1: Positive | None = None
    R_2: Positive | None = None
    """R_1, R_2: radii [length], needed for rolling friction only."""

    def __post_init__(self) -> None:
        if (self.R_1 is None) != (self.R_2 is None):
            raise InputError(f"R_1 = {self.R_1}, R_2 = {self.R_2}: must be both radii, or none")

    @property
    def has_radii(self) -> bool:
        """True if the radii are known."""
        return self.R_1 is not None

    @property
    def radii(self) -> tuple[float, float]:
        """R_1 and R_2 [length]; 1 and 1 if unknown, which nothing but rolling friction notices."""
        return (1.0, 1.0) if self.R_1 is None or self.R_2 is None else (self.R_1, self.R_2)


class RowError(InputError):
    """An error in an impact: its index, and the message."""

    def __init__(self, row: int, text: str) -> None:
        super().__init__(f"row {row + 1}: {text}")
        self.row: int = row
        self.text: str = text


# Error of a known value, over the least one of its kind, and least error over the largest one of its kind in the impact:
# its part of chi2 is 1e-6. True motions that agree with a smaller one lie in a curved valley so narrow that the search
# for the nearest one does not reach its end.
_EXACT = 1e-3


class FitProblem(ABC):
    """Impacts as a fit sees them: n of them, with q quantities and d latent coordinates.

    Attributes
    ----------
    names : tuple of str
        The quantities, of which the first is the angle of impact or the direction of the normal.
    y : array (n, q)
        Measured values, NaN where one is missing.
    white : array (n, q, q)
        W with W^T W the inverse of the covariance; rows of 0 for what is missing. A residual is W (y - h).
    start : array (n, d)
        Latent coordinates by what was measured before the impact.
    spread : array (n,)
        Standard error of the first of them, as far as measured before the impact; infinite if it was not.
    step : array (d,)
        Of a one-sided difference.
    redundancy : array (n,)
        Number of values measured beyond those that the latent coordinates take.
    estimated : tuple of str
        Groups of quantities whose error is estimated from the residuals.
    unknown : array (n, q)
        True for values whose error is.
    """

    start: Array
    spread: Array
    step: Array
    low: float = -LARGEST
    high: float = LARGEST

    def __init__(
        self,
        names: Sequence[str],
        y: Array,
        s: Array,
        groups: Sequence[str],
        covariance: Mapping[tuple[int, int], Array] | None = None,
    ) -> None:
        self.names: tuple[str, ...] = tuple(names)
        self.y: Array = y
        self.groups: tuple[str, ...] = tuple(groups)
        present = ~np.isnan(y)
        unknown = np.isnan(s) & present
        each_group = zip(groups, unknown.T, strict=True)
        self.estimated: tuple[str, ...] = tuple(
            dict.fromkeys(group for group, each in each_group if each.any())
        )
        self.known: NDArray[np.bool_] = present & (s == 0.0)
        self.unknown: NDArray[np.bool_] = unknown
        for group in dict.fromkeys(groups):
            members, guess = [i for i, each in enumerate(groups) if each == group], self.first_guess(group)
            own = np.where(unknown[:, members], guess, s[:, members])  # of any size at first; then `scaled`
            own = np.where(own > 0.0, np.fmax(own, _EXACT * np.fmax.reduce(own, axis=1)[:, None]), own)
            positive = own[own > 0.0]
            least = np.min(positive) if positive.size else 1e-2 * guess
            s[:, members] = np.where(self.known[:, members], _EXACT * least, own)
        self.s: Array = np.where(present, s, np.nan)
        self.white: Array = whitening(self.s, covariance or {}, self.names)
        self.rows: Index = np.arange(len(y))

    @abstractmethod
    def first_guess(self, group: str) -> float:
        """An error to begin with, where it is to be estimated."""

    @abstractmethod
    def motion(self, x: Array, rows: Index) -> tuple[Any, ...]:
        """Arguments of `relative_motion` at latent coordinates (..., m, d) of the impacts `rows` (m,)."""

    @abstractmethod
    def observe(self, x: Array, out: Sequence[Array], motion: Sequence[Array]) -> list[Array]:
        """Values of every quantity, each (..., m)."""

    def predict(self, law: Law, values: Array, x: Array, rows: Index | None = None) -> Array:
        """Values (..., m, q) of all quantities by a law with free coefficients (..., p)."""
        where = self.rows if rows is None else rows
        motion = self.motion(x, where)
        found = self.observe(x, law.collide(values, motion), motion)
        return np.stack(np.broadcast_arrays(*found), axis=-1)

    @abstractmethod
    def probe(self) -> tuple[Any, ...]:
        """A motion of each impact with g_n = g_t = 1."""

    @property
    def speeds(self) -> Array | float:
        """|g| (n,) of the impacts as measured [length/time]; 1 where only ratios are known."""
        return 1.0

    def edges(self, law: Law, values: Array) -> Array:
        """Angles of incidence [rad] between which predictions are smooth, ascending: (..., n, e)."""
        inner = law.transitions(values, self.probe(), self.speeds)
        if self.low < 0.0:
            inner = [*inner, *(-each for each in inner)]
        shape = (*values.shape[:-1], len(self.y))
        low, high = np.full(shape, self.low), np.full(shape, self.high)
        ends = [low, *(np.broadcast_to(each, shape) for each in inner), high]
        return np.clip(np.sort(np.stack(ends, axis=-1), axis=-1), self.low, self.high)

    def regimes(self, law: Law, values: Array, x: Array) -> NDArray[np.int8]:
        """Values of `Regime` at latent coordinates (n, d)."""
        *_, sticks, rolls = law.collide(values, self.motion(x, self.rows))
        regime = 1 + np.asarray(sticks, dtype=np.int8)
        if float(law.full(values).get("rho", np.zeros(1))[0]) > 0.0:
            regime = np.where(rolls > 0.0, regime + 2, regime + 4)
        if not law.has_transition:
            regime = np.full(len(self.y), Regime.SEPARATING)
        elif law.sticking is None:
            chi, (edge, *_) = x[:, 0], law.transitions(values, self.probe(), self.speeds)
            regime = np.where(np.abs(chi) < edge, Regime.STICKING, Regime.SLIDING)
        return np.asarray(regime, dtype=np.int8)

    def take(self, rows: Index) -> FitProblem:
        """Some of the impacts."""
        other = copy.copy(self)
        for name in ("y", "s", "white", "known", "unknown", "start", "spread", "redundancy"):
            setattr(other, name, getattr(self, name)[rows])
        other.rows = np.arange(len(rows))
        return other

    def of(self, y: Array) -> FitProblem:
        """Other measured values (n, q), with the same errors."""
        other = copy.copy(self)
        other.y = np.where(np.isnan(self.y), np.nan, y)
        other.begin()
        return other

    def scaled(self, factors: Mapping[str, float]) -> FitProblem:
        """Errors of groups of quantities multiplied by factors, but for those that are given."""
        other = copy.copy(self)
        by = np.array([factors.get(group, 1.0) for group in self.groups])
        by = np.where(self.unknown | self.known, by, 1.0)
        other.s, other.white = self.s * by, self.white / by[:, None, :]
        other.begin()
        return other

    @abstractmethod
    def begin(self) -> None:
        """Set `start`, `spread` and `step` from values and errors."""

    @abstractmethod
    def at(self, law: Law, values: Array, psi: Array) -> FitProblem:
        """Impacts without error at angles of incidence [rad], otherwise as typical ones of these."""

    def set_redundancy(self, law: Law, values: Array) -> None:
        """Count, by the rank of the derivatives, the values beyond those that latent coordinates take."""
        x = np.clip(self.start, [self.low + 0.1, *[-np.inf] * (self.start.shape[1] - 1)], np.inf)
        slope = self.white @ latent_slope(self, law, values, x, self.rows, np.ones(len(x)))[1]
        scale = np.sqrt(np.sum(slope**2, axis=1, keepdims=True))
        rank = np.linalg.matrix_rank(slope / np.where(scale > 0.0, scale, 1.0), tol=1e-7)
        self.redundancy: Array = np.sum(~np.isnan(self.y), axis=1) - rank


def latent_slope(
    problem: FitProblem, law: Law, values: Array, x: Array, rows: Index, side: Array
) -> tuple[Array, Array]:
    """The prediction (m, q), and its derivatives (m, q, d) by the latent coordinates.

    Differences are one-sided, those of the first coordinate to the side `side` (m,) = +-1.
    """
    d = x.shape[-1]
    steps = np.eye(d)[:, None, :] * problem.step * np.where(np.arange(d) == 0, side[:, None], 1.0)
    f = problem.predict(law, values, np.concatenate([x[None], x + steps]), rows)
    found = (f[1:] - f[0]) / np.sum(steps, axis=-1)[..., None]
    return f[0], np.moveaxis(found, 0, -1)


def whitening(s: Array, covariance: Mapping[tuple[int, int], Array], names: Sequence[str]) -> Array:
    """W (n, q, q) with W^T W the inverse of the covariance, of errors (n, q) and covariances of two columns (n,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(np.isnan(s), 0.0, 1.0 / s)
    white = inverse[..., None] * np.eye(s.shape[1])
    if not covariance:
        return np.asarray(white)
    correlation = np.tile(np.eye(s.shape[1]), (len(s), 1, 1))
    for (a, b), value in covariance.items():
        part = np.nan_to_num(value) * inverse[:, a] * inverse[:, b]
        correlation[:, a, b] = correlation[:, b, a] = part
    least = np.linalg.eigvalsh(correlation)[:, 0]
    if np.any(least <= 1e-9):
        pairs = ", ".join(f"{names[a]} and {names[b]}" for a, b in covariance)
        text = f"covariance of {pairs}: larger than the errors allow, no covariance matrix is so"
        raise RowError(int(np.argmin(least)), text)
    return np.linalg.inv(np.linalg.cholesky(correlation)) @ white


class AngleProblem(FitProblem):
    """A table of angles; the latent coordinate is the true impact angle psi [rad]."""

    low: float = SMALLEST

    def __init__(self, names: Sequence[str], y: Array, s: Array, groups: Sequence[str], pair: Pair) -> None:
        self.pair = pair
        if pair.M == 0.0 and (gone := {"delta_2", "Rw_2", "sqrt_d2_d1"} & set(names)):
            raise InputError(
                f"{', '.join(sorted(gone))}: cannot be combined with a wall (M = 0), which does not move"
            )
        super().__init__(names, y, s, groups)
        self.begin()

    def first_guess(self, group: str) -> float:
        """A degree, or a fiftieth."""
        return 1.0 if group == "angles" else 0.02

    def begin(self) -> None:
        """The measured impact angle."""
        self.start: Array = np.clip(np.radians(self.y[:, :1]), SMALLEST, LARGEST)
        self.spread: Array = np.radians(self.s[:, 0])
        self.step: Array = np.array([1e-6])

    def motion(self, x: Array, rows: Index) -> tuple[Any, ...]:
        """m_1 = 1, v_o = 1, and the line of centres along x."""
        pair, (R_1, R_2), psi = self.pair, self.pair.radii, x[..., 0]
        return (
            *(1.0, 0.0),
            *(1.0, R_1, pair.k_1, np.cos(psi), np.sin(psi), 0.0),
            *(pair.M, R_2, pair.k_2, 0.0, 0.0, 0.0),  # 1/m_2 = M for m_1 = 1
        )

    def probe(self) -> tuple[Any, ...]:
        """At 45 degrees."""
        return self.motion(np.full((1, 1), 0.25 * math.pi), self.rows[:1])

    def observe(self, x: Array, out: Sequence[Array], motion: Sequence[Array]) -> list[Array]:
        """Values of every quantity."""
        v_1n, v_1t, w_1, v_2n, v_2t, w_2, *_ = out
        psi, (R_1, R_2) = x[..., 0], self.pair.radii
        slip = v_1t + R_1 * w_1 - v_2t + R_2 * w_2
        given = {
            "psi": lambda: np.degrees(psi),
            "delta_1": lambda: np.degrees(np.arctan2(v_1t, v_1n)),
            "delta_2": lambda: np.degrees(np.arctan2(v_2t, v_2n)),
            "Rw_2": lambda: -R_2 * w_2,
            "sqrt_d2_d1": lambda: np.hypot(v_2n, v_2t) / np.hypot(v_1n, v_1t),
            "rebound": lambda: np.degrees(np.arctan2(v_1t, -v_1n)),
            "rebound_contact": lambda: np.degrees(np.arctan2(slip, v_2n - v_1n)),
            "v_t_ratio": lambda: v_1t / np.sin(psi),
            "Rw_1": lambda: -R_1 * w_1,
            "e_t_apparent": lambda: -slip / np.sin(psi),
        }
        return [given[name]() for name in self.names]

    def at(self, law: Law, values: Array, psi: Array) -> AngleProblem:
        """Impacts without error at angles of incidence [rad], of the typical errors of these."""
        s = np.broadcast_to(np.nanmedian(self.s, axis=0), (len(psi), len(self.names))).copy()
        blank = AngleProblem(self.names, np.zeros_like(s), s, self.groups, self.pair)
        return AngleProblem(self.names, blank.predict(law, values, psi[:, None]), s, self.groups, self.pair)


class CollisionProblem(FitProblem):
    """Whole collisions; latent coordinates are

    chi, direction of the normal [rad], |g| [length/time], velocity of the centre of mass (2) and both spins;
    of a wall chi, direction of the normal, |g| and the spin of disk 1.
    """

    def __init__(
        self,
        names: Sequence[str],
        y: Array,
        s: Array,
        groups: Sequence[str],
        disks: Sequence[Array],
        wall: Sequence[Array],
        covariance: Mapping[tuple[int, int], Array],
    ) -> None:
        m_1, R_1, k_1, m_2, R_2, k_2 = disks
        self.wall: bool = bool(wall)
        moves = wall if wall else np.zeros((3, len(y)))
        R_2 = R_1 if self.wall else R_2
        self.of_disks: Array = np.stack([1.0 / m_1, R_1, k_1, 1.0 / m_2, R_2, k_2, *moves])
        speeds = np.abs(y[:, [i for i, name in enumerate(names) if name[0] == "v"]])
        self.speed: float = float(np.nanmedian(speeds[speeds > 0.0])) if np.any(speeds > 0.0) else 1.0
        super().__init__(names, y, s, groups, covariance)
        self.begin()

    @property
    def speeds(self) -> Array | float:
        """|g| (n,) of the impacts as measured [length/time]."""
        return np.asarray(self.start[:, 2])

    def first_guess(self, group: str) -> float:
        """A hundredth, of a speed of the table."""
        typical = {"velocities": self.speed, "spins": self.speed / float(np.median(self.of_disks[1]))}
        return 0.01 * typical.get(group, 1.0)

    def take(self, rows: Index) -> FitProblem:
        """Some of the collisions."""
        other = super().take(rows)
        assert isinstance(other, CollisionProblem)
        other.of_disks = self.of_disks[:, rows]
        return other

    def begin(self) -> None:
        """Set starts from the motion before; missing values are taken from after, or are 0."""
        columns = dict(zip(self.names, self.y.T, strict=True))
        errors = dict(zip(self.names, self.s.T, strict=True))
        im_1, R_1, _, im_2, R_2, _, *wall = self.of_disks

        def before(name: str) -> Array:
            value = columns[name]
            return np.nan_to_num(np.where(np.isnan(value), columns[f"{name}_after"], value))

        v_1x, v_1y, w_1 = (before(name) for name in MOTION[:3])
        v_2x, v_2y, w_2 = wall if self.wall else [before(name) for name in MOTION[3:]]
        phi = np.nan_to_num(columns[DIRECTION])
        n_x, n_y = np.cos(phi), np.sin(phi)
        g_n = (v_1x - v_2x) * n_x + (v_1y - v_2y) * n_y
        g_t = (v_1y - v_2y) * n_x - (v_1x - v_2x) * n_y + R_1 * w_1 + R_2 * w_2
        G = np.maximum(np.hypot(g_n, g_t), 1e-6 * self.speed)
        measured = [name for name in (DIRECTION, *MOTION) if name in self.names]
        whole = np.all([~np.isnan(columns[name]) for name in measured], axis=0)
        apart = g_n < -4.0 * np.nan_to_num(errors["vx_1"] + errors["vy_1"]) - 0.05 * G
        self.separating: NDArray[np.bool_] = whole & (apart | ((g_n == 0.0) & (g_t == 0.0)))
        chi = np.clip(np.arctan2(g_t, np.maximum(g_n, 0.05 * G)), -LARGEST, LARGEST)
        share = im_1 / (im_1 + im_2)  # m_2 / (m_1 + m_2)
        if self.wall:
            self.start: Array = np.stack([chi, phi, G, w_1], axis=-1)
        else:
            x, y = v_1x - share * (v_1x - v_2x), v_1y - share * (v_1y - v_2y)
            self.start = np.stack([chi, phi, G, x, y, w_1, w_2], axis=-1)
        lever = {"spin_1": R_1, "spin_2": R_2}
        squares = (
            np.nan_to_num(errors[name], nan=np.inf) ** 2 * lever.get(name, 1.0) ** 2 for name in measured[1:]
        )
        variance = sum(squares)
        self.spread: Array = np.where(whole, np.sqrt(variance) / G + errors[DIRECTION], np.inf)
        spin = self.speed / float(np.median(R_1))
        scale = [1.0, 1.0, self.speed, spin] if self.wall else [1.0, 1.0, *[self.speed] * 3, spin, spin]
        self.step: Array = 1e-6 * np.array(scale)

    def motion(self, x: Array, rows: Index) -> tuple[Any, ...]:
        """n, and each disk's mass, radius, k, velocity and spin before the impact."""
        im_1, R_1, k_1, im_2, R_2, k_2, v_x, v_y, w_2 = self.of_disks[:, rows]
        chi, phi, G = (x[..., i] for i in range(3))
        w_1 = x[..., -1] if self.wall else x[..., 5]
        w_2 = w_2 if self.wall else x[..., 6]
        n_x, n_y = np.cos(phi), np.sin(phi)
        dv_n, dv_t = G * np.cos(chi), G * np.sin(chi) - R_1 * w_1 - R_2 * w_2
        dv_x, dv_y = dv_n * n_x - dv_t * n_y, dv_n * n_y + dv_t * n_x
        if self.wall:
            ends = (v_x + dv_x, v_y + dv_y, v_x, v_y)
        else:
            share = im_1 / (im_1 + im_2)
            X, Y = x[..., 3], x[..., 4]
            ends = (X + share * dv_x, Y + share * dv_y, X - (1.0 - share) * dv_x, Y - (1.0 - share) * dv_y)
        return (n_x, n_y, im_1, R_1, k_1, ends[0], ends[1], w_1, im_2, R_2, k_2, ends[2], ends[3], w_2)

    def probe(self) -> tuple[Any, ...]:
        """g_n = g_t = 1, without spins."""
        one = np.zeros_like(self.start)
        one[:, 0], one[:, 2] = 0.25 * math.pi, math.sqrt(2.0)
        return self.motion(one, self.rows)

    def observe(self, x: Array, out: Sequence[Array], motion: Sequence[Array]) -> list[Array]:
        """Direction of the normal, motion before and after."""
        before = (*motion[5:8], *(() if self.wall else motion[11:14]))
        return [x[..., 1], *before, *out[: len(before)]]

    def at(self, law: Law, values: Array, psi: Array) -> CollisionProblem:
        """Collisions without error at angles of incidence [rad], otherwise as a typical one of these."""
        fullest = int(np.argmax(np.sum(~np.isnan(self.y), axis=1)))
        other = self.take(np.full(len(psi), fullest))
        assert isinstance(other, CollisionProblem)
        x = other.start.copy()
        x[:, 0], x[:, 2] = psi, np.median(self.start[:, 2])
        present = ~np.isnan(other.y)
        other.s = np.where(present, np.nanmedian(self.s, axis=0), np.nan)
        other.white = whitening(other.s, {}, self.names)
        other.y = np.where(present, other.predict(law, values, x), np.nan)
        other.begin()
        return other
