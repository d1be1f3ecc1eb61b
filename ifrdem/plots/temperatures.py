"""Panels of temperatures against time, beside kinetic theory where it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import theory_curves
from .style import RATIO, ROTATION, TRANSLATION, few_labels, from_zero, grid, label, positive

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (TRANSLATION, ROTATION, RATIO)
NAMES = (
    r"translational, $T = \langle m v^2 \rangle / 2$",
    r"rotational, $T_\mathrm{rot} = \langle I \omega^2 \rangle$",
    None,
)


def cooling(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Both temperatures, and below them their ratio theta, against time.

    Double logarithmic: a homogeneous gas cools like t^-2 (Haff), a straight line.
    """
    later = trajectory.times > 0.0  # time 0 has no place on a logarithmic axis
    T = _points((upper, upper, lower), trajectory, later)
    _curves(upper, lower, *theory_curves.cooling(trajectory))
    upper.legend(loc="best", frameon=False)
    if np.any(T[later] > 0.0):
        upper.set(xscale="log", yscale="log")
    _label(upper, lower, trajectory)
    if upper.get_xscale() == "log":
        few_labels(upper)


def driven(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Both temperatures, and below them their ratio theta, against time, on plain axes that begin at 0."""
    _with_steady_state(upper, lower, trajectory, theory_curves.driven(trajectory))


def sheared(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """The same for a sheared gas."""
    _with_steady_state(upper, lower, trajectory, theory_curves.sheared(trajectory))


def _with_steady_state(
    upper: Axes, lower: Axes, trajectory: Trajectory,
    theory: tuple[theory_curves.Curves | None, tuple[float, float] | None, str],
) -> None:  # fmt: skip
    """Draw temperatures, curves of kinetic theory and the steady state."""
    _points((upper, upper, lower), trajectory, np.ones(len(trajectory), dtype=bool))
    drawn, steady, note = theory
    _curves(upper, lower, drawn, note)
    if steady is not None:
        values = (*steady, steady[1] / steady[0])
        for axes, value, colour in zip((upper, upper, lower), values, COLOURS, strict=True):
            if np.isfinite(value):
                axes.axhline(value, ls=":", lw=1.5, color=colour)
        upper.plot([], [], color="black", ls=":", lw=1.5, label="its steady state")
    _label(upper, lower, trajectory)
    from_zero(upper)
    upper.legend(loc="best", frameon=False)


def walled(upper: Axes, trajectory: Trajectory) -> None:
    """Both temperatures against time, on plain axes that begin at 0; there is no theory of gases between walls."""
    _points((upper, upper), trajectory, np.ones(len(trajectory), dtype=bool))
    upper.set(xlabel=label(trajectory, "time $t$", "time"), ylabel=label(trajectory, "temperature", "energy"))
    grid(upper)
    from_zero(upper)
    upper.legend(loc="best", frameon=False)


def _points(panels: tuple[Axes, ...], trajectory: Trajectory, shown: NDArray[np.bool_]) -> Array:
    """Draw T, T_rot and, if it has a panel, their ratio at the frames that are `shown`; returns T of all frames."""
    T, T_rot = (trajectory.observables[name] for name in ("temperature", "rotational_temperature"))
    with np.errstate(divide="ignore", invalid="ignore"):
        values = (T, T_rot, T_rot / T)
    for axes, value, colour, name in zip(panels, values, COLOURS, NAMES, strict=False):
        # Open, so that the theory shows where it agrees.
        axes.plot(
            trajectory.times[shown], positive(value[shown]), "o", ms=5, mfc="none", color=colour, label=name
        )
    return T


def _curves(upper: Axes, lower: Axes, drawn: theory_curves.Curves | None, note: str) -> None:
    """Draw temperatures by theory, if there is one, and their ratio; put the note into the legend."""
    if drawn is not None:
        when, T, T_rot = drawn
        for axes, values, colour in zip((upper, upper, lower), (T, T_rot, T_rot / T), COLOURS, strict=True):
            axes.plot(when, positive(values), "--", lw=1.5, color=colour)
    upper.plot([], [], color="black", ls="--" if drawn is not None else "none", lw=1.5, label=note)


def _label(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Label the axes, of which the lower ones begin at 0."""
    upper.set_ylabel(label(trajectory, "temperature", "energy"))
    lower.set(xlabel=label(trajectory, "time $t$", "time"), ylabel=r"$\theta = T_\mathrm{rot} / T$")
    from_zero(lower)
    grid(upper, lower)
    upper.tick_params(which="both", labelbottom=False)
