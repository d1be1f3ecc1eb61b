"""A kernel that enters collisions into the history of a disk, for tests. Import only after `backend.start`."""

from ifrdem.kernels.compiler.language import Rows, Table
from ifrdem.kernels.compiler.signature import Arrays, kernel
from ifrdem.kernels.disks.particle import update_history_hash


@kernel
def enter(time: Rows, partner: Rows, gas: Arrays("event_info")):
    """Enter collisions with partners at times, in this order, into the history of the disk in slot 0."""
    for _ in range(1):
        for m in range(time.shape[0]):
            update_history_hash(0, time[m], partner[m], gas)


@kernel
def enter_each(time: Table, partner: Table, gas: Arrays("event_info")):
    """Enter collisions with partners at times, a row of them for each disk, into the histories of the disks."""
    for i in range(time.shape[0]):
        for m in range(time.shape[1]):
            update_history_hash(i, time[i, m], partner[i, m], gas)
