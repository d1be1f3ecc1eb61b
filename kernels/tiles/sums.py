"""Sums over all tiles: what they have added up in a window."""

from ..columns import REACH, TOTAL
from ..compiler.language import on_gpu, ti
from ..layout import AT_END, BLOCK_OF_TILES
from ..disks.particle import round_products
from ..compiler.signature import Arrays, kernel


@ti.func
def is_owned(tile, gas: ti.template()):
    """1 if a tile is one of this rank's; all are where there is but one."""
    found = 1
    if ti.static(gas.uses.ranks):
        found = gas.tile[tile].owned
    return found


@ti.func
def total_of(column, gas: ti.template()):
    """One of the sums over all tiles to the end of the window."""
    total = gas.tally[0, AT_END][column]
    if gas.grid.single_tile == 0:
        total = gas.total[TOTAL.width + column]
    return total


@ti.func
def max_speed_sq(gas: ti.template()):
    """The largest square of a speed at the end of the window."""
    found = gas.tally[0, AT_END].fastest
    if gas.grid.single_tile == 0:
        found = gas.total.max_speed_sq
    return found


@ti.func
def is_summed_here(gas: ti.template()):
    """1 if a launch adds up the sums of tiles; several ranks exchange them first (`sum_shared`)."""
    found = 1
    if ti.static(gas.uses.ranks):
        found = gas.grid.single_tile
    return found


@ti.func
def sum_up(b, column, gas: ti.template()):
    """One column of `found` for block b of tiles."""
    first = b * BLOCK_OF_TILES
    last = ti.min(first + BLOCK_OF_TILES, gas.grid.tiles_x * gas.grid.tiles_y)
    total = ti.cast(0.0, ti.f64)
    columns = gas.tally.shape[2]
    if column == TOTAL.max_speed_sq:
        for k in range(first, last):
            total = ti.max(total, gas.tally[k, AT_END].fastest)
    elif column < TOTAL.width:
        for k in range(first, last):
            total = ti.max(total, ti.cast(gas.reach[k][REACH.excursion + column - TOTAL.excursion], ti.f64))
    else:
        when = (column - TOTAL.width) // columns
        of = column - TOTAL.width - when * columns
        for k in range(first, last):
            total += gas.tally[k, when][of]
    gas.found[b][column] = total


@ti.func
def sum_blocks(column, gas: ti.template()):
    """One column of `total`: block after block, in one order whatever computes it."""
    total = gas.found[0][column]
    for b in range(1, gas.found.shape[0]):
        if column < TOTAL.width:
            total = ti.max(total, gas.found[b][column])
        else:
            total += gas.found[b][column]
    gas.total[column] = total


@ti.func
def sum_tiles(gas: ti.template()):
    """Sum up all columns: loops of a kernel."""
    ti.loop_config(serialize=ti.static(not on_gpu()))
    for item in range(gas.found.shape[0] * gas.found.shape[1]):
        round_products(gas)
        if is_summed_here(gas):
            sum_up(item // gas.found.shape[1], item % gas.found.shape[1], gas)
    ti.loop_config(serialize=ti.static(not on_gpu()))
    for column in range(gas.total.shape[0]):
        if is_summed_here(gas):
            sum_blocks(column, gas)


@kernel
def sum_shared(n_blocks: ti.i32, last: ti.i32, gas: Arrays("uses grid tally reach found total blocks")):
    """The last step of `run_windows` and `survey` on ranks: sums of `n_blocks` blocks of tiles; of all, if `last`."""
    for item in range(n_blocks * gas.found.shape[1]):
        sum_up(gas.blocks[item // gas.found.shape[1]], item % gas.found.shape[1], gas)
    for column in range(last * gas.total.shape[0]):
        sum_blocks(column, gas)
