"""Kinds of pieces, motions and turns of walls, by the numbers that rows of `walls` hold.

Apart from `shapes.py`, which imports Taichi: the host needs the numbers before it starts.
"""

PIECES = ("line", "segment", "container", "post", "arc inside", "arc outside")
"""Shapes of pieces. A container has the disks inside of its circle, a post outside; the two sides of an arc are two."""
LINE, SEGMENT, CONTAINER, POST, ARC_INSIDE, ARC_OUTSIDE = range(len(PIECES))
GONE = len(PIECES)  # a gate that is open
MOTIONS = ("still", "steady", "sine", "sawtooth", "free")
"""Motions; a piston is free."""
STILL, STEADY, SINE, SAWTOOTH, FREE = range(len(MOTIONS))
TURNS = MOTIONS[:3]
