"""Panels of temperatures against time, with kinetic theory where it holds."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..analysis.gas_theory import Curves, gas_of
from ..errors import InputError
from ..theory import driven_gas
from ..theory.choose import is_closed
from ..theory.driven_gas import Driving
from ..tools.labels import few_labels
from ..trajectory.reader import Trajectory
from .series import along, axis_label, cools
from .style import (
    RATIO,
    ROTATION,
    TRANSLATION,
    foreground,
    from_zero,
    grid,
    label,
    legend,
    marks,
    positive,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (TRANSLATION, ROTATION, RATIO)
# Of T, T_rot and their ratio: long and short dashes, and near and far dots.
THEORY = (0, (6.0, 2.0)), (0, (2.5, 1.5)), (0, (6.0, 2.0))
STEADY = (0, (1.0, 1.5)), (0, (1.0, 4.0)), (0, (1.0, 1.5))
NAMES = (
    r"translational, $T = \langle m v^2 \rangle / 2$",
    r"rotational, $T_\mathrm{rot} = \langle I \omega^2 \rangle$",
    None,
)


def theory(trajectory: Trajectory, over: str = "t") -> tuple[Curves | None, tuple[float, float] | None, str]:
    """Curves of kinetic theory, T and T_rot of the steady state, and a note; None where there are none.

    Of several kinds of disks that are driven there is no steady state in closed form; the curve shows it where the run
    is long.
    """
    gas, times, rate = gas_of(trajectory), trajectory.times, trajectory.box.shear_rate
    if isinstance(gas, str):
        return None, None, gas
    steady, moves, closed = None, bool(gas.T0.any()), is_closed()
    nothing = "nothing moves: no kinetic theory here"
    if rate and closed:
        try:
            flow = gas.steady_flow(rate)
        except InputError as error:
            return None, None, str(error)
        steady = None if flow is None else (flow.temperature, flow.rotational_temperature)
        nothing = "nothing moves at first: no curve of kinetic theory here"
    elif gas.forces:
        masses = zip(gas.disks.mass.tolist(), gas.disks.inertia.tolist(), strict=True)
        drives = [Driving.of(gas.forces, mass, inertia) for mass, inertia in set(masses)]
        known = [driving for driving in drives if driving is not None]
        if len(known) < len(drives):
            return None, None, "a force that is not linear: no kinetic theory here"
        moves |= any(driving.power for driving in known)
        if gas.kinds == 1 and moves and closed and not gas.laws[0][0].depends_on_speed:
            steady = driven_gas.steady_state(*gas.one_kind, known[0])
    if not moves or times[-1] <= times[0]:
        return None, steady if rate else None, nothing
    elapsed = times[times > times[0]] - times[0]
    when = np.linspace(0.0, elapsed[-1], 400)
    if not rate and not gas.forces:
        # Of a single frame, a decade before it shows where it comes from.
        when = np.geomspace(elapsed[0] if len(elapsed) > 1 else 0.1 * elapsed[0], elapsed[-1], 300)
    try:
        curves = gas.curves(trajectory, when, over, rate)
    except InputError as error:
        if closed:
            raise
        return None, None, f"no DSMC here: {error}"
    return curves, steady, curves.text


def draw(trajectory: Trajectory, over: str, upper: Axes, lower: Axes | None = None) -> None:
    """Draw both temperatures and, given axes, their ratio theta against time, with the theory of the run.

    A cooling gas is drawn double logarithmic: a homogeneous one cools like t^-2 (Haff), a straight line. Over
    collisions per disk only T is logarithmic. Other gases have plain axes that begin at 0. Between walls there is no
    theory; where a tenth of the positive temperatures there are below a hundredth of the highest one, the axis is
    logarithmic and leaves out zeros, that is disks at rest.
    """
    walled = bool(trajectory.free_area.all_walls)
    free = cools(trajectory)
    T, T_rot = (trajectory.observables[name] for name in ("temperature", "rotational_temperature"))
    known = np.concatenate((T[T > 0.0], T_rot[T_rot > 0.0]))
    decades = walled and len(known) > 0 and np.quantile(known, 0.1) < 0.01 * known.max()
    lower = None if walled else lower
    # Time 0 has no place on a logarithmic axis.
    shown = (trajectory.times > 0.0) | (over != "t" or not free)
    _points(upper, lower, trajectory, shown, over, zeros=walled and not decades)
    if not walled:
        _theory(upper, lower, over, *theory(trajectory, over))
    if decades:
        upper.set_yscale("log")
    elif free and np.any(T[shown] > 0.0):
        upper.set(xscale="log" if over == "t" else "linear", yscale="log")
    upper.set_ylabel(label(trajectory, "temperature", "energy"))
    (lower or upper).set_xlabel(axis_label(trajectory, over))
    grid(upper)
    if lower is not None:
        lower.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
        from_zero(lower)
        grid(lower)
        upper.tick_params(which="both", labelbottom=False)
    if not (free or decades):
        from_zero(upper)
    legend(upper)
    if upper.get_xscale() == "log":
        few_labels(upper)
    if upper.get_yscale() == "log":
        few_labels(upper, "y")


def _points(
    upper: Axes, lower: Axes | None, trajectory: Trajectory, shown: NDArray[np.bool_], over: str, *, zeros: bool
) -> None:  # fmt: skip
    """Draw T, T_rot and, if it has axes, their ratio at the frames that are `shown`.

    `zeros` are drawn on plain axes: disks at rest.

    Without error bars: how much T and T_rot of independent gases differ follows from no property of a single frame. Cases
    draw the start with exactly the given energy (`initial.maxwellian`), spins begin at rest or so, and later every
    collision shares noise between two disks, so that neither 1/n nor 2/n is the relative variance. Seeds of a study show
    it.
    """
    T, T_rot = (trajectory.observables[name] for name in ("temperature", "rotational_temperature"))
    x = along(trajectory, trajectory.times, over)[shown]
    with np.errstate(divide="ignore", invalid="ignore"):
        values = (T, T_rot, T_rot / T)
    for axes, value, colour, name in zip((upper, upper, lower), values, COLOURS, NAMES, strict=True):
        if axes is None or (value is not T and not np.any(np.nan_to_num(value))):  # nothing spins
            continue
        # Open, so that the theory shows where it agrees.
        y = value[shown] if zeros else positive(value[shown])
        axes.plot(x, y, ms=5, label=name, **marks(colour))


def _theory(
    upper: Axes, lower: Axes | None, over: str, drawn: Curves | None, steady: tuple[float, float] | None, note: str
) -> None:  # fmt: skip
    """Draw temperatures by theory, those of the steady state, and their ratios, if there are any, with a note."""
    if drawn is not None:
        when, T, T_rot, tau, _ = drawn
        T = positive(T)  # disks may begin at rest
        curves = zip((upper, upper, lower), (T, T_rot, T_rot / T), COLOURS, THEORY, strict=True)
        for axes, values, colour, line in curves:
            if axes is not None:
                axes.plot(when if over == "t" else tau, positive(values), ls=line, lw=1.5, color=colour)
    style = "--" if drawn is not None else "none"
    upper.plot([], [], color=foreground(upper), ls=style, lw=1.5, label=textwrap.fill(note, 60))
    if steady is not None:
        ratio = steady[1] / steady[0]
        for axes, value, colour, line in zip(
            (upper, upper, lower), (*steady, ratio), COLOURS, STEADY, strict=True
        ):
            if axes is not None and np.isfinite(value):
                axes.axhline(value, ls=line, lw=1.5, color=colour)
        upper.plot([], [], color=foreground(upper), ls=":", lw=1.5, label="steady state of kinetic theory")
