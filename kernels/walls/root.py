"""First root of the gap between a disk and a wall.

The root is found by steps that cannot pass it: from t, with a lower bound c of f'' until the horizon, f(t + s) >= f +
f' s + c s^2 / 2, and the next t is the smallest root of that parabola. Where the bound is f'' itself (flat walls, at
rest or in steady motion, with gravity or without; containers without gravity), the first step ends at the root;
elsewhere steps converge like Newton's. `shapes.py` has the gap of each shape.
"""

from ..disks.flights import rounding
from ..compiler.language import ti
from ..layout import FAR
from .kinds import FREE, SAWTOOTH, SINE, STILL
from .motion import epsilon, turned_back, wall_motion, wall_turn
from .shapes import UNKNOWN, gap_of

MOST_STEPS = 1000  # towards a root; contacts with walls take tens
# With an oscillating wall: a disk that comes slowly takes some four for each of its periods.
MOST_STEPS_OSCILLATING = 100_000


@ti.func
def relative_motion(w, x, y, vx, vy, tau, t, gas: ti.template()):
    """A disk at time t in the frame that rotates with wall w; arguments as of `wall_time`.

    t; position; velocity relative to the wall; displacement s of the wall along its direction; bound of the wall's
    acceleration; `push`, bound of the relative acceleration, until the motion changes at `until`; `noise`, error of
    velocities by rounding.
    """
    wall = gas.walls[w]
    gx, gy = gas.scale.gx, gas.scale.gy
    pull = ti.sqrt(gx * gx + gy * gy)
    # A fall since the beginning of the window.
    at_x = x + vx * (t - tau) + 0.5 * gx * t * t
    at_y = y + vy * (t - tau) + 0.5 * gy * t * t
    s, speed, bound, until = wall_motion(w, t, gas)
    ux, uy = wall.motion.x, wall.motion.y
    rel_x = vx + gx * t - ux * speed
    rel_y = vy + gy * t - uy * speed
    push = pull + bound
    noise = ti.static(rounding()) * (ti.abs(vx) + ti.abs(vy) + pull * t + ti.abs(speed))
    if ti.static(gas.uses.turning_walls):
        if wall.turn.kind != STILL:
            angle, spin, most_spin, spin_bound = wall_turn(w, t, gas)
            lever_x = at_x - wall.turn.x - ux * s
            lever_y = at_y - wall.turn.y - uy * s
            still = ti.min(gas.scale.window, until) - t
            fastest = ti.sqrt(rel_x * rel_x + rel_y * rel_y) + push * still
            lever = ti.sqrt(lever_x * lever_x + lever_y * lever_y) + fastest * still
            push += 2.0 * most_spin * fastest + (spin_bound + most_spin * most_spin) * lever
            noise += ti.static(rounding()) * (most_spin * lever)
            at_x, at_y = turned_back(w, at_x, at_y, s, angle, gas)
            rel_x += spin * lever_y
            rel_y -= spin * lever_x
            c, sine = ti.cos(angle), ti.sin(angle)
            rel_x, rel_y = c * rel_x + sine * rel_y, c * rel_y - sine * rel_x
    return ti.Struct(
        t=t, x=at_x, y=at_y, vx=rel_x, vy=rel_y, s=s, bound=bound, push=push, until=until, noise=noise
    )


@ti.func
def step_to_root(f, slope, curve):
    """The smallest positive root s of f + slope s + curve s^2 / 2 with f >= 0; FAR if there is none."""
    step = FAR + 0.0 * f
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
    return step


@ti.func
def wall_time(w, x, y, vx, vy, tau, radius, horizon, gas: ti.template()):
    """Time at which a disk, at (x, y) at `tau` with the falling frame's velocity, first touches wall w; FAR if late.

    Returns the time, and 1 if the disk rests on the wall, which has no next collision.
    """
    wall = gas.walls[w]
    found, resting = FAR + 0.0 * tau, 0
    t = tau
    if ti.static(gas.uses.pistons):
        if wall.motion.kind == FREE:
            t = ti.max(t, wall.piston.since)
    active, steps, behind = 1, 0, UNKNOWN
    most = MOST_STEPS
    if wall.motion.kind == SINE or wall.motion.kind == SAWTOOTH:
        most = MOST_STEPS_OSCILLATING
    if ti.static(gas.uses.turning_walls):
        if wall.turn.kind == SINE:
            most = MOST_STEPS_OSCILLATING
    while active == 1:
        steps += 1
        relative = relative_motion(w, x, y, vx, vy, tau, t, gas)
        gap = gap_of(w, relative, radius, behind, gas)
        f, behind, crossed = gap.f, gap.behind, 0
        if f <= gap.tolerance:
            if gap.slope < -gap.noise:
                if gap.here == 1:
                    found = t
                    active = 0
                else:
                    behind, crossed = 1 - behind, 1
            elif gap.slope <= gap.noise and gap.curve < 0.0 and gap.here == 1:
                # Without speed, and pulled together. A container pulls by its curvature alone: a disk slides along it.
                resting = 1
                active = 0
                if ti.static(gas.uses.rest):  # it bounces (`rest.py`)
                    found, resting = t, 0
            f = 0.0
        if active == 1:
            step = step_to_root(f, gap.slope, gap.curve)
            if crossed == 1:  # in the next moment it is on the other side
                step = 0.0 * t
            # A step too small for the clock would never end.
            step = ti.max(step, ti.static(epsilon()) * ti.max(t, 1.0e-3 * gas.scale.window))
            if t + step > relative.until:
                t = relative.until
            else:
                t += step
            if t >= horizon or steps >= most:
                active = 0
                if steps >= most:
                    resting = 1
                    if ti.static(
                        gas.uses.rest
                    ):  # along a wall as near as g (horizon / MOST_STEPS)^2 / 2: it touches
                        found, resting = t, 0
    return found, resting
