"""The kernels that apply a force to every disk: one pair of them for each class of forces."""

from .language import ti
from .layout import (
    BLOCK,
    CELLS_X,
    CELLS_Y,
    DURATION,
    ID,
    INVERSE_MASS,
    KIND,
    ORIGIN_X,
    ORIGIN_Y,
    RADIUS,
    SPIN,
    SPREAD,
    TAU,
    TILE_SIDE,
    TILE_X,
    TILE_Y,
    TILES_X,
    TILES_Y,
    VX,
    VY,
    GasArrays,
    K,
    N,
    Rows,
    Table,
    X,
    Y,
    n_blocks,
    plain,
)
from .random import DRAWS
from .shear import flow_at, lab_x

# Columns of the small arrays that the host hands over. `when`: time and length of the step. `counter_words`: number of
# the step (low, high word), index of the force, seed (low, high word).
TIME, DT = range(2)
STEP_LOW, STEP_HIGH, INDEX, SEED_LOW, SEED_HIGH = range(5)


@ti.func
def arrived(s, time, gas: ti.template()):
    """What a force may know of the disk at slot s, once that has flown to the end of the epoch, at `time`.

    Velocities are those in the mean flow, if there is one.
    """
    dt = gas.scale[DURATION] - gas.flight[s][TAU]
    gas.flight[s][X] = gas.flight[s][X] + gas.flight[s][VX] * dt
    gas.flight[s][Y] = gas.flight[s][Y] + gas.flight[s][VY] * dt
    gas.flight[s][TAU] = gas.scale[DURATION]
    tile = gas.cell[s] // (gas.grid[CELLS_X] * gas.grid[CELLS_Y])
    x = (tile // gas.grid[TILES_Y]) * gas.scale[TILE_X] + gas.flight[s][X]
    y = (tile % gas.grid[TILES_Y]) * gas.scale[TILE_Y] + gas.flight[s][Y]
    length_x, length_y = gas.grid[TILES_X] * gas.scale[TILE_X], gas.grid[TILES_Y] * gas.scale[TILE_Y]
    vx = gas.flight[s][VX]
    if ti.static(gas.uses.sheared):
        row = tile % gas.grid[TILES_Y]
        corner = (tile // gas.grid[TILES_Y]) * gas.clock[TILE_SIDE]
        lab, _boxes = lab_x(corner, gas.flight[s][X], row, time, gas)
        x = ti.cast(lab, float)
        vx -= flow_at(gas.flight[s][Y], gas)
    kind = gas.meta[s][KIND]
    mass = 1.0 / gas.kinds[kind][INVERSE_MASS]
    radius = gas.flight[s][RADIUS]
    return ti.Struct(
        x=x - length_x * ti.floor(x / length_x) - gas.scale[ORIGIN_X],
        y=y - length_y * ti.floor(y / length_y) - gas.scale[ORIGIN_Y],
        vx=vx,
        vy=gas.flight[s][VY],
        spin=gas.flight[s][SPIN],
        mass=mass,
        radius=radius,
        k=gas.kinds[kind][K],
        inertia=mass * radius * radius / gas.kinds[kind][K],
    )


@ti.func
def stream_of(s, counter_words: ti.template(), gas: ti.template()):
    """The stream of random numbers of the disk at slot s in this step (`random.py`)."""
    return ti.Vector([
        ti.cast(gas.meta[s][ID], ti.u32), counter_words[STEP_LOW], counter_words[STEP_HIGH],
        counter_words[INDEX] * ti.u32(DRAWS), counter_words[SEED_LOW], counter_words[SEED_HIGH],
    ], ti.u32)  # fmt: skip


@ti.func
def energy(mass, inertia, vx, vy, spin):
    """Kinetic energy of a disk, in double precision whatever the run computes in."""
    vx_, vy_, spin_ = ti.cast(vx, ti.f64), ti.cast(vy, ti.f64), ti.cast(spin, ti.f64)
    return 0.5 * (mass * (vx_ * vx_ + vy_ * vy_) + inertia * (spin_ * spin_))


def kernels_of(force, n_parameters):
    """Kernels of a class of forces with so many parameters: (sum its totals, apply it).

    Both take the disks as an epoch left them, and fly them to its end without sorting them anew. Sums over disks go by
    blocks of slots, and block by block: their rounding does not depend on threads.
    """
    act, measure = (
        function if hasattr(function, "_is_taichi_function") else ti.func(plain(function))
        for function in (force.act, force.measure)
    )
    n_totals = force.totals

    @ti.func
    def vector(values: ti.template(), count: ti.template()):
        # A vector has one entry at least.
        return ti.Vector(
            [ti.cast(values[j], float) for j in ti.static(range(count))] if ti.static(count > 0) else [0.0]
        )

    @ti.kernel
    def sum_totals(
        uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, flight: Rows, kinds: Rows, meta: Rows,
        cell: Rows, when: Rows, counter_words: Rows, parameters: Rows, block_sums: Table, totals: Rows,
    ):  # fmt: skip
        gas = ti.static(GasArrays(
            grid=grid, scale=scale, clock=clock, flight=flight, kinds=kinds, meta=meta, cell=cell,
            uses=uses,
        ))  # fmt: skip
        for item in range(SPREAD * n_blocks(gas.grid[N])):
            if item % SPREAD == 0:
                b = item // SPREAD
                total = ti.Vector([ti.cast(0.0, ti.f64) for _ in ti.static(range(n_totals))])
                for s in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                    step = ti.Struct(
                        time=ti.cast(when[TIME], float), dt=ti.cast(when[DT], float),
                        random=stream_of(s, counter_words, gas), totals=ti.Vector([0.0]),
                    )  # fmt: skip
                    total += measure(arrived(s, when[TIME], gas), step, vector(parameters, n_parameters))
                for j in ti.static(range(n_totals)):
                    block_sums[b, j] = total[j]
        for _ in range(1):
            for j in ti.static(range(n_totals)):
                totals[j] = 0.0
            for b in range(n_blocks(gas.grid[N])):
                for j in ti.static(range(n_totals)):
                    totals[j] += block_sums[b, j]

    @ti.kernel
    def apply_force(
        uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, flight: Rows, kinds: Rows, meta: Rows,
        cell: Rows, when: Rows, counter_words: Rows, parameters: Rows, block_sums: Table, totals: Rows, gained: Rows,
        flow_work: Rows,
    ):  # fmt: skip
        gas = ti.static(GasArrays(
            grid=grid, scale=scale, clock=clock, flight=flight, kinds=kinds, meta=meta, cell=cell,
            flow_work=flow_work, uses=uses,
        ))  # fmt: skip
        for item in range(SPREAD * n_blocks(gas.grid[N])):
            if item % SPREAD == 0:
                b = item // SPREAD
                gain = ti.cast(0.0, ti.f64)
                for s in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                    step = ti.Struct(
                        time=ti.cast(when[TIME], float), dt=ti.cast(when[DT], float),
                        random=stream_of(s, counter_words, gas), totals=vector(totals, n_totals),
                    )  # fmt: skip
                    disk = arrived(s, when[TIME], gas)
                    before = energy(disk.mass, disk.inertia, disk.vx, disk.vy, disk.spin)
                    vx, vy, spin = act(disk, step, vector(parameters, n_parameters))
                    flow = 0.0 * vx
                    if ti.static(gas.uses.sheared):
                        flow = flow_at(gas.flight[s][Y], gas)
                        vx += flow
                    gas.flight[s][VX] = vx
                    gas.flight[s][VY] = vy
                    gas.flight[s][SPIN] = spin
                    # What was stored may be rounded to single precision.
                    stored = gas.flight[s][VX]
                    if ti.static(gas.uses.sheared):
                        stored -= flow
                        # What the frame of the row sees of it beyond that is not the flow's doing (`flow.py`).
                        excess = disk.mass * flow * (stored - disk.vx)
                        gas.flow_work[gas.meta[s][ID]] += ti.cast(excess, ti.f64)
                    gain += (
                        energy(disk.mass, disk.inertia, stored, gas.flight[s][VY], gas.flight[s][SPIN])
                        - before
                    )
                block_sums[b, 0] = gain
        for _ in range(1):
            gained[0] = 0.0
            for b in range(n_blocks(gas.grid[N])):
                gained[0] += block_sums[b, 0]

    return sum_totals if n_totals > 0 else None, apply_force
