"""The IFR law in PyBullet, by `ifrdem.bullet.step`, against the law and against our engine."""

from __future__ import annotations

import math

import numpy as np

from ... import bullet
from ...model.laws.coin_table import coins
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks, State
from ...model.walls.wall import sides
from ...tools.checked import Array
from ..paper import pairs, predicted
from ..paper.equations import Impact
from ..report import style
from ..report.registry import Picture, Result
from . import box, bullet_world
from .bullet_world import BulletWorld, Surface
from .stepped import Snapshots, deviation

QUESTION = "Do PyBullet's bodies collide by the IFR law when `ifrdem.bullet.step` moves them?"
REFERENCE = "Eqs. 6 to 17 for a pair; our engine for a hundred disks between walls"

LAW = coins["1 pta"].law
NO_RESPONSE = Surface(1.0, 0.0)  # what Bullet would do by itself, which the adapter switches off


def run(quick: bool) -> Result:
    bullet_world.require()
    result = Result()
    _pairs(result, 12 if quick else 60)
    times = np.arange(0.25, 1.51 if quick else 4.01, 0.25)
    steps = (0.05,) if quick else (0.05, 0.01)
    begin = box.start(1)
    ours, source = box.exact(LAW, begin, times), "our engine"
    apart: dict[str, Array] = {}
    for step in steps:
        theirs = in_bullet(begin, LAW, step, times)
        both = zip(theirs.states, ours.states, strict=True)
        away = [np.hypot(*(a.position - b.position).T) for a, b in both]
        apart[f"IFR in PyBullet, step {step:g}"] = np.median(away, axis=1)
        at = int(np.argmin(np.abs(times - 1.0)))
        reason = "f64 round-off, multiplied some ten times by each of one to four collisions a disk"
        text = f"places of 100 disks [R] at t = 1, step {step:g}"
        result.all_near(text, away[at], 0.0, 1e-10, reason, source)
        text = f"collisions by t = {times[-1]:g}, walls included, step {step:g}"
        events = ours.collisions + ours.wall_collisions
        if quick:
            tolerance, reason = 0.0, "none, while rounding has not separated the two codes"
        else:
            tolerance, reason = 2.0, "rounding may have separated single disks"
        result.near(text, theirs.collisions[-1], events[-1], tolerance, reason, source)
    result.pictures.append(_figure(times, apart))
    return result


def _pairs(result: Result, n: int) -> None:
    """Pairs at large steps, contact anywhere in them: the outcome is the law's, at the place where it is exact."""
    rng = np.random.default_rng(7)
    psi = np.radians(np.linspace(5.0, 85.0, n))
    for sticking in ("percussion_center", "contact_point"):
        law = IFRLaw(e_n=LAW.e_n, e_t=LAW.e_t, mu=LAW.mu, sticking=sticking)
        c = Impact(psi, law.e_n, law.e_t, law.mu, M=1.3, R_2=1.4, w_o=rng.uniform(-1.0, 1.0, n))
        w_2o = rng.uniform(-1.0, 1.0, n)
        c, _, w_2o = pairs.broadcast(c, sticking, w_2o)
        right = predicted.after(c, sticking, w_2o)
        normal, velocity, spin = (np.empty(shape) for shape in ((n, 2), (n, 2, 2), (n, 2)))
        disks = Disks(2, mass=np.array([1.0, 1.0 / 1.3]), radius=np.array([1.0, 1.4]))
        with BulletWorld(disks, NO_RESPONSE, time_step=0.05) as world:
            bodies = bullet.Bodies.read(world.client, world.disks)
            for i in range(n):
                angle = rng.uniform(0.0, 2.0 * np.pi)
                normal[i], along = pairs.directions(np.array([angle, angle + psi[i]]))
                v = np.array([along, [0.0, 0.0]])
                x = np.array([-2.4 * normal[i], [0.0, 0.0]]) - v * (2.0 + rng.uniform()) * 0.05
                world.place(x, v, np.array([c.w_o[i], -w_2o[i]]))
                for _ in range(5):
                    bullet.step(world.client, bodies, law)
                state = world.state()
                velocity[i], spin[i] = state.velocity, state.spin
        off = deviation(pairs.After.seen(c, w_2o, normal, velocity, spin), right)
        text = f"velocities and R omega [v_o] of a pair in PyBullet, steps of 0.05 R / v_o, {sticking}"
        source = "Eqs. 6 to 17, spin of disk 2 by momentum balance"
        result.all_near(text, off, 0.0, 1e-12, "f64 round-off, psi to 85 degrees", source)


def in_bullet(begin: State, law: IFRLaw, step: float, times: Array) -> Snapshots:
    """The box of `box` with the IFR law in PyBullet; collisions are those with walls too."""
    states, hits, count = [], [], 0
    with BulletWorld(box.DISKS, NO_RESPONSE, walls=sides(box.BOX), time_step=step) as world:
        world.place(begin.position, begin.velocity, begin.spin)
        bodies = bullet.Bodies.read(world.client, [*world.disks, *world.walls])
        done = 0
        for number in np.rint(times / step).astype(int):
            for _ in range(int(number) - done):
                count += len(bullet.step(world.client, bodies, law))
            done = int(number)
            states.append(world.state())
            hits.append(count)
    return Snapshots(states, np.array(hits), np.zeros(len(hits), dtype=np.int64), seconds=math.nan)


def _figure(times: Array, apart: dict[str, Array]) -> Picture:
    figure, (ax,) = style.panels(width=4.2)
    looks = zip(apart.items(), (style.BLUE, style.VERMILION), "ox", strict=False)
    for (text, away), colour, marker in looks:
        line = np.maximum(away, 1e-17)
        ax.semilogy(times, line, marker + "-", color=colour, mfc="none", lw=0.7, label=text)
    ax.set(xlabel=box.TIME, ylabel=r"median distance $/\,R$", xlim=(0, None), ylim=(1e-16, 1e-10))
    ax.legend(loc="lower right")
    caption = (
        "A hundred aluminium coins between walls, moved by PyBullet and collided by `ifrdem.bullet.step`: "
        "median distance from their places in our engine. Contacts are computed within a step, so that the "
        "length of the step does not matter; rounding grows from collision to collision as between any two "
        "codes."
    )
    return Picture("bullet-ifr", caption, figure)
