"""Kernels that call functions of forces at random times, for tests. Import only after `backend.start`."""

from ifrdem.kernels.compiler.language import Rows, ti
from ifrdem.kernels.compiler.signature import Arrays, kernel
from ifrdem.kernels.disks.force_times import find_action
from ifrdem.kernels.layout import FAR


@kernel
def find(after: Rows, after_draw: Rows, gas: Arrays("uses grid event_info action force_values")):
    """First action of the forces on the disk in each slot after a time and a number in its slice."""
    for i in range(after.shape[0]):
        gas.action[i].time = ti.f64(FAR)
        for force in ti.static(gas.uses.forces):
            find_action(i, after[i], ti.cast(after_draw[i], ti.i32), force, gas)
