"""Initial arrays of a gas, from checked input.

==========  =====================================================
`cells`     cells in which kernels find disks
`checks`    input that the engine refuses
`features`  what a gas records, what its kernels are compiled for
`overlaps`  whether disks overlap, and disks that are moved apart
`start`     disks on one process or several ranks
==========  =====================================================
"""
