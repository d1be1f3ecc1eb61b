"""Notices about the gas of a case: what is worth a word, though nothing is wrong.

The functions are of a `CaseGas`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..model.observables import drift_text
from ..model.walls import crush
from ..simulation.steps.rotation import FASTEST_DRUM

if TYPE_CHECKING:
    from .gas import CaseGas

REPORTED_DRIFT = 1e-3
"""Part of the kinetic energy of the disks' motion above which a drift of the whole gas is reported."""


def warnings(gas: CaseGas) -> list[str]:
    """One text for each law that only the loss along the line of centres keeps from adding energy."""
    texts = dict.fromkeys(each.message for each in gas.verdicts if each.admissible and not each.strict)
    return list(texts)


def notices(gas: CaseGas) -> list[str]:
    """Texts about a drift, long steps of forces, effects that are left out, and walls on which no disk can rest."""
    from .estimate import long_steps

    texts, froude = [*drifting(gas), *long_steps(gas)], drum(gas)
    if froude > FASTEST_DRUM:
        texts.append(
            f"box.gravity_rotation_rate = {gas.case.box.gravity_rotation_rate:g}: the Froude number of such a "
            f"drum, {froude:.3g}, is above {FASTEST_DRUM}: its frame has centrifugal and Coriolis accelerations, "
            "too, which are left out"
        )
    texts += [*forgotten(gas), *aliased(gas), *unlikely_units(gas)]
    if gas.case.run.resting_speed is None:
        return texts
    for i, wall in enumerate(gas.walls):
        if wall.supports_rest:
            continue
        reason = "has a temperature" if wall.temperature else "moves"
        instead = (
            ""
            if wall.temperature
            else "; "
            + (
                "in the frame of a slow drum gravity turns: let the wall stand, and give box.gravity_rotation_rate"
                if wall.turn.kind == "steady" or (wall.shape == "container" and wall.surface_speed)
                else "in the frame of a steady motion the wall stands: let it, and move all others the other way"
                if wall.motion.kind == "steady" or wall.surface_speed
                else "a floor that shakes has no frame in which gravity is constant: its disks stay awake"
            )
        )
        texts.append(f'wall[{i}] {reason}, and supports no disks with run.collapse = "rest"{instead}')
    return texts


MOST_PHASES = 20
"""Phases of a period at which frames may be for means at each of them."""


def aliased(gas: CaseGas) -> list[str]:
    """Text about frames that are at many phases of the walls, each of them at another one, and seldom in a period."""
    case = gas.case
    if case.period is None or case.run.t_end is None:
        return []
    cadence = case.frame_cadence
    if cadence.spacing != "even" or cadence.collisions is not None:
        return []
    interval = cadence.interval or (case.run.t_end - gas.begin[0]) / (cadence.number or 1)
    apart = interval / case.period
    phases = next(
        (m for m in range(1, MOST_PHASES + 1) if math.isclose(m * apart, round(m * apart), rel_tol=1e-6)), 0
    )
    if phases or apart < 1.0 / MOST_PHASES:
        return []
    return [
        f"frames are {apart:.4g} periods of the walls apart: they fall on more than {MOST_PHASES} phases of the motion, "
        "so that a film runs at another speed, or backwards; output.frames_phases = 8 has 8 frames in each period"
    ]


def drifting(gas: CaseGas) -> list[str]:
    """Text about a drift that has more than `REPORTED_DRIFT` of the energy of the disks' motion."""
    if not gas.drift_share > REPORTED_DRIFT:
        return []
    case = gas.case
    per = f"{case.unit('length')}/{case.unit('time').strip()}" if case.unit("length") else ""
    media = [each.kind for each in case.force if each.has_medium]
    about = "Speeds, collision rates and temperatures are about its mean velocity"
    if media:
        about = (
            "Speeds and collision rates here are about its mean velocity; temperatures of the run are not, for "
            f"the medium of {' and '.join(dict.fromkeys(media))} is at rest"
        )
    return [
        f"the whole gas drifts at {drift_text(gas.drift)}{per}, {100.0 * gas.drift_share:.4g} % of the kinetic "
        f"energy of its motion. {about}. The run takes longer than that of the same gas without the drift: windows "
        "end where the fastest disk has come too far"
    ]


def forgotten(gas: CaseGas) -> list[str]:
    """Texts about quantities of the disks that the frame of the start does not store."""
    run, name = gas.case.run, "start.motion = true: the frame does not store"
    texts: list[str] = []
    if gas.given is None or not gas.case.start.motion:
        return texts
    if run.contact_time is not None:
        until = gas.given.time + run.contact_time
        texts.append(
            f"{name} when disks collided last: until t = {until:.6g}, run.contact_time counts collisions since the "
            "start only"
        )
    if any(wall.temperature for wall in gas.walls):
        texts.append(
            f"{name} how often disks hit thermal walls: with the seed of its run they draw the same random "
            f"velocities again, with another run.seed than {run.seed} others"
        )
    if run.resting_speed is not None and "asleep" not in gas.given.past:
        texts.append(f"{name} which disks sleep (output.fields, asleep): all are awake at first")
    return texts


LIGHTEST, HEAVIEST = 0.01, 500.0
"""Areal densities of real disks, m / (pi R^2) [kg/m^2]: a film of plastic of 10 um, or balls of glass of 3 um, and a
cylinder of steel of 60 mm. A length in mm in place of m makes it 1e6 times too small, a mass in g 1e3 times too large.
"""


def unlikely_units(gas: CaseGas) -> list[str]:
    """A text for each species whose areal density no real disk has: a sign of numbers in other units than SI."""
    if gas.case.run.units != "SI":
        return []
    texts = []
    for each in gas.species:
        density = each.areal_density
        if each.mass is not None:
            density = each.mass / (math.pi * each.summary.radius.mean**2)
        if not LIGHTEST <= density <= HEAVIEST:
            texts.append(
                f"disks of species '{each.name}' have {density:.3g} kg/m^2 by mass and radius, real ones "
                f"{LIGHTEST:g} to {HEAVIEST:g}: are lengths in m, not mm, and masses in kg, not g? "
                'run.units = "reduced" is for numbers without units'
            )
    return texts


def drum(gas: CaseGas) -> float:
    """Froude number of the drum in whose frame gravity turns: Omega^2 R / g, R of the widest container.

    Half of the box's longer side where there is none; 0 if gravity does not turn.
    """
    section = gas.case.box
    radii = [wall.radius for wall in gas.walls if wall.shape == "container"]
    radius = max(radii) if radii else 0.5 * max(gas.box.lengths)
    return section.gravity_rotation_rate**2 * radius / (math.hypot(*section.gravity) or 1.0)


def wall_pinch_warnings(gas: CaseGas) -> list[str]:
    """One text for each two walls that may crush a disk between them in the run; InputError if they must."""
    if not gas.n:
        return []
    end = math.inf if gas.case.run.t_end is None else gas.case.run.t_end
    return crush.wall_pinch_warnings(gas.free_area.all_walls, gas.box, gas.kinds.radius, gas.begin[0], end)
