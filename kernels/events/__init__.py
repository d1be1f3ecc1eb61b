"""Events of one region of disks.

========  ===================================================
`events`  in order, from the beginning of a window to its end
`rest`    resting contact: disks that lie still sleep
========  ===================================================
"""
