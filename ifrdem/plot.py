"""Pictures of a run, from its trajectory file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import curves
from .box import Box
from .errors import InputError
from .trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's blue and vermilion: told apart with every kind of colour blindness, and in grey.
TRANSLATION, ROTATION, RATIO = "#0072B2", "#D55E00", "#444444"
# Diverging, dark in the middle, so that disks without spin show on white; orange is counter-clockwise.
SPINS = ("#56B4E9", "#2A6A99", "#333333", "#A84A00", "#FF9A3D")

MOST_DISKS = 100_000
"""Above this many disks one by one are smaller than a pixel, and slow: a density map is drawn."""

SLABS = 20  # in which the mean flow is drawn

MAP_CELL = 6.0  # side of the density map's cells in mean diameters: some 10 to 30 disks each at phi = 0.25


def cooling(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a cooling gas: its temperatures against time beside kinetic theory, and its disks at the end.

    The theory is `theory.cooling` from the first frame on. Where it does not hold (several kinds of disks,
    rolling friction), the picture says so.

    Parameters
    ----------
    path_h5 : path
        A trajectory with the observables `temperature` and `rotational_temperature` and, for the theory, the
        parameter `laws` that `ifrdem run` writes: rows of IFRLaw arguments as JSON.
    path_png : path
        The picture to write: it appears whole or not at all. An existing one is replaced.

    Raises
    ------
    InputError
        If the trajectory cannot be read or lacks these observables, or the picture cannot be written.
    """
    _draw(path_h5, path_png, _temperatures)


def driven(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a driven gas: its temperatures against time beside kinetic theory, and its disks at the end.

    The theory is `driven_theory.driven` from the first frame on, and `driven_theory.steady_state`. Where they do not
    hold (several kinds of disks, rolling friction, a force that is not linear), the picture says so.

    Parameters
    ----------
    path_h5 : path
        A trajectory as for `cooling`, with the parameter `forces` that `ifrdem run` writes: a list of the keys of each
        force as JSON.
    path_png : path
        The picture to write, as for `cooling`.

    Raises
    ------
    InputError
        As `cooling`.
    """
    _draw(path_h5, path_png, _driven_temperatures)


def sheared(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a sheared gas: its temperatures against time beside kinetic theory, its flow, and its disks at the end.

    The theory is `shear_theory.sheared` from the first frame on, and `shear_theory.steady_state`. Where they do not
    hold (several kinds of disks, rolling friction, forces), the picture says so. The flow is the mean velocity along x
    in slabs, over the second half of the frames.

    Parameters
    ----------
    path_h5 : path
        A trajectory as for `cooling`, of a sheared box.
    path_png : path
        The picture to write, as for `cooling`.

    Raises
    ------
    InputError
        As `cooling`.
    """
    _draw(path_h5, path_png, _sheared_temperatures, flow=True)


def _draw(
    path_h5: str | os.PathLike[str],
    path_png: str | os.PathLike[str],
    temperatures: Callable[[Axes, Axes, Trajectory], None],
    *,
    flow: bool = False,
) -> None:
    """A picture of temperatures (left, and their ratio below), the flow if wished, and disks (right)."""
    from matplotlib.figure import Figure

    with Trajectory(path_h5) as trajectory:
        if len(trajectory) == 0:
            raise InputError(f"{path_h5}: no frame to draw")
        figure = Figure(figsize=(16.5 if flow else 13.5, 6.3), dpi=200, layout="constrained")
        widths = (1.0, 0.4, 1.15) if flow else (1.0, 1.15)
        grid = figure.add_gridspec(2, len(widths), width_ratios=widths, height_ratios=(3.0, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        temperatures(upper, lower, trajectory)
        if flow:
            _flow(figure.add_subplot(grid[:, 1]), trajectory)
        _last_frame(figure, figure.add_subplot(grid[:, -1]), trajectory)
        figure.suptitle(_title(trajectory))
        _save(figure, Path(path_png))


def _temperatures(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Both temperatures, and below them their ratio theta, against time.

    Double logarithmic: a homogeneous gas cools like t^-2 (Haff), a straight line.
    """
    times = trajectory.times
    later = times > 0.0  # time 0 has no place on a logarithmic axis
    T = _points(upper, lower, trajectory, later)
    drawn, note = curves.cooling(trajectory)
    if drawn is not None:
        _curves(upper, lower, *drawn)
    upper.plot([], [], color="black", ls="--" if drawn is not None else "none", lw=1.5, label=note)
    upper.legend(loc="best", frameon=False)
    if np.count_nonzero(later) and np.any(T[later] > 0.0):
        upper.set_xscale("log")
        upper.set_yscale("log")
    _label(upper, lower, trajectory)
    if upper.get_xscale() == "log":
        _few_labels(upper)
    upper.tick_params(which="both", labelbottom=False)


def _driven_temperatures(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Both temperatures, and below them their ratio theta, against time, on plain axes that begin at 0."""
    _points(upper, lower, trajectory, np.ones(len(trajectory), dtype=bool))
    _with_steady_state(upper, lower, trajectory, curves.driven(trajectory))


def _sheared_temperatures(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """The same for a sheared gas."""
    _points(upper, lower, trajectory, np.ones(len(trajectory), dtype=bool))
    _with_steady_state(upper, lower, trajectory, curves.sheared(trajectory))


def _with_steady_state(
    upper: Axes,
    lower: Axes,
    trajectory: Trajectory,
    theory: tuple[curves.Curves | None, tuple[float, float] | None, str],
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
        _from_zero(axes)
    upper.legend(loc="best", frameon=False)
    upper.tick_params(which="both", labelbottom=False)


def _flow(axes: Axes, trajectory: Trajectory) -> None:
    """Mean velocity along x in slabs, over the second half of the frames, beside the flow that the box imposes."""
    units, box = trajectory.units, trajectory.box
    height = box.lengths[1]
    edges = np.array([0.0, height])
    imposed = box.flow(np.stack((np.zeros(2), edges), axis=1))[:, 0]
    speed = units["length"] + "/" + units["time"] if "time" in units else None
    if {"position", "velocity"} <= set(trajectory.fields):
        count, sum_ = np.zeros(SLABS), np.zeros(SLABS)
        for frame in trajectory[len(trajectory) // 2 :]:
            slab = np.minimum((frame.position[:, 1] / height * SLABS).astype(int), SLABS - 1)
            count += np.bincount(slab, minlength=SLABS)
            sum_ += np.bincount(slab, frame.velocity[:, 0], minlength=SLABS)
        middles = (np.arange(SLABS) + 0.5) * height / SLABS
        with np.errstate(invalid="ignore"):
            axes.plot(sum_ / count, middles, "o", ms=5, mfc="none", color=TRANSLATION, label="disks")
    axes.plot(imposed, edges, "-", lw=1.0, color="black", label=r"$\dot\gamma (y - L_y / 2)$")
    axes.set_ylim(0.0, height)
    axes.set_xlabel(_with_unit(r"$\langle v_x \rangle$", speed))
    axes.set_ylabel(_with_unit("$y$", units.get("length")))
    axes.set_title("mean flow, second half")
    axes.grid(True, which="major", lw=0.4, alpha=0.5)
    axes.legend(loc="upper left", frameon=False)


def _points(
    upper: Axes, lower: Axes, trajectory: Trajectory, shown: NDArray[np.bool_]
) -> NDArray[np.float64]:
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
        # Open, so that the theory shows where it agrees.
        axes.plot(times[shown], _positive(values[shown]), "o", ms=5, mfc="none", color=colour, label=label)
    return T


def _curves(
    upper: Axes, lower: Axes, when: NDArray[np.float64], T: NDArray[np.float64], T_rot: NDArray[np.float64]
) -> None:
    """Draw temperatures by theory, and their ratio."""
    for axes, values, colour in (
        (upper, T, TRANSLATION),
        (upper, T_rot, ROTATION),
        (lower, T_rot / T, RATIO),
    ):
        axes.plot(when, _positive(values), "--", lw=1.5, color=colour)


def _label(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """Label the axes, of which the lower ones begin at 0."""
    units = trajectory.units
    upper.set_ylabel(_with_unit("temperature", units.get("energy")))
    lower.set_ylabel(r"$\theta = T_\mathrm{rot} / T$")
    _from_zero(lower)
    lower.set_xlabel(_with_unit("time $t$", units.get("time")))
    for axes in (upper, lower):
        axes.grid(True, which="major", lw=0.4, alpha=0.5)


def _from_zero(axes: Axes) -> None:
    """Let the vertical axis begin at 0 and end so far above what is drawn that no marker is cut."""
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    highest = np.max(drawn, where=np.isfinite(drawn), initial=0.0)
    axes.set_ylim(0.0, 1.12 * highest if highest > 0.0 else 1.0)


def _few_labels(axes: Axes) -> None:
    """Label a logarithmic time axis so that labels neither collide nor lack, however short it is.

    Matplotlib labels powers of ten and, below a decade or so, some of the ticks between them, without regard
    to their width. Below two decades the steps here are those of rulers: 1, 2, 5, or finer.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    first, last = axes.get_xlim()
    axes.xaxis.set_minor_formatter(NullFormatter())
    if last / first >= 100.0:
        return
    # Two labels at least: any factor of 5 holds two of the first, any of 2.1 two of the others, and frames
    # that begin at 0 and are evenly spaced span a factor of 2, and the margins.
    steps = (1.0, 2.0, 5.0) if last / first >= 5.0 else (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
    axes.xaxis.set_major_locator(LogLocator(subs=steps))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _short(value)))


def _short(value: float) -> str:
    """0.05 and 2000, but 5 x 10^-6 in full."""
    if 1e-3 <= value < 1e4:
        return f"{value:.6g}"
    factor, exponent = f"{value:.5e}".split("e")
    return rf"${float(factor):g} \times 10^{{{int(exponent)}}}$"


def _last_frame(figure: Any, axes: Axes, trajectory: Trajectory) -> None:
    """The disks of the last frame, coloured by spin, or a map of where they are if they are too many."""
    units, lengths = trajectory.units, trajectory.box.lengths
    frame = trajectory[-1]
    axes.set_xlim(0.0, lengths[0])
    axes.set_ylim(0.0, lengths[1])
    axes.set_aspect("equal")
    axes.set_xlabel(_with_unit("$x$", units.get("length")))
    axes.set_ylabel(_with_unit("$y$", units.get("length")))
    if "position" not in trajectory.fields:
        axes.set_title("the file holds no positions")
        return
    time = f"$t$ = {trajectory.with_unit(f'{frame.time:.4g}', 'time')}"
    if trajectory.disks.n > MOST_DISKS:
        cell = _density_map(figure, axes, trajectory, frame.position)
        size = trajectory.with_unit(f"{cell:.3g}", "length")
        axes.set_title(f"area fraction at {time}, in cells of {size}\n(too many disks to draw each)")
    else:
        spin = frame.spin if "angular_velocity" in trajectory.fields else np.zeros(trajectory.disks.n)
        _disks(figure, axes, trajectory, frame.position, spin, frame.time)
        axes.set_title(f"disks at {time}")


def _disks(
    figure: Any,
    axes: Axes,
    trajectory: Trajectory,
    position: NDArray[np.float64],
    spin: NDArray[np.float64],
    time: float,
) -> None:
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import LinearSegmentedColormap

    radius = trajectory.disks.radius
    position, owner = _with_images(position, radius, trajectory.box, time)
    # A heavy tail of fast spins must not wash out all others: colours are full from the 95th percentile on.
    limit = float(np.quantile(np.abs(spin), 0.95)) if len(spin) else 0.0
    limit = limit if limit > 0.0 else 1.0
    drawn = EllipseCollection(
        2.0 * radius[owner],
        2.0 * radius[owner],
        np.zeros(len(owner)),
        units="xy",
        offsets=position,
        offset_transform=axes.transData,
        array=spin[owner],
        cmap=LinearSegmentedColormap.from_list("spins", SPINS),
        clim=(-limit, limit),
        linewidths=0.0,
    )
    axes.add_collection(drawn)
    unit_time = trajectory.units.get("time")
    unit = "reduced units" if unit_time is None else f"rad/{unit_time}"
    bar = figure.colorbar(drawn, ax=axes, extend="both", shrink=0.85)
    bar.set_label(rf"spin $\omega$ ({unit}), counter-clockwise positive")


def _density_map(figure: Any, axes: Axes, trajectory: Trajectory, position: NDArray[np.float64]) -> float:
    """Draw the local area fraction and return the mean side of its cells [length]."""
    lengths, radius = trajectory.box.lengths, trajectory.disks.radius
    cell = MAP_CELL * 2.0 * float(np.sqrt(np.mean(radius**2)))
    counts = [int(np.clip(round(side / cell), 1, 1000)) for side in lengths]
    covered, _, _ = np.histogram2d(
        position[:, 0],
        position[:, 1],
        bins=counts,
        range=[(0.0, side) for side in lengths],
        weights=np.pi * radius**2,
    )
    covered *= counts[0] * counts[1] / trajectory.box.area
    drawn = axes.imshow(
        covered.T,
        origin="lower",
        extent=(0.0, lengths[0], 0.0, lengths[1]),
        cmap="cividis",
        vmin=0.0,
        vmax=float(np.quantile(covered, 0.999)),
        interpolation="nearest",
    )
    figure.colorbar(drawn, ax=axes, extend="max", shrink=0.85).set_label("area fraction")
    return float(np.sqrt(trajectory.box.area / (counts[0] * counts[1])))


def _with_images(
    position: NDArray[np.float64], radius: NDArray[np.float64], box: Box, time: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Positions with the periodic images of disks that a side cuts, and which disk each of them is."""
    owner = np.arange(len(position))
    for axis in (1, 0):  # what comes in above or below may be cut at the side
        length = box.periods[axis]
        if length == 0.0:
            continue
        low = position[:, axis] < radius[owner]
        high = position[:, axis] > length - radius[owner]
        shift = np.zeros(2)
        shift[axis] = length
        if axis == 1:
            shift[0] = box.image_above(time)
        position = np.concatenate([position, position[low] + shift, position[high] - shift])
        if axis == 1 and box.periodic[0]:
            position[:, 0] %= box.lengths[0]
        owner = np.concatenate([owner, owner[low], owner[high]])
    return position, owner


def _title(trajectory: Trajectory) -> str:
    disks, phi = trajectory.disks, trajectory.box.packing_fraction(trajectory.disks.radius)
    name = trajectory.parameters.get("name", trajectory.path.stem)
    text = f"{name}: {disks.n} disks, packing fraction {phi:.3g}"
    if "collisions" in trajectory.observables and disks.n:
        text += f", {2.0 * float(trajectory.observables['collisions'][-1]) / disks.n:.3g} collisions per disk"
    return text


def _positive(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """With nan for what a logarithmic axis cannot show, such as the temperature of spins at rest."""
    return np.where(values > 0.0, values, np.nan)


def _with_unit(text: str, unit: str | None) -> str:
    return f"{text} ({'reduced units' if unit is None else unit})"


def _save(figure: Figure, path: Path) -> None:
    """Write beside the target and rename into place."""
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        figure.savefig(aside, format="png")
        os.replace(aside, path)
    except OSError as error:
        raise InputError(f"picture {path} cannot be written: {error.strerror}") from error
    finally:
        aside.unlink(missing_ok=True)
