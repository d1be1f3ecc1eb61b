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

import taichi as ti

from .events import collide, predict, propagate, restore
from .extend import LATER, extend, push, raise_level, too_fast
from .layout import (
    AFFECTED_ROW,
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
    NEVER,
    NUMBER,
    PARTNER,
    ROLLED_BACK,
    ROUND,
    SLOT,
    SPREAD,
    STANDS,
    TE,
    TIME,
    UNDO,
    UNDO_ROW,
    WINDOW,
    N,
)
from .sort import BLOCK, n_blocks


@ti.func
def next_round(grid: ti.template(), lists: ti.template(), counter: ti.template(), link: ti.template()):
    """Close a round: rolled-back disks open the next one's list of changed disks."""
    now = counter[ROUND] % 2
    following = counter[ROUND] + 1
    counter[CHANGED_ROW + 1 - now] = 0
    counter[AFFECTED_ROW + 1 - now] = 0
    counter[ROUND] = following
    counter[N_ROUNDS] += 1
    # Each active disk of the next round logs at most one collision. Deciding before it begins keeps the outcome
    # independent of threads.
    if counter[N_LOG] + counter[CHANGED_ROW + now] + counter[AFFECTED_ROW + now] > grid[LOG_CAPACITY]:
        counter[LOG_FULL] = 1
    q = 0
    while q < counter[UNDO_ROW]:
        i = lists[UNDO_ROW, q]
        link[i][DIRTY] = following
        push(CHANGED_ROW + following % 2, i, lists, counter)
        q += 1
    counter[UNDO_ROW] = 0


@ti.func
def n_active(everybody, counter: ti.template()):
    """How many disks the round looks at for collisions: all, or those that predicted in the round before."""
    n = everybody
    if everybody == 0:
        last = (counter[ROUND] + 1) % 2
        n = counter[CHANGED_ROW + last] + counter[AFFECTED_ROW + last]
    return n


@ti.func
def active_disk(q, everybody, lists: ti.template(), counter: ti.template()):
    """Slot of the q-th active disk."""
    i = q
    if everybody == 0:
        last = (counter[ROUND] + 1) % 2
        changed = counter[CHANGED_ROW + last]
        if q < changed:
            i = lists[CHANGED_ROW + last, q]
        else:
            i = lists[AFFECTED_ROW + last, q - changed]
    return i


@ti.kernel
def one_round(
    everybody: ti.i32,
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    kinds: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    lists: ti.types.ndarray(ndim=2),
    counter: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
    law: ti.types.ndarray(ndim=3),
):
    """One round in parallel. `everybody` = n makes all disks active (a window's first round), 0 the last predicted.

    Events before `window` and before the epoch's end are due; predictions reach to `horizon`; nobody may move
    further than `reach`, half the skin.
    """
    for _ in range(1):
        # Latched: an end brought forward by this round's collisions holds from the next round on.
        limit[LATCHED] = ti.min(limit[END], scale[WINDOW])
    for q in range(n_active(everybody, counter)):
        collide(
            active_disk(q, everybody, lists, counter), everybody,
            grid, scale, flight, kinds, link, meta, lists, counter, limit, log_real, log_int, law,
        )  # fmt: skip
    for q in range(counter[CHANGED_ROW + counter[ROUND] % 2]):
        i = lists[CHANGED_ROW + counter[ROUND] % 2, q]
        level = too_fast(i, grid, scale, flight, link)
        if level > 0:
            raise_level(i, level, link, counter)
            push(EXTEND_ROW, i, lists, counter)
    for q in range(counter[EXTEND_ROW]):
        extend(
            lists[EXTEND_ROW, q], LATER,
            grid, scale, flight, link, meta, cell, start, neighbour, lists, counter, log_real, log_int,
        )  # fmt: skip
    for _ in range(1):
        counter[EXTEND_ROW] = 0
    for q in range(counter[CHANGED_ROW + counter[ROUND] % 2]):
        predict(
            lists[CHANGED_ROW + counter[ROUND] % 2, q], True,
            grid, scale, flight, link, meta, neighbour, lists, counter, log_real, log_int,
        )  # fmt: skip
    for _ in range(1):
        propagate(link, lists, counter, log_int)
    for q in range(counter[UNDO_ROW]):
        restore(lists[UNDO_ROW, q], flight, link, counter, log_real, log_int)
    for q in range(counter[AFFECTED_ROW + counter[ROUND] % 2]):
        i = lists[AFFECTED_ROW + counter[ROUND] % 2, q]
        if link[i][PARTNER] != ROLLED_BACK:
            predict(
                i, False,
                grid, scale, flight, link, meta, neighbour, lists, counter, log_real, log_int,
            )  # fmt: skip
    for _ in range(1):
        next_round(grid, lists, counter, link)


@ti.kernel
def rounds_by_one_thread(
    first: ti.i32,
    most_active: ti.i32,
    most_rounds: ti.i32,
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    kinds: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    lists: ti.types.ndarray(ndim=2),
    counter: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
    law: ti.types.ndarray(ndim=3),
):
    """The rounds of `one_round`, one after another by one thread, while no more than `most_active` disks are active.

    Starting threads costs more than the few disks of a late round, or the rounds of a small system, need.
    """
    for _ in range(1):
        everybody = first
        going = 1
        while going == 1:
            limit[LATCHED] = ti.min(limit[END], scale[WINDOW])
            for q in range(n_active(everybody, counter)):
                collide(
                    active_disk(q, everybody, lists, counter), everybody,
                    grid, scale, flight, kinds, link, meta, lists, counter, limit, log_real, log_int, law,
                )  # fmt: skip
            for q in range(counter[CHANGED_ROW + counter[ROUND] % 2]):
                i = lists[CHANGED_ROW + counter[ROUND] % 2, q]
                level = too_fast(i, grid, scale, flight, link)
                if level > 0:
                    raise_level(i, level, link, counter)
                    push(EXTEND_ROW, i, lists, counter)
            for q in range(counter[EXTEND_ROW]):
                extend(
                    lists[EXTEND_ROW, q], LATER,
                    grid, scale, flight, link, meta, cell, start, neighbour, lists, counter, log_real, log_int,
                )  # fmt: skip
            counter[EXTEND_ROW] = 0
            for q in range(counter[CHANGED_ROW + counter[ROUND] % 2]):
                predict(
                    lists[CHANGED_ROW + counter[ROUND] % 2, q], True,
                    grid, scale, flight, link, meta, neighbour, lists, counter, log_real, log_int,
                )  # fmt: skip
            propagate(link, lists, counter, log_int)
            for q in range(counter[UNDO_ROW]):
                restore(lists[UNDO_ROW, q], flight, link, counter, log_real, log_int)
            for q in range(counter[AFFECTED_ROW + counter[ROUND] % 2]):
                i = lists[AFFECTED_ROW + counter[ROUND] % 2, q]
                if link[i][PARTNER] != ROLLED_BACK:
                    predict(
                        i, False,
                        grid, scale, flight, link, meta, neighbour, lists, counter, log_real, log_int,
                    )  # fmt: skip
            next_round(grid, lists, counter, link)
            everybody = 0
            active = n_active(0, counter) + counter[CHANGED_ROW + counter[ROUND] % 2]
            if (
                active == 0
                or active > most_active
                or counter[LOG_FULL] == 1
                or counter[MOST_NEIGHBOURS] > 0
                or counter[N_ROUNDS] >= most_rounds
            ):
                going = 0


@ti.kernel
def earliest_event(
    grid: ti.types.ndarray(ndim=1), flight: ti.types.ndarray(ndim=1), limit: ti.types.ndarray(ndim=1)
):
    """`limit[EARLIEST]`: the time of the earliest unprocessed event. Everything before it is final."""
    for _ in range(1):
        limit[EARLIEST] = FAR
    for item in range(SPREAD * n_blocks(grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            earliest = limit[EARLIEST]
            for i in range(b * BLOCK, ti.min(grid[N], (b + 1) * BLOCK)):
                earliest = ti.min(earliest, flight[i][TE])
            ti.atomic_min(limit[EARLIEST], earliest)


@ti.kernel
def cut(
    end: ti.f64,
    flight: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    lists: ti.types.ndarray(ndim=2),
    counter: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
):
    """Undo every collision at `end` or later, to end the epoch there."""
    for _ in range(1):
        counter[UNDO_ROW] = 0
    for entry in range(counter[N_LOG]):
        if log_int[entry][STANDS] == 1 and log_real[entry][TIME] >= end:
            for side in ti.static(range(2)):
                i = log_int[entry][SLOT + side]
                if ti.atomic_min(link[i][UNDO], log_int[entry][NUMBER + side]) == NEVER:
                    push(UNDO_ROW, i, lists, counter)
    for q in range(counter[UNDO_ROW]):
        restore(lists[UNDO_ROW, q], flight, link, counter, log_real, log_int)
    for _ in range(1):
        counter[UNDO_ROW] = 0
