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
from .law import relative_motion
from .layout import (
    DRIFT,
    DURATION,
    GX,
    GY,
    HEAVIEST,
    INVERSE_MASS,
    KIND,
    KIND_RADIUS,
    MATERIAL,
    MOST_ENERGY,
    N_LOG,
    SLOT,
    SPIN,
    STANDS,
    WALL_SPEED,
    K,
)
from .seen import before, disks_seen, wall_seen, was_elastic
from .walls import TEMPERATURE, WALL_MATERIAL

# Rows of `losses`: all so far; those of the epoch in plain double precision, a check; 1 where it fails.
ALL, EPOCH, WRONG = range(3)
# Columns of `losses` and `regimes`.
NORMAL, RESTITUTION, SLIDING_LOSS, STICKING_LOSS, ROLLING_LOSS, AT_WALLS = range(6)
SLIDES, STICKS, ROLLS_SLIDING, ROLLS_STICKING, ELASTICALLY = range(5)

RECORDS = 256  # that one thread handles at a time
# What one disk has at most, in units; parts of a unit. Sums reach 2^63 units, 2^41 times that; a loss is rounded by
# 2^-55 of it.
MOST_IN_UNITS, PARTS = 2.0**22, 2.0**32


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
def kind_of(i, gas: ti.template()):
    """Kind of disk i; where there is but one, without a look at the disk, which is far away in memory."""
    kind = 0
    if gas.kinds.shape[0] > 1:
        kind = gas.meta[i][KIND]
    return kind


@ti.func
def energy_of(i, speed2, gas: ti.template()):
    """Kinetic energy of disk i, whose speed squared is `speed2`; of an immovable one what it may give to another."""
    kind = kind_of(i, gas)
    im = gas.kinds[kind][INVERSE_MASS]
    rim = gas.flight[i][SPIN] * gas.kinds[kind][KIND_RADIUS]
    mass = gas.scale[HEAVIEST]
    if im > 0.0:
        mass = 1.0 / im
    return 0.5 * mass * (speed2 + rim * rim / gas.kinds[kind][K])


@ti.func
def energy_unit(gas: ti.template()):
    """How many of the whole numbers that energies are added up as make an energy of 1; 0 where nothing moves.

    They suit the disk that has most energy as the epoch begins, and what gravity, walls and a flow may give to one.
    """
    pull = ti.sqrt(gas.scale[GX] * gas.scale[GX] + gas.scale[GY] * gas.scale[GY])
    given = ti.cast(gas.scale[WALL_SPEED] + pull * gas.scale[DURATION] + ti.abs(gas.scale[DRIFT]), ti.f64)
    most = ti.cast(gas.limit[MOST_ENERGY], ti.f64) + ti.cast(gas.scale[HEAVIEST], ti.f64) * given * given
    unit = 0.0 * most
    if most > 0.0:
        unit = MOST_IN_UNITS / most
    return unit


@ti.func
def loss_in(entry, gas: ti.template()):
    """Energy that the collision of a record took, by mechanism, and its regime; -1 for those with walls."""
    lost = ti.Vector([0.0] * 6, ti.f64)
    regime = -1
    i, other = gas.log_int[entry][SLOT], gas.log_int[entry][SLOT + 1]
    if was_elastic(entry, gas):
        if other >= 0:
            regime = ELASTICALLY
    else:
        kind = kind_of(i, gas)
        radius = gas.kinds[kind][KIND_RADIUS]
        # Who the partner is decides its numbers only: the law is compiled once.
        nx, ny, ux, uy, w_j = 0.0 * radius, 0.0 * radius, 0.0 * radius, 0.0 * radius, 0.0 * radius
        im_j, radius_j, k_j, q = 0.0 * radius, radius, 1.0 + 0.0 * radius, 0
        vx, vy, w_i = before(entry, 0, gas)
        there = 1
        if other >= 0:
            _t, _x, _y, nx, ny, drift = disks_seen(entry, gas)
            ux, uy, w_j = before(entry, 1, gas)
            ux += drift
            kind_j = kind_of(other, gas)
            im_j, k_j = gas.kinds[kind_j][INVERSE_MASS], gas.kinds[kind_j][K]
            radius_j = gas.kinds[kind_j][KIND_RADIUS]
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
                regime = 2 * rolls + sticks
                for column in ti.static(range(5)):
                    lost[column] = took[column]
            else:
                lost[AT_WALLS] = took.sum()
    return lost, regime


@ti.func
def tally(b, unit, gas: ti.template()):
    """Enter what the collisions of a block of records took, those that stand, into the sums of the epoch."""
    whole, rest = ti.Vector([0] * 6, ti.i64), ti.Vector([0] * 6, ti.i64)
    rounded = ti.Vector([0.0] * 6, ti.f64)
    counts = ti.Vector([0] * 5, ti.i32)
    for entry in range(b * RECORDS, ti.min(gas.counter[N_LOG], (b + 1) * RECORDS)):
        if gas.log_int[entry][STANDS] == 1:
            lost, regime = loss_in(entry, gas)
            for column in ti.static(range(5)):
                counts[column] += regime == column
            for column in ti.static(range(6)):
                value = lost[column] * unit
                near = ti.floor(value + 0.5)
                whole[column] += ti.cast(near, ti.i64)
                rest[column] += ti.cast(ti.floor((value - near) * PARTS + 0.5), ti.i64)
                rounded[column] += lost[column]
    for column in ti.static(range(6)):
        ti.atomic_add(gas.losses_whole[0, column], whole[column])
        ti.atomic_add(gas.losses_whole[1, column], rest[column])
        ti.atomic_add(gas.losses[EPOCH, column], rounded[column])
    for column in ti.static(range(5)):
        ti.atomic_add(gas.regimes[column], ti.cast(counts[column], ti.i64))


@ti.func
def close_tally(unit, gas: ti.template()):
    """Add the sums of the epoch to the ledger, and forget its records. By one thread."""
    scale = ti.cast(0.0, ti.f64)
    for column in ti.static(range(6)):
        scale += ti.abs(gas.losses[EPOCH, column])
    for column in ti.static(range(6)):
        units = (
            ti.cast(gas.losses_whole[0, column], ti.f64)
            + ti.cast(gas.losses_whole[1, column], ti.f64) / PARTS
        )
        lost = ti.cast(0.0, ti.f64)
        if unit > 0.0:
            lost = units / unit
        # Watchdog: what is no number (NaN), or more than anybody had.
        if not ti.abs(lost - gas.losses[EPOCH, column]) * unit <= 1.0 + 1e-6 * scale * unit:
            gas.losses[WRONG, column] = 1.0
        gas.losses[ALL, column] = gas.losses[ALL, column] + lost
        gas.losses[EPOCH, column] = 0.0
        gas.losses_whole[0, column] = 0
        gas.losses_whole[1, column] = 0
    gas.counter[N_LOG] = 0


@ti.func
def n_record_blocks(gas: ti.template()):
    """Blocks of the records of the epoch that ends."""
    return (gas.counter[N_LOG] + RECORDS - 1) // RECORDS
