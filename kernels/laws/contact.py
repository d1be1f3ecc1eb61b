"""Collision of two disks, or of a disk and a wall: law, coefficients, velocities after it, and energy losses.

Two remedies for inelastic collapse make collisions elastic:

- a *velocity cut-off*: those whose normal speed of approach is below it;
- the *tc rule*: those of which either partner's latest collision, with a disk or a wall, was less than the contact time
  ago. S. Luding and S. McNamara, Granul. Matter 1, 113 (1998), doi:10.1007/s100350050017.

Losses of kinetic energy by mechanism, none of which depends on the frame; their sum is the pair's loss, to rounding:

- P_n on the approach g_n: P_n (g_n - P_n / 2 m_n);
- P_t on the slip g_t: P_t (g_t - P_t / 2 m_t). The part P_et of tangential restitution acts first and takes
  P_et (g_t - P_et / 2 m_t); friction takes the rest. This order is a convention, the sum is not;
- the rolling torque: what it takes from each spin.
"""

from ..columns import LOSS, TRIAL_TABLES
from ..compiler.language import ti
from ..compiler.records import NamedVector
from .law import after_impulses, inverse_masses, relative_motion
from ..compiler.signature import Arrays, kernel


@ti.func
def braking_loss(T, w_free, inverse_mass, radius, k):
    """Energy that the angular impulse T takes from a spin that is braked to rest at most; none of walls, k <= 0."""
    inertia_free = ti.cast(0.0, ti.f64) * w_free
    if k * inverse_mass > 0.0:
        inertia_free = radius * radius * ti.abs(w_free) / (k * inverse_mass)
    braking = ti.min(ti.cast(T, ti.f64), inertia_free)
    loss = ti.cast(0.0, ti.f64)
    if k * inverse_mass > 0.0:
        loss = braking * (ti.abs(w_free) - 0.5 * braking * k * inverse_mass / (radius * radius))
    return loss


@ti.func
def losses_of(given: ti.template(), pair: ti.template()):
    """Energy that the impulses `given` take from a pair that approaches (`impulses_between`): a vector of `LOSS`."""
    # Divisions are what this costs: none that can be spared.
    inverse_n, inverse_t = inverse_masses(pair.inverse_mass_i, pair.k_i, pair.inverse_mass_j, pair.k_j)
    tangential = ti.cast(given.P_t, ti.f64) * (pair.g_t - 0.5 * given.P_t * inverse_t)
    restitution = ti.cast(given.P_et, ti.f64) * (pair.g_t - 0.5 * given.P_et * inverse_t)
    lost = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    loss = NamedVector(lost, LOSS)
    loss.normal = ti.cast(given.P_n, ti.f64) * (pair.g_n - 0.5 * given.P_n * inverse_n)
    loss.tangential_restitution = restitution
    loss.friction = tangential - restitution
    if given.T != 0.0:  # a custom law may give a negative one, which drives spins
        free_i = pair.spin_i - pair.k_i * pair.inverse_mass_i / pair.radius_i * given.P_t
        free_j = pair.spin_j - pair.k_j * pair.inverse_mass_j / pair.radius_j * given.P_t
        loss.rolling = braking_loss(given.T, free_i, pair.inverse_mass_i, pair.radius_i, pair.k_i)
        loss.rolling += braking_loss(given.T, free_j, pair.inverse_mass_j, pair.radius_j, pair.k_j)
    return lost


# Bits of `regime` (`collided`): the collision was elastic by one of the two; with a ledger, whether friction stopped
# the slip, and whether the rolling torque was its greatest.
STICKS, ROLLS, ELASTIC = 1, 2, 4
LEAST_REBOUND = 0.1  # of the resting speed


@ti.func
def impulses_between(
    p, q, n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j, reduced_radius, gas: ti.template()
):  # fmt: skip
    """Impulses by the law of materials p and q, P_n, P_t, T, with a ledger P_et, sticks, rolls; the pair, with its g_n.

    g_n is below 0 where it separates by rounding. All of P_t counts as restitution for a custom law, which does not
    divide it. Arguments as for `law.collide_pair`, and the reduced radius, as of `law.reduced_radius` or
    `walls.shapes.reduced_radius_at`.
    """
    g_n, g_t, m_n, m_t = relative_motion(
        n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j
    )
    pair = ti.Struct(  # what a law gets (`law.CollisionLaw.collide`)
        # A pair that separates by rounding has no power 1/5 of its approach; its impulses do not count.
        g_n=ti.max(g_n, 0.0), g_t=g_t, m_n=m_n, m_t=m_t,
        inverse_mass_i=im_i, radius_i=R_i, k_i=k_i, spin_i=w_i,
        inverse_mass_j=im_j, radius_j=R_j, k_j=k_j, spin_j=w_j, reduced_radius=reduced_radius,
    )  # fmt: skip
    names = ti.static(gas.uses.collision_law.names)
    law = ti.Struct({names[j]: gas.law[p, q][j] for j in ti.static(range(len(names)))})
    if ti.static(gas.uses.rest):
        # A contact that lasts (`events/rest.py`): e_n = 1 except for the least rebound.
        if g_n < gas.scale.resting_speed:
            pair.g_n = ti.max(g_n, LEAST_REBOUND * gas.scale.resting_speed)
            law.e_n, law.e_t, law.contact_point = g_n / pair.g_n, -1.0, 1.0
    # One of these, so that a law is compiled once.
    impulses = ti.Vector([0.0 * g_n] * 6)
    if ti.static(gas.uses.collision_law.has_table):
        P_n, P_t, T, P_et, sticking, rolling = gas.uses.collision_law.parts(pair, law, gas.law[p, q])
        impulses = ti.Vector([P_n, P_t, T, P_et, sticking, rolling])
    elif ti.static(gas.uses.ledger and gas.uses.collision_law.parts):
        P_n, P_t, T, P_et, sticking, rolling = gas.uses.collision_law.parts(pair, law)
        impulses = ti.Vector([P_n, P_t, T, P_et, sticking, rolling])
    else:
        P_n, P_t, T = gas.uses.collision_law.impulses(pair, law)
        impulses = ti.Vector([P_n, P_t, T, P_t, 0.0 * g_n, 0.0 * g_n])
    pair.g_n = g_n
    given = ti.Struct(
        P_n=impulses[0], P_t=impulses[1], T=impulses[2], P_et=impulses[3], sticks=impulses[4], rolls=impulses[5]
    )  # fmt: skip
    return given, pair


@ti.func
def collided(
    p, q, n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j, reduced_radius, persistent,
    gas: ti.template(),
):  # fmt: skip
    """Velocities and spins after a collision of materials p and q, vx_i, vy_i, w_i, vx_j, vy_j, w_j; how; its losses.

    How: ELASTIC; else, with a ledger, STICKS and ROLLS; else 0. Losses: as of `losses_of`; 0 without one.
    Arguments as for `impulses_between`; p and q are materials. A pair that separates keeps its velocities and spins.
    With `persistent` > 0 (the tc rule), or below the cut-off, disks collide like smooth elastic ones.
    """
    given, pair = impulses_between(
        p, q, n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j, reduced_radius, gas
    )
    elastic = pair.g_n < gas.scale.velocity_cutoff
    if ti.static(gas.uses.rest):
        elastic = pair.g_n < gas.scale.resting_speed
    if ti.static(gas.uses.contact_time):
        elastic = elastic or persistent > 0
    regime = 0
    lost = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    approaching = 1.0 * (pair.g_n > 0.0)
    if ti.static(gas.uses.rest):
        approaching = 1.0 * (given.P_n > 0.0)  # also a pair that separates too slowly
        if elastic and given.P_n > 0.0:
            if ti.static(gas.uses.ledger):
                lost = losses_of(given, pair)
                regime = STICKS * ti.cast(given.sticks, ti.i32)
            regime += ELASTIC
            elastic = False
        elif pair.g_n > 0.0:
            if ti.static(gas.uses.ledger):
                lost = losses_of(given, pair)
                regime = STICKS * ti.cast(given.sticks, ti.i32) + ROLLS * ti.cast(given.rolls, ti.i32)
    elif elastic:
        given.P_n = 2.0 * pair.m_n * pair.g_n
        given.P_t = 0.0
        given.T = 0.0
        regime = ELASTIC
    elif pair.g_n > 0.0:
        if ti.static(gas.uses.ledger):
            lost = losses_of(given, pair)
            regime = STICKS * ti.cast(given.sticks, ti.i32) + ROLLS * ti.cast(given.rolls, ti.i32)
    vx_i_new, vy_i_new, w_i_new, vx_j_new, vy_j_new, w_j_new = after_impulses(
        approaching * given.P_n, approaching * given.P_t, approaching * given.T,
        n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j,
    )  # fmt: skip
    after = ti.Struct(vx_i=vx_i_new, vy_i=vy_i_new, w_i=w_i_new, vx_j=vx_j_new, vy_j=vy_j_new, w_j=w_j_new)
    return after, regime, lost


@kernel
def sample_law(gas: Arrays("uses law pairs found", TRIAL_TABLES)):
    """Collide each of c pairs, n along x and disk j at rest: a row of `found` for each of `pairs`."""
    for c in range(gas.pairs.shape[0]):
        it, result = gas.pairs[c], gas.found[c]
        p, q = ti.cast(it.material_i, ti.i32), ti.cast(it.material_j, ti.i32)
        given, pair = impulses_between(
            p, q, 1.0, 0.0, it.inverse_mass_i, it.radius_i, it.k_i, it.vx_i, it.vy_i, it.spin_i,
            it.inverse_mass_j, it.radius_j, it.k_j, 0.0, 0.0, it.spin_j, it.reduced_radius, gas,
        )  # fmt: skip
        result.P_n = given.P_n
        result.least_P_n = pair.m_n * pair.g_n
        result.vx_i, result.vy_i, result.spin_i, result.vx_j, result.vy_j, result.spin_j = after_impulses(
            given.P_n, given.P_t, given.T, 1.0, 0.0,
            it.inverse_mass_i, it.radius_i, it.k_i, it.vx_i, it.vy_i, it.spin_i,
            it.inverse_mass_j, it.radius_j, it.k_j, 0.0, 0.0, it.spin_j,
        )  # fmt: skip
