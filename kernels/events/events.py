"""The serial core: the events of one region of disks, in order, from the beginning of a window to its end.

Disks lie in cells at least as wide as the largest of them, so that disks that touch are in adjacent cells. Each has one
event: its collision or, if that is earlier, its crossing into the next cell. Bins over the time of the window are the
queue.

Only the disk that predicts a collision stores it. A partner that has collided since makes it stale: then the disk
predicts again. None is missed: whenever the motion of a disk changes it looks at all its neighbours, and when it enters
a cell, at those that become neighbours; so of any two that will meet, the one that looked last knows of it, or has an
earlier event, at which it looks again.

Positions and clocks of disks change at collisions only, never at crossings, and are rounded to the grid then. So
histories depend neither on the cells nor on the region, only on the disks in it.
"""

from ..columns import LOSS, MECHANISM, TALLY
from ..compiler.records import NamedVector
from ..laws.contact import ELASTIC, ROLLS, STICKS, collided
from ..laws.law import reduced_radius
from ..forces.force_events import act_alone, act_on_all, first_horizon, kick_time
from ..disks.force_times import action_time
from ..disks.flights import bits_of, real_of
from ..compiler.language import on_gpu, ti
from ..layout import (
    AT_END, AT_MOMENT, BY_COUNT, BY_LAW, BY_REMEDY, BY_WORK, ELASTICALLY, FAR, FULL_PAIRS,
    FULL_TRAIL, NO_PARTNER, OWN, OWN_ACTION, PAIRS, SLOT, TOO_LONG, TRAIL,
)  # fmt: skip
from ..disks.particle import (
    add, charge, just_collided, kind_of, largest_speed, next_hash, note_speed, position_at, speed_square,
    turn, watched_row, write_motion,
)  # fmt: skip
from .rest import (
    count_hit, fall_asleep, in_falling_frame, is_support, is_wedged, set_at_rest, sleeps, wake,
)  # fmt: skip
from ..disks.histograms import enter_histograms
from ..disks.stress import add_energy_of_pair, add_virial_of_pair
from ..tiles.lines import leave_place, take_place, write_line
from ..tiles.tiles import head_at, layer_of, note_extremes, scale_of, word_of, write
from ..walls.cells import first_wall, other_image
from ..walls.collision import hit_wall
from ..walls.images import from_partner, wall_of
from ..walls.pistons import bounce, meets_piston, next_stop
from .search import find

EMPTY = -1  # of bins and cells
NO_ROW = -1  # of a trail
LEAST_ID = -(2**31)
NOT_QUEUED = -1  # as `event_info.previous`; the first of bin b has -2 - b
MANY_EVENTS = 200_000  # and 20 of each disk, without progress of time: an inelastic collapse
EVENTS_OF_A_LOOK = 100_000  # between two looks of `check_progress`
# Of a gas in one tile: a second's work or two, before Python may look whether it is to stop. Half of it within a
# window, where so many are often those of a large gas, each of which takes longer.
MOST_EVENTS_OF_A_LAUNCH = 1_000_000
# Events, and those of each disk besides, in which a window that ends advances by this part of it: some 20 s of work.
# A disk collides about once in a window, and crosses a few hundred cells in the thinnest gases: some 15 in this part.
LONG, LONG_OF_A_DISK, LEAST_ADVANCE = 2_500_000, 30, 0.05
TOO_FAR = 1e6  # or a disk that would come so many times through its region in a window


@ti.func
def remove_event(i, bins, gas: ti.template()):
    """Remove a disk from its bin."""
    info = gas.event_info[i]
    before, after = info.previous, info.next
    if before != NOT_QUEUED:
        if before < NOT_QUEUED:
            gas.bin[bins - 2 - before] = after
        else:
            gas.event_info[before].next = after
        if after >= 0:
            gas.event_info[after].previous = before
        info.previous = NOT_QUEUED


@ti.func
def insert_event(i, t, present, bins, n_bins, rate, gas: ti.template()):
    """Put a disk whose event is at t into its bin, none before the `present` one; into none beyond the window."""
    if t * rate < n_bins:
        b = ti.min(ti.max(ti.cast(t * rate, ti.i32), present), n_bins - 1)
        after = gas.bin[bins + b]
        gas.event_info[i].next = after
        gas.event_info[i].previous = -2 - b
        if after >= 0:
            gas.event_info[after].previous = i
        gas.bin[bins + b] = i


@ti.func
def next_event(i, gas: ti.template()):
    """Time at which the disk in slot i collides or leaves its cell."""
    hit, leaves = gas.motion[i].t_hit, gas.motion[i].t_leave
    return ti.select(leaves < hit, leaves, hit)


@ti.func
def precedes(i, k, gas: ti.template()):
    """1 if the event of the disk in slot i, at the time of that in slot k, comes first: the smaller pair of ids."""
    info, info_k = gas.event_info[i], gas.event_info[k]
    a, b, c, d = info.id, info.id, info_k.id, info_k.id
    if info.partner >= 0 and gas.motion[i].t_hit <= gas.motion[i].t_leave:
        b = gas.event_info[info.partner].id
    if info_k.partner >= 0 and gas.motion[k].t_hit <= gas.motion[k].t_leave:
        d = gas.event_info[info_k.partner].id
    low_1, high_1 = ti.min(a, b), ti.max(a, b)
    low_2, high_2 = ti.min(c, d), ti.max(c, d)
    if ti.static(gas.uses.actions):  # forces first: a disk predicts no collision at that time
        if info.partner == OWN_ACTION and gas.motion[i].t_hit <= gas.motion[i].t_leave:
            low_1 = ti.i32(LEAST_ID)
        if info_k.partner == OWN_ACTION and gas.motion[k].t_hit <= gas.motion[k].t_leave:
            low_2 = ti.i32(LEAST_ID)
    return low_1 < low_2 or (low_1 == low_2 and high_1 < high_2)


@ti.func
def leaving(i, region: ti.template(), gas: ti.template()):
    """Time at which the disk in slot i leaves its cell, and the side: 1 left, 2 right, 3 below, 4 above.

    Cells at an end of the region that is no periodic side have no end there.
    """
    motion, info = gas.motion[i], gas.event_info[i]
    cx, cy = info.cell >> 16, info.cell & 0xFFFF
    nx, ny, factor = scale_of(layer_of(i, gas), region, gas)
    side_x, side_y = factor * region.side_x, factor * region.side_y
    x, y, vx, vy = motion.x, motion.y, motion.vx, motion.vy
    if ti.static(gas.uses.shear):
        row = info.shear_row
        if row != 0:  # in the frame of the region
            vx += row * gas.scale.drift
            x += row * (gas.scale.aside + gas.scale.drift * motion.tau)
    # Without branches, which no processor foresees: of times as integers, which have the order of numbers from 0 on.
    right, up = ti.cast(vx > 0.0, ti.i32), ti.cast(vy > 0.0, ti.i32)
    never = bits_of(FAR + 0.0 * x)
    to_x = bits_of((region.x + (cx + right) * side_x - x) / vx)
    to_y = bits_of((region.y + (cy + up) * side_y - y) / vy)
    moves_x, moves_y = ti.abs(vx) > 0.0, ti.abs(vy) > 0.0
    to_x = ti.select(moves_x & ((region.wrap_x == 1) | (cx != right * (nx - 1))), to_x, never)
    to_y = ti.select(moves_y & ((region.wrap_y == 1) | (cy != up * (ny - 1))), to_y, never)
    side = ti.select(to_y < to_x, 3 + up, 1 + right)
    earliest = real_of(ti.max(ti.min(to_x, to_y), 0 * never))
    return motion.tau + earliest, side


@ti.func
def stays(i, horizon, region: ti.template(), gas: ti.template()):
    """True if the disk in slot i does not leave its cell until a `horizon`; without the divisions of `leaving`."""
    motion, info = gas.motion[i], gas.event_info[i]
    _nx, _ny, factor = scale_of(layer_of(i, gas), region, gas)
    dt = horizon - motion.tau
    x, y = motion.x + motion.vx * dt - region.x, motion.y + motion.vy * dt - region.y
    if ti.static(gas.uses.shear):
        x += info.shear_row * (gas.scale.aside + gas.scale.drift * horizon)
    cx, cy = (
        x - (info.cell >> 16) * (factor * region.side_x),
        y - (info.cell & 0xFFFF) * (factor * region.side_y),
    )
    return (cx > 0.0) & (cx < factor * region.side_x) & (cy > 0.0) & (cy < factor * region.side_y)


@ti.func
def step_over(side):
    """Columns and rows of cells that a disk moves by over a side of its cell: 1 left, 2 right, 3 below, 4 above."""
    return ti.select(side <= 2, 2 * side - 3, 0), ti.select(side <= 2, 0, 2 * side - 7)


@ti.func
def unlink(i, cell, gas: ti.template()):
    """Take the disk in slot i out of the list of its cell, given by its index in `head`."""
    following = gas.event_info[i].next_in_cell
    back, before, k = EMPTY, EMPTY, gas.head[cell] & SLOT
    while k != i:
        back, before, k = before, k, gas.event_info[k].next_in_cell & SLOT
    if before == EMPTY:
        gas.head[cell] = following
    else:
        gas.event_info[before].next_in_cell = following
        if following < 0:  # the one before is the last one now
            if back == EMPTY:
                gas.head[cell] = before
            else:
                gas.event_info[back].next_in_cell = before


@ti.func
def leave(i, side, region: ti.template(), gas: ti.template()):
    """Move the disk in slot i into the next cell over a side; round the box where that is periodic."""
    info, motion, image = gas.event_info[i], gas.motion[i], gas.image_info[i]
    cx, cy = info.cell >> 16, info.cell & 0xFFFF
    layer = layer_of(i, gas)
    nx, ny, _factor = scale_of(layer, region, gas)
    if ti.static(gas.uses.thin):
        leave_place(i, cx * ny + cy, region, gas)
    else:
        unlink(i, head_at(cx, cy, layer, region, gas), gas)
    step_x, step_y = step_over(side)
    cx += step_x
    cy += step_y
    if cx < 0 or cx >= nx:
        cx -= step_x * nx
        motion.x = motion.x - step_x * gas.scale.length_x
        image.lap_x = image.lap_x + step_x
        if ti.static(gas.uses.walls):
            other_image(i, step_x, 0, gas)
    if cy < 0 or cy >= ny:
        cy -= step_y * ny
        motion.y = motion.y - step_y * gas.scale.length_y
        image.lap_y = image.lap_y + step_y
        if ti.static(gas.uses.walls):
            other_image(i, 0, step_y, gas)
    info.cell = (cx << 16) + cy
    if ti.static(gas.uses.thin):
        take_place(i, cx * ny + cy, region, gas)
    else:
        cell = head_at(cx, cy, layer, region, gas)
        info.next_in_cell = gas.head[cell]
        gas.head[cell] = word_of(i, info.next_in_cell)


@ti.func
def nearest(d, length, wraps):
    """The shift by a box length that brings a separation nearest to 0, across a periodic side."""
    shift = 0.0 * d
    if wraps == 1:
        if d > 0.5 * length:
            shift = -length
        elif d < -0.5 * length:
            shift = length
    return shift


@ti.func
def friction_column(regime):
    """Column of losses to which friction in a collision belongs."""
    return ti.select(regime % ROLLS == STICKS, MECHANISM.sticking, MECHANISM.sliding)


@ti.func
def enter_losses(tile, regime, lost, gas: ti.template()):
    """Add the losses and the regime of a collision of two disks to the tally."""
    loss = NamedVector(lost, LOSS)
    add(tile, TALLY.losses.normal, loss.normal, gas)
    add(tile, TALLY.losses.tangential_restitution, loss.tangential_restitution, gas)
    add(tile, TALLY.losses[friction_column(regime)], loss.friction, gas)
    add(tile, TALLY.losses.rolling, loss.rolling, gas)
    add(tile, TALLY.regimes[ti.min(regime, ELASTICALLY)], 1.0, gas)


@ti.func
def charge_half(i, regime, lost, gas: ti.template()):
    """Add half of the losses of a collision to those of the disk in slot i."""
    loss = NamedVector(lost, LOSS)
    charge(i, MECHANISM.normal, 0.5 * loss.normal, gas)
    charge(i, MECHANISM.tangential_restitution, 0.5 * loss.tangential_restitution, gas)
    charge(i, friction_column(regime), 0.5 * loss.friction, gas)
    charge(i, MECHANISM.rolling, 0.5 * loss.rolling, gas)


@ti.func
def hit_sleepers(
    a: ti.template(), b: ti.template(), t: ti.template(), since_a: ti.template(), since_b: ti.template(),
    asleep_a: ti.template(), asleep_b: ti.template(), slow: ti.template(), inverse_a: ti.template(),
    inverse_b: ti.template(), tile: ti.template(), gas: ti.template(),
):  # fmt: skip
    """Wake the disks in slots a and b that sleep, or set their inverse mass to 0, if the hit is `slow`.

    A slow hit leaves a sleeping disk asleep, like a wall. A harder one wakes it, and one by a disk that is wedged in.
    """
    if slow and asleep_a:
        count_hit(b, t, since_b, gas)
        slow = not is_wedged(b, t, gas)
    elif slow and asleep_b:
        count_hit(a, t, since_a, gas)
        slow = not is_wedged(a, t, gas)
    if slow:
        inverse_a, inverse_b = ti.select(asleep_a, 0.0, inverse_a), ti.select(asleep_b, 0.0, inverse_b)
    else:
        if asleep_a:
            wake(a, tile, gas)
        if asleep_b:
            wake(b, tile, gas)


@ti.func
def rest_after_hit(
    a: ti.template(), b: ti.template(), t: ti.template(), tile: ti.template(), gas: ti.template()
):
    """Where one of the disks in slots a and b still sleeps, the other may fall asleep too."""
    if sleeps(a, gas):
        set_at_rest(a, t, gas)
        fall_asleep(b, t, tile, gas)
    elif sleeps(b, gas):
        set_at_rest(b, t, gas)
        fall_asleep(a, t, tile, gas)


@ti.func
def write_pair(a: ti.template(), b: ti.template(), t: ti.template(), tile: ti.template(), gas: ti.template()):
    """Write a row of `pair` for a collision of the disks in slots a and b."""
    row = ti.atomic_add(gas.counter.n_pairs, 1)
    if row < gas.grid.most_pairs:
        gas.pair_time[row] = t
        gas.pair[row].tile = tile
        gas.pair[row].id, gas.pair[row].partner = gas.event_info[a].id, gas.event_info[b].id
    else:
        ti.atomic_or(gas.counter.full, FULL_PAIRS)


@ti.func
def write_trail(turn: ti.template(), run: ti.template(), partner: ti.template(), gas: ti.template()):
    """Write a row of `trail` for the event of the disk in slot i at t with a partner, behind those of the tile."""
    row = ti.atomic_add(gas.counter.n_trail, 1)
    if row < gas.grid.most_trail:
        one, other = turn.i - run.offset, partner
        if partner >= 0:
            other -= run.offset
            a = ti.select(gas.event_info[partner].id < gas.event_info[turn.i].id, partner, turn.i)
            one += ti.select(gas.event_info[a].own_rank > 0, OWN, 0)
        last = gas.tile[run.tile].last_row
        if last < 0:
            gas.tile[run.tile].first_row = row
        else:
            gas.trail[last].next = row
        gas.tile[run.tile].last_row = row
        gas.trail_time[row] = turn.t
        gas.trail[row].one, gas.trail[row].other, gas.trail[row].next = one, other, NO_ROW
    else:
        ti.atomic_or(gas.counter.full, FULL_TRAIL)


@ti.func
def note_event(turn: ti.template(), run: ti.template(), partner: ti.template(), gas: ti.template()):
    """Write down the event of the disk in slot i at t with a partner, before it happens, where trails are kept."""
    if ti.static(not on_gpu()):
        if (gas.grid.watching & TRAIL) > 0:
            write_trail(turn, run, partner, gas)


@ti.func
def begin_trail(tile, gas: ti.template()):
    """Begin the trail of a tile anew; where it runs again in a window, collisions on the old one do not count."""
    row = gas.tile[tile].first_row
    while row >= 0 and gas.counter.again == 1:
        gas.trail[row].one &= SLOT
        row = gas.trail[row].next
    gas.tile[tile].first_row, gas.tile[tile].last_row = NO_ROW, NO_ROW


@ti.func
def write_collision(
    a: ti.template(), b: ti.template(), t: ti.template(), rx: ti.template(), ry: ti.template(), r: ti.template(),
    before: ti.template(), after: ti.template(), regime: ti.template(), tile: ti.template(), region: ti.template(),
    gas: ti.template(),
):  # fmt: skip
    """Write a row of `event` for each of the disks in slots a and b that is tracked."""
    for side in ti.static(range(2)):
        one, other, sign = a, b, 1.0
        if ti.static(side == 1):
            one, other, sign = b, a, -1.0
        row = watched_row(one, t, tile, region, gas)
        if row >= 0:
            gas.event[row].normal[0], gas.event[row].normal[1] = sign * rx / r, sign * ry / r
            write_motion(row, t, 3 * side, before, after, gas)
            gas.event_int[row].partner = gas.event_info[other].id
            gas.event_int[row].regime = ti.select(regime >= ELASTIC, BY_REMEDY, BY_LAW)


@ti.func
def count_collision(
    kind_a: ti.template(), regime: ti.template(), lost: ti.template(), rows: ti.template(), faster: ti.template(),
    vx_a: ti.template(), new_vx_a: ti.template(), tile: ti.template(), gas: ti.template(),
):  # fmt: skip
    """Add a collision to the tally of the tile that owns disk a, which is of kind `kind_a`."""
    add(tile, TALLY.collisions, 1.0, gas)
    if regime >= ELASTIC:
        add(tile, TALLY.elastics, 1.0, gas)
    if ti.static(gas.uses.ledger):
        enter_losses(tile, regime, lost, gas)
    if ti.static(gas.uses.shear):
        if rows != 0:
            # a got the momentum m dv, and b, in a frame that is faster, the opposite.
            gained = ti.cast((new_vx_a - vx_a) * faster, ti.f64)
            add(tile, TALLY.flow_work, gained / gas.kinds[kind_a].inverse_mass, gas)


@ti.func
def collide(i, j, t, tile, region: ti.template(), gas: ti.template()):
    """Collide the disks in slots i and j at time t, the smaller id first: the same bits from either side.

    Everything is read before the first number is written: on a GPU, a load waits for the store before it.
    """
    a = ti.select(gas.event_info[j].id < gas.event_info[i].id, j, i)
    b = i + j - a
    motion_a, motion_b, info_a, info_b = gas.motion[a], gas.motion[b], gas.event_info[a], gas.event_info[b]
    since_a, since_b = motion_a.tau, motion_b.tau
    vx_a, vy_a, w_a = motion_a.vx, motion_a.vy, motion_a.spin
    vx_b, vy_b, w_b = motion_b.vx, motion_b.vy, motion_b.spin
    x_a, y_a = position_at(a, t, gas)
    x_b, y_b = position_at(b, t, gas)
    number_a, number_b = info_a.number, info_b.number
    fastest_a, fastest_b = info_a.max_speed_sq, info_b.max_speed_sq
    owned = info_a.own_rank > 0
    writes = ti.select(owned, gas.grid.watching & PAIRS, 0)
    hash_1_a, hash_2_a = next_hash(info_a.hash_1, info_a.hash_2, t, info_b.id)
    hash_1_b, hash_2_b = next_hash(info_b.hash_1, info_b.hash_2, t, info_a.id)
    kind_a, kind_b = kind_of(a, gas), kind_of(b, gas)
    one, other = gas.kinds[kind_a], gas.kinds[kind_b]
    p, q = ti.cast(one.material, ti.i32), ti.cast(other.material, ti.i32)
    inverse_a, inverse_b = one.inverse_mass, other.inverse_mass
    radius_a, k_a, radius_b, k_b = one.radius, one.k, other.radius, other.k
    persistent = 0
    if ti.static(gas.uses.contact_time):
        persistent = ti.max(just_collided(a, t, gas), just_collided(b, t, gas))
    free_a, free_b = 0.0 * t, 0.0 * t
    if ti.static(gas.uses.free_times):
        free_a, free_b = t - gas.since[a], t - gas.since[b]
    asleep_a, asleep_b = sleeps(a, gas), sleeps(b, gas)
    if ti.static(gas.uses.rest):
        if asleep_a:
            x_a, y_a, vx_a, vy_a = in_falling_frame(x_a, y_a, t, gas)
        if asleep_b:
            x_b, y_b, vx_b, vy_b = in_falling_frame(x_b, y_b, t, gas)
    rx = x_b - x_a
    ry = y_b - y_a
    faster = 0.0 * t
    rows = 0
    if ti.static(gas.uses.shear):
        # In the frame of a's row, where b is faster.
        rows = info_b.shear_row - info_a.shear_row
        faster = rows * gas.scale.drift
        rx += rows * gas.scale.aside + faster * t
        vx_b += faster
    rx += nearest(rx, gas.scale.length_x, region.wrap_x)
    ry += nearest(ry, gas.scale.length_y, region.wrap_y)
    r = ti.sqrt(rx * rx + ry * ry)
    if ti.static(gas.uses.rest):
        slow = ((vx_a - vx_b) * rx + (vy_a - vy_b) * ry) / r < gas.scale.resting_speed
        hit_sleepers(a, b, t, since_a, since_b, asleep_a, asleep_b, slow, inverse_a, inverse_b, tile, gas)
    new, regime, lost = collided(
        p, q, rx / r, ry / r, inverse_a, radius_a, k_a, vx_a, vy_a, w_a, inverse_b, radius_b, k_b, vx_b, vy_b, w_b,
        reduced_radius(radius_a, radius_b), persistent, gas,
    )  # fmt: skip
    if ti.static(gas.uses.latest_collision):
        gas.since[a], gas.since[b] = t, t
    turn(a, t, gas)
    turn(b, t, gas)
    motion_a.x, motion_a.y, motion_a.tau = x_a, y_a, t
    motion_b.x, motion_b.y, motion_b.tau = x_b, y_b, t
    motion_a.vx, motion_a.vy, motion_a.spin = new.vx_i, new.vy_i, new.w_i
    motion_b.vx, motion_b.vy, motion_b.spin = new.vx_j - faster, new.vy_j, new.w_j
    info_a.number, info_b.number = number_a + 1, number_b + 1
    info_a.hash_1, info_a.hash_2, info_b.hash_1, info_b.hash_2 = hash_1_a, hash_2_a, hash_1_b, hash_2_b
    info_a.last, info_b.last = b, a
    if ti.static(gas.uses.rest):
        rest_after_hit(a, b, t, tile, gas)
        note_speed(a, gas)
        note_speed(b, gas)
    else:
        info_a.max_speed_sq = ti.max(fastest_a, speed_square(new.vx_i, new.vy_i))
        info_b.max_speed_sq = ti.max(fastest_b, speed_square(new.vx_j - faster, new.vy_j))
    if ti.static(gas.uses.thin):
        write_line(a, gas)
        write_line(b, gas)
    if writes > 0:
        write_pair(a, b, t, tile, gas)
    if ti.static(gas.uses.histories or gas.uses.heat_flux):
        before = ti.Vector([vx_a, vy_a, w_a, vx_b, vy_b, w_b])
        after = ti.Vector([new.vx_i, new.vy_i, new.w_i, new.vx_j, new.vy_j, new.w_j])
        if ti.static(gas.uses.histories):
            write_collision(a, b, t, rx, ry, r, before, after, regime, tile, region, gas)
        if ti.static(gas.uses.heat_flux):
            if owned:
                add_energy_of_pair(tile, kind_a, kind_b, t, before, after, rx, ry, r, gas)
    if ti.static(gas.uses.dissipated):
        charge_half(a, regime, lost, gas)
        charge_half(b, regime, lost, gas)
    if owned:
        count_collision(kind_a, regime, lost, rows, faster, vx_a, new.vx_i, tile, gas)
        if ti.static(gas.uses.histograms > 0):
            ux, uy = vx_a - vx_b, vy_a - vy_b
            g_n, g_t = ux * (rx / r) + uy * (ry / r), ti.abs(uy * (rx / r) - ux * (ry / r))
            enter_histograms(tile, info_a.id, info_b.id, g_n, g_t, free_a, free_b, regime, gas)
    if ti.static(gas.uses.stress):
        add_virial_of_pair(
            tile, a, b, kind_a, kind_b, new.vx_i - vx_a, new.vy_i - vy_a, new.vx_j - vx_b, new.vy_j - vy_b, rx, ry, gas
        )  # fmt: skip


@ti.func
def predict(
    i, x_low, x_high, y_low, y_high, half, keeps, horizon, region: ti.template(), gas: ti.template()
):  # fmt: skip
    """Find the next event of the disk in slot i in the cells of `find`, or keep the present one (`keeps`); its time.

    Collisions are found up to a `horizon`.
    """
    motion, info = gas.motion[i], gas.event_info[i]
    best, partner = horizon, NO_PARTNER
    if ti.static(gas.uses.actions):
        acts = action_time(i, gas)
        if acts <= horizon:
            best, partner = acts, OWN_ACTION
    if keeps == 1:
        if info.partner != NO_PARTNER:
            best, partner = motion.t_hit, info.partner
    before = partner
    best, partner = find(i, x_low, x_high, y_low, y_high, half, best, partner, region, gas)
    if ti.static(gas.uses.walls and not gas.uses.rest):
        best, partner = first_wall(i, best, partner, region, gas)
    elif ti.static(gas.uses.walls):
        if not sleeps(i, gas):
            best, partner = first_wall(i, best, partner, region, gas)
    if partner == NO_PARTNER:
        best = FAR + 0.0 * horizon
    elif partner >= 0 and partner != before:
        info.partner_number = gas.event_info[partner].number
    motion.t_hit = best
    info.partner = partner
    leaves, side = FAR + 0.0 * horizon, 0
    if ti.static(gas.uses.forced):
        if not stays(i, ti.min(best, horizon), region, gas):
            leaves, side = leaving(i, region, gas)
    else:
        leaves, side = leaving(i, region, gas)
    if ti.static(gas.uses.rest):
        if sleeps(i, gas):
            leaves = FAR
    motion.t_leave, info.direction = leaves, side
    return ti.select(best < leaves, best, leaves)


@ti.func
def earliest_event(turn: ti.template(), run: ti.template(), gas: ti.template()):
    """Set i to the slot of the disk whose event comes next, and t to its time; i stays EMPTY if no bin before `last`
    has one."""
    while turn.i < 0 and run.present < run.last:
        turn.i = gas.bin[run.bins + run.present]
        if turn.i < 0:
            run.present += 1
    if turn.i >= 0:
        turn.t = next_event(turn.i, gas)
        k = gas.event_info[turn.i].next
        while k >= 0:
            t_k = next_event(k, gas)
            if t_k < turn.t:
                turn.i, turn.t = k, t_k
            elif t_k == turn.t:
                if precedes(k, turn.i, gas):
                    turn.i, turn.t = k, t_k
            k = gas.event_info[k].next


@ti.func
def check_moment(turn: ti.template(), run: ti.template(), gas: ti.template()):
    """Set `writing` to the time of the tally that is due before the event of the disk in slot i at t, if one is."""
    if run.moment < FAR and (turn.i < 0 or turn.t > run.moment):
        turn.writing = AT_MOMENT + run.written
        run.written += 1
        run.moment = gas.scale.moment[run.written]
        if run.pausing == 1:
            gas.counter.paused = run.pauses
            run.active = 0
    elif turn.i < 0:
        turn.writing, run.active = AT_END, 0


@ti.func
def write_here(turn: ti.template(), run: ti.template(), region: ti.template(), gas: ti.template()):
    """Write the own disks of a tile, by one thread; at the end of a window on a CPU only."""
    if ti.static(on_gpu()):
        if turn.writing != AT_END:
            write(run.n, run.tile, turn.writing, 0, 1, region, gas)
    else:
        share = write(run.n, run.tile, turn.writing, 0, 1, region, gas)
        if turn.writing == AT_END:
            note_extremes(run.tile, share, gas)


@ti.func
def cross_side(turn: ti.template(), region: ti.template(), gas: ti.template()):
    """Move the disk in slot i into the next cell, and have it look at the cells that become adjacent."""
    side = gas.event_info[turn.i].direction
    leave(turn.i, side, region, gas)
    step_x, step_y = step_over(side)
    turn.keeps = 1
    if side <= 2:
        turn.x_low, turn.x_high = step_x, step_x
    else:
        turn.y_low, turn.y_high = step_y, step_y


@ti.func
def pause_after(turn: ti.template(), run: ti.template(), gas: ti.template()):
    """Pause at t if the collision there was the last one requested."""
    if run.pausing == 1 and run.pauses == 1:
        if gas.sums.collisions + gas.tally[run.tile, AT_END].collisions >= gas.clock.wanted:
            run.moment, run.written, run.pauses = turn.t, 0, BY_COUNT
            gas.scale.moment[0] = turn.t


@ti.func
def meet_wall(
    turn: ti.template(), run: ti.template(), partner: ti.template(), region: ti.template(),
    gas: ti.template(),
):  # fmt: skip
    """Collide the disk in slot i with its wall. After one with a piston all disks look for theirs again."""
    since = gas.motion[turn.i].tau
    if ti.static(gas.uses.pistons):
        if meets_piston(turn.i, gas) == 1:
            turn.n_searching, turn.all_search = run.n, 1
    regime = hit_wall(turn.i, turn.t, run.tile, region, gas)
    if ti.static(gas.uses.rest):
        if regime >= ELASTIC and is_support(wall_of(from_partner(partner)), gas):
            count_hit(turn.i, turn.t, since, gas)
            fall_asleep(turn.i, turn.t, run.tile, gas)


@ti.func
def check_progress(turn: ti.template(), run: ti.template(), region: ti.template(), gas: ti.template()):
    """End the events if time has not advanced for so many that they have no end.

    It may advance, and come to no end all the same. So a gas in one tile pauses after a long launch (BY_WORK), where
    the host looks how far it has come and takes note of Ctrl-C, and goes on. It pauses only where time has advanced
    since the last look, so that pauses do not hide that it stands still. A tile of many cannot pause: it skips the
    rest of its events, and is marked, so that one thread runs the whole box, with pauses.
    """
    advances = turn.t - run.advanced_at >= 1e-9 * run.window
    if advances:
        run.advanced, run.advanced_at = run.events, turn.t
    stuck = run.events - run.advanced > MANY_EVENTS + 20 * run.n
    alone = gas.grid.single_tile == 1
    most = LONG // 5 + LONG_OF_A_DISK * run.n
    if ti.static(on_gpu()):  # where nothing pauses, and a thread is slower
        stuck = stuck or (
            alone and run.events > most and turn.t * most < LEAST_ADVANCE * run.window * run.events
        )
    if stuck:
        stalled = 1
        for m in range(run.offset, run.offset + run.n):
            if not (largest_speed(m, gas) * run.window <= TOO_FAR * (region.nx * region.side_x)):
                stalled = 2  # also of a speed that is no number
        ti.atomic_max(gas.counter.stalled, stalled)
        run.active = 0
    elif alone and advances and 2 * run.events > MOST_EVENTS_OF_A_LAUNCH and run.pauses == 1:
        if ti.static(not on_gpu()):
            gas.counter.paused, gas.counter.written, gas.clock.reached = (
                BY_WORK,
                run.written,
                ti.cast(turn.t, ti.f64),
            )
            run.active = 0
    elif not alone and (run.events > most or gas.counter.stuck > 0):
        gas.tile[run.tile].mark = TOO_LONG
        ti.atomic_add(gas.counter.stuck, 1)  # other tiles need not go on
        run.last, run.acts = 0, FAR + 0.0 * run.window
    run.next_look = run.events + EVENTS_OF_A_LOOK


@ti.func
def look_for_pistons(turn: ti.template(), run: ti.template(), q: ti.template(), gas: ti.template()):
    """After an event of a piston, have disk number q look at walls, and at disks too if it is to meet a piston."""
    if turn.all_search == 1:
        turn.i = run.offset + q
        remove_event(turn.i, run.bins, gas)
        turn.x_low, turn.x_high, turn.keeps = 1, 0, 1  # at no disk, but at walls
        if meets_piston(turn.i, gas) == 1:
            turn.x_low, turn.x_high, turn.keeps = -1, 1, 0


@ti.func
def begin_queue(run: ti.template(), gas: ti.template()):
    """Empty the bins, unless a window is resumed. On a GPU a team has predicted first events: put them into bins."""
    if run.resuming == 0:
        run.fresh = 0
        for b in range(run.n_bins):
            gas.bin[run.bins + b] = EMPTY
    if ti.static(on_gpu()):
        run.fresh = run.n
        for i in range(run.offset, run.offset + run.n):
            t = next_event(i, gas)
            if ti.static(gas.uses.forced):
                if t <= first_horizon(gas):
                    insert_event(i, t, 0, run.bins, run.n_bins, run.rate, gas)
            else:
                insert_event(i, t, 0, run.bins, run.n_bins, run.rate, gas)


@ti.func
def first_force(run: ti.template(), gas: ti.template()):
    """Set `row` to that of `kicks` which acts first in a window, or in the rest of it."""
    run.row = ti.cast(gas.clock.acted, ti.i32)
    if run.resuming == 1:
        run.row = ti.cast(gas.clock.next_kick, ti.i32)


@ti.func
def expect_forces(run: ti.template(), gas: ti.template()):
    """Set when forces act next, by row `row` of `kicks`: nothing is predicted beyond that `horizon`, or binned."""
    run.acts = kick_time(run.row, gas)
    run.horizon = ti.min(run.acts, run.window)
    run.last = ti.min(ti.cast(run.horizon * run.rate, ti.i32) + 1, run.n_bins)


@ti.func
def apply_forces(turn: ti.template(), run: ti.template(), region: ti.template(), gas: ti.template()):
    """Have forces act on all disks if that comes before the event of disk i at t: then all look around again."""
    if run.acts <= run.window and (turn.i < 0 or turn.t > run.acts) and run.acts <= run.moment:
        turn.kicked = 1
        end = run.row + 1
        while kick_time(end, gas) == run.acts:
            end += 1
        act_on_all(run.n, run.row, end, run.acts, 0, 1, run.tile, region, gas)
        if ti.static(gas.uses.thin):
            for i in range(run.offset, run.offset + run.n):
                write_line(i, gas)
        if run.acts < run.window:
            run.present, run.fresh = ti.min(ti.cast(run.acts * run.rate, ti.i32), run.n_bins - 1), 0
        run.row = end
        expect_forces(run, gas)


@ti.func
def earliest_stop(turn: ti.template(), run: ti.template(), gas: ti.template()):
    """Set `stopped` to the piston that meets a stop before t, and t to that time; -1 if none does."""
    turn.stop, turn.stopped = next_stop(gas)
    if turn.stop < turn.t:
        turn.i, turn.t = run.offset, turn.stop
    else:
        turn.stopped = -1


@ti.func
def run_event(turn: ti.template(), run: ti.template(), region: ti.template(), gas: ti.template()):
    """The event of the disk in slot i at time t: it crosses into the next cell, or collides with a disk or a wall."""
    remove_event(turn.i, run.bins, gas)
    partner = gas.event_info[turn.i].partner
    if gas.motion[turn.i].t_leave < gas.motion[turn.i].t_hit:
        cross_side(turn, region, gas)
    elif partner >= 0:
        if gas.event_info[partner].number == gas.event_info[turn.i].partner_number:
            note_event(turn, run, partner, gas)
            remove_event(partner, run.bins, gas)
            collide(turn.i, partner, turn.t, run.tile, region, gas)
            turn.second, turn.n_searching = partner, 2
            pause_after(turn, run, gas)
    else:
        note_event(turn, run, partner, gas)
        is_action = False
        if ti.static(gas.uses.actions):
            is_action = partner == OWN_ACTION
            if is_action:
                act_alone(turn.i, turn.t, run.tile, region, gas)
        if ti.static(gas.uses.walls):
            if not is_action:
                meet_wall(turn, run, partner, region, gas)
        if ti.static(gas.uses.thin):
            write_line(turn.i, gas)


@ti.func
def begin_run(n, n_bins, tile, resuming, region: ti.template(), gas: ti.template()):
    """Variables of the events of a window in a region of n disks, which functions of single events read and change."""
    window = gas.scale.window
    first_look = EVENTS_OF_A_LOOK
    if gas.grid.single_tile == 0 and gas.counter.stuck > 0:
        first_look = 0
    return ti.Struct(
        n=n, n_bins=n_bins, tile=tile, resuming=resuming,
        # first slot, and first bin, of the lane; bins in a unit of time
        offset=region.lane * gas.grid.lane_slots, bins=region.lane * gas.grid.bins, rate=n_bins / window,
        window=window,
        present=0,  # the bin that is emptied
        fresh=n,  # disks that have looked around themselves since the last flights of all began
        active=1,
        # the next one to be written, and how many are: some where a gas in one tile goes on after a long launch
        moment=gas.scale.moment[gas.counter.written], written=gas.counter.written,
        pausing=gas.counter.pausing, pauses=1,  # 1, or BY_COUNT
        # the next row of `kicks`, when it acts, until when anything is predicted, and the bin behind that time
        row=0, acts=FAR + 0.0 * window, horizon=window, last=n_bins,
        # `check_progress`; a tile that begins after another one was marked looks at once
        events=0, advanced=0, advanced_at=-1.0 - window, next_look=first_look,
    )  # fmt: skip


@ti.func
def begin_turn(run: ti.template()):
    """Variables of a turn in a run: of one event, or of a look of a disk around itself."""
    return ti.Struct(
        i=EMPTY, t=run.window,  # the disk whose event comes, and when
        n_searching=0, first=0, second=0, half=0, keeps=0, x_low=-1, x_high=1, y_low=-1, y_high=1,  # `predict`
        all_search=0, stop=run.window, stopped=-1,  # for a piston, after an event of it
        writing=-1, kicked=0,
    )  # fmt: skip


@ti.func
def run_events(n, n_bins, tile, resuming, region: ti.template(), gas: ti.template()):
    """All events of a window in a region of n disks in the slots of its lane, which are prepared.

    Own disks are written at requested moments, and, on a CPU, at the end; on a GPU a team does this, which has
    predicted their first events too. A gas in one tile may pause at a moment, or after the last of so many collisions,
    and continues when `resuming`.

    `run` and `turn` are records: the functions above read and change them, and nothing else of this function.
    """
    run = begin_run(n, n_bins, tile, resuming, region, gas)
    begin_queue(run, gas)
    if ti.static(gas.uses.forced):
        first_force(run, gas)
        expect_forces(run, gas)
    while run.active == 1:
        # At most two disks look around themselves in a turn; one place in the code where they do keeps it small.
        turn = begin_turn(run)
        if run.fresh < run.n:
            turn.first, turn.n_searching, turn.half, turn.x_low = run.offset + run.fresh, 1, 1, 0
            run.fresh += 1
        else:
            earliest_event(turn, run, gas)
            if ti.static(gas.uses.low_memory):
                if turn.t > gas.scale.stored_at:
                    turn.i = EMPTY
            if ti.static(gas.uses.pistons):
                earliest_stop(turn, run, gas)
            if ti.static(gas.uses.forced):
                apply_forces(turn, run, region, gas)
            if turn.kicked == 0:
                check_moment(turn, run, gas)
            if turn.kicked == 1:
                pass
            elif turn.writing >= 0:
                write_here(turn, run, region, gas)
            elif turn.stopped >= 0:
                run.events += 1
                if ti.static(gas.uses.pistons):
                    bounce(turn.stopped, turn.t, gas)
                turn.n_searching, turn.all_search = run.n, 1
                # For disks that meet it later in this window.
                run.present = ti.min(run.present, run.n_bins - 1)
            else:
                run.events += 1
                turn.first, turn.n_searching = turn.i, 1
                run_event(turn, run, region, gas)
                if run.events > run.next_look:
                    check_progress(turn, run, region, gas)
        for q in range(turn.n_searching):
            turn.i = turn.first
            if q == 1:
                turn.i = turn.second
            if ti.static(gas.uses.pistons):
                look_for_pistons(turn, run, q, gas)
            turn.t = predict(
                turn.i, turn.x_low, turn.x_high, turn.y_low, turn.y_high, turn.half, turn.keeps, run.horizon, region,
                gas,
            )  # fmt: skip
            if ti.static(gas.uses.forced):
                if turn.t <= run.horizon:
                    insert_event(turn.i, turn.t, run.present, run.bins, run.n_bins, run.rate, gas)
            else:
                insert_event(turn.i, turn.t, run.present, run.bins, run.n_bins, run.rate, gas)
    if ti.static(gas.uses.forced):
        if gas.grid.single_tile == 1:
            gas.clock.next_kick = ti.cast(run.row, ti.f64)
    ti.atomic_add(gas.counter.n_events, run.events)


@ti.func
def repeat_events(n, tile, region: ti.template(), gas: ti.template()):
    """Repeat the events of a window up to the last requested moment, as the trail of a tile has them, and write moments.

    The n disks are prepared as for `run_events`, in the same slots. Events come in the same order, forces and moments
    between them, and by the same functions: so bits are the same. None is searched for.
    """
    run = begin_run(n, 1, tile, 0, region, gas)
    if ti.static(gas.uses.forced):
        first_force(run, gas)
        expect_forces(run, gas)
    row = gas.tile[tile].first_row
    while run.moment < FAR:
        turn = begin_turn(run)
        if row >= 0:
            turn.i, turn.t = run.offset + (gas.trail[row].one & SLOT), gas.trail_time[row]
        if ti.static(gas.uses.forced):
            apply_forces(turn, run, region, gas)
        if turn.kicked == 0:
            check_moment(turn, run, gas)
            if turn.writing >= 0:
                write_here(turn, run, region, gas)
            else:
                expect_event(turn, run, gas.trail[row].other, gas)
                run_event(turn, run, region, gas)
                row = gas.trail[row].next


@ti.func
def expect_event(turn: ti.template(), run: ti.template(), other, gas: ti.template()):
    """Set the next event of the disk in slot i as if it had been predicted: at t, with `other` of a trail."""
    partner = other
    if other >= 0:
        partner += run.offset
        gas.event_info[turn.i].partner_number = gas.event_info[partner].number
    gas.event_info[turn.i].partner = partner
    gas.motion[turn.i].t_hit, gas.motion[turn.i].t_leave = turn.t, FAR
