"""Kernels that use columns by name, for tests. Import only after `backend.start`."""

import taichi as ti

from ifrdem.kernels.language import Rows, Table
from ifrdem.kernels.records import gas_of


@ti.kernel
def move(disk: Rows, tile: Table, scale: Rows):
    """Fly disks along x until the end of moment 2; count them in part 1 of a tile, and let its part 0 begin at 3."""
    gas = ti.static(gas_of(disk=disk, tile=tile, scale=scale))
    for i in range(gas.disk.shape[0]):
        body, m = gas.disk[i], 2
        body.x += gas.scale.moment[m].until * body.vx
        part = 0
        ti.atomic_add(gas.tile[0].count.other[part], 1)
        gas.tile[0].start[part] = 3


@ti.kernel
def wrong(disk: Rows):
    """Ask for a column that is not there."""
    gas = ti.static(gas_of(disk=disk))
    for i in range(gas.disk.shape[0]):
        gas.disk[i].mass = 1.0
