"""Walls: when a disk meets one, and what happens then.

=================  ====================================================================================
module             content
=================  ====================================================================================
`kinds`            numbers of shapes, motions and turns; without Taichi, for the host too
`images`           numbers of the periodic images of a wall, alone and as a partner
`motion`           where a wall is at a time: displacement, turn, bounds on both
`pistons`          walls with a mass, which disks drive
`shapes`           table of shapes: nearest point, gap to a disk, bounding box
`root`             first root of the gap
`cells`            walls near each cell, and the first one that a disk meets
`collision`        what a collision does to disk, piston and sums
`thermal`          random velocities behind a thermal wall, and its heat
=================  ====================================================================================

A wall is a disk of infinite mass to the law. Between collisions a disk moves in a frame that falls freely from the
beginning of the window on: there all flights are straight, and pairs never notice gravity. Only walls, which do not
fall, see parabolas; here times are those of the window, positions those of the box, and velocities those of the lab.

`columns.WALL` names the columns of a row of `walls`: one piece of a wall. A polyline has a row for each side, an arc
one for each of its two faces and its two ends.

To add a shape, write its functions in `shapes.py` and enter it in the table there, with its name in `kinds.PIECES`.
"""
