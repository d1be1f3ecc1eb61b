"""Input that the engine refuses before it makes any array: InputError says what is wrong, and what to do instead."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, refuse
from ...kernels.columns import ADDRESSABLE, MOST_IDS, SINGLE_TILE, most_disks
from ...model import rules
from ...model.box import Box
from ...model.collapse import Collapse, ContactTime, Rest, VelocityCutoff
from ...model.overlaps import tolerances
from ...model.setup import Setup, library_classes
from ...model.state import Disks, State, unlike
from ...model.walls.checks import check as check_walls
from ...model.walls.wall import Wall, wall_names
from ...mpi import current
from ...quantities import PRECISIONS

if TYPE_CHECKING:
    from ...model.device import Device
    from ...model.forces import Force
    from .start import StartCounts

MOST_JUMP = 0.01
"""Jumps of disks at rest, in smallest radii: what is low against them."""
MANTISSA = {"f32": 24, "f64": 53}
"""Binary digits of a number."""
COARSEST = 0.01
"""Largest spacing of positions, and error of displacements, in smallest radii: contacts keep two digits."""
MOST_COUNTED = 2**31 - 1
"""Boxes that a disk can travel, and collisions that it can have: they are counted in 32 bits."""
LEAST_REBOUND = {"f32": 1e-3, "f64": 1e-12}
"""e_n below which rounding may leave a disk that hits a wall without any speed along the normal."""


def fastest(disks: Disks, velocity: NDArray[np.float64], spin: NDArray[np.float64]) -> float:
    """The largest velocity component or R |omega| of disks [length/time]; 0 without disks."""
    return float(max(np.abs(velocity).max(initial=0.0), (np.abs(spin) * disks.radius).max(initial=0.0)))


def kinetic_energy(disks: Disks, velocity: NDArray[np.float64], spin: NDArray[np.float64]) -> float:
    """The largest kinetic energy of a movable disk [energy]; 0 without disks."""
    movable = np.isfinite(disks.mass)
    translation = disks.mass[movable] * np.sum(velocity[movable] ** 2, axis=1)
    rotation = disks.inertia[movable] * spin[movable] ** 2
    return float(0.5 * (translation + rotation).max(initial=0.0))


def hottest(walls: Iterable[Wall], forces: Iterable[Force]) -> float:
    """The largest temperature of walls and thermostats [energy]; 0 without them."""
    of_walls = (wall.temperature or 0.0 for wall in walls)
    of_forces = (getattr(force, "hottest", 0.0) for force in forces)
    return max([0.0, *of_walls, *of_forces])


@np.errstate(over="ignore", under="ignore")
def check_magnitudes(disks: Disks, box: Box, speed: float, precision: str, hottest: float = 0.0) -> None:
    """Refuse units in which numbers that the kernels form would leave the range of their type, silently.

    Squares of discriminants and inverse inertias go furthest; times must stay below FAR (`kernels/layout.py`). The
    disks are as fast as `speed` (`fastest`); walls and thermostats may be as hot as `hottest` [energy].
    """
    low, high = (1e-30, 1e30) if precision == "f32" else (1e-280, 1e280)
    columns = [disks.mass, disks.radius, disks.k]
    if all(len(each) > 1 and each.strides[0] == 0 for each in columns):  # all are alike
        columns = [each[:1] for each in columns]
    finite = np.isfinite(columns[0])
    if not disks.n or not finite.any():
        return
    m, R, k = (each[finite] for each in columns)
    v = max(speed, float(np.sqrt(hottest / m.min())))  # of disks that come from there, v and R omega alike
    formed = {"m": m, "1 / m": 1.0 / m, "R^2": R * R, "k / (m R)": k / m / R, "k / (m R^2)": k / m / R / R}
    if v > 0.0:
        formed |= {"v^2": np.array([v * v]), "(R v)^2": (R * v) ** 2, "m v": m * v}
    for name, values in formed.items():
        if values.min() < low or values.max() > high:
            worst = values.min() if values.min() < low else values.max()
            raise InputError(
                f"units: {name} = {worst:.3g} (v: the largest speed) lies outside of {low:g} to {high:g}, what "
                f"{precision} can compute with; choose units in which masses, radii and speeds are nearer to 1"
                + ("" if precision == "f64" else ', or precision "f64"')
            )
    if v > 0.0 and not box.is_open and max(box.lengths) / v > 1e27:
        raise InputError(
            f"units: a speed of {v:.3g} takes {max(box.lengths) / v:.3g} to cross the box: more than 1e27, the longest "
            "time of the engine; choose a larger unit of time"
        )


def position_spacing(extent: float, precision: str) -> float:
    """Spacing of the grid of positions [length] in a region of this extent [length]: a power of two."""
    return 2.0 ** (math.ceil(math.log2(2.0 * extent)) - MANTISSA[precision])


def check_resolved(n: int, radius: float, box: Box, precision: str) -> None:
    """Refuse a box so large that its grid of positions is too coarse for disks of the smallest `radius` [length].

    In single precision positions of more than SINGLE_TILE disks are relative to a tile, which other rules keep small.
    """
    if box.is_open or not n or (precision == "f32" and n > SINGLE_TILE):
        return
    spacing = position_spacing(max(box.lengths), precision)
    if spacing > COARSEST * radius:
        raise InputError(
            f"a box of {box.lengths[0]:.4g} x {box.lengths[1]:.4g}: {precision} resolves positions to "
            f"{spacing:.3g}, which must be at most a hundredth of the smallest radius, {radius:.4g}: choose a denser "
            "gas, or fewer disks"
        )


def fly_alike(velocity: NDArray[np.float64]) -> bool:
    """True if all velocities, shape (n, 2), are equal and not 0; each rank gives those of its slice."""
    ends = np.concatenate([velocity.max(axis=0, initial=-np.inf), -velocity.min(axis=0, initial=np.inf)])
    ends = np.max(current().allgather(ends), axis=0)
    return bool(np.all(ends[:2] == -ends[2:]) and np.any(ends))


def check_duration(
    begin: float, t_end: float, radius: float, box: Box, alone: float, travelled: int = 0
) -> None:
    """Refuse a run so long that rounding loses the images of a sheared box, or a disk that never meets anything.

    It lasts from `begin` to `t_end` [time]. `radius` is the smallest [length]; `alone` is the speed of disks that never
    meet [length/time], 0 if any do. Images have moved since t = 0, disks since `begin`, after boxes `travelled`.
    """
    if box.is_open or not math.isfinite(t_end):
        return
    across = abs(box.shear_rate) * box.lengths[1]
    for speed, duration, what in (
        (across, t_end, "images across a sheared box move by"),
        (alone, t_end - begin, "disks that never meet fly"),
    ):
        distance = speed * duration
        error, boxes = distance * 2.0 ** -MANTISSA["f64"], distance / min(box.lengths)
        room = MOST_COUNTED - travelled
        if error > COARSEST * radius or (speed == alone and boxes > room):
            raise InputError(
                f"{what} {distance:.3g} ({boxes:.3g} boxes) in a time of {duration:.4g}, too far for the rounding or "
                f"the counter of boxes ({travelled} so far): must be a time of at most "
                f"{duration * min(COARSEST * radius / error, room / boxes):.2g}"
            )


def check_collapse(
    collapse: Collapse | None,
    disks: Disks,
    box: Box,
    walls: Sequence[Wall],
    gravity: tuple[float, float],
    e_n: NDArray[np.float64] | None,
    device: Device,
) -> None:
    """Refuse a remedy for inelastic collapse whose speeds do not suit this gas; arguments as for `Engine`.

    `e_n` (M, M) is that of each pair of materials; None for a law that has none. Walls include the sides of the box.
    """
    if isinstance(collapse, Rest):
        _check_jumps(disks, gravity, collapse)
    elif e_n is not None:
        materials = unlike([disks.material])[0].tolist()
        _check_rebound(e_n, materials, walls, box, gravity, collapse, device.precision)


def _check_rebound(
    e_n: NDArray[np.float64],
    materials: Iterable[int],
    walls: Sequence[Wall],
    box: Box,
    gravity: tuple[float, float],
    collapse: Collapse | None,
    precision: str,
) -> None:
    """Refuse disks that would stay on a wall after a hit because a remedy makes slow collisions elastic.

    A hit with e_n = 0 leaves no speed along the normal, and an elastic collision without speed does nothing. What
    presses a disk against its wall then is gravity, a curved wall, or one that accelerates. `e_n` (M, M) is that of
    each pair of materials, `materials` are those of the disks; walls include the sides of the box.
    """
    if not isinstance(collapse, ContactTime | VelocityCutoff):
        return
    least = LEAST_REBOUND.get(precision, 0.0)
    for w, wall in enumerate(walls):
        if wall.temperature is not None or not (any(gravity) or wall.presses):
            continue
        for material in materials:
            if (rebound := float(e_n[material, wall.material])) < least:
                raise InputError(
                    f"disks that hit {wall_names(walls, box)[w]} with e_n = {rebound:g} stay there without speed, and "
                    f"with collapse = {collapse} the collision that follows is elastic, without speed, and does "
                    f"nothing: e_n must be at least {least:g} there; or, under gravity, use collapse = Rest(speed)"
                )


def at_rest_on_walls(
    position: NDArray[np.float64], velocity: NDArray[np.float64], radius: NDArray[np.float64], walls: Sequence[Wall],
    gravity: tuple[float, float],
) -> tuple[int, int] | None:  # fmt: skip
    """Numbers of the first disk that lies on a wall at rest, and of the wall; None if none does.

    It touches the wall to rounding, without speed along the normal, and gravity holds it there: it has no next
    collision (`kernels/walls/root.py`). Places and velocities (n, 2), radii (n,).
    """
    noise = 1e-14 * np.abs(velocity).sum(axis=1)
    for w, wall in enumerate(walls):
        moves = wall.motion.kind != "still" or wall.turn.kind != "still" or wall.piston is not None
        if not any(gravity) or moves or not wall.is_present(0.0):
            continue
        normal, distance = wall.normal(position)
        error = 8.0 * np.finfo(np.float64).eps * (np.abs(position).sum(axis=1) + radius + wall.radius)
        still = (distance - radius <= error) & (np.abs(np.sum(normal * velocity, axis=1)) <= noise)
        if wall.shape == "line":
            still &= normal @ np.array(gravity) < 0.0
        if still.any():
            return int(np.argmax(still)), w
    return None


def check_stored(largest: Mapping[str, float], precision: str, energy: float = 0.0) -> None:
    """Refuse quantities, the largest of each by name, that a trajectory file cannot hold.

    `precision` is "f32" or "f64". `energy` is that of a disk, 0 if the file does not have what disks dissipate: single
    collisions take a small part of it, and a gas that is heated many times as much.
    """
    limits = np.finfo(PRECISIONS[precision])
    low, high = float(limits.tiny), float(limits.max)
    checked = [(name, value, low, high) for name, value in largest.items()]
    checked.append(("the field dissipated: energies of disks", energy, 1e10 * low, 1e-6 * high))
    for name, value, least, most in checked:
        if value != 0.0 and not least <= value <= most:
            raise InputError(
                f'output.precision = "{precision}": {name} of {value:.3g} cannot be stored, only from {least:.3g} to '
                f"{most:.3g}; choose units in which it is nearer to 1"
                + (', or "f64"' if precision == "f32" else "")
            )


def check(setup: Setup, disks: Disks, state: State, counts: StartCounts, ranks: int) -> None:
    """Refuse what the engine cannot simulate.

    Of ranks, `disks` and `state` may be those of a slice; `counts` are of all disks.
    """
    box, walls, device, materials = setup.box, setup.all_walls, setup.device, len(setup.law)
    check_number(counts.n, ranks, "last_partner" in setup.record, low_memory=device.low_memory)
    n = disks.n
    check_motion(disks, state)
    if n and int(disks.material.max()) >= materials:
        raise InputError(f"material index {disks.material.max()}: the law table has {materials} materials")
    diameter = 2.0 * float(disks.radius.max()) if n else 0.0
    shortest = box.shortest_period
    if diameter > shortest / 3.0:
        i = int(np.argmax(disks.radius))
        raise InputError(
            f"disk {i} has diameter {diameter:.6g}, more than a third of the periodic side {shortest:.6g}: "
            "it could meet its own periodic image; use a larger box"
        )
    thermal = sum(wall.temperature is not None for wall in walls)
    if n * thermal > ADDRESSABLE:  # each disk's heat from each
        raise InputError(
            f"{n} disks and {thermal} thermal walls: the engine's 32-bit indices allow {ADDRESSABLE // thermal} disks "
            "with so many"
        )
    check_magnitudes(disks, box, counts.speed, device.precision, hottest(walls, setup.forces))
    check_resolved(disks.n, float(disks.radius.min(initial=math.inf)), box, device.precision)
    check_walls(
        walls, box, state.position, disks.radius, materials, float(state.time),
        collisions=counts.collisions,
        tolerance=tolerances(box, disks.radius, state.position, device.rounding)[1],
    )  # fmt: skip


def check_number(n: int, ranks: int = 1, partners: bool = False, *, low_memory: bool = False) -> None:
    """Refuse more disks than 32-bit indices reach, which count disks of each rank, and ids of all of them.

    Latest `partners` are stored as numbers of 32 bits, of which those below 0 mean walls.
    """
    if partners and n > ADDRESSABLE:
        raise InputError(
            f"record = ['last_partner']: {n} disks, and latest partners are known of {ADDRESSABLE} at most"
        )
    each = most_disks(low_memory)
    most = min(ranks * each, MOST_IDS)
    if n > most:
        on = f" on {ranks} ranks" if ranks > 1 else " in one process"
        if ranks == 1 and not low_memory:
            on += f", {most_disks(True)} with low_memory = true"
        least = -(-n // each)
        instead = f": run them on {least} ranks or more (mpiexec -n {least})" if n <= MOST_IDS else ""
        raise InputError(f"{n} disks: the engine's 32-bit indices allow {most} at most{on}{instead}")


def _check_jumps(disks: Disks, gravity: tuple[float, float], collapse: Rest) -> None:
    """Refuse a resting speed at which disks would jump too high for what rest means (`kernels/events/rest.py`)."""
    pull = math.hypot(*gravity)
    jump = 0.5 * collapse.speed**2 / pull
    if disks.n and jump > MOST_JUMP * float(disks.radius.min()):
        most = math.sqrt(2.0 * pull * MOST_JUMP * float(disks.radius.min()))
        raise InputError(
            f"collapse = {collapse}: disks would jump {jump:.3g} high, v_s^2 / 2g, more than a hundredth of the "
            f"smallest radius, {disks.radius.min():.3g}; the resting speed must be at most {most:.3g}"
        )


def check_exclusions(setup: Setup, **others: Any) -> None:
    """Refuse what cannot go together (`model.rules`): InputError with a line for each exclusion.

    The setup is the one that is to be; `others` are facts that are not in it (`Setup.facts`).
    """
    box, walls, forces, device = setup.box, setup.walls, setup.forces, setup.device
    pistons = [w for w, wall in enumerate(walls) if wall.piston is not None]
    facts = setup.facts(**others)

    def said(name: str) -> str:
        """An argument, with its value."""
        first, _, kind = name.partition(".")
        if first == "forces" and kind:
            i = next(i for i, force in enumerate(forces) if kind in library_classes(force))
            return f"forces[{i}] = {forces[i]}"
        sides = f"walls at sides of the box (periodic = {box.periodic})"
        words = {
            "box.open": "box = Box.open()", "box.periodic": f"box.periodic = {box.periodic}",
            "box.shear_rate": f"box.shear_rate = {box.shear_rate:g}", "gravity": f"gravity = {setup.gravity}",
            "walls": "walls" if walls else sides if facts.walled else "walls = []",
            "walls.piston": f"walls[{next(iter(pistons), 0)}].piston", "forces": f"forces = {list(forces)}",
            "collapse": f"collapse = {setup.collapse}", "law": f"law = {facts.law}", "record": f'record = "{kind}"',
            "device.name": f'device.name = "{device.name}"', "device.low_memory": "device.low_memory = True",
            "device.precision": f'device.precision = "{device.precision}"', "order": f'order = "{facts.order}"',
            "disks.n": f"{facts.n} disk{'s' * (facts.n != 1)}", "disks.mass": "disks of infinite mass",
            "histories": "histories", "comm": f"comm of {facts.ranks} ranks",
        }  # fmt: skip
        return words.get(name) or words[first]

    broken = rules.refusals(facts)
    refuse([f"{said(rule.at)}: cannot be combined with {said(rule.with_)}: {rule.why}" for rule in broken])


def check_motion(disks: Disks, state: State) -> None:
    """Refuse immovable disks that move."""
    moving = ~disks.movable & (np.any(state.velocity != 0.0, axis=1) | (state.spin != 0.0))
    if np.any(moving):
        i = int(np.argmax(moving))
        raise InputError(
            f"disk {i} has an infinite mass and moves (velocity {state.velocity[i]}, spin {state.spin[i]}): "
            "an immovable disk must be at rest"
        )
