"""Sizes and bounds of the engine, for `check`, estimates and files; names of columns are in `columns.py`."""

from .columns import bytes_of

MOST_WALLS = 100_000
ADDRESSABLE = 2**31 - 1  # numbers of one array that 32-bit indices reach
MOST_DISKS = ADDRESSABLE // 24  # of the longest array: three parts of eight numbers
# Disks of a gas on several ranks. Its ids have 32 bits: those of more than 2^31 - 1 disks begin below 0 there.
MOST_IDS = 2**32 - 1
_PARTS = 3  # of the state: at the beginning and end of a window, and at a moment in it
GHOST_BYTES = 14  # of ghost records of disks in halos, for each disk
# Bytes that the arrays take for each disk in double precision. Further moments of gases of up to TOLD_DISKS disks have
# another 28 MB in all, those of collisions 8 bytes a disk more.
BYTES_PER_DISK = (
    _PARTS * bytes_of("disk", "meta") + bytes_of("history_hash", "displacement", "slot_before") + GHOST_BYTES
)
TOLD_DISKS = 500_000  # times moments of a window for which there is room, at least of one moment
TOUCHES_OF_DISK = 8  # for which there is room, on average
RESTING_BYTES = (  # more, of disks that may rest: room for contacts of each, and the forces at four
    _PARTS * bytes_of("slept", "held")
    + TOUCHES_OF_DISK * bytes_of("contact")
    + bytes_of("rest", "residual_acceleration", "cached_force")
)

ALONE = 20_000  # up to so many disks, one thread runs the whole box as one tile
