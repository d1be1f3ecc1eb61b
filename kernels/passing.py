"""Where all disks were at a time within an epoch that is over but not settled, by its log: frames end no epoch."""

import taichi as ti

from .history import flight_at
from .layout import (
    BLOCK,
    EVENTS,
    FAR,
    ID,
    SEQ,
    SLOT,
    SPREAD,
    STANDS,
    TIME,
    GasArrays,
    N,
    Rows,
    Table,
)
from .seen import in_box
from .sort import n_blocks
from .tally import partner_in, turned
from .totals import ALL_EVENTS, TOTALS, moving


@ti.kernel
def look_back(
    t: ti.f64, origin_x: ti.f64, origin_y: ti.f64, highest_x: ti.f64, highest_y: ti.f64,
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, meta: Rows, image: Rows,
    link: Rows, cell: Rows, log_real: Rows, log_int: Rows, last_partner: Rows, angle: Rows, real_out: Table,
    int_out: Table, partner_out: Rows, angle_out: Rows, sums: Table,
):  # fmt: skip
    """Disks at time t of the epoch, in id order, collisions at t included; and the sums that `totals` has.

    `real_out` (n, 5), `int_out` (n, 3): what `sort.export` gives, but places in the user's box, from its `origin` on
    and not beyond the `highest` place in it. A disk's numbers stand together: its place in memory is far from that of
    the disk before. `partner_out` and `angle_out` (n,) only where the gas keeps them. `sums` (blocks, TOTALS), block by
    block of slots. Not in a gas with walls or shear, whose frames fall or move.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, meta=meta, image=image, link=link, cell=cell,
        log_real=log_real, log_int=log_int, last_partner=last_partner, angle=angle, uses=uses,
    ))  # fmt: skip
    for item in range(SPREAD * n_blocks(gas.grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            total = ti.Vector([0.0] * TOTALS, ti.f64)
            for s in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                x, y, vx, vy, spin, started, entry, later = flight_at(s, t, gas)
                since = t - started
                x, y, boxes_x, boxes_y = in_box(s, x + vx * since, y + vy * since, gas)
                events = gas.meta[s][EVENTS] + gas.link[s][SEQ] - later
                i = gas.meta[s][ID]
                real_out[i, 0] = ti.min(x - origin_x, highest_x)
                real_out[i, 1] = ti.min(y - origin_y, highest_y)
                real_out[i, 2] = vx
                real_out[i, 3] = vy
                real_out[i, 4] = spin
                int_out[i, 0] = events
                int_out[i, 1] = gas.image[i][0] + boxes_x
                int_out[i, 2] = gas.image[i][1] + boxes_y
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
