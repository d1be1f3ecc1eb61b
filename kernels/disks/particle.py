"""A disk in the scratch space of a tile: its properties, its flight to a collision, and the hash of its history."""

from .flights import on_grid
from ..compiler.language import is_single_precision, on_gpu, round_products_by, ti
from ..layout import AT_END, FIRST_WALL, FULL_WATCHED, NO_PARTNER, TRACKED, VOID_DISK, VOID_WALL


@ti.func
def round_products(gas: ti.template()):
    """Round products by themselves in the loop that begins with this, on a GPU (`compiler/compiler_fixes.py`)."""
    if ti.static(on_gpu()):
        zero = ti.cast(
            ti.cast(gas.grid.opaque_zero, ti.u32), ti.u64
        )  # no more than the lower half of a double
        ti.static(round_products_by(zero))


@ti.func
def listed_kind(s, gas: ti.template()):
    """Kind of the disk at a slot. On several ranks it goes with the disk."""
    kind = 0
    if ti.static(gas.uses.several_kinds and gas.uses.ranks):
        kind = gas.kind[s]
    elif ti.static(gas.uses.several_kinds):
        kind = gas.kind[gas.meta[s].id]
    return kind


@ti.func
def kind_of(i, gas: ti.template()):
    """Row of `kinds` of the disk in slot i; 0, without reading it, if there is only one."""
    kind = 0
    if ti.static(gas.uses.several_kinds):
        kind = gas.event_info[i].kind
    return kind


@ti.func
def radius_of(i, gas: ti.template()):
    """Radius of the disk in slot i."""
    return gas.kinds[kind_of(i, gas)].radius


@ti.func
def update_history_hash(i, t, partner, gas: ti.template()):
    """Enter a collision at time t into the hash of the history of the disk in slot i: `partner` is an id, or a wall.

    Two hashes of 32 bits, by multiplication with odd constants.
    """
    info = gas.event_info[i]
    info.hash_1, info.hash_2 = next_hash(info.hash_1, info.hash_2, t, partner)


@ti.func
def next_hash(hash_1, hash_2, t, partner):
    """Both words of the hash of a history after a collision at time t, from those before it."""
    low, high = ti.u32(0), ti.u32(0)
    if ti.static(is_single_precision()):
        low = ti.bit_cast(t, ti.u32)
    else:
        word = ti.bit_cast(t, ti.u64)
        low, high = ti.cast(word, ti.u32), ti.cast(word >> ti.u64(32), ti.u32)
    code = ti.cast(partner, ti.u32)
    one, two = ti.cast(hash_1, ti.u32), ti.cast(hash_2, ti.u32)
    one = (one ^ low) * ti.u32(0x9E3779B1) + high
    one = (one ^ (one >> ti.u32(15)) ^ code) * ti.u32(0x85EBCA77)
    two = (two ^ high) * ti.u32(0xC2B2AE3D) + code
    two = (two ^ (two >> ti.u32(13))) * ti.u32(0x27D4EB2F)
    two = (two ^ low) * ti.u32(0x165667B1)
    return ti.cast(one ^ (one >> ti.u32(16)), ti.i32), ti.cast(two ^ (two >> ti.u32(16)), ti.i32)


@ti.func
def largest_speed(i, gas: ti.template()):
    """Bound on the speed of the disk in slot i in the window so far."""
    return ti.cast(ti.sqrt(largest_square(i, gas)), float)


@ti.func
def largest_square(i, gas: ti.template()):
    """Bound on the square of the speed of the disk in slot i in the window so far."""
    return square_of(gas.event_info[i].max_speed_sq)


@ti.func
def square_of(upper):
    """The square (f64) of which `upper_half` gave this."""
    return ti.bit_cast(ti.cast(upper, ti.i64) << ti.i64(32), ti.f64)


@ti.func
def upper_half(square):
    """Upper half of the bits of a square (f64, 0 or more), rounded up: integers in the order of the squares."""
    return ti.cast(ti.bit_cast(square, ti.i64) >> ti.i64(32), ti.i32) + 1


@ti.func
def note_speed(i, gas: ti.template()):
    """Keep the largest square of the speed of the disk in slot i: the upper half of a double, rounded up."""
    square = speed_square(gas.motion[i].vx, gas.motion[i].vy)
    gas.event_info[i].max_speed_sq = ti.max(gas.event_info[i].max_speed_sq, square)


@ti.func
def speed_square(vx, vy):
    """Upper bound on the square of a speed: the upper half of a double, rounded up."""
    vx_, vy_ = ti.cast(vx, ti.f64), ti.cast(vy, ti.f64)
    return upper_half(1.000001 * (vx_ * vx_ + vy_ * vy_))


@ti.func
def just_collided(i, t, gas: ti.template()):
    """1 if the latest collision of the disk in slot i was less than the contact time before t, else 0."""
    return ti.cast(t - gas.since[i] < gas.scale.contact_time, ti.i32)


@ti.func
def void_latest_partner(i, gas: ti.template()):
    """Note that the disk in slot i may meet its latest partner at once: a force has acted."""
    info = gas.event_info[i]
    if ti.static(gas.uses.last_partner):  # who it was is still asked for
        if info.last >= 0:
            info.last = VOID_DISK - info.last
        elif info.last <= FIRST_WALL and info.last > VOID_WALL:
            info.last = info.last + VOID_WALL
    else:
        info.last = NO_PARTNER


@ti.func
def latest_partner(i, gas: ti.template()):
    """Latest partner of the disk in slot i in the window: a slot, a wall (FIRST_WALL - w), or none."""
    last = gas.event_info[i].last
    if ti.static(gas.uses.forced):
        if last <= VOID_DISK:
            last = VOID_DISK - last
        elif last < VOID_WALL:
            last -= VOID_WALL
    return last


@ti.func
def fly_to(i, t, gas: ti.template()):
    """Fly the disk in slot i to time t, where its motion changes."""
    motion = gas.motion[i]
    turn(i, t, gas)
    x, y = position_at(i, t, gas)
    motion.x, motion.y, motion.tau = x, y, t


@ti.func
def position_at(i, t, gas: ti.template()):
    """Position of the disk in slot i at time t, where its motion changes, rounded to the grid."""
    motion = gas.motion[i]
    dt = t - motion.tau
    return motion.x + on_grid(motion.vx * dt, gas), motion.y + on_grid(motion.vy * dt, gas)


@ti.func
def turn(i, t, gas: ti.template()):
    """Turn the disk in slot i until time t, if angles are recorded."""
    if ti.static(gas.uses.angle):
        motion = gas.motion[i]
        dt = t - motion.tau
        gas.turn[i] = gas.turn[i] + ti.cast(motion.spin, ti.f64) * ti.cast(dt, ti.f64)


@ti.func
def advance_to(i, t, gas: ti.template()):
    """Fly the disk in slot i to its collision at time t."""
    fly_to(i, t, gas)
    gas.event_info[i].number = gas.event_info[i].number + 1


@ti.func
def collisions_in_window(i, gas: ti.template()):
    """Collisions of the disk in slot i so far in the window, without actions of forces on it."""
    found = gas.event_info[i].number
    if ti.static(gas.uses.actions):
        found -= ti.cast(gas.action[i].count, ti.i32)
    return found


@ti.func
def add(tile, column, value, gas: ti.template()):
    """Add to the tally of a tile. On a GPU several threads may do that at a time (`windows/blocks.py`)."""
    if ti.static(on_gpu()):
        ti.atomic_add(gas.tally[tile, AT_END][column], value)
    else:
        gas.tally[tile, AT_END][column] = gas.tally[tile, AT_END][column] + value


@ti.func
def charge(i, column, energy, gas: ti.template()):
    """Add energy that a collision dissipated to the loss of the disk in slot i."""
    gas.loss[i][column] = gas.loss[i][column] + energy


@ti.func
def watched_row(i, t, tile, region: ti.template(), gas: ti.template()):
    """Begin a row of `event` for a collision of the disk in slot i at time t; -1 if it is not tracked, or no room."""
    info, image = gas.event_info[i], gas.image_info[i]
    row = -1
    if (gas.grid.watching & TRACKED) > 0 and info.own_rank > 0:
        if gas.watched[info.id] > 0:
            row = ti.atomic_add(gas.counter.n_watched, 1)
            if row >= gas.grid.most_events:
                ti.atomic_or(gas.counter.full, FULL_WATCHED)
                row = -1
            else:
                gas.event[row].time = t
                gas.event[row].position[0] = region.corner_x + gas.motion[i].x + 0.5 * gas.scale.gx * t * t
                gas.event[row].position[1] = region.corner_y + gas.motion[i].y + 0.5 * gas.scale.gy * t * t
                gas.event_int[row].tile = tile
                gas.event_int[row].id = info.id
                s = gas.grid.part * gas.grid.room + image.slot
                gas.event_int[row].image[0] = gas.meta[s].image_x + image.lap_x
                gas.event_int[row].image[1] = gas.meta[s].image_y + image.lap_y
                gas.event_int[row].number = collisions_in_window(i, gas)
    return row


@ti.func
def write_motion(row, t, first: ti.template(), before, after, gas: ti.template()):
    """Write velocities and spins (vx, vy, spin of both partners) before and after, the disk's from `first` on."""
    event = gas.event[row]
    fall_x, fall_y = gas.scale.gx * t, gas.scale.gy * t
    other = ti.static(3 - first)
    event.velocity_before[0] = before[first] + fall_x
    event.velocity_before[1] = before[first + 1] + fall_y
    event.velocity_after[0], event.velocity_after[1] = (
        after[first] + fall_x,
        after[first + 1] + fall_y,
    )
    event.spin_before, event.spin_after = before[first + 2], after[first + 2]
    event.partner_velocity_before[0] = before[other] + fall_x
    event.partner_velocity_before[1] = before[other + 1] + fall_y
    event.partner_velocity_after[0], event.partner_velocity_after[1] = (
        after[other] + fall_x,
        after[other + 1] + fall_y,
    )
    event.partner_spin_before, event.partner_spin_after = (
        before[other + 2],
        after[other + 2],
    )
