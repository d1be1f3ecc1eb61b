"""Walls near each cell of a region, as the window begins, and the first one that a disk meets."""

from ..compiler.language import ti
from ..layout import FIRST_WALL, FULL_WALLS
from ..disks.particle import radius_of
from .images import as_partner, boxes_of, from_partner, image_of, position_at, wall_of
from .kinds import GONE
from .motion import turned_back, wall_motion, wall_reach, wall_turn
from .root import wall_time
from .shapes import face_distance, repeats, wall_box, wall_vector


@ti.func
def span(low, high, corner, side, count):
    """First and last cell of those that a stretch may meet, cells at the ends of the region without an end."""
    first = ti.cast(ti.floor(ti.max((low - corner) / side, -1.0)), ti.i32)
    last = ti.cast(ti.floor(ti.min((high - corner) / side, count + 0.0)), ti.i32)
    return ti.min(ti.max(first, 0), count - 1), ti.min(ti.max(last, 0), count - 1)


@ti.func
def place_walls(region: ti.template(), gas: ti.template()):
    """List for each cell of a region the images of walls that a disk in it may touch.

    Twice over the walls: the first time counts, the second enters.
    """
    cells, starts = region.nx * region.ny, region.lane * (gas.grid.cells + 1)
    for c in range(cells + 1):
        gas.wall_start[starts + c] = 0
    for turn in range(2):
        for w in range(gas.grid.walls):
            place_wall(w, turn, region, gas)
        before = 0
        if turn == 0:
            for c in range(cells + 1):
                here = gas.wall_start[starts + c]
                gas.wall_start[starts + c] = before
                before += here
            if before > gas.grid.items:
                ti.atomic_or(gas.counter.full, FULL_WALLS)
                ti.atomic_max(gas.counter.needed, before)
        else:
            # Each start has become the end: the start of the next one.
            for back in range(cells):
                c = starts + cells - back
                gas.wall_start[c] = gas.wall_start[c - 1]
            gas.wall_start[starts] = 0


@ti.func
def place_wall(w, entering, region: ti.template(), gas: ti.template()):
    """Count the images of wall w at the cells that it may be touched in, and enter them if `entering` is 1."""
    s, angle = wall_position(w, gas)
    reach = 1.001 * wall_reach(w, gas)
    boxes_x, boxes_y = boxes_around(w, gas)
    for box_x in range(-boxes_x, boxes_x + 1):
        for box_y in range(-boxes_y, boxes_y + 1):
            place_image(w, box_x, box_y, s, angle, reach, entering, region, gas)


@ti.func
def wall_position(w, gas: ti.template()):
    """Displacement of wall w along its direction, and its angle, as the window begins."""
    begin = 0.0 * gas.scale.window
    s, _speed, _bound, _until = wall_motion(w, begin, gas)
    angle = begin
    if ti.static(gas.uses.turning_walls):
        angle, _spin, _most, _turn_bound = wall_turn(w, begin, gas)
    return s, angle


@ti.func
def boxes_around(w, gas: ti.template()):
    """How many boxes away images of wall w are, along x and y: 1 or 0; -1 along x if it is gone."""
    boxes_x, boxes_y = gas.grid.periodic_x, gas.grid.periodic_y
    if repeats(w, gas) == 0:
        boxes_x, boxes_y = 0, 0
    if ti.static(gas.uses.timed_walls):
        if ti.cast(gas.walls[w].kind, ti.i32) == GONE:
            boxes_x = -1
    return boxes_x, boxes_y


@ti.func
def distance_from(w, x, y, s, angle, gas: ti.template()):
    """Distance of a position from the face of wall w, which is displaced by s and turned by an angle."""
    if ti.static(gas.uses.turning_walls):
        x, y = turned_back(w, x, y, s, angle, gas)
    nx, ny, distance = wall_vector(w, x, y, s, gas)
    return face_distance(w, nx, ny, distance, gas)


@ti.func
def may_touch(image, x, y, way, region: ti.template(), gas: ti.template()):
    """1 if a disk may touch an image of a wall in the window: one that is within `way` of a position of the region."""
    w = wall_of(image)
    box_x, box_y = boxes_of(image)
    boxes_x, boxes_y = boxes_around(w, gas)
    found = 0
    if ti.abs(box_x) <= boxes_x and ti.abs(box_y) <= boxes_y:
        s, angle = wall_position(w, gas)
        at_x = region.corner_x + x - box_x * gas.scale.length_x
        at_y = region.corner_y + y - box_y * gas.scale.length_y
        found = ti.cast(
            distance_from(w, at_x, at_y, s, angle, gas) <= 1.001 * (wall_reach(w, gas) + way), ti.i32
        )
    return found


@ti.func
def place_image(w, box_x, box_y, s, angle, reach, entering, region: ti.template(), gas: ti.template()):
    """As `place_wall` one image of it, displaced by s and turned by an angle, as far as it reaches."""
    wall = gas.walls[w]
    items, starts = region.lane * gas.grid.items, region.lane * (gas.grid.cells + 1)
    around = reach + 0.5 * ti.sqrt(region.side_x**2 + region.side_y**2)
    # From the corner of the region's tile.
    off_x = box_x * gas.scale.length_x - region.corner_x
    off_y = box_y * gas.scale.length_y - region.corner_y
    px = wall.x + wall.motion.x * s + off_x
    py = wall.y + wall.motion.y * s + off_y
    qx, qy = wall.towards_x, wall.towards_y
    if ti.static(gas.uses.turning_walls):
        px, py = turned_back(w, px - off_x, py - off_y, s, -angle, gas)
        px += off_x
        py += off_y
        qx, qy = ti.cos(angle) * qx - ti.sin(angle) * qy, ti.sin(angle) * qx + ti.cos(angle) * qy
    low_x, high_x, low_y, high_y = wall_box(w, px, py, qx, qy, gas)
    extent = reach + wall.radius
    first_x, last_x = span(low_x - extent, high_x + extent, region.x, region.side_x, region.nx)
    first_y, last_y = span(low_y - extent, high_y + extent, region.y, region.side_y, region.ny)
    for cx in range(first_x, last_x + 1):
        for cy in range(first_y, last_y + 1):
            x = region.x + (cx + 0.5) * region.side_x - off_x
            y = region.y + (cy + 0.5) * region.side_y - off_y
            if distance_from(w, x, y, s, angle, gas) <= around:
                c = starts + cx * region.ny + cy
                if entering == 1:
                    item = gas.wall_start[c]
                    if item < gas.grid.items:
                        gas.wall_item[items + item] = image_of(w, box_x, box_y)
                gas.wall_start[c] = gas.wall_start[c] + 1


@ti.func
def cell_of(i, region: ti.template(), gas: ti.template()):
    """Place in `wall_start` of the first wall near the cell of the disk in slot i."""
    cell = gas.event_info[i].cell
    return region.lane * (gas.grid.cells + 1) + (cell >> 16) * region.ny + (cell & 0xFFFF)


@ti.func
def first_wall(i, best, partner, region: ti.template(), gas: ti.template()):
    """The earlier of the meeting at `best` with `partner` and the first one with a wall near the disk in slot i."""
    cell = cell_of(i, region, gas)
    for item in range(gas.wall_start[cell], gas.wall_start[cell + 1]):
        image = gas.wall_item[region.lane * gas.grid.items + item]
        best, partner = earlier_wall(i, image, best, partner, region, gas)
    return best, partner


@ti.func
def earlier_wall(i, image, best, partner, region: ti.template(), gas: ti.template()):
    """The meeting of the disk in slot i with an image of a wall, if that is before the one at `best` with `partner`."""
    motion = gas.motion[i]
    x, y = position_at(i, image, region, gas)
    t, resting = wall_time(
        wall_of(image), x, y, motion.vx, motion.vy, motion.tau, radius_of(i, gas), best, gas
    )
    if resting == 1 and gas.event_info[i].own_rank > 0:
        gas.counter.resting = 1
    if t < best:
        best = t
        partner = as_partner(image)
    return best, partner


@ti.func
def other_image(i, step_x, step_y, gas: ti.template()):
    """Name the wall that the disk in slot i meets by its image there, after the disk went round the box, by steps of
    1, 0 or -1 boxes."""
    info = gas.event_info[i]
    if info.partner <= FIRST_WALL:
        image = from_partner(info.partner)
        w = wall_of(image)
        if repeats(w, gas) == 1:
            box_x, box_y = boxes_of(image)
            info.partner = as_partner(image_of(w, box_x - step_x, box_y - step_y))
