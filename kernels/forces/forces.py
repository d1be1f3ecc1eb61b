"""The kernels that apply a force to every disk at a window's beginning: some for each class of forces.

`force_events.py` applies forces within windows.
"""

from typing import Any, NamedTuple

from ..columns import LEVELS
from .force_events import disk_of, energy, motionless, step_of
from ..compiler.language import Cube, Rows, Table, declared, spread_of_loops, ti
from ..disks.particle import listed_kind, round_products
from ..random import DRAWS, normals
from ..tiles.readout import placed
from ..compiler.records import NamedNumbers, more_of
from ..disks.shear import flow_at
from ..compiler.signature import Arrays, kernel
from ..tiles.sums import is_owned

OF_DISKS = "uses grid scale clock disk kind kinds meta tile edge_x edge_y when counter_words"
"""Arrays from which a force gets the disks, a step and random numbers."""


@ti.func
def particle_view(s, tile, time, given, gas: ti.template()):
    """A listed disk at `time`, as forces get it; velocities are relative to the mean flow."""
    disk = gas.disk[s]
    here = placed(s, tile, time, gas)
    x, y, flow = here.x, here.y, here.flow
    return disk_of(
        listed_kind(s, gas), gas.meta[s].id, ti.cast(x, float), ti.cast(y, float),
        disk.vx - ti.cast(flow, float), disk.vy, disk.spin, given, gas,
    )  # fmt: skip


@ti.func
def stream_of(s, gas: ti.template()):
    """The stream of random numbers of a listed disk in this step (`random.py`)."""
    return ti.Vector([
        ti.cast(gas.meta[s].id, ti.u32), gas.counter_words.step_low, gas.counter_words.step_high,
        gas.counter_words.index * ti.u32(DRAWS), gas.counter_words.seed_low, gas.counter_words.seed_high,
    ], ti.u32)  # fmt: skip


@ti.func
def free_of(gas: ti.template()):
    """1 for x and y where the whole gas can drift, else 0."""
    return ti.Vector([ti.cast(gas.when.free_x, float), ti.cast(gas.when.free_y, float)])


class ForceKernels(NamedTuple):
    """Kernels of a class of forces: they sum totals, at a moment and of steps ahead; apply it; sample it on one disk,
    and on disks at rest."""

    sum_totals: Any
    sum_ahead: Any
    apply_force: Any
    sample_force: Any
    kick_from_rest: Any


def kernels_of(force: Any, n_bounds: int = 0) -> ForceKernels:
    """Kernels of a class of forces; for sums they are compiled only if it has totals.

    `n_bounds` first ids of species follow its parameters.
    """
    act, measure = declared(force.act), declared(force.measure)
    names = (*force.parameters, *force.constants)

    def given_of(parameters: Any) -> tuple[Any]:
        return (NamedNumbers(parameters, names, 0, n_bounds),)

    return ForceKernels(
        _sum_totals_of(measure, force.totals, given_of),
        _sum_ahead_of(measure, force.totals, given_of),
        _apply_force_of(act, measure, force.totals, given_of, force.draws_pair),
        _sample_force_of(act, measure, force.totals, given_of, force.draws_pair),
        _kick_from_rest_of(act, given_of, force.draws_pair),
    )


@ti.func
def add_term(found: ti.template(), terms: ti.template(), rounders: ti.template(), n_totals: ti.template()):
    """Add the terms of a disk to the largest sizes of terms, and parts of them to sums: see `_sum_totals_of`."""
    for j in ti.static(range(n_totals)):
        rest = ti.cast(terms[j], ti.f64)
        found[j] = ti.max(found[j], ti.abs(rest))
        for level in ti.static(range(LEVELS)):
            part = (rest + rounders[level, j]) - rounders[level, j]
            found[n_totals * (1 + level) + j] += part
            rest -= part


def _sum_ahead_of(measure: Any, n_totals: int, given_of: Any) -> Any:
    """Kernel that sums the terms of a force in many steps, which do not depend on the motion.

    `tile_sums` gets for each tile and step what that of `_sum_totals_of` gets for a tile. `shares` gets the terms, in
    order of steps, ids and totals, from number `stored` on, unless that is negative.
    """

    @kernel
    def sum_ahead(
        stored: ti.i32,
        gas: Arrays(OF_DISKS + " shares"),
        parameters: Rows, steps: Rows, tile_sums: Cube, rounders: Table,
    ):  # fmt: skip
        """Sum the force's terms over the disks of each tile, in steps with these numbers."""
        given = ti.static(given_of(parameters))[0]
        spread = ti.static(spread_of_loops())
        for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y * steps.shape[0]):
            round_products(gas)
            b = item // (spread * steps.shape[0])
            m = item // spread - b * steps.shape[0]
            if item % spread == 0 and is_owned(b, gas) == 1:
                found = ti.Vector([ti.cast(0.0, ti.f64) for _ in ti.static(range(n_totals * (1 + LEVELS)))])
                rounder = ti.Matrix([
                    [rounders[level, j] for j in ti.static(range(n_totals))] for level in ti.static(range(LEVELS))
                ])  # fmt: skip
                number = ti.cast(steps[m], ti.i64)
                first = gas.grid.part * gas.grid.room + gas.tile[b].start[gas.grid.part]
                for s in range(first, first + gas.tile[b].count[gas.grid.part]):
                    stream = stream_of(s, gas)
                    stream[1], stream[2] = ti.cast(number, ti.u32), ti.cast(number >> ti.i64(32), ti.u32)
                    step = ti.static(step_of(
                        ti.cast((steps[m] + 0.5) * gas.when.dt, float), ti.cast(gas.when.dt, float), free_of(gas),
                        stream, [],
                    ))[0]  # fmt: skip
                    terms = measure(motionless(listed_kind(s, gas), gas.meta[s].id, given, gas), step, given)
                    add_term(found, terms, rounder, n_totals)
                    if stored >= 0:
                        row = stored + (m * gas.grid.n + gas.meta[s].id) * n_totals
                        for j in ti.static(range(n_totals)):
                            gas.shares[row + j] = ti.cast(terms[j], float)
                for j in ti.static(range(n_totals * (1 + LEVELS))):
                    tile_sums[b, m, j] = found[j]

    return sum_ahead


def _sum_totals_of(measure: Any, n_totals: int, given_of: Any) -> Any:
    """Kernel that sums the terms of a force.

    Totals change the motion, so their bits may not depend on the order of the disks. `tile_sums` gets for each tile,
    of this rank's where there are several:

    - for each total, the largest size of a term;
    - for each of LEVELS and total, the sum of parts of terms. A part is what adding `rounders[level, total]` rounds a
      term to; its rest goes to the next level. Parts are multiples of a power of two, and their sums exact.
    """

    @kernel
    def sum_totals(
        gas: Arrays(OF_DISKS),
        parameters: Rows, tile_sums: Table, rounders: Table,
    ):  # fmt: skip
        """Sum the force's terms over the disks of each tile."""
        given = ti.static(given_of(parameters))[0]
        spread = ti.static(spread_of_loops())
        for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
            round_products(gas)
            if item % spread == 0 and is_owned(item // spread, gas) == 1:
                b = item // spread
                found = ti.Vector([ti.cast(0.0, ti.f64) for _ in ti.static(range(n_totals * (1 + LEVELS)))])
                rounder = ti.Matrix([
                    [rounders[level, j] for j in ti.static(range(n_totals))] for level in ti.static(range(LEVELS))
                ])  # fmt: skip
                first = gas.grid.part * gas.grid.room + gas.tile[b].start[gas.grid.part]
                for s in range(first, first + gas.tile[b].count[gas.grid.part]):
                    step = ti.static(step_of(
                        ti.cast(gas.when.time, float), ti.cast(gas.when.dt, float), free_of(gas), stream_of(s, gas), [],
                    ))[0]  # fmt: skip
                    terms = measure(particle_view(s, b, gas.when.time, given, gas), step, given)
                    add_term(found, terms, rounder, n_totals)
                for j in ti.static(range(n_totals * (1 + LEVELS))):
                    tile_sums[b, j] = found[j]

    return sum_totals


def _apply_force_of(act: Any, measure: Any, n_totals: int, given_of: Any, draws_pair: bool) -> Any:
    """Kernel that applies a force.

    `tile_sums` gets for each tile the energy gained, and what frames of rows see of that beyond it (`disks/shear.py`).
    """

    @kernel
    def apply_force(
        gas: Arrays(OF_DISKS),
        parameters: Rows, tile_sums: Table, totals: Rows,
    ):  # fmt: skip
        """Apply the force to every disk; sum what each tile gains."""
        given = ti.static(given_of(parameters))[0]
        spread = ti.static(spread_of_loops())
        for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
            round_products(gas)
            if item % spread == 0 and is_owned(item // spread, gas) == 1:
                b = item // spread
                gain, excess = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
                first = gas.grid.part * gas.grid.room + gas.tile[b].start[gas.grid.part]
                for s in range(first, first + gas.tile[b].count[gas.grid.part]):
                    listed_disk = gas.disk[s]
                    time, dt = ti.cast(gas.when.time, float), ti.cast(gas.when.dt, float)
                    body = particle_view(s, b, gas.when.time, given, gas)
                    share = ti.Vector([0.0 * dt for _ in ti.static(range(max(n_totals, 1)))])
                    if ti.static(n_totals > 0):
                        summed = ti.static(step_of(time, dt, free_of(gas), stream_of(s, gas), []))[0]
                        terms = measure(body, summed, given)
                        for j in ti.static(range(n_totals)):
                            share[j] = ti.cast(terms[j], float)
                    pair = ti.Vector([0.0 * dt, 0.0 * dt])
                    if ti.static(draws_pair):
                        pair = normals(stream_of(s, gas), 0)
                    step = ti.static(step_of(
                        time, dt, free_of(gas), stream_of(s, gas),
                        [totals[j] for j in ti.static(range(n_totals))], share, pair, draws_pair,
                    ))[0]  # fmt: skip
                    before = energy(body.mass, body.inertia, body.vx, body.vy, body.spin)
                    new_vx, new_vy, new_spin = act(body, step, given)
                    vx, vy, spin = ti.cast(new_vx, float), ti.cast(new_vy, float), ti.cast(new_spin, float)
                    flow = 0.0 * vx
                    if ti.static(gas.uses.shear):
                        flow = ti.cast(flow_at(listed_disk.y, gas), float)
                    listed_disk.vx, listed_disk.vy, listed_disk.spin = vx + flow, vy, spin
                    # What was stored may be rounded to single precision.
                    stored = listed_disk.vx - flow
                    gain += energy(body.mass, body.inertia, stored, listed_disk.vy, listed_disk.spin) - before
                    if ti.static(gas.uses.shear):
                        # What the frame of the row sees of it beyond that is not the flow's doing (`disks/shear.py`).
                        excess += ti.cast(body.mass * flow * (stored - body.vx), ti.f64)
                tile_sums[b, 1] = excess
                tile_sums[b, 0] = gain

    return apply_force


def _sample_force_of(act: Any, measure: Any, n_totals: int, given_of: Any, draws_pair: bool) -> Any:
    """Kernel that calls a force once."""

    @ti.kernel
    def sample_force(numbers: Rows, parameters: Rows):
        """Compile the force for one disk with placeholder numbers."""
        given = ti.static(given_of(parameters))[0]
        for s in range(1):
            body = ti.Struct(
                x=numbers[s], y=numbers[s], vx=numbers[s], vy=numbers[s], spin=numbers[s], mass=numbers[s],
                radius=numbers[s], k=numbers[s], inertia=numbers[s], id=s, species=s, material=s,
            )  # fmt: skip
            random = ti.Vector([ti.cast(s, ti.u32) for _ in ti.static(range(6))], ti.u32)
            free = ti.Vector([numbers[s], numbers[s]])
            first = ti.static(step_of(numbers[s], numbers[s], free, random, []))[0]
            if ti.static(n_totals > 0):
                terms = measure(body, first, given)
                for j in ti.static(range(n_totals)):
                    numbers[s] += terms[j]
            share = ti.Vector([numbers[s] for _ in ti.static(range(max(n_totals, 1)))])
            pair = ti.Vector([numbers[s], numbers[s]])
            step = ti.static(step_of(
                numbers[s], numbers[s], free, random, [numbers[s] for _ in ti.static(range(n_totals))], share,
                pair, draws_pair,
            ))[0]  # fmt: skip
            vx, vy, spin = act(body, step, given)
            numbers[s] = vx + vy + spin

    return sample_force


def _kick_from_rest_of(act: Any, given_of: Any, draws_pair: bool) -> Any:
    """Kernel that finds how fast a force without totals makes disks at rest."""

    @kernel
    def kick_from_rest(dt: ti.f64, gas: Arrays("uses kinds"), parameters: Rows, found: Rows):
        """Set the largest square of a speed that a disk of any kind and species has got in a few draws."""
        given = ti.static(given_of(parameters))[0]
        ti.loop_config(serialize=True)
        many = gas.kinds.shape[0]
        for draw in range(8 * many * ti.static(1 + len(more_of(given)))):
            zero = ti.cast(0.0, float)
            number = 0
            for j in ti.static(range(len(more_of(given)))):
                if draw // (8 * many) == j + 1:
                    number = ti.cast(ti.static(more_of(given))[j], ti.i32)
            body = disk_of(draw // 8 % many, number, zero, zero, zero, zero, zero, given, gas)
            random = ti.Vector([ti.cast(draw, ti.u32)] + [ti.u32(0) for _ in ti.static(range(5))], ti.u32)
            pair = normals(random, 0)
            step = ti.static(step_of(
                zero, ti.cast(dt, float), ti.Vector([zero, zero]), random, [], pair, pair, draws_pair
            ))[0]  # fmt: skip
            vx, vy, _spin = act(body, step, given)
            square = ti.cast(vx * vx + vy * vy, ti.f64)
            if square - square == 0.0:  # a number
                found[0] = ti.max(found[0], square)

    return kick_from_rest
