"""Tracks of disks in a walled tray, as a camera sees them; no code of the engine.

Flights are straight, impacts follow the law of the paper with the percussion centre (Eqs. 5, 8, 9, 15), written out
here. `film` adds what spoils a video: noise, lost frames, exchanged ids, a picture that drifts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


def simulate(fps: float, duration: float, seed: int, number: int = 20, speed: float = 0.6) -> Motion:
    """Disks of two materials from a grid; event by event, all pairs looked at."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(5), np.arange(4)), axis=-1).reshape(-1, 2)
    x = (grid[rng.permutation(20)[:number]] + 0.5) * np.array(TRAY) / [5, 4]
    x += rng.uniform(-0.02, 0.02, x.shape)
    v, w, angle = rng.normal(0.0, speed, (number, 2)), rng.normal(0.0, 8.0, number), np.zeros(number)
    material = np.arange(number) % 2
    m, R = np.array(MASS)[material], np.array(RADIUS)[material]
    a, b = np.triu_indices(number, 1)
    frames = np.arange(0.0, duration, 1.0 / fps)
    shown, now = np.empty((len(frames), number, 3)), 0.0
    impacts: list[Impact] = []
    next_frame = 0
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
        dt = max(min(float(wait.min()), float(sides.min())), 0.0)
        while next_frame < len(frames) and frames[next_frame] <= now + dt:
            ahead = frames[next_frame] - now
            shown[next_frame] = np.column_stack([x + ahead * v, angle + ahead * w])
            next_frame += 1
        if next_frame == len(frames):
            return Motion(frames, shown, material, impacts)
        x, angle, now = x + dt * v, angle + dt * w, now + dt
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
) -> str:
    """A CSV file of the frames: frame, id, x, y, angle [rad], with noise [m, rad].

    `lost` is the part of positions that are missing, `swaps` the number of pairs that exchange their ids where they
    meet, `drift` a velocity of the picture along x [m/s], `scale` the unit of positions per metre.
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
    lines = [
        f"{f},{i},{x:.6g},{y:.6g},{angle:.5f}"
        for f, row in enumerate(place)
        for i, (x, y, angle) in enumerate(row)
        if visible[f, i]
    ]
    return "frame,id,x,y,angle (rad)\n" + "\n".join(lines) + "\n"
