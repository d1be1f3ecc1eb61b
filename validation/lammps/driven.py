"""Gases driven by kicks, of Hertz-Mindlin contacts in LAMMPS and under laws of impacts: the steady T and T_rot."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...model.forces import RandomKicks
from ...plots.style import marks
from ...tools.checked import Array
from ..gas.sample import restarted, sampled_run
from ..report import style
from ..report.registry import Picture, Result
from . import contacts, library
from .contacts import COLOURS, CONTACT_POINT, PERCUSSION, TABLE, WALTON
from .gas import LAMMPS, OVERLAP, Laws, differs, near, over, percent, soft, start, temperatures
from .world import Contact

QUESTION = "Which laws give the spins of a driven gas of Hertz-Mindlin contacts?"
REFERENCE = "LAMMPS from the same starts"

SEEDS = range(11, 17)
DISKS, END, SKIPPED = 500, 120.0, 30.0
POWER, INTERVAL = 0.15, 0.5


def run(quick: bool) -> Result:
    library.load()
    result = Result()
    laws: Laws = {TABLE: contacts.tabulated(1e-3), **contacts.fitted(contacts.hertz_mindlin(1e-3))}
    values = driven(laws, contacts.hertz_mindlin(OVERLAP), DISKS, SEEDS)
    names, source = [*laws], LAMMPS
    each = {name: over(values, 1 + i) for i, name in enumerate(names)}
    softness = "contacts last and overlap by 3e-3 diameters, several at once"
    near(result, "T of the table over that of LAMMPS, less 1", each[TABLE][:, 0], 0.0, 0.01, softness, source)
    near(
        result,
        "theta of the table over that of LAMMPS, less 1",
        each[TABLE][:, 1],
        0.0,
        0.01,
        softness,
        source,
    )
    text = "theta of Walton's law over that of LAMMPS, less 1"
    near(result, text, each[WALTON][:, 1], 0.0, 0.02, "one beta_0 for all angles", source)
    for name, expected in ((PERCUSSION, 0.12), (CONTACT_POINT, -0.13)):
        text = f"theta of the {name} over that of LAMMPS, less 1"
        differs(result, text, each[name][:, 1], expected, 0.05, "LAMMPS; docs/results/lammps.md")
    lines: list[tuple[str | float, ...]] = [
        (name, f"{values[i, :, 0].mean():.4f}", f"{values[i, :, 1].mean():.4f}",
         *(("", "") if i == 0 else (percent(each[name][:, 0]), percent(each[name][:, 1]))))
        for i, name in enumerate((LAMMPS, *names))
    ]  # fmt: skip
    result.table(
        "Steady state under random kicks", ("law", "T", "theta = T_rot / T", "T over LAMMPS, less 1 (%)",
        "theta over LAMMPS, less 1 (%)"), lines,
        f"{len(SEEDS)} pairs of gases of {DISKS} disks, kicks of the power {POWER} each {INTERVAL}, just before kicks, t = "
        f"{SKIPPED:g} to {END:g}.",
    )  # fmt: skip
    result.pictures.append(_figure(names, each))
    return result


def driven(laws: Laws, contact: Contact, disks: int, seeds: Sequence[int]) -> Array:
    """T and theta of the steady state just before kicks, of LAMMPS and of each law, (codes, seeds, 2)."""
    rows = []
    number, first = round(END / INTERVAL), round(SKIPPED / INTERVAL)
    for seed in seeds:
        gas = start(disks, seed)
        world, rng, found = soft(gas, contact, INTERVAL), np.random.default_rng(seed), []
        for _ in range(number):
            world.run(round(INTERVAL / world.step), set_up=False)
            v = world.array("v")[:, :2]
            found.append(temperatures(v, world.array("omega")[:, 2]))
            kick = rng.normal(0.0, math.sqrt(POWER * INTERVAL), (disks, 2))
            v += kick - kick.mean(0)
        codes = [found]
        for law in laws.values():
            kicks = RandomKicks(step=INTERVAL, power=POWER)
            one = restarted(gas, law, forces=[kicks], seed=seed)
            # Kicks act in the middle of their steps: frames are just before.
            before = 0.5 * INTERVAL - 1e-9
            one.run(t_end=before)
            states, _ = sampled_run(one, number - 1, t_end=before + (number - 1) * INTERVAL)
            codes.append([temperatures(state.velocity, state.spin) for state in states])
        mean = np.array(codes)[:, first:].mean(1)
        mean[:, 1] /= mean[:, 0]
        rows.append(mean)
    return np.array(rows).swapaxes(0, 1)


def _figure(names: list[str], each: dict[str, Array]) -> Picture:
    figure, panels = style.panels(2, width=3.4, height=3.1)
    for axes, at, label in zip(panels, (0, 1), ("$T$", r"$\theta = T_\mathrm{rot} / T$"), strict=True):
        for i, name in enumerate(names):
            value = 100.0 * each[name][:, at]
            error = value.std(ddof=1) / np.sqrt(len(value))
            axes.errorbar([i], value.mean(), error, capsize=3, **marks(COLOURS[name]))
        axes.axhline(0.0, color=style.BLACK, lw=0.7)
        axes.set_xticks(range(len(names)), [name.replace(" ", "\n") for name in names], fontsize=8)
        axes.set(ylabel=f"{label} over that of LAMMPS $-$ 1 (%)", xlim=(-0.5, len(names) - 0.5))
    style.letters(*panels)
    caption = (
        f"Gases of {DISKS} disks that random kicks drive, under laws tabulated from or fitted to Hertz-Mindlin impacts, "
        f"relative to these contacts in LAMMPS. Bars: standard errors over {len(SEEDS)} starts."
    )
    return Picture("lammps-driven", caption, figure)
