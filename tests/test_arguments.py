"""Nonsense as an argument of every public name: an InputError that names it, or a finite result; nothing else."""

from __future__ import annotations

import ast
import builtins
import dataclasses
import functools
import importlib
import inspect
import itertools
import json
import math
import pkgutil
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.layout_files import add_histories
from support.layout_files import write as write_layout
from typing_extensions import TypeAliasType

import ifrdem
from ifrdem import Device, InputError, analysis, bullet, theory
from ifrdem.errors import TheoryError
from ifrdem.model.laws.pairs import PairLaws
from ifrdem.plots import impact_angles
from ifrdem.theory.driven_gas import Driving
from ifrdem.tools import checked
from ifrdem.tools.checked import check_of

Scalar = TypeVar("Scalar", bound=np.generic)

LAW = ifrdem.IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2)
SMOOTH = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
DISKS = ifrdem.Disks(4, mass=1.0, radius=0.5)
TWO_MATERIALS = ifrdem.Disks(2, mass=1.0, radius=0.5, material=[0, 1])
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
    "contact_value": {"packing_fraction": 0.2, "contact": "henderson"},
    "cooling": {**GAS, "packing_fraction": 0.2, "T0": 1.0, "T_rot0": 0.5, "times": [0.0, 1.0]},
    "cooling_factor": {"a_2": 0.1},
    "cooling_rates": {"T": 1.0, "T_rot": 0.5, **GAS, "number_density": 0.1},
    "cooling_ratio": {"law": LAW, "k": 2.0, "theta0": 0.5},
    "cooling_ratios": {"law": LAW, "k": 2.0},
    "cooling_sonine": {"e_n": 0.9},
    "haff": {"T0": 1.0, "e_n": 0.9, "rate0": 1.0, "times": [0.0, 1.0]},
    "haff_time": {"e_n": 0.9, "rate0": 1.0},
    "heated_sonine": {"e_n": 0.9, "kick_energy": 0.1},
    "mean_free_path": {"packing_fraction": 0.2, "radius": 0.5},
    "mixture_collision_rates": {"T": [1.0, 2.0], "mass": [1.0, 4.0], "radius": [0.5, 1.0],
                                "number_density": [0.1, 0.1], "g": np.ones((2, 2))},
    "mixture_contact_values": {"packing_fraction": 0.2, "radius": [0.5, 1.0], "fraction": [1.0, 2.0],
                               "contact": "virial"},
    "mixture_cooling": {"mixture": MIXTURE, **TWO},
    "mixture_cooling_ratios": {"mixture": MIXTURE, "theta0": 1.0},
    "mixture_cooling_rates": {"mixture": MIXTURE, "T": [1.0, 2.0], "T_rot": [0.5, 0.5]},
    "mixture_driven": {"mixture": MIXTURE, "driving": [Driving(power=0.1), Driving(power=0.2)], **TWO},
    "prediction": {"disks": DISKS, "law": SMOOTH, "packing_fraction": 0.2, "T0": 1.0, "T_rot0": 0.5,
                   "times": [0.0, 1.0], "forces": (), "shear_rate": 0.0, "velocities": "best"},
    "constant_beta": {"law": SMOOTH, "k": 2.0},
    "Driving": {"power": 0.1, "spin_power": 0.2, "rate": 0.3, "spin_rate": 0.4},
    "rough_cooling": {"e_n": 0.9, "beta": 0.5, "mass": 1.0, "radius": 0.5, "k": 2.0, "packing_fraction": 0.1,
                      "T0": 1.0, "T_rot0": 0.5, "times": [0.0, 1.0]},
    "rough_sonine": {"e_n": 0.9, "beta": 0.5, "k": 2.0},
    "rough_rates": {"theta": 0.5, "e_n": 0.9, "beta": 0.5, "k": 2.0},
    "self_diffusion": {"e_n": 0.9},
    "shear_length": {**MODES, "theta": 0.5},
    "shear_mode_energy": {"collisions_per_disk": 2.0, **MODES, "box": (50.0, 50.0), "theta0": 0.5},
    "shear_mode_time": {"law": SMOOTH, "mass": 1.0, "radius": 0.5, "packing_fraction": 0.2,
                        "box": (50.0, 50.0), "T0": 1.0, "share": 0.02, "k": 2.0, "theta0": 0.5},
    "shear_viscosity": {"packing_fraction": 0.2, "T": 1.0, "mass": 1.0, "radius": 0.5, "law": LAW, "k": 2.0,
                        "theta": 0.5},
    "sonine_coefficient": {"velocity": VELOCITY},
    "steady_flow": {"law": SMOOTH, "mass": 1.0, "radius": 0.5, "k": 2.0, "packing_fraction": 0.2,
                    "shear_rate": 0.5},
    "thermal_conductivity": {"packing_fraction": 0.2, "T": 1.0, "mass": 1.0, "radius": 0.5},
}  # fmt: skip
HISTOGRAM = ifrdem.observables.Histogram("impact_angle", np.linspace(0.0, 1.5, 4), np.array([[3, 2, 1]]))
MSD = analysis.mean_square_displacement(TIMES, PATHS)
ANALYSIS: dict[str, dict[str, Any]] = {
    "clusters": {"position": POINTS, "box": BOX, "radius": 0.1, "gap": 0.1, "time": 0.0},
    "coarse_grain": {"position": POINTS, "velocity": VELOCITY, "spin": SPIN, "box": SIDES, "cells": (2, 2),
                     "mass": 1.0, "radius": 0.1, "inertia": 0.1, "width": 0.0},
    "collision_distribution": {"histogram": HISTOGRAM, "pair": 0},
    "compressibility": {"packing_fraction": 0.2, "contact": 1.2, "e_n": 0.9},
    "contact_from_rate": {"rate": 1.0, "packing_fraction": 0.2, "temperature": 1.0, "mass": 1.0,
                          "radius": 0.5},
    "contact_value": {"position": POINTS, "box": SIDES, "radius": 0.5, "time": 0.0,
                      "others": POINTS, "radius_of_others": 0.5},
    "correlation_time": {"series": TIMES},
    "diffusion_coefficient": {"msd": MSD, "first": 0.5, "last": 3.0},
    "gaussian": {"c": 1.0},
    "haff_fit": {"time": TIMES, "temperature": (1.0 + TIMES) ** -2.0 * (1.0 + 0.01 * RNG.normal(size=9)),
                 "first": 0.0, "last": 4.0, "disks": 100},
    "hexatic": {"position": POINTS, "box": SIDES, "neighbours": "nearest", "time": 0.0},
    "impacts": {"psi": np.linspace(0.0, 1.5, 50), "regime": np.ones(50, dtype=int), "bins": 5},
    "mean_square_displacement": {"times": TIMES, "paths": PATHS, "origins": "all", "most_lags": 5},
    "mean_stress": {"time": np.arange(5.0), "stress": np.ones((4, 4)), "kinetic": 0.5 * np.ones((4, 4)),
                    "span": (0.5, 3.5)},
    "mean_with_error": {"series": TIMES},
    "pair_correlation": {"position": POINTS, "box": SIDES, "r_max": 3.0, "bins": 10, "r_min": 0.0,
                         "time": 0.0, "others": POINTS},
    "phase_average": {"time": np.arange(16.0), "series": np.ones(16), "period": 4.0, "begin": 1.0, "phases": 4},
    "pressure_from_impulses": {**COLLISIONS, "span": (0.0, 10.0), "area": 100.0, "disks": 10, "tracked": 10,
                               "temperature": 1.0},
    "ratio_fit": {"x": TIMES, "theta": 0.6 - 0.5 * np.exp(-TIMES) + 0.01 * RNG.normal(size=9), "first": 0.0,
                  "last": 4.0, "disks": 100},
    "sonine_density": {"c": 1.0, "a2": 0.1},
    "speed_tail": {"velocity": RNG.normal(size=(400, 2)), "mass": 1.0, "first": 0.5, "bins": 10},
    "structure_factor": {"position": POINTS, "box": SIDES, "k_max": 5.0, "rings": 5, "time": 0.0},
    "transport_coefficient": {"time": np.arange(301.0), "flux": RNG.normal(size=(300, 2)), "factor": 2.0, "lag": 4.0},
    "unwrap": {"position": np.full((3, 2, 2), 0.5), "box": SIDES, "image": np.zeros((3, 2, 2), dtype=int),
               "velocity": np.zeros((3, 2, 2)), "times": 0.0},
    "velocity_autocorrelation": {"times": TIMES, "velocity": PATHS, "origins": "all", "most_lags": 5},
    "velocity_correlation": {"position": POINTS, "velocity": VELOCITY, "box": SIDES, "r_max": 3.0, "bins": 5,
                             "time": 0.0},
    "velocity_spectrum": {"position": POINTS, "velocity": VELOCITY, "box": SIDES, "k_max": 5.0, "rings": 5,
                          "time": 0.0},
    "velocity_distribution": {"velocity": VELOCITY, "spin": SPIN, "mass": 1.0, "inertia": 1.0, "bins": 11,
                              "widest": 5.0},
}  # fmt: skip
RADIUS = [0.5] * 4
STATE = ifrdem.State([[1.0, 1.0], [3.0, 1.0], [1.0, 3.0], [3.0, 3.0]], np.zeros((4, 2)), np.zeros(4))
SMALL = ifrdem.Box((10.0, 10.0))
WALL = ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0))
PLACED = {"box": SMALL, "radius": RADIUS, "walls": ()}
INITIAL: dict[str, dict[str, Any]] = {
    "gaussian_spins": {"n": 4, "spin_rms": 1.0, "seed": 1},
    "grown_positions": {"box": SMALL, "radius": RADIUS, "seed": 1, "walls": (), "progress": lambda _: None},
    "hexagonal_positions": {**PLACED, "seed": 1},
    "maxwellian": {"mass": [1.0] * 4, "speed_rms": 1.0, "temperature": None, "seed": 1},
    "random_positions": {**PLACED, "seed": 1},
    "separate": {**PLACED, "position": STATE.position, "time": 0.0},
}
SAMPLED = {"n": 4, "seed": 1}
RADII: dict[str, dict[str, Any]] = {
    "bidisperse": {**SAMPLED, "low": 0.5, "high": 0.7, "large_fraction": 0.5},
    "check": {"distribution": "uniform", "low": 0.5, "high": 0.7},
    "gaussian": {**SAMPLED, "mean": 0.5, "deviation": 0.05, "low": 0.4, "high": 0.6},
    "lognormal": {**SAMPLED, "mean": 0.5, "deviation": 0.05, "low": 0.4, "high": 0.6},
    "of_ids": {"distribution": "uniform", "n": 4, "ids": range(2), "seed": 1, "low": 0.5, "high": 0.7},
    "sample": {"distribution": "uniform", **SAMPLED, "low": 0.5, "high": 0.7},
    "uniform": {**SAMPLED, "low": 0.5, "high": 0.7},
    "parameter_problem": {"distribution": "uniform", "given": {"low": 0.5}},
}
FORCES: dict[str, dict[str, Any]] = {
    "Drag": {"step": 0.1, "rate": 0.1, "quadratic": 0.1, "spin_rate": 0.1},
    "Force": {"step": 0.1},
    "Langevin": {"step": 0.1, "temperature": 1.0, "rate": 0.1, "spin_temperature": 1.0, "spin_rate": 0.1},
    "PoissonForce": {"rate": 0.1},
    "PoissonKicks": {"rate": 0.1, "power": 0.1, "diffusion": None},
    "PoissonSpinKicks": {"rate": 0.1, "power": 0.1, "diffusion": None},
    "RandomKicks": {"step": 0.1, "power": 0.1, "diffusion": None},
    "Rescale": {"step": 0.1, "temperature": 1.0, "energy": None},
    "SpinKicks": {"step": 0.1, "power": 0.1, "diffusion": None},
    "TableFriction": {"step": 0.1, "mu": 0.1, "gravity": 9.8},
}
MEASURE = ifrdem.observables.measure(DISKS, STATE)
STRESSED = dataclasses.replace(MEASURE, virial=np.eye(2), energy_transfer=np.ones(2))
OBSERVABLES: dict[str, dict[str, Any]] = {
    "drift_text": {"velocity": [1.0, 0.0]},
    "from_totals": {"disks": DISKS, "totals": np.ones(14), "time": 1.0, "wall_collisions": 0,
                    "about_mean": (True, True), "species": np.ones((2, 7))},
    "heat_flux": {"before": STRESSED, "after": dataclasses.replace(STRESSED, time=1.0), "area": 10.0},
    "histogram": {"name": "free_time", "after": dataclasses.replace(STRESSED, histograms=np.ones((1, 709), int), time=1.0),
                  "before": dataclasses.replace(STRESSED, histograms=np.zeros((1, 709), int))},
    "histogram_edges": {"name": "regime"},
    "measure": {"disks": DISKS, "state": STATE, "energy_input": 0.0, "wall_work": 0.0, "wall_heat": 0.0,
                "gravity": (0.0, 0.0), "dissipated": np.zeros(7), "regimes": np.zeros(5, dtype=int),
                "about_mean": (True, True)},
    "stress": {"before": STRESSED, "after": dataclasses.replace(STRESSED, time=1.0), "area": 10.0},
    "sums": {"disks": DISKS, "state": STATE, "gravity": (0.0, 0.0)},
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
    "Box.from_packing_fraction": {"radius": RADIUS, "packing_fraction": 0.2, "aspect": 1.0, "shear_rate": 0.0},
    "Box.packing_fraction": {"self": SMALL, "radius": RADIUS},
    "Box.flow": {"self": SMALL, "position": POINTS},
    "Box.image_above": {"self": SMALL, "time": 1.0},
    "Box.wrap": {"self": SMALL, "position": POINTS, "time": 1.0},
    "Box.minimum_image": {"self": SMALL, "difference": POINTS, "time": 1.0},
    "Box.unwrap": {"self": SMALL, "position": POINTS, "image": np.zeros((400, 2), dtype=int), "time": 1.0},
    "CollisionLaw": {},
    "ContactTime": {"time": 0.1},
    "Device": {
        "name": "cpu", "threads": 1, "precision": "f64", "window_collisions": 0.4, "low_memory": False,
    },
    "Disks": {"n": 2, "mass": [1.0, 2.0], "radius": 0.5, "k": 2.0, "material": [0, 1],
              "species": {"a": 1, "b": 1}},
    "IFRLaw": {"e_n": 0.9, "e_t": -0.8, "mu": 0.2, "sticking": "contact_point", "rho": 0.0, "k": 2.0},
    "IFRLaw.admissibility": {"self": LAW, "k_i": 2.0, "k_j": 2.0, "m_i": 1.0, "m_j": 1.0},
    "IFRLaw.check": {"self": LAW, "k_i": 2.0, "k_j": 2.0, "m_i": 1.0, "m_j": 1.0},
    "Ledger": {"first": MEASURE, "latest": MEASURE, "frames": 1, "area": 10.0, "latest_row": MEASURE},
    "Ledger.observables": {"self": ifrdem.Ledger(), "measure": MEASURE},
    "Ledger.row": {"self": ifrdem.Ledger(), "measure": MEASURE},
    "Motion": {"kind": "sawtooth", "direction": (0.0, 1.0), "speed": 0.0, "amplitude": 0.1, "frequency": 1.0,
               "phase": 0.0, "rise": 0.5},
    "Motion.displacement": {"self": ifrdem.Motion("steady", speed=1.0), "t": 1.0},
    "Piston": {"mass": 1.0, "force": 0.1, "spring": 0.1, "displacement": 0.1, "velocity": 0.1, "low": -1.0,
               "high": 1.0},
    "Piston.energy": {"self": ifrdem.Piston(1.0), "displacement": 1.0, "velocity": 1.0, "pull": 0.0},
    "Rest": {"speed": 0.1},
    "RotatingGravity": {"start": (0.0, -1.0), "rate": 0.1, "step": 0.01},
    "State": {"position": np.ones((2, 2)), "velocity": np.ones((2, 2)), "spin": [0.0, 0.0], "time": 0.0,
              "collisions": [0, 0], "image": np.zeros((2, 2), dtype=int), "wall_collisions": [0, 0],
              "latest_collision": [0.0, 0.0], "last_partner": [-1, -1], "angle": [0.0, 0.0],
              "dissipated": np.zeros((2, 7)), "flow": np.zeros((2, 2)), "asleep": [0, 0]},
    "Study": {"path": "cooling", "vary": (), "set": (), "seeds": 2, "coefficients": None,
              "output": None},
    "Turn": {"kind": "sine", "center": (0.0, 0.0), "rate": 1.0, "amplitude": 1.0, "frequency": 1.0, "phase": 0.0},
    "Turn.angle": {"self": ifrdem.Turn("steady", rate=1.0), "t": 1.0},
    "VelocityCutoff": {"speed": 0.1},
    "Wall": {"shape": "arc", "origin": (1.0, 1.0), "towards": (0.0, 1.0), "radius": 1.0, "angles": (0.0, 1.0),
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
                "velocity": [[1.0, 0.0], [0.0, 0.0]], "spin": [0.0, 0.0], "reduced_radius": 0.25},
    "slice_of": {"n": 10, "comm": None},
}  # fmt: skip
ANGLES = np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
IMPACTS = ifrdem.fit.Data(
    psi=ANGLES,
    measured={"delta_1": 1.5 * ANGLES, "delta_2": 0.2 * ANGLES},
    errors={"psi": 0.7, "delta_1": 0.7, "delta_2": 0.7},
)
MOTION = {
    "vx_1": [1.0, 0.7],
    "vy_1": [0.2, 0.7],
    "vx_1_after": [-0.9, -0.63],
    "nx": [1.0, 1.0],
    "ny": [0.0, 0.0],
}
COIN = ifrdem.fit.Disk(mass=1.0, radius=0.5)


@functools.cache
def fitted() -> ifrdem.fit.Fit:
    """Impacts fitted by a law of two coefficients."""
    return ifrdem.fit.fit(IMPACTS, M=1.0, model=["ifr-percussion"], profile=False)


def of_fits() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Calls that need a fit, by name."""
    found = fitted()
    return {
        "Fit.law": (found.law, {"name": "ifr-percussion"}),
        "Fitted.draw": (found.laws[found.best].draw, {"number": 2, "seed": 1}),
        "Fitted.ifr": (found.laws[found.best].ifr, {"k": 2.0}),
        "as_json": (ifrdem.fit.as_json, {"fit": found}),
        "design": (ifrdem.fit.design, {"fit": found, "number": 5, "psi": ANGLES}),
        "draws": (ifrdem.fit.draws, {"fit": found, "number": 2, "seed": 1}),
        "material": (ifrdem.fit.material, {"fit": found, "name": "coins"}),
        "table": (ifrdem.fit.table, {"fit": found}),
    }


FIT: dict[str, dict[str, Any]] = {
    "Collisions": {"disk_1": COIN, "disk_2": ifrdem.fit.WALL, "measured": MOTION, "source": "data", "line": [2, 3],
                   "errors": {"vx_1": 0.01, "vy_1": 0.01, "vx_1_after": 0.01, "normal": 0.01},
                   "si": True, "covariance": {("vx_1", "vy_1"): 1e-6}, "notes": (), "materials": ("a, b", "a, b")},
    "Data": {"psi": ANGLES, "measured": {"delta_1": 1.5 * ANGLES}, "errors": {"psi": 0.7, "delta_1": 0.7},
             "source": "data", "line": [2, 3, 4, 5, 6, 7], "notes": ()},
    "Disk": {"mass": [1.0, 2.0], "radius": 0.5, "k": 2.0},
    "TableFormat": {"columns": {}, "units": {}, "known": {}, "delimiter": ",", "decimal": "."},
    "Pair": {"M": 0.5, "k_1": 2.0, "k_2": 2.0, "R_1": 1.0, "R_2": 1.0},
    "example": {"seed": 1},
    "fit": {"data": IMPACTS, "M": 1.0, "k_1": 2.0, "k_2": 2.0, "R_1": 1.0, "R_2": 1.0, "model": ["brach"], "own": (),
            "fix": {"mu": 0.2}, "rolling": False, "robust": False, "level": 0.95, "profile": False,
            "cross_validate": False, "bootstrap": 0, "seed": 1, "progress": lambda _: None},
    "own": {"kind": Elastic, "ranges": {"e_n": (0.0, 1.0)}},
}  # fmt: skip
ENGINES: dict[str, dict[str, Any]] = {
    "collide_step": {"position": np.array([[0.0, 0.0], [2.0, 0.0]]), "velocity": np.zeros((2, 2)), "spin": np.zeros(2),
                     "dt": 0.1, "law": LAW, "mass": 1.0, "radius": 0.5, "k": 2.0, "lengths": (5.0, 5.0),
                     "walls": (), "angle": None},
}  # fmt: skip
MODULES: dict[ModuleType, dict[str, dict[str, Any]]] = {
    ifrdem.engines: ENGINES, theory: THEORY, analysis: ANALYSIS, ifrdem.initial: INITIAL, ifrdem.initial.radii: RADII,
    ifrdem.forces: FORCES, ifrdem.observables: OBSERVABLES, ifrdem.fit: FIT, ifrdem: IFRDEM,
}  # fmt: skip
"""Module -> public name, or a class's method, -> arguments of one valid call."""

OTHERS: dict[ModuleType, set[str]] = {
    ifrdem.engines: {"Hit"},
    theory: {"CoolingRatio", "RoughCooling", "RoughSonine", "MixtureTemperatures", "Prediction", "ShearModes", "SteadyFlow"},
    analysis: {"BinAverages", "Clusters", "CollisionDistribution", "ContactValue", "Correlation", "Cycle", "Diffusion", "Fields", "HaffFit", "Hexatic",
               "Impacts", "Local", "MeanStress", "PairCorrelation", "Pressure", "RatioFit",
               "SonineCoefficients", "SpeedTail", "StructureFactor", "TransportCoefficient", "VelocityCorrelation", "VelocityDistribution", "VelocitySpectrum", "mean_fields",
               "profiles"},
    ifrdem.forces: {"normals", "uniforms"},
    ifrdem.observables: {"HeatFlux", "Histogram", "Measure", "Stress"},
    # Functions of fits, files and gases are below.
    ifrdem.fit: {"Design", "Estimate", "Fit", "Fitted", "Interval", "Law", "as_json", "design", "draws", "material",
                 "read", "table"},
    ifrdem: {"Case", "DSMC", "History", "PartsWriter", "Regime", "Simulation", "Trajectory", "TrajectoryWriter",
             "concat", "run", "view"},
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
        ("ragged", [[1.0, 2.0], [3.0]]), ("duration", np.timedelta64(1, "s")), ("date", np.datetime64("2021-05-04")),
        ("durations", np.array([1, 2], "m8[s]")), ("ints without a text", [10**5001, 1]), ("deep", nested(3000)),
        ("long text", "nonsense " * 33),
    )  # fmt: skip


def nested(depth: int) -> list[Any]:
    """A list in a list in a list ...; beyond 1000 Python cannot write it."""
    return functools.reduce(lambda inner, _: [inner], range(depth), [])


def looking_valid() -> Iterator[tuple[str, Any]]:
    """Values that many arguments may have, but that need care: ends of ranges, counts and types."""
    yield from (
        ("empty", np.zeros(0)), ("no points", np.zeros((0, 2))), ("equal", [1.0, 1.0]), ("gap", [1.0, math.nan]),
        ("subnormal", [5e-324, 5e-324]), ("1e308", [1e308, -1e308]), ("1e99", 1e99), ("1e-99", 1e-99),
        ("count", 2**31 - 1), ("0-d", np.array(1.0)), ("uint64", np.array([2**64 - 1, 1], dtype=np.uint64)),
        ("float16", np.float16(1.0)), ("long double", np.longdouble("1e4000")), ("falling", [3.0, 2.0, 1.0]),
        ("one place", np.ones((10**5, 2))), ("objects", np.array([1.0, 2.0], dtype=object)),
        ("text with a zero", "a\0b"), ("no text", "\ud800"),
    )  # fmt: skip


NONSENSE = [name for name, _ in nonsense()]


TEXTS = ("text", "long text")


def numbers(result: Any) -> Iterator[float]:
    """All numbers in a result."""
    if isinstance(result, np.ndarray):
        if result.dtype.kind in "fc":
            yield from np.abs(np.asarray(result)).ravel().tolist()
    elif isinstance(result, float | complex | np.number):
        yield abs(result)
    elif dataclasses.is_dataclass(result) and not isinstance(result, type):
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
                if name not in str(error) and not (kind in TEXTS and "nonsense" in str(error)):
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


@pytest.mark.parametrize(
    "name", ["Fit.law", "Fitted.draw", "Fitted.ifr", "as_json", "design", "draws", "material", "table"]
)
def test_nonsense_for_a_fit_is_refused_by_the_name_of_its_argument(name: str) -> None:
    assert wrong_answers(*of_fits()[name]) == []


class TooLong(BaseException):
    """Raised in a call that has taken `MOST_SECONDS` of processor time."""


MOST_SECONDS = 30.0


def no_answers(call: Callable[..., Any], arguments: Mapping[str, Any]) -> list[str]:
    """Values that look valid and end in no answer: neither a result, nor a message on the input or the theory."""

    def stop(*_: object) -> None:
        raise TooLong

    wrong, before = [], signal.signal(signal.SIGPROF, stop)
    try:
        for name in arguments.keys() - {"self"}:
            for kind, value in looking_valid():
                if kind == "count" and name in COUNTS_OF_RESULTS:
                    continue
                signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
                try:
                    called(call, {**arguments, name: value})
                except (InputError, TheoryError) as error:
                    if len(str(error)) > 5000:
                        wrong.append(f"{name} = {kind}: a message of {len(str(error))} characters")
                except TooLong:
                    wrong.append(f"{name} = {kind}: takes longer than {MOST_SECONDS} s")
                except Exception as error:  # reported
                    wrong.append(f"{name} = {kind}: {type(error).__name__}: {error}")
                finally:
                    signal.setitimer(signal.ITIMER_PROF, 0.0)
    finally:
        signal.signal(signal.SIGPROF, before)
    return wrong


COUNTS_OF_RESULTS = {"n", "number"}
"""Arguments that say how many numbers a call returns: as many take memory and time, or are refused for want of it."""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers of processor time on this system")
@pytest.mark.full(keep=("ifrdem.theory-cooling", "ifrdem.theory-sonine_coefficient", "ifrdem-Disks"))
@pytest.mark.parametrize(("module", "name"), CALLS)
def test_values_that_look_valid_end_in_an_answer(module: str, name: str) -> None:
    found = next(each for each in MODULES if each.__name__ == module)
    assert no_answers(public(found, name), MODULES[found][name]) == []


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


def test_signatures_show_types_without_checks() -> None:
    """`help` showed Annotated[float | None, LATER] for what is float | None."""
    shown = {
        f"{module.__name__}.{name}": str(inspect.signature(public(module, name)))
        for module, names in MODULES.items()
        for name in names
    }
    shown["run"] = str(inspect.signature(ifrdem.Simulation.run))
    assert {name for name, text in shown.items() if "Annotated" in text} == set()
    assert re.search(r"t_end: '?float \| None'? = None", shown["run"])


def small_file(folder: Path) -> str:
    """A trajectory of three frames of four disks."""
    path = str(folder / "small.h5")
    with ifrdem.TrajectoryWriter(
        path, DISKS, SMALL, fields=("position", "velocity", "angular_velocity")
    ) as file:
        for time in (0.0, 1.0, 2.0):
            state = dataclasses.replace(STATE, time=time)
            measure = ifrdem.observables.measure(DISKS, state)
            names = (
                "temperature", "rotational_temperature", "energy", "collisions", "translational_energy",
                "rotational_energy",
            )  # fmt: skip
            file.write(state, {name: getattr(measure, name) for name in names})
    return path


def scan(folder: Path) -> Path:
    """A trajectory of one impact: disk 0 on disk 1, at rest."""
    law = {
        "law": "ifr",
        "e_n": 0.9,
        "e_t": -1.0,
        "mu": 0.0,
        "sticking": "contact_point",
        "rho": 0.0,
        "k": 2.0,
    }
    parameters = {"laws": json.dumps([[law]])}
    path, disks = folder / "scan.h5", ifrdem.Disks(2, mass=1.0, radius=0.5)
    with ifrdem.TrajectoryWriter(path, disks, SMALL, parameters=parameters) as file:
        for time in (0.0, 1.0):
            position = [[2.0 + 0.5 * time, 2.0], [4.0, 2.3]]
            velocity = [[1.0, 0.0], [0.0, 0.0]] if time == 0.0 else [[0.1, -0.3], [0.9, 0.3]]
            file.write(ifrdem.State(position, velocity, [0.0, 0.0], time, [int(time)] * 2))
    return path


def of_files(folder: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Calls that need a file, by name; what writes one is given another name each time."""
    path = small_file(folder)
    run = ifrdem.Trajectory(path)
    names = itertools.count()
    data = folder / "data.csv"
    data.write_text(ifrdem.fit.example(1), encoding="utf-8")
    write_layout(tracked := folder / "tracked.h5", n=7)
    start = {
        "time": 0.0, "position": np.ones((3, 2)), "velocity": np.ones((3, 2)), "spin": np.ones(3),
        "image": np.zeros((3, 2)),
    }  # fmt: skip
    add_histories(tracked, [1, 4, 6], start, [], [(0, 2.0)])
    paths = ifrdem.Trajectory(tracked)
    history = paths.history(4)
    frame = run[0]

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
        "precision": "f32", "compression": "none", "force": False, "walls": (), "within": None,
    }  # fmt: skip

    def parts(**arguments: Any) -> None:
        arguments.setdefault("path", folder / f"{next(names)}.h5")
        with ifrdem.PartsWriter.create(**arguments):
            pass

    in_parts = {"disks": DISKS, "own": DISKS, "box": SMALL, "number": 2, "force": False, "parameters": {"a": 1},
                "fields": ("position",), "comm": None}  # fmt: skip
    pictures = {
        name: (getattr(ifrdem.plots, name), {"run": run, "path_png": None})
        for name in ("cooling", "driven", "sheared", "table", "walled")
    }
    pictures["impact_scan"] = (
        ifrdem.plots.impact_scan,
        {"run": ifrdem.Trajectory(scan(folder)), "path_png": None},
    )
    return {
        **{f"plots.{name}": call for name, call in pictures.items()},
        "analysis.profiles": (analysis.profiles, {"trajectory": run, "axis": "y", "bins": 40, "frames": [0, 1],
                                                  "span": (0.0, 4.0), "collisions": True}),
        "analysis.mean_fields": (analysis.mean_fields, {"trajectory": run, "cells": (2, 2), "frames": [0, 1],
                                                        "collisions": True}),
        "fit.read": (ifrdem.fit.read, {"path": data, "errors": {"angles": 0.7}, "disk_1": COIN, "disk_2": None,
                                       "form": ifrdem.fit.TableFormat(), "min_quality": 0.01}),
        **{f"History.{name}": (getattr(history, name), {"t": [0.5, 1.0]})
           for name in ("angle", "position", "spin", "unwrapped", "velocity")},
        "History.__getitem__": (lambda name: history[name], {"name": "psi"}),
        "Frame.__getitem__": (lambda name: frame[name], {"name": "position"}),
        "Frame.field": (frame.field, {"name": "position"}),
        "Frame.plot": (frame.plot, {"ax": None, "color": "spin"}),
        "DiskPath.__getitem__": (lambda name: run.disk(0)[name], {"name": "position"}),
        "Series.__getitem__": (lambda name: run.observables[name], {"name": "energy"}),
        "Series.columns": (run.observables.columns, {"name": "energy"}),
        "PartsWriter.create": (parts, in_parts),
        "Trajectory.constants": (run.constants, {"name": "mass", "disks": slice(0, 2)}),
        "Trajectory.dataset": (run.dataset, {"name": "position"}),
        "Trajectory.dtype": (run.dtype, {"name": "position"}),
        "Trajectory.history": (paths.history, {"disk": 4}),
        "Trajectory.plot": (run.plot, {"what": "temperatures", "ax": None, "frames": [0, 1], "over": "t",
                                       "color": None}),
        "Trajectory.read": (run.read, {"name": "position", "selection": 1}),
        "Trajectory.read_events": (paths.read_events, {"name": "time", "rows": 0, "start": 0}),
        "Trajectory.record": (lambda name, use: run.record(name, use, "[]"), {"name": "gravity", "use": list}),
        "Trajectory.require": (run.require, {"name": "position"}),
        "Trajectory.shape": (run.shape, {"name": "position"}),
        "Trajectory.with_unit": (run.with_unit, {"text": "1", "quantity": "time"}),
        "Trajectory": (ifrdem.Trajectory, {"path": path}),
        "Trajectory.__getitem__": (lambda frame: run[frame], {"frame": 0}),
        "Trajectory.disk": (run.disk, {"disk": 0}),
        "Trajectory.to_pandas": (run.to_pandas, {"which": "observables", "index": -1}),
        "TrajectoryWriter": (written, writer),
        "TrajectoryWriter.write": (write, {"state": STATE, "observables": {"a": 1.0}}),
        "concat": (ifrdem.concat, {"trajectories": [path]}),
        "plots.figure": (ifrdem.plots.figure, {"trajectory": run, "what": "temperatures", "frames": [0, 1],
                                               "over": "t", "color": None, "make": Figure,
                                               "size": (7.0, 5.0), "dpi": 100, "title": True}),
        "view": (ifrdem.view, {"trajectory": run, "frames": [0], "height": 640}),
    }  # fmt: skip


PICTURES = ("cooling", "driven", "impact_scan", "sheared", "table", "walled")
FILES = [
    *(f"plots.{name}" for name in (*PICTURES, "figure")), "analysis.mean_fields", "analysis.profiles", "fit.read",
    *(f"History.{name}" for name in ("__getitem__", "angle", "position", "spin", "unwrapped", "velocity")),
    "Frame.__getitem__", "Frame.field", "Frame.plot", "DiskPath.__getitem__", "Series.__getitem__", "Series.columns",
    "PartsWriter.create", "Trajectory", "TrajectoryWriter", "TrajectoryWriter.write", "concat", "view",
    *(f"Trajectory.{name}" for name in (
        "__getitem__", "constants", "dataset", "disk", "dtype", "history", "plot", "read", "read_events", "record",
        "require", "shape", "to_pandas", "with_unit")),
]  # fmt: skip


@pytest.fixture(scope="module")
def calls_of_files(
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    return of_files(tmp_path_factory.mktemp("files"))


@pytest.mark.parametrize("name", FILES)
def test_nonsense_for_files_is_refused_by_the_name_of_its_argument(
    name: str,
    calls_of_files: dict[str, tuple[Callable[..., Any], dict[str, Any]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for module in (ifrdem.plots.run, impact_angles):
        monkeypatch.setattr(module, "save", lambda figure, path: None)
    assert set(calls_of_files) == set(FILES)
    assert wrong_answers(*calls_of_files[name]) == []


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers of processor time on this system")
@pytest.mark.full(keep=("Trajectory.constants", "Trajectory.read"))
@pytest.mark.parametrize("name", FILES)
def test_values_that_look_valid_for_files_end_in_an_answer(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for module in (ifrdem.plots.run, impact_angles):
        monkeypatch.setattr(module, "save", lambda figure, path: None)
    assert no_answers(*of_files(tmp_path)[name]) == []


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

    @functools.cache
    def driven() -> ifrdem.Simulation:
        """A gas under a piston."""
        walls = [ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0), piston=ifrdem.Piston(1.0))]
        return gas(box=ifrdem.Box((10.0, 10.0), (True, False)), walls=walls)

    simulation: dict[str, Any] = {
        "disks": DISKS, "box": SMALL, "law": law, "state": STATE, "walls": (), "gravity": (0.0, 0.0),
        "forces": (), "collapse": None, "device": Device(threads=1), "record": (), "regions": None, "histories": (),
        "seed": 0, "comm": None,
    }  # fmt: skip
    return {
        "DSMC": (dsmc, {"disks": DISKS, "law": law, "packing_fraction": 0.1, "velocity": np.ones((4, 2)),
                        "spin": None, "seed": 0, "species": None, "driving": None, "shear_rate": 0.0, "contact": "virial",
                        "device": "cpu"}),
        "Simulation": (gas, simulation),
        "Simulation.run": (lambda **given: gas().run(**given), {
            "t_end": 0.0, "frames": 1, "frame_callbacks": (), "series": None, "series_callbacks": (), "progress": None,
        }),
        "DSMC.run": (lambda **given: dsmc().run(**given), {"t_end": 0.0, "samples": [0.0]}),
        "Simulation.collide": (made.collide, {"count": 0}),
        "Simulation.collide_until": (made.collide_until, {"t_end": 0.0}),
        "Simulation.save_checkpoint": (made.save_checkpoint, {"path": "saved.npz", "extra": None, "arrays": None}),
        "Simulation.set_piston_force": (lambda **given: driven().set_piston_force(**given),
                                        {"wall": 0, "force": 1.0}),
        "Simulation.switch_ledger": (gas(record=["ledger"]).switch_ledger, {"on": True}),
        "Simulation.run_for": (lambda **given: gas().run_for(**given), {
            "time": 1e-9, "frames": 1, "frame_callbacks": (), "series": None, "series_callbacks": (),
        }),
        "Simulation.set_law": (made.set_law, {"law": law}),
        "Simulation.set_forces": (made.set_forces, {"forces": ()}),
        "Simulation.set_gravity": (made.set_gravity, {"gravity": (0.0, 0.0)}),
        "Simulation.set_velocities": (made.set_velocities, {"velocity": np.zeros((4, 2)), "spin": np.zeros(4)}),
        "Simulation.load_checkpoint": (made.load_checkpoint, {"path": "none.npz"}),
        "Simulation.from_checkpoint": (ifrdem.Simulation.from_checkpoint, {
            "path": "made.h5", "law": None, "forces": None, "device": None, "comm": None,
        }),
    }  # fmt: skip


GASES = [
    "DSMC", "DSMC.run", "Simulation",
    *(f"Simulation.{name}" for name in (
        "collide", "collide_until", "from_checkpoint", "load_checkpoint", "run", "run_for", "save_checkpoint",
        "set_forces", "set_gravity", "set_law", "set_piston_force", "set_velocities", "switch_ledger")),
]  # fmt: skip


@pytest.mark.parametrize("name", GASES)
def test_nonsense_for_gases_is_refused_by_the_name_of_its_argument(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    calls = of_gases()
    assert set(calls) == set(GASES)
    calls["Simulation.save_checkpoint"][0]("made.h5")
    call, arguments = calls[name]
    wrong = []
    for key in arguments:
        for kind, value in nonsense():
            try:
                called(call, {**arguments, key: value})
            except InputError as error:
                if key not in str(error) and not (kind in TEXTS and "nonsense" in str(error)):
                    wrong.append(f"{key} = {kind}: not named: {error}")
            except Exception as error:  # reported: only InputError is an answer to nonsense
                wrong.append(f"{key} = {kind}: {type(error).__name__}")
    assert wrong == []


def of_bullet(client: int) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Calls of the adapter to PyBullet, by name."""
    disk = bullet.add_disk(client, mass=1.0, radius=0.5)
    bodies = bullet.Bodies.read(client, [disk])
    surface = {"friction": 0.1, "restitution": 0.5}
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    return {
        "Bodies.read": (bullet.Bodies.read, {"client": client, "bodies": [disk]}),
        "Bodies.state": (bodies.state, {"client": client}),
        "add_disk": (bullet.add_disk, {"client": client, "mass": 1.0, "radius": 0.5, "k": 2.0, "height": 0.5,
                                       **surface}),
        "add_wall": (bullet.add_wall, {"client": client, "point": (0.0, 0.0), "normal": (0.0, 1.0), **surface}),
        "place": (bullet.place, {"client": client, "body": disk.body, "position": (0.0, 0.0), "velocity": (0.0, 0.0),
                                 "spin": 0.0, "angle": 0.0, "z": 0.0}),
        "step": (bullet.step, {"client": client, "bodies": bodies, "law": law}),
    }  # fmt: skip


@pytest.mark.skipif(bullet.absence() is not None, reason="PyBullet is absent")
@pytest.mark.parametrize("name", ["Bodies.read", "Bodies.state", "add_disk", "add_wall", "place", "step"])
def test_nonsense_for_pybullet_is_refused_by_the_name_of_its_argument(name: str) -> None:
    p = bullet.load()
    client = p.connect(p.DIRECT)
    try:
        assert wrong_answers(*of_bullet(client)[name]) == []
    finally:
        p.disconnect(client)


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
         "n = an int of 1329 bits: must be"),
        (lambda: theory.contact_value(10**400), "packing_fraction = an int of 1329 bits"),
    ],
)  # fmt: skip
def test_nonsense_that_was_taken_before_is_named(call: Callable[[], Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        call()


@pytest.mark.parametrize("value", [np.float32("inf"), np.float16("inf"), np.float32(0.0), np.float32("nan")])
def test_numbers_of_short_types_of_numpy_are_held_to_the_same_bounds(value: Any) -> None:
    """NumPy rounds bounds to the type of its own numbers: 1e50 to inf, 1e-50 to 0."""
    for call in (
        lambda: ifrdem.theory.mean_free_path(0.2, value),
        lambda: ifrdem.Piston(mass=value),
        lambda: ifrdem.Box.from_packing_fraction([0.5], 0.2, value),
    ):
        with pytest.raises(InputError):
            call()
    law = ifrdem.IFRLaw(e_n=np.float32(0.5), e_t=-1, mu=0)
    assert (type(law.e_n), law.e_n) == (float, 0.5)


@checked.validated
def _taking_all_memory(n: int) -> None:
    """A function that needs more memory than there is."""
    raise MemoryError(f"Unable to allocate {8 * n} B")


def test_want_of_memory_is_a_message_and_no_traceback() -> None:
    with pytest.raises(
        InputError, match="_taking_all_memory: not enough memory for what was asked: Unable to allocate"
    ):
        _taking_all_memory(2**40)


def test_aliases_of_types_are_checked_as_their_types() -> None:
    # NumPy 2.5 declares NDArray and ArrayLike by `type` statements where Python has them.
    array = TypeAliasType("array", np.ndarray[Any, np.dtype[Scalar]], type_params=(Scalar,))
    assert check_of(array[np.integer]) == check_of(np.ndarray[Any, np.dtype[np.integer]]) is None
    assert check_of(TypeAliasType("number", float | None)) == check_of(float | None)


def type_checking_names(module: ModuleType) -> set[str]:
    """Names that a module imports for type checkers only."""
    tree = ast.parse(inspect.getsource(module))
    blocks = [
        each
        for each in ast.walk(tree)
        if isinstance(each, ast.If) and ast.unparse(each.test) == "TYPE_CHECKING"
    ]
    imports = [one for block in blocks for one in block.body if isinstance(one, ast.Import | ast.ImportFrom)]
    return {(alias.asname or alias.name).split(".")[0] for one in imports for alias in one.names}


def unknown_names(function: Callable[..., Any]) -> set[str]:
    """Names in the annotations of a checked function that are nowhere: `validated` would not check those arguments."""
    module = sys.modules[function.__module__]
    known = {*vars(builtins), *vars(module), *type_checking_names(module)}
    hints = [one.annotation for one in inspect.signature(function).parameters.values()]
    trees = [ast.parse(hint, mode="eval") for hint in hints if isinstance(hint, str)]
    return {each.id for tree in trees for each in ast.walk(tree) if isinstance(each, ast.Name)} - known


def test_every_annotation_of_a_checked_function_names_what_is_there() -> None:
    for module in pkgutil.walk_packages(ifrdem.__path__, "ifrdem."):
        if not module.name.startswith(
            ("ifrdem.docs", "ifrdem.__main__", "ifrdem.validation", "ifrdem.cases")
        ):
            importlib.import_module(module.name)
    assert len(checked.VALIDATED) > 150
    found = {f"{one.__module__}.{one.__qualname__}": unknown_names(one) for one in checked.VALIDATED}
    assert {name: names for name, names in found.items() if names} == {}


def _misspelt(value: Positiv) -> None:  # type: ignore[name-defined]  # noqa: F821
    """A function whose annotation names nothing."""


def test_an_annotation_that_names_nothing_is_found() -> None:
    assert unknown_names(_misspelt) == {"Positiv"}


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: ifrdem.Disks(3, mas=1.0, radius=1.0), r"^Disks: unknown argument 'mas' \(did you mean 'mass'"),
        (lambda: ifrdem.IFRLaw(en=0.9, e_t=0.0, mu=1.0), r"^IFRLaw: unknown argument 'en' \(did you mean 'e_n'"),
        (lambda: ifrdem.IFRLaw(e_N=0.9, e_t=0.0, mu=1.0), r"unknown argument 'e_N' \(did you mean 'e_n'"),
        (lambda: ifrdem.initial.maxwellian(np.ones(3), temperatur=1.0, seed=1),
         r"^maxwellian: unknown argument 'temperatur' \(did you mean 'temperature'"),
        # Of options that a type lists.
        (lambda: ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0), temperatur=1.0),
         r"^Wall.line: unknown argument 'temperatur' \(did you mean 'temperature'.* moves_until, normal, opens_after"),
        (lambda: ifrdem.Simulation.run_for(None, time=1.0, frame=3),  # type: ignore[arg-type]
         r"^Simulation.run_for: unknown argument 'frame' \(did you mean 'frames'"),
        (lambda: ifrdem.Device("gpu"), "name = 'gpu': .*did you mean 'cuda'"),
        (lambda: ifrdem.forces.PoissonKicks(10.0), "PoissonKicks: .* power and diffusion; given: none"),
        (lambda: ifrdem.forces.SpinKicks(1.0, power=1.0, diffusion=1.0),
         "SpinKicks: .* power and diffusion; given: both"),
        (lambda: PairLaws.of([[LAW, None], [None, LAW]], DISKS), r"law\[0\]\[1\] = None"),
        (lambda: PairLaws.of([[LAW]], TWO_MATERIALS), r"law = table of shape \(1, 1\): .*at least 2 materials"),
        (lambda: PairLaws.of(None, DISKS), "law = None: must be"),
        (lambda: ifrdem.Ledger().row(STRESSED), "area = None: must be given"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_place(call: Callable[[], Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        call()
