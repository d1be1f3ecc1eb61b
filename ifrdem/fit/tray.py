"""Estimate of the law by which a tray slows disks down, from all flights of a film.

Each piece of a flight has an unknown place, velocity, angle and spin at its first frame; the constants of the law are
common to all. The unknowns of pieces are eliminated from every Gauss-Newton step (G. H. Golub and V. Pereyra, SIAM J.
Numer. Anal. 10, 413 (1973), doi:10.1137/0710036). Frames have Student-t weights, and a piece that no law fits, because
it holds an impact that was not found, counts less. Errors come from the scatter of the gradients of pieces
(H. White, Econometrica 50, 1 (1982), doi:10.2307/1912526), and are never less than those of the frames alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ..model.gravity import EARTH
from .flight import LAWS, Tray

Array = NDArray[np.float64]

LEAST_FRAMES = 6
"""Frames of a piece that are needed at least."""
LONGEST = 0.5
"""Time that a piece lasts at most; longer flights are several pieces [s]."""
DIFFER = 1e-3
"""Probability of chance below which differences between places, times and kinds of disks count."""
BAD_FIT = 1.3
"""chi-square per degree of freedom of flights from which no law fits them."""

_NU = 4.0  # degrees of freedom of the Student-t noise
_MOST = 300  # pieces that are used
_KEEP = 4.0  # errors from which a constant is kept
_TILT_KEEP = 20.8  # chi-square of gx and gy together from which they are kept: 4 errors of one constant
_NEGATIVE = 6.0  # errors from which a constant is kept though it is negative
_FLAT = 1e-3  # probability of places of a disk at rest below which it moves
_MOST_FITTED = 0.95  # of the flights that another law fits
_TURNS = 15
_UNITS = {"a0": " m/s2", "a1": "/s |v|", "b0": " rad/s2", "b1": "/s |w|"}


@dataclass(frozen=True, eq=False)
class Piece:
    """Frames of one flight, without gaps."""

    tau: Array  # (n,): times from the first frame on
    x: Array  # (n, 2): positions [length]
    angle: Array | None  # (n,): angles [rad]
    sigma: Array  # (2,): errors of positions
    sigma_angle: float
    R: float
    k: float
    group: Mapping[str, int] = field(
        default_factory=dict
    )  # kind of disk, quarter of the tray, third of the film

    @property
    def rests(self) -> bool:
        """True if neither the place nor the angle changes."""
        turned = (
            np.zeros((len(self.tau), 0)) if self.angle is None else self.angle[:, None] / self.sigma_angle
        )
        return all(frames_at_rest(x) == len(self.tau) for x in (self.x / self.sigma, turned))


@dataclass(frozen=True, eq=False)
class TrayEstimate:
    """A law of flight, and how well the flights determine it."""

    tray: Tray
    names: tuple[str, ...]  # constants that differ from 0
    covariance: Array  # (names, names)
    pieces: int
    chi2: float
    dof: int
    straight_chi2: float  # of straight flights through the same frames
    losses: Array  # of each piece, Student-t
    good: NDArray[np.bool_]  # pieces that the law fits, of which `chi2` is
    tested: Mapping[str, float]  # probability that a constant is 0, by name; "tilt" of both
    slowing: tuple[float, float]  # mean deceleration of the flights, and its error [length/time^2]
    differences: Mapping[str, float] = field(
        default_factory=dict
    )  # probability that groups differ by chance only

    def error(self, name: str) -> float:
        """Standard error of a constant; 0 of one that is not used."""
        if name not in self.names:
            return 0.0
        i = self.names.index(name)
        return math.sqrt(float(self.covariance[i, i]))

    @property
    def fits(self) -> bool:
        """True if the law describes the flights."""
        return self.chi2 <= BAD_FIT * max(self.dof, 1)

    def text(self) -> str:
        """A line on the tray."""
        fit = f"{self.pieces} flights, chi2 {self.chi2:.0f} for {self.dof}"
        if not self.names:
            bound = abs(self.slowing[0]) + _KEEP * self.slowing[1]
            return (
                f"flights are straight: no constant of the tray differs from 0 by {_KEEP:g} errors; "
                f"they slow down by less than {bound:.2g} m/s2 ({fit})"
            )
        tray, value = (
            self.tray,
            {name: _with_error(getattr(self.tray, name), self.error(name)) for name in self.names},
        )
        parts = []
        if tray.coupled:
            contact = "on their faces" if tray.law == "coin" else "on their edges"
            parts.append(f"coins slide and spin {contact} with mu g = {value['a0']} m/s2")
        else:
            for names, of in ((("a0", "a1"), "flights slow down by"), (("b0", "b1"), "spins by")):
                law = " + ".join(f"({value[name]}){_UNITS[name]}" for name in names if name in value)
                parts += [f"{of} {law}"] * bool(law)
        if "gx" in value:
            mrad = 1e3 * math.hypot(tray.gx, tray.gy) / EARTH
            parts.append(f"the tray is tilted: g = ({value['gx']}, {value['gy']}) m/s2, {mrad:.3g} mrad")
        return f"{'; '.join(parts)} ({fit}; straight flights without slowing: chi2 {self.straight_chi2:.4g})"

    def warnings(self) -> list[str]:
        """Warnings on effects that the law leaves out."""
        found = [
            f"flights differ by {what} (p = {p:.2g}): the law of the tray is a mean"
            for what, p in self.differences.items()
            if p < DIFFER
        ]
        if not self.fits:
            text = "no law of the tray fits the flights"
            found.append(f"{text} (chi2 {self.chi2:.0f} for {self.dof}): velocities and spins may be wrong")
        return found


def _with_error(value: float, error: float) -> str:
    """A value to the second digit of its error."""
    digits = max(0, 1 - math.floor(math.log10(error))) if error > 0.0 else 4
    return f"{value:.{min(digits, 9)}f} +- {error:.2g}"


def estimate(pieces: Sequence[Piece], law: str = "estimate") -> TrayEstimate:
    """The law of flight of some pieces by maximum likelihood; constants that do not differ from 0 are left out.

    `law` is one of `flight.LAWS`, or "estimate": plain, and if that slows disks down and angles are known each coupled
    law, of which the one with the least loss is chosen.
    """
    moving = [each for each in pieces if not each.rests] or pieces  # a disk at rest tells nothing
    longest = sorted(moving, key=lambda each: -float(each.tau[-1]) * len(each.tau) ** 0.5)[:_MOST]
    fit = _Fit(longest)
    spins = any(each.angle is not None for each in longest)
    found: list[TrayEstimate] = []
    if law in ("estimate", "plain"):
        names = [name for name in LAWS["plain"] if spins or name[0] != "b"]
        found.append(fit.selected(Tray(), names))
    slowed = law != "estimate" or (found[0].tray.a0 > 0.0 and "a0" in found[0].names)
    guess = max(found[0].tray.a0, 1e-6) if found and slowed else fit.deceleration()
    for coupled in (name for name in LAWS if name != "plain" and law in ("estimate", name)):
        if spins and slowed:
            found.append(fit.selected(Tray(law=coupled, a0=guess), LAWS[coupled]))
    # Of flights that hold an impact no law is right or wrong. A law that fits far fewer flights than others is wrong.
    most = max(int(np.sum(each.good)) for each in found)
    fair = [each for each in found if np.sum(each.good) > _MOST_FITTED * most]
    by_all = np.all([each.good for each in fair], axis=0)
    best = min(fair, key=lambda each: float(np.sum(each.losses[by_all])) + 2.0 * len(each.names))
    fit.fitted(best.tray, best.names)
    differences = fit.differences(best.names)
    straight = float(np.sum(fit.fitted(Tray(), ()).squares[best.good]))
    return replace(best, straight_chi2=straight, differences=differences)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The end of a search."""

    tray: Tray
    covariance: Array
    losses: Array
    squares: Array
    good: NDArray[np.bool_]


class _Fit:
    """The sum over pieces, all in one array."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = pieces
        n = max(len(each.tau) for each in pieces)
        self.tau, self.y, self.mask = (np.zeros((len(pieces), n, *rest)) for rest in ((), (3,), (3,)))
        sigma = np.array([[*each.sigma, each.sigma_angle] for each in pieces])
        self.sigma = np.where(np.isfinite(sigma), sigma, 1.0)
        self.R, self.k = np.array([[each.R] for each in pieces]), np.array([each.k for each in pieces])
        self.local = np.zeros((len(pieces), 6))  # x, y, v_x, v_y, angle, spin at the first frame
        for i, each in enumerate(pieces):
            m = len(each.tau)
            self.tau[i, :m], self.tau[i, m:] = each.tau, each.tau[-1]
            self.y[i, :m, :2], self.mask[i, :m, :2] = each.x, 1.0
            if each.angle is not None:
                self.y[i, :m, 2], self.mask[i, :m, 2] = each.angle, 1.0
            line = np.polyfit(each.tau[: min(m, 8)], self.y[i, : min(m, 8)], 1)
            self.local[i] = [*line[1, :2], *line[0, :2], line[1, 2], line[0, 2]]
        self.turned = self.mask[:, 0, 2] > 0.0
        self.dof = np.sum(self.mask, axis=(1, 2)) - np.where(self.turned, 6, 4)
        self.length, self.turn = np.median(self.sigma[:, :2]), np.median(self.sigma[:, 2])
        self.time = float(np.median(self.tau[:, -1]))
        self.gradients, self.informations = np.zeros((len(pieces), 0)), np.zeros((len(pieces), 0, 0))

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Steps of differences by constants, of a hundredth of an error of a flight."""
        a, b, rate = self.length / self.time**2, self.turn / self.time**2, 1.0 / self.time
        return {
            "a0": 1e-2 * a,
            "a1": 1e-3 * rate,
            "b0": 1e-2 * b,
            "b1": 1e-3 * rate,
            "gx": 1e-2 * a,
            "gy": 1e-2 * a,
        }

    def deceleration(self) -> float:
        """A first guess: the mean deceleration along the flights."""
        found = self.fitted(Tray(), ("a0",)).tray.a0
        return max(found, float(1e-2 * self.length / self.time**2))

    def _model(self, tray: Tray, p: Array) -> Array:
        moved, turned = tray.flight(self.tau, p[:, 2:4], p[:, 5], self.R, self.k)
        return np.concatenate([p[:, None, :2] + moved, (p[:, 4:5] + turned)[..., None]], axis=2)

    def _system(self, tray: Tray, names: Sequence[str]) -> tuple[Array, Array]:
        """Residuals (P, n, 3) in units of their errors, and their derivatives (P, n, 3, 6 + constants)."""
        p, base = self.local, self._model(tray, self.local)
        scale = self.mask / self.sigma[:, None]
        J = np.zeros((*base.shape, 6 + len(names)))
        for c, own in enumerate((0, 1, 4)):
            J[:, :, c, own] = -scale[..., c]
        speed = 1e-4 * np.hypot(p[:, 2], p[:, 3]) + 1e-2 * self.length / self.time
        for c, h in ((2, speed), (3, speed), (5, 1e-4 * np.abs(p[:, 5]) + 1e-2 * self.turn / self.time)):
            q = p.copy()
            q[:, c] += h
            J[..., c] = -(self._model(tray, q) - base) / h[:, None, None] * scale
        for i, name in enumerate(names):
            value = getattr(tray, name)
            h = self.sizes[name] + 1e-4 * abs(value)
            J[..., 6 + i] = -(self._model(tray.changed({name: value + h}), p) - base) / h * scale
        return (self.y - base) * scale, J

    def fitted(self, start: Tray, names: Sequence[str]) -> _Fitted:
        """The constants of these names and the motion of all pieces; others stay as they are."""
        T, tray, covariance = len(names), start, np.zeros((len(names),) * 2)
        for turn in range(_TURNS):
            r, J = self._system(tray, names)
            far = np.sum(r[..., :2] ** 2, axis=2)
            losses = (_NU + 2.0) * np.log1p(far / _NU) + (_NU + 1.0) * np.log1p(r[..., 2] ** 2 / _NU)
            weight = self.mask.copy()
            weight[..., :2] *= ((_NU + 2.0) / (_NU + far))[..., None]
            weight[..., 2] *= (_NU + 1.0) / (_NU + r[..., 2] ** 2)
            squares = np.sum(r**2, axis=(1, 2))
            if turn > 1:  # at first no piece fits
                fair = self.dof + 4.0 * np.sqrt(2.0 * self.dof)
                weight *= np.minimum(1.0, fair / np.maximum(squares, 1e-9))[:, None, None]
            flat, root = J.reshape(len(J), -1, 6 + T), weight.reshape(len(J), -1, 1)
            H = np.swapaxes(flat, 1, 2) @ (flat * root)
            g = np.sum(flat * root * r.reshape(len(J), -1, 1), axis=1)
            unit, A, B, D = _parts(H)
            to_local = g[:, :6] / unit
            solved = np.linalg.solve(A, np.concatenate([B, to_local[..., None]], axis=2))
            each_S = D - np.swapaxes(B, 1, 2) @ solved[:, :, :T]
            each = g[:, 6:] - np.einsum("pij,pi->pj", B, solved[:, :, T])
            S = np.sum(each_S, axis=0)
            inverse = _inverse(S)
            step = -inverse @ np.sum(each, axis=0)
            local = -(solved[:, :, T] + solved[:, :, :T] @ step)
            size = float(step @ S @ step) + float(np.max(np.einsum("pi,pij,pj->p", local, A, local)))
            self.local = self.local + local / unit
            self.gradients, self.informations = each, each_S
            if T:
                covariance = _no_less(inverse @ (each.T @ each) @ inverse, inverse)
                moved = {name: float(getattr(tray, name) + s) for name, s in zip(names, step, strict=True)}
                if tray.law != "plain":  # without friction there is no such law
                    moved["a0"] = max(moved.get("a0", tray.a0), 0.2 * tray.a0)
                tray = tray.changed(moved)
            if turn > 2 and size < 1e-2:
                break
        good = squares < self.dof + 6.0 * np.sqrt(2.0 * self.dof) + 10.0
        return _Fitted(tray, covariance, np.sum(losses, axis=1), squares, good)

    def selected(self, start: Tray, names: Sequence[str]) -> TrayEstimate:
        """All constants of these names, without those that do not differ from 0, the least one first."""
        left, tray, tested = [*names], start, dict[str, float]()
        while True:
            end = self.fitted(tray, left)
            tray, z = end.tray, dict[str, float]()
            for i, name in enumerate(left):
                if name in ("gx", "gy"):
                    both = [left.index("gx"), left.index("gy")]
                    g = np.array([tray.gx, tray.gy])
                    square = float(g @ _inverse(end.covariance[np.ix_(both, both)]) @ g)
                    z[name] = _KEEP * math.sqrt(square / _TILT_KEEP)
                    tested.setdefault("tilt", float(chdtrc(2, square)))
                    continue
                variance = float(end.covariance[i, i])  # 0 of a constant that no flight determines
                z[name] = abs(getattr(tray, name)) / math.sqrt(variance) if variance > 0.0 else 0.0
                tested.setdefault(name, float(chdtrc(1, z[name] ** 2)))
                if getattr(tray, name) < 0.0 and z[name] < _NEGATIVE:
                    z[name] = 0.0
            weakest = min(z, key=lambda name: z[name], default=None)
            if weakest is None or z[weakest] >= _KEEP:
                slowing = self.slowing(tray, left, end.covariance)
                good, squares = end.good, end.squares
                return TrayEstimate(
                    tray, tuple(left), end.covariance, int(np.sum(good)), float(np.sum(squares[good])),
                    int(np.sum(self.dof[good])), math.nan, end.losses, good, tested, slowing,
                )  # fmt: skip
            gone = ("gx", "gy") if weakest in ("gx", "gy") else (weakest,)
            left = [name for name in left if name not in gone]
            if weakest == "a0" and tray.law != "plain":
                left, tray = [], Tray()
            tray = tray.changed(dict.fromkeys(gone, 0.0))

    def slowing(self, tray: Tray, names: Sequence[str], covariance: Array) -> tuple[float, float]:
        """Mean deceleration of the flights [length/time^2], and its error.

        That of a constant deceleration, or of slow or of fast flights if it is larger.
        """
        _, J = self._system(tray, ("a0",))
        flat = J.reshape(len(J), -1, 7)
        _, A, B, D = _parts(np.swapaxes(flat, 1, 2) @ flat)
        S = D[:, 0, 0] - np.einsum("pi,pi->p", B[..., 0], np.linalg.solve(A, B)[..., 0])
        speeds, rims = np.hypot(self.local[:, 2], self.local[:, 3]), self.R[:, 0] * np.abs(self.local[:, 5])
        each = [tray.braking(v, u) for v, u in zip(speeds.tolist(), rims.tolist(), strict=True)]
        error = 1.0 / math.sqrt(max(float(np.sum(S)), 1e-300))
        for v in np.quantile(speeds, [0.1, 0.9]).tolist():
            by = np.array([{"a0": 1.0, "a1": v}.get(name, 0.0) for name in names])
            error = max(error, math.sqrt(float(by @ covariance @ by)))
        return float(np.mean(each)), error

    def differences(self, names: Sequence[str]) -> dict[str, float]:
        """Probability that the constants of groups of pieces differ so much by chance, for each way of grouping.

        By one step from the common constants, with the covariance of each group.
        """
        found = {}
        for what in dict.fromkeys(what for each in self.pieces for what in each.group) if names else ():
            of = np.array([each.group.get(what, -1) for each in self.pieces])
            steps, information = [], []
            for one in np.unique(of[of >= 0]):
                some = of == one
                if np.sum(some) < 12:  # too few for their scatter
                    continue
                g, inverse = self.gradients[some], _inverse(np.sum(self.informations[some], axis=0))
                steps.append(-inverse @ np.sum(g, axis=0))
                information.append(_inverse(_no_less(inverse @ (g.T @ g) @ inverse, inverse)))
            if len(steps) < 2:
                continue
            total = _inverse(np.sum(information, axis=0))
            mean = total @ np.sum([w @ each for w, each in zip(information, steps, strict=True)], axis=0)
            square = sum(float((d - mean) @ w @ (d - mean)) for w, d in zip(information, steps, strict=True))
            found[what] = float(chdtrc(len(names) * (len(steps) - 1), square))
        return found


def _parts(H: Array) -> tuple[Array, Array, Array, Array]:
    """Units (P, 6) of the unknowns of pieces, and blocks of H (P, 6 + T, 6 + T) in them: own, mixed, of constants."""
    own = np.arange(6)
    unit = np.sqrt(H[:, own, own])
    unit = np.where(unit > 0.0, unit, 1.0)
    A = H[:, :6, :6] / unit[:, :, None] / unit[:, None, :]
    A[:, own, own] += 1e-6 + (A[:, own, own] == 0.0)
    return unit, A, H[:, :6, 6:] / unit[:, :, None], H[:, 6:, 6:]


def frames_at_rest(x: Array) -> int:
    """Number of frames, from the first on, in which x (n, d), in units of its errors, keeps its value; NaN is passed."""
    good = np.flatnonzero(~np.isnan(x).any(axis=1))
    if not len(good):
        return 0
    from_first = x[good] - x[good[0]]
    n = np.arange(1, len(good) + 1)
    about = np.cumsum(np.sum(from_first**2, axis=1)) - np.sum(np.cumsum(from_first, axis=0) ** 2, axis=1) / n
    moves = chdtrc(np.maximum((n - 1) * x.shape[1], 1), about) < _FLAT
    return int(good[np.argmax(moves)]) if moves.any() else len(x)


def _inverse(symmetric: Array) -> Array:
    """Inverse, without the directions in which there is none."""
    if not len(symmetric):
        return np.zeros((0, 0))
    unit = np.sqrt(np.abs(np.diag(symmetric)))
    unit = np.where(unit > 0.0, unit, 1.0)
    return np.asarray(
        np.linalg.pinv(symmetric / np.outer(unit, unit), rcond=1e-10, hermitian=True)
    ) / np.outer(unit, unit)


def _no_less(covariance: Array, least: Array) -> Array:
    """A covariance with variances of at least those of another one: of few pieces the scatter is known badly."""
    by = np.sqrt(np.maximum(1.0, np.diag(least) / np.maximum(np.diag(covariance), 1e-300)))
    return np.asarray(covariance * np.outer(by, by))
