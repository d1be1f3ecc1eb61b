"""The gas of a trajectory for kinetic theory, which starts from the temperatures of the first frame."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, TheoryWarning, cut
from ..model.laws.ifr import EnergyWarning
from ..model.laws.law import CollisionLaw
from ..model.state import Disks, kinds_of
from ..theory.choose import PREDICT, Prediction, is_closed
from ..theory.collisions import collision_rate, is_smooth
from ..theory.driven_gas import Driving
from ..theory.hydrodynamics import self_diffusion, shear_viscosity, thermal_conductivity
from ..theory.mixtures import Mixture
from ..theory.sheared_gas import SteadyFlow, steady_flow
from ..tools.checked import Array
from ..tools.old_words import present_force
from ..trajectory.reader import Trajectory
from . import result
from .common import MeanValue
from .stress import mean_stress


class Curves(NamedTuple):
    """Times, T and T_rot [energy] and collisions per disk at them, (steps,) each, and the name of the theory."""

    times: Array
    temperature: Array
    rotational_temperature: Array
    collisions_per_disk: Array
    text: str


MOST_KINDS = 16
"""Most kinds of disks: theory sums over all pairs of kinds at every step, which takes seconds beyond this."""
VELOCITIES = {"gaussian": "Gaussian", "sonine": "Sonine", "dsmc": "DSMC"}
"""Words for `theory.Prediction.velocities` in legends."""
FLOW = {"N_1": "N_1", "friction": "friction", "T_x_over_T_y": "T_x / T_y", "viscosity": "viscosity"}
"""Numbers of `analyse stress` in a flow for which there is a theory: their keys, and what they are called."""
RATIOS = ("normal_difference", "friction", "temperature_ratio")
"""Properties of `Stress` that the first of `FLOW` are."""
FLOW_ROWS = 201
"""Times at which DSMC of a flow is sampled."""
LONGER = 1e6
"""Longest curve of theory, in durations of the run, where theory needs more time for the collisions of the run."""


@dataclass(frozen=True)
class TheoryGas:
    """The gas of a trajectory for kinetic theory: each kind of disks starts with its own temperatures."""

    disks: Disks
    laws: list[list[CollisionLaw]]
    phi: float
    T0: Array
    T_rot0: Array
    forces: list[dict[str, Any]]
    kind: NDArray[np.int64]
    """Kind of each disk, in the order of `Mixture.of`, shape (n,)."""

    @property
    def kinds(self) -> int:
        """Number of kinds of disks."""
        return len(self.T0)

    @property
    def one_kind(self) -> tuple[Any, float, float, float, float]:
        """Law, mass, radius, k and packing fraction, as theories of equal disks take them."""
        d, material = self.disks, int(self.disks.material[0])
        return self.laws[material][material], float(d.mass[0]), float(d.radius[0]), float(d.k[0]), self.phi

    @property
    def smooth_restitution(self) -> float | None:
        """e_n of equal smooth disks whose e_n is a constant; None of others."""
        law = self.one_kind[0]
        return law.e_n if self.kinds == 1 and is_smooth(law) and not law.depends_on_speed else None

    def prediction(self, elapsed: Array, shear_rate: float = 0.0) -> Prediction:
        """Temperatures `elapsed` after the first frame [time]; InputError where no theory describes the gas."""
        with (  # the run has given both warnings
            warnings.catch_warnings(action="ignore", category=EnergyWarning),
            warnings.catch_warnings(action="ignore", category=TheoryWarning),
        ):
            return PREDICT.get()(
                self.disks, self.laws, self.phi, self.T0, self.T_rot0, elapsed, forces=self.forces,
                shear_rate=shear_rate, velocities="best",
            )  # fmt: skip

    def of_groups(self, groups: Sequence[NDArray[np.intp]], elapsed: Array) -> tuple[Array, Array, str]:
        """T and T_rot of groups of disks [energy], shape (steps, groups) each, and a name; as `prediction`."""
        found = self.prediction(elapsed)
        of = found.species
        if of is None:
            raise InputError("kinetic theory of a sheared gas has no temperatures of species")
        share = np.array([np.bincount(self.kind[ids], minlength=self.kinds) / len(ids) for ids in groups])
        return of.temperature @ share.T, of.rotational_temperature @ share.T, self.text(found)

    def steady_flow(self, shear_rate: float) -> SteadyFlow | None:
        """The steady state of a sheared gas, None without one; InputError where no theory describes the gas."""
        with warnings.catch_warnings(action="ignore", category=TheoryWarning):  # the run has said it
            for known, text in (
                (not self.forces, "forces in a flow"),
                (self.kinds == 1, "several kinds of disks in a flow"),
                (not self.laws[0][0].depends_on_speed, "e_n that depends on the speed, in a flow"),
            ):
                if not known:
                    raise InputError(f"{text}: no kinetic theory here")
            return steady_flow(*self.one_kind, shear_rate)

    def of_flow(self, shear_rate: float, span: tuple[float, float] = (0.0, 0.0)) -> dict[str, MeanValue]:
        """Ratios of stresses and the viscosity [energy time/length^2] of a flow, by the keys of `FLOW`.

        Of the steady flow, without errors; by DSMC means over a `span` of times after the first frame, with errors.
        InputError or TheoryError where no theory describes the gas, InputError where there is no steady state.
        """
        if not is_closed():
            times = np.linspace(0.0, span[1], FLOW_ROWS)
            parts = self.prediction(times, shear_rate).stress
            assert parts is not None
            kinetic, collisional = (each[1:].reshape(-1, 4) for each in parts)
            found = mean_stress(times, kinetic + collisional, kinetic, span=span)
            stress, shear = found.stress, (float(found.error[0, 1]), float(found.n_eff[0, 1]))
            errors = {
                each: (getattr(found, f"{each}_error"), getattr(found, f"{each}_n_eff")) for each in RATIOS
            }
        elif (flow := self.steady_flow(shear_rate)) is None:
            raise InputError("no steady state by kinetic theory: the flow heats this gas without end")
        else:
            stress, shear = flow.stress, (np.nan, np.nan)
            errors = dict.fromkeys(RATIOS, shear)
        ratios = [MeanValue(getattr(stress, each), *errors[each]) for each in RATIOS]
        viscosity = MeanValue(float(stress.total[0, 1]), *shear).times(-1.0 / shear_rate)
        return dict(zip(FLOW, (*ratios, viscosity), strict=True))

    def enskog(self, T: float, *, spins: bool) -> dict[str, float]:
        """eta [mass/time], D [length^2/time], and kappa [1/time] without `spins`, of equal smooth elastic disks.

        By Enskog's theory at the temperature T [energy]; empty of others. Spins, which smooth disks never change, carry
        energy too.
        """
        if self.smooth_restitution != 1.0:
            return {}
        _, mass, radius, _, phi = self.one_kind
        found = {
            "eta": shear_viscosity(phi, T, mass, radius),
            "D": self_diffusion(1.0) * T / (mass * collision_rate(phi, T, mass, radius)),
        }
        return found if spins else found | {"kappa": thermal_conductivity(phi, T, mass, radius)}

    def curves(self, trajectory: Trajectory, elapsed: Array, over: str, shear_rate: float = 0.0) -> Curves:
        """T and T_rot of all disks, `elapsed` after the first frame; over "tau" up to the collisions of the run."""
        before = end = 0.0
        if "collisions" in trajectory.observables:
            before, end = 2.0 * trajectory.observables["collisions"][[0, -1]] / self.disks.n
        if over == "tau":
            elapsed = np.append(0.0, elapsed[elapsed > 0.0])
        while True:
            found = self.prediction(elapsed, shear_rate)
            collisions = before + found.collisions_per_disk
            if (
                over == "t"
                or collisions[-1] >= end
                or elapsed[-1] > LONGER * np.ptp(trajectory.times[[0, -1]])
            ):
                shown = slice(None) if over == "t" else slice(int(np.searchsorted(collisions, end)) + 1)
                when, T, T_rot, tau = (
                    each[shown]
                    for each in (
                        elapsed + trajectory.times[0],
                        found.temperature,
                        found.rotational_temperature,
                        collisions,
                    )
                )
                return Curves(when, T, T_rot, tau, self.text(found))
            elapsed = np.append(elapsed, elapsed[-1] * 2.0 ** np.linspace(0.05, 1.0, 20))

    def text(self, found: Prediction) -> str:
        """Name of a prediction in the legend."""
        what = "flow" if found.kind == "sheared" else "gas" if self.kinds == 1 else "mixture"
        by, words = (
            ("DSMC", "")
            if found.velocities == "dsmc"
            else ("kinetic theory", f", {VELOCITIES[found.velocities]}")
        )
        return f"{by} (homogeneous {what}){words}"


def name_of_theory() -> str:
    """Name of the theory in use, in texts and legends."""
    return "kinetic theory" if is_closed() else "DSMC"


def gas_of(trajectory: Trajectory) -> TheoryGas | str:
    """The gas of a trajectory as kinetic theory takes it, or the reason why theory does not hold."""
    if trajectory.missing:
        return "a part is missing: no kinetic theory here"
    disks = trajectory.disks
    kinds = int(kinds_of(disks).max(initial=-1)) + 1
    for invalid, text in (
        (trajectory.free_area.all_walls, "walls"),
        (trajectory.parameters.get("collapse", "none") != "none", "elastic exceptions against collapse"),
        (trajectory.box.is_open, "open box"),
        (not disks.movable.all(), "immovable disks"),
        ("laws" not in trajectory.parameters, "no law in the file"),
        (trajectory.has_custom_laws, "custom law"),
        (kinds > MOST_KINDS, f"more than {MOST_KINDS} kinds of disks"),
    ):
        if invalid:
            return f"{text}: no kinetic theory here"
    phi = trajectory.box.packing_fraction(disks.radius)
    with warnings.catch_warnings(action="ignore", category=EnergyWarning):
        try:
            laws = [[one for one in line if one is not None] for line in trajectory.laws]
            if any(len(line) < len(laws) for line in laws):
                return "materials that never meet: no kinetic theory here"
            which = kinds_of(disks)
            if is_closed():
                if any(getattr(one, "rho", 0.0) > 0.0 for line in laws for one in line):
                    return "rolling friction: no kinetic theory here"
                if not all(one.has_averages for line in laws for one in line):
                    return "a law without averages: no kinetic theory here"
                Mixture.of(disks, laws, phi)  # which refuses what it cannot describe
        except InputError as error:
            return f"no kinetic theory here: {cut(error.reason)}"
    forces = trajectory.record("forces", _forces, "[]")
    if kinds == 1:
        start = [trajectory.observables[name][:1] for name in ("temperature", "rotational_temperature")]
    else:
        frame, members = trajectory[0], [which == kind for kind in range(kinds)]
        velocity = frame.velocity - result.drift(trajectory, range(len(trajectory))).velocity
        moving = 0.5 * disks.mass * np.sum(velocity**2, axis=1)
        spinning = disks.inertia * frame.spin**2
        start = [np.array([each[those].mean() for those in members]) for each in (moving, spinning)]
    return TheoryGas(disks, laws, phi, start[0], start[1], forces, which)


def _forces(given: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The forces of a case, as far as the theory supports them."""
    forces = [present_force(each) for each in given]
    Driving.of(forces, 1.0, 1.0)
    return forces
