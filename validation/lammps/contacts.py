"""Hertz-Mindlin contacts of LAMMPS as laws of impacts: tabulated, and laws of few coefficients fitted to impacts.

With `damping coeff_restitution` Hertz's contact has no scale of speed: impacts at one speed give P_t / P_n against
|g_t| / g_n for all of them. A table of them separates two causes by which gases may differ: the law, and the duration
and softness of contacts.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...model.laws.collision import collide, impulses
from ...model.laws.ifr import IFRLaw
from ...model.laws.law import OF_PAIR, CollisionLaw
from ...model.laws.table import TableLaw
from ...model.laws.viscoelastic import Viscoelastic
from ...model.laws.walton import Walton
from ...plots import style
from ...tools.checked import Array
from . import world
from .world import M_N, M_T, Contact, SingleImpacts

E_N, MU = 0.9, 0.2
TABLE, WALTON, PERCUSSION, CONTACT_POINT = "table", "Walton", "IFR, percussion centre", "IFR, contact point"
COLOURS: Mapping[str, str] = dict(zip((TABLE, WALTON, PERCUSSION, CONTACT_POINT), style.KINDS, strict=False))
POINTS = 60
LAST = 60.0
"""Angle of incidence [degrees] up to which contacts are tabulated; they slide from 50 degrees on."""
SPEED = 1.5
ETA = 9677.0
"""Viscosity of `damping viscoelastic`, with which e_n is 0.9 at g_n = 1.77 for contacts `stiff(1e-3)`."""


def hertz_mindlin(overlap: float) -> Contact:
    """The contact with e_n = 0.9 and mu = 0.2 that overlaps by so many diameters at g_n = 1.5."""
    return world.stiff(overlap, SPEED, mu=MU, eta=E_N)


def viscoelastic(overlap: float, *, limit: bool = True) -> Contact:
    """A contact with the same e_n at each g_n, whatever its overlap at g_n = 1.5.

    b of `laws.Viscoelastic` has A Y^(2/5), and A = eta m_n / Y: eta is proportional to Y^(3/5).
    """
    contact = world.stiff(overlap, SPEED, mu=MU)
    eta = ETA * (contact.k / world.stiff(1e-3, SPEED).k) ** 0.6
    return contact._replace(damping="viscoelastic", eta=eta, limit=limit)


def law_of(contact: Contact, **friction: float | str) -> Viscoelastic:
    """`laws.Viscoelastic` of a contact with viscoelastic damping: Y = E / (1 - nu^2), A = eta m_n / Y."""
    return Viscoelastic(A=contact.eta * M_N / contact.modulus, Y=contact.modulus, **friction)  # type: ignore[arg-type]


@functools.cache
def tabulated(overlap: float) -> TableLaw:
    """`hertz_mindlin(overlap)` as a law of impacts."""
    slip = np.tan(np.radians(np.linspace(0.5, LAST, POINTS)))
    found = world.impacts(hertz_mindlin(overlap), SPEED, SPEED * slip, steps=40)
    slip, ratio = found.g_t / found.g_n, np.minimum(found.ratio, MU)
    ratio[-1] = MU
    return TableLaw(slip=slip, ratio=ratio, e_n=E_N)


def with_speed(table: TableLaw, law: Viscoelastic) -> TableLaw:
    """A table with the e_n of viscoelastic disks."""
    speed = np.geomspace(1e-4, 30.0, 120)
    e_n = [law.restitution(float(g_n), mass=1.0, radius=0.5) for g_n in speed]
    return TableLaw(slip=table.slip, ratio=table.ratio, e_n=e_n, g_n=speed)


def impacts_of_gas(contact: Contact, number: int = 400, seed: int = 1) -> SingleImpacts:
    """Impacts as in a Maxwellian gas with T = T_rot = 1; those slower than 0.05, which take long, are left out."""
    rng = np.random.default_rng(seed)
    g_n = 2.0 * np.sqrt(rng.exponential(size=number))
    spins = rng.normal(0.0, 2.0, number)  # of both disks, R^2 (<w_1^2> + <w_2^2>) = 4
    g_t = rng.normal(0.0, np.sqrt(2.0), number) + spins
    some = g_n > 0.05
    return world.impacts(contact, g_n[some], g_t[some], (spins / g_t)[some])


def after(law: CollisionLaw, impacts: SingleImpacts) -> tuple[Array, Array]:
    """g_t and the sum of spins after impacts, by `ifrdem.collide`."""
    by_centres = impacts.g_t - 0.5 * impacts.spins
    first = np.stack((impacts.g_n, by_centres), axis=-1)
    velocity = np.stack((first, np.zeros_like(first)), axis=-2)
    spin = np.repeat(0.5 * impacts.spins[..., None], 2, axis=-1)
    found = collide(law, [1.0, 0.0], [1.0, 1.0], [0.5, 0.5], [impacts.k] * 2, velocity, spin)
    spins = found.spin.sum(axis=-1)
    return np.asarray(found.velocity[..., 0, 1] - found.velocity[..., 1, 1] + 0.5 * spins), spins


def tangential(law: CollisionLaw, row: Array, g_n: Array, g_t: Array) -> Array:
    """P_t of a law with a row of coefficients, of two disks."""
    given = {"g_n": g_n, "g_t": g_t, "m_n": M_N, "m_t": M_T, "reduced_radius": 0.25}
    given |= {f"{name}_{one}": value for one in "ij" for name, value in
              (("inverse_mass", 1.0), ("radius", 0.5), ("k", 2.0), ("spin", 0.0))}  # fmt: skip
    return impulses(type(law), [np.asarray(given[name]) for name in OF_PAIR], [*row])[1]


def fitted(
    contact: Contact, names: Sequence[str] = (WALTON, PERCUSSION, CONTACT_POINT), number: int = 400
) -> dict[str, CollisionLaw]:
    """Walton's law and the IFR law with both kinds of sticking, fitted to so many impacts of a gas: least squares of P_t.

    Errors of velocities and spins that are equal in energy weight P_t equally in all impacts.
    """
    from scipy.optimize import least_squares

    found = impacts_of_gas(contact, number)
    P_t = found.ratio * M_N * (found.g_n - found.h_n)
    e_n = float(np.sum(found.e_n * found.g_n**2) / np.sum(found.g_n**2))

    def best(law: type[CollisionLaw], name: str, low: float, **fixed: str) -> CollisionLaw:
        def law_at(values: Array) -> CollisionLaw:
            return law(e_n=e_n, mu=float(values[1]), **{name: float(values[0])}, **fixed)  # type: ignore[arg-type]

        def off(values: Array) -> Array:
            one = law_at(values)
            return tangential(one, np.array(one.table_row()), found.g_n, found.g_t) - P_t

        # beta_0 up to 1; more than 0 for e_t adds energy.
        most = 1.0 if law is Walton else -0.5
        at = least_squares(
            off, (low + 0.2, MU), bounds=((low, 0.0), (most, 2.0)), x_scale=0.1, diff_step=1e-6
        )
        return law_at(at.x)

    made: dict[str, Callable[[], CollisionLaw]] = {
        WALTON: lambda: best(Walton, "beta_0", -1.0),
        PERCUSSION: lambda: best(IFRLaw, "e_t", -1.0, sticking="percussion_center"),
        CONTACT_POINT: lambda: best(IFRLaw, "e_t", -1.0, sticking="contact_point"),
    }
    return {name: made[name]() for name in names}


def named(law: CollisionLaw) -> str:
    """Coefficients of a law that was fitted."""
    one, mu = ("beta_0", law.mu) if isinstance(law, Walton) else ("e_t", law.mu)
    return f"{one} = {getattr(law, one):.3f}, mu = {mu:.3f}"
