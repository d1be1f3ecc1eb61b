"""Kernels that call single functions of tiles and cells, for tests. Import only after `backend.start`."""

from ifrdem.kernels.compiler.language import Rows, Table, ti
from ifrdem.kernels.compiler.signature import Arrays, kernel
from ifrdem.kernels.disks.particle import largest_square, note_speed
from ifrdem.kernels.events.search import search_candidates, search_cells
from ifrdem.kernels.layout import FAR, NO_PARTNER
from ifrdem.kernels.tiles.readout import placed
from ifrdem.kernels.tiles.tiles import is_wrong, load_from, neighbor_tile, region_of, store


@kernel
def note(velocity: Table, out: Rows, gas: Arrays("motion event_info")):
    """Give the disk in slot 0 one velocity after the other; the bound on its squared speed after each."""
    for _ in range(1):
        for m in range(velocity.shape[0]):
            gas.motion[0].vx, gas.motion[0].vy = velocity[m, 0], velocity[m, 1]
            note_speed(0, gas)
            out[m] = largest_square(0, gas)


@kernel
def neighbors(out: Table, gas: Arrays("uses grid scale edge_x edge_y")):
    """Tile, shift and boxes of `neighbor_tile` for all steps from -3 to 3 from each tile, in order."""
    for k in range(out.shape[0]):
        tile, step = k // 49, k % 49
        near = neighbor_tile(tile, step // 7 - 3, step % 7 - 3, gas)
        out[k, 0], out[k, 1], out[k, 2] = ti.cast(near.tile, float), near.shift_x, near.shift_y
        out[k, 3], out[k, 4] = ti.cast(near.boxes_x, float), ti.cast(near.boxes_y, float)


@kernel
def place(tile: ti.i32, time: ti.f64, out: Table, gas: Arrays("uses grid scale edge_x edge_y disk")):
    """Results of `placed` for the disks that a tile lists."""
    for s in range(out.shape[0]):
        here = placed(s, tile, time, gas)
        out[s, 0], out[s, 1] = here.x, here.y
        out[s, 2], out[s, 3], out[s, 4] = here.boxes_x, here.boxes_y, here.frame


@kernel
def verify(
    out: Rows,
    gas: Arrays("uses grid scale reach tile edge_x edge_y disk history_hash displacement slot_before ghost"),
):
    """Whether ghost records of each tile are wrong (`is_wrong`)."""
    for k in range(out.shape[0]):
        out[k] = ti.cast(is_wrong(k, 0, gas), float)


@kernel
def search(
    times: Table, partners: Table,
    gas: Arrays("uses grid scale reach edge_x edge_y kinds motion event_info head"),
):  # fmt: skip
    """First meetings of all disks of a box, in lane 1, with those in the 3 x 3 cells around: by cells and by images.

    Then with those in half of the cells, so that each pair is compared once.
    """
    for _ in range(1):
        region = region_of(0, 1, gas)
        for k in range(2 * times.shape[0]):
            i, halved = k >> 1, k & 1
            info = gas.event_info[i]
            cx, cy = info.cell >> 16, info.cell & 0xFFFF
            low_x, high_x, low_y, high_y, layer = cx - 1 + halved, cx + 1, cy - 1, cy + 1, 0
            nx, ny, last = region.nx, region.ny, info.last
            radius, size = 0.5 * gas.scale.widest, ti.abs(gas.motion[i].vx) + ti.abs(gas.motion[i].vy)
            best, partner = FAR + 0.0 * size, NO_PARTNER
            search_cells(
                i, low_x, high_x, low_y, high_y, cx, cy, halved, layer, nx, ny, last, radius, size, best, partner,
                region, gas,
            )  # fmt: skip
            times[i, 2 * halved], partners[i, 2 * halved] = best, ti.cast(partner, float)
            best, partner = FAR + 0.0 * size, NO_PARTNER
            search_candidates(
                i, low_x, high_x, low_y, high_y, cx, cy, halved, layer, nx, ny, last, radius, size, best, partner,
                region, gas,
            )  # fmt: skip
            times[i, 2 * halved + 1], partners[i, 2 * halved + 1] = best, ti.cast(partner, float)


@kernel
def carry(
    gas: Arrays(
        "uses grid scale reach edge_x edge_y tile kinds disk meta past hits held asleep dissipated kind motion "
        "event_info image_info candidates rest cached_force since turn loss"
    ),
):
    """Load the disk of candidate 0 into slot 1 of a tile that is the box, and store it in row 2."""
    for _ in range(1):
        region = region_of(0, 0, gas)
        zero = 0.0 * gas.scale.window
        itself = ti.Struct(tile=0, step_y=0, shift_x=zero, shift_y=zero, boxes_x=0, boxes_y=0)
        load_from(itself, 0, 1, 0, region, gas)
        m = gas.motion[1]
        store(1, 2, zero, m.x, m.y, m.vx, m.vy, 0, 0, gas)
