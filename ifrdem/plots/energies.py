"""Panels of whole-gas quantities against time: energies, and what became of the energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis import result
from ..trajectory.reader import Trajectory
from .style import ACROSS, RATIO, ROTATION, TRANSLATION, grid, label, legend_above

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INPUT, HEAT, DISSIPATED = "#009E73", "#CC79A7", "#E69F00"


def _finish(axes: Any, trajectory: Trajectory, text: str, columns: int = 3) -> None:
    axes.set(xlabel=label(trajectory, "time $t$", "time"), ylabel=label(trajectory, text, "energy"))
    grid(axes)
    legend_above(axes, columns)


def energy(figure: Figure, trajectory: Trajectory) -> None:
    """Translational, rotational and potential energy against time."""
    axes = figure.subplots()
    names = ["translational_energy", "rotational_energy"]
    when, values = result.series(trajectory, *names)
    for name, value, colour, style in zip(names, values, (TRANSLATION, ROTATION), ("-", "--"), strict=True):
        axes.plot(when, value, style, color=colour, lw=1.5, label=name.replace("_", " "))
    if "potential_energy" in trajectory.observables and np.any(trajectory.observables["potential_energy"]):
        when, (value,) = result.series(trajectory, "potential_energy")
        axes.plot(when, value, "-.", color=RATIO, lw=1.5, label="potential energy")
    axes.set_ylim(bottom=0.0 if axes.get_ylim()[0] >= 0.0 or np.all(values[0] >= 0.0) else None)
    _finish(axes, trajectory, "energy")


def ledger(figure: Figure, trajectory: Trajectory) -> None:
    """Energy ledger: present, dissipated, put in; and by how much the sum of it all changes.

    present + dissipated - input = start. The residual is that of the file's `ledger_residual` if it has one, which is
    counted collision by collision; otherwise there is nothing to compare and it is not drawn.
    """
    try:
        when_left, (residual,) = result.series(trajectory, "ledger_residual")
    except ValueError:  # only runs that count every collision have it
        upper = figure.subplots()
        lower = None
    else:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    when, (present, dissipated) = result.series(trajectory, "energy", "dissipated_energy")
    if "potential_energy" in trajectory.observables:
        present = present + result.series(trajectory, "potential_energy")[1][0]
    upper.plot(when, present, "-", color=TRANSLATION, lw=1.5, label="present (kinetic and potential)")
    upper.plot(when, dissipated, "--", color=DISSIPATED, lw=1.5, label="dissipated by collisions")
    total = present + dissipated
    for name, colour, text in (
        ("energy_input", INPUT, "put in by forces or shear"),
        ("wall_work", ACROSS, "work of walls"),
        ("wall_heat", HEAT, "heat of walls"),
    ):
        if name in trajectory.observables and np.any(trajectory.observables[name]):
            _, (value,) = result.series(trajectory, name)
            upper.plot(when, value, "-.", color=colour, lw=1.5, label=text)
            total = total - value
    upper.plot(when, total, ":", color=RATIO, lw=1.8, label="present + dissipated $-$ put in")
    _finish(upper, trajectory, "energy")
    if lower is not None:
        lower.plot(when_left, residual / (abs(float(total[0])) or 1.0), ".-", color=RATIO, lw=0.8, ms=3)
        lower.set(ylabel="residual / start", xlabel=upper.get_xlabel())
        grid(lower)
        upper.set_xlabel("")


def mechanisms(figure: Figure, trajectory: Trajectory) -> None:
    """Energy dissipated by each mechanism against time."""
    axes = figure.subplots()
    when, (values,) = result.series(trajectory, "dissipated_by_mechanism")
    names = ("normal", "tangential restitution", "sliding", "sticking", "rolling", "walls")
    colours = (TRANSLATION, ROTATION, INPUT, HEAT, DISSIPATED, RATIO)
    styles = ("-", "--", "-.", ":", "-", "--")
    for name, colour, style, value in zip(names, colours, styles, values.T, strict=True):
        if np.any(value):
            axes.plot(when, value, style, color=colour, lw=1.5, label=name)
    _finish(axes, trajectory, "energy dissipated", columns=4)
