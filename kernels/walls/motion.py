"""Motion of walls: displacement along a direction and turn about a centre, at times of the window.

Rotating walls. In the frame that turns with a wall about its centre, by the angle theta(t), the wall is at rest, and a
disk's centre is at p = Rot(-theta) (x - c). With r = x - c and the velocity v = dr/dt of the lab,
dp/dt = Rot(-theta) (v - w x r), and once more d2p/dt2 = Rot(-theta) (a - alpha x r - 2 w x v - w^2 r), w and alpha the
angular velocity and acceleration. (The Coriolis term is 2 w x (v - w x r) and the centrifugal one -w^2 r; together they
are 2 w x v + w^2 r.) So |d2p/dt2| <= |a| + |alpha| r + 2 |w| |v| + w^2 r =: B, with the largest r and |v| until the
window ends. B bounds the acceleration in `root.py` (`push`).
"""

from ..columns import TALLY
from ..compiler.language import ti
from ..layout import FAR
from .kinds import FREE, SAWTOOTH, SINE, STEADY
from .pistons import piston_motion, set_piston

TWO_PI = 6.283185307179586


def epsilon() -> float:
    """Spacing of real numbers at 1."""
    return 1.2e-7 if ti.lang.impl.get_runtime().default_fp == ti.f32 else 2.3e-16


@ti.func
def wall_phases(gas: ti.template()):
    """At the beginning of a window: where every wall is in its motion. In double precision, for long runs."""
    for w in range(gas.grid.walls):
        wall = gas.walls[w]
        motion, turn = wall.motion, wall.turn
        now = ti.cast(gas.clock.begin, ti.f64)
        if ti.static(gas.uses.timed_walls):
            begins, ends = ti.cast(wall.moving.begin, ti.f64), ti.cast(wall.moving.end, ti.f64)
            wall.moving.now = ti.cast(now >= begins and now < ends, float)
            now = ti.min(ti.max(now, begins), ends)
            if begins > -FAR:  # its motion counts from where it begins
                now -= begins
        kind = ti.cast(motion.kind, ti.i32)
        rate, phase = ti.cast(motion.rate, ti.f64), ti.cast(motion.phase, ti.f64)
        at = ti.cast(motion.amplitude, ti.f64) * now
        if kind == SINE:
            turns = (rate * now + phase) / TWO_PI
            at = TWO_PI * (turns - ti.floor(turns))
        elif kind == SAWTOOTH:
            turns = rate * now + phase
            at = turns - ti.floor(turns)
        motion.now = ti.cast(at, float)
        if ti.static(gas.uses.turning_walls):
            turned = ti.cast(turn.amplitude, ti.f64) * now + ti.cast(turn.phase, ti.f64)
            if ti.cast(turn.kind, ti.i32) == SINE:
                turned = ti.cast(turn.rate, ti.f64) * now + ti.cast(turn.phase, ti.f64)
            turned /= TWO_PI
            turn.now = ti.cast(TWO_PI * (turned - ti.floor(turned)), float)
    if ti.static(gas.uses.pistons):
        w = gas.grid.first_piston
        while w >= 0:
            if gas.counter.resuming == 0:  # else it has moved on in this window
                column = TALLY.width + ti.cast(gas.walls[w].piston.sums, ti.i32)
                set_piston(w, 0.0 * gas.scale.window, gas.sums[column], gas.sums[column + 1], gas)
            w = ti.cast(gas.walls[w].piston.next, ti.i32)


@ti.func
def wall_motion(w, time, gas: ti.template()):
    """Displacement of wall w along its direction at a time of the window, its speed, a bound of the magnitude of its
    acceleration, and the time until which all three hold."""
    wall = gas.walls[w]
    t = time
    if ti.static(gas.uses.timed_walls):
        t = time * wall.moving.now
    kind = ti.cast(wall.motion.kind, ti.i32)
    amplitude, rate, at = wall.motion.amplitude, wall.motion.rate, wall.motion.now
    s, speed, bound = 0.0 * t, 0.0 * t, 0.0 * t
    until = FAR + 0.0 * t
    if kind == STEADY:
        s = at + amplitude * t
        speed = amplitude
    elif kind == SINE:
        s = amplitude * ti.sin(at + rate * t)
        speed = amplitude * rate * ti.cos(at + rate * t)
        bound = ti.abs(amplitude) * rate * rate
    elif kind == SAWTOOTH:
        s, speed, until = sawtooth(amplitude, rate, at, wall.motion.rise, t)
    if ti.static(gas.uses.pistons):
        if kind == FREE:
            s, speed, bound, _pull = piston_motion(w, time, gas)
    if ti.static(gas.uses.timed_walls):
        speed *= wall.moving.now
        bound *= wall.moving.now
        if wall.moving.now == 0.0:
            until = FAR + 0.0 * time
    return s, speed, bound, until


@ti.func
def sawtooth(amplitude, rate, at, rise, t):
    """Displacement and speed at time t of the window, which begins at the part `at` of a period; end of the stroke."""
    s, speed, until = 0.0 * t, 0.0 * t, 0.0 * t
    turns = at + rate * t
    whole = ti.floor(turns)
    part = turns - whole
    # At the very end of a stroke, but for rounding of `turns`, the next one is what counts.
    near = 64.0 * ti.static(epsilon()) * ti.max(1.0, turns)
    if part > rise - near and part < rise:
        part = rise
    if part > 1.0 - near:
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
    return s, speed, until


@ti.func
def wall_turn(w, time, gas: ti.template()):
    """Angle of wall w at a time of the window, its angular velocity, and bounds of its magnitude and that of the
    angular acceleration."""
    wall = gas.walls[w]
    t = time
    if ti.static(gas.uses.timed_walls):
        t = time * wall.moving.now
    kind = ti.cast(wall.turn.kind, ti.i32)
    amplitude, at = wall.turn.amplitude, wall.turn.now
    angle, spin, most, bound = 0.0 * t, 0.0 * t, 0.0 * t, 0.0 * t
    if kind == STEADY:
        angle = at + amplitude * t
        spin = amplitude
        most = ti.abs(amplitude)
    elif kind == SINE:
        rate = wall.turn.rate
        angle = amplitude * ti.sin(at + rate * t)
        spin = amplitude * rate * ti.cos(at + rate * t)
        most = ti.abs(amplitude * rate)
        bound = most * rate
    if ti.static(gas.uses.timed_walls):
        moves = wall.moving.now
        spin, most, bound = spin * moves, most * moves, bound * moves
    return angle, spin, most, bound


@ti.func
def turned_back(w, x, y, s, angle, gas: ti.template()):
    """Position (x, y) in the frame of wall w, displaced by s and rotated by an angle."""
    wall = gas.walls[w]
    cx = wall.turn.x + wall.motion.x * s
    cy = wall.turn.y + wall.motion.y * s
    c, sine = ti.cos(angle), ti.sin(angle)
    return cx + c * (x - cx) + sine * (y - cy), cy - sine * (x - cx) + c * (y - cy)


@ti.func
def wall_reach(w, gas: ti.template()):
    """Distance from a wall, as the window begins, of the farthest centre of a disk that may touch it in the window."""
    wall = gas.walls[w]
    window = gas.scale.window
    _s, speed, bound, _until = wall_motion(w, 0.0 * window, gas)
    distance = ti.abs(speed) * window + 0.5 * bound * window * window
    if ti.cast(wall.motion.kind, ti.i32) == SAWTOOTH:
        distance = 2.0 * ti.abs(wall.motion.amplitude)
    if ti.cast(wall.motion.kind, ti.i32) == FREE:  # where collisions may drive it
        distance = FAR + 0.0 * window
    if ti.static(gas.uses.turning_walls):
        _angle, _spin, most_spin, _bound = wall_turn(w, 0.0 * window, gas)
        distance += ti.min(most_spin * window, 2.0) * wall.turn.lever
    fall = 0.5 * ti.sqrt(gas.scale.gx**2 + gas.scale.gy**2) * window * window
    return distance + 2.0 * fall + 0.5 * gas.scale.widest
