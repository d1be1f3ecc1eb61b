"""The rounds of an epoch: collide, predict, check causality, roll back.

One round, on a state that does not change while others read it:

1. every pair whose members name each other at the same time collides, and the collision is logged with both
   states before it;
2. every disk that changed (it collided, or was rolled back in the round before) predicts its next event over its
   neighbours, and finds the neighbours it affects: those that named it, or now meet it earlier than their event;
3. where such a disk's flight crosses an *older* flight of a neighbour whose clock is ahead, that neighbour collided
   too early: its collision that ended the crossed flight, and all that followed from it, are marked to be undone;
4. marked disks go back to the state before their first undone collision and predict in the next round;
5. affected disks predict again.

Nothing depends on the order in which threads work: each step writes only what no other item of the step reads,
and marks are minima. The work lists are filled by atomics in any order, but are used as sets.
"""

from .events import collide, mark, predict, propagate, restore
from .extend import LATER, extend, raise_level
from .language import ti
from .layout import (
    AFFECTED_ROW,
    BLOCK,
    CHANGED_ROW,
    DIRTY,
    EARLIEST,
    END,
    EXTEND_ROW,
    FAR,
    LATCHED,
    LOG_CAPACITY,
    LOG_FULL,
    MOST_NEIGHBOURS,
    N_LOG,
    N_ROUNDS,
    NUMBER,
    PARTNER,
    ROLLED_BACK,
    ROUND,
    SLOT,
    SPREAD,
    STANDS,
    TE,
    TIME,
    UNDO_ROW,
    WINDOW,
    Cube,
    GasArrays,
    N,
    Rows,
    Table,
    n_blocks,
    push,
)
from .levels import too_fast


@ti.func
def next_round(gas: ti.template()):
    """Close a round: rolled-back disks open the next one's list of changed disks."""
    now = gas.counter[ROUND] % 2
    following = gas.counter[ROUND] + 1
    gas.counter[CHANGED_ROW + 1 - now] = 0
    gas.counter[AFFECTED_ROW + 1 - now] = 0
    gas.counter[ROUND] = following
    gas.counter[N_ROUNDS] += 1
    # Each active disk of the next round logs at most one collision. Deciding before it begins keeps the outcome
    # independent of threads.
    if (
        gas.counter[N_LOG] + gas.counter[CHANGED_ROW + now] + gas.counter[AFFECTED_ROW + now]
        > gas.grid[LOG_CAPACITY]
    ):
        gas.counter[LOG_FULL] = 1
    q = 0
    while q < gas.counter[UNDO_ROW]:
        i = gas.lists[UNDO_ROW, q]
        gas.link[i][DIRTY] = following
        push(CHANGED_ROW + following % 2, i, gas)
        q += 1
    gas.counter[UNDO_ROW] = 0


@ti.func
def n_active(everybody, gas: ti.template()):
    """How many disks the round looks at for collisions: all, or those that predicted in the round before."""
    n = everybody
    if everybody == 0:
        last = (gas.counter[ROUND] + 1) % 2
        n = gas.counter[CHANGED_ROW + last] + gas.counter[AFFECTED_ROW + last]
    return n


@ti.func
def active_disk(q, everybody, gas: ti.template()):
    """Slot of the q-th active disk."""
    i = q
    if everybody == 0:
        last = (gas.counter[ROUND] + 1) % 2
        changed = gas.counter[CHANGED_ROW + last]
        if q < changed:
            i = gas.lists[CHANGED_ROW + last, q]
        else:
            i = gas.lists[AFFECTED_ROW + last, q - changed]
    return i


@ti.func
def raise_if_fast(i, gas: ti.template()):
    """Have disk i's list extended if it has become too fast for it."""
    level = too_fast(i, gas)
    if level > 0:
        raise_level(i, level, LATER, gas)
        push(EXTEND_ROW, i, gas)


@ti.func
def predict_again(i, gas: ti.template()):
    """Step 5 for disk i, unless it was rolled back and predicts in the next round anyhow."""
    if gas.link[i][PARTNER] != ROLLED_BACK:
        predict(i, False, gas)


@ti.kernel
def one_round(
    everybody: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, link: Rows,
    meta: Rows, cell: Rows, start: Rows, neighbour: Rows, lists: Table, counter: Rows, limit: Rows,
    log_real: Rows, log_int: Rows, log_loss: Rows, law: Cube, walls: Rows, near_walls: Rows, latest: Rows,
):  # fmt: skip
    """One round in parallel. `everybody` = n makes all disks active (a window's first round), 0 the last predicted.

    Events before `window` and before the epoch's end are due; predictions reach to `horizon`; nobody may move
    further than `reach`, half the skin.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, link=link, meta=meta, cell=cell, start=start,
        neighbour=neighbour, lists=lists, counter=counter, limit=limit, log_real=log_real, log_int=log_int,
        log_loss=log_loss, law=law, walls=walls, near_walls=near_walls, latest=latest, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        # Latched: an end brought forward by this round's collisions holds from the next round on.
        gas.limit[LATCHED] = ti.min(gas.limit[END], gas.scale[WINDOW])
    for q in range(n_active(everybody, gas)):
        collide(active_disk(q, everybody, gas), everybody, gas)
    for q in range(gas.counter[CHANGED_ROW + gas.counter[ROUND] % 2]):
        raise_if_fast(gas.lists[CHANGED_ROW + gas.counter[ROUND] % 2, q], gas)
    for q in range(gas.counter[EXTEND_ROW]):
        extend(gas.lists[EXTEND_ROW, q], LATER, gas)
    for _ in range(1):
        gas.counter[EXTEND_ROW] = 0
    for q in range(gas.counter[CHANGED_ROW + gas.counter[ROUND] % 2]):
        predict(gas.lists[CHANGED_ROW + gas.counter[ROUND] % 2, q], True, gas)
    for _ in range(1):
        propagate(gas)
    for q in range(gas.counter[UNDO_ROW]):
        restore(gas.lists[UNDO_ROW, q], gas)
    for q in range(gas.counter[AFFECTED_ROW + gas.counter[ROUND] % 2]):
        predict_again(gas.lists[AFFECTED_ROW + gas.counter[ROUND] % 2, q], gas)
    for _ in range(1):
        next_round(gas)


@ti.kernel
def rounds_by_one_thread(
    first: ti.i32, most_active: ti.i32, most_rounds: ti.i32, uses: ti.template(), grid: Rows, scale: Rows,
    flight: Rows, kinds: Rows, link: Rows, meta: Rows, cell: Rows, start: Rows, neighbour: Rows, lists: Table,
    counter: Rows, limit: Rows, log_real: Rows, log_int: Rows, log_loss: Rows, law: Cube, walls: Rows, near_walls: Rows,
    latest: Rows,
):  # fmt: skip
    """The rounds of `one_round`, one after another by one thread, while no more than `most_active` disks are active.

    Starting threads costs more than the few disks of a late round, or the rounds of a small system, need.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, link=link, meta=meta, cell=cell, start=start,
        neighbour=neighbour, lists=lists, counter=counter, limit=limit, log_real=log_real, log_int=log_int,
        log_loss=log_loss, law=law, walls=walls, near_walls=near_walls, latest=latest, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        everybody = first
        going = 1
        while going == 1:
            gas.limit[LATCHED] = ti.min(gas.limit[END], gas.scale[WINDOW])
            for q in range(n_active(everybody, gas)):
                collide(active_disk(q, everybody, gas), everybody, gas)
            for q in range(gas.counter[CHANGED_ROW + gas.counter[ROUND] % 2]):
                raise_if_fast(gas.lists[CHANGED_ROW + gas.counter[ROUND] % 2, q], gas)
            for q in range(gas.counter[EXTEND_ROW]):
                extend(gas.lists[EXTEND_ROW, q], LATER, gas)
            gas.counter[EXTEND_ROW] = 0
            for q in range(gas.counter[CHANGED_ROW + gas.counter[ROUND] % 2]):
                predict(gas.lists[CHANGED_ROW + gas.counter[ROUND] % 2, q], True, gas)
            propagate(gas)
            for q in range(gas.counter[UNDO_ROW]):
                restore(gas.lists[UNDO_ROW, q], gas)
            for q in range(gas.counter[AFFECTED_ROW + gas.counter[ROUND] % 2]):
                predict_again(gas.lists[AFFECTED_ROW + gas.counter[ROUND] % 2, q], gas)
            next_round(gas)
            everybody = 0
            active = n_active(0, gas) + gas.counter[CHANGED_ROW + gas.counter[ROUND] % 2]
            if (
                active == 0
                or active > most_active
                or gas.counter[LOG_FULL] == 1
                or gas.counter[MOST_NEIGHBOURS] > 0
                or gas.counter[N_ROUNDS] >= most_rounds
            ):
                going = 0


@ti.kernel
def earliest_event(
    grid: Rows, flight: Rows, limit: Rows,
):  # fmt: skip
    """`gas.limit[EARLIEST]`: the time of the earliest unprocessed event. Everything before it is final."""
    gas = ti.static(GasArrays(
        grid=grid, flight=flight, limit=limit,
    ))  # fmt: skip
    for _ in range(1):
        gas.limit[EARLIEST] = FAR
    for item in range(SPREAD * n_blocks(gas.grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            earliest = gas.limit[EARLIEST]
            for i in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                earliest = ti.min(earliest, gas.flight[i][TE])
            ti.atomic_min(gas.limit[EARLIEST], earliest)


@ti.kernel
def cut(
    end: ti.f64, uses: ti.template(), flight: Rows, link: Rows, lists: Table, counter: Rows, log_real: Rows,
    log_int: Rows,
):  # fmt: skip
    """Undo every collision at `end` or later, to end the epoch there."""
    gas = ti.static(GasArrays(
        flight=flight, link=link, lists=lists, counter=counter, log_real=log_real, log_int=log_int, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        gas.counter[UNDO_ROW] = 0
    for entry in range(gas.counter[N_LOG]):
        if gas.log_int[entry][STANDS] == 1 and gas.log_real[entry][TIME] >= end:
            for side in ti.static(range(2)):
                i = gas.log_int[entry][SLOT + side]
                if i >= 0:  # not a wall
                    mark(i, gas.log_int[entry][NUMBER + side], gas)
    for q in range(gas.counter[UNDO_ROW]):
        restore(gas.lists[UNDO_ROW, q], gas)
    for _ in range(1):
        gas.counter[UNDO_ROW] = 0
