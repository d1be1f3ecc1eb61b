"""Disks by id, and sums over all of them, at the beginning or end of a window or at a moment in it asked for.

And how the host gets small arrays, and rows of others, from a GPU and back.
"""

from .language import Cube, Rows, Table, has_numbers, spread_of_loops, ti, width
from .layout import (
    ALL_EVENTS, ANGLE, ASLEEP, AT_MOMENT, COUNT, DRIFT, EVENTS, EXCESS, FALL, GX, GY, ID, IMAGE_X, IMAGE_Y,
    KIND_INERTIA, KIND_MASS, LAST_PARTNER, LATEST, MECHANISMS, MOMENTS, MOMENTUM_X, MOMENTUM_Y, MOMENT_IN, NOTED,
    OWNED, PART, PERIODIC_X, PERIODIC_Y, ROOM, ROTATIONAL, SAID_ASLEEP, SHEAR_PRESSURE, SLEEPING, SPIN, START, TILES_X,
    TILES_Y, TOLD, TOTALS, TRANSLATIONAL, VX, VY, WALL_HITS, X, Y, gas_of,
)  # fmt: skip
from .places import listed_kind, round_products
from .shear import flow_at, frame_speed
from .tiles import fly


@ti.func
def count_in(s, x, y, flow, total: ti.template(), gas: ti.template()):
    """Add a disk at a place in the box to the sums; nothing for a disk of infinite mass. In double precision.

    Kinetic energies, momentum, m v_x v_y, mass times the way along gravity, collisions with disks and walls. Velocities
    are those beyond the flow; the last sum is how much more kinetic energy the frames of rows of tiles see.
    """
    kind = listed_kind(s, gas)
    mass = ti.cast(gas.kinds[kind][KIND_MASS], ti.f64)
    vx, vy = ti.cast(gas.disk[s][VX], ti.f64), ti.cast(gas.disk[s][VY], ti.f64)
    spin = ti.cast(gas.disk[s][SPIN], ti.f64)
    total[ALL_EVENTS] += gas.meta[s][EVENTS]
    if ti.static(gas.uses.sheared):
        total[EXCESS] += flow * (vx - 0.5 * flow) * mass
        vx -= flow
    total[MOMENTUM_X] += mass * vx
    total[MOMENTUM_Y] += mass * vy
    total[TRANSLATIONAL] += 0.5 * mass * (vx * vx + vy * vy)
    total[ROTATIONAL] += 0.5 * ti.cast(gas.kinds[kind][KIND_INERTIA], ti.f64) * spin * spin
    total[SHEAR_PRESSURE] += mass * vx * vy
    total[FALL] += (x * gas.scale[GX] + y * gas.scale[GY]) * mass


@ti.func
def placed(s, tile, time, gas: ti.template()):
    """Place in the box of a listed disk, boxes that it is away from there, velocities of its frame and the flow."""
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    x = gas.edge_x[tx] + ti.cast(gas.disk[s][X], ti.f64)
    y = gas.edge_y[ty] + ti.cast(gas.disk[s][Y], ti.f64)
    boxes_x, boxes_y = 0, 0
    frame, flow = 0.0 * x, 0.0 * x
    if ti.static(gas.uses.sheared):
        frame = frame_speed(ty, gas)
        flow = flow_at(gas.disk[s][Y], gas)
        x += frame * time
    if gas.grid[PERIODIC_Y] == 1:
        length = gas.edge_y[gas.grid[TILES_Y]]
        if y < 0.0 or y >= length:
            boxes_y = ti.floor(y / length, ti.i32)
            y -= boxes_y * length
            if ti.static(gas.uses.sheared):
                # The image in the box is in a row whose frame is slower by so many rows.
                slower = boxes_y * gas.grid[TILES_Y] * ti.cast(gas.scale[DRIFT], ti.f64)
                x -= slower * time
                frame -= slower
    if gas.grid[PERIODIC_X] == 1:
        length = gas.edge_x[gas.grid[TILES_X]]
        if x < 0.0 or x >= length:
            boxes_x = ti.floor(x / length, ti.i32)
            x -= boxes_x * length
    return x, y, boxes_x, boxes_y, frame, flow


@ti.kernel
def read_out(
    part: ti.i32, time: ti.f64, filled: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, disk: Rows,
    meta: Rows, past: Rows, hits: Rows, spent: Rows, slept: Rows, kind: Rows, kinds: Rows, tile: Table, edge_x: Rows,
    edge_y: Rows, real_out: Table, int_out: Table, past_out: Table, hits_out: Table, spent_out: Table, totals: Table,
):  # fmt: skip
    """Write disks by id (of one rank of several, by slot), unless `filled` is 0, and the sums of each tile.

    `real_out` (n, 5): x, y, vx, vy, spin; `int_out` (n, 3): collisions with disks and walls, boxes travelled;
    `past_out` (n, 2): time since the window's beginning of the latest collision, angle; `hits_out` (n, 3): collisions
    with walls, latest partner, 1 for disks asleep; `spent_out` (n, MECHANISMS): energy that collisions took; `totals`
    (tiles, TOTALS).
    """
    gas = ti.static(gas_of(
        grid=grid, scale=scale, clock=clock, disk=disk, meta=meta, past=past, hits=hits, spent=spent, slept=slept,
        kind=kind, kinds=kinds, tile=tile, edge_x=edge_x, edge_y=edge_y, uses=uses,
    ))  # fmt: skip
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        round_products(gas)
        if item % spread == 0:
            k = item // spread
            lists = part
            if part >= TOLD:
                lists = 1 - gas.grid[PART]  # the lists at a moment are those at the end
            first = part * gas.grid[ROOM] + gas.tile[k, START + lists]
            total = ti.Vector([0.0] * TOTALS, ti.f64)
            last = first + gas.tile[k, COUNT + lists]
            if ti.static(gas.uses.shared):
                if gas.tile[k, OWNED] == 0:
                    last = first
            for s in range(first, last):
                x, y, boxes_x, boxes_y, frame, flow = placed(s, k, time, gas)
                count_in(s, x, y, flow, total, gas)
                if filled == 1:
                    i = gas.meta[s][ID]
                    if ti.static(gas.uses.shared):
                        i = s - part * gas.grid[ROOM]
                    vx = ti.cast(gas.disk[s][VX], ti.f64) + frame
                    row = ti.Vector([x, y, vx, gas.disk[s][VY], gas.disk[s][SPIN]], ti.f64)
                    for column in ti.static(range(5)):
                        if ti.static(has_numbers(real_out, ti.f32)):
                            real_out[i, column] = ti.cast(row[column], ti.f32)
                        else:
                            real_out[i, column] = row[column]
                    int_out[i, 0] = gas.meta[s][EVENTS]
                    int_out[i, 1] = gas.meta[s][IMAGE_X] + boxes_x
                    int_out[i, 2] = gas.meta[s][IMAGE_Y] + boxes_y
                    if ti.static(gas.uses.remembers or gas.uses.turned):
                        past_out[i, LATEST], past_out[i, ANGLE] = gas.past[s][LATEST], gas.past[s][ANGLE]
                    if ti.static(gas.uses.itemised):
                        for column in ti.static(range(MECHANISMS)):
                            spent_out[i, column] = gas.spent[s][column]
                    if ti.static(gas.uses.walled or gas.uses.partnered):
                        hits_out[i, WALL_HITS] = gas.hits[s][WALL_HITS]
                        hits_out[i, LAST_PARTNER] = gas.hits[s][LAST_PARTNER]
                    if ti.static(gas.uses.rests):
                        hits_out[i, SLEEPING] = ti.cast(
                            gas.slept[s] == ASLEEP or gas.slept[s] == SAID_ASLEEP, ti.i32
                        )
            for c in ti.static(range(TOTALS)):
                totals[k, c] = total[c]


@ti.kernel
def settle(
    m: ti.i32, time: ti.f64, n_notes: ti.i32, n_slots: ti.i32, uses: ti.template(), grid: Rows, scale: Rows,
    tile: Table, disk: Rows, meta: Rows, past: Rows, hits: Rows, spent: Rows, told_at: Rows, note: Table, note_at: Rows,
    note_tally: Table, tally: Cube,
):  # fmt: skip
    """Bring moment m of a window, the time of which was not known, to a time since the window's beginning.

    Latest notes first, then flights. Notes of a disk stand in the order of time, for one tile took them.
    """
    gas = ti.static(gas_of(
        grid=grid, scale=scale, tile=tile, disk=disk, meta=meta, past=past, hits=hits, spent=spent, told_at=told_at,
        note=note, note_at=note_at, note_tally=note_tally, tally=tally, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        first = gas.scale[MOMENT_IN + 2 * m]
        for n in range(n_notes):
            at, k = gas.note_at[n], gas.note[n, 1]
            if at > first and at <= time and n >= gas.tile[k, NOTED]:
                slot = m * gas.grid[ROOM] + gas.note[n, 0]
                row, noted = TOLD * gas.grid[ROOM] + slot, (TOLD + gas.grid[MOMENTS]) * gas.grid[ROOM] + n
                gas.told_at[slot] = ti.cast(at, float)
                gas.disk[row], gas.meta[row] = gas.disk[noted], gas.meta[noted]
                if ti.static(gas.uses.remembers or gas.uses.turned):
                    gas.past[row] = gas.past[noted]
                if ti.static(gas.uses.walled or gas.uses.partnered):
                    gas.hits[row] = gas.hits[noted]
                if ti.static(gas.uses.itemised):
                    gas.spent[row] = gas.spent[noted]
                for column in range(gas.tally.shape[2]):
                    gas.tally[k, AT_MOMENT + m, column] = gas.note_tally[n, column]
    for slot in range(n_slots):
        round_products(gas)
        now = ti.cast(time, float)
        fly(
            (TOLD + m) * gas.grid[ROOM] + slot, now - gas.told_at[m * gas.grid[ROOM] + slot], now,
            gas.scale[GX] * now, gas.scale[GY] * now, gas,
        )  # fmt: skip


@ti.kernel
def exchange(
    board: Rows, sending: ti.i32, grid: Rows, scale: Rows, clock: Rows, sums: Rows, counter: Rows, total: Rows,
):  # fmt: skip
    """Copy the small arrays, one after another, from the `board` if `sending`, else to it, for the host."""
    for _ in range(1):
        at = 0
        for array in ti.static((grid, scale, clock, sums, counter, total)):
            for i in range(array.shape[0]):
                if sending == 1:
                    if ti.static(has_numbers(array, ti.i32)):
                        array[i] = ti.cast(board[at + i], ti.i32)
                    elif ti.static(has_numbers(array, ti.f32)):
                        array[i] = ti.cast(board[at + i], ti.f32)
                    else:
                        array[i] = board[at + i]
                else:
                    board[at + i] = ti.cast(array[i], ti.f64)
            at += array.shape[0]


@ti.kernel
def take_rows(array: Rows, at: Rows, rows: Table):
    """Copy the rows `at` of an array into a table, which ranks send one another (`ifrdem/simulation/ranks.py`)."""
    for i in range(at.shape[0]):
        if ti.static(width(array) == 0):
            rows[i, 0] = array[at[i]]
        else:
            for column in ti.static(range(width(array))):
                rows[i, column] = array[at[i]][column]


@ti.kernel
def put_rows(array: Rows, at: Rows, rows: Table):
    """Copy a table into the rows `at` of an array."""
    for i in range(at.shape[0]):
        if ti.static(width(array) == 0):
            array[at[i]] = rows[i, 0]
        else:
            for column in ti.static(range(width(array))):
                array[at[i]][column] = rows[i, column]
