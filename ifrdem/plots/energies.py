"""Panels of whole-gas quantities against time: energies, and what became of the energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis import result
from ..model.walls import OF_PISTONS
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .style import ACROSS, RATIO, ROTATION, TRANSLATION, grid, label, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INPUT, HEAT, DISSIPATED = "#009E73", "#CC79A7", "#E69F00"


AXES = {"t": "time $t$", "tau": r"collisions per disk $\tau$"}
"""Axes of what changes in time."""


def along(trajectory: Trajectory, when: Array, over: str) -> Array:
    """Times [time], or the collisions per disk until them."""
    if over == "t":
        return when
    times, (collisions,) = result.series(trajectory, "collisions")
    return np.asarray(np.interp(when, times, 2.0 * collisions / max(trajectory.n, 1)))


def series(trajectory: Trajectory, over: str, *names: str) -> tuple[Array, list[Array]]:
    """Whole-gas quantities by name, and where they stand on such an axis."""
    when, values = result.series(trajectory, *names)
    return along(trajectory, when, over), values


def axis_label(trajectory: Trajectory, over: str) -> str:
    """Label of such an axis."""
    return label(trajectory, AXES["t"], "time") if over == "t" else AXES[over]


def _finish(axes: Any, trajectory: Trajectory, text: str, over: str, columns: int = 3) -> None:
    axes.set(xlabel=axis_label(trajectory, over), ylabel=label(trajectory, text, "energy"))
    grid(axes)
    legend_above(axes, columns)


def energy(axes: Axes, trajectory: Trajectory, over: str = "t") -> None:
    """Translational, rotational and potential energy against time, and that of the pistons."""
    names = ["translational_energy", "rotational_energy"]
    x, values = series(trajectory, over, *names)
    for name, value, colour, style in zip(names, values, (TRANSLATION, ROTATION), ("-", "--"), strict=True):
        axes.plot(x, value, style, color=colour, lw=1.5, label=name.replace("_", " "))
    if "potential_energy" in trajectory.observables and np.any(trajectory.observables["potential_energy"]):
        x, (value,) = series(trajectory, over, "potential_energy")
        axes.plot(x, value, "-.", color=RATIO, lw=1.5, label="potential energy")
    if f"{OF_PISTONS}energy" in trajectory.observables:
        x, (value,) = series(trajectory, over, f"{OF_PISTONS}energy")
        name = "pistons (kinetic and potential)"
        axes.plot(x, value.sum(axis=1), ":", color=INPUT, lw=1.8, label=name)
    if all(np.min(np.asarray(line.get_ydata()), initial=0.0) >= 0.0 for line in axes.lines):
        axes.set_ylim(bottom=0.0)
    _finish(axes, trajectory, "energy", over)


def ledger(upper: Axes, trajectory: Trajectory, over: str = "t", lower: Axes | None = None) -> None:
    """Energy ledger: present, dissipated, put in; and by how much the sum of it all changes.

    present + dissipated - input = start. The residual, in axes of its own, is the file's `ledger_residual`, which is
    counted collision by collision.
    """
    x, (present, dissipated) = series(trajectory, over, "energy", "dissipated_energy")
    if "potential_energy" in trajectory.observables:
        present = present + result.series(trajectory, "potential_energy")[1][0]
    upper.plot(x, present, "-", color=TRANSLATION, lw=1.5, label="present (kinetic and potential)")
    upper.plot(x, dissipated, "--", color=DISSIPATED, lw=1.5, label="dissipated by collisions")
    total = present + dissipated
    for name, colour, text in (
        ("energy_input", INPUT, "put in by forces or shear"),
        ("wall_work", ACROSS, "work of walls"),
        ("wall_heat", HEAT, "heat of walls"),
    ):
        if name in trajectory.observables and np.any(trajectory.observables[name]):
            _, (value,) = result.series(trajectory, name)
            upper.plot(x, value, "-.", color=colour, lw=1.5, label=text)
            total = total - value
    upper.plot(x, total, ":", color=RATIO, lw=1.8, label="present + dissipated $-$ put in")
    _finish(upper, trajectory, "energy", over)
    if lower is not None:
        x, (residual,) = series(trajectory, over, "ledger_residual")
        lower.plot(x, residual / (abs(float(total[0])) or 1.0), ".-", color=RATIO, lw=0.8, ms=3)
        lower.set(ylabel="residual / start", xlabel=upper.get_xlabel())
        grid(lower)
        upper.set_xlabel("")


def mechanisms(axes: Axes, trajectory: Trajectory, over: str = "t") -> None:
    """Energy dissipated by each mechanism against time."""
    x, (values,) = series(trajectory, over, "dissipated_by_mechanism")
    names = ("normal", "tangential restitution", "sliding", "sticking", "rolling", "walls", "rest")
    colours = (TRANSLATION, ROTATION, INPUT, HEAT, DISSIPATED, RATIO, ACROSS)
    styles = ("-", "--", "-.", ":", "-", "--", "-.")
    # Files of before disks could rest have six.
    for name, colour, style, value in zip(names, colours, styles, values.T, strict=False):
        if np.any(value):
            axes.plot(x, value, style, color=colour, lw=1.5, label=name)
    _finish(axes, trajectory, "energy dissipated", over, columns=4)
