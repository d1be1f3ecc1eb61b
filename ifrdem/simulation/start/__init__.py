"""Initial arrays of a gas, from checked input.

==========  =====================================================
`checks`    input that the engine refuses
`features`  what a gas records, what its kernels are compiled for
`start`     disks on one process or several ranks
==========  =====================================================
"""
