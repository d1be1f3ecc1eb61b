"""The mean flow of a sheared gas: the frames of rows of tiles, and what the flow puts in.

With a shear rate g the gas flows along x as fast as u(y) = g (y - L_y / 2), and the images of the box above and below
move with it (A. W. Lees, S. F. Edwards, J. Phys. C 5, 1921 (1972), doi:10.1088/0022-3719/5/15/006). Each row of tiles
has its own frame, which moves as fast as the flow in the row's middle and coincided with the lab at time 0. So every
row moves at the same speed g h, with the height h of a tile, relative to the one below it, also across a side of the
box. In units of tiles, the displacement is a whole number, by which `tiles.neighbor_tile` looks further along x, and
a rest, `aside`.

Energy. In the frames of the rows, flights keep kinetic energies. These change where a disk crosses to another row, and
where disks of two rows collide and pass momentum from one frame to the other. The tally sums both. The work of the mean
flow differs from this sum by a function of the present state (`readout.count_in`).
"""

from ..compiler.language import ti


@ti.pyfunc
def displacement(speed, time, tile_side, tiles):
    """Way of a row of tiles at `speed`, in double precision: whole boxes, whole tiles, and the rest."""
    distance = speed * time
    whole = ti.floor(distance / tile_side + 0.5)
    boxes = ti.floor(whole / tiles)
    return boxes, whole - boxes * tiles, distance - whole * tile_side


@ti.func
def frame_speed(row, gas: ti.template()):
    """Velocity in the lab of a row of tiles' frame: that of the flow in the row's middle, in double precision."""
    return ti.cast(gas.scale.drift, ti.f64) * (ti.cast(2 * row + 1 - gas.grid.tiles_y, ti.f64) * 0.5)


@ti.func
def flow_at(y, gas: ti.template()):
    """Velocity of the flow at a height in a tile, in the frame of that row of tiles."""
    return ti.cast(gas.scale.shear, ti.f64) * (ti.cast(y, ti.f64) - 0.5 * gas.edge_y[1])
