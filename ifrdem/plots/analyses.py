"""Panels of what analyses find: distributions, g(r), S(k), displacements, fields, clusters, angles of impact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .. import analysis
from ..analysis.result import Outcome, unit
from ..trajectory.reader import Trajectory
from . import disks as plot_disks
from .style import ACROSS, RATIO, ROTATION, TRANSLATION, few_labels, from_zero, legend_above, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours for kinds of disks.
KINDS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#999999")
MARKERS = "os^Dv<>P"


def _unit(trajectory: Trajectory, text: str) -> str | None:
    """As `outcome.unit`, with raised twos; None in reduced units, as `with_unit` takes it."""
    return unit(trajectory, text).replace("^2", "\N{SUPERSCRIPT TWO}") or None


def _grid(*every: Any) -> None:
    for axes in every:
        axes.grid(True, which="major", lw=0.4, alpha=0.5)


def velocity(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """Distributions of velocity components and spins, logarithmic, beside Gaussians and their Sonine expansion."""
    left, right = figure.subplots(1, 2, sharey=True)
    x = np.linspace(-5.0, 5.0, 400)
    lowest = highest = float(analysis.gaussian(x).max())
    for i, (name, found) in enumerate(outcome.result.items()):
        for axes, middle, density, error in (
            (left, found.speed, found.density, found.density_error),
            (right, found.spin, found.spin_density, found.spin_density_error),
        ):
            seen = density > 0.0
            if not np.any(seen):
                continue
            lowest = min(lowest, float(density[seen].min()))
            highest = max(highest, float(density[seen].max()))
            look = {"color": KINDS[i % 8], "marker": MARKERS[i % 8], "mfc": "none"}
            axes.errorbar(
                middle[seen],
                density[seen],
                error[seen],
                ls="none",
                ms=4,
                lw=0.8,
                label=name.split(",")[0],
                **look,
            )
    sonine = next(iter(outcome.result.values())).sonine
    for axes, a2, label in ((left, sonine.a20, "a_{20}"), (right, sonine.a02, "a_{02}")):
        axes.plot(x, analysis.gaussian(x), "-", color=RATIO, lw=1.2, label="Gaussian")
        if np.isfinite(a2) and len(outcome.result) == 1:
            expansion = analysis.sonine_density(x, a2)
            shown = np.where(expansion > 0.0, expansion, np.nan)
            highest = max(highest, float(np.nanmax(shown)))
            axes.plot(x, shown, "--", color=ROTATION, lw=1.2, label=rf"with ${label} = {a2:.3g}$")
        if not axes.lines or not np.isfinite(a2):
            axes.text(0.5, 0.5, "no spins", transform=axes.transAxes, ha="center")
        axes.set_yscale("log")
        axes.set_xlim(-5.0, 5.0)
        legend_above(axes)
    left.set_ylim(0.3 * lowest, 2.0 * highest)  # the right one shares it
    left.set_xlabel(r"$c = v_{x,y} / \sqrt{2 T / m}$")
    right.set_xlabel(r"$w = \omega / \sqrt{2 T_\mathrm{rot} / I}$")
    left.set_ylabel("probability density")
    _grid(left, right)


def pairs(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """g(r) with its errors, and its value at contact."""
    axes, found = figure.subplots(), outcome.result
    diameter = 2.0 * float(trajectory.disks.radius.mean())
    seen = found.pairs > 0.0
    axes.fill_between(
        found.r[seen] / diameter,
        (found.g - found.g_error)[seen],
        (found.g + found.g_error)[seen],
        color=ACROSS,
        lw=0.0,
        alpha=0.6,
    )
    axes.plot(
        found.r / diameter, found.g, "-", color=TRANSLATION, lw=1.2, label="disks, band: standard error"
    )
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label="ideal gas")
    for row in outcome.rows:
        if row.name == "g at contact":
            label = f"at contact: {row.value:.3f} $\\pm$ {row.error:.3f}"
            look: dict[str, Any] = {"color": ROTATION, "marker": "D", "ls": "none", "ms": 6, "mfc": "none"}
            axes.errorbar([1.0], [row.value], [row.error], label=label, **look)
    axes.set_xlim(0.0, float(found.r[-1]) / diameter)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("$r$ (mean diameters)")
    axes.set_ylabel("$g(r)$")
    axes.legend(loc="best", frameon=False)
    _grid(axes)


def structure(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """S(k), double logarithmic, with its errors."""
    axes, found = figure.subplots(), outcome.result
    diameter = 2.0 * float(trajectory.disks.radius.mean())
    axes.errorbar(
        found.k * diameter,
        found.S,
        found.S_error,
        fmt="o",
        ms=3,
        lw=0.8,
        mfc="none",
        color=TRANSLATION,
        label="disks",
    )
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label="ideal gas")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(r"$k$ $\times$ mean diameter")
    axes.set_ylabel("$S(k)$")
    axes.legend(loc="best", frameon=False)
    _grid(axes)


def msd(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """The mean-square displacement, double logarithmic, with ballistic flight and the fitted diffusion."""
    axes = figure.subplots()
    found, fit = outcome.result
    later = found.lag > 0.0
    t, value = found.lag[later], found.value[later]
    axes.errorbar(
        t, value, found.error[later], fmt="o", ms=3.5, lw=0.8, mfc="none", color=TRANSLATION, label="disks"
    )
    axes.plot(t, value[0] * (t / t[0]) ** 2, ":", color=RATIO, lw=1.2, label="free flight, $t^2$")
    used = (t >= fit.lags[0]) & (t <= fit.lags[1])
    slope = 2.0 * found.components * fit.D
    line = value[used].mean() + slope * (t - t[used].mean())
    straight = abs(fit.exponent - 1.0) <= 0.2
    in_unit = _unit(trajectory, "length^2/time") or ""
    label = f"line, $D$ = {fit.D:.3g} $\\pm$ {fit.error:.1g} {in_unit}".rstrip()
    if outcome.doubts:  # no single D
        label = "straight line (the gas is not steady: no $D$)"
    elif not straight:
        label += f"\n(no diffusion: exponent {fit.exponent:.2f})"
    axes.plot(t[used], line[used], "-", color=ROTATION, lw=2.0, zorder=5, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(0.5 * value.min(), 3.0 * value.max())
    few_labels(axes)
    axes.set_xlabel(with_unit("lag $t$", trajectory.units.get("time")))
    axes.set_ylabel(with_unit(r"$\langle |\Delta r|^2 \rangle$", _unit(trajectory, "length^2")))
    axes.legend(loc="lower right", frameon=False)
    _grid(axes)


def vacf(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """The velocity autocorrelation over its value at 0; over a logarithmic time, without lag 0, if frames are so."""
    axes, found = figure.subplots(), outcome.result
    scale = found.value[0]
    step = np.diff(found.lag)
    # Evenly spaced frames have steps of one length, those due at collisions of a gas that cools longer and longer ones.
    logarithmic = len(step) > 2 and step.max() > 10.0 * step.min()
    shown = slice(1 if logarithmic else 0, None)
    axes.errorbar(
        found.lag[shown],
        (found.value / scale)[shown],
        (found.error / scale)[shown],
        fmt="o-",
        ms=3.5,
        lw=0.8,
        mfc="none",
        color=TRANSLATION,
    )
    axes.axhline(0.0, color=RATIO, ls=":", lw=1.2)
    if logarithmic:
        axes.set_xscale("log")
        few_labels(axes)
    axes.set_xlabel(with_unit("lag $t$", trajectory.units.get("time")))
    axes.set_ylabel(r"$\langle v(0) \cdot v(t) \rangle \,/\, \langle v^2 \rangle$")
    _grid(axes)


def fields(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
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
    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    u = np.nan_to_num(found.velocity)
    speed = float(np.sqrt(np.mean(np.sum(u**2, axis=-1))))
    if speed > 0.0:
        left.quiver(
            x[where], y[where], u[..., 0][where], u[..., 1][where], color="white", pivot="mid", width=0.003
        )
        text = f"{speed:.2g} {_unit(trajectory, 'length/time') or ''}".strip()
        left.set_title(f"arrows: mean velocity of cells, rms {text}", fontsize="medium")
    T = found.temperature
    high = float(np.nanquantile(T, 0.995)) if np.any(np.isfinite(T)) else 1.0
    drawn = right.imshow(T.T, cmap="inferno", vmin=0.0, vmax=high if high > 0.0 else 1.0, **look)
    figure.colorbar(drawn, ax=right, extend="max", shrink=0.8).set_label(
        with_unit("thermal temperature $T$", trajectory.units.get("energy"))
    )
    for axes in (left, right):
        axes.set_xlabel(with_unit("$x$", trajectory.units.get("length")))
        axes.set_aspect("equal")
    left.set_ylabel(with_unit("$y$", trajectory.units.get("length")))


def clusters(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """The largest cluster in time, and how many clusters have which size in the last frame."""
    left, right = figure.subplots(1, 2)
    found = outcome.result
    left.plot(found.times, [one.largest for one in found.clusters], "o-", ms=4, mfc="none", color=TRANSLATION)
    left.set_xlabel(with_unit("time $t$", trajectory.units.get("time")))
    left.set_ylabel("share of disks in the largest cluster")
    from_zero(left)
    size, count = np.unique(found.clusters[-1].sizes, return_counts=True)
    right.plot(size, count, "o", ms=4, mfc="none", color=ROTATION)
    right.set_xscale("log")
    right.set_yscale("log")
    right.set_xlabel("disks in a cluster")
    right.set_ylabel("clusters, last frame")
    few_labels(right)
    gap = trajectory.with_unit(f"{found.clusters[-1].gap:.3g}", "length")
    right.set_title(f"joined where surfaces are nearer than {gap}", fontsize="medium")
    _grid(left, right)


def psi6(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """|psi_6| of the disks of the last frame used, in place, and its distribution."""
    left, right = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    value = np.abs(outcome.result.psi6)
    frame = trajectory[int(np.argmin(np.abs(trajectory.times - outcome.times[1])))]
    position = frame.position
    # Some 4 points of the picture a disk where there are few, and a dot where there are many.
    size = float(np.clip(4e4 / len(position), 0.2, 40.0))
    (x_low, x_high), (y_low, y_high) = plot_disks.shown_region(trajectory, position)
    left.set_xlim(x_low, x_high)
    left.set_ylim(y_low, y_high)
    drawn = left.scatter(
        *position.T, c=value, s=size, lw=0.0, cmap="cividis", vmin=0.0, vmax=1.0, rasterized=True
    )
    figure.colorbar(drawn, ax=left, shrink=0.85).set_label(r"$|\psi_6|$")
    left.set_aspect("equal")
    left.set_xlabel(with_unit("$x$", trajectory.units.get("length")))
    left.set_ylabel(with_unit("$y$", trajectory.units.get("length")))
    left.set_title(f"$t$ = {trajectory.with_unit(f'{frame.time:.4g}', 'time')}", fontsize="medium")
    right.hist(value, 50, range=(0.0, 1.0), density=True, color=TRANSLATION)
    right.axvline(value.mean(), color=ROTATION, ls="--", lw=1.5, label=f"mean {value.mean():.3f}")
    right.axvline(
        outcome.result.whole,
        color=RATIO,
        ls=":",
        lw=1.5,
        label=rf"$|\langle\psi_6\rangle|$ {outcome.result.whole:.3f}",
    )
    right.set_xlabel(r"$|\psi_6|$")
    right.set_ylabel("probability density")
    right.set_xlim(0.0, 1.0)
    right.legend(loc="best", frameon=False)
    _grid(right)


def _with_error(value: float, error: float) -> str:
    """A number with its error, if it has one."""
    return f"({value:.3g} $\\pm$ {error:.1g})" if np.isfinite(error) else f"{value:.3g}"


def cooling(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """T against time with Haff's law, and theta against collisions per disk with its exponential."""
    left, right = figure.subplots(1, 2)
    haff, ratio = outcome.result
    table = outcome.tables[""]
    t, T, tau, theta = (table[name] for name in ("time", "temperature", "collisions_per_disk", "theta"))
    left.plot(1.0 + (t - t[0]) / haff.t_H, T, "o", ms=4, mfc="none", color=TRANSLATION, label="disks")
    x = np.geomspace(1.0, 1.0 + (t[-1] - t[0]) / haff.t_H, 200)
    time = trajectory.with_unit(_with_error(haff.t_H, haff.t_H_error), "time")
    label = f"Haff's law, $t_H$ = {time}"
    if not haff.describes:
        label = f"the nearest of Haff's law, $t_H$ = {time},\nwhich does not describe it"
    left.plot(x, haff.T0 / x**2, "--", color=RATIO, lw=1.5, label=label)
    if x[-1] > 2.0:  # a shorter stretch has no room for labels of a logarithm
        left.set_xscale("log")
        left.set_yscale("log")
        few_labels(left)
    left.set_xlabel("$1 + (t - t_0) / t_H$")
    left.set_ylabel(with_unit("temperature $T$", trajectory.units.get("energy")))
    left.legend(loc="best", frameon=False)
    right.plot(tau, theta, "o", ms=4, mfc="none", color=ROTATION, label="disks")
    if ratio is not None:
        end = _with_error(ratio.theta_end, ratio.theta_end_error)
        label = f"exponential, lag {_with_error(ratio.lag, ratio.lag_error)},\nend {end}"
        if not ratio.describes:
            label = f"nearest {label},\nwhich does not describe it"
        fine = np.linspace(tau[0], tau[-1], 300)
        curve = ratio.theta_end + (ratio.theta_0 - ratio.theta_end) * np.exp(-(fine - tau[0]) / ratio.lag)
        right.plot(fine, curve, "--", color=RATIO, lw=1.5, label=label)
    right.set_xlabel("collisions per disk")
    right.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
    right.set_ylim(bottom=0.0)
    right.legend(loc="best", frameon=False)
    _grid(left, right)


def impact(figure: Figure, trajectory: Trajectory, outcome: Outcome) -> None:
    """The density of the angle of impact beside that of molecular chaos, and shares of the regimes."""
    left, right = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
    found = outcome.result
    degrees = np.degrees(found.psi)
    left.errorbar(
        degrees,
        found.density,
        found.density_error,
        fmt="o",
        ms=4,
        lw=0.8,
        mfc="none",
        color=TRANSLATION,
        label=f"{found.collisions} collisions",
    )
    fine = np.linspace(0.0, 90.0, 200)
    left.plot(fine, np.cos(np.radians(fine)), "-", color=RATIO, lw=1.5, label=r"molecular chaos, $\cos\psi$")
    left.set_xlim(0.0, 90.0)
    left.set_ylim(bottom=0.0)
    left.set_xlabel(r"angle of impact $\psi$ (degrees)")
    left.set_ylabel("probability density (1/rad)")
    left.legend(loc="best", frameon=False)
    names = list(found.regimes)
    share, error = (np.array([found.regimes[name][i] for name in names]) for i in (0, 1))
    right.barh(names, share, xerr=error, color=ACROSS, ec=TRANSLATION, ecolor=ROTATION, capsize=3.0)
    right.set_xlabel("share of collisions, bars: standard error")
    right.set_title(f"regimes of {found.regime_collisions} collisions", fontsize="medium")
    right.set_xlim(0.0, 1.0)
    _grid(left, right)


PANELS = {
    "velocity": velocity,
    "g": pairs,
    "S": structure,
    "msd": msd,
    "vacf": vacf,
    "fields": fields,
    "clusters": clusters,
    "psi6": psi6,
    "cooling": cooling,
    "impact": impact,
}
"""Name of the analysis -> what draws it."""
