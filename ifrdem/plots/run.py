"""Pictures of a run, from its trajectory file."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, counted
from ..tools.checked import validated
from ..tools.files import write_saved
from ..trajectory.reader import Trajectory
from . import disks, profiles, temperatures
from .style import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Run = str | os.PathLike[str] | Trajectory
PicturePath = str | os.PathLike[str] | None
FORMATS = ("png", "svg", "pdf")
"""Of pictures, by their endings."""


@validated
def cooling(run: Run, path_png: PicturePath = None) -> Figure:
    """Draw a cooling gas: its temperatures against time with kinetic theory, and its disks at the end.

    The theory is `theory.prediction` from the first frame on, of one kind of disks or of a mixture. Where it does not
    hold (more than `gas_theory.MOST_KINDS` kinds of disks, rolling friction), the figure gives the reason. InputError
    if the trajectory cannot be read or lacks these observables, or the picture cannot be written.

    Parameters
    ----------
    run : path or Trajectory
        A trajectory, or its file, with the observables `temperature` and `rotational_temperature` and, for the theory,
        the parameter `laws` that `ifrdem run` writes: rows of IFRLaw arguments as JSON.
    path_png : path, optional
        The picture to write: it appears whole or not at all. An existing one is replaced.

    Returns
    -------
    Figure
        The same, to change or to show.

    Examples
    --------
    >>> from ifrdem import plots
    >>> figure = plots.cooling("cooling.h5", "cooling.png")  # of `ifrdem run cooling`
    """
    return _draw(run, path_png)


@validated
def driven(run: Run, path_png: PicturePath = None) -> Figure:
    """Draw a driven gas: its temperatures against time with kinetic theory, and its disks at the end.

    As `cooling`, with the parameter `forces` that `ifrdem run` writes, a list of the keys of each force as JSON; of one
    kind of disks also the steady state (`driven_gas.steady_state`). Theory knows linear forces only.

    Examples
    --------
    >>> from ifrdem import plots
    >>> figure = plots.driven("driven.h5", "driven.png")  # of `ifrdem run driven`
    """
    return _draw(run, path_png)


@validated
def sheared(run: Run, path_png: PicturePath = None) -> Figure:
    """Draw a sheared gas: its temperatures against time with kinetic theory, its flow, and its disks at the end.

    As `cooling`, of a sheared box, with `sheared_gas.steady_state`; theory knows one kind of disks without forces. The
    flow is the mean velocity along x in slabs, over the second half of the frames.

    Examples
    --------
    >>> from ifrdem import plots
    >>> figure = plots.sheared("shear.h5", "shear.png")  # of `ifrdem run shear`
    """
    return _draw(run, path_png, flow=True)


@validated
def walled(run: Run, path_png: PicturePath = None) -> Figure:
    """Draw a gas between walls: temperatures against time, profiles across it (`profiles.py`), and its last frame.

    As `cooling`, without theory. Profiles go upwards under gravity (the parameter `gravity`, two numbers as JSON), else
    from wall to wall; they are means over the second half of the frames. Where gravity turns there are none.

    Examples
    --------
    >>> from ifrdem import plots
    >>> figure = plots.walled("drum.h5", "drum.png")  # of `ifrdem run drum`
    """
    with drawing(run, path_png) as (trajectory, figure):
        width, height = trajectory.box.lengths
        right = 7.0 / max(min(height / width, 2.0), 1.0)
        figure.set_size_inches(8.2 + right, 7.5)
        grid = figure.add_gridspec(2, 2, width_ratios=(8.2, right), height_ratios=(1.0, 1.5))
        turns = "gravity_rotation_rate" in trajectory.parameters
        found = None if turns else profiles.of(trajectory)
        temperatures.draw(trajectory, "t", figure.add_subplot(grid[:, 0] if turns else grid[0, 0]))
        if found is not None:
            profiles.draw(figure, grid[1, 0], trajectory, found)
        elif not turns:
            lacks = [one for one in ("position", "velocity") if one not in trajectory.fields]
            empty = figure.add_subplot(grid[1, 0])
            empty.set_axis_off()
            empty.text(0.5, 0.5, f"no profiles: the file holds no {' and no '.join(lacks)}", ha="center")
        disks.last_frame(figure.add_subplot(grid[:, 1]), trajectory)
    return figure


def _draw(run: Run, path_png: PicturePath, *, flow: bool = False) -> Figure:
    """A picture of temperatures (left, and their ratio below), the flow if wished, and disks (right)."""
    with drawing(run, path_png) as (trajectory, figure):
        figure.set_size_inches(16.5 if flow else 13.5, 6.3)
        widths = (1.0, 0.4, 1.15) if flow else (1.0, 1.15)
        grid = figure.add_gridspec(2, len(widths), width_ratios=widths, height_ratios=(3.0, 1.0))
        upper = figure.add_subplot(grid[0, 0])
        temperatures.draw(trajectory, "t", upper, figure.add_subplot(grid[1, 0], sharex=upper))
        if flow:
            profiles.flow(figure.add_subplot(grid[:, 1]), trajectory)
        disks.last_frame(figure.add_subplot(grid[:, -1]), trajectory)
    return figure


@contextmanager
def drawing(run: Run, path_png: PicturePath) -> Iterator[tuple[Trajectory, Figure]]:
    """A trajectory with frames, and a figure that gets its title and is written in the end, if it has a place."""
    from matplotlib.figure import Figure

    with contextlib.nullcontext(run) if isinstance(run, Trajectory) else Trajectory(run) as trajectory:
        if len(trajectory) == 0:
            raise InputError(f"{trajectory.path}: no frame to draw")
        figure = Figure(dpi=200, layout="constrained")
        yield trajectory, figure
        figure.suptitle(title(trajectory))
        if path_png is not None:
            save(figure, Path(path_png))


def title(trajectory: Trajectory) -> str:
    """Title of a picture of a run."""
    text, n = gas(trajectory), trajectory.n
    if "collisions" in trajectory.observables and n:
        number = f"{2.0 * float(trajectory.observables['collisions'][-1]) / n:.3g}"
        text += f", {f'{float(number):.0f}' if 'e+' in number else number} collisions per disk"
    return text


def gas(trajectory: Trajectory) -> str:
    """Name, number of disks and packing fraction of a run; of a part of a trajectory, which one it is."""
    name, n = trajectory.parameters.get("name", trajectory.path.stem), trajectory.n
    where = "open box"
    if trajectory.missing:
        where = f"{len(trajectory.missing)} of its {len(trajectory.parts or ())} parts missing"
    elif not trajectory.box.is_open:
        free_area = trajectory.free_area
        where = f"packing fraction{free_area.name} {free_area.packing_fraction(trajectory.disks.radius):.3g}"
    if (part := trajectory.part) is not None:  # whose disks are no gas of their own
        where = f"part {part.number} of a trajectory (disks {part.first} to {part.first + n - 1})"
    return f"{plain(str(name))}: {counted(n, 'disk')}, {where}"


def save(figure: Figure, path: Path) -> None:
    """Write a picture, of the format that its ending says (`FORMATS`, else PNG); it appears whole or not at all."""
    from matplotlib import rc_context

    figure.draw_without_rendering()  # margins fit the labels that this layout has chosen from the next one on
    kind = path.suffix.lower()[1:]
    with rc_context({"pdf.fonttype": 42}):  # TrueType: journals refuse Type 3
        write_saved(path, lambda file: figure.savefig(file, format=kind if kind in FORMATS else "png"))
