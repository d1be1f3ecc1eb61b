"""Cooling gases of Hertz-Mindlin contacts in LAMMPS, against laws of impacts; of a constant e_n and viscoelastic."""

from __future__ import annotations

import numpy as np

from ...plots.style import dashes
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import contacts, library
from .contacts import COLOURS, PERCUSSION, TABLE, WALTON
from .gas import LAMMPS, OVERLAP, Laws, cooling, differs, near, over, percent

QUESTION = "Does a gas of Hertz-Mindlin contacts cool as its impacts, taken as a law, say?"
REFERENCE = "LAMMPS from the same starts"

SEEDS = range(1, 7)
DISKS, END = 700, 20.0
END_VISCOELASTIC = 50.0
TIMES = np.linspace(0.0, 1.0, 7)[1:] ** 1.5
WITH_SPEED, CONSTANT, BUILT_IN = (
    "table with e_n(g_n)",
    "Walton, constant e_n",
    "viscoelastic, Walton's friction",
)
LOOK = {WITH_SPEED: COLOURS[TABLE], CONSTANT: COLOURS[PERCUSSION], BUILT_IN: COLOURS[WALTON]}
SOFTNESS = "contacts last and overlap by 3e-3 diameters, several at once"


def run(quick: bool) -> Result:
    library.load()
    result = Result()
    table, fitted = contacts.tabulated(1e-3), contacts.fitted(contacts.hertz_mindlin(1e-3))
    laws: Laws = {TABLE: table, **fitted}
    constant, tau = cooling(laws, contacts.hertz_mindlin(OVERLAP), DISKS, SEEDS, END * TIMES)
    for at, systematic in ((1, 0.01), (-1, 0.02)):
        text = f"T of the table over that of LAMMPS, less 1, after {tau[at]:.0f} collisions per disk"
        near(result, text, over(constant, 1)[:, at, 0], 0.0, systematic, SOFTNESS, LAMMPS)

    contact = contacts.viscoelastic(OVERLAP)
    law = contacts.law_of(contact)
    walton = fitted[WALTON]
    of_speed: Laws = {
        WITH_SPEED: contacts.with_speed(table, law),
        BUILT_IN: contacts.law_of(contact, friction="walton", beta_0=walton.beta_0, mu=walton.mu),
        CONSTANT: contacts.fitted(contact)[WALTON],
    }
    speed, tau_2 = cooling(of_speed, contact, DISKS, SEEDS, END_VISCOELASTIC * TIMES)
    names = [*of_speed]
    for name, systematic in ((WITH_SPEED, 0.02), (BUILT_IN, 0.03)):
        text = f"viscoelastic contacts: T of the {name} over that of LAMMPS, less 1, after {tau_2[-1]:.0f}"
        more = "" if name == WITH_SPEED else "; one beta_0 for all angles"
        near(
            result,
            text,
            over(speed, 1 + names.index(name))[:, -1, 0],
            0.0,
            systematic,
            SOFTNESS + more,
            LAMMPS,
        )
    differs(
        result, f"viscoelastic contacts: T of a constant e_n = {of_speed[CONSTANT].e_n:.3f}, fitted to thermal impacts",
        over(speed, 1 + names.index(CONSTANT))[:, -1, 0], -0.12, 0.05, "LAMMPS; docs/results/lammps.md",
    )  # fmt: skip
    _table(result, [(laws, constant, tau), (of_speed, speed, tau_2)])
    result.pictures.append(_figure([(laws, constant, tau), (of_speed, speed, tau_2)]))
    return result


Part = tuple[Laws, Array, Array]


def _table(result: Result, parts: list[Part]) -> None:
    lines: list[tuple[str | float, ...]] = []
    for (laws, values, tau), title in zip(parts, ("constant e_n", "viscoelastic"), strict=True):
        for at in (len(tau) // 2, len(tau) - 1):
            for i, name in enumerate(laws, 1):
                each = over(values, i)[:, at]
                lines.append((title, f"{tau[at]:.1f}", name, percent(each[:, 0]), percent(each[:, 1])))
    result.table(
        "T and theta = T_rot / T of laws of impacts, over those of LAMMPS, less 1 (%)",
        ("contacts", "collisions per disk", "law", "T", "theta"), lines,
        f"Means of {len(SEEDS)} pairs of gases of {DISKS} disks with their standard errors.",
    )  # fmt: skip


def _figure(parts: list[Part]) -> Picture:
    figure, panels = style.panels(3, width=3.2)
    looks = {**COLOURS, **LOOK}
    for axes, part, at, label in zip(panels, (0, 0, 1), (0, 1, 0), ("$T$", r"$\theta$", "$T$"), strict=True):
        laws, values, tau = parts[part]
        for i, name in enumerate(laws, 1):
            each = 100.0 * over(values, i)[:, :, at]
            mean, error = each.mean(0), each.std(0, ddof=1) / np.sqrt(len(each))
            axes.plot(tau, mean, label=name, **dashes(looks[name]))
            axes.fill_between(tau, mean - error, mean + error, color=looks[name], alpha=0.2, lw=0.0)
        axes.axhline(0.0, color=style.BLACK, lw=0.7)
        axes.set(
            xlabel=r"collisions per disk $\tau$",
            ylabel=f"{label} over that of LAMMPS $-$ 1 (%)",
            xlim=(0, tau[-1]),
        )
        axes.legend(loc="best", fontsize=7)
    for letter, title, axes in zip(
        "abc", ("cooling", "cooling: spins", "viscoelastic contacts"), panels, strict=True
    ):
        axes.set_title(f"({letter}) {title}", loc="left", fontsize=9)
    caption = (
        f"Cooling gases of {DISKS} disks at packing fraction 0.15 under laws of impacts, relative to Hertz-Mindlin "
        "contacts in LAMMPS from the same starts. (a), (b) e_n = 0.9: laws tabulated from, or fitted to, impacts. (c) "
        f"Viscoelastic contacts: a constant e_n cools too fast. Bands: standard errors over {len(SEEDS)} starts."
    )
    return Picture("lammps-cooling", caption, figure)
