"""Panels of analysis results: distributions, g(r), S(k), displacements, fields, clusters, angles of impact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from .. import analysis
from ..analysis.averages import OF_DISKS, ProfileSequence
from ..analysis.gas_theory import name_of_theory
from ..analysis.histograms import TITLES
from ..analysis.motion import Displacement
from ..analysis.result import NOT_STATIONARY, Evaluation
from ..tools.checked import Array
from ..tools.intervals import PERCENT, student_t
from ..tools.labels import few_labels
from ..trajectory.reader import Trajectory
from . import disks as plot_disks
from . import species, vortices
from .series import AXES
from .style import (
    ACROSS,
    HATCH,
    KINDS,
    LOOKS,
    OPEN,
    RATIO,
    ROTATION,
    TRANSLATION,
    bars,
    color_bar,
    dashes,
    from_zero,
    grid,
    label,
    legend,
    legend_above,
    marked_line,
    marks,
    place_axes,
    plain,
    unit_of,
    with_unit,
)  # fmt: skip

BARS: dict[str, Any] = {"color": ACROSS, "ec": TRANSLATION, "ecolor": ROTATION, "capsize": 3.0}
POINTS: dict[str, Any] = {"fmt": "o", "lw": 0.8, "mfc": "none", "color": TRANSLATION}


MOST_SONINE = 0.3
"""|a20| or |a02| up to which the first term of the Sonine expansion is drawn."""


def velocity(left: Axes, *rest: Any) -> None:
    """Distributions of velocity components and spins, logarithmic, with Gaussians and their Sonine expansion.

    The expansion is of first order in a20 or a02. It is drawn for |a| <= `MOST_SONINE`; beyond, its next terms are not
    small, and the legend has the value alone.
    `rest` is the axes for spins, unless there are none, the trajectory or None, and the result.
    """
    *spins, _, evaluation = rest
    right = spins[0] if spins else None
    x = np.linspace(-5.0, 5.0, 400)
    lowest = highest = float(analysis.gaussian(x).max())
    for i, (name, found) in enumerate(evaluation.result.items()):
        style = marks(KINDS[i % len(KINDS)], ms=4, lw=0.8)
        for axes, middle, density, error in (
            (left, found.speed, found.density, found.density_error),
            (right, found.spin, found.spin_density, found.spin_density_error),
        ):
            positive = density > 0.0
            if axes is None:
                continue
            if np.any(positive):
                lowest, highest = min(lowest, density[positive].min()), max(highest, density[positive].max())
                axes.errorbar(
                    middle[positive], density[positive], error[positive], label=name.split(",")[0], **style
                )
    sonine = next(iter(evaluation.result.values())).sonine
    for axes, a2, text in ((left, sonine.a20, "a_{20}"), (right, sonine.a02, "a_{02}")):
        if axes is None:
            continue
        axes.plot(x, analysis.gaussian(x), "-", color=RATIO, lw=1.2, label="Gaussian")
        if np.isfinite(a2) and len(evaluation.result) == 1:
            text = rf"${text} = {a2:.3g}$"
            if abs(a2) <= MOST_SONINE:
                expansion = analysis.sonine_density(x, a2)
                # Not beyond where it falls below 0: it is no density there, and what comes after is none either.
                end = np.min(np.abs(x), where=expansion <= 0.0, initial=np.inf)
                shown = np.where(np.abs(x) < end, expansion, np.nan)
                highest = max(highest, float(np.nanmax(shown)))
                axes.plot(x, shown, "--", color=ROTATION, lw=1.2, label=f"with {text}")
            else:
                axes.plot([], [], " ", label=text)
        axes.set(yscale="log", xlim=(-5.0, 5.0))
        legend_above(axes)
    left.set_ylim(0.3 * lowest, 2.0 * highest)
    left.set(xlabel=r"$c = v_{x,y} / \sqrt{2 T / m}$", ylabel="probability density")
    grid(left)
    if right is not None:
        right.set_ylim(left.get_ylim())
        right.set_ylabel("probability density")
        right.set_xlabel(r"$w = \omega / \sqrt{2 T_\mathrm{rot} / I}$")
        grid(right)


def tail(axes: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """Densities of velocities against the speed, logarithmic, with the fit of the tail and a Gaussian."""
    del trajectory
    highest = lowest = 1.0 / np.pi
    end = 0.0
    for i, (name, found) in enumerate(evaluation.result.items()):
        color = KINDS[i % len(KINDS)]
        middle, shown = 0.5 * (found.edges[1:] + found.edges[:-1]), found.counts > 0
        text = "disks" if len(evaluation.result) == 1 else plain(name)
        axes.errorbar(
            middle[shown],
            found.density[shown],
            found.density_error[shown],
            label=text,
            **marks(color, ms=4, lw=0.8),
        )
        fine = np.linspace(found.first, found.edges[-1], 200)
        nu = _with_error(found.nu.mean, found.nu.error)
        look = dashes(KINDS[(i + 1) % len(KINDS)])
        axes.plot(fine, found.fitted(fine), lw=1.5, label=rf"$\exp(-A c^\nu)$, $\nu$ = {nu}", **look)
        lowest, highest = min(lowest, found.density[shown].min()), max(highest, found.density.max())
        end = max(end, float(found.edges[-1]))
    c = np.linspace(0.0, end, 400)
    axes.plot(c, np.exp(-(c**2)) / np.pi, "-", color=RATIO, lw=1.2, label="Gaussian")
    axes.set(yscale="log", xlim=(0.0, 1.03 * end), ylim=(0.3 * lowest, 2.0 * highest))
    axes.set(xlabel=r"$c = |v| / \sqrt{2 T / m}$", ylabel="density of velocities $f(c)$")
    legend(axes)
    grid(axes)


WIDEST = 0.05
"""Width, as part of r, that bins of g(r) have at most when they are drawn as one."""
ENOUGH = 0.01
"""Relative standard error of g below which no more bins are merged."""
CLEARLY = 0.01
"""Smallest height of the plateau above 1 that is pointed out, if it exceeds its error too."""


def merged(found: analysis.PairCorrelation) -> tuple[Array, Array, Array]:
    """r, g and its standard error, with neighbouring bins merged until the error is small: the noise of the rest goes.

    Below the lowest r that any pair has, bins are as they were.
    """
    rows, first = [], 0
    for last in range(len(found.r)):
        some = slice(first, last + 1)
        area, count = found.r[some], found.pairs[some].sum()  # of rings of one width
        width = (last + 2 - first) * (found.r[1] - found.r[0])  # with the next one
        if 0.0 < count < ENOUGH**-2 and width < WIDEST * found.r[last] and last + 1 < len(found.r):
            continue
        error = np.sqrt(np.sum((area * found.g_error[some]) ** 2)) if count else 0.0
        rows.append([area.mean(), area @ found.g[some] / area.sum(), error / area.sum()])
        first = last + 1
    r, g, error = np.array(rows).T
    return r, g, error


def pairs(axes: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """g(r) with its errors, and its value at contact; of several species those of each pair of them."""
    unit = 1.0 if trajectory is None else 2.0 * float(trajectory.disks.radius.mean())
    whole, *of_pairs = evaluation.result.items()
    for i, (name, found) in enumerate(of_pairs):
        r, g, error = merged(found)
        color = KINDS[i % len(KINDS)]
        axes.fill_between(r / unit, g - error, g + error, lw=0.0, alpha=0.3, color=color)
        text = f"{plain(name)}{', band: standard error' * (not i)}"
        axes.plot(r / unit, g, lw=1.2, label=text, **dashes(color))
    found = whole[1]
    if not of_pairs:
        _all_pairs(axes, trajectory, evaluation, found, unit)
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label="ideal gas")
    text = "$r$" if trajectory is None else "$r$ (mean diameters)"
    axes.set(xlim=(0.0, float(found.r[-1]) / unit), xlabel=text, ylabel="$g(r)$")
    axes.set_ylim(bottom=0.0)
    legend(axes)
    grid(axes)


def _all_pairs(
    axes: Axes, trajectory: Trajectory | None, evaluation: Evaluation, found: analysis.PairCorrelation, unit: float
) -> None:  # fmt: skip
    """g(r) of all disks, its value at contact, and its plateau if that is above 1."""
    r, g, error = merged(found)
    axes.fill_between(r / unit, g - error, g + error, color=ACROSS, lw=0.0, alpha=0.6)
    axes.plot(r / unit, g, "-", color=TRANSLATION, lw=1.2, label="disks, band: standard error")
    far = r > 0.7 * r[-1]
    plateau = float(g[far].mean())
    of_plateau = float(np.sqrt(np.sum(error[far] ** 2)) / np.count_nonzero(far))
    if plateau - 1.0 > max(CLEARLY, 4.0 * of_plateau):
        reason = "walls" if trajectory is not None and trajectory.free_area.all_walls else "clusters"
        text = f"{plateau:.3g}: above 1, as the density varies ({reason})"
        axes.plot(r[far][[0, -1]] / unit, [plateau, plateau], "--", color=ROTATION, lw=1.5, label=text)
    for row in evaluation.rows:
        if row.name == "g at contact":
            text = f"at contact: {row.value:.3f} $\\pm$ {row.error:.3f}"
            text = text if np.isfinite(row.error) else f"at contact: {row.value:.3g} (best fit, poor)"
            style = OPEN | {"color": ROTATION, "marker": "D", "ms": 6}
            axes.errorbar([1.0], [row.value], [row.error], label=text, **style)


def structure(axes: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """S(k), double logarithmic, with its errors."""
    found = evaluation.result
    k, text = found.k, "$k$"
    if trajectory is not None:
        k, text = k * 2.0 * float(trajectory.disks.radius.mean()), r"$k$ $\times$ mean diameter"
    axes.errorbar(k, found.S, bars(found.S, found.ends), ms=3, label=f"disks, {PERCENT} intervals", **POINTS)
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label="ideal gas")
    axes.set(xscale="log", yscale="log", xlabel=text, ylabel="$S(k)$")
    legend(axes)
    grid(axes)


def msd(axes: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """Mean-square displacements, double logarithmic, with ballistic flight and the fitted diffusion.

    Of a cooling gas against collisions per disk, over the squared free path where that is known.
    """
    own_time = "tau" in evaluation.tables.get("", {})
    lowest, highest = np.inf, 0.0
    for i, (name, one) in enumerate(evaluation.result.items()):
        found, fit, alone = one.msd, one.fit, len(evaluation.result) == 1
        unit = one.free_path**2 if np.isfinite(one.free_path) else 1.0
        later = found.lag > 0.0
        t, value = found.lag[later], found.value[later] / unit
        lowest, highest = min(lowest, value.min()), max(highest, value.max())
        style = POINTS if alone else marks(KINDS[i % len(KINDS)], lw=0.8)
        half = student_t(found.disks) * found.error[later] / unit
        text = f"{'disks' if alone else plain(name)}, {PERCENT} intervals" if not i else plain(name)
        axes.errorbar(t, value, half, ms=3.5, label=text, **style)
        if np.isfinite(one.flight) and one.flight > 0.0:
            text = "free flight" if own_time else r"free flight, $\langle v^2 \rangle t^2$"
            _free_flight(axes, one, t, unit, RATIO if alone else style["color"], None if i else text)
        if fit is None:
            continue
        used = (t >= fit.lags[0]) & (t <= fit.lags[1])
        line = value[used].mean() + 2.0 * found.components * fit.D / unit * (t - t[used].mean())
        text = (
            f"$D$ = {fit.D:.3g} $\\pm$ {fit.error:.1g} {unit_of(trajectory, 'length^2/time') or ''}".rstrip()
        )
        if own_time:
            text = rf"$D / \nu$ = {fit.D:.3g} $\pm$ {fit.error:.1g} {unit_of(trajectory, 'length^2') or ''}".rstrip()
            if unit != 1.0:
                text = rf"$D m \nu / T$ = {0.5 * np.pi * fit.D / unit:.3g} $\pm$ {0.5 * np.pi * fit.error / unit:.1g}"
        elif any(NOT_STATIONARY in warning for warning in evaluation.warnings):
            text = "straight line (the gas is not stationary: no $D$)"
        if abs(fit.exponent - 1.0) > 0.2:
            text += f"\n(no diffusion: exponent {fit.exponent:.2f})"
        used &= line > 0.0  # a logarithmic axis would draw a line that falls below 0 as a vertical one
        look = {"color": ROTATION} if alone else dashes(KINDS[i % len(KINDS)])
        axes.plot(t[used], line[used], lw=2.0, zorder=5, label=text, **look)
    axes.set(xscale="log", yscale="log", ylim=(0.5 * lowest, 3.0 * highest))
    few_labels(axes)
    axes.set_xlabel(OWN_LAG if own_time else label(trajectory, "lag $t$", "time"))
    scaled = own_time and np.isfinite(next(iter(evaluation.result.values())).free_path)
    text = r"$\langle |\Delta r|^2 \rangle"
    axes.set_ylabel(rf"{text} \,/\, \lambda^2$" if scaled else label(trajectory, f"{text}$", "length^2"))
    legend(axes, "lower right")
    grid(axes)


EARLIER = 0.1
"""Part of the first lag from which free flight is drawn, at least."""


def _free_flight(axes: Axes, one: Displacement, t: Array, unit: float, color: str, label: str | None) -> None:
    """<v^2> t^2 by the velocities of the frames, from before the first lag if flight ends earlier.

    It meets diffusion, 2 d D t in d directions, at 2 d D / <v^2>.
    """
    begin = t[0]
    if one.fit is not None and one.fit.D > 0.0:
        begin = min(begin, max(2.0 * one.msd.components * one.fit.D / one.flight, EARLIER * begin))
    when = np.geomspace(begin, t[-1], 50)
    axes.plot(when, one.flight / unit * when**2, ":", color=color, lw=1.2, label=label)


OWN_LAG = r"lag $\tau$ (collisions per disk)"


def vacf(axes: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """Velocity autocorrelations over their values at 0; over a logarithmic time, without lag 0, if frames are so."""
    own_time = "tau" in evaluation.tables.get("", {})
    for i, (name, found) in enumerate(evaluation.result.items()):
        step = np.diff(found.lag)
        # Evenly spaced frames have steps of one length, those due at collisions of a cooling gas longer ones.
        logarithmic = len(step) > 2 and step.max() > 10.0 * step.min()
        t, value, error = (each[int(logarithmic) :] for each in (found.lag, found.value, found.error))
        style = marked_line(KINDS[i % len(KINDS)], lw=0.8)
        half = student_t(found.disks) * error / found.value[0]
        axes.errorbar(t, value / found.value[0], half, ms=3.5, label=plain(name), **style)
        if logarithmic:
            axes.set_xscale("log")
            few_labels(axes)
    axes.axhline(0.0, color=RATIO, ls=":", lw=1.2)
    for row in evaluation.rows:
        if row.name == "decay by kinetic theory, collisions per disk":
            axes.plot(t, np.exp(-t / row.value), "--", color=ROTATION, lw=1.2, label="kinetic theory")
    if len(axes.lines) > 2 or len(evaluation.result) > 1:
        legend(axes)
    axes.set_xlabel(OWN_LAG if own_time else label(trajectory, "lag $t$", "time"))
    text = r"\langle c(0) \cdot c(\tau) \rangle" if own_time else r"\langle v(0) \cdot v(t) \rangle"
    axes.set_ylabel(rf"${text} \,/\, \langle {'c' if own_time else 'v'}^2 \rangle$")
    grid(axes)


def profiles(*axes_and_rest: Any) -> None:
    """Packing fraction, flow, temperatures; stress, heat flux, and theta or the temperatures of species."""
    *axes, trajectory, evaluation = axes_and_rest
    found = evaluation.result
    if isinstance(found, ProfileSequence):
        _sequence(axes, trajectory, found)
        return
    part = "" if found.has_collisions else "_kinetic"
    words = "" if found.has_collisions else ", kinetic part"
    if len(axes) == 3:  # of strips without an end, which have no area
        flow, temperatures, last = axes
    else:
        density, flow, temperatures, stress, heat, last = axes
        _density(density, found)
        for (i, j), color in zip(INDICES, COLORS, strict=True):
            text = f"$P_{{{found.directions[i]}{found.directions[j]}}}$"
            _curve(stress, found, f"stress{part}", (i, j), text, color)
        stress.set_ylabel(label(trajectory, f"pressure tensor{words}", "energy/length^2"))
        _components(
            heat, trajectory, found, f"heat_flux{part}", "q", f"heat flux{words}", "energy/(length time)"
        )
    _components(flow, trajectory, found, "velocity", "u", "mean velocity", "length/time")
    _temperatures(temperatures, trajectory, found)
    if found.species:
        for i, (name, one) in enumerate(found.species.items()):
            _curve(last, one, "temperature", (), plain(name), KINDS[i % len(KINDS)])
        last.set_ylabel(label(trajectory, "temperature $T$ of species", "energy"))
    elif not np.any(np.nan_to_num(found.mean.theta)):
        last.set_visible(False)  # nothing spins
    else:
        _curve(last, found, "theta", (), "", ROTATION)
        last.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
    last.set_ylim(bottom=0.0)
    for one in axes:
        legend_above(one, 4)
    for one in axes:
        one.set_xlabel(label(trajectory, f"${found.axes[0]}$", "length"))
    grid(*axes)


def _sequence(axes: Sequence[Axes], trajectory: Trajectory | None, found: ProfileSequence) -> None:
    """Profiles over time, or at phases: one component of each quantity, from dark (first) to light (last)."""
    first = found.profiles[0]
    normal = 1 if first.axes[0] == "y" else 0
    name = first.directions[normal]
    part, words = ("", "") if first.has_collisions else ("_kinetic", ", kinetic part")
    panels: list[tuple[str, tuple[int, ...], str, str]] = [
        ("packing_fraction", (), r"packing fraction $\phi$", ""),
        ("velocity", (normal,), f"mean velocity $u_{name}$", "length/time"),
        ("temperature", (), "temperature $T$", "energy"),
        (f"stress{part}", (normal, normal), f"$P_{{{name}{name}}}${words}", "energy/length^2"),
        (f"heat_flux{part}", (normal,), f"heat flux $q_{name}${words}", "energy/(length time)"),
        ("theta", (), r"$\theta = T_\mathrm{rot} / T$", ""),
    ]
    if len(axes) == 3:  # of strips without an end, which have no density
        panels = [*panels[1:3], panels[5]]
    elif len(axes) == 2:
        panels = [panels[0 if np.isfinite(first.mean.packing_fraction).any() else 1], panels[2]]
    for one, (quantity, at, text, dimension) in zip(axes, panels, strict=True):
        for i, (place, each) in enumerate(zip(found.places, found.profiles, strict=True)):
            value = getattr(each.mean, quantity)[(..., *at)]
            if quantity in OF_DISKS:
                value = np.where(each.disks >= FEWEST, value, np.nan)
            words = with_unit(trajectory, f"{place:.4g}", "time") if found.over == "time" else f"{place:.3g}"
            shade = DARKEST + (LIGHTEST - DARKEST) * i / max(len(found.places) - 1, 1)
            style: dict[str, Any] = {
                "color": colormaps["cividis"](shade),
                "ls": LOOKS[KINDS[i % len(KINDS)]][2],
            }
            text_of = f"{'$t$ = ' if found.over == 'time' else 'phase '}{words}"
            one.plot(each.middles[0], value, lw=1.3, label=text_of, **style)
        one.set_ylabel(label(trajectory, text, dimension) if dimension else text)
        one.set_xlabel(label(trajectory, f"${first.axes[0]}$", "length"))
    if len(axes) > 2 and not any(np.any(np.nan_to_num(each.mean.theta)) for each in found.profiles):
        axes[-1].set_visible(False)  # nothing spins
    legend_above(axes[0], 3)
    grid(*axes)


DARKEST, LIGHTEST = 0.0, 0.7
"""Part of the map of colours, dark to light, that curves of a sequence have."""


def cycle(left: Axes, right: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """Temperatures, and the centre of mass or what is in regions, at the phases of the walls, with 95 % intervals."""
    found = evaluation.result
    groups = {left: [name for name in found if "temperature" in name]}
    regions = [name for name in found if name.startswith("region_disks")]
    groups[right] = regions or [name for name in found if name.startswith("center_of_mass")]
    for axes, names in groups.items():
        for name, color in zip(names, KINDS, strict=False):
            one = found[name]
            half = student_t(one.n_eff) * one.error
            axes.errorbar(
                one.phase,
                one.mean,
                half,
                label=WORDS.get(name) or plain(name.partition("/")[2] or name),
                **marked_line(color, ms=4, lw=1.0),
            )
        axes.set_xlabel("phase of the wall (periods)")
        axes.set_xlim(-0.02, 1.0)
        legend_above(axes, 3)
    left.set_ylabel(label(trajectory, "temperature", "energy"))
    right.set_ylabel("disks in the region" if regions else label(trajectory, "centre of mass", "length"))
    grid(left, right)


WORDS = {
    "temperature": "$T$", "rotational_temperature": r"$T_\mathrm{rot}$", "center_of_mass/x": "$x$",
    "center_of_mass/y": "$y$",
}  # fmt: skip
"""Symbols of quantities in legends."""


FEWEST = 20
"""Disks of a bin, over all frames, below which their mean velocity and temperatures are not drawn."""
FEWEST_INDEPENDENT = 3.0
"""n_eff below which an interval, of 4.3 (n_eff = 3) to 12.7 (2) standard errors, does not set an axis."""
TENSOR = ("xx", "yy", "xy", "yx")
INDICES = ((0, 0), (1, 1), (0, 1), (1, 0))
COLORS = (TRANSLATION, ROTATION, RATIO, KINDS[2])


def _curve(
    axes: Axes,
    found: analysis.BinAverages,
    name: str,
    at: tuple[int, ...],
    text: str,
    color: str,
) -> None:
    """A component of a quantity along the bins, with its 95 % interval.

    Means over disks (`averages.OF_DISKS`) are not drawn of bins with fewer than `FEWEST` disks over all frames, and
    their axis is that of bins with one disk a frame or more in the mean, if there are any. Of other quantities the axis
    does without the intervals of bins with fewer than `FEWEST` disks. Of all it does without the intervals of n_eff
    below `FEWEST_INDEPENDENT`, which reach beyond it.
    """
    value, error, n_eff = (getattr(one, name)[(..., *at)] for one in (found.mean, found.error, found.n_eff))
    half = np.nan_to_num(error * student_t(n_eff))
    style = marked_line(color, ms=3.5, lw=0.9)
    shown, filled = np.isfinite(value), found.disks >= FEWEST
    if name in OF_DISKS:
        shown = shown & filled
        filled = found.disks >= found.frames
    filled = shown & filled if (shown & filled).any() else shown
    whole = filled if name in OF_DISKS else shown
    certain = filled & (n_eff >= FEWEST_INDEPENDENT)
    axes.errorbar(
        found.middles[0],
        np.where(whole, value, np.nan),
        np.where(certain, half, 0.0),
        label=text or None,
        **style,
    )
    limits = axes.dataLim.frozen()
    rest = shown & ~certain
    axes.errorbar(found.middles[0][rest], value[rest], half[rest], **(style | {"ls": "none"}))
    axes.dataLim.set(limits)


def _density(axes: Axes, found: analysis.BinAverages) -> None:
    _curve(axes, found, "packing_fraction", (), "all" if found.species else "", TRANSLATION)
    for i, (name, one) in enumerate(found.species.items()):
        _curve(axes, one, "packing_fraction", (), plain(name), KINDS[(i + 1) % len(KINDS)])
    axes.set_ylabel(r"packing fraction $\phi$")
    axes.set_ylim(bottom=0.0)


def _temperatures(axes: Axes, trajectory: Trajectory | None, found: analysis.BinAverages) -> None:
    for i, color in enumerate((TRANSLATION, RATIO)):
        _curve(axes, found, "temperatures", (i,), f"$T_{found.directions[i]}$", color)
    if np.any(np.nan_to_num(found.mean.rotational_temperature)):
        _curve(axes, found, "rotational_temperature", (), r"$T_\mathrm{rot}$", ROTATION)
    axes.set_ylabel(label(trajectory, "temperature", "energy"))
    axes.set_ylim(bottom=0.0)


def _components(
    axes: Axes, trajectory: Trajectory | None, found: analysis.BinAverages, name: str, symbol: str, text: str,
    quantity: str,
) -> None:  # fmt: skip
    for i, direction in enumerate(found.directions):
        _curve(axes, found, name, (i,), f"${symbol}_{direction}$", (TRANSLATION, ROTATION)[i])
    axes.set_ylabel(label(trajectory, text, quantity))


def fields(left: Axes, right: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """Maps of the packing fraction with the flow, and of the thermal temperature."""
    found = evaluation.result
    averaged = isinstance(found, analysis.BinAverages)
    (x, y), values = (found.middles, found.mean) if averaged else ((found.x, found.y), found)
    half = [0.5 * (one[1] - one[0]) if len(one) > 1 else one[0] for one in (x, y)]
    region = (x[0] - half[0], x[-1] + half[0], y[0] - half[1], y[-1] + half[1])
    style: dict[str, Any] = {"origin": "lower", "extent": region, "interpolation": "nearest"}
    drawn = left.imshow(values.packing_fraction.T, cmap="cividis", vmin=0.0, **style)
    place_axes(left, trajectory)
    color_bar(left, drawn, "packing fraction")
    every = max(1, -(-max(len(x), len(y)) // 24))
    where = (slice(every // 2, None, every),) * 2
    u = np.nan_to_num(values.velocity)
    speed = float(np.sqrt(np.mean(np.sum(u**2, axis=-1))))
    if speed > 0.0:
        arrows = (*np.meshgrid(x, y, indexing="ij"), u[..., 0], u[..., 1])
        left.quiver(*(each[where] for each in arrows), color="white", pivot="mid", width=0.003)
        text = f"{speed:.2g} {unit_of(trajectory, 'length/time') or ''}".strip()
        left.set_title(f"arrows: mean velocity in each cell (rms {text})", fontsize="medium")
    T = values.temperature
    high = float(np.nanquantile(T, 0.995)) if np.any(np.isfinite(T)) else 1.0
    drawn = right.imshow(T.T, cmap="inferno", vmin=0.0, vmax=high if high > 0.0 else 1.0, **style)
    place_axes(right, trajectory)
    color_bar(right, drawn, label(trajectory, "thermal temperature $T$", "energy"), "max")


def bin_averages(left: Axes, right: Axes, found: analysis.BinAverages) -> None:
    """Density and temperature: maps of cells, curves along strips and rings."""
    if len(found.axes) == 2:
        fields(left, right, None, _alone(found))
        return
    if np.isfinite(found.mean.packing_fraction).any():
        _density(left, found)
    else:  # strips without an end
        _components(left, None, found, "velocity", "u", "mean velocity", "length/time")
    _temperatures(right, None, found)
    for axes in (left, right):
        axes.set_xlabel(f"${found.axes[0]}$")
        legend_above(axes, 4)
    grid(left, right)


def clusters(left: Axes, right: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """The largest cluster in time, and how many clusters have which size in the last frame."""
    found = evaluation.result
    left.plot(found.times, [one.largest for one in found.clusters], "o-", ms=4, mfc="none", color=TRANSLATION)
    left.set(xlabel=label(trajectory, "time $t$", "time"), ylabel="share of disks in the largest cluster")
    from_zero(left)
    _sizes(right, trajectory, found.clusters[-1])
    right.set_ylabel("clusters, last frame")
    grid(left)


def _sizes(right: Axes, trajectory: Trajectory | None, found: analysis.Clusters) -> None:
    """Number of clusters of each size."""
    right.plot(*np.unique(found.sizes, return_counts=True), "o", ms=4, mfc="none", color=ROTATION)
    right.set(xscale="log", yscale="log", xlabel="disks in a cluster", ylabel="clusters")
    few_labels(right)
    gap = with_unit(trajectory, f"{found.gap:.3g}", "length")
    right.set_title(f"clusters: gaps between surfaces below {gap}", fontsize="medium")
    grid(right)


def psi6(left: Axes, right: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """|psi_6| of the disks of the last frame used, in place, and its distribution."""
    found = evaluation.result
    value, whole = np.abs(found.psi6), found.whole
    assert trajectory is not None
    frame = trajectory[int(np.argmin(np.abs(trajectory.times - evaluation.times[1])))]
    place_axes(left, trajectory, plot_disks.shown_region(trajectory, frame.position))
    # Some 4 points of the picture a disk where there are few, and a dot where there are many.
    size = float(np.clip(4e4 / len(frame.position), 0.2, 40.0))
    style: dict[str, Any] = {"c": value, "s": size, "lw": 0.0, "cmap": "cividis", "vmin": 0.0, "vmax": 1.0}
    color_bar(left, left.scatter(*frame.position.T, rasterized=True, **style), r"$|\psi_6|$")
    left.set_title(f"$t$ = {with_unit(trajectory, f'{frame.time:.4g}', 'time')}", fontsize="medium")
    _order(right, value, whole)


def _order(right: Axes, value: Array, whole: float) -> None:
    """Distribution of |psi_6|."""
    right.hist(value, 50, range=(0.0, 1.0), density=True, color=TRANSLATION)
    right.axvline(value.mean(), color=ROTATION, ls="--", lw=1.5, label=f"mean {value.mean():.3f}")
    right.axvline(whole, color=RATIO, ls=":", lw=1.5, label=rf"$|\langle\psi_6\rangle|$ {whole:.3f}")
    right.set(xlabel=r"$|\psi_6|$", ylabel="probability density", xlim=(0.0, 1.0))
    legend(right)
    grid(right)


def _with_error(value: float, error: float) -> str:
    """A number with its error, if it has one."""
    return f"({value:.3g} $\\pm$ {error:.1g})" if np.isfinite(error) else f"{value:.3g}"


def cooling(left: Axes, *rest: Any) -> None:
    """T against time with Haff's law, and theta against collisions per disk with its exponential.

    `rest` is the axes for theta, unless nothing spins, the trajectory or None, and the result.
    """
    *thetas, trajectory, evaluation = rest
    haff, ratio = evaluation.result
    table = evaluation.tables[""]
    t, T, tau, theta = (table[name] for name in ("time", "temperature", "collisions_per_disk", "theta"))
    left.plot(1.0 + (t - t[0]) / haff.t_H, T, "o", ms=4, mfc="none", color=TRANSLATION, label="disks")
    _haff(left, trajectory, haff, t[-1])
    for right in thetas:
        right.plot(tau, theta, "o", ms=4, mfc="none", color=ROTATION, label="disks")
        if ratio is not None:
            _approach(right, ratio, tau[0], tau[-1])
        right.set_xlabel(AXES["tau"])
        _thetas(right)


def _haff(axes: Axes, trajectory: Trajectory | None, haff: analysis.HaffFit, end: float) -> None:
    """Draw the fitted Haff's law up to a time."""
    x = np.geomspace(1.0, 1.0 + (end - haff.times[0]) / haff.t_H, 200)
    text = f"Haff's law, $t_H$ = {with_unit(trajectory, _with_error(haff.t_H, haff.t_H_error), 'time')}"
    if not haff.describes:
        text = f"best fit of {text} (poor)"
    axes.plot(x, haff.T0 / x**2, "--", color=RATIO, lw=1.5, label=text)
    if x[-1] > 2.0:  # a shorter stretch has no room for labels of a logarithm
        axes.set(xscale="log", yscale="log")
        few_labels(axes)
    axes.set(xlabel="$1 + (t - t_0) / t_H$", ylabel=label(trajectory, "temperature $T$", "energy"))
    legend(axes)
    grid(axes)


def _approach(axes: Axes, ratio: analysis.RatioFit, first: float, last: float) -> None:
    """Draw the fitted exponential from the start of the fit."""
    end = _with_error(ratio.theta_end, ratio.theta_end_error)
    if not np.isfinite(ratio.lag):
        if np.isfinite(ratio.theta_end):
            axes.axhline(
                ratio.theta_end, ls="--", color=RATIO, lw=1.5, label=f"no relaxation seen, mean {end}"
            )
        else:
            axes.plot([], [], " ", label="these data do not show an asymptote")
        return
    text = f"exponential, relaxation {_with_error(ratio.lag, ratio.lag_error)},\nasymptote {end}"
    if not ratio.describes:
        text = f"best fit (poor): {text}"
    fine = np.linspace(first, last, 300)
    curve = ratio.theta_end + (ratio.theta_0 - ratio.theta_end) * np.exp(-(fine - first) / ratio.lag)
    axes.plot(fine, curve, "--", color=RATIO, lw=1.5, label=text)


def _thetas(axes: Axes) -> None:
    axes.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
    axes.set_ylim(bottom=0.0)
    legend(axes)
    grid(axes)


def _ratio(axes: Axes, found: analysis.RatioFit) -> None:
    """The exponential over five lags: the fit does not know where its data end."""
    _approach(axes, found, 0.0, 5.0 * found.lag)
    axes.set_xlabel(r"$x - x_\mathrm{first}$ (times or collisions per disk, as in the fit)")
    _thetas(axes)


def _pressure(axes: Axes, found: analysis.Pressure) -> None:
    """The kinetic and the collisional part, and their sum."""
    error = np.nan_to_num([found.kinetic_error, found.collisional_error, found.error])
    parts = ("kinetic", "collisional", "total")
    axes.bar(parts, [getattr(found, one) for one in parts], yerr=error, **BARS)
    axes.set(xlabel="part, bars: standard error", ylabel="pressure $p$")
    axes.set_title(f"$p A / (N T)$ = {found.Z:.4g}", fontsize="medium")
    grid(axes)


def stress_in_flow(
    left: Axes, right: Axes, ratios: Axes, trajectory: Trajectory | None, evaluation: Evaluation
) -> None:
    """`stress` of a sheared gas, and ratios of its components."""
    stress(left, right, trajectory, evaluation)
    _flow_ratios(ratios, evaluation)


def stress(left: Axes, right: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """The pressure tensor in blocks of time, and the kinetic and collisional part of its mean."""
    found = evaluation.result
    names, at = TENSOR, INDICES
    for name, (a, b), color in zip(names, at, COLORS, strict=True):
        style = marks if name == "yx" else marked_line  # almost the same as xy
        left.plot(found.time, found.blocks[:, a, b], label=f"$P_{{{name}}}$", **style(color, ms=4.5, lw=1.0))
        left.axhline(found.stress.total[a, b], color=color, ls=":", lw=0.8)
    left.set(xlabel=label(trajectory, "time $t$", "time"))
    left.set_ylabel(label(trajectory, "$P_{ab}$, mean over a block of time", "energy/length^2"))
    left.axhline(0.0, color="0.7", lw=0.8, zorder=0)
    legend_above(left, 4)
    labels, place = [f"$P_{{{name}}}$" for name in names], np.arange(4.0)
    parts: tuple[tuple[str, Any, dict[str, Any]], ...] = (
        ("kinetic", found.stress.kinetic, {"color": TRANSLATION}),
        ("collisional", found.stress.collisional, {"color": ROTATION, "hatch": HATCH, "edgecolor": "white"}),
    )
    for i, (name, part, look) in enumerate(parts):
        right.bar(place + 0.27 * (i - 1), [part[one] for one in at], 0.25, label=name, **look)
    error = np.nan_to_num([found.error[one] for one in at])
    total = [found.stress.total[one] for one in at]
    right.bar(place + 0.27, total, 0.25, yerr=error, **BARS, label="sum, with standard error")
    right.axhline(0.0, color=RATIO, lw=0.8)
    right.set_xticks(place, labels)
    right.set_xlabel("component")
    right.set_ylabel(label(trajectory, "mean pressure tensor", "energy/length^2"))
    legend_above(right, 3)
    grid(left, right)


RATIOS_OF_FLOW = {
    "N_1": r"$N_1 = (P_{xx} - P_{yy}) / p$",
    "friction": "$-P_{xy} / P_{yy}$",
    "T_x_over_T_y": "$T_x / T_y$",
}
"""Labels of ratios of a flow, by their keys."""


def _flow_ratios(axes: Axes, evaluation: Evaluation) -> None:
    """Ratios of stresses of a sheared gas with their intervals, beside those of the theory in use."""
    rows = {row.key: row for row in evaluation.rows}
    known = [rows[key] for key in RATIOS_OF_FLOW if key in rows]
    place = np.arange(float(len(known)))
    half = [float(student_t(row.n_eff)) * row.error for row in known]
    axes.errorbar(
        place, [row.value for row in known], half, ms=6, capsize=3.0, label=f"disks, {PERCENT} intervals", **marks(TRANSLATION)
    )  # fmt: skip
    of_theory = [rows.get(f"{row.key}_theory") for row in known]
    there, by = np.array([each is not None for each in of_theory]), [each for each in of_theory if each]
    if by:
        values = [each.value for each in by]
        axes.plot(
            place[there], values, "_", ms=22, mew=1.8, color=ROTATION, label=f"{name_of_theory()} (homogeneous flow)"
        )  # fmt: skip
        if any(each.error > 0.0 for each in by):
            wide = [float(student_t(each.n_eff)) * each.error for each in by]
            axes.errorbar(place[there], values, wide, fmt="none", ecolor=ROTATION, capsize=6.0)
    axes.set_xticks(place, [RATIOS_OF_FLOW[row.key] for row in known])
    axes.set(xlim=(-0.5, len(known) - 0.5), ylabel="ratio of mean stresses, or temperatures")
    axes.set_ylim(bottom=min(0.0, *(row.value for row in known)))
    legend_above(axes, 1)
    grid(axes)


COEFFICIENTS = {
    "eta": (r"shear viscosity $\eta$", "mass/time"), "kappa": (r"heat conductivity $\kappa$", "1/time"),
    "D": ("self-diffusion $D$", "length^2/time"),
}  # fmt: skip
"""Words and dimensions of transport coefficients."""


def transport(*given: Any) -> None:
    """Viscosity, heat conductivity and self-diffusion against the lag, by both formulas, with Enskog's values."""
    *panels, trajectory, evaluation = given
    values = {row.key: row.value for row in evaluation.rows}
    for axes, (name, (text, dimension)) in zip(panels, COEFFICIENTS.items(), strict=True):
        axes.set_ylabel(label(trajectory, text, dimension))
        axes.set_xlabel(label(trajectory, "lag $t$", "time"))
        if name in evaluation.result:
            coefficient(axes, evaluation.result[name], values.get(f"{name}_enskog"))
        else:
            needs = {"eta": "output.stress = true", "kappa": "output.heat_flux = true", "D": "output.frames"}
            axes.text(
                0.5, 0.5, f"none: see the table\n({needs[name]})", ha="center", transform=axes.transAxes
            )
    grid(*panels)


def coefficient(axes: Axes, found: analysis.TransportCoefficient, enskog: float | None = None) -> None:
    """A transport coefficient against the lag: the integral, and the mean square over twice the lag."""
    for t, value, error, text, color in (
        (found.lags, found.integral, found.integral_error, "Green-Kubo", TRANSLATION),
        (found.square_lags, found.square, found.square_error, "Helfand, $M / 2t$", ROTATION),
    ):
        if not len(t):
            continue
        band = student_t(found.helfand.n_eff) * error
        hatch: Any = {"hatch": HATCH} if color == ROTATION else {}
        axes.fill_between(t, value - band, value + band, alpha=0.25, lw=0.0, color=color, **hatch)
        axes.plot(t, value, lw=1.5, label=f"{text}, band: {PERCENT}", **dashes(color))
    if enskog is not None:
        axes.axhline(enskog, color=RATIO, ls=":", lw=1.5, label="Enskog")
    result, place = found.green_kubo, found.lag
    if not len(found.lags):
        result, place = found.helfand, float(found.square_lags[-1])
    half = float(student_t(result.n_eff)) * result.error
    axes.errorbar([place], [result.mean], [half], ms=6, capsize=3.0, label="result", **marks(KINDS[2]))
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    legend(axes, "lower right")


def impact(left: Axes, right: Axes, trajectory: Trajectory | None, evaluation: Evaluation) -> None:
    """The density of the impact angle, that of molecular chaos, and shares of the regimes."""
    found = evaluation.result
    text = f"{found.collisions} collisions"
    left.errorbar(np.degrees(found.psi), found.density, found.density_error, ms=4, label=text, **POINTS)
    fine = np.linspace(0.0, 90.0, 200)
    left.plot(fine, np.cos(np.radians(fine)), "-", color=RATIO, lw=1.5, label=r"molecular chaos, $\cos\psi$")
    left.set(xlabel=r"angle of impact $\psi$ (degrees)", ylabel="probability density (1/rad)")
    left.set(xlim=(0.0, 90.0))
    left.set_ylim(bottom=0.0)
    legend(left)
    share, error = np.array(list(found.regimes.values())).reshape(-1, 2).T
    right.barh(list(found.regimes), share, xerr=error, **BARS)
    right.set(xlim=(0.0, 1.0), xlabel="share of collisions, bars: standard error")
    right.set_title(f"regimes of {found.regime_collisions} collisions", fontsize="medium")
    grid(left, right)


def histograms(*given: Any) -> None:
    """Distributions by the angle of impact, the normal speed and the free time, and those in equilibrium."""
    *panels, trajectory, evaluation = given
    for i, (pair, found) in enumerate(evaluation.result.items()):
        for axes, name in zip(panels, TITLES, strict=True):
            if name in found:
                distribution(
                    axes, trajectory, found[name], pair, **marks(KINDS[i % len(KINDS)], ms=4, lw=0.8)
                )
    for axes, name in zip(panels, TITLES, strict=True):
        axes.set_title(TITLES[name], fontsize="medium")
        if not axes.lines:
            axes.text(
                0.5, 0.5, "output.free_times = true\nrecords them", ha="center", transform=axes.transAxes
            )
    for axes in panels[1:]:
        axes.set_ylabel("")
    legend(panels[0])
    grid(*panels)


def distribution(
    axes: Axes, trajectory: Trajectory | None, found: analysis.CollisionDistribution, name: str, **style: Any
) -> None:
    """A distribution of collisions, with the line of equilibrium, in parts of that line's maximum."""
    middle, highest = 0.5 * (found.edges[1:] + found.edges[:-1]), found.equilibrium.max()
    # On a logarithmic axis a bar that reaches 0 says nothing.
    shown = found.density > (0.0 if found.name == "impact_angle" else 2.0 * found.density_error)
    if found.name == "impact_angle":
        middle = np.degrees(middle)
    error = found.density_error[shown] / highest
    axes.errorbar(middle[shown], found.density[shown] / highest, error, label=name, **style)
    line = None if any(each.get_label() == "equilibrium" for each in axes.lines) else "equilibrium"
    axes.plot(middle[shown], found.equilibrium[shown] / highest, "-", color=RATIO, lw=1.5, label=line)
    quantity, dimension = {
        "impact_angle": (r"angle of impact $\psi$ (degrees)", None), "normal_speed": ("normal speed $g_n$", "length/time"),
        "free_time": ("free time $t$", "time"),
    }[found.name]  # fmt: skip
    axes.set_xlabel(quantity if dimension is None else label(trajectory, quantity, dimension))
    axes.set_ylabel("density over that in equilibrium at its maximum")
    if found.name == "impact_angle":
        axes.set_ylim(bottom=0.0)
    else:
        axes.set(xscale="log", yscale="log")


def _coefficient_alone(axes: Axes, found: analysis.TransportCoefficient) -> None:
    """A transport coefficient of rows."""
    coefficient(axes, found)
    axes.set(xlabel="lag $t$", ylabel="transport coefficient")
    grid(axes)


def _cycle_alone(axes: Axes, found: analysis.Cycle) -> None:
    """Means of a series at phases."""
    half = student_t(found.n_eff) * found.error
    axes.errorbar(
        found.phase, found.mean, half, label=f"{found.periods} periods, {PERCENT} intervals", **POINTS
    )
    axes.set(xlabel="phase (periods)", ylabel="mean")
    legend(axes)
    grid(axes)


class Panels(NamedTuple):
    """A picture of an analysis: its drawing function and the arguments of `Figure.subplots`."""

    draw: Callable[..., None]
    layout: dict[str, Any] = {}  # noqa: RUF012


TWO: dict[str, Any] = {"ncols": 2}
STACKED: dict[str, Any] = {"nrows": 2, "sharex": True}
PANELS = {
    "velocity": Panels(velocity, TWO), "tail": Panels(tail), "rdf": Panels(pairs), "structure-factor": Panels(structure), "msd": Panels(msd),
    "vacf": Panels(vacf), "profiles": Panels(profiles, {"nrows": 2, "ncols": 3, "sharex": True}),
    "cycle": Panels(cycle, TWO), "fields": Panels(fields, TWO), "clusters": Panels(clusters, TWO),
    "psi6": Panels(psi6, TWO | {"width_ratios": (1.3, 1.0)}), "stress": Panels(stress, TWO),
    "transport": Panels(transport, {"ncols": 3}),
    "velocity-correlation": Panels(vortices.correlation, TWO), "vorticity": Panels(vortices.spectrum, TWO),
    "cooling": Panels(cooling, TWO), "species": Panels(species.temperatures, STACKED),
    "impact": Panels(impact, TWO | {"width_ratios": (1.4, 1.0)}), "histograms": Panels(histograms, {"ncols": 3}),
}  # fmt: skip
"""Name of the analysis -> its picture."""


def _alone(found: Any) -> Evaluation:
    """A result that belongs to no file."""
    return Evaluation(found, [], {}, [], (np.nan, np.nan))


def _correlation(axes: Axes, found: analysis.Correlation) -> None:
    """A mean-square displacement, which begins at 0, or an autocorrelation."""
    if found.value[0] == 0.0:
        msd(axes, None, _alone({"all disks": Displacement(found, None)}))
    else:
        vacf(axes, None, _alone({"all disks": found}))


RESULTS: dict[type[Any], Panels] = {
    analysis.VelocityDistribution: Panels(
        lambda left, right, found: velocity(left, right, None, _alone({"all": found})), TWO
    ),
    analysis.SpeedTail: Panels(lambda axes, found: tail(axes, None, _alone({"all": found}))),
    analysis.PairCorrelation: Panels(lambda axes, found: pairs(axes, None, _alone({"all": found}))),
    analysis.StructureFactor: Panels(lambda axes, found: structure(axes, None, _alone(found))),
    analysis.Correlation: Panels(_correlation),
    analysis.BinAverages: Panels(bin_averages, TWO),
    analysis.VelocityCorrelation: Panels(lambda axes, found: vortices.correlation_alone(axes, None, found)),
    analysis.VelocitySpectrum: Panels(lambda axes, found: vortices.spectrum_alone(axes, None, found)),
    analysis.Fields: Panels(lambda left, right, found: fields(left, right, None, _alone(found)), TWO),
    analysis.Clusters: Panels(lambda axes, found: _sizes(axes, None, found)),
    analysis.Hexatic: Panels(lambda axes, found: _order(axes, np.abs(found.psi6), found.whole)),
    analysis.HaffFit: Panels(lambda axes, found: _haff(axes, None, found, found.times[1])),
    analysis.RatioFit: Panels(_ratio),
    analysis.Pressure: Panels(_pressure),
    analysis.MeanStress: Panels(lambda left, right, found: stress(left, right, None, _alone(found)), TWO),
    ProfileSequence: Panels(
        lambda *given: _sequence(given[:-1], None, given[-1]), TWO
    ),
    analysis.Cycle: Panels(lambda axes, found: _cycle_alone(axes, found)),
    analysis.TransportCoefficient: Panels(_coefficient_alone),
    analysis.CollisionDistribution: Panels(
        lambda axes, found: distribution(axes, None, found, f"{found.count} collisions", **POINTS)
    ),
    analysis.Impacts: Panels(lambda left, right, found: impact(left, right, None, _alone(found)), TWO),
}  # fmt: skip
"""Type of a result of `ifrdem.analysis` -> its picture, which takes the axes and the result."""
