"""Tiles with halos: disks by tile, and what is added up or read from them.

=========  ========================================================================
`tiles`    gather disks for a window, write them at its end, prove that it is exact
`sums`     sums over all tiles
`readout`  disks by id, sums over all disks
=========  ========================================================================
"""
