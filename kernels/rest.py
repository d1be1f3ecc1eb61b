"""Resting contact: disks that lie still sleep, and cost nothing until something wakes them.

An event-driven code has no lasting contacts: a disk that comes to rest on a floor collides infinitely often in a finite
time. With a *resting speed* v_s, which is small, lasting contact is replaced by two rules and a judgement.

*Rebound.* A collision whose normal speed of approach g_n is below v_s belongs to a contact that lasts, which the law of
single impacts does not describe. It is elastic (e_n = 1), and along the contact Coulomb's friction alone acts: sticking
at the contact point, mu P_n at most, and rolling friction rho P_n at most; tangential restitution, an impulse that
needs no normal force, does not (e_t = -1). So a disk on a support makes jumps of height v_s^2 / 2g at most. Gravity
returns its momentum 2 m g_n in the time 2 g_n / g: on average the support pushes by the weight, and friction is that of
this push, as in a contact that lasts. The rebound is no slower than v_0 = v_s / 10, which bounds the number of events;
what this gives, 1 % of m v_s^2 / 2 at most, is in the ledger.

*Sleep.* A disk that may rest (see below) falls asleep at a collision slower than v_s with a disk that sleeps or a wall
at rest, if it is slower than 2 v_s afterwards (v and R omega): there it touches. From then on it stays where it is.
What it had of kinetic energy is the loss `rest` of the ledger. To others it is a wall: a disk of infinite mass at rest.
A hit at v_s or more wakes it, and it takes part in that collision with its own mass. A disk that is caught between
others that sleep, so closely that it hits them eight times with no more than v_s / 1000 g between two of them, falls
asleep too, until the next judgement; if it is too fast, it is driven in like a wedge, and wakes whom it hits; if it is
not free after 64 hits, it falls asleep at its speed (`Statistics.jammed` counts: friction would have braked it).

*Judgement.* At the beginning of each window it is judged who may rest. Take all disks that sleep or are slower than
2 v_s as resting, and let them touch each other and walls at rest where the gap is below 4 v_s^2 / g. May they stay?
They do if there are contact forces in the cones |F_t| <= mu F_n, F_n >= 0, that balance every weight and torque. So
find the forces that leave the least acceleration,

    min over forces in the cones of  sum (m a^2 + I alpha^2) / 2,   m a = m g + sum F,  I alpha = sum of torques:

a convex problem (M. Anitescu, Math. Program. 105, 113 (2006), doi:10.1007/s10107-005-0590-7), in which the a and alpha
that are left are unique. Steps along the gradient, each back into the cones, find them, with momentum that starts anew
where it leads upwards (B. O'Donoghue and E. Candes, Found. Comput. Math. 15, 715 (2015),
doi:10.1007/s10208-013-9150-3). Unknown are F_n, F_t and the torques, not amounts of both edges of a cone: two edges of
large mu are almost opposite, and the way grows as mu^2. Those disks may rest whose a and R alpha are below g / 1000.
One that sleeps and has more than 3 g / 1000 wakes: its support has gone, or what lies on it is too much for it. So the
load of a heap goes down to the floor, and one without friction flows apart. A torque of rolling friction, rho F_n at
most, acts on each spin by itself, as in the law.

A window lasts 8 v_s / g at most, so that who has lost his support falls late by that; and no longer than a fall by a
twentieth of the largest diameter, by which a disk that sleeps may leave its cell in the falling frame.

The steps begin with the forces that the last judgement found at the same contact, 0 at a new one: in a heap that moves
little they are few. These forces belong to the state, so that a run that is resumed goes on to the bit.

What this is not. Forces in a heap at rest are not unique: which are found depends on where the steps begin. Where
contacts are held by a stress of their own (a disk wedged between walls that friction locks), disks may rest. Walls that
move, have a moving surface or a temperature support nobody: disks that they can reach in a window are awake. All gaps
of a heap are below 4 v_s^2 / g, and it is as much too high. For v_s to 0 all of this vanishes.
"""

from .flights import on_grid
from .language import ti
from .layout import (
    ASLEEP, ASLEEP_NOW, AWAKE, BEGIN, BY_REST, CELL, CELLS, CUTOFF, FAR, FIRST_WALL, GX, GY, HELD, HITS_NOW,
    INVERSE_MASS, ITEMS, JAMMED, KIND_RADIUS, LENGTH_X, LENGTH_Y, LOSSES, MATERIAL, MAY_REST,
    NEXT_IN_CELL, NOBODY, OF_HELD, PLACES, SAID_ASLEEP, SLEEPERS, TOUCHES_OF_DISK, TURNED, UNJUDGED, VX, VY, WHO, WOKEN,
    W_SPIN, K, X, Y,
)  # fmt: skip
from .places import add, charge, kind_of, radius_of
from .walls import (
    ARC_INSIDE, ARC_OUTSIDE, HALF, MOTION, QX, QY, STILL, SURFACE, TEMPERATURE, TURN, TYPE, WALL_MATERIAL, turned_back,
    wall_motion, wall_reach, wall_turn, wall_vector,
)  # fmt: skip

SLOW = 2.0  # resting speeds: slower disks may rest
GAP = 4.0  # v_s^2 / g: disks that are nearer touch
QUICK, QUICK_HITS, JAMMED_HITS = 1e-3, 8, 64  # v_s / g: times between hits that are none; how many of them
AT_REST, MOVED = 1e-3, 3e-3  # g: accelerations below which a disk may fall asleep, and above which it wakes
MU, RHO = 2, 4  # columns of the law's table (`IFRLaw.table_row`)
NEAR_ENOUGH = 1e-4  # g: what steps still change of accelerations when forces are found
# contact that may bear: places of both disks, the second -1 for a wall; the normal; what a unit of its four forces
# (normal, along the contact, torques on both disks) does to either, scaled so that each changes sqrt(m) a by 1 in all;
# bounds of the last three over the first; the forces, and those that are tried, or the last change (`note_touch`)
FIRST, SECOND, NORMAL_FIRST, NORMAL_SECOND, PUSH, DRAG, SPIN_UP = 0, 1, 2, 3, 4, 6, 8
BOUND, FORCE, TRIED = 10, 13, 17
FORCES = 4


@ti.func
def sleeps(i, gas: ti.template()):
    """1 if the disk at place i sleeps, else 0."""
    found = 0
    if ti.static(gas.uses.rests):
        found = ti.cast(gas.rest[i][ASLEEP_NOW] == ASLEEP, ti.i32)
    return found


@ti.func
def set_in_motion(i, t, gas: ti.template()):
    """Say where a disk that sleeps at place i is, and how it moves, in the frame that falls."""
    gas.work[i][X] = gas.work[i][X] - on_grid(0.5 * gas.scale[GX] * t * t, gas)
    gas.work[i][Y] = gas.work[i][Y] - on_grid(0.5 * gas.scale[GY] * t * t, gas)
    gas.work[i][VX], gas.work[i][VY] = -gas.scale[GX] * t, -gas.scale[GY] * t


@ti.func
def set_at_rest(i, t, gas: ti.template()):
    """Fix the disk at place i where it is in the lab."""
    gas.work[i][X] = gas.work[i][X] + on_grid(0.5 * gas.scale[GX] * t * t, gas)
    gas.work[i][Y] = gas.work[i][Y] + on_grid(0.5 * gas.scale[GY] * t * t, gas)
    gas.work[i][VX], gas.work[i][VY], gas.work[i][W_SPIN] = 0.0, 0.0, 0.0


@ti.func
def wake(i, tile, gas: ti.template()):
    """Wake the disk at place i, which moves by itself from here on."""
    gas.rest[i][ASLEEP_NOW] = WOKEN
    add(tile, SLEEPERS, -1.0, gas)


@ti.func
def is_slow(i, vx, vy, gas: ti.template()):
    """1 if the disk at place i, with this velocity in the lab, is slow enough to rest, else 0."""
    limit = SLOW * gas.scale[CUTOFF]
    surface = radius_of(i, gas) * gas.work[i][W_SPIN]
    return ti.cast(vx * vx + vy * vy < limit * limit and surface * surface < limit * limit, ti.i32)


@ti.func
def count_hit(i, t, since, gas: ti.template()):
    """Count a slow hit of something at rest by the disk at place i, whose latest collision was at `since`, if quick."""
    pull = ti.abs(gas.scale[GX]) + ti.abs(gas.scale[GY])
    quick = (t - since) * pull < QUICK * gas.scale[CUTOFF]
    gas.rest[i][HITS_NOW] = ti.select(quick, gas.rest[i][HITS_NOW] + 1, 0)


@ti.func
def is_wedged(i, t, gas: ti.template()):
    """1 if the disk at place i has hit what sleeps so often without time between, and is too fast to sleep."""
    vx, vy = gas.work[i][VX] + gas.scale[GX] * t, gas.work[i][VY] + gas.scale[GY] * t
    hits = gas.rest[i][HITS_NOW]
    return hits >= QUICK_HITS and hits < JAMMED_HITS and not is_slow(i, vx, vy, gas)


@ti.func
def fall_asleep(i, t, tile, gas: ti.template()):
    """Let the disk at place i fall asleep after a slow collision with something at rest, if it may and is slow.

    It may, too, if it is caught between others. If it cannot get free it falls asleep at any speed.
    """
    vx, vy = gas.work[i][VX] + gas.scale[GX] * t, gas.work[i][VY] + gas.scale[GY] * t
    hits, slow = gas.rest[i][HITS_NOW], is_slow(i, vx, vy, gas)
    if hits >= JAMMED_HITS or (slow and (gas.rest[i][MAY_REST] == 1 or hits >= QUICK_HITS)):
        if not slow:
            gas.counter[JAMMED] = gas.counter[JAMMED] + 1
        gas.rest[i][HITS_NOW] = 0
        kind = kind_of(i, gas)
        radius, spin = gas.kinds[kind][KIND_RADIUS], gas.work[i][W_SPIN]
        lost = vx * vx + vy * vy + radius * radius * spin * spin / gas.kinds[kind][K]
        energy = ti.cast(0.5 * lost / gas.kinds[kind][INVERSE_MASS], ti.f64)
        add(tile, LOSSES + BY_REST, energy, gas)
        if ti.static(gas.uses.itemised):
            charge(i, BY_REST, energy, gas)
        add(tile, SLEEPERS, 1.0, gas)
        gas.rest[i][ASLEEP_NOW] = ASLEEP
        set_at_rest(i, t, gas)


@ti.func
def meeting_with_sleeper(rx, ry, vx, vy, noise, sigma, within, gas: ti.template()):
    """Time until a disk that falls touches one that sleeps; FAR if not `within`. Separation r, velocity v in the lab.

    The gap f = |r| - sigma has f'' >= -g. Steps to the root of f + f' s - g s^2 / 2 cannot pass the first root of f,
    and converge like Newton's (`walls.py`). Disks that touch without speed meet at once if gravity pulls them together.
    """
    gx, gy = gas.scale[GX], gas.scale[GY]
    pull = ti.sqrt(gx * gx + gy * gy)
    found = FAR + 0.0 * rx
    tolerance = 1.0e-15 * (gas.scale[LENGTH_X] + gas.scale[LENGTH_Y])
    reach = sigma + (ti.abs(vx) + ti.abs(vy) + 0.5 * pull * within) * within
    s = 0.0 * rx
    going = ti.cast(rx * rx + ry * ry < reach * reach and within >= 0.0, ti.i32)
    steps = 0
    while going == 1:
        steps += 1
        x, y = rx + vx * s + 0.5 * gx * s * s, ry + vy * s + 0.5 * gy * s * s
        ux, uy = vx + gx * s, vy + gy * s
        r = ti.sqrt(x * x + y * y)
        f = r - sigma
        slope = (x * ux + y * uy) / r
        if f <= tolerance:
            f = 0.0
            if slope < -noise:
                found = s
            elif slope <= noise and ux * ux + uy * uy - slope * slope + x * gx + y * gy < 0.0:
                found = s
            if found < FAR:
                going = 0
        if going == 1:
            root = ti.sqrt(slope * slope + 2.0 * pull * f)
            step = (slope + root) / pull
            if slope < 0.0:
                step = 2.0 * f / (root - slope)
            least = 2.0e-16 * within
            if f == 0.0 and ti.abs(slope) <= noise:
                least = 1.0e-6 * within  # they part
            s += ti.max(step, least)
            if s >= within or steps > 1000:
                going = 0
    return found


@ti.func
def note_touch(i, j, nx, ny, mu, rho, count, gas: ti.template()):
    """Enter the contact of the disk at place i with that at j, or a wall (-1), n towards i; the length of the list.

    A force F_n n + F_t t acts on i at -R n from its centre, the opposite on j; t = (-n_y, n_x). The friction torque T
    on each disk acts by itself. sqrt(m) a and sqrt(I) alpha = sqrt(k / m) (T / R - F_t) are what is made small.
    """
    if count < TOUCHES_OF_DISK * gas.grid[PLACES]:
        one = mobility(i, gas)
        other = ti.Vector([0.0, 0.0, 0.0], ti.f64)
        if j >= 0:
            other = mobility(j, gas)
        along = one.xy.norm_sqr() + other.xy.norm_sqr()
        size_n = ti.sqrt(one.x * one.x + other.x * other.x)
        size_t = ti.sqrt(along)
        gas.touch[count][FIRST], gas.touch[count][SECOND] = ti.cast(i, ti.f64), ti.cast(j, ti.f64)
        gas.touch[count][NORMAL_FIRST], gas.touch[count][NORMAL_SECOND] = nx, ny
        gas.touch[count][PUSH], gas.touch[count][PUSH + 1] = one.x / size_n, other.x / size_n
        gas.touch[count][DRAG], gas.touch[count][DRAG + 1] = one.x / size_t, other.x / size_t
        gas.touch[count][SPIN_UP], gas.touch[count][SPIN_UP + 1] = -one.y / size_t, -other.y / size_t
        gas.touch[count][BOUND] = mu * size_t / size_n
        gas.touch[count][BOUND + 1] = rho * one.z / size_n
        gas.touch[count][BOUND + 2] = rho * other.z / size_n
    return count + 1


@ti.func
def mobility(i, gas: ti.template()):
    """1 / sqrt(m), sqrt(k / m) and sqrt(k / m) / R of the disk at place i."""
    kind = kind_of(i, gas)
    root = ti.sqrt(ti.cast(gas.kinds[kind][INVERSE_MASS], ti.f64))
    turn = root * ti.sqrt(ti.cast(gas.kinds[kind][K], ti.f64))
    return ti.Vector([root, turn, turn / gas.kinds[kind][KIND_RADIUS]], ti.f64)


@ti.func
def meets_moving_wall(i, region: ti.template(), gas: ti.template()):
    """1 if a wall that moves, or is no support for another reason, may touch the disk at place i in this window."""
    found = 0
    cell = (
        region.lane * (gas.grid[CELLS] + 1)
        + (gas.link[i][CELL] >> 16) * region.ny
        + (gas.link[i][CELL] & 0xFFFF)
    )
    for item in range(gas.wall_start[cell], gas.wall_start[cell + 1]):
        code = gas.wall_item[region.lane * gas.grid[ITEMS] + item]
        w = code // 9
        if not is_support(w, gas):
            _nx, _ny, distance = from_wall(i, code, region, gas)
            if distance <= wall_reach(w, gas):
                found = 1
    return found


@ti.func
def is_support(w, gas: ti.template()):
    """1 if wall w is at rest, its surface too, and has no temperature, else 0."""
    moves = gas.walls[w][MOTION] != STILL or gas.walls[w][TURN] != STILL or gas.walls[w][SURFACE] != 0.0
    return not (moves or gas.walls[w][TEMPERATURE] > 0.0)


@ti.func
def from_wall(i, code, region: ti.template(), gas: ti.template()):
    """Unit vector from a wall, by the code of its image, to the disk at place i, and distance, as the window begins.

    A wall that turns is seen as it was before. Beside an arc only its ends are near, which are walls of their own.
    """
    w = code // 9
    s, _speed, _bound, _until = wall_motion(w, 0.0 * gas.scale[CUTOFF], gas)
    x = region.corner_x + gas.work[i][X] - ((code // 3) % 3 - 1) * gas.scale[LENGTH_X]
    y = region.corner_y + gas.work[i][Y] - (code % 3 - 1) * gas.scale[LENGTH_Y]
    if ti.static(gas.uses.turning):
        angle, _spin, _most, _turn_bound = wall_turn(w, 0.0 * s, gas)
        x, y = turned_back(w, x, y, s, angle, gas)
    nx, ny, distance = wall_vector(w, x, y, s, gas)
    if ti.static(gas.uses.arched):
        kind = ti.cast(gas.walls[w][TYPE], ti.i32)
        if kind == ARC_INSIDE or kind == ARC_OUTSIDE:
            along = nx * gas.walls[w][QX] + ny * gas.walls[w][QY]
            behind = distance < 0.0  # on the other side of the circle, which is a wall of its own
            if behind or ti.select(kind == ARC_INSIDE, -along, along) < ti.cos(gas.walls[w][HALF]):
                distance = FAR + 0.0 * distance
    return nx, ny, distance


@ti.func
def find_touches(n, region: ti.template(), gas: ti.template()):
    """List the contacts of disks that may rest with each other and with walls at rest; their number.

    Awake disks without any may not.
    """
    pull = ti.sqrt(gas.scale[GX] ** 2 + gas.scale[GY] ** 2)
    near = GAP * gas.scale[CUTOFF] * gas.scale[CUTOFF] / pull
    places = region.lane * gas.grid[PLACES]
    count = 0
    for i in range(places, places + n):
        if gas.rest[i][MAY_REST] == 1:
            own_x, own_y = gas.link[i][CELL] >> 16, gas.link[i][CELL] & 0xFFFF
            radius = radius_of(i, gas)
            p = ti.cast(gas.kinds[kind_of(i, gas)][MATERIAL], ti.i32)
            for step in range(5):  # each pair once: the own cell, and half of those around
                ax, ay = own_x + ti.select(step < 2, 0, 1), own_y + ti.select(step < 2, step, step - 3)
                shift_x, shift_y = 0.0 * near, 0.0 * near
                if region.wrap_x == 1 and ax >= region.nx:
                    ax -= region.nx
                    shift_x = gas.scale[LENGTH_X]
                if region.wrap_y == 1:
                    if ay >= region.ny:
                        ay -= region.ny
                        shift_y = gas.scale[LENGTH_Y]
                    elif ay < 0:
                        ay += region.ny
                        shift_y = -gas.scale[LENGTH_Y]
                j = -1
                if ax < region.nx and ay >= 0 and ay < region.ny:
                    j = gas.head[region.cells + ax * region.ny + ay]
                    if step == 0:
                        j = gas.link[i][NEXT_IN_CELL]
                while j >= 0:
                    if gas.rest[j][MAY_REST] == 1:
                        dx = gas.work[i][X] - gas.work[j][X] - shift_x
                        dy = gas.work[i][Y] - gas.work[j][Y] - shift_y
                        r = ti.sqrt(dx * dx + dy * dy)
                        if r < radius + radius_of(j, gas) + near:
                            q = ti.cast(gas.kinds[kind_of(j, gas)][MATERIAL], ti.i32)
                            count = note_touch(
                                i, j, dx / r, dy / r, gas.law[p, q, MU], gas.law[p, q, RHO], count, gas
                            )
                    j = gas.link[j][NEXT_IN_CELL]
            cell = region.lane * (gas.grid[CELLS] + 1) + own_x * region.ny + own_y
            if ti.static(gas.uses.walled):
                for item in range(gas.wall_start[cell], gas.wall_start[cell + 1]):
                    code = gas.wall_item[region.lane * gas.grid[ITEMS] + item]
                    nx, ny, distance = from_wall(i, code, region, gas)
                    if distance < radius + near and is_support(code // 9, gas):
                        q = ti.cast(gas.walls[code // 9][WALL_MATERIAL], ti.i32)
                        count = note_touch(
                            i,
                            FIRST_WALL - code // 9,
                            nx,
                            ny,
                            gas.law[p, q, MU],
                            gas.law[p, q, RHO],
                            count,
                            gas,
                        )
    if count > TOUCHES_OF_DISK * gas.grid[PLACES]:
        count = TOUCHES_OF_DISK * gas.grid[PLACES]
        gas.counter[UNJUDGED] = gas.counter[UNJUDGED] + 1
    return count


@ti.func
def accelerate(count, n, further, weight, rolls, places, gas: ti.template()):
    """Find sqrt(m) a and sqrt(I) alpha of n disks by `weight` times gravity and forces, which become those tried.

    These are the forces and `further` of their last change. Friction torques count only if some contact `rolls`.
    """
    for i in range(places, places + n):
        root = weight / ti.sqrt(ti.cast(gas.kinds[kind_of(i, gas)][INVERSE_MASS], ti.f64))
        gas.balance[i][0], gas.balance[i][1] = root * gas.scale[GX], root * gas.scale[GY]
        gas.balance[i][2] = 0.0
    for c in range(count):
        i, j = ti.cast(gas.touch[c][FIRST], ti.i32), ti.cast(gas.touch[c][SECOND], ti.i32)
        nx, ny = gas.touch[c][NORMAL_FIRST], gas.touch[c][NORMAL_SECOND]
        push = gas.touch[c][FORCE] + further * gas.touch[c][TRIED]
        drag = gas.touch[c][FORCE + 1] + further * gas.touch[c][TRIED + 1]
        gas.touch[c][TRIED], gas.touch[c][TRIED + 1] = push, drag
        p, q = push * gas.touch[c][PUSH], drag * gas.touch[c][DRAG]
        gas.balance[i][0] = gas.balance[i][0] + (p * nx - q * ny)
        gas.balance[i][1] = gas.balance[i][1] + (p * ny + q * nx)
        gas.balance[i][2] = gas.balance[i][2] + drag * gas.touch[c][SPIN_UP]
        if j >= 0:
            p, q = push * gas.touch[c][PUSH + 1], drag * gas.touch[c][DRAG + 1]
            gas.balance[j][0] = gas.balance[j][0] - (p * nx - q * ny)
            gas.balance[j][1] = gas.balance[j][1] - (p * ny + q * nx)
            gas.balance[j][2] = gas.balance[j][2] + drag * gas.touch[c][SPIN_UP + 1]
        if rolls == 1:
            for q in ti.static(range(2, FORCES)):
                gas.touch[c][TRIED + q] = gas.touch[c][FORCE + q] + further * gas.touch[c][TRIED + q]
            gas.balance[i][2] = gas.balance[i][2] + gas.touch[c][TRIED + 2]
            if j >= 0:
                gas.balance[j][2] = gas.balance[j][2] + gas.touch[c][TRIED + 3]


@ti.func
def gained(c, gas: ti.template()):
    """Change of the sum of (m a^2 + I alpha^2) / 2 by a unit more of each of the four forces of a contact."""
    i, j = ti.cast(gas.touch[c][FIRST], ti.i32), ti.cast(gas.touch[c][SECOND], ti.i32)
    nx, ny = gas.touch[c][NORMAL_FIRST], gas.touch[c][NORMAL_SECOND]
    ax, ay, turn = gas.balance[i][0], gas.balance[i][1], gas.balance[i][2]
    push = gas.touch[c][PUSH] * (nx * ax + ny * ay)
    drag = gas.touch[c][DRAG] * (nx * ay - ny * ax) + gas.touch[c][SPIN_UP] * turn
    other = ti.cast(0.0, ti.f64)
    if j >= 0:
        ax, ay, other = gas.balance[j][0], gas.balance[j][1], gas.balance[j][2]
        push -= gas.touch[c][PUSH + 1] * (nx * ax + ny * ay)
        drag -= gas.touch[c][DRAG + 1] * (nx * ay - ny * ax) - gas.touch[c][SPIN_UP + 1] * other
    return ti.Vector([push, drag, turn, other], ti.f64)


@ti.func
def into_wedge(push, drag, bound):
    """The nearest F_n >= 0 and F_t with |F_t| <= b F_n."""
    most = bound * push
    if push < 0.0 or ti.abs(drag) > most:
        push = ti.max((push + bound * ti.abs(drag)) / (1.0 + bound * bound), 0.0)
        most = bound * push
        drag = ti.max(-most, ti.min(drag, most))
    return push, drag


@ti.func
def into_cone(force, c, gas: ti.template()):
    """The nearest four forces with F >= 0 and |F_q| <= b_q F.

    F is the root of F - F_0 - sum b_q max(|F_q| - b_q F, 0), which grows and bends down: Newton's steps from its left
    side stay there, and each loses a term at least or is the last one.
    """
    push = ti.max(force[0], 0.0)
    least = force[0]
    for q in ti.static(range(FORCES - 1)):
        least += gas.touch[c][BOUND + q] * ti.abs(force[q + 1])
    found = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    if least > 0.0:
        going, steps = 1, 0
        while going == 1:
            value, slope = push - force[0], ti.cast(1.0, ti.f64)
            for q in ti.static(range(FORCES - 1)):
                bound = gas.touch[c][BOUND + q]
                over = ti.abs(force[q + 1]) - bound * push
                if over > 0.0:
                    value -= bound * over
                    slope += bound * bound
            push -= value / slope
            steps += 1
            going = ti.cast(value < 0.0 and steps < FORCES, ti.i32)
        found[0] = push
        for q in ti.static(range(FORCES - 1)):
            most = gas.touch[c][BOUND + q] * push
            found[q + 1] = ti.max(-most, ti.min(force[q + 1], most))
    return found


@ti.func
def balanced(count, n, most, places, gas: ti.template()):
    """Find the forces in all cones that leave the least accelerations; 1 if that was done in `most` steps, else 0."""
    lightest, rolls = ti.cast(0.0, ti.f64), 0
    for c in range(count):
        i = ti.cast(gas.touch[c][FIRST], ti.i32)
        lightest = ti.max(lightest, ti.cast(gas.kinds[kind_of(i, gas)][INVERSE_MASS], ti.f64))
        if gas.touch[c][BOUND + 1] > 0.0:
            rolls = 1
        # Torques against the force along the contact: what turns a disk most.
        gas.touch[c][FORCE], gas.touch[c][FORCE + 1] = 1.0, -1.0 - 0.1 * ti.cast(c % 3, ti.f64)
        gas.touch[c][FORCE + 2], gas.touch[c][FORCE + 3] = 1.0, 1.0
        for q in ti.static(range(FORCES)):
            gas.touch[c][TRIED + q] = 0.0
    pull = ti.cast(ti.sqrt(gas.scale[GX] ** 2 + gas.scale[GY] ** 2), ti.f64)
    enough = (NEAR_ENOUGH * pull) ** 2 / ti.max(lightest, 1.0e-300)
    # The largest curvature, by the power method; a tenth more is above it.
    largest = ti.cast(1.0, ti.f64)
    for _turn in range(20):
        accelerate(count, n, 0.0, 0.0, rolls, places, gas)
        square = ti.cast(0.0, ti.f64)
        for c in range(count):
            change = gained(c, gas)
            for q in ti.static(range(FORCES)):
                if q < 2 or rolls == 1:
                    square += change[q] * change[q]
                    gas.touch[c][FORCE + q] = change[q]
        largest = ti.sqrt(ti.max(square, 1.0e-300))
        for c in range(count):
            for q in ti.static(range(FORCES)):
                gas.touch[c][FORCE + q] = gas.touch[c][FORCE + q] / largest
    step = 1.0 / (1.1 * largest)
    for c in range(count):
        recall(c, gas)
    going, done, turn, further, momentum = 1, 0, 0, ti.cast(0.0, ti.f64), ti.cast(1.0, ti.f64)
    while going == 1:
        accelerate(count, n, further, 1.0, rolls, places, gas)
        changed, upwards = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        for c in range(count):
            slope = gained(c, gas)
            force = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
            force[0] = gas.touch[c][TRIED] - step * slope[0]
            force[1] = gas.touch[c][TRIED + 1] - step * slope[1]
            if rolls == 1:
                force[2] = gas.touch[c][TRIED + 2] - step * slope[2]
                force[3] = gas.touch[c][TRIED + 3] - step * slope[3]
                force = into_cone(force, c, gas)
            else:
                force[0], force[1] = into_wedge(force[0], force[1], gas.touch[c][BOUND])
            for q in ti.static(range(FORCES)):
                if q < 2 or rolls == 1:
                    change = force[q] - gas.touch[c][FORCE + q]
                    changed += (force[q] - gas.touch[c][TRIED + q]) ** 2
                    upwards += slope[q] * change
                    gas.touch[c][TRIED + q] = change
                    gas.touch[c][FORCE + q] = force[q]
        turn += 1
        if changed < enough * step * step:
            going, done = 0, 1
        elif turn > most:
            going = 0
        further = 0.0
        if upwards > 0.0:
            momentum = 1.0
        else:
            later = 0.5 * (1.0 + ti.sqrt(1.0 + 4.0 * momentum * momentum))
            further = (momentum - 1.0) / later
            momentum = later
    accelerate(count, n, 0.0, 1.0, rolls, places, gas)
    keep(count, n, places, gas)
    return done


@ti.func
def who_touches(c, gas: ti.template()):
    """The other one of a contact: the id of the disk, or the wall as a partner."""
    other = ti.cast(gas.touch[c][SECOND], ti.i32)
    if other >= 0:
        other = gas.link[other][WHO]
    return other


@ti.func
def recall(c, gas: ti.template()):
    """Set the forces of a contact to those that the last judgement found there, 0 without.

    Seen from the other disk n, t and the force are the opposite: F_n and F_t are the same, and torques change places.
    """
    i, j = ti.cast(gas.touch[c][FIRST], ti.i32), ti.cast(gas.touch[c][SECOND], ti.i32)
    other = who_touches(c, gas)
    found = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    for h in ti.static(range(0, HELD * OF_HELD, OF_HELD)):
        if gas.grip[i][h] == other:
            for q in ti.static(range(FORCES)):
                found[q] = gas.grip[i][h + 1 + q]
        if j >= 0:
            if gas.grip[j][h] == gas.link[i][WHO]:
                found = ti.Vector(
                    [gas.grip[j][h + 1], gas.grip[j][h + 2], gas.grip[j][h + 4], gas.grip[j][h + 3]], ti.f64
                )
    for q in ti.static(range(FORCES)):
        gas.touch[c][FORCE + q], gas.touch[c][TRIED + q] = found[q], 0.0  # no change yet


@ti.func
def keep(count, n, places, gas: ti.template()):
    """Keep the forces that were found, for the next judgement: at the first HELD contacts that a disk lists."""
    for i in range(places, places + n):
        for h in ti.static(range(0, HELD * OF_HELD, OF_HELD)):
            gas.grip[i][h] = NOBODY
    for c in range(count):
        i = ti.cast(gas.touch[c][FIRST], ti.i32)
        going = ti.cast(gas.touch[c][FORCE] > 0.0, ti.i32)
        for h in ti.static(range(0, HELD * OF_HELD, OF_HELD)):
            if going == 1 and gas.grip[i][h] == NOBODY:
                gas.grip[i][h] = who_touches(c, gas)
                for q in ti.static(range(FORCES)):
                    gas.grip[i][h + 1 + q] = gas.touch[c][FORCE + q]
                going = 0


@ti.func
def left_over(i, gas: ti.template()):
    """The larger of the acceleration and R alpha that is left of the disk at place i."""
    kind = kind_of(i, gas)
    ax, ay, turn = gas.balance[i][0], gas.balance[i][1], gas.balance[i][2]
    root = ti.sqrt(ti.cast(gas.kinds[kind][INVERSE_MASS], ti.f64))
    return root * ti.max(
        ti.sqrt(ax * ax + ay * ay), ti.abs(turn) * ti.sqrt(ti.cast(gas.kinds[kind][K], ti.f64))
    )


@ti.func
def judge(n, tile, region: ti.template(), gas: ti.template()):
    """Judge at the beginning of a window who may rest: wake those who may not, note who may fall asleep.

    There is nothing to judge where nobody has been woken since the last time, no slow disk touches anything and gravity
    has not turned.
    """
    places = region.lane * gas.grid[PLACES]
    pull = ti.cast(ti.sqrt(gas.scale[GX] ** 2 + gas.scale[GY] ** 2), ti.f64)
    changed = ti.cast(gas.clock[BEGIN] == gas.clock[TURNED], ti.i32)
    for i in range(places, places + n):
        if gas.rest[i][ASLEEP_NOW] == WOKEN:
            gas.rest[i][ASLEEP_NOW] = AWAKE
            changed = 1
        if gas.rest[i][ASLEEP_NOW] == SAID_ASLEEP:
            gas.rest[i][ASLEEP_NOW] = ASLEEP
            changed = 1
        gas.rest[i][MAY_REST] = ti.max(sleeps(i, gas), is_slow(i, gas.work[i][VX], gas.work[i][VY], gas))
        if ti.static(gas.uses.walled):
            if gas.rest[i][MAY_REST] == 1:
                if meets_moving_wall(i, region, gas):
                    gas.rest[i][MAY_REST] = 0
                    if sleeps(i, gas):
                        wake(i, tile, gas)
                        changed = 1
    count = find_touches(n, region, gas)
    for c in range(count):
        i, j = ti.cast(gas.touch[c][FIRST], ti.i32), ti.cast(gas.touch[c][SECOND], ti.i32)
        if not sleeps(i, gas):
            changed = 1
        if j >= 0:
            if not sleeps(j, gas):
                changed = 1
    if changed == 1:
        resting = 0
        for i in range(places, places + n):
            resting += gas.rest[i][MAY_REST]
        if not balanced(count, n, 4000 + 10 * resting, places, gas):
            gas.counter[UNJUDGED] = gas.counter[UNJUDGED] + 1
        for i in range(places, places + n):
            over = left_over(i, gas)
            if sleeps(i, gas):
                if over > MOVED * pull:
                    wake(i, tile, gas)
            gas.rest[i][MAY_REST] = ti.cast(gas.rest[i][MAY_REST] == 1 and over < AT_REST * pull, ti.i32)
    else:
        for i in range(places, places + n):
            gas.rest[i][MAY_REST] = 0
