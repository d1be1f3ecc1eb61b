"""The kernels that apply a force to every disk: one pair of them for each class of forces."""

from typing import Any

from .language import Rows, Table, declared, spread_of_loops, ti
from .particle import listed_kind, round_products
from .random import DRAWS
from .readout import placed
from .records import NamedNumbers
from .shear import flow_at
from .signature import Arrays, kernel
from .windows import is_owned

OF_DISKS = "uses grid scale clock disk kind kinds meta tile edge_x edge_y when counter_words"
"""Arrays from which a force gets the disks, a step and random numbers."""
LEVELS = 3
"""Parts that a term of a sum is divided into (`sum_totals`)."""


@ti.func
def particle_view(s, tile, time, gas: ti.template()):
    """Quantities of a listed disk at `time`, as forces get them; velocities are relative to the mean flow."""
    disk = gas.disk[s]
    x, y, _boxes_x, _boxes_y, _frame, flow = placed(s, tile, time, gas)
    kind = listed_kind(s, gas)
    mass = 1.0 / gas.kinds[kind].inverse_mass
    radius = gas.kinds[kind].radius
    return ti.Struct(
        x=ti.cast(x, float),
        y=ti.cast(y, float),
        vx=disk.vx - ti.cast(flow, float),
        vy=disk.vy,
        spin=disk.spin,
        mass=mass,
        radius=radius,
        k=gas.kinds[kind].k,
        inertia=mass * radius * radius / gas.kinds[kind].k,
    )


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


@ti.func
def energy(mass, inertia, vx, vy, spin):
    """Kinetic energy of a disk, in double precision whatever the run computes in."""
    vx_, vy_, spin_ = ti.cast(vx, ti.f64), ti.cast(vy, ti.f64), ti.cast(spin, ti.f64)
    return 0.5 * (mass * (vx_ * vx_ + vy_ * vy_) + inertia * (spin_ * spin_))


def step_of(time: Any, dt: Any, free: Any, random: Any, totals: list[Any]) -> tuple[Any]:
    """Quantities of a step, as forces get them, for `ti.static`; `totals` only if the force has some."""
    given = {"totals": ti.Vector(totals)} if totals else {}
    return (ti.Struct(time=time, dt=dt, free=free, random=random, **given),)


def kernels_of(force: Any) -> tuple[Any, Any, Any]:
    """Kernels of a class of forces: sum its totals (None without totals), apply it, compile it for one disk."""
    act, measure = declared(force.act), declared(force.measure)
    names = tuple(force.parameters)
    return (
        _sum_totals_of(measure, force.totals, names) if force.totals else None,
        _apply_force_of(act, force.totals, names),
        _sample_force_of(act, measure, force.totals, names),
    )


def _sum_totals_of(measure: Any, n_totals: int, names: tuple[str, ...]) -> Any:
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
        given = ti.static((NamedNumbers(parameters, names),))[0]
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
                    terms = measure(particle_view(s, b, gas.when.time, gas), step, given)
                    for j in ti.static(range(n_totals)):
                        rest = ti.cast(terms[j], ti.f64)
                        found[j] = ti.max(found[j], ti.abs(rest))
                        for level in ti.static(range(LEVELS)):
                            part = (rest + rounder[level, j]) - rounder[level, j]
                            found[n_totals * (1 + level) + j] += part
                            rest -= part
                for j in ti.static(range(n_totals * (1 + LEVELS))):
                    tile_sums[b, j] = found[j]

    return sum_totals


def _apply_force_of(act: Any, n_totals: int, names: tuple[str, ...]) -> Any:
    """Kernel that applies a force.

    `tile_sums` gets for each tile the energy gained, and what frames of rows see of that beyond it (`shear.py`).
    """

    @kernel
    def apply_force(
        gas: Arrays(OF_DISKS),
        parameters: Rows, tile_sums: Table, totals: Rows,
    ):  # fmt: skip
        """Apply the force to every disk; sum what each tile gains."""
        given = ti.static((NamedNumbers(parameters, names),))[0]
        spread = ti.static(spread_of_loops())
        for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
            round_products(gas)
            if item % spread == 0 and is_owned(item // spread, gas) == 1:
                b = item // spread
                gain, excess = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
                first = gas.grid.part * gas.grid.room + gas.tile[b].start[gas.grid.part]
                for s in range(first, first + gas.tile[b].count[gas.grid.part]):
                    listed_disk = gas.disk[s]
                    step = ti.static(step_of(
                        ti.cast(gas.when.time, float), ti.cast(gas.when.dt, float), free_of(gas), stream_of(s, gas),
                        [totals[j] for j in ti.static(range(n_totals))],
                    ))[0]  # fmt: skip
                    body = particle_view(s, b, gas.when.time, gas)
                    before = energy(body.mass, body.inertia, body.vx, body.vy, body.spin)
                    new_vx, new_vy, new_spin = act(body, step, given)
                    vx, vy, spin = ti.cast(new_vx, float), ti.cast(new_vy, float), ti.cast(new_spin, float)
                    flow = 0.0 * vx
                    if ti.static(gas.uses.sheared):
                        flow = ti.cast(flow_at(listed_disk.y, gas), float)
                    listed_disk.vx, listed_disk.vy, listed_disk.spin = vx + flow, vy, spin
                    # What was stored may be rounded to single precision.
                    stored = listed_disk.vx - flow
                    gain += energy(body.mass, body.inertia, stored, listed_disk.vy, listed_disk.spin) - before
                    if ti.static(gas.uses.sheared):
                        # What the frame of the row sees of it beyond that is not the flow's doing (`shear.py`).
                        excess += ti.cast(body.mass * flow * (stored - body.vx), ti.f64)
                tile_sums[b, 1] = excess
                tile_sums[b, 0] = gain

    return apply_force


def _sample_force_of(act: Any, measure: Any, n_totals: int, names: tuple[str, ...]) -> Any:
    """Kernel that calls a force once."""

    @ti.kernel
    def sample_force(numbers: Rows, parameters: Rows):
        """Compile the force for one disk with placeholder numbers."""
        given = ti.static((NamedNumbers(parameters, names),))[0]
        for s in range(1):
            body = ti.Struct(
                x=numbers[s], y=numbers[s], vx=numbers[s], vy=numbers[s], spin=numbers[s], mass=numbers[s],
                radius=numbers[s], k=numbers[s], inertia=numbers[s],
            )  # fmt: skip
            random = ti.Vector([ti.cast(s, ti.u32) for _ in ti.static(range(6))], ti.u32)
            free = ti.Vector([numbers[s], numbers[s]])
            first = ti.static(step_of(numbers[s], numbers[s], free, random, []))[0]
            if ti.static(n_totals > 0):
                terms = measure(body, first, given)
                for j in ti.static(range(n_totals)):
                    numbers[s] += terms[j]
            step = ti.static(step_of(
                numbers[s], numbers[s], free, random, [numbers[s] for _ in ti.static(range(n_totals))],
            ))[0]  # fmt: skip
            vx, vy, spin = act(body, step, given)
            numbers[s] = vx + vy + spin

    return sample_force
