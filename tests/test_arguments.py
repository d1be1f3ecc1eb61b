"""Nonsense as an argument of every public name: an InputError that names it, or a finite result; nothing else."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import ifrdem
from ifrdem import Device, InputError, analysis, theory
from ifrdem.theory.driven_gas import Drive

LAW = ifrdem.IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2)
SMOOTH = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
DISKS = ifrdem.Disks(4, mass=1.0, radius=0.5)
RNG = np.random.default_rng(1)
TIMES = np.linspace(0.0, 4.0, 9)
PATHS = np.cumsum(RNG.normal(size=(9, 5, 2)), axis=0)
POINTS = 10.0 * RNG.random((400, 2))
VELOCITY = RNG.normal(size=(400, 2))
SPIN = RNG.normal(size=400)
SIDES = (10.0, 10.0)
BOX = ifrdem.Box(SIDES)
MIXTURE = theory.Mixture([1.0, 4.0], [0.5, 1.0], SMOOTH, 0.2)
TWO = {"T0": [1.0, 2.0], "T_rot0": [0.5, 0.5], "times": [0.0, 1.0]}
GAS = {"law": LAW, "mass": 1.0, "radius": 0.5, "k": 2.0}
MODES = {"law": SMOOTH, "radius": 0.5, "packing_fraction": 0.2, "k": 2.0}
COLLISIONS = {
    "time": np.linspace(0.0, 9.0, 50), "normal": np.tile([1.0, 0.0], (50, 1)),
    "impulse": np.tile([2.0, 0.0], (50, 1)), "distance": np.ones(50),
}  # fmt: skip

THEORY: dict[str, dict[str, Any]] = {
    "Mixture": {"mass": [1.0, 4.0], "radius": [0.5, 1.0], "law": SMOOTH, "packing_fraction": 0.2, "k": 2.0,
                "fraction": [1.0, 2.0], "contact": "virial"},
    "changes_per_collision": {"theta": 0.5, "law": LAW, "k": 2.0},
    "checked_times": {"times": [0.0, 1.0]},
    "clustering_length": {"e_n": 0.9, "radius": 0.5, "packing_fraction": 0.2},
    "collision_factor": {"a_2": 0.1},
    "collision_rate": {"packing_fraction": 0.2, "T": 1.0, "mass": 1.0, "radius": 0.5, "g": 1.2},
    "compressibility": {"packing_fraction": 0.2, "radius": [0.5, 1.0], "fraction": [1.0, 2.0],
                        "contact": "virial"},
    "contact_value": {"packing_fraction": 0.2},
    "cooling": {**GAS, "packing_fraction": 0.2, "T0": 1.0, "T_rot0": 0.5, "times": [0.0, 1.0]},
    "cooling_factor": {"a_2": 0.1},
    "cooling_rates": {"T": 1.0, "T_rot": 0.5, **GAS, "number_density": 0.1},
    "cooling_ratio": {"law": LAW, "k": 2.0, "theta0": 0.5},
    "cooling_ratios": {"law": LAW, "k": 2.0},
    "cooling_sonine": {"e_n": 0.9},
    "haff": {"T0": 1.0, "e_n": 0.9, "rate0": 1.0, "times": [0.0, 1.0]},
    "haff_time": {"e_n": 0.9, "rate0": 1.0},
    "heated_sonine": {"e_n": 0.9},
    "henderson": {"packing_fraction": 0.2},
    "mean_free_path": {"packing_fraction": 0.2, "radius": 0.5},
    "mixture_collision_rates": {"T": [1.0, 2.0], "mass": [1.0, 4.0], "radius": [0.5, 1.0],
                                "number_density": [0.1, 0.1], "g": np.ones((2, 2))},
    "mixture_contact_values": {"packing_fraction": 0.2, "radius": [0.5, 1.0], "fraction": [1.0, 2.0],
                               "contact": "virial"},
    "mixture_cooling": {"mixture": MIXTURE, **TWO},
    "mixture_cooling_rates": {"mixture": MIXTURE, "T": [1.0, 2.0], "T_rot": [0.5, 0.5]},
    "mixture_driven": {"mixture": MIXTURE, "drives": [Drive(power=0.1), Drive(power=0.2)], **TWO},
    "prediction": {"disks": DISKS, "law": SMOOTH, "packing_fraction": 0.2, "T0": 1.0, "T_rot0": 0.5,
                   "times": [0.0, 1.0], "forces": (), "shear_rate": 0.0},
    "rough_rates": {"theta": 0.5, "e_n": 0.9, "beta": 0.5, "k": 2.0},
    "shear_length": {**MODES, "theta": 0.5},
    "shear_mode_energy": {"collisions_per_disk": 2.0, **MODES, "box": (50.0, 50.0), "theta0": 0.5},
    "shear_mode_time": {"law": SMOOTH, "mass": 1.0, "radius": 0.5, "packing_fraction": 0.2,
                        "box": (50.0, 50.0), "T0": 1.0, "share": 0.02, "k": 2.0, "theta0": 0.5},
    "shear_viscosity": {"packing_fraction": 0.2, "T": 1.0, "mass": 1.0, "radius": 0.5, "law": LAW, "k": 2.0,
                        "theta": 0.5},
    "sonine_coefficient": {"velocity": VELOCITY},
    "thermal_conductivity": {"packing_fraction": 0.2, "T": 1.0, "mass": 1.0, "radius": 0.5},
}  # fmt: skip
MSD = analysis.mean_square_displacement(TIMES, PATHS)
ANALYSIS: dict[str, dict[str, Any]] = {
    "clusters": {"position": POINTS, "box": BOX, "radius": 0.1, "gap": 0.1, "time": 0.0},
    "coarse_grain": {"position": POINTS, "velocity": VELOCITY, "spin": SPIN, "box": SIDES, "cells": (2, 2),
                     "mass": 1.0, "radius": 0.1, "inertia": 0.1, "width": 0.0},
    "compressibility": {"packing_fraction": 0.2, "contact": 1.2, "e_n": 0.9},
    "contact_from_rate": {"rate": 1.0, "packing_fraction": 0.2, "temperature": 1.0, "mass": 1.0,
                          "radius": 0.5},
    "contact_value": {"position": POINTS, "box": SIDES, "radius": 0.5, "time": 0.0},
    "correlation_time": {"series": TIMES},
    "diffusion_coefficient": {"msd": MSD, "first": 0.5, "last": 3.0},
    "gaussian": {"c": 1.0},
    "haff_fit": {"time": TIMES, "temperature": (1.0 + TIMES) ** -2.0 * (1.0 + 0.01 * RNG.normal(size=9)),
                 "first": 0.0, "last": 4.0, "disks": 100},
    "hexatic": {"position": POINTS, "box": SIDES, "neighbours": "nearest", "time": 0.0},
    "impacts": {"psi": np.linspace(0.0, 1.5, 50), "regime": np.ones(50, dtype=int), "bins": 5},
    "mean_square_displacement": {"times": TIMES, "paths": PATHS, "origins": "all", "most_lags": 5},
    "mean_with_error": {"series": TIMES},
    "pair_correlation": {"position": POINTS, "box": SIDES, "r_max": 3.0, "bins": 10, "r_min": 0.0,
                         "time": 0.0},
    "pressure_from_impulses": {**COLLISIONS, "span": (0.0, 10.0), "area": 100.0, "disks": 10, "tracked": 10,
                               "temperature": 1.0},
    "ratio_fit": {"x": TIMES, "theta": 0.6 - 0.5 * np.exp(-TIMES) + 0.01 * RNG.normal(size=9), "first": 0.0,
                  "last": 4.0, "disks": 100},
    "sonine_density": {"c": 1.0, "a2": 0.1},
    "structure_factor": {"position": POINTS, "box": SIDES, "k_max": 5.0, "rings": 5, "time": 0.0},
    "unwrap": {"position": np.full((3, 2, 2), 0.5), "box": SIDES, "image": np.zeros((3, 2, 2), dtype=int),
               "velocity": np.zeros((3, 2, 2)), "times": 0.0},
    "velocity_autocorrelation": {"times": TIMES, "velocity": PATHS, "origins": "all", "most_lags": 5},
    "velocity_distribution": {"velocity": VELOCITY, "spin": SPIN, "mass": 1.0, "inertia": 1.0, "bins": 11,
                              "widest": 5.0},
}  # fmt: skip
RADIUS = [0.5] * 4
STATE = ifrdem.State([[1.0, 1.0], [3.0, 1.0], [1.0, 3.0], [3.0, 3.0]], np.zeros((4, 2)), np.zeros(4))
SMALL = ifrdem.Box((10.0, 10.0))
WALL = ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0))
PLACED = {"box": SMALL, "radius": RADIUS, "walls": (), "comm": None}
INITIAL: dict[str, dict[str, Any]] = {
    "gaussian_spins": {"n": 4, "spin_rms": 1.0, "seed": 1, "comm": None},
    "grow": {"box": SMALL, "radius": RADIUS, "seed": 1, "walls": (), "progress": lambda _: None},
    "hexagonal_positions": {**PLACED, "seed": 1},
    "maxwellian": {"mass": [1.0] * 4, "speed_rms": 1.0, "temperature": None, "seed": 1, "comm": None},
    "random_positions": {**PLACED, "seed": 1},
    "separate": {**PLACED, "position": STATE.position, "time": 0.0},
}
SAMPLED = {"n": 4, "seed": 1, "comm": None}
RADII: dict[str, dict[str, Any]] = {
    "bidisperse": {**SAMPLED, "low": 0.5, "high": 0.7, "large_fraction": 0.5},
    "check": {"distribution": "uniform", "low": 0.5, "high": 0.7},
    "gaussian": {**SAMPLED, "mean": 0.5, "deviation": 0.05, "low": 0.4, "high": 0.6},
    "lognormal": {**SAMPLED, "mean": 0.5, "deviation": 0.05, "low": 0.4, "high": 0.6},
    "of_ids": {"distribution": "uniform", "n": 4, "ids": range(2), "seed": 1, "low": 0.5, "high": 0.7},
    "sample": {"distribution": "uniform", **SAMPLED, "low": 0.5, "high": 0.7},
    "uniform": {**SAMPLED, "low": 0.5, "high": 0.7},
    "wrong_parameters": {"distribution": "uniform", "given": {"low": 0.5}},
}
FORCES: dict[str, dict[str, Any]] = {
    "Drag": {"step": 0.1, "rate": 0.1, "quadratic": 0.1, "spin_rate": 0.1},
    "Force": {"step": 0.1, "parameters": [1.0]},
    "Langevin": {"step": 0.1, "temperature": 1.0, "rate": 0.1, "spin_temperature": 1.0, "spin_rate": 0.1},
    "RandomKicks": {"step": 0.1, "power": 0.1, "diffusion": None},
    "Rescale": {"step": 0.1, "temperature": 1.0, "energy": None},
    "SpinKicks": {"step": 0.1, "power": 0.1, "diffusion": None},
    "TableFriction": {"step": 0.1, "mu": 0.1, "gravity": 9.8},
}
MEASURE = ifrdem.observables.measure(DISKS, STATE)
OBSERVABLES: dict[str, dict[str, Any]] = {
    "drift_text": {"velocity": [1.0, 0.0]},
    "from_totals": {"disks": DISKS, "totals": np.ones(9), "time": 1.0, "wall_hits": 0,
                    "about_mean": (True, True)},
    "measure": {"disks": DISKS, "state": STATE, "energy_input": 0.0, "wall_work": 0.0, "wall_heat": 0.0,
                "gravity": (0.0, 0.0), "dissipated": np.zeros(7), "regimes": np.zeros(5, dtype=int),
                "about_mean": (True, True)},
    "sums": {"disks": DISKS, "state": STATE, "gravity": (0.0, 0.0), "comm": None},
}  # fmt: skip
WALLS: dict[str, Any] = {
    "material": 0,
    "motion": ifrdem.Motion(),
    "turn": ifrdem.Turn(),
    "moves_from": None,
    "moves_until": None,
    "opens_at": None,
    "opens_after": None,
    "surface_speed": 0.0,
    "temperature": None,
    "group": "",
    "piston": None,
}
POINTS_OF_WALL = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]


class Elastic(ifrdem.CollisionLaw):
    """A law of one coefficient."""

    coefficients = ("e_n",)

    @staticmethod
    def collide(pair: Any, coefficients: Any) -> tuple[Any, Any, Any]:
        return (1.0 + coefficients[0]) * pair.m_n * pair.g_n, 0.0, 0.0


IFRDEM: dict[str, dict[str, Any]] = {
    "Box": {"lengths": (3.0, 2.0), "periodic": (True, True), "shear_rate": 0.0},
    "Box.from_packing_fraction": {"radius": RADIUS, "packing_fraction": 0.2, "aspect": 1.0, "shear_rate": 0.0,
                                  "comm": None},
    "Box.packing_fraction": {"self": SMALL, "radius": RADIUS},
    "Box.flow": {"self": SMALL, "position": POINTS},
    "Box.image_above": {"self": SMALL, "time": 1.0},
    "Box.wrap": {"self": SMALL, "position": POINTS, "time": 1.0},
    "Box.minimum_image": {"self": SMALL, "difference": POINTS, "time": 1.0},
    "Box.unwrap": {"self": SMALL, "position": POINTS, "image": np.zeros((400, 2), dtype=int), "time": 1.0},
    "CollisionLaw": {},
    "Disks": {"n": 2, "mass": [1.0, 2.0], "radius": 0.5, "k": 2.0, "material": [0, 1]},
    "IFRLaw": {"e_n": 0.9, "e_t": -0.8, "mu": 0.2, "sticking": "contact_point", "rho": 0.0, "k": 2.0},
    "IFRLaw.admissibility": {"self": LAW, "k_i": 2.0, "k_j": 2.0, "m_i": 1.0, "m_j": 1.0},
    "IFRLaw.check": {"self": LAW, "k_i": 2.0, "k_j": 2.0, "m_i": 1.0, "m_j": 1.0},
    "Ledger": {"first": MEASURE, "latest": MEASURE, "frames": 1},
    "Ledger.observables": {"self": ifrdem.Ledger(), "measure": MEASURE},
    "Ledger.row": {"self": ifrdem.Ledger(), "measure": MEASURE},
    "Motion": {"kind": "sawtooth", "direction": (0.0, 1.0), "speed": 0.0, "amplitude": 0.1, "frequency": 1.0,
               "phase": 0.0, "rise": 0.5},
    "Motion.displacement": {"self": ifrdem.Motion("steady", speed=1.0), "t": 1.0},
    "Piston": {"mass": 1.0, "force": 0.1, "spring": 0.1, "displacement": 0.1, "velocity": 0.1, "low": -1.0,
               "high": 1.0},
    "Piston.energy": {"self": ifrdem.Piston(1.0), "displacement": 1.0, "velocity": 1.0, "pull": 0.0},
    "State": {"position": np.ones((2, 2)), "velocity": np.ones((2, 2)), "spin": [0.0, 0.0], "time": 0.0,
              "collisions": [0, 0], "image": np.zeros((2, 2), dtype=int), "wall_hits": [0, 0],
              "latest_collision": [0.0, 0.0], "last_partner": [-1, -1], "angle": [0.0, 0.0],
              "dissipated": np.zeros((2, 7)), "flow": np.zeros((2, 2)), "asleep": [0, 0]},
    "Study": {"path": "cooling", "vary": (), "set": (), "seeds": 2, "output": None},
    "Turn": {"kind": "sine", "center": (0.0, 0.0), "rate": 1.0, "amplitude": 1.0, "frequency": 1.0, "phase": 0.0},
    "Turn.angle": {"self": ifrdem.Turn("steady", rate=1.0), "t": 1.0},
    "Wall": {"shape": "arc", "place": (1.0, 1.0), "towards": (0.0, 1.0), "radius": 1.0, "angles": (0.0, 1.0),
             "points": (), "holds": "both", **WALLS},
    "Wall.line": {"point": (0.0, 0.0), "normal": (0.0, 1.0), **WALLS},
    "Wall.segment": {"start": (0.0, 0.0), "end": (0.0, 1.0), **WALLS},
    "Wall.container": {"center": (0.0, 0.0), "radius": 1.0, **WALLS},
    "Wall.post": {"center": (0.0, 0.0), "radius": 1.0, **WALLS},
    "Wall.arc": {"center": (0.0, 0.0), "radius": 1.0, "angles": (0.0, 1.0), **WALLS},
    "Wall.polyline": {"points": POINTS_OF_WALL, "scale": 1.0, **WALLS},
    "Wall.polygon": {"points": POINTS_OF_WALL, "holds": "both", "scale": 1.0, **WALLS},
    "WallSums": {"walls": [WALL], "values": np.zeros((1, 6))},
    "collide": {"law": LAW, "normal": [1.0, 0.0], "mass": [1.0, 1.0], "radius": [0.5, 0.5], "k": [2.0, 2.0],
                "velocity": [[1.0, 0.0], [0.0, 0.0]], "spin": [0.0, 0.0]},
    "slice_of": {"n": 10, "comm": None},
}  # fmt: skip
FIT: dict[str, dict[str, Any]] = {
    "Disk": {"mass": [1.0, 2.0], "radius": 0.5, "k": 2.0},
    "Form": {"columns": {}, "units": {}, "known": {}, "delimiter": ",", "decimal": "."},
    "Pair": {"M": 0.5, "k_1": 2.0, "k_2": 2.0, "R_1": 1.0, "R_2": 1.0},
    "Walton": {"e_n": 0.9, "beta": 0.5, "mu": 0.2},
    "example": {"seed": 1},
    "own": {"kind": Elastic, "ranges": {"e_n": (0.0, 1.0)}},
}  # fmt: skip
MODULES: dict[ModuleType, dict[str, dict[str, Any]]] = {
    theory: THEORY, analysis: ANALYSIS, ifrdem.initial: INITIAL, ifrdem.initial.radii: RADII,
    ifrdem.forces: FORCES, ifrdem.observables: OBSERVABLES, ifrdem.fit: FIT, ifrdem: IFRDEM,
}  # fmt: skip
"""Module -> public name, or a class's method, -> arguments of one valid call."""

OTHERS: dict[ModuleType, set[str]] = {
    theory: {"CoolingRatio", "MixtureTemperatures", "Prediction", "ShearModes"},
    analysis: {"Clusters", "ContactValue", "Correlation", "Diffusion", "Fields", "HaffFit", "Hexatic", "Impacts",
               "PairCorrelation", "Pressure", "RatioFit", "SonineCoefficients", "StructureFactor",
               "VelocityDistribution"},
    ifrdem.forces: {"normals", "number", "uniforms"},
    ifrdem.observables: {"Measure"},
    # Tables of data are checked line by line, and what takes a fit by its own tests (`tests/fit`).
    ifrdem.fit: {"Collisions", "Data", "Design", "Estimate", "Fit", "Fitted", "Interval", "Law", "as_json", "design",
                 "draws", "fit", "material", "read", "table"},
    # Of files and gases below; the writer of parts has options of the writer.
    ifrdem: {"DSMC", "History", "PartsWriter", "Regime", "Simulation", "Trajectory", "TrajectoryWriter", "concat",
             "view"},
}  # fmt: skip
"""Public names without a call here: classes that functions return and users do not make, and some others."""


def nonsense() -> Iterator[tuple[str, Any]]:
    """Values that hardly any argument may have, by name."""
    yield from (
        ("nan", math.nan), ("inf", math.inf), ("-inf", -math.inf), ("-1", -1), ("0", 0), ("1j", 1j),
        ("text", "nonsense"), ("bytes", b"x"), ("None", None), ("[]", []), ("{}", {}), ("object", object()),
        ("True", True), ("10**400", 10**400), ("-10**400", -(10**400)),
        ("5e-324", 5e-324), ("1e300", 1e300), ("masked", np.ma.masked_array([1.0, 2.0], [False, True])),
        ("masked number", np.ma.masked), ("shape", np.zeros((2, 3, 4, 5))), ("objects", np.array([None, "x"])),
        ("nan array", np.full((2, 2), np.nan)), ("class", int), ("generator", (object() for _ in range(3))),
        ("ragged", [[1.0, 2.0], [3.0]]),
    )  # fmt: skip


NONSENSE = [name for name, _ in nonsense()]


def numbers(result: Any) -> Iterator[float]:
    """All numbers in a result."""
    if isinstance(result, np.ndarray):
        if result.dtype.kind in "fc":
            yield from np.abs(np.asarray(result)).ravel().tolist()
    elif isinstance(result, float | complex | np.number):
        yield abs(result)
    elif dataclasses.is_dataclass(result):
        yield from numbers([getattr(result, each.name) for each in dataclasses.fields(result)])
    elif isinstance(result, Mapping):
        yield from numbers(list(result.values()))
    elif isinstance(result, list | tuple):
        for each in result:
            yield from numbers(each)


def wrong_answers(call: Callable[..., Any], arguments: Mapping[str, Any]) -> list[str]:
    """Kinds of nonsense to which a call answers by something else than a result without nan or an InputError."""
    wrong = []
    known = sum(math.isnan(each) for each in numbers(called(call, arguments)))  # as of empty cells
    for name in arguments.keys() - {"self"}:
        for kind, value in nonsense():
            if kind == "class" and callable(arguments[name]):
                continue
            try:
                found = called(call, {**arguments, name: value})
            except InputError as error:
                if name not in str(error) and not (kind == "text" and "nonsense" in str(error)):
                    wrong.append(f"{name} = {kind}: not named: {error}")
            except Exception as error:  # reported: only InputError is an answer to nonsense
                wrong.append(f"{name} = {kind}: {type(error).__name__}")
            else:
                if sum(math.isnan(each) for each in numbers(found)) > known:
                    wrong.append(f"{name} = {kind}: nan")
    return wrong


def called(call: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ifrdem.TheoryWarning)
        warnings.simplefilter("ignore", ifrdem.EnergyWarning)
        return call(**arguments)


def public(module: ModuleType, name: str) -> Callable[..., Any]:
    """A public function, class, or method, "Class.method"."""
    found: Any = module
    for part in name.split("."):
        found = getattr(found, part)
    return found


CALLS = [(module.__name__, name) for module, calls in MODULES.items() for name in calls]


@pytest.mark.parametrize(("module", "name"), CALLS)
def test_nonsense_is_refused_by_the_name_of_its_argument(module: str, name: str) -> None:
    found = next(each for each in MODULES if each.__name__ == module)
    assert wrong_answers(public(found, name), MODULES[found][name]) == []


def public_names(module: ModuleType) -> set[str]:
    """Names of public functions and classes, but errors and warnings."""
    given = getattr(module, "__all__", None) if module is not ifrdem else dir(ifrdem)
    found = set()
    for name in given or [name for name, each in vars(module).items() if _made_in(each, module)]:
        each = getattr(module, name)
        error = isinstance(each, type) and issubclass(each, BaseException)
        if callable(each) and not name.startswith("_") and not error:
            found.add(name)
    return found


def _made_in(each: Any, module: ModuleType) -> bool:
    return getattr(each, "__module__", None) == module.__name__ and hasattr(each, "__qualname__")


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_every_public_name_has_a_valid_call_with_all_of_its_arguments(module: ModuleType) -> None:
    """A new public name needs one: or nonsense in its arguments is not tried."""
    called_ones = {name for name in MODULES[module] if "." not in name}
    assert public_names(module) - OTHERS.get(module, set()) == called_ones
    for name, arguments in MODULES[module].items():
        parameters = inspect.signature(public(module, name)).parameters.values()
        known = {each.name for each in parameters if each.kind is not each.VAR_KEYWORD}
        assert known <= set(arguments), name


def small_file(folder: Path) -> str:
    """A trajectory of three frames of four disks."""
    path = str(folder / "small.h5")
    with ifrdem.TrajectoryWriter(
        path, DISKS, SMALL, fields=("position", "velocity", "angular_velocity")
    ) as file:
        for time in (0.0, 1.0, 2.0):
            state = dataclasses.replace(STATE, time=time)
            measure = ifrdem.observables.measure(DISKS, state)
            names = ("temperature", "rotational_temperature", "energy", "collisions")
            file.write(state, {name: getattr(measure, name) for name in names})
    return path


def of_files(folder: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Calls that need a file, by name; what writes one is given another name each time."""
    path = small_file(folder)
    run = ifrdem.Trajectory(path)
    names = itertools.count()

    def written(**arguments: Any) -> None:
        arguments.setdefault("path", folder / f"{next(names)}.h5")
        with ifrdem.TrajectoryWriter(**arguments):
            pass

    file = ifrdem.TrajectoryWriter(folder / "written.h5", DISKS, SMALL)

    def write(state: Any, observables: Any) -> None:
        own = dataclasses.replace(state, time=float(next(names))) if state is STATE else state
        file.write(state=own, observables=observables)

    writer: dict[str, Any] = {
        "disks": DISKS, "box": SMALL, "fields": ("position",), "parameters": {"a": 1}, "units": None,
        "precision": "f4", "compression": "none", "force": False, "walls": (), "within": None,
    }  # fmt: skip
    return {
        "Trajectory": (ifrdem.Trajectory, {"path": path}),
        "Trajectory.__getitem__": (lambda frame: run[frame], {"frame": 0}),
        "Trajectory.disk": (run.disk, {"disk": 0}),
        "Trajectory.to_pandas": (run.to_pandas, {"which": "observables", "index": -1}),
        "TrajectoryWriter": (written, writer),
        "TrajectoryWriter.write": (write, {"state": STATE, "observables": {"a": 1.0}}),
        "concat": (ifrdem.concat, {"trajectories": [path]}),
        "plots.figure": (ifrdem.plots.figure, {"trajectory": run, "what": "temperatures", "frames": [0, 1],
                                               "over": "t", "color": None, "make": Figure}),
        "view": (ifrdem.view, {"trajectory": run, "frames": [0], "height": 640}),
    }  # fmt: skip


@pytest.mark.parametrize("name", [
    "Trajectory", "Trajectory.__getitem__", "Trajectory.disk", "Trajectory.to_pandas", "TrajectoryWriter",
    "TrajectoryWriter.write", "concat", "plots.figure", "view",
])  # fmt: skip
def test_nonsense_for_files_is_refused_by_the_name_of_its_argument(name: str, tmp_path: Path) -> None:
    assert wrong_answers(*of_files(tmp_path)[name]) == []


def of_gases() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Calls of simulations, by name: none of them moves a gas."""
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)

    def gas(**options: Any) -> ifrdem.Simulation:
        given = {
            "disks": DISKS,
            "box": SMALL,
            "law": law,
            "state": STATE,
            "device": Device(threads=1),
            **options,
        }
        return ifrdem.Simulation(**given)

    def dsmc(**options: Any) -> ifrdem.DSMC:
        given = {
            "disks": DISKS,
            "law": law,
            "packing_fraction": 0.1,
            "velocity": np.ones((4, 2)),
            "device": Device(threads=1),
        }
        return ifrdem.DSMC(**{**given, **options})

    made = gas()
    simulation: dict[str, Any] = {
        "disks": DISKS, "box": SMALL, "law": law, "state": STATE, "walls": (), "gravity": (0.0, 0.0),
        "forces": (), "collapse": None, "device": Device(threads=1), "record": (), "tracked": (), "seed": 0,
        "comm": None, "sliced": False,
    }  # fmt: skip
    return {
        "DSMC": (dsmc, {"disks": DISKS, "law": law, "packing_fraction": 0.1, "velocity": np.ones((4, 2)),
                        "spin": None, "seed": 0, "species": None, "drive": None, "contact": "virial",
                        "device": "cpu"}),
        "Simulation": (gas, simulation),
        "Simulation.run": (lambda **given: gas().run(**given), {
            "t_end": 0.0, "frames": 1, "observers": (), "series": None, "samplers": (), "progress": None,
        }),
        "Simulation.set_law": (made.set_law, {"law": law}),
        "Simulation.set_forces": (made.set_forces, {"forces": ()}),
        "Simulation.set_gravity": (made.set_gravity, {"gravity": (0.0, 0.0)}),
        "Simulation.set_velocities": (made.set_velocities, {"velocity": np.zeros((4, 2)), "spin": np.zeros(4)}),
        "Simulation.load_checkpoint": (made.load_checkpoint, {"path": "none.npz"}),
    }  # fmt: skip


@pytest.mark.parametrize("name", [
    "DSMC", "Simulation", "Simulation.run", "Simulation.set_law", "Simulation.set_forces",
    "Simulation.set_gravity", "Simulation.set_velocities", "Simulation.load_checkpoint",
])  # fmt: skip
def test_nonsense_for_gases_is_refused_by_the_name_of_its_argument(name: str) -> None:
    call, arguments = of_gases()[name]
    wrong = []
    for key in arguments:
        for kind, value in nonsense():
            try:
                called(call, {**arguments, key: value})
            except InputError as error:
                if key not in str(error) and not (
                    name == "Simulation.load_checkpoint" and "nonsense" in str(error)
                ):
                    wrong.append(f"{key} = {kind}: not named: {error}")
            except Exception as error:  # reported: only InputError is an answer to nonsense
                wrong.append(f"{key} = {kind}: {type(error).__name__}")
    assert wrong == []


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: analysis.diffusion_coefficient(MSD, first=1j), "first = 1j: must be a finite number"),
        (lambda: analysis.velocity_distribution(VELOCITY, SPIN, mass=math.nan), "mass = nan: must be positive"),
        (lambda: analysis.velocity_distribution(np.ma.masked_array(VELOCITY), SPIN), "velocity is a masked array"),
        (lambda: analysis.coarse_grain(POINTS, VELOCITY, box=BOX, cells=(2, 2), mass=math.inf),
         "mass = inf: must be positive"),
        (lambda: analysis.pressure_from_impulses(**{**ANALYSIS["pressure_from_impulses"], "distance": [math.nan]}),
         r"distance\[0\] = nan: must be positive"),
        (lambda: ifrdem.fit.Disk(mass=-1, radius=1.0), "mass = -1.0: must be positive"),
        (lambda: theory.haff(1.0, 2, 1.0, [0.0]), "e_n = 2: must be a number from 0 to 1"),
        (lambda: theory.cooling_rates(**{**THEORY["cooling_rates"], "T": 5e-324}), "T = 5e-324: must be positive"),
        (lambda: ifrdem.Ledger(object()), "first = <object object.*: must be a Measure"),
        (lambda: theory.haff_time(-1, 1), "e_n = -1: must be a number from 0 to 1"),
        (lambda: analysis.contact_from_rate(**{**ANALYSIS["contact_from_rate"], "packing_fraction": 0}),
         "packing_fraction = 0: must be a number above 0"),
        (lambda: ifrdem.initial.radii.lognormal(10**400, mean=1.0, deviation=0.1, seed=1),
         "n = an int of 1329 bits: must be an integer from 0 to"),
        (lambda: theory.contact_value(10**400), "packing_fraction = an int of 1329 bits"),
    ],
)  # fmt: skip
def test_nonsense_that_was_taken_before_is_named(call: Callable[[], Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        call()


@pytest.mark.parametrize("value", [np.float32("inf"), np.float16("inf"), np.float32(0.0), np.float32("nan")])
def test_numbers_of_short_types_of_numpy_are_held_to_the_same_bounds(value: Any) -> None:
    """NumPy rounds bounds to the type of its own numbers: 1e100 to inf, 1e-100 to 0."""
    for call in (
        lambda: ifrdem.theory.mean_free_path(0.2, value),
        lambda: ifrdem.Piston(mass=value),
        lambda: ifrdem.Box.from_packing_fraction([0.5], 0.2, value),
    ):
        with pytest.raises(InputError):
            call()
    law = ifrdem.IFRLaw(e_n=np.float32(0.5), e_t=-1, mu=0)
    assert (type(law.e_n), law.e_n) == (float, 0.5)
