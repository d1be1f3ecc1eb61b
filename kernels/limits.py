"""Sizes and bounds of the engine, which estimates need too without starting it."""

# Columns of the arrays (`kernels/layout.py`).
FLIGHT, KIND, LINK, META, IMAGE, LISTS = 8, 6, 8, 3, 2, 5
LOG_REAL, LOG_INT, LOG_LOSS = 11, 8, 4
WALL = 18
MECHANISMS, REGIMES = 6, 5
MOST_WALLS = 31  # those that a disk can touch in an epoch are the bits of one integer
ADDRESSABLE = 2**31 - 1  # entries of one array that 32-bit indices reach
ROW = 16  # entries of a neighbour row to begin with; rows grow where more are needed
CROWD = 8000  # neighbours of one disk, at most: its row's lengths share an integer
MOST_DISKS = ADDRESSABLE // 24  # with rows as long as a dense gas may need
# Bytes that the arrays take for each disk, with a log of one record for two disks, cells for half as many as there
# are disks, and in double precision.
BYTES_PER_DISK = (
    8 * FLIGHT + 4 * (LINK + META + IMAGE + LISTS + ROW + 1 + 1 + 1) + (8 * LOG_REAL + 4 * LOG_INT) // 2
)
LEDGER_BYTES_PER_DISK = 8 * LOG_LOSS // 2
"""What the energy ledger takes beyond: the losses of each record of the log."""

ALONE = 20_000  # up to so many disks, one thread runs whole epochs by itself
TILE_DISKS = 4000  # disks of a tile: what fits the cache next to a core
# Who processes an epoch's collisions: one thread alone, tiles of disks in parallel, or rounds over all disks.
ORDERS = ("alone", "tiles", "rounds")
