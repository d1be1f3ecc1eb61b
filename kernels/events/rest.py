"""Resting contact: disks that lie still sleep, and cost nothing until something wakes them.

An event-driven code has no lasting contacts: a disk that comes to rest on a floor collides infinitely often in a finite
time. With a small *resting speed* v_s, two rules and a force calculation replace lasting contact.

*Rebound.* A collision whose normal speed of approach g_n is below v_s belongs to a lasting contact, which the law of
single impacts does not describe. It is elastic (e_n = 1). Along the contact Coulomb friction alone acts: sticking at
the contact point, at most mu P_n, and rolling friction, at most rho P_n. Tangential restitution, an impulse that needs
no normal force, does not act (e_t = -1). So a disk on a support jumps by v_s^2 / 2g at most. Gravity returns its
momentum 2 m g_n in the time 2 g_n / g: on average the support pushes by the weight, and friction is that of this push,
as in a lasting contact. The rebound is at least v_0 = v_s / 10, which bounds the number of events; the energy that this
adds, at most 1 % of m v_s^2 / 2, is in the ledger.

*Sleep.* A disk that may rest (see below) falls asleep at a collision slower than v_s with a sleeping disk or a wall at
rest, if it is slower than 2 v_s afterwards (v and R omega): there it touches. From then on it stays there. Its kinetic
energy is the loss `rest` of the ledger. For others it is a wall: a disk of infinite mass at rest. A hit at v_s or more
wakes it, and it takes part in that collision with its own mass.

A disk may be caught between sleeping disks, so closely that it hits them eight times with at most v_s / 1000 g between
two hits. It then falls asleep too, until the next force calculation. If it is too fast, it acts as a wedge and wakes
the disks that it hits. If it is not free after 64 hits, it falls asleep at any speed (`Statistics.jammed` counts these:
friction would have braked it).

*Contact forces.* At the beginning of each window it is decided which disks may rest. Take all disks that sleep or are
slower than 2 v_s as resting. They touch each other, and walls at rest, where the gap is below 4 v_s^2 / g. They may
rest if there are contact forces in the cones |F_t| <= mu F_n, F_n >= 0, that balance every weight and torque. So find
the forces that minimise the residual accelerations,

    min over forces in the cones of  sum (m a^2 + I alpha^2) / 2,   m a = m g + sum F,  I alpha = sum of torques:

a convex problem (M. Anitescu, Math. Program. 105, 113 (2006), doi:10.1007/s10107-005-0590-7), whose residual a and
alpha are unique. It is solved by projected gradient steps with momentum, which restarts when a step goes uphill (B.
O'Donoghue and E. Candes, Found. Comput. Math. 15, 715 (2015), doi:10.1007/s10208-013-9150-3). Unknown are F_n, F_t and
the torques, not amounts of both edges of a cone: two edges of large mu are almost opposite, and the number of steps
would grow as mu^2.

- A disk may rest if its a and R alpha are below g / 1000.
- A sleeping disk with more than 3 g / 1000 wakes: it has lost its support, or its load is too large.

So the load of a heap is carried down to the floor, and a heap without friction flows apart. A torque of rolling
friction, at most rho F_n, acts on each spin by itself, as in the law.

A window lasts 8 v_s / g at most, which bounds how late a disk without support falls. It lasts no longer than a fall by
a twentieth of the largest diameter, by which a sleeping disk may leave its cell in the falling frame.

The steps begin with the forces last found at the same contact, and with 0 at a new one: in a heap that moves little
they are few. These forces belong to the state, so that a resumed run gives the same bits.

*Limits.* Forces in a heap at rest are not unique: the result depends on where the steps begin. Contacts held by a
stress of their own (a disk wedged between walls that friction locks) count as supported. Walls that move, have a moving
surface or a temperature support no disk: disks that they can reach in a window are awake. All gaps of a heap are below
4 v_s^2 / g, and its height is too large by as much. For v_s to 0 all of this vanishes.
"""

from ..columns import FORCES, HELD, MECHANISM, TALLY
from ..disks.flights import on_grid
from ..compiler.language import ti
from ..columns import CONTACTS_PER_DISK
from ..layout import ASLEEP, ASLEEP_UNVERIFIED, AWAKE, FAR, NO_PARTNER, SLOT, WOKEN
from ..disks.particle import add, charge, kind_of, radius_of
from ..walls.cells import cell_of
from ..walls.images import as_partner, position_at, wall_of
from ..walls.kinds import STILL
from ..walls.motion import turned_back, wall_motion, wall_reach, wall_turn
from ..walls.shapes import side_is_not_nearest, wall_vector

SLOW = 2.0  # resting speeds: slower disks may rest
GAP = 4.0  # v_s^2 / g: disks that are nearer touch
QUICK, QUICK_HITS, JAMMED_HITS = 1e-3, 8, 64  # v_s / g: times between hits that are none; how many of them
AT_REST, MOVED = 1e-3, 3e-3  # g: accelerations below which a disk may fall asleep, and above which it wakes
NEAR_ENOUGH = 1e-4  # g: what steps still change of accelerations when forces are found


@ti.func
def sleeps(i, gas: ti.template()):
    """1 if the disk in slot i sleeps, else 0."""
    found = 0
    if ti.static(gas.uses.rest):
        found = ti.cast(gas.rest[i].asleep == ASLEEP, ti.i32)
    return found


@ti.func
def in_falling_frame(x, y, t, gas: ti.template()):
    """Position and velocity at time t, in the falling frame, of a disk that sleeps at (x, y)."""
    x_ = x - on_grid(0.5 * gas.scale.gx * t * t, gas)
    y_ = y - on_grid(0.5 * gas.scale.gy * t * t, gas)
    return x_, y_, -gas.scale.gx * t, -gas.scale.gy * t


@ti.func
def set_at_rest(i, t, gas: ti.template()):
    """Set the disk in slot i at rest in the lab."""
    motion = gas.motion[i]
    motion.x = motion.x + on_grid(0.5 * gas.scale.gx * t * t, gas)
    motion.y = motion.y + on_grid(0.5 * gas.scale.gy * t * t, gas)
    motion.vx, motion.vy, motion.spin = 0.0, 0.0, 0.0


@ti.func
def wake(i, tile, gas: ti.template()):
    """Wake the disk in slot i."""
    gas.rest[i].asleep = WOKEN
    add(tile, TALLY.sleepers, -1.0, gas)


@ti.func
def is_slow(i, vx, vy, gas: ti.template()):
    """1 if the disk in slot i, with this velocity in the lab, is slow enough to rest, else 0."""
    limit = SLOW * gas.scale.resting_speed
    surface = radius_of(i, gas) * gas.motion[i].spin
    return ti.cast(vx * vx + vy * vy < limit * limit and surface * surface < limit * limit, ti.i32)


@ti.func
def count_hit(i, t, since, gas: ti.template()):
    """Count a slow hit of a disk or wall at rest by the disk in slot i, if its latest collision was just before."""
    pull = ti.abs(gas.scale.gx) + ti.abs(gas.scale.gy)
    quick = (t - since) * pull < QUICK * gas.scale.resting_speed
    gas.rest[i].hits = ti.select(quick, gas.rest[i].hits + 1, 0)


@ti.func
def is_wedged(i, t, gas: ti.template()):
    """1 if the disk in slot i has hit sleeping disks too often without time between, and is too fast to sleep."""
    vx, vy = gas.motion[i].vx + gas.scale.gx * t, gas.motion[i].vy + gas.scale.gy * t
    hits = gas.rest[i].hits
    return hits >= QUICK_HITS and hits < JAMMED_HITS and not is_slow(i, vx, vy, gas)


@ti.func
def fall_asleep(i, t, tile, gas: ti.template()):
    """Let the disk in slot i fall asleep after a slow collision with a disk or wall at rest, if it may and is slow.

    A disk that is caught between others may; if it cannot get free, it falls asleep at any speed.
    """
    rest, motion = gas.rest[i], gas.motion[i]
    vx, vy = motion.vx + gas.scale.gx * t, motion.vy + gas.scale.gy * t
    hits, slow = rest.hits, is_slow(i, vx, vy, gas)
    if hits >= JAMMED_HITS or (slow and (rest.may_rest == 1 or hits >= QUICK_HITS)):
        if not slow:
            gas.counter.jammed = gas.counter.jammed + 1
        rest.hits = 0
        kind = kind_of(i, gas)
        radius, spin = gas.kinds[kind].radius, motion.spin
        lost = vx * vx + vy * vy + radius * radius * spin * spin / gas.kinds[kind].k
        energy = ti.cast(0.5 * lost / gas.kinds[kind].inverse_mass, ti.f64)
        add(tile, TALLY.losses.rest, energy, gas)
        if ti.static(gas.uses.dissipated):
            charge(i, MECHANISM.rest, energy, gas)
        add(tile, TALLY.sleepers, 1.0, gas)
        rest.asleep = ASLEEP
        set_at_rest(i, t, gas)


@ti.func
def time_to_sleeper(rx, ry, vx, vy, noise, sigma, within, gas: ti.template()):
    """Time until a falling disk touches a sleeping one; FAR if not `within` that. Separation r, velocity v in the lab.

    The gap f = |r| - sigma has f'' >= -g. Steps to the root of f + f' s - g s^2 / 2 cannot pass the first root of f,
    and converge like Newton's (`walls/root.py`). Disks that touch without speed meet at once if gravity pulls
    them together.
    """
    gx, gy = gas.scale.gx, gas.scale.gy
    pull = ti.sqrt(gx * gx + gy * gy)
    found = FAR + 0.0 * rx
    tolerance = 1.0e-15 * (gas.scale.length_x + gas.scale.length_y)
    reach = sigma + (ti.abs(vx) + ti.abs(vy) + 0.5 * pull * within) * within
    s = 0.0 * rx
    active = ti.cast(rx * rx + ry * ry < reach * reach and within >= 0.0, ti.i32)
    steps = 0
    while active == 1:
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
                active = 0
        if active == 1:
            root = ti.sqrt(slope * slope + 2.0 * pull * f)
            step = (slope + root) / pull
            if slope < 0.0:
                step = 2.0 * f / (root - slope)
            least = 2.0e-16 * within
            if f == 0.0 and ti.abs(slope) <= noise:
                least = 1.0e-6 * within  # they separate
            s += ti.max(step, least)
            if s >= within or steps > 1000:
                active = 0
    return found


@ti.func
def add_contact(i, j, nx, ny, mu, rho, count, gas: ti.template()):
    """Enter the contact of the disk in slot i with that at j, or a wall (-1), n towards i; the length of the list.

    A force F_n n + F_t t acts on i at -R n from its centre, the opposite on j; t = (-n_y, n_x). The friction torque T
    on each disk acts by itself. sqrt(m) a and sqrt(I) alpha = sqrt(k / m) (T / R - F_t) are what is made small.
    """
    contact = gas.contact[count]
    if count < CONTACTS_PER_DISK * gas.grid.lane_slots:
        one = mobility(i, gas)
        other = ti.Vector([0.0, 0.0, 0.0], ti.f64)
        if j >= 0:
            other = mobility(j, gas)
        along = one.xy.norm_sqr() + other.xy.norm_sqr()
        size_n = ti.sqrt(one.x * one.x + other.x * other.x)
        size_t = ti.sqrt(along)
        contact.i, contact.j = ti.cast(i, ti.f64), ti.cast(j, ti.f64)
        contact.normal_x, contact.normal_y = nx, ny
        contact.push[0], contact.push[1] = one.x / size_n, other.x / size_n
        contact.drag[0], contact.drag[1] = one.x / size_t, other.x / size_t
        contact.spin_up[0], contact.spin_up[1] = -one.y / size_t, -other.y / size_t
        contact.bound[0] = mu * size_t / size_n
        contact.bound[1] = rho * one.z / size_n
        contact.bound[2] = rho * other.z / size_n
    return count + 1


@ti.func
def mobility(i, gas: ti.template()):
    """1 / sqrt(m), sqrt(k / m) and sqrt(k / m) / R of the disk in slot i."""
    kind = kind_of(i, gas)
    root = ti.sqrt(ti.cast(gas.kinds[kind].inverse_mass, ti.f64))
    turn = root * ti.sqrt(ti.cast(gas.kinds[kind].k, ti.f64))
    return ti.Vector([root, turn, turn / gas.kinds[kind].radius], ti.f64)


@ti.func
def meets_moving_wall(i, region: ti.template(), gas: ti.template()):
    """1 if a wall that moves, or is no support for another reason, may touch the disk in slot i in this window."""
    found = 0
    cell = cell_of(i, region, gas)
    for item in range(gas.wall_start[cell], gas.wall_start[cell + 1]):
        image = gas.wall_item[region.lane * gas.grid.items + item]
        w = wall_of(image)
        if not is_support(w, gas):
            _nx, _ny, distance = from_wall(i, image, region, gas)
            if distance <= wall_reach(w, gas):
                found = 1
    return found


@ti.func
def is_support(w, gas: ti.template()):
    """1 if wall w is at rest, its surface too, and has no temperature, else 0."""
    wall = gas.walls[w]
    moves = wall.motion.kind != STILL or wall.turn.kind != STILL or wall.surface_speed != 0.0
    return not (moves or wall.temperature > 0.0)


@ti.func
def from_wall(i, image, region: ti.template(), gas: ti.template()):
    """Unit vector from an image of a wall to the disk in slot i, and distance, as the window begins.

    A rotating wall keeps its earlier angle. Outside the angles of an arc only its ends, which are separate walls, are
    near.
    """
    w = wall_of(image)
    s, _speed, _bound, _until = wall_motion(w, 0.0 * gas.scale.resting_speed, gas)
    x, y = position_at(i, image, region, gas)
    if ti.static(gas.uses.turning_walls):
        angle, _spin, _most, _turn_bound = wall_turn(w, 0.0 * s, gas)
        x, y = turned_back(w, x, y, s, angle, gas)
    nx, ny, distance = wall_vector(w, x, y, s, gas)
    if side_is_not_nearest(w, nx, ny, distance, gas) == 1:
        distance = FAR + 0.0 * distance
    return nx, ny, distance


@ti.func
def find_contacts(n, region: ti.template(), gas: ti.template()):
    """List the contacts of disks that may rest with each other and with walls at rest; their number.

    Awake disks without any may not.
    """
    pull = ti.sqrt(gas.scale.gx**2 + gas.scale.gy**2)
    near = GAP * gas.scale.resting_speed * gas.scale.resting_speed / pull
    offset = region.lane * gas.grid.lane_slots
    count = 0
    for i in range(offset, offset + n):
        info = gas.event_info[i]
        if gas.rest[i].may_rest == 1:
            own_x, own_y = info.cell >> 16, info.cell & 0xFFFF
            radius = radius_of(i, gas)
            p = ti.cast(gas.kinds[kind_of(i, gas)].material, ti.i32)
            for step in range(5):  # each pair once: the own cell, and half of those around
                ax, ay = own_x + ti.select(step < 2, 0, 1), own_y + ti.select(step < 2, step, step - 3)
                shift_x, shift_y = 0.0 * near, 0.0 * near
                if region.wrap_x == 1 and ax >= region.nx:
                    ax -= region.nx
                    shift_x = gas.scale.length_x
                if region.wrap_y == 1:
                    if ay >= region.ny:
                        ay -= region.ny
                        shift_y = gas.scale.length_y
                    elif ay < 0:
                        ay += region.ny
                        shift_y = -gas.scale.length_y
                j = -1
                if ax < region.nx and ay >= 0 and ay < region.ny:
                    j = gas.head[region.cells + ax * region.ny + ay]
                    if step == 0:
                        j = info.next_in_cell
                while j >= 0:
                    j &= SLOT
                    if gas.rest[j].may_rest == 1:
                        dx = gas.motion[i].x - gas.motion[j].x - shift_x
                        dy = gas.motion[i].y - gas.motion[j].y - shift_y
                        r = ti.sqrt(dx * dx + dy * dy)
                        if r < radius + radius_of(j, gas) + near:
                            q = ti.cast(gas.kinds[kind_of(j, gas)].material, ti.i32)
                            count = add_contact(
                                i, j, dx / r, dy / r, gas.law[p, q].mu, gas.law[p, q].rho, count, gas
                            )
                    j = gas.event_info[j].next_in_cell
            if ti.static(gas.uses.walls):
                cell = cell_of(i, region, gas)
                for item in range(gas.wall_start[cell], gas.wall_start[cell + 1]):
                    image = gas.wall_item[region.lane * gas.grid.items + item]
                    w = wall_of(image)
                    nx, ny, distance = from_wall(i, image, region, gas)
                    if distance < radius + near and is_support(w, gas):
                        q = ti.cast(gas.walls[w].material, ti.i32)
                        count = add_contact(
                            i, as_partner(w), nx, ny, gas.law[p, q].mu, gas.law[p, q].rho, count, gas
                        )
    if count > CONTACTS_PER_DISK * gas.grid.lane_slots:
        count = CONTACTS_PER_DISK * gas.grid.lane_slots
        gas.counter.unverified = gas.counter.unverified + 1
    return count


@ti.func
def accelerate(count, n, further, weight, rolls, offset, gas: ti.template()):
    """Find sqrt(m) a and sqrt(I) alpha of n disks by `weight` times gravity and forces, which become the trial forces.

    These are the forces plus `further` times their last change. Friction torques count only if some contact `rolls`.
    """
    for i in range(offset, offset + n):
        residual = gas.residual_acceleration[i]
        root = weight / ti.sqrt(ti.cast(gas.kinds[kind_of(i, gas)].inverse_mass, ti.f64))
        residual.x, residual.y = (
            root * gas.scale.gx,
            root * gas.scale.gy,
        )
        residual.turn = 0.0
    for c in range(count):
        contact = gas.contact[c]
        i, j = ti.cast(contact.i, ti.i32), ti.cast(contact.j, ti.i32)
        nx, ny = contact.normal_x, contact.normal_y
        push = contact.force[0] + further * contact.trial[0]
        drag = contact.force[1] + further * contact.trial[1]
        contact.trial[0], contact.trial[1] = push, drag
        p, q = push * contact.push[0], drag * contact.drag[0]
        gas.residual_acceleration[i].x = gas.residual_acceleration[i].x + (p * nx - q * ny)
        gas.residual_acceleration[i].y = gas.residual_acceleration[i].y + (p * ny + q * nx)
        gas.residual_acceleration[i].turn = gas.residual_acceleration[i].turn + drag * contact.spin_up[0]
        if j >= 0:
            p, q = push * contact.push[1], drag * contact.drag[1]
            gas.residual_acceleration[j].x = gas.residual_acceleration[j].x - (p * nx - q * ny)
            gas.residual_acceleration[j].y = gas.residual_acceleration[j].y - (p * ny + q * nx)
            gas.residual_acceleration[j].turn = gas.residual_acceleration[j].turn + drag * contact.spin_up[1]
        if rolls == 1:
            for q in ti.static(range(2, FORCES)):
                contact.trial[q] = contact.force[q] + further * contact.trial[q]
            gas.residual_acceleration[i].turn = gas.residual_acceleration[i].turn + contact.trial[2]
            if j >= 0:
                gas.residual_acceleration[j].turn = gas.residual_acceleration[j].turn + contact.trial[3]


@ti.func
def energy_gradient(c, gas: ti.template()):
    """Derivatives of the sum of (m a^2 + I alpha^2) / 2 by the four forces of a contact."""
    contact = gas.contact[c]
    i, j = ti.cast(contact.i, ti.i32), ti.cast(contact.j, ti.i32)
    nx, ny = contact.normal_x, contact.normal_y
    ax, ay, turn = (
        gas.residual_acceleration[i].x,
        gas.residual_acceleration[i].y,
        gas.residual_acceleration[i].turn,
    )
    push = contact.push[0] * (nx * ax + ny * ay)
    drag = contact.drag[0] * (nx * ay - ny * ax) + contact.spin_up[0] * turn
    other = ti.cast(0.0, ti.f64)
    if j >= 0:
        ax, ay, other = (
            gas.residual_acceleration[j].x,
            gas.residual_acceleration[j].y,
            gas.residual_acceleration[j].turn,
        )
        push -= contact.push[1] * (nx * ax + ny * ay)
        drag -= contact.drag[1] * (nx * ay - ny * ax) - contact.spin_up[1] * other
    return ti.Vector([push, drag, turn, other], ti.f64)


@ti.func
def project_on_wedge(push, drag, bound):
    """The nearest F_n >= 0 and F_t with |F_t| <= b F_n."""
    most = bound * push
    if push < 0.0 or ti.abs(drag) > most:
        push = ti.max((push + bound * ti.abs(drag)) / (1.0 + bound * bound), 0.0)
        most = bound * push
        drag = ti.max(-most, ti.min(drag, most))
    return push, drag


@ti.func
def project_on_cone(force, c, gas: ti.template()):
    """The nearest four forces with F >= 0 and |F_q| <= b_q F.

    F is the root of F - F_0 - sum b_q max(|F_q| - b_q F, 0), which grows and bends down: Newton's steps from its left
    side stay there, and each loses a term at least or is the last one.
    """
    contact = gas.contact[c]
    push = ti.max(force[0], 0.0)
    least = force[0]
    for q in ti.static(range(FORCES - 1)):
        least += contact.bound[q] * ti.abs(force[q + 1])
    found = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    if least > 0.0:
        active, steps = 1, 0
        while active == 1:
            value, slope = push - force[0], ti.cast(1.0, ti.f64)
            for q in ti.static(range(FORCES - 1)):
                bound = contact.bound[q]
                over = ti.abs(force[q + 1]) - bound * push
                if over > 0.0:
                    value -= bound * over
                    slope += bound * bound
            push -= value / slope
            steps += 1
            active = ti.cast(value < 0.0 and steps < FORCES, ti.i32)
        found[0] = push
        for q in ti.static(range(FORCES - 1)):
            most = contact.bound[q] * push
            found[q + 1] = ti.max(-most, ti.min(force[q + 1], most))
    return found


@ti.func
def solve_contact_forces(count, n, most, offset, gas: ti.template()):
    """Find the forces in all cones that minimise the residual accelerations; 1 if `most` steps were enough, else 0."""
    lightest, rolls = ti.cast(0.0, ti.f64), 0
    for c in range(count):
        contact = gas.contact[c]
        i = ti.cast(contact.i, ti.i32)
        lightest = ti.max(lightest, ti.cast(gas.kinds[kind_of(i, gas)].inverse_mass, ti.f64))
        if contact.bound[1] > 0.0:
            rolls = 1
        # Torques against the force along the contact, which turn a disk most.
        contact.force[0], contact.force[1] = 1.0, -1.0 - 0.1 * ti.cast(c % 3, ti.f64)
        contact.force[2], contact.force[3] = 1.0, 1.0
        for q in ti.static(range(FORCES)):
            contact.trial[q] = 0.0
    pull = ti.cast(ti.sqrt(gas.scale.gx**2 + gas.scale.gy**2), ti.f64)
    enough = (NEAR_ENOUGH * pull) ** 2 / ti.max(lightest, 1.0e-300)
    # The largest curvature, by the power method, and a tenth more as an upper bound.
    largest = ti.cast(1.0, ti.f64)
    for _turn in range(20):
        accelerate(count, n, 0.0, 0.0, rolls, offset, gas)
        square = ti.cast(0.0, ti.f64)
        for c in range(count):
            change = energy_gradient(c, gas)
            for q in ti.static(range(FORCES)):
                if q < 2 or rolls == 1:
                    square += change[q] * change[q]
                    gas.contact[c].force[q] = change[q]
        largest = ti.sqrt(ti.max(square, 1.0e-300))
        for c in range(count):
            for q in ti.static(range(FORCES)):
                gas.contact[c].force[q] = gas.contact[c].force[q] / largest
    step = 1.0 / (1.1 * largest)
    for c in range(count):
        load_cached_forces(c, gas)
    active, done, turn, further, momentum = 1, 0, 0, ti.cast(0.0, ti.f64), ti.cast(1.0, ti.f64)
    while active == 1:
        accelerate(count, n, further, 1.0, rolls, offset, gas)
        changed, upwards = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        for c in range(count):
            touching = gas.contact[c]
            slope = energy_gradient(c, gas)
            force = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
            force[0] = touching.trial[0] - step * slope[0]
            force[1] = touching.trial[1] - step * slope[1]
            if rolls == 1:
                force[2] = touching.trial[2] - step * slope[2]
                force[3] = touching.trial[3] - step * slope[3]
                force = project_on_cone(force, c, gas)
            else:
                force[0], force[1] = project_on_wedge(force[0], force[1], touching.bound[0])
            for q in ti.static(range(FORCES)):
                if q < 2 or rolls == 1:
                    change = force[q] - touching.force[q]
                    changed += (force[q] - touching.trial[q]) ** 2
                    upwards += slope[q] * change
                    touching.trial[q] = change
                    touching.force[q] = force[q]
        turn += 1
        if changed < enough * step * step:
            active, done = 0, 1
        elif turn > most:
            active = 0
        further = 0.0
        if upwards > 0.0:
            momentum = 1.0
        else:
            later = 0.5 * (1.0 + ti.sqrt(1.0 + 4.0 * momentum * momentum))
            further = (momentum - 1.0) / later
            momentum = later
    accelerate(count, n, 0.0, 1.0, rolls, offset, gas)
    cache_forces(count, n, offset, gas)
    return done


@ti.func
def contact_partner(c, gas: ti.template()):
    """The second partner of a contact: the id of the disk, or the wall as a partner."""
    other = ti.cast(gas.contact[c].j, ti.i32)
    if other >= 0:
        other = gas.event_info[other].id
    return other


@ti.func
def load_cached_forces(c, gas: ti.template()):
    """Set the forces of a contact to those last found there, or to 0.

    Seen from the other disk n, t and the force are opposite: F_n and F_t are the same, and the torques are exchanged.
    """
    contact = gas.contact[c]
    i, j = ti.cast(contact.i, ti.i32), ti.cast(contact.j, ti.i32)
    other = contact_partner(c, gas)
    found = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)
    for h in ti.static(range(HELD.contact.count)):
        if gas.cached_force[i].contact[h].other == other:
            for q in ti.static(range(FORCES)):
                found[q] = gas.cached_force[i].contact[h].force[q]
        if j >= 0:
            if gas.cached_force[j].contact[h].other == gas.event_info[i].id:
                found = ti.Vector(
                    [
                        gas.cached_force[j].contact[h].force[0],
                        gas.cached_force[j].contact[h].force[1],
                        gas.cached_force[j].contact[h].force[3],
                        gas.cached_force[j].contact[h].force[2],
                    ],
                    ti.f64,
                )
    for q in ti.static(range(FORCES)):
        contact.force[q], contact.trial[q] = found[q], 0.0  # no change yet


@ti.func
def cache_forces(count, n, offset, gas: ti.template()):
    """Cache the forces at the first contacts that a disk lists, for the next window."""
    for i in range(offset, offset + n):
        for h in ti.static(range(HELD.contact.count)):
            gas.cached_force[i].contact[h].other = NO_PARTNER
    for c in range(count):
        contact = gas.contact[c]
        i = ti.cast(contact.i, ti.i32)
        active = ti.cast(contact.force[0] > 0.0, ti.i32)
        for h in ti.static(range(HELD.contact.count)):
            if active == 1 and gas.cached_force[i].contact[h].other == NO_PARTNER:
                gas.cached_force[i].contact[h].other = contact_partner(c, gas)
                for q in ti.static(range(FORCES)):
                    gas.cached_force[i].contact[h].force[q] = contact.force[q]
                active = 0


@ti.func
def residual_of(i, gas: ti.template()):
    """The larger of the residual acceleration and R alpha of the disk in slot i."""
    residual = gas.residual_acceleration[i]
    kind = kind_of(i, gas)
    ax, ay, turn = residual.x, residual.y, residual.turn
    root = ti.sqrt(ti.cast(gas.kinds[kind].inverse_mass, ti.f64))
    return root * ti.max(
        ti.sqrt(ax * ax + ay * ay), ti.abs(turn) * ti.sqrt(ti.cast(gas.kinds[kind].k, ti.f64))
    )


@ti.func
def update_resting(n, tile, region: ti.template(), gas: ti.template()):
    """Decide at the beginning of a window which disks may rest: wake those that may not, mark those that may.

    Nothing changes if no disk has been woken since the last time, no slow disk touches anything and gravity has not
    turned.
    """
    offset = region.lane * gas.grid.lane_slots
    pull = ti.cast(ti.sqrt(gas.scale.gx**2 + gas.scale.gy**2), ti.f64)
    changed = ti.cast(gas.clock.begin == gas.clock.rotated, ti.i32)
    for i in range(offset, offset + n):
        rest = gas.rest[i]
        if rest.asleep == WOKEN:
            rest.asleep = AWAKE
            changed = 1
        if rest.asleep == ASLEEP_UNVERIFIED:
            rest.asleep = ASLEEP
            changed = 1
        rest.may_rest = ti.max(sleeps(i, gas), is_slow(i, gas.motion[i].vx, gas.motion[i].vy, gas))
        if ti.static(gas.uses.walls):
            if rest.may_rest == 1:
                if meets_moving_wall(i, region, gas):
                    rest.may_rest = 0
                    if sleeps(i, gas):
                        wake(i, tile, gas)
                        changed = 1
    count = find_contacts(n, region, gas)
    for c in range(count):
        i, j = ti.cast(gas.contact[c].i, ti.i32), ti.cast(gas.contact[c].j, ti.i32)
        if not sleeps(i, gas):
            changed = 1
        if j >= 0:
            if not sleeps(j, gas):
                changed = 1
    if changed == 1:
        resting = 0
        for i in range(offset, offset + n):
            resting += gas.rest[i].may_rest
        if not solve_contact_forces(count, n, 4000 + 10 * resting, offset, gas):
            gas.counter.unverified = gas.counter.unverified + 1
        for i in range(offset, offset + n):
            over = residual_of(i, gas)
            if sleeps(i, gas):
                if over > MOVED * pull:
                    wake(i, tile, gas)
            gas.rest[i].may_rest = ti.cast(gas.rest[i].may_rest == 1 and over < AT_REST * pull, ti.i32)
    else:
        for i in range(offset, offset + n):
            gas.rest[i].may_rest = 0
