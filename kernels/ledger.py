"""What dissipates energy: every collision of an epoch, split into its mechanisms and added up before the log is lost.

A collision changes the kinetic energy of its pair by what its impulses do. P_n on the approach g_n takes
P_n (g_n - P_n / 2 m_n). P_t on the slip g_t takes P_t (g_t - P_t / 2 m_t); of that, the part P_et of tangential
restitution, acting first, takes P_et (g_t - P_et / 2 m_t), and friction, on the slip that is left, the rest: the
order of the two is a convention, their sum is not. The rolling torque takes what it takes from each spin. All do not
depend on the frame, and their sum is what the pair loses, to rounding.

Collisions with walls count as one mechanism, in the frame of the wall, and thermal walls not at all: the energy that
they give or take is heat (`tally.py`).
"""

import taichi as ti

from .contact import coefficients, pair_of
from .history import side_of
from .law import relative_motion
from .layout import (
    GX,
    GY,
    HEAD,
    INVERSE_MASS,
    KIND,
    MATERIAL,
    PREVIOUS,
    RADIUS,
    SLOT,
    K,
)
from .seen import before, disks_seen, wall_seen, was_elastic
from .walls import TEMPERATURE, WALL_MATERIAL

# Columns of `losses` and `regimes`.
NORMAL, RESTITUTION, SLIDING_LOSS, STICKING_LOSS, ROLLING_LOSS, AT_WALLS = range(6)
SLIDES, STICKS, ROLLS_SLIDING, ROLLS_STICKING, ELASTICALLY = range(5)


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
def losses_of(
    p, q, n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j, gas: ti.template()
):  # fmt: skip
    """Energy that a collision of materials p and q takes, by mechanism, and its regime. Arguments: `collide_pair`.

    Returns losses (normal, tangential restitution, sliding, sticking, rolling) and whether it sticks and rolls. A law
    of one's own does not tell what of P_t is restitution: all of it then counts as tangential restitution.
    """
    g_n, g_t, m_n, m_t = relative_motion(
        n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j
    )
    pair = pair_of(g_n, g_t, m_n, m_t, im_i, R_i, k_i, w_i, im_j, R_j, k_j, w_j)
    row = coefficients(p, q, gas)
    P_n, P_t, T = gas.uses.collision_law.impulses(pair, row)
    lost = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0], ti.f64)
    sticks = 0
    rolls = 0
    if g_n > 0.0:
        normal = ti.cast(P_n, ti.f64) * (g_n - 0.5 * P_n / m_n)
        tangential = ti.cast(P_t, ti.f64) * (g_t - 0.5 * P_t / m_t)
        restitution = tangential
        if ti.static(gas.uses.collision_law.parts):
            P_et, sticking, rolling = gas.uses.collision_law.parts(pair, row)
            restitution = ti.cast(P_et, ti.f64) * (g_t - 0.5 * P_et / m_t)
            sticks = ti.cast(sticking, ti.i32)
            rolls = ti.cast(rolling, ti.i32)
        lost[NORMAL] = normal
        lost[RESTITUTION] = restitution
        friction = tangential - restitution
        if sticks == 1:
            lost[STICKING_LOSS] = friction
        else:
            lost[SLIDING_LOSS] = friction
        lost[ROLLING_LOSS] = braking_loss(T, w_i - k_i * im_i / R_i * P_t, im_i, R_i, k_i)
        lost[ROLLING_LOSS] += braking_loss(T, w_j - k_j * im_j / R_j * P_t, im_j, R_j, k_j)
    return lost, sticks, rolls


@ti.func
def tally(i, lost: ti.template(), counts: ti.template(), gas: ti.template()):
    """Add what the collisions took of which disk i is the first, latest first, to sums of a block of disks."""
    entry = gas.link[i][HEAD]
    while entry >= 0:
        side = side_of(entry, i, gas)
        other = gas.log_int[entry][SLOT + 1]
        if side == 0:
            if was_elastic(entry, gas):
                counts[ELASTICALLY] += other >= 0
            else:
                kind = gas.meta[i][KIND]
                radius = gas.flight[i][RADIUS]
                # Who the partner is decides its numbers only: the law is compiled once.
                nx, ny, ux, uy, w_j = 0.0 * radius, 0.0 * radius, 0.0 * radius, 0.0 * radius, 0.0 * radius
                im_j, radius_j, k_j, q = 0.0 * radius, radius, 1.0 + 0.0 * radius, 0
                vx, vy, w_i = before(entry, 0, gas)
                there = 1
                if other >= 0:
                    _t, _x, _y, nx, ny, drift = disks_seen(entry, gas)
                    ux, uy, w_j = before(entry, 1, gas)
                    ux += drift
                    kind_j = gas.meta[other][KIND]
                    im_j, k_j = gas.kinds[kind_j][INVERSE_MASS], gas.kinds[kind_j][K]
                    radius_j = gas.flight[other][RADIUS]
                    q = ti.cast(gas.kinds[kind_j][MATERIAL], ti.i32)
                elif ti.static(gas.uses.walled):
                    w = -1 - other
                    if gas.walls[w][TEMPERATURE] > 0.0:
                        there = 0
                    else:
                        t, _x, _y, nx, ny, ux, uy = wall_seen(entry, gas)
                        vx += gas.scale[GX] * t
                        vy += gas.scale[GY] * t
                        q = ti.cast(gas.walls[w][WALL_MATERIAL], ti.i32)
                if there == 1:
                    took, sticks, rolls = losses_of(
                        ti.cast(gas.kinds[kind][MATERIAL], ti.i32), q, nx, ny,
                        gas.kinds[kind][INVERSE_MASS], radius, gas.kinds[kind][K], vx, vy, w_i,
                        im_j, radius_j, k_j, ux, uy, w_j, gas,
                    )  # fmt: skip
                    if other >= 0:
                        for column in ti.static(range(5)):
                            lost[column] += took[column]
                        regime = 2 * rolls + sticks
                        for column in ti.static(range(4)):
                            counts[column] += regime == column
                    else:
                        lost[AT_WALLS] += took.sum()
        entry = gas.log_int[entry][PREVIOUS + side]


@ti.func
def keep_sums(b, lost, counts, gas: ti.template()):
    """Add the sums of block b to the ledger."""
    for column in ti.static(range(6)):
        gas.losses[b, column] = gas.losses[b, column] + lost[column]
    for column in ti.static(range(5)):
        gas.regimes[b, column] = gas.regimes[b, column] + counts[column]
