"""Disks in cells before there is an engine: disks that are added to a box one by one, and pairs that are close.

Disks are in levels by size, the largest in level 0: each level spans a factor 2 of radii and has cells of its own, whose
sides are no shorter than the diameter of its largest disk. A disk looks for others in its own level and in those of
larger disks, so that it finds each pair, and large cells hold no crowd of small disks.

Places and distances are in double precision, whatever the precision of the runtime.
"""

from .compiler.language import Rows, Table, spread_of_loops, ti

# Columns of `frame`: the corner and sides of the region that has cells, whether it goes around the box along an axis,
# the sides of the box, whether it is periodic, and how far along x the images above it are.
LOW, SIDE, AROUND, LENGTH, PERIODIC, ABOVE = 0, 2, 4, 6, 8, 10
FRAME = 11
# Columns of `level`: the sides of its cells and the radius of its largest disk; of `cells`: their numbers along x and
# y, and the first one.
CELL, TOP = 0, 2
LEVEL = 3
FIRST_CELL = 2
CELLS = 3


@ti.func
def level_of(radius, first, last, level: ti.template()):
    """The level, from `first` up to, but not including, `last`, of a disk of this radius."""
    found = first
    while found + 1 < last and radius <= level[found + 1, TOP]:
        found += 1
    return found


@ti.func
def in_frame(x, y, s, frame: ti.template()):
    """A place from the corner of a frame, moved by whole boxes where the box is periodic."""
    rx, ry = x - frame[s, LOW], y - frame[s, LOW + 1]
    if frame[s, PERIODIC + 1] > 0.0:
        boxes = ti.floor(ry / frame[s, LENGTH + 1])
        ry -= boxes * frame[s, LENGTH + 1]
        rx -= boxes * frame[s, ABOVE]
    if frame[s, PERIODIC] > 0.0:
        rx -= ti.floor(rx / frame[s, LENGTH]) * frame[s, LENGTH]
    return rx, ry


@ti.func
def cell_along(r, side, count):
    """Number of the cell at a distance from the corner, which may be beyond the last one."""
    return ti.cast(ti.min(ti.max(ti.floor(r / side), -1.0 * count), 2.0 * count), ti.i32)


@ti.func
def cell_number(cx, cy, s, m, frame: ti.template(), cells: ti.template()):
    """The cell of these numbers in level m; -1 for one beyond an end."""
    nx, ny = cells[m, 0], cells[m, 1]
    ax, ay = cx, cy
    if frame[s, AROUND] > 0.0:
        ax = (cx + nx) % nx
    if frame[s, AROUND + 1] > 0.0:
        ay = (cy + ny) % ny
    found = -1
    if ax >= 0 and ax < nx and ay >= 0 and ay < ny:
        found = cells[m, FIRST_CELL] + ay * nx + ax
    return found


@ti.func
def cell_of(rx, ry, s, m, frame: ti.template(), level: ti.template(), cells: ti.template()):
    """The cell of level m that holds a place, which is from the corner of frame s; the nearest one for one outside."""
    cx = ti.min(ti.max(cell_along(rx, level[m, CELL], cells[m, 0]), 0), cells[m, 0] - 1)
    cy = ti.min(ti.max(cell_along(ry, level[m, CELL + 1], cells[m, 1]), 0), cells[m, 1] - 1)
    return cells[m, FIRST_CELL] + cy * cells[m, 0] + cx


@ti.func
def nearest(difference, length, periodic):
    """The shortest periodic equivalent of a difference of places."""
    found = difference
    if periodic > 0.0 and 2.0 * ti.abs(difference) > length:
        found = difference - length * ti.round(difference / length)
    return found


@ti.func
def insert(i, x, y, s, m, frame: ti.template(), level: ti.template(), cells: ti.template(), head: ti.template(),
           next_in_cell: ti.template()):  # fmt: skip
    """Add disk i at a place to the list of its cell in level m."""
    rx, ry = in_frame(x, y, s, frame)
    c = cell_of(rx, ry, s, m, frame, level, cells)
    next_in_cell[i] = head[c]
    head[c] = i


@ti.func
def overlaps_one(x, y, r, s, m, within, position: ti.template(), radius: ti.template(), frame: ti.template(),
                 level: ti.template(), cells: ti.template(), head: ti.template(), next_in_cell: ti.template()):  # fmt: skip
    """1 if a disk at a place comes closer to one in the cells of level m than `within` times the sum of radii."""
    found = 0
    rx, ry = in_frame(x, y, s, frame)
    reach = (r + level[m, TOP]) * within * within  # and a little more, for rounding
    x_first = cell_along(rx - reach, level[m, CELL], cells[m, 0])
    x_last = cell_along(rx + reach, level[m, CELL], cells[m, 0])
    y_first = cell_along(ry - reach, level[m, CELL + 1], cells[m, 1])
    y_last = cell_along(ry + reach, level[m, CELL + 1], cells[m, 1])
    cy = y_first
    while cy <= y_last and found == 0:
        cx = x_first
        while cx <= x_last and found == 0:
            c = cell_number(cx, cy, s, m, frame, cells)
            j = -1
            if c >= 0:
                j = head[c]
            while j >= 0 and found == 0:
                dx = nearest(x - position[j, 0], frame[s, LENGTH], frame[s, PERIODIC])
                dy = nearest(y - position[j, 1], frame[s, LENGTH + 1], frame[s, PERIODIC + 1])
                if ti.sqrt(dx * dx + dy * dy) <= (r + radius[j]) * within:
                    found = 1
                j = next_in_cell[j]
            cx += 1
        cy += 1
    return found


@ti.kernel
def add_in_order(
    within: ti.f64, stood: Table, first: Rows, owner: Rows, candidate: Table, success: Rows, position: Table, radius: Rows,
    placed: Rows, frame: Table, level: Table, cells: Table, head: Rows, next_in_cell: Rows,
):  # fmt: skip
    """Add disks to strips, each by one thread: attempts first[s] up to first[s + 1] are those of strip s, in order.

    Attempt a places disk `owner[a]` at `candidate[a]`, unless it is placed or comes closer to one that is than `within`
    times the sum of their radii; `success` says so. First the disks from stood[s, 0] up to
    stood[s, 1] are inserted, which stand there already. Each strip has its frame, and as many levels as the others.
    """
    spread = ti.static(spread_of_loops())
    strips = first.shape[0] - 1
    levels = level.shape[0] // strips
    for item in range(spread * strips):
        if item % spread == 0:
            s = item // spread
            low, high = s * levels, (s + 1) * levels
            for i in range(stood[s, 0], stood[s, 1]):
                m = level_of(radius[i], low, high, level)
                insert(i, position[i, 0], position[i, 1], s, m, frame, level, cells, head, next_in_cell)
            for a in range(first[s], first[s + 1]):
                i = owner[a]
                if placed[i] == 0:
                    x, y, r = candidate[a, 0], candidate[a, 1], radius[i]
                    blocked, m = 0, low
                    while m < high and blocked == 0:
                        blocked = overlaps_one(x, y, r, s, m, within, position, radius, frame, level, cells, head, next_in_cell)  # fmt: skip
                        m += 1
                    if blocked == 0:
                        position[i, 0], position[i, 1] = x, y
                        placed[i], success[a] = 1, 1
                        own = level_of(r, low, high, level)
                        insert(i, x, y, s, own, frame, level, cells, head, next_in_cell)


@ti.kernel
def count_in_cells(position: Table, radius: Rows, frame: Table, level: Table, cells: Table, count: Rows):
    """Count the disks of each cell; `radius` has one value, of all disks, or one of each."""
    for i in range(position.shape[0]):
        rx, ry = in_frame(position[i, 0], position[i, 1], 0, frame)
        m = level_of(radius[ti.min(i, radius.shape[0] - 1)], 0, level.shape[0], level)
        ti.atomic_add(count[cell_of(rx, ry, 0, m, frame, level, cells)], 1)


@ti.kernel
def list_in_cells(
    position: Table, radius: Rows, frame: Table, level: Table, cells: Table, end: Rows, listed: Rows, place: Table,
    size: Rows,
):  # fmt: skip
    """List the disks cell by cell, in any order, with their places in the frame, and sizes if they have several.

    Before, `end` has where each cell's list ends; afterwards, where it begins.
    """
    for i in range(position.shape[0]):
        rx, ry = in_frame(position[i, 0], position[i, 1], 0, frame)
        r = radius[ti.min(i, radius.shape[0] - 1)]
        m = level_of(r, 0, level.shape[0], level)
        k = ti.atomic_sub(end[cell_of(rx, ry, 0, m, frame, level, cells)], 1) - 1
        listed[k] = i
        place[k, 0], place[k, 1] = rx, ry
        if radius.shape[0] > 1:
            size[k] = r


@ti.kernel
def find_close(
    within: ti.f64, gap: ti.f64, frame: Table, level: Table, cells: Table, begin: Rows, listed: Rows, place: Table,
    size: Rows, pair: Table, found: Rows,
):  # fmt: skip
    """Find the pairs of disks closer than `within` times the sum of their radii plus `gap`, some of them twice.

    `size` has the radius of each of `listed`, or one of all. Adds the number of pairs to `found`, and lists as many of
    them as there is room for; it stops soon when there is none.
    """
    for k in range(listed.shape[0]):
        if found[0] <= pair.shape[0]:
            r = size[ti.min(k, size.shape[0] - 1)]
            rx, ry = place[k, 0], place[k, 1]
            own = level_of(r, 0, level.shape[0], level)
            for m in range(own + 1):
                reach = (r + level[m, TOP]) * within + gap
                # The pairs of a level are found from the one that is listed first.
                after = ti.select(m == own, k + 1, 0)
                for cy in range(
                    cell_along(ry - reach, level[m, CELL + 1], cells[m, 1]),
                    cell_along(ry + reach, level[m, CELL + 1], cells[m, 1]) + 1,
                ):
                    # In a sheared box, the images above and below are aside.
                    boxes = ti.floor(cy / (1.0 * cells[m, 1])) * frame[0, PERIODIC + 1]
                    x = rx - boxes * frame[0, ABOVE]
                    x -= ti.floor(x / frame[0, LENGTH]) * frame[0, LENGTH] * frame[0, PERIODIC]
                    y = ry - boxes * frame[0, LENGTH + 1]
                    cx = cell_along(x - reach, level[m, CELL], cells[m, 0])
                    x_last = cell_along(x + reach, level[m, CELL], cells[m, 0])
                    while cx <= x_last:
                        c = cell_number(cx, cy, 0, m, frame, cells)
                        row = 1  # cells that are listed one after the other
                        if cx >= 0:
                            row = ti.max(ti.min(x_last + 1, cells[m, 0]) - cx, 1)
                        if c >= 0:
                            for other in range(ti.max(begin[c], after), begin[c + row]):
                                dx = nearest(place[other, 0] - x, frame[0, LENGTH], frame[0, PERIODIC])
                                dy = place[other, 1] - y
                                far = (r + size[ti.min(other, size.shape[0] - 1)]) * within + gap
                                if dx * dx + dy * dy < far * far:
                                    at = ti.atomic_add(found[0], 1)
                                    if at < pair.shape[0]:
                                        pair[at, 0], pair[at, 1] = listed[k], listed[other]
                        cx += row
