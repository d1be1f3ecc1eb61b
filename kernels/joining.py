"""What tiles must settle with each other after each ran by itself."""

from .events import mark, propagate, restore
from .flights import id_at, meeting, meeting_time, offer, precedes, shift_by
from .history import flight_between, previous
from .language import ti
from .layout import (
    ACTIVE,
    AFFECTED,
    AFFECTED_ROW,
    CELLS_X,
    CELLS_Y,
    CHANGED_ROW,
    FAR,
    HEAD,
    HORIZON,
    ID,
    LENGTH,
    N_VIOLATIONS,
    NEVER,
    PARTNER,
    RADIUS,
    ROLL_BACK,
    ROLLED_BACK,
    ROUND,
    ROW,
    SPREAD,
    TE,
    TILES_X,
    TILES_Y,
    UNDO_ROW,
    WINDOW,
    GasArrays,
    Rows,
    Table,
    n_others,
    push,
)
from .rounds import next_round
from .tiles import UNSURE


@ti.func
def check_history(i, j, shift, gas: ti.template()):
    """Test every flight of disk i against every flight of disk j that it overlaps in time.

    The earliest meeting that neither disk's collisions prevented undoes those that followed it.
    """
    sigma = gas.flight[i][RADIUS] + gas.flight[j][RADIUS]
    shift_x, shift_y, drift = shift_by(shift, gas)
    horizon = gas.scale[HORIZON]
    found = horizon
    undo_i = NEVER
    undo_j = NEVER
    # A flight ends with record `end_` (-1: not yet), and begins with record `begin_` (-1: with the epoch).
    end_i = -1
    begin_i = gas.link[i][HEAD]
    more_i = 1
    while more_i == 1:
        xi, yi, vxi, vyi, start_i, stop_i, number_i, other_i = flight_between(i, begin_i, end_i, horizon, gas)
        end_j = -1
        begin_j = gas.link[j][HEAD]
        more_j = 1
        while more_j == 1:
            xj, yj, vxj, vyj, start_j, stop_j, number_j, other_j = flight_between(
                j, begin_j, end_j, horizon, gas
            )
            if start_j < stop_i and start_i < stop_j and start_i < stop_i and start_j < stop_j:
                # Two flights that began with one collision separate; two that have not ended are for predictions.
                if (end_i >= 0 or end_j >= 0) and (begin_i < 0 or begin_i != begin_j):
                    before = ti.min(found, ti.min(stop_i, stop_j))
                    t = meeting_time(
                        xi, yi, vxi, vyi, start_i, xj, yj, vxj, vyj, start_j,
                        shift_x, shift_y, drift, sigma, before, gas,
                    )  # fmt: skip
                    real = t < found and t <= before
                    # An exact tie falls to the smaller pair of ids.
                    if t == stop_i and end_i >= 0:
                        real = real and precedes(
                            gas.meta[i][ID], gas.meta[j][ID], gas.meta[i][ID], id_at(other_i, gas)
                        )
                    if t == stop_j and end_j >= 0:
                        real = real and precedes(
                            gas.meta[i][ID], gas.meta[j][ID], gas.meta[j][ID], id_at(other_j, gas)
                        )
                    if real:
                        found = t
                        undo_i = number_i
                        undo_j = number_j
            # Older flights of j matter while they end after this flight of i begins.
            if begin_j < 0 or start_j <= start_i:
                more_j = 0
            else:
                end_j = begin_j
                begin_j = previous(end_j, j, gas)
        if begin_i < 0:
            more_i = 0
        else:
            end_i = begin_i
            begin_i = previous(end_i, i, gas)
    if found < horizon and gas.grid[ROLL_BACK] == 1:
        ti.atomic_add(gas.counter[N_VIOLATIONS], 1)
        if undo_i < NEVER:
            mark(i, undo_i, gas)
        if undo_j < NEVER:
            mark(j, undo_j, gas)


@ti.func
def look_across(i, gas: ti.template()):
    """Predict disk i's meetings with disks of other tiles, where either of the two has changed or forgotten the other.

    Writes only what is disk i's own: the other disk looks for itself.
    """
    row = gas.grid[ROW]
    horizon = gas.scale[HORIZON]
    for q in range(n_others(gas.link[i][LENGTH])):
        code = gas.neighbour[row * i + row - 1 - q]
        j = code // 9
        if gas.link[i][AFFECTED] == UNSURE or gas.link[j][AFFECTED] == UNSURE:
            t = meeting(i, j, code - 9 * j, ti.min(horizon, gas.flight[i][TE]), gas)
            offer(i, t, code, horizon, gas)


@ti.func
def still_true(i, gas: ti.template()):
    """Whether disk i's event is one of its present flight and its partner's; if that was rolled back, it will tell."""
    code = gas.link[i][PARTNER]
    true = 1
    if code >= 0:  # a wall's part in an event does not change
        j = code // 9
        shift = code - 9 * j
        if gas.link[j][PARTNER] != ROLLED_BACK and gas.link[j][PARTNER] != 9 * i + 8 - shift:
            if meeting(i, j, shift, gas.scale[HORIZON], gas) != gas.flight[i][TE]:
                true = 0
        elif gas.link[j][PARTNER] != ROLLED_BACK and gas.flight[j][TE] != gas.flight[i][TE]:
            true = 0
    return true


@ti.kernel
def join_tiles(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, link: Rows, meta: Rows, cell: Rows, start: Rows,
    fill: Rows, order: Rows, neighbour: Rows, lists: Table, counter: Rows, log_real: Rows, log_int: Rows,
):  # fmt: skip
    """After the tiles ran: undo what a disk of another tile should have prevented, and open the rounds.

    Active in the first round are all disks with an event in the window. Disks that may not know their earliest event
    predict anew in it: those that were rolled back or became too fast, and those whose partner has changed since.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, link=link, meta=meta, cell=cell, start=start, fill=fill,
        order=order, neighbour=neighbour, lists=lists, counter=counter, log_real=log_real, log_int=log_int,
        uses=uses,
    ))  # fmt: skip
    for item in range(SPREAD * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        if item % SPREAD == 0:
            tile = item // SPREAD
            low = gas.start[tile * gas.grid[CELLS_X] * gas.grid[CELLS_Y]]
            for place in range(low, low + gas.fill[tile]):
                i = gas.order[place]
                for q in range(n_others(gas.link[i][LENGTH])):
                    code = gas.neighbour[gas.grid[ROW] * i + gas.grid[ROW] - 1 - q]
                    j = code // 9
                    if i < j and (gas.link[i][HEAD] >= 0 or gas.link[j][HEAD] >= 0):
                        if gas.cell[j] // (gas.grid[CELLS_X] * gas.grid[CELLS_Y]) != tile:
                            check_history(i, j, code - 9 * j, gas)
    for _ in range(1):
        propagate(gas)
    for q in range(gas.counter[UNDO_ROW]):
        restore(gas.lists[UNDO_ROW, q], gas)
        gas.link[gas.lists[UNDO_ROW, q]][AFFECTED] = -1
    for item in range(SPREAD * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        if item % SPREAD == 0:
            low = gas.start[item // SPREAD * gas.grid[CELLS_X] * gas.grid[CELLS_Y]]
            for place in range(low, low + gas.fill[item // SPREAD]):
                if gas.link[gas.order[place]][PARTNER] != ROLLED_BACK:
                    look_across(gas.order[place], gas)
    for item in range(SPREAD * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        if item % SPREAD == 0:
            low = gas.start[item // SPREAD * gas.grid[CELLS_X] * gas.grid[CELLS_Y]]
            now = gas.counter[ROUND] % 2
            for place in range(low, low + gas.fill[item // SPREAD]):
                i = gas.order[place]
                if gas.link[i][PARTNER] == ROLLED_BACK:
                    # Not one of those rolled back just now: it became too fast.
                    if gas.link[i][AFFECTED] == UNSURE:
                        push(CHANGED_ROW + now, i, gas)
                elif gas.flight[i][TE] < gas.scale[WINDOW]:
                    if still_true(i, gas) == 1:
                        push(AFFECTED_ROW + now, i, gas)
                        gas.link[i][ACTIVE] = gas.counter[ROUND] + 1
                    else:
                        push(CHANGED_ROW + now, i, gas)
    for q in range(gas.counter[CHANGED_ROW + gas.counter[ROUND] % 2]):
        # From here on the same as a disk that was rolled back.
        i = gas.lists[CHANGED_ROW + gas.counter[ROUND] % 2, q]
        gas.link[i][PARTNER] = ROLLED_BACK
        gas.flight[i][TE] = FAR
    for _ in range(1):
        now = gas.counter[ROUND] % 2
        q = 0
        while q < gas.counter[CHANGED_ROW + now]:
            push(UNDO_ROW, gas.lists[CHANGED_ROW + now, q], gas)
            q += 1
        gas.counter[CHANGED_ROW + now] = 0
        next_round(gas)
