"""Panels of temperatures against time, beside kinetic theory where it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import theory_curves
from .style import RATIO, ROTATION, TRANSLATION, few_labels, from_zero, positive, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def cooling(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Both temperatures, and below them their ratio theta, against time.

    Double logarithmic: a homogeneous gas cools like t^-2 (Haff), a straight line.
    """
    times = trajectory.times
    later = times > 0.0  # time 0 has no place on a logarithmic axis
    T = _points(upper, lower, trajectory, later)
    drawn, note = theory_curves.cooling(trajectory)
    if drawn is not None:
        _curves(upper, lower, *drawn)
    upper.plot([], [], color="black", ls="--" if drawn is not None else "none", lw=1.5, label=note)
    upper.legend(loc="best", frameon=False)
    if np.count_nonzero(later) and np.any(T[later] > 0.0):
        upper.set_xscale("log")
        upper.set_yscale("log")
    _label(upper, lower, trajectory)
    if upper.get_xscale() == "log":
        few_labels(upper)
    upper.tick_params(which="both", labelbottom=False)


def driven(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Both temperatures, and below them their ratio theta, against time, on plain axes that begin at 0."""
    _points(upper, lower, trajectory, np.ones(len(trajectory), dtype=bool))
    _with_steady_state(upper, lower, trajectory, theory_curves.driven(trajectory))


def sheared(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """The same for a sheared gas."""
    _points(upper, lower, trajectory, np.ones(len(trajectory), dtype=bool))
    _with_steady_state(upper, lower, trajectory, theory_curves.sheared(trajectory))


def _with_steady_state(
    upper: Axes,
    lower: Axes,
    trajectory: Trajectory,
    theory: tuple[theory_curves.Curves | None, tuple[float, float] | None, str],
) -> None:
    """Add curves of kinetic theory and the steady state to temperatures, and finish the axes."""
    drawn, steady, note = theory
    if drawn is not None:
        _curves(upper, lower, *drawn)
    upper.plot([], [], color="black", ls="--" if drawn is not None else "none", lw=1.5, label=note)
    if steady is not None:
        T, T_rot = steady
        for axes, value, colour in (
            (upper, T, TRANSLATION),
            (upper, T_rot, ROTATION),
            (lower, T_rot / T, RATIO),
        ):
            if np.isfinite(value):
                axes.axhline(value, ls=":", lw=1.5, color=colour)
        upper.plot([], [], color="black", ls=":", lw=1.5, label="its steady state")
    _label(upper, lower, trajectory)
    for axes in (upper, lower):
        from_zero(axes)
    upper.legend(loc="best", frameon=False)
    upper.tick_params(which="both", labelbottom=False)


def walled(upper: Axes, trajectory: Trajectory) -> None:
    """Both temperatures against time, on plain axes that begin at 0; there is no theory of gases between walls."""
    _points(upper, None, trajectory, np.ones(len(trajectory), dtype=bool))
    units = trajectory.units
    upper.set_ylabel(with_unit("temperature", units.get("energy")))
    upper.set_xlabel(with_unit("time $t$", units.get("time")))
    upper.grid(True, which="major", lw=0.4, alpha=0.5)
    from_zero(upper)
    upper.legend(loc="best", frameon=False)


def _points(upper: Axes, lower: Axes | None, trajectory: Trajectory, shown: NDArray[np.bool_]) -> Array:
    """Draw the temperatures and their ratio at the frames that are `shown`; returns T of all frames."""
    times = trajectory.times
    T = trajectory.observables["temperature"]
    T_rot = trajectory.observables["rotational_temperature"]
    with np.errstate(divide="ignore", invalid="ignore"):
        theta = T_rot / T
    series = (
        (upper, T, TRANSLATION, r"translational, $T = \langle m v^2 \rangle / 2$"),
        (upper, T_rot, ROTATION, r"rotational, $T_\mathrm{rot} = \langle I \omega^2 \rangle$"),
        (lower, theta, RATIO, None),
    )
    for axes, values, colour, label in series:
        if axes is None:
            continue
        # Open, so that the theory shows where it agrees.
        axes.plot(times[shown], positive(values[shown]), "o", ms=5, mfc="none", color=colour, label=label)
    return T


def _curves(upper: Axes, lower: Axes, when: Array, T: Array, T_rot: Array) -> None:
    """Draw temperatures by theory, and their ratio."""
    for axes, values, colour in (
        (upper, T, TRANSLATION),
        (upper, T_rot, ROTATION),
        (lower, T_rot / T, RATIO),
    ):
        axes.plot(when, positive(values), "--", lw=1.5, color=colour)


def _label(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Label the axes, of which the lower ones begin at 0."""
    units = trajectory.units
    upper.set_ylabel(with_unit("temperature", units.get("energy")))
    lower.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
    from_zero(lower)
    lower.set_xlabel(with_unit("time $t$", units.get("time")))
    for axes in (upper, lower):
        axes.grid(True, which="major", lw=0.4, alpha=0.5)
