r"""Profiles of gases: fluxes of momentum and heat, compared with walls, weight and the recorded stress.

Units: mass of a disk and (not in the dilute gas) its diameter. All averages are `analysis.profiles` of trajectories.

*Momentum.* Under gravity g the flux P_yy at a height carries the weight of what is above it and the pressure of the
ceiling, P_yy(y) = P_top + g int_y rho dy, for any equation of state. Over a finite time, the change of the
momentum above is added.

*Barometer.* A dilute elastic gas in equilibrium has one temperature T, and n ~ exp(-m g y / T).

*Heat.* Elastic disks conduct heat between two walls of different temperatures: q_x is the heat that the cold wall takes
per length and time, plus the change of the energy between.

*Collisions.* The virial from histories, summed over the bins, equals that of the engine, to rounding.

*Shear.* u_x is rate (y - L_y / 2), and the kinetic part of P_xy equals the recorded one.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ... import analysis
from ...runs.case import Case
from ...tools.checked import Array
from ...trajectory.reader import Frame, Trajectory
from ..report import style
from ..report.registry import Picture, Result
from .sample import compare, ratio, seeds_of

QUESTION = "Do profiles of density, stress and heat flux balance the weight, walls and the recorded stress?"
REFERENCE = "balances of momentum and energy; the barometric formula; the stress that a run records"

Found = TypeVar("Found")
ROUNDING = 1e-9
SMOOTH = {"name": "smooth", "e_n": 1.0, "e_t": -1.0, "mu": 0.0}
ROUGH = {"name": "rough", "e_n": 0.9, "e_t": -0.5, "mu": 0.3}


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, (left, right) = style.panels(2)
    _weight(result, quick, seed, left)
    _heat(result, quick, seed, right)
    _barometer(result, quick, seed)
    _collisions(result, seed)
    _shear(result, quick, seed)
    style.titles(left, right)
    caption = (
        "(a) P_yy of an elastic gas under gravity, and the weight above it with the pressure of the ceiling (line). "
        "(b) Heat flux between walls at T = 3 and 1, and what the cold wall takes (line)."
    )
    result.pictures.append(Picture("gas_profiles", caption, figure))
    return result


def of_run(
    use: Callable[[Trajectory], Found], seed: int, t_end: float, frames: int, **sections: Any
) -> Found:
    """What `use` finds in the trajectory of a case, which is then deleted."""
    fields = ["position", "velocity", "angular_velocity", "collisions"]
    output = {"frames": frames, "series": frames, "fields": fields, **sections.pop("output", {})}
    times = {"name": "gas", "seed": seed, "t_end": t_end, "units": "reduced"}
    case = Case(run=times, start={"positions": "random"}, output=output, **sections)
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.redirect_stderr(io.StringIO()):  # its progress
            trajectory = case.run_to(Path(folder) / "gas.h5", picture=False)
        with trajectory:
            return use(trajectory)


def disks(
    number: int, material: str = "smooth", diameter: float = 1.0, speed_rms: float = 2.0
) -> list[dict[str, Any]]:
    kind = {"name": "disks", "number": number, "material": material, "mass": 1.0}
    return [{**kind, "diameter": diameter, "speed_rms": speed_rms}]


def gained(trajectory: Trajectory, name: str, first: int) -> Array:
    """What each wall has given since a row of the series, over the time."""
    series = trajectory.series
    return np.asarray((series[name][-1] - series[name][first]) / (series.time[-1] - series.time[first]))


def gained_beyond(
    run: Trajectory, axis: int, edges: Array, frames: Sequence[int], of: Callable[[Frame], Array]
) -> Array:
    """What disks beyond each strip gain of a quantity between the first and the last frame, over the time, (strips,).

    The mean over places in the strip: a disk in it counts by the part that is below it.
    """
    low, high = edges[:-1, None], edges[1:, None]

    def beyond(frame: Frame) -> Array:
        return np.clip((frame.position[:, axis] - low) / (high - low), 0.0, 1.0) @ of(frame)

    first, last = (run[frames[i]] for i in (0, -1))
    return np.asarray((beyond(last) - beyond(first)) / (last.time - first.time))


# -- momentum ----------------------------------------------------------------------------------------------

WIDTH, HEIGHT, WEIGHT, STRIPS = 20.0, 40.0, 0.2, 20


def weighed(seed: int, t_end: float) -> tuple[Array, Array]:
    """P_yy in strips of a gas under gravity, and what it carries there, both (STRIPS,)."""
    frames, skip = round(4.0 * t_end), round(t_end)

    def use(run: Trajectory) -> tuple[Array, Array]:
        used = range(skip, frames + 1)
        found = analysis.profiles(run, "y", STRIPS, frames=used)
        rho = found.mean.number_density * HEIGHT / STRIPS
        above = WEIGHT * (np.cumsum(rho[::-1])[::-1] - 0.5 * rho)
        above += gained_beyond(run, 1, found.edges[0], used, lambda frame: frame.velocity[:, 1]) / WIDTH
        top = -float(gained(run, "walls_momentum_y", skip)[1]) / WIDTH
        return found.mean.stress[:, 1, 1], above + top

    box = {
        "lengths": [WIDTH, HEIGHT],
        "periodic": [True, False],
        "material": "smooth",
        "gravity": [0.0, -WEIGHT],
    }
    output = {"histories_all": True, "wall_sums": True}
    return of_run(use, seed, t_end, frames, box=box, material=[SMOOTH], species=disks(200), output=output)


def _weight(result: Result, quick: bool, seed: int, axes: Any) -> None:
    seeds = seeds_of(seed, 10, 8700)
    stress, carried = np.swapaxes([weighed(one, 30.0 if quick else 120.0) for one in seeds], 0, 1)
    for strip in (0, 8, 16):
        compare(
            result, f"P_yy in strip {strip} of {STRIPS} over the weight above and the ceiling's pressure",
            ratio(stress[:, strip], carried[:, strip]), 1.0, disks=200, seeds=seeds, systematic=0.004,
            why="0.4 %: the density varies in a strip", source="balance of momentum", widest=0.08,
        )  # fmt: skip
    y = (np.arange(STRIPS) + 0.5) * HEIGHT / STRIPS
    style.points(axes, y, stress.mean(axis=0), style.VERMILION, "$P_{yy}$", "s")
    axes.plot(y, carried.mean(axis=0), color=style.BLACK, label="weight above")
    axes.set(xlabel="$y$", ylabel="$P_{yy}$")
    axes.legend()


# -- heat --------------------------------------------------------------------------------------------------


def conducted(seed: int, t_end: float) -> tuple[Array, Array]:
    """q_x in six strips between walls at T = 3 and 1, and the heat that the hot one hands on to them, both (6,)."""
    frames, skip = round(8.0 * t_end), round(4.0 * t_end)

    def use(run: Trajectory) -> tuple[Array, Array]:
        used = range(skip, frames + 1)
        found = analysis.profiles(run, "x", 6, frames=used)
        inertia = run.disks.inertia
        beyond = gained_beyond(
            run, 0, found.edges[0], used,
            lambda frame: 0.5 * np.sum(frame.velocity**2, axis=1) + 0.5 * inertia * frame.spin**2,
        )  # fmt: skip
        return found.mean.heat_flux[:, 0], (beyond - float(gained(run, "walls_heat", skip)[1])) / 20.0

    walls = [
        {"shape": "line", "point": [0.0, 0.0], "normal": [1.0, 0.0], "temperature": 3.0},
        {"shape": "line", "point": [20.0, 0.0], "normal": [-1.0, 0.0], "temperature": 1.0},
    ]
    box = {"lengths": [20.0, 20.0], "periodic": [False, True], "material": "smooth"}
    sections = {"box": box, "wall": walls, "material": [SMOOTH], "species": disks(150)}
    return of_run(use, seed, t_end, frames, output={"histories_all": True, "wall_sums": True}, **sections)


def _heat(result: Result, quick: bool, seed: int, axes: Any) -> None:
    seeds = seeds_of(seed, 10, 8720)
    flux, heat = np.swapaxes([conducted(one, 50.0 if quick else 150.0) for one in seeds], 0, 1)
    for strip in (1, 4):
        compare(
            result, f"heat flux in strip {strip} of 6 over that of thermal walls",
            ratio(flux[:, strip], heat[:, strip]), 1.0, disks=150, seeds=seeds, systematic=0.0, why="none",
            widest=0.5 if quick else 0.3, source="balance of energy",
        )  # fmt: skip
    x = (np.arange(6) + 0.5) * 20.0 / 6.0
    style.points(axes, x, flux.mean(axis=0), style.VERMILION, "heat flux", "s")
    axes.plot(x, heat.mean(axis=0), color=style.BLACK, label="into the cold wall, and what is beyond")
    axes.set(xlabel="$x$", ylabel="$q_x$")
    axes.set_ylim(bottom=0.0)
    axes.legend()


# -- barometer ---------------------------------------------------------------------------------------------


def height_of(seed: int, t_end: float) -> float:
    """Mean height of a dilute gas by its density profile, over that of exp(-m g y / T) with its temperature."""
    g, frames = 0.05, 400
    height, radius = 200.0, 0.1

    def use(run: Trajectory) -> float:
        skip = range(200, frames + 1)
        found = analysis.profiles(run, "y", 100, frames=skip)
        n, y = found.mean.number_density, found.middles[0] - radius
        T = float(analysis.profiles(run, "y", 1, frames=skip).mean.temperature[0])
        scale, span = T / g, height - 2.0 * radius
        return float(n @ y / n.sum()) / (scale - span / np.expm1(span / scale))

    box = {"lengths": [60.0, height], "periodic": [True, False], "material": "smooth", "gravity": [0.0, -g]}
    species = disks(300, diameter=2.0 * radius, speed_rms=1.5)
    return of_run(use, seed, t_end, frames, box=box, material=[SMOOTH], species=species)


def _barometer(result: Result, quick: bool, seed: int) -> None:
    seeds = seeds_of(seed, 10, 8740)
    found = [height_of(one, 1000.0 if quick else 4000.0) for one in seeds]
    compare(
        result, "mean height of a dilute gas over that of n ~ exp(-m g y / T)", found, 1.0, disks=300, seeds=seeds,
        systematic=0.01, why="1 %: packing fraction 0.002 below, bins, 300 disks of one energy", widest=0.08,
        source="the barometric formula",
    )  # fmt: skip


# -- the recorded stress -----------------------------------------------------------------------------------


def recorded(run: Trajectory) -> tuple[Array, Array]:
    """Collisional and kinetic part of the mean pressure tensor of a run's series, (2, 2)."""
    series, step = run.series, np.diff(run.series.time)
    whole, kinetic = (step @ series[name][1:] / step.sum() for name in ("stress", "stress_kinetic"))
    return (whole - kinetic).reshape(2, 2), kinetic.reshape(2, 2)


def shared(seed: int) -> float:
    """Largest difference of the collisional stress, over strips and over cells, from the recorded one; relative."""

    def use(run: Trajectory) -> float:
        every = range(len(run))
        both = [analysis.profiles(run, "y", 7, frames=every), analysis.mean_fields(run, (5, 4), frames=every)]
        expected = recorded(run)[0]
        parts = [(one.mean.stress - one.mean.stress_kinetic).reshape(-1, 2, 2).mean(axis=0) for one in both]
        return float(np.max(np.abs(np.array(parts) - expected)) / expected[0, 0])

    box = {"lengths": [20.0, 16.0], "periodic": [True, False], "material": "rough"}
    output = {"histories_all": True, "stress": True}
    return of_run(use, seed, 10.0, 20, box=box, material=[ROUGH], species=disks(150, "rough"), output=output)


def _collisions(result: Result, seed: int) -> None:
    found = [1.0 + shared(one) for one in seeds_of(seed, 2, 8760)]
    result.all_near(
        "collisional stress of rough disks between walls, from bins over the recorded one", np.array(found), 1.0,
        ROUNDING, "f64 round-off of 1e3 collisions", "the virial that the engine adds up",
    )  # fmt: skip


def sheared(seed: int, t_end: float) -> tuple[float, float]:
    """Slope of u_x over the shear rate, and the kinetic P_xy of strips over the recorded one."""
    frames = round(10.0 * t_end)

    def use(run: Trajectory) -> tuple[float, float]:
        found = analysis.profiles(run, "y", 10, frames=range(frames + 1))
        slope = float(np.polyfit(found.middles[0], found.mean.velocity[:, 0], 1)[0])
        return slope / 0.5, float(found.mean.stress_kinetic[:, 0, 1].mean() / recorded(run)[1][0, 1])

    box = {"packing_fraction": 0.1, "shear_rate": 0.5}
    species = disks(500, "rough", speed_rms=1.5)
    return of_run(
        use, seed, t_end, frames, box=box, material=[ROUGH], species=species, output={"stress": True}
    )


def _shear(result: Result, quick: bool, seed: int) -> None:
    seeds: Sequence[int] = seeds_of(seed, 8, 8780)
    slope, stress = np.transpose([sheared(one, 10.0 if quick else 40.0) for one in seeds])
    compare(
        result, "slope of the flow of a sheared box over its rate", slope, 1.0, disks=500, seeds=seeds,
        systematic=0.0, why="none", widest=0.2, source="the imposed flow",
    )  # fmt: skip
    compare(
        result, "kinetic P_xy of strips over the recorded one", stress, 1.0, disks=500, seeds=seeds,
        systematic=0.01, why="1 %: means over frames and over rows of the series", widest=0.1,
        source="the stress that the run records",
    )  # fmt: skip
