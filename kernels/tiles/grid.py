"""Column and row of a tile."""

from ..compiler.language import ti


@ti.func
def place_of(tile, gas: ti.template()):
    """Column and row of a tile."""
    column = tile // gas.grid.tiles_y
    return column, tile - column * gas.grid.tiles_y
