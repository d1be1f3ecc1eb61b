"""The event engine and what drives it.

A module imports only from its own row and rows below it:

=============  =============================================================
`simulation`   `Simulation`, the object users run
`dsmc`         `DSMC`, a homogeneous gas without positions
`checkpoints`  complete states, in files and in memory, to resume from
`engine`       the engine, seen from the host
`windows`      arrays on the device, tiles, ranks
`steps`        what happens at given times: output, forces, rotating gravity
`measuring`    what is read from a running gas
`start`        what a gas starts from: checks, features, disks of ranks
`backend`      starts the runtime on a device
=============  =============================================================
"""
