"""The collisions of tracked disks, copied from the log of an epoch before that is lost."""

from .history import side_of
from .language import ti
from .layout import (
    DURATION,
    GX,
    GY,
    HEAD,
    ID,
    PREVIOUS,
    SEQ,
    SLOT,
    SPIN,
    TAU,
    VX,
    VY,
    Cube,
    GasArrays,
    N,
    Rows,
    Table,
    X,
    Y,
)
from .seen import after, before, disks_seen, in_box, wall_seen, was_elastic, where
from .walls import TEMPERATURE

# Columns of what is copied: real numbers; and integers.
AT, PLACE, NORMAL, V_BEFORE, V_AFTER, W_BEFORE, W_AFTER, U_BEFORE, U_AFTER, S_BEFORE, S_AFTER = (
    0, 1, 3, 5, 7, 9, 10, 11, 13, 15, 16,
)  # fmt: skip
REALS = 17
WHO, PARTNER_ID, BOX_X, HOW_IT_WAS, ORDINAL = 0, 1, 2, 4, 5
INTEGERS = 6
BY_LAW, BY_REMEDY, BY_HEAT = range(3)  # how it was


@ti.kernel
def count_tracked(grid: Rows, meta: Rows, link: Rows, tracked: Rows) -> ti.i32:
    """Collisions of tracked disks in the epoch that has ended; one of two of them counts twice."""
    total = 0
    for i in range(grid[N]):
        if tracked[meta[i][ID]] > 0:
            total += link[i][SEQ]
    return total


@ti.func
def put_pair(row, side, entry, gas: ti.template(), real_out: ti.template(), int_out: ti.template()):
    """Write what happened to both disks of a record, seen from the one on this side of it."""
    t, _x, _y, nx, ny, _drift = disks_seen(entry, gas)
    sign = 1.0 - 2.0 * side
    x, y, _ = where(entry, side, gas)
    fall_x, fall_y = gas.scale[GX] * t, gas.scale[GY] * t
    real_out[row, AT] = t
    real_out[row, PLACE], real_out[row, PLACE + 1] = x + 0.5 * fall_x * t, y + 0.5 * fall_y * t
    real_out[row, NORMAL], real_out[row, NORMAL + 1] = sign * nx, sign * ny
    vx, vy, spin = before(entry, 1 - side, gas)
    real_out[row, U_BEFORE], real_out[row, U_BEFORE + 1] = vx + fall_x, vy + fall_y
    real_out[row, S_BEFORE] = spin
    vx, vy, spin = after(entry, 1 - side, gas)
    real_out[row, U_AFTER], real_out[row, U_AFTER + 1] = vx + fall_x, vy + fall_y
    real_out[row, S_AFTER] = spin
    int_out[row, PARTNER_ID] = gas.meta[gas.log_int[entry][SLOT + 1 - side]][ID]


@ti.func
def put_wall(row, entry, gas: ti.template(), real_out: ti.template(), int_out: ti.template()):
    """Write where a disk hit a wall, and how that moves."""
    t, x, y, nx, ny, ux, uy = wall_seen(entry, gas)
    w = -1 - gas.log_int[entry][SLOT + 1]
    real_out[row, AT] = t
    real_out[row, PLACE], real_out[row, PLACE + 1] = x, y
    real_out[row, NORMAL], real_out[row, NORMAL + 1] = nx, ny
    for first in ti.static((U_BEFORE, U_AFTER)):
        real_out[row, first], real_out[row, first + 1] = ux, uy
    real_out[row, S_BEFORE], real_out[row, S_AFTER] = 0.0, 0.0
    int_out[row, PARTNER_ID] = -2 - w
    if gas.walls[w][TEMPERATURE] > 0.0:
        int_out[row, HOW_IT_WAS] = BY_HEAT


@ti.kernel
def copy_states(
    grid: Rows, scale: Rows, flight: Rows, meta: Rows, image: Rows, cell: Rows, tracked: Rows, real_out: Table,
    int_out: Table,
):  # fmt: skip
    """Where tracked disks are at the end of the epoch, without walls, and how they move; each in its own row.

    x, y, vx, vy, spin into `real_out` (m, 5), inside the box; box lengths travelled into `int_out` (m, 2).
    """
    gas = ti.static(GasArrays(grid=grid, scale=scale, flight=flight, meta=meta, image=image, cell=cell))
    for i in range(gas.grid[N]):
        row = tracked[gas.meta[i][ID]] - 1
        if row >= 0:
            dt = gas.scale[DURATION] - gas.flight[i][TAU]
            x, y = gas.flight[i][X] + gas.flight[i][VX] * dt, gas.flight[i][Y] + gas.flight[i][VY] * dt
            x, y, boxes_x, boxes_y = in_box(i, x, y, gas)
            real_out[row, 0], real_out[row, 1] = x, y
            real_out[row, 2], real_out[row, 3] = gas.flight[i][VX], gas.flight[i][VY]
            real_out[row, 4] = gas.flight[i][SPIN]
            int_out[row, 0] = gas.image[gas.meta[i][ID]][0] + boxes_x
            int_out[row, 1] = gas.image[gas.meta[i][ID]][1] + boxes_y


@ti.kernel
def copy_tracked(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, meta: Rows, image: Rows, link: Rows,
    cell: Rows, log_real: Rows, log_int: Rows, walls: Rows, law: Cube, tracked: Rows, next_row: Rows, real_out: Table,
    int_out: Table,
):  # fmt: skip
    """Write every collision of tracked disks in the epoch that has ended, in any order, from row `next_row[0]` on.

    Not in a sheared gas, whose rows of tiles have frames of their own. Places are those in the lab, inside the box.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, meta=meta, image=image, link=link, cell=cell,
        log_real=log_real, log_int=log_int, walls=walls, law=law, uses=uses,
    ))  # fmt: skip
    for i in range(gas.grid[N]):
        if tracked[gas.meta[i][ID]] > 0:
            vx, vy, spin = gas.flight[i][VX], gas.flight[i][VY], gas.flight[i][SPIN]
            number = gas.link[i][SEQ]
            entry = gas.link[i][HEAD]
            while entry >= 0:
                side = side_of(entry, i, gas)
                row = ti.atomic_add(next_row[0], 1)
                number -= 1
                int_out[row, WHO] = gas.meta[i][ID]
                int_out[row, ORDINAL] = number
                int_out[row, HOW_IT_WAS] = BY_LAW
                if gas.log_int[entry][SLOT + 1] >= 0:
                    put_pair(row, side, entry, gas, real_out, int_out)
                else:
                    if ti.static(gas.uses.walled):
                        put_wall(row, entry, gas, real_out, int_out)
                if was_elastic(entry, gas):
                    int_out[row, HOW_IT_WAS] = BY_REMEDY
                t = real_out[row, AT]
                real_out[row, V_AFTER] = vx + gas.scale[GX] * t
                real_out[row, V_AFTER + 1] = vy + gas.scale[GY] * t
                real_out[row, W_AFTER] = spin
                vx, vy, spin = before(entry, side, gas)
                real_out[row, V_BEFORE] = vx + gas.scale[GX] * t
                real_out[row, V_BEFORE + 1] = vy + gas.scale[GY] * t
                real_out[row, W_BEFORE] = spin
                x, y, boxes_x, boxes_y = in_box(i, real_out[row, PLACE], real_out[row, PLACE + 1], gas)
                real_out[row, PLACE], real_out[row, PLACE + 1] = x, y
                int_out[row, BOX_X] = gas.image[gas.meta[i][ID]][0] + boxes_x
                int_out[row, BOX_X + 1] = gas.image[gas.meta[i][ID]][1] + boxes_y
                entry = gas.log_int[entry][PREVIOUS + side]
