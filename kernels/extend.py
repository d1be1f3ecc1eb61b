"""Longer lists for fast disks.

The list of an epoch holds every pair that could touch while no disk moves further than the *reach*. Epochs would be
short if the fastest disk had to keep to it. A disk that is too fast gets a higher *level* l instead: it may move
(1 + l / 4) reaches, and is listed with everybody whom it could then touch, at the beginning of the epoch or when a
collision has made it fast. Whom it could meet only beyond its old range, it cannot have met before.

At any time, every pair closer at the beginning of the epoch than contact + both ranges is listed. Entries too many
do no harm: no event depends on them.
"""

import taichi as ti

from .layout import (
    AFFECTED,
    AFFECTED_ROW,
    BEFORE,
    CELL_X,
    CELL_Y,
    CELLS_X,
    CELLS_Y,
    HEAD,
    HORIZON,
    LENGTH,
    LEVEL,
    LEVELS,
    MOST_LEVEL,
    MOST_NEIGHBOURS,
    OTHER,
    PARTNER,
    PREVIOUS,
    RADIUS,
    REACH,
    ROW,
    SAME_FRAME,
    SLOT,
    SPEED_MARGIN,
    TILE_X,
    TILE_Y,
    TOP_LEVEL,
    VX,
    VY,
    WIDEST,
    X,
    Y,
    contact_delay,
    level_of,
    n_others,
    n_own,
    tile_beside,
)
from .lists import offer

CAP = 2.26
LATER, AT_START_ALONE, AT_START = range(3)
EXTENDS = -3  # as a partner: this disk's list is being extended


@ti.pyfunc
def speed_cap(fastest, mean_square, most_level):
    """Speed [length/time] up to which disks need no longer list, and which sets the length of an epoch.

    A lower one makes epochs longer, and more disks need longer lists: CAP times the root mean square speed is reached
    by one disk in 170 of a Maxwellian gas. The fastest disk must stay well below the highest level.
    """
    least = SPEED_MARGIN * fastest / (1.0 + 0.2 * most_level)
    return ti.min(SPEED_MARGIN * fastest, ti.max(CAP * ti.sqrt(mean_square), least))


@ti.func
def needed_level(vx, vy, scale: ti.template()):
    """The lowest level at which a disk may keep this velocity to the end of the epoch."""
    way = ti.sqrt(vx * vx + vy * vy) * scale[HORIZON]
    level = 0
    if way > scale[REACH]:
        level = ti.ceil(ti.min((way / scale[REACH] - 1.0) * LEVELS, 1.0e6), ti.i32)
    return level


@ti.func
def reach_of(level, scale: ti.template()):
    """How far a disk of that level may move in the epoch."""
    return scale[REACH] * (1.0 + level / LEVELS)


@ti.func
def start_position(
    i, flight: ti.template(), link: ti.template(), log_real: ti.template(), log_int: ti.template()
):
    """Where disk i was at the beginning of the epoch."""
    x, y = flight[i][X], flight[i][Y]
    entry = link[i][HEAD]
    while entry >= 0:
        side = 0
        if log_int[entry][SLOT] != i:
            side = 1
        x, y = log_real[entry][BEFORE + 5 * side], log_real[entry][BEFORE + 5 * side + 1]
        entry = log_int[entry][PREVIOUS + side]
    return x, y


@ti.func
def push(row, item, lists: ti.template(), counter: ti.template()):
    """Append to a work list."""
    lists[row, ti.atomic_add(counter[row], 1)] = item


@ti.func
def append(
    i, j, shift, grid: ti.template(), link: ti.template(), neighbour: ti.template(), counter: ti.template()
):
    """Add disk j, one `shift` away, to disk i's list."""
    row = grid[ROW]
    step = OTHER
    if shift == SAME_FRAME:
        step = 1
    lengths = ti.atomic_add(link[i][LENGTH], step)
    if n_own(lengths) + n_others(lengths) >= row:
        # The epoch will be done again with longer rows; until then, no length may point beyond its row.
        ti.atomic_sub(link[i][LENGTH], step)
        ti.atomic_max(counter[MOST_NEIGHBOURS], row + 1)
    elif shift == SAME_FRAME:
        neighbour[row * i + n_own(lengths)] = j
    else:
        neighbour[row * i + row - 1 - n_others(lengths)] = 9 * j + shift


@ti.func
def listed(i, j, shift, grid: ti.template(), link: ti.template(), neighbour: ti.template()):
    """Whether disk i's list already has disk j."""
    row = grid[ROW]
    lengths = link[i][LENGTH]
    found = 0
    if shift == SAME_FRAME:
        for q in range(n_own(lengths)):
            if neighbour[row * i + q] == j:
                found = 1
    else:
        for q in range(n_others(lengths)):
            if neighbour[row * i + row - 1 - q] == 9 * j + shift:
                found = 1
    return found


@ti.func
def raise_level(i, level, link: ti.template(), counter: ti.template()):
    """First step for disk i, done for all such disks before the second: its new level."""
    link[i][LENGTH] += (level - level_of(link[i][LENGTH])) * LEVEL
    link[i][PARTNER] = EXTENDS
    ti.atomic_max(counter[TOP_LEVEL], level)


@ti.func
def extend(
    i,
    when: ti.template(),
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    cell: ti.template(),
    start: ti.template(),
    neighbour: ti.template(),
    lists: ti.template(),
    counter: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Second step: list disk i with everybody whom it could now touch.

    Of two disks that are extended together, the lower slot lists the pair. Both disks must know of their meeting:
    `when` says whether a prediction follows anyhow (LATER), or none of the disks has moved yet and the event is
    offered to both (AT_START_ALONE), or both are put on the list AFFECTED_ROW to predict (AT_START).
    """
    x, y = start_position(i, flight, link, log_real, log_int)
    radius = flight[i][RADIUS]
    own_reach = reach_of(level_of(link[i][LENGTH]), scale)
    furthest = scale[WIDEST] + own_reach + reach_of(counter[TOP_LEVEL], scale)
    cells = grid[CELLS_X] * grid[CELLS_Y]
    tile = cell[i] // cells
    in_x = (cell[i] - tile * cells) // grid[CELLS_Y]
    in_y = cell[i] - tile * cells - in_x * grid[CELLS_Y]
    most_x = ti.min(ti.ceil(furthest / scale[CELL_X], ti.i32), grid[CELLS_X])
    most_y = ti.min(ti.ceil(furthest / scale[CELL_Y], ti.i32), grid[CELLS_Y])
    for at_x in range(in_x - most_x, in_x + most_x + 1):
        for at_y in range(in_y - most_y, in_y + most_y + 1):
            cx, cy = at_x, at_y
            shift = SAME_FRAME
            if cx < 0:
                cx += grid[CELLS_X]
                shift -= 3
            elif cx >= grid[CELLS_X]:
                cx -= grid[CELLS_X]
                shift += 3
            if cy < 0:
                cy += grid[CELLS_Y]
                shift -= 1
            elif cy >= grid[CELLS_Y]:
                cy -= grid[CELLS_Y]
                shift += 1
            other = tile
            if shift != SAME_FRAME:
                other = tile_beside(tile, shift, grid)
            c = (other * grid[CELLS_X] + cx) * grid[CELLS_Y] + cy
            for j in range(start[c], start[c + 1]):
                beside = link[j][PARTNER] == EXTENDS
                if ti.static(when != LATER):
                    beside = level_of(link[j][LENGTH]) > 0
                if j != i and (i < j or not beside):
                    xj, yj = start_position(j, flight, link, log_real, log_int)
                    rx = xj - x + (shift // 3 - 1) * scale[TILE_X]
                    ry = yj - y + (shift % 3 - 1) * scale[TILE_Y]
                    sigma = radius + flight[j][RADIUS]
                    near = sigma + own_reach + reach_of(level_of(link[j][LENGTH]), scale)
                    if rx * rx + ry * ry < near * near:
                        if listed(i, j, shift, grid, link, neighbour) == 0:
                            append(i, j, shift, grid, link, neighbour, counter)
                            append(j, i, 8 - shift, grid, link, neighbour, counter)
                            if ti.static(when != LATER):
                                t = contact_delay(
                                    rx,
                                    ry,
                                    flight[i][VX],
                                    flight[i][VY],
                                    flight[j][VX],
                                    flight[j][VY],
                                    sigma,
                                    scale[HORIZON],
                                )
                                if ti.static(when == AT_START_ALONE):
                                    offer(i, t, 9 * j + shift, scale[HORIZON], flight, link, meta)
                                    offer(j, t, 9 * i + 8 - shift, scale[HORIZON], flight, link, meta)
                                elif t < scale[HORIZON]:
                                    for member in ti.static(range(2)):
                                        slot = i
                                        if ti.static(member == 1):
                                            slot = j
                                        if ti.atomic_max(link[slot][AFFECTED], 0) < 0:
                                            push(AFFECTED_ROW, slot, lists, counter)


@ti.func
def too_fast(i, grid: ti.template(), scale: ti.template(), flight: ti.template(), link: ti.template()):
    """The level that disk i needs, if that is above the one it has and not above what the box allows; else 0."""
    level = needed_level(flight[i][VX], flight[i][VY], scale)
    if level <= level_of(link[i][LENGTH]) or level > grid[MOST_LEVEL]:
        level = 0
    return level
