"""Where all disks were at a time within an epoch that is over but not settled, by its log: frames end no epoch."""

from .history import flight_at
from .language import ti
from .layout import (
    BLOCK,
    CELLS_X,
    CELLS_Y,
    EVENTS,
    FAR,
    ID,
    SEQ,
    SLOT,
    SPREAD,
    STANDS,
    TILE_X,
    TILE_Y,
    TILES_X,
    TILES_Y,
    TIME,
    GasArrays,
    N,
    Rows,
    Table,
    n_blocks,
)
from .seen import folded
from .tally import partner_in, turned
from .totals import ALL_EVENTS, TOTALS, moving
from .walls import corner_of_tile

# What a frame has of a disk, a word each: a word is as long as a real number of the frame, and may hold one.
ROW_X, ROW_Y, ROW_VX, ROW_VY, ROW_SPIN, ROW_EVENTS, ROW_IMAGE_X, ROW_IMAGE_Y = range(8)
ROW_WORDS = 8


@ti.func
def put_real(row, column, value, wide: ti.template(), rows_out: ti.template()):
    """Write a real number into a word, bit by bit."""
    if ti.static(wide):
        rows_out[row, column] = ti.bit_cast(ti.cast(value, ti.f64), ti.i64)
    else:
        rows_out[row, column] = ti.bit_cast(ti.cast(value, ti.f32), ti.i32)


@ti.kernel
def look_back(
    wide: ti.template(), t: ti.f64, origin_x: ti.f64, origin_y: ti.f64, highest_x: ti.f64, highest_y: ti.f64,
    imaged: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, meta: Rows, image: Rows,
    link: Rows, cell: Rows, log_real: Rows, log_int: Rows, last_partner: Rows, angle: Rows, rows_out: Table,
    partner_out: Rows, angle_out: Rows, sums: Table,
):  # fmt: skip
    """Disks at time t of the epoch, in id order, collisions at t included; and the sums that `totals` has.

    `rows_out` (n, ROW_WORDS), whole numbers of 32 bits, or of 64 if `wide`, for real numbers of as many: position in
    the user's box, from its `origin` on and not beyond the `highest` place in it; velocity, spin and count as
    `sort.export` gives them, and so images, if `imaged` is 1. All of a disk stands together because ids lie anywhere
    in memory: this loop waits for memory once a disk. `partner_out` and `angle_out` (n,) only where the gas keeps them.
    `sums` (blocks, TOTALS), block by block of slots. Not in a gas with walls or shear, whose frames fall or move.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, meta=meta, image=image, link=link, cell=cell,
        log_real=log_real, log_int=log_int, last_partner=last_partner, angle=angle, uses=uses,
    ))  # fmt: skip
    for item in range(SPREAD * n_blocks(gas.grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            total = ti.Vector([0.0] * TOTALS, ti.f64)
            cells = gas.grid[CELLS_X] * gas.grid[CELLS_Y]
            length_x, length_y = gas.grid[TILES_X] * gas.scale[TILE_X], gas.grid[TILES_Y] * gas.scale[TILE_Y]
            first = -cells
            corner_x, corner_y = 0.0 * length_x, 0.0 * length_y
            for s in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                x, y, vx, vy, spin, started, entry, later = flight_at(s, t, gas)
                since = t - started
                if gas.cell[s] < first or gas.cell[s] >= first + cells:
                    # Disks of a tile stand together: these divisions are done once for all of them.
                    tile = gas.cell[s] // cells
                    first = tile * cells
                    corner_x, corner_y = corner_of_tile(tile, gas)
                x, boxes_x = folded(corner_x + x + vx * since, length_x)
                y, boxes_y = folded(corner_y + y + vy * since, length_y)
                events = gas.meta[s][EVENTS] + gas.link[s][SEQ] - later
                i = gas.meta[s][ID]
                put_real(i, ROW_X, ti.min(x - origin_x, highest_x), wide, rows_out)
                put_real(i, ROW_Y, ti.min(y - origin_y, highest_y), wide, rows_out)
                put_real(i, ROW_VX, vx, wide, rows_out)
                put_real(i, ROW_VY, vy, wide, rows_out)
                put_real(i, ROW_SPIN, spin, wide, rows_out)
                rows_out[i, ROW_EVENTS] = events
                if imaged == 1:
                    rows_out[i, ROW_IMAGE_X] = gas.image[i][0] + boxes_x
                    rows_out[i, ROW_IMAGE_Y] = gas.image[i][1] + boxes_y
                if ti.static(gas.uses.partnered):
                    partner_out[i] = partner_in(entry, s, gas)
                if ti.static(gas.uses.turned):
                    angle_out[i] = gas.angle[i] + turned(s, t, gas)
                total[ALL_EVENTS] += events
                shares = moving(s, ti.cast(vx, ti.f64), ti.cast(vy, ti.f64), ti.cast(spin, ti.f64), gas)
                for column in ti.static(range(5)):
                    total[column] += shares[column]
            for column in ti.static(range(TOTALS)):
                sums[b, column] = total[column]


@ti.kernel
def times_of_collisions(records: ti.i32, log_real: Rows, log_int: Rows, times: Rows):
    """When each of the first `records` of the log was, shape (records,); FAR where it does not stand, or met a wall."""
    for entry in range(records):
        times[entry] = FAR
        if log_int[entry][STANDS] == 1 and log_int[entry][SLOT + 1] >= 0:
            times[entry] = log_real[entry][TIME]
