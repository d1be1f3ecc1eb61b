"""A disk in the scratch space of a tile: what it is, how it comes to a collision, and the hash of its history."""

from .flights import on_grid
from .language import ti
from .layout import (
    AT_END, CONTACT_TIME, HASH_1, HASH_2, KIND, KIND_RADIUS, NUMBER, TAU, TOP, VX, VY, W_SPIN, X, Y,
)  # fmt: skip


@ti.func
def kind_of(i, gas: ti.template()):
    """Row of `kinds` of the disk at place i; without a look at it where there is but one."""
    kind = 0
    if ti.static(gas.uses.mixed):
        kind = gas.link[i][KIND]
    return kind


@ti.func
def radius_of(i, gas: ti.template()):
    """Radius of the disk at place i."""
    return gas.kinds[kind_of(i, gas)][KIND_RADIUS]


@ti.func
def remember(i, t, whom, gas: ti.template()):
    """Enter a collision at time t into the hash of the history of the disk at place i: `whom` is an id, or a wall.

    Two hashes of 32 bits, by multiplication with odd constants.
    """
    low, high = ti.u32(0), ti.u32(0)
    if ti.static(ti.lang.impl.get_runtime().default_fp == ti.f32):
        low = ti.bit_cast(t, ti.u32)
    else:
        word = ti.bit_cast(t, ti.u64)
        low, high = ti.cast(word, ti.u32), ti.cast(word >> ti.u64(32), ti.u32)
    partner = ti.cast(whom, ti.u32)
    one, two = ti.cast(gas.link[i][HASH_1], ti.u32), ti.cast(gas.link[i][HASH_2], ti.u32)
    one = (one ^ low) * ti.u32(0x9E3779B1) + high
    one = (one ^ (one >> ti.u32(15)) ^ partner) * ti.u32(0x85EBCA77)
    two = (two ^ high) * ti.u32(0xC2B2AE3D) + partner
    two = (two ^ (two >> ti.u32(13)) ^ low) * ti.u32(0x27D4EB2F)
    gas.link[i][HASH_1] = ti.cast(one ^ (one >> ti.u32(16)), ti.i32)
    gas.link[i][HASH_2] = ti.cast(two ^ (two >> ti.u32(16)), ti.i32)


@ti.func
def largest_speed(i, gas: ti.template()):
    """Bound on the speed of the disk at place i in the window so far."""
    return ti.sqrt(ti.cast(ti.bit_cast(gas.link[i][TOP], ti.f32), float))


@ti.func
def note_speed(i, gas: ti.template()):
    """Keep the largest square of the speed of the disk at place i, rounded up to single precision."""
    vx, vy = gas.work[i][VX], gas.work[i][VY]
    square = ti.cast(1.000001 * (vx * vx + vy * vy), ti.f32)
    gas.link[i][TOP] = ti.bit_cast(ti.max(square, ti.bit_cast(gas.link[i][TOP], ti.f32)), ti.i32)


@ti.func
def just_collided(i, t, gas: ti.template()):
    """1 if the latest collision of the disk at place i was less than the contact time before t, else 0."""
    return ti.cast(t - gas.since[i] < gas.scale[CONTACT_TIME], ti.i32)


@ti.func
def came_to(i, t, gas: ti.template()):
    """Fly the disk at place i to its collision at time t."""
    dt = t - gas.work[i][TAU]
    gas.work[i][X] = gas.work[i][X] + on_grid(gas.work[i][VX] * dt, gas)
    gas.work[i][Y] = gas.work[i][Y] + on_grid(gas.work[i][VY] * dt, gas)
    if ti.static(gas.uses.turned):
        gas.turn[i] = gas.turn[i] + ti.cast(gas.work[i][W_SPIN], ti.f64) * ti.cast(dt, ti.f64)
    gas.work[i][TAU] = t
    gas.link[i][NUMBER] = gas.link[i][NUMBER] + 1


@ti.func
def add(tile, column, value, gas: ti.template()):
    """Add to the tally of a tile."""
    gas.tally[tile, AT_END, column] = gas.tally[tile, AT_END, column] + value
