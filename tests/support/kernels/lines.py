"""Kernels that call single functions of lines of flight, for tests. Import only after `backend.start`."""

from ifrdem.kernels.compiler.language import Table, ti
from ifrdem.kernels.compiler.signature import Arrays, kernel
from ifrdem.kernels.tiles.lines import PLACES, begin_lines, leave_place, passing, read_line, take_place


@kernel
def pass_by(
    n: ti.i32, nx: ti.i32, ny: ti.i32, moves: Table, found: Table,
    gas: Arrays("grid scale uses kinds motion event_info line line_slot bunch spare"),
):  # fmt: skip
    """Give n disks places, move them one after the other (rows of `moves`: slot, column, row), and test all pairs.

    found[i, j]: 0 if slot j is in no place, 1 if its line does not pass that of slot i, 2 if it does; more if it is in
    several places.
    """
    for _ in range(1):
        region = ti.Struct(lane=1, nx=nx, ny=ny)
        begin_lines(n, region, gas)
        first = gas.grid.lane_slots
        for m in range(moves.shape[0]):
            i = first + ti.cast(moves[m, 0], ti.i32)
            cell = gas.event_info[i].cell
            leave_place(i, (cell >> 16) * ny + (cell & 0xFFFF), region, gas)
            x, y = ti.cast(moves[m, 1], ti.i32), ti.cast(moves[m, 2], ti.i32)
            gas.event_info[i].cell = (x << 16) + y
            take_place(i, x * ny + y, region, gas)
        for i in range(n):
            own, radius = read_line(first + i, 0.0, 0.0, gas)
            for cell in range(nx * ny):
                b = gas.grid.bunches + cell
                while b >= 0:
                    bits = passing(b, own, radius, gas)
                    for k in range(gas.bunch[b].count):
                        found[i, gas.line_slot[b * PLACES + k] - first] += 1.0 + ((bits >> k) & 1)
                    b = gas.bunch[b].next
