"""The results of a study: one data set over its swept keys, seeds and rows, as NetCDF-4 and for xarray."""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from ..analysis.common import mean_errors
from ..analysis.gas_theory import MOST_KINDS, VELOCITIES, TheoryGas
from ..analysis.window import any_drives, becomes_steady, since
from ..case import file as case_file
from ..case.case import UNITS, CaseSections
from ..case.file import CaseFile
from ..case.gas import CaseGas
from ..case.keys import about
from ..errors import DamageError, InputError, NameMissing, TheoryError, counted, there_are
from ..model.laws.ifr import EnergyWarning
from ..model.state import kinds_of
from ..quantities import AXES, NUMBER, SERIES, SPECIES_SERIES
from ..theory.choose import is_closed
from ..theory.mixtures import MixtureTemperatures
from ..tools import files
from ..tools.checked import is_number
from ..tools.files import NO_VALUES
from ..tools.intervals import PERCENT, student_t
from ..tools.versions import __version__, revision
from ..trajectory.descriptions import REDUCED
from ..trajectory.file import new_file
from ..trajectory.tables import optional_import
from . import reading
from .draws import COEFFICIENTS
from .plan import VARIANT, Plan, with_labels
from .task import AT, NOTES, WARNINGS, Task, Variable, along, grown, load
from .windows import SAME_RUN, window_of

if TYPE_CHECKING:
    import xarray

SEED = "seed"
ROWS = ("time", "collisions_per_disk")
"""Dimensions of series."""
ENDING, RUNS = ".nc", ".runs"
"""Endings of the file of results, and of the folder of runs next to it."""
THEORY = ("temperature", "rotational_temperature", "theta")
"""Predictions of kinetic theory for a gas."""
PARTS = (*AXES, "species", "region")
"""Dimensions of a quantity that several numbers make up: curves or panels, as swept keys are."""
START, N_EFF, RUN_ERROR = "analyses_from", "_n_eff", "_run_error"
"""Variable with the start of averages over time of each point; endings of numbers of independent values, and of
standard errors within a run."""
WINDOWED = f"temperature{N_EFF}"
"""Variable that is finite at points that have a steady window."""
SERIES_FROM = "series_from"
"""Variable of means over rows (`averaged`): where they begin."""
SHORT = {"T": "temperature", "T_rot": "rotational_temperature", "tau": "collisions_per_disk", "t": "time"}
"""Symbols for names, on the command line and on axes."""
BY_COEFFICIENTS = "_by_coefficients"
"""Ending of what errors of coefficients make of the spread (`pooled`)."""
HALF_INTERVAL = "_half_interval"
"""Ending of half the 95 % interval of a prediction, by both parts of its spread."""
STATISTICS = {
    BY_COEFFICIENTS: ": standard deviation by errors of coefficients",
    HALF_INTERVAL: f": half the {PERCENT} interval, by seeds and errors of coefficients",
    N_EFF: ": number of independent values with the same error, in the window of a run",
    RUN_ERROR: ": standard error within a run, over its window",
    "_theory": ": kinetic theory",
    "_error": ": standard error of the mean over seeds",
    "_mean": ": mean over seeds",
    "": "",
}
"""Text on each ending of a quantity's name."""
TEXTS = {
    SEED: "seed of the random numbers", AT: "where frames are analysed", "time": "time",
    "collisions_per_disk": "collisions per disk so far, mean over all disks", "run": "name of the file of the run",
    "theta": "rotational over translational temperature", "failure": "message of a run that failed",
    "runs": "number of finished runs", "axis": "axes of vectors", "species": "names of the species", "region": "names of the regions",
    "component": "components of the pressure tensor", "mechanism": "mechanisms of dissipation",
    "regime": "regimes of collisions", VARIANT: "variants of the case",
    COEFFICIENTS: "drawn sets of coefficients", START: "where averages over time begin",
    SERIES_FROM: "where means over rows begin",
    WARNINGS: "warnings of the analyses of each run", NOTES: "notes of the analyses of each run",
}  # fmt: skip
"""Text on variables that are no quantities of the whole gas."""
BEYOND, NOT_FAR_BEYOND = 10.0, 1.25
"""Times the end of the runs, to which theory is followed: it may need longer for as many collisions. DSMC of a gas that
does not cool is followed less far, for it has as many collisions all the time."""


@dataclass
class Results:
    """Variables by name, of which those that are called like a dimension are its coordinates; and texts about them.

    A quantity `temperature` has the dimensions of the study, seeds and rows; with it are stored its mean over seeds,
    `temperature_mean`, the standard error of that, `temperature_error`, and, where a theory holds,
    `temperature_theory`.
    """

    variables: dict[str, Variable] = field(default_factory=dict)
    attributes: dict[str, str] = field(default_factory=dict)

    @property
    def quantities(self) -> list[str]:
        """Names of what has a mean over seeds."""
        return [name.removesuffix("_mean") for name in self.variables if name.endswith("_mean")]

    @property
    def texts(self) -> dict[str, str]:
        """The names of numbers of analyses as these print them."""
        found: dict[str, str] = json.loads(self.attributes.get("texts", "{}"))
        return found

    @property
    def axes(self) -> dict[str, list[str]]:
        """The names of the keys that vary along each swept dimension, which is called like the first of them."""
        found: dict[str, list[str]] = json.loads(self.attributes["axes"])
        return found

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of values along the swept dimensions."""
        return tuple(len(self.values(axis)) for axis in self.axes)

    @property
    def row_axis(self) -> str:
        """The dimension of series: what ends the runs. InputError if the results have none."""
        for name in ROWS:
            if name in self.variables and self.variables[name].dims == (name,):
                return name
        raise InputError(f"the results have no rows: must have the variable {' or '.join(ROWS)} along itself")

    @property
    def row_places(self) -> NDArray[Any]:
        """Places of the rows of series, in what ends the runs."""
        return self.variables[self.row_axis].values

    def values(self, name: str) -> NDArray[Any]:
        """The values of a variable.

        Raises InputError if there is none of this name (also a KeyError).
        """
        if name not in self.variables:
            raise NameMissing(f"the results hold no {name!r}{there_are(name, self.variables)}")
        return self.variables[name].values

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a NetCDF-4 file, which is one of HDF5; it appears whole or not at all.

        Raises InputError if it cannot be written.
        """
        sizes: dict[str, int] = {}
        for one in self.variables.values():
            sizes |= dict(zip(one.dims, one.values.shape, strict=True))

        def fill(aside: Path) -> None:
            with new_file(aside, track_order=True) as file:
                scales: dict[str, h5py.Dataset] = {}
                for dim, size in sizes.items():  # netCDF-4's own notation for an axis with or without values
                    if dim in self.variables:
                        scales[dim] = _dataset(file, dim, self.variables[dim], self._texts(dim))
                        scales[dim].make_scale(dim)
                    else:
                        scales[dim] = file.create_dataset(dim, shape=(size,), dtype=">f4")
                        scales[dim].make_scale(f"{NO_VALUES}{size:10d}")
                for name, one in self.variables.items():
                    if name not in sizes:
                        dataset = _dataset(file, name, one, self._texts(name))
                        for axis, dim in zip(dataset.dims, one.dims, strict=True):
                            axis.attach_scale(scales[dim])
                for name, text in self.attributes.items():
                    file.attrs[name] = text

        files.write_aside(Path(path), fill)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Results:
        """The results in a file that `write` made.

        Another process opens it, because HDF5 can crash on damaged files.

        Raises InputError if it is no such file, or damaged (`DamageError`).
        """
        attributes, variables = reading.read(path)
        return cls({name: Variable(*each) for name, each in variables.items()}, attributes)

    def _texts(self, name: str) -> dict[str, str]:
        """The attributes of a variable: `units` ("1" for a pure number, none for texts) and `long_name`."""
        one, keys = self.variables[name], json.loads(self.attributes.get("keys", "{}"))
        texts = TEXTS | self.texts
        of_case = name in keys and name not in (VARIANT, COEFFICIENTS)
        text = about(keys[name])[0] if of_case else texts.get(name)
        for suffix, statistic in STATISTICS.items():
            if text is None and name.endswith(suffix):
                stem = name.removesuffix(suffix)
                described = SERIES[stem].text if stem in SERIES else texts.get(stem, stem.replace("_", " "))
                text = described + statistic
        units = {} if one.values.dtype.kind in "UO" else {"units": one.unit or NUMBER}
        return units | {"long_name": text or name}

    def to_xarray(self) -> xarray.Dataset:
        """The results as an xarray data set (extra `analysis`), with `units` and `long_name` in `attrs`."""
        xarray = optional_import("xarray", "analysis")
        swept = {name for names in self.axes.values() for name in names}
        made = {
            name: xarray.Variable(one.dims, one.values, self._texts(name))
            for name, one in self.variables.items()
        }
        coordinates = {name: one for name, one in made.items() if (name,) == one.dims or name in swept}
        others = {name: one for name, one in made.items() if name not in coordinates}
        return xarray.Dataset(others, coordinates, self.attributes)


def _dataset(file: h5py.File, name: str, one: Variable, texts: Mapping[str, str]) -> h5py.Dataset:
    if one.values.dtype.kind in "UO":
        found = file.create_dataset(name, data=one.values.astype(object), dtype=h5py.string_dtype())
    else:
        big = {"compression": "gzip", "shuffle": True} if one.values.nbytes > 100_000 else {}
        found = file.create_dataset(name, data=one.values, **big)
    for attribute, text in texts.items():
        found.attrs[attribute] = text
    return found


def collect(
    plan: Plan, good: Mapping[tuple[int, ...], CaseSections], tasks: Iterable[Task], failed: Mapping[str, str]
) -> Results:
    """The results of all finished runs; others are nan, and failed ones have a message."""
    case = next(iter(good.values()))
    row_axis, positions = along(case)
    variables: dict[str, Variable] = {}
    swept, reduced = tuple(axis.names[0] for axis in plan.axes), case.run.units == REDUCED
    for axis in plan.axes:
        for name, values in zip(axis.names, zip(*axis.values, strict=True), strict=True):
            unit = about(dict(zip(axis.names, axis.keys, strict=True))[name], reduced=reduced)[1]
            variables[name] = Variable((axis.names[0],), _coordinate(values), unit)
    variables[SEED] = Variable((SEED,), np.array(plan.seeds))
    names = AXES | ({"species": tuple(each.name for each in case.species)} if len(case.species) > 1 else {})
    names |= {"region": tuple(case.output.regions)} if case.output.regions else {}
    for name, parts in names.items():
        variables[name] = Variable((name,), np.array(parts))
    if plan.output.analyses_at:
        variables[AT] = Variable((AT,), np.array(plan.output.analyses_at))
    texts = {name: np.full(plan.shape, "", dtype=object) for name in ("run", "failure", WARNINGS, NOTES)}
    loaded: dict[tuple[int, ...], dict[int, dict[str, Variable]]] = {}
    for task in tasks:
        texts["run"][task.index] = task.key
        texts["failure"][task.index] = failed.get(task.key, "")
        if not task.result.exists():
            continue
        try:
            loaded.setdefault(task.index[:-1], {})[task.index[-1]] = load(task.result)[0]
        except DamageError as error:
            texts["failure"][task.index] = str(error)
    windows = {
        point: window_of(
            row_axis,
            positions,
            of_seeds,
            plan.output.analyses_from,
            names.get("species", ()),
            steady=_has_window(good[point], of_seeds),
        )
        for point, of_seeds in loaded.items()
    }
    found: dict[str, Variable] = {}
    starts, effective = np.full(plan.shape[:-1], np.nan), np.full(plan.shape, np.nan)
    for point, window in windows.items():
        starts[point] = window.start
        for seed, result in loaded[point].items():
            at = (*point, seed)
            effective[at] = window.effective.get(seed, np.nan)
            for name, one in window.of_run(seed, result).items():
                if name in texts:
                    texts[name][at] = str(one.values)
                    continue
                shape = (*plan.shape, *one.values.shape)
                whole = found.get(name) or Variable(
                    (*swept, SEED, *one.dims), np.full(shape, np.nan), one.unit
                )
                room = grown(whole.values, shape)
                corner: Any = (*at, *(slice(size) for size in one.values.shape))
                room[corner] = one.values
                found[name] = Variable(whole.dims, room, one.unit, one.text)
    unit = UNITS[case.run.units]["time"] if row_axis == "time" else ""
    variables[row_axis] = Variable((row_axis,), positions, unit)
    variables |= {name: Variable((*swept, SEED), each) for name, each in texts.items()}
    if plan.output.has_averages or np.isfinite(effective).any():
        variables[START] = Variable(swept, starts, unit)
    if np.isfinite(effective).any():
        variables[WINDOWED] = Variable((*swept, SEED), effective)
    variables |= means_over_seeds(
        found, len(swept), [point for point, each in windows.items() if SAME_RUN in each.marks]
    )
    attributes: dict[str, str] = {}
    if "temperature" in found:
        variables["runs"] = Variable(swept, np.isfinite(found["temperature"].values[..., 0]).sum(axis=-1))
        cases = {point: (each, plan.base(point).path.parent) for point, each in good.items()}
        theory, attributes[VELOCITY_WORDS] = _theory(
            cases, row_axis, variables, equilibrated=plan.first is not None
        )
        variables |= theory
    used = {dim for one in variables.values() for dim in one.dims if len(one.dims) > 1} | {SEED, row_axis}
    keys = [each for axis in plan.axes for each in zip(axis.names, axis.keys, strict=True)]
    attributes |= {
        "title": f"{plan.name}: {counted(math.prod(plan.shape[:-1]), 'point')}, {counted(len(plan.seeds), 'seed')}",
        "axes": json.dumps({axis.names[0]: axis.names for axis in plan.axes}),
        "keys": json.dumps(dict(keys)),
        "texts": json.dumps({name: one.text for name, one in found.items() if one.text}),
        "case": plan.text,
        "path": str(plan.path.resolve()),
        "overrides": "\n".join(plan.overrides),
        **_bases(plan),
        **({} if plan.output.analyses_from is None else {GIVEN_START: f"{plan.output.analyses_from:g}"}),
        **({} if plan.draws is None else {COEFFICIENTS: plan.draws.text}),
        "ifrdem": __version__,
        "git": revision(),
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    kept = {name for name, one in variables.items() if len(one.dims) != 1 or one.dims[0] in {*used, *swept}}
    return Results({name: one for name, one in variables.items() if name in kept}, attributes)


def _bases(plan: Plan) -> dict[str, str]:
    """Attributes on the variants of a study, and on whether its runs begin with the last frames of others."""
    found = {} if plan.first is None else {EQUILIBRATED: plan.first.model_dump_json()}
    if plan.variants:
        bases = [(each.text, str(each.path.resolve()), each.overrides) for each in plan.variants]
        found[VARIANTS] = json.dumps(bases)
    return found


EQUILIBRATED, VARIANTS, VELOCITY_WORDS = "equilibrate", "variants", "velocities_of_theory"
GIVEN_START = "given_analyses_from"
"""Attributes of results: the equilibration of the runs; text, path and changes of the case of each variant; which
velocities kinetic theory takes; where the study sets that averages over time begin."""


def _has_window(case: CaseSections, results: Mapping[int, Mapping[str, Variable]]) -> bool:
    """`becomes_steady` of the gas of a point."""
    driven = any_drives({name: one.values for name, one in each.items()} for each in results.values())
    walled = bool(case.wall) or (case.walled and not case.box.open)
    return becomes_steady(case.box.shear_rate, walled=walled, driven=driven)


def _coordinate(values: tuple[Any, ...]) -> NDArray[Any]:
    number = all(is_number(each) for each in values)
    texts = (each if number or isinstance(each, str) else json.dumps(each) for each in values)
    return np.array(list(texts))


def means_over_seeds(
    found: Mapping[str, Variable], over: int, alike: Sequence[tuple[int, ...]] = ()
) -> dict[str, Variable]:
    """Each variable, its mean over seeds and the standard error of that, without runs that are missing.

    Points whose seeds give the same run (`alike`) have no error.
    """
    made = {}
    for name, one in found.items():
        dims, values, unit, _ = one
        finite = np.isfinite(values)
        count = finite.sum(axis=over)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(finite, values, 0.0).sum(axis=over) / count
            spread = np.where(finite, values - np.expand_dims(mean, over), 0.0)
            error = np.sqrt((spread**2).sum(axis=over) / (count - 1) / count)
        for point in alike:
            error[point] = np.nan
        less = dims[:over] + dims[over + 1 :]
        made[name] = one
        made[f"{name}_mean"] = Variable(less, mean, unit)
        made[f"{name}_error"] = Variable(less, np.where(count > 1, error, np.nan), unit)
    return made


def _theory(
    cases: Mapping[tuple[int, ...], tuple[CaseSections, Path]], row_axis: str, variables: Mapping[str, Variable], *,
    equilibrated: bool,
) -> tuple[dict[str, Variable], str]:  # fmt: skip
    """Temperatures of each point by kinetic theory, at the places of the rows, nan where it does not hold; and words.

    These say which velocities it takes, such as "Gaussian, Sonine" for the one at some points, the other at others.
    """
    T = variables["temperature_mean"]
    made = {name: np.full(T.values.shape, np.nan) for name in THEORY}
    velocities: set[str] = set()
    for point, (case, folder) in cases.items():
        times = variables["time"].values if row_axis == "time" else variables["time_mean"].values[point]
        if not np.isfinite(T.values[point]).any():
            continue
        start = _measured_start(point, variables) if equilibrated else None
        curves = predicted(case, folder, float(np.nanmax(times)), start)
        if curves is None:
            continue
        when, tau, T_theory, T_rot, words, _ = curves
        velocities.add(words)
        base = when if row_axis == "time" else tau
        positions = variables[row_axis].values
        inside = positions <= base[-1]
        made["temperature"][point][inside] = np.interp(positions[inside], base, T_theory)
        made["rotational_temperature"][point][inside] = np.interp(positions[inside], base, T_rot)
    with np.errstate(divide="ignore", invalid="ignore"):
        made["theta"] = made["rotational_temperature"] / made["temperature"]
    if not np.isfinite(made["temperature"]).any():
        return {}, ""
    words = ", ".join(sorted(velocities))
    found = {name: Variable(T.dims, values, variables[name].unit) for name, values in made.items()}
    return {f"{name}_theory": one for name, one in found.items()}, words


def _measured_start(
    point: tuple[int, ...], variables: Mapping[str, Variable]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """T and T_rot of each species in the first row, mean over seeds: of runs that begin with the end of others."""
    whole = ("temperature", "rotational_temperature")
    names = SPECIES_SERIES[:2] if f"{SPECIES_SERIES[0]}_mean" in variables else whole
    T, T_rot = (np.atleast_1d(variables[f"{name}_mean"].values[point][0]) for name in names)
    return T, T_rot


def stored_case(results: Results, fixed: Mapping[str, int], *more: str) -> CaseFile:
    """The case of positions on swept dimensions, with more changes; InputError if a file that it needs is gone."""
    keys = json.loads(results.attributes["keys"])
    text, path = results.attributes["case"], results.attributes["path"]
    changes = [line for line in results.attributes["overrides"].splitlines() if line]
    if VARIANT in fixed:
        text, path, changes = json.loads(results.attributes[VARIANTS])[fixed[VARIANT]]
    for dim, i in fixed.items():
        if dim != VARIANT:
            swept = [
                one for one in results.axes[dim] if one != COEFFICIENTS
            ]  # theory is that of the best ones
            changes += [f"{keys[one]}={_assigned(results.values(one)[i])}" for one in swept]
    return case_file.of_text(text, Path(path), (*changes, *more), stored=True)


def with_theory(results: Results) -> Results:
    """Results with the temperatures of the theory that is in use (`PREDICT`), in place of those that are stored.

    Raises InputError if the results know no case, or a file that a case needs is gone.
    """
    if "path" not in results.attributes or "temperature_mean" not in results.variables:
        raise InputError("the results hold no case of their gas, from which theory would begin")
    shape = results.shape
    points = {at: stored_case(results, dict(zip(results.axes, at, strict=True))) for at in np.ndindex(shape)}
    cases = {at: (file.case, file.path.parent) for at, file in points.items()}
    equilibrated = EQUILIBRATED in results.attributes
    theory, words = _theory(cases, results.row_axis, results.variables, equilibrated=equilibrated)
    kept = {
        name: one
        for name, one in results.variables.items()
        if name not in {f"{each}_theory" for each in THEORY}
    }
    return Results(kept | theory, results.attributes | {VELOCITY_WORDS: words})


def theory_of(results: Results, name: str) -> Variable | None:
    """Kinetic theory of a quantity, if there is one: of the gas, or of an analysis."""
    names = (f"{name}_theory_mean", f"{name}_by_theory_mean", f"{name}_enskog_mean", f"{name}_theory")
    return next((results.variables[each] for each in names if each in results.variables), None)


def _assigned(value: Any) -> str:
    return json.dumps(value.item() if isinstance(value, np.generic) else value)


def row_weights(places: NDArray[np.float64], start: float) -> NDArray[np.float64]:
    """Weights of rows in a mean from a place on, each the distance from the row before; the last row alone for nan."""
    if np.isfinite(start):
        weights = np.where(since(places, start), np.diff(places, prepend=places[0]), 0.0)
    else:
        weights = np.where(np.arange(len(places)) == len(places) - 1, 1.0, 0.0)
    return np.asarray(weights)


class Predicted(NamedTuple):
    """Kinetic theory of a gas: times [time], collisions per disk, T and T_rot [energy]; which velocities it takes; and of
    each kind of disks, None in a flow."""

    times: NDArray[np.float64]
    collisions_per_disk: NDArray[np.float64]
    temperature: NDArray[np.float64]
    rotational_temperature: NDArray[np.float64]
    velocities: str
    species: MixtureTemperatures | None


def predicted(
    case: CaseSections, folder: Path, end: float, start: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
) -> Predicted | None:  # fmt: skip
    """Temperatures by kinetic theory, to beyond a time [time]; None where it holds not.

    `start` are T and T_rot of each species at the start, if not those of the case [energy].
    """
    if end <= 0.0 or (gas := gas_of_case(case, folder, start)) is None:
        return None
    driven = bool(case.force or case.box.shear_rate)
    later = np.linspace(0.0, 1.0, 1500)[1:] if driven else np.geomspace(1e-5, 1.0, 1500)
    beyond = NOT_FAR_BEYOND if driven and not is_closed() else BEYOND
    steps = beyond * end * np.r_[0.0, later]
    try:
        found = gas.prediction(steps, case.box.shear_rate)
    except (InputError, TheoryError):  # rolling friction, forces that are not linear, ...: there is no theory
        return None
    of_all = found.collisions_per_disk, found.temperature, found.rotational_temperature
    return Predicted(steps, *of_all, VELOCITIES[found.velocities], found.species)


def gas_of_case(
    case: CaseSections, folder: Path, start: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
) -> TheoryGas | None:
    """The gas of a case for kinetic theory; None where it is not homogeneous, or has too many kinds of disks.

    `start` as for `predicted`.
    """
    made = CaseGas.from_case(case, folder)
    if not case.homogeneous or made.box.is_open:
        return None
    numbers = [each.number for each in made.species]
    with warnings.catch_warnings(action="ignore", category=EnergyWarning):
        disks, laws = made.disks, made.law_table
    which = kinds_of(disks)
    if (kinds := int(which.max()) + 1) > MOST_KINDS:
        return None
    speed, spin = (
        np.repeat([getattr(each, name) for each in made.species], numbers)
        for name in ("speed_rms", "spin_rms")
    )
    energies = [0.5 * disks.mass * speed**2, disks.inertia * spin**2]
    if start is not None:
        energies = [np.repeat(each, numbers) for each in start]
    T0, T_rot0 = (np.array([each[which == kind].mean() for kind in range(kinds)]) for each in energies)
    forces = [each.model_dump(exclude_none=True) for each in case.force]
    return TheoryGas(disks, laws, made.box.packing_fraction(disks.radius), T0, T_rot0, forces, which)


def averaged(results: Results, start: float | None = None, option: str = "start") -> Results:
    """Results whose series are means of each run over its rows from a place on, in what ends the runs.

    Without `start`, the place is the steady window of each point (`window_starts`); points without one have the last
    row. So have quantities that add up over the run. A row counts with the distance from the one before, because rows
    may be spaced logarithmically. Of each mean over rows, NAME_run_error and NAME_n_eff are its standard error within a
    run and the number of independent values behind it; where a point has a single seed, that is the error of NAME_mean.
    `option` is the name of `start` in the message. Raises InputError if no row after the first is as late.
    """
    row_axis, places = results.row_axis, results.row_places
    shape = results.shape
    starts = window_starts(results) if start is None else np.full(shape, start)
    weights = np.zeros((*shape, len(places)))
    for at in np.ndindex(shape):
        if np.isfinite(starts[at]):
            weights[at] = row_weights(places, float(starts[at]))
    if start is not None and not weights.any():
        raise InputError(f"{option} {start:g}: must be at most {places[-1]:g}, the last row of {row_axis}")
    kept, series, within = {}, {}, {}
    for name, one in results.variables.items():
        if row_axis not in one.dims or name == row_axis:
            kept[name] = one
        elif SEED in one.dims and f"{name}_mean" in results.variables:
            mean, *errors = _over_window(one, row_axis, places, weights, last=name in ADDING)
            series[name] = mean
            within[name] = errors
        elif name.endswith("_theory"):
            kept[name] = _over_window(one, row_axis, places, weights)[0]
    found = kept | means_over_seeds(series, len(shape), _same_points(results))
    if np.isfinite(starts).any():
        found[SERIES_FROM] = Variable(tuple(results.axes), starts, results.variables[row_axis].unit)
    for name, (error, n_eff) in within.items():
        found |= {f"{name}{RUN_ERROR}": error, f"{name}{N_EFF}": n_eff}
        one = found[f"{name}_error"]
        single = np.isfinite(series[name].values).sum(axis=len(shape)) == 1
        own = np.nanmax(
            np.where(np.isfinite(error.values), error.values, -np.inf), axis=len(shape), initial=-np.inf
        )
        found[f"{name}_error"] = one._replace(values=np.where(single & np.isfinite(own), own, one.values))
    return Results(found, results.attributes)


ADDING = {name for name, each in SERIES.items() if each.adds_up} | {*ROWS}
"""Series that add up over the run, whose value is that at its end."""


def window_starts(results: Results) -> NDArray[np.float64]:
    """Places from which series of each point are averaged, in what ends the runs; nan where it has no window.

    A point has one if its gas is driven, sheared or between walls, or if the study sets analyses_from.
    """
    shape = results.shape
    n_eff = results.variables.get(WINDOWED)
    if START not in results.variables or n_eff is None:  # cooling gases, or of another version
        return np.full(shape, np.nan)
    known = np.isfinite(n_eff.values).any(axis=len(shape))
    return np.where(known, results.values(START), np.nan)


def _over_window(
    one: Variable, row_axis: str, places: NDArray[np.float64], weights: NDArray[np.float64], *, last: bool = False
) -> tuple[Variable, Variable, Variable]:  # fmt: skip
    """Mean of a variable over the rows that have weights, (points..., rows), its error within a run, and n_eff.

    Rows without a value in any run, such as the first one of stresses, are left out. Where no row has a weight, and
    with `last`, it is the last row with a value, without an error.
    """
    axis, points = one.dims.index(row_axis), weights.ndim - 1
    values = np.moveaxis(one.values, axis, points)  # points, rows, seeds, components
    shape = (*values.shape[:points], *values.shape[points + 1 :])
    mean, error, n_eff = (np.full(shape, np.nan) for _ in range(3))
    for at in np.ndindex(values.shape[:points]):
        rows = values[at]
        known = np.isfinite(rows).any(axis=tuple(range(1, rows.ndim)))
        used = known & (weights[at] > 0.0) & (not last)
        if used.any():
            mean[at] = np.average(rows[used], axis=0, weights=weights[at][used])
            error[at], n_eff[at] = mean_errors(_at_even_places(places[used], rows[used]))
        elif known.any():
            mean[at] = rows[np.flatnonzero(known)[-1]]
    dims = one.dims[:axis] + one.dims[axis + 1 :]
    return one._replace(dims=dims, values=mean), Variable(dims, error, one.unit), Variable(dims, n_eff)


def _at_even_places(places: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows at places of equal distance, interpolated if they are not there, as rows of a logarithmic spacing are not."""
    steps = np.diff(places)
    if len(steps) < 2 or np.ptp(steps) <= 0.5 * np.mean(steps):
        return rows
    even = np.linspace(places[0], places[-1], len(places))
    columns = [np.interp(even, places, column) for column in rows.reshape(len(places), -1).T]
    return np.stack(columns, axis=1).reshape(rows.shape)


def _same_points(results: Results) -> list[tuple[int, ...]]:
    """Points whose seeds give the same run."""
    if WARNINGS not in results.variables:
        return []
    texts = results.values(WARNINGS)
    return sorted({at[:-1] for at in np.ndindex(texts.shape) if SAME_RUN in str(texts[at])})


def warnings_of(results: Results) -> list[str]:
    """Lines on the number of runs with warnings of analyses, and their texts; empty if none has."""
    if WARNINGS not in results.variables:
        return []  # of another version
    runs: dict[str, list[str]] = {}
    texts, count = results.values(WARNINGS), 0
    for at in np.ndindex(texts.shape):
        if not (lines := str(texts[at]).splitlines()):
            continue
        count += 1
        pairs = [
            f"{key} = {results.values(key)[i]}"
            for i, names in zip(at, results.axes.values(), strict=False)
            for key in names
        ]
        label = ", ".join((*pairs, f"seed {results.values(SEED)[at[-1]]}"))
        for line in dict.fromkeys(lines):
            runs.setdefault(line, []).append(label)
    if not count:
        return []
    shown = with_labels(runs, 0)
    more = [f"and {len(shown) - MOST_SHOWN} more"] if len(shown) > MOST_SHOWN else []
    return [f"{count} of {counted(texts.size, 'run')} with warnings", *shown[:MOST_SHOWN], *more]


MOST_SHOWN = 8
"""Warnings that are shown."""


def half_interval(results: Results, name: str) -> NDArray[np.float64] | None:
    """Half the 95 % interval of the mean of a quantity, by Student's t over its seeds.

    Of a single seed, by n_eff of its mean over rows where it has one (`averaged`), else nan. None for quantities of no
    seeds.
    """
    if f"{name}_error" not in results.variables:
        return None
    count: NDArray[Any] = finite_seeds(results, name)
    if f"{name}{RUN_ERROR}" in results.variables:
        over = results.variables[name].dims.index(SEED)
        known = np.isfinite(results.values(name))
        n_eff = np.where(known, results.values(f"{name}{N_EFF}"), 0.0).sum(axis=over)  # of a single seed
        count = np.where(count == 1, n_eff, count)
    return np.asarray(student_t(count) * results.values(f"{name}_error"))  # nan for a single seed


def finite_seeds(results: Results, name: str) -> NDArray[np.int64]:
    """Number of seeds behind each mean of a quantity."""
    values, dims = results.values(name), results.variables[name].dims
    if SEED not in dims or results.variables[f"{name}_error"].dims != tuple(
        dim for dim in dims if dim != SEED
    ):
        raise InputError(f"{name}: must have the dimension {SEED} and those of {name}_error")
    return np.asarray(np.isfinite(values).sum(axis=dims.index(SEED)))
