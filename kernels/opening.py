"""Beginning of an epoch: all lists and first events, as kernels."""

from .cells import place_of
from .events import predict
from .extend import AT_START, extend, raise_level
from .flights import first_meeting, offer
from .language import ti
from .layout import (
    ACTIVE,
    AFFECTED,
    AFFECTED_ROW,
    CELLS_X,
    CELLS_Y,
    EXTEND_ROW,
    HORIZON,
    LENGTH,
    MOST_NEIGHBOURS,
    RADIUS,
    REACH,
    ROW,
    SAME_FRAME,
    SKIN,
    SPREAD,
    TILES_X,
    TILES_Y,
    GasArrays,
    N,
    Rows,
    Table,
    X,
    Y,
    n_others,
    n_own,
    push,
)
from .levels import too_fast
from .lists import list_others, list_tile, open_epoch
from .sort import clear
from .walls import note_walls, offer_wall


@ti.kernel
def list_tiles(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, link: Rows, meta: Rows, start: Rows,
    neighbour: Rows, counter: Rows, limit: Rows, cell: Rows, clock: Rows, walls: Rows, near_walls: Rows,
    latest: Rows,
):  # fmt: skip
    """Open an epoch: list every pair closer than contact + skin, predict first events. One thread a tile."""
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, link=link, meta=meta, start=start, neighbour=neighbour,
        counter=counter, limit=limit, cell=cell, clock=clock, walls=walls, near_walls=near_walls, latest=latest,
        uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        open_epoch(gas)
    for item in range(SPREAD * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        if item % SPREAD == 0:
            list_tile(item // SPREAD, gas)


@ti.kernel
def list_disks(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, link: Rows, meta: Rows, cell: Rows, start: Rows,
    neighbour: Rows, counter: Rows, limit: Rows, clock: Rows, walls: Rows, near_walls: Rows, latest: Rows,
):  # fmt: skip
    """The same as `list_tiles`, one thread a disk: every pair is looked at twice, but thousands of threads help."""
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, link=link, meta=meta, cell=cell, start=start,
        neighbour=neighbour, counter=counter, limit=limit, clock=clock, walls=walls, near_walls=near_walls,
        latest=latest, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        open_epoch(gas)
    for i in range(gas.grid[N]):
        tile, in_x, in_y = place_of(gas.cell[i], gas)
        length = 0
        first_y = ti.max(in_y - 1, 0)
        last_y = ti.min(in_y + 1, gas.grid[CELLS_Y] - 1)
        for column in range(ti.max(in_x - 1, 0), ti.min(in_x + 2, gas.grid[CELLS_X])):
            base = (tile * gas.grid[CELLS_X] + column) * gas.grid[CELLS_Y]
            for j in range(gas.start[base + first_y], gas.start[base + last_y + 1]):
                rx = gas.flight[j][X] - gas.flight[i][X]
                ry = gas.flight[j][Y] - gas.flight[i][Y]
                near = gas.flight[i][RADIUS] + gas.flight[j][RADIUS] + gas.scale[SKIN]
                if rx * rx + ry * ry < near * near and j != i:
                    if length < gas.grid[ROW]:
                        gas.neighbour[gas.grid[ROW] * i + length] = j
                    length += 1
                    t = first_meeting(i, j, rx, ry, 0.0, gas.scale[HORIZON], gas)
                    offer(i, t, 9 * j + SAME_FRAME, gas.scale[HORIZON], gas)
        gas.link[i][LENGTH] = length
        if ti.static(gas.uses.walled):
            note_walls(i, gas.flight[i][X], gas.flight[i][Y], gas.scale[REACH], gas)
        if in_x == 0 or in_x == gas.grid[CELLS_X] - 1 or in_y == 0 or in_y == gas.grid[CELLS_Y] - 1:
            list_others(i, tile, in_x, in_y, gas)
        lengths = gas.link[i][LENGTH]
        if n_own(lengths) + n_others(lengths) > gas.grid[ROW]:
            ti.atomic_max(gas.counter[MOST_NEIGHBOURS], n_own(lengths) + n_others(lengths))


@ti.kernel
def clear_all(
    grid: Rows, flight: Rows, link: Rows,
):  # fmt: skip
    """Forget the epoch's lists and events, to list again."""
    gas = ti.static(GasArrays(
        grid=grid, flight=flight, link=link,
    ))  # fmt: skip
    for s in range(gas.grid[N]):
        clear(s, gas)


@ti.kernel
def extend_fast(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, link: Rows, meta: Rows, cell: Rows, start: Rows,
    neighbour: Rows, lists: Table, counter: Rows, log_real: Rows, log_int: Rows, walls: Rows, near_walls: Rows,
):  # fmt: skip
    """Longer lists for the disks that are too fast at the beginning of the epoch; first meetings with walls."""
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, link=link, meta=meta, cell=cell, start=start,
        neighbour=neighbour, lists=lists, counter=counter, log_real=log_real, log_int=log_int, walls=walls,
        near_walls=near_walls, uses=uses,
    ))  # fmt: skip
    for i in range(gas.grid[N]):
        level = too_fast(i, gas)
        if level > 0:
            raise_level(i, level, AT_START, gas)
            push(EXTEND_ROW, i, gas)
    for q in range(gas.counter[EXTEND_ROW]):
        extend(gas.lists[EXTEND_ROW, q], AT_START, gas)
    for q in range(gas.counter[EXTEND_ROW]):
        gas.link[gas.lists[EXTEND_ROW, q]][ACTIVE] = -1  # it held LENGTH_BEFORE
    for q in range(gas.counter[AFFECTED_ROW]):
        i = gas.lists[AFFECTED_ROW, q]
        predict(i, False, gas)
        gas.link[i][AFFECTED] = -1
    if ti.static(uses.walled):
        for i in range(gas.grid[N]):
            offer_wall(i, gas)
    for _ in range(1):
        gas.counter[EXTEND_ROW] = 0
        gas.counter[AFFECTED_ROW] = 0
