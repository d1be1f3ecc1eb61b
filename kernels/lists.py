"""Beginning of an epoch: list the neighbours, predict first events."""

from .cells import cell_beside, columns_aside, has_column
from .flights import first_meeting, offer, shift_by
from .language import ti
from .layout import (
    CELLS_X,
    CELLS_Y,
    END,
    HORIZON,
    LENGTH,
    LOG_FULL,
    MOST_NEIGHBOURS,
    N_ELASTIC,
    N_LOG,
    N_ROUNDS,
    N_STANDING,
    N_UNDONE,
    N_VIOLATIONS,
    N_WALL_HITS,
    NOW,
    OTHER,
    RADIUS,
    REACH,
    RESTING,
    ROW,
    SAME_FRAME,
    SKIN,
    TE,
    TOP_LEVEL,
    N,
    X,
    Y,
    n_others,
    n_own,
)
from .walls import note_walls, wall_phases


@ti.func
def open_epoch(gas: ti.template()):
    """Counters and end of a new epoch."""
    for item in ti.static(
        (
            0,
            1,
            2,
            3,
            4,
            N_LOG,
            N_STANDING,
            N_VIOLATIONS,
            N_ROUNDS,
            MOST_NEIGHBOURS,
            LOG_FULL,
            N_UNDONE,
            TOP_LEVEL,
            N_WALL_HITS,
            N_ELASTIC,
            RESTING,
        )
    ):
        gas.counter[item] = 0
    gas.limit[END] = gas.scale[HORIZON]
    if ti.static(gas.uses.remembers):
        gas.latest[gas.grid[N]] = gas.clock[NOW]
    if ti.static(gas.uses.walled):
        wall_phases(gas)


@ti.func
def list_others(i, tile, in_x, in_y, gas: ti.template()):
    """List disk i's neighbours in other tiles, or across the box in its own, and predict its meetings with them."""
    row = gas.grid[ROW]
    length = 0
    for beside in range(ti.static(9 + 3 * gas.uses.sheared)):
        at_x = in_x + beside // 3 - 1
        at_y = in_y + beside % 3 - 1
        shift = SAME_FRAME
        c = 0
        if ti.static(gas.uses.sheared):
            at_x += columns_aside(at_y, gas)
            # A fourth column is within reach only in displaced rows.
            displaced = at_y < 0 or at_y >= gas.grid[CELLS_Y]
            if has_column(at_x, gas) and (displaced or beside < 9):
                c, shift = cell_beside(tile, at_x, at_y, gas)
        else:
            c, shift = cell_beside(tile, at_x, at_y, gas)
        if shift != SAME_FRAME:
            shift_x, shift_y, drift = shift_by(shift, gas)
            for j in range(gas.start[c], gas.start[c + 1]):
                rx = gas.flight[j][X] - gas.flight[i][X] + shift_x
                ry = gas.flight[j][Y] - gas.flight[i][Y] + shift_y
                near = gas.flight[i][RADIUS] + gas.flight[j][RADIUS] + gas.scale[SKIN]
                if rx * rx + ry * ry < near * near:
                    gas.neighbour[row * i + row - 1 - ti.min(length, row - 1)] = 9 * j + shift
                    length += 1
                    t = first_meeting(i, j, rx, ry, drift, gas.scale[HORIZON], gas)
                    offer(i, t, 9 * j + shift, gas.scale[HORIZON], gas)
    gas.link[i][LENGTH] = gas.link[i][LENGTH] + OTHER * length


@ti.func
def list_tile(tile, gas: ti.template()):
    """List the neighbours of a tile's disks and predict first events; each pair of the tile is looked at once.

    Entries that a row has no room for are not written, but `gas.counter[MOST_NEIGHBOURS]` tells the length needed.
    """
    row = gas.grid[ROW]
    cells_x = gas.grid[CELLS_X]
    cells_y = gas.grid[CELLS_Y]
    skin = gas.scale[SKIN]
    horizon = gas.scale[HORIZON]
    first = tile * cells_x * cells_y
    most = 0
    for in_x in range(cells_x):
        for in_y in range(cells_y):
            c = first + in_x * cells_y + in_y
            # The cells of a column follow one another in memory: above this one, and to its right.
            above = ti.min(in_y + 1, cells_y - 1) - in_y
            below = in_y - ti.max(in_y - 1, 0)
            own_end = gas.start[c + above + 1]
            right = 0
            right_end = 0
            if in_x + 1 < cells_x:
                right = gas.start[c + cells_y - below]
                right_end = gas.start[c + cells_y + above + 1]
            at_border = in_x == 0 or in_x == cells_x - 1 or in_y == 0 or in_y == cells_y - 1
            for i in range(gas.start[c], gas.start[c + 1]):
                x, y = gas.flight[i][X], gas.flight[i][Y]
                radius = gas.flight[i][RADIUS]
                old = gas.link[i][LENGTH]
                length = old
                # Every candidate is written to the next free place; only a neighbour moves that place on. Cheaper
                # than a branch that nobody can predict.
                for j in range(i + 1, own_end):
                    rx, ry = gas.flight[j][X] - x, gas.flight[j][Y] - y
                    near = radius + gas.flight[j][RADIUS] + skin
                    gas.neighbour[row * i + ti.min(length, row - 1)] = j
                    length += ti.cast(rx * rx + ry * ry < near * near, ti.i32)
                for j in range(right, right_end):
                    rx, ry = gas.flight[j][X] - x, gas.flight[j][Y] - y
                    near = radius + gas.flight[j][RADIUS] + skin
                    gas.neighbour[row * i + ti.min(length, row - 1)] = j
                    length += ti.cast(rx * rx + ry * ry < near * near, ti.i32)
                gas.link[i][LENGTH] = length
                earliest = gas.flight[i][TE]
                for q in range(old, ti.min(length, row)):
                    j = gas.neighbour[row * i + q]
                    length_j = gas.link[j][LENGTH]
                    gas.neighbour[row * j + ti.min(length_j, row - 1)] = i
                    gas.link[j][LENGTH] = length_j + 1
                    before = ti.min(horizon, ti.max(earliest, gas.flight[j][TE]))
                    t = first_meeting(i, j, gas.flight[j][X] - x, gas.flight[j][Y] - y, 0.0, before, gas)
                    if t <= before:
                        offer(i, t, 9 * j + SAME_FRAME, horizon, gas)
                        offer(j, t, 9 * i + SAME_FRAME, horizon, gas)
                        earliest = gas.flight[i][TE]
                if at_border:
                    list_others(i, tile, in_x, in_y, gas)
                lengths = gas.link[i][LENGTH]
                most = ti.max(most, n_own(lengths) + n_others(lengths))
    # A row that later disks made too long shows when it is looked at again.
    for i in range(gas.start[first], gas.start[first + cells_x * cells_y]):
        if ti.static(gas.uses.walled):
            note_walls(i, gas.flight[i][X], gas.flight[i][Y], gas.scale[REACH], gas)
        most = ti.max(most, n_own(gas.link[i][LENGTH]) + n_others(gas.link[i][LENGTH]))
    # In a row that is just full, a candidate may have been written over the last neighbour.
    if most >= row:
        ti.atomic_max(gas.counter[MOST_NEIGHBOURS], most + 1)
