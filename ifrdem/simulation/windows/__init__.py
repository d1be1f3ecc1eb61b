"""Windows from the host: arrays on the device, tiles, ranks.

=========  ========================================================================
`windows`  lengths and sums of windows, stops within one
`runner`   the tiles of a process run a window, again with wider halos where needed
`arrays`   arrays on the device, and how kernels get them
`tiling`   sizes of tiles and cells, lengths of windows
`domain`   the part of a gas that a process has
`ranks`    the part that one of several MPI ranks has
=========  ========================================================================
"""
