"""A disk: its properties, its flight, what it carries along.

==========  ======================================================
`particle`  properties, flight to a collision, hash of the history
`flights`   contact times of two disks; positions on a grid
`shear`     the mean flow of a sheared gas
`stress`    momentum that collisions transfer
==========  ======================================================
"""
