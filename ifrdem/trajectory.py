"""Trajectory files, read lazily as sequences of frames. The layout is described in `ifrdem.h5md`."""

from __future__ import annotations

import operator
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import overload

import h5py
import numpy as np
from numpy.typing import NDArray

from . import h5md, walls
from .box import Box
from .errors import InputError, nearest
from .room import Room
from .state import Disks
from .trajectory_writer import TrajectoryError, TrajectoryWriter

__all__ = [
    "Frame",
    "FrameError",
    "NameMissing",
    "Trajectory",
    "TrajectoryError",
    "TrajectoryWriter",
    "describe",
]


class FrameError(InputError, IndexError):
    """A frame number outside the trajectory."""


class NameMissing(InputError, KeyError):
    """A name that the file does not hold."""

    __str__ = Exception.__str__  # KeyError would put its message into quotes


class Frame:
    """One frame of a trajectory; each array is read when asked for. Floats are float64 whatever is stored.

    Attributes
    ----------
    index : int
        Number of the frame, from 0.
    time : float
        Its time [time].
    """

    def __init__(self, trajectory: Trajectory, index: int) -> None:
        self._trajectory = trajectory
        self.index = index

    def __repr__(self) -> str:
        """Which frame of how many, and when."""
        trajectory = self._trajectory
        return (
            f"<Frame {self.index} of {len(trajectory)}: {trajectory.disks.n} disks at "
            f"t = {trajectory.with_unit(f'{self.time:.6g}', 'time')}>"
        )

    def field(self, name: str) -> NDArray:
        """A stored field by its name in the file, shape (n,) or (n, 2).

        Raises
        ------
        InputError
            If the file does not hold it (also a KeyError).
        """
        value = self._trajectory.dataset(name)[self.index]
        return value if h5md.FIELDS[name].count else value.astype(np.float64)

    @property
    def time(self) -> float:
        """The time [time]."""
        return float(self._trajectory.times[self.index])

    @property
    def position(self) -> NDArray[np.float64]:
        """Centres [length], shape (n, 2), inside the box; anywhere in the plane if that is open."""
        return self.field("position")

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocities in the lab [length/time], shape (n, 2)."""
        return self.field("velocity")

    @property
    def peculiar_velocity(self) -> NDArray[np.float64]:
        """Velocities relative to the mean flow of a sheared box [length/time], shape (n, 2); in others the same."""
        if self._trajectory.box.shear_rate == 0.0:
            return self.velocity
        return self.velocity - self._trajectory.box.flow(self.position)

    @property
    def spin(self) -> NDArray[np.float64]:
        """Angular velocities, counter-clockwise [rad/time], shape (n,)."""
        return self.field("angular_velocity")

    @property
    def collisions(self) -> NDArray[np.int32]:
        """Collisions that each disk has had, shape (n,)."""
        return self.field("collisions")

    @property
    def image(self) -> NDArray[np.int32]:
        """How often each disk has left the box through each side, shape (n, 2); see `Box.unwrap`."""
        return self.field("image")


class Observables(Mapping[str, NDArray]):
    """Whole-gas quantities by name: arrays over the frames, shape (frames, ...), read when asked for."""

    def __init__(self, file: h5py.File, frames: int) -> None:
        self._group = file["observables"]
        self._frames = frames

    def __getitem__(self, name: str) -> NDArray:
        names = list(self)
        if name not in names:
            raise NameMissing(
                f"{self._group.file.filename} holds no observable {name!r}: "
                f"there are {', '.join(names) or 'none'}{nearest(name, names)}"
            )
        return self._group[name]["value"][: self._frames]

    def __iter__(self) -> Iterator[str]:
        return iter(self._group)

    def __len__(self) -> int:
        return len(self._group)


class Trajectory(Sequence[Frame]):
    """A trajectory file as a sequence of frames, read lazily: memory holds what was asked for.

    Only committed frames count. A file that a run is still writing can be read; frames added after opening
    are seen by opening again.

    Parameters
    ----------
    path : str or path
        The file.

    Attributes
    ----------
    disks : Disks
        The constant properties of the n disks.
    box : Box
        The box.
    walls : tuple of Wall
        Walls beside those at its sides; only those that the run stored (`TrajectoryWriter`).
    times : array (frames,)
        Times of the frames [time].
    parameters : dict
        The run's record by name (case text, seed, versions/<package>, units/<quantity>, ...). In reduced
        units there is one parameter `units`, "reduced".
    observables : mapping
        Whole-gas quantities, name -> array over the frames.

    Raises
    ------
    InputError
        If the file is not there, not HDF5, damaged, not H5MD, or not ours; the message says what is missing.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._file = _open(self.path)
        try:
            h5md.check_layout(self._file, str(path))
            self._frames = len(self._file[f"{h5md.EDGES}/step"])
            self.times: NDArray[np.float64] = self._file[f"{h5md.EDGES}/time"][: self._frames]
            self.times.flags.writeable = False
            particles = self._file[h5md.PARTICLES]
            mass, radius, k, material = (particles[name][()] for name in ("mass", "radius", "k", "material"))
            self.disks = Disks(len(mass), mass=mass, radius=radius, k=k, material=material)
            lengths = particles["box"].attrs["lengths"]
            sides = [str(one) for one in particles["box"].attrs["boundary"]]
            periodic = (sides[0] == "periodic", sides[1] == "periodic")
            shear_rate = float(particles["box"].attrs.get("shear_rate", 0.0))
            self.box = Box((float(lengths[0]), float(lengths[1])), periodic, shear_rate)
            self.parameters: dict[str, str | int | float] = {}
            self._file["parameters"].visititems(self._read_parameter)
            self.walls = walls.from_json(str(self.parameters.get("walls", "[]")))
        except BaseException:
            self._file.close()
            raise
        self.observables = Observables(self._file, self._frames)

    def _read_parameter(self, name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            value = item[()]
            self.parameters[name] = value.decode() if isinstance(value, bytes) else value.item()

    def __enter__(self) -> Trajectory:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def room(self) -> Room:
        """What walls leave to the disks, at t = 0."""
        return Room(self.box, self.walls)

    def close(self) -> None:
        """Close the file; its frames cannot be read any more."""
        self._file.close()

    def __len__(self) -> int:
        return self._frames

    def __repr__(self) -> str:
        """The file, and how much is in it."""
        span = ""
        if self._frames:
            span = f" from t = {self.times[0]:.6g} to {self.with_unit(f'{self.times[-1]:.6g}', 'time')}"
        frames = f"{self._frames} frame{'' if self._frames == 1 else 's'}"
        closed = "" if self._file else ", closed"
        return f"<Trajectory {str(self.path)!r}: {self.disks.n} disks, {frames}{span}{closed}>"

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return [Frame(self, i) for i in range(*index.indices(self._frames))]
        i = operator.index(index)
        if not -self._frames <= i < self._frames:
            span = f"0 to {self._frames - 1}" if self._frames else "none"
            raise FrameError(f"frame {i} of {self.path}: there are {self._frames} frames ({span})")
        return Frame(self, i % self._frames)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the per-disk fields in the file."""
        return h5md.stored_fields(self._file)

    def dataset(self, name: str) -> h5py.Dataset:
        """The stored data of a field, to read across frames: `dataset("position")[:, 7]` is a disk's path.

        Shape (frames, n) or (frames, n, 2); after a kill it may hold an uncommitted frame behind the last.

        Raises
        ------
        InputError
            If the file does not hold it (also a KeyError).
        """
        if name not in self.fields:
            raise NameMissing(
                f"{self.path} holds no field {name!r}: "
                f"there are {', '.join(self.fields)}{nearest(name, self.fields)}"
            )
        return h5md.field_dataset(self._file, name)

    def with_unit(self, text: str, quantity: str) -> str:
        """A text with the unit of a quantity behind it; unchanged in reduced units."""
        return f"{text} {self.units[quantity]}" if quantity in self.units else text

    @property
    def units(self) -> dict[str, str]:
        """Unit of each quantity; empty in reduced units."""
        prefix = "units/"
        return {k.removeprefix(prefix): str(v) for k, v in self.parameters.items() if k.startswith(prefix)}


def _open(path: Path) -> h5py.File:
    if not os.path.exists(path):
        raise InputError(f"{path}: there is no such file")
    if os.path.isdir(path):
        raise InputError(f"{path} is a folder: a trajectory file is needed")
    try:
        try:
            return h5py.File(path, "r")
        except BlockingIOError:  # a run is writing it
            return h5py.File(path, "r", locking=False)
    except OSError as error:
        if error.errno:
            raise InputError(f"{path} cannot be read: {os.strerror(error.errno)}") from error
        if h5py.is_hdf5(path):
            raise InputError(f"{path} is a damaged HDF5 file: {error}") from error
        raise InputError(f"{path} is not an HDF5 file") from error


def describe(path: str | os.PathLike[str], *, full: bool = False) -> str:
    """What a trajectory file holds, as text for people.

    Parameters
    ----------
    path : str or path
        The file.
    full : bool
        Give long parameters (the case text) whole instead of by their number of lines.

    Raises
    ------
    InputError
        As `Trajectory`.
    """
    with Trajectory(path) as trajectory:
        lines = [f"{path}: trajectory of ifrdem, H5MD {'.'.join(map(str, h5md.H5MD_VERSION))}"]
        lines += _describe_gas(trajectory)
        lines += _describe_fields(trajectory)
        lines += _describe_names("units", trajectory.units, full=full)
        record = {
            k: v for k, v in trajectory.parameters.items() if k != "units" and not k.startswith("units/")
        }
        lines += _describe_names("parameters", record, full=full)
    return "\n".join(lines)


def _describe_gas(trajectory: Trajectory) -> list[str]:
    disks, box, times = trajectory.disks, trajectory.box, trajectory.times
    length, time, mass = (
        f" {trajectory.units[name]}" if name in trajectory.units else ""
        for name in ("length", "time", "mass")
    )
    lines = [f"  size on disk      {_bytes(trajectory.path.stat().st_size)}"]
    span = f", time {times[0]:.6g} to {times[-1]:.6g}{time}" if len(times) else ""
    lines.append(f"  frames            {len(trajectory)}{span}")
    if "units" in trajectory.parameters:
        lines.append(f"  units             {trajectory.parameters['units']}")
    lines.append(f"  disks             {disks.n}")
    for name, values, unit in (
        ("radius", disks.radius, length),
        ("mass", disks.mass, mass),
        ("k", disks.k, ""),
    ):
        if disks.n:
            low, high = float(values.min()), float(values.max())
            lines.append(
                f"  {name:<18}" + (f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}") + unit
            )
    if disks.n:
        lines.append(f"  materials         {len(np.unique(disks.material))}")
    if box.is_open:
        lines.append("  box               open: positions are plain, never wrapped")
    else:
        lines.append(
            f"  box               {box.lengths[0]:.6g} x {box.lengths[1]:.6g}{length}, {describe_sides(box)}"
        )
    if trajectory.walls:
        shapes = [wall.shape for wall in trajectory.walls]
        counts = ", ".join(f"{shapes.count(shape)} {shape}" for shape in dict.fromkeys(shapes))
        lines.append(f"  walls             {counts}")
    if not box.is_open:
        lines.append(f"  packing fraction  {trajectory.room.packing_fraction(disks.radius):.4f}")
    return lines


def _describe_fields(trajectory: Trajectory) -> list[str]:
    lines = ["fields (per disk and frame)"]
    for name in trajectory.fields:
        dataset = trajectory.dataset(name)
        frame = int(np.prod(dataset.shape[1:])) * dataset.dtype.itemsize
        filters = f", {dataset.compression}" if dataset.compression else ""
        stored = _bytes(dataset.id.get_storage_size())
        lines.append(
            f"  {name:<18}{dataset.dtype}{_shape(dataset.shape[2:])}, "
            f"{_bytes(frame)} a frame, {stored} stored{filters}"
        )
        if len(dataset) > len(trajectory):
            lines[-1] += f", {len(dataset) - len(trajectory)} uncommitted"
    lines.append("observables (per frame)")
    for name, values in trajectory.observables.items():
        lines.append(f"  {name:<24}{values.dtype}{_shape(values.shape[1:])}")
    return lines


def _describe_names(title: str, names: Mapping[str, object], *, full: bool) -> list[str]:
    lines = [title] if names else []
    for name, value in names.items():
        text = str(value).rstrip("\n")
        rows = text.splitlines()
        if len(rows) <= 1 and (full or len(text) <= 80):
            lines.append(f"  {name:<18}{text}")
        elif full:
            lines += [f"  {name}", *(f"    {row}" for row in rows)]
        else:
            lines.append(f"  {name:<18}{rows[0][:50]} ... ({len(rows)} lines, {len(text)} characters)")
    return lines


def _shape(shape: tuple[int, ...]) -> str:
    return f" x {' x '.join(map(str, shape))}" if shape else ""


def _bytes(count: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def describe_sides(box: Box) -> str:
    """What stands at the sides of a box, in words."""
    if box.shear_rate:
        return f"periodic, sheared at the rate {box.shear_rate:.6g}"
    if box.periodic[0] == box.periodic[1]:
        return "periodic" if box.periodic[0] else "between walls"
    return (
        f"periodic in {'x' if box.periodic[0] else 'y'}, between walls in {'y' if box.periodic[0] else 'x'}"
    )
