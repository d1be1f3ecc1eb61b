"""Sizes of tiles and cells and lengths of windows, chosen from the density of a gas at the start of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError
from ...kernels.columns import SINGLE_TILE, most_disks
from ...kernels.layout import BLOCK_SLOTS, FAR, MAX_TRAVEL
from ...model.box import Box
from ...model.density import henderson, packing_fraction, path_in_collisions
from ...model.state import Disks, State, unlike

if TYPE_CHECKING:
    from ...kernels.layout import Uses
    from ...model.device import Device

CELL = 1.0 + 1e-6  # side of a cell in largest diameters, at least: what rounding leaves of it
# The same where disks sleep, which may leave their cell in the falling frame by RESTING_FALL. A window lasts a fall by
# that many largest diameters, or RESTING_WINDOW v_s / g, at most.
RESTING_CELL, RESTING_FALL, RESTING_WINDOW = 1.1, 0.05, 8.0
# A gas is thin (`Uses.thin`) below this packing fraction, where that is faster; disks in one of its cells.
THIN, IN_THIN_CELL = 5e-3, 20.0
LEAST_GAP = 2.0  # ratio of radii on both sides of a gap between them, from which on cells have two layers
LEAST_TILE, GPU_LEAST_TILE = 12.0, 8.0  # side of a tile in largest diameters, at least
FEWER_WINDOWS = 4.0  # of gases in one tile, which need no halo
CHAINS, GPU_CHAINS = 4.0, 4.0  # halo for disks that hit one another in chains, in largest diameters
GPU_COLLISIONS, GPU_TILE = 0.4, 64  # collisions of a disk in a window, and disks of a tile, for a GPU
LOCAL_COLLISIONS = 2.0  # of a disk in a window at the busiest place, over the mean, for blocks of a GPU
BLOCK_DEVIATIONS = 4.5  # of the number of disks around a tile, for which a block of a GPU has room too
DENSEST = 0.85  # packing fraction beyond which tiles and windows stay the same
DENSEST_FLUID = 0.8  # packing fraction beyond which the estimate of collision rates stays the same: a crystal
ROOM = 0.5  # around an open gas, in extents of what it fills: beyond, its cells have no ends


def tile_parameters(phi: float) -> tuple[float, int]:
    """Fastest measured parameters at a packing fraction phi: collisions of a disk in a window, disks of a tile."""
    collisions = np.interp(phi, [0.0, 0.1, 0.3, 0.6], [0.5, 0.7, 1.3, 1.5])
    return float(collisions), 5000


def block_side(phi: float, free: float, halo: float) -> float:
    """Side of a tile that a block of a GPU runs [length]: with its halo [length] it has what a block has room for.

    A disk has the area `free` [length^2]. The variance of the number of disks in an area is its mean times
    (1 - phi)^3 / (1 + phi), by the compressibility of scaled-particle theory.
    """
    spread = math.sqrt(BLOCK_SLOTS * (1.0 - phi) ** 3 / (1.0 + phi))
    return math.sqrt((BLOCK_SLOTS - BLOCK_DEVIATIONS * spread) * free) - 2.0 * halo


def thin_cell(phi: float, free: float, widest: float, uses: Uses, device: Device) -> float:
    """Side of the cells of a thin gas [length], or 0 for a gas that is not thin.

    A disk has the area `free` [length^2]. Kernels for sheared gases and those that rest compare disks in their own way.
    In single precision the lines of flight would be no less exact than the comparisons. Cells as wide as few very large
    disks hold too many small ones.
    """
    side = math.sqrt(IN_THIN_CELL * free)
    can = device.name == "cpu" and device.precision == "f64" and not (uses.shear or uses.rest)
    return side if can and phi < THIN and side > CELL * widest else 0.0


def disks_per_cell(phi: float) -> float:
    """Fastest measured number of disks in a cell: more in dilute gases, whose disks cross more cells."""
    return float(np.clip(0.38 * (0.1 / max(phi, 1e-300)) ** 0.3, 0.3, 3.0))


def split_of(radius: NDArray[np.float64]) -> float | None:
    """The largest radius of disks in small cells, if a second layer of large cells for the others is faster.

    The two groups are separated by the widest gap between radii, if that is a factor 2 at least.
    """
    (known,) = unlike([radius])
    if len(known) < 2:
        return None
    gap = int(np.argmax(known[1:] / known[:-1]))
    return float(known[gap]) if known[gap + 1] > LEAST_GAP * known[gap] else None


def tiles_along(sides: NDArray[np.float64], area: float, least: float) -> tuple[int, int]:
    """Numbers of tiles along x and y, of an area [length^2] and a least side [length]."""
    side = max(math.sqrt(area), least)
    return max(1, int(sides[0] / side)), max(1, int(sides[1] / side))


def tiles_on_ranks(disks: Disks, box: Box) -> tuple[int, int]:
    """Numbers of tiles along x and y of a box that is on several ranks (`Tiling`)."""
    if disks.n <= SINGLE_TILE and box.shear_rate == 0.0:
        return 1, 1
    _, tile_disks = tile_parameters(min(packing_fraction(disks.covered, box.area), DENSEST))
    widest = 2.0 * float(disks.radius.max(initial=0.0))
    return tiles_along(np.array(box.lengths), tile_disks * box.area / max(disks.n, 1), LEAST_TILE * widest)


def filled_region(box: Box, state: State, widest: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower left and upper right corner [length] of the box, or of what an open gas fills, with room around it.

    EngineError if an open gas is too wide to compute with.
    """
    if not box.is_open:
        return np.zeros(2), np.array(box.lengths)
    if not state.n:
        return np.zeros(2), np.ones(2)
    low, high = state.position.min(axis=0), state.position.max(axis=0)
    room = ROOM * (high - low).max() + widest
    low, high = low - room, high + room
    if not np.isfinite(high - low).all() or (high - low).max() > 1e100:
        raise EngineError(f"positions spread over {(high - low).max():.3g}: too far apart to compute with")
    return low, high


@dataclass(frozen=True)
class Tiling:
    """Tiles and cells of a region, and the length of windows.

    Attributes
    ----------
    tiles : tuple of int
        Numbers along x and y.
    single_tile : bool
        True if one thread runs the whole region in order.
    cell_side : float
        Of the cells in which neighbours are looked for; of two layers, of the small ones [length].
    thin : bool
        True if neighbours are found by lines of flight, in one layer of cells.
    coarse : int
        Sides of small cells in that of large ones.
    window_side : float
        Of a tile, of which a disk may cross a part in a window [length].
    collisions : float
        Of a disk in a window.
    local_collisions : float
        Most collisions of a disk in a window, where they are most frequent; FAR: no limit.
    path : float
        What a disk covers between so many collisions at the rms speed [length].
    chain_halo : float
        Halo of a tile for disks that hit one another in chains [length].
    """

    tiles: tuple[int, int]
    single_tile: bool
    cell_side: float
    thin: bool
    coarse: int
    window_side: float
    collisions: float
    local_collisions: float
    path: float
    chain_halo: float

    @classmethod
    def of(
        cls,
        disks: Disks,
        sides: NDArray[np.float64],
        widest: float,
        split: float | None,
        uses: Uses,
        device: Device,
        order: str | None,
        tile_disks: int | None,
    ) -> Tiling:
        """The tiling of a rectangle with these sides [length], of disks up to `widest` across in one layer of cells.

        In two layers, small cells hold disks of radii up to `split` [length]. Order and disks of a tile as of `Engine`.
        """
        n, on_gpu = disks.n, device.name != "cpu"
        given, few = device.window_collisions, n <= SINGLE_TILE
        area = float(np.prod(sides))
        phi = min(packing_fraction(disks.covered, area), DENSEST)
        collisions, in_tile = tile_parameters(phi)
        if on_gpu:
            collisions, in_tile = min(collisions, GPU_COLLISIONS), GPU_TILE
            if uses.blockwise:  # so that lists have some ten disks
                collisions = min(collisions, float(np.interp(phi, [0.1, 0.3], [0.2, 0.4])))
        elif few and not uses.shear:
            collisions *= FEWER_WINDOWS
        if given is not None:  # whatever the device: windows decide the bits
            collisions = given
        free = area / max(n, 1)  # of a disk
        mean = 2.0 * disks.mean_radius if n else 1.0
        path = path_in_collisions(collisions, free, mean, henderson(min(phi, DENSEST_FLUID)))
        # A gas in one tile: no disk goes round the box in a window, for the grid of positions.
        window_side = float(sides.min())
        if given is not None:
            window_side = min(window_side, math.sqrt(GPU_TILE * free))
        elif uses.shear or not few or on_gpu:
            window_side = min(window_side, math.sqrt(in_tile * free))
        # Columns and rows of cells are counted in 16 bits; of more disks no region is the whole box.
        least = float(sides.max()) / 3e4 if n <= most_disks(device.low_memory) else 0.0
        cell = (RESTING_CELL if uses.rest else CELL) * widest if split is None else CELL * 2.0 * split
        wide = thin_cell(phi, free, widest, uses, device)
        cell_side = max(wide or max(cell, math.sqrt(disks_per_cell(phi) * free)), least)
        coarse = 1 if split is None or wide else math.ceil(CELL * widest / cell_side)
        single_tile = order == "serial" or (order is None and few and not on_gpu)
        single_tile = single_tile and not uses.shear
        tiles = (1, 1)
        chain_halo = widest * ((GPU_CHAINS if on_gpu else CHAINS) + 3.0 * phi)
        if not single_tile:
            least_tile = (GPU_LEAST_TILE if on_gpu else LEAST_TILE) * widest
            tiles = tiles_along(sides, (tile_disks or in_tile) * free, least_tile)
            if on_gpu and uses.blockwise and n and not tile_disks:
                # By the speed of the fastest of n disks in equilibrium.
                way = min(path * math.sqrt(math.log(n) + 2.0), MAX_TRAVEL * window_side)
                side = max(block_side(phi, free, chain_halo + 2.0 * way), least_tile)
                tiles = math.ceil(sides[0] / side), math.ceil(sides[1] / side)
        # Long chains of collisions in clusters would need halos that blocks of a GPU have no room for.
        local = LOCAL_COLLISIONS * collisions if uses.blockwise and (on_gpu or given is not None) else FAR
        return cls(
            tiles,
            single_tile,
            cell_side,
            wide > 0.0,
            coarse,
            window_side,
            collisions,
            local,
            path,
            chain_halo,
        )
