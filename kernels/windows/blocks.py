"""A tile a block of threads: the events of a window on a GPU, in rounds.

A block gathers the disks of a tile and its halo, sorts them by cells, and lists for each the disks near it, which are
all that it can meet in the window. Their flights lie in the memory that the threads of a block share. Then *rounds*
follow, until no event is left. In a round all events happen that come before every other event of every disk in the
lists of both of its disks. So no disk of one is in a list of the other, and threads read what no other thread writes.

As in `events/events.py`, only the disk that predicts stores an event, which is stale if the partner has collided since.

*Certificate.* Events do not happen in the order of their times, so a disk i that looks around itself at a time t may
find one, k, that has collided later already. Where k's flight began, tau_k > t, the two may not have met before:

    |x_i(t) - x_k(tau_k)| >= sigma + max(|v_i|, top_k) (tau_k - t),   top_k: largest speed of k in the window

else the tile is marked.

Proof that an unmarked tile has the events of `events/events.py`. Let f and g be flights of i and k that overlap in
time, f being the later one to be made by the program. When f was made, k was in g, or beyond it, or before it. In g: f
was tested against g, and i keeps an event that is no later than their meeting; before that time comes, one of both
flights has ended, or the event was stale and i looked again. Beyond g: by the certificate they did not meet before
that. Before it: then g was made later than f, against the assumption. Disks that are not listed cannot meet unless one
is faster than the speed that the lists are made for, which is marked too. So no meeting is missed, and the motion of
hard disks without missed meetings is unique. Times depend on flights only and are the same from either side.

Forces that act on all disks divide the window: before they do, all events up to their time have happened, and then all
disks begin a flight at that time. A force that acts on one disk at a time of its own is an event of this disk alone.

A marked tile is run again at once with longer lists, and then one event after another. One that is marked then too, or
that has more disks than a block has room for, is run by one thread (`windows.run_windows_on_gpu`).
"""

from collections import namedtuple
from typing import Any

from ..columns import BLOCK_INTEGERS, BLOCK_REALS, BLOCK_SUMS, Columns
from ..disks.flights import bits_of, contact_signs, real_of
from ..disks.force_times import action_time
from ..events.events import collide, precedes
from ..events.search import compare, separation
from ..forces.force_events import act_alone, act_on_all, first_horizon, horizon_of, kick_time
from ..compiler.language import is_single_precision, shared, ti
from ..tiles.grid import place_of
from ..layout import (
    AT_END,
    AT_MOMENT,
    BLOCK_SLOTS,
    DENSE_SLOTS,
    FAR,
    FULL_GHOSTS,
    NEAR_WORDS,
    NO_PARTNER,
    OWN_ACTION,
    PAIRS,
    TOO_MANY,
)
from ..disks.particle import largest_square, radius_of, round_products, speed_square, upper_half
from .planner import pull_of
from ..compiler.records import From, InColumns, Split, NamedVector
from ..compiler.signature import Arrays, kernel
from ..tiles.sums import sum_tiles
from ..tiles.tiles import (
    begin,
    bounds_of,
    cell_at,
    clear,
    gather_tile,
    lies_in,
    load_from,
    position_in_tile,
    reserve_ghosts,
    reserve_list,
    sides_of,
    slot_of,
    write,
)
from ..walls.cells import earlier_wall, may_touch
from ..walls.collision import hit_wall
from ..walls.motion import wall_phases
from .windows import WINDOW, begin_window, tile_of, verify_tiles

THREADS = 256  # of a block
MOST_NEAR = 4 * NEAR_WORDS - 1  # places of a list
ALL_NEAR = MOST_NEAR  # as the number of disks that may meet one: any in its list
ABREAST = 8  # threads that look around a disk
NONE = 0x7FFFFFFF  # the key of no event
MET, STALE = -1, -2  # of one that happens in this round
TICKS = 1073741824.0  # keys in a window
# How much faster than at the window's beginning disks may be for the lists: than the fastest of the tile, and of all.
FASTER, FASTEST_OF_ALL = 1.35, 1.15
MARGIN = 1.5  # beyond contact that lists have at least, in largest diameters
ATTEMPTS = 3
MOST_BLOCKS = 1024  # of a GPU
MOST_ROUNDS = 20_000
# What threads of a block note for one another.
NOTES = Columns(
    gathered="disks gathered", own="own disks", copies="copies", mark="why the tile has to be run again, or 0",
    speed="upper half of the largest square of a speed",
    extent="upper half of the largest square of a distance that lists reach", images="images of walls",
    queued="queued disks",
    least="least key of the queue", tile="tile", room="room", sums=("sums of warps", THREADS // 32),
    list_begin=("of each of the nine tiles around, the first slot", 9),
    list_length=("of each, the number of disks", 9), boxes=("of each, boxes away", 9),
)  # fmt: skip
# Why a tile has to be run again: a list has no place left, the order of events is not certain, a disk is too fast for
# the lists, there are too many disks (TOO_MANY), rounds without end, no room for ghost records, or too many disks for
# any block.
LIST_FULL, UNCERTAIN, TOO_FAST, ENDLESS, NO_ROOM, NO_BLOCK = 1, 2, 4, 16, 32, 64
FLIGHT = ("x", "y", "vx", "vy", "tau")


def block_of(gas: Any, number: Any, slots: int) -> Any:
    """The arrays of a gas as a block with this number has them: its part of the scratch space, and what threads share.

    It has so many slots for disks. What events look at most is shared by blocks of BLOCK_SLOTS, and lies in the scratch
    space of those with more. Called once in a loop of a kernel, while it is compiled.
    """
    first, given = number * slots, gas._asdict()
    for array, table in (("integers", BLOCK_INTEGERS), ("reals", BLOCK_REALS), ("sums", BLOCK_SUMS)):
        flat, begin_at = given[f"block_{array}"], first * table.width
        for name, column in table.at.items():
            if isinstance(column, int):
                given[name] = From(flat, begin_at + column * slots)
            else:
                given[name] = InColumns(flat, column, begin_at, slots)
    given["near"] = From(gas.near, first * NEAR_WORDS)
    given["image_list"], given["near_image"] = From(gas.image_list, first), From(gas.near_image, first)
    given["order"] = From(gas.block_integers, first * BLOCK_INTEGERS.width)  # before there are events
    given["key"], given["low"] = shared(slots, ti.i32), shared(slots, ti.i32)
    given["head"] = given["low"]  # before there are events
    given["queue"], given["note"] = (
        shared(slots // 4, ti.u16),
        NamedVector(shared(NOTES.width, ti.i32), NOTES),
    )
    given["shift"] = shared(2 * 9)
    if slots <= BLOCK_SLOTS:
        given["motion"] = Split(given["motion"], {name: shared(slots) for name in FLIGHT})
        event = {
            "partner": shared(slots, ti.i16),
            "number": shared(slots, ti.i32),
            "partner_number": shared(slots, ti.i16),
        }
        given["event_info"] = Split(given["event_info"], event)
    return namedtuple("Block", (*given, "slots"))(**given, slots=slots)


@ti.func
def shuffled_word(value, step: ti.template(), mask):
    """An i32 of the thread of a warp whose number differs in the bit `step`."""
    return ti.simt.warp.shfl_xor_i32(mask, value, step)


@ti.func
def shuffled_f64(value, step: ti.template(), mask):
    """As `shuffled_word`, of an f64."""
    word = ti.bit_cast(value, ti.u64)
    low = shuffled_word(ti.cast(ti.cast(word, ti.u32), ti.i32), step, mask)
    high = shuffled_word(ti.cast(ti.cast(word >> ti.u64(32), ti.u32), ti.i32), step, mask)
    both = (ti.cast(ti.cast(high, ti.u32), ti.u64) << ti.u64(32)) | ti.cast(ti.cast(low, ti.u32), ti.u64)
    return ti.bit_cast(both, ti.f64)


@ti.func
def shuffled(value, step: ti.template(), mask):
    """As `shuffled_word`, of a real number."""
    if ti.static(is_single_precision()):
        return real_of(shuffled_word(bits_of(value), step, mask))
    else:
        return shuffled_f64(value, step, mask)


@ti.func
def region_around(tile, halo, reach, gas: ti.template()):
    """Cells of a tile and its halo, at least `reach` wide, as many as a block has room for."""
    width, height = sides_of(tile, gas)
    width += 2.0 * halo
    height += 2.0 * halo
    most = ti.static(int(gas.slots**0.5))
    nx = ti.min(ti.max(ti.cast(width / reach, ti.i32), 1), most)
    ny = ti.min(ti.max(ti.cast(height / reach, ti.i32), 1), most)
    tx, ty = place_of(tile, gas)
    return ti.Struct(
        x=-halo, y=-halo, nx=nx, ny=ny, side_x=width / nx, side_y=height / ny, wrap_x=0, wrap_y=0, cells=0, lane=0,
        coarse=1, corner_x=ti.cast(gas.edge_x[tx], float), corner_y=ti.cast(gas.edge_y[ty], float),
    )  # fmt: skip


@ti.func
def note_tiles(tile, me, block: ti.template()):
    """Note what `gather_tile` returns for the nine tiles around, and where their lists are: one thread per tile."""
    if me < 9:
        near = gather_tile(tile, me, block)
        block.shift[2 * me], block.shift[2 * me + 1] = near.shift_x, near.shift_y
        block.note.boxes[me] = (near.boxes_x << 16) | (near.boxes_y & 0xFFFF)
        block.note.list_begin[me], block.note.list_length[me] = 0, 0
        if near.tile >= 0:
            part = block.grid.part
            block.note.list_begin[me] = part * block.grid.room + block.tile[near.tile].start[part]
            block.note.list_length[me] = block.tile[near.tile].count[part]


@ti.func
def noted_tile(step, block: ti.template()):
    """One of the nine tiles around, as `neighbor_tile` describes it; its number is not noted."""
    boxes = block.note.boxes[step]
    return ti.Struct(
        tile=-1, step_y=step % 3 - 1, shift_x=block.shift[2 * step], shift_y=block.shift[2 * step + 1],
        boxes_x=boxes >> 16, boxes_y=(boxes << 16) >> 16,
    )  # fmt: skip


@ti.func
def choose_disks(tile, halo, me, region: ti.template(), block: ti.template()):
    """List the disks in a tile and its halo as candidates, count them, and note the largest square of a speed.

    Until candidates are sorted, slot m keeps the position of candidate m.
    """
    left, right, below, above = bounds_of(halo, tile, block)
    own_left, own_right, own_below, own_above = bounds_of(0.0 * halo, tile, block)
    fastest, k = 0, me
    for step in range(9):
        near = noted_tile(step, block)
        first, many = block.note.list_begin[step], block.note.list_length[step]
        while k < many:
            s = first + k
            here = position_in_tile(s, near, region, block)
            x, y = here.x, here.y
            square = speed_square(block.disk[s].vx, block.disk[s].vy)
            if lies_in(x, y, left, right, below, above):
                rank = 0
                if lies_in(x, y, own_left, own_right, own_below, own_above):
                    rank = 1 + ti.atomic_add(block.note.own, 1)
                else:
                    rank = -1 - ti.atomic_add(block.note.copies, 1)
                m = ti.atomic_add(block.note.gathered, 1)
                if m < block.slots:
                    block.candidates[m].slot = s
                    block.candidates[m].own_rank = rank
                    block.candidates[m].step = step
                    block.motion[m].x, block.motion[m].y = x, y
                fastest = ti.max(fastest, square)
            k += THREADS
        k -= many  # threads share the nine lists as if they were one
    ti.atomic_max(block.note.speed, fastest)


@ti.func
def count_by_cell(n, me, region: ti.template(), block: ti.template()):
    """Find the cells of the candidates, and where the disks of each begin: into `head`."""
    m = me
    while m < n:
        cell = cell_at(block.motion[m].x, block.motion[m].y, region)
        block.candidates[m].cell = cell
        ti.atomic_add(block.head[cell], 1)
        m += THREADS
    ti.simt.block.sync()
    # Each thread adds up a part of the cells, a warp the sums of its threads, all threads those of the warps before:
    # then a thread knows where the disks of its first cell begin.
    cells = region.nx * region.ny
    chunk = (cells + THREADS - 1) // THREADS
    first, last = ti.min(me * chunk, cells), ti.min((me + 1) * chunk, cells)
    mine = 0
    for c in range(first, last):
        mine += block.head[c]
    upto = mine
    lane = me % 32
    for step in ti.static((1, 2, 4, 8, 16)):
        other = ti.simt.warp.shfl_up_i32(ti.u32(0xFFFFFFFF), upto, step)
        if lane >= step:
            upto += other
    if lane == 31:
        block.note.sums[me // 32] = upto
    ti.simt.block.sync()
    before = upto - mine
    for warp in range(me // 32):
        before += block.note.sums[warp]
    for c in range(first, last):
        here = block.head[c]
        block.head[c] = before
        before += here


@ti.func
def list_neighbors(i, margin, region: ti.template(), block: ti.template()):
    """List the disks that are nearer to the disk in slot i than contact and a margin [length].

    Returns 1 if there is no room; and of those in earlier slots that may meet it in the window, before anything else
    happens, their number and the first four of their slots, in a word. Cells are contiguous along y, and `head` is
    where each ends.
    """
    cell = block.event_info[i].cell
    cx, cy = cell >> 16, cell & 0xFFFF
    x, y, vx, vy = block.motion[i].x, block.motion[i].y, block.motion[i].vx, block.motion[i].vy
    many, first, word = 0, ti.u64(0), ti.u64(0)
    n_meet, meet = 0, ti.u64(0)
    sigma, window = block.scale.widest, block.scale.window
    reach = sigma + margin
    square = reach * reach
    for column in range(ti.max(cx - 1, 0), ti.min(cx + 1, region.nx - 1) + 1):
        first_cell = column * region.ny + ti.max(cy - 1, 0)
        k, end = 0, block.head[column * region.ny + ti.min(cy + 1, region.ny - 1)]
        if first_cell > 0:
            k = block.head[first_cell - 1]
        while k < end:
            rx, ry = block.motion[k].x - x, block.motion[k].y - y
            faster = 0.0 * x
            if ti.static(block.uses.shear):
                rows = block.event_info[k].shear_row - block.event_info[i].shear_row
                rx += rows * block.scale.aside
                faster = rows * block.scale.drift
            if ti.static(block.uses.several_kinds):
                sigma = radius_of(i, block) + radius_of(k, block)
                reach = sigma + margin
                square = reach * reach
            if k != i and rx * rx + ry * ry < square:
                # Each pair is tested once, by the later slot: both motions have been loaded here.
                if k < i:
                    ux, uy = block.motion[k].vx - vx + faster, block.motion[k].vy - vy
                    if contact_signs(rx, ry, ux, uy, sigma, window) < 0:
                        meet = (meet << ti.u64(16)) | ti.cast(k, ti.u64)
                        n_meet += 1
                many += 1
                entry = ti.cast(k, ti.u64) << ti.cast(16 * (many & 3), ti.u64)
                if many < 4:
                    first |= entry
                else:
                    word |= entry
                    if (many & 3) == 3 and many <= MOST_NEAR:
                        block.near[i * NEAR_WORDS + (many >> 2)] = word
                        word = ti.u64(0)
            k += 1
    # The last word, which is not full; the first one has the number in place 0, and is written last.
    if many % 4 != 3 and many > 3 and many <= MOST_NEAR:
        block.near[i * NEAR_WORDS + many // 4] = word
    block.near[i * NEAR_WORDS] = first | ti.cast(ti.min(many, MOST_NEAR), ti.u64)
    return ti.cast(many > MOST_NEAR, ti.i32), n_meet, meet


@ti.func
def entry_of(i, m, block: ti.template()):
    """Place m of the list of the disk in slot i: 0 has the number of disks in it, the others have their slots."""
    word = block.near[i * NEAR_WORDS + (m >> 2)]
    return ti.cast((word >> ti.cast(16 * (m & 3), ti.u64)) & ti.u64(0xFFFF), ti.i32)


@ti.func
def first_meeting(i, n_meet, meet, best, partner, region: ti.template(), block: ti.template()):
    """The earliest meeting of the disk in slot i with those in earlier slots: time, partner. As `list_neighbors` says.

    So each pair is looked at once. With more than four that may meet, or ALL_NEAR, at all in the list.
    """
    info, motion = block.event_info[i], block.motion[i]
    x, y, vx, vy, tau = motion.x, motion.y, motion.vx, motion.vy, motion.tau
    radius = block.scale.widest * 0.5
    if ti.static(block.uses.several_kinds):
        radius = radius_of(i, block)
    size, last = ti.abs(vx) + ti.abs(vy), info.last
    m, end = 0, n_meet
    if n_meet > 4:
        end = entry_of(i, 0, block)
    while m < end:
        j = ti.cast((meet >> ti.cast(16 * (m % 4), ti.u64)) & ti.u64(0xFFFF), ti.i32)
        if n_meet > 4:
            j = entry_of(i, m + 1, block)
        if j < i:
            start, rx, ry, ux, uy, sigma = separation(
                j, x, y, vx, vy, tau, radius, 0.0 * x, 0.0 * x, info, block
            )
            compare(i, j, start, rx, ry, ux, uy, sigma, size, last, best, partner, block)
        m += 1
    return best, partner


@ti.func
def list_images(me, way, region: ti.template(), block: ti.template()):
    """List the images of walls that disks of the region may touch in the window if each moves by `way` at most.

    By the first warp, in the order of their numbers. `note.extent` is the upper half of the square of the largest
    distance of a disk from the region's centre.
    """
    if me < 32:
        extent = ti.cast(
            ti.sqrt(ti.bit_cast(ti.cast(block.note.extent, ti.i64) << ti.i64(32), ti.f64)), float
        )
        x = region.x + 0.5 * region.nx * region.side_x
        y = region.y + 0.5 * region.ny * region.side_y
        many, image, images = 0, me, 9 * block.grid.walls
        # All lanes stay in the loop: each votes, also where its own image is beyond the last.
        while image - me < images:
            near = 0
            if image < images:
                near = may_touch(image, x, y, extent + way, region, block)
            votes = ti.cast(ti.simt.warp.ballot(near), ti.u32)
            earlier = votes & ((ti.u32(1) << ti.cast(me, ti.u32)) - ti.u32(1))
            # Votes of lanes before give each its place: the list has one order, whichever lane is first.
            at = many + ti.cast(ti.math.popcnt(earlier), ti.i32)
            if near == 1 and at < block.slots:
                block.image_list[at] = image
            many += ti.cast(ti.math.popcnt(votes), ti.i32)
            image += 32
        if me == 0:
            block.note.images = ti.min(many, block.slots)
            if many > block.slots:
                block.note.mark = TOO_MANY


@ti.func
def list_walls(i, way, region: ti.template(), block: ti.template()):
    """List the images of walls that the disk in slot i may touch in the window: their number, and places of three."""
    many, word = 0, ti.u64(0)
    for m in range(block.note.images):
        if may_touch(block.image_list[m], block.motion[i].x, block.motion[i].y, way, region, block) == 1:
            many += 1
            if many < 4:
                word |= ti.cast(m, ti.u64) << ti.cast(16 * many, ti.u64)
    block.near_image[i] = word | ti.cast(many, ti.u64)


@ti.func
def first_wall(i, best, partner, region: ti.template(), block: ti.template()):
    """As `walls.cells.first_wall`, by the list of `list_walls`, or all images near the tile if that is too short."""
    word = block.near_image[i]
    many = ti.cast(word & ti.u64(0xFFFF), ti.i32)
    end = many
    if many > 3:
        end = block.note.images
    for m in range(end):
        at = m
        if many <= 3:
            at = ti.cast((word >> ti.cast(16 * (m + 1), ti.u64)) & ti.u64(0xFFFF), ti.i32)
        best, partner = earlier_wall(i, block.image_list[at], best, partner, region, block)
    return best, partner


@ti.func
def look_around(i, first, t, best, partner, mask, region: ti.template(), block: ti.template()):
    """The earliest meeting of the disk in slot i with those of its list: time, partner; 1 if the order is not certain.

    With those at every `ABREAST`-th place from a first one on. The disk looks at time t. `mask`: threads of the warp
    that call this.
    """
    wrong = 0
    info, motion = block.event_info[i], block.motion[i]
    x, y, vx, vy, tau = motion.x, motion.y, motion.vx, motion.vy, motion.tau
    last = info.last
    radius = block.scale.widest * 0.5
    if ti.static(block.uses.several_kinds):
        radius = radius_of(i, block)
    size = ti.abs(vx) + ti.abs(vy)
    m, end, j = first, entry_of(i, 0, block), entry_of(i, ti.min(first, MOST_NEAR), block)
    ti.simt.warp.sync(mask)  # keeps the loads above together: the compiler moves none past it
    while m <= end:
        start, rx, ry, ux, uy, sigma = separation(j, x, y, vx, vy, tau, radius, 0.0 * x, 0.0 * x, info, block)
        # The certificate: j has collided later already, so the two must have been too far apart to meet before that.
        ahead = block.motion[j].tau - t
        if ahead > 0.0:
            dx = block.motion[j].x - (x + vx * (t - tau))
            dy = block.motion[j].y - (y + vy * (t - tau))
            square = ti.cast(largest_square(j, block), float)
            if ti.static(block.uses.shear):  # in the frame of the disk that looks
                rows = block.event_info[j].shear_row - info.shear_row
                dx += rows * (block.scale.aside + block.scale.drift * block.motion[j].tau)
                top = ti.sqrt(square) + ti.abs(rows * block.scale.drift)
                square = top * top
            fastest = ti.max(vx * vx + vy * vy, square)
            # Wider than the rounding of what stands here: it may mark a tile in vain, not miss a meeting.
            margin = ti.static(1.00001 if is_single_precision() else 1.000001)
            way = sigma + margin * ti.sqrt(fastest) * ahead
            if dx * dx + dy * dy < way * way:
                wrong = 1
        compare(i, j, start, rx, ry, ux, uy, sigma, size, last, best, partner, block)
        m += ABREAST
        if m <= end:
            j = entry_of(i, m, block)
    return best, partner, wrong


@ti.func
def partner_of(i, block: ti.template()):
    """Slot of the partner in the event of the disk in slot i."""
    return ti.cast(block.event_info[i].partner, ti.i32)


@ti.func
def key_of(t, limit, block: ti.template()):
    """Key of an event at time t, which has the order of times; NONE if it is later than `limit`."""
    key = NONE
    within = t <= limit and t < block.scale.window
    if ti.static(block.uses.low_memory):
        within = within and t <= block.scale.stored_at
    if within:
        key = ti.cast(t * (ti.cast(TICKS, float) / block.scale.window), ti.i32)
    return key


@ti.func
def keep_event(i, best, partner, limit, block: ti.template()):
    """Store the next event of the disk in slot i, and its key."""
    t = ti.select(partner == NO_PARTNER, FAR + 0.0 * best, best)
    block.key[i] = key_of(t, limit, block)
    block.event_info[i].partner = ti.cast(partner, ti.i16)
    if partner >= 0:
        block.event_info[i].partner_number = ti.cast(block.event_info[partner].number, ti.i16)
    block.motion[i].t_hit = t


@ti.func
def nothing_before(i, horizon, block: ti.template()):
    """Time and partner of the event of the disk in slot i if it meets nothing: a force on it alone, or the horizon."""
    best, partner = horizon, NO_PARTNER
    if ti.static(block.uses.actions):
        acts = action_time(i, block)
        if acts <= horizon:
            best, partner = acts, OWN_ACTION
    return best, partner


@ti.func
def predict_first(i, n_meet, meet, horizon, limit, region: ti.template(), block: ti.template()):
    """Find the first event of the disk in slot i in flights that all disks begin; `n_meet`, `meet` as `first_meeting`.

    Cells have no part in events.
    """
    best, partner = nothing_before(i, horizon, block)
    best, partner = first_meeting(i, n_meet, meet, best, partner, region, block)
    if ti.static(block.uses.walls):
        best, partner = first_wall(i, best, partner, region, block)
    block.motion[i].t_leave = FAR
    keep_event(i, best, partner, limit, block)


@ti.func
def prepare_block(tile, me, wider, faster, region: ti.template(), block: ti.template()):
    """Lay out the disks of a tile for a window: gathered, sorted, with lists and first events. Returns their number.

    Not more than block.slots: else the tile is marked. `region` gets its cells.
    """
    halo = block.reach[tile].halo
    c = me
    while c < block.slots:
        block.head[c] = 0
        c += THREADS
    if me < NOTES.tile:
        block.note[me] = 0
    note_tiles(tile, me, block)
    ti.simt.block.sync()
    choose_disks(tile, halo, me, region, block)
    ti.simt.block.sync()
    n = block.note.gathered
    # Disks may become faster than they are: `faster` times the fastest near this tile, but not much more than the
    # fastest of the gas. Two of them approach by `way` at most in the window. What adds speed within it is added below.
    square = ti.bit_cast(ti.cast(block.note.speed, ti.i64) << ti.i64(32), ti.f64) * (faster * faster)
    bound = block.clock.fastest * ti.max(faster / FASTER * FASTEST_OF_ALL, FASTEST_OF_ALL)
    square = ti.min(square, bound * bound)
    way = 2.0 * ti.cast(ti.sqrt(square), float) * block.scale.window
    if ti.static(block.uses.shear):  # rows of tiles move against each other
        drift = ti.abs(ti.cast(block.scale.drift, ti.f64))
        speed = ti.sqrt(square) + drift
        square = speed * speed
        way = 2.0 * ti.cast(speed + drift, float) * block.scale.window
    if ti.static(block.uses.walls):  # walls make disks faster, gravity too in the lab frame
        push = block.clock.wall_speed + pull_of(block) * ti.cast(block.scale.window, ti.f64)
        speed = ti.sqrt(square) + 2.0 * push * (faster / FASTER)
        square = speed * speed
        way = 2.0 * ti.cast(speed, float) * block.scale.window
    if ti.static(block.uses.actions):  # forces make disks faster
        speed = ti.sqrt(square) + ti.sqrt(block.clock.action_square) * (faster / FASTER)
        square = speed * speed
        way = 2.0 * ti.cast(speed, float) * block.scale.window
    # Longer lists than the window needs make the certificate hold more often.
    margin = ti.max(way, wider * ti.max(way, MARGIN * block.scale.widest))
    if n > block.slots:
        # All threads go on with no disk, so that each comes to every `sync`.
        n = 0
        if me == 0:
            block.note.mark = TOO_MANY
    found = region_around(tile, halo, block.scale.widest + margin, block)
    region.nx, region.ny, region.side_x, region.side_y = found.nx, found.ny, found.side_x, found.side_y
    count_by_cell(n, me, region, block)
    ti.simt.block.sync()
    m = me
    while m < n:
        block.order[slot_of(m, region, block)] = m
        m += THREADS
    ti.simt.block.sync()
    i = me
    while i < n:
        m = block.order[i]
        load_from(noted_tile(block.candidates[m].step, block), m, i, tile, region, block)
        if ti.static(block.uses.walls):
            x = block.motion[i].x - (region.x + 0.5 * region.nx * region.side_x)
            y = block.motion[i].y - (region.y + 0.5 * region.ny * region.side_y)
            ti.atomic_max(block.note.extent, upper_half(1.000001 * ti.cast(x * x + y * y, ti.f64)))
        i += THREADS
    ti.simt.block.sync()
    if ti.static(block.uses.walls):
        list_images(me, 0.5 * way, region, block)
        ti.simt.block.sync()
    i = me
    while i < n:
        full, n_meet, meet = list_neighbors(i, margin, region, block)
        if full == 1:
            ti.atomic_or(block.note.mark, LIST_FULL)
        if ti.static(block.uses.walls):
            list_walls(i, 0.5 * way, region, block)
        predict_first(i, n_meet, meet, first_horizon(block), FAR + 0.0 * margin, region, block)
        i += THREADS
    ti.simt.block.sync()
    return n, upper_half(square)


@ti.func
def is_first(i, block: ti.template()):
    """1 if the event of the disk in slot i comes before all others of both of its disks."""
    first = 0
    key = block.key[i]
    if key < NONE and block.low[i] == key:
        p = partner_of(i, block)
        if p < 0:
            first = 1
        elif block.low[p] == key:
            # Where both have stored it, the smaller slot counts.
            first = ti.cast(block.key[p] > key or i < p or partner_of(p, block) != i, ti.i32)
    return first


@ti.func
def queue_events(n, me, block: ti.template()):
    """Queue the events that come before all others around both of their disks. A warp looks at one after another."""
    lane = me % 32
    i = me
    while i - lane < n:
        first = 0
        if i < n:
            first = is_first(i, block)
        rest = ti.cast(ti.simt.warp.ballot(first), ti.u32)
        while rest != 0:
            leader = 31 - ti.math.clz(ti.cast(rest, ti.i32))
            rest ^= ti.u32(1) << ti.cast(leader, ti.u32)
            j = i - lane + leader
            p = partner_of(j, block)
            key = block.key[j]
            # Half a warp looks at the list of one disk, half at that of its partner.
            a = ti.select(lane < 16 or p < 0, j, p)
            late, m, end = 0, 1 + lane % 16, entry_of(a, 0, block)
            k = entry_of(a, m, block)
            ti.simt.warp.sync(ti.u32(0xFFFFFFFF))  # as in `look_around`
            while m <= end:
                # A disk near either of them has an event that is not later, and might come in between.
                if k != j and k != p and block.low[k] <= key:
                    late = 1
                m += 16
                if m <= end:
                    k = entry_of(a, m, block)
            if ti.simt.warp.ballot(late) == 0:
                if lane == 0:
                    at = ti.atomic_add(block.note.queued, 1)
                    if at < block.slots // 4:
                        block.queue[at] = ti.cast(j, ti.u16)
        i += THREADS


@ti.func
def queue_earliest(n, block: ti.template()):
    """Queue the earliest event of all: where keys are equal, none comes before all around it."""
    found = -1
    for i in range(n):
        if block.key[i] < NONE:
            if found < 0:
                found = i
            else:
                t, earliest = block.motion[i].t_hit, block.motion[found].t_hit
                if t < earliest:
                    found = i
                elif t == earliest:
                    if precedes(i, found, block):
                        found = i
    block.queue[0] = ti.cast(found, ti.u16)


@ti.func
def queue_least(n, me, block: ti.template()):
    """Queue the event that has the least key of all: the earliest one, unless there are several."""
    i = me
    while i < n:
        if block.key[i] < NONE:
            ti.atomic_min(block.note.least, block.key[i])
        i += THREADS
    ti.simt.block.sync()
    i = me
    while i < n:
        key = block.key[i]
        if key < NONE and key == block.note.least:
            p = partner_of(i, block)
            counts = p < 0
            if p >= 0:
                counts = block.key[p] > key or i < p or partner_of(p, block) != i  # not stored by both
            if counts:
                if ti.atomic_add(block.note.queued, 1) == 0:
                    block.queue[0] = ti.cast(i, ti.u16)
        i += THREADS


@ti.func
def collide_queue(tile, me, region: ti.template(), block: ti.template()):
    """The collisions of all queued events, each by a thread: those of a warp collide at the same time.

    The key of an event then says whether it was a collision (MET), or was STALE.
    """
    q, many = me, ti.min(block.note.queued, block.slots // 4)
    while q < many:
        i = ti.cast(block.queue[q], ti.i32)
        p = partner_of(i, block)
        block.key[i] = STALE
        if p < 0:
            block.key[i] = MET
            is_action = False
            if ti.static(block.uses.actions):
                is_action = p == OWN_ACTION
                if is_action:
                    act_alone(i, block.motion[i].t_hit, tile, region, block)
            if ti.static(block.uses.walls):
                if not is_action:
                    hit_wall(i, block.motion[i].t_hit, tile, region, block)
        elif ti.cast(block.event_info[p].number, ti.i16) == ti.cast(
            block.event_info[i].partner_number, ti.i16
        ):
            block.key[i] = MET
            collide(i, p, block.motion[i].t_hit, tile, region, block)
        q += THREADS


@ti.func
def predict_queue(me, horizon, limit, fastest, region: ti.template(), block: ti.template()):
    """Next events of the disks of all queued events, each by ABREAST threads, which look at the list of a disk."""
    lane = me % 32
    place = me % (2 * ABREAST)
    half = place // ABREAST
    mask = ti.u32((1 << (2 * ABREAST)) - 1) << ti.cast(lane - place, ti.u32)
    q, many = me // (2 * ABREAST), ti.min(block.note.queued, block.slots // 4)
    while q < many:
        i = ti.cast(block.queue[q], ti.i32)
        p, t = partner_of(i, block), block.motion[i].t_hit
        # One half looks for the disk, the other for its partner, which keeps its own event where this one was stale.
        looks = half == 0 or (block.key[i] == MET and p >= 0)
        a = ti.select(half == 0 or p < 0, i, p)
        square = block.event_info[a].max_speed_sq
        first = place % ABREAST + 1
        if not looks:
            first = MOST_NEAR + 1  # at none
        # Each thread begins with what happens without a meeting; the earliest of all threads then wins.
        best, partner = nothing_before(a, horizon, block)
        best, partner, wrong = look_around(a, first, t, best, partner, mask, region, block)
        for step in ti.static([2**k for k in reversed(range(ABREAST.bit_length() - 1))]):
            t_k, k = shuffled(best, step, mask), shuffled_word(partner, step, mask)
            earlier = t_k < best
            if t_k == best and k >= 0 and partner >= 0:  # ties without meetings are equal
                earlier = block.event_info[k].id < block.event_info[partner].id
            if earlier:
                best, partner = t_k, k
        ti.simt.warp.sync(mask)
        if wrong == 1:
            ti.atomic_or(block.note.mark, UNCERTAIN)
        if place % ABREAST == 0 and looks:
            if ti.static(block.uses.walls):
                best, partner = first_wall(a, best, partner, region, block)
            if square > fastest:
                ti.atomic_or(block.note.mark, TOO_FAST)
            keep_event(a, best, partner, limit, block)
        q += THREADS // (2 * ABREAST)


@ti.func
def forget_keys(n, me, block: ti.template()):
    """Forget the least keys of the events around each disk."""
    i = me
    while i < n:
        block.low[i] = NONE
        i += THREADS


@ti.func
def run_rounds(
    n, tile, me, horizon, limit, fastest, serial, rounds, region: ti.template(), block: ti.template()
):  # fmt: skip
    """All events until `limit`, in rounds, or until the tile is marked. Returns the number of rounds so far.

    If `serial`, one event after another.
    """
    going = 1
    forget_keys(n, me, block)
    ti.simt.block.sync()
    while going > 0:
        i, pending = me, 0
        while i < n:
            key = block.key[i]
            if key < NONE:
                pending = 1
                ti.atomic_min(block.low[i], key)
                p = partner_of(i, block)
                if p >= 0:
                    ti.atomic_min(block.low[p], key)
            i += THREADS
        if me == 0:
            block.note.queued, block.note.least = 0, NONE
            if rounds > MOST_ROUNDS:
                block.note.mark = ENDLESS
        # The same number for all threads: none leaves the loop while others wait for it. It is a barrier too.
        going = ti.simt.block.sync_count_nonzero(pending)
        if block.note.mark > 0:
            going = 0
        if going > 0:
            rounds += 1
            if serial == 0:
                queue_events(n, me, block)
            else:
                queue_least(n, me, block)
            ti.simt.block.sync()
            many = block.note.queued
            # Keys are rounded times. Where none is before all around it, or several are least, times decide.
            if many == 0 or (serial == 1 and many > 1):
                # All have read `queued` before one changes it.
                ti.simt.block.sync()
                if me == 0:
                    queue_earliest(n, block)
                    block.note.queued = 1
                ti.simt.block.sync()
            collide_queue(tile, me, region, block)
            ti.simt.block.sync()
            predict_queue(me, horizon, limit, fastest, region, block)
            forget_keys(n, me, block)
            ti.simt.block.sync()
    return rounds


@ti.func
def act_by_block(n, row, tile, me, limit, fastest, region: ti.template(), block: ti.template()):
    """Have the forces of a row of `kicks`, and others at the same time, act on all disks, which then look around.

    Returns the row of the forces that act next.
    """
    t = kick_time(row, block)
    # Forces at one time act as one: disks look around after the last of them only.
    end = row + 1
    while kick_time(end, block) == t:
        end += 1
    act_on_all(n, row, end, t, me, THREADS, tile, region, block)
    i = me
    while i < n:
        if block.event_info[i].max_speed_sq > fastest:
            ti.atomic_or(block.note.mark, TOO_FAST)
        i += THREADS
    ti.simt.block.sync()
    i = me
    while i < n:
        predict_first(i, ALL_NEAR, ti.u64(0), horizon_of(end, block), limit, region, block)
        i += THREADS
    return end


@ti.func
def run_stages(n, tile, me, fastest, serial, region: ti.template(), block: ti.template()):
    """All events of the window; forces act at their times, and own disks are written at each requested moment."""
    rounds, stage, going = 0, 0, 1
    row = 0
    if ti.static(block.uses.forced):
        row = ti.cast(block.clock.acted, ti.i32)
    while going > 0:
        limit = block.scale.moment[stage]
        # Keys of events after this stage's end were NONE: some of them are within the next stage.
        if stage > 0 or limit < FAR:
            i = me
            while i < n:
                block.key[i] = key_of(block.motion[i].t_hit, limit, block)
                i += THREADS
        ti.simt.block.sync()
        horizon = horizon_of(row, block)
        rounds = run_rounds(n, tile, me, horizon, limit, fastest, serial, rounds, region, block)
        ti.simt.block.sync()
        acts = 0
        if ti.static(block.uses.forced):
            at = kick_time(row, block)
            # A moment at the time of a force is written after the force has acted.
            acts = ti.cast(at <= block.scale.window and at <= limit and block.note.mark == 0, ti.i32)
            ti.simt.block.sync()
            if acts == 1:
                row = act_by_block(n, row, tile, me, limit, fastest, region, block)
        if acts == 1:
            pass
        elif limit < FAR and block.note.mark == 0:
            write(n, tile, AT_MOMENT + stage, me, THREADS, region, block)
            stage += 1
        else:
            going = 0


@ti.func
def write_block(n, tile, me, region: ti.template(), block: ti.template()):
    """Write the own disks at the window's end, and the bounds and sums of them all."""
    share = write(n, tile, AT_END, me, THREADS, region, block)
    warp = ti.u32(0xFFFFFFFF)  # all its threads
    for step in ti.static((16, 8, 4, 2, 1)):
        share.fastest = ti.max(share.fastest, shuffled(share.fastest, step, warp))
        share.squares += shuffled_f64(share.squares, step, warp)
        share.event_squares += shuffled_f64(share.event_squares, step, warp)
        share.excursion = ti.max(share.excursion, shuffled(share.excursion, step, warp))
        share.max_displacement = ti.max(share.max_displacement, shuffled(share.max_displacement, step, warp))
        share.overhang = ti.max(share.overhang, shuffled(share.overhang, step, warp))
    ti.simt.block.sync()
    # Flights have been written: their shared memory takes the shares of the warps.
    if me % 32 == 0:
        row = me // 32
        block.motion[row].x, block.motion[row].y = share.fastest, share.excursion
        block.motion[row].vx, block.motion[row].vy = share.max_displacement, share.overhang
        # Whole numbers: exact in any order.
        ti.atomic_add(block.tally[tile, AT_END].squares, share.squares)
        ti.atomic_add(block.tally[tile, AT_END].event_squares, share.event_squares)
    ti.simt.block.sync()
    if me == 0:
        for row in range(THREADS // 32):
            share.fastest, share.excursion = (
                ti.max(share.fastest, block.motion[row].x),
                ti.max(share.excursion, block.motion[row].y),
            )
            share.max_displacement = ti.max(share.max_displacement, block.motion[row].vx)
            share.overhang = ti.max(share.overhang, block.motion[row].vy)
        block.tally[tile, AT_END].fastest = ti.cast(share.fastest, ti.f64)
        block.reach[tile].excursion, block.reach[tile].max_displacement = (
            share.excursion,
            share.max_displacement,
        )
        block.reach[tile].overhang = share.overhang


@ti.func
def run_tile_by_block(tile, me, block: ti.template()):
    """The window of one tile."""
    halo = block.reach[tile].halo
    region = region_around(tile, halo, block.scale.widest, block)
    wider, faster = ti.cast(1.0, float), ti.cast(FASTER, float)
    attempt, n, mark = 0, 0, 0
    # What it writes down it cannot write again: pairs are written down in few windows only.
    serial = ti.cast((block.grid.watching & PAIRS) > 0, ti.i32)
    while attempt < ATTEMPTS:
        n, fastest = prepare_block(tile, me, wider, ti.cast(faster, ti.f64), region, block)
        if attempt == 0 and me == 0:
            block.tile[tile].gathered = n
            block.tile[tile].count.other[block.grid.part] = block.note.own
            block.tile[tile].n_ghosts = block.note.copies
            if ti.static(block.slots == BLOCK_SLOTS):  # whichever block runs it
                reserve_list(tile, block)
            block.note.room = 1
            if (block.note.mark & TOO_MANY) == 0:
                reserve_ghosts(tile, block)
                block.note.room = ti.cast((block.counter.full & FULL_GHOSTS) == 0, ti.i32)
        ti.simt.block.sync()
        if block.note.mark == 0 and block.note.room == 1:
            run_stages(n, tile, me, fastest, serial, region, block)
        ti.simt.block.sync()
        # Read by all before the next attempt clears it.
        mark = block.note.mark
        ti.simt.block.sync()
        attempt += 1
        # Other lists mend none of the other marks; and records of a window are written once.
        if mark == 0 or mark >= TOO_MANY or block.grid.watching > 0:
            attempt = ATTEMPTS
        elif attempt < ATTEMPTS:
            # Shorter lists fit; longer ones look further, so that the order is certain more often.
            if (mark & LIST_FULL) > 0:
                wider *= 0.8
            elif (mark & UNCERTAIN) > 0:
                wider *= 1.4
            if attempt == ATTEMPTS - 1:
                serial, wider = 1, 0.0 * wider  # then the order is certain, with the shortest lists
            if (mark & TOO_FAST) > 0:
                faster *= 1.3
            clear(tile, me, THREADS, block)
        ti.simt.block.sync()
    if block.note.room == 0:
        mark = NO_ROOM
    if mark == 0:
        write_block(n, tile, me, region, block)
    if me == 0:
        block.tile[tile].mark = mark
        if mark > 0:
            block.tile[tile].n_ghosts = 0
        if (mark & TOO_MANY) > 0:
            if ti.static(block.slots == BLOCK_SLOTS):
                postpone(tile, block)
            else:
                block.tile[tile].mark = NO_BLOCK
    ti.simt.block.sync()


@ti.func
def postpone(tile, block: ti.template()):
    """Leave a tile to `run_dense_tiles`."""
    block.tile[tile].mark = TOO_MANY
    block.dense[ti.atomic_add(block.counter.n_dense, 1)] = tile


@ti.func
def start_tile(tile, me, block: ti.template()):
    """Begin the window of a tile, and run it unless it needs more room."""
    begin(tile, me, THREADS, block)
    ti.simt.block.sync()
    # Tiles that are run again have wider halos, so more disks: larger blocks run them.
    if block.counter.again == 0:
        run_tile_by_block(tile, me, block)
    elif me == 0:
        postpone(tile, block)


@ti.func
def take_tile(n_tiles, me, block: ti.template()):
    """Number of the next one of so many tiles, the same for all threads; -1 if none is left."""
    if me == 0:
        k = ti.atomic_add(block.counter.next_tile, 1)
        block.note.tile = ti.select(k < n_tiles and block.counter.halted == 0, k, -1)
    ti.simt.block.sync()
    return block.note.tile


# A kernel for a GPU has 64 arguments at most, and lines of thin gases are for CPUs.
OF_CPUS = ("line", "line_slot", "bunch", "spare")
BLOCKS = Arrays(
    " ".join(
        (
            *(name for name in WINDOW.names if name not in OF_CPUS),
            "near near_image image_list dense block_integers block_reals block_sums",
        )
    )
)


@ti.func
def end_window(ends: ti.template(), gas: ti.template()):
    """Add up the sums of all tiles and verify them, if the window `ends`; on ranks it does later."""
    sum_tiles(gas)
    if ti.static(not gas.uses.ranks):
        verify_tiles(ends, gas)


@kernel
def run_windows_by_blocks(n_listed: ti.i32, ends: ti.i32, gas: BLOCKS):
    """As `windows.run_windows_on_gpu`, a tile by a block of threads, and `windows.verify`, if the window `ends`.

    Else `run_dense_tiles` has to follow: it runs those that have more disks than fit, and those that are run again,
    which have wider halos. Tiles that both mark have to be run by `run_windows_on_gpu`.
    """
    for _ in range(1):
        round_products(gas)
        begin_window(gas)
        if ti.static(gas.uses.walls):
            wall_phases(gas)
        gas.counter.next_tile = 0
        if gas.counter.halted == 0:
            gas.counter.n_dense = 0
    ti.loop_config(block_dim=THREADS)
    for item in range(MOST_BLOCKS * THREADS):
        round_products(gas)
        me = item % THREADS
        number = item // THREADS
        block = ti.static(block_of(gas, number, BLOCK_SLOTS))
        if number < gas.grid.blocks:
            k = take_tile(n_listed, me, block)
            while k >= 0:
                ti.simt.block.sync()
                start_tile(tile_of(k, block), me, block)
                k = take_tile(n_listed, me, block)
        ti.simt.block.sync()  # another item of the loop may follow
    end_window(ends, gas)


@kernel
def run_dense_tiles(gas: BLOCKS):
    """Run the tiles of the window that need blocks with room for DENSE_SLOTS, and end the window.

    A kernel of its own: Taichi gives shared arrays of several loops of a kernel the same names, and then one size.
    """
    for _ in range(1):
        gas.counter.next_tile = 0
    ti.loop_config(block_dim=THREADS)
    for item in range(MOST_BLOCKS * BLOCK_SLOTS // DENSE_SLOTS * THREADS):
        round_products(gas)
        me = item % THREADS
        number = item // THREADS
        block = ti.static(block_of(gas, number, DENSE_SLOTS))
        if number < gas.grid.blocks * BLOCK_SLOTS // DENSE_SLOTS:
            k = take_tile(gas.counter.n_dense, me, block)
            while k >= 0:
                ti.simt.block.sync()
                run_tile_by_block(block.dense[k], me, block)
                k = take_tile(gas.counter.n_dense, me, block)
        ti.simt.block.sync()  # another item of the loop may follow
    end_window(1, gas)
