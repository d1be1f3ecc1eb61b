"""Sums over all disks: what `observables.measure` tells of a state, without copying the state."""

from .language import ti
from .layout import (
    BLOCK,
    CELLS_X,
    CELLS_Y,
    EVENTS,
    GX,
    GY,
    KIND_INERTIA,
    KIND_MASS,
    SPIN,
    SPREAD,
    TILE_X,
    TILE_Y,
    TILES_Y,
    VX,
    VY,
    GasArrays,
    N,
    Rows,
    Table,
    X,
    Y,
    kind_of,
    n_blocks,
)
from .shear import flow_at

TRANSLATIONAL, ROTATIONAL, MOMENTUM_X, MOMENTUM_Y, SHEAR_PRESSURE, FALL, ALL_EVENTS, EXCESS = range(8)
TOTALS = 8


@ti.func
def moving(i, vx, vy, spin, gas: ti.template()):
    """Shares of disk i, with these velocities, in the sums from TRANSLATIONAL to SHEAR_PRESSURE; in double precision.

    Nothing for a disk of infinite mass.
    """
    kind = kind_of(i, gas)
    mass, inertia = (
        ti.cast(gas.kinds[kind][KIND_MASS], ti.f64),
        ti.cast(gas.kinds[kind][KIND_INERTIA], ti.f64),
    )
    shares = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0], ti.f64)
    shares[MOMENTUM_X] = mass * vx
    shares[MOMENTUM_Y] = mass * vy
    shares[TRANSLATIONAL] = 0.5 * (shares[MOMENTUM_X] * vx + shares[MOMENTUM_Y] * vy)
    shares[ROTATIONAL] = 0.5 * inertia * spin * spin
    shares[SHEAR_PRESSURE] = shares[MOMENTUM_X] * vy
    return shares


@ti.func
def count_in(s, total: ti.template(), gas: ti.template()):
    """Add a settled disk to the sums that `totals` has."""
    total[ALL_EVENTS] += gas.meta[s][EVENTS]
    mass = ti.cast(gas.kinds[kind_of(s, gas)][KIND_MASS], ti.f64)
    vx, vy = ti.cast(gas.flight[s][VX], ti.f64), ti.cast(gas.flight[s][VY], ti.f64)
    if ti.static(gas.uses.sheared):
        flow = ti.cast(flow_at(gas.flight[s][Y], gas), ti.f64)
        total[EXCESS] += flow * (vx - 0.5 * flow) * mass
        vx -= flow
    shares = moving(s, vx, vy, ti.cast(gas.flight[s][SPIN], ti.f64), gas)
    for column in ti.static(range(5)):
        total[column] += shares[column]
    if ti.static(gas.uses.walled):
        tile = gas.cell[s] // (gas.grid[CELLS_X] * gas.grid[CELLS_Y])
        tile_x = tile // gas.grid[TILES_Y]
        x = tile_x * gas.scale[TILE_X] + ti.cast(gas.flight[s][X], ti.f64)
        y = (tile - tile_x * gas.grid[TILES_Y]) * gas.scale[TILE_Y] + ti.cast(gas.flight[s][Y], ti.f64)
        total[FALL] += (x * gas.scale[GX] + y * gas.scale[GY]) * mass


@ti.kernel
def totals(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, meta: Rows, cell: Rows, sums: Table,
):  # fmt: skip
    """Sums over settled disks, block by block, into `sums` (blocks, TOTALS), in double precision.

    Kinetic energies, momentum, m v_x v_y, mass times the way along gravity, collisions with disks and walls.
    Velocities are peculiar ones in a sheared gas; the last sum is how much more kinetic energy the frames of its rows
    of tiles see (`sort.export`). Disks of infinite mass count for nothing. `sort.settle` gives the same, if asked.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, meta=meta, cell=cell, uses=uses,
    ))  # fmt: skip
    for item in range(SPREAD * n_blocks(gas.grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            total = ti.Vector([0.0] * TOTALS, ti.f64)
            for s in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                count_in(s, total, gas)
            for column in ti.static(range(TOTALS)):
                sums[b, column] = total[column]
