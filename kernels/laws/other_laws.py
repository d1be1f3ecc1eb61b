"""Collision laws other than the IFR law: their formulas, as the engine calls laws.

Each takes a pair and its coefficients by name (`ifrdem.CollisionLaw.collide`). Symbols as in `law`.
"""

from ..compiler.language import ti
from .law import ifr_impulses

# Coefficients of the Pade approximant of e_n; P. Mueller and T. Poeschel, Phys. Rev. E 84, 021302 (2011),
# doi:10.1103/PhysRevE.84.021302, Table I.
C_1, B_1, B_2, B_3, B_4 = 0.501086, 0.501086, 1.15345, 0.577977, 0.532178


@ti.pyfunc
def walton_friction(P_n, beta_0, mu, g_t, m_t):
    """P_t of Walton's law, and 1.0 if it sticks, else 0.0.

    |P_t| is the smaller of mu P_n, while the contact slides, and (1 + beta_0) m_t |g_t|, which reverses the slip by
    beta_0. O. R. Walton, in Particulate Two-Phase Flow (1993), chapter 25.
    """
    P_stick = (1.0 + beta_0) * m_t * ti.abs(g_t)
    direction = 1.0 * (g_t > 0.0) - 1.0 * (g_t < 0.0)
    return direction * ti.min(mu * P_n, P_stick), 1.0 * (P_stick <= mu * P_n)


@ti.pyfunc
def walton_parts(pair, law):
    """Walton's law with a ledger: as `law.ifr_parts`. A collision that sticks has restitution only, else friction."""
    P_n = (1.0 + law.e_n) * pair.m_n * pair.g_n
    P_t, sticking = walton_friction(P_n, law.beta_0, law.mu, pair.g_t, pair.m_t)
    return P_n, P_t, 0.0 * P_n, sticking * P_t, sticking, 0.0 * P_n


@ti.pyfunc
def walton(pair, law):
    """Walton's law: P_n, P_t and no rolling friction."""
    P_n, P_t, T, _, _, _ = walton_parts(pair, law)
    return P_n, P_t, T


@ti.pyfunc
def fifth_root(x):
    """x^(1/5) of 0 <= x < 1e60, by square roots and divisions only, so that all devices give the same bits.

    The product of roots is x^(3/16 + 3/256), a factor of 1.11 off at most. Newton's method squares and doubles the
    relative error: 0.11, 0.025, 1.3e-3, 3e-6, 2e-11 there, and rounding from 1e-12 to 1e12.
    """
    x = ti.max(x, 1e-37)
    eighth = ti.sqrt(ti.sqrt(ti.sqrt(x)))
    sixteenth = ti.sqrt(eighth)
    small = ti.sqrt(ti.sqrt(ti.sqrt(sixteenth)))
    y = eighth * sixteenth * small * ti.sqrt(small)
    for _ in ti.static(range(4)):
        square = y * y
        y = y - (y - x / (square * square)) * 0.2
    return y


@ti.pyfunc
def restitution(x, b):
    """Normal restitution of viscoelastic spheres at b and its root x: 1 - e_n = 1.15345 b for small b.

    With the elastic force K xi^(3/2), K = 2 Y sqrt(R) / 3 of the reduced radius R, and the damping force 3 A K sqrt(xi)
    xi' / 2, the equation of motion of the overlap xi has one number only, b = (3/2) A (K / m_n)^(2/5) g_n^(1/5).
    """
    return (1.0 + C_1 * x) / (1.0 + B_1 * x + b * (B_2 + B_3 * x + B_4 * b))


@ti.pyfunc
def viscoelastic_parts(pair, law):
    """Normal restitution of viscoelastic spheres, friction of the IFR law or of Walton's, as `law.ifr_parts`.

    With `law.walton` = 1.0 the row of the IFR law is that of no restitution and no rolling friction.
    """
    stiffness = 2.0 * law.Y * ti.sqrt(pair.reduced_radius) / (3.0 * pair.m_n)
    b = 1.5 * law.A * fifth_root(stiffness * stiffness * pair.g_n)
    e_n = restitution(ti.sqrt(b), b)
    P_n, P_t_ifr, T, sticks_ifr, rolling, P_et = ifr_impulses(
        e_n, law.e_t, law.mu, law.contact_point, law.rho,
        pair.g_n, pair.g_t, pair.m_n, pair.m_t, pair.radius_i, pair.radius_j,
    )  # fmt: skip
    P_t_walton, sticks_walton = walton_friction(P_n, law.beta_0, law.mu, pair.g_t, pair.m_t)
    ifr = 1.0 - law.walton
    P_t = law.walton * P_t_walton + ifr * P_t_ifr
    P_et = law.walton * sticks_walton * P_t_walton + ifr * P_et
    sticking = law.walton * sticks_walton + ifr * sticks_ifr
    return P_n, P_t, T, P_et, sticking, rolling * (law.rho > 0.0)


@ti.pyfunc
def viscoelastic(pair, law):
    """Viscoelastic spheres without a ledger: P_n, P_t, T of `viscoelastic_parts`."""
    P_n, P_t, T, _, _, _ = viscoelastic_parts(pair, law)
    return P_n, P_t, T
