"""What happens to one disk in a round: it collides, predicts, is marked, is rolled back.

The order of these steps and what they guarantee is told in `rounds.py`.
"""

from .contact import ELASTIC, collided, just_collided
from .flights import id_at, id_of, meeting_time, precedes, shift_by, sooner
from .history import flight_between, previous, record, side_of
from .language import ti
from .layout import (
    ACTIVE,
    AFFECTED,
    AFFECTED_ROW,
    BEFORE,
    CHANGED_ROW,
    DIRTY,
    FAR,
    FIRST_WALL,
    HEAD,
    HORIZON,
    HOW,
    ID,
    INVERSE_MASS,
    KIND,
    LATCHED,
    LENGTH,
    MATERIAL,
    N_ELASTIC,
    N_LOG,
    N_STANDING,
    N_UNDONE,
    N_VIOLATIONS,
    N_WALL_HITS,
    NEVER,
    NUMBER,
    PARTNER,
    PREVIOUS,
    RADIUS,
    ROLL_BACK,
    ROLLED_BACK,
    ROUND,
    ROW,
    SAME_FRAME,
    SEQ,
    SHIFT_BITS,
    SLOT,
    SPIN,
    STANDS,
    TAU,
    TE,
    TIME,
    UNDO,
    UNDO_ROW,
    VX,
    VY,
    K,
    X,
    Y,
    n_others,
    n_own,
    push,
)
from .levels import limit_if_too_fast
from .walls import first_wall, hit_wall


@ti.func
def collide_at(entry, t, a, b, shift, gas: ti.template()):
    """Collide slots a < b at time t, b lying one `shift` from a, and log it as record `entry`."""
    lasting = 0
    if ti.static(gas.uses.remembers):
        lasting = ti.max(just_collided(a, t, gas), just_collided(b, t, gas))
    gas.log_real[entry][TIME] = t
    record(entry, 0, a, gas)
    record(entry, 1, b, gas)
    x_a = gas.flight[a][X] + gas.flight[a][VX] * (t - gas.flight[a][TAU])
    y_a = gas.flight[a][Y] + gas.flight[a][VY] * (t - gas.flight[a][TAU])
    x_b = gas.flight[b][X] + gas.flight[b][VX] * (t - gas.flight[b][TAU])
    y_b = gas.flight[b][Y] + gas.flight[b][VY] * (t - gas.flight[b][TAU])
    shift_x, shift_y, drift = shift_by(shift, gas)
    vx_b = gas.flight[b][VX]
    if ti.static(gas.uses.sheared):
        # In the frame of a's row, where b is faster.
        shift_x += drift * t
        vx_b += drift
    rx = x_b - x_a + shift_x
    ry = y_b - y_a + shift_y
    r = ti.sqrt(rx * rx + ry * ry)
    kind_a = gas.meta[a][KIND]
    kind_b = gas.meta[b][KIND]
    p = ti.cast(gas.kinds[kind_a][MATERIAL], ti.i32)
    q = ti.cast(gas.kinds[kind_b][MATERIAL], ti.i32)
    nx, ny = rx / r, ry / r
    vx_a, vy_a, w_a, vx_b, vy_b, w_b, how, lost = collided(
        p, q, nx, ny,
        gas.kinds[kind_a][INVERSE_MASS], gas.flight[a][RADIUS], gas.kinds[kind_a][K],
        gas.flight[a][VX], gas.flight[a][VY], gas.flight[a][SPIN],
        gas.kinds[kind_b][INVERSE_MASS], gas.flight[b][RADIUS], gas.kinds[kind_b][K],
        vx_b, gas.flight[b][VY], gas.flight[b][SPIN],
        lasting, gas,
    )  # fmt: skip
    gas.flight[a][X] = x_a
    gas.flight[a][Y] = y_a
    gas.flight[a][VX] = vx_a
    gas.flight[a][VY] = vy_a
    gas.flight[a][TAU] = t
    gas.flight[a][SPIN] = w_a
    gas.flight[b][X] = x_b
    gas.flight[b][Y] = y_b
    if ti.static(gas.uses.sheared):
        vx_b -= drift
    gas.flight[b][VX] = vx_b
    gas.flight[b][VY] = vy_b
    gas.flight[b][TAU] = t
    gas.flight[b][SPIN] = w_b
    gas.log_int[entry][HOW] = how + SHIFT_BITS * shift
    if ti.static(gas.uses.tallied):
        gas.log_loss[entry] = lost
    if how >= ELASTIC:
        ti.atomic_add(gas.counter[N_ELASTIC], 1)
    gas.log_int[entry][STANDS] = 1
    limit_if_too_fast(a, t, gas)
    limit_if_too_fast(b, t, gas)


@ti.func
def collide(i, everybody, gas: ti.template()):
    """Step 1 for disk i: collide with its partner, if they name each other and the event is due.

    Both members of a pair may be active; the lower slot then does the work. `everybody` > 0 says that all are.
    """
    code = gas.link[i][PARTNER]
    t = gas.flight[i][TE]
    if code >= 0 and t < gas.limit[LATCHED]:
        j = code // 9
        shift = code - 9 * j
        round_ = gas.counter[ROUND]
        mutual = gas.link[j][PARTNER] == 9 * i + 8 - shift and gas.flight[j][TE] == t
        mine = i < j
        if everybody == 0 and gas.link[j][ACTIVE] != round_:
            mine = True
        if mutual and mine:
            # Always from the lower slot to the higher, whoever does it: the same bits.
            a = ti.min(i, j)
            b = ti.max(i, j)
            if i != a:
                shift = 8 - shift
            entry = ti.atomic_add(gas.counter[N_LOG], 1)
            ti.atomic_add(gas.counter[N_STANDING], 1)
            collide_at(entry, t, a, b, shift, gas)
            gas.link[a][DIRTY] = round_
            gas.link[b][DIRTY] = round_
            row = CHANGED_ROW + round_ % 2
            push(row, a, gas)
            push(row, b, gas)
    if ti.static(gas.uses.walled):
        if code <= FIRST_WALL and t < gas.limit[LATCHED]:
            hit_wall(ti.atomic_add(gas.counter[N_LOG], 1), t, i, gas)
            gas.link[i][DIRTY] = gas.counter[ROUND]
            push(CHANGED_ROW + gas.counter[ROUND] % 2, i, gas)


@ti.func
def neighbour_code(i, q, lengths, row, gas: ti.template()):
    """The q-th neighbour of disk i as a code: those in the same frame first, then the others."""
    own = n_own(lengths)
    code = 0
    if q < own:
        code = 9 * gas.neighbour[row * i + q] + SAME_FRAME
    else:
        code = gas.neighbour[row * i + row - 1 - (q - own)]
    return code


@ti.func
def mark(i, number, gas: ti.template()):
    """Undo disk i's collisions from that number on."""
    if ti.atomic_min(gas.link[i][UNDO], number) == NEVER:
        push(UNDO_ROW, i, gas)


@ti.func
def predict(i, changed: ti.template(), gas: ti.template()):
    """Steps 2 and 3 (`changed`) or 5 for disk i: its earliest event, whom it affects, who collided too early."""
    round_ = gas.counter[ROUND]
    x, y, vx, vy = gas.flight[i][X], gas.flight[i][Y], gas.flight[i][VX], gas.flight[i][VY]
    tau, radius = gas.flight[i][TAU], gas.flight[i][RADIUS]
    head = gas.link[i][HEAD]
    horizon = gas.scale[HORIZON]
    lengths = gas.link[i][LENGTH]
    earliest = FAR
    partner = -1
    for q in range(n_own(lengths) + n_others(lengths)):
        code = neighbour_code(i, q, lengths, gas.grid[ROW], gas)
        j = code // 9
        shift = code - 9 * j
        shift_x, shift_y, drift = shift_by(shift, gas)
        sigma = radius + gas.flight[j][RADIUS]
        head_j = gas.link[j][HEAD]
        t = FAR
        # A pair whose latest collision was with each other separates: it cannot meet again in straight flight.
        if head < 0 or head != head_j:
            t = meeting_time(
                x, y, vx, vy, tau,
                gas.flight[j][X], gas.flight[j][Y], gas.flight[j][VX], gas.flight[j][VY], gas.flight[j][TAU],
                shift_x, shift_y, drift, sigma, horizon, gas,
            )  # fmt: skip
        if ti.static(changed):
            # Causality: walk back over the neighbour's flights that ended after this disk's began.
            undo = NEVER
            entry = head_j
            while entry >= 0:
                before = previous(entry, j, gas)
                xj, yj, vxj, vyj, began, ended, number, other = flight_between(j, before, entry, horizon, gas)
                if ended <= tau:
                    entry = -1
                else:
                    if began < ended and (head < 0 or before != head):
                        crossing = meeting_time(
                            x, y, vx, vy, tau, xj, yj, vxj, vyj, began,
                            shift_x, shift_y, drift, sigma, ended, gas,
                        )  # fmt: skip
                        if crossing <= ended:
                            early = crossing < ended
                            if crossing == ended:
                                # An exact tie falls to the smaller pair of ids.
                                early = precedes(
                                    gas.meta[i][ID], gas.meta[j][ID], id_at(other, gas), gas.meta[j][ID]
                                )
                            if early:
                                undo = number
                                t = crossing
                    entry = before
            if undo < NEVER and gas.grid[ROLL_BACK] == 1:
                ti.atomic_add(gas.counter[N_VIOLATIONS], 1)
                mark(j, undo, gas)
            if gas.link[j][DIRTY] != round_:
                partner_j = gas.link[j][PARTNER]
                affected = False
                if partner_j >= 0:
                    affected = partner_j // 9 == i
                if t < horizon:
                    if t < gas.flight[j][TE]:
                        affected = True
                    elif t == gas.flight[j][TE]:
                        affected = affected or gas.meta[i][ID] < id_of(partner_j, gas)
                if affected:  # nested: Taichi evaluates both sides of `and`
                    if ti.atomic_max(gas.link[j][AFFECTED], round_) < round_:
                        push(AFFECTED_ROW + round_ % 2, j, gas)
        if sooner(t, j, earliest, partner, horizon, gas):
            earliest = t
            partner = code
    if ti.static(gas.uses.walled):
        t, code = first_wall(i, gas)
        if t < earliest:
            earliest = t
            partner = code
    gas.flight[i][TE] = earliest
    gas.link[i][PARTNER] = partner
    gas.link[i][ACTIVE] = round_ + 1


@ti.func
def propagate(gas: ti.template()):
    """Step 3: carry the marks to partners until nothing changes. A minimum, so the result is unique."""
    moved = 1
    while moved == 1:
        moved = 0
        q = 0
        while q < gas.counter[UNDO_ROW]:
            i = gas.lists[UNDO_ROW, q]
            entry = gas.link[i][HEAD]
            while entry >= 0:
                side = side_of(entry, i, gas)
                if gas.log_int[entry][NUMBER + side] >= gas.link[i][UNDO]:
                    j = gas.log_int[entry][SLOT + 1 - side]
                    number = gas.log_int[entry][NUMBER + 1 - side]
                    if j >= 0:  # not a wall
                        if number < gas.link[j][UNDO]:
                            if gas.link[j][UNDO] == NEVER:
                                push(UNDO_ROW, j, gas)
                            gas.link[j][UNDO] = number
                            moved = 1
                    entry = gas.log_int[entry][PREVIOUS + side]
                else:
                    entry = -1
            q += 1


@ti.func
def restore(i, gas: ti.template()):
    """Step 4: put disk i back to the state before its first undone collision. It names nobody until it predicts."""
    undo = gas.link[i][UNDO]
    entry = gas.link[i][HEAD]
    found = 0
    while found == 0:
        side = side_of(entry, i, gas)
        gas.log_int[entry][STANDS] = 0
        before = gas.log_int[entry][PREVIOUS + side]
        if side == 0 and gas.log_int[entry][HOW] % SHIFT_BITS >= ELASTIC:
            ti.atomic_sub(gas.counter[N_ELASTIC], 1)
        if gas.log_int[entry][SLOT + 1] < 0:
            ti.atomic_sub(gas.counter[N_WALL_HITS], 1)
        elif side == 0:
            ti.atomic_add(gas.counter[N_UNDONE], 1)
            ti.atomic_sub(gas.counter[N_STANDING], 1)
        if gas.log_int[entry][NUMBER + side] == undo:
            first = BEFORE + 5 * side
            gas.flight[i][X] = gas.log_real[entry][first]
            gas.flight[i][Y] = gas.log_real[entry][first + 1]
            gas.flight[i][VX] = gas.log_real[entry][first + 2]
            gas.flight[i][VY] = gas.log_real[entry][first + 3]
            gas.flight[i][SPIN] = gas.log_real[entry][first + 4]
            gas.flight[i][TAU] = 0.0
            if before >= 0:
                gas.flight[i][TAU] = gas.log_real[before][TIME]
            found = 1
        entry = before
    gas.link[i][HEAD] = entry
    gas.link[i][SEQ] = undo
    gas.link[i][UNDO] = NEVER
    gas.link[i][PARTNER] = ROLLED_BACK
    gas.flight[i][TE] = FAR
