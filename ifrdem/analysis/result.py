"""Results of analyses of files, and helpers of all of them: frames, units, kinds of disks."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.observables import Measure, drift_text
from ..model.state import Disks, codes, unlike
from ..tools.checked import Array
from ..tools.intervals import student_t
from ..tools.reprs import Brief
from ..trajectory.export import species
from ..trajectory.reader import Trajectory
from .common import BLOCKS, MeanValue

COLUMNS = ("time", "id", "partner", "normal", "impulse", "psi", "regime")


@dataclass(frozen=True, eq=False, repr=False)
class TrackedCollisions(Brief):
    """Collisions of tracked disks with disks in a time span; a collision of two tracked disks is listed twice."""

    time: Array  # these, shape (c, ...), as in the file
    id: NDArray[np.int32]
    partner: NDArray[np.int32]
    normal: Array
    impulse: Array
    psi: Array
    regime: NDArray[np.int8]
    tracked: NDArray[np.int32]  # the disks that are tracked
    span: tuple[float, float]  # the time that is known [time]

    @property
    def first_of_pair(self) -> NDArray[np.bool_]:
        """Mask that selects each collision once, shape (c,)."""
        return (self.id < self.partner) | ~np.isin(self.partner, self.tracked)


def require_fields(trajectory: Trajectory, *fields: str) -> None:
    """Raise InputError if fields are missing; the message names the keys of a case that store them."""
    missing = [name for name in fields if name not in trajectory.fields]
    if missing:
        names = " and ".join(f'"{name}"' for name in missing)
        raise InputError(
            f"{trajectory.path} holds no {' and no '.join(missing)} of the disks: put {names} into output.fields of "
            "the case and run it again"
        )


def require_velocities(trajectory: Trajectory, *further: str) -> None:
    """Raise InputError if velocities, in a sheared gas also positions, or `further` fields are missing."""
    require_fields(trajectory, "velocity", *further, *["position"] * bool(trajectory.box.shear_rate))


def series(trajectory: Trajectory, *names: str) -> tuple[Array, list[Array]]:
    """Times, and whole-gas quantities by name: from `timeseries`, or at the frames if there are more of these.

    InputError if the file has not got one of them.
    """
    at_frames = all(name in trajectory.observables for name in names)
    rows = len(trajectory.series.time)
    in_series = rows and all(name in trajectory.series for name in names)
    if in_series and not (at_frames and rows < len(trajectory)):
        return trajectory.series.time, [trajectory.series[name].astype(float) for name in names]
    missing = [name for name in names if name not in trajectory.observables]
    if missing:
        fields = [name for name in missing if name in trajectory.fields]
        of_disks = f" ({' and '.join(fields)} of each disk it holds, as a field)" if fields else ""
        expected = ", ".join(f'"{name}": {_measured(name)}' for name in missing)
        raise InputError(
            f"{trajectory.path} holds no observable {' and no observable '.join(missing)}{of_disks}: `ifrdem run` "
            f"writes these into every file; from Python, file.write(state, {{{expected}}}) does, with measure = "
            "ifrdem.observables.measure(disks, state)"
        )
    return trajectory.times, [trajectory.observables[name].astype(float) for name in names]


def _measured(name: str) -> str:
    """The Python name of a whole-gas quantity."""
    known = name in Measure.__dataclass_fields__ or hasattr(Measure, name)
    return f"measure.{name}" if known else "..."


def collisions(trajectory: Trajectory) -> TrackedCollisions:
    """Collisions of tracked disks with other disks, without wall hits and kicks.

    InputError if the file has no histories, or no time of them is known.
    """
    tracked = trajectory.tracked
    if not len(tracked):
        raise InputError(
            f"{trajectory.path} holds no histories of collisions: name the disks to track in output.histories of "
            "the case and run it again"
        )
    rows, *span = trajectory.tracked_events
    found = {name: trajectory.read_events(name, rows) for name in COLUMNS}
    pair = found["partner"] >= 0
    own = {name: column[pair] for name, column in found.items()}
    return TrackedCollisions(**own, tracked=tracked, span=(span[0], span[1]))


class Drift(NamedTuple):
    """Drift of a whole gas: mean velocity in the directions in which it is conserved, and share of the energy."""

    velocity: Array  # weighted by mass [length/time], shape (2,); 0 along directions in which it changes
    energy: float  # kinetic energy of it [energy]
    share: float  # of the kinetic energy of the disks' motion, in the mean over frames

    def __bool__(self) -> bool:
        """True if the drift exceeds rounding."""
        return self.share > VISIBLE_DRIFT

    def notes(self, trajectory: Trajectory, what: str) -> list[str]:
        """A note on the drift that ends with its effect, `what`; empty without a drift."""
        if not self:
            return []
        where = f"{drift_text(self.velocity)} {unit(trajectory, 'length/time')}".rstrip()
        return [f"the whole gas drifts at {where}, {100.0 * self.share:.4g} % of its kinetic energy; {what}"]


VISIBLE_DRIFT = 1e-9
"""Part of the kinetic energy below which a drift changes no digit that an analysis prints."""
KEPT = 1e-6
"""Largest change of a conserved momentum, in parts of sum m |v|: the rounding of single precision."""


def drift(trajectory: Trajectory, used: Sequence[int]) -> Drift:
    """Drift of a gas over some frames: along x and y, if the total momentum is the same in all of them.

    It is conserved where nothing stops the gas. From the observable `momentum`; 0 without it, with fewer than two
    frames, or where a part of the file is missing, and masses with it.
    """
    none = Drift(np.zeros(2), 0.0, 0.0)
    names = ("momentum", "translational_energy")
    if len(used) < 2 or trajectory.missing or any(name not in trajectory.observables for name in names):
        return none
    momentum, energy = (np.asarray(trajectory.observables[name])[list(used)] for name in names)
    mass = float(np.sum(trajectory.disks.mass, where=trajectory.disks.movable))
    if trajectory.part is not None or mass == 0.0 or not energy.max() > 0.0:
        return none
    scale = np.sqrt(2.0 * float(energy.max()) * mass)
    kept = np.ptp(momentum, axis=0) <= KEPT * scale
    velocity = np.where(kept, momentum.mean(axis=0) / mass, 0.0)
    own = 0.5 * mass * float(velocity @ velocity)
    return Drift(velocity, own, min(own / float(energy.mean()), 1.0))


MOST_FRAMES = 20
"""Frames that are taken by default, evenly from the second half of a file."""
MOST_DISKS = 2_000_000
"""Disks times frames above which fewer are taken: some 30 s of g(r)."""
MOST_KINDS = 8
NOT_STATIONARY = "the gas is not stationary"
"""Beginning of a warning that is one because the gas changes."""

Columns = dict[str, NDArray[Any]]


class FramesFrom(list[int]):
    """Numbers of the frames of a trajectory from a time on, to the last.

    Analyses of series, or of collisions, take all from that time on, which may lie between two frames.
    """

    def __init__(self, numbers: Iterable[int], time: float, place: str = "") -> None:
        super().__init__(numbers)
        self.time = time  # [time]
        self.place = place or f"t = {time:.4g}"  # for messages, in what ends the run


Groups = dict[str, NDArray[np.intp]]
"""Names of groups of disks, and the ids of each."""


def identifier(*parts: str) -> str:
    """Parts of a name joined by underscores: an identifier in NetCDF, JSON and Python."""
    text = "_".join(part.replace(" / ", " over ") for part in parts if part)
    name = re.sub(r"\W+", "_", text).strip("_")
    return re.sub("_error$", "_uncertainty", name)  # in studies, errors are those of means over seeds


class Reading(NamedTuple):
    """A named number with its standard error (nan for none) and unit ("" for none), and its key in files."""

    name: str  # as it is printed
    value: float
    error: float = float("nan")
    unit: str = ""
    key: str = ""  # short and fixed; without it, the name
    n_eff: float = math.nan  # independent values with this error (`common.mean_errors`)
    ends: tuple[float, float] | None = None  # of the 95 % interval where value +- error is a poor one

    @classmethod
    def of(cls, name: str, found: MeanValue, unit: str = "", key: str = "") -> Reading:
        """A mean of a correlated series."""
        return cls(name, found.mean, found.error, unit, key, found.n_eff)

    @classmethod
    def at(
        cls, i: int, name: str, key: str, values: Array, errors: Array, ends: tuple[Array, Array]
    ) -> Reading:
        """The value at one place of arrays of values, errors and ends of intervals, (n,) each."""
        low, high = ends
        return cls(name, float(values[i]), float(errors[i]), key=key, ends=(float(low[i]), float(high[i])))

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval: unless given, by Student's t with n_eff - 1 degrees of freedom; nan if unknown."""
        if self.ends is not None:
            return self.ends
        half = float(student_t(self.n_eff)) * self.error
        return self.value - half, self.value + half


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Brief):
    """Results of one analysis of a file."""

    # What the function of `ifrdem.analysis` returned; for velocities a dict of them by kind of disk.
    result: Any
    rows: list[Reading]  # numbers for people
    tables: dict[str, Columns]  # name ("" for the only or main one) -> columns by name, of one length
    notes: list[str]  # what to know of them
    times: tuple[float, float]  # first and last time that was used
    # Why numbers do not mean what their names say: shown before them.
    warnings: list[str] = field(default_factory=list)
    frames: int = 0  # how many were used; 0 if what was used is no frames

    def __post_init__(self) -> None:
        if not any(TOO_SHORT in warning for warning in self.warnings):
            object.__setattr__(self, "warnings", [*self.warnings, *_too_short(self.rows)])


TOO_SHORT = "too short: fewer than two independent values; the error is a guess"


def _too_short(rows: Iterable[Reading]) -> list[str]:
    """Warning that names the means with an error from fewer than two independent values; empty without any."""
    names = [row.name for row in rows if row.ends is None and row.error > 0.0 and row.n_eff < 2.0]
    return [f"{TOO_SHORT} ({', '.join(names)})"] if names else []


def few_rows(n: int, what: str) -> list[str]:
    """A note if a mean is over so few rows or frames that nothing is known of their correlation; else empty."""
    if not 1 < n < BLOCKS:
        return []
    return [
        f"errors from {n} {what}: fewer than {BLOCKS} are too few to judge their correlation, and whether the gas is "
        "steady"
    ]


def second_half(trajectory: Trajectory, frames: Sequence[int] | None) -> list[int]:
    """The chosen frames, or evenly spaced ones of the second half, including the last."""
    used = all_frames(trajectory, frames)
    if frames is not None:
        return used
    last = used[-1]
    most = int(np.clip(MOST_DISKS // max(trajectory.n, 1), 1, MOST_FRAMES))
    count = min(most, last - last // 2 + 1)
    return sorted({round(i) for i in np.linspace(last, last // 2, count)}) if count > 1 else [last]


def all_frames(trajectory: Trajectory, frames: Sequence[int] | None) -> list[int]:
    """The chosen frames, or all."""
    if len(trajectory) == 0:
        raise InputError(f"{trajectory.path}: no frame to analyse")
    if frames is None:
        return list(range(len(trajectory)))
    return frames if isinstance(frames, FramesFrom) else list(frames)


def unit(trajectory: Trajectory, text: str) -> str:
    """A unit such as "length^2/time" in the words of the file; "" in reduced units."""
    units = trajectory.units
    if not units:
        return ""
    for quantity in ("length", "time", "mass", "energy"):
        text = text.replace(quantity, units.get(quantity, quantity))
    return text


def span_text(trajectory: Trajectory, evaluation: Evaluation) -> str:
    """Number and times of the frames used, as text."""
    first, last = evaluation.times
    span = f"t = {first:.4g}" if first == last else f"t = {first:.4g} to {last:.4g}"
    frames = f"{evaluation.frames} frame{'s' * (evaluation.frames > 1)}, " if evaluation.frames else ""
    return f"{frames}{trajectory.with_unit(span, 'time')}"


def part_warnings(trajectory: Trajectory) -> list[str]:
    """Warning for analyses of neighbours or densities if the file is one part of a trajectory; else empty."""
    if (part := trajectory.part) is None:
        return []
    which = f"disks {part.first} to {part.first + trajectory.n - 1}"
    return [
        f"this file is part {part.number} of a trajectory ({which}): the other disks of the gas are left out"
    ]


def times(trajectory: Trajectory, used: Sequence[int]) -> tuple[float, float]:
    """First and last time of frames [time]."""
    first = used.time if isinstance(used, FramesFrom) else float(trajectory.times[used[0]])
    return first, float(trajectory.times[used[-1]])


def index_of_movable(disks: Disks) -> Any:
    """Index of the disks that can move; of all without a copy, if all can."""
    return slice(None) if disks.n_movable == disks.n else disks.movable


def kinds(trajectory: Trajectory) -> Groups:
    """Movable disks by the names of their species; of a file without several, by radius, mass, k and material.

    By material only, if there are many kinds.
    """
    disks = trajectory.disks
    movable = np.flatnonzero(np.isfinite(disks.mass))
    named = species(trajectory) or {}
    if len(named) > 1:
        of_disk = np.repeat(np.arange(len(named)), [*named.values()])[movable]
        groups = {name: movable[of_disk == i] for i, name in enumerate(named)}
        return {name: ids for name, ids in groups.items() if len(ids)}
    columns: list[NDArray[Any]] = [disks.material, disks.radius, disks.mass, disks.k]
    if len(movable) < disks.n:
        columns = [each[movable] for each in columns]
    rows, which = unlike(columns), codes(columns)
    number = len(rows[0])
    if number == 1:
        return {"all disks": movable}
    if number > MOST_KINDS:
        (materials,) = unlike(columns[:1])
        if not 1 < len(materials) <= MOST_KINDS:
            return {f"disks of {number} kinds together, as if at one temperature": movable}
        return {f"material {one}": movable[disks.material[movable] == one] for one in materials}
    texts = [
        f"material {row[0]:.0f}, R = {trajectory.with_unit(f'{row[1]:.4g}', 'length')}"
        for row in zip(*rows, strict=True)
    ]
    return {text: movable[which == i] for i, text in enumerate(texts)}
