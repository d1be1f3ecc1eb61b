"""A kernel that shows the gap between disks and a wall, and its first root, for tests.

Import only after `device.start`.
"""

from ifrdem.kernels.compiler.language import Cube, Rows, Table
from ifrdem.kernels.compiler.signature import Arrays, kernel
from ifrdem.kernels.walls.motion import wall_phases
from ifrdem.kernels.walls.root import relative_motion, wall_time
from ifrdem.kernels.walls.shapes import UNKNOWN, gap_of


@kernel
def gaps(
    disks: Table, times: Rows, out: Cube, root: Rows, gas: Arrays("uses grid scale clock counter walls")
):
    """Of wall 0 and disks (x, y, vx, vy, radius at time 0): f, slope, curve, tolerance, here, behind at times; root."""
    for _ in range(1):
        wall_phases(gas)
        for i in range(disks.shape[0]):
            x, y, vx, vy, radius = disks[i, 0], disks[i, 1], disks[i, 2], disks[i, 3], disks[i, 4]
            for m in range(times.shape[0]):
                observed = relative_motion(0, x, y, vx, vy, 0.0, times[m], gas)
                gap = gap_of(0, observed, radius, UNKNOWN, gas)
                out[i, m, 0], out[i, m, 1], out[i, m, 2] = gap.f, gap.slope, gap.curve
                out[i, m, 3], out[i, m, 4], out[i, m, 5] = gap.tolerance, gap.here, gap.behind
            root[i], _resting = wall_time(0, x, y, vx, vy, 0.0, radius, gas.scale.window, gas)
