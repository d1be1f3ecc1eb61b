"""Forces that act within a window: events at which disks get new velocities.

They are for forces that look at one disk only, so that copies of a disk in the halos of other tiles move as the disk
itself. Positions are rounded to the grid there, as at a collision. A force in steps acts on all disks of a region at
one time, and all search for their next events again. A force at random times acts on one disk, which then does so.

Rows of `kicks` are steps of forces, in order; those that act at one time have the very same `time`. All their numbers
are given before the window: totals too, of forces whose totals do not depend on the motion.
"""

from typing import Any

from ..columns import FORCE_VALUES, LEVELS, TALLY
from ..disks.flights import on_grid
from ..compiler.language import ti
from ..tiles.grid import place_of
from ..layout import BY_LAW, KICKED, NOT_FINITE, NOT_FINITE_ALONE
from ..disks.particle import add, fly_to, kind_of, note_speed, void_latest_partner, watched_row, write_motion
from ..random import DRAWS, normals
from ..compiler.records import NamedNumbers, more_of
from ..disks.shear import flow_at
from ..disks.force_times import action_stream, interval, next_action


@ti.func
def kick_time(row, gas: ti.template()):
    """Time since the window's beginning at which the force of a row of `kicks` acts."""
    return ti.cast(gas.kicks[row].time - gas.clock.begin, float)


@ti.func
def horizon_of(row, gas: ti.template()):
    """Time up to which events are predicted before the forces of a row of `kicks` act, or the window ends."""
    horizon = gas.scale.window
    if ti.static(gas.uses.forced):
        horizon = ti.min(kick_time(row, gas), horizon)
    return horizon


@ti.func
def first_horizon(gas: ti.template()):
    """As `horizon_of`, at the window's beginning."""
    horizon = gas.scale.window
    if ti.static(gas.uses.forced):
        horizon = horizon_of(ti.cast(gas.clock.acted, ti.i32), gas)
    return horizon


@ti.func
def energy(mass, inertia, vx, vy, spin):
    """Kinetic energy of a disk, in double precision whatever the run computes in."""
    vx_, vy_, spin_ = ti.cast(vx, ti.f64), ti.cast(vy, ti.f64), ti.cast(spin, ti.f64)
    return 0.5 * (mass * (vx_ * vx_ + vy_ * vy_) + inertia * (spin_ * spin_))


def step_of(
    time: Any,
    dt: Any,
    free: Any,
    random: Any,
    totals: list[Any],
    share: Any = None,
    pair: Any = None,
    draws_pair: bool = False,
) -> tuple[Any]:
    """Quantities of a step, as forces get them, for `ti.static`.

    `totals` and `share` are given only if the force has totals, `pair` only if it `draws_pair`.
    """
    given = {"totals": ti.Vector(totals), "share": share} if totals else {}
    given |= {"pair": pair} if draws_pair else {}
    return (ti.Struct(time=time, dt=dt, free=free, random=random, **given),)


@ti.func
def position_in_box(i, t, tile, gas: ti.template()):
    """Position in the box of the disk in slot i at time t: the same bits in all tiles that have a copy of it.

    The drop under gravity is rounded to the grid, so that all sums are exact. Not of a sheared box.
    """
    tx, ty = place_of(tile, gas)
    x = gas.edge_x[tx] + ti.cast(gas.motion[i].x + on_grid(0.5 * gas.scale.gx * t * t, gas), ti.f64)
    y = gas.edge_y[ty] + ti.cast(gas.motion[i].y + on_grid(0.5 * gas.scale.gy * t * t, gas), ti.f64)
    if gas.grid.periodic_x == 1:
        length = gas.edge_x[gas.grid.tiles_x]
        x -= ti.floor(x / length) * length
    if gas.grid.periodic_y == 1:
        length = gas.edge_y[gas.grid.tiles_y]
        y -= ti.floor(y / length) * length
    return ti.cast(x, float), ti.cast(y, float)


@ti.func
def flow_in_frame(i, gas: ti.template()):
    """Velocity of the flow at the disk in slot i, in the frame that its velocity is measured in."""
    flow = 0.0 * gas.scale.window
    if ti.static(gas.uses.shear):
        height = ti.cast(gas.edge_y[1], float)
        flow = ti.cast(flow_at(gas.motion[i].y - gas.event_info[i].shear_row * height, gas), float)
    return flow


@ti.func
def add_gain(gains: ti.template(), number: ti.template(), gain, gas: ti.template()):
    """Add the energy that a force gave to a disk, in parts whose sums are exact, in any order of the disks."""
    rounder = gas.clock.gain_unit * gas.clock.square_unit
    for level in ti.static(range(LEVELS)):
        part = (gain + rounder) - rounder
        gains[LEVELS * number + level] += part
        gain -= part
        rounder *= gas.clock.gain_step


@ti.func
def write_kick(i, t, vx, vy, spin, tile, region: ti.template(), gas: ti.template()):
    """Write a row of `event` for the disk in slot i if it is tracked and a force has changed this motion of it."""
    motion = gas.motion[i]
    if vx != motion.vx or vy != motion.vy or spin != motion.spin:
        row = watched_row(i, t, tile, region, gas)
        if row >= 0:
            gas.event[row].normal[0], gas.event[row].normal[1] = 0.0 * t, 0.0 * t
            before = ti.Vector([vx, vy, spin, 0.0 * t, 0.0 * t, 0.0 * t])
            after = ti.Vector([motion.vx, motion.vy, motion.spin, 0.0 * t, 0.0 * t, 0.0 * t])
            write_motion(row, t, 0, before, after, gas)
            gas.event_int[row].partner, gas.event_int[row].regime = KICKED, BY_LAW


@ti.func
def act_on_all(n, first, end, t, thread, team, tile, region: ti.template(), gas: ti.template()):
    """Apply the forces of rows `first` to `end` - 1 of `kicks` to the n disks of a region, at time t of the window.

    A `team` of threads shares the disks.
    """
    offset = region.lane * gas.grid.lane_slots + thread
    many = (n - thread + team - 1) // team
    gains = ti.Vector([0.0] * gas.uses.gains, ti.f64)
    for row in range(first, end):
        for force in ti.static(gas.uses.forces):
            if ti.static(force.draws_pair):
                if ti.cast(gas.kicks[row].force, ti.i32) == force.number:
                    draw_pairs(offset, many, team, row, gas)
        for m in range(many):
            i = offset + team * m
            if row == first:
                fly_to(i, t, gas)
                void_latest_partner(i, gas)
            motion = gas.motion[i]
            vx, vy, spin = motion.vx, motion.vy, motion.spin
            act_on(i, row, t, tile, gains, gas)
            note_speed(i, gas)
            if ti.static(gas.uses.histories):
                write_kick(i, t, vx, vy, spin, tile, region, gas)
    add_gains(gains, tile, gas)


@ti.func
def draw_pairs(offset, many, team, row, gas: ti.template()):
    """Draw the first pair of normal random numbers of the disks of a thread for a row of `kicks`.

    A separate loop takes half of the time of draws within the loop of the force, because a processor works on several
    disks at a time (`ifrdem/docs/results/forces.md`). The numbers are stored in the times of events, which all disks
    predict again after the force.
    """
    for m in range(many):
        i = offset + team * m
        pair = normals(stream_of_row(i, row, gas), 0)
        gas.motion[i].t_hit, gas.motion[i].t_leave = pair[0], pair[1]


@ti.func
def stream_of_row(i, row, gas: ti.template()):
    """The stream of random numbers (`random.py`) of the disk in slot i in the step of a row of `kicks`."""
    kick = gas.kicks[row]
    number = ti.cast(kick.number, ti.i64)
    return ti.Vector([
        ti.cast(gas.event_info[i].id, ti.u32), ti.cast(number, ti.u32), ti.cast(number >> ti.i64(32), ti.u32),
        ti.cast(kick.index, ti.u32) * ti.u32(DRAWS), ti.cast(gas.grid.seed_low, ti.u32),
        ti.cast(gas.grid.seed_high, ti.u32),
    ], ti.u32)  # fmt: skip


def parameters_of(force: Any, values: Any) -> tuple[Any]:
    """The parameters of a force within windows, by name, for `ti.static`."""
    return (NamedNumbers(values, force.names, FORCE_VALUES.width + force.first_parameter, force.n_bounds),)


@ti.func
def disk_of(kind, number, x, y, vx, vy, spin, given, gas: ti.template()):
    """A disk as forces get it, of a kind and with an id `number`. `given` has the first ids of species."""
    mass = 1.0 / gas.kinds[kind].inverse_mass
    radius = gas.kinds[kind].radius
    species = 0
    for bound in ti.static(more_of(given)):
        species += ti.cast(ti.cast(number, ti.f64) >= bound, ti.i32)
    return ti.Struct(
        x=x, y=y, vx=vx, vy=vy, spin=spin, mass=mass, radius=radius, k=gas.kinds[kind].k,
        inertia=mass * radius * radius / gas.kinds[kind].k,
        id=ti.cast(number, ti.i32), species=species, material=ti.cast(gas.kinds[kind].material, ti.i32),
    )  # fmt: skip


@ti.func
def motionless(kind, number, given, gas: ti.template()):
    """A disk without its motion: NaN, so that a force that reads it is seen."""
    nan = ti.sqrt(-(1.0 / gas.kinds[kind].inverse_mass))
    return disk_of(kind, number, nan, nan, nan, nan, nan, given, gas)


@ti.func
def act_alone(i, t, tile, region: ti.template(), gas: ti.template()):
    """Apply the force whose time has come to the disk in slot i alone, at time t of the window.

    What others predicted for this disk is stale then, as after a collision of it.
    """
    gains = ti.Vector([0.0] * gas.uses.gains, ti.f64)
    fly_to(i, t, gas)
    void_latest_partner(i, gas)
    gas.event_info[i].number = gas.event_info[i].number + 1
    motion = gas.motion[i]
    vx, vy, spin = motion.vx, motion.vy, motion.spin
    for force in ti.static(gas.uses.forces):
        if ti.static(force.alone):
            if ti.cast(gas.action[i].force, ti.i32) == force.number:
                random = action_stream(i, force, gas)
                pair = ti.Vector([0.0 * t, 0.0 * t])
                if ti.static(force.draws_pair):
                    pair = normals(random, 0)
                step = ti.static(step_of(
                    ti.cast(gas.action[i].time, float), ti.cast(interval(force, gas), float), free_of(gas), random, [],
                    pair, pair, force.draws_pair,
                ))[0]  # fmt: skip
                change(i, t, step, NOT_FINITE_ALONE + force.number, tile, force, gains, gas)
    note_speed(i, gas)
    if ti.static(gas.uses.histories):
        write_kick(i, t, vx, vy, spin, tile, region, gas)
    next_action(i, gas)
    add_gains(gains, tile, gas)


@ti.func
def free_of(gas: ti.template()):
    """1 for x and y where the whole gas can drift, else 0."""
    return ti.Vector([ti.cast(gas.force_values.free_x, float), ti.cast(gas.force_values.free_y, float)])


@ti.func
def add_gains(gains: ti.template(), tile, gas: ti.template()):
    """Add energies that forces gave to the tally of a tile."""
    for column in ti.static(range(gas.uses.gains)):
        add(tile, gas.tally.shape[2] - gas.uses.gains + column, gains[column], gas)


@ti.func
def act_on(i, row, t, tile, gains: ti.template(), gas: ti.template()):
    """Apply the force of a row of `kicks` to the disk in slot i, and add up what it gains if it is an own one."""
    kick, random = gas.kicks[row], stream_of_row(i, row, gas)
    for force in ti.static(gas.uses.forces):
        if ti.static(not force.alone):
            if ti.cast(kick.force, ti.i32) == force.number:
                time, dt, free = (
                    ti.cast((kick.number + 0.5) * kick.dt, float),
                    ti.cast(kick.dt, float),
                    free_of(gas),
                )
                share = ti.Vector([0.0 * t for _ in ti.static(range(max(force.n_totals, 1)))])
                if ti.static(force.n_totals > 0):
                    stored = ti.cast(kick.shares, ti.i32)
                    if stored >= 0:
                        for j in ti.static(range(force.n_totals)):
                            share[j] = gas.shares[stored + gas.event_info[i].id * force.n_totals + j]
                    else:
                        given = ti.static(parameters_of(force, gas.force_values))[0]
                        first = ti.static(step_of(time, dt, free, random, []))[0]
                        terms = force.measure(
                            motionless(kind_of(i, gas), gas.event_info[i].id, given, gas), first, given
                        )
                        for j in ti.static(range(force.n_totals)):
                            share[j] = ti.cast(terms[j], float)
                pair = ti.Vector([gas.motion[i].t_hit, gas.motion[i].t_leave])
                step = ti.static(step_of(
                    time, dt, free, random, [kick.totals[j] for j in range(force.n_totals)], share,
                    pair, force.draws_pair,
                ))[0]  # fmt: skip
                change(i, t, step, NOT_FINITE + row, tile, force, gains, gas)


@ti.func
def change(i, t, step, mark, tile, force: ti.template(), gains: ti.template(), gas: ti.template()):
    """Change velocity and spin of the disk in slot i by a force, and add up what it gains if it is an own one.

    `mark` is for `counter.stalled` if the change is not finite.
    """
    motion = gas.motion[i]
    kind = kind_of(i, gas)
    x, y = position_in_box(i, t, tile, gas)
    fall_x, fall_y = gas.scale.gx * t, gas.scale.gy * t
    flow = flow_in_frame(i, gas)
    given = ti.static(parameters_of(force, gas.force_values))[0]
    body = disk_of(
        kind,
        gas.event_info[i].id,
        x,
        y,
        motion.vx + fall_x - flow,
        motion.vy + fall_y,
        motion.spin,
        given,
        gas,
    )
    new_vx, new_vy, new_spin = force.act(body, step, given)
    motion.vx = ti.cast(new_vx, float) + flow - fall_x
    motion.vy, motion.spin = ti.cast(new_vy, float) - fall_y, ti.cast(new_spin, float)
    if gas.event_info[i].own_rank > 0:
        # What was stored may be rounded, to single precision or with the fall.
        stored_x, stored_y = motion.vx + fall_x - flow, motion.vy + fall_y
        gain = energy(body.mass, body.inertia, stored_x, stored_y, motion.spin)
        gain -= energy(body.mass, body.inertia, body.vx, body.vy, body.spin)
        add_gain(gains, force.number, gain, gas)
        if not gain - gain == 0.0:
            ti.atomic_max(gas.counter.stalled, mark)
        if ti.static(gas.uses.shear):
            # What the frame of the row sees of it beyond that is not the flow's doing (`disks/shear.py`).
            add(tile, TALLY.flow_work, ti.cast(body.mass * flow * (stored_x - body.vx), ti.f64), gas)
