"""What happens to one disk in a round: it collides, predicts, is marked, is rolled back.

The order of these steps and what they guarantee is told in `rounds.py`.
"""

import taichi as ti

from .extend import needed_level, push, reach_of
from .law import collide_pair
from .layout import (
    ACTIVE,
    AFFECTED,
    AFFECTED_ROW,
    BEFORE,
    CHANGED_ROW,
    DIRTY,
    END,
    FAR,
    HEAD,
    HORIZON,
    ID,
    INVERSE_MASS,
    KIND,
    LATCHED,
    LENGTH,
    MATERIAL,
    MOST_LEVEL,
    N_LOG,
    N_STANDING,
    N_UNDONE,
    N_VIOLATIONS,
    NEVER,
    NUMBER,
    PARTNER,
    PREVIOUS,
    RADIUS,
    REACH,
    REGIME,
    ROLL_BACK,
    ROLLED_BACK,
    ROUND,
    ROW,
    SAME_FRAME,
    SEQ,
    SLOT,
    SPIN,
    STANDS,
    TAU,
    TE,
    TILE_X,
    TILE_Y,
    TIME,
    UNDO,
    UNDO_ROW,
    VX,
    VY,
    K,
    X,
    Y,
    level_of,
    meeting_time,
    n_others,
    n_own,
    precedes,
    sooner,
)


@ti.func
def record(
    entry,
    side,
    slot,
    flight: ti.template(),
    link: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Log a disk's state before its collision number `entry`, and make that its latest."""
    first = BEFORE + 5 * side
    log_real[entry][first] = flight[slot][X]
    log_real[entry][first + 1] = flight[slot][Y]
    log_real[entry][first + 2] = flight[slot][VX]
    log_real[entry][first + 3] = flight[slot][VY]
    log_real[entry][first + 4] = flight[slot][SPIN]
    log_int[entry][SLOT + side] = slot
    log_int[entry][PREVIOUS + side] = link[slot][HEAD]
    log_int[entry][NUMBER + side] = link[slot][SEQ]
    link[slot][HEAD] = entry
    link[slot][SEQ] += 1


@ti.func
def collide_at(
    entry,
    t,
    a,
    b,
    shift,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    kinds: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    limit: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
    law: ti.template(),
):
    """Collide slots a < b at time t, b lying one `shift` from a, and log it as record `entry`."""
    log_real[entry][TIME] = t
    record(entry, 0, a, flight, link, log_real, log_int)
    record(entry, 1, b, flight, link, log_real, log_int)
    x_a = flight[a][X] + flight[a][VX] * (t - flight[a][TAU])
    y_a = flight[a][Y] + flight[a][VY] * (t - flight[a][TAU])
    x_b = flight[b][X] + flight[b][VX] * (t - flight[b][TAU])
    y_b = flight[b][Y] + flight[b][VY] * (t - flight[b][TAU])
    rx = x_b - x_a + (shift // 3 - 1) * scale[TILE_X]
    ry = y_b - y_a + (shift % 3 - 1) * scale[TILE_Y]
    r = ti.sqrt(rx * rx + ry * ry)
    kind_a = meta[a][KIND]
    kind_b = meta[b][KIND]
    p = ti.cast(kinds[kind_a][MATERIAL], ti.i32)
    q = ti.cast(kinds[kind_b][MATERIAL], ti.i32)
    vx_a, vy_a, w_a, vx_b, vy_b, w_b, _, _, sticking, rolling = collide_pair(
        law[p, q, 0], law[p, q, 1], law[p, q, 2], law[p, q, 3], law[p, q, 4],
        rx / r, ry / r,
        kinds[kind_a][INVERSE_MASS], flight[a][RADIUS], kinds[kind_a][K],
        flight[a][VX], flight[a][VY], flight[a][SPIN],
        kinds[kind_b][INVERSE_MASS], flight[b][RADIUS], kinds[kind_b][K],
        flight[b][VX], flight[b][VY], flight[b][SPIN],
    )  # fmt: skip
    flight[a][X] = x_a
    flight[a][Y] = y_a
    flight[a][VX] = vx_a
    flight[a][VY] = vy_a
    flight[a][TAU] = t
    flight[a][SPIN] = w_a
    flight[b][X] = x_b
    flight[b][Y] = y_b
    flight[b][VX] = vx_b
    flight[b][VY] = vy_b
    flight[b][TAU] = t
    flight[b][SPIN] = w_b
    log_int[entry][REGIME] = ti.cast(sticking, ti.i32) + 2 * ti.cast(rolling, ti.i32)
    log_int[entry][STANDS] = 1
    # The neighbour list is complete while nobody moves further than his reach. A disk that becomes faster gets a
    # longer list (`extend`); if the box does not allow that, the epoch ends before the disk comes so far.
    fastest2 = ti.max(vx_a * vx_a + vy_a * vy_a, vx_b * vx_b + vy_b * vy_b)
    if fastest2 * (scale[HORIZON] * scale[HORIZON]) > scale[REACH] * scale[REACH]:
        for disk in ti.static(range(2)):
            slot = a
            if ti.static(disk == 1):
                slot = b
            level = needed_level(flight[slot][VX], flight[slot][VY], scale)
            if level > grid[MOST_LEVEL]:
                speed = ti.sqrt(flight[slot][VX] ** 2 + flight[slot][VY] ** 2)
                # It has not come so far yet at t, whatever its speed is now.
                ti.atomic_min(limit[END], ti.max(t, reach_of(level_of(link[slot][LENGTH]), scale) / speed))


@ti.func
def collide(
    i,
    everybody,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    kinds: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    lists: ti.template(),
    counter: ti.template(),
    limit: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
    law: ti.template(),
):
    """Step 1 for disk i: collide with its partner, if they name each other and the event is due.

    Both members of a pair may be active; the lower slot then does the work. `everybody` > 0 says that all are.
    """
    code = link[i][PARTNER]
    t = flight[i][TE]
    if code >= 0 and t < limit[LATCHED]:
        j = code // 9
        shift = code - 9 * j
        round_ = counter[ROUND]
        mutual = link[j][PARTNER] == 9 * i + 8 - shift and flight[j][TE] == t
        mine = i < j
        if everybody == 0 and link[j][ACTIVE] != round_:
            mine = True
        if mutual and mine:
            # Always from the lower slot to the higher, whoever does it: the same bits.
            a = ti.min(i, j)
            b = ti.max(i, j)
            if i != a:
                shift = 8 - shift
            entry = ti.atomic_add(counter[N_LOG], 1)
            ti.atomic_add(counter[N_STANDING], 1)
            collide_at(
                entry, t, a, b, shift, grid, scale, flight, kinds, link, meta, limit, log_real, log_int, law
            )
            link[a][DIRTY] = round_
            link[b][DIRTY] = round_
            row = CHANGED_ROW + round_ % 2
            push(row, a, lists, counter)
            push(row, b, lists, counter)


@ti.func
def neighbour_code(i, q, lengths, row, neighbour: ti.template()):
    """The q-th neighbour of disk i as a code: those in the same frame first, then the others."""
    own = n_own(lengths)
    code = 0
    if q < own:
        code = 9 * neighbour[row * i + q] + SAME_FRAME
    else:
        code = neighbour[row * i + row - 1 - (q - own)]
    return code


@ti.func
def predict(
    i,
    changed: ti.template(),
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    neighbour: ti.template(),
    lists: ti.template(),
    counter: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Steps 2 and 3 (`changed`) or 5 for disk i: its earliest event, whom it affects, who collided too early."""
    round_ = counter[ROUND]
    x, y, vx, vy = flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY]
    tau, radius = flight[i][TAU], flight[i][RADIUS]
    head = link[i][HEAD]
    horizon = scale[HORIZON]
    lengths = link[i][LENGTH]
    earliest = FAR
    partner = -1
    for q in range(n_own(lengths) + n_others(lengths)):
        code = neighbour_code(i, q, lengths, grid[ROW], neighbour)
        j = code // 9
        shift = code - 9 * j
        shift_x = (shift // 3 - 1) * scale[TILE_X]
        shift_y = (shift % 3 - 1) * scale[TILE_Y]
        sigma = radius + flight[j][RADIUS]
        head_j = link[j][HEAD]
        t = FAR
        # A pair whose latest collision was with each other separates: it cannot meet again in straight flight.
        if head < 0 or head != head_j:
            t = meeting_time(
                x, y, vx, vy, tau,
                flight[j][X], flight[j][Y], flight[j][VX], flight[j][VY], flight[j][TAU],
                shift_x, shift_y, sigma, horizon,
            )  # fmt: skip
        if ti.static(changed):
            # Causality: walk back over the neighbour's flights that ended after this disk's began.
            undo = NEVER
            entry = head_j
            while entry >= 0:
                ended = log_real[entry][TIME]
                side = 0
                if log_int[entry][SLOT] != j:
                    side = 1
                before = log_int[entry][PREVIOUS + side]
                began = 0.0
                if before >= 0:
                    began = log_real[before][TIME]
                if ended <= tau:
                    entry = -1
                else:
                    if began < ended and (head < 0 or before != head):
                        first = BEFORE + 5 * side
                        crossing = meeting_time(
                            x, y, vx, vy, tau,
                            log_real[entry][first], log_real[entry][first + 1],
                            log_real[entry][first + 2], log_real[entry][first + 3], began,
                            shift_x, shift_y, sigma, ended,
                        )  # fmt: skip
                        if crossing <= ended:
                            early = crossing < ended
                            if crossing == ended:
                                # An exact tie falls to the smaller pair of ids.
                                other = log_int[entry][SLOT + 1 - side]
                                early = precedes(meta[i][ID], meta[j][ID], meta[other][ID], meta[j][ID])
                            if early:
                                undo = log_int[entry][NUMBER + side]
                                t = crossing
                    entry = before
            if undo < NEVER and grid[ROLL_BACK] == 1:
                ti.atomic_add(counter[N_VIOLATIONS], 1)
                if ti.atomic_min(link[j][UNDO], undo) == NEVER:
                    push(UNDO_ROW, j, lists, counter)
            if link[j][DIRTY] != round_:
                partner_j = link[j][PARTNER]
                affected = False
                if partner_j >= 0:
                    affected = partner_j // 9 == i
                if t < horizon:
                    if t < flight[j][TE]:
                        affected = True
                    elif t == flight[j][TE]:
                        affected = affected or meta[i][ID] < meta[partner_j // 9][ID]
                if affected:  # nested: Taichi evaluates both sides of `and`
                    if ti.atomic_max(link[j][AFFECTED], round_) < round_:
                        push(AFFECTED_ROW + round_ % 2, j, lists, counter)
        if sooner(t, j, earliest, partner, horizon, meta):
            earliest = t
            partner = code
    flight[i][TE] = earliest
    link[i][PARTNER] = partner
    link[i][ACTIVE] = round_ + 1


@ti.func
def propagate(link: ti.template(), lists: ti.template(), counter: ti.template(), log_int: ti.template()):
    """Step 3: carry the marks to partners until nothing changes. A minimum, so the result is unique."""
    moved = 1
    while moved == 1:
        moved = 0
        q = 0
        while q < counter[UNDO_ROW]:
            i = lists[UNDO_ROW, q]
            entry = link[i][HEAD]
            while entry >= 0:
                side = 0
                if log_int[entry][SLOT] != i:
                    side = 1
                if log_int[entry][NUMBER + side] >= link[i][UNDO]:
                    j = log_int[entry][SLOT + 1 - side]
                    number = log_int[entry][NUMBER + 1 - side]
                    if number < link[j][UNDO]:
                        if link[j][UNDO] == NEVER:
                            push(UNDO_ROW, j, lists, counter)
                        link[j][UNDO] = number
                        moved = 1
                    entry = log_int[entry][PREVIOUS + side]
                else:
                    entry = -1
            q += 1


@ti.func
def restore(
    i,
    flight: ti.template(),
    link: ti.template(),
    counter: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Step 4: put disk i back to the state before its first undone collision. It names nobody until it predicts."""
    undo = link[i][UNDO]
    entry = link[i][HEAD]
    found = 0
    while found == 0:
        side = 0
        if log_int[entry][SLOT] != i:
            side = 1
        log_int[entry][STANDS] = 0
        before = log_int[entry][PREVIOUS + side]
        if side == 0:
            ti.atomic_add(counter[N_UNDONE], 1)
            ti.atomic_sub(counter[N_STANDING], 1)
        if log_int[entry][NUMBER + side] == undo:
            first = BEFORE + 5 * side
            flight[i][X] = log_real[entry][first]
            flight[i][Y] = log_real[entry][first + 1]
            flight[i][VX] = log_real[entry][first + 2]
            flight[i][VY] = log_real[entry][first + 3]
            flight[i][SPIN] = log_real[entry][first + 4]
            flight[i][TAU] = 0.0
            if before >= 0:
                flight[i][TAU] = log_real[before][TIME]
            found = 1
        entry = before
    link[i][HEAD] = entry
    link[i][SEQ] = undo
    link[i][UNDO] = NEVER
    link[i][PARTNER] = ROLLED_BACK
    flight[i][TE] = FAR
