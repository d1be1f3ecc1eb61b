"""Collisions of the tracked disks of a trajectory as one table: a row for each collision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.laws.ifr import ELASTIC, Regime
from ..model.laws.law import parts_of
from ..quantities import EVENT, MECHANISMS
from .history import KICK
from .species import named_species

if TYPE_CHECKING:
    from .reader import Trajectory

Array = NDArray[np.float64]
COLUMNS = {
    "time": ("time of the collision", "time"),
    "id": ("number of the disk", "1"),
    "partner": ("number of the other disk; -2 - w: wall w", "1"),
    "species": ("species of the disk", ""),
    "partner_species": ("species of the other disk; of a wall its group or \"wall W\"", ""),
    "x": ("point of contact", "length"),
    "y": ("point of contact", "length"),
    "normal_x": ("unit vector from the centre of the disk to the contact", "1"),
    "normal_y": ("unit vector from the centre of the disk to the contact", "1"),
    "g_n": ("relative velocity at the contact along the normal, before the collision, above 0", "velocity"),
    "g_t": ("relative velocity at the contact along t = (-n_y, n_x), before the collision, with spins", "velocity"),
    "psi": ("impact angle, between relative velocity and line of centres", "radian"),
    "P_n": ("impulse that the disk gives along the normal", "momentum"),
    "P_t": ("impulse that the disk gives along t", "momentum"),
    "regime": ("regime, as in histories", "1"),
    "dissipated": ("energy that the collision took", "energy"),
    **{f"dissipated_{name}": (f"part of it: {name.replace('_', ' ')}", "energy") for name in MECHANISMS[:-1]},
    "free_time": ("time since the previous collision of the disk; nan for its first one", "time"),
    "free_path": ("path of the disk in that time", "length"),
    "partner_free_time": ("that of the other disk, if it is tracked", "time"),
    "partner_free_path": ("that of the other disk, if it is tracked", "length"),
}  # fmt: skip
"""Text and dimension of each column."""


def table(trajectory: Trajectory) -> dict[str, NDArray[Any]]:
    """Every collision of the tracked disks once, in the order of time: the columns of `COLUMNS`, (collisions,) each.

    Of two tracked disks `id` is the one with the smaller number. Energies are those of the run's ledger: P_n on the
    approach, P_t on the slip, of which the law's tangential restitution has a part that acts first, and what the
    rolling torque takes from spins; of walls all of it is `dissipated_walls`, with the spin of a wall that turns taken
    as 0 for rolling friction. The parts of tangential restitution and friction are nan if the law is that of a file
    that may not be run (`run_law_files`). Ways are straight between collisions, kicks and crossings of sides; under a
    constant force they are those of the parabola, by Gauss' rule.

    Raises InputError if the file has no histories.
    """
    count, *_ = trajectory.tracked_events
    events = {name: trajectory.read_events(name, count) for name in EVENT if name != "image"}
    order = np.lexsort((events["time"], events["id"]))
    events = {name: values[order] for name, values in events.items()}
    free_time, free_path = _since_the_one_before(events)
    other = _event_of_partner(events)
    kept = (events["partner"] != KICK) & ((other < 0) | (events["id"] < events["partner"]))
    rows = np.flatnonzero(kept)
    rows = rows[np.argsort(events["time"][rows], kind="stable")]
    of = {name: values[rows] for name, values in events.items()}
    of_partner = np.where(other[rows] >= 0, other[rows], len(free_time))
    partner_free = [np.append(each, np.nan)[of_partner] for each in (free_time, free_path)]
    disks, i, j = trajectory.disks, of["id"], of["partner"]
    normal = of["normal"]
    g_n, g_t = _at_contact(of, disks.radius, "before")
    names = _names(trajectory)
    found: dict[str, NDArray[Any]] = {
        "time": of["time"], "id": i, "partner": j,
        "species": names[i], "partner_species": np.where(j >= 0, names[j], _wall_names(trajectory, j)),
    }  # fmt: skip
    contact = of["position"] + disks.radius[i, None] * normal
    found |= {"x": contact[:, 0], "y": contact[:, 1], "normal_x": normal[:, 0], "normal_y": normal[:, 1]}
    found |= {
        "g_n": g_n,
        "g_t": g_t,
        "psi": of["psi"],
        "P_n": of["impulse"][:, 0],
        "P_t": of["impulse"][:, 1],
    }
    found["regime"] = of["regime"]
    found |= _dissipated(trajectory, of, g_n, g_t)
    found |= {"free_time": free_time[rows], "free_path": free_path[rows]}
    found |= {"partner_free_time": partner_free[0], "partner_free_path": partner_free[1]}
    return {name: found[name] for name in COLUMNS}


def _since_the_one_before(events: dict[str, NDArray[Any]]) -> tuple[Array, Array]:
    """Time and way since the collision before of each event of a disk; nan of its first collision, and of kicks.

    Events are in the order of disks and times. From one event to the next the velocity changes evenly or not at all;
    both ends are known.
    """
    time, ids = events["time"], events["id"]
    same = np.concatenate(([False], ids[1:] == ids[:-1]))
    step = np.where(same, np.diff(time, prepend=time[:1]), 0.0)
    begin = np.concatenate((events["velocity_before"][:1], events["velocity_after"][:-1]))
    end = events["velocity_before"]
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    speed = sum(
        0.5 * weight * np.hypot(*(begin + 0.5 * (1.0 + node) * (end - begin)).T)
        for node, weight in zip(nodes, weights, strict=True)
    )
    way = np.cumsum(step * speed)
    hits = np.flatnonzero(events["partner"] != KICK)
    free_time, free_path = np.full(len(time), np.nan), np.full(len(time), np.nan)
    later = hits[1:][ids[hits[1:]] == ids[hits[:-1]]]
    earlier = hits[:-1][ids[hits[1:]] == ids[hits[:-1]]]
    free_time[later], free_path[later] = time[later] - time[earlier], way[later] - way[earlier]
    return free_time, free_path


def _event_of_partner(events: dict[str, NDArray[Any]]) -> NDArray[np.intp]:
    """Row of the same collision among the events of the partner; -1 if that is not tracked, a wall, or none."""
    key = events["id"] + 1j * events["time"]  # sorted as complex numbers are: by disk, then by time
    wanted = events["partner"] + 1j * events["time"]
    at = np.searchsorted(key, wanted).clip(max=max(len(key) - 1, 0))
    return np.where(key[at] == wanted, at, -1) if len(key) else at


def _at_contact(of: dict[str, NDArray[Any]], radius: Array, when: str) -> tuple[Array, Array]:
    """g_n and g_t before or after collisions."""
    i, j, normal = of["id"], of["partner"], of["normal"]
    g = of[f"velocity_{when}"] - of[f"partner_velocity_{when}"]
    slip = radius[i] * of[f"spin_{when}"] + np.where(j >= 0, radius[j], 0.0) * of[f"partner_spin_{when}"]
    return g[:, 0] * normal[:, 0] + g[:, 1] * normal[:, 1], g[:, 1] * normal[:, 0] - g[:, 0] * normal[
        :, 1
    ] + slip


def _dissipated(
    trajectory: Trajectory, of: dict[str, NDArray[Any]], g_n: Array, g_t: Array
) -> dict[str, NDArray[Any]]:
    """Energy that collisions took, by mechanism as `kernels.laws.contact` divides it.

    The whole is impulses times the mean relative velocity at the contact, and what the rolling torque takes from spins.
    """
    disks, i, j = trajectory.disks, of["id"], of["partner"]
    P_n, P_t = of["impulse"].T
    after_n, after_t = _at_contact(of, disks.radius, "after")
    normal = 0.5 * P_n * (g_n + after_n)
    torques = _rolling(disks, i, of["spin_before"], of["spin_after"], P_t)
    torques += _rolling(disks, j, of["partner_spin_before"], of["partner_spin_after"], P_t)
    whole, pair = normal + 0.5 * P_t * (g_t + after_t) + torques, j >= 0
    inverse = np.where(disks.movable, (1.0 + disks.k) / disks.mass, 0.0)
    inverse_t = inverse[i] + np.where(pair, inverse[j], 0.0)
    tangential = P_t * (g_t - 0.5 * P_t * inverse_t)  # without what the rolling torque changes of the slip
    rolling = whole - normal - tangential
    rolling[np.abs(rolling) <= ROUNDING * np.abs(whole)] = 0.0
    restitution = np.zeros(len(i))
    known = pair & (P_t != 0.0)
    some = {name: each[known] for name, each in of.items()}
    restitution[known] = _restitution(trajectory, some, g_n[known], g_t[known])
    friction, sticks = tangential - restitution, np.isin(of["regime"], STICKING)
    parts = {
        "normal": normal, "tangential_restitution": restitution, "sliding": np.where(sticks, 0.0, friction),
        "sticking": np.where(sticks, friction, 0.0), "rolling": rolling,
    }  # fmt: skip
    found = {"dissipated": whole}
    found |= {f"dissipated_{name}": np.where(pair, part, 0.0) for name, part in parts.items()}
    return found | {"dissipated_walls": np.where(pair, 0.0, whole)}


NODES = 12
"""Of Gauss' rule for the length of a parabola."""
ROUNDING = 1e-12
STICKING = (Regime.STICKING, Regime.STICKING_ROLLING, Regime.STICKING_NONROLLING)
"""Regimes in which friction sticks; 6 without rolling."""


def _rolling(disks: Any, of: NDArray[Any], before: Array, after: Array, P_t: Array) -> Array:
    """Energy that the rolling torque took from spins: what changes them beside the torque of P_t; 0 by rounding."""
    own = np.where((of >= 0) & disks.movable[of], of, 0)
    inertia, lever = disks.inertia[own], disks.radius[own] * P_t
    torque = inertia * (after - before) + lever
    scale = inertia * (np.abs(before) + np.abs(after)) + np.abs(lever)
    real = (of >= 0) & disks.movable[of] & (np.abs(torque) > 1e-9 * scale)
    return np.where(real, -0.5 * torque * (before + after), 0.0)


def _restitution(trajectory: Trajectory, of: dict[str, NDArray[Any]], g_n: Array, g_t: Array) -> Array:
    """P_et (g_t - P_et / 2 m_t) of pairs of disks by their laws; nan where the law may not be run."""
    from ..kernels.laws.law import inverse_masses, reduced_radius  # imports Taichi, which is slow
    from ..model.laws.collision import impulses

    disks, i, j = trajectory.disks, of["id"], of["partner"]
    found = np.full(len(i), np.nan)
    try:
        laws = trajectory.laws
    except InputError:
        return found
    a, b = disks.material[i], disks.material[j]
    inverse = np.where(disks.movable, 1.0 / disks.mass, 0.0)
    inverse_n, inverse_t = inverse_masses(inverse[i], disks.k[i], inverse[j], disks.k[j])
    pair = (
        g_n, g_t, 1.0 / inverse_n, 1.0 / inverse_t, inverse[i], disks.radius[i], disks.k[i], of["spin_before"],
        inverse[j], disks.radius[j], disks.k[j], of["partner_spin_before"], reduced_radius(disks.radius[i], disks.radius[j]),
    )  # fmt: skip
    for p, q in {*zip(a.tolist(), b.tolist(), strict=True)}:
        law, rows = laws[p][q], np.flatnonzero((a == p) & (b == q))
        if law is None:
            continue
        parts = parts_of(type(law))
        P_et = of["impulse"][rows, 1]  # of a law that does not divide it
        if parts is not None:
            P_et = impulses(type(law), tuple(each[rows] for each in pair), law.table_row(), parts)[3]
        found[rows] = P_et * (g_t[rows] - 0.5 * P_et * inverse_t[rows])
    return np.where(of["regime"] == ELASTIC, 0.0, found)


def _names(trajectory: Trajectory) -> NDArray[np.str_]:
    """Name of the species of each disk; empty without names."""
    named = named_species(trajectory.parameters, trajectory.n)
    if named is None:
        return np.full(trajectory.n, "")
    return np.repeat(np.array([*named]), [*named.values()])


def _wall_names(trajectory: Trajectory, partner: NDArray[Any]) -> NDArray[np.str_]:
    """Name of the wall of each collision with one."""
    groups = [wall.group for wall in trajectory.walls]
    number = np.maximum(-2 - partner, 0)
    names = [next(iter(groups[w : w + 1]), "") or f"wall {w}" for w in range(int(number.max(initial=0)) + 1)]
    return np.array(names)[number]
