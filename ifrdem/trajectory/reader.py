"""Trajectory files, read lazily as sequences of frames. The layout is described in `layout`."""

from __future__ import annotations

import functools
import json
import math
import operator
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, overload

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import (
    AttributeMissing,
    DamageError,
    DamageWarning,
    FrameError,
    InputError,
    NameMissing,
    counted,
    cut,
    printable,
    shortened,
    there_are,
)
from ..model.box import Box
from ..model.laws.law import CollisionLaw
from ..model.laws.records import checked_record, from_record, is_custom, of_table
from ..model.state import Disks
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall, at_displacements, columns_of
from ..model.walls.wall import from_json as walls_from_json
from ..mpi.distribution import GATHERED
from ..quantities import FIELDS, PISTON_SERIES, WALL_SERIES
from ..tools import checked
from ..tools.checked import Integer, is_integer, validated
from ..tools.notebook import DisksRepr, NotebookRepr, plots, refuse_unknown
from ..tools.read_only import ReadOnlyAttributes
from . import damage, history, layout, tables
from . import parts as part_files
from .history import History
from .parts import Part, Parts
from .species import named_species, species_of_disks

if TYPE_CHECKING:
    import MDAnalysis
    import pandas
    import xarray

Result = TypeVar("Result")

# A run may be writing just while its file is opened: how often to try again, and the pause between [s].
_ATTEMPTS, _PAUSE = 5, 0.05


SPIN = "angular_velocity"
"""Name of the spin in H5MD; both names are understood."""


class Frame(ReadOnlyAttributes, DisksRepr):
    """One frame of a trajectory; each array is read on access. Floats are float64 whatever is stored.

    Every stored field is there by its name, as `frame["velocity"]` and as `frame.velocity`; "spin" is another name of
    "angular_velocity".

    Attributes
    ----------
    index : int
        Number of the frame, from 0.
    time : float
        Its time [time].
    trajectory : Trajectory
        Whose frame it is.
    """

    index: int
    trajectory: Trajectory

    def __init__(self, trajectory: Trajectory, index: int) -> None:
        self._set(trajectory=trajectory, index=index)

    def __repr__(self) -> str:
        """Number of the frame of how many, and its time."""
        trajectory = self.trajectory
        return (
            f"<Frame {self.index} of {len(trajectory)}: {trajectory.n} disks at "
            f"t = {trajectory.with_unit(f'{self.time:.6g}', 'time')}>"
        )

    @validated
    def __getitem__(self, name: str) -> NDArray[Any]:
        """A stored field by name, as `field`."""
        return self.field(name)

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        return self.field(name)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.trajectory.fields})

    @validated
    def field(self, name: str) -> NDArray[Any]:
        """A stored field by its name in the file, shape (n,) or (n, 2).

        Raises InputError if the file does not hold it (also a KeyError and an AttributeError, so that `hasattr` works),
        or it cannot be read (`DamageError`).
        """
        try:
            value = self.trajectory.read(name, self.index)
        except NameMissing as error:
            raise AttributeMissing(str(error)) from None
        return value.astype(np.float64) if value.dtype.kind == "f" else value

    @property
    def time(self) -> float:
        """The time [time]."""
        return float(self.trajectory.times[self.index])

    @property
    def walls(self) -> tuple[Wall, ...]:
        """Walls of the trajectory, pistons where they are in this frame; for the others `Wall.outline` takes the time.

        The sides of the box are not among them.
        """
        trajectory = self.trajectory
        if PISTON_SERIES[0] not in trajectory.observables:
            return trajectory.walls
        return at_displacements(
            trajectory.walls, trajectory.observables[PISTON_SERIES[0]][self.index].tolist()
        )

    @property
    def position(self) -> NDArray[np.float64]:
        """Centres [length], shape (n, 2), inside the box; anywhere in the plane if that is open."""
        return self.field("position")

    @property
    def box(self) -> tuple[float, float, float, float, float, float]:
        """The box as freud, HOOMD and gsd have it: (Lx, Ly, Lz, xy, xz, yz) [length, length, 0, 1, 0, 0].

        All its sides count as periodic there, so a side between walls is given twice as long (`Box.cell`): neighbours
        are right, and densities that use its area are too low. InputError for an open box.
        """
        box = self.trajectory.box
        if box.is_open:
            raise InputError(f"{self.trajectory.path}: an open box has no sides: give freud another box")
        (x, _, _), (lean, y, _), _ = box.cell(self.time).tolist()
        return x, y, 0.0, lean / y, 0.0, 0.0

    @property
    def points(self) -> NDArray[np.float64]:
        """Centres with z = 0 about the middle of the box [length], shape (n, 3), as freud takes them with `box`."""
        self.box  # noqa: B018 (refuses an open one)
        middle = 0.5 * np.array(self.trajectory.box.lengths)
        return np.column_stack([self.position - middle, np.zeros(self.trajectory.n)])

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocities in the lab [length/time], shape (n, 2)."""
        return self.field("velocity")

    @property
    def peculiar_velocity(self) -> NDArray[np.float64]:
        """Velocities relative to the mean flow of a sheared box [length/time], shape (n, 2); else `velocity`."""
        if self.trajectory.box.shear_rate == 0.0:
            return self.velocity
        return self.velocity - self.trajectory.box.flow(self.position)

    @property
    def spin(self) -> NDArray[np.float64]:
        """Angular velocities, counter-clockwise [rad/time], shape (n,)."""
        return self.field(SPIN)

    @property
    def collisions(self) -> NDArray[np.int32]:
        """Collisions that each disk has had, shape (n,)."""
        return self.field("collisions")

    @property
    def image(self) -> NDArray[np.int32]:
        """Box lengths that each disk has travelled along each axis, shape (n, 2); see `Box.unwrap`."""
        return self.field("image")

    @property
    def unwrapped(self) -> NDArray[np.float64]:
        """Unwrapped positions [length], shape (n, 2); the file must hold `image`."""
        return self.trajectory.box.unwrap(self.position, self.image, self.time)


DERIVED: dict[str, tuple[str, ...]] = {
    "collisions_per_disk": ("collisions",),
    "collision_rate": ("collisions",),
    "theta": ("rotational_temperature", "temperature"),
    "species_theta": ("species_rotational_temperature", "species_temperature"),
}
"""Name of a computed quantity -> the quantities that it is computed from."""


_WRITING = {
    "observable": "file.write(state, ledger.observables(measure))",
    "series": "file.write_series(measure.time, ledger.row(measure))",
}
"""Call of a script that writes observables, and the call that writes a row of series; for messages."""


class Series(ReadOnlyAttributes, Mapping[str, NDArray[Any]]):
    """Quantities by name: arrays over separate times, shape (rows, ...), read on access.

    A quantity with named columns gives one of them too: `series["dissipated_by_mechanism/sliding"]`,
    `series["walls_work/wall 0 line"]`; by the name of a group of walls, their sum: `series["walls_work/paddle"]`. The
    name of a group comes before that of a column, which may be the same in old files.

    Iterating gives the quantities in the file. Three more are computed from them (`derived`):

    - "collisions_per_disk": tau, twice the collisions over the number of disks;
    - "collision_rate": nu, the rate of a disk since the previous row [1/time]; nan in the first row;
    - "theta", of species "species_theta": the rotational over the translational temperature, nan at rest.

    Attributes
    ----------
    time : array (rows,)
        Times of the rows [time].
    """

    time: NDArray[np.float64]

    def __init__(
        self,
        group: h5py.Group | None,
        time: NDArray[np.float64],
        kind: str,
        read: Callable[[str, int, int], NDArray[Any]],
        n: int,
        groups: Sequence[str] = (),
    ) -> None:
        self._kind = kind
        self._n = n
        self._groups = groups
        self._path = "" if group is None else str(group.name)
        self._read = read
        self._columns: dict[str, tuple[str, ...]] = {}
        for name, item in () if group is None else group.items():
            if isinstance(item, h5py.Group):
                columns = item.attrs.get("columns", ())
                self._columns[damage.text_of(name)] = tuple(
                    one.decode() if isinstance(one, bytes) else str(one) for one in columns
                )
        self._set(time=time)

    @validated
    def __getitem__(self, name: str) -> NDArray[Any]:
        whole, _, column = str(name).partition("/")
        columns = self.columns(whole)
        value = (
            self._derive(whole)
            if whole in self.derived
            else self._read(f"{self._path}/{whole}/value", len(self.time), len(columns))
        )
        if not column:
            return value
        groups = self._groups if whole in WALL_SERIES else ()
        chosen = columns_of(column, columns, groups)
        if not chosen:
            known = (*dict.fromkeys(filter(None, groups)), *columns)
            raise NameMissing(
                f"{self._kind} {whole!r} of the file has no column {column!r}{there_are(column, known)}"
            )
        return value[:, chosen[0]] if len(chosen) == 1 else np.asarray(value[:, chosen].sum(axis=1))

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    @validated
    def columns(self, name: str) -> tuple[str, ...]:
        """Names of the columns of a quantity; empty if it has none."""
        if name in self.derived:
            return self._columns[DERIVED[name][-1]]
        if name not in self._columns:
            how = (
                ""
                if len(self)
                else f"; a script writes them with {_WRITING[self._kind]}, ledger = ifrdem.Ledger()"
            )
            raise NameMissing(f"the file holds no {self._kind} {name!r}{there_are(str(name), self)}{how}")
        return self._columns[name]

    @property
    def derived(self) -> tuple[str, ...]:
        """Names of quantities that are computed from those in the file."""
        known = self._columns
        return tuple(
            name
            for name, needed in DERIVED.items()
            if name not in known and all(one in known for one in needed)
        )

    def _derive(self, name: str) -> NDArray[np.float64]:
        values = [self[one].astype(np.float64) for one in DERIVED[name]]
        with np.errstate(divide="ignore", invalid="ignore"):
            if len(values) == 2:
                return np.where(values[1] > 0.0, values[0] / values[1], np.nan)
            per_disk = 2.0 * values[0] / max(self._n, 1)
            if name == "collisions_per_disk":
                return per_disk
            elapsed = np.diff(self.time, prepend=np.nan)
            return np.where(elapsed > 0.0, np.diff(per_disk, prepend=np.nan) / elapsed, np.nan)

    def __repr__(self) -> str:
        return f"<{self._kind} of {len(self.time)} rows: {', '.join(self) or 'none'}>"


@dataclass(frozen=True, eq=False, repr=False)
class DiskPath:
    """One disk over the frames of a trajectory.

    Attributes
    ----------
    disk : int
        Its id.
    time : array (F,)
        Times of the frames [time].
    fields : dict
        What is stored of it, by name: shape (F,) or (F, 2).
    position : array (F, 2)
        Its centres [length]; on a path without jumps where the file holds images (`unwrapped`), else inside the box.
    unwrapped : bool
        Whether positions are those of a path without jumps.
    """

    disk: int
    time: NDArray[np.float64]
    fields: dict[str, NDArray[Any]]
    position: NDArray[np.float64]
    unwrapped: bool

    @validated
    def __getitem__(self, name: str) -> NDArray[Any]:
        name = SPIN if name == "spin" else name
        if name not in self.fields:
            raise NameMissing(f"the file holds no field {name!r}{there_are(name, self.fields)}")
        return self.fields[name]

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.time)

    def __repr__(self) -> str:
        """Id, number of frames, time range and fields."""
        span = f", t = {self.time[0]:.6g} to {self.time[-1]:.6g}" if len(self) else ""
        return (
            f"<DiskPath of disk {self.disk}: {counted(len(self), 'frame')}{span}; {', '.join(self.fields)}>"
        )


class Trajectory(ReadOnlyAttributes, NotebookRepr, Sequence[Frame]):
    """A trajectory file as a sequence of frames, read lazily: memory holds what was accessed.

    Only committed frames count. A file that a run is still writing can be read; what it adds after opening is seen
    after `refresh`. Files of layout 1.0 lack series and histories.

    Parameters
    ----------
    path : str or path
        The file.
    run_law_files : bool
        Let `laws` execute the files of custom laws, which are programs.

    Attributes
    ----------
    n : int
        Number of disks.
    disks : Disks
        The constant properties of the n disks; of more than a million, read at the first access.
    box : Box
        The box.
    walls : tuple of Wall
        Walls in addition to those at its sides; only those that the run stored (`TrajectoryWriter`).
    times : array (frames,)
        Times of the frames [time].
    parameters : dict
        The run's record by name (case text, seed, versions/<package>, units/<quantity>, ...). In reduced
        units there is one parameter `units`, "reduced".
    observables : Series
        Whole-gas quantities by name, over the frames.
    series : Series
        Whole-gas quantities by name, over times of their own; empty if the run had none.

    Raises
    ------
    InputError
        If the file is not there, not HDF5, damaged, not H5MD, or not ours; the message says what is missing.

    Warns
    -----
    DamageWarning
        If a part of a trajectory in parts is missing: what concerns its disks cannot be read, all else can.

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    >>> box = ifrdem.Box((10.0, 10.0))
    >>> state = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], np.zeros(2))
    >>> with ifrdem.TrajectoryWriter("pair.h5", disks, box) as file:
    ...     file.write(state, {"temperature": 0.25})
    ...
    >>> with ifrdem.Trajectory("pair.h5") as file:
    ...     print(file[-1].position[0], file.observables["temperature"])
    ...
    [1. 5.] [0.25]
    """

    path: Path
    n: int
    box: Box
    walls: tuple[Wall, ...]
    times: NDArray[np.float64]
    parameters: dict[str, str | int | float]
    observables: Series
    series: Series

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles open the file anew, and so do those of frames and series."""
        return functools.partial(type(self), run_law_files=self._run_law_files), (self.path,)

    def __init__(self, path: str | os.PathLike[str], *, run_law_files: bool = False) -> None:
        self._set(path=checked.path("path", path))
        self._run_law_files = checked.Instance((bool,))("run_law_files", run_law_files)
        self._open()
        try:
            self._reopening(self._read_head)
            for error in self._missing.values():
                text = f"{error}; radii, masses and fields of its disks cannot be read, all else can"
                warnings.warn(text, DamageWarning, stacklevel=2)
            if not self._missing and self.n <= GATHERED:
                self.disks  # noqa: B018 (of few, they are there when the file is closed)
        except BaseException as error:
            newer = layout.newer(self._file, str(self.path)) if isinstance(error, DamageError) else ""
            self._file.close()
            if newer:
                raise InputError(f"{newer} ({error})") from error
            raise

    def _open(self) -> None:
        self._file, self._written_to = _open(self.path)

    def _reopening(self, act: Callable[[], Result]) -> Result:
        """Call `act`; if a run is writing and half of a write is seen, reopen the file and call it again."""
        for _ in range(_ATTEMPTS - 1 if self._written_to else 0):
            try:
                with damage.as_damage_error(self.path, "its content"):
                    return act()
            except DamageError:
                time.sleep(_PAUSE)
                self._file.close()
                self._open()
        with damage.as_damage_error(self.path, "its content"):
            return act()

    @validated
    def read(self, name: str, selection: Any = ()) -> NDArray[Any]:
        """A part of a stored field, such as `read("position", 3)` of a frame; see `dataset`.

        A selection has whole numbers and slices, of frames first, then of disks.

        Raises InputError if it is another one, the file does not hold the field, or it cannot be read (`DamageError`).
        """
        forward, turned = _forward(name, selection, self.shape(name))
        value = np.flip(self._reopening(lambda: self._read_field(name, forward)), axis=turned)
        if value.dtype.kind == "f" and not np.isfinite(value).all():  # no writer of ours stores such
            raise DamageError(f"{self.path} is damaged: {name} holds numbers that are not finite")
        return value

    def _read_field(self, name: str, selection: Any) -> NDArray[Any]:
        if self._parts is None:
            return damage.read(self.dataset(name), selection)
        field = self.require(name)
        return self._parts.read(self.path, f"{layout.PARTICLES}/{field}/{FIELDS[field].dataset}", selection)

    def _read_rows(self, name: str, rows: int, columns: int) -> NDArray[Any]:
        """The first rows of a quantity; with columns, each has so many numbers."""

        def act() -> NDArray[Any]:
            dataset = self._opened()[name]
            damage.require_shape(dataset, (None, columns) if columns else (None, *dataset.shape[1:]))
            value = damage.read(dataset, slice(0, rows))
            if len(value) < rows:
                raise DamageError(f"{self.path} is damaged: {name} holds {len(value)} of {rows} rows")
            return value

        return self._reopening(act)

    def _opened(self) -> h5py.File:
        if not self._file:
            raise InputError(f"{self.path} is closed: nothing can be read from it")
        return self._file

    def _read_head(self) -> None:
        """Read everything but the frames."""
        file = self._file
        self._missing: dict[int, part_files.MissingPart] = {}
        # In a file that is written it may be there in a moment.
        self._parts = layout.check_layout(file, str(self.path), None if self._written_to else self._missing)
        self._disks: Disks | None = None
        self._fields = layout.stored_fields(file)
        self._frames = len(file[f"{layout.clock(file)}/step"])
        particles, rows = file[layout.PARTICLES], file.get(layout.TIMESERIES)
        self._set(n=len(particles["mass"]) if self._parts is None else self._parts.n)
        with damage.as_damage_error(self.path, f"{layout.PARTICLES}/box"):
            self._set(box=_box(particles["box"].attrs))
        self._set(times=self._moments(file[layout.clock(file)]), parameters={})
        self._unreadable: dict[str, DamageError] = {}
        names: list[bytes | str] = []
        file["parameters"].visit(names.append)
        for name in names:
            self._read_parameter(file["parameters"], name)
        with damage.as_damage_error(self.path, "parameter walls"):
            walls = self._text("walls", "[]")
            if walls != "[]" and (version := layout.version_of(file)) < (1, 5):
                found = ".".join(map(str, version))
                raise InputError(f"{self.path} has layout {found}: walls can be read from layout 1.5 on")
            self._set(walls=walls_from_json(walls))
        moments = np.zeros(0) if rows is None else self._moments(rows)
        self._set(
            observables=Series(file["observables"], self.times, "observable", self._read_rows, self.n),
            series=Series(
                rows, moments, "series", self._read_rows, self.n, [wall.group for wall in self.walls]
            ),
        )

    @property
    def disks(self) -> Disks:
        """The constant properties of the n disks."""
        if self._disks is None:

            def made() -> Disks:
                columns: dict[str, Any] = {name: self._constants(name) for name in layout.STATIC}
                with damage.as_damage_error(self.path, layout.PARTICLES):
                    return Disks(len(columns["mass"]), **columns)

            self._disks = self._reopening(made)
        return self._disks

    @validated
    def constants(self, name: str, disks: slice | int = slice(None)) -> NDArray[Any]:
        """Radii, masses, k, materials or species of some disks: "radius", "mass", "k", "material", "species".

        Materials and species are numbers; species those of the parameter `species`, or of materials where none are
        named.

        Raises InputError if there is no such constant or disk, or it cannot be read (`DamageError`).
        """
        known = (*layout.STATIC, "species")
        if name not in known:
            raise NameMissing(f"there is no constant {name!r}{there_are(str(name), known)}")
        (some,), turned = _forward("disks", disks, (self.n,))
        return np.flip(self._reopening(lambda: self._constants(name, some)), axis=turned)

    def _constants(self, name: str, disks: slice | int = slice(None)) -> NDArray[Any]:
        path = f"{layout.PARTICLES}/{name}"
        if name == "species" and layout.version_of(self._opened()) < (1, 6):  # which held materials there
            named = named_species(self.parameters, self.n)
            if named is None:
                return self._constants("material", disks)
            return np.asarray(species_of_disks(tuple(named.values()), 0, self.n)[disks])
        if self._parts is None:
            return damage.read(self._opened()[path], disks)
        return self._parts.read(self.path, path, disks, axis=0)

    def _moments(self, group: h5py.Group) -> NDArray[np.float64]:
        """Times of the committed rows of a group."""
        times = damage.read(group["time"], slice(0, len(group["step"])))
        if len(times) < len(group["step"]) or times.ndim != 1 or not np.isfinite(times).all():
            raise DamageError(
                f"{self.path} is damaged: {group.name}/time does not hold {len(group['step'])} finite times"
            )
        times.flags.writeable = False
        return times

    def refresh(self) -> int:
        """Open the file again to see what a run has added; returns the number of new frames.

        Frames stay valid; keep no datasets of before.
        """
        before = self._frames
        self._file.close()
        self._open()
        self._reopening(self._read_head)
        return self._frames - before

    def _read_parameter(self, group: h5py.Group, name: bytes | str) -> None:
        text = damage.text_of(name)
        try:
            with damage.as_damage_error(self.path, f"parameter {text}"):
                item = group[name]
                if isinstance(item, h5py.Dataset):
                    self.parameters[text] = damage.parameter(item)
        except DamageError as error:  # frames can be read without it; `record` raises it where it is needed
            self._unreadable[text] = error
            warnings.warn(f"{error}; the parameter is left out", DamageWarning, stacklevel=2)

    @validated
    def record(self, name: str, use: Callable[[Any], Result], default: str | None = None) -> Result:
        """Return `use` of a parameter that holds JSON (`default` where the run stored none).

        Raises InputError if there is none and no default, it cannot be read, or `use` cannot do with what it says.
        """
        text = self._text(name, default)
        with damage.as_damage_error(self.path, f"parameter {name}"):
            return use(json.loads(text))

    def _text(self, name: str, default: str | None) -> str:
        if name in self._unreadable:
            raise self._unreadable[name]
        if name not in self.parameters and default is None:
            raise NameMissing(f"{self.path} holds no parameter {name!r}{there_are(name, self.parameters)}")
        return str(self.parameters.get(name, default))

    @property
    def gravity(self) -> tuple[float, float]:
        """Gravity of the run [length/time^2]: the parameter of that name, two numbers as JSON; none if it is absent."""

        def pair(given: Any) -> tuple[float, float]:
            x, y = (float(one) for one in given)
            if not (math.isfinite(x) and math.isfinite(y)):
                raise ValueError(f"{given}: must be two finite numbers")
            return x, y

        return self.record("gravity", pair, "[0.0, 0.0]")

    @property
    def laws(self) -> list[list[CollisionLaw | None]]:
        """The law of each pair of materials, [a][b]; None for materials that never meet.

        A custom law is made from its file, where it was or next to the trajectory: its code is executed, if
        `run_law_files` was set and the file is that of the run.

        Raises InputError if the run stored none, they are damaged, `run_law_files` was not set for a custom one, or its
        file is not there or has changed.
        """
        materials = int(self.disks.material.max(initial=-1)) + 1
        table = self.record("laws", lambda given: _laws(given, materials))
        custom = [one["law"] for one in of_table(table) if isinstance(one, Mapping)]
        if custom and not self._run_law_files:
            raise InputError(
                f"{self.path}: law {cut(custom[0])} is a program: Trajectory(path, run_law_files=True) executes it; "
                "read it first if it is not yours"
            )
        try:
            return [
                [from_record(one, self.path.parent) if isinstance(one, Mapping) else one for one in row]
                for row in table
            ]
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None

    @property
    def has_custom_laws(self) -> bool:
        """True if laws are custom ones from files, whose code `laws` executes if `run_law_files` was set."""
        return self.record("laws", lambda given: any(map(is_custom, of_table(given))), "[]")

    def __enter__(self) -> Trajectory:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def file(self) -> h5py.File:
        """The open h5py file, for data without an attribute here."""
        return self._file

    @property
    def parts(self) -> Parts | None:
        """The parts that the trajectory is in; None if its file holds all data."""
        return self._parts

    @property
    def part(self) -> Part | None:
        """Mark of the part of a trajectory that the file is, with some of its disks only; None of a whole one."""
        file = self._opened()
        with damage.as_damage_error(self.path, part_files.PART):
            return Part.of(file) if self._parts is None and part_files.PART in file else None

    @property
    def missing(self) -> tuple[int, ...]:
        """Numbers of the parts that are missing: what needs their disks cannot be read (`DamageError`)."""
        return tuple(self._missing)

    def data_files(self) -> Iterator[h5py.File]:
        """The files that hold the fields, open one after another: this one, or its parts."""
        for _, file in part_files.data_files(self._opened(), self._parts, self.path, self.n):
            yield file

    @property
    def free_area(self) -> FreeArea:
        """The area that walls leave to the disks in the first frame; gates count as open."""
        walls, time = (self[0].walls, self[0].time) if len(self) else (self.walls, 0.0)
        fixed = tuple(wall for wall in walls if not wall.gated)
        return FreeArea(self.box, fixed, time, gates_open=len(fixed) < len(walls))

    def close(self) -> None:
        """Close the file; its frames cannot be read any more."""
        self._file.close()

    def __len__(self) -> int:
        return self._frames

    def __repr__(self) -> str:
        """The file and its numbers of frames and disks."""
        span = ""
        if self._frames:
            span = f" from t = {self.times[0]:.6g} to {self.with_unit(f'{self.times[-1]:.6g}', 'time')}"
        frames, closed = counted(self._frames, "frame"), "" if self._file else ", closed"
        return f"<Trajectory {str(self.path)!r}: {self.n} disks, {frames}{span}{closed}>"

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return [Frame(self, i) for i in range(*index.indices(self._frames))]
        i = _index("frame", index)
        if not -self._frames <= i < self._frames:
            span = f"0 to {self._frames - 1}" if self._frames else "none"
            raise FrameError(f"frame {shortened(i)} of {self.path}: there are {self._frames} frames ({span})")
        return Frame(self, i % self._frames)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the per-disk fields in the file."""
        return self._fields

    @validated
    def require(self, name: str) -> str:
        """The name of a stored field in the file ("angular_velocity" of "spin").

        Raises InputError if the file does not hold it (also a KeyError), or is closed.
        """
        self._opened()
        field = SPIN if name == "spin" else name
        if field not in self.fields:
            raise NameMissing(f"{self.path} holds no field {field!r}{there_are(str(field), self.fields)}")
        return field

    @validated
    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a stored field over the committed frames, (frames, n) or (frames, n, 2), also if parts are missing.

        Raises InputError as `require`.
        """
        return (self._frames, self.n, *FIELDS[self.require(name)].tail)

    @validated
    def dtype(self, name: str) -> np.dtype[Any]:
        """Type in which a field or a constant of the disks is stored, also if parts are missing.

        Raises InputError if the file holds neither, it is closed or damaged.
        """
        file = self._opened()
        with damage.as_damage_error(self.path, name):
            if name in (*layout.STATIC, "species"):
                return np.dtype(file[f"{layout.PARTICLES}/{name}"].dtype)
            return np.dtype(layout.field_dataset(file, self.require(name)).dtype)

    @validated
    def chunks(self, name: str) -> tuple[int, ...]:
        """Shape of the chunks in which a field is stored.

        Raises InputError as `require`.
        """
        of_disks = FIELDS[self.require(name)].tail
        if self._parts is not None:
            return (1, layout.chunk_disks(self.n), *of_disks)
        with damage.as_damage_error(self.path, name):
            return tuple(layout.field_dataset(self._opened(), self.require(name)).chunks or self.shape(name))

    def __dask_tokenize__(self) -> tuple[str, int, int]:
        """Mark of the content for Dask: the file, its number of frames, and the time of its last change."""
        return str(self.path.resolve()), self._frames, self.path.stat().st_mtime_ns

    @validated
    def dataset(self, name: str) -> h5py.Dataset:
        """The data of a field, to read across frames: `dataset("position")[:, 7]` is a disk's path.

        Shape (frames, n) or (frames, n, 2); after a kill it may hold an uncommitted frame after the last. HDF5 opens
        the parts of a trajectory when the shape is read, so they are checked before.

        Raises InputError if the file does not hold it (also a KeyError), is closed, or a part of it is missing or no
        file (`DamageError`).
        """
        field = self.require(name)
        if self._parts is not None:
            self._parts.check(self.path)
        return layout.field_dataset(self._opened(), field)

    def disk(self, disk: int) -> DiskPath:
        """The stored path of a disk over the frames; `history` is exact between them, if the disk is tracked.

        Raises InputError if there is no such disk, the file holds no positions, or it is damaged.
        """
        disk = self.checked_disk(disk)
        fields: dict[str, NDArray[Any]] = {}
        self.require("position")
        for name in self.fields:
            value = self.read(name, (slice(0, self._frames), disk))
            fields[name] = value.astype(np.float64) if value.dtype.kind == "f" else value
        position = fields["position"]
        if unwrapped := "image" in fields:
            position = self.box.unwrap(position, fields["image"], self.times)
        return DiskPath(disk, self.times, fields, position, unwrapped)

    @property
    def tracked(self) -> NDArray[np.int32]:
        """Ids of the disks that have a `history`, ascending; none if the run tracked none."""
        return self._reopening(lambda: history.tracked(self._opened()))

    @property
    def tracked_events(self) -> tuple[int, float, float]:
        """Number of committed events of all tracked disks, and the times between which they are complete [time].

        Raises InputError if the file has no histories, or they are damaged.
        """
        return self._reopening(lambda: history.committed(self._opened(), str(self.path)))

    @validated
    def read_events(
        self, name: str, rows: Annotated[int, Integer(0, 2**62)], start: Annotated[int, Integer(0, 2**62)] = 0
    ) -> NDArray[Any]:
        """A column of the first events of all tracked disks, from the event `start` on."""
        return self._reopening(
            lambda: damage.read(self._opened()[f"{history.GROUP}/events/{name}"], slice(start, rows))
        )

    def history(self, disk: int) -> History:
        """Every collision of a tracked disk, and its position at any time between them.

        Raises InputError if there is no such disk, or it is not tracked (the message says which are), or the file is
        damaged.
        """
        disk, radius, path = self.checked_disk(disk), self.disks.radius, str(self.path)
        return self._reopening(
            lambda: history.read(
                self._opened(), path, disk, box=self.box, radius=radius, gravity=self.gravity
            )
        )

    def checked_disk(self, disk: int) -> int:
        """The id of a disk; InputError if there is none of it."""
        disk = _index("disk", disk)
        n = self.n
        if not 0 <= disk < n:
            span = f" (0 to {n - 1})" if n else ""
            raise FrameError(f"disk {shortened(disk)} of {self.path}: there are {n} disks{span}")
        return disk

    def to_pandas(
        self, which: Literal["series", "observables", "frame", "collisions"] = "series", index: int = -1
    ) -> pandas.DataFrame:
        """A pandas table: `series` or `observables` by time, or disks of the frame `index` by id; vectors as _x, _y.

        Or `collisions` of the tracked disks, a row each: disks, species, place, relative velocities, impulses, regime,
        energy by mechanism, free times and paths of both (`trajectory.collisions.table`).

        Raises InputError if `which` is another word, there is no such frame, the file has no histories, or pandas is not
        installed.
        """
        return tables.to_pandas(self, which, index)

    def to_xarray(self, chunks: Mapping[str, int] | Literal["auto"] | None = None) -> xarray.Dataset:
        """Fields, observables and series with named axes; fields are read when computed with, from the open file.

        Parameters
        ----------
        chunks : dict or "auto", optional
            Divide the fields into arrays of Dask, which reads and computes one after another, or on a cluster, whose
            processes open the file by its path: with so many frames and disks each, as `{"time": 10}`, or as many as
            Dask takes ("auto"). Where a number is missing it is that of the chunks in the file, as for `{}`.

        Raises
        ------
        InputError
            If xarray, or for `chunks` dask, is not installed, or `chunks` are none.
        """
        return tables.to_xarray(self, chunks)

    @validated
    def plot(
        self, what: str = "temperatures", ax: Any = None, *, frames: Sequence[int] | None = None,
        over: str | None = None, color: str | None = None, axis: str | None = None, bins: int | None = None,
        cells: tuple[int, int] | None = None, average: bool = False, **unknown: Any,
    ) -> Any:  # fmt: skip
        """Draw a picture that `ifrdem plot --list` lists: temperatures, disks, energy, velocity, rdf, ...

        Parameters
        ----------
        what : str
            Its name.
        ax : Axes or several, optional
            Axes of Matplotlib to draw into, as many as the picture has panels; of temperatures and the ledger one will
            do, for the upper panel. By default those of a new figure of `pyplot`.
        frames : sequence of int, optional
            Of which frames; by default of those that suit the picture.
        over : {"t", "tau"}, optional
            Time, or collisions per disk: of temperatures, energy, ledger, mechanisms, walls, piston and species. By
            default time, of species collisions per disk where the file counts them.
        color : str, optional
            Of "disks", as `Frame.plot` has it.
        axis, bins, cells, average
            Of "profiles" and "fields", as `ifrdem analyse` has them.

        Returns
        -------
        Axes, or an array of them

        Raises
        ------
        InputError
            If there is no such picture or argument, the file does not hold what it takes, or axes are missing.
        """
        of_analysis = {"axis": axis, "bins": bins, "cells": cells, "average": average or None}
        refuse_unknown(unknown, ("what", "ax", "frames", "over", "color", *of_analysis))
        options = {name: value for name, value in of_analysis.items() if value is not None}
        return plots().trajectory(self, what, ax, frames=frames, over=over, color=color, **options)

    def universe(self) -> MDAnalysis.Universe:
        """A universe of MDAnalysis over this file, in the units of the file (nothing is converted).

        It has an atom for each disk, with masses, radii and types (names of species, of materials where no species are named, or their numbers); coordinates are single precision.
        MDAnalysis takes all sides as periodic: a side between walls is twice as long there (`Box.cell`), and a box
        without periodic sides has no dimensions.

        Warns
        -----
        UserWarning
            If one side is periodic and one between walls: densities that use the volume of its box are too low. If the
            file has a layout before 1.4, whose box MDAnalysis takes for another one.

        Raises
        ------
        InputError
            If MDAnalysis is not installed, or the file holds no positions.

        Examples
        --------
        >>> import ifrdem
        >>> with ifrdem.Trajectory("cooling.h5") as run:  # of `ifrdem run cooling`
        ...     universe = run.universe()
        ...
        >>> universe.atoms.center_of_mass()  # doctest: +SKIP
        """
        return tables.universe(self)

    @validated
    def with_unit(self, text: str, quantity: str) -> str:
        """A text followed by the unit of a quantity; unchanged in reduced units."""
        return f"{text} {self.units[quantity]}" if quantity in self.units else text

    @property
    def units(self) -> dict[str, str]:
        """Unit of each quantity; empty in reduced units, or if the file states none."""
        prefix = "units/"
        return {
            k.removeprefix(prefix): printable(str(v))
            for k, v in self.parameters.items()
            if k.startswith(prefix)
        }

    @property
    def stated_units(self) -> dict[str, str] | None:
        """Units as for `units`; None if the file states none, not even that they are reduced."""
        return self.units or ({} if self.parameters.get("units") == layout.REDUCED else None)


def _forward(
    name: str, selection: Any, lengths: tuple[int, ...]
) -> tuple[tuple[int | slice, ...], tuple[int, ...]]:
    """A selection as HDF5 takes it, without negative numbers and steps, and the axes of what is read to turn round.

    InputError if it is none for axes of these lengths.
    """
    given = selection if isinstance(selection, tuple) else (selection,)
    if len(given) > len(lengths):
        raise InputError(f"selection {shortened(selection)} of {name}: {len(lengths)} axes at most")
    forward: list[Any] = []
    turned: list[int] = []  # axes of what is read
    for length, each in zip(lengths, given or (slice(None),), strict=False):
        refused = InputError(
            f"selection {shortened(each)} of {name}: must be integers and slices; index the "
            "result for others, as trajectory.read(name, 3)[[5, 2]]"
        )
        if isinstance(each, slice):
            try:
                rows = range(length)[each]
            except (TypeError, ValueError):
                raise refused from None
            if rows.step < 0:
                turned.append(sum(isinstance(one, slice) for one in forward))
                rows = rows[::-1]
            forward.append(slice(rows.start, rows.stop, rows.step) if rows else slice(0, 0))
        elif is_integer(each):
            if not -length <= each < length:
                raise FrameError(
                    f"selection {shortened(each)} of {name}: there are {length} along this axis, from 0"
                )
            forward.append(int(each) % length)
        else:
            raise refused
    return tuple(forward), tuple(turned)


def _index(what: str, given: Any) -> int:
    """The number of a frame or a disk; InputError if it is none."""
    try:
        return operator.index(given)
    except TypeError:
        raise InputError(f"{what} = {shortened(given)}: must be an integer") from None


def check_file(path: Path) -> None:
    """Raise InputError if a path is no regular file, or empty: HDF5 would wait for a pipe or /proc/kmsg for ever."""
    if not os.path.exists(path):
        raise InputError(f"{path}: there is no such file")
    if not os.path.isfile(path):
        what = "a folder" if os.path.isdir(path) else "a device or pipe"
        raise InputError(f"{path} is {what}: must be a trajectory file")
    if not os.path.getsize(path):
        damage.check_readable(path)  # files of the system have no size
        raise InputError(f"{path} is empty: must be a trajectory file")


def _laws(given: Any, materials: int) -> list[list[Any]]:
    """Laws of a table of records; of a custom law, its record."""
    if not materials <= len(given) or any(len(row) != len(given) for row in given):
        raise ValueError(f"must have a row and a column for each of {materials} materials")

    def law(record: Any) -> Any:
        return (
            None if record is None else checked_record(record) if is_custom(record) else from_record(record)
        )

    return [[law(one) for one in row] for row in given]


def _box(attributes: Mapping[str, Any]) -> Box:
    lengths = attributes["lengths"]
    sides = [one.decode() if isinstance(one, bytes) else str(one) for one in attributes["boundary"]]
    if len(lengths) != 2 or len(sides) != 3 or not {*sides} <= {"periodic", "none"}:
        raise ValueError(
            f"lengths {lengths} and boundary {sides}: must be two lengths and three of 'periodic' or 'none'"
        )
    periodic = (sides[0] == "periodic", sides[1] == "periodic")
    return Box((float(lengths[0]), float(lengths[1])), periodic, float(attributes.get("shear_rate", 0.0)))


def _open(path: Path) -> tuple[h5py.File, bool]:
    """The file, and whether a run is writing it."""
    check_file(path)
    attempt, writing = 1, False
    while True:
        try:
            return h5py.File(path, "r", **({"locking": False} if writing else {})), writing
        except BlockingIOError:
            writing = True
        except OSError as error:
            if writing and attempt < _ATTEMPTS:  # it has grown between two looks of HDF5 at its size
                attempt += 1
                time.sleep(_PAUSE)
                continue
            if error.errno:
                raise InputError(f"{path} cannot be read: {os.strerror(error.errno)}") from error
            if not h5py.is_hdf5(path):
                raise InputError(f"{path} is not an HDF5 file") from error
            raise DamageError(f"{path} is a damaged HDF5 file: {error}; run `ifrdem repair` on it") from error
