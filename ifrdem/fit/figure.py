"""Pictures of a fit: data and laws with residuals and marked outliers; coefficients in pairs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..tools.colours import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from ..tools.files import write_saved
from ..tools.labels import few_labels
from .data import Data
from .likelihood import Array
from .model import DIRECTION, MEASURED, MOTION, CollisionProblem
from .result import Fit, Fitted, of_probability

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Style = tuple[str, Any, str]
STYLES: tuple[Style, ...] = ((BLUE, "-", "o"), (VERMILION, "--", "s"), (GREEN, "-.", "^"), (PURPLE, ":", "v"), (SKY, (0, (5, 1, 1, 1)), "D"), (ORANGE, "-", "P"))  # fmt: skip
"""Colours of laws, and lines and markers that differ without them."""
_DATA, _OUT = "#222222", "#CC0000"
SYMBOLS = {
    "e_n": "$e_n$",
    "A": "$A$",
    "e_t": "$e_t$",
    "mu": r"$\mu$",
    "rho": r"$\rho$",
    "beta_0": r"$\beta_0$",
}


@dataclass(frozen=True, eq=False)
class _Panel:
    """One quantity against the angle of incidence."""

    label: str
    psi: Array
    value: Array
    psi_error: Array
    error: Array

    @property
    def present(self) -> NDArray[np.bool_]:
        return np.isfinite(self.value) & np.isfinite(self.psi)


def draw(fit: Fit, paths: Sequence[Path]) -> None:
    """Draw every measured quantity against psi with all laws, and below it the residuals of each law over their errors.

    A residual is measured minus predicted at the measured psi; its error has that of psi in it, by the slope
    of the curve. Vertical lines mark the fitted transitions, bands their intervals, red rings suspicious
    impacts. Of whole collisions, normal restitution and the slip after the impact over the speed of approach
    are drawn against the angle of incidence at the contact. Each file is written in the format of its ending.

    Raises InputError if a file cannot be written.
    """
    from matplotlib.figure import Figure

    panels, laws, styles = _panels(fit), fit.laws, _styles(fit)
    heights = (3.0, *[1.0] * len(laws))
    figure = Figure(figsize=(1.4 + 4.2 * len(panels), 4.6 + 1.3 * len(laws)), dpi=200, layout="constrained")
    grid = figure.subplots(1 + len(laws), len(panels), sharex=True, squeeze=False, height_ratios=heights)
    for column, panel in enumerate(panels):
        upper = grid[0, column]
        present = panel.present
        upper.errorbar(
            panel.psi[present], panel.value[present], panel.error[present], panel.psi_error[present],
            fmt="o", ms=4, color=_DATA, elinewidth=1.0, zorder=3,
        )  # fmt: skip
        _rings(upper, fit.laws[fit.best], panel.psi, panel.value)
        angles = np.linspace(0.05, min(89.9, 1.06 * float(np.nanmax(panel.psi + panel.psi_error))), 400)
        for row, (name, fitted) in enumerate(laws.items(), start=1):
            colour, line, marker = styles[name]
            curve = _curve(fit, fitted, column, angles)
            upper.plot(angles, curve, ls=line, color=colour, lw=1.8, zorder=2)
            slope = np.gradient(curve, angles)
            at = np.interp(panel.psi, angles, curve)
            error = np.hypot(panel.error, np.interp(panel.psi, angles, slope) * panel.psi_error)
            residual = (panel.value - at) / error
            lower = grid[row, column]
            lower.plot(panel.psi, residual, ls="none", marker=marker, ms=3.5, color=colour)
            _rings(lower, fitted, panel.psi, residual)
            largest = max(3.0, float(np.nanmax(np.abs(residual), initial=0.0)))
            lower.set_ylim(-1.15 * largest, 1.15 * largest)
            lower.axhline(0.0, color=_DATA, lw=0.8)
            for level in (-2.0, 2.0):
                lower.axhline(level, color=_DATA, lw=0.8, ls=":")
            _transition(upper, fitted, colour, line)
            _transition(lower, fitted, colour, line)
        _limit(upper, panel)
        upper.set_ylabel(panel.label)
        grid[-1, column].set_xlabel(r"impact angle $\psi$ (degrees)")
        for axes in grid[:, column]:
            axes.grid(True, lw=0.4, alpha=0.5)
    for row, name in enumerate(laws, start=1):
        of = f"{name}\n" if len(laws) > 1 else ""
        grid[row, 0].set_ylabel(f"{of}residual / error", fontsize="small")
    last = max(float(np.nanmax(panel.psi + panel.psi_error)) for panel in panels)
    grid[0, 0].set_xlim(0.0, min(1.05 * max(last, 1.0), 90.0))
    figure.legend(
        handles=_legend(fit, len(panels)), loc="outside lower center", frameon=False, fontsize="small"
    )
    noun = "impacts" if isinstance(fit.data, Data) else "collisions"
    figure.suptitle(f"{Path(fit.data.source).name}: {len(fit.data)} {noun}", parse_math=False)
    save(figure, paths)


def corner(fit: Fit, paths: Sequence[Path]) -> None:
    """Draw the coefficients of every law in pairs: ellipses of 68 and 95 %, from the covariance, and profile intervals.

    Raises InputError if a file cannot be written, or no law has a coefficient that is determined.
    """
    from matplotlib.figure import Figure

    laws = {name: each for name, each in fit.laws.items() if np.isfinite(each.covariance).all()}
    styles = _styles(fit)
    if not laws:
        raise InputError("no picture of coefficients: none is determined by itself")
    names = list(dict.fromkeys(name for each in laws.values() for name in each.law.free))
    n = len(names)
    figure = Figure(figsize=(1.5 + 2.1 * n, 1.8 + 2.1 * n), dpi=200, layout="constrained")
    grid = figure.subplots(n, n, squeeze=False, sharex="col")
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    for row, a in enumerate(names):
        for column, b in enumerate(names):
            axes = grid[row, column]
            if column > row:
                axes.set_axis_off()
                continue
            if not any({a, b} <= set(each.law.free) for each in laws.values()):
                axes.set(yticks=[])
                axes.text(0.5, 0.5, "no law has both", ha="center", transform=axes.transAxes, color="0.5")
            for name, each in laws.items():
                colour, line, marker = styles[name]
                free = each.law.free
                if a not in free or b not in free:
                    continue
                x, y = free.index(b), free.index(a)
                if a == b:
                    sigma = math.sqrt(each.covariance[x, x])
                    at = np.linspace(each.values[x] - 4.0 * sigma, each.values[x] + 4.0 * sigma, 200)
                    axes.plot(at, np.exp(-0.5 * ((at - each.values[x]) / sigma) ** 2), ls=line, color=colour)
                    interval = each.estimates[a].interval
                    axes.axvspan(interval.low, interval.high, color=colour, alpha=0.12, lw=0.0)
                    axes.set_yticks([])
                    continue
                part = each.covariance[np.ix_([x, y], [x, y])]
                root = np.linalg.cholesky(part + 1e-15 * np.trace(part) * np.eye(2))
                for content in (0.68, 0.95):
                    radius = math.sqrt(-2.0 * math.log(1.0 - content))
                    ellipse = each.values[[x, y], None] + radius * root @ circle
                    axes.plot(*ellipse, ls=line, color=colour, lw=1.2)
                axes.plot(each.values[x], each.values[y], marker=marker, ms=4, color=colour)
            if row == n - 1:
                axes.set_xlabel(SYMBOLS.get(b, b))
            if column == 0 and row > 0:
                axes.set_ylabel(SYMBOLS.get(a, a))
            axes.tick_params(labelsize="x-small")
            axes.locator_params(axis="x", nbins=3)
    handles = [_line(styles[name], name) for name in laws]
    ncols = min(len(handles), 3)
    figure.legend(handles=handles, loc="outside lower center", ncols=ncols, frameon=False, fontsize="small")
    bands = f"68 and 95 % ellipses, {100 * fit.level:g} % profile intervals (bands)"
    figure.suptitle(f"{Path(fit.data.source).name}: {bands}", fontsize="small", parse_math=False)
    save(figure, paths)


def speeds(fit: Fit, paths: Sequence[Path]) -> None:
    """Draw the coefficients of single impacts against g_n, and e_t against the rim speed, of the best law.

    Each value is what the impact alone would give, with the other coefficients as fitted. Impacts whose standard error
    is above five times its lower quartile are left out. Lines are the fitted values, dashed lines the trends with
    68 % bands.

    Raises InputError if a file cannot be written, or there are too few whole collisions.
    """
    from matplotlib.figure import Figure

    fitted = fit.laws[fit.best]
    trends = fitted.trends
    if trends is None or not trends.each:
        raise InputError("no picture of speeds: requires whole collisions, at least 8 more than coefficients")
    figure = Figure(figsize=(1.2 + 3.6 * len(trends.each), 4.2), dpi=200, layout="constrained")
    grid = figure.subplots(1, len(trends.each), squeeze=False)[0]
    colour = STYLES[0][0]
    unit = "" if isinstance(fit.data, Data) else fit.data.unit(MOTION[0])
    unit = unit or "length/time"
    for axes, trend in zip(grid, trends.each, strict=True):
        k = trends.names.index(trend.coefficient)
        at = trends.speed if trend.against == "g_n" else trends.rim
        value, error = trends.value[:, k], trends.error[:, k]
        known = np.isfinite(error) & np.isfinite(value)
        known &= error < 5.0 * np.quantile(error[known], 0.25)
        axes.errorbar(
            at[known],
            value[known],
            error[known],
            fmt="o",
            ms=3,
            color=_DATA,
            elinewidth=0.6,
            alpha=0.6,
            zorder=1,
        )
        axes.axhline(fitted.values[k], color=colour, lw=1.6)
        u = np.linspace(trend.low, trend.high, 100)
        scale = np.log if trend.against == "g_n" else np.asarray
        part = (scale(u) - scale(trend.pivot)) / (scale(trend.high) - scale(trend.low))
        line, spread = fitted.values[k] + trend.change * part, trend.error * np.abs(part)
        axes.plot(u, line, color=STYLES[1][0], ls="--", lw=1.6)
        axes.fill_between(u, line - spread, line + spread, color=STYLES[1][0], alpha=0.25, lw=0.0)
        low, high = np.quantile(value[known], [0.02, 0.98])
        margin = 0.3 * max(high - low, 4.0 * float(np.median(error[known])))
        axes.set_ylim(low - margin, high + margin)
        if trend.against == "g_n":
            axes.set_xscale("log")
            few_labels(axes)
        about = "normal speed $g_n$" if trend.against == "g_n" else r"rim speed $|R_1\omega_1 + R_2\omega_2|$"
        axes.set_xlabel(f"{about} ({unit})")
        axes.set_ylabel(SYMBOLS.get(trend.coefficient, trend.coefficient))
        axes.set_title(
            f"change {trend.change:+.2g} $\\pm$ {trend.error:.1g}, p {of_probability(trend.probability, 2, '= ')}",
            fontsize="small",
        )
        axes.grid(True, lw=0.4, alpha=0.5)
    text = f"{Path(fit.data.source).name}, {fit.best}: single impacts, fitted values (lines), trends (dashed, 68 %)"
    figure.suptitle(text, fontsize="small", parse_math=False)
    save(figure, paths)


def save(figure: Figure, paths: Sequence[Path]) -> None:
    """Write a figure into files, each whole or not at all; InputError if one cannot be written."""
    for path in paths:
        write_saved(path, partial(figure.savefig, format=path.suffix[1:] or "png"))


def _styles(fit: Fit) -> dict[str, Style]:
    """Colour, line and marker of each law."""
    return dict(zip(fit.laws, itertools.cycle(STYLES), strict=False))


def _line(style: Style, label: str) -> Line2D:
    """Entry of a law in a legend."""
    from matplotlib.lines import Line2D

    colour, line, marker = style
    return Line2D([], [], color=colour, ls=line, marker=marker, ms=4, label=label)


def _panels(fit: Fit) -> list[_Panel]:
    """Quantities of a table of angles; of whole collisions -g_n'/g_n and g_t'/g_n, with errors to first order."""
    data, problem = fit.data, fit.laws[fit.best].problem
    if isinstance(data, Data):
        found = []
        for i, name in enumerate(data.names, start=1):
            unit = " (degrees)" if MEASURED[name].unit == "deg" else ""
            label = MEASURED[name].symbol + unit
            found.append(_Panel(label, data.psi, data.measured[name], problem.s[:, 0], problem.s[:, i]))
        return found
    assert isinstance(problem, CollisionProblem)
    y = problem.y
    base = _derived(problem, y)
    variance = np.zeros_like(base)
    for i in range(y.shape[1]):
        step = 1e-4 * np.nan_to_num(problem.s[:, i], nan=1.0)
        moved = y.copy()
        moved[:, i] += step
        variance += ((_derived(problem, moved) - base) / step * np.nan_to_num(problem.s[:, i])) ** 2
    error = np.sqrt(variance)
    sign = np.where(base[0] < 0.0, -1.0, 1.0)
    psi = sign * base[0]
    return [
        _Panel("$-g_n' / g_n$", psi, base[1], error[0], error[1]),
        _Panel("$g_t' / g_n$", psi, sign * base[2], error[0], error[2]),
    ]


def _derived(problem: CollisionProblem, y: Array) -> Array:
    """Angle of incidence [deg], -g_n'/g_n and g_t'/g_n, (3, n), of observed values (n, q)."""
    columns = dict(zip(problem.names, y.T, strict=True))
    _, R_1, _, _, R_2, _, *wall = problem.of_disks
    n_x, n_y = np.cos(columns[DIRECTION]), np.sin(columns[DIRECTION])
    g = []
    for end in ("", "_after"):
        v_2x, v_2y, w_2 = (
            wall if problem.wall else (columns[f"{name}{end}"] for name in ("vx_2", "vy_2", "spin_2"))
        )
        x, y_ = columns[f"vx_1{end}"] - v_2x, columns[f"vy_1{end}"] - v_2y
        g.append((x * n_x + y_ * n_y, y_ * n_x - x * n_y + R_1 * columns[f"spin_1{end}"] + R_2 * w_2))
    (g_n, g_t), (g_n_after, g_t_after) = g
    return np.stack([np.degrees(np.arctan2(g_t, g_n)), -g_n_after / g_n, g_t_after / g_n])


def _curve(fit: Fit, fitted: Fitted, column: int, psi: Array) -> Array:
    exact = fitted.problem.at(fitted.law, fitted.values, np.radians(psi))
    if isinstance(fit.data, Data):
        return np.asarray(exact.y[:, 1 + column])
    assert isinstance(exact, CollisionProblem)
    x = exact.start.copy()
    x[:, 0] = np.radians(psi)
    whole = exact.predict(fitted.law, fitted.values, x, np.arange(len(psi)))
    return np.asarray(_derived(exact, whole)[1 + column])


def _rings(axes: Axes, fitted: Fitted, psi: Array, value: Array) -> None:
    rows = [each.index for each in fitted.suspects]
    if rows:
        axes.plot(
            psi[rows], value[rows], ls="none", marker="o", ms=11, mfc="none", mec=_OUT, mew=1.4, zorder=4
        )


def _limit(axes: Axes, panel: _Panel) -> None:
    """Limit an axis to the measured values; curves may leave it."""
    present = panel.present
    low, high = axes.get_ylim()
    data_low = float(np.min((panel.value - panel.error)[present]))
    data_high = float(np.max((panel.value + panel.error)[present]))
    margin = 0.12 * (data_high - data_low)
    axes.set_ylim(max(low, data_low - margin), min(high, data_high + margin))


def _transition(axes: Axes, fitted: Fitted, colour: str, line: object) -> None:
    if "psi_transit" in fitted.estimates:
        found = fitted.estimates["psi_transit"]
        axes.axvline(found.value, color=colour, ls=line, lw=0.9, alpha=0.8)
        axes.axvspan(found.interval.low, found.interval.high, color=colour, alpha=0.10, lw=0.0)


def _legend(fit: Fit, columns: int) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [
        Line2D([], [], ls="none", marker="o", ms=4, color=_DATA, label="measured, with standard errors")
    ]
    styles = _styles(fit)
    for name, fitted in fit.laws.items():
        values = (f"{SYMBOLS.get(key, key)} = {fitted.estimates[key].value:.4g}" for key in fitted.law.free)
        text = f"{name}: {', '.join(values)};" + ("\n" if columns == 1 else " ")
        tested = f"$\\chi^2 = {fitted.chi2:.1f}$ for {fitted.dof} degrees of freedom"
        text += "errors estimated from the residuals" if fitted.errors else tested
        handles.append(_line(styles[name], text))
    if any("psi_transit" in each.estimates for each in fit.laws.values()):
        text = f"transition from sticking to sliding, with its {100 * fit.level:g} % interval"
        handles.append(Patch(color=_DATA, alpha=0.15, lw=0.0, label=text))
    if any(each.suspects for each in fit.laws.values()):
        handles.append(Line2D([], [], ls="none", marker="o", ms=9, mfc="none", mec=_OUT, label="suspicious"))
    return handles
