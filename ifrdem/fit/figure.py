"""The picture of a fit: data and both fitted curves, residuals beneath."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..model.ifr import STICKING
from .model import MEASURED, Array, Model
from .result import Fit

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

# Okabe and Ito's blue and vermilion, told apart with every kind of colour blindness; and by line and marker too.
STYLE = {STICKING[0]: ("#0072B2", "-", "o"), STICKING[1]: ("#D55E00", "--", "s")}
LABEL = {STICKING[0]: "percussion centre", STICKING[1]: "contact point"}
_DATA = "#222222"


def draw(fit: Fit, paths: Sequence[Path]) -> None:
    """Draw every measured quantity against psi, and below it the residuals over their errors.

    A residual is measured minus predicted at the measured psi; its error has that of psi in it, by the slope of the
    curve. Vertical lines mark the fitted transitions, bands their 95 % intervals.

    Parameters
    ----------
    fit : Fit
        What was found.
    paths : sequence of Path
        Files to write, each in the format of its ending.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    from matplotlib.figure import Figure

    names = fit.data.names
    figure = Figure(figsize=(1.0 + 4.4 * len(names), 6.6), dpi=200, layout="constrained")
    grid = figure.subplots(2, len(names), sharex=True, squeeze=False, height_ratios=(3.0, 1.2))
    for column, name in enumerate(names):
        upper, lower = grid[0, column], grid[1, column]
        _curves(upper, fit, column)
        _residuals(lower, fit, column)
        unit = " (degrees)" if MEASURED[name].unit == "deg" else ""
        upper.set_ylabel(MEASURED[name].symbol + unit)
        lower.set_ylabel("residual / error")
        lower.set_xlabel(r"impact angle $\psi$ (degrees)")
        for axes in (upper, lower):
            _transitions(axes, fit)
            axes.grid(True, lw=0.4, alpha=0.5)
    figure.legend(handles=_legend(fit), loc="outside lower center", frameon=False)
    last = max(np.max(fit.data.psi + fit.data.errors["psi"]), 1.0)
    grid[0, 0].set_xlim(0.0, min(1.05 * last, 90.0))
    title = f"{Path(fit.data.source).name}: {len(fit.data)} impacts, M = {fit.pair.M:.4g}"
    figure.suptitle(title, parse_math=False)
    for path in paths:
        try:
            figure.savefig(path)
        except OSError as error:
            raise InputError(f"picture {path} cannot be written: {error.strerror}") from error


def _legend(fit: Fit) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    narrow = len(fit.data.names) == 1
    handles: list[Artist] = [
        Line2D([], [], ls="none", marker="o", ms=4, color=_DATA, label="measured, with standard errors")
    ]
    for kind, closure in fit.closures.items():
        colour, line, marker = STYLE[kind]
        symbols = {"e_n": "e_n", "e_t": "e_t", "mu": r"\mu", "rho": r"\rho"}
        values = (f"${symbols[key]} = {closure.estimates[key].value:.4g}$" for key in closure.coefficients)
        text = f"{LABEL[kind]}: {', '.join(values)};" + ("\n" if narrow else " ")
        text += f"$\\chi^2 = {closure.chi2:.1f}$ for {closure.dof} degrees of freedom"
        filled = colour if marker == "o" else "none"
        handles.append(Line2D([], [], color=colour, ls=line, marker=marker, ms=4, mfc=filled, label=text))
    text = "transition from sticking to sliding, with its 95 % interval"
    return [*handles, Patch(color=_DATA, alpha=0.15, lw=0.0, label=text)]


def _curves(axes: Axes, fit: Fit, column: int) -> None:
    data, name = fit.data, fit.data.names[column]
    axes.errorbar(
        data.psi, data.measured[name], data.errors[name], data.errors["psi"],
        fmt="o", ms=4, color=_DATA, elinewidth=1.0, zorder=3, label="measured, with standard errors",
    )  # fmt: skip
    psi = np.linspace(0.01, min(90.0 - 1e-3, 1.06 * np.max(data.psi + data.errors["psi"])), 800)
    for kind in fit.closures:
        colour, line, _ = STYLE[kind]
        axes.plot(psi, fit.predict(kind, psi)[:, column], line, color=colour, lw=1.8, zorder=2)
    low, high = axes.get_ylim()  # a curve may leave the data; what was measured is what is to be seen
    values, error = data.measured[name], data.errors[name]
    seen_low, seen_high = np.min(values - error), np.max(values + error)
    margin = 0.12 * (seen_high - seen_low)
    axes.set_ylim(max(low, seen_low - margin), min(high, seen_high + margin))


def _residuals(axes: Axes, fit: Fit, column: int) -> None:
    data, name = fit.data, fit.data.names[column]
    psi = np.radians(data.psi)
    largest = 2.0
    for shift, (kind, closure) in zip((-0.25, 0.25), fit.closures.items(), strict=False):
        colour, _, marker = STYLE[kind]
        predicted, slope = _with_slope(Model(fit.pair, closure.sticking), closure.values, psi, name)
        error = np.hypot(data.errors[name], slope * np.radians(data.errors["psi"]))
        residual = (data.measured[name] - predicted) / error
        largest = max(largest, float(np.max(np.abs(residual))))
        axes.plot(
            data.psi + shift, residual, marker, ms=4, color=colour, mfc=colour if marker == "o" else "none"
        )
    axes.axhline(0.0, color=_DATA, lw=0.8)
    for level in (-2.0, 2.0):
        axes.axhline(level, color=_DATA, lw=0.8, ls=":")
    axes.set_ylim(-1.15 * largest, 1.15 * largest)


def _with_slope(model: Model, coefficients: Array, psi: Array, name: str) -> tuple[Array, Array]:
    """Prediction of one quantity and its derivative by psi [1/rad]."""
    step = 1e-4
    angles = np.clip(np.stack([psi, psi + step, psi - step]), 1e-6, 0.5 * np.pi - 1e-6)
    f = model.predict(coefficients, angles, [name])[..., 0]
    return f[0], (f[1] - f[2]) / (angles[1] - angles[2])


def _transitions(axes: Axes, fit: Fit) -> None:
    for kind, closure in fit.closures.items():
        colour, line, _ = STYLE[kind]
        found = closure.estimates["psi_transit"]
        axes.axvline(found.value, color=colour, ls=line, lw=0.9, alpha=0.8)
        axes.axvspan(found.interval.low, found.interval.high, color=colour, alpha=0.10, lw=0.0)
