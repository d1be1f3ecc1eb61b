"""What one collision takes, split into its mechanisms.

A collision changes the kinetic energy of its pair by what its impulses do. P_n on the approach g_n takes
P_n (g_n - P_n / 2 m_n). P_t on the slip g_t takes P_t (g_t - P_t / 2 m_t); of that, the part P_et of tangential
restitution, acting first, takes P_et (g_t - P_et / 2 m_t), and friction, on the slip that is left, the rest: the
order of the two is a convention, their sum is not. The rolling torque takes what it takes from each spin. All do not
depend on the frame, and their sum is what the pair loses, to rounding.
"""

from .language import ti
from .law import inverse_masses

# Columns of `log_loss`.
BY_NORMAL, BY_RESTITUTION, BY_FRICTION, BY_ROLLING = range(4)


@ti.func
def braking_loss(T, w_free, inverse_mass, radius, k):
    """Energy that the angular impulse T takes from a spin that is braked to rest at most."""
    inertia_free = ti.cast(0.0, ti.f64) * w_free
    if inverse_mass > 0.0:
        inertia_free = radius * radius * ti.abs(w_free) / (k * inverse_mass)
    braking = ti.min(ti.cast(T, ti.f64), inertia_free)
    loss = ti.cast(0.0, ti.f64)
    if inverse_mass > 0.0:
        loss = braking * (ti.abs(w_free) - 0.5 * braking * k * inverse_mass / (radius * radius))
    return loss


@ti.func
def losses_of(P_n, P_t, T, P_et, pair: ti.template()):
    """Energy that these impulses take from a pair that approaches (`contact.pair_of`), by the columns of `log_loss`."""
    # Divisions are what this costs: none that can be spared.
    inverse_n, inverse_t = inverse_masses(pair.inverse_mass_i, pair.k_i, pair.inverse_mass_j, pair.k_j)
    tangential = ti.cast(P_t, ti.f64) * (pair.g_t - 0.5 * P_t * inverse_t)
    restitution = ti.cast(P_et, ti.f64) * (pair.g_t - 0.5 * P_et * inverse_t)
    lost = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    lost[BY_NORMAL] = ti.cast(P_n, ti.f64) * (pair.g_n - 0.5 * P_n * inverse_n)
    lost[BY_RESTITUTION] = restitution
    lost[BY_FRICTION] = tangential - restitution
    if T != 0.0:  # a law of one's own may give a negative one, which drives spins
        free_i = pair.spin_i - pair.k_i * pair.inverse_mass_i / pair.radius_i * P_t
        free_j = pair.spin_j - pair.k_j * pair.inverse_mass_j / pair.radius_j * P_t
        lost[BY_ROLLING] = braking_loss(T, free_i, pair.inverse_mass_i, pair.radius_i, pair.k_i)
        lost[BY_ROLLING] += braking_loss(T, free_j, pair.inverse_mass_j, pair.radius_j, pair.k_j)
    return lost
