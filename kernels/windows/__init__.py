"""Windows: all events for a short time.

=========  ================================================
`planner`  how long a window is, how wide halos are
`windows`  a tile by a thread, or the whole box in order
`blocks`   a tile by a block of threads of a GPU, in rounds
=========  ================================================
"""
