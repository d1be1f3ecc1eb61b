"""Tracks of disks in a walled tray, as a camera sees them; no code of the engine, nor of `ifrdem.fit`.

Impacts follow the law of the paper with the percussion centre (Eqs. 5, 8, 9, 15), written out here. Flights are
straight, or slowed down by a `Tray` in small kicks: half a kick, flight with impacts event by event, half a kick.
`film` adds what spoils a video: noise, lost frames, exchanged ids, a picture that drifts; `clips` joins short films.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipe, ellipk

Array = NDArray[np.float64]

TRAY = (0.8, 0.6)
MASS, RADIUS = (0.030, 0.020), (0.025, 0.020)  # of the two materials A and B [kg, m]
# e_n, e_t, mu of A on A, A on B, B on B, and of each on the wall
PAIR = {(0, 0): (0.87, -0.88, 0.21), (0, 1): (0.80, -0.95, 0.15), (1, 1): (0.70, -0.98, 0.11)}
WALL = (0.90, -0.90, 0.20)
SIDES = (((1.0, 0.0), TRAY[0]), ((-1.0, 0.0), 0.0), ((0.0, 1.0), TRAY[1]), ((0.0, -1.0), 0.0))


@dataclass(frozen=True)
class Impact:
    """A true impact: of disks i and j, or of i with a side of the tray if j < 0."""

    t: float
    i: int
    j: int
    before: Array  # (2, 3): vx, vy, spin of both
    after: Array


@dataclass(frozen=True)
class Motion:
    """A true motion: positions and angles (f, n, 3) at the times (f,), and its impacts."""

    t: Array
    place: Array
    material: NDArray[np.int64]
    impacts: list[Impact]
    fps: float
    clip: NDArray[np.int64]  # (f,): from 0


@dataclass(frozen=True)
class Tray:
    """Law of deceleration of disks: dv/dt = -(a0 + a1 |v|) v/|v| + g, dw/dt = -(b0 + b1 |w|) sign(w), to rest.

    `face` or `ring` instead couples both motions: Coulomb friction a0 = mu g, spread evenly over the face of a disk
    (Farkas et al. 2003), or over its rim. `slippery` multiplies a0 of material B.
    """

    a0: float = 0.0
    a1: float = 0.0
    b0: float = 0.0
    b1: float = 0.0
    g: tuple[float, float] = (0.0, 0.0)
    contact: str = "point"
    slippery: float = 1.0

    def kick(
        self, v: Array, w: Array, R: Array, material: NDArray[np.int64], dt: float
    ) -> tuple[Array, Array]:
        """Velocities (n, 2) and spins (n,) after a time dt."""
        a0 = self.a0 * np.where(material == 1, self.slippery, 1.0)
        v = v + np.array(self.g) * dt
        speed = np.hypot(*v.T)
        if self.contact == "point":
            slower = np.maximum(speed - (a0 + self.a1 * speed) * dt, 0.0)
            spin = np.sign(w) * np.maximum(np.abs(w) - (self.b0 + self.b1 * np.abs(w)) * dt, 0.0)
        else:
            rim = R * np.abs(w)
            moves = speed + rim > 2.0 * a0 * dt
            # the middle of the step, so that the error is of third order in dt
            theta, F_of, T_of = of_contact(self.contact)
            F, T = (np.interp(np.arctan2(speed, rim), theta, each) for each in (F_of, T_of))
            angle = np.arctan2(np.maximum(speed - 0.5 * a0 * dt * F, 0.0), np.maximum(rim - a0 * dt * T, 0.0))
            F, T = (np.interp(angle, theta, each) for each in (F_of, T_of))
            slower = np.where(moves, np.maximum(speed - a0 * dt * F, 0.0), 0.0)
            spin = np.where(moves, np.sign(w) * np.maximum(rim - 2.0 * a0 * dt * T, 0.0) / R, 0.0)
        return v * np.where(speed > 0.0, slower / np.where(speed > 0.0, speed, 1.0), 0.0)[:, None], spin


@functools.cache
def of_contact(contact: str) -> tuple[Array, Array, Array]:
    """Angles atan2(v, u), and `slip` there; 2,000 of them, so that straight lines between them err by 1e-6."""
    theta = np.linspace(0.0, 0.5 * np.pi, 2000)
    return theta, *slip(np.sin(theta), np.cos(theta), contact)


def slip(v: Array, u: Array, contact: str) -> tuple[Array, Array]:
    """Force over mu m g and torque over mu m g R of disks that move at v and whose rims turn at u, of k = 2.

    A ring of radius r has the parts -dD/dv and -dD/du of D = 2/pi (v + u) E(4 v u / (v + u)^2), the mean speed on it;
    the face is the mean of rings over its area, here by a rule of Gauss.
    """
    if contact == "face":
        nodes, weights = np.polynomial.legendre.leggauss(24)
        r2 = 0.5 * (nodes + 1.0)  # even in the area, r^2
        parts = [slip(v, np.sqrt(each) * u, "ring") for each in r2]
        F = sum(0.5 * weight * part[0] for weight, part in zip(weights, parts, strict=True))
        T = sum(0.5 * w * np.sqrt(each) * part[1] for w, each, part in zip(weights, r2, parts, strict=True))
        return np.asarray(F), np.asarray(T)
    both = np.where(v + u > 0.0, v + u, 1.0)
    m = np.minimum(4.0 * v * u / both**2, 1.0 - 1e-14)
    K, E = ellipk(m), ellipe(m)
    # dE/dm = (E - K)/(2 m), and (E - K)/m = -pi/4 (1 + 3 m/8 + 15 m^2/64) where it loses its digits
    by_m = np.where(
        m > 1e-3, (E - K) / np.where(m > 1e-3, m, 1.0), -np.pi / 4.0 * (1.0 + 0.375 * m + 15.0 / 64.0 * m**2)
    )
    F = 2.0 / np.pi * (E + by_m * 2.0 * u * (u - v) / both**2)
    T = 2.0 / np.pi * (E + by_m * 2.0 * v * (v - u) / both**2)
    return F, T


def collide(law: tuple[float, float, float], n: Array, m: Array, R: Array, v: Array, w: Array) -> None:
    """Change velocities (2, 2) and spins (2,) of homogeneous disks; an infinite mass is a wall."""
    e_n, e_t, mu = law
    t = np.array([-n[1], n[0]])
    g = v[0] - v[1] + (R[0] * w[0] + R[1] * w[1]) * t
    g_n, g_t = g @ n, g @ t
    m_n = 1.0 / np.sum(1.0 / m)
    P_n = (1.0 + e_n) * m_n * g_n
    P_t = (1.0 + e_t) * m_n / 3.0 * g_t + np.sign(g_t) * min(mu * P_n, 0.5 * m_n * abs(g_t))
    v -= np.array([1.0, -1.0])[:, None] * (P_n * n + P_t * t) / m[:, None]
    w -= 2.0 * P_t / (m * R)


def simulate(
    fps: float,
    duration: float,
    seed: int,
    number: int = 20,
    speed: float = 0.6,
    *,
    spin: float = 8.0,
    tray: Tray | None = None,
    resting: int = 0,
) -> Motion:
    """Disks of two materials from a grid; event by event, all pairs looked at.

    `speed` and `spin` are standard deviations [m/s, rad/s], but 0 of the first `resting` disks.
    """
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(5), np.arange(4)), axis=-1).reshape(-1, 2)
    x = (grid[rng.permutation(20)[:number]] + 0.5) * np.array(TRAY) / [5, 4]
    x += rng.uniform(-0.02, 0.02, x.shape)
    v, w, angle = rng.normal(0.0, speed, (number, 2)), rng.normal(0.0, spin, number), np.zeros(number)
    v[:resting], w[:resting] = 0.0, 0.0
    material = np.arange(number) % 2
    m, R = np.array(MASS)[material], np.array(RADIUS)[material]
    a, b = np.triu_indices(number, 1)
    frames = np.arange(0.0, duration, 1.0 / fps)
    shown, now = np.empty((len(frames), number, 3)), 0.0
    impacts: list[Impact] = []
    next_frame, kicks, step = 0, 0, np.inf if tray is None else 0.05 / fps
    if tray is not None:
        v, w = tray.kick(v, w, R, material, 0.5 * step)
    while True:
        d, u, s = x[b] - x[a], v[b] - v[a], R[a] + R[b]
        du, uu = np.sum(d * u, 1), np.sum(u * u, 1)
        root = du**2 - uu * (np.sum(d * d, 1) - s**2)
        meets = (du < 0.0) & (root > 0.0)
        wait = np.where(
            meets, (-du - np.sqrt(np.where(meets, root, 0.0))) / np.where(uu > 0.0, uu, 1.0), np.inf
        )
        sides = np.stack([(at - R - x @ n) / np.where(v @ n > 0.0, v @ n, np.nan) for n, at in SIDES])
        sides = np.where(np.isnan(sides), np.inf, sides)
        first = float(min(wait.min(), sides.min()))
        to_kick = (kicks + 1) * step - now
        dt = max(min(first, to_kick), 0.0)
        while next_frame < len(frames) and frames[next_frame] <= now + dt + (0.0 if tray is None else 1e-9):
            ahead = frames[next_frame] - now
            shown[next_frame] = np.column_stack([x + ahead * v, angle + ahead * w])
            next_frame += 1
        if next_frame == len(frames):
            return Motion(frames, shown, material, impacts, fps, np.zeros(len(frames), dtype=np.int64))
        x, angle, now = x + dt * v, angle + dt * w, now + dt
        if tray is not None and to_kick <= first:
            v, w = tray.kick(v, w, R, material, step)
            kicks, now = kicks + 1, (kicks + 1) * step
            continue
        if wait.min() <= sides.min():
            k = int(np.argmin(wait))
            i, j = int(a[k]), int(b[k])
            n = (x[j] - x[i]) / np.hypot(*(x[j] - x[i]))
            both, law = [i, j], PAIR[min(material[i], material[j]), max(material[i], material[j])]
            v_, w_, m_, R_ = v[both], w[both], m[both], R[both]
        else:
            side, i = divmod(int(np.argmin(sides)), number)
            n, j, law = np.array(SIDES[side][0]), -1 - side, WALL
            both = [i]
            v_, w_ = np.stack([v[i], np.zeros(2)]), np.array([w[i], 0.0])
            m_, R_ = np.array([m[i], np.inf]), np.array([R[i], 1.0])
        before = np.column_stack([v_, w_])
        collide(law, n, m_, R_, v_, w_)
        impacts.append(Impact(now, i, j, before, np.column_stack([v_, w_])))
        v[both], w[both] = v_[: len(both)], w_[: len(both)]


def clips(motions: Sequence[Motion], gap: float) -> Motion:
    """One film of several, one after the other; `gap` is the time between them [s], a number of frames."""
    t, impacts, clip, start = [], [], [], 0.0
    for i, each in enumerate(motions):
        t.append(each.t + start)
        clip.append(np.full(len(each.t), i))
        impacts += [Impact(hit.t + start, hit.i, hit.j, hit.before, hit.after) for hit in each.impacts]
        start += float(each.t[-1]) + gap
    place = np.concatenate([each.place for each in motions])
    one = motions[0]
    return Motion(np.concatenate(t), place, one.material, impacts, one.fps, np.concatenate(clip))


def film(
    motion: Motion,
    seed: int,
    *,
    noise: float = 3e-4,
    angle_noise: float = np.radians(1.0),
    lost: float = 0.0,
    swaps: int = 0,
    drift: float = 0.0,
    scale: float = 1.0,
    y_sign: float = 1.0,
    numbered: bool = False,
) -> str:
    """A CSV file of the frames: frame, id, x, y, angle [rad], with noise [m, rad].

    `lost` is the part of positions that are missing, `swaps` the number of pairs that exchange their ids where they
    meet, `drift` a velocity of the picture along x [m/s], `scale` the unit of positions per metre. `numbered` adds a column
    clip, in each of which frames begin from 0.
    """
    rng = np.random.default_rng(seed)
    place = motion.place.copy()
    pairs = [each for each in motion.impacts if each.j >= 0 and motion.t[3] < each.t < motion.t[-4]]
    for each in rng.permutation(np.array(pairs, dtype=object))[:swaps]:
        from_here = motion.t > each.t
        place[np.ix_(from_here, [each.i, each.j])] = place[np.ix_(from_here, [each.j, each.i])]
    place[..., 0] += drift * motion.t[:, None]
    place[..., :2] += noise * rng.standard_normal(place[..., :2].shape)
    place[..., 2] += angle_noise * rng.standard_normal(place.shape[:2])
    place[..., 2] = (place[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    place *= [scale, y_sign * scale, 1.0]
    visible = rng.random(place.shape[:2]) >= lost
    frame = np.rint(motion.t * motion.fps).astype(int)
    ends = [""] * len(frame)
    if numbered:
        frame -= frame[np.searchsorted(motion.clip, motion.clip)]
        ends = [f",{clip}" for clip in motion.clip]
    lines = [
        f"{frame[f]},{i},{x:.6g},{y:.6g},{angle:.5f}{ends[f]}"
        for f, row in enumerate(place)
        for i, (x, y, angle) in enumerate(row)
        if visible[f, i]
    ]
    return "frame,id,x,y,angle (rad)" + ",clip" * numbered + "\n" + "\n".join(lines) + "\n"
