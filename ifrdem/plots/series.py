"""Panels of quantities over time: energies, the ledger, pistons, and forces and heat of walls."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..analysis import result
from ..errors import InputError
from ..model.walls.motion import Turn
from ..quantities import PISTON_SERIES
from ..tools.checked import Array
from ..tools.colours import GREEN, ORANGE, PURPLE
from ..tools.intervals import PERCENT, student_t
from ..tools.labels import few_labels
from ..trajectory.reader import Trajectory
from .style import (
    ACROSS,
    KINDS,
    LOOKS,
    RATIO,
    ROTATION,
    TRANSLATION,
    dashes,
    grid,
    label,
    legend_above,
    plain,
    positive,
    some_marks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INPUT, HEAT, DISSIPATED = GREEN, PURPLE, ORANGE
POINTS = 100
"""Intervals, at most, over which forces on walls are means."""
AXES = {"t": "time $t$", "tau": r"collisions per disk $\tau$"}
"""Axes of what changes in time."""


def along(trajectory: Trajectory, when: Array, over: str) -> Array:
    """Times [time], or the collisions per disk until them."""
    if over == "t":
        return when
    times, (collisions,) = result.series(trajectory, "collisions")
    return np.asarray(np.interp(when, times, 2.0 * collisions / max(trajectory.n, 1)))


def series(trajectory: Trajectory, over: str, *names: str) -> tuple[Array, list[Array]]:
    """Whole-gas quantities by name, and their coordinates on such an axis."""
    when, values = result.series(trajectory, *names)
    return along(trajectory, when, over), values


def axis_label(trajectory: Trajectory, over: str) -> str:
    """Label of such an axis."""
    return label(trajectory, AXES["t"], "time") if over == "t" else AXES[over]


def _finish(axes: Axes, trajectory: Trajectory, text: str, over: str, columns: int = 3) -> None:
    axes.set(xlabel=axis_label(trajectory, over), ylabel=label(trajectory, text, "energy"))
    grid(axes)
    legend_above(axes, columns)


def cools(trajectory: Trajectory) -> bool:
    """True for a gas without walls, forces and shear."""
    driven = trajectory.box.shear_rate or trajectory.record("forces", bool, "[]")
    return not (trajectory.free_area.all_walls or driven)


def energy(trajectory: Trajectory, over: str, axes: Axes) -> None:
    """Translational, rotational and potential energy against time, and that of the pistons.

    Logarithmic for a gas that cools, whose energy falls over decades.
    """
    names = ["translational_energy", "rotational_energy"]
    x, values = series(trajectory, over, *names)
    for name, value, colour, style in zip(names, values, (TRANSLATION, ROTATION), ("-", "--"), strict=True):
        axes.plot(x, value, style, color=colour, lw=1.5, label=name.replace("_", " "))
    if "potential_energy" in trajectory.observables and np.any(trajectory.observables["potential_energy"]):
        x, (value,) = series(trajectory, over, "potential_energy")
        axes.plot(x, value, "-.", color=RATIO, lw=1.5, label="potential energy")
    if "piston_energy" in trajectory.observables:
        x, (value,) = series(trajectory, over, "piston_energy")
        name = "pistons (kinetic and potential)"
        axes.plot(x, value.sum(axis=1), ":", color=INPUT, lw=1.8, label=name)
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    if cools(trajectory) and np.any(drawn > 0.0) and np.all(drawn >= 0.0):
        for line in axes.lines:
            line.set_ydata(positive(np.asarray(line.get_ydata())))
        axes.set_yscale("log")
        few_labels(axes, "y")
    elif np.all(drawn >= 0.0):
        axes.set_ylim(bottom=0.0)
    _finish(axes, trajectory, "energy", over)


def ledger(trajectory: Trajectory, over: str, upper: Axes, lower: Axes | None = None) -> None:
    """Energy ledger: present, dissipated, put in; and the change of their sum.

    present + dissipated - input = start. The residual, in axes of its own, is the file's `ledger_residual`, which is
    counted collision by collision.
    """
    x, (present, dissipated) = series(trajectory, over, "energy", "dissipated_energy")
    if "potential_energy" in trajectory.observables:
        present = present + result.series(trajectory, "potential_energy")[1][0]
    upper.plot(x, present, "-", color=TRANSLATION, lw=1.5, label="present (kinetic and potential)")
    upper.plot(x, dissipated, "--", color=DISSIPATED, lw=1.5, label="dissipated by collisions")
    total = present + dissipated
    for name, colour, line, text in (
        ("energy_input", INPUT, "-.", "put in by forces or shear"),
        ("wall_work", ACROSS, (0, (3.0, 1.0)), "work of walls"),
        ("wall_heat", HEAT, (0, (8.0, 1.5, 1.0, 1.5, 1.0, 1.5)), "heat of walls"),
    ):
        if name in trajectory.observables and np.any(trajectory.observables[name]):
            _, (value,) = result.series(trajectory, name)
            upper.plot(x, value, ls=line, color=colour, lw=1.5, label=text)
            total = total - value
    upper.plot(x, total, ":", color=RATIO, lw=1.8, label="present + dissipated $-$ put in")
    _finish(upper, trajectory, "energy", over)
    if lower is not None:
        x, (residual,) = series(trajectory, over, "ledger_residual")
        lower.plot(x, residual / (abs(float(total[0])) or 1.0), ".-", color=RATIO, lw=0.8, ms=3)
        lower.set(ylabel="residual / start", xlabel=upper.get_xlabel())
        grid(lower)
        upper.set_xlabel("")


def mechanisms(trajectory: Trajectory, over: str, axes: Axes) -> None:
    """Energy dissipated by each mechanism against time."""
    x, (values,) = series(trajectory, over, "dissipated_by_mechanism")
    names = ("normal", "tangential restitution", "sliding", "sticking", "rolling", "walls", "rest")
    colours = (TRANSLATION, ROTATION, INPUT, HEAT, DISSIPATED, RATIO, ACROSS)
    styles = [line for _, _, line in LOOKS.values()]
    # Files of before disks could rest have six.
    for name, colour, line, value in zip(names, colours, styles, values.T, strict=False):
        if np.any(value):
            axes.plot(x, value, ls=line, color=colour, lw=1.5, label=name)
    _finish(axes, trajectory, "energy dissipated", over, columns=4)


def piston(trajectory: Trajectory, over: str, *panels: Axes) -> None:
    """Displacement of each piston along its normal, and its velocity, against time.

    InputError if the file has no piston.
    """
    quantities = PISTON_SERIES[:2]
    if quantities[0] not in trajectory.observables:
        raise InputError(
            f"{trajectory.path} has no piston: it requires a wall with piston = {{ mass = ... }} in [[wall]]"
        )
    x, columns = series(trajectory, over, *quantities)
    pistons = [(number, wall) for number, wall in enumerate(trajectory.walls) if wall.piston is not None]
    texts = (("displacement", "length"), ("velocity", "length/time"))
    for panel, values, (text, unit) in zip(panels, columns, texts, strict=False):
        for i, (number, wall) in enumerate(pistons):
            name = plain(wall.group or f"wall {number} {wall.shape}")
            panel.plot(x, values[:, i], lw=1.2, label=name, **dashes(KINDS[i % len(KINDS)]))
        panel.set_ylabel(label(trajectory, f"{text} of the piston{'s' * (len(pistons) > 1)}", unit))
    panels[-1].set_xlabel(axis_label(trajectory, over))
    grid(*panels)
    if len(pistons) > 1:
        legend_above(panels[0])


def _wall_names(trajectory: Trajectory) -> list[str]:
    """Names of the curves: groups, and walls without one; those of most hits if there are more than colours.

    InputError if the file does not hold the sums of walls, or fewer than two rows of them.
    """
    sums = trajectory.series
    if "walls_hits" not in sums:
        raise InputError(
            f"{trajectory.path} does not hold what walls give to the disks: it requires output.wall_sums = true, "
            'as by `ifrdem run CASE --set output.wall_sums=true` (in Python record=["wall_sums"])'
        )
    if len(sums.time) < 2:
        raise InputError(f"{trajectory.path}: must have two rows of the series or more for forces on walls")
    columns = sums.columns("walls_hits")
    groups = [wall.group for wall in trajectory.walls] + [""] * len(columns)
    names = list(dict.fromkeys(group or column for group, column in zip(groups, columns, strict=False)))
    hits = {name: float(sums[f"walls_hits/{name}"][-1]) for name in names}
    most = sorted(names, key=lambda name: -hits[name])[: len(KINDS)]
    return [name for name in names if name in most and hits[name] > 0.0] or most


def given_by_walls(trajectory: Trajectory) -> list[str]:
    """Which of work and heat walls gave to disks; both if the file does not say."""
    series, both = trajectory.series, ["work", "heat"]
    if "walls_work" not in series:
        return both
    return [name for name in both if series[f"walls_{name}"].any()]


def intervals(time: Array) -> NDArray[np.intp]:
    """Rows that divide a series into at most `POINTS` intervals of about one length.

    Rows nearest to times of equal distance: rows that are close together, as at the end of a run, make no interval of
    their own, in which a single hit would be a spike.
    """
    last = len(time) - 1
    number = min(POINTS, last)
    step = (time[last] - time[0]) / number
    middles = 0.5 * (time[1:] + time[:-1])
    rows = [0]
    for row in np.searchsorted(middles, time[0] + step * np.arange(1, number)):
        if time[row] - time[rows[-1]] > 0.5 * step:
            rows.append(int(row))
    if len(rows) > 1 and time[last] - time[rows[-1]] <= 0.5 * step:
        rows.pop()
    return np.array([*rows, last], dtype=np.intp)


FEWEST_ROWS = 4
"""Rows of an interval by whose scatter the error of its mean is found."""


def means(time: Array, total: Array, rows: NDArray[np.intp]) -> tuple[Array, Array]:
    """Rates of a sum between some rows, and half of their 95 % intervals; nan of fewer than `FEWEST_ROWS` rows.

    By the scatter of the rates of single rows, each with the weight of its time, by Student's t. Rows count as
    independent.
    """
    span, gain = np.diff(time), np.diff(total)
    mean, half = np.diff(total[rows]) / np.diff(time[rows]), np.full(len(rows) - 1, np.nan)
    for i, (first, last) in enumerate(itertools.pairwise(rows)):
        n = int(last - first)
        if n >= FEWEST_ROWS:
            off = gain[first:last] - mean[i] * span[first:last]
            error = np.sqrt(np.sum(off**2) * n / (n - 1)) / (time[last] - time[first])
            half[i] = student_t(n) * error
    return mean, half


def has_torques(trajectory: Trajectory) -> bool:
    """False if all walls are endless lines or sides of the box, whose torques about a point say nothing."""
    return any(not wall.geometry.is_endless for wall in trajectory.walls)


def walls(trajectory: Trajectory, over: str, force: Axes, *others: Axes) -> None:
    """Mean force *on* walls in intervals of the series; in `others`, the torque, if `has_torques`, and what walls gave.

    What walls gave is the work and the heat until then.

    Intervals are of about one length (`intervals`), and each is drawn as long as it is, with the 95 % interval of its
    mean where it has rows to find it by. The band of the first interval, which holds the start of a motion, does not
    set the ends of the axis. Torques are about the centre of a wall's turn, or the origin.
    """
    torque, given = (others[0], others[1:]) if has_torques(trajectory) else (None, others)
    reach: dict[Axes, list[Array]] = {}
    sums, names, quantities = trajectory.series, _wall_names(trajectory), given_by_walls(trajectory)
    rows = intervals(sums.time)
    steps = np.repeat(along(trajectory, sums.time[rows], over), 2)[1:-1]

    def draw(panel: Axes, quantity: str, name: str, line: str, i: int, text: str | None = None) -> None:
        mean, half = means(sums.time, -sums[f"walls_{quantity}/{name}"].astype(float), rows)
        y, part = np.repeat(mean, 2), np.repeat(half, 2)
        panel.plot(steps, y, lw=1.2, label=text, **some_marks(KINDS[i], i, ls=line))
        if np.isfinite(part).any():
            panel.fill_between(steps, y - part, y + part, color=KINDS[i], alpha=0.2, lw=0.0)
        reach.setdefault(panel, []).extend((mean, (mean - half)[1:], (mean + half)[1:]))

    for i, name in enumerate(names[: len(KINDS)]):
        draw(force, "momentum_y", name, "-", i, plain(name))
        draw(force, "momentum_x", name, ":", i)
        if torque is not None:
            draw(torque, "torque", name, "-", i)
        for panel, quantity in zip(given, quantities, strict=True):
            values = sums[f"walls_{quantity}/{name}"]
            panel.plot(along(trajectory, sums.time, over), values, lw=1.2, **some_marks(KINDS[i], i))
    for panel, parts in reach.items():
        ends = np.concatenate(parts)
        low, high = np.nanmin(ends), np.nanmax(ends)
        if high > low:
            margin = 0.05 * (high - low)
            panel.set_ylim(low - margin, high + margin)
    left_out = len(sums.columns("walls_hits")) > len(KINDS) == len(names)
    text = "along $x$ (others: $y$)" + ("; those of most hits" if left_out else "")
    if len(sums.time) > FEWEST_ROWS * len(rows):
        text += f"; bands: {PERCENT} intervals"
    force.plot([], [], ":", color="0.5", label=text)
    force.set_ylabel(label(trajectory, "mean force on the wall", "mass length/time^2"))
    if torque is not None:
        text = f"mean torque about {_centre_of_torques(trajectory)}"
        torque.set_ylabel(label(trajectory, text, "mass length^2/time^2"))
    for panel, quantity in zip(given, quantities, strict=True):
        panel.set_ylabel(label(trajectory, f"{quantity} given to disks", "energy"))
    for panel in (force, *others):
        panel.set_xlabel(axis_label(trajectory, over))
    grid(force, *others)
    legend_above(force, 2)


def _centre_of_torques(trajectory: Trajectory) -> str:
    turning = sum(wall.turn != Turn() for wall in trajectory.walls)
    if turning == len(trajectory.walls) and all(trajectory.box.periodic):
        return "the centre of its turn"
    return "(0, 0)" + "\n(walls that turn: its centre)" * (turning > 0)
