"""Averages of a gas in bins of space, over frames: density, flow, temperatures, stress, heat flux, with errors.

In a bin of area A, over F frames, with the velocity V = v - u of each disk relative to the mean velocity u of the bin,
u = sum m v / sum m over all of these frames:

    n = N / (F A),    T_a = sum m V_a^2 / (N - 1),    T_rot = sum I w^2 / N,
    P_ab = sum m V_a V_b / (F A) + (1 / (A t)) sum_c s p_a l_b,
    q_b = sum (m V^2 + I w^2) V_b / (2 F A) + (1 / (A t)) sum_c s (e - u.p) l_b,

N is the number of disks summed over the frames, each in the bin of its centre, and t the duration. In a collision c a
disk transfers the momentum p and the energy e along the line l from its centre to the contact; the fraction s of this
line lies in the bin (J. H. Irving and J. G. Kirkwood, J. Chem. Phys. 18, 817 (1950), doi:10.1063/1.1747782). Momentum
thus goes from centre to centre, and dissipated energy is lost at the contact. Collisions are read from histories. In
the work u.p of a bin without centres, u is that of the whole gas in the first frame.
Kinetic stresses have the factor N / (N - 1) too, so that they equal n T.

Errors are estimated by the jackknife over blocks of frames. Every formula is evaluated with one block left out at a
time; the error is that of the mean of the pseudo-values (B. Efron and C. Stein, Ann. Stat. 9, 586 (1981),
doi:10.1214/aos/1176345462), with the correlation of blocks.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.walls.free_area import FreeArea
from ..tools.checked import Array, Integer, Integers, Real, choice, validated
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from ..trajectory import export
from ..trajectory.history import KICK
from ..trajectory.reader import Frame, Trajectory
from ..trajectory.tables import optional_import
from . import common
from . import result as stored
from .bins import Bins, Grid, Rings, Strips
from .common import BLOCKS, mean_errors
from .options import MOST_BINS, MOST_CELLS
from .window import steady_frames

if TYPE_CHECKING:
    import xarray

AXES = ("x", "y", "r")
OF_DISKS = ("velocity", "temperatures", "temperature", "rotational_temperature", "theta")
"""Means over disks: in nearly empty bins those of the history of single ones."""
MOST_WORK = 20_000_000
"""Disks times frames above which fewer frames are taken by default (some ten seconds)."""
EVENTS = 1_000_000
"""Number of events of histories that are read at once."""


@dataclass(frozen=True, eq=False, repr=False)
class Local(Brief):
    """Quantities in each bin: scalars have the shape of the bins (...), vectors (..., 2), tensors (..., 2, 2).

    Components are along the `directions` of the bins. A value is nan where a bin has too few disks for it, and where
    it is not known.
    """

    number_density: Array
    """[1/length^2]."""
    packing_fraction: Array
    """Area of disks in the bin over its free area; the only quantity that includes immovable disks."""
    velocity: Array
    """Mean velocity u, weighted by mass, in the lab [length/time]."""
    temperatures: Array
    """T_a = <m V_a^2> [energy]."""
    temperature: Array
    """Mean of the two components of `temperatures` [energy]."""
    rotational_temperature: Array
    """T_rot = <I w^2> [energy]."""
    theta: Array
    """T_rot / T."""
    stress_kinetic: Array
    """Kinetic part of the pressure tensor P_ab, b along the normal [energy/length^2]."""
    stress: Array
    """P_ab with its collisional part [energy/length^2]; nan without histories."""
    heat_flux_kinetic: Array
    """Kinetic part of the heat flux q [energy/(length time)]."""
    heat_flux: Array
    """q with its collisional part [energy/(length time)]; nan without histories."""


UNITS = {
    "number_density": "1/length^2", "velocity": "length/time", "temperatures": "energy", "temperature": "energy",
    "rotational_temperature": "energy", "stress_kinetic": "energy/length^2", "stress": "energy/length^2",
    "heat_flux_kinetic": "energy/(length time)", "heat_flux": "energy/(length time)",
}  # fmt: skip
SYMBOLS = {
    "velocity": "u_{}", "temperatures": "temperature_{}", "stress_kinetic": "P_{}{}_kinetic", "stress": "P_{}{}",
    "heat_flux_kinetic": "q_{}_kinetic", "heat_flux": "q_{}",
}  # fmt: skip
"""Names of components in tables."""


@dataclass(frozen=True, eq=False, repr=False)
class BinAverages(Brief, ResultPlot):
    """Averages over frames in bins: a profile in strips or rings, or fields in the cells of a grid."""

    axes: tuple[str, ...]
    """Coordinates that bins divide: ("y",), ("r",), or ("x", "y")."""
    edges: tuple[Array, ...]
    """Edges of the bins along each coordinate [length], shape (bins + 1,)."""
    directions: tuple[str, str]
    """Components of vectors: x and y, or r (radial) and t (tangential, counter-clockwise)."""
    disks: Array
    """Number of disks in each bin, summed over the frames."""
    mean: Local
    error: Local
    n_eff: Local
    """mean, error, n_eff: the averages, their standard errors, and the number of independent blocks with that error;
    the latter two are nan with fewer than two frames. Intervals are Student's t with n_eff - 1 degrees of freedom, 1 at
    least."""
    species: dict[str, BinAverages]
    """Averages of each species by name, with only the kinetic part of stress and heat flux; empty for one species."""
    times: tuple[float, float]
    """First and last time [time]."""
    frames: int
    """Number of frames."""
    units: dict[str, str]
    """Unit of each quantity; empty in reduced units."""

    @property
    def middles(self) -> tuple[Array, ...]:
        """Middles of the bins along each axis [length]."""
        return tuple(0.5 * (one[1:] + one[:-1]) for one in self.edges)

    @property
    def has_collisions(self) -> bool:
        """True if stress and heat flux have their collisional part."""
        return bool(np.isfinite(self.mean.stress).any())

    def columns(self) -> dict[str, Array]:
        """Columns by name, with a row for each bin: middles, every component with its error and n_eff, then species.

        Without histories the kinetic parts of stress and heat flux are the only ones.
        """
        grid = np.meshgrid(*self.middles, indexing="ij")
        found = dict(zip(self.axes, (one.ravel() for one in grid), strict=True)) | {
            "disks": self.disks.ravel()
        }
        for label, one in {"": self, **{f" [{name}]": each for name, each in self.species.items()}}.items():
            for each in dataclasses.fields(Local):
                if each.name in ("stress", "heat_flux") and not one.has_collisions:
                    continue
                for key, at in _components(each.name, self.directions):
                    for kind, values in (("", one.mean), (" error", one.error), (" n_eff", one.n_eff)):
                        found[f"{key}{label}{kind}"] = getattr(values, each.name)[at].ravel()
        return found

    def to_xarray(self) -> xarray.Dataset:
        """Dataset of every quantity, its error, `NAME_error`, and `NAME_n_eff`; those of species are `species_NAME`.

        Vectors have the dimension `component`, the stress `component` (of momentum) and `normal`, species `species`.
        InputError if xarray is not installed.
        """
        package = optional_import("xarray", "analysis")
        coordinates: dict[str, Any] = dict(zip(self.axes, self.middles, strict=True))
        coordinates |= {"component": list(self.directions), "normal": list(self.directions)}
        coordinates |= {"species": list(self.species)} if self.species else {}
        data: dict[str, Any] = {"disks": (self.axes, self.disks)}
        for kind, ending in (("mean", ""), ("error", "_error"), ("n_eff", "_n_eff")):
            for each in dataclasses.fields(Local):
                values = getattr(getattr(self, kind), each.name)
                dims = (*self.axes, *("component", "normal")[: values.ndim - len(self.axes)])
                known = each.name in self.units and kind != "n_eff"
                of_unit = {"units": self.units[each.name]} if known else {}
                data[f"{each.name}{ending}"] = (dims, values, of_unit)
                if self.species:
                    of_species = [getattr(getattr(one, kind), each.name) for one in self.species.values()]
                    data[f"species_{each.name}{ending}"] = (("species", *dims), np.stack(of_species), of_unit)
        return package.Dataset(data, coordinates)


def _components(name: str, directions: tuple[str, str]) -> Iterator[tuple[str, Any]]:
    """Names and indices of the components of a quantity."""
    symbol = SYMBOLS.get(name)
    if symbol is None:
        yield name, ()
    elif symbol.count("{}") == 1:
        for i, one in enumerate(directions):
            yield symbol.format(one), (..., i)
    else:
        for i, one in enumerate(directions):
            for j, other in enumerate(directions):
                yield symbol.format(one, other), (..., i, j)


# -- what users call ---------------------------------------------------------------------------------------


_Frames = Annotated[Sequence[int], Integers(("n",), least=1)] | None
_Span = tuple[Real, Real] | None


@validated
def profiles(
    trajectory: Trajectory, axis: str | None = None, bins: Annotated[int, Integer(1, MOST_BINS)] | None = None,
    *, frames: _Frames = None, span: _Span = None, collisions: bool = True,
) -> BinAverages:  # fmt: skip
    """Averages in strips across x or y, or in rings, of a trajectory; by default over the second half of the frames.

    Parameters
    ----------
    trajectory : Trajectory
        File with positions and velocities; without spins T_rot is nan. With `output.histories_all` stress and heat
        flux have their exact collisional part; with the histories of some disks, it is scaled to all disks.
    axis : {"x", "y", "r"}, optional
        The coordinate. "r" is the distance from the centre of circular walls at rest. By default along gravity, or
        from wall to wall.
    bins : int, optional
        Bins of equal width; by default one a mean diameter wide, 8 to 40 of them.
    frames : sequence of int, optional
        Numbers of the frames.
    span : tuple of two floats, optional
        The first and last edge [length]; by default those of the free area.
    collisions : bool
        Whether to read histories for the collisional part.

    Returns
    -------
    BinAverages

    Raises
    ------
    InputError
        If an argument is out of range, a frame does not exist, rings have no centre, or the file lacks a field.

    Notes
    -----
    The area of each disk is divided exactly among bins. Free areas are those of the first frame; if walls move, they
    are the mean over one frame of each block. A flow that varies within a bin increases T and P: choose narrow bins.
    In a sheared box T and P use velocities relative to the imposed flow, and `velocity` includes that flow. Gravity and
    contacts of disks at rest are not collisions: P does not include the weight that sleeping disks transmit.

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import analysis
    >>> with ifrdem.Trajectory("cooling.h5") as run:  # of `ifrdem run cooling`
    ...     found = analysis.profiles(run, "y", 10)
    ...
    >>> found.mean.temperature.shape, found.to_xarray()["stress"].dims
    ((10,), ('y', 'component', 'normal'))
    """
    used = _used(trajectory, frames)
    axis = default_axis(trajectory) if axis is None else choice("axis", axis, AXES)
    low, high = free_range(trajectory, axis, used) if span is None else span
    if not (low < high and math.isfinite(high - low)):
        raise InputError(f"span = ({low:g}, {high:g}): must be two finite numbers, the first one smaller")
    if bins is None:
        bins = int(np.clip((high - low) / (2.0 * trajectory.disks.mean_radius), 8, 40))
    edges = (low + (high - low) * np.arange(bins + 1) / bins,)
    if not np.all(np.diff(edges[0]) > 0.0):
        raise InputError(
            f"span = ({low:g}, {high:g}): must be wider, as {bins} bins have no width by rounding"
        )
    if axis == "r":
        found: Bins = Rings(trajectory.box, (axis,), edges, center_of_walls(trajectory))
    else:
        found = Strips(trajectory.box, (axis,), edges)
    return _averages(trajectory, found, used, collisions)


@dataclass(frozen=True, eq=False, repr=False)
class ProfileSequence(Brief, ResultPlot):
    """Profiles of several groups of frames, in the same bins: over time, or at phases of walls that move to and fro."""

    over: str
    """"time" or "phase"."""
    places: Array
    """Middles of the windows [time], or phases from 0 to 1, shape (groups,)."""
    profiles: list[BinAverages]
    """The averages over each group."""


def profiles_of_groups(
    trajectory: Trajectory, places: Array, groups: Sequence[Sequence[int]], over: str, axis: str | None,
    bins: int | None,
) -> ProfileSequence:  # fmt: skip
    """Profiles of each group of frames, in bins over the free area of all of them."""
    every = sorted({frame for group in groups for frame in group})
    axis = default_axis(trajectory) if axis is None else axis
    span = free_range(trajectory, choice("axis", axis, AXES), every)
    found = [profiles(trajectory, axis, bins, frames=group, span=span) for group in groups]
    return ProfileSequence(over, places, found)


_Cells = Annotated[int, Integer(1, MOST_CELLS)]


@validated
def mean_fields(
    trajectory: Trajectory, cells: tuple[_Cells, _Cells] | None = None, *, frames: _Frames = None,
    collisions: bool = True,
) -> BinAverages:  # fmt: skip
    """Averages over frames in the cells of a grid over the free area; else as `profiles`.

    `cells` are their numbers along x and y: by default a cell has some 20 disks, and a side at most 200 cells.
    `coarse_grain` takes a single frame, and Gaussians instead of cells. InputError as for `profiles`.

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import analysis
    >>> with ifrdem.Trajectory("cooling.h5") as run:  # of `ifrdem run cooling`
    ...     found = analysis.mean_fields(run, (6, 4))
    ...
    >>> found.mean.velocity.shape
    (6, 4, 2)
    """
    used = _used(trajectory, frames)
    ends = [free_range(trajectory, axis, used) for axis in ("x", "y")]
    numbers = cells or default_cells(np.diff(ends).ravel(), trajectory.disks.n_movable)
    edges = tuple(
        low + (high - low) * np.arange(number + 1) / number
        for (low, high), number in zip(ends, numbers, strict=True)
    )
    return _averages(trajectory, Grid(trajectory.box, ("x", "y"), edges), used, collisions)


def default_cells(lengths: Array, disks: int) -> tuple[int, int]:
    """Numbers of cells along x and y of an area with these sides [length]: some 20 disks a cell, at most 200 a side."""
    side = np.sqrt(float(np.prod(lengths)) * 20.0 / max(disks, 1))
    a, b = (int(number) for number in np.clip(np.rint(lengths / side), 1, 200))
    return a, b


def _used(trajectory: Trajectory, frames: Sequence[int] | None) -> list[int]:
    stored.require_fields(trajectory, "position", "velocity")
    if not trajectory.disks.n_movable:
        raise InputError("mass: must be finite for at least one disk; averages are over disks that can move")
    every = stored.all_frames(trajectory, None)
    frames = steady_frames(trajectory, frames)
    if frames is not None and not isinstance(frames, stored.FramesFrom):
        return sorted({trajectory[i].index for i in frames})
    half = every[len(every) // 2 :] if frames is None else [*frames]
    return half[:: -(-len(half) * trajectory.n // MOST_WORK)]


def default_axis(trajectory: Trajectory) -> str:
    """x or y: along gravity; else across the first flat wall; else from wall to wall."""
    gravity = trajectory.gravity
    if any(gravity):
        return "xy"[int(abs(gravity[1]) >= abs(gravity[0]))]
    for wall in trajectory.walls:
        if wall.shape == "line":
            return "xy"[int(abs(wall.towards[1]) > abs(wall.towards[0]))]
    return "xy"[int(trajectory.box.periodic[0])]


def center_of_walls(trajectory: Trajectory) -> tuple[float, float]:
    """Common centre [length] of the circular walls; InputError without one that stays."""
    circles = [wall for wall in trajectory.walls if wall.shape in ("container", "post")]
    centers = {wall.origin for wall in circles}
    moving = any(
        wall.motion.kind != "still" or wall.piston is not None
        or (wall.turn.kind != "still" and tuple(wall.turn.center) != tuple(wall.origin))
        for wall in circles
    )  # fmt: skip
    if len(centers) != 1 or moving:
        reason = "they move" if moving else f"there are {len(centers)} centres"
        raise InputError(
            f"axis = r: must have circular walls around one centre at rest ({reason}); choose x or y"
        )
    ((x, y),) = centers
    return float(x), float(y)


def free_range(trajectory: Trajectory, axis: str, used: Sequence[int]) -> tuple[float, float]:
    """Lowest and highest coordinate of the free area [length]; of the disks where an open box has no end."""
    center = np.array(center_of_walls(trajectory)) if axis == "r" else np.zeros(2)
    if axis == "r":
        walls = [wall for wall in trajectory.walls if wall.shape in ("container", "post")]
        low = max((wall.radius for wall in walls if wall.shape == "post"), default=0.0)
        inner = [wall.radius for wall in walls if wall.shape == "container"]
        high = float(min(inner or [*center, *(trajectory.box.lengths - center)]))
        high = math.inf if trajectory.box.is_open and not inner else high
    else:
        k = "xy".index(axis)
        bounds = [_free_area(trajectory[i]).bounds() for i in _sampled(trajectory, used)]
        low, high = min(float(one[0][k]) for one in bounds), max(float(one[1][k]) for one in bounds)
    if trajectory.box.is_open and not math.isfinite(high):
        from_center = [trajectory[i].position - center for i in used]
        at = [np.hypot(*one.T) if axis == "r" else one[:, "xy".index(axis)] for one in from_center]
        reach = trajectory.disks.radius
        low = low if axis == "r" else min(float(np.min(one - reach)) for one in at)
        high = max(float(np.max(one + reach)) for one in at)
    return float(low), float(high)


def _sampled(trajectory: Trajectory, used: Sequence[int]) -> list[int]:
    """A frame of each block if walls move, else the first one."""
    if any(wall.changes_with_time or wall.piston is not None for wall in trajectory.walls):
        return [int(block[len(block) // 2]) for block in _blocks(used)]
    return [used[0]]


def _free_area(frame: Frame) -> FreeArea:
    """The area that walls leave in a frame; gates count as open. In an open box walls take no area."""
    box = frame.trajectory.box
    fixed = () if box.is_open else tuple(wall for wall in frame.walls if not wall.gated)
    return FreeArea(box, fixed, frame.time)


def _blocks(used: Sequence[int]) -> list[Any]:
    return np.array_split(np.asarray(used), min(BLOCKS, len(used)))


# -- sums over frames and collisions -----------------------------------------------------------------------

Sums = dict[str, Array]
"""Sums of each block, (blocks, bins): `_OF_DISKS` of disks, those of collisions, and areas."""
_OF_DISKS = (
    "count", "mass", "p_0", "p_1", "pp_00", "pp_01", "pp_11", "spin", "e_0", "e_1", "r_0", "r_1", "covered"
)  # fmt: skip
"""Over frames and disks: 1, m, m v_a, m v_a v_b, I w^2, m v^2 v_a / 2, I w^2 v_a / 2, and areas of disks in the bin."""


def _averages(trajectory: Trajectory, bins: Bins, used: Sequence[int], collisions: bool) -> BinAverages:
    """Averages of all disks and of species; velocities are summed relative to that of the gas, to lose no digits."""
    named = export.kinds(trajectory)
    names = named[0] if named is not None and len(named[0]) > 1 else [""]
    kind = named[1] if named is not None and len(names) > 1 else np.broadcast_to(np.intp(0), trajectory.n)
    drift = np.zeros(2) if bins.axes == ("r",) else _mean_velocity(trajectory[used[0]])
    turning, blocks = "angular_velocity" in trajectory.fields, _blocks(used)
    of_disks = np.zeros((len(_OF_DISKS), len(names), len(blocks), bins.count))
    for b, block in enumerate(blocks):
        for i in block:
            of_disks[:, :, b] += _sums_of_frame(trajectory[int(i)], bins, kind, len(names), drift)
    times = trajectory.times[np.asarray(used)]
    areas = np.mean([bins.areas(_free_area(trajectory[i])) for i in _sampled(trajectory, used)], axis=0)
    areas = np.where((areas > 1e-9 * areas.max()) & np.isfinite(areas), areas, np.nan)
    of_bins = _collisions(trajectory, bins, areas, _block_ends(times, blocks), wanted=collisions)
    of_bins["area_frames"] = areas * np.array([len(block) for block in blocks])[:, None]
    units = {name: stored.unit(trajectory, text) for name, text in UNITS.items()}
    units = {name: text for name, text in units.items() if text}
    flow = drift + _imposed(bins)

    def made(sums: Array, of_bins: Sums, species: dict[str, BinAverages]) -> BinAverages:
        total = dict(zip(_OF_DISKS, sums, strict=True)) | of_bins
        found = _with_errors(total, lambda one: _quantities(one, flow, bins.shape, turning=turning))
        span = (float(times.min()), float(times.max()))
        disks = total["count"].sum(axis=0).reshape(bins.shape)
        return BinAverages(
            bins.axes, bins.edges, bins.directions, disks, *found, species, span, len(used), units
        )

    own = of_bins | {name: np.full_like(of_bins[name], np.nan) for name in ("virial", "carried")}
    each = {name: made(of_disks[:, k], own, {}) for k, name in enumerate(names)} if len(names) > 1 else {}
    return made(of_disks.sum(axis=1), of_bins, each)


def _mean_velocity(frame: Frame) -> Array:
    disks, velocity = frame.trajectory.disks, frame.peculiar_velocity
    found, whole = np.zeros(2), 0.0
    for some in common.blocks(disks.n):
        movable = disks.movable[some]
        mass = disks.mass[some][movable]
        found += mass @ velocity[some][movable]
        whole += float(mass.sum())
    return found / whole


def _imposed(bins: Bins) -> Array:
    """The flow of a sheared box in the middle of each bin [length/time], (bins, 2)."""
    if not bins.box.shear_rate or "y" not in bins.axes:
        return np.zeros((bins.count, 2))
    middles = [0.5 * (one[1:] + one[:-1]) for one in bins.edges]
    y = np.meshgrid(*middles, indexing="ij")[-1].ravel()
    return bins.box.flow(np.stack((np.zeros_like(y), y), axis=1))


def _sums_of_frame(frame: Frame, bins: Bins, kind: Any, kinds: int, drift: Array) -> Array:
    """`_OF_DISKS` of one frame, (sums, kinds, bins)."""
    disks, box = frame.trajectory.disks, frame.trajectory.box
    columns = [frame.position, frame.peculiar_velocity]
    columns += [frame.spin] if "angular_velocity" in frame.trajectory.fields else []
    found = np.zeros((len(_OF_DISKS), kinds, bins.count))
    constants: tuple[Any, ...] = disks.radius, disks.mass, disks.inertia, disks.movable, kind
    for some in common.blocks(disks.n):
        position, velocity, *spin = (each[some] for each in columns)
        rows = box.wrap(position, frame.time), velocity - drift, spin[0] if spin else np.zeros(len(position))
        found += _sums_of_disks(bins, kinds, frame.time, *rows, *(each[some] for each in constants))
    return found


def _sums_of_disks(
    bins: Bins, kinds: int, time: float, position: Array, velocity: Array, spin: Array, radius: Array, mass: Array,
    inertia: Array, movable: NDArray[np.bool_], kind: NDArray[np.intp],
) -> Array:  # fmt: skip
    """`_OF_DISKS` of some disks, (sums, kinds, bins)."""
    size = kinds * bins.count
    overlaps = bins.overlaps(position, radius, time)
    covered = np.bincount(kind[overlaps.disk] * bins.count + overlaps.bin, overlaps.area, minlength=size)
    where = bins.of(position)
    inside = (where >= 0) & movable
    index = kind[inside] * bins.count + where[inside]
    m = mass[inside]
    v = bins.components(position[inside], velocity[inside])
    p, rotation = m[:, None] * v, inertia[inside] * spin[inside] ** 2
    energy = 0.5 * np.sum(p * v, axis=1)
    rows = [np.ones(len(m)), m, *p.T, p[:, 0] * v[:, 0], p[:, 0] * v[:, 1], p[:, 1] * v[:, 1], rotation]
    rows += [*(energy[:, None] * v).T, *(0.5 * rotation[:, None] * v).T]
    sums = [np.bincount(index, row, minlength=size) for row in rows]
    return np.stack([one.reshape(kinds, bins.count) for one in (*sums, covered)])


def _block_ends(times: Array, blocks: Sequence[Any]) -> Array:
    """Ends of the times of blocks [time], (blocks + 1,): between the frames of neighbours."""
    last = np.cumsum([len(block) for block in blocks])[:-1]
    return np.concatenate(([times[0]], 0.5 * (times[last - 1] + times[last]), [times[-1]]))


def _collisions(trajectory: Trajectory, bins: Bins, areas: Array, ends: Array, *, wanted: bool) -> Sums:
    """Sums over the collisions in histories: of momentum `virial` (blocks, bins, 4), of energy `carried` (..., 2).

    Both [energy time] and [energy length], nan without histories in these times; and `area_time` [length^2 time].
    """
    blocks, n = len(ends) - 1, bins.count
    virial, carried = np.zeros((4, blocks * n)), np.zeros((2, blocks * n))
    disks, tracked = trajectory.disks, trajectory.tracked
    movable = int(np.count_nonzero(disks.movable[tracked]))
    first, last = ends[0], ends[0]
    if movable and wanted:
        rows, start, end = trajectory.tracked_events
        first, last = max(start, ends[0]), min(end, ends[-1])
    if not last > first:
        virial[:], carried[:] = np.nan, np.nan
        first, last = ends[0], ends[-1]
    else:
        for event in _events(trajectory, rows, first, last):
            block = np.clip(np.searchsorted(ends, event["time"], side="left") - 1, 0, blocks - 1)
            of_event, begin, line, p, energy = _carried(trajectory, event)
            pieces = bins.pieces(begin, line)
            at = pieces.line
            index = block[of_event[at]] * n + pieces.bin
            weight = pieces.share * (disks.n_movable / movable)
            p_, line_ = (bins.components(pieces.middle, one[at]) for one in (p, line))
            for k, (a, b) in enumerate(np.ndindex(2, 2)):
                virial[k] += np.bincount(index, weight * p_[:, a] * line_[:, b], minlength=blocks * n)
            for b in (0, 1):
                carried[b] += np.bincount(index, weight * energy[at] * line_[:, b], minlength=blocks * n)
    duration = np.maximum(np.minimum(ends[1:], last) - np.maximum(ends[:-1], first), 0.0)
    return {
        "virial": np.moveaxis(virial.reshape(4, blocks, n), 0, -1),
        "carried": np.moveaxis(carried.reshape(2, blocks, n), 0, -1),
        "area_time": areas * duration[:, None],
    }


def _events(trajectory: Trajectory, rows: int, first: float, last: float) -> Iterator[dict[str, Any]]:
    """Collisions of tracked disks that can move, after one time and up to another, some at a time."""
    names = ("time", "id", "partner", "position", "normal", "velocity_before", "velocity_after", "spin_before",
             "spin_after")  # fmt: skip
    for begin in range(0, rows, EVENTS):
        found = {name: trajectory.read_events(name, min(begin + EVENTS, rows), begin) for name in names}
        used = (found["time"] > first) & (found["time"] <= last) & (found["partner"] != KICK)
        used &= trajectory.disks.movable[found["id"]]
        if used.any():
            yield {name: column[used] for name, column in found.items()}


def _carried(trajectory: Trajectory, event: Mapping[str, Any]) -> tuple[Any, Array, Array, Array, Array]:
    """Lines along which collisions transfer momentum and energy: event, begin, line, momentum and energy of each.

    A line goes from the disk's centre to the contact. A second one goes on to the centre of an immovable disk.
    """
    disks, ids, partner = trajectory.disks, event["id"], event["partner"]
    m, before, after = disks.mass[ids], event["velocity_before"], event["velocity_after"]
    p = m[:, None] * (before - after)
    energy = 0.5 * m * np.sum(before**2 - after**2, axis=1)
    energy += 0.5 * disks.inertia[ids] * (event["spin_before"] ** 2 - event["spin_after"] ** 2)
    line = disks.radius[ids][:, None] * event["normal"]
    fixed = np.flatnonzero((partner >= 0) & ~disks.movable[np.maximum(partner, 0)])
    contact = event["position"][fixed] + line[fixed]
    onward = disks.radius[partner[fixed]][:, None] * event["normal"][fixed]
    return (
        np.concatenate((np.arange(len(ids)), fixed)), np.concatenate((event["position"], contact)),
        np.concatenate((line, onward)), np.concatenate((p, p[fixed])),
        np.concatenate((energy, np.zeros(len(fixed)))),
    )  # fmt: skip


# -- from sums to quantities ------------------------------------------------------------------------------


def _with_errors(sums: Sums, formula: Callable[[Mapping[str, Array]], Local]) -> tuple[Local, Local, Local]:
    """Quantities from sums of blocks, their standard errors by the jackknife, and n_eff of each."""
    total = {name: value.sum(axis=0) for name, value in sums.items()}
    mean, blocks = formula(total), len(sums["count"])
    without = [formula({name: total[name] - value[b] for name, value in sums.items()}) for b in range(blocks)]
    errors, effective = {}, {}
    for name, value in vars(mean).items():
        pseudo = np.stack([blocks * value - (blocks - 1) * getattr(one, name) for one in without])
        errors[name], effective[name] = mean_errors(pseudo)
    return mean, Local(**errors), Local(**effective)


def _quantities(sums: Mapping[str, Array], flow: Array, shape: tuple[int, ...], *, turning: bool) -> Local:
    """The formulas of this module; `flow` [length/time], (bins, 2), is what velocities are summed relative to."""
    N, M, spin = (sums[name] for name in ("count", "mass", "spin"))
    P, E, R = (np.stack([sums[f"{name}_{a}"] for a in (0, 1)], axis=-1) for name in ("p", "e", "r"))
    square = np.stack([sums[f"pp_{ab}"] for ab in ("00", "01", "01", "11")], axis=-1).reshape(-1, 2, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = P / M[:, None]
        w = np.nan_to_num(u)
        spread = square - M[:, None, None] * w[:, :, None] * w[:, None, :]
        unbiased = np.where(N > 1.5, N / (N - 1.0), 1.0)
        T = np.where(N > 1.5, 1.0, np.nan)[:, None] * np.diagonal(spread, axis1=1, axis2=2)
        T = T * (unbiased / N)[:, None]
        T_rot = spin / N if turning else np.full(len(N), np.nan)
        mean_T = T.mean(axis=1)
        theta = np.where(mean_T > 0.0, T_rot / mean_T, np.nan)
        area, area_time = sums["area_frames"], sums["area_time"]
        kinetic = spread * (unbiased / area)[:, None, None]
        trace = np.trace(square, axis1=1, axis2=2)[:, None]
        energy = E - 0.5 * w * trace - np.einsum("nab,nb->na", square, w)
        energy += (M * np.sum(w * w, axis=1))[:, None] * w + R - 0.5 * w * spin[:, None]
        heat = energy / area[:, None] if turning else np.full_like(energy, np.nan)
        virial = sums["virial"].reshape(-1, 2, 2)
        carried = sums["carried"] - np.einsum("na,nab->nb", w + flow, virial)
        found = Local(
            number_density=N / area, packing_fraction=sums["covered"] / area, velocity=u + flow, temperatures=T,
            temperature=mean_T, rotational_temperature=T_rot, theta=theta, stress_kinetic=kinetic,
            stress=kinetic + virial / area_time[:, None, None], heat_flux_kinetic=heat,
            heat_flux=heat + carried / area_time[:, None],
        )  # fmt: skip
    return Local(**{name: value.reshape(*shape, *value.shape[1:]) for name, value in vars(found).items()})
