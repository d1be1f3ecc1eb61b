"""Panels of velocity correlations and spectra, and the correlation length against collisions per disk."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ..analysis.flow import VelocityCorrelation, VelocitySpectrum
from ..analysis.result import Columns, Evaluation
from ..tools.intervals import PERCENT
from ..trajectory.reader import Trajectory
from .series import AXES
from .style import (
    OPEN,
    RATIO,
    ROTATION,
    TRANSLATION,
    bars,
    dashes,
    from_zero,
    grid,
    label,
    legend,
    marks,
    with_unit,
)


def correlation_alone(axes: Axes, trajectory: Trajectory | None, found: VelocityCorrelation) -> None:
    """Correlations along and across r with their errors, and where the one across r falls below 0."""
    # Without bins that contact cuts.
    shown = found.pairs > 0.5 * found.pairs.sum() * found.r / found.r.sum()
    for value, error, colour, text in (
        (found.along, found.along_error, TRANSLATION, r"along $r$, $C_\parallel$"),
        (found.across, found.across_error, ROTATION, r"across $r$, $C_\perp$"),
    ):
        r, value, error = found.r[shown], value[shown], error[shown]
        axes.plot(r, value, lw=1.2, label=text, **dashes(colour))
        axes.fill_between(r, value - error, value + error, color=colour, alpha=0.25, lw=0.0)
    axes.axhline(0.0, color=RATIO, ls=":", lw=1.2)
    if np.isfinite(found.length):
        text = with_unit(trajectory, f"correlation length: {found.length:.3g}", "length")
        axes.axvline(found.length, color=RATIO, ls="--", lw=1.2, label=text)
    axes.set_xlabel(label(trajectory, "distance $r$", "length"))
    axes.set_ylabel(r"$\langle v_i v_j \rangle \,/\, (\langle v^2 \rangle / 2)$")
    legend(axes)
    grid(axes)


def correlation(left: Axes, right: Axes, trajectory: Trajectory, evaluation: Evaluation) -> None:
    """Velocity correlations, and the correlation length in each frame."""
    correlation_alone(left, trajectory, evaluation.result)
    _over_frames(right, trajectory, evaluation.tables["frames"], "length", "correlation length")


def spectrum_alone(axes: Axes, trajectory: Trajectory | None, found: VelocitySpectrum) -> None:
    """The spectrum across and along k with its errors, double logarithmic."""
    for value, ends, colour, text in (
        (found.across, found.across_ends, ROTATION, "across $k$"),
        (found.along, found.along_ends, TRANSLATION, "along $k$"),
    ):
        axes.errorbar(found.k, value, bars(value, ends), ms=3.5, lw=0.8, label=text, **marks(colour))
    axes.axhline(1.0, color=RATIO, ls=":", lw=1.2, label=f"independent velocities; bars: {PERCENT} intervals")
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel(label(trajectory, "$k$", "1/length"))
    axes.set_ylabel(r"$\langle |v_k|^2 \rangle \,/\, (n \langle v^2 \rangle / 2)$")
    legend(axes)
    grid(axes)


def spectrum(left: Axes, right: Axes, trajectory: Trajectory, evaluation: Evaluation) -> None:
    """The spectrum of the velocity field, and the wavelength of its maximum in each frame."""
    spectrum_alone(left, trajectory, evaluation.result)
    _over_frames(
        right, trajectory, evaluation.tables["frames"], "wavelength", "wavelength of the maximum across $k$"
    )


def _over_frames(axes: Axes, trajectory: Trajectory, table: Columns, name: str, text: str) -> None:
    """A length of each frame against collisions per disk, or time where these are not known."""
    own_time = "collisions_per_disk" in table
    x = table["collisions_per_disk" if own_time else "time"]
    axes.plot(x, table[name], "o", color=ROTATION, ms=4, **OPEN)
    if not np.isfinite(table[name]).any():
        axes.text(0.5, 0.5, "no length found in any frame", transform=axes.transAxes, ha="center")
    axes.set_xlabel(AXES["tau"] if own_time else label(trajectory, AXES["t"], "time"))
    axes.set_ylabel(label(trajectory, text, "length"))
    from_zero(axes)
    grid(axes)
