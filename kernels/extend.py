"""Longer lists for fast disks.

The list of an epoch holds every pair that could touch while no disk moves further than the *reach*. Epochs would be
short if the fastest disk had to keep to it. A disk that is too fast gets a higher *level* l instead: it may move
(1 + l / 4) reaches, and is listed with everybody whom it could then touch, at the beginning of the epoch or when a
collision has made it fast. Whom it could meet only beyond its old range, it cannot have met before.

At any time, every pair closer at the beginning of the epoch than contact + both ranges is listed. Entries too many
do no harm: no event depends on them.
"""

from .cells import cell_beside, columns_aside, has_column, place_of
from .flights import first_meeting, offer, shift_by
from .history import start_position
from .language import ti
from .layout import (
    AFFECTED,
    AFFECTED_ROW,
    CELL_X,
    CELL_Y,
    CELLS_X,
    CELLS_Y,
    HORIZON,
    LENGTH,
    LENGTH_BEFORE,
    LEVEL,
    MOST_NEIGHBOURS,
    OTHER,
    PARTNER,
    RADIUS,
    ROW,
    SAME_FRAME,
    SHEAR,
    TOP_LEVEL,
    WALLS,
    WIDEST,
    level_of,
    n_others,
    n_own,
    push,
)
from .levels import reach_of
from .shear import rows_apart

LATER, AT_START_ALONE, AT_START = range(3)
EXTENDS = -3  # as a partner: this disk's list is being extended


@ti.func
def append(i, j, shift, gas: ti.template()):
    """Add disk j, one `shift` away, to disk i's list."""
    row = gas.grid[ROW]
    step = OTHER
    if shift == SAME_FRAME:
        step = 1
    lengths = ti.atomic_add(gas.link[i][LENGTH], step)
    if n_own(lengths) + n_others(lengths) >= row:
        # The epoch will be done again with longer rows; until then, no length may point beyond its row.
        ti.atomic_sub(gas.link[i][LENGTH], step)
        ti.atomic_max(gas.counter[MOST_NEIGHBOURS], row + 1)
    elif shift == SAME_FRAME:
        gas.neighbour[row * i + n_own(lengths)] = j
    else:
        gas.neighbour[row * i + row - 1 - n_others(lengths)] = 9 * j + shift


@ti.func
def listed(i, j, shift, gas: ti.template()):
    """Whether disk i's list had disk j before lists were extended.

    What is being appended is left out: another thread may have raised LENGTH and not have written the entry yet, and
    what stands there from an earlier epoch could be j.
    """
    row = gas.grid[ROW]
    lengths = gas.link[i][LENGTH_BEFORE]
    found = 0
    if shift == SAME_FRAME:
        for q in range(n_own(lengths)):
            if gas.neighbour[row * i + q] == j:
                found = 1
    else:
        for q in range(n_others(lengths)):
            if gas.neighbour[row * i + row - 1 - q] == 9 * j + shift:
                found = 1
    return found


@ti.func
def raise_level(i, level, when: ti.template(), gas: ti.template()):
    """First step for disk i, done for all such disks before the second: its new level; `when` as for `extend`."""
    before = gas.link[i][LENGTH]
    gas.link[i][LENGTH_BEFORE] = before
    gas.link[i][LENGTH] = before + (level - level_of(before)) * LEVEL
    if ti.static(when == LATER):
        gas.link[i][PARTNER] = EXTENDS
    ti.atomic_max(gas.counter[TOP_LEVEL], level)


@ti.func
def extend(i, when: ti.template(), gas: ti.template()):
    """Second step: list disk i with everybody whom it could now touch.

    Of two disks that are extended together, the lower slot lists the pair. Both disks must know of their meeting:
    `when` says whether a prediction follows anyhow (LATER), or none of the disks has moved yet and the event is
    offered to both (AT_START_ALONE), or both are put on the list AFFECTED_ROW to predict (AT_START).
    """
    x, y = start_position(i, gas)
    radius = gas.flight[i][RADIUS]
    own_reach = reach_of(level_of(gas.link[i][LENGTH]), gas)
    if ti.static(gas.uses.walled):
        # Rare enough to test all walls: bits of those that are out of reach cost time, never a collision.
        gas.near_walls[i] = (1 << gas.grid[WALLS]) - 1
    furthest = gas.scale[WIDEST] + own_reach + reach_of(gas.counter[TOP_LEVEL], gas)
    tile, in_x, in_y = place_of(gas.cell[i], gas)
    most_y = ti.min(ti.ceil(furthest / gas.scale[CELL_Y], ti.i32), gas.grid[CELLS_Y])
    apart = 0.0 * furthest
    if ti.static(gas.uses.sheared):
        # Rows further apart than adjacent ones move against each other more than both disks' reaches allow for.
        apart = 2.0 * rows_apart(gas.scale[SHEAR], gas.scale[CELL_Y]) * gas.scale[HORIZON]
        furthest += apart * (most_y - 1)
    most_x = ti.min(ti.ceil(furthest / gas.scale[CELL_X], ti.i32), gas.grid[CELLS_X])
    for column in range(in_x - most_x, in_x + most_x + ti.static(1 + gas.uses.sheared)):
        for at_y in range(in_y - most_y, in_y + most_y + 1):
            at_x = column
            there = 1
            if ti.static(gas.uses.sheared):
                at_x += columns_aside(at_y, gas)
                if not has_column(at_x, gas):
                    there = 0
                    at_x = in_x
            c, shift = cell_beside(tile, at_x, at_y, gas)
            shift_x, shift_y, drift = shift_by(shift, gas)
            end = gas.start[c + 1]
            if ti.static(gas.uses.sheared):
                if there == 0:
                    end = gas.start[c]
            for j in range(gas.start[c], end):
                beside = gas.link[j][PARTNER] == EXTENDS
                if ti.static(when != LATER):
                    beside = level_of(gas.link[j][LENGTH]) > 0
                if j != i and (i < j or not beside):
                    xj, yj = start_position(j, gas)
                    rx = xj - x + shift_x
                    ry = yj - y + shift_y
                    near = (
                        radius
                        + gas.flight[j][RADIUS]
                        + own_reach
                        + reach_of(level_of(gas.link[j][LENGTH]), gas)
                    )
                    if ti.static(gas.uses.sheared):
                        near += apart * ti.max(ti.abs(at_y - in_y) - 1, 0)
                    if rx * rx + ry * ry < near * near:
                        if listed(i, j, shift, gas) == 0:
                            append(i, j, shift, gas)
                            append(j, i, 8 - shift, gas)
                            if ti.static(when != LATER):
                                t = first_meeting(i, j, rx, ry, drift, gas.scale[HORIZON], gas)
                                if ti.static(when == AT_START_ALONE):
                                    offer(i, t, 9 * j + shift, gas.scale[HORIZON], gas)
                                    offer(j, t, 9 * i + 8 - shift, gas.scale[HORIZON], gas)
                                elif t < gas.scale[HORIZON]:
                                    for member in ti.static(range(2)):
                                        slot = i
                                        if ti.static(member == 1):
                                            slot = j
                                        if ti.atomic_max(gas.link[slot][AFFECTED], 0) < 0:
                                            push(AFFECTED_ROW, slot, gas)
