"""Pictures of a run, from its trajectory file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..tools.files import write_aside
from ..trajectory.reader import Trajectory
from . import disks as plot_disks
from . import profiles as plot_profiles
from . import profiles as profile_data
from . import temperatures as plot_temperatures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def cooling(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a cooling gas: its temperatures against time beside kinetic theory, and its disks at the end.

    The theory is `theory.prediction` from the first frame on, of one kind of disks or of a mixture. Where it does not
    hold (more than `curves.MOST_KINDS` kinds of disks, rolling friction), the picture says so.

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
    _draw(path_h5, path_png, plot_temperatures.cooling)


def driven(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a driven gas: its temperatures against time beside kinetic theory, and its disks at the end.

    The theory is `theory.prediction` from the first frame on, of one kind of disks or of a mixture, and of one kind
    `driven_gas.steady_state`. Where they do not hold (more than `curves.MOST_KINDS` kinds of disks, rolling
    friction, a force that is not linear), the picture says so.

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
    _draw(path_h5, path_png, plot_temperatures.driven)


def walled(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a gas between walls: temperatures against time, profiles across it (`profiles.py`), and its last frame.

    Profiles go upwards under gravity, else from wall to wall; they are means over the second half of the frames.

    Parameters
    ----------
    path_h5 : path
        A trajectory as for `cooling`, with its walls and the parameter `gravity` that `ifrdem run` writes: a list of
        two numbers as JSON.
    path_png : path
        The picture to write, as for `cooling`.

    Raises
    ------
    InputError
        As `cooling`.
    """
    from matplotlib.figure import Figure

    with Trajectory(path_h5) as trajectory:
        if len(trajectory) == 0:
            raise InputError(f"{path_h5}: no frame to draw")
        width, height = trajectory.box.lengths
        tall = min(max(height / width, 0.5), 2.0)
        figure = Figure(figsize=(8.2 + 7.0 / max(tall, 1.0), 7.5), dpi=200, layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(8.2, 7.0 / max(tall, 1.0)), height_ratios=(1.0, 1.5))
        plot_temperatures.walled(figure.add_subplot(grid[0, 0]), trajectory)
        found = profile_data.of(trajectory)
        if found is not None:
            plot_profiles.draw(figure, grid[1, 0], trajectory, found)
        plot_disks.last_frame(figure, figure.add_subplot(grid[:, 1]), trajectory)
        figure.suptitle(title(trajectory))
        save(figure, Path(path_png))


def sheared(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a sheared gas: its temperatures against time beside kinetic theory, its flow, and its disks at the end.

    The theory is `theory.prediction` from the first frame on, and `sheared_gas.steady_state`. Where they do not
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
    _draw(path_h5, path_png, plot_temperatures.sheared, flow=True)


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
            plot_profiles.flow(figure.add_subplot(grid[:, 1]), trajectory)
        plot_disks.last_frame(figure, figure.add_subplot(grid[:, -1]), trajectory)
        figure.suptitle(title(trajectory))
        save(figure, Path(path_png))


def title(trajectory: Trajectory) -> str:
    """What stands above a picture of a run."""
    text, n = gas(trajectory), trajectory.disks.n
    if "collisions" in trajectory.observables and n:
        text += f", {2.0 * float(trajectory.observables['collisions'][-1]) / n:.3g} collisions per disk"
    return text


def gas(trajectory: Trajectory) -> str:
    """Name, number of disks and packing fraction of a run."""
    disks = trajectory.disks
    name = trajectory.parameters.get("name", trajectory.path.stem)
    where = "open box"
    if not trajectory.box.is_open:
        where = f"packing fraction {trajectory.room.packing_fraction(disks.radius):.3g}"
    if trajectory.room.all_walls:
        where = where.replace("packing fraction", "packing fraction between walls")
    return f"{name}: {disks.n} disks, {where}"


def save(figure: Figure, path: Path) -> None:
    """Write a picture; it appears whole or not at all."""
    write_aside(path, lambda aside: figure.savefig(aside, format="png"))
