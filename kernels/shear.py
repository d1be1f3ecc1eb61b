"""The mean flow of a sheared gas: the frames of rows of tiles, and what the flow puts in.

With a shear rate g the gas flows along x as fast as u(y) = g (y - L_y / 2), and the images of the box above and below
move with it (A. W. Lees, S. F. Edwards, J. Phys. C 5, 1921 (1972), doi:10.1088/0022-3719/5/15/006). Each row of tiles
has a frame of its own, which moves as fast as the flow in the row's middle and lay upon the lab at time 0. So every row
moves at the same speed g TILE_Y against the one below it, the image of the first row above the last one too: nothing is
special at a side of the box. In units of tiles, the displacement is a whole number, by which `tile_beside` looks
further along x, and a rest, which `shift_by` adds.

Energy. In the frames of the rows of tiles, flights keep kinetic energies. They change where a disk goes over to another
row, and where disks of two rows collide, whose momentum is passed from one frame to the other. Both are added up in
`flow_work`. What is peculiar to the mean flow differs from that by a function of the present state (`export`).

How far a disk may come in an epoch (`levels.py`) is counted in the flow at the middle of its row of *cells*. Two
adjacent rows of cells move against each other, half as fast as that counts for each disk; those further apart are
looked at by `extend` only, which adds what is missing.
"""

from .cells import place_of
from .history import side_of
from .language import ti
from .layout import (
    ASIDE,
    BEFORE,
    BOXES_ASIDE,
    CELL_Y,
    DRIFT,
    HEAD,
    HOW,
    INVERSE_MASS,
    KIND,
    NOW,
    PREVIOUS,
    ROW_SPEED,
    SHEAR,
    SHIFT_BITS,
    TILE_SIDE,
    TILE_Y,
    TILES_ASIDE,
    TILES_X,
    TILES_Y,
    VX,
    VY,
)


@ti.pyfunc
def displacement(speed, time, tile_side, tiles):
    """How far a row of tiles has come at `speed`, in double precision: whole boxes, whole tiles, and the rest."""
    way = speed * time
    whole = ti.floor(way / tile_side + 0.5)
    boxes = ti.floor(whole / tiles)
    return boxes, whole - boxes * tiles, way - whole * tile_side


@ti.func
def displace_rows(gas: ti.template()):
    """At the beginning of an epoch: how far each row of tiles has moved against the one below it."""
    boxes, tiles, rest = displacement(
        gas.clock[ROW_SPEED], gas.clock[NOW], gas.clock[TILE_SIDE], ti.cast(gas.grid[TILES_X], ti.f64)
    )
    gas.grid[BOXES_ASIDE] = ti.cast(boxes, ti.i32)
    gas.grid[TILES_ASIDE] = ti.cast(tiles, ti.i32)
    gas.scale[ASIDE] = ti.cast(rest, float)


@ti.func
def frame_speed(row, gas: ti.template()):
    """Velocity in the lab of a row of tiles' frame: that of the flow in the row's middle, in double precision."""
    return gas.clock[ROW_SPEED] * (ti.cast(2 * row + 1 - gas.grid[TILES_Y], ti.f64) * 0.5)


@ti.func
def lab_x(corner, x, row, now, gas: ti.template()):
    """Where in the box a disk of a row of tiles is, at x in a tile whose corner is given; and in which box."""
    length = gas.clock[TILE_SIDE] * gas.grid[TILES_X]
    at = corner + ti.cast(x, ti.f64) + frame_speed(row, gas) * now
    boxes = ti.floor(at / length)
    return at - boxes * length, ti.cast(boxes, ti.i32)


@ti.func
def flow_at(y, gas: ti.template()):
    """Velocity of the flow at a height in a tile, in the frame of that row of tiles."""
    return gas.scale[SHEAR] * (y - 0.5 * gas.scale[TILE_Y])


@ti.func
def speed2_in_flow(i, gas: ti.template()):
    """Square of disk i's speed: in the flow at the middle of its row of cells, if there is one."""
    vx, vy = gas.flight[i][VX], gas.flight[i][VY]
    if ti.static(gas.uses.sheared):
        _tile, _column, row = place_of(gas.cell[i], gas)
        vx -= flow_at((row + 0.5) * gas.scale[CELL_Y], gas)
    return vx * vx + vy * vy


@ti.pyfunc
def rows_apart(shear, cell_y):
    """Half of the speed at which adjacent rows of cells move against each other."""
    return 0.5 * abs(shear) * cell_y


@ti.func
def way_speed2(i, gas: ti.template()):
    """Square of the speed at which disk i uses up its reach."""
    speed2 = speed2_in_flow(i, gas)
    if ti.static(gas.uses.sheared):
        speed = ti.sqrt(speed2) + rows_apart(gas.scale[SHEAR], gas.scale[CELL_Y])
        speed2 = speed * speed
    return speed2


@ti.func
def work_between_rows(i, gas: ti.template()):
    """Energy that disk i and its partners got from the flow in this epoch's collisions across rows of tiles.

    Kinetic energies are counted in the frame of each disk's row, against which the partner's moves. Each collision
    counts at its first disk: that got a momentum m dv, and its partner, in a frame dy DRIFT faster, the opposite. In
    double precision.
    """
    vx = gas.flight[i][VX]
    change = 0.0 * vx
    entry = gas.link[i][HEAD]
    while entry >= 0:
        side = side_of(entry, i, gas)
        before = gas.log_real[entry][BEFORE + 5 * side + 2]
        if side == 0:
            shift = gas.log_int[entry][HOW] // SHIFT_BITS
            change += (vx - before) * (shift % 3 - 1)
        vx = before
        entry = gas.log_int[entry][PREVIOUS + side]
    return ti.cast(change * gas.scale[DRIFT], ti.f64) / gas.kinds[gas.meta[i][KIND]][INVERSE_MASS]


@ti.func
def work_of_crossing(i, step_y, gas: ti.template()):
    """Kinetic energy, in double precision, that disk i gets by going over to the frame `step_y` rows up."""
    vx = ti.cast(gas.flight[i][VX], ti.f64)
    faster = ti.cast(step_y * gas.scale[DRIFT], ti.f64)
    return faster * (0.5 * faster - vx) / gas.kinds[gas.meta[i][KIND]][INVERSE_MASS]
