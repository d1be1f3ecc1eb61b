"""Disks by id and sums over all disks, at the beginning or end of a window or at a requested moment in it.

Also copies of small arrays, and of rows of others, between host and GPU.
"""

from ...quantities import FRAME
from ..columns import MECHANISM, READOUT, SMALL, first_word
from ..compiler.language import Rows, Table, has_numbers, spread_of_loops, ti, width
from .grid import place_of
from ..compiler.records import NamedVector
from ..layout import ASLEEP, ASLEEP_UNVERIFIED, SNAPSHOT
from ..disks.particle import listed_kind, round_products
from ..disks.shear import flow_at, frame_speed
from ..compiler.signature import Arrays, kernel


@ti.func
def own_slots(tile, part, gas: ti.template()):
    """Slots of the disks of a tile in a part: the first, and the one behind the last; none in one of another rank."""
    lists = part
    if part >= SNAPSHOT:
        lists = 1 - gas.grid.part  # the lists at a moment are those at the end
    first = part * gas.grid.room + gas.tile[tile].start[lists]
    last = first + gas.tile[tile].count[lists]
    if ti.static(gas.uses.ranks):
        if gas.tile[tile].owned == 0:
            last = first
    return first, last


@ti.func
def count_in(s, x, y, flow, total: ti.template(), gas: ti.template()):
    """Add a disk at a place in the box to the sums; nothing for a disk of infinite mass. In double precision.

    Kinetic energies and their flux, momentum, m v_x v_y and m v_x^2, mass times the place and the way along gravity,
    collisions with disks and walls. Velocities are those beyond the flow; then the excess of kinetic energy in the frames of rows of tiles, and
    the mass.
    """
    disk = gas.disk[s]
    kind = listed_kind(s, gas)
    mass = ti.cast(gas.kinds[kind].mass, ti.f64)
    vx, vy = ti.cast(disk.vx, ti.f64), ti.cast(disk.vy, ti.f64)
    spin = ti.cast(disk.spin, ti.f64)
    sums = NamedVector(total, READOUT)
    sums.all_events += gas.meta[s].events
    if ti.static(gas.uses.shear):
        sums.excess += flow * (vx - 0.5 * flow) * mass
        vx -= flow
    sums.momentum_x += mass * vx
    sums.momentum_y += mass * vy
    moving = 0.5 * mass * (vx * vx + vy * vy)
    spinning = 0.5 * ti.cast(gas.kinds[kind].inertia, ti.f64) * spin * spin
    sums.translational += moving
    sums.rotational += spinning
    sums.energy_flux_x += (moving + spinning) * vx
    sums.energy_flux_y += (moving + spinning) * vy
    sums.momentum_flux_xx += mass * vx * vx
    sums.momentum_flux_xy += mass * vx * vy
    sums.mass_x += mass * x
    sums.mass_y += mass * y
    sums.fall += (x * gas.scale.gx + y * gas.scale.gy) * mass
    sums.mass += mass


@ti.func
def placed(s, tile, time, gas: ti.template()):
    """Place in the box of a listed disk, boxes that it is away from there, velocities of its frame and the flow."""
    disk = gas.disk[s]
    tx, ty = place_of(tile, gas)
    x = gas.edge_x[tx] + ti.cast(disk.x, ti.f64)
    y = gas.edge_y[ty] + ti.cast(disk.y, ti.f64)
    boxes_x, boxes_y = 0, 0
    frame, flow = 0.0 * x, 0.0 * x
    if ti.static(gas.uses.shear):
        frame = frame_speed(ty, gas)
        flow = flow_at(disk.y, gas)
        x += frame * time
    if gas.grid.periodic_y == 1:
        length = gas.edge_y[gas.grid.tiles_y]
        if y < 0.0 or y >= length:
            boxes_y = ti.floor(y / length, ti.i32)
            y -= boxes_y * length
            if ti.static(gas.uses.shear):
                # The image in the box is in a row whose frame is slower by so many rows.
                slower = boxes_y * gas.grid.tiles_y * ti.cast(gas.scale.drift, ti.f64)
                x -= slower * time
                frame -= slower
    if gas.grid.periodic_x == 1:
        length = gas.edge_x[gas.grid.tiles_x]
        if x < 0.0 or x >= length:
            boxes_x = ti.floor(x / length, ti.i32)
            x -= boxes_x * length
    return ti.Struct(x=x, y=y, boxes_x=boxes_x, boxes_y=boxes_y, frame=frame, flow=flow)


def is_single(words):
    """True if the words of a frame are those of one in single precision."""
    return has_numbers(words, ti.u32)


@ti.func
def store_number(i, name: ti.template(), m: ti.template(), value, gas: ti.template()):
    """Write number `m` of a quantity of disk `i` into its frame: a real one in the precision of the frame."""
    single = ti.static(is_single(gas.frame_out))
    at = ti.static(first_word(name, gas.uses, single))
    if ti.static(FRAME[name].whole and single):
        gas.frame_out[i, at + m] = ti.bit_cast(ti.cast(value, ti.i32), ti.u32)
    elif ti.static(FRAME[name].whole):
        gas.frame_out[i, at + m] = ti.cast(value, ti.i32)
    elif ti.static(single):
        gas.frame_out[i, at + m] = ti.bit_cast(ti.cast(value, ti.f32), ti.u32)
    else:
        bits = ti.bit_cast(ti.cast(value, ti.f64), ti.i64)
        gas.frame_out[i, at + 2 * m] = ti.cast(bits, ti.i32)
        gas.frame_out[i, at + 2 * m + 1] = ti.cast(bits >> ti.i64(32), ti.i32)


@kernel
def read_out(
    part: ti.i32,
    time: ti.f64,
    filled: ti.i32,
    first_row: ti.i32,
    gas: Arrays(
        "uses grid scale clock disk meta past hits dissipated asleep kind kinds tile edge_x edge_y frame_out totals"
    ),
):
    """Write disks by id (of one rank of several, by slot), unless `filled` is 0, and the sums of each tile.

    `frame_out` (n, words) has rows from `first_row` on, of all or of some disks: rows of `frame_dtype` as words, u32 of frames in single precision, else i32;
    `latest_collision` counts from the window's beginning.
    `totals` (tiles, sums).
    """
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0:
            k = item // spread
            first, last = own_slots(k, part, gas)
            total = ti.Vector([0.0] * READOUT.width, ti.f64)
            for s in range(first, last):
                meta_row, listed_disk = gas.meta[s], gas.disk[s]
                here = placed(s, k, time, gas)
                x, y, boxes_x, boxes_y, frame = here.x, here.y, here.boxes_x, here.boxes_y, here.frame
                count_in(s, x, y, here.flow, total, gas)
                i = meta_row.id - first_row
                if ti.static(gas.uses.ranks):
                    i = s - part * gas.grid.room - first_row
                if filled == 1 and i >= 0 and i < gas.frame_out.shape[0]:
                    store_number(i, "position", 0, x, gas)
                    store_number(i, "position", 1, y, gas)
                    store_number(i, "velocity", 0, ti.cast(listed_disk.vx, ti.f64) + frame, gas)
                    store_number(i, "velocity", 1, listed_disk.vy, gas)
                    store_number(i, "spin", 0, listed_disk.spin, gas)
                    store_number(i, "image", 0, meta_row.image_x + boxes_x, gas)
                    store_number(i, "image", 1, meta_row.image_y + boxes_y, gas)
                    events = meta_row.events
                    if ti.static(gas.uses.walls):
                        events -= gas.hits[s].wall_collisions
                    store_number(i, "collisions", 0, events, gas)
                    if ti.static(gas.uses.angle):
                        store_number(i, "angle", 0, gas.past[s].angle, gas)
                    if ti.static(gas.uses.dissipated):
                        for column in ti.static(range(MECHANISM.width)):
                            store_number(i, "dissipated", column, gas.dissipated[s][column], gas)
                    if ti.static(gas.uses.last_partner):
                        store_number(i, "last_partner", 0, gas.hits[s].last_partner, gas)
                    if ti.static(gas.uses.rest):
                        sleeps = gas.asleep[s] == ASLEEP or gas.asleep[s] == ASLEEP_UNVERIFIED
                        store_number(i, "asleep", 0, sleeps, gas)
                    if ti.static(gas.uses.latest_collision and not is_single(gas.frame_out)):
                        store_number(i, "latest_collision", 0, gas.past[s].latest, gas)
                    if ti.static(gas.uses.walls and not is_single(gas.frame_out)):
                        store_number(i, "wall_collisions", 0, gas.hits[s].wall_collisions, gas)
            for c in ti.static(range(READOUT.width)):
                gas.totals[k][c] = total[c]


@kernel
def read_species(
    part: ti.i32,
    gas: Arrays(
        "uses grid scale clock disk meta hits kind kinds tile edge_y first_of_species species_totals"
    ),
):
    """Add up the motion and the collisions with disks of each species, tile by tile.

    Ids of species s begin at `first_of_species[s]`; `species_totals` (tiles, species, columns of SPECIES) are 0.
    """
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0:
            k = item // spread
            first, last = own_slots(k, part, gas)
            for s in range(first, last):
                listed_disk, kind_row, id_of_disk = gas.disk[s], listed_kind(s, gas), gas.meta[s].id
                mass = ti.cast(gas.kinds[kind_row].mass, ti.f64)
                vx, vy = ti.cast(listed_disk.vx, ti.f64), ti.cast(listed_disk.vy, ti.f64)
                if ti.static(gas.uses.shear):
                    vx -= flow_at(listed_disk.y, gas)
                spin = ti.cast(listed_disk.spin, ti.f64)
                species = -1
                for j in range(gas.first_of_species.shape[0]):
                    if id_of_disk >= gas.first_of_species[j]:
                        species += 1
                events = gas.meta[s].events
                if ti.static(gas.uses.walls):
                    events -= gas.hits[s].wall_collisions
                inertia = ti.cast(gas.kinds[kind_row].inertia, ti.f64)
                sums = gas.species_totals[k, species]
                sums.translational += 0.5 * mass * (vx * vx + vy * vy)
                sums.rotational += 0.5 * inertia * spin * spin
                sums.momentum_x += mass * vx
                sums.momentum_y += mass * vy
                sums.mass += mass
                sums.collisions += events
                if mass > 0.0:
                    sums.movable += 1.0


@kernel
def read_regions(
    part: ti.i32,
    time: ti.f64,
    gas: Arrays("uses grid scale clock disk meta kind kinds tile edge_x edge_y regions region_totals"),
):
    """Add up the disks in each of the `regions`, tile by tile; `region_totals` (tiles, regions, columns) are 0."""
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0:
            k = item // spread
            first, last = own_slots(k, part, gas)
            for s in range(first, last):
                here, listed_disk = placed(s, k, time, gas), gas.disk[s]
                kind_row = listed_kind(s, gas)
                mass = ti.cast(gas.kinds[kind_row].mass, ti.f64)
                vx, vy = ti.cast(listed_disk.vx, ti.f64) - here.flow, ti.cast(listed_disk.vy, ti.f64)
                spin = ti.cast(listed_disk.spin, ti.f64)
                energy = (
                    mass * (vx * vx + vy * vy) + ti.cast(gas.kinds[kind_row].inertia, ti.f64) * spin * spin
                )
                for r in range(gas.regions.shape[0]):
                    sides = gas.regions[r]
                    inside = here.x >= sides.x_low and here.x < sides.x_high
                    if mass > 0.0 and inside and here.y >= sides.y_low and here.y < sides.y_high:
                        sums = gas.region_totals[k, r]
                        sums.disks += 1.0
                        sums.mass += mass
                        sums.energy += 0.5 * energy


@kernel
def exchange(board: Rows, sending: ti.i32, arrays: Arrays(" ".join(SMALL), {})):
    """Copy the small arrays, one after another, from the `board` if `sending`, else to it, for the host."""
    for _ in range(1):
        at = 0
        for array in ti.static(arrays):
            for i in range(array.shape[0]):
                if sending == 1:
                    if ti.static(has_numbers(array, ti.i32)):
                        array[i] = ti.cast(board[at + i], ti.i32)
                    elif ti.static(has_numbers(array, ti.f32)):
                        array[i] = ti.cast(board[at + i], ti.f32)
                    else:
                        array[i] = board[at + i]
                else:
                    board[at + i] = ti.cast(array[i], ti.f64)
            at += array.shape[0]


@ti.kernel
def read_rows(array: Rows, at: Rows, rows: Table):
    """Copy the rows `at` of an array into a table, that ranks send (`ifrdem/simulation/windows/ranks.py`)."""
    for i in range(at.shape[0]):
        if ti.static(width(array) == 0):
            rows[i, 0] = array[at[i]]
        else:
            for column in ti.static(range(width(array))):
                rows[i, column] = array[at[i]][column]


@ti.kernel
def write_rows(array: Rows, at: Rows, rows: Table):
    """Copy a table into the rows `at` of an array."""
    for i in range(at.shape[0]):
        if ti.static(width(array) == 0):
            array[at[i]] = rows[i, 0]
        else:
            for column in ti.static(range(width(array))):
                array[at[i]][column] = rows[i, column]
