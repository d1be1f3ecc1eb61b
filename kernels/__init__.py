"""Taichi kernels: the collision law and the event engine. No I/O, no `ti.init`, no printing here.

A module imports only from its own row and rows above it:

===================  ===================================================================================
`columns`, `layout`  names of the columns of all arrays; what the arrays hold, and the features of a gas
`compiler`           the runtime, and what this program adds to its language
`laws`               collision laws, and what a collision does
`random`             random numbers by counter
`disks`              a disk: its properties, its flight
`walls`              walls: when a disk meets one, and what happens then
`tiles`              disks by tile, and what is added up or read from them
`forces`             forces between collisions
`events`             events of one region of disks, in order; disks at rest
`windows`            all events for a short time, on a CPU or GPU
`dsmc`               a homogeneous gas without positions
`starts`             disks in cells before there is an engine: where they are added, which are close
===================  ===================================================================================
"""
