"""Disks of a gas (`Disks`, constant), and their positions and motion at a time (`State`, changing)."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..kernels.columns import MECHANISM, MOST_IDS
from ..mpi import SERIAL, current
from ..mpi.distribution import broadcast_constant_rows
from ..quantities import FRAME
from ..tools import checked
from ..tools.checked import LEAST, Array, Integer, Numbers, PositivePerDisk, check_of, validated
from ..tools.not_recorded import NotRecorded
from ..tools.notebook import NotebookRepr
from ..tools.read_only import ReadOnlyAttributes
from ..tools.reprs import Brief
from .density import disk_area

NumberOfDisks = Annotated[int, Integer(0, MOST_IDS)]
_Sizes = Annotated[NDArray[np.float64], check_of(PositivePerDisk)]
_Masses = Annotated[
    NDArray[np.float64],
    Numbers(("n",), LEAST, math.inf, f"positive, from {LEAST:g}, or inf for an immovable disk", scalar=True),
]


def _by_row(formula: Callable[..., NDArray[Any]], *columns: NDArray[Any]) -> NDArray[Any]:
    """A formula of columns, row by row: in the memory of one row, and read-only, where all of them are."""
    if len(columns[0]) and all(each.strides[0] == 0 for each in columns):
        return np.broadcast_to(formula(*(each[:1] for each in columns)), columns[0].shape)
    return formula(*columns)


@validated
@dataclass(frozen=True, eq=False, repr=False)
class Disks(Brief):
    """The constant properties of n disks.

    Every argument but `n` may be a number (the same for all) or an array of shape (n,). InputError if n is negative,
    or a mass, radius or k is not a positive finite number (a mass may be infinite).

    Parameters
    ----------
    n : int
        Number of disks.
    mass, radius : array_like
        Masses m [mass] and radii R [length]. An infinite mass makes an immovable disk: it must be at rest, without
        spin, and counts neither in energies nor in momentum.
    k : array_like
        Shape number in the moment of inertia I = m R^2 / k: 2 for a homogeneous disk, 1 for a hoop.
    material : array_like of int
        Index of each disk's material in the law table; 0 where there is one material.
    species : mapping of str to int
        Names of species and their numbers of disks, in the order of ids: each `Measure` then has their temperatures and
        collisions. In slices of ranks, how many of each are in the slice, 0 for none. Empty: no species are named.

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(3, mass=[1.0, 1.0, 4.0], radius=[0.5, 0.5, 1.0])
    >>> disks.inertia
    array([0.125, 0.125, 2.   ])
    """

    n: NumberOfDisks
    mass: _Masses
    radius: _Sizes
    k: _Sizes = field(default_factory=lambda: np.array(2.0))
    material: NDArray[np.int32] = field(default_factory=lambda: np.array(0, dtype=np.int32))
    species: Mapping[str, NumberOfDisks] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        for name in COLUMNS:
            given = getattr(self, name)
            if name == "material":
                column: NDArray[Any] = checked.integers(name, given, (self.n,), broadcast=True).copy()
            else:
                column = checked.column(name, given, self.n)
            column.flags.writeable = False
            set_(self, name, broadcast_constant_rows(column))
        set_(self, "species", dict(self.species))
        if unnamed := [name for name in self.species if not isinstance(name, str) or not name]:
            raise InputError(f"species: a name is {unnamed[0]!r}: must be a text, not empty")
        if self.species and sum(self.species.values()) != self.n:
            raise InputError(f"species = {self.species}: must add up to {self.n} disks")

    @property
    def movable(self) -> NDArray[np.bool_]:
        """True for disks of a finite mass, shape (n,)."""
        return _by_row(np.isfinite, self.mass)

    @property
    def inertia(self) -> Array:
        """Moments of inertia m R^2 / k [mass length^2], shape (n,); infinite for an immovable disk."""
        return _by_row(lambda mass, radius, k: mass * radius**2 / k, self.mass, self.radius, self.k)

    @functools.cached_property
    def n_movable(self) -> int:
        """Number of disks of a finite mass."""
        return int(np.count_nonzero(self.movable))

    @functools.cached_property
    def covered(self) -> float:
        """Area that all disks cover [length^2]."""
        return disk_area(self.radius)

    @functools.cached_property
    def mean_radius(self) -> float:
        """Mean radius [length]; nan without disks."""
        return float(SERIAL.total(self.radius) / self.n) if self.n else math.nan


COLUMNS = ("mass", "radius", "k", "material")
"""Constant properties of a disk."""
MOST_KINDS = 1000
"""Kinds of disks that each of several ranks knows all of; of more, it knows those of its own disks."""


class DiskKinds(Disks):
    """Kinds of disks of a gas that is on several ranks, none of which need have all of its disks.

    `n`, `n_movable`, `covered`, `mean_radius` and `species` are those of all disks; mass, radius, k and material have a
    row for each kind, ascending. Where there are more than MOST_KINDS, `every` is False, and the rows are `extremes`.
    """

    every: bool

    @classmethod
    def of(cls, disks: Disks) -> DiskKinds:
        """The kinds of some disks; of ranks, each gives those of its slice, and gets the kinds of all."""
        comm = current()
        kinds = merge_kinds(comm.allgather(kinds_among([getattr(disks, name) for name in COLUMNS])))
        n, movable = comm.allreduce(disks.n), comm.allreduce(disks.n_movable)
        squares, radii = (comm.total(each) for each in (np.square(disks.radius), disks.radius))
        species = merge_species(comm.allgather(disks.species))
        return cls.made(kinds, n, movable, squares, radii, species)

    @classmethod
    def made(
        cls, kinds: Kinds, n: int, n_movable: int, squares: float, radii: float, species: Mapping[str, int]
    ) -> DiskKinds:
        """Kinds from their rows, the sum of squared radii of all disks [length^2], and of their radii [length]."""
        found = object.__new__(cls)
        vars(found).update(
            dict(zip(COLUMNS, kinds[0], strict=True)),
            every=kinds[1],
            n=n,
            n_movable=n_movable,
            species=species,
        )
        vars(found).update(covered=float(np.pi * squares), mean_radius=float(radii / n) if n else math.nan)
        return found

    @property
    def rows(self) -> Disks:
        """A disk of each kind."""
        return Disks(len(self.mass), *(getattr(self, name) for name in COLUMNS))


def species_in(species: Mapping[str, int], ids: range) -> dict[str, int]:
    """Numbers of the disks of each species among some ids."""
    found, first = {}, 0
    for name, number in species.items():
        found[name] = len(range(max(first, ids.start), min(first + number, ids.stop)))
        first += number
    return found


def merge_species(found: Sequence[Mapping[str, int]]) -> dict[str, int]:
    """Species of several slices of disks together; InputError if they are not in one order of ids."""
    merged = {name: sum(each.get(name, 0) for each in found) for name in found[0]}
    first = 0
    for each in found:
        last = first + sum(each.values())
        if each != (needed := species_in(merged, range(first, last))):
            raise InputError(
                f"species = {each}: must be {needed}: all ranks name all species, and ids of a species are one range"
            )
        first = last
    return merged


Kinds = tuple[list[NDArray[Any]], bool]
"""Rows of `COLUMNS`, and whether they are all kinds of some disks, or `extremes` of them."""


def kinds_among(columns: Sequence[NDArray[Any]]) -> Kinds:
    """The kinds of disks of these `COLUMNS`, or the extremes where there are more than MOST_KINDS."""
    for few in (slice(2 * MOST_KINDS), slice(None)):  # the first rows may suffice
        rows = unlike([column[few] for column in columns])
        if len(rows[0]) > MOST_KINDS:
            return extremes(columns), False
    return rows, True


def merge_kinds(found: Sequence[Kinds]) -> Kinds:
    """The kinds, or the extremes, of several sets of disks together, however the disks are divided into sets."""
    columns = [np.concatenate(each) for each in zip(*(rows for rows, _ in found), strict=True)]
    return kinds_among(columns) if all(every for _, every in found) else (extremes(columns), False)


def codes(columns: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    """A number for each row of columns, from 0 on: the same for equal rows only, and larger for larger ones."""
    code: NDArray[np.int64] = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        if len(column) and column.min() != column.max():
            values, index = np.unique(column, return_inverse=True)
            _, code = np.unique(code * len(values) + index, return_inverse=True)
    return code


def unlike(columns: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Rows of columns, ascending, each once."""
    code = codes(columns)
    first = np.unique(code, return_index=True)[1] if code.any() else np.arange(min(len(code), 1))
    return [column[first] for column in columns]


def kinds_of(disks: Disks) -> NDArray[np.int64]:
    """Kind of each disk, shape (n,), from 0 on: disks of one kind agree in mass, radius, k and material."""
    return codes([disks.mass, disks.radius, disks.k, disks.material])


def extremes(columns: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Those rows of `COLUMNS` that have the smallest or the largest m, R, m R or m R^2, ascending, each once.

    They are chosen among disks of one material and k whose radii are of the same power of 2, movable ones or not. So
    the least and the largest of each are known, the lightest and the heaviest of each material and k, and gaps between
    radii by more than a factor 2. Extremes of sets of extremes are those of all.
    """
    mass, radius, k, material = columns
    with np.errstate(over="ignore", under="ignore"):
        measured = (mass, radius, mass * radius, mass * radius**2)
    group, power = codes([material, k, np.isfinite(mass)]), np.frexp(radius)[1]
    found = []
    for one in range(int(group.max(initial=-1)) + 1):
        for order in range(int(power.min(initial=0)), int(power.max(initial=0)) + 1):
            own = np.flatnonzero((group == one) & (power == order))
            for measure in measured if len(own) else ():
                here = measure[own]
                for extreme in (here.min(), here.max()):
                    at = own[here == extreme]
                    for column in (radius, mass):  # one row of a tie
                        at = at[column[at] == column[at].min()]
                    found.append(at[0])
    return unlike([column[found] for column in columns])


RECORDED = {
    "latest_collision": 'collapse=ContactTime(...) or record=["free_times"]',
    "last_partner": 'record=["last_partner"]',
    "angle": 'record=["angle"]',
    "dissipated": 'record=["dissipated"]',
}
"""Quantities of a state that only some simulations record, and what to give `Simulation` for each."""


def _rows(
    check: Callable[[Any, tuple[int, ...]], NDArray[Any]],
    value: Any,
    shape: tuple[int, ...],
    default: np.generic,
) -> NDArray[Any]:
    """The values of a quantity of disks, or its default, checked; in the memory of one row where all share one."""
    if value is None:
        return np.broadcast_to(default, shape)
    if isinstance(value, np.ndarray) and value.shape == shape and shape[0] > 1 and value.strides[0] == 0:
        return np.broadcast_to(check(value[:1], (1, *shape[1:])), shape)
    return check(value, shape)


_LOWEST = -(2**31)
_COUNTS = (
    ("collisions", (), 0, 0),
    ("image", (2,), 0, _LOWEST),
    ("wall_collisions", (), 0, 0),
    ("last_partner", (), -1, _LOWEST),
    ("asleep", (), 0, 0),
)
"""Counts of a state, their shape per disk, their default, and their lowest value."""


@dataclass(eq=False, repr=False)
class State(Brief, ReadOnlyAttributes, NotebookRepr):
    """Positions and motion of n disks at one time.

    InputError if shapes do not fit or a value is not finite (the first such disk is named).

    Attributes
    ----------
    position, velocity : array (n, 2)
        Centres [length], inside the box, and their velocities in the lab [length/time], in a sheared box too.
    spin : array (n,)
        Angular velocities, counter-clockwise [rad/time].
    time : float
        [time].
    collisions, wall_collisions, image : array (n,), (n,) and (n, 2) of int32
        Collisions that each disk has had, those with walls, and how often it has left the box through each side, of
        which `Box.unwrap` makes paths. Thermal walls count their hits to draw random numbers.
    latest_collision : array (n,)
        When each disk last collided with a disk or wall [time], -inf if never. Recorded by runs with a `ContactTime`.
    last_partner : array (n,) of int32
        Latest partner of each disk: an id, -1 if there is none yet, -2 - w for wall w. Recorded by runs with
        `record=["last_partner"]`.
    angle : array (n,)
        How far each disk has turned since the start, counter-clockwise, full turns included [rad]. Recorded by runs
        with `record=["angle"]`.
    dissipated : array (n, 7)
        Energy that each disk's collisions have taken, by mechanism (`quantities.MECHANISMS`), half of what one took
        for either disk [energy]. Recorded by runs with `record=["dissipated"]`.
    asleep : array (n,) of int32
        1 for disks that sleep where they are at rest, else 0 (`collapse=Rest(speed)`).
    flow : array (n, 2) or None
        Velocity of the mean flow at each disk [length/time]; None where there is none. A simulation in a sheared box
        sets it, and `observables.measure` needs it; to start one, it is not needed.

    Notes
    -----
    In a state of a simulation, the use of a quantity that it did not record raises InputError (also an
    AttributeError). A start need not have them: they begin at 0, or with no collision.

    Examples
    --------
    >>> import ifrdem
    >>> state = ifrdem.State([[0.0, 0.0], [1.5, 0.0]], [[1.0, 0.0], [0.0, 0.0]], spin=[0.0, 2.0])
    >>> state.time, state.velocity.shape
    (0.0, (2, 2))
    """

    position: Array
    velocity: Array
    spin: Array
    time: float = 0.0
    collisions: NDArray[np.int32] = None  # type: ignore[assignment]
    image: NDArray[np.int32] = None  # type: ignore[assignment]
    wall_collisions: NDArray[np.int32] = None  # type: ignore[assignment]
    latest_collision: Array = None  # type: ignore[assignment]
    last_partner: NDArray[np.int32] = None  # type: ignore[assignment]
    angle: Array = None  # type: ignore[assignment]
    dissipated: Array = None  # type: ignore[assignment]
    flow: Array | None = None
    asleep: NDArray[np.int32] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name in RECORDED:
            if isinstance(getattr(self, name), NotRecorded):
                setattr(self, name, None)
        self.position = checked.array("position", self.position)
        if self.position.ndim != 2 or self.position.shape[1] != 2:
            raise InputError(f"position has shape {self.position.shape}: must be (n, 2)")
        n = len(self.position)
        self.spin = checked.array("spin", self.spin, (n,))
        self.velocity = checked.array("velocity", self.velocity, (n, 2))
        self.time = checked.FINITE("time", self.time)
        for name, shape, default, least in _COUNTS:
            integers = functools.partial(checked.integers, name, least=least)
            setattr(self, name, _rows(integers, getattr(self, name), (n, *shape), np.int32(default)))
        for name, tail, start in (
            ("latest_collision", (), -np.inf),
            ("angle", (), 0.0),
            ("dissipated", (MECHANISM.width,), 0.0),
        ):
            numbers = functools.partial(checked.array, name)
            setattr(self, name, _rows(numbers, getattr(self, name), (n, *tail), np.float64(start)))
        given = ("position", "velocity", "spin", "angle", "dissipated")
        for name in given:
            value = getattr(self, name)
            finite = np.isfinite(value)
            if not finite.all():
                i = int(np.argmin(finite)) // max(value.size // n, 1)
                raise InputError(f"{name}[{i}] = {value[i]}: every value must be finite")
        late = ~(self.latest_collision <= self.time)
        if np.any(late):
            i = int(np.argmax(late))
            needed = f"must be a time not after that of the state, {self.time}"
            raise InputError(f"latest_collision[{i}] = {self.latest_collision[i]}: {needed}")
        if self.flow is not None:
            self.flow = checked.array("flow", self.flow, (n, 2))
            if not np.isfinite(self.flow).all():
                raise InputError("flow: must be finite values")

    @property
    def n(self) -> int:
        """Number of disks."""
        return len(self.spin)

    @property
    def peculiar_velocity(self) -> Array:
        """Velocities relative to the mean flow [length/time], shape (n, 2)."""
        return self.velocity if self.flow is None else self.velocity - self.flow

    def part(self, ids: range) -> Self:
        """State of some disks: views, which are not checked again."""
        found = copy.copy(self)
        for name in self.assignable - {"time"}:
            if isinstance(value := getattr(self, name), np.ndarray):
                vars(found)[name] = value[ids.start : ids.stop]
        return found

    def without_all_but(self, recorded: Collection[str]) -> Self:
        """The state itself, whose quantities of `RECORDED` beyond these names are replaced by errors."""
        for name in RECORDED.keys() - recorded:
            setattr(self, name, NotRecorded(f"State.{name}", RECORDED[name]))
        return self


State.assignable = frozenset(each.name for each in fields(State))
OF_STATE = tuple(FRAME)
"""Names of the quantities of each disk in a state, without the flow, which the box gives."""


def scatter_state(disks: Disks | None, state: State | None) -> tuple[Disks, State]:
    """Disks and state of this rank's slice, of those that the root has; arguments of other ranks are ignored."""
    comm = current()
    if comm.size == 1:
        assert disks is not None
        assert state is not None
        return disks, state
    arrays: list[NDArray[Any]] | None = None
    n, time, species = 0, 0.0, dict[str, int]()
    if comm.is_root:
        assert disks is not None
        assert state is not None
        n, time, species = disks.n, float(state.time), dict(disks.species)
        arrays = [broadcast_constant_rows(getattr(disks, name)) for name in COLUMNS]
        arrays += [broadcast_constant_rows(getattr(state, name)) for name in OF_STATE]
    n, time, species = comm.bcast((n, time, species))
    found = comm.scatter_rows(n, arrays)
    ids = comm.slice_of(n)
    own = Disks(len(ids), *found[: len(COLUMNS)], species=species_in(species, ids))
    return own, State(time=time, **dict(zip(OF_STATE, found[len(COLUMNS) :], strict=True)))


def gather_disks(n: int, disks: Disks) -> Disks | None:
    """All n disks, of which each rank gives its slice: on the root; None on the others."""
    rows = current().gather_rows(n, [getattr(disks, name) for name in COLUMNS])
    species = merge_species(current().allgather(disks.species))
    return None if rows is None else Disks(n, *rows, species=species)


def gather_state(n: int, state: State) -> State | None:
    """The state of all n disks, of which each rank gives its slice: on the root; None on the others."""
    names = [
        name for name in sorted(State.assignable - {"time"}) if isinstance(getattr(state, name), np.ndarray)
    ]
    rows = current().gather_rows(n, [getattr(state, name) for name in names])
    if rows is None:
        return None
    whole = copy.copy(state)
    for name, values in zip(names, rows, strict=True):
        setattr(whole, name, values)
    return whole


@dataclass(frozen=True, eq=False)
class FrameRows:
    """Disks at one time as writers take them: a structured array by id (`quantities.FRAME`), fields as attributes."""

    time: float
    rows: NDArray[Any]

    @classmethod
    def of(cls, state: State, names: Iterable[str]) -> FrameRows:
        """Rows of some quantities of a state, in its precision."""
        columns = {name: getattr(state, name) for name in names}
        kind = [(name, each.dtype, each.shape[1:]) for name, each in columns.items()]
        rows: NDArray[Any] = np.empty(state.n, kind)
        for name, each in columns.items():
            rows[name] = each
        return cls(state.time, rows)

    @property
    def n(self) -> int:
        """Number of disks."""
        return len(self.rows)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in (self.rows.dtype.names or ()):
            raise AttributeError(name)
        return self.rows[name]
