"""Lines of flight in cells, by which thin gases look for neighbours (`Uses.thin`).

Disks of a thin gas compare themselves with so many others that cells with few of them, read disk by disk, take most of
the time. Here a cell has bunches of PLACES lines. A line is the flight of a disk in single precision: where it would
have been at the window's beginning, and its way in the window, in largest diameters. One loop without branches, which
the compiler makes one over vectors, tests all lines of a bunch: two disks can meet only if their lines pass each other
at no more than the sum of their radii. What is left is compared in full precision, as in other gases.

Nothing that may meet is lost. A number of a line is wrong by at most u = 2^-24 of itself, so at a time of the window
the separation of two lines is wrong by at most u (R_i + R_j), where R is the sum of the magnitudes of a line's four
numbers. The cross product c of separation and relative way is then computed with an error of at most 5 u (R_i + R_j)
times that way, and c^2 and what it is compared with are wrong by some units in the last place. ERROR has more than twice
of all that: the radius of a line is that of its disk and ERROR R. A bunch keeps the largest one since it was empty.
"""

from ..compiler.language import ti
from ..disks.particle import radius_of

PLACE_BITS = 5
PLACES = 1 << PLACE_BITS  # of a bunch
NUMBERS = 4  # of a line: x, y, way along x and y; bunch by bunch, and there number by number
NO_BUNCH = -1
ERROR = 16.0 * 2.0**-24
FARTHEST = 1.0e8  # sum of magnitudes of a line beyond which c^2 might overflow: it passes all tests
SLOWEST = 1.0e-30  # square of a way, below which products are no longer exact: it is taken to be so large


@ti.func
def line_of(i, gas: ti.template()):
    """The line of the disk in slot i: x, y, way along x and y; its radius [largest diameters]. In single precision."""
    motion = gas.motion[i]
    unit = gas.scale.per_widest
    x, y = (motion.x - motion.vx * motion.tau) * unit, (motion.y - motion.vy * motion.tau) * unit
    vx, vy = motion.vx * (gas.scale.window * unit), motion.vy * (gas.scale.window * unit)
    reach = ti.abs(x) + ti.abs(y) + ti.abs(vx) + ti.abs(vy)
    radius = (1.0 + ERROR) * radius_of(i, gas) * unit + ERROR * reach
    if not (reach < FARTHEST):
        x, y, vx, vy, radius = 0.0, 0.0, 0.0, 0.0, ti.math.inf
    return ti.Vector([x, y, vx, vy], ti.f32), ti.cast(radius, ti.f32)


@ti.func
def first_number(place):
    """Index in `line` of the first number of the line at a place; the others follow PLACES further each."""
    return (place >> PLACE_BITS) * (NUMBERS * PLACES) + (place & (PLACES - 1))


@ti.func
def read_line(i, shift_x, shift_y, gas: ti.template()):
    """The line of the disk in slot i as seen from an image of the box, which is shifted so far [length]; its radius."""
    place = gas.event_info[i].next_in_cell
    at = first_number(place)
    line = ti.Vector([0.0] * NUMBERS, ti.f32)
    for number in ti.static(range(NUMBERS)):
        line[number] = gas.line[at + number * PLACES]
    line[0] -= ti.cast(shift_x * gas.scale.per_widest, ti.f32)
    line[1] -= ti.cast(shift_y * gas.scale.per_widest, ti.f32)
    radius = ti.bit_cast(gas.bunch[place >> PLACE_BITS].radius, ti.f32)
    return line, radius + ti.cast(ERROR * (ti.abs(shift_x) + ti.abs(shift_y)) * gas.scale.per_widest, ti.f32)


@ti.func
def write_line(i, gas: ti.template()):
    """Write the line of the disk in slot i to its place."""
    line, radius = line_of(i, gas)
    place = gas.event_info[i].next_in_cell
    at = first_number(place)
    for number in ti.static(range(NUMBERS)):
        gas.line[at + number * PLACES] = line[number]
    widen(place >> PLACE_BITS, ti.bit_cast(radius, ti.i32), gas)


@ti.func
def widen(b, radius, gas: ti.template()):
    """Note a radius of a line, as bits, which are in the order of such numbers, in the radius of its bunch."""
    gas.bunch[b].radius = ti.max(gas.bunch[b].radius, radius)


@ti.func
def last_bunch(cell, region: ti.template(), gas: ti.template()):
    """The last bunch of a cell, given by its number in the region, and the one before it or NO_BUNCH."""
    before, b = NO_BUNCH, region.lane * gas.grid.bunches + cell
    while gas.bunch[b].next >= 0:
        before = b
        b = gas.bunch[b].next
    return b, before


@ti.func
def clear_bunch(b, gas: ti.template()):
    """Make a bunch the last one of its cell, without lines."""
    gas.bunch[b].count, gas.bunch[b].next, gas.bunch[b].radius = 0, NO_BUNCH, 0


@ti.func
def begin_lines(n, region: ti.template(), gas: ti.template()):
    """Empty all cells, and give the n disks of a region their places, in order of their slots."""
    first, cells = region.lane * gas.grid.bunches, region.nx * region.ny
    for b in range(first, first + cells):
        clear_bunch(b, gas)
    # All but the last bunch of a cell are full: so many more are enough.
    last = first + cells + n // PLACES
    for b in range(first + cells, last + 1):
        gas.bunch[b].next = b + 1
    gas.bunch[last].next = NO_BUNCH
    gas.spare[region.lane] = first + cells
    for i in range(region.lane * gas.grid.lane_slots, region.lane * gas.grid.lane_slots + n):
        cell = gas.event_info[i].cell
        take_place(i, (cell >> 16) * region.ny + (cell & 0xFFFF), region, gas)


@ti.func
def take_place(i, cell, region: ti.template(), gas: ti.template()):
    """Write the line of the disk in slot i behind the others of a cell."""
    b, _before = last_bunch(cell, region, gas)
    if gas.bunch[b].count == PLACES:
        new = gas.spare[region.lane]
        gas.spare[region.lane] = gas.bunch[new].next
        clear_bunch(new, gas)
        gas.bunch[b].next = new
        b = new
    place = b * PLACES + gas.bunch[b].count
    gas.bunch[b].count += 1
    gas.line_slot[place] = i
    gas.event_info[i].next_in_cell = place
    write_line(i, gas)


@ti.func
def leave_place(i, cell, region: ti.template(), gas: ti.template()):
    """Take the line of the disk in slot i out of its cell: the last one comes to its place."""
    b, before = last_bunch(cell, region, gas)
    count = gas.bunch[b].count - 1
    place, last = gas.event_info[i].next_in_cell, b * PLACES + count
    moved = gas.line_slot[last]
    gas.line_slot[place] = moved
    gas.event_info[moved].next_in_cell = place
    to, at = first_number(place), first_number(last)
    for number in ti.static(range(NUMBERS)):
        gas.line[to + number * PLACES] = gas.line[at + number * PLACES]
    widen(place >> PLACE_BITS, gas.bunch[b].radius, gas)
    gas.bunch[b].count = count
    if count == 0 and before >= 0:
        gas.bunch[before].next = NO_BUNCH
        gas.bunch[b].next = gas.spare[region.lane]
        gas.spare[region.lane] = b


@ti.func
def passing(b, line, radius, gas: ti.template()):
    """The places of bunch b, as bits, whose lines pass a given one closely enough. Empty places may be among them."""
    x, y, vx, vy = line[0], line[1], line[2], line[3]
    sigma = ti.bit_cast(gas.bunch[b].radius, ti.f32) + radius
    square = sigma * sigma
    bits, first = 0, b * (NUMBERS * PLACES)
    for k in range(PLACES):
        dx, dy = gas.line[first + k] - x, gas.line[first + PLACES + k] - y
        ux, uy = gas.line[first + 2 * PLACES + k] - vx, gas.line[first + 3 * PLACES + k] - vy
        c = dx * uy - dy * ux
        within = c * c - square * (ux * ux + uy * uy + ti.f32(SLOWEST))
        bits |= (ti.bit_cast(within, ti.i32) >> 31) & (1 << k)
    return bits
