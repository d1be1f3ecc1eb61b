"""Panels of what analyses find: distributions, g(r), S(k), displacements, fields, clusters, angles of impact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .. import analysis
from ..analysis.result import Evaluation
from ..trajectory.reader import Trajectory
from . import disks as plot_disks
from .style import (
    ACROSS,
    OPEN,
    RATIO,
    ROTATION,
    TRANSLATION,
    few_labels,
    from_zero,
    grid,
    label,
    legend_above,
    place_axes,
    unit_of,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours for kinds of disks.
KINDS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#999999")
MARKERS = "os^Dv<>P"
POINTS: dict[str, Any] = {"fmt": "o", "lw": 0.8, "mfc": "none", "color": TRANSLATION}


def velocity(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """Distributions of velocity components and spins, logarithmic, beside Gaussians and their Sonine expansion."""
    left, right = figure.subplots(1, 2, sharey=True)
    x = np.linspace(-5.0, 5.0, 400)
    lowest = highest = float(analysis.gaussian(x).max())
    for i, (name, found) in enumerate(outcome.result.items()):
        look = OPEN | {"color": KINDS[i % 8], "marker": MARKERS[i % 8], "ms": 4, "lw": 0.8}
        for axes, middle, density, error in (
            (left, found.speed, found.density, found.density_error),
            (right, found.spin, found.spin_density, found.spin_density_error),
        ):
            seen = density > 0.0
            if np.any(seen):
                lowest, highest = min(lowest, density[seen].min()), max(highest, density[seen].max())
                axes.errorbar(middle[seen], density[seen], error[seen], label=name.split(",")[0], **look)
    sonine = next(iter(outcome.result.values())).sonine
    for axes, a2, text in ((left, sonine.a20, "a_{20}"), (right, sonine.a02, "a_{02}")):
        axes.plot(x, analysis.gaussian(x), "-", color=RATIO, lw=1.2, label="Gaussian")
        if np.isfinite(a2) and len(outcome.result) == 1:
            expansion = analysis.sonine_density(x, a2)
            shown = np.where(expansion > 0.0, expansion, np.nan)
            highest = max(highest, float(np.nanmax(shown)))
            axes.plot(x, shown, "--", color=ROTATION, lw=1.2, label=rf"with ${text} = {a2:.3g}$")
        if not axes.lines or not np.isfinite(a2):
            axes.text(0.5, 0.5, "no spins", transform=axes.transAxes, ha="center")
        axes.set(yscale="log", xlim=(-5.0, 5.0))
        legend_above(axes)
    left.set_ylim(0.3 * lowest, 2.0 * highest)  # the right one shares it
    left.set(xlabel=r"$c = v_{x,y} / \sqrt{2 T / m}$", ylabel="probability density")
    right.set_xlabel(r"$w = \omega / \sqrt{2 T_\mathrm{rot} / I}$")
    grid(left, right)


def pairs(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """g(r) with its errors, and its value at contact."""
    axes, found = figure.subplots(), outcome.result
    r, seen = found.r / (2.0 * float(trajectory.disks.radius.mean())), found.pairs > 0.0
    low, high = ((found.g + sign * found.g_error)[seen] for sign in (-1.0, 1.0))
    axes.fill_between(r[seen], low, high, color=ACROSS, lw=0.0, alpha=0.6)
    axes.plot(r, found.g, "-", color=TRANSLATION, lw=1.2, label="disks, band: standard error")
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label="ideal gas")
    for row in outcome.rows:
        if row.name == "g at contact":
            text = f"at contact: {row.value:.3f} $\\pm$ {row.error:.3f}"
            look = OPEN | {"color": ROTATION, "marker": "D", "ms": 6}
            axes.errorbar([1.0], [row.value], [row.error], label=text, **look)
    axes.set(xlim=(0.0, float(r[-1])), xlabel="$r$ (mean diameters)", ylabel="$g(r)$")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="best", frameon=False)
    grid(axes)


def structure(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """S(k), double logarithmic, with its errors."""
    axes, found = figure.subplots(), outcome.result
    k = found.k * 2.0 * float(trajectory.disks.radius.mean())
    axes.errorbar(k, found.S, found.S_error, ms=3, label="disks", **POINTS)
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label="ideal gas")
    axes.set(xscale="log", yscale="log", xlabel=r"$k$ $\times$ mean diameter", ylabel="$S(k)$")
    axes.legend(loc="best", frameon=False)
    grid(axes)


def msd(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """The mean-square displacement, double logarithmic, with ballistic flight and the fitted diffusion."""
    axes = figure.subplots()
    found, fit = outcome.result
    later = found.lag > 0.0
    t, value = found.lag[later], found.value[later]
    axes.errorbar(t, value, found.error[later], ms=3.5, label="disks", **POINTS)
    axes.plot(t, value[0] * (t / t[0]) ** 2, ":", color=RATIO, lw=1.2, label="free flight, $t^2$")
    used = (t >= fit.lags[0]) & (t <= fit.lags[1])
    line = value[used].mean() + 2.0 * found.components * fit.D * (t - t[used].mean())
    text = f"line, $D$ = {fit.D:.3g} $\\pm$ {fit.error:.1g} {unit_of(trajectory, 'length^2/time') or ''}".rstrip()
    if outcome.doubts:  # no single D
        text = "straight line (the gas is not steady: no $D$)"
    elif abs(fit.exponent - 1.0) > 0.2:
        text += f"\n(no diffusion: exponent {fit.exponent:.2f})"
    axes.plot(t[used], line[used], "-", color=ROTATION, lw=2.0, zorder=5, label=text)
    axes.set(xscale="log", yscale="log", ylim=(0.5 * value.min(), 3.0 * value.max()))
    few_labels(axes)
    axes.set_xlabel(label(trajectory, "lag $t$", "time"))
    axes.set_ylabel(label(trajectory, r"$\langle |\Delta r|^2 \rangle$", "length^2"))
    axes.legend(loc="lower right", frameon=False)
    grid(axes)


def vacf(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """The velocity autocorrelation over its value at 0; over a logarithmic time, without lag 0, if frames are so."""
    axes, found = figure.subplots(), outcome.result
    step = np.diff(found.lag)
    # Evenly spaced frames have steps of one length, those due at collisions of a gas that cools longer and longer ones.
    logarithmic = len(step) > 2 and step.max() > 10.0 * step.min()
    t, value, error = (each[int(logarithmic) :] for each in (found.lag, found.value, found.error))
    axes.errorbar(t, value / found.value[0], error / found.value[0], ms=3.5, **POINTS | {"fmt": "o-"})
    axes.axhline(0.0, color=RATIO, ls=":", lw=1.2)
    if logarithmic:
        axes.set_xscale("log")
        few_labels(axes)
    axes.set_xlabel(label(trajectory, "lag $t$", "time"))
    axes.set_ylabel(r"$\langle v(0) \cdot v(t) \rangle \,/\, \langle v^2 \rangle$")
    grid(axes)


def fields(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """Maps of the packing fraction with the flow, and of the thermal temperature."""
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    found = outcome.result
    half = [0.5 * (one[1] - one[0]) if len(one) > 1 else one[0] for one in (found.x, found.y)]
    region = (found.x[0] - half[0], found.x[-1] + half[0], found.y[0] - half[1], found.y[-1] + half[1])
    look: dict[str, Any] = {"origin": "lower", "extent": region, "interpolation": "nearest"}
    drawn = left.imshow(found.packing_fraction.T, cmap="cividis", vmin=0.0, **look)
    figure.colorbar(drawn, ax=left, shrink=0.8).set_label("packing fraction")
    every = max(1, -(-max(len(found.x), len(found.y)) // 24))
    where = (slice(every // 2, None, every),) * 2
    u = np.nan_to_num(found.velocity)
    speed = float(np.sqrt(np.mean(np.sum(u**2, axis=-1))))
    if speed > 0.0:
        arrows = (*np.meshgrid(found.x, found.y, indexing="ij"), u[..., 0], u[..., 1])
        left.quiver(*(each[where] for each in arrows), color="white", pivot="mid", width=0.003)
        text = f"{speed:.2g} {unit_of(trajectory, 'length/time') or ''}".strip()
        left.set_title(f"arrows: mean velocity of cells, rms {text}", fontsize="medium")
    T = found.temperature
    high = float(np.nanquantile(T, 0.995)) if np.any(np.isfinite(T)) else 1.0
    drawn = right.imshow(T.T, cmap="inferno", vmin=0.0, vmax=high if high > 0.0 else 1.0, **look)
    bar = figure.colorbar(drawn, ax=right, extend="max", shrink=0.8)
    bar.set_label(label(trajectory, "thermal temperature $T$", "energy"))
    for axes in (left, right):
        place_axes(axes, trajectory)
    right.set_ylabel("")


def clusters(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """The largest cluster in time, and how many clusters have which size in the last frame."""
    left, right = figure.subplots(1, 2)
    found = outcome.result
    left.plot(found.times, [one.largest for one in found.clusters], "o-", ms=4, mfc="none", color=TRANSLATION)
    left.set(xlabel=label(trajectory, "time $t$", "time"), ylabel="share of disks in the largest cluster")
    from_zero(left)
    right.plot(
        *np.unique(found.clusters[-1].sizes, return_counts=True), "o", ms=4, mfc="none", color=ROTATION
    )
    right.set(xscale="log", yscale="log", xlabel="disks in a cluster", ylabel="clusters, last frame")
    few_labels(right)
    gap = trajectory.with_unit(f"{found.clusters[-1].gap:.3g}", "length")
    right.set_title(f"joined where surfaces are nearer than {gap}", fontsize="medium")
    grid(left, right)


def psi6(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """|psi_6| of the disks of the last frame used, in place, and its distribution."""
    left, right = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    value, whole = np.abs(outcome.result.psi6), outcome.result.whole
    frame = trajectory[int(np.argmin(np.abs(trajectory.times - outcome.times[1])))]
    place_axes(left, trajectory, plot_disks.shown_region(trajectory, frame.position))
    # Some 4 points of the picture a disk where there are few, and a dot where there are many.
    size = float(np.clip(4e4 / len(frame.position), 0.2, 40.0))
    look: dict[str, Any] = {"c": value, "s": size, "lw": 0.0, "cmap": "cividis", "vmin": 0.0, "vmax": 1.0}
    drawn = left.scatter(*frame.position.T, rasterized=True, **look)
    figure.colorbar(drawn, ax=left, shrink=0.85).set_label(r"$|\psi_6|$")
    left.set_title(f"$t$ = {trajectory.with_unit(f'{frame.time:.4g}', 'time')}", fontsize="medium")
    right.hist(value, 50, range=(0.0, 1.0), density=True, color=TRANSLATION)
    right.axvline(value.mean(), color=ROTATION, ls="--", lw=1.5, label=f"mean {value.mean():.3f}")
    right.axvline(whole, color=RATIO, ls=":", lw=1.5, label=rf"$|\langle\psi_6\rangle|$ {whole:.3f}")
    right.set(xlabel=r"$|\psi_6|$", ylabel="probability density", xlim=(0.0, 1.0))
    right.legend(loc="best", frameon=False)
    grid(right)


def _with_error(value: float, error: float) -> str:
    """A number with its error, if it has one."""
    return f"({value:.3g} $\\pm$ {error:.1g})" if np.isfinite(error) else f"{value:.3g}"


def cooling(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """T against time with Haff's law, and theta against collisions per disk with its exponential."""
    left, right = figure.subplots(1, 2)
    haff, ratio = outcome.result
    table = outcome.tables[""]
    t, T, tau, theta = (table[name] for name in ("time", "temperature", "collisions_per_disk", "theta"))
    left.plot(1.0 + (t - t[0]) / haff.t_H, T, "o", ms=4, mfc="none", color=TRANSLATION, label="disks")
    x = np.geomspace(1.0, 1.0 + (t[-1] - t[0]) / haff.t_H, 200)
    text = f"Haff's law, $t_H$ = {trajectory.with_unit(_with_error(haff.t_H, haff.t_H_error), 'time')}"
    if not haff.describes:
        text = f"the nearest of {text},\nwhich does not describe it"
    left.plot(x, haff.T0 / x**2, "--", color=RATIO, lw=1.5, label=text)
    if x[-1] > 2.0:  # a shorter stretch has no room for labels of a logarithm
        left.set(xscale="log", yscale="log")
        few_labels(left)
    left.set(xlabel="$1 + (t - t_0) / t_H$", ylabel=label(trajectory, "temperature $T$", "energy"))
    left.legend(loc="best", frameon=False)
    right.plot(tau, theta, "o", ms=4, mfc="none", color=ROTATION, label="disks")
    if ratio is not None:
        end = _with_error(ratio.theta_end, ratio.theta_end_error)
        text = f"exponential, lag {_with_error(ratio.lag, ratio.lag_error)},\nend {end}"
        if not ratio.describes:
            text = f"nearest {text},\nwhich does not describe it"
        fine = np.linspace(tau[0], tau[-1], 300)
        curve = ratio.theta_end + (ratio.theta_0 - ratio.theta_end) * np.exp(-(fine - tau[0]) / ratio.lag)
        right.plot(fine, curve, "--", color=RATIO, lw=1.5, label=text)
    right.set(xlabel="collisions per disk", ylabel=r"$\theta = T_\mathrm{rot} / T$")
    right.set_ylim(bottom=0.0)
    right.legend(loc="best", frameon=False)
    grid(left, right)


def impact(figure: Figure, trajectory: Trajectory, outcome: Evaluation) -> None:
    """The density of the angle of impact beside that of molecular chaos, and shares of the regimes."""
    left, right = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
    found = outcome.result
    text = f"{found.collisions} collisions"
    left.errorbar(np.degrees(found.psi), found.density, found.density_error, ms=4, label=text, **POINTS)
    fine = np.linspace(0.0, 90.0, 200)
    left.plot(fine, np.cos(np.radians(fine)), "-", color=RATIO, lw=1.5, label=r"molecular chaos, $\cos\psi$")
    left.set(
        xlim=(0.0, 90.0), xlabel=r"angle of impact $\psi$ (degrees)", ylabel="probability density (1/rad)"
    )
    left.set_ylim(bottom=0.0)
    left.legend(loc="best", frameon=False)
    share, error = np.array(list(found.regimes.values())).reshape(-1, 2).T
    look: dict[str, Any] = {"color": ACROSS, "ec": TRANSLATION, "ecolor": ROTATION, "capsize": 3.0}
    right.barh(list(found.regimes), share, xerr=error, **look)
    right.set(xlim=(0.0, 1.0), xlabel="share of collisions, bars: standard error")
    right.set_title(f"regimes of {found.regime_collisions} collisions", fontsize="medium")
    grid(left, right)


PANELS = {
    "velocity": velocity, "g": pairs, "S": structure, "msd": msd, "vacf": vacf, "fields": fields, "clusters": clusters,
    "psi6": psi6, "cooling": cooling, "impact": impact,
}  # fmt: skip
"""Name of the analysis -> what draws it."""
