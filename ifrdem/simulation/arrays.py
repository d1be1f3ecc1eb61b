"""The engine's arrays: what lies on the device, how large it is, and how kernels get it.

`kernels/layout.py` says what each array holds; they have the same names here. This module imports Taichi: import it
only after `backend.start`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError
from ..kernels import layout as k
from ..kernels.columns import (
    ADDRESSABLE,
    CONTACTS_PER_DISK,
    KIND,
    MOST_DISKS,
    MOST_MOMENTS,
    PISTON_STATE,
    REAL,
    SINGLE_TILE,
    SMALL,
    SNAPSHOT_DISKS,
    TABLES,
    TALLY,
    TOTAL,
    TYPES,
    WALL,
    WALL_SUM,
    Named,
    blank,
    named,
)
from ..kernels.language import from_numpy, ti, to_numpy, view
from ..kernels.readout import exchange
from ..kernels.shear import displacement
from ..kernels.signature import parameters_of
from ..kernels.walls.kinds import FREE, GONE
from ..model.box import Box
from ..model.contact import henderson
from ..model.state import COLUMNS, Disks, State, codes
from ..model.walls import Wall
from . import backend
from .checks import MANTISSA, position_spacing
from .domain import Domain

CELL = 1.0 + 1e-6  # side of a cell in largest diameters, at least: what rounding leaves of it
# The same where disks sleep, which may leave their cell in the falling frame by RESTING_FALL. A window lasts a fall by
# that many largest diameters, or RESTING_WINDOW v_s / g, at most.
RESTING_CELL, RESTING_FALL, RESTING_WINDOW = 1.1, 0.05, 8.0
LEAST_GAP = 2.0  # ratio of radii on both sides of a gap between them, from which on cells have two layers
LEAST_TILE, GPU_LEAST_TILE = 12.0, 8.0  # side of a tile in largest diameters, at least
FEWER_WINDOWS = 4.0  # of gases in one tile, which need no halo
CHAINS, GPU_CHAINS = 4.0, 4.0  # halo for those who hit one another in chains, in largest diameters
GPU_COLLISIONS, GPU_TILE = 0.4, 64  # the same for a GPU
GPU_THREADS = 32768  # of which some work on events, spread over all multiprocessors
DENSEST_FLUID = 0.8  # packing fraction beyond which the estimate of collision rates stays the same: a crystal
BURST = 64  # windows of a gas in one tile that one launch runs at most
GPU_BURST = 20_000_000  # disks times windows, of a GPU
ROOM = 0.5  # around an open gas, in extents of what it fills: beyond, its cells have no ends
SLACK = 1.3  # of the scratch space of a lane, beyond what the densest tile needed


def tile_parameters(packing_fraction: float) -> tuple[float, int]:
    """Collisions that a disk has in a window, and disks of a tile: what took least time at this density."""
    collisions = np.interp(packing_fraction, [0.0, 0.1, 0.3, 0.6], [0.5, 0.7, 1.3, 1.5])
    return float(collisions), 5000


def disks_per_cell(packing_fraction: float) -> float:
    """Of thin gases, whose cells are wider: what took least time; the thinner, the more cells a disk passes."""
    return float(np.clip(0.38 * (0.1 / max(packing_fraction, 1e-300)) ** 0.3, 0.3, 3.0))


def split_of(radius: NDArray[np.float64]) -> float | None:
    """The largest radius of disks in small cells, where it pays to have large cells for the others: of two layers.

    The widest gap between radii parts them, if that is a factor 2 at least.
    """
    known = np.unique(radius)
    if len(known) < 2:
        return None
    gap = int(np.argmax(known[1:] / known[:-1]))
    return float(known[gap]) if known[gap + 1] > LEAST_GAP * known[gap] else None


def kind_rows(
    mass: NDArray[np.float64], radius: NDArray[np.float64], k: NDArray[np.float64], material: NDArray[np.integer]
) -> NDArray[np.float64]:  # fmt: skip
    """Rows of `kinds` of some disks, shape (disks, columns of `columns.KIND`)."""
    kind = Named(np.empty((len(mass), KIND.width)), KIND)
    kind.inverse_mass, kind.k, kind.radius, kind.material = 1.0 / mass, k, radius, material
    kind.mass = np.where(np.isfinite(mass), mass, 0.0)
    kind.inertia = kind.mass * radius**2 / k
    return kind.array


def kinds_of(disks: Disks) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Kinds of disks, shape (kinds, columns of `columns.KIND`); and the kind of each row of `disks`."""
    code = codes((1.0 / disks.mass, disks.k, disks.radius, disks.material))
    first = np.unique(code, return_index=True)[1] if code.any() else np.arange(min(len(code), 1))
    return kind_rows(*(getattr(disks, name)[first] for name in COLUMNS)), code


def tiles_along(sides: NDArray[np.float64], area: float, least: float) -> tuple[int, int]:
    """Numbers of tiles along x and y, of an area [length^2] and a least side [length]."""
    side = max(math.sqrt(area), least)
    return max(1, int(sides[0] / side)), max(1, int(sides[1] / side))


def tiles_on_ranks(disks: Disks, box: Box) -> tuple[int, int]:
    """Numbers of tiles along x and y of a box that is on several ranks (`DeviceArrays.load`)."""
    if disks.n <= SINGLE_TILE and box.shear_rate == 0.0:
        return 1, 1
    _, tile_disks = tile_parameters(min(disks.covered / box.area, 0.85))
    widest = 2.0 * float(disks.radius.max(initial=0.0))
    return tiles_along(np.array(box.lengths), tile_disks * box.area / max(disks.n, 1), LEAST_TILE * widest)


def concatenated_ranges(first: NDArray[np.integer], count: NDArray[np.integer]) -> NDArray[np.intp]:
    """Numbers of stretches that begin at `first` and are so long, one stretch after another."""
    before = np.cumsum(count) - count
    found: NDArray[np.intp] = np.repeat(first - before, count) + np.arange(int(count.sum()))
    return found


class DeviceArrays:
    """All arrays of one engine, under the names that kernels give their arguments.

    Coefficients of the law for each pair of materials, `law_table` (M, M, c); `options` of `Engine`; `walls`,
    a row of `columns.WALL` for each of their pieces.
    """

    tile: Any
    listed: Any
    displacement: Any
    event: Any
    event_int: Any
    pair_time: Any
    pair: Any
    found: Any
    blocks: Any

    def __init__(
        self,
        disks: Disks,
        box: Box,
        law_table: NDArray[np.float64],
        options: Any,
        walls: NDArray[np.float64],
        uses: k.Uses,
        domain: Domain | None = None,
    ) -> None:
        n = disks.n
        self.n: int = n
        self.domain: Domain = domain or Domain()
        self.domain.attach(self)
        self.box: Box = box
        self.uses: k.Uses = uses
        self.real: type[np.floating[Any]] = np.float32 if options.device.precision == "f32" else np.float64
        self._type = getattr(ti, options.device.precision)
        self._arguments: dict[Callable[..., Any], list[str]] = {}
        self.room: int = 0
        self.parts: int = 2
        kinds, self._kind = kinds_of(disks)
        self.kinds: Any
        self.make("kinds", len(kinds))
        if n:
            from_numpy(self.kinds, kinds.astype(self.real))
        self._split = split_of(disks.radius)
        # Walls are noted in one layer of cells.
        layered = self._split is not None and not (uses.walled or uses.rests)
        self.uses = uses = uses.replace(mixed=len(kinds) > 1, layered=layered)
        self.kind: Any
        self.make("kind", n if uses.mixed and not uses.shared else 1)
        if uses.mixed and not uses.shared:
            from_numpy(self.kind, self._kind.astype(np.int32))
        self.law: Any = ti.ndarray(self._type, law_table.shape)
        from_numpy(self.law, law_table.astype(self.real))
        # Small arrays that the host reads after every launch. Kernels on a CPU take NumPy arrays as they are; a GPU has
        # arrays of its own for them (`launch`).
        self.on_gpu: bool = options.device.name != "cpu"
        self._twins: dict[str, Any] = {}
        self.counter: Named = blank("counter", np.int32)
        self.clock: Named = blank("clock")
        self.grid: Named = blank("grid", np.int32)
        self.scale: Named = blank("scale", self.real)
        self.scale.moment = k.FAR
        words = np.array([options.seed & 0xFFFFFFFF, options.seed >> 32], dtype=np.uint32)
        self.grid.seed_low, self.grid.seed_high = words.view(np.int32)
        # Where there are more disks, on several ranks, no kernel asks how many.
        self.grid.n, self.grid.lanes, self.clock.n = min(n, ADDRESSABLE), 1, n
        self.grid.walls = len(walls)
        self.grid.periodic_x, self.grid.periodic_y = box.periodic
        self.widest: float = 2.0 * float(disks.radius.max()) if n else 1.0
        self.scale.widest = self.widest
        self.scale.cutoff, self.scale.contact_time = options.velocity_cutoff, options.contact_time
        if options.resting_speed:
            self.scale.cutoff = options.resting_speed
        self.scale.shear = box.shear_rate
        walls = walls.reshape(-1, WALL.width)
        self.walls: Any
        self.make("walls", len(walls))
        wall = named(walls, "walls")
        owner = wall.owner.astype(np.int64)
        self.thermal: NDArray[np.int64] = np.unique(owner[wall.temperature > 0.0])
        number = int(owner.max()) + 1 if uses.summed else 0
        self.pistons: NDArray[np.int64] = np.flatnonzero(wall.motion.kind == FREE)  # rows of walls
        first_piston = len(self.thermal) + WALL_SUM.width * number
        # Number of columns of the tally.
        self.columns: int = TALLY.width + first_piston + PISTON_STATE.width * len(self.pistons)
        self.grid.first_piston = self.pistons[0] if len(self.pistons) else -1
        self.wall_rows: NDArray[np.float64] = walls
        if len(walls):
            wall.heat = np.where(np.isin(owner, self.thermal), np.searchsorted(self.thermal, owner), -1)
            wall.sums = len(self.thermal) + WALL_SUM.width * owner
            wall.piston.sums[self.pistons] = first_piston + PISTON_STATE.width * np.arange(len(self.pistons))
            wall.piston.next[self.pistons] = np.append(self.pistons[1:], -1)[: len(self.pistons)]
            from_numpy(self.walls, walls.astype(self.real))
        self.sums: NDArray[np.float64] = np.zeros(self.columns)
        self._lanes = 0
        self.batch: int = 0
        self.make_parts(2, self.domain.first_slots(n))
        self.watched: Any
        self.make("watched", n if uses.watched else 1)
        self.scratch(0, 0, 0)
        self.make_ghosts(0)
        self.events(0)
        self.make_pairs(0)

    # ------------------------------------------------------------------ room

    @staticmethod
    def new_array(of: Any, *shape: int) -> Any:
        return ti.ndarray(of, tuple(max(each, 1) for each in shape))

    def _type_of(self, name: str) -> Any:
        return self._type if TYPES[name] == REAL else getattr(ti, TYPES[name])

    def make(self, name: str, rows: int) -> None:
        """Replace the array of this name by one of so many rows, at least one: of numbers, or of its columns."""
        of, rows = self._type_of(name), max(rows, 1)
        new = ti.Vector.ndarray(TABLES[name].width, of, rows) if name in TABLES else self.new_array(of, rows)
        self.replace(name, new)

    def _make_table(self, name: str, rows: int) -> None:
        """As `_make`, with the columns as a second axis."""
        self.replace(name, self.new_array(self._type_of(name), rows, TABLES[name].width))

    def replace(self, name: str, new: Any) -> None:
        old = getattr(self, name, None)
        if isinstance(old, ti.Ndarray):
            backend.free_array(old)
        setattr(self, name, new)

    def make_parts(self, parts: int, room: int) -> None:
        """Room for the state of so many disks at so many times; what is there already stays.

        Times are the beginning and end of a window, and moments in it.
        """
        kept = self.state_arrays()
        rows = parts * room
        self._check_addresses(rows)
        before = {name: self.values(name).copy() for name in self.state_names()} if self.room else {}
        for name in before:
            self.replace(name, None)
        for name in ("disk", "meta", "past", "hits", "spent", "held", "slept"):
            self.make(name, rows if kept[name] else 1)
        if self.uses.shared:
            self.make("kind", rows if kept["kind"] else 1)
        same = min(self.room, room)
        for name, old in before.items():
            with self.written(name) as (new,):
                for part in range(min(self.parts, parts)):
                    new[part * room : part * room + same] = old[part * self.room : part * self.room + same]
        for name in ("history_hash", "displacement", "slot_before"):
            self.make(name, room)
        self.parts, self.room = parts, room
        self.grid.moments, self.grid.room = parts - 2, room

    def make_moments(self, needed: int = 1) -> int:
        """Make room for so many moments within a window, or for the most that there may be: for how many."""
        most = max(1, min(MOST_MOMENTS, SNAPSHOT_DISKS // max(self.n, 1)))
        moments = max(self.parts - 2, 1 if needed == 1 else most)
        if moments > self.parts - 2:
            self.make_parts(2 + moments, self.room)
            self._make_sums()
        return self.parts - 2

    def _check_addresses(self, rows: int) -> None:
        if 8 * rows > ADDRESSABLE:
            raise EngineError(
                f"{self.n} disks: 32-bit indices of Taichi reach arrays of {ADDRESSABLE} numbers, which is enough for "
                f"{ADDRESSABLE // 24} disks"
            )

    def scratch(self, lane_slots: int, cells: int, items: int) -> None:
        """Scratch space of the lanes: disks, cells, bins (a power of two) and walls near cells of a region."""
        bins = 1 << max(lane_slots - 1, 1).bit_length()
        if self.grid.single_tile and not self.on_gpu:
            bins *= k.BINS_PER_DISK
        lanes, uses = int(self.grid.lanes), self.uses
        rows = lanes * lane_slots
        self._check_addresses(2 * rows)
        grid = self.grid
        grid.lane_slots, grid.cells, grid.bins, grid.items = lane_slots, cells, bins, items
        for name in ("motion", "event_info", "image_info", "start_position"):
            self.make(name, rows)
        self.make("rest", rows if uses.rests else 1)
        self.make("residual_acceleration", rows if uses.rests else 1)
        self.make("contact", CONTACTS_PER_DISK * rows if uses.rests else 1)
        self.make("cached_force", rows if uses.rests else 1)
        self.make("candidates", rows)
        self.make("since", rows if uses.remembers else 1)
        self.make("turn", rows if uses.turned else 1)
        self.make("loss", rows if uses.itemised else 1)
        self.make("head", lanes * cells)
        self.make("bin", lanes * bins)
        self.make("wall_start", lanes * (cells + 1) if uses.walled else 1)
        self.make("wall_item", lanes * items if uses.walled else 1)

    def make_ghosts(self, most: int) -> None:
        """Allocate so many ghost records."""
        self._check_addresses(most)
        self.grid.most_ghosts = most
        self.make("ghost", most)
        self.make("ghost_position", most)

    def events(self, most: int) -> None:
        """Room for so many collisions that are written down."""
        self._check_addresses(3 * most)
        self.grid.most_events = most
        self.make("event", most)
        self.make("event_int", most)

    def make_pairs(self, most: int) -> None:
        """Room for so many collisions of two disks that are written down."""
        self._check_addresses(most)
        self.grid.most_pairs = most
        self.make("pair_time", most)
        self.make("pair", most)

    # ------------------------------------------------------------------ tiles

    def divide(self, tiles: tuple[int, int], low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Divide the rectangle from `low` to `high` [length] into tiles, whose sides lie on the grid of places."""
        count = np.array(tiles)
        extent = max(float(np.max(np.abs(np.concatenate([low, high])))), float(np.max(high - low)))
        precision = "f32" if self.real == np.float32 else "f64"
        if precision == "f32" and max(tiles) > 1:  # places are from the corner of a tile
            extent = 2.0 * float(np.max((high - low) / count))
        self.spacing: float = position_spacing(extent, precision)
        self.scale.rounding_constant = 1.5 * 2.0 ** (MANTISSA[precision] - 1) * self.spacing
        edges = []
        for axis in range(2):
            q = self.spacing
            if self.uses.sheared:  # all alike
                side = round((high[axis] - low[axis]) / tiles[axis] / q) * q
                edges.append(low[axis] + side * np.arange(tiles[axis] + 1))
            else:
                edges.append(np.round(np.linspace(low[axis], high[axis], tiles[axis] + 1) / q) * q)
        self.edges: list[NDArray[np.float64]] = edges
        self.grid.tiles_x, self.grid.tiles_y = tiles
        if self.uses.sheared:
            self.scale.drift = self.box.shear_rate * edges[1][1]
        total: int = tiles[0] * tiles[1]
        self.tiles: int = total
        self.own: NDArray[np.intp] = np.arange(total)
        if (1 + MOST_MOMENTS) * total * self.columns > ADDRESSABLE:
            raise EngineError(
                f"sums of walls: {self.columns} columns in each of {total} tiles are more than the {ADDRESSABLE} "
                "numbers that 32-bit indices of Taichi reach; make polylines of walls, or do without wall_sums"
            )
        for axis, name in enumerate(("edge_x", "edge_y")):
            self.make(name, len(edges[axis]))
            from_numpy(getattr(self, name), edges[axis])
        self._make_table("tile", total)
        self.make("listed", total)
        self._make_table("reach", total)
        blocks = -(-total // k.BLOCK_OF_TILES)
        self.make("blocks", blocks)  # that this process adds up
        from_numpy(self.blocks, np.arange(blocks, dtype=np.int32))
        self.total: NDArray[np.float64] = np.zeros(0)
        self._make_sums()
        self.scale.length_x, self.scale.length_y = (edge[-1] - edge[0] for edge in edges)
        self.scale.least_side = self.least_side

    @property
    def least_side(self) -> float:
        """Beyond it around a tile, the tiles around it would not have all disks [length]."""
        sides = [float(np.diff(edge).min()) for edge in self.edges]
        if self.uses.sheared:
            sides[0] /= 2.0  # rows above and below lie askew by up to half a tile
        return min(sides)

    def _make_sums(self) -> None:
        """Room for what tiles add up in a window, to its end and to each moment; sums that are known stay."""
        total, times = self.tiles, 1 + max(self.parts - 2, 1)
        columns, known = TOTAL.width + times * self.columns, self.total
        if len(known) == columns:
            return
        self.replace("tally", self.new_array(ti.f64, total, times, self.columns))
        self.replace("found", self.new_array(ti.f64, -(-total // k.BLOCK_OF_TILES), columns))
        self.total = np.zeros(columns)
        self.total[: min(len(known), columns)] = known[:columns]

    def load(self, disks: Disks, options: Any, state: State) -> None:
        """Divide the box, or what an open gas fills, into tiles, and begin a window from a state."""
        n, box = self.n, self.box
        low, high = np.zeros(2), np.array(box.lengths) if not box.is_open else np.ones(2)
        if box.is_open and n:
            low, high = state.position.min(axis=0), state.position.max(axis=0)
            room = ROOM * (high - low).max() + self.widest
            low, high = low - room, high + room
            if not np.isfinite(high - low).all() or (high - low).max() > 1e100:
                raise EngineError(
                    f"positions spread over {(high - low).max():.3g}: too far apart to compute with"
                )
        self.area: float = float(np.prod(high - low))
        phi = min(disks.covered / self.area, 0.85)
        self.packing_fraction: float = phi
        collisions, tile_disks = tile_parameters(phi)
        if self.on_gpu:
            collisions, tile_disks = min(collisions, GPU_COLLISIONS), GPU_TILE
        free = self.area / max(n, 1)  # of a disk
        few = n <= SINGLE_TILE
        sheared = self.uses.sheared
        if few and not sheared and not self.on_gpu:
            collisions *= FEWER_WINDOWS
        if options.device.window_collisions is not None:  # whatever the device: windows decide the bits
            collisions = options.device.window_collisions
        mean = 2.0 * disks.mean_radius if n else 1.0
        self.clock.path = (
            collisions * free / (math.sqrt(2.0 * math.pi) * mean * henderson(min(phi, DENSEST_FLUID)))
        )
        # A gas in one tile: no disk goes round the box in a window, for the grid of positions.
        own = float((high - low).min())
        if options.device.window_collisions is not None:
            own = min(own, math.sqrt(GPU_TILE * free))
        elif sheared or not few or self.on_gpu:
            own = min(own, math.sqrt(tile_disks * free))
        self.clock.tile_side = own
        # Columns and rows of cells are counted in 16 bits; of more disks no region is the whole box.
        least = float((high - low).max()) / 3e4 if n <= MOST_DISKS else 0.0
        widest = (RESTING_CELL if self.uses.rests else CELL) * self.widest
        self.grid.coarse = 1
        if self.uses.layered and self._split is not None:
            widest, self.scale.split = CELL * 2.0 * self._split, self._split
        side = self.scale.cell_side = max(widest, math.sqrt(disks_per_cell(phi) * free), least)
        if self.uses.layered:
            self.grid.coarse = math.ceil(CELL * self.widest / side)
        tiles = (1, 1)
        self.single_tile = options.order == "serial" or (
            options.order is None and few and options.device.name == "cpu"
        )
        self.single_tile = self.single_tile and not sheared
        if not self.single_tile:
            least_tile = GPU_LEAST_TILE if self.on_gpu else LEAST_TILE
            tiles = tiles_along(
                high - low, (options.tile_disks or tile_disks) * free, least_tile * self.widest
            )
        self.divide(tiles, low, high)
        if sheared:  # no last resort: windows are short enough for the tiles
            side = min(float(np.diff(edge).min()) for edge in self.edges)
            self.clock.tile_side = min(own, side / 3.0)
            shorter = min(1.0, side / (30.0 * self.widest))
            self.clock.path *= shorter
            collisions *= shorter
        self.clock.free_path, self.clock.in_window = self.clock.path, 0.5 * n * collisions
        lanes = 1 if self.single_tile else min(backend.lanes(), self.tiles)
        self.grid.lanes, self.grid.single_tile = lanes, int(self.single_tile)
        spread = min(max(GPU_THREADS // self.tiles, 1), k.TEAM)
        self.grid.stride = 1 << (spread.bit_length() - 1)
        self.batch = lanes if self.on_gpu else self.tiles  # tiles that one launch runs at most
        # Windows that follow one another without a look by the host, which would cost a GPU as long as a small gas.
        self.burst = BURST if self.single_tile else 1
        if self.on_gpu:
            followed = sheared or self.single_tile or self.uses.shared  # by something that the host does
            self.burst = 1 if followed else min(BURST, 1 + GPU_BURST // max(n, 1))
        self.scale.chain = self.widest * ((GPU_CHAINS if self.on_gpu else CHAINS) + 3.0 * phi)
        if self.single_tile:
            lane_slots, cells = n, int(1.3 * np.prod(np.maximum((high - low) / side, 1.0))) + 64
        else:
            lane_slots, cells = min(2 * n // self.tiles + 64, 9 * n), 64
        if lane_slots > self.grid.lane_slots or cells > self.grid.cells or lanes != self._lanes:
            self._lanes = lanes
            self.scratch(lane_slots, cells, 256 if self.uses.walled else 0)
        self.load_state(state)

    def open_walls(self, opened: NDArray[np.bool_]) -> None:
        """Take those walls, by their number, out of the gas: gates that are open."""
        rows = self.wall_rows.copy()
        wall = named(rows, "walls")
        wall.kind[opened[wall.owner.astype(np.int64)]] = GONE
        from_numpy(self.walls, rows.astype(self.real))

    def change_wall(self, number: int, wall: Wall) -> None:
        """Have the piston that is this wall be driven by another force; `open_walls` then sends it."""
        rows = named(self.wall_rows, "walls")
        rows.piston.push[rows.owner == number] = named(wall.rows(), "walls").piston.push

    def take_lists(self, found: dict[str, NDArray[Any]]) -> None:
        """Go on from lists that `lists` gave, as the beginning of a window."""
        self.domain.load({name: found[name] for name in self._kept()}, *found["listed"].T)

    def lists(self, part: int) -> dict[str, NDArray[Any]]:
        """Rows of the state at a part, by array and in order of ids; and `listed`, the tile and the place in its list.

        Of ranks, those of the own slice (`mpi/distribution.py`).
        """
        held, tile = self.rows_held(part)
        held.pop("kind", None)
        slot = np.arange(len(tile)) - np.searchsorted(tile, tile)
        held["listed"] = np.stack([tile, slot], axis=1).astype(np.int32)
        ids = named(held["meta"], "meta").id.astype(np.int64) - self.domain.first_id
        return dict(zip(held, self.domain.comm.by_id(self.n, ids, list(held.values())), strict=True))

    def _kept(self) -> list[str]:
        """Names of the arrays of a state that this gas keeps, beside the kinds of disks, which ids tell."""
        return [name for name in self.state_names() if name != "kind"]

    def values(self, name: str) -> NDArray[Any]:
        """Content of an array; on a CPU not to be changed, for it is the array itself."""
        array = getattr(self, name)
        found: NDArray[Any] = to_numpy(array) if self.on_gpu else view(array)
        return found

    def watch(self, chosen: NDArray[np.bool_]) -> None:
        """Choose the disks, by id, whose collisions are written down."""
        from_numpy(self.watched, chosen.astype(np.int32))

    @contextmanager
    def written(self, *names: str) -> Iterator[list[NDArray[Any]]]:
        """Content of arrays, which may be changed; a GPU gets it back at the end."""
        found = [self.values(name) for name in names]
        yield found
        if self.on_gpu:
            for name, values in zip(names, found, strict=True):
                from_numpy(getattr(self, name), values)

    def displace_rows(self, time: float) -> None:
        """Note how far rows of tiles in a sheared gas have moved against those below until `time` [time]."""
        side = float(self.edges[0][1])
        boxes, tiles, rest = displacement(float(self.scale.drift), time, side, float(self.grid.tiles_x))
        self.grid.boxes_aside, self.grid.tiles_aside = boxes, tiles
        self.scale.aside = round(rest / self.spacing) * self.spacing

    def _in_frames(
        self, state: State
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Positions and velocities in the frames of rows of tiles (`kernels/shear.py`), and boxes crossed.

        All positions lie in the box, along x as the frame lay upon it at time 0.
        """
        box, rows = self.box, int(self.grid.tiles_y)
        speed = float(self.scale.drift)
        lengths = np.array([edge[-1] for edge in self.edges])
        crossed = np.floor(state.position / lengths)
        position, velocity = state.position.copy(), state.velocity.copy()
        position[:, 1] = box.wrap(state.position, state.time)[:, 1]
        row = np.minimum((position[:, 1] / self.edges[1][1]).astype(np.int64), rows - 1)
        # The box above is one of `rows` rows further.
        frame = speed * (row + crossed[:, 1] * rows - 0.5 * (rows - 1))
        velocity[:, 0] -= frame
        position[:, 0] -= frame * state.time
        crossed[:, 0] = np.floor(position[:, 0] / lengths[0])
        position[:, 0] -= crossed[:, 0] * lengths[0]
        position[:, 0] = np.where(position[:, 0] < lengths[0], position[:, 0], 0.0)
        return position, velocity, crossed

    def load_state(self, state: State) -> None:
        """Write a state into the lists of the tiles, as the beginning of a window."""
        self.grid.part = 0
        if self.uses.sheared:
            self.displace_rows(state.time)
        self.domain.load(*self._rows_from(state))

    def _rows_from(self, state: State) -> tuple[dict[str, NDArray[Any]], NDArray[np.integer]]:
        """Rows of the arrays for a state, by the arrays' names; and the tile of each."""
        velocity, crossed = state.velocity, np.zeros((state.n, 2))
        if self.uses.sheared:
            position, velocity, crossed = self._in_frames(state)
        else:
            position = self.box.wrap(state.position)
            for axis in range(2):
                if self.box.periodic[axis]:
                    crossed[:, axis] = np.floor(state.position[:, axis] / self.box.lengths[axis])
        # First onto the grid: differences are exact then, whatever the tiles.
        position = np.round(position / self.spacing) * self.spacing
        counts = np.array([self.grid.tiles_x, self.grid.tiles_y])
        columns = [np.searchsorted(self.edges[a], position[:, a], side="right") - 1 for a in (0, 1)]
        index = np.clip(np.stack(columns, axis=1), 0, counts - 1)
        tile = index[:, 0] * counts[1] + index[:, 1]
        local = position - np.stack([self.edges[a][index[:, a]] for a in (0, 1)], axis=1)
        events, ids = state.collisions + state.wall_collisions, self.domain.comm.slice_of(self.n)
        kept: dict[str, Callable[[], NDArray[Any]]] = {
            "disk": lambda: np.column_stack([local, velocity, state.spin]),
            "meta": lambda: np.column_stack(
                [
                    np.arange(ids.start, ids.stop) + self.domain.first_id,
                    events,
                    state.image + crossed.astype(np.int32),
                ]
            ),
            "past": lambda: np.column_stack([state.latest_collision - state.time, state.angle]),
            "hits": lambda: np.column_stack([state.wall_collisions, state.last_partner]),
            "spent": lambda: state.dissipated,
            # Either is to be judged.
            "slept": lambda: np.where(state.asleep, k.ASLEEP_UNVERIFIED, k.WOKEN),
            "held": lambda: np.full((state.n, TABLES["held"].width), k.NO_PARTNER),
        }
        types = {"real": self.real, "f64": np.float64, "i32": np.int32}
        found: dict[str, NDArray[Any]] = {
            name: kept[name]().astype(types[TYPES[name]], copy=False) for name in self._kept()
        }
        return found, tile

    def set_lists(self, part: int, count: NDArray[np.int64]) -> None:
        """Say how many disks each tile lists; lists begin one after another."""
        with self.written("tile") as (tile,):
            lists = named(tile, "tile")
            lists.count[:, part] = count
            lists.start[:, part] = np.cumsum(count) - count

    def relist(self) -> None:
        """List the disks by the tiles they are in; places stay what they are, to the last bit."""
        held, listed, tile = self._moved()
        self.domain.list_rows(held, tile, listed)

    def _moved(self) -> tuple[dict[str, NDArray[Any]], NDArray[np.intp], NDArray[np.int64]]:
        """Rows of the state by array, list after list, from the corners of the tiles that they are in now.

        With the tile that lists each, and the one that it is in.
        """
        held, listed = self.rows_held(int(self.grid.part))
        counts = np.array([self.grid.tiles_x, self.grid.tiles_y])
        index = np.empty((len(listed), 2), dtype=np.int64)
        disk, image = held["disk"], named(held["meta"], "meta")
        for axis, old in enumerate((listed // counts[1], listed % counts[1])):
            edge = self.edges[axis]
            position = edge[old] + disk[:, axis].astype(np.float64)
            if self.box.periodic[axis]:
                boxes = np.floor(position / edge[-1])
                boxes = np.where(position - boxes * edge[-1] >= edge[-1], boxes + 1, boxes)
                position -= boxes * edge[-1]
                (image.image_x, image.image_y)[axis][:] += boxes.astype(np.int32)
            index[:, axis] = np.clip(np.searchsorted(edge, position, side="right") - 1, 0, counts[axis] - 1)
            disk[:, axis] = position - edge[index[:, axis]]
        return held, listed, index[:, 0] * counts[1] + index[:, 1]

    def rows_held(self, part: int) -> tuple[dict[str, NDArray[Any]], NDArray[np.intp]]:
        """Rows of the state at a part, by array, list after list; and the tile that lists each."""
        rows, tile = self.rows_of(part)
        return {name: self.domain.state_rows(name, rows) for name in self.state_names()}, tile

    def rows_of(self, part: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows of a part in the arrays of the state, list after list, and the tile that lists each; own ones only."""
        tile = named(self.values("tile"), "tile")
        first, count = tile.start[self.own, part], tile.count[self.own, part]
        return part * self.room + concatenated_ranges(first, count), np.repeat(self.own, count)

    def state_names(self) -> list[str]:
        """Names of the arrays of a state that this gas keeps."""
        return [name for name, kept in self.state_arrays().items() if kept]

    def state_arrays(self) -> dict[str, bool]:
        """Names of the arrays that hold a state, and whether this gas keeps them."""
        uses = self.uses
        dated, counted = uses.remembers or uses.turned, uses.walled or uses.partnered
        return {
            "disk": True, "meta": True, "past": dated, "hits": counted, "spent": uses.itemised, "slept": uses.rests,
            "held": uses.rests, "kind": uses.mixed and uses.shared,
        }  # fmt: skip

    # ------------------------------------------------------------------ kernels

    def launch(self, kernel: Callable[..., Any], *numbers: float, **given: Any) -> Any:
        """Run a kernel: its first arguments are `numbers`, the others arrays, `given` or found here by their names."""
        if not self.on_gpu:
            return self._call(kernel, numbers, given)
        with self.sent():
            return self._call(kernel, numbers, given | self._twins)

    @contextmanager
    def sent(self) -> Iterator[Callable[..., Any]]:
        """Run several kernels, by what this gives, before the host sees what became of the small arrays."""
        if not self.on_gpu:
            yield self.launch
            return
        if not self._twins:
            for name in SMALL:
                kind = {np.dtype(np.int32): ti.i32, np.dtype(np.float32): ti.f32}.get(
                    self._raw(name).dtype, ti.f64
                )
                self._twins[name] = self.new_array(kind, len(self._raw(name)))
        own = [self._raw(name) for name in SMALL]
        board = np.concatenate(own).astype(np.float64)
        exchange(board, 1, *self._twins.values())
        yield lambda kernel, *numbers, **given: self._call(kernel, numbers, given | self._twins)
        exchange(board, 0, *self._twins.values())
        at = 0
        for array in own:
            array[:] = board[at : at + len(array)]
            at += len(array)

    def _call(self, kernel: Callable[..., Any], numbers: tuple[float, ...], given: dict[str, Any]) -> Any:
        if kernel not in self._arguments:
            self._arguments[kernel] = parameters_of(kernel)
        names = self._arguments[kernel][len(numbers) :]
        return kernel(*numbers, *(given[name] if name in given else self._raw(name) for name in names))

    def _raw(self, name: str) -> Any:
        """An array as kernels take it."""
        found = getattr(self, name)
        return found.array if isinstance(found, Named) else found

    def set_law(self, law_table: NDArray[np.float64], collision_law: Any) -> None:
        """Collide by another law from here on."""
        if law_table.shape != tuple(self.law.shape):
            self.replace("law", ti.ndarray(self._type, law_table.shape))
        from_numpy(self.law, law_table.astype(self.real))
        self.uses = self.uses.replace(collision_law=collision_law)

    def set_gravity(
        self, gravity: tuple[float, float], resting_speed: float, turned_at: float = -math.inf
    ) -> None:
        """Let disks fall otherwise from here on; all must have settled. Windows are as long as who rests may fall.

        Sleeping disks are checked again where gravity `turned_at` [time] that the window begins.
        """
        self.scale.gx, self.scale.gy = gravity
        self.clock.turned = turned_at
        self.clock.longest = np.inf
        if resting_speed:
            pull = math.hypot(*gravity)
            fall = math.sqrt(2.0 * RESTING_FALL * self.widest / pull)
            self.clock.longest = min(RESTING_WINDOW * resting_speed / pull, fall)

    def _on_device(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if isinstance(value, ti.Ndarray)}

    @property
    def bytes_allocated(self) -> int:
        """Bytes of all device arrays."""
        return self.bytes_of(*self._on_device())

    def bytes_of(self, *names: str) -> int:
        """Bytes of some of them."""
        wide = {"f64": 8, "u64": 8, "i64": 8}
        return sum(
            wide.get(str(array.dtype), 4) * math.prod(array.shape) * math.prod(array.element_shape)
            for array in (getattr(self, name) for name in names)
        )

    def release(self) -> None:
        """Give all device memory back."""
        for name, array in self._on_device().items():
            backend.free_array(array)
            setattr(self, name, None)
        for value in self._twins.values():
            backend.free_array(value)
