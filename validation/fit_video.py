"""Video data made by the program at known truth: tracks of coin collisions, and a table of coins before and after.

`python -m ifrdem.validation.fit_video FOLDER` writes tracks.csv (25 collisions of two coins on a table, 1,000
frames/s; `... FOLDER 200` other numbers), start.csv and rest.csv (12 coins on it: the measured starts and rest
positions), and the case table.toml of these, which is `coins_from_video`. `... FOLDER ellipses` makes 20 such tables, compares each with 12 runs with drawn
start and law, and prints the part of the places on the ellipses of `compare`.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import ifrdem
from ifrdem import fit
from ifrdem.case.shipped import find
from ifrdem.fit import impacts
from ifrdem.fit.tracks import read as read_tracks
from ifrdem.model.gravity import EARTH
from ifrdem.runs import compare
from ifrdem.tools.tables import TableFormat

Array = NDArray[np.float64]
LAW = ifrdem.IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
TABLE_FRICTION = 0.2
COIN = ifrdem.coins["1 pta"]
FILM = 1000.0, 1.0e-4, 25  # frames per second, error of a place [m], collisions
PLACE, VELOCITY, SPIN = 1.0e-4, 3.0e-3, 0.3  # errors of the start: [m], [m/s], [rad/s]
MADE = "# SYNTHETIC: made by `python -m ifrdem.validation.fit_video` at e_n = 0.87, e_t = -0.88, mu = 0.21, table mu = 0.2\n"


FLIGHT, FINE = 0.12, 2.5e-4  # time of a flight before and after an impact, and of a step of it [s]


def _slid(v: Array, w: Array) -> tuple[Array, Array, Array, Array]:
    """Flights of coins from velocities (n, 2) and spins (n,): displacements and angles by fine steps, ends of motion."""
    from ifrdem.kernels.forces import table_friction  # imports Taichi, which is slow
    from ifrdem.simulation import backend

    backend.start()
    n, steps = len(w), round(FLIGHT / FINE)
    speed, rim, one = np.hypot(*v.T), COIN.radius * w, np.ones(n)
    along = v / np.where(speed > 0.0, speed, 1.0)[:, None]
    moved, turned = np.zeros((steps + 1, n)), np.zeros((steps + 1, n))
    x, t, eps = np.zeros((3, n))
    for i in range(steps):
        before = rim.copy()
        table_friction.slide_coins(
            FINE, 1e-12, EARTH * TABLE_FRICTION * one, 2.0 * one, speed, rim, x, t, eps
        )
        moved[i + 1] = moved[i] + x
        turned[i + 1] = turned[i] + 0.5 * (before + rim) / COIN.radius * FINE
    return moved[..., None] * along, turned, speed[:, None] * along, rim / COIN.radius


def tracks(fps: float, noise: float, number: int, seed: int = 1, angle_noise: float = 0.01) -> str:
    """A CSV table of places in the frames of `number` collisions, one after the other, with pixel noise [m] and [rad].

    The coins slide and spin on the table before and after.
    """
    rng = np.random.default_rng(seed)
    phi, psi = rng.uniform(0.0, 2.0 * np.pi, number), np.radians(rng.uniform(-75.0, 75.0, number))
    n = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    across = np.stack([-n[:, 1], n[:, 0]], axis=-1)
    v = rng.normal(0.0, 0.1, (number, 2, 2))
    v[:, 0] += rng.uniform(0.7, 1.2, number)[:, None] * (
        np.cos(psi)[:, None] * n + np.sin(psi)[:, None] * across
    )
    w = rng.normal(0.0, 8.0, (number, 2))
    moved, turned, end, spin = _slid(v.reshape(-1, 2), w.ravel())
    v, w = end.reshape(number, 2, 2), spin.reshape(number, 2)
    for k in range(number):
        out = ifrdem.collide(LAW, n[k], [COIN.mass] * 2, [COIN.radius] * 2, [2.0] * 2, v[k], w[k])
        v[k], w[k] = out.velocity, out.spin
    later, turned_later, *_ = _slid(v.reshape(-1, 2), w.ravel())
    place = rng.uniform(0.0, 0.3, (number, 1, 2)) + np.stack([0.0 * n, 2.0 * COIN.radius * n], axis=1)
    x = np.concatenate([moved - moved[-1], later[1:]]) + place.reshape(-1, 2)
    angle = np.concatenate([turned - turned[-1], turned_later[1:]])
    fine = FINE * np.arange(len(x))
    lines = [MADE + "t (s),id,x (mm),y (mm),angle (rad)"]
    for k in range(number):
        t = np.arange(0.0, 2.0 * FLIGHT, 1.0 / fps) + rng.uniform(0.0, 1.0 / fps)
        t = t[t <= fine[-1]]
        for i in (2 * k, 2 * k + 1):
            seen = np.stack([np.interp(t, fine, x[:, i, axis]) for axis in (0, 1)], axis=-1)
            seen = 1e3 * (seen + noise * rng.standard_normal(seen.shape))
            a = np.interp(t, fine, angle[:, i]) + angle_noise * rng.standard_normal(len(t))
            a = (a + np.pi) % (2.0 * np.pi) - np.pi
            lines += [
                f"{s + k:.6f},{i},{b:.4f},{c:.4f},{d:.4f}" for s, (b, c), d in zip(t, seen, a, strict=True)
            ]
    return "\n".join(lines) + "\n"


def table(seed: int = 1) -> tuple[str, str]:
    """CSV tables of the start and of the rest places of 12 coins, as a camera gives them.

    Nine coins lie loosely around the middle, three come in.
    """
    rng = np.random.default_rng(seed)
    R = COIN.radius
    grid = np.array([[i, j] for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0)]) * 2.6 * R + rng.normal(
        0.0, 0.15 * R, (9, 2)
    )
    grid[1] = grid[0] + 2.0 * R * np.array([0.1, 0.995]) / np.hypot(0.1, 0.995)  # these two touch
    position = np.concatenate([grid, [[-0.2, 0.012], [0.19, -0.03], [0.01, 0.21]]])
    velocity = np.concatenate([np.zeros((9, 2)), [[0.95, 0.0], [-0.9, 0.1], [0.0, -1.0]]])
    spin = np.concatenate([np.zeros(9), [0.0, 25.0, -15.0]])
    disks = ifrdem.Disks(12, mass=np.full(12, COIN.mass), radius=np.full(12, R))
    forces = [ifrdem.forces.TableFriction(mu=TABLE_FRICTION, step=1.0e-3)]
    gas = ifrdem.Simulation(
        disks, ifrdem.Box.open(), LAW, ifrdem.State(position, velocity, spin), forces=forces
    )
    gas.run(t_end=1.5)
    at_end = np.asarray(gas.state.position) + PLACE * rng.standard_normal(position.shape)
    seen = position + PLACE * rng.standard_normal(position.shape)
    moving = np.any(velocity != 0.0, axis=1)
    v = velocity + VELOCITY * rng.standard_normal(velocity.shape) * moving[:, None]
    w = spin + SPIN * rng.standard_normal(12) * moving
    start = [MADE + "pos x (mm),pos y (mm),u (mm/s),v (mm/s),turn (rad/s),du (mm/s),dv (mm/s),dturn (rad/s)"]
    start += [
        f"{1e3 * a:.2f},{1e3 * b:.2f},{1e3 * c:.1f},{1e3 * d:.1f},{e:.2f},{1e3 * VELOCITY * m:g},{1e3 * VELOCITY * m:g},{SPIN * m:g}"
        for (a, b), (c, d), e, m in zip(seen, v, w, moving, strict=True)
    ]
    return "\n".join(start) + "\n", "\n".join(rest(at_end.tolist())) + "\n"


def rest(places: Sequence[Sequence[float]]) -> list[str]:
    """Lines of a table of rest places [m], as `ifrdem compare` reads them."""
    return [
        MADE + "id,x (mm),y (mm)",
        *(f"{i},{1e3 * a:.2f},{1e3 * b:.2f}" for i, (a, b) in enumerate(places)),
    ]


def fitted(folder: Path) -> fit.Fitted:
    """The law fitted to the collisions of the film."""
    (folder / "tracks.csv").write_text(tracks(*FILM), encoding="utf-8")
    disk = fit.Disk(mass=COIN.mass, radius=COIN.radius, k=COIN.k)
    found = impacts.find(read_tracks(folder / "tracks.csv"), disk)
    (folder / "hits.csv").write_text(impacts.csv(found.pairs), encoding="utf-8")
    name = "ifr-percussion"
    return fit.fit(fit.read(folder / "hits.csv"), model=[name], profile=False).laws[name]


def ellipses(folder: Path, tables: int = 20, members: int = 12) -> str:
    """The part of rest places on the 68 and 95 % ellipses, over tables of other starts and errors."""
    law = fitted(folder)
    found, among, farthest = [], [], []
    for seed in range(1, tables + 1):
        start, places = table(seed)
        (folder / "coins_from_video.csv").write_text(start, encoding="utf-8")
        (folder / "rest.csv").write_text(places, encoding="utf-8")
        case, run = folder / "coins_from_video.toml", folder / "run.h5"
        case.write_bytes(find("coins_from_video").read_bytes())
        command = [sys.executable, "-m", "ifrdem", "run", str(case), "--quiet", "--no-picture", "--force"]
        subprocess.run([*command, "-o", str(folder / "run")], check=True)
        measured = compare.read(folder / "rest.csv", {"positions": PLACE}, TableFormat())
        compared = compare.compare(
            run,
            measured,
            laws=law.draw(members, seed),
            errors={"positions": PLACE},
            members=members,
            seed=seed,
            case=case,
        )
        found.append(compared.probability)
        each = np.concatenate([compared.members, measured.position[None]])
        one_left_out = [
            replace(
                compared,
                measured=replace(measured, position=each[i], error=measured.error * (i == members)),
                members=np.delete(each, i, axis=0),
            ).probability
            for i in range(members + 1)
        ]
        among.append(one_left_out[:-1])
        farthest.append(np.argmax(one_left_out, axis=0) == members)
    inside = [float(np.mean(np.array(found) < part)) for part in (0.68, 0.95)]
    return (
        f"{tables} tables of {len(found[0])} coins, {members} runs each: "
        f"within 68 % {inside[0]:.3f}, within 95 % {inside[1]:.3f}; each run among the others and the measurement: "
        f"{np.mean(np.array(among) < 0.68):.3f}, {np.mean(np.array(among) < 0.95):.3f}; "
        f"the measured place is the farthest in {np.mean(farthest):.3f}"
    )


def main(folder: Path, what: str = "") -> None:
    """Write the four files, with another number of collisions if `what` is one, or print the table of ellipses."""
    folder.mkdir(parents=True, exist_ok=True)
    if what == "ellipses":
        print(ellipses(folder))
        return
    start, places = table()
    fps, noise, number = FILM
    for name, text in (
        ("tracks", tracks(fps, noise, int(what or number))),
        ("start", start),
        ("rest", places),
    ):
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    case = find("coins_from_video").read_text(encoding="utf-8").split("\n\n", 1)[1]
    case = case.replace("coins_from_video.csv", "start.csv").replace("coins_from_video", "table")
    (folder / "table.toml").write_text(case, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
