"""The panel of a run's last frame: its disks and walls, or a map of where the disks are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..model.box import Box
from ..model.walls import Wall
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .style import place_axes, unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Diverging, dark in the middle, so that disks without spin show on white; orange is counter-clockwise.
SPINS = ("#56B4E9", "#2A6A99", "#333333", "#A84A00", "#FF9A3D")
DENSITIES = "cividis"
WALL, POST, HOT = "#000000", "#999999", "#CC79A7"

MOST_DISKS = 100_000
"""Above this many disks one by one are smaller than a pixel, and slow: a density map is drawn."""

MAP_CELL = 6.0  # side of the density map's cells in mean diameters: some 10 to 30 disks each at phi = 0.25


def last_frame(figure: Any, axes: Axes, trajectory: Trajectory, index: int = -1) -> None:
    """The disks of the last frame (or another), coloured by spin, or a map of where they are if they are too many."""
    frame = trajectory[index]
    position = frame.position if "position" in trajectory.fields else np.zeros((1, 2))
    place_axes(axes, trajectory, shown_region(trajectory, position))
    draw_walls(axes, trajectory, frame.time)
    if "position" not in trajectory.fields:
        axes.set_title("the file holds no positions")
        return
    time = f"$t$ = {trajectory.with_unit(f'{frame.time:.4g}', 'time')}"
    if trajectory.disks.n > MOST_DISKS:
        cell = _density_map(figure, axes, trajectory, position)
        size = trajectory.with_unit(f"{cell:.3g}", "length")
        axes.set_title(f"area fraction at {time}, in cells of {size}\n(too many disks to draw each)")
    else:
        spin = frame.spin if "angular_velocity" in trajectory.fields else np.zeros(trajectory.disks.n)
        _disks(figure, axes, trajectory, position, spin, frame.time)
        axes.set_title(f"disks at {time}")


def shown_region(trajectory: Trajectory, position: Array) -> Array:
    """Ends of x and of y [length], shape (2, 2), of the box; of an open one, of what holds these positions."""
    if not trajectory.box.is_open:
        return np.array([[0.0, side] for side in trajectory.box.lengths])
    low, high = position.min(axis=0), position.max(axis=0)
    middle, half = (low + high) / 2.0, float((high - low).max()) * 0.52 + float(trajectory.disks.radius.max())
    return np.stack([middle - half, middle + half], axis=1)


def _disks(
    figure: Any, axes: Axes, trajectory: Trajectory, position: Array, spin: Array, time: float
) -> None:
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import LinearSegmentedColormap

    radius = trajectory.disks.radius
    position, owner = with_images(position, radius, trajectory.box, time)
    # A heavy tail of fast spins must not wash out all others: colours are full from the 95th percentile on.
    limit = float(np.quantile(np.abs(spin), 0.95)) if len(spin) else 0.0
    limit = limit if limit > 0.0 else 1.0
    width = 2.0 * radius[owner]
    drawn = EllipseCollection(
        width, width, np.zeros(len(owner)), units="xy", offsets=position, offset_transform=axes.transData,
        array=spin[owner], cmap=LinearSegmentedColormap.from_list("spins", SPINS), clim=(-limit, limit), linewidths=0.0,
    )  # fmt: skip
    axes.add_collection(drawn)
    figure.colorbar(drawn, ax=axes, extend="both", shrink=0.85).set_label(spin_label(trajectory))


def spin_label(trajectory: Trajectory) -> str:
    unit = unit_of(trajectory, "time")
    return (
        rf"spin $\omega$ ({'reduced units' if unit is None else f'rad/{unit}'}), counter-clockwise positive"
    )


def _density_map(figure: Any, axes: Axes, trajectory: Trajectory, position: Array) -> float:
    """Draw the local area fraction and return the mean side of its cells [length]."""
    region = shown_region(trajectory, position)
    covered = area_fraction(trajectory, position, region)
    drawn = axes.imshow(
        covered.T, origin="lower", extent=(*region[0], *region[1]), cmap=DENSITIES, vmin=0.0,
        vmax=float(np.quantile(covered, 0.999)), interpolation="nearest",
    )  # fmt: skip
    figure.colorbar(drawn, ax=axes, extend="max", shrink=0.85).set_label("area fraction")
    return cell_side(covered, region)


def area_fraction(trajectory: Trajectory, position: Array, region: Array) -> Array:
    """The part that disks cover of each cell of a region [length], shape (2, 2): cells along x and along y."""
    radius = trajectory.disks.radius
    lengths = np.ptp(region, axis=1)
    cell = MAP_CELL * 2.0 * float(np.sqrt(np.mean(radius**2)))
    counts = np.clip(np.rint(lengths / cell), 1, 1000).astype(int)
    part = (position - region[:, 0]) / lengths
    inside = ((part >= 0.0) & (part <= 1.0)).all(axis=1)
    column, row = np.minimum((part[inside] * counts).astype(int), counts - 1).T
    covered = np.bincount(column * counts[1] + row, np.pi * radius[inside] ** 2, int(counts.prod()))
    return covered.reshape(counts) * float(counts.prod() / np.prod(lengths))


def cell_side(covered: Array, region: Array) -> float:
    """Mean side of the cells of `area_fraction` [length]."""
    return float(np.sqrt(np.prod(np.ptp(region, axis=1)) / covered.size))


def with_images(position: Array, radius: Array, box: Box, time: float) -> tuple[Array, NDArray[np.intp]]:
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


def draw_walls(axes: Axes, trajectory: Trajectory, time: float) -> None:
    """Draw the walls where they are at this time, with arrows along moving surfaces; thick sides are walls too."""
    for periodic, sides in zip(trajectory.box.periodic, (("left", "right"), ("bottom", "top")), strict=True):
        for side in sides:
            axes.spines[side].set_linewidth(0.8 if periodic or trajectory.box.is_open else 2.5)
    for wall in trajectory.walls:
        _wall(axes, wall, max(trajectory.box.lengths), time)


def _wall(axes: Axes, wall: Wall, size: float, time: float) -> None:
    from matplotlib.patches import Circle

    place = np.array(wall.place) + np.array(wall.motion.direction) * wall.motion.displacement(time)
    towards = np.array(wall.towards)
    colour = WALL if wall.temperature is None else HOT
    if wall.shape in ("line", "segment"):
        if wall.shape == "line":
            along = 2.0 * size * np.array((towards[1], -towards[0]))
            middle = np.clip(0.5 * size - place, -size, size) @ along / (along @ along) * along  # of the box
            ends = np.array((place - along, place + along)) + middle
        else:
            ends = np.array((place, place + towards))
        # Above the frame: half of a line at a side of the box shows.
        width = 2.5 if wall.temperature is None else 6.0
        look: dict[str, Any] = {"color": colour, "lw": width, "solid_capstyle": "round", "zorder": 3}
        axes.plot(*ends.T, scalex=False, scaley=False, **look)
        return
    filled = wall.shape == "post"
    axes.add_patch(Circle((place[0], place[1]), wall.radius, fill=filled, fc=POST, ec=colour, lw=2.0))
    if wall.surface_speed != 0.0:
        angle = np.arange(8) * np.pi / 4.0
        out = np.column_stack((np.cos(angle), np.sin(angle)))
        turn = np.sign(wall.surface_speed) * (1.0 if filled else -1.0)  # counter-clockwise
        along = turn * np.column_stack((-out[:, 1], out[:, 0]))
        for at, step in zip(place + wall.radius * out, 0.06 * wall.radius * along, strict=True):
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.5}
            axes.annotate("", xy=at + step, xytext=at - step, arrowprops=arrow)
