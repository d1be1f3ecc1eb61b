"""Disks and walls at one time, drawn to scale in many colours, or a map of where the disks are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..analysis.common import blocks
from ..errors import InputError, nearest
from ..model.box import Box
from ..model.state import Disks, State
from ..model.walls.wall import Wall, at_displacements
from ..simulation.simulation import Simulation
from ..tools.checked import Array
from ..tools.colours import PURPLE, SKY
from ..trajectory.export import kinds, material_names, species
from ..trajectory.reader import Frame, Trajectory
from .style import Bounded, Gas, color_bar, foreground, is_dark, label, place_axes, shades, unit_of, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import Colormap

# Diverging; the middle stands out against the background, so that disks without spin show. Orange is counter-clockwise.
SPINS = (SKY, "#2A6A99", "#333333", "#A84A00", "#FF9A3D")
SPINS_ON_DARK = ("#1E88E5", "#7FB6E6", "#D8D8D8", "#F0A868", "#FF7F0E")
DENSITIES = "cividis"
DIRECTIONS = (
    "#E0A030", "#F2CF7A", "#E6E2EE", "#8FB8E8", "#3B7DC4", "#343C96", "#5A2D5E", "#A0542F", "#E0A030",
)  # fmt: skip
"""Cyclic, from 0 degrees counter-clockwise: yellow is right and blue left, light up and dark down. This is
visible with every kind of colour blindness (`tests/plots/test_poster.py`)."""
POST, HOT, PLAIN = "#999999", PURPLE, "#888888"

MOST_DISKS = 100_000
"""Above this many disks one by one are smaller than a pixel, and slow: a density map is drawn."""

PIXELS = 700.0
"""Pixels along the longer side of the axes of a picture, about: no disk is drawn smaller than one."""

MAP_CELL = 6.0  # side of the density map's cells in mean diameters: some 10 to 30 disks each at phi = 0.25


@dataclass(frozen=True, eq=False)
class View:
    """Disks at one time, and what is around them; `stated_units` is None where they are not known."""

    disks: Disks
    box: Box
    walls: tuple[Wall, ...]
    stated_units: dict[str, str] | None
    moving: Frame | State
    stored: tuple[str, ...]

    @classmethod
    def of(cls, thing: Frame | Simulation) -> View:
        """View of a frame, or of the present state of a simulation."""
        if isinstance(thing, Frame):
            trajectory = thing.trajectory
            return cls(
                trajectory.disks, trajectory.box, thing.walls, trajectory.stated_units, thing, trajectory.fields
            )  # fmt: skip
        state = thing.state
        stored: tuple[str, ...] = ("position", "velocity", "angular_velocity", "collisions")
        stored += ("dissipated",) * isinstance(state.dissipated, np.ndarray)
        stored += ("asleep",) * bool(state.asleep.any())
        walls = at_displacements(thing.walls, thing.pistons[:, 0].tolist())
        return cls(thing.disks, thing.box, walls, None, state, stored)

    @property
    def time(self) -> float:
        """[time]."""
        return self.moving.time


class Colour(NamedTuple):
    """Colours of disks: values (n,), the label of their bar, and the kind of their scale."""

    values: Callable[[View], Array]
    label: Callable[[View], str]
    scale: str  # "signed", "positive", "span", "cyclic" or "kinds"
    field: str = "position"
    names: Callable[[View], Sequence[str]] = lambda _view: ()  # of kinds, by their values


def spin_label(gas: Gas | None) -> str:
    unit = unit_of(gas, "time")
    text = "" if unit is None else f" (rad/{unit})"
    if gas is not None and gas.stated_units == {}:
        text = " (reduced units)"
    return f"spin $\\omega${text}\ncounter-clockwise positive"


def _temperature(view: View) -> Array:
    mass = np.where(view.disks.movable, view.disks.mass, 0.0)
    return np.asarray(0.5 * mass * np.sum(view.moving.peculiar_velocity**2, axis=1))


def _materials(view: View) -> Sequence[str]:
    return (isinstance(view.moving, Frame) and material_names(view.moving.trajectory)) or ()


def _kinds(view: View) -> tuple[Sequence[str], NDArray[np.intp]]:
    """Names and numbers of the species; of the materials where none are named."""
    named = kinds(view.moving.trajectory) if isinstance(view.moving, Frame) else None
    return named or (_materials(view), view.disks.material.astype(np.intp))


COLOURS = {
    "spin": Colour(lambda view: view.moving.spin, spin_label, "signed", "angular_velocity"),
    "speed": Colour(
        lambda view: np.linalg.norm(view.moving.peculiar_velocity, axis=1),
        lambda view: label(view, "speed", "length/time"), "positive", "velocity",
    ),
    "direction": Colour(
        lambda view: np.degrees(np.arctan2(*view.moving.peculiar_velocity.T[::-1])),
        lambda view: "direction of the velocity (degrees)", "cyclic", "velocity",
    ),
    "temperature": Colour(
        _temperature, lambda view: label(view, "temperature of each disk $m c^2 / 2$", "energy"), "positive", "velocity"
    ),
    "radius": Colour(lambda view: view.disks.radius, lambda view: label(view, "radius", "length"), "span"),
    "material": Colour(
        lambda view: view.disks.material.astype(float), lambda view: "material", "kinds", names=_materials
    ),
    "species": Colour(
        lambda view: _kinds(view)[1].astype(float), lambda view: "", "kinds", names=lambda view: _kinds(view)[0]
    ),
    "collisions": Colour(
        lambda view: view.moving.collisions.astype(float), lambda view: "collisions of the disk", "span", "collisions"
    ),
    "asleep": Colour(
        lambda view: view.moving.asleep.astype(float), lambda view: "", "kinds", "asleep",
        names=lambda _view: ("awake", "asleep"),
    ),
    "dissipated": Colour(
        lambda view: np.asarray(view.moving.dissipated.sum(axis=1)),
        lambda view: label(view, "energy dissipated in the disk's collisions", "energy"), "positive", "dissipated",
    ),
}  # fmt: skip
"""Name -> colour of the disks."""


def colour_of(name: str, option: str = "color =") -> Colour | None:
    """A colour by its name, None for "none"; InputError names those that there are."""
    known = [*COLOURS, "none"]
    if not isinstance(name, str) or name not in known:
        raise InputError(f"{option} {name}: must be one of {', '.join(known)}{nearest(str(name), known)}")
    return COLOURS.get(name)


def colour_map(scale: str, *, dark: bool, kinds: int = 1) -> Colormap:
    """Map of colours for a kind of scale, on a light background or a dark one."""
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap, ListedColormap

    if scale == "signed":
        return LinearSegmentedColormap.from_list("spins", SPINS_ON_DARK if dark else SPINS)
    if scale == "kinds":
        return ListedColormap([*map(tuple, shades(max(kinds, 1), dark=dark))])
    if scale == "cyclic":  # from -180 degrees
        return LinearSegmentedColormap.from_list("directions", [*DIRECTIONS[4:], *DIRECTIONS[1:5]])
    return colormaps["inferno" if dark else "viridis"]


def limits(scale: str, values: Array) -> tuple[float, float]:
    """Ends of the colours.

    A heavy tail of fast disks must not wash out all others: colours are full from the 95th percentile on.
    """
    if scale == "cyclic":
        return -180.0, 180.0
    if not len(values):
        return 0.0, 1.0
    if scale == "kinds":
        return -0.5, float(values.max()) + 0.5
    if scale == "span":
        low, high = (float(each) for each in (values.min(), values.max()))
        return low, high if high > low else low + 1.0
    top = float(np.quantile(np.abs(values), 0.95)) or float(np.abs(values).max()) or 1.0
    return (-top, top) if scale == "signed" else (0.0, top)


def draw(axes: Axes, view: View, color: str = "spin") -> None:
    """Draw disks and walls into axes, and a colour bar unless all are the same; or a map of many disks."""
    colour = colour_of(color)
    for field in ("position", *([] if colour is None else [colour.field])):
        if field not in view.stored and isinstance(view.moving, Frame):
            view.moving.trajectory.require(field)
    position = view.moving.position
    place_axes(axes, view, shown_region(view, position))
    draw_walls(axes, view, view.time, collisions_of(view.moving))
    time = f"$t$ = {with_unit(view, f'{view.time:.4g}', 'time')}"
    if view.disks.n > MOST_DISKS:
        size = with_unit(view, f"{_density_map(axes, view, position):.3g}", "length")
        axes.set_title(
            f"area fraction at {time}\ncells of {size}; above {MOST_DISKS} disks, single disks are not drawn"
        )
    else:
        enlarged = _disks(axes, view, colour)
        small = f"\n({enlarged} disks are enlarged to one pixel)" if enlarged else ""
        axes.set_title(f"disks at {time}{small}")


def last_frame(axes: Axes, trajectory: Trajectory, index: int = -1, color: str | None = None) -> None:
    """The disks of the last frame (or another), by default coloured by spin, or by species where nothing turns."""
    frame = trajectory[index]
    if "position" not in trajectory.fields:
        place_axes(axes, trajectory, shown_region(trajectory, np.zeros((1, 2))))
        draw_walls(axes, trajectory, frame.time, collisions_of(frame), frame.walls)
        axes.set_title("the file holds no positions")
        return
    view = View.of(frame)
    draw(axes, view, color or default_color(view))


def default_color(view: View) -> str:
    """Spin; where nothing turns, the species, or else the material, if there are several."""
    if "angular_velocity" in view.stored and view.moving.spin.any():
        return "spin"
    if isinstance(view.moving, Frame) and len(species(view.moving.trajectory) or ()) > 1:
        return "species"
    return "material" if len(np.unique(view.disks.material)) > 1 else "none"


def shown_region(gas: Gas, position: Array) -> Array:
    """Ends of x and of y [length], shape (2, 2), of the box; of an open box, around these positions."""
    if not gas.box.is_open:
        return np.array([[0.0, side] for side in gas.box.lengths])
    if not len(position):
        return np.array([[0.0, 1.0]] * 2)
    low, high = position.min(axis=0), position.max(axis=0)
    middle, half = (low + high) / 2.0, float((high - low).max()) * 0.52 + float(gas.disks.radius.max())
    return np.stack([middle - half, middle + half], axis=1)


def figure_size(gas: Gas, position: Array) -> tuple[float, float]:
    """Size of a figure that the disks fill [inches]."""
    width, height = np.ptp(shown_region(gas, position), axis=1)
    room_for_a_title = 5.5
    return max(min(7.5, 1.6 + 5.2 * width / height), room_for_a_title), min(6.2, 1.2 + 5.9 * height / width)


def add_disks(axes: Axes, view: View, pixel: float) -> tuple[EllipseCollection, NDArray[np.intp]]:
    """Disks and their periodic images as patches of the axes, and which disk each is; none is narrower than a pixel.

    `pixel` is its side [length].
    """
    from matplotlib.collections import EllipseCollection

    radius = view.disks.radius
    position, owner = with_images(view.moving.position, radius, view.box, view.time)
    width = np.maximum(2.0 * radius[owner], pixel)
    drawn = EllipseCollection(
        width, width, np.zeros(len(owner)), units="xy", offsets=position, offset_transform=axes.transData,
        linewidths=0.0,
    )  # fmt: skip
    axes.add_collection(drawn)
    return drawn, owner


def _disks(axes: Axes, view: View, colour: Colour | None) -> int:
    """Draw disks with a colour bar, and return how many of them are enlarged to one pixel."""
    drawn, scale, enlarged = add_colored(axes, view, colour)
    if colour is not None and scale is not None:
        color_bar(axes, drawn, colour.label(view), extend(scale), colour.names(view))
    return enlarged


def add_colored(axes: Axes, view: View, colour: Colour | None) -> tuple[EllipseCollection, str | None, int]:
    """Disks in their colours, the kind of the scale (None if all are the same), and how many disks are enlarged."""
    pixel = float(np.ptp(shown_region(view, view.moving.position), axis=1).max()) / PIXELS
    drawn, owner = add_disks(axes, view, pixel)
    values = None if colour is None else colour.values(view)
    scale = None
    if colour is None or values is None or np.all(values == values[:1]):  # all equal
        drawn.set_facecolor(PLAIN)
    else:
        scale = colour.scale
        low, high = limits(colour.scale, values)
        drawn.set(
            array=values[owner], clim=(low, high),
            cmap=colour_map(colour.scale, dark=is_dark(axes), kinds=round(high + 0.5)),
        )  # fmt: skip
    return drawn, scale, int(np.sum(2.0 * view.disks.radius < pixel))


def extend(scale: str) -> str:
    """Ends of a colour bar that values may lie beyond."""
    return {"signed": "both", "positive": "max"}.get(scale, "neither")


def _density_map(axes: Axes, view: View, position: Array) -> float:
    """Draw the local area fraction and return the mean side of its cells [length]."""
    region = shown_region(view, position)
    covered = area_fraction(view, position, region)
    drawn = axes.imshow(
        covered.T, origin="lower", extent=(*region[0], *region[1]), cmap=DENSITIES, vmin=0.0,
        vmax=float(np.quantile(covered, 0.999)), interpolation="nearest",
    )  # fmt: skip
    color_bar(axes, drawn, "area fraction", "max")
    return cell_side(covered, region)


def area_fraction(gas: Gas, position: Array, region: Array) -> Array:
    """The part that disks cover of each cell of a region [length], shape (2, 2): cells along x and along y."""
    radius = gas.disks.radius
    lengths = np.ptp(region, axis=1)
    cell = MAP_CELL * 2.0 * float(np.sqrt(np.mean(radius**2)))
    counts = np.clip(np.rint(lengths / cell), 1, 1000).astype(int)
    covered = np.zeros(int(counts.prod()))
    for some in blocks(len(position)):
        part = (position[some] - region[:, 0]) / lengths
        inside = ((part >= 0.0) & (part <= 1.0)).all(axis=1)
        column, row = np.minimum((part[inside] * counts).astype(int), counts - 1).T
        covered += np.bincount(column * counts[1] + row, np.pi * radius[some][inside] ** 2, len(covered))
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


def collisions_of(moving: Frame | State) -> int:
    """Collisions of two disks until then; 0 of a file whose frames have no sums."""
    if isinstance(moving, Frame):
        sums = moving.trajectory.observables
        return int(sums["collisions"][moving.index]) if "collisions" in sums else 0
    return int(moving.collisions.sum()) // 2


def draw_walls(
    axes: Axes, gas: Bounded, time: float, collisions: int = 0, walls: tuple[Wall, ...] | None = None
) -> None:
    """Draw the walls that stand at this time, after so many collisions, with arrows along moving surfaces.

    Those of the gas, or the given ones, among which pistons are where they are then. Thick sides are walls too.
    """
    for periodic, sides in zip(gas.box.periodic, (("left", "right"), ("bottom", "top")), strict=True):
        for side in sides:
            axes.spines[side].set_linewidth(0.8 if periodic or gas.box.is_open else 2.5)
    for wall in gas.walls if walls is None else walls:
        if wall.is_present(time, collisions):
            _wall(axes, wall, gas.box.lengths, time)


def _wall(axes: Axes, wall: Wall, lengths: tuple[float, float], time: float) -> None:
    from matplotlib.patches import Circle

    center = wall.transform(np.array([wall.origin]), time)[0]
    colour = foreground(axes) if wall.temperature is None else HOT
    if not wall.geometry.is_circle:
        ends = wall.transform(wall.geometry.path(lengths), time)
        # Above the frame: half of a line at a side of the box shows.
        width = 2.5 if wall.temperature is None else 6.0
        style: dict[str, Any] = {"color": colour, "lw": width, "solid_capstyle": "round", "zorder": 3}
        axes.plot(*ends.T, scalex=False, scaley=False, **style)
        return
    filled = wall.geometry.side < 0.0
    axes.add_patch(Circle((center[0], center[1]), wall.radius, fill=filled, fc=POST, ec=colour, lw=2.0))
    if wall.surface_speed != 0.0:
        angle = np.arange(8) * np.pi / 4.0
        out = np.column_stack((np.cos(angle), np.sin(angle)))
        turn = np.sign(wall.surface_speed) * (1.0 if filled else -1.0)  # counter-clockwise
        along = turn * np.column_stack((-out[:, 1], out[:, 0]))
        for at, step in zip(center + wall.radius * out, 0.06 * wall.radius * along, strict=True):
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.5}
            axes.annotate("", xy=at + step, xytext=at - step, arrowprops=arrow)
