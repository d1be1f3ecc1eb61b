"""Pistons: walls with a mass M and one degree of freedom, the displacement s along the normal u.

Between collisions M s'' = F + M g.u - K s: a parabola, or an oscillation of angular frequency sqrt(K/M) (`rate`) about
F/K + g.u/rate^2. A row of `walls` holds s and s' at the latest event of the piston, the time of that, and F/M (`push`).
A disk looks for it from the later of its own latest event and that one. Rails hold it along its tangent, and it does
not turn: an impulse P along n changes the approach by -P (1/m + 1/M), one along t the slip by -P (1 + k)/m, as at a
fixed wall. The law has both effective masses of a second disk with 1/M and k = -1, whose 1/m_t = (1 + k)/M is nothing.
The impulse J that it gives works J (s'_before + s'_after)/2: with J = -M (s'_after - s'_before) its kinetic energy
changes by minus that. At a stop s' changes its sign; pressed against one without speed, or with less than 1e-6 of its
acceleration times the window, it stays there. After an event of a piston every disk looks for it again, so that a gas
with one is one tile.
"""

from ..columns import TALLY
from ..compiler.language import ti
from ..layout import FAR, FIRST_WALL
from .images import from_partner, wall_of
from .kinds import FREE

TWO_PI = 6.283185307179586


@ti.func
def push_of(w, gas: ti.template()):
    """Acceleration of piston w by its force and gravity."""
    wall = gas.walls[w]
    return wall.piston.push + (gas.scale.gx * wall.motion.x + gas.scale.gy * wall.motion.y)


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
        column = TALLY.width + ti.cast(gas.walls[w].piston.sums, ti.i32)
        found = ti.max(found, piston_speed(
            gas.sums[column], gas.sums[column + 1], push_of(w, gas), gas.walls[w].piston.rate, gas.clock.path
        ))  # fmt: skip
        w = ti.cast(gas.walls[w].piston.next, ti.i32)
    return found


@ti.func
def set_piston(w, t, s, speed, gas: ti.template()):
    """Set displacement and speed of piston w at a time of the window, and the time at which it meets a stop."""
    piston = gas.walls[w].piston
    piston.displacement, piston.speed, piston.since = s, speed, t
    push, rate = push_of(w, gas), piston.rate
    delay = FAR + 0.0 * t
    if is_held(w, gas) == 0:
        if rate == 0.0:
            delay = ti.min(fall_time(s - piston.low, speed, push), fall_time(piston.high - s, -speed, -push))
        else:
            delay = swing_time(w, t, s, speed, push - rate * rate * s, gas)
    piston.stop_at = t + delay


@ti.func
def swing_time(w, t, s, speed, a, gas: ti.template()):
    """Time until piston w on its spring, at s with a speed and an acceleration a at time t, meets a stop; else FAR."""
    piston = gas.walls[w].piston
    rate, low, high = piston.rate, piston.low, piston.high
    delay = FAR + 0.0 * t
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
    return delay


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
    piston = gas.walls[w].piston
    s = piston.displacement
    pull = push_of(w, gas) - piston.rate**2 * s
    pressed = (s <= piston.low and pull < 0.0) or (s >= piston.high and pull > 0.0)
    return ti.cast(pressed and piston.speed == 0.0, ti.i32)


@ti.func
def piston_motion(w, time, gas: ti.template()):
    """Displacement of piston w at a time of the window, its speed, a bound of the magnitude of its acceleration, and
    that itself where it is constant, else minus the bound."""
    piston = gas.walls[w].piston
    t = time - piston.since
    s, speed = piston.displacement, piston.speed
    push, rate = push_of(w, gas), piston.rate
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
        piston = gas.walls[w].piston
        if piston.stop_at < found:
            found, which = piston.stop_at, w
        w = ti.cast(piston.next, ti.i32)
    return found, which


@ti.func
def bounce(w, t, gas: ti.template()):
    """Let piston w bounce off its stop at time t; bounces of a millionth of a window are none, and it stays there."""
    s, speed, bound, _pull = piston_motion(w, t, gas)
    low, high = gas.walls[w].piston.low, gas.walls[w].piston.high
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
    partner = gas.event_info[i].partner
    if partner <= FIRST_WALL:
        found = ti.cast(gas.walls[wall_of(from_partner(partner))].motion.kind == FREE, ti.i32)
    return found


@ti.func
def write_pistons(tile, when, time, gas: ti.template()):
    """Note how pistons have changed from the beginning of the window until a time of it."""
    w = gas.grid.first_piston
    while w >= 0:
        column = TALLY.width + ti.cast(gas.walls[w].piston.sums, ti.i32)
        s, speed, _bound, _pull = piston_motion(w, time, gas)
        gas.tally[tile, when][column] = s - gas.sums[column]
        gas.tally[tile, when][column + 1] = speed - gas.sums[column + 1]
        w = ti.cast(gas.walls[w].piston.next, ti.i32)
