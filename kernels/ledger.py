"""What dissipates energy: every collision of an epoch, split into its mechanisms and added up before the log is lost.

What a collision took is logged with it (`losses.py`): its numbers are at hand then. One that is undone counts for
nothing. Those with walls count as one mechanism, in the frame of the wall, and those with thermal walls not at all: the
energy that they give or take is heat (`tally.py`).

Sums are of whole numbers, in a unit that suits the largest loss of the epoch: the same bits in whatever order records
are, for any number of threads.
"""

from .contact import BY_FRICTION, BY_NORMAL, BY_RESTITUTION, BY_ROLLING, ROLLS, STICKS
from .language import ti
from .layout import HOW, N_LOG, SHIFT_BITS, SLOT, STANDS

# Rows of `losses`: all so far; of the epoch, in the first column, the largest of one collision.
ALL, EPOCH = range(2)
# Columns of `losses` and `regimes`.
NORMAL, RESTITUTION, SLIDING_LOSS, STICKING_LOSS, ROLLING_LOSS, AT_WALLS = range(6)
SLIDES, STICKS_ONLY, ROLLS_SLIDING, ROLLS_STICKING, ELASTICALLY = range(5)

RECORDS = 1024  # that one thread handles at a time
# What the largest loss is in units; parts of a unit. Sums reach 2^63 units, 2^41 times that; a loss is rounded by
# 2^-55 of the largest.
MOST_IN_UNITS, PARTS = 2.0**22, 2.0**32
BOUNDLESS = 1.0e300  # losses beyond, and those that are no numbers, are not counted but told of


@ti.func
def weigh(b, gas: ti.template()):
    """Note the largest loss in a block of records, of those that stand; infinite where one is no number."""
    most = ti.cast(0.0, ti.f64)
    for entry in range(b * RECORDS, ti.min(gas.counter[N_LOG], (b + 1) * RECORDS)):
        if gas.log_int[entry][STANDS] == 1:
            size = ti.cast(0.0, ti.f64)
            for part in ti.static(range(4)):
                size += ti.abs(gas.log_loss[entry][part])
            if not size <= BOUNDLESS:
                size = ti.math.inf
            most = ti.max(most, size)
    ti.atomic_max(gas.losses[EPOCH, 0], most)


@ti.func
def unit_of(most):
    """How many of the whole numbers that losses are added up as make an energy of 1; 0 where nothing is lost."""
    unit = 0.0 * most
    if most > 0.0 and most <= 4.0 * BOUNDLESS:
        unit = MOST_IN_UNITS / most
    return unit


@ti.func
def tally(b, gas: ti.template()):
    """Enter what the collisions of a block of records took, those that stand, into the sums of the epoch."""
    unit = unit_of(gas.losses[EPOCH, 0])
    whole, rest = ti.Vector([0] * 6, ti.i64), ti.Vector([0] * 6, ti.i64)
    counts = ti.Vector([0] * 5, ti.i32)
    columns = ti.static(range(6 if gas.uses.walled else AT_WALLS))
    for entry in range(b * RECORDS, ti.min(gas.counter[N_LOG], (b + 1) * RECORDS)):
        if gas.log_int[entry][STANDS] == 1:
            how = gas.log_int[entry][HOW] % SHIFT_BITS
            sticks = ti.cast(how % ROLLS == STICKS, ti.i32)
            lost = ti.Vector([0.0] * 6, ti.f64)
            friction = gas.log_loss[entry][BY_FRICTION]
            lost[NORMAL] = gas.log_loss[entry][BY_NORMAL]
            lost[RESTITUTION] = gas.log_loss[entry][BY_RESTITUTION]
            lost[SLIDING_LOSS] = (1 - sticks) * friction
            lost[STICKING_LOSS] = sticks * friction
            lost[ROLLING_LOSS] = gas.log_loss[entry][BY_ROLLING]
            regime = ti.min(how, ELASTICALLY)
            if ti.static(gas.uses.walled):
                if gas.log_int[entry][SLOT + 1] < 0:
                    regime = -1
                    together = lost.sum()
                    lost = ti.Vector([0.0] * 6, ti.f64)
                    lost[AT_WALLS] = together
            for column in ti.static(range(5)):
                counts[column] += regime == column
            for column in ti.static(columns):
                value = lost[column] * unit
                near = ti.floor(value + 0.5)
                whole[column] += ti.cast(near, ti.i64)
                rest[column] += ti.cast(ti.floor((value - near) * PARTS + 0.5), ti.i64)
    for column in ti.static(columns):
        ti.atomic_add(gas.losses_whole[0, column], whole[column])
        ti.atomic_add(gas.losses_whole[1, column], rest[column])
    for column in ti.static(range(5)):
        ti.atomic_add(gas.regimes[column], ti.cast(counts[column], ti.i64))


@ti.func
def close_tally(gas: ti.template()):
    """Add the sums of the epoch to the ledger, and forget its records. By one thread."""
    most = gas.losses[EPOCH, 0]
    unit = unit_of(most)
    for column in ti.static(range(6)):
        units = (
            ti.cast(gas.losses_whole[0, column], ti.f64)
            + ti.cast(gas.losses_whole[1, column], ti.f64) / PARTS
        )
        lost = 0.0 * units
        if unit > 0.0:
            lost = units / unit
        elif most > 0.0:
            lost = ti.math.nan
        gas.losses[ALL, column] = gas.losses[ALL, column] + lost
        gas.losses_whole[0, column] = 0
        gas.losses_whole[1, column] = 0
    gas.losses[EPOCH, 0] = 0.0
    gas.counter[N_LOG] = 0


@ti.func
def n_record_blocks(gas: ti.template()):
    """Blocks of the records of the epoch that ends."""
    return (gas.counter[N_LOG] + RECORDS - 1) // RECORDS
