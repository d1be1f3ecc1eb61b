"""Panels of temperatures against time, beside kinetic theory where it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import theory_curves
from .energies import along, axis_label
from .style import RATIO, ROTATION, TRANSLATION, few_labels, foreground, from_zero, grid, label, positive

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (TRANSLATION, ROTATION, RATIO)
NAMES = (
    r"translational, $T = \langle m v^2 \rangle / 2$",
    r"rotational, $T_\mathrm{rot} = \langle I \omega^2 \rangle$",
    None,
)


BAND = 2.0
"""Standard errors that a band reaches to both sides: 95 % of a normal distribution."""


def draw(upper: Axes, trajectory: Trajectory, over: str = "t", lower: Axes | None = None) -> None:
    """Temperatures, and their ratio if it has axes, with the theory of the run: sheared, driven or cooling, or none."""
    if trajectory.room.all_walls:
        walled(upper, trajectory, over)
    elif trajectory.box.shear_rate:
        _with_steady_state(upper, lower, trajectory, over, theory_curves.sheared(trajectory, over))
    elif trajectory.record("forces", bool, "[]"):
        _with_steady_state(upper, lower, trajectory, over, theory_curves.driven(trajectory, over))
    else:
        cooling(upper, lower, trajectory, over)


def cooling(upper: Axes, lower: Axes | None, trajectory: Trajectory, over: str = "t") -> None:
    """Both temperatures, and below them their ratio theta, against time.

    Double logarithmic: a homogeneous gas cools like t^-2 (Haff), a straight line. Over collisions per disk only T is.
    """
    shown = (trajectory.times > 0.0) | (over != "t")  # time 0 has no place on a logarithmic axis
    T = _points(upper, lower, trajectory, shown, over)
    _curves(upper, lower, over, *theory_curves.cooling(trajectory, over))
    if np.any(T[shown] > 0.0):
        upper.set(xscale="log" if over == "t" else "linear", yscale="log")
    _label(upper, lower, trajectory, over)
    upper.legend(loc="best", frameon=False)
    if upper.get_xscale() == "log":
        few_labels(upper)


def _with_steady_state(
    upper: Axes, lower: Axes | None, trajectory: Trajectory, over: str,
    theory: tuple[theory_curves.Curves | None, tuple[float, float] | None, str],
) -> None:  # fmt: skip
    """Both temperatures and their ratio, curves of kinetic theory and the steady state, on axes that begin at 0."""
    _points(upper, lower, trajectory, np.ones(len(trajectory), dtype=bool), over)
    drawn, steady, note = theory
    _curves(upper, lower, over, drawn, note)
    if steady is not None:
        values = (*steady, steady[1] / steady[0])
        for axes, value, colour in zip((upper, upper, lower), values, COLOURS, strict=True):
            if axes is not None and np.isfinite(value):
                axes.axhline(value, ls=":", lw=1.5, color=colour)
        upper.plot([], [], color=foreground(upper), ls=":", lw=1.5, label="its steady state")
    _label(upper, lower, trajectory, over)
    from_zero(upper)
    upper.legend(loc="best", frameon=False)


def walled(upper: Axes, trajectory: Trajectory, over: str = "t") -> None:
    """Both temperatures against time; there is no theory of gases between walls.

    On a plain axis that begins at 0, which shows disks at rest; where a tenth of the positive temperatures are below a
    hundredth of the highest one, on a logarithmic axis, which leaves zeros out.
    """
    T = np.concatenate([trajectory.observables[f"{kind}temperature"] for kind in ("", "rotational_")])
    decades = bool(np.any(T > 0.0)) and np.quantile(T[T > 0.0], 0.1) < 0.01 * T.max()
    _points(upper, None, trajectory, np.ones(len(trajectory), dtype=bool), over, zeros=not decades)
    _label(upper, None, trajectory, over)
    if decades:
        upper.set_yscale("log")
    else:
        from_zero(upper)
    upper.legend(loc="best", frameon=False)


def _points(
    upper: Axes,
    lower: Axes | None,
    trajectory: Trajectory,
    shown: NDArray[np.bool_],
    over: str,
    *,
    zeros: bool = False,
) -> Array:
    """Draw T, T_rot and, if it has axes, their ratio at the frames that are `shown`; returns T of all frames.

    `zeros` are drawn on plain axes: disks at rest.

    Bands reach two standard errors of n independent disks, whose velocities and spins are Gaussian, to both sides: the
    relative variance of T is 1 / n, that of T_rot 2 / n. Streams and clusters make it larger.
    """
    T, T_rot = (trajectory.observables[name] for name in ("temperature", "rotational_temperature"))
    movable = trajectory.n if trajectory.missing else int(trajectory.disks.movable.sum())
    x, n = along(trajectory, trajectory.times, over)[shown], max(movable, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = (T, T_rot, T_rot / T)
    for axes, value, colour, name, variance in zip(
        (upper, upper, lower), values, COLOURS, NAMES, (1.0 / n, 2.0 / n, 3.0 / n), strict=True
    ):
        if axes is None:
            continue
        y, part = value[shown] if zeros else positive(value[shown]), BAND * variance**0.5
        # Open, so that the theory shows where it agrees.
        axes.plot(x, y, "o", ms=5, mfc="none", color=colour, label=name)
        axes.fill_between(x, y * max(1.0 - part, 0.0), y * (1.0 + part), color=colour, alpha=0.25, lw=0.0)
    upper.fill_between(
        [], [], [], color=RATIO, alpha=0.4, lw=0.0, label=rf"$\pm {BAND:g}$ standard errors of {n} disks"
    )
    return T


def _curves(
    upper: Axes, lower: Axes | None, over: str, drawn: theory_curves.Curves | None, note: str
) -> None:
    """Draw temperatures by theory, if there is one, and their ratio; put the note into the legend."""
    if drawn is not None:
        when, T, T_rot, tau = drawn
        for axes, values, colour in zip((upper, upper, lower), (T, T_rot, T_rot / T), COLOURS, strict=True):
            if axes is not None:
                axes.plot(when if over == "t" else tau, positive(values), "--", lw=1.5, color=colour)
    style = "--" if drawn is not None else "none"
    upper.plot([], [], color=foreground(upper), ls=style, lw=1.5, label=note)


def _label(upper: Axes, lower: Axes | None, trajectory: Trajectory, over: str) -> None:
    """Label the axes, of which the lower ones begin at 0."""
    upper.set_ylabel(label(trajectory, "temperature", "energy"))
    (lower or upper).set_xlabel(axis_label(trajectory, over))
    grid(upper)
    if lower is not None:
        lower.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
        from_zero(lower)
        grid(lower)
        upper.tick_params(which="both", labelbottom=False)
