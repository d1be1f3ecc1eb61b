"""Content of the viewer's page: a trajectory as JSON, and as arrays of small integers."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analysis import result
from ..errors import InputError
from ..model.laws.ifr import regime_name
from ..plots import disks as plot_disks
from ..plots.run import title
from ..plots.style import unit_of
from ..runs import status
from ..tools.checked import Array
from ..trajectory.export import kinds
from ..trajectory.history import KICK
from ..trajectory.reader import SPIN, Frame, Trajectory
from ..trajectory.rows import converted

MOST_DISKS = 2_000_000
"""Above so many disks in the window, a map of the area fraction is shown instead."""
MOST_EVENTS = 20_000_000  # of histories kept in memory for the times since collisions
MOST_COLLISIONS = 1000  # of a history that are shown, those around the frame's time
MOST_TRACKED = 1000  # ids of tracked disks that the page knows
MOST_ROWS = 1500  # of a curve
LEVELS, UNKNOWN = 254, 255
"""The highest level of a colour, and the level of disks whose value is not known."""
FULL = 0.98  # part of the disks whose values lie inside the range of the colours
REDUCED = "reduced units"


@dataclass(frozen=True)
class DiskColour:
    """A quantity by which disks are coloured: its label, unit in words, and the kind of its colours."""

    label: str
    unit: str
    kind: str  # "diverging" about 0, "rising", "cyclic" (degrees) or "names"
    field: str  # that the file must hold
    values: Callable[[Content, Frame], Array]


def pack(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A JSON header followed by little-endian arrays, each aligned to four bytes.

    First the length of the header (uint32). Its `arrays` are lists of name, type (as "u2") and number of elements.
    """
    listed = [[name, f"{one.dtype.kind}{one.dtype.itemsize}", one.size] for name, one in arrays.items()]
    text = json.dumps({**header, "arrays": listed}, allow_nan=False).encode()
    parts = [text + b" " * (-len(text) % 4)]
    for one in arrays.values():
        parts.append(one.astype(one.dtype.newbyteorder("<"), copy=False).tobytes())
        parts.append(b"\0" * (-one.nbytes % 4))
    return b"".join([len(parts[0]).to_bytes(4, "little"), *parts])


def numbers(values: Array, digits: int = 7) -> list[float | None]:
    """Numbers as JSON has them, to so many digits; null where they are not finite."""
    return [float(f"{one:.{digits}g}") if np.isfinite(one) else None for one in np.asarray(values).tolist()]


def levels(values: Array, kind: str) -> tuple[NDArray[np.uint8], list[float]]:
    """Levels 0 to `LEVELS` of values (n,), `UNKNOWN` for nan; and the range [low, high] that they stand for."""
    known = values[np.isfinite(values)]
    low, high = 0.0, 1.0
    if kind == "cyclic":
        low, high = -180.0, 180.0
    elif known.size and kind == "diverging":  # a heavy tail of fast spins must not wash out all others
        high = float(np.quantile(np.abs(known), FULL)) or 1.0
        low = -high
    elif known.size:
        low, high = float(known.min()), float(np.quantile(known, FULL))
        high = high if high > low else low + 1.0
    level = np.rint(np.clip((values - low) / (high - low), 0.0, 1.0) * LEVELS)
    return np.where(np.isnan(level), UNKNOWN, level).astype(np.uint8), [low, high]


class Content:
    """A trajectory in the form of the page.

    Raises InputError if the file holds no positions.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        trajectory.require("position")
        self.trajectory = trajectory
        self._radii()
        self._stamp = self._now()
        self._forget()

    def _forget(self) -> None:
        self._events: tuple[Array, NDArray[np.int32]] | None = None
        self._positions: tuple[int, Array, NDArray[np.intp]] | None = None

    def _now(self) -> tuple[int, int]:
        """Size of the file and the time of its last change."""
        try:
            state = self.trajectory.path.stat()
        except OSError as error:
            raise InputError(f"{self.trajectory.path}: {error.strerror}") from error
        return state.st_size, state.st_mtime_ns

    def refresh(self) -> None:
        """Read what a run has added to the file."""
        if (now := self._now()) != self._stamp:
            self.trajectory.refresh()
            self._stamp = now
            self._forget()

    @property
    def gas(self) -> str:
        """A name of this file with these disks, to detect that another one has replaced it."""
        state = self.trajectory.path.stat()
        return f"{state.st_dev:x}.{state.st_ino:x}.{zlib.crc32(self.trajectory.disks.radius.tobytes()):x}"

    @property
    def status(self) -> str:
        """Progress of the run that is writing the file; "" without one."""
        try:
            content = status.read(self.trajectory.path)
        except InputError:  # there is none, such as of a run from Python
            return ""
        return status.line(content) if content["state"] == status.RUNNING else ""

    def head(self, opening: int | None = None) -> dict[str, Any]:
        """The content except the disks, for JSON.

        `opening` is the frame that the page opens with: without it the first one, or of a live run the last one.
        """
        it = self.trajectory
        available, absent = self.colours
        tracked = it.tracked
        names = kinds(it)
        return {
            "title": title(it) if len(it) else it.path.stem,
            "gas": self.gas,
            "n": it.disks.n,
            "times": numbers(it.times, 12),
            "units": {name: unit_of(it, name) or "" for name in ("time", "length", "mass")},
            "unit": {"velocity": unit_of(it, "length/time") or "", "spin": self._unit("angle/time")},
            "reduced": not it.units,
            "box": None if it.box.is_open else {"lengths": it.box.lengths, "periodic": it.box.periodic},
            "colours": available,
            "colour": self._varying(
                [one["name"] for one in available],
                opening if opening is not None else -1 if self.status else 0,
            ),
            "absent": absent,
            "names": names[0] if names else [],
            "marks": "angle" in it.fields,
            "tracked": tracked[:MOST_TRACKED].tolist(),
            "tracked_count": len(tracked),
            "charts": self.charts(),
            "status": self.status,
        }

    def _unit(self, quantity: str) -> str:
        """Unit of a colour; turns are in rad in every file."""
        unit = unit_of(self.trajectory, quantity.removeprefix("angle")) if quantity else ""
        if unit is None:
            return REDUCED if self.trajectory.stated_units == {} else ""
        return quantity.startswith("angle") * "rad" + unit

    @property
    def colours(self) -> tuple[list[dict[str, Any]], dict[str, str]]:
        """Quantities by which disks can be coloured, and reasons why others cannot."""
        it, found, absent = self.trajectory, [], {}
        for name, one in COLOURS.items():
            if one.field == "species":
                absent[name] = "" if len(self._kinds()[0]) > 1 else "all disks are of one species"
            elif one.field == "histories":
                absent[name] = self._no_events()
            elif one.field not in it.fields:
                absent[name] = f'the file holds no "{one.field}" of the disks (output.fields of the case)'
            if not absent.get(name):
                absent.pop(name, None)
                label = one.label + (" relative to the flow" if name == "speed" and it.box.shear_rate else "")
                entry = {"name": name, "label": label, "unit": self._unit(one.unit), "kind": one.kind}
                # From -180 degrees, as plots have them.
                stops = [*plot_disks.DIRECTIONS[4:], *plot_disks.DIRECTIONS[1:5]]
                found.append(entry | ({"stops": stops} if one.kind == "cyclic" else {}))
        return found, absent

    def _varying(self, names: Sequence[str], index: int) -> str:
        """The first of these colours that differs among the disks of a frame: spins may all be 0 at the start."""
        for name in names if len(self.trajectory) else ():
            values = COLOURS[name].values(self, self.trajectory[index])
            if len(values) and not np.all(values == values[0]):
                return name
        return names[0] if names else ""

    def _kinds(self) -> tuple[Sequence[str], NDArray[np.intp]]:
        material = self.trajectory.disks.material.astype(np.intp)
        count = int(material.max(initial=0)) + 1
        return kinds(self.trajectory) or ([f"material {i}" for i in range(count)], material)

    def _no_events(self) -> str:
        """Reason why the times of collisions are not known; "" if they are."""
        if not len(self.trajectory.tracked):
            return "the file holds no histories of collisions (output.histories of the case)"
        events = self.trajectory.tracked_events[0]
        return f"{events} events of histories are too many to hold" if events > MOST_EVENTS else ""

    def charts(self) -> list[dict[str, Any]]:
        """Curves of whole-gas quantities over time: temperatures, and energies."""
        found = []
        for what, names in CHARTS.items():
            lines, x = [], None
            for name, label in names.items():
                try:
                    when, (value,) = result.series(self.trajectory, name)
                except InputError:  # not stored
                    continue
                if value.ndim != 1 or not np.any(value) or (x is not None and len(when) != len(x)):
                    continue
                x = when
                some = np.unique(np.linspace(0, len(when) - 1, MOST_ROWS).astype(int))
                lines.append({"name": label, "y": numbers(value[some])})
            if x is not None and len(x):
                unit = self._unit("energy")
                found.append(
                    {"name": what, "unit": unit, "over": "t", "x": numbers(x[some], 12), "lines": lines}
                )
        return found

    def _radii(self) -> NDArray[Any]:
        """Radii as browsers draw them; InputError if they are outside of the range of single precision."""
        remedy = "browsers draw in it: choose units in which it is nearer to 1, or draw by `ifrdem plot FILE disks`"
        return converted("radius", self.trajectory.disks.radius, np.float32, remedy)

    def disks(self) -> bytes:
        """Radius [length] and number of the species of each disk; one number where all are the same."""
        radius, species = self._radii(), self._kinds()[1].astype(np.uint8)
        return pack(
            {}, {"radius": radius[:1] if len(np.unique(radius)) == 1 else radius,
                 "species": species[:1] if len(np.unique(species)) == 1 else species},
        )  # fmt: skip

    def frame(
        self, index: int, colours: Sequence[str] = (), window: Array | None = None
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Header and arrays of a frame's disks, with their periodic images at the sides, or of a map of their area
        fraction.

        Positions and angles are in parts of 65536 of the header's `window` (ends of x, ends of y) and of a turn;
        colours are `levels`. The first `whole` disks are those of ids 0, 1, ...; those of the others are the array
        `id`.

        Parameters
        ----------
        index : int
        colours : sequence of str
            Names of `COLOURS` that `head` lists; species are left out, which do not change.
        window : array (2, 2), optional
            Ends of x and of y [length]: only disks that are seen in it.
        """
        frame = self.trajectory[index]
        header: dict[str, Any] = {"index": index, "time": frame.time, "walls": self._walls(frame)}
        if window is None and self.trajectory.n > MOST_DISKS:
            return self._map(frame, header, window)
        position, owner = self._placed(frame)
        radius, whole = self.trajectory.disks.radius, self.trajectory.n
        if window is not None:
            reach = radius[owner, None]
            near = (position + reach >= window[:, 0]) & (position - reach <= window[:, 1])
            kept = np.flatnonzero(near.all(axis=1))
            position, owner, whole = position[kept], owner[kept], 0
        if len(owner) > MOST_DISKS:
            return self._map(frame, header, window)
        low, high = np.zeros(2), np.ones(2)
        if len(owner):
            low, high = position.min(axis=0), position.max(axis=0)
        high = np.where(high > low, high, low + 1.0)
        arrays: dict[str, NDArray[Any]] = {
            "position": np.rint((position - low) / (high - low) * 65535.0).astype(np.uint16).ravel(),
            "id": owner[whole:].astype(np.uint32),
        }
        header |= {"window": np.stack([low, high], axis=1).tolist(), "whole": whole, "ranges": {}}
        if "angle" in self.trajectory.fields:
            turns = np.rint(frame["angle"][owner] / (2.0 * np.pi) * 65536.0)
            arrays["angle"] = turns.astype(np.int64).astype(np.uint16)
        for name in colours:
            if name != "species":
                one = COLOURS[name]
                level, header["ranges"][name] = levels(one.values(self, frame), one.kind)
                arrays[name] = level[owner]
        return header, arrays

    def _placed(self, frame: Frame) -> tuple[Array, NDArray[np.intp]]:
        """Positions with periodic images and their owners; kept for the next window of the same frame."""
        if self._positions is None or self._positions[0] != frame.index:
            it = self.trajectory
            found = plot_disks.with_images(frame.position, it.disks.radius, it.box, frame.time)
            self._positions = (frame.index, *found)
        return self._positions[1:]

    def _map(
        self, frame: Frame, header: dict[str, Any], window: Array | None
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        position = frame.position
        region = plot_disks.shown_region(self.trajectory, position)
        if window is not None and not self.trajectory.box.is_open:
            low, high = np.maximum(window[:, 0], region[:, 0]), np.minimum(window[:, 1], region[:, 1])
            region = np.stack([low, high], axis=1)
        covered = plot_disks.area_fraction(self.trajectory, position, region)
        top = float(np.quantile(covered, 0.999)) or 1.0
        header |= {
            "window": region.tolist(), "shape": covered.shape, "ranges": {"map": [0.0, top]},
            "cell": plot_disks.cell_side(covered, region),
        }  # fmt: skip
        level = np.rint(np.clip(covered / top, 0.0, 1.0) * LEVELS).astype(np.uint8)
        return header, {"map": level.ravel("F")}

    def _walls(self, frame: Frame) -> list[dict[str, Any]]:
        """Walls where they stand in a frame; of those that are neither lines nor whole circles, points along them."""
        walls, time = frame.walls, frame.time
        done = plot_disks.collisions_of(frame) if any(one.opens_after is not None for one in walls) else 0
        return [
            {
                "shape": one.shape, "origin": one.transform(np.array([one.origin]), time)[0].tolist(),
                "towards": one.towards, "radius": one.radius, "surface": one.surface_speed,
                "hot": one.temperature is not None,
                "points": [] if one.geometry.is_circle else one.outline(time).tolist(),
            }
            for one in walls
            if one.is_present(time, done)
        ]  # fmt: skip

    def since(self, frame: Frame) -> Array:
        """Time since the last collision of each disk [time]; nan of disks not tracked, and of those without one."""
        if self._events is None:
            rows = self.trajectory.tracked_events[0]
            time, id, partner = (
                self.trajectory.read_events(name, rows) for name in ("time", "id", "partner")
            )
            self._events = time[partner != KICK], id[partner != KICK]
        time, id = self._events
        last = np.full(self.trajectory.n, np.nan)
        until = np.searchsorted(time, frame.time, side="right")
        # Events are ordered by time: the last one stays.
        last[id[:until]] = time[:until]
        return frame.time - last

    def disk(self, id: int, index: int) -> dict[str, Any]:
        """A disk in a frame, and its collisions around that time; `collisions` is null of a disk not tracked.

        Raises InputError if there is no such disk or frame.
        """
        it, frame = self.trajectory, self.trajectory[index]
        id = it.checked_disk(id)
        values = {
            name: numbers(np.atleast_1d(it.read(name, (index, id))))
            for name in ("position", "velocity", SPIN, "collisions") if name in it.fields
        }  # fmt: skip
        names, kind = self._kinds()
        about = {
            "id": id,
            "species": names[kind[id]],
            "mass": numbers(it.disks.mass[id : id + 1])[0],
            "values": values,
        }
        return about | self.collisions(id, frame.time, MOST_COLLISIONS)

    def collisions(self, id: int, time: float, most: int) -> dict[str, Any]:
        """At most `most` collisions of a disk around a time: the total number, and rows of the selected ones."""
        if id not in self.trajectory.tracked:
            return {"collisions": None, "rows": []}
        found = self.trajectory.history(id)
        hits = np.flatnonzero(found.partner != KICK)
        first = max(0, min(int(np.searchsorted(found.time[hits], time)) - most // 2, len(hits) - most))
        names = ("time", "partner", "psi", "velocity_before", "velocity_after", "spin_before", "spin_after")
        rows = [
            [*numbers(np.hstack([found[name][i] for name in names]), 9), regime_name(int(found.regime[i]))]
            for i in hits[first : first + most]
        ]
        return {"collisions": len(hits), "kicks": len(found) - len(hits), "rows": rows}


CHARTS = {
    "temperatures": {"temperature": "T", "rotational_temperature": "T_rot"},
    "energies": {
        "energy": "kinetic", "translational_energy": "translational", "rotational_energy": "rotational",
        "potential_energy": "potential", "dissipated_energy": "dissipated",
    },
}  # fmt: skip
"""Curves below the disks: names in the file, and on the page."""


def _speed(_content: Content, frame: Frame) -> Array:
    velocity = frame.peculiar_velocity
    return np.hypot(velocity[:, 0], velocity[:, 1])


def _direction(_content: Content, frame: Frame) -> Array:
    velocity = frame.peculiar_velocity
    return np.where(velocity.any(axis=1), np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0])), np.nan)


COLOURS = {
    "spin": DiskColour(
        "spin (counter-clockwise +)", "angle/time", "diverging", SPIN, lambda _, frame: frame.spin
    ),
    "speed": DiskColour("speed", "length/time", "rising", "velocity", _speed),
    "direction": DiskColour("direction of the velocity", "", "cyclic", "velocity", _direction),
    "species": DiskColour(
        "species", "", "names", "species", lambda content, _: content._kinds()[1].astype(float)
    ),
    "collisions": DiskColour(
        "collisions", "", "rising", "collisions", lambda _, frame: frame.collisions.astype(float)
    ),
    "since": DiskColour("time since the last collision", "time", "rising", "histories", Content.since),
}
"""Quantities by which disks can be coloured."""
