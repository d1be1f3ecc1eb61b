"""The search of a disk for its next collision, among the disks of the cells around it.

Two disks are compared by when they meet, and ties fall to the smaller id. Cells that are nearly empty are read as
`lines` of flights in single precision (`tiles/lines.py`), the others disk by disk.
"""

from ..compiler.language import on_gpu, ti
from ..disks.flights import contact_delay, contact_signs, rounding
from ..disks.particle import radius_of
from ..layout import FAR, FIRST_WALL, MORE, SLOT
from ..tiles.lines import PLACES, passing, read_line
from ..tiles.tiles import head_at, layer_of, scale_of
from .rest import sleeps, time_to_sleeper

SEPARATING = 2.25  # square of a distance in contact distances: at it or less two disks have just collided
RING = 16  # places for slots to come, of up to 9 cells; a power of two


@ti.func
def sooner(t, j, best, partner, gas: ti.template()):
    """1 if a meeting at t with the disk in slot j comes before that at `best`; ties fall to the smaller id."""
    before = t < best
    if t == best and t < FAR:
        if partner >= 0:
            before = gas.event_info[j].id < gas.event_info[partner].id
        else:
            before = partner <= FIRST_WALL  # walls come after all disks
    return before


@ti.func
def separation(
    j, x, y, vx, vy, tau, radius, shift_x, shift_y, info: ti.template(), gas: ti.template()
):  # fmt: skip
    """Position and velocity of an image of the disk in slot j relative to another disk, and their contact distance.

    They hold from `start` on, which comes first of what is returned: since then both fly as they do now. Given of the
    other disk: position, velocity, time of these, radius, row of `event_info`; of the image: its shift.
    """
    other = gas.motion[j]
    tau_j = other.tau
    start = ti.select(tau_j > tau, tau_j, tau)
    vx_j, vy_j = other.vx, other.vy
    from_i, from_j = start - tau, start - tau_j
    # Differences of positions are exact. Seen from j, every term only changes its sign.
    rx = ((other.x - x) + shift_x) + (vx_j * from_j - vx * from_i)
    ry = ((other.y - y) + shift_y) + (vy_j * from_j - vy * from_i)
    ux, uy = vx_j - vx, vy_j - vy
    if ti.static(gas.uses.shear):
        rows = gas.event_info[j].shear_row - info.shear_row
        if rows != 0:
            rx += rows * (gas.scale.aside + gas.scale.drift * start)
            ux += rows * gas.scale.drift
    sigma = gas.scale.widest
    if ti.static(gas.uses.several_kinds):
        sigma = radius + radius_of(j, gas)
    return start, rx, ry, ux, uy, sigma


@ti.func
def compare(
    i: ti.template(), j: ti.template(), start: ti.template(), rx: ti.template(), ry: ti.template(),
    ux: ti.template(), uy: ti.template(), sigma: ti.template(), size: ti.template(), last: ti.template(),
    best: ti.template(), partner: ti.template(), gas: ti.template(),
):  # fmt: skip
    """Replace `best` and `partner` by the meeting of the disks in slots i and j, if that is earlier.

    Of disk i: |v_x| + |v_y| and latest partner. `start` and what follows are those of `separation`.
    """
    noise = ti.static(rounding()) * (size + (ti.abs(gas.motion[j].vx) + ti.abs(gas.motion[j].vy)))
    t = start + contact_delay(rx, ry, ux, uy, noise, sigma, best - start, gas)
    if j == last and gas.event_info[j].last == i:
        # They separate since this start; but across a narrow box another image may come.
        if rx * rx + ry * ry < SEPARATING * sigma * sigma:
            t = FAR
    if ti.static(gas.uses.rest):
        asleep_i, asleep_j = sleeps(i, gas), sleeps(j, gas)
        if asleep_i and asleep_j:
            t = FAR
        elif asleep_i or asleep_j:
            # A parabola in the lab, of the one that flies about the other.
            sign = ti.select(asleep_i, 1.0, -1.0)
            gx, gy = gas.scale.gx, gas.scale.gy
            t = start + time_to_sleeper(
                sign * rx + 0.5 * gx * start * start, sign * ry + 0.5 * gy * start * start,
                sign * ux + gx * start, sign * uy + gy * start,
                noise, sigma, best - start, gas,
            )  # fmt: skip
    if sooner(t, j, best, partner, gas):
        best = t
        partner = j


@ti.func
def search_cells(
    i: ti.template(), low_x: ti.template(), high_x: ti.template(), low_y: ti.template(), high_y: ti.template(),
    own_x: ti.template(), own_y: ti.template(), halved: ti.template(), layer: ti.template(), nx: ti.template(),
    ny: ti.template(), last: ti.template(), radius: ti.template(), size: ti.template(), best: ti.template(),
    partner: ti.template(), region: ti.template(), gas: ti.template(),
):  # fmt: skip
    """Compare the disk in slot i with those of a layer in columns and rows of cells, cell by cell: on a GPU."""
    info, motion = gas.event_info[i], gas.motion[i]
    x, y, vx, vy, tau = motion.x, motion.y, motion.vx, motion.vy, motion.tau
    for column in range(low_x, high_x + 1):
        ax = column
        shift_x = 0.0 * x
        if ax < 0:
            ax += nx
            shift_x = -gas.scale.length_x
        elif ax >= nx:
            ax -= nx
            shift_x = gas.scale.length_x
        first_y = low_y
        if halved == 1 and column == own_x:
            first_y = own_y
        for row_of_cells in range(first_y, high_y + 1):
            ay = row_of_cells
            shift_y = 0.0 * x
            if ay < 0:
                ay += ny
                shift_y = -gas.scale.length_y
            elif ay >= ny:
                ay -= ny
                shift_y = gas.scale.length_y
            j = gas.head[head_at(ax, ay, layer, region, gas)]
            if halved == 1 and column == own_x and row_of_cells == own_y:
                j = info.next_in_cell
            while j >= 0:
                j &= SLOT
                following = gas.event_info[j].next_in_cell
                if j != i:
                    start, rx, ry, ux, uy, sigma = separation(
                        j, x, y, vx, vy, tau, radius, shift_x, shift_y, info, gas
                    )
                    compare(i, j, start, rx, ry, ux, uy, sigma, size, last, best, partner, gas)
                j = following


@ti.func
def box_of(cell, cells):
    """The box in which a column or row of `cells` lies that is less than a box outside: -1, 0, or 1."""
    return ti.cast(cell >= cells, ti.i32) - ti.cast(cell < 0, ti.i32)


@ti.func
def search_candidates(
    i: ti.template(), low_x: ti.template(), high_x: ti.template(), low_y: ti.template(), high_y: ti.template(),
    own_x: ti.template(), own_y: ti.template(), halved: ti.template(), layer: ti.template(), nx: ti.template(),
    ny: ti.template(), last: ti.template(), radius: ti.template(), size: ti.template(), best: ti.template(),
    partner: ti.template(), region: ti.template(), gas: ti.template(),
):  # fmt: skip
    """As `search_cells`, on a CPU: image of the box by image, and there, with two layers, by blocks of 3 x 3 cells."""
    leaves, images, left, below, rows = 1, 9, -1, -1, 3
    if low_x >= 0 and high_x < nx and low_y >= 0 and high_y < ny:
        leaves, images = 0, 1
    elif ti.static(gas.uses.thin):  # which have few cells: only images that these reach
        left, below = box_of(low_x, nx), box_of(low_y, ny)
        rows = box_of(high_y, ny) - below + 1
        images = (box_of(high_x, nx) - left + 1) * rows
    for image in range(images):
        first_x, last_x, first_y, last_y = low_x, high_x, low_y, high_y
        half_x, half_y = ti.select(halved == 1, own_x, -2 * nx), own_y
        shift_x, shift_y = 0.0 * gas.scale.length_x, 0.0 * gas.scale.length_y
        if leaves == 1:
            over = image // rows
            box_x, box_y = left + over, below + image - rows * over
            shift_x, shift_y = box_x * gas.scale.length_x, box_y * gas.scale.length_y
            first_x, last_x = ti.max(low_x - box_x * nx, 0), ti.min(high_x - box_x * nx, nx - 1)
            first_y, last_y = ti.max(low_y - box_y * ny, 0), ti.min(high_y - box_y * ny, ny - 1)
            half_x -= box_x * nx
            half_y -= box_y * ny
        if ti.static(gas.uses.layers):
            for across in range((last_x - first_x + 3) // 3):
                for along in range((last_y - first_y + 3) // 3):
                    block_x, block_y = first_x + 3 * across, first_y + 3 * along
                    search_block(
                        i, block_x, ti.min(block_x + 2, last_x), block_y, ti.min(block_y + 2, last_y), half_x, half_y,
                        shift_x, shift_y, layer, ny, last, radius, size, best, partner, region, gas,
                    )  # fmt: skip
        elif ti.static(gas.uses.thin):
            search_lines(
                i, first_x, last_x, first_y, last_y, half_x, half_y, shift_x, shift_y, ny, last, size, best, partner,
                region, gas,
            )  # fmt: skip
        elif first_x <= last_x and first_y <= last_y:
            search_block(
                i, first_x, last_x, first_y, last_y, half_x, half_y, shift_x, shift_y, layer, ny, last, radius, size,
                best, partner, region, gas,
            )  # fmt: skip


@ti.func
def search_block(
    i: ti.template(), first_x: ti.template(), last_x: ti.template(), first_y: ti.template(), last_y: ti.template(),
    half_x: ti.template(), half_y: ti.template(), shift_x: ti.template(), shift_y: ti.template(),
    layer: ti.template(), ny: ti.template(), last: ti.template(), radius: ti.template(), size: ti.template(),
    best: ti.template(), partner: ti.template(), region: ti.template(), gas: ti.template(),
):  # fmt: skip
    """Compare the disk in slot i with those in at most 3 x 3 cells, by one loop: only its end is hard to predict.

    A ring holds the words of the disks that are still to be compared: at first the head of each cell. One that is taken
    from it adds the next in its cell, so it never holds more than there are cells. Most cells hold one disk, whose word
    says so: its `event_info` is not read. If cell (half_x, half_y) is among them, it begins behind disk i, and its column
    there.
    """
    info, motion = gas.event_info[i], gas.motion[i]
    x, y, vx, vy, tau = motion.x, motion.y, motion.vx, motion.vy, motion.tau
    ring = ti.Vector([0] * RING, ti.i32)
    end = 0
    at = head_at(first_x, 0, layer, region, gas)
    for column in range(first_x, last_x + 1):
        begin_y = first_y
        if column == half_x:
            begin_y = ti.max(first_y, half_y)
            if first_y <= half_y and half_y <= last_y:
                begin_y += 1
                ring[0] = info.next_in_cell
                end = (ring[0] >> 31) + 1
        for cell in range(at + begin_y, at + last_y + 1):
            j = gas.head[cell]
            ring[end] = j
            end += (j >> 31) + 1  # empty cells are negative
        at += ny
    m = 0
    while m < end:
        word = ring[m & (RING - 1)]
        j = word & SLOT
        m += 1
        if word >= MORE:
            ring[end & (RING - 1)] = gas.event_info[j].next_in_cell
            end += 1
        # Of a disk and itself b = 0.
        start, rx, ry, ux, uy, sigma = separation(j, x, y, vx, vy, tau, radius, shift_x, shift_y, info, gas)
        signs = contact_signs(rx, ry, ux, uy, sigma, best - start)
        if ti.static(gas.uses.rest):
            if sleeps(i, gas) or sleeps(j, gas):
                signs = -1
        if signs < 0:
            compare(i, j, start, rx, ry, ux, uy, sigma, size, last, best, partner, gas)


@ti.func
def search_lines(
    i: ti.template(), first_x: ti.template(), last_x: ti.template(), first_y: ti.template(), last_y: ti.template(),
    half_x: ti.template(), half_y: ti.template(), shift_x: ti.template(), shift_y: ti.template(), ny: ti.template(),
    last: ti.template(), size: ti.template(), best: ti.template(), partner: ti.template(), region: ti.template(),
    gas: ti.template(),
):  # fmt: skip
    """As `search_block`, of thin gases: the disk in slot i with those whose lines pass its own (`tiles/lines.py`).

    In cell (half_x, half_y) only with disks in slots behind its own.
    """
    info, motion = gas.event_info[i], gas.motion[i]
    x, y, vx, vy, tau = motion.x, motion.y, motion.vx, motion.vy, motion.tau
    radius = radius_of(i, gas)
    line, width = read_line(i, shift_x, shift_y, gas)
    for column in range(first_x, last_x + 1):
        begin_y = first_y
        if column == half_x:
            begin_y = ti.max(first_y, half_y)
        for row in range(begin_y, last_y + 1):
            b = region.lane * gas.grid.bunches + column * ny + row
            behind = ti.select(column == half_x and row == half_y, i, -1)
            while b >= 0:
                bits = passing(b, line, width, gas)
                if bits != 0:
                    for k in range(gas.bunch[b].count):
                        j = gas.line_slot[b * PLACES + k]
                        if ((bits >> k) & 1) == 1 and j > behind and j != i:
                            start, rx, ry, ux, uy, sigma = separation(
                                j, x, y, vx, vy, tau, radius, shift_x, shift_y, info, gas
                            )
                            if contact_signs(rx, ry, ux, uy, sigma, best - start) < 0:
                                compare(i, j, start, rx, ry, ux, uy, sigma, size, last, best, partner, gas)
                b = gas.bunch[b].next


@ti.func
def find(
    i, x_low, x_high, y_low, y_high, half, best, partner, region: ti.template(), gas: ti.template()
):  # fmt: skip
    """The earliest meeting of the disk in slot i with those of the cells around its own, before `best`: time, partner.

    Cells from (x_low, y_low) to (x_high, y_high) steps away. If `half`, only every other one of the nine, so that each
    pair is compared once. With two layers, small disks look at the large cells around their own too, if `half` or if
    they have just come into a large cell; large disks look at all small cells in the large ones, unless `half`.
    """
    info, motion = gas.event_info[i], gas.motion[i]
    own_x, own_y = info.cell >> 16, info.cell & 0xFFFF
    last = info.last
    radius = gas.scale.widest * 0.5
    if ti.static(gas.uses.several_kinds):
        radius = radius_of(i, gas)
    size = ti.abs(motion.vx) + ti.abs(motion.vy)
    mine = layer_of(i, gas)
    for other in range(ti.static(2 if gas.uses.layers else 1)):
        layer = other
        if ti.static(not gas.uses.layers):
            layer = mine
        nx, ny, _factor = scale_of(layer, region, gas)
        low_x, high_x, low_y, high_y = own_x + x_low, own_x + x_high, own_y + y_low, own_y + y_high
        halved = half
        if ti.static(gas.uses.layers):
            if mine == 0 and layer == 1:
                low_x, high_x, low_y, high_y = around(
                    own_x, own_y, x_low, x_high, y_low, y_high, half, region
                )
                halved = 0
            elif mine == 1 and layer == 0:
                low_x, high_x = low_x * region.coarse, (high_x + 1) * region.coarse - 1
                low_y, high_y = low_y * region.coarse, (high_y + 1) * region.coarse - 1
                if half == 1:
                    high_x = low_x - 1
                halved = 0
        if region.wrap_x == 0:
            low_x, high_x = ti.max(low_x, 0), ti.min(high_x, nx - 1)
        if region.wrap_y == 0:
            low_y, high_y = ti.max(low_y, 0), ti.min(high_y, ny - 1)
        if ti.static(on_gpu()):
            search_cells(
                i, low_x, high_x, low_y, high_y, own_x, own_y, halved, layer, nx, ny, last, radius, size, best, partner,
                region, gas,
            )  # fmt: skip
        else:
            search_candidates(
                i, low_x, high_x, low_y, high_y, own_x, own_y, halved, layer, nx, ny, last, radius, size, best, partner,
                region, gas,
            )  # fmt: skip
    return best, partner


@ti.func
def around(own_x, own_y, x_low, x_high, y_low, y_high, half, region: ti.template()):
    """The large cells, first and last column and row, that a small disk searches; none if it entered no large one."""
    m = region.coarse
    cx, cy = own_x // m, own_y // m
    low_x, high_x, low_y, high_y = cx - 1, cx + 1, cy - 1, cy + 1
    if half == 0 and x_low == x_high:
        low_x = high_x = cx + x_low
        if own_x - m * cx != ti.select(x_low == 1, 0, m - 1):
            high_x = low_x - 1
    elif half == 0 and y_low == y_high:
        low_y = high_y = cy + y_low
        if own_y - m * cy != ti.select(y_low == 1, 0, m - 1):
            high_y = low_y - 1
    return low_x, high_x, low_y, high_y
