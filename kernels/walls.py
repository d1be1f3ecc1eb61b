"""Walls: when a disk meets one, and what happens then.

A wall is a disk of infinite mass to the law. Between collisions a disk moves in a frame that falls freely from the
beginning of the epoch on: there all flights are straight, and pairs never notice gravity. Only walls, which do not
fall, see parabolas; here times are those of the epoch, positions those of the box, and velocities those of the lab.

The *gap* f(t) between a disk and a wall is positive while they are apart. Its first root is found by steps that cannot
pass it: from t, with a lower bound c of f'' until the horizon, f(t + s) >= f + f' s + c s^2 / 2, and the next t is the
smallest root of that parabola. Where the bound is f'' itself (flat walls, at rest or in steady motion, with gravity or
without; containers without gravity), the first step ends at the root; elsewhere steps converge like Newton's.

A row of `walls` holds

==============  ==========================================================================================
column          meaning
==============  ==========================================================================================
TYPE            LINE, SEGMENT, CONTAINER (disks inside of a circle) or POST (disks outside of one)
PX, PY          a point of a line, the beginning of a segment, the centre of a circle
QX, QY          a line's unit normal, towards the disks; the end of a segment minus its beginning
CIRCLE          radius of a circle
MOTION          STILL, STEADY, SINE or SAWTOOTH displacement along (UX, UY), a unit vector
UX, UY
AMPLITUDE       of the displacement; for STEADY the speed
RATE            angular frequency of SINE, frequency of SAWTOOTH
PHASE           at t = 0 of the run, in radians (SINE) or periods (SAWTOOTH)
RISE            part of its period in which SAWTOOTH rises, from -AMPLITUDE to AMPLITUDE
SURFACE         speed of the wall's surface along its tangent, (-n_y, n_x) of the normal towards the disk
WALL_MATERIAL   row of the law's table
NOW_0           what MOTION needs to know of the beginning of the epoch: displacement (STEADY), phase
TEMPERATURE     of a thermal wall [energy], which does not follow the law (`thermal.py`); else 0
HEAT            column of `wall_heat` of a thermal wall, else -1
==============  ==========================================================================================

Thermal walls: a disk leaves with a random velocity, as if it had come from a gas behind the wall.

Why the normal component is not Gaussian: of a gas with the Maxwellian density f(v) ~ exp(-m v^2 / 2 T), those disks
that pass a line in a time dt come from a distance v_n dt, so that their velocities are distributed as v_n f(v),
v_n > 0. The factors separate. Along the wall v_t stays Gaussian with variance T/m, the spin, whatever v is, with T/I;
the normal component has the density (m v_n / T) exp(-m v_n^2 / 2 T), Rayleigh's. Its part above v_n is
exp(-m v_n^2 / 2 T): set equal to a uniform u, v_n = sqrt(-2 (T/m) ln u). A gas of the same temperature sends to the
wall just what it gets back, and stays what it is. R. Tehver et al., Phys. Rev. E 57, R17 (1998),
doi:10.1103/PhysRevE.57.R17, tell what goes wrong with other densities.
"""

from .contact import ELASTIC, collided, just_collided
from .flights import rounding
from .history import record
from .language import ti
from .layout import (
    CELLS_X,
    CELLS_Y,
    EVENTS,
    FAR,
    FIRST_WALL,
    GX,
    GY,
    HORIZON,
    HOW,
    ID,
    INVERSE_MASS,
    KIND,
    MATERIAL,
    N_ELASTIC,
    N_WALL_HITS,
    NOW,
    NUMBER,
    PARTNER,
    PREVIOUS,
    RADIUS,
    RESTING,
    SEED_HIGH,
    SEED_LOW,
    SLOT,
    SPIN,
    STANDS,
    TAU,
    TE,
    TILE_X,
    TILE_Y,
    TILES_Y,
    TIME,
    VX,
    VY,
    WALLS,
    K,
    X,
    Y,
)
from .levels import limit_if_too_fast
from .random import DRAWS, normals, rayleigh

PLACE = 0xFFFF * DRAWS  # in streams of random numbers: the index that no force has


@ti.func
def thermal_velocity(i, number, temperature, nx, ny, ux, uy, gas: ti.template()):
    """Velocity and spin of disk i after its collision `number` of the epoch, with a wall of this temperature [energy].

    (nx, ny) is the wall's normal towards the disk, (ux, uy) the velocity of its surface.

    The random numbers depend on the seed, the disk, and how many collisions it has had before, with disks and walls,
    in the epoch and before: on nothing that threads, cuts or rollbacks change.
    """
    stream = ti.Vector([
        ti.cast(gas.meta[i][ID], ti.u32), ti.cast(gas.meta[i][EVENTS] + number, ti.u32), ti.u32(0),
        ti.u32(PLACE), ti.cast(gas.grid[SEED_LOW], ti.u32), ti.cast(gas.grid[SEED_HIGH], ti.u32),
    ], ti.u32)  # fmt: skip
    kind = gas.meta[i][KIND]
    spread = ti.sqrt(temperature * gas.kinds[kind][INVERSE_MASS])
    v_n = spread * rayleigh(stream, 0)
    along = normals(stream, 1)
    v_t = spread * along[0]
    # sqrt(T/I), I = m R^2 / k
    spin = spread * ti.sqrt(gas.kinds[kind][K]) / gas.flight[i][RADIUS] * along[1]
    return ux + v_n * nx - v_t * ny, uy + v_n * ny + v_t * nx, spin


TYPE, PX, PY, QX, QY, CIRCLE, MOTION, UX, UY = range(9)
AMPLITUDE, RATE, PHASE, RISE, SURFACE, WALL_MATERIAL, NOW_0, TEMPERATURE, HEAT = range(9, 18)
LINE, SEGMENT, CONTAINER, POST = range(4)
STILL, STEADY, SINE, SAWTOOTH = range(4)
MOST_STEPS = 1000  # towards a root; grazing contacts with oscillating walls take tens
TWO_PI = 6.283185307179586


@ti.func
def wall_phases(gas: ti.template()):
    """At the beginning of an epoch: where every wall is in its motion. In double precision, for long runs."""
    for w in range(gas.grid[WALLS]):
        motion = ti.cast(gas.walls[w][MOTION], ti.i32)
        now = ti.cast(gas.clock[NOW], ti.f64)
        rate = ti.cast(gas.walls[w][RATE], ti.f64)
        phase = ti.cast(gas.walls[w][PHASE], ti.f64)
        at = ti.cast(gas.walls[w][AMPLITUDE], ti.f64) * now
        if motion == SINE:
            turns = (rate * now + phase) / TWO_PI
            at = TWO_PI * (turns - ti.floor(turns))
        elif motion == SAWTOOTH:
            turns = rate * now + phase
            at = turns - ti.floor(turns)
        gas.walls[w][NOW_0] = ti.cast(at, float)


@ti.func
def wall_motion(w, t, gas: ti.template()):
    """Displacement of wall w along its direction at time t of the epoch, its speed, a bound of the magnitude of its
    acceleration, and the time until which all three hold."""
    motion = ti.cast(gas.walls[w][MOTION], ti.i32)
    amplitude = gas.walls[w][AMPLITUDE]
    rate = gas.walls[w][RATE]
    at = gas.walls[w][NOW_0]
    s = 0.0 * t
    speed = 0.0 * t
    bound = 0.0 * t
    until = FAR + 0.0 * t
    if motion == STEADY:
        s = at + amplitude * t
        speed = amplitude
    elif motion == SINE:
        s = amplitude * ti.sin(at + rate * t)
        speed = amplitude * rate * ti.cos(at + rate * t)
        bound = ti.abs(amplitude) * rate * rate
    elif motion == SAWTOOTH:
        rise = gas.walls[w][RISE]
        turns = at + rate * t
        whole = ti.floor(turns)
        part = turns - whole
        # At the very end of a piece, the next one is what counts.
        if part > rise - 64.0 * ti.static(epsilon()) and part < rise:
            part = rise
        if part > 1.0 - 64.0 * ti.static(epsilon()):
            part = 0.0 * t
            whole += 1.0
        if part < rise:
            s = amplitude * (2.0 * part / rise - 1.0)
            speed = 2.0 * amplitude * rate / rise
            until = (whole + rise - at) / rate
        else:
            s = amplitude * (1.0 - 2.0 * (part - rise) / (1.0 - rise))
            speed = -2.0 * amplitude * rate / (1.0 - rise)
            until = (whole + 1.0 - at) / rate
    return s, speed, bound, until


def epsilon():
    """Spacing of real numbers at 1."""
    return 1.2e-7 if ti.lang.impl.get_runtime().default_fp == ti.f32 else 2.3e-16


@ti.func
def wall_vector(w, x, y, s, gas: ti.template()):
    """From the point of wall w that is nearest to (x, y), the wall displaced by s, to (x, y): unit vector, distance.

    For a container, the vector points inwards.
    """
    kind = ti.cast(gas.walls[w][TYPE], ti.i32)
    dx = x - gas.walls[w][PX] - gas.walls[w][UX] * s
    dy = y - gas.walls[w][PY] - gas.walls[w][UY] * s
    qx, qy = gas.walls[w][QX], gas.walls[w][QY]
    nx, ny = qx, qy
    distance = dx * qx + dy * qy
    if kind == SEGMENT:
        along = ti.min(ti.max((dx * qx + dy * qy) / (qx * qx + qy * qy), 0.0), 1.0)
        dx -= along * qx
        dy -= along * qy
    if kind != LINE:
        r = ti.sqrt(dx * dx + dy * dy)
        nx, ny = dx / r, dy / r
        distance = r - gas.walls[w][CIRCLE]
        if kind == CONTAINER:
            nx, ny = -nx, -ny
            distance = gas.walls[w][CIRCLE] - r
            if r == 0.0:  # in the middle of a container, all directions are the same
                nx, ny = 1.0 + 0.0 * x, 0.0 * x
    return nx, ny, distance


@ti.func
def wall_time(w, x, y, vx, vy, tau, radius, horizon, gas: ti.template()):
    """When a disk, at (x, y) at time `tau` with the falling frame's velocity, first touches wall w; FAR if not in time.

    Returns the time, and 1 if the disk rests on the wall, which has no next collision.
    """
    gx, gy = gas.scale[GX], gas.scale[GY]
    kind = ti.cast(gas.walls[w][TYPE], ti.i32)
    found = FAR + 0.0 * tau
    resting = 0
    t = tau
    going = 1
    steps = 0
    while going == 1:
        steps += 1
        # A fall since the beginning of the epoch.
        at_x = x + vx * (t - tau) + 0.5 * gx * t * t
        at_y = y + vy * (t - tau) + 0.5 * gy * t * t
        s, speed, bound, until = wall_motion(w, t, gas)
        ux, uy = gas.walls[w][UX], gas.walls[w][UY]
        rel_x = vx + gx * t - ux * speed
        rel_y = vy + gy * t - uy * speed
        nx, ny, distance = wall_vector(w, at_x, at_y, s, gas)
        f = distance - radius
        slope = nx * rel_x + ny * rel_y
        pull = ti.sqrt(gx * gx + gy * gy)
        curve = -(pull + bound)
        if kind == LINE:
            curve = gx * nx + gy * ny - ti.abs(ux * nx + uy * ny) * bound
        # Positions are sums of numbers as large as these.
        tolerance = 8.0 * ti.static(epsilon()) * (ti.abs(at_x) + ti.abs(at_y) + radius + gas.walls[w][CIRCLE])
        noise = ti.static(rounding()) * (ti.abs(vx) + ti.abs(vy) + pull * t + ti.abs(speed))
        if kind == CONTAINER:
            # The same roots for (R_c - R)^2 - r^2, whose second derivative is bounded: -2 v^2 without forces.
            inner = gas.walls[w][CIRCLE] - radius
            r = gas.walls[w][CIRCLE] - distance
            gain = (pull + bound) * (ti.min(horizon, until) - t)
            most = ti.sqrt(rel_x * rel_x + rel_y * rel_y) + gain
            f = inner * inner - r * r
            slope *= 2.0 * r
            curve = -2.0 * (most * most + (pull + bound) * inner)
            tolerance *= 2.0 * inner
            noise *= 2.0 * inner
        if f <= tolerance:
            if slope < -noise:
                found = t
                going = 0
            elif slope <= noise and curve < 0.0:
                # Without speed, and pulled together. A container pulls by its curvature alone: a disk slides along it.
                resting = 1
                going = 0
            f = 0.0
        if going == 1:
            step = FAR + 0.0 * t
            d = slope * slope - 2.0 * curve * f
            if f == 0.0:
                if curve < 0.0:
                    step = -2.0 * slope / curve
            elif d >= 0.0:
                if slope < 0.0 and curve >= 0.0:
                    step = 2.0 * f / (ti.sqrt(d) - slope)
                elif curve < 0.0:
                    # Both signs of the slope: the one positive root, in the form that does not cancel.
                    if slope <= 0.0:
                        step = 2.0 * f / (ti.sqrt(d) - slope)
                    else:
                        step = (slope + ti.sqrt(d)) / -curve
            # A step too small for the clock would never end.
            step = ti.max(step, ti.static(epsilon()) * ti.max(t, 1.0e-3 * horizon))
            if t + step > until:
                t = until
            else:
                t += step
            if t >= horizon or steps >= MOST_STEPS:
                going = 0
                if steps >= MOST_STEPS:
                    resting = 1
    return found, resting


@ti.func
def corner_of(i, gas: ti.template()):
    """Lower left corner of disk i's tile."""
    return corner_of_tile(gas.cell[i] // (gas.grid[CELLS_X] * gas.grid[CELLS_Y]), gas)


@ti.func
def corner_of_tile(tile, gas: ti.template()):
    """Lower left corner of a tile."""
    tx = tile // gas.grid[TILES_Y]
    return tx * gas.scale[TILE_X], (tile - tx * gas.grid[TILES_Y]) * gas.scale[TILE_Y]


@ti.func
def note_walls(i, x, y, reach, gas: ti.template()):
    """Note which walls disk i, at (x, y) at the beginning of the epoch, can touch while it moves no further than its
    reach in the falling frame."""
    corner_x, corner_y = corner_of(i, gas)
    horizon = gas.scale[HORIZON]
    fall = 0.5 * ti.sqrt(gas.scale[GX] ** 2 + gas.scale[GY] ** 2) * horizon * horizon
    near = 0
    for w in range(gas.grid[WALLS]):
        s, speed, bound, _ = wall_motion(w, 0.0 * horizon, gas)
        way = ti.abs(speed) * horizon + 0.5 * bound * horizon * horizon
        if ti.cast(gas.walls[w][MOTION], ti.i32) == SAWTOOTH:
            way = 2.0 * ti.abs(gas.walls[w][AMPLITUDE])
        _, _, distance = wall_vector(w, corner_x + x, corner_y + y, s, gas)
        if distance - gas.flight[i][RADIUS] <= 1.001 * (reach + fall + way):
            near |= 1 << w
    gas.near_walls[i] = near


@ti.func
def first_wall(i, gas: ti.template()):
    """Disk i's earliest meeting with a wall: its time and code; FAR and -1 if there is none."""
    earliest = FAR + 0.0 * gas.scale[HORIZON]
    code = -1
    near = gas.near_walls[i]
    if near != 0:
        corner_x, corner_y = corner_of(i, gas)
        for w in range(gas.grid[WALLS]):
            if ((near >> w) & 1) == 1:
                t, resting = wall_time(
                    w, corner_x + gas.flight[i][X], corner_y + gas.flight[i][Y],
                    gas.flight[i][VX], gas.flight[i][VY], gas.flight[i][TAU], gas.flight[i][RADIUS],
                    ti.min(gas.scale[HORIZON], earliest), gas,
                )  # fmt: skip
                if resting == 1:
                    gas.counter[RESTING] = 1
                if t < earliest:
                    earliest = t
                    code = FIRST_WALL - w
    return earliest, code


@ti.func
def offer_wall(i, gas: ti.template()):
    """Make disk i's earliest meeting with a wall its event, if it comes before the one it has."""
    t, code = first_wall(i, gas)
    if t < gas.flight[i][TE] and t < gas.scale[HORIZON]:
        gas.flight[i][TE] = t
        gas.link[i][PARTNER] = code


@ti.func
def wall_met(i, w, x, y, t, gas: ti.template()):
    """Wall w as disk i, at (x, y) in the falling frame, meets it at t: unit vector to the disk, its velocity there."""
    corner_x, corner_y = corner_of(i, gas)
    s, speed, _, _ = wall_motion(w, t, gas)
    nx, ny, _ = wall_vector(
        w, corner_x + x + 0.5 * gas.scale[GX] * t * t, corner_y + y + 0.5 * gas.scale[GY] * t * t, s, gas
    )
    ux = gas.walls[w][UX] * speed - ny * gas.walls[w][SURFACE]
    uy = gas.walls[w][UY] * speed + nx * gas.walls[w][SURFACE]
    return nx, ny, ux, uy


@ti.func
def hit_wall(entry, t, i, gas: ti.template()):
    """Collide disk i with the wall that it names, at time t; log it as record `entry`, the second disk being -1 - w."""
    w = FIRST_WALL - gas.link[i][PARTNER]
    lasting = 0
    if ti.static(gas.uses.remembers):
        lasting = just_collided(i, t, gas)
    gas.log_real[entry][TIME] = t
    record(entry, 0, i, gas)
    gas.log_int[entry][SLOT + 1] = -1 - w
    gas.log_int[entry][PREVIOUS + 1] = -1
    gas.log_int[entry][NUMBER + 1] = 0
    tau = gas.flight[i][TAU]
    x = gas.flight[i][X] + gas.flight[i][VX] * (t - tau)
    y = gas.flight[i][Y] + gas.flight[i][VY] * (t - tau)
    gx, gy = gas.scale[GX], gas.scale[GY]
    nx, ny, ux, uy = wall_met(i, w, x, y, t, gas)
    kind = gas.meta[i][KIND]
    p = ti.cast(gas.kinds[kind][MATERIAL], ti.i32)
    q = ti.cast(gas.walls[w][WALL_MATERIAL], ti.i32)
    radius = gas.flight[i][RADIUS]
    vx, vy = gas.flight[i][VX] + gx * t, gas.flight[i][VY] + gy * t
    vx, vy, spin, _, _, _, how, lost = collided(
        p, q, -nx, -ny,
        gas.kinds[kind][INVERSE_MASS], radius, gas.kinds[kind][K], vx, vy, gas.flight[i][SPIN],
        0.0, radius, 1.0, ux, uy, 0.0, lasting, gas,
    )  # fmt: skip
    if ti.static(gas.uses.thermal):
        if gas.walls[w][TEMPERATURE] > 0.0:
            vx, vy, spin = thermal_velocity(
                i, gas.log_int[entry][NUMBER], gas.walls[w][TEMPERATURE], nx, ny, ux, uy, gas
            )
            how = 0
            lost = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)  # what it took or gave is heat
    gas.flight[i][X] = x
    gas.flight[i][Y] = y
    gas.flight[i][VX] = vx - gx * t
    gas.flight[i][VY] = vy - gy * t
    gas.flight[i][TAU] = t
    gas.flight[i][SPIN] = spin
    gas.log_int[entry][HOW] = how
    if ti.static(gas.uses.tallied):
        gas.log_loss[entry] = lost
    if how >= ELASTIC:
        ti.atomic_add(gas.counter[N_ELASTIC], 1)
    gas.log_int[entry][STANDS] = 1
    ti.atomic_add(gas.counter[N_WALL_HITS], 1)
    limit_if_too_fast(i, t, gas)
