"""A box of a hundred cylinders between walls: PyBullet, pymunk and our engine from the same starts."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...initial import placement
from ...model.box import Box
from ...model.device import Device
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks, State
from ...model.walls.wall import sides
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result, Table
from . import bullet_world, pymunk_world, stepped
from .bullet_world import BulletWorld, Surface
from .pymunk_world import PymunkWorld
from .stepped import Snapshots, World

QUESTION = (
    "Does a gas of a hundred disks between walls cool, spin up and collide in other codes as in our engine?"
)
REFERENCE = "our engine, walled box, e_t = -1, contact point, from the same starts"

N, PHI, E_N, MU = 100, 0.3, 0.8, 0.2
SURFACE = Surface(E_N, MU)
LAW = IFRLaw(e_n=E_N, e_t=-1.0, mu=MU, sticking="contact_point")
DISKS = Disks(N, mass=1.0, radius=1.0)  # type: ignore[arg-type]
BOX = Box((math.sqrt(N * math.pi / PHI),) * 2, periodic=(False, False))

FINE, COARSE = 1e-3, 5e-3  # time steps [R / thermal speed]; all sampled times are multiples
ERRORS = 4.0  # standard errors that may lie between two codes
BIAS = 1e-3  # what a step of 1e-3 leaves: contacts at a distance that is shorter by up to v dt, 5e-4 of 2 R


@dataclass(frozen=True)
class BoxMeasures:
    """One code's gases: arrays (seeds, times); positions (seeds, times, n, 2), and which disks have collided."""

    energy: Array
    spin_share: Array
    collisions: Array
    wall_collisions: Array
    position: Array
    collided: NDArray[np.bool_]
    seconds: float


@dataclass
class Code:
    """A code with its step, and its gases of the seeds so far."""

    name: str
    world: World | None
    time_step: float
    law: IFRLaw = LAW
    gases: list[Snapshots] = field(default_factory=list)

    def measured(self) -> BoxMeasures:
        """All seeds together."""
        at_start = 0.5 * float(np.sum(DISKS.mass)) * 2.0  # T = 1: m v^2 / 2 is 1 on average
        moving, turning = np.array([gas.energy(DISKS) for gas in self.gases]).swapaxes(0, 1)
        return BoxMeasures(
            (moving + turning) / at_start,
            turning / (moving + turning),
            np.array([gas.collisions for gas in self.gases], dtype=float) * 2.0 / N,
            np.array([gas.wall_collisions for gas in self.gases], dtype=float) / N,
            np.array([[state.position for state in gas.states] for gas in self.gases]),
            np.array([[state.collisions > 0 for state in gas.states] for gas in self.gases]),
            sum(gas.seconds for gas in self.gases),
        )


def run(quick: bool) -> Result:
    bullet_world.require()
    result = Result()
    seeds = range(1, 5 if quick else 21)
    times = np.arange(0.25, 2.01, 0.25) if quick else np.arange(0.25, 5.01, 0.25)
    ours = Code("ifrdem", None, 0.0)
    ifr = Code("ifrdem, e_t = -0.88", None, 0.0, IFRLaw(e_n=E_N, e_t=-0.88, mu=MU, sticking="contact_point"))
    others = [Code("PyBullet", BulletWorld, COARSE if quick else FINE)]
    coarse: list[Code] = [] if quick else [Code("PyBullet, step 5e-3", BulletWorld, COARSE)]
    if pymunk_world.absence() is None:
        others.append(Code("pymunk", PymunkWorld, FINE))
        if not quick:
            others.append(Code("pymunk, step 1e-4", PymunkWorld, 1e-4))
    for code in (ours, ifr):
        exact(code.law, start(0), times[:1])  # compiles
    for seed in seeds:
        begin = start(seed)
        for code in (ours, ifr):
            code.gases.append(exact(code.law, begin, times))
        for code in others + (coarse if seed <= 4 else []):
            assert code.world is not None
            walls = {
                "time_step": code.time_step,
                "steps": np.rint(times / code.time_step).astype(int).tolist(),
            }
            code.gases.append(stepped.gas(code.world, DISKS, SURFACE, sides(BOX), begin, **walls))
    found = {code.name: code.measured() for code in (ours, ifr, *others, *coarse)}
    for code in others:
        _compare(result, code, found["ifrdem"], found[code.name], times)
    _before_chaos(result, [*others, *coarse], found, times)
    names, steps = [code.name for code in others], {code.name: code.time_step for code in (*others, *coarse)}
    result.tables += [_power(found, times, names), _speed(found, [*others, *coarse])]
    result.pictures += [_figure(found, times, names[:2]), _chaos_figure(found, times, steps)]
    return result


def start(seed: int) -> State:
    """Disks at random, with Maxwellian velocities of temperature 1 and without spins."""
    inside = Box(tuple(side - 2.0 for side in BOX.lengths))  # type: ignore[arg-type]
    position = placement.random_positions(inside, DISKS.radius, seed=seed) + 1.0
    velocity = placement.maxwellian(DISKS.mass, temperature=1.0, seed=seed)
    return State(position, velocity, np.zeros(N))


def exact(law: IFRLaw, begin: State, times: Sequence[float] | Array) -> Snapshots:
    """Our engine's run; timed without stops on the way."""
    gas = Simulation(DISKS, BOX, law, begin, device=Device(threads=1))
    states, counts = [], []
    for t in times:
        gas.run(t_end=float(t))
        states.append(gas.state)
        counts.append((gas.collisions, gas.wall_collisions))
    timed = Simulation(DISKS, BOX, law, begin, device=Device(threads=1))
    began = time.process_time()
    timed.run(t_end=float(times[-1]))
    collisions, wall_collisions = np.array(counts).T
    return Snapshots(states, collisions, wall_collisions, time.process_time() - began)


def mean_and_error(values: Array) -> tuple[Array, Array]:
    """Mean over the seeds and its standard error, shape (times,)."""
    return values.mean(axis=0), values.std(axis=0, ddof=1) / math.sqrt(len(values))


def _compare(result: Result, code: Code, ours: BoxMeasures, theirs: BoxMeasures, times: Array) -> None:
    """Means over the seeds against ours, by the scatter of the paired differences."""
    seeds = len(theirs.energy)
    reason = (
        f"{ERRORS:g} standard errors of the paired differences of {seeds} starts, and the bias of the step of "
        f"{code.time_step:g}, which finds contacts late; of counts, four events that fall to the other side "
        "of a time"
    )
    half = len(times) // 2 - 1
    for at in (half, len(times) - 1):
        for text, attribute, few in (
            ("energy over that at the start", "energy", 0.0),
            ("part of the energy that is spin", "spin_share", 0.0),
            ("collisions per disk", "collisions", 8.0 / (N * seeds)),
            ("wall hits per disk", "wall_collisions", 4.0 / (N * seeds)),
        ):
            mine, other = getattr(ours, attribute)[:, at], getattr(theirs, attribute)[:, at]
            _, error = mean_and_error((other - mine)[:, None])
            margin = BIAS * max(code.time_step / FINE, 1.0) * float(mine.mean()) + few
            tolerance, quantity = (
                ERRORS * float(error[0]) + margin,
                f"{text} at t = {times[at]:g}, {code.name}",
            )
            source = "our engine from the same starts"
            result.near(quantity, other.mean(), mine.mean(), tolerance, reason, source)


def _apart(ours: BoxMeasures, theirs: BoxMeasures) -> Array:
    """Median over disks that have collided in ours of the distance between both codes' places [R], shape (times,)."""
    seeds = len(theirs.position)
    away = np.hypot(*np.moveaxis(theirs.position - ours.position[:seeds], -1, 0))
    return np.nanmedian(np.where(ours.collided[:seeds], away, np.nan), axis=(0, 2))


def _before_chaos(result: Result, codes: list[Code], found: dict[str, BoxMeasures], times: Array) -> None:
    at = int(np.argmin(np.abs(times - 1.0)))
    for code in codes:
        off = float(_apart(found["ifrdem"], found[code.name])[at])
        result.near(
            f"median distance between places [R] of disks that have collided at t = {times[at]:g}, "
            f"{code.name}, step {code.time_step:g}",
            off, 0.0, 3.0 * code.time_step,
            "a disk hits up to one step late, v dt with v about 1, and its velocity is off by v dt / R (bullet_flight)",
            "our engine from the same starts",
        )  # fmt: skip


def _power(found: dict[str, BoxMeasures], times: Array, others: list[str]) -> Table:
    """Would the comparison have noticed IFR's own e_t?"""
    rows: list[tuple[str | float, ...]] = []
    ours = found["ifrdem"]
    for name in (*others, "ifrdem, e_t = -0.88"):
        for text, attribute in (("energy", "energy"), ("part that is spin", "spin_share")):
            difference = getattr(found[name], attribute)[:, -1] - getattr(ours, attribute)[:, -1]
            mean, error = mean_and_error(difference[:, None])
            rows.append((name, text, float(mean[0]), float(error[0]), float(abs(mean[0]) / error[0])))
    return Table(
        f"Differences from ifrdem at e_t = -1 at t = {times[-1]:g}, means over the starts",
        ("code", "quantity", "difference", "standard error", "in standard errors"),
        rows,
        "The last two rows show the sensitivity of the comparison: IFR at the e_t of an aluminium coin is another gas.",
    )


def _speed(found: dict[str, BoxMeasures], codes: list[Code]) -> Table:
    rows: list[tuple[str | float, ...]] = []
    for name, step in (("ifrdem", 0.0), *((code.name, code.time_step) for code in codes)):
        one = found[name]
        events = float(np.sum(one.collisions[:, -1]) * N / 2.0 + np.sum(one.wall_collisions[:, -1]) * N)
        rows.append((name, f"{step:g}" if step else "none", round(events), one.seconds, events / one.seconds))
    return Table(
        "Speed on this box, one thread each",
        ("code", "time step", "collisions, walls included", "processor time (s)", "collisions/s"),
        rows,
        "Steps and events alone, set-up and compilation left out; ours without stops on the way. A hundred disks "
        "are few for our engine: see the README for larger gases. " + stepped.not_measured(),
    )


TIME = r"$t$ ($R\,\sqrt{m/T_0}$)"
CODES = ("PyBullet", "pymunk", "PyBullet, step 5e-3", "pymunk, step 1e-4")
COLOURS = dict(zip(CODES, (style.BLUE, style.VERMILION, style.SKY, style.ORANGE), strict=True))
MARKERS = dict(zip(CODES, "oxs+", strict=True))


def _figure(found: dict[str, BoxMeasures], times: Array, others: list[str]) -> Picture:
    figure, axes = style.panels(3, width=2.9)
    shown = (("energy", "$E / E_0$"), ("spin_share", "$E_{rot} / E$"), ("collisions", "collisions per disk"))
    for ax, (attribute, text) in zip(axes, shown, strict=True):
        for code, line in (("ifrdem", "-"), ("ifrdem, e_t = -0.88", "--")):
            mean, error = mean_and_error(getattr(found[code], attribute))
            ax.plot(times, mean, line, color=style.BLACK if line == "-" else style.GREY,
                    label="ifrdem" if line == "-" else r"ifrdem, $e_t = -0.88$")  # fmt: skip
            ax.fill_between(times, mean - error, mean + error, color=style.GREY, alpha=0.3, lw=0)
        for i, code in enumerate(others):
            some = slice(i, None, 2)  # markers of two codes alternate
            look = {"ms": 4, "lw": 0.8, "capsize": 2}
            values = getattr(found[code], attribute)[:, some]
            style.errorbars(ax, times[some], values, COLOURS[code], code, MARKERS[code], **look)
        ax.set(xlabel=TIME, ylabel=text, xlim=(0, None), ylim=(0, None))
    style.letters(*axes)
    axes[0].set_ylim(0.0, 1.12)
    axes[0].legend(loc="lower left")
    caption = (
        f"{N} disks between four walls, packing fraction {PHI}, e_n = {E_N}, mu = {MU}: (a) energy, (b) the "
        f"part of it that is spin, (c) collisions per disk; means over {len(found['ifrdem'].energy)} starts "
        "with their standard errors (bars; grey band: ours). Dashed: our engine with IFR at e_t = -0.88, "
        "which neither code has."
    )
    return Picture("bullet-box", caption, figure)


def _chaos_figure(found: dict[str, BoxMeasures], times: Array, steps: dict[str, float]) -> Picture:
    figure, (ax,) = style.panels(width=4.2)
    for code in steps:
        apart, label = _apart(found["ifrdem"], found[code]), f"{code.split(',')[0]}, step {steps[code]:g}"
        ax.semilogy(times, apart, MARKERS[code] + "-", color=COLOURS[code], mfc="none", lw=0.7, label=label)
    ax.set(xlabel=TIME, ylabel=r"median distance $/\,R$", xlim=(0, None), ylim=(1e-6, None))
    ax.legend(loc="lower right")
    caption = (
        "Median distance between a disk in another code and in our engine, of those that have collided. The "
        "shorter the step, the closer; every collision multiplies the distance, until single places cannot "
        "be compared any more and only means can."
    )
    return Picture("bullet-chaos", caption, figure)
