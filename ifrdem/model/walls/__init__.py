"""Walls: their shapes, motions and checks, and the free area that they leave to disks.

`wall`: `Wall`. `shapes`, `outlines`: geometry. `motion`: `Motion`, `Turn`, `Piston`. `free_area`, `boundaries`: area
and boundary of what disks can reach. `checks`, `crush`: positions, overlaps and narrowing gaps.
"""
