"""Need for exact events: a time step finds a contact late, and bodies collide along a line of centres that turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...tools.checked import Array
from ..paper import pairs, predicted
from ..paper.equations import Impact
from ..report import style
from ..report.registry import Picture, Result
from . import bullet_world, stepped
from .pair import AGREEMENT, EXACT, NORMAL
from .stepped import deviation

QUESTION = "How far off is an impact that a time step finds late, and how does that go with the step?"
REFERENCE = "first order in v dt / R, because the overlap when it is found is; ours by the closed forms"


def run(quick: bool) -> Result:
    bullet_world.require()
    result = Result()
    n = 40 if quick else 200
    step = 10.0 ** np.linspace(-5.0, -1.0, 9 if quick else 17)
    psi = np.radians(np.linspace(5.0, 85.0, n))
    c = Impact(psi, 0.87, -1.0, 0.21, M=1.3)
    right = predicted.after(c, "contact_point")
    ours = deviation(pairs.fly(c, "contact_point"), right)
    result.exact("velocities and R omega [v_o] of our engine", ours, 0.0, "Eqs. 6 to 14")
    errors = {}
    for world in stepped.worlds():
        off = np.array([deviation(stepped.fly(world, c, one, seed=i), right) for i, one in enumerate(step)])
        errors[world.name] = np.sqrt(np.mean(off**2, axis=1))
        order, _ = np.polyfit(np.log10(step), np.log10(errors[world.name]), 1)
        result.near(
            f"order of the error in v dt / R over four decades, {world.name}", order, 1.0, 0.05,
            "random phases of the step scatter the mean of an error by some percent; at 1e-1 higher orders show",
            "the line of centres turns by at most v dt sin(psi) / (R_1 + R_2)",
        )  # fmt: skip
        expected = np.array([late(c, one, seed=i) for i, one in enumerate(step)])
        result.all_near(
            f"error [v_o] from that of the contact found at the next step, {world.name}", off, expected,
            2.0 * AGREEMENT,
            NORMAL if world.name == "PyBullet" else EXACT, "closed forms at a line of centres that has turned",
        )  # fmt: skip
    names = list(errors)
    result.table(
        "rms error of velocities and R omega after one impact, in units of v_o",
        ("v dt / R", *names),
        [(float(one), *(float(errors[name][i]) for name in names)) for i, one in enumerate(step)],
        f"Our engine: {np.sqrt(np.mean(ours**2)):.1e}, whatever the length of its windows. "
        + stepped.not_measured(),
    )
    result.pictures.append(_figure(step, errors, ours))
    return result


def late(c: Impact, step: float, seed: int) -> Array:
    """Error of impacts that are found at the end of the time step in which they happen, shape (n,).

    Disk 1 flies on by s = v_o dt (1 - phase): the line of centres turns by the angle a with tan(a) = s sin(psi) /
    (sigma - s cos(psi)), in the sense in which psi grows. Seen from the turned line the impact has psi + a; its
    outcome, turned back, is what is compared.
    """
    _, phase = stepped.geometry(len(c.psi), seed)
    s = step * c.R_1 * (1.0 - phase)
    a = np.arctan2(s * np.sin(c.psi), c.R_1 + c.R_2 - s * np.cos(c.psi))
    right = predicted.after(c, "contact_point")
    turned = predicted.after(replace(c, psi=c.psi + a), "contact_point")
    both = ((turned.v_1n, turned.v_1t), (turned.v_2n, turned.v_2t))
    v_1, v_2 = (np.exp(-1j * a) * (n + 1j * t) for n, t in both)
    back = replace(turned, v_1n=v_1.real, v_1t=v_1.imag, v_2n=v_2.real, v_2t=v_2.imag)
    return deviation(back, right)


def _figure(step: Array, errors: dict[str, Array], ours: Array) -> Picture:
    figure, (ax,) = style.panels(width=4.2)
    looks = zip(errors.items(), (style.BLUE, style.VERMILION), ("o", "x"), strict=False)
    for (name, error), colour, marker in looks:
        ax.loglog(step, error, marker, mfc="none", color=colour, label=name)
    first, middle = next(iter(errors.values())), len(step) // 2
    ax.loglog(step, first[middle] * step / step[middle], color=style.GREY, lw=0.8, label="first order")
    ax.axhline(np.sqrt(np.mean(ours**2)), color=style.GREEN, label="ifrdem (has no step)")
    ax.set(xlabel=r"$v\,\Delta t / R$", ylabel=r"rms error $/\,v_o$", ylim=(1e-17, 1.0))
    ax.legend(loc="center right")
    caption = (
        "Error of one impact that free flight leads to, contact at a random phase of the time step, against "
        "the length of the step. A step finds the overlap late, when the line of centres has turned; the "
        "error is of first order and the same in both codes. Events are computed, not found: ours is "
        "rounding."
    )
    return Picture("bullet-flight", caption, figure)
