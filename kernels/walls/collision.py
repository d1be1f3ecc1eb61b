"""A collision of a disk with a wall: what it does to the disk, to a piston, and to the sums of walls."""

from ..columns import MECHANISM, TALLY, WALL_SUM
from ..laws.contact import ELASTIC, collided
from ..compiler.language import ti
from ..layout import BY_HEAT, BY_LAW, BY_REMEDY
from ..disks.particle import (
    add, advance_to, charge, just_collided, kind_of, note_speed, update_history_hash, watched_row, write_motion,
)  # fmt: skip
from ..disks.stress import add_energy, add_virial
from .images import as_partner, from_partner, position_at, wall_of
from .kinds import FREE, STILL
from .motion import turned_back, wall_motion, wall_turn
from .pistons import set_piston
from .shapes import reduced_radius_at, wall_vector
from .thermal import heat_given, thermal_velocity


@ti.func
def contact_at(i, image, t, region: ti.template(), gas: ti.template()):
    """The contact of the disk in slot i with an image of a wall at time t, in the lab.

    Unit normal towards the disk; velocity of the wall at the disk's centre, if it reached there as a rigid body; its
    angular velocity; displacement and speed along its direction; vector from what torques are about, the centre of its
    turn or the origin.
    """
    w = wall_of(image)
    wall = gas.walls[w]
    s, speed, _bound, _until = wall_motion(w, t, gas)
    x, y = position_at(i, image, region, gas)
    x += 0.5 * gas.scale.gx * t * t
    y += 0.5 * gas.scale.gy * t * t
    spin, at_x, at_y, angle = 0.0 * t, x, y, 0.0 * t
    if ti.static(gas.uses.turning_walls):
        angle, spin, _most, _turn_bound = wall_turn(w, t, gas)
        at_x, at_y = turned_back(w, x, y, s, angle, gas)
    nx, ny, _distance = wall_vector(w, at_x, at_y, s, gas)
    if ti.static(gas.uses.turning_walls):
        nx, ny = ti.cos(angle) * nx - ti.sin(angle) * ny, ti.sin(angle) * nx + ti.cos(angle) * ny
    ux = wall.motion.x * speed - ny * wall.surface_speed
    uy = wall.motion.y * speed + nx * wall.surface_speed
    if ti.static(gas.uses.turning_walls):
        if wall.turn.kind != STILL:
            x -= wall.turn.x + wall.motion.x * s
            y -= wall.turn.y + wall.motion.y * s
        # In the frame that moves and turns with the wall it is at rest, and the law sees the disk's spin against it:
        # the slip is that of the contact.
        ux -= spin * y
        uy += spin * x
    return ti.Struct(nx=nx, ny=ny, ux=ux, uy=uy, spin=spin, s=s, speed=speed, lever_x=x, lever_y=y)


@ti.func
def hit_wall(i, t, tile, region: ti.template(), gas: ti.template()):
    """Collide the disk in slot i at time t with the wall that it meets, in the lab; disks are in one that falls.

    Returns how (`contact.collided`).
    """
    info, motion = gas.event_info[i], gas.motion[i]
    image = from_partner(info.partner)
    w = wall_of(image)
    persistent = 0
    if ti.static(gas.uses.contact_time):
        persistent = just_collided(i, t, gas)
    if ti.static(gas.uses.latest_collision):
        gas.since[i] = t
    advance_to(i, t, gas)
    gx, gy = gas.scale.gx, gas.scale.gy
    contact = contact_at(i, image, t, region, gas)
    owner = w
    if ti.static(gas.uses.wall_pieces):
        owner = ti.cast(gas.walls[w].owner, ti.i32)
    before = ti.Struct(vx=motion.vx + gx * t, vy=motion.vy + gy * t, spin=motion.spin)
    after, gained, regime, lost = after_collision(i, w, t, before, persistent, contact, gas)
    motion.vx, motion.vy, motion.spin = after.vx - gx * t, after.vy - gy * t, after.spin
    if ti.static(gas.uses.histories):
        write_collision(i, w, owner, t, tile, before, after, gained, regime, contact, region, gas)
    if ti.static(gas.uses.dissipated):
        charge(i, MECHANISM.walls, lost.sum(), gas)
    update_history_hash(i, t, -1 - w, gas)
    note_speed(i, gas)
    info.last = as_partner(owner)
    gas.image_info[i].wall_collisions = gas.image_info[i].wall_collisions + 1
    if info.own_rank > 0:
        add(tile, TALLY.wall_collisions, 1.0, gas)
        if regime >= ELASTIC:
            add(tile, TALLY.elastics, 1.0, gas)
        if ti.static(gas.uses.ledger):
            add(tile, TALLY.losses.walls, lost.sum(), gas)
        add_to_sums(i, w, tile, before, after, gained, contact, gas)
        if ti.static(gas.uses.stress):
            kind = kind_of(i, gas)
            radius = gas.kinds[kind].radius
            add_virial(
                tile, gas.kinds[kind].mass, after.vx - before.vx, after.vy - before.vy,
                radius * contact.nx, radius * contact.ny, gas,
            )  # fmt: skip
            if ti.static(gas.uses.heat_flux):
                add_energy(
                    tile, kind, after.vx - before.vx, after.vy - before.vy, after.spin - before.spin,
                    after.vx + before.vx, after.vy + before.vy, after.spin + before.spin,
                    radius * contact.nx, radius * contact.ny, gas,
                )  # fmt: skip
    return regime


@ti.func
def after_collision(i, w, t, before: ti.template(), persistent, contact: ti.template(), gas: ti.template()):
    """Velocity and spin of the disk in slot i after a collision; the speed that a piston gained; how, and what it
    took (`contact.collided`)."""
    wall, kind = gas.walls[w], kind_of(i, gas)
    p, q = ti.cast(gas.kinds[kind].material, ti.i32), ti.cast(wall.material, ti.i32)
    radius = gas.kinds[kind].radius
    relative_spin = before.spin
    if ti.static(gas.uses.turning_walls):
        relative_spin -= contact.spin
    inverse_w, k_w = 0.0 * t, 1.0 + 0.0 * t
    if ti.static(gas.uses.pistons):
        if wall.motion.kind == FREE:
            inverse_w, k_w = wall.piston.inverse_mass, -1.0 + 0.0 * t
    new, regime, lost = collided(
        p, q, -contact.nx, -contact.ny, gas.kinds[kind].inverse_mass, radius, gas.kinds[kind].k, before.vx, before.vy,
        relative_spin, inverse_w, radius, k_w, contact.ux, contact.uy, 0.0, reduced_radius_at(w, radius, gas),
        persistent, gas,
    )  # fmt: skip
    after = ti.Struct(vx=new.vx_i, vy=new.vy_i, spin=new.w_i)
    gained = 0.0 * t  # by a piston, whose surface runs on
    if ti.static(gas.uses.pistons):
        if wall.motion.kind == FREE:
            gained = (new.vx_j - contact.ux) * wall.motion.x + (new.vy_j - contact.uy) * wall.motion.y
            set_piston(w, t, contact.s, contact.speed + gained, gas)
    if ti.static(gas.uses.thermal_walls):
        if wall.temperature > 0.0:
            after.vx, after.vy, after.spin = thermal_velocity(
                i, wall.temperature, contact.nx, contact.ny, contact.ux, contact.uy, gas
            )
            regime = 0
            lost = ti.Vector([0.0, 0.0, 0.0, 0.0], ti.f64)  # what it took or gave is heat
    if ti.static(gas.uses.turning_walls):
        after.spin += contact.spin
    return after, gained, regime, lost


@ti.func
def write_collision(
    i, w, owner, t, tile, before: ti.template(), after: ti.template(), gained, regime, contact: ti.template(),
    region: ti.template(), gas: ti.template(),
):  # fmt: skip
    """Record a collision with wall w, if the disk in slot i is tracked. The wall's velocity is that in the lab."""
    row = watched_row(i, t, tile, region, gas)
    if row >= 0:
        wall, kind = gas.walls[w], kind_of(i, gas)
        radius = gas.kinds[kind].radius
        nx, ny = contact.nx, contact.ny
        fall_x, fall_y = gas.scale.gx * t, gas.scale.gy * t
        gas.event[row].normal[0], gas.event[row].normal[1] = -nx, -ny
        wx, wy = contact.ux - fall_x, contact.uy - fall_y
        if ti.static(gas.uses.turning_walls):  # at the contact
            wx += contact.spin * radius * ny
            wy -= contact.spin * radius * nx
        one = ti.Vector([before.vx - fall_x, before.vy - fall_y, before.spin, wx, wy, 0.0 * t])
        if ti.static(gas.uses.pistons):
            wx += wall.motion.x * gained
            wy += wall.motion.y * gained
        other = ti.Vector([after.vx - fall_x, after.vy - fall_y, after.spin, wx, wy, 0.0 * t])
        write_motion(row, t, 0, one, other, gas)
        gas.event_int[row].partner = -2 - owner
        gas.event_int[row].regime = ti.select(regime >= ELASTIC, BY_REMEDY, BY_LAW)
        if ti.static(gas.uses.thermal_walls):
            if wall.temperature > 0.0:
                gas.event_int[row].regime = BY_HEAT


@ti.func
def add_to_sums(
    i,
    w,
    tile,
    before: ti.template(),
    after: ti.template(),
    gained,
    contact: ti.template(),
    gas: ti.template(),
):
    """Add what wall w gave to the disk in slot i: work, heat, and its own sums."""
    wall, kind = gas.walls[w], kind_of(i, gas)
    inverse_mass = gas.kinds[kind].inverse_mass
    ux, uy = contact.ux, contact.uy
    # A wall works on what it pushes: the impulse times its own velocity, of a piston the mean of before and after.
    if ti.static(gas.uses.pistons):
        ux += 0.5 * wall.motion.x * gained
        uy += 0.5 * wall.motion.y * gained
    work = ti.cast(((after.vx - before.vx) * ux + (after.vy - before.vy) * uy) / inverse_mass, ti.f64)
    if ti.static(gas.uses.turning_walls):
        work += turning_impulse(kind, after.spin - before.spin, gas) * contact.spin
    add(tile, TALLY.wall_work, work, gas)
    heat = ti.cast(0.0, ti.f64)
    if ti.static(gas.uses.thermal_walls):
        column = ti.cast(wall.heat, ti.i32)
        if column >= 0:
            heat = heat_given(
                kind, after.vx - ux, after.vy - uy, after.spin - contact.spin,
                before.vx - ux, before.vy - uy, before.spin - contact.spin, gas,
            )  # fmt: skip
            add(tile, TALLY.width + column, heat, gas)
    if ti.static(gas.uses.wall_sums):
        gained_x = ti.cast((after.vx - before.vx) / inverse_mass, ti.f64)
        gained_y = ti.cast((after.vy - before.vy) / inverse_mass, ti.f64)
        turned = turning_impulse(kind, after.spin - before.spin, gas)
        first = TALLY.width + ti.cast(wall.sums, ti.i32)
        add(tile, first + WALL_SUM.momentum_x, gained_x, gas)
        add(tile, first + WALL_SUM.momentum_y, gained_y, gas)
        add(
            tile,
            first + WALL_SUM.torque,
            contact.lever_x * gained_y - contact.lever_y * gained_x + turned,
            gas,
        )
        add(tile, first + WALL_SUM.work, work, gas)
        add(tile, first + WALL_SUM.heat, heat, gas)
        add(tile, first + WALL_SUM.hits, 1.0, gas)


@ti.func
def turning_impulse(kind, gained, gas: ti.template()):
    """Angular momentum of a spin that a disk of this kind gained. In double precision."""
    radius = ti.cast(gas.kinds[kind].radius, ti.f64)
    k, inverse_mass = ti.cast(gas.kinds[kind].k, ti.f64), ti.cast(gas.kinds[kind].inverse_mass, ti.f64)
    return radius * radius / (k * inverse_mass) * gained
