"""Tiles with halos: disks by tile, and what is added up or read from them.

=========  ========================================================================
`tiles`    gather disks for a window, write them at its end, prove that it is exact
`lines`    lines of flight in cells, by which thin gases find neighbours
`sums`     sums over all tiles
`readout`  disks by id, sums over all disks
=========  ========================================================================
"""
