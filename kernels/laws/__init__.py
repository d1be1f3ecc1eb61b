"""Collision laws, and what a collision does to two disks, or to a disk and a wall.

============  =========================================================
`law`         the IFR law, and what every law shares
`other_laws`  other laws by name
`contact`     coefficients, velocities after a collision, energy losses
============  =========================================================
"""
