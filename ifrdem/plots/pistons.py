"""Panels of pistons against time: how far they are displaced, and how fast they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..errors import InputError
from ..model.walls import OF_PISTONS
from ..trajectory.reader import Trajectory
from .energies import axis_label, series
from .style import KINDS, grid, label, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(axes: Sequence[Axes], trajectory: Trajectory, over: str = "t") -> None:
    """Displacement of each piston along its normal, and its velocity, against time.

    Raises
    ------
    InputError
        If the file has no piston.
    """
    quantities = [f"{OF_PISTONS}{name}" for name in ("displacement", "velocity")]
    if quantities[0] not in trajectory.observables:
        raise InputError(
            f"{trajectory.path} has no piston: a wall with one, piston = {{ mass = ... }} in [[wall]], is needed"
        )
    x, columns = series(trajectory, over, *quantities)
    names = [
        f"wall {number} {wall.shape}"
        for number, wall in enumerate(trajectory.walls)
        if wall.piston is not None
    ]
    texts = (("displacement", "length"), ("velocity", "length/time"))
    for panel, values, (text, unit) in zip(axes, columns, texts, strict=False):
        for i, name in enumerate(names):
            colour = KINDS[i % len(KINDS)]
            panel.plot(x, values[:, i], "-", color=colour, lw=1.2, label=name)
        panel.set_ylabel(label(trajectory, f"{text} of the piston{'s' * (len(names) > 1)}", unit))
    axes[-1].set_xlabel(axis_label(trajectory, over))
    grid(*axes)
    if len(names) > 1:
        legend_above(axes[0])
