"""The plan of a study: its base case, the keys that it sweeps, its seeds, and what is kept of every run."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from ..analysis.names import ANALYSES, OF_FRAMES, OVER_TIME
from ..analysis.options import checked_option
from ..case import file as case_file
from ..case import shipped
from ..case.case import CaseSections
from ..case.estimate import long_steps
from ..case.gas import CaseGas
from ..case.messages import spelled
from ..case.output_section import TRACKED
from ..errors import InputError, cut, listed, nearest, option_name, shortened
from ..quantities import LEDGER, OBSERVABLES
from ..tools import checked, text_file
from ..tools.checked import Integer, NonNegative
from ..tools.values import Several
from ..tools.versions import __version__
from .draws import COEFFICIENTS, Draws, drawn
from .task import Task, along

if TYPE_CHECKING:
    AnalysisName = str
else:
    AnalysisName = Literal[tuple(ANALYSES)]
ROWS = 50
"""Rows of series where neither the study nor its case says how many."""
MOST_RUNS = 100_000
MOST_FRAMES = 2000
"""Frames of a run that the times of analyses may need."""
FIXED = {
    "run.seed": "the seeds of the study ([ensemble] seeds) vary it",
    "run.name": "runs of a study are named by themselves",
    "run.threads": "the results do not depend on it; the number of workers says how many runs go side by side",
    "run.runtime": "the processes of a study have one runtime",
    "run.units": "one study has one system of units",
    "run.t_end": "every run has the same end: a longer run holds the shorter ones",
    "run.collisions_per_disk": "every run has the same end: a longer run holds the shorter ones",
}
"""Keys that cannot be swept, and why; neither can those of [output]."""
VARIANT = "variant"
"""Dimension of the variants of a study."""
RESERVED = {
    "time",
    "step",
    *OBSERVABLES,
    *LEDGER,
    "theta",
    "seed",
    "collisions_per_disk",
    "run",
    "runs",
    "failure",
    "warnings",
    "notes",
    "analyses_from",
    "at",
    VARIANT,
    COEFFICIENTS,
}
"""Names that a swept key cannot have in the results."""
CADENCES = (
    "series_interval",
    "series_collisions",
    "series_phases",
    "series_spacing",
    "frames_interval",
    "frames_collisions",
    "frames_phases",
    "frames_spacing",
    "log_from",
)
"""Keys of [output] that say when rows and frames are due, beside their numbers."""
FIRST_SEED = 1_000_003
"""Added to the seed of a run for that of its equilibration, whose random forces differ."""
LAST_FRAME = {"frames": "1", "series": "1", "picture": "false", "views": "false"}
"""Keys of [output] of an equilibration, of which the last frame is needed."""
FRAME_KEYS = ("file", "frame", "psi", "speed", "columns", "units", "delimiter", "decimal", "relax")
"""Keys of [start] that do not go with a start from the last frame of a trajectory."""
MOTION_KEYS = ("speed_rms", "temperature", "spin_rms")
"""Keys of species that do not go with velocities of a frame."""
TEMPLATE = """\
# Haff's law and the ratio of temperatures of a cooling gas, for restitution and friction.
# ifrdem study FILE --dry-run estimates its cost; ifrdem study FILE runs it; the same command resumes it.

# The base case: a case file (path from this file), or the name of a shipped case.
case = "cooling"
# Changes of it for every run, as `ifrdem run --set` takes them.
set = ["species[0].number=2000", "run.collisions_per_disk=20", "output.histories="]

# Every combination of these values, and every seed, is a run. A key is spelled as for --set.
[sweep]
"material[0].e_n" = [0.7, 0.8, 0.9]
"material[0].mu" = [0.05, 0.21, 0.5]
# "material[0].mu" = { from = 0.0, to = 0.5, number = 6 }                          # evenly
# "box.packing_fraction" = { from = 0.01, to = 0.5, number = 5, spacing = "log" }  # at a constant ratio

# Keys that vary together, as one axis: as many values each.
# [[zip]]
# "species[0].number" = [500, 2000, 8000]
# "species[0].speed_rms" = [1.0, 2.0, 4.0]

# Different laws, forces or geometries, as a further axis "variant": keys that are set, keys that are removed, or
# another case file, whose runs have the same end.
# [[variants]]
# name = "table"
# [[variants]]
# name = "frictionless"
# set = ["material[0].mu=0.0"]
# remove = ["material[0].rho"]
# [[variants]]
# name = "other"
# case = "other.toml"

# A first run for each seed, with these changes; the runs of the study begin with positions and motion of its last
# frame. Swept keys that it needs, too, such as the size of the box, are in along.
# [equilibrate]
# set = ["run.collisions_per_disk=50", "material[0].e_n=1.0"]
# remove = []
# along = []

[ensemble]
# A number of seeds, from run.seed of the case on, or a list: [1, 2, 5].
seeds = 20
# Sets of coefficients drawn from the errors that materials and pairs of the case have, as a further axis.
# coefficients = 20

[output]
# Rows of the time series after the first, evenly in what ends the run, or "log".
series = 50
# series_spacing = "log"
# Analyses of every run, as in `ifrdem analyse`; those of frames
# (OF_FRAMES)
# at these collisions per disk (times, where the run ends at a time).
# analyses = ["velocity", "rdf"]
# analyses_at = [5.0, 10.0, 20.0]
# Where averages over a run begin (of series, stress, species, profiles, ...), in the same; without it, driven and
# sheared gases and those between walls are averaged over the steady part, and analyses of gases that cool over the
# whole run.
# analyses_from = 10.0
# Options of analyses, as of `ifrdem analyse`; frames as of --frames.
# options = { profiles = { axis = "y", bins = 20, frames = "100:" }, fields = { cells = [20, 20], average = true } }
# Keep the trajectory of every run.
# trajectories = true

[cluster]
# Nothing: a process for each core of this machine. Else one of these three.
# workers = 4
# scheduler = "tcp://host:8786"        # of Dask
# kind = "slurm"                       # or pbs, sge, lsf: jobs of a batch system, by dask-jobqueue
# jobs = 10
# options = { cores = 16, memory = "16 GB", walltime = "02:00:00", queue = "short" }
""".replace("OF_FRAMES", ", ".join(OF_FRAMES))
"""The study file that `ifrdem new study` writes."""


class _Part(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, frozen=True
    )


class Range(_Part):
    """Values at even steps, or at a constant ratio."""

    start: float | int = Field(alias="from")
    to: float | int
    number: Annotated[int, Integer(2, MOST_RUNS)]
    spacing: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _log_of_positive(self) -> Range:
        if self.spacing == "log" and not (self.start > 0 and self.to > 0):
            raise PydanticCustomError("range", "a log range goes between two numbers above 0")
        return self

    def values(self) -> list[float | int]:
        """The numbers, to 12 digits: 0.8, not 0.7999999999999999; whole ones where both ends are."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        found = [float(f"{each:.12g}") for each in space(self.start, self.to, self.number)]
        whole = isinstance(self.start, int) and isinstance(self.to, int)
        return [int(one) for one in found] if whole and all(map(float.is_integer, found)) else list(found)


class EnsembleSection(_Part):
    """Seeds: a number, from run.seed of the case on, or a list; sets of coefficients drawn from their errors."""

    seeds: Any = 1
    coefficients: Several | None = None


class StudyOutput(_Part):
    """Output kept for every run."""

    series: Annotated[int, Integer(1, 100_000)] | None = None
    series_spacing: Literal["even", "log"] | None = None
    analyses: list[AnalysisName] = Field(default=[])
    analyses_at: list[float] = Field(default=[])
    analyses_from: NonNegative | None = None
    options: dict[AnalysisName, dict[str, Any]] = Field(default={})
    trajectories: bool = False

    @model_validator(mode="after")
    def _options_of_analyses(self) -> StudyOutput:
        for name, given in self.options.items():
            if name not in self.analyses:
                raise PydanticCustomError("options", f"{name}: must be among the analyses of this study")
            for option, value in given.items():
                try:
                    checked_option(name, option, value)
                except InputError as error:
                    raise PydanticCustomError("options", f"{name}.{error}") from None
            if "frames" in given and name in OF_FRAMES and self.analyses_at:
                raise PydanticCustomError("options", f"{name}.frames: cannot be combined with analyses_at")
        return self

    @property
    def has_averages(self) -> bool:
        """True if there is an analysis over the time of each run."""
        return any(name in OVER_TIME for name in self.analyses)


class ClusterSection(_Part):
    """Place of the runs: processes here, a scheduler of Dask, or jobs of a batch system (dask-jobqueue)."""

    workers: Annotated[int, Integer(0, 10_000)] | None = None
    scheduler: str | None = None
    kind: Literal["slurm", "pbs", "sge", "lsf"] | None = None
    jobs: Annotated[int, Integer(1, 10_000)] = 1
    options: dict[str, Any] = Field(default={})

    @model_validator(mode="after")
    def _one_kind(self) -> ClusterSection:
        given = [name for name in ("workers", "scheduler", "kind") if getattr(self, name) is not None]
        if len(given) > 1:
            text = f"at most one of workers, scheduler, kind must be given; given: {given}"
            raise PydanticCustomError("place", text)
        return self


class VariantSection(_Part):
    """A variant of the case: keys that are set, keys that are removed, or another case file."""

    name: Annotated[str, Field(min_length=1)]
    set: list[str] = Field(default=[])
    remove: list[str] = Field(default=[])
    case: str | None = None

    @property
    def changes(self) -> list[str]:
        """Changes as of `--set`."""
        return [*self.set, *(f"{key}=" for key in self.remove)]


class EquilibrateSection(_Part):
    """A first run of each seed, with whose last frame the runs of the study begin."""

    set: list[str] = Field(default=[])
    remove: list[str] = Field(default=[])
    along: list[str] = Field(default=[])


class StudyFile(_Part):
    """The content of a study file."""

    case: str
    set: list[str] = Field(default=[])
    sweep: dict[str, Any] = Field(default={})
    zip: list[dict[str, Any]] = Field(default=[])
    variants: list[VariantSection] = Field(default=[])
    equilibrate: EquilibrateSection | None = None
    ensemble: EnsembleSection = EnsembleSection()
    output: StudyOutput = StudyOutput()
    cluster: ClusterSection = ClusterSection()


@dataclass(frozen=True)
class Axis:
    """Keys that vary together: their names in the results, and at each position the value of every key."""

    names: tuple[str, ...]
    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]

    def label(self, i: int) -> str:
        """ "e_n = 0.8" of position i; of drawn coefficients their number."""
        if self.names[0] == COEFFICIENTS:
            return f"{COEFFICIENTS} = {self.values[i][0]}"
        pairs = zip(self.names, self.values[i], strict=True)
        return ", ".join(f"{name} = {_text(each)}" for name, each in pairs)

    def assignments(self, i: int) -> list[str]:
        """The values as overrides of a case, "KEY=VALUE"; none of variants, which are in `Plan.base`."""
        if self.names == (VARIANT,):
            return []
        pairs = zip(self.keys, self.values[i], strict=True)
        return [f"{key}={json.dumps(each)}" for key, each in pairs if key != COEFFICIENTS]


class Base(NamedTuple):
    """A case that is varied: its text, its path, and what every run changes of it."""

    text: str
    path: Path
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """A valid study."""

    name: str  # of its results
    path: Path  # the base case; relative paths in it start from its folder
    text: str  # its text
    overrides: tuple[str, ...]  # what every run changes of it
    axes: tuple[Axis, ...]
    seeds: tuple[int, ...]
    output: StudyOutput
    cluster: ClusterSection
    variants: tuple[Base, ...] = ()  # of the first axis, if there are some
    first: EquilibrateSection | None = None
    draws: Draws | None = None  # of coefficients, which are the last axis

    def base(self, point: tuple[int, ...]) -> Base:
        """The case of a point without its swept keys."""
        return self.variants[point[0]] if self.variants else Base(self.text, self.path, self.overrides)

    @property
    def shape(self) -> tuple[int, ...]:
        """Positions along each axis, and seeds."""
        return (*(len(axis.values) for axis in self.axes), len(self.seeds))

    @property
    def points(self) -> Iterator[tuple[int, ...]]:
        """Positions of each point on the axes."""
        return itertools.product(*(range(size) for size in self.shape[:-1]))

    def label(self, point: tuple[int, ...]) -> str:
        """ "e_n = 0.8, mu = 0.1"."""
        return ", ".join(axis.label(i) for axis, i in zip(self.axes, point, strict=True)) or "the base case"

    def _changes(self, point: tuple[int, ...], seed: int) -> list[str]:
        swept = [one for axis, i in zip(self.axes, point, strict=True) for one in axis.assignments(i)]
        return [*self.base(point).overrides, *swept, f"run.seed={seed}"]

    def _first_changes(self, point: tuple[int, ...], seed: int) -> list[str]:
        """Changes of the case of a point for its equilibration."""
        first = self.first
        assert first is not None
        swept = [
            one
            for axis, i in zip(self.axes, point, strict=True)
            if {*axis.keys} & {*first.along}
            for one in axis.assignments(i)
        ]
        removed = [f"{key}=" for key in first.remove]
        kept = [f"output.{key}={value}" for key, value in LAST_FRAME.items()]
        kept += [f"output.{key}=" for key in (*TRACKED, *CADENCES)]
        seed = (seed + FIRST_SEED) % 2**63
        return [*self.base(point).overrides, *swept, *first.set, *removed, *kept, f"run.seed={seed}"]

    def checked_cases(self) -> tuple[dict[tuple[int, ...], CaseSections], list[str], list[str]]:
        """Cases of the points that are in order, lines on what `check` refuses of the others, and warnings.

        Warnings are those of long steps of forces.
        """
        good: dict[tuple[int, ...], CaseSections] = {}
        refused: dict[str, list[str]] = {}
        warned: dict[str, list[str]] = {}
        axis: tuple[str, tuple[float, ...]] | None = None
        species: list[str] = []
        for point in self.points:
            base = self.base(point)
            try:
                file = case_file.of_text(base.text, base.path, self._changes(point, self.seeds[0]))
                self._refuse_start(file.gas)
                self._refuse_equilibration(file.gas, point)
                name, rows = along(file.case)
                axis, species = (
                    axis or (name, tuple(rows)),
                    species or [each.name for each in file.case.species],
                )
                if axis != (name, tuple(rows)) or species != [each.name for each in file.case.species]:
                    text = "runs of all variants must have the same end, rows and names of species"
                    raise InputError(f"{VARIANT}: {text}")
                good[point] = file.case  # without its arrays, of which there may be many
                for line in long_steps(file.gas):
                    warned.setdefault(line, []).append(self.label(point))
            except InputError as error:
                for line in str(error).replace(" [set on the command line]", "").splitlines():
                    line = line.removeprefix(f"{base.path}: ").removeprefix("--set ").removeprefix("set: ")
                    refused.setdefault(line, []).append(self.label(point))
        count = math.prod(self.shape[:-1])
        return good, with_labels(refused, 0 if good else count), with_labels(warned, count)

    def _refuse_start(self, gas: CaseGas) -> None:
        """Raise InputError if runs do not begin at 0, or seeds change nothing in them."""
        box, start = gas.box, gas.case.start
        if gas.begin != (0.0, 0):
            text = "must be 0 in a study, whose runs share one time axis (without the key it is the time of the frame)"
            if box.shear_rate:
                period = box.lengths[0] / abs(box.shear_rate * box.lengths[1])
                text += f"; in a sheared box, this needs a frame at a multiple of {period:.6g}"
            raise InputError(f"start.time = {gas.begin[0]:g}: {text}")
        if len(self.seeds) > 1 and not gas.is_drawn:
            motion = " Without start.motion = true velocities are drawn, from speed_rms." * start.motion
            raise InputError(
                f"seeds = {len(self.seeds)}: all runs would be the same: nothing in this case is drawn, neither the "
                f"start nor forces nor thermal walls.{motion} Or give one seed"
            )

    def _refuse_equilibration(self, gas: CaseGas, point: tuple[int, ...]) -> None:
        """Raise InputError if the equilibration of a point is refused, or ends in another box or with other disks."""
        if self.first is None:
            return
        base = self.base(point)
        if gas.case.start.trajectory is not None or gas.case.start.file is not None:
            raise InputError("equilibrate: cannot be combined with a start from a file")
        try:
            first = case_file.of_text(base.text, base.path, self._first_changes(point, self.seeds[0])).gas
        except InputError as error:
            raise InputError("\n".join(f"equilibrate: {line}" for line in str(error).splitlines())) from None
        same = first.box.lengths == gas.box.lengths and first.n == gas.n
        if not same or not np.array_equal(first.disks.radius, gas.disks.radius):
            text = "must have the box and the disks of the run that begins with its last frame"
            raise InputError(f"equilibrate: {text}: name the swept keys that change them in along")

    def equilibration(self, point: tuple[int, ...], seed: int, folder: Path) -> Task | None:
        """The first run of a seed of a point; None in a study without. Points that do not change it share it."""
        if self.first is None:
            return None
        base = self.base(point)
        changes = self._first_changes(point, seed)
        case = case_file.of_text(base.text, base.path, changes).case
        record = case.model_dump(mode="json", exclude={"run": {"name", "threads"}})
        outside = {name: _digest(base.path.parent / name) for name in case.files}
        return Task(
            key=_key([record, outside, "equilibration", __version__]), index=(*point, 0), text=base.text,
            path=str(base.path.resolve()), overrides=tuple(changes), folder=str(folder.resolve()), analyses=(), at=(),
            start=None, trajectory=True,
            weight=weight(case),
        )  # fmt: skip

    def tasks(self, good: dict[tuple[int, ...], CaseSections], folder: Path) -> Iterator[Task]:
        """The runs of the points that are in order, whose results stand in a folder."""
        firsts: dict[tuple[str, ...], Task] = {}
        for point, case in good.items():
            base = self.base(point)
            # The case has the rows of series; only averages over the run have a start.
            without = {"series", "series_spacing", *["analyses_from"] * (not self.output.has_averages)}
            kept = self.output.model_dump(
                exclude=without | {"options"} if not self.output.options else without
            )
            record = case.model_dump(mode="json", exclude={"run": {"name", "threads"}})
            outside = {name: _digest(base.path.parent / name) for name in case.files}
            for i, seed in enumerate(self.seeds):
                record["run"]["seed"] = seed
                identity, changes, after = (
                    [record, outside, kept, __version__],
                    self._changes(point, seed),
                    "",
                )
                if self.first is not None:
                    first_changes = (base.text, *self._first_changes(point, seed))
                    if first_changes not in firsts:
                        made = self.equilibration(point, seed, folder)
                        assert made is not None
                        firsts[first_changes] = made
                    after = firsts[first_changes].key
                    identity.append(after)
                    changes += _from_frame(folder.resolve() / f"{after}.h5", len(case.species))
                yield Task(
                    key=_key(identity), index=(*point, i), text=base.text, path=str(base.path.resolve()),
                    overrides=tuple(changes), folder=str(folder.resolve()),
                    analyses=tuple(self.output.analyses), at=tuple(self.output.analyses_at),
                    start=self.output.analyses_from, trajectory=self.output.trajectories,
                    weight=weight(case),
                    options=self.output.options, after=after,
                )  # fmt: skip


def weight(case: CaseSections) -> float:
    """Part of a run in the work of a study: disks times collisions per disk, or disks where a time ends it."""
    return sum(each.number for each in case.species) * (case.run.collisions_per_disk or 1.0)


def _key(identity: list[Any]) -> str:
    """Name of the files of a run, from all that decides its result."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]


def _from_frame(path: Path, species: int) -> list[str]:
    """Changes of a case by which it begins at time 0 with positions and motion of the last frame of a trajectory."""
    found = [f"start.{key}=" for key in FRAME_KEYS]
    found += [f"start.positions={json.dumps(str(path))}", "start.motion=true", "start.time=0.0"]
    return found + [f"species[{i}].{key}=" for i in range(species) for key in MOTION_KEYS]


def with_labels(labels_of: dict[str, list[str]], count: int) -> list[str]:
    """Each text with the label of its first point and the number of its further points.

    A text that has `count` points, which is all of them, gets no label.
    """
    lines = []
    for text, labels in labels_of.items():
        more = f" (and {len(labels) - 1} more)" if len(labels) > 1 else ""
        lines.append(text if len(labels) == count else f"{labels[0]}{more}: {text}")
    return lines


def read(
    path: str | Path,
    *,
    vary: Sequence[str] = (),
    set: Sequence[str] = (),
    seeds: str | int | None = None,
    coefficients: int | None = None,
) -> Plan:
    """The plan of a study file (it names its case by the key `case`), or of a case file and keys to vary.

    `vary` are further axes, "KEY=VALUES" (`axis_of`); `set`, `seeds` and `coefficients` are as for `Study`.

    Raises InputError with a line for each thing that is wrong with the study itself.
    """
    path = shipped.find(str(path), study=True)
    text, raw = case_file.load(path)
    of_study = "case" in raw or not {"run", "box", "species"} & raw.keys()
    name = path.stem if of_study else f"{path.stem}-study"  # NAME.nc is a view of the trajectory of a run
    study, folder = _checked(raw if of_study else {"case": str(path)}, path), path.parent
    if of_study:
        path = path.parent / study.case if Path(study.case).suffix else shipped.find(study.case)
        text, raw = case_file.load(path)
    groups = [{key: values} for key, values in study.sweep.items()] + [dict(group) for group in study.zip]
    groups += [axis_of(each) for each in vary]
    for key in (key for group in groups for key in group if key in (VARIANT, COEFFICIENTS)):
        way = "[[variants]] has them" if key == VARIANT else "ensemble.coefficients is their number"
        raise InputError(f"{key}: is no key of a case that can be swept; {way}")
    lists = [{key: _values(key, each) for key, each in group.items()} for group in groups]
    axes = _axes(lists)
    changes = [*study.set, *set]
    main = _base(path, text, raw, changes, study.output)
    number, draws = study.ensemble.coefficients if coefficients is None else coefficients, None
    if number is not None:
        if study.variants:
            raise InputError(
                f"{COEFFICIENTS}: cannot be combined with variants; use a study for each of them"
            )
        draws = _drawn(main, number)
        *others, sets = _axes([*lists, {key: [*values] for key, values in _columns(draws)}])
        numbered = tuple((i, *values) for i, values in enumerate(sets.values))
        axes = (*others, Axis((COEFFICIENTS, *sets.names), (COEFFICIENTS, *sets.keys), numbered))
    chosen = _seeds(study.ensemble.seeds if seeds is None else seeds, int(_number(raw, "seed")))
    variants = _variants(study, main, changes, folder)
    if variants:
        axes = (Axis((VARIANT,), (VARIANT,), tuple((each.name,) for each in study.variants)), *axes)
    if study.equilibrate is not None and (
        unknown := [
            key for key in study.equilibrate.along if key not in {key for axis in axes for key in axis.keys}
        ]
    ):
        swept = ", ".join(key for axis in axes for key in axis.keys if key not in (VARIANT, COEFFICIENTS))
        raise InputError(
            f"equilibrate.along: {unknown[0]}: must be a swept key{nearest(unknown[0], swept.split(', '))}"
        )
    plan = Plan(
        name,
        path,
        text,
        main.overrides,
        axes,
        chosen,
        study.output,
        study.cluster,
        variants,
        study.equilibrate,
        draws,
    )
    if study.equilibrate is not None:
        known = {key for axis in axes for key in axis.keys}
        removed = [key for key in study.equilibrate.remove if key not in known]
        _refuse_absent_in_all(variants or (main,), study.equilibrate.set, removed)
    runs = math.prod(plan.shape)
    if runs > MOST_RUNS:
        raise InputError(f"{runs} runs: a study can have {MOST_RUNS} at most")
    return plan


def _columns(draws: Draws) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Keys of drawn coefficients, and the values of each."""
    return zip(draws.keys, zip(*draws.values, strict=True), strict=True)


def _drawn(base: Base, number: int) -> Draws:
    """Coefficients drawn from the errors of a case."""

    def case_with(changes: Sequence[str]) -> CaseSections:
        return case_file.of_text(base.text, base.path, (*base.overrides, *changes)).case

    def allowed(changes: Sequence[str]) -> bool:
        try:
            case_with(changes)
        except InputError:  # the case itself is in order: coefficients are beyond the limits of a law
            return False
        return True

    return drawn(case_with([]), number, allowed)


def _base(path: Path, text: str, raw: dict[str, Any], changes: Sequence[str], output: StudyOutput) -> Base:
    """A case with what every run changes of it; `raw`, its keys, is changed, too."""
    for assignment in changes:
        case_file.override(raw, assignment)
    return Base(text, path, (*changes, *_output_overrides(raw, output)))


def _variants(study: StudyFile, main: Base, changes: Sequence[str], folder: Path) -> tuple[Base, ...]:
    """The cases of the variants of a study; paths start from its folder."""
    names = [each.name for each in study.variants]
    if twice := [name for i, name in enumerate(names) if name in names[:i]]:
        raise InputError(f"variants: two are called {json.dumps(twice[0])}")
    found = []
    for each in study.variants:
        path = main.path
        if each.case is not None:
            path = folder / each.case if Path(each.case).suffix else shipped.find(each.case)
        try:
            text, raw = case_file.load(path)
            _refuse_absent(raw, [*changes, *each.set], each.remove)
            found.append(_base(path, text, raw, [*changes, *each.changes], study.output))
        except InputError as error:
            raise InputError(f"variants: {each.name}: {error}") from None
    return tuple(found)


def _refuse_absent(raw: Mapping[str, Any], changes: Sequence[str], keys: Sequence[str]) -> None:
    """Raise InputError for the first of the keys that a parsed case, changed so, does not have."""
    changed = copy.deepcopy(dict(raw))
    for each in changes:
        case_file.override(changed, each)
    for key in keys:
        node: Any = changed
        for step in case_file.parse_assignment(f"{key}=")[0]:
            near = nearest(str(step), [*node]) if isinstance(node, dict) else ""
            try:
                node = node[step]
            except (KeyError, IndexError, TypeError):
                raise InputError(f"remove: {key}: there is no such key in the case{near}") from None


def _refuse_absent_in_all(bases: Sequence[Base], changes: Sequence[str], keys: Sequence[str]) -> None:
    """Raise InputError for the first of the keys to remove for `equilibrate` that none of the cases has."""
    for key in keys:
        errors = []
        for base in bases:
            try:
                raw = case_file.load_text(base.text, base.path)
                _refuse_absent(raw, [*base.overrides, *changes], [key])
            except InputError as error:
                errors.append(error)
        if len(errors) == len(bases):
            raise InputError(f"equilibrate: {errors[0]}") from None


def axis_of(text: str) -> dict[str, Any]:
    """Keys that vary together, from "KEY=1,2,3", "KEY=0.1:0.9:5" or "KEY=0.1:10:5:log", several parted by ";".

    Examples
    --------
    >>> axis_of("material[0].e_n=0.7,0.8,0.9")
    {'material[0].e_n': [0.7, 0.8, 0.9]}
    >>> axis_of("material[0].mu=0.1:10:3:log")
    {'material[0].mu': {'from': 0.1, 'to': 10, 'number': 3, 'spacing': 'log'}}
    """
    found: dict[str, Any] = {}
    for part in text.split(";"):
        key, equals, values = (each.strip() for each in part.partition("="))
        if not (key and equals and values):
            such = "such as material[0].e_n=0.7,0.8,0.9 or material[0].mu=0.1:0.5:5"
            raise InputError(f"{option_name('--vary', 'vary:')} {text}: must be KEY=VALUES, {such}")
        if key in found:
            raise InputError(f"{option_name('--vary', 'vary:')} {text}: {key} is given twice")
        number = r"[-+\d.eE_]+"
        if match := re.fullmatch(rf"({number}):({number}):(\d+)(?::(linear|log))?", values):
            start, to = (_toml(each, each) for each in match.group(1, 2))
            found[key] = {"from": start, "to": to, "number": int(match[3]), "spacing": match[4] or "linear"}
        else:
            found[key] = _toml(f"[{values}]", [each.strip() for each in values.split(",")])
    return found


def _toml(value: str, other: Any) -> Any:
    """A value in the form of TOML; `other` for None."""
    try:
        return other if "\n" in value else case_file.parsed(f"v = {value}")["v"]
    except InputError:
        return other


def _values(key: str, given: Any) -> list[Any]:
    """The values of a key, from a list or a range."""
    if isinstance(given, dict):
        try:
            values: list[Any] = Range.model_validate(given).values()
        except ValidationError as error:
            raise InputError("\n".join(f"{key}: {line}" for line in _lines(error, Range))) from None
    elif isinstance(given, list):
        values = given
    else:
        text = "must be a list of values, or a range { from = 0.1, to = 0.9, number = 5 }"
        raise InputError(f"{key}: {text}")
    texts = [json.dumps(each) for each in values]
    if not values:
        raise InputError(f"{key}: must have one value or more")
    if twice := [each for i, each in enumerate(texts) if each in texts[:i]]:
        raise InputError(f"{key}: {twice[0]} is given twice")
    return values


def _axes(groups: list[dict[str, list[Any]]]) -> tuple[Axis, ...]:
    keys = [key for group in groups for key in group]
    tokens = {key: [each.replace("[", "").replace("]", "") for each in key.split(".")] for key in keys}
    for i, key in enumerate(keys):
        case_file.parse_assignment(f"{key}=0")  # which refuses what is no key
        if key in keys[:i]:
            raise InputError(f"{key}: two axes of this name; it can vary along one")
        own = "the study's own [output] sets what is kept" if key.startswith("output") else None
        if reason := FIXED.get(key, own):
            raise InputError(f"{key}: cannot be swept: {reason}")
    names: dict[str, str] = {}
    for key in keys:
        for length in range(1, len(tokens[key]) + 1):
            name = "_".join(tokens[key][-length:])
            same = [other for other in keys if "_".join(tokens[other][-length:]) == name]
            if (len(same) == 1 and name not in RESERVED) or length == len(tokens[key]):
                names[key] = name
                break
    axes = []
    for group in groups:
        lengths = {key: len(values) for key, values in group.items()}
        if len({*lengths.values()}) > 1:
            counts = ", ".join(f"{key} has {count}" for key, count in lengths.items())
            raise InputError(f"keys that vary together need as many values each: {counts}")
        if group:
            values = tuple(zip(*group.values(), strict=True))
            axes.append(Axis(tuple(names[key] for key in group), tuple(group), values))
    return tuple(axes)


def _seeds(given: Any, first: int) -> tuple[int, ...]:
    shown = shortened(given)
    need = f"seeds = {shown}: must be a number of seeds, 1 or more, or a list such as 1,2,5"
    if isinstance(given, str):
        parts = [checked.whole_of(each) for each in given.split(",")]
        if None in parts:
            raise InputError(need)
        given = parts[0] if len(parts) == 1 else parts
    if checked.is_integer(given):
        if not 1 <= given <= MOST_RUNS:
            raise InputError(need)
        return tuple(range(first, first + given))
    if not isinstance(given, list) or not all(map(checked.is_integer, given)):
        raise InputError(need)
    if not given or len({*given}) < len(given) or not all(0 <= each < 2**63 for each in given):
        raise InputError(f"seeds = {shown}: must be integers, 0 or more, each once")
    return tuple(given)


def _number(case: dict[str, Any], key: str) -> float:
    """A number of [run] in an unchecked case; 0 if it has none."""
    section = case.get("run")
    value: Any = section.get(key) if isinstance(section, dict) else None
    return value if checked.is_number(value) else 0


def _output_overrides(case: dict[str, Any], output: StudyOutput) -> Iterator[str]:
    """Changes of the case's [output] by a study: rows of series at the same places in every run, no pictures."""
    given = case.get("output")
    given = given if isinstance(given, dict) else {}
    replaced = [*CADENCES[:2]]
    if output.analyses_at:
        replaced += ["frames", *CADENCES[3:6]]
    yield from (f"output.{key}=" for key in replaced if key in given)
    yield f"output.series={output.series or given.get('series') or ROWS}"
    if output.series_spacing:
        yield f'output.series_spacing="{output.series_spacing}"'
    yield "output.picture=false"
    if not output.trajectories:
        yield "output.views=false"
    at = output.analyses_at
    if at and not output.analyses:
        raise InputError("analyses_at requires analyses")
    start = output.analyses_from
    t_end, per_disk = (_number(case, key) for key in ("t_end", "collisions_per_disk"))
    if start is not None and (end := t_end or per_disk) and not start < end:
        raise InputError(f"analyses_from = {start:g}: must be before {end:g}, the end of the run")
    if at and (end := t_end or per_disk):  # else `check` reports the error
        if not 0.0 <= min(at) <= max(at) <= end:
            raise InputError(f"analyses_at = {at}: the run goes from 0 to {end:g}")
        parts = [Fraction(str(each)) for each in at if each > 0.0]
        share = math.lcm(*(each.denominator for each in parts))
        step = Fraction(math.gcd(*(int(each * share) for each in parts)), share)
        step = step or Fraction(str(t_end or per_disk))
        if max(at) / step > MOST_FRAMES:
            text = f"frames at every {float(step):g} would be needed, more than {MOST_FRAMES}"
            raise InputError(f"analyses_at = {at}: {text}; multiples of one number need fewer")
        yield f"output.frames_{'interval' if t_end else 'collisions'}={float(step)}"


def _checked(raw: dict[str, Any], path: Path) -> StudyFile:
    try:
        return StudyFile.model_validate(raw)
    except ValidationError as error:
        raise InputError(listed([f"{path}: {line}" for line in _lines(error)])) from None


def _lines(error: ValidationError, model: type[BaseModel] = StudyFile) -> Iterator[str]:
    """A line for each mistake."""
    sections = {
        name: type(StudyFile.model_fields[name].default) for name in ("ensemble", "output", "cluster")
    }
    for each in error.errors(include_url=False):
        location = spelled([step for step in each["loc"] if step not in ("int", "float")])
        text = str(each["msg"]).replace("Input should", "must").replace("be a valid", "be a")
        if each["type"] == "extra_forbidden":
            *above, last = map(str, each["loc"])
            fields = sections.get(".".join(above), model).model_fields
            known = [one.alias or name for name, one in fields.items()]
            text = f"unknown key{nearest(last, known)}; known here: {', '.join(known)}"
        elif each["type"] == "missing":
            text = "missing" + (
                ": the case file, or the name of a shipped case" if location == "case" else ""
            )
        elif each["type"] == "literal_error":
            allowed = re.findall(r"'([^']+)'", each["ctx"]["expected"])
            text = f"must be {checked.Choice(tuple(allowed)).instead_of(each['input'])}"
        value = each["input"]
        if each["type"] not in ("extra_forbidden", "missing") and isinstance(value, str | int | float):
            location += f" = {cut(json.dumps(value))}" * bool(location)
        yield f"{location}: {text}" if location else text


def _digest(path: Path) -> str:
    try:
        with text_file.opened(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
