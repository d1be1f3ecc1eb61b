"""Kernels that use columns by name, for tests. Import only after `backend.start`."""

from ifrdem.kernels.compiler.language import ti
from ifrdem.kernels.compiler.signature import Arrays, kernel


@kernel
def move(gas: Arrays("disk tile scale")):
    """Fly disks along x until moment 2; count them in part 1 of a tile, and let its part 0 begin at 3."""
    for i in range(gas.disk.shape[0]):
        body, m = gas.disk[i], 2
        body.x += gas.scale.moment[m] * body.vx
        part = 0
        ti.atomic_add(gas.tile[0].count.other[part], 1)
        gas.tile[0].start[part] = 3


@kernel
def wrong(gas: Arrays("disk")):
    """Ask for a column that is not there."""
    for i in range(gas.disk.shape[0]):
        gas.disk[i].mass = 1.0


def shifting(shift: float):  # type: ignore[no-untyped-def]
    """A kernel that moves disks along x by so much, a constant of it."""

    @kernel
    def move_by(gas: Arrays("disk")):
        """Move all disks."""
        for i in range(gas.disk.shape[0]):
            gas.disk[i].x += shift

    return move_by


@kernel
def missing(gas: Arrays("disk")):
    """Use an array that is not in the list."""
    for i in range(gas.disk.shape[0]):
        gas.disk[i].x = gas.scale.window
