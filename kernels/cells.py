"""Cells and tiles: where a disk stands among them, and what lies beside."""

from .language import ti
from .layout import ASIDE, CELL_X, CELLS_X, CELLS_Y, SAME_FRAME, TILES_ASIDE, TILES_X, TILES_Y


@ti.func
def place_of(c, gas: ti.template()):
    """Tile of a cell, and the cell's column and row in it."""
    cells = gas.grid[CELLS_X] * gas.grid[CELLS_Y]
    tile = c // cells
    in_x = (c - tile * cells) // gas.grid[CELLS_Y]
    return tile, in_x, c - tile * cells - in_x * gas.grid[CELLS_Y]


@ti.func
def tile_beside(tile, shift, gas: ti.template()):
    """The tile that lies one `shift` from `tile`, across the box's sides if need be."""
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    tx += shift // 3 - 1
    ty += shift % 3 - 1
    if ti.static(gas.uses.sheared):
        tx -= (shift % 3 - 1) * gas.grid[TILES_ASIDE]
    if tx < 0:
        tx += gas.grid[TILES_X]
    elif tx >= gas.grid[TILES_X]:
        tx -= gas.grid[TILES_X]
    if ty < 0:
        ty += gas.grid[TILES_Y]
    elif ty >= gas.grid[TILES_Y]:
        ty -= gas.grid[TILES_Y]
    return tx * gas.grid[TILES_Y] + ty


@ti.func
def cell_beside(tile, cx, cy, gas: ti.template()):
    """The cell in column cx and row cy of a tile, both less than a tile outside of it at most; and its shift."""
    shift = SAME_FRAME
    if cx < 0:
        cx += gas.grid[CELLS_X]
        shift -= 3
    elif cx >= gas.grid[CELLS_X]:
        cx -= gas.grid[CELLS_X]
        shift += 3
    if cy < 0:
        cy += gas.grid[CELLS_Y]
        shift -= 1
    elif cy >= gas.grid[CELLS_Y]:
        cy -= gas.grid[CELLS_Y]
        shift += 1
    other = tile
    if shift != SAME_FRAME:
        other = tile_beside(tile, shift, gas)
    return (other * gas.grid[CELLS_X] + cx) * gas.grid[CELLS_Y] + cy, shift


@ti.func
def columns_aside(at_y, gas: ti.template()):
    """In a sheared gas, which column lies over column 0 in row `at_y`, in this row of tiles or the next above or below.

    The rest of the displacement is no whole number of columns: those rows have one column more within reach, to the
    right.
    """
    dy = 0
    if at_y < 0:
        dy = -1
    elif at_y >= gas.grid[CELLS_Y]:
        dy = 1
    return ti.floor(-dy * gas.scale[ASIDE] / gas.scale[CELL_X], ti.i32)


@ti.func
def has_column(at_x, gas: ti.template()):
    """Whether a column lies in this tile or the next one on either side."""
    return at_x >= -gas.grid[CELLS_X] and at_x < 2 * gas.grid[CELLS_X]
