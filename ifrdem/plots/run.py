"""Pictures of a run, from its trajectory file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..tools.files import write_aside
from ..trajectory.reader import Trajectory
from . import disks, profiles, temperatures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def cooling(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a cooling gas: its temperatures against time beside kinetic theory, and its disks at the end.

    The theory is `theory.prediction` from the first frame on, of one kind of disks or of a mixture. Where it does not
    hold (more than `curves.MOST_KINDS` kinds of disks, rolling friction), the picture says so. InputError if the
    trajectory cannot be read or lacks these observables, or the picture cannot be written.

    Parameters
    ----------
    path_h5 : path
        A trajectory with the observables `temperature` and `rotational_temperature` and, for the theory, the
        parameter `laws` that `ifrdem run` writes: rows of IFRLaw arguments as JSON.
    path_png : path
        The picture to write: it appears whole or not at all. An existing one is replaced.

    Examples
    --------
    >>> from ifrdem import plots
    >>> plots.cooling("cooling.h5", "cooling.png")  # of `ifrdem run cooling`
    """
    _draw(path_h5, path_png, temperatures.cooling)


def driven(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a driven gas: its temperatures against time beside kinetic theory, and its disks at the end.

    As `cooling`, with the parameter `forces` that `ifrdem run` writes, a list of the keys of each force as JSON; of one
    kind of disks also the steady state (`driven_gas.steady_state`). Theory knows linear forces only.

    Examples
    --------
    >>> from ifrdem import plots
    >>> plots.driven("driven.h5", "driven.png")  # of `ifrdem run driven`
    """
    _draw(path_h5, path_png, temperatures.driven)


def sheared(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a sheared gas: its temperatures against time beside kinetic theory, its flow, and its disks at the end.

    As `cooling`, of a sheared box, with `sheared_gas.steady_state`; theory knows one kind of disks without forces. The
    flow is the mean velocity along x in slabs, over the second half of the frames.

    Examples
    --------
    >>> from ifrdem import plots
    >>> plots.sheared("shear.h5", "shear.png")  # of `ifrdem run shear`
    """
    _draw(path_h5, path_png, temperatures.sheared, flow=True)


def walled(path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]) -> None:
    """Draw a gas between walls: temperatures against time, profiles across it (`profiles.py`), and its last frame.

    As `cooling`, without theory. Profiles go upwards under gravity (the parameter `gravity`, two numbers as JSON), else
    from wall to wall; they are means over the second half of the frames.

    Examples
    --------
    >>> from ifrdem import plots
    >>> plots.walled("drum.h5", "drum.png")  # of `ifrdem run drum`
    """
    with drawing(path_h5, path_png) as (trajectory, figure):
        width, height = trajectory.box.lengths
        right = 7.0 / max(min(height / width, 2.0), 1.0)
        figure.set_size_inches(8.2 + right, 7.5)
        grid = figure.add_gridspec(2, 2, width_ratios=(8.2, right), height_ratios=(1.0, 1.5))
        temperatures.walled(figure.add_subplot(grid[0, 0]), trajectory)
        found = profiles.of(trajectory)
        if found is not None:
            profiles.draw(figure, grid[1, 0], trajectory, found)
        disks.last_frame(figure, figure.add_subplot(grid[:, 1]), trajectory)


def _draw(
    path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str],
    draw: Callable[[Axes, Axes, Trajectory], None], *, flow: bool = False,
) -> None:  # fmt: skip
    """A picture of temperatures (left, and their ratio below), the flow if wished, and disks (right)."""
    with drawing(path_h5, path_png) as (trajectory, figure):
        figure.set_size_inches(16.5 if flow else 13.5, 6.3)
        widths = (1.0, 0.4, 1.15) if flow else (1.0, 1.15)
        grid = figure.add_gridspec(2, len(widths), width_ratios=widths, height_ratios=(3.0, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        draw(upper, figure.add_subplot(grid[1, 0], sharex=upper), trajectory)
        if flow:
            profiles.flow(figure.add_subplot(grid[:, 1]), trajectory)
        disks.last_frame(figure, figure.add_subplot(grid[:, -1]), trajectory)


@contextmanager
def drawing(
    path_h5: str | os.PathLike[str], path_png: str | os.PathLike[str]
) -> Iterator[tuple[Trajectory, Figure]]:
    """A trajectory with frames, and a figure that gets its title and is written in the end."""
    from matplotlib.figure import Figure

    with Trajectory(path_h5) as trajectory:
        if len(trajectory) == 0:
            raise InputError(f"{path_h5}: no frame to draw")
        figure = Figure(dpi=200, layout="constrained")
        yield trajectory, figure
        figure.suptitle(title(trajectory))
        save(figure, Path(path_png))


def title(trajectory: Trajectory) -> str:
    """Title of a picture of a run."""
    text, n = gas(trajectory), trajectory.disks.n
    if "collisions" in trajectory.observables and n:
        text += f", {2.0 * float(trajectory.observables['collisions'][-1]) / n:.3g} collisions per disk"
    return text


def gas(trajectory: Trajectory) -> str:
    """Name, number of disks and packing fraction of a run."""
    name, n = trajectory.parameters.get("name", trajectory.path.stem), trajectory.disks.n
    where = "open box"
    if not trajectory.box.is_open:
        where = f"packing fraction {trajectory.room.packing_fraction(trajectory.disks.radius):.3g}"
    if trajectory.room.all_walls:
        where = where.replace("packing fraction", "packing fraction between walls")
    return f"{name}: {n} disks, {where}"


def save(figure: Figure, path: Path) -> None:
    """Write a picture; it appears whole or not at all."""
    write_aside(path, lambda aside: figure.savefig(aside, format="png"))
