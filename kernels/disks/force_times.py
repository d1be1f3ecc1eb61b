"""Times at which forces act on single disks: a Poisson process of each disk, exact in time.

Time is divided into slices, each as long as the mean time between two actions of a force on a disk. The number of
actions in a slice has a Poisson distribution with mean 1, and the time of each is uniformly distributed in the slice.
Both follow from random numbers by counter, of the disk, the force and the slice. So nothing is stored between windows,
and tiles, threads, ranks and restarts find the same times.

Times are those of the run, in double precision. An action belongs to the window with begin <= time < end.
"""

from ..columns import FORCE_VALUES
from ..compiler.language import is_single_precision, ti
from ..layout import FAR
from ..random import DRAWS, unit, words

E_TO_MINUS_1 = 0.36787944117144233
MOST_ACTIONS = 40  # in a slice: more have a probability of 1e-48, below that of any random number of 53 bits
ACTION_BITS = 24  # of the high word of the number of a slice; bits above have the number of an action in it


@ti.func
def n_actions(u):
    """Random number of a Poisson distribution with mean 1, from a uniform one in (0, 1]."""
    n = 0
    part = ti.f64(E_TO_MINUS_1)
    below = part
    while u > below and n < MOST_ACTIONS:
        n += 1
        part = part / n
        below += part
    return n


@ti.func
def slice_stream(i, number, force: ti.template(), gas: ti.template()):
    """The stream of random numbers (`random.py`) from which the actions on the disk in slot i in a slice follow."""
    index = ti.cast(gas.force_values[FORCE_VALUES.width + force.first + 1], ti.u32)
    return ti.Vector([
        ti.cast(gas.event_info[i].id, ti.u32), ti.cast(number, ti.u32), ti.cast(number >> ti.i64(32), ti.u32),
        index * ti.u32(DRAWS), ti.cast(gas.grid.seed_low, ti.u32), ti.cast(gas.grid.seed_high, ti.u32),
    ], ti.u32)  # fmt: skip


@ti.func
def action_stream(i, force: ti.template(), gas: ti.template()):
    """The stream of random numbers of the next action of this force on the disk in slot i."""
    following = gas.action[i]
    stream = slice_stream(i, ti.cast(following.slice, ti.i64), force, gas)
    stream[2] |= (ti.cast(following.draw, ti.u32) + ti.u32(1)) << ti.u32(ACTION_BITS)
    return stream


@ti.func
def interval(force: ti.template(), gas: ti.template()):
    """Mean time between two actions of a force on a disk."""
    return gas.force_values[FORCE_VALUES.width + force.first]


@ti.func
def find_action(i, after, after_draw, force: ti.template(), gas: ti.template()):
    """Have `action[i]` be the first action of a force after a time, unless it is an earlier one of another force.

    Actions at the very same time are in the order of their numbers in the slice: those above `after_draw` come after.
    """
    length = interval(force, gas)
    # The slice before it, too, where rounding may put an action at its end after the time.
    number = ti.cast(ti.floor(after / length * (1.0 - 1e-15) - 1e-6), ti.i64)
    found = 0
    while found == 0:
        stream = slice_stream(i, number, force, gas)
        drawn = words(stream, 0)
        n = n_actions(unit(drawn[0], drawn[1]))
        for draw in range(n):
            u = unit(drawn[2], drawn[3])
            if draw > 0:
                if draw % 2 == 1:
                    drawn = words(stream, (draw + 1) // 2)
                    u = unit(drawn[0], drawn[1])
            time = (ti.cast(number, ti.f64) + u) * length
            following = gas.action[i]
            if time > after or (time == after and draw > after_draw):
                first = time < following.time
                if time == following.time and ti.cast(following.force, ti.i32) == force.number:
                    first = draw < ti.cast(following.draw, ti.i32)
                if first:
                    following.time, following.slice = time, ti.cast(number, ti.f64)
                    following.draw, following.force = ti.cast(draw, ti.f64), ti.cast(force.number, ti.f64)
                found = 1
        number += 1


@ti.func
def begin_actions(i, gas: ti.template()):
    """Find the first action on the disk in slot i in a window that begins."""
    gas.action[i].time, gas.action[i].force, gas.action[i].count = ti.f64(FAR), ti.f64(-1.0), ti.f64(0.0)
    for force in ti.static(gas.uses.forces):
        if ti.static(force.alone):
            find_action(i, gas.clock.begin, -1, force, gas)


@ti.func
def next_action(i, gas: ti.template()):
    """Find the action on the disk in slot i that follows the present one."""
    present = gas.action[i]
    time, number, draw = present.time, ti.cast(present.force, ti.i32), ti.cast(present.draw, ti.i32)
    present.time, present.force, present.count = ti.f64(FAR), ti.f64(-1.0), present.count + 1.0
    for force in ti.static(gas.uses.forces):
        if ti.static(force.alone):
            # At the very same time forces act in order.
            after_draw = ti.select(force.number > number, -1, MOST_ACTIONS)
            if force.number == number:
                after_draw = draw
            find_action(i, time, after_draw, force, gas)


@ti.func
def action_time(i, gas: ti.template()):
    """Time since the window's beginning at which a force acts next on the disk in slot i; FAR if not in the window."""
    time = gas.action[i].time
    found = FAR + 0.0 * gas.scale.window
    if time < gas.clock.end:
        # Bins of the queue hold what comes before the end by more than rounding.
        last = gas.scale.window * ti.static(1.0 - (1e-6 if is_single_precision() else 1e-12))
        found = ti.min(ti.cast(time - gas.clock.begin, float), last)
    return found
