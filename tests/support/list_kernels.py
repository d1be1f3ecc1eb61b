"""Kernels that ask the engine's neighbour lists, for tests. Import only after `backend.start`."""

import taichi as ti

from ifrdem.kernels.extend import AT_START, listed, raise_level
from ifrdem.kernels.layout import GasArrays, Rows


@ti.kernel
def raise_first(level: ti.i32, grid: Rows, link: Rows, counter: Rows):
    """Have the list of disk 0 extended: the first step."""
    gas = ti.static(GasArrays(grid=grid, link=link, counter=counter))
    for _ in range(1):
        raise_level(0, level, AT_START, gas)


@ti.kernel
def list_of_first_has(j: ti.i32, shift: ti.i32, grid: Rows, link: Rows, neighbour: Rows) -> ti.i32:
    """Whether disk 0's list has disk j."""
    gas = ti.static(GasArrays(grid=grid, link=link, neighbour=neighbour))
    return listed(0, j, shift, gas)
