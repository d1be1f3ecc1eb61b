"""Sizes and bounds of the engine, for `check`, estimates and files; names of columns stand in `layout.py`."""

WALL = 38  # columns of a wall (`kernels/walls.py`)
OWNER, MOVING, INVERSE = 18, 6, 32  # of them: the number of the wall; the first of its motion; of a piston's
MECHANISMS, REGIMES = 7, 5
WALL_SUMS = 6  # of a wall: momentum, torque, work, heat, hits
PISTON_STATE = 2  # of a piston: displacement, velocity
MOST_WALLS = 100_000
ADDRESSABLE = 2**31 - 1  # numbers of one array that 32-bit indices reach
MOST_DISKS = ADDRESSABLE // 24  # of the longest array: three parts of eight numbers
# Disks of a gas on several ranks. Its ids have 32 bits: those of more than 2^31 - 1 disks begin below 0 there.
MOST_IDS = 2**32 - 1
# Bytes that the arrays take for each disk in double precision: at the beginning and end of a window and at a moment in
# it places, velocities, spin (40) and id, events, images (16); hash, way and slot (16); claims of disks in halos (14).
# Further moments of gases of up to TOLD_DISKS disks have another 28 MB in all, those of collisions 8 bytes a disk more.
BYTES_PER_DISK = 198
TOLD_DISKS = 500_000  # times moments of a window for which there is room, at least of one moment
RESTING_BYTES = 2032  # more, of disks that may rest: room for eight contacts of each, and the forces at four

ALONE = 20_000  # up to so many disks, one thread runs the whole box as one tile
