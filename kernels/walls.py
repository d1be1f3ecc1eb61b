"""Walls: when a disk meets one, and what happens then.

A wall is a disk of infinite mass to the law. Between collisions a disk moves in a frame that falls freely from the
beginning of the window on: there all flights are straight, and pairs never notice gravity. Only walls, which do not
fall, see parabolas; here times are those of the window, positions those of the box, and velocities those of the lab.

The *gap* f(t) between a disk and a wall is positive while they are apart. Its first root is found by steps that cannot
pass it: from t, with a lower bound c of f'' until the horizon, f(t + s) >= f + f' s + c s^2 / 2, and the next t is the
smallest root of that parabola. Where the bound is f'' itself (flat walls, at rest or in steady motion, with gravity or
without; containers without gravity), the first step ends at the root; elsewhere steps converge like Newton's.

A row of `walls` holds

==============  ==========================================================================================
column          meaning
==============  ==========================================================================================
type            LINE, SEGMENT, CONTAINER (disks inside of a circle), POST (disks outside of one), ARC_INSIDE and
                ARC_OUTSIDE (the two sides of an arc), or GONE (a gate that is open)
px, py          a point of a line, the beginning of a segment, the centre of a circle
qx, qy          a line's unit normal, towards the disks; the end of a segment minus its beginning; the unit vector to
                the middle of an arc
circle          radius of a circle
motion          STILL, STEADY, SINE, SAWTOOTH or FREE displacement along (ux, uy), a unit vector
ux, uy
amplitude       of the displacement; for STEADY the speed
rate            angular frequency of SINE, frequency of SAWTOOTH
phase           at t = 0 of the run, or at `begins`, in radians (SINE) or periods (SAWTOOTH)
rise            part of its period in which SAWTOOTH rises, from -`amplitude` to `amplitude`
surface         speed of the wall's surface along its tangent, (-n_y, n_x) of the normal towards the disk
material        row of the law's table
now             what `motion` needs to know of the beginning of the window: displacement (STEADY), phase
temperature     of a thermal wall [energy], which does not follow the law (below); else 0
heat            which of the sums of walls is the heat of a thermal wall, else -1
owner           number of the wall that this is a piece of
half            half the angle of an arc
turn            STILL, STEADY or SINE rotation about (cx, cy), which the displacement carries along
cx, cy
turn_by         amplitude of the angle; for STEADY the angular velocity
turn_rate       angular frequency of SINE
turn_phase      at t = 0 of the run, or at `begins`
turn_now        what `turn` needs to know of the beginning of the window: angle (STEADY), phase
lever           distance of the farthest point of the piece from (cx, cy)
begins, ends    time of the run from which on it moves, and until when
moves           1 if it moves in the window, which neither of the two lies in, else 0
sums            first of the sums of its wall: momentum (2), torque, work, heat, hits
inverse_mass    inverse mass of a piston, whose motion is FREE
low, high       of a piston's displacement, which its stops bound
piston          first of the changes of its displacement and velocity, among the sums of walls
next_piston     row of the next piston, or -1
stop_at         time of the window at which it meets a stop
==============  ==========================================================================================

Rotating walls. In the frame that turns with a wall about its centre, by the angle theta(t), the wall is at rest, and a
disk's centre is at p = Rot(-theta) (x - c). With r = x - c and the velocity v = dr/dt of the lab,
dp/dt = Rot(-theta) (v - w x r), and once more d2p/dt2 = Rot(-theta) (a - alpha x r - 2 w x v - w^2 r), w and alpha the
angular velocity and acceleration. (The Coriolis term is 2 w x (v - w x r) and the centrifugal one -w^2 r; together they
are 2 w x v + w^2 r.) So |d2p/dt2| <= |a| + |alpha| r + 2 |w| |v| + w^2 r =: B, with the largest r and |v| until the
window ends. Distances to a segment or a point, and from a circle outside of it, are convex functions of p with slopes
of at most 1, so that f'' >= -B; for the inside of a circle (rho^2 - p^2)'' = -2 (|p'|^2 + p . p'') >= -2 (|p'|^2 + B
rho). All are met by the same steps. Bounds reach to the end of the window, not to the earliest meeting known: that
depends on who was looked at before, and steps, whose last bits depend on their bounds, would too.

Arcs. A disk of radius R touches the inside of an arc of radius A from within the circle rho = A - R, the outside from
beyond rho = A + R, at an angle of the arc; it touches the ends as posts of radius 0. A centre that passes the circle
beside the arc is followed on its other side until it comes back. Between the two circles it cannot get behind the arc:
there, at the first angle of the arc, it would be nearer than R to its end. The angles of the arc are widened by 6e-8:
at the seam circle and end touch each other, and a circle that is taken so far is R (6e-8)^2 / 2 = 2e-15 R off.

Pistons. A piston has a mass M and one degree of freedom, its displacement s along its normal u. Between hits
M s'' = F + M g.u - K s: a parabola, or an oscillation of angular frequency sqrt(K/M) (`rate`) about F/K + g.u/rate^2.
Its columns now, speed, since and push hold s and s' at the latest event of its own, the time of that, and F/M. A disk
looks for it from the later of its own latest event and that one. Rails hold it along its tangent, and it does not turn:
an impulse P along n changes the approach by -P (1/m + 1/M), one along t the slip by -P (1 + k)/m, as at a fixed wall.
The law has both effective masses of a second disk with 1/M and k = -1, whose 1/m_t = (1 + k)/M is nothing. The impulse
J that it gives works J (s'_before + s'_after)/2: with J = -M (s'_after - s'_before) its kinetic energy changes by minus
that. At a stop s' changes its sign; pressed against one without speed, or with less than 1e-6 of its acceleration times
the window, it stays there. After an event of a piston every disk looks for it again, so that a gas with one is one
tile.

Thermal walls: a disk leaves with a random velocity, as if it had come from a gas behind the wall.

Why the normal component is not Gaussian: of a gas with the Maxwellian density f(v) ~ exp(-m v^2 / 2 T), those disks
that pass a line in a time dt come from a distance v_n dt, so that their velocities are distributed as v_n f(v),
v_n > 0. The factors separate. Along the wall v_t stays Gaussian with variance T/m, the spin, whatever v is, with T/I;
the normal component has the density (m v_n / T) exp(-m v_n^2 / 2 T), Rayleigh's. Its part above v_n is
exp(-m v_n^2 / 2 T): set equal to a uniform u, v_n = sqrt(-2 (T/m) ln u). A gas of the same temperature sends to the
wall just what it gets back, and stays what it is. R. Tehver et al., Phys. Rev. E 57, R17 (1998),
doi:10.1103/PhysRevE.57.R17, tell what goes wrong with other densities.
"""

from .columns import MECHANISM, TALLY, WALL_SUM
from .contact import ELASTIC, collided
from .flights import rounding
from .language import ti
from .layout import BY_HEAT, BY_LAW, BY_REMEDY, FAR, FIRST_WALL, FULL_WALLS
from .particle import (
    add, advance_to, charge, just_collided, kind_of, note_speed, radius_of, update_history_hash,
    watched_row, write_motion,
)  # fmt: skip
from .random import DRAWS, normals, rayleigh

PLACE = 0xFFFF * DRAWS  # in streams of random numbers: the index that no force has


@ti.func
def thermal_velocity(i, temperature, nx, ny, ux, uy, gas: ti.template()):
    """Velocity and spin of the disk in slot i after a collision with a wall of this temperature [energy].

    (nx, ny) is the wall's normal towards the disk, (ux, uy) the velocity of its surface.

    The random numbers depend on the seed, the disk, and how many collisions it has had before, with disks and walls.
    """
    stream = ti.Vector([
        ti.cast(gas.event_info[i].id, ti.u32),
        ti.cast(gas.image_info[i].events_before + gas.event_info[i].number - 1, ti.u32), ti.u32(0), ti.u32(PLACE),
        ti.cast(gas.grid.seed_low, ti.u32), ti.cast(gas.grid.seed_high, ti.u32),
    ], ti.u32)  # fmt: skip
    kind = kind_of(i, gas)
    spread = ti.sqrt(temperature * gas.kinds[kind].inverse_mass)
    v_n = spread * rayleigh(stream, 0)
    along = normals(stream, 1)
    v_t = spread * along[0]
    # sqrt(T/I), I = m R^2 / k
    spin = spread * ti.sqrt(gas.kinds[kind].k) / gas.kinds[kind].radius * along[1]
    return ux + v_n * nx - v_t * ny, uy + v_n * ny + v_t * nx, spin


LINE, SEGMENT, CONTAINER, POST, ARC_INSIDE, ARC_OUTSIDE, GONE = range(7)
STILL, STEADY, SINE, SAWTOOTH, FREE = range(5)
MOST_STEPS = 1000  # towards a root; grazing contacts with oscillating walls take tens
TWO_PI = 6.283185307179586


@ti.func
def wall_phases(gas: ti.template()):
    """At the beginning of a window: where every wall is in its motion. In double precision, for long runs."""
    for w in range(gas.grid.walls):
        wall = gas.walls[w]
        motion = ti.cast(wall.motion, ti.i32)
        now = ti.cast(gas.clock.begin, ti.f64)
        if ti.static(gas.uses.timed):
            begins, ends = ti.cast(wall.begins, ti.f64), ti.cast(wall.ends, ti.f64)
            wall.moves = ti.cast(now >= begins and now < ends, float)
            now = ti.min(ti.max(now, begins), ends)
            if begins > -FAR:  # its motion counts from where it begins
                now -= begins
        rate = ti.cast(wall.rate, ti.f64)
        phase = ti.cast(wall.phase, ti.f64)
        at = ti.cast(wall.amplitude, ti.f64) * now
        if motion == SINE:
            turns = (rate * now + phase) / TWO_PI
            at = TWO_PI * (turns - ti.floor(turns))
        elif motion == SAWTOOTH:
            turns = rate * now + phase
            at = turns - ti.floor(turns)
        if motion != FREE:
            wall.now = ti.cast(at, float)
        if ti.static(gas.uses.turning):
            turned = ti.cast(wall.turn_by, ti.f64) * now + ti.cast(wall.turn_phase, ti.f64)
            if ti.cast(wall.turn, ti.i32) == SINE:
                turned = ti.cast(wall.turn_rate, ti.f64) * now + ti.cast(wall.turn_phase, ti.f64)
            turned /= TWO_PI
            wall.turn_now = ti.cast(TWO_PI * (turned - ti.floor(turned)), float)
    if ti.static(gas.uses.pistons):
        w = gas.grid.first_piston
        while w >= 0:
            if gas.counter.resuming == 0:  # else it has moved on in this window
                column = TALLY.width + ti.cast(gas.walls[w].piston, ti.i32)
                set_piston(w, 0.0 * gas.scale.window, gas.sums[column], gas.sums[column + 1], gas)
            w = ti.cast(gas.walls[w].next_piston, ti.i32)


@ti.func
def push_of(w, gas: ti.template()):
    """Acceleration of piston w by its force and gravity."""
    wall = gas.walls[w]
    return wall.push + (gas.scale.gx * wall.ux + gas.scale.gy * wall.uy)


@ti.pyfunc
def piston_speed(s, speed, push, rate, path):
    """Speed that a piston has and gains while disks go a `path` [length]: it decides how long windows are."""
    return ti.abs(speed) + ti.sqrt(ti.abs(push - rate * rate * s) * path)


@ti.func
def fastest_piston(gas: ti.template()):
    """The largest `piston_speed` at the beginning of a window, from the sums."""
    found = ti.cast(0.0, ti.f64)
    w = gas.grid.first_piston
    while w >= 0:
        column = TALLY.width + ti.cast(gas.walls[w].piston, ti.i32)
        found = ti.max(found, piston_speed(
            gas.sums[column], gas.sums[column + 1], push_of(w, gas), gas.walls[w].rate, gas.clock.path
        ))  # fmt: skip
        w = ti.cast(gas.walls[w].next_piston, ti.i32)
    return found


@ti.func
def set_piston(w, t, s, speed, gas: ti.template()):
    """Let piston w go on from a displacement with a speed at a time of the window; note when it meets a stop."""
    wall = gas.walls[w]
    wall.now, wall.speed, wall.since = s, speed, t
    push, rate = push_of(w, gas), wall.rate
    low, high = wall.low, wall.high
    delay = FAR + 0.0 * t
    if is_held(w, gas) == 0:
        if rate == 0.0:
            delay = ti.min(fall_time(s - low, speed, push), fall_time(high - s, -speed, -push))
        else:
            a = push - rate * rate * s
            x = -a / (rate * rate)
            size, phase = ti.sqrt(x * x + (speed / rate) ** 2), ti.atan2(speed / rate, x)
            # s = middle + size cos(rate t - phase): falls to `low` at phase + acos, rises to `high` at phase - acos.
            below, above = (low - s + x) / size, (high - s + x) / size
            if below > -1.0:
                delay = ti.min(delay, turn_of(phase + ti.acos(ti.min(below, 1.0))) / rate)
            if above < 1.0:
                delay = ti.min(delay, turn_of(phase - ti.acos(ti.max(above, -1.0))) / rate)
            if rate * gas.scale.window < 1e-4:  # in a window as good as constant acceleration
                delay = ti.min(fall_time(s - low, speed, a), fall_time(high - s, -speed, -a))
            for _ in range(2):  # angles are as exact as 1e-16 of a turn, which may be long
                if delay < gas.scale.window:
                    there, u, _bound, _pull = piston_motion(w, t + delay, gas)
                    stop = low
                    if ti.abs(there - high) < ti.abs(there - low):
                        stop = high
                    if u != 0.0:
                        delay = ti.max(delay + (stop - there) / u, 0.0)
            if (s <= low and speed < 0.0) or (s >= high and speed > 0.0):
                delay = 0.0 * t
    wall.stop_at = t + delay


@ti.func
def turn_of(angle):
    """The angle from 0 to a full turn that is the same."""
    return angle - TWO_PI * ti.floor(angle / TWO_PI)


@ti.func
def fall_time(height, speed, pull):
    """Time until height + speed t + pull t^2 / 2 falls to 0; FAR if it does not."""
    found = FAR + 0.0 * height
    d = speed * speed - 2.0 * pull * height
    if height <= 0.0:
        if speed < 0.0:
            found = 0.0 * height
        elif pull < 0.0:
            found = -2.0 * speed / pull
    elif speed < 0.0:
        if d >= 0.0:
            found = 2.0 * height / (ti.sqrt(d) - speed)
    elif pull < 0.0:
        found = (speed + ti.sqrt(d)) / -pull
    return found


@ti.func
def is_held(w, gas: ti.template()):
    """1 if piston w is pressed against a stop without speed, else 0."""
    wall = gas.walls[w]
    s = wall.now
    pull = push_of(w, gas) - wall.rate**2 * s
    pressed = (s <= wall.low and pull < 0.0) or (s >= wall.high and pull > 0.0)
    return ti.cast(pressed and wall.speed == 0.0, ti.i32)


@ti.func
def piston_motion(w, time, gas: ti.template()):
    """Displacement of piston w at a time of the window, its speed, a bound of the magnitude of its acceleration, and
    that itself where it is constant, else minus the bound."""
    wall = gas.walls[w]
    t = time - wall.since
    s, speed = wall.now, wall.speed
    push, rate = push_of(w, gas), wall.rate
    bound, pull = 0.0 * t, 0.0 * t
    if is_held(w, gas) == 0:
        if rate == 0.0:
            s += (speed + 0.5 * push * t) * t
            speed += push * t
            bound, pull = ti.abs(push), push
        else:
            # Without the middle of the oscillation, push / rate^2, which is far away where the spring is soft.
            half, sine = ti.sin(0.5 * rate * t) / rate, ti.sin(rate * t) / rate
            a = push - rate * rate * s
            bound = ti.sqrt(a * a + (rate * speed) ** 2)
            s += speed * sine + 2.0 * a * half * half
            speed = speed * ti.cos(rate * t) + a * sine
    return s, speed, bound, pull


@ti.func
def next_stop(gas: ti.template()):
    """The earliest time of the window at which a piston meets a stop, and that piston."""
    found, which = FAR + 0.0 * gas.scale.window, -1
    w = gas.grid.first_piston
    while w >= 0:
        if gas.walls[w].stop_at < found:
            found, which = gas.walls[w].stop_at, w
        w = ti.cast(gas.walls[w].next_piston, ti.i32)
    return found, which


@ti.func
def bounce(w, t, gas: ti.template()):
    """Let piston w bounce off its stop at time t; bounces of a millionth of a window are none, and it stays there."""
    s, speed, bound, _pull = piston_motion(w, t, gas)
    low, high = gas.walls[w].low, gas.walls[w].high
    away = ti.abs(speed)
    if away < 1.0e-6 * bound * gas.scale.window:
        away = 0.0 * away
    if ti.abs(s - low) < ti.abs(s - high):
        set_piston(w, t, low, away, gas)
    else:
        set_piston(w, t, high, -away, gas)


@ti.func
def meets_piston(i, gas: ti.template()):
    """1 if the next collision of the disk in slot i is one with a piston, else 0."""
    found = 0
    if gas.event_info[i].partner <= FIRST_WALL:
        w = (FIRST_WALL - gas.event_info[i].partner) // 9
        found = ti.cast(gas.walls[w].motion == FREE, ti.i32)
    return found


@ti.func
def write_pistons(tile, when, time, gas: ti.template()):
    """Note how pistons have changed from the beginning of the window until a time of it."""
    w = gas.grid.first_piston
    while w >= 0:
        column = TALLY.width + ti.cast(gas.walls[w].piston, ti.i32)
        s, speed, _bound, _pull = piston_motion(w, time, gas)
        gas.tally[tile, when][column] = s - gas.sums[column]
        gas.tally[tile, when][column + 1] = speed - gas.sums[column + 1]
        w = ti.cast(gas.walls[w].next_piston, ti.i32)


@ti.func
def wall_motion(w, time, gas: ti.template()):
    """Displacement of wall w along its direction at a time of the window, its speed, a bound of the magnitude of its
    acceleration, and the time until which all three hold."""
    wall = gas.walls[w]
    t = time
    if ti.static(gas.uses.timed):
        t = time * wall.moves
    motion = ti.cast(wall.motion, ti.i32)
    amplitude = wall.amplitude
    rate = wall.rate
    at = wall.now
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
        rise = wall.rise
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
    if ti.static(gas.uses.pistons):
        if motion == FREE:
            s, speed, bound, _pull = piston_motion(w, time, gas)
    if ti.static(gas.uses.timed):
        speed *= wall.moves
        bound *= wall.moves
        if wall.moves == 0.0:
            until = FAR + 0.0 * time
    return s, speed, bound, until


@ti.func
def wall_turn(w, time, gas: ti.template()):
    """Angle of wall w at a time of the window, its angular velocity, and bounds of its magnitude and that of the
    angular acceleration."""
    wall = gas.walls[w]
    t = time
    if ti.static(gas.uses.timed):
        t = time * wall.moves
    turn = ti.cast(wall.turn, ti.i32)
    by, at = wall.turn_by, wall.turn_now
    angle, spin, most, bound = 0.0 * t, 0.0 * t, 0.0 * t, 0.0 * t
    if turn == STEADY:
        angle = at + by * t
        spin = by
        most = ti.abs(by)
    elif turn == SINE:
        rate = wall.turn_rate
        angle = by * ti.sin(at + rate * t)
        spin = by * rate * ti.cos(at + rate * t)
        most = ti.abs(by * rate)
        bound = most * rate
    if ti.static(gas.uses.timed):
        moves = wall.moves
        spin, most, bound = spin * moves, most * moves, bound * moves
    return angle, spin, most, bound


@ti.func
def turned_back(w, x, y, s, angle, gas: ti.template()):
    """A place (x, y) as wall w, displaced by s, saw it before it turned by an angle."""
    wall = gas.walls[w]
    cx = wall.cx + wall.ux * s
    cy = wall.cy + wall.uy * s
    c, sine = ti.cos(angle), ti.sin(angle)
    return cx + c * (x - cx) + sine * (y - cy), cy - sine * (x - cx) + c * (y - cy)


def epsilon() -> float:
    """Spacing of real numbers at 1."""
    return 1.2e-7 if ti.lang.impl.get_runtime().default_fp == ti.f32 else 2.3e-16


def seam() -> float:
    """Angle by which an arc is widened at both ends."""
    return float(4.0 * epsilon() ** 0.5)


@ti.func
def wall_vector(w, x, y, s, gas: ti.template()):
    """From the point of wall w that is nearest to (x, y), the wall displaced by s, to (x, y): unit vector, distance.

    For a container and the inside of an arc, the vector points inwards, and an arc counts as the whole circle.
    """
    wall = gas.walls[w]
    kind = ti.cast(wall.type, ti.i32)
    dx = x - wall.px - wall.ux * s
    dy = y - wall.py - wall.uy * s
    qx, qy = wall.qx, wall.qy
    nx, ny = qx, qy
    distance = dx * qx + dy * qy
    if kind == SEGMENT:
        along = ti.min(ti.max((dx * qx + dy * qy) / (qx * qx + qy * qy), 0.0), 1.0)
        dx -= along * qx
        dy -= along * qy
    if kind != LINE:
        r = ti.sqrt(dx * dx + dy * dy)
        nx, ny = dx / r, dy / r
        distance = r - wall.circle
        if kind == CONTAINER or kind == ARC_INSIDE:
            nx, ny = -nx, -ny
            distance = wall.circle - r
            if r == 0.0:  # in the middle of a container, all directions are the same
                nx, ny = 1.0 + 0.0 * x, 0.0 * x
    return nx, ny, distance


@ti.func
def wall_time(w, x, y, vx, vy, tau, radius, horizon, gas: ti.template()):
    """Time at which a disk, at (x, y) at `tau` with the falling frame's velocity, first touches wall w; FAR if late.

    Returns the time, and 1 if the disk rests on the wall, which has no next collision.
    """
    wall = gas.walls[w]
    gx, gy = gas.scale.gx, gas.scale.gy
    kind = ti.cast(wall.type, ti.i32)
    found = FAR + 0.0 * tau
    resting = 0
    t = tau
    if ti.static(gas.uses.pistons):
        if wall.motion == FREE:
            t = ti.max(t, wall.since)
    going = 1
    steps = 0
    behind = 0  # 1 on the side of an arc's circle from which its face is not touched
    if ti.static(gas.uses.arched):
        if kind == ARC_INSIDE and wall.circle <= radius:
            going = 0
    while going == 1:
        steps += 1
        # A fall since the beginning of the window.
        at_x = x + vx * (t - tau) + 0.5 * gx * t * t
        at_y = y + vy * (t - tau) + 0.5 * gy * t * t
        s, speed, bound, until = wall_motion(w, t, gas)
        ux, uy = wall.ux, wall.uy
        rel_x = vx + gx * t - ux * speed
        rel_y = vy + gy * t - uy * speed
        extra, swing = 0.0 * t, 0.0 * t  # of a wall that turns: bound on what that adds to f'', largest speed
        if ti.static(gas.uses.turning):
            if wall.turn != STILL:
                angle, spin, most_spin, spin_bound = wall_turn(w, t, gas)
                lever_x = at_x - wall.cx - ux * s
                lever_y = at_y - wall.cy - uy * s
                still = ti.min(gas.scale.window, until) - t
                push = ti.sqrt(gx * gx + gy * gy) + bound
                fastest = ti.sqrt(rel_x * rel_x + rel_y * rel_y) + push * still
                lever = ti.sqrt(lever_x * lever_x + lever_y * lever_y) + fastest * still
                extra = 2.0 * most_spin * fastest + (spin_bound + most_spin * most_spin) * lever
                swing = most_spin * lever
                at_x, at_y = turned_back(w, at_x, at_y, s, angle, gas)
                rel_x += spin * lever_y
                rel_y -= spin * lever_x
                c, sine = ti.cos(angle), ti.sin(angle)
                rel_x, rel_y = c * rel_x + sine * rel_y, c * rel_y - sine * rel_x
        nx, ny, distance = wall_vector(w, at_x, at_y, s, gas)
        f = distance - radius
        slope = nx * rel_x + ny * rel_y
        pull = ti.sqrt(gx * gx + gy * gy)
        curve = -(pull + bound)
        if ti.static(gas.uses.turning):
            curve -= extra
        if kind == LINE:
            curve = gx * nx + gy * ny - ti.abs(ux * nx + uy * ny) * bound
            if ti.static(gas.uses.pistons):
                if wall.motion == FREE and wall.rate == 0.0:
                    _s, _speed, _bound, pull_w = piston_motion(w, t, gas)
                    curve = gx * nx + gy * ny - (ux * nx + uy * ny) * pull_w
        # Positions are sums of numbers as large as these.
        tolerance = 8.0 * ti.static(epsilon()) * (ti.abs(at_x) + ti.abs(at_y) + radius + wall.circle)
        noise = ti.static(rounding()) * (ti.abs(vx) + ti.abs(vy) + pull * t + ti.abs(speed))
        if ti.static(gas.uses.turning):
            noise += ti.static(rounding()) * swing
        here = 1  # 0 beside an arc, or behind its face: nothing is there to be touched
        if ti.static(gas.uses.arched):
            if kind == ARC_INSIDE or kind == ARC_OUTSIDE:
                # rho^2 - r^2 within the circle of centres that touch it, as for a container; r - rho beyond.
                counts_within = ti.cast(kind == ARC_INSIDE, ti.i32)
                sign = 1.0 - 2.0 * counts_within
                rho = wall.circle + sign * radius
                r = wall.circle + sign * distance
                beyond = r - rho
                if steps == 1:
                    behind = ti.cast(-sign * beyond > tolerance, ti.i32)
                within = counts_within ^ behind
                out_x, out_y = sign * nx, sign * ny
                middle = out_x * wall.qx + out_y * wall.qy
                half = wall.half + ti.static(seam())
                here = ti.cast(half >= 0.5 * TWO_PI or middle >= ti.cos(half), ti.i32) * (1 - behind)
                slope = out_x * rel_x + out_y * rel_y
                f = beyond
                if within == 1:
                    push = pull + bound + extra
                    most = ti.sqrt(rel_x * rel_x + rel_y * rel_y)
                    most += push * (ti.min(gas.scale.window, until) - t)
                    f = -beyond * (r + rho)
                    slope *= -2.0 * r
                    curve = -2.0 * (most * most + push * rho)
                    tolerance *= 2.0 * rho
                    noise *= 2.0 * rho
        if kind == CONTAINER:
            # The same roots for (R_c - R)^2 - r^2, whose second derivative is bounded: -2 v^2 without forces.
            inner = wall.circle - radius
            r = wall.circle - distance
            push = pull + bound
            if ti.static(gas.uses.turning):
                push += extra
            gain = push * (ti.min(gas.scale.window, until) - t)
            most = ti.sqrt(rel_x * rel_x + rel_y * rel_y) + gain
            f = inner * inner - r * r
            slope *= 2.0 * r
            curve = -2.0 * (most * most + push * inner)
            tolerance *= 2.0 * inner
            noise *= 2.0 * inner
        crossed = 0
        if f <= tolerance:
            if slope < -noise:
                if here == 1:
                    found = t
                    going = 0
                else:
                    behind, crossed = 1 - behind, 1
            elif slope <= noise and curve < 0.0 and here == 1:
                # Without speed, and pulled together. A container pulls by its curvature alone: a disk slides along it.
                resting = 1
                going = 0
                if ti.static(gas.uses.rests):  # it bounces (`rest.py`)
                    found, resting = t, 0
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
            if crossed == 1:  # in the next moment it is on the other side
                step = 0.0 * t
            # A step too small for the clock would never end.
            step = ti.max(step, ti.static(epsilon()) * ti.max(t, 1.0e-3 * gas.scale.window))
            if t + step > until:
                t = until
            else:
                t += step
            if t >= horizon or steps >= MOST_STEPS:
                going = 0
                if steps >= MOST_STEPS:
                    resting = 1
                    if ti.static(
                        gas.uses.rests
                    ):  # along a wall as near as g (horizon / MOST_STEPS)^2 / 2: it touches
                        found, resting = t, 0
    return found, resting


@ti.func
def wall_reach(w, gas: ti.template()):
    """Distance from a wall, as the window begins, of the farthest centre of a disk that may touch it in the window."""
    wall = gas.walls[w]
    window = gas.scale.window
    _s, speed, bound, _until = wall_motion(w, 0.0 * window, gas)
    way = ti.abs(speed) * window + 0.5 * bound * window * window
    if ti.cast(wall.motion, ti.i32) == SAWTOOTH:
        way = 2.0 * ti.abs(wall.amplitude)
    if ti.cast(wall.motion, ti.i32) == FREE:  # where hits may drive it
        way = FAR + 0.0 * window
    if ti.static(gas.uses.turning):
        _angle, _spin, most_spin, _bound = wall_turn(w, 0.0 * window, gas)
        way += ti.min(most_spin * window, 2.0) * wall.lever
    fall = 0.5 * ti.sqrt(gas.scale.gx**2 + gas.scale.gy**2) * window * window
    return way + 2.0 * fall + 0.5 * gas.scale.widest


@ti.func
def span(low, high, corner, side, count):
    """First and last cell of those that a stretch may meet, cells at the ends of the region without an end."""
    first = ti.cast(ti.floor(ti.max((low - corner) / side, -1.0)), ti.i32)
    last = ti.cast(ti.floor(ti.min((high - corner) / side, count + 0.0)), ti.i32)
    return ti.min(ti.max(first, 0), count - 1), ti.min(ti.max(last, 0), count - 1)


@ti.func
def arc_distance(w, nx, ny, distance, gas: ti.template()):
    """Distance of a place from the arc of wall w; arguments as `wall_vector` gives them of the whole circle."""
    wall = gas.walls[w]
    sign = 1.0
    if ti.cast(wall.type, ti.i32) == ARC_INSIDE:
        sign = -1.0
    radius, half = wall.circle, wall.half
    r = radius + sign * distance
    qx, qy = wall.qx, wall.qy
    along, across = sign * (nx * qx + ny * qy), sign * (ny * qx - nx * qy)
    found = ti.abs(distance)
    if along < ti.cos(half):  # the end on its side of the middle is nearest
        found = ti.sqrt(
            (r * along - radius * ti.cos(half)) ** 2 + (r * ti.abs(across) - radius * ti.sin(half)) ** 2
        )
    return found


@ti.func
def place_walls(region: ti.template(), gas: ti.template()):
    """Note for each cell of a region the walls that a disk in it may touch, and through which periodic side.

    Twice over the walls: the first time counts, the second enters. An item is 9 * wall + 3 * box + box, a box being 0
    to 2 for the one before, this one and the next.
    """
    lane = region.lane
    cells, items = region.nx * region.ny, lane * gas.grid.items
    starts = lane * (gas.grid.cells + 1)
    for c in range(cells + 1):
        gas.wall_start[starts + c] = 0
    for turn in range(2):
        for w in range(gas.grid.walls):
            wall = gas.walls[w]
            kind = ti.cast(wall.type, ti.i32)
            s, _speed, _bound, _until = wall_motion(w, 0.0 * gas.scale.window, gas)
            reach = 1.001 * wall_reach(w, gas)
            around = reach + 0.5 * ti.sqrt(region.side_x**2 + region.side_y**2)
            images = ti.cast(kind != LINE and kind != CONTAINER, ti.i32)
            boxes_x, boxes_y = images * gas.grid.periodic_x, images * gas.grid.periodic_y
            if ti.static(gas.uses.timed):
                if kind == GONE:
                    boxes_x = -1
            angle = 0.0 * reach
            if ti.static(gas.uses.turning):
                angle, _spin, _most, _turn_bound = wall_turn(w, 0.0 * gas.scale.window, gas)
            for box_x in range(-boxes_x, boxes_x + 1):
                for box_y in range(-boxes_y, boxes_y + 1):
                    # The wall's image, from the corner of the region's tile.
                    off_x = box_x * gas.scale.length_x - region.corner_x
                    off_y = box_y * gas.scale.length_y - region.corner_y
                    px = wall.px + wall.ux * s + off_x
                    py = wall.py + wall.uy * s + off_y
                    qx, qy = wall.qx, wall.qy
                    if ti.static(gas.uses.turning):
                        px, py = turned_back(w, px - off_x, py - off_y, s, -angle, gas)
                        px += off_x
                        py += off_y
                        qx, qy = (
                            ti.cos(angle) * qx - ti.sin(angle) * qy,
                            ti.sin(angle) * qx + ti.cos(angle) * qy,
                        )
                    low_x, high_x, low_y, high_y = px, px, py, py
                    if kind == SEGMENT:
                        low_x, high_x = ti.min(px, px + qx), ti.max(px, px + qx)
                        low_y, high_y = ti.min(py, py + qy), ti.max(py, py + qy)
                    if kind == LINE:
                        if wall.qx != 0.0:
                            low_y, high_y = -FAR + 0.0 * px, FAR + 0.0 * px
                        if wall.qy != 0.0:
                            low_x, high_x = -FAR + 0.0 * px, FAR + 0.0 * px
                    extent = reach + wall.circle
                    first_x, last_x = span(
                        low_x - extent, high_x + extent, region.x, region.side_x, region.nx
                    )
                    first_y, last_y = span(
                        low_y - extent, high_y + extent, region.y, region.side_y, region.ny
                    )
                    for cx in range(first_x, last_x + 1):
                        for cy in range(first_y, last_y + 1):
                            x = region.x + (cx + 0.5) * region.side_x - off_x
                            y = region.y + (cy + 0.5) * region.side_y - off_y
                            if ti.static(gas.uses.turning):
                                x, y = turned_back(w, x, y, s, angle, gas)
                            nx, ny, distance = wall_vector(w, x, y, s, gas)
                            if ti.static(gas.uses.arched):
                                if kind == ARC_INSIDE or kind == ARC_OUTSIDE:
                                    distance = arc_distance(w, nx, ny, distance, gas)
                            if distance <= around:
                                c = starts + cx * region.ny + cy
                                if turn == 1:
                                    item = gas.wall_start[c]
                                    if item < gas.grid.items:
                                        gas.wall_item[items + item] = 9 * w + 3 * (box_x + 1) + box_y + 1
                                gas.wall_start[c] = gas.wall_start[c] + 1
        before = 0
        if turn == 0:
            for c in range(cells + 1):
                here = gas.wall_start[starts + c]
                gas.wall_start[starts + c] = before
                before += here
            if before > gas.grid.items:
                ti.atomic_or(gas.counter.full, FULL_WALLS)
                ti.atomic_max(gas.counter.needed, before)
        else:
            # Each start has become the end: the start of the next one.
            for back in range(cells):
                c = starts + cells - back
                gas.wall_start[c] = gas.wall_start[c - 1]
            gas.wall_start[starts] = 0


@ti.func
def first_wall(i, best, partner, region: ti.template(), gas: ti.template()):
    """The earlier of the meeting at `best` with `partner` and the first one with a wall near the disk in slot i."""
    info, motion = gas.event_info[i], gas.motion[i]
    lane = region.lane
    cell = lane * (gas.grid.cells + 1) + (info.cell >> 16) * region.ny + (info.cell & 0xFFFF)
    for item in range(gas.wall_start[cell], gas.wall_start[cell + 1]):
        code = gas.wall_item[lane * gas.grid.items + item]
        w = code // 9
        t, resting = wall_time(
            w,
            region.corner_x + motion.x - ((code // 3) % 3 - 1) * gas.scale.length_x,
            region.corner_y + motion.y - (code % 3 - 1) * gas.scale.length_y,
            motion.vx, motion.vy, motion.tau, radius_of(i, gas), best, gas,
        )  # fmt: skip
        if resting == 1 and info.own_rank > 0:
            gas.counter.resting = 1
        if t < best:
            best = t
            partner = FIRST_WALL - code
    return best, partner


@ti.func
def other_image(i, boxes, gas: ti.template()):
    """Name the wall that the disk in slot i meets by its image there, after the disk went round the box."""
    info = gas.event_info[i]
    if info.partner <= FIRST_WALL:
        kind = ti.cast(gas.walls[(FIRST_WALL - info.partner) // 9].type, ti.i32)
        if kind != LINE and kind != CONTAINER:
            info.partner = info.partner + boxes


@ti.func
def hit_wall(i, t, tile, region: ti.template(), gas: ti.template()):
    """Collide the disk in slot i at time t with the wall that it meets, in the lab; disks are in one that falls.

    Returns how (`contact.collided`).
    """
    info, motion = gas.event_info[i], gas.motion[i]
    code = FIRST_WALL - info.partner
    w = code // 9
    lasting = 0
    if ti.static(gas.uses.remembers):
        lasting = just_collided(i, t, gas)
        gas.since[i] = t
    advance_to(i, t, gas)
    gx, gy = gas.scale.gx, gas.scale.gy
    s, speed, _bound, _until = wall_motion(w, t, gas)
    x = region.corner_x + motion.x - ((code // 3) % 3 - 1) * gas.scale.length_x + 0.5 * gx * t * t
    y = region.corner_y + motion.y - (code % 3 - 1) * gas.scale.length_y + 0.5 * gy * t * t
    spin_w, at_x, at_y, angle = 0.0 * t, x, y, 0.0 * t
    if ti.static(gas.uses.turning):
        angle, spin_w, _most, _turn_bound = wall_turn(w, t, gas)
        at_x, at_y = turned_back(w, x, y, s, angle, gas)
    nx, ny, _distance = wall_vector(w, at_x, at_y, s, gas)
    if ti.static(gas.uses.turning):
        nx, ny = ti.cos(angle) * nx - ti.sin(angle) * ny, ti.sin(angle) * nx + ti.cos(angle) * ny
    ux = gas.walls[w].ux * speed - ny * gas.walls[w].surface
    uy = gas.walls[w].uy * speed + nx * gas.walls[w].surface
    lever_x, lever_y = x, y  # from what torques are about: the centre of its rotation, or the origin
    if ti.static(gas.uses.turning):
        if gas.walls[w].turn != STILL:
            lever_x -= gas.walls[w].cx + gas.walls[w].ux * s
            lever_y -= gas.walls[w].cy + gas.walls[w].uy * s
        # The velocity that the wall, as a rigid body, would have at the disk's centre. In the frame that moves and
        # turns with it the wall is at rest, and the law sees the disk's spin against it: the slip is that of the
        # contact.
        ux -= spin_w * lever_y
        uy += spin_w * lever_x
    owner = w
    if ti.static(gas.uses.pieced):
        owner = ti.cast(gas.walls[w].owner, ti.i32)
    kind = kind_of(i, gas)
    inverse_mass, radius = gas.kinds[kind].inverse_mass, gas.kinds[kind].radius
    p = ti.cast(gas.kinds[kind].material, ti.i32)
    q = ti.cast(gas.walls[w].material, ti.i32)
    vx_0, vy_0, spin_0 = motion.vx + gx * t, motion.vy + gy * t, motion.spin
    seen_spin = spin_0
    if ti.static(gas.uses.turning):
        seen_spin -= spin_w
    inverse_w, k_w = 0.0 * t, 1.0 + 0.0 * t
    if ti.static(gas.uses.pistons):
        if gas.walls[w].motion == FREE:
            inverse_w, k_w = gas.walls[w].inverse_mass, -1.0 + 0.0 * t
    vx, vy, spin, ux_1, uy_1, _, how, lost = collided(
        p, q, -nx, -ny, inverse_mass, radius, gas.kinds[kind].k, vx_0, vy_0, seen_spin,
        inverse_w, radius, k_w, ux, uy, 0.0, lasting, gas,
    )  # fmt: skip
    gained = 0.0 * t  # by a piston, whose surface runs on
    if ti.static(gas.uses.pistons):
        if gas.walls[w].motion == FREE:
            gained = (ux_1 - ux) * gas.walls[w].ux + (uy_1 - uy) * gas.walls[w].uy
            set_piston(w, t, s, speed + gained, gas)
    if ti.static(gas.uses.thermal):
        if gas.walls[w].temperature > 0.0:
            vx, vy, spin = thermal_velocity(i, gas.walls[w].temperature, nx, ny, ux, uy, gas)
            how = 0
            lost = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)  # what it took or gave is heat
    if ti.static(gas.uses.turning):
        spin += spin_w
    motion.vx, motion.vy, motion.spin = vx - gx * t, vy - gy * t, spin
    if ti.static(gas.uses.watched):
        row = watched_row(i, t, tile, region, gas)
        if row >= 0:
            gas.event[row].normal[0], gas.event[row].normal[1] = -nx, -ny
            # The wall's velocity is that in the lab.
            wx, wy = ux - gx * t, uy - gy * t
            if ti.static(gas.uses.turning):  # at the contact
                wx += spin_w * radius * ny
                wy -= spin_w * radius * nx
            before = ti.Vector([vx_0 - gx * t, vy_0 - gy * t, spin_0, wx, wy, 0.0 * t])
            if ti.static(gas.uses.pistons):
                wx += gas.walls[w].ux * gained
                wy += gas.walls[w].uy * gained
            after = ti.Vector([vx - gx * t, vy - gy * t, spin, wx, wy, 0.0 * t])
            write_motion(row, t, 0, before, after, gas)
            gas.event_int[row].partner = -2 - owner
            gas.event_int[row].how = ti.select(how >= ELASTIC, BY_REMEDY, BY_LAW)
            if ti.static(gas.uses.thermal):
                if gas.walls[w].temperature > 0.0:
                    gas.event_int[row].how = BY_HEAT
    if ti.static(gas.uses.itemised):
        charge(i, MECHANISM.walls, lost.sum(), gas)
    update_history_hash(i, t, -1 - w, gas)
    note_speed(i, gas)
    info.last = FIRST_WALL - owner
    gas.image_info[i].wall_hits = gas.image_info[i].wall_hits + 1
    if info.own_rank > 0:
        add(tile, TALLY.wall_collisions, 1.0, gas)
        if how >= ELASTIC:
            add(tile, TALLY.elastics, 1.0, gas)
        # A wall works on what it pushes: the impulse times its own velocity, of a piston the mean of before and after.
        if ti.static(gas.uses.pistons):
            ux += 0.5 * gas.walls[w].ux * gained
            uy += 0.5 * gas.walls[w].uy * gained
        work = ti.cast(((vx - vx_0) * ux + (vy - vy_0) * uy) / inverse_mass, ti.f64)
        if ti.static(gas.uses.turning):
            work += turning_impulse(kind, spin - spin_0, gas) * spin_w
        add(tile, TALLY.wall_work, work, gas)
        if ti.static(gas.uses.tallied):
            add(tile, TALLY.losses.walls, lost.sum(), gas)
        heat = ti.cast(0.0, ti.f64)
        if ti.static(gas.uses.thermal):
            column = ti.cast(gas.walls[w].heat, ti.i32)
            if column >= 0:
                heat = heat_given(
                    kind, vx - ux, vy - uy, spin - spin_w, vx_0 - ux, vy_0 - uy, spin_0 - spin_w, gas
                )
                add(tile, TALLY.width + column, heat, gas)
        if ti.static(gas.uses.summed):
            gained_x = ti.cast((vx - vx_0) / inverse_mass, ti.f64)
            gained_y = ti.cast((vy - vy_0) / inverse_mass, ti.f64)
            torque = lever_x * gained_y - lever_y * gained_x + turning_impulse(kind, spin - spin_0, gas)
            first = TALLY.width + ti.cast(gas.walls[w].sums, ti.i32)
            add(tile, first + WALL_SUM.momentum_x, gained_x, gas)
            add(tile, first + WALL_SUM.momentum_y, gained_y, gas)
            add(tile, first + WALL_SUM.torque, torque, gas)
            add(tile, first + WALL_SUM.work, work, gas)
            add(tile, first + WALL_SUM.heat, heat, gas)
            add(tile, first + WALL_SUM.hits, 1.0, gas)
    return how


@ti.func
def turning_impulse(kind, gained, gas: ti.template()):
    """Angular momentum of a spin that a disk of this kind gained. In double precision."""
    radius = ti.cast(gas.kinds[kind].radius, ti.f64)
    k, inverse_mass = ti.cast(gas.kinds[kind].k, ti.f64), ti.cast(gas.kinds[kind].inverse_mass, ti.f64)
    return radius * radius / (k * inverse_mass) * gained


@ti.func
def heat_given(kind, vx, vy, spin, vx_0, vy_0, spin_0, gas: ti.template()):
    """Kinetic energy after less that before, of a disk with velocities in the wall's frame. In double precision."""
    mass = 1.0 / ti.cast(gas.kinds[kind].inverse_mass, ti.f64)
    radius = ti.cast(gas.kinds[kind].radius, ti.f64)
    inertia = mass * radius * radius / ti.cast(gas.kinds[kind].k, ti.f64)
    # Each difference of squares as a product.
    along_x = ti.cast(vx - vx_0, ti.f64) * ti.cast(vx + vx_0, ti.f64)
    along_y = ti.cast(vy - vy_0, ti.f64) * ti.cast(vy + vy_0, ti.f64)
    turning = ti.cast(spin - spin_0, ti.f64) * ti.cast(spin + spin_0, ti.f64)
    return 0.5 * (mass * (along_x + along_y) + inertia * turning)
