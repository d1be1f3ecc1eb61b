"""Levels: how far a disk may move in an epoch for its neighbour list to be complete; `extend.py` tells more."""

from .language import ti
from .layout import END, HORIZON, LENGTH, LEVELS, MOST_LEVEL, REACH, SPEED_MARGIN, level_of
from .shear import way_speed2

CAP = 2.26


@ti.pyfunc
def speed_cap(fastest, mean_square, most_level):
    """Speed [length/time] up to which disks need no longer list, and which sets the length of an epoch.

    A lower one makes epochs longer, and more disks need longer lists: CAP times the root mean square speed is reached
    by one disk in 170 of a Maxwellian gas. The fastest disk must stay well below the highest level.
    """
    least = SPEED_MARGIN * fastest / (1.0 + 0.2 * most_level)
    return ti.min(SPEED_MARGIN * fastest, ti.max(CAP * ti.sqrt(mean_square), least))


@ti.func
def needed_level(speed2, gas: ti.template()):
    """The lowest level at which a disk may keep a speed, of this square, to the end of the epoch."""
    way = ti.sqrt(speed2) * gas.scale[HORIZON]
    level = 0
    if way > gas.scale[REACH]:
        level = ti.ceil(ti.min((way / gas.scale[REACH] - 1.0) * LEVELS, 1.0e6), ti.i32)
    return level


@ti.pyfunc
def reach_at(reach, level):
    """How far a disk of that level may move in an epoch [length], `reach` being that of level 0."""
    return reach * (1.0 + level / LEVELS)


@ti.func
def reach_of(level, gas: ti.template()):
    """How far a disk of that level may move in the epoch."""
    return reach_at(gas.scale[REACH], level)


@ti.func
def too_fast(i, gas: ti.template()):
    """The level that disk i needs, if that is above the one it has and not above what the box allows; else 0."""
    level = needed_level(way_speed2(i, gas), gas)
    if level <= level_of(gas.link[i][LENGTH]) or level > gas.grid[MOST_LEVEL]:
        level = 0
    return level


@ti.func
def limit_if_too_fast(i, t, gas: ti.template()):
    """After disk i's collision at time t: end the epoch before the disk comes further than its list allows.

    The list is complete while nobody moves further than his reach. A disk that becomes faster gets a longer list
    (`extend.py`) if the box allows that.
    """
    speed2 = way_speed2(i, gas)
    horizon = gas.scale[HORIZON]
    if speed2 * (horizon * horizon) > gas.scale[REACH] * gas.scale[REACH]:
        if needed_level(speed2, gas) > gas.grid[MOST_LEVEL]:
            # It has not come so far yet at t, whatever its speed is now.
            furthest = reach_of(level_of(gas.link[i][LENGTH]), gas)
            ti.atomic_min(gas.limit[END], ti.max(t, furthest / ti.sqrt(speed2)))


@ti.pyfunc
def epoch_length(reach, cap, wall_speed, pull):
    """Length [time] of an epoch for disks slower than `cap` that walls hit and a gravity `pull` accelerates.

    A disk at rest leaves a wall that moves at U with up to 2 U; one that fell for a time D has the speed pull D, and
    comes no further than its reach with it if pull D^2 is not more than that.
    """
    length = reach / ti.max(ti.max(cap, 2.0 * wall_speed), 1.0e-290)
    if pull > 0.0:
        length = ti.min(length, ti.sqrt(reach / pull))
    return length
