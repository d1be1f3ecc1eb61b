"""The engine's arrays on the device: their sizes, and how kernels get them.

`kernels/layout.py` says what each array holds; they have the same names here. This module imports Taichi: import it
only after `backend.start`.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError
from ...kernels import layout as k
from ...kernels.columns import (
    ADDRESSABLE,
    BLOCK_INTEGERS,
    BLOCK_REALS,
    BLOCK_SUMS,
    CONTACTS_PER_DISK,
    FORCE_VALUES,
    KICK,
    KIND,
    MOST_MOMENTS,
    REAL,
    SMALL,
    SNAPSHOT_DISKS,
    TABLES,
    TALLY,
    TOTAL,
    TYPES,
    WALL,
    Named,
    blank,
    most_disks,
    named,
)
from ...kernels.compiler.language import from_numpy, ti, to_numpy, view
from ...kernels.compiler.launch import Launcher
from ...kernels.disks.shear import displacement
from ...kernels.tiles.lines import NUMBERS, PLACES
from ...kernels.tiles.readout import exchange
from ...kernels.walls.kinds import GONE
from ...model.box import Box
from ...model.state import COLUMNS, Disks, State, codes
from ...model.walls.wall import Wall
from ...mpi.distribution import BLOCK, RowsByBlock, Table
from .. import backend
from ..measuring.extra_tally import ExtraTally
from ..start.checks import MANTISSA, MOST_COUNTED, position_spacing
from .domain import Domain
from .tiling import RESTING_FALL, RESTING_WINDOW, Tiling, filled_region, split_of

if TYPE_CHECKING:
    from ...model.setup import Setup

GPU_THREADS = 32768  # of which some work on events, spread over all multiprocessors
BURST = 64  # windows of a gas in one tile that one launch runs at most
BLOCK_LANES = 32  # tiles that threads of a GPU run at the same time where blocks run most
GPU_BURST = 20_000_000  # disks times windows, of a GPU
SLACK = 1.3  # of the scratch space of a lane, beyond what the densest tile needed


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


def concatenated_ranges(first: NDArray[np.integer], count: NDArray[np.integer]) -> NDArray[np.intp]:
    """Numbers of stretches that begin at `first` and are so long, one stretch after another."""
    before = np.cumsum(count) - count
    found: NDArray[np.intp] = np.repeat(first - before, count) + np.arange(int(count.sum()))
    return found


class DeviceArrays:
    """All arrays of one engine, under the names that kernels give their arguments.

    `walls` have a row of `columns.WALL` for each of their pieces; `order` and `tile_disks` as of `Engine`.
    """

    tile: Any
    listed: Any
    displacement: Any
    event: Any
    event_int: Any
    pair_time: Any
    pair: Any
    trail_time: Any
    trail: Any
    found: Any
    blocks: Any

    def __init__(
        self,
        setup: Setup,
        disks: Disks,
        walls: NDArray[np.float64],
        uses: k.Uses,
        domain: Domain | None = None,
        *,
        order: str | None = None,
        tile_disks: int | None = None,
    ) -> None:
        n = disks.n
        self.n: int = n
        self.domain: Domain = domain or Domain()
        self.domain.attach(self)
        self.box: Box = setup.box
        self._device, self._order, self._tile_disks = setup.device, order, tile_disks
        self.uses: k.Uses = uses
        self.real: type[np.floating[Any]] = np.float32 if setup.device.precision == "f32" else np.float64
        self._type = getattr(ti, setup.device.precision)
        self._launchers: dict[Callable[..., Any], tuple[Launcher, Callable[[Any], tuple[Any, ...]]]] = {}
        self.on_gpu: bool = setup.device.name != "cpu"
        self._low_memory = setup.device.low_memory
        self._twins: dict[str, Any] = {}
        self.room: int = 0
        self.parts: int = 2
        self.widest: float = 2.0 * float(disks.radius.max()) if n else 1.0
        self._take_kinds(disks)
        self.law: Any = ti.ndarray(self._type, setup.law_rows.shape)
        from_numpy(self.law, setup.law_rows.astype(self.real))
        self.wall_rows: NDArray[np.float64] = walls.reshape(-1, WALL.width)
        self.extra_tally: ExtraTally = ExtraTally.of(self.wall_rows, uses)
        self.columns: int = self.extra_tally.width
        self.walls: Any
        self.make("walls", len(self.wall_rows))
        if len(self.wall_rows):
            from_numpy(self.walls, self.wall_rows.astype(self.real))
        self._make_small_arrays(setup)
        self._lanes = 0
        self.batch: int = 0
        self.make_parts(2, self.domain.first_slots(n))
        self.first_of_species: Any
        self.make("first_of_species", len(disks.species))
        if disks.species:
            numbers = np.array([*disks.species.values()])
            first = np.cumsum(numbers) - numbers + self.domain.first_id
            from_numpy(self.first_of_species, first.astype(np.int32))
        self.watched: Any
        self.make("watched", n if uses.histories else 1)
        self.scratch(0, 0, 0)
        self.make_ghosts(0)
        self.events(0)
        self.make_pairs(0)
        self.make_trail(0)
        self.kicks: Any
        self.force_values: Any
        self.set_kicks(np.full((1, KICK.width), k.FAR))
        self.set_force_values(np.zeros(FORCE_VALUES.width))
        self.shares: Any
        self.make("shares", 1)

    def _take_kinds(self, disks: Disks) -> None:
        """Make the table of kinds of disks, and the kind of each disk."""
        kinds, code = kinds_of(disks)
        self.kinds: Any
        self.make("kinds", len(kinds))
        if self.n:
            from_numpy(self.kinds, kinds.astype(self.real))
        split = split_of(disks.radius)
        # Walls are noted in one layer of cells.
        layered = split is not None and not (self.uses.walls or self.uses.rest)
        self._split = split if layered else None
        self.uses = self.uses.replace(several_kinds=len(kinds) > 1, layers=layered)
        by_id = self.uses.several_kinds and not self.uses.ranks
        self.kind: Any
        self.make("kind", self.n if by_id else 1)
        if by_id:
            from_numpy(self.kind, code.astype(np.int32))

    def _make_small_arrays(self, setup: Setup) -> None:
        """Make the arrays that the host reads after every launch, with what stays the same in them.

        Kernels on a CPU take NumPy arrays as they are; a GPU has arrays of its own for them (`launch`).
        """
        n, pistons = self.n, self.extra_tally.pistons
        self.counter: Named = blank("counter", np.int32)
        self.clock: Named = blank("clock")
        self.grid: Named = blank("grid", np.int32)
        self.scale: Named = blank("scale", self.real)
        self.sums: NDArray[np.float64] = np.zeros(self.columns)
        self.scale.moment = k.FAR
        words = np.array([setup.seed & 0xFFFFFFFF, setup.seed >> 32], dtype=np.uint32)
        self.grid.seed_low, self.grid.seed_high = words.view(np.int32)
        # Where there are more disks, on several ranks, no kernel asks how many.
        self.grid.n, self.grid.lanes, self.clock.n = min(n, ADDRESSABLE), 1, n
        self.grid.walls = len(self.wall_rows)
        self.grid.first_piston = pistons[0] if len(pistons) else -1
        self.grid.periodic_x, self.grid.periodic_y = self.box.periodic
        self.scale.widest, self.scale.per_widest = self.widest, 1.0 / self.widest
        self.scale.velocity_cutoff, self.scale.resting_speed = setup.velocity_cutoff, setup.resting_speed
        self.scale.contact_time = setup.contact_time
        self.scale.shear = self.box.shear_rate

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
        """Replace an array as `make` does, with the columns as a second axis."""
        self.replace(name, self.new_array(self._type_of(name), rows, TABLES[name].width))

    def replace(self, name: str, new: Any) -> None:
        old = getattr(self, name, None)
        if isinstance(old, ti.Ndarray):
            backend.free_array(old)
        setattr(self, name, new)

    def make_parts(self, parts: int, room: int) -> None:
        """Make room for the state of so many disks at so many times; existing data stay.

        Times are the beginning and end of a window, and moments in it.
        """
        kept = self.state_arrays()
        rows = parts * room
        self._check_addresses(rows)
        same = min(self.room, room)
        for name in kept:
            if name == "kind" and not self.uses.ranks:
                continue
            # One by one: copies of all of them would be as large as the engine.
            old = self.values(name).copy() if self.room and kept[name] else None
            self.replace(name, None)
            self.make(name, rows if kept[name] else 1)
            if old is not None:
                with self.written(name) as (new,):
                    for part in range(min(self.parts, parts)):
                        new[part * room : part * room + same] = old[
                            part * self.room : part * self.room + same
                        ]
            del old
        for name in ("history_hash", "displacement", "slot_before"):
            self.make(name, room)
        self.parts, self.room = parts, room
        self.grid.moments, self.grid.room = parts - 2, room

    @property
    def keeps_moments(self) -> bool:
        """True unless `low_memory` leaves no room for states at moments within a window."""
        return self.single_tile or not self._low_memory

    def make_moments(self, needed: int = 1) -> int:
        """Make room for states at `needed` moments within a window, or at as many as allowed; return their number."""
        if not self.keeps_moments:
            return 0
        most = max(1, min(MOST_MOMENTS, SNAPSHOT_DISKS // max(self.n, 1)))
        moments = max(self.parts - 2, 1 if needed == 1 else most)
        if moments > self.parts - 2:
            self.make_parts(2 + moments, self.room)
            self._make_sums()
        return self.parts - 2

    def _check_addresses(self, rows: int) -> None:
        if 8 * rows > ADDRESSABLE:
            raise EngineError(
                f"{self.n} disks: 32-bit indices of kernels reach arrays of {ADDRESSABLE} numbers, which is enough for "
                f"{most_disks(self._low_memory)} disks"
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
        for name in ("motion", "event_info", "image_info"):
            self.make(name, rows)
        self.make("action", rows if uses.actions else 1)
        self.make("rest", rows if uses.rest else 1)
        self.make("residual_acceleration", rows if uses.rest else 1)
        self.make("contact", CONTACTS_PER_DISK * rows if uses.rest else 1)
        self.make("cached_force", rows if uses.rest else 1)
        self.make("candidates", rows)
        self.make("since", rows if uses.latest_collision else 1)
        self.make("turn", rows if uses.angle else 1)
        self.make("loss", rows if uses.dissipated else 1)
        self.make("head", lanes * cells)
        bunches = cells + lane_slots // PLACES + 1 if uses.thin else 0
        self._check_addresses(lanes * bunches * NUMBERS * PLACES // 8)
        grid.bunches = bunches
        self.make("bunch", lanes * bunches)
        self.make("line", lanes * bunches * NUMBERS * PLACES)
        self.make("line_slot", lanes * bunches * PLACES)
        self.make("spare", lanes)
        self.make("bin", lanes * bins)
        self.make("wall_start", lanes * (cells + 1) if uses.walls else 1)
        self.make("wall_item", lanes * items if uses.walls else 1)

    def make_ghosts(self, most: int) -> None:
        """Allocate so many ghost records."""
        self._check_addresses(most)
        self.grid.most_ghosts = most
        self.make("ghost", most)

    def events(self, most: int) -> None:
        """Make room for so many recorded collisions of tracked disks."""
        self._check_addresses(3 * most)
        self.grid.most_events = most
        self.make("event", most)
        self.make("event_int", most)

    def make_pairs(self, most: int) -> None:
        """Make room for so many recorded collisions of two disks."""
        self._check_addresses(most)
        self.grid.most_pairs = most
        self.make("pair_time", most)
        self.make("pair", most)

    @property
    def keeps_trail(self) -> bool:
        """True if moments of a window are found by its trail, rather than by another run of it."""
        return not (self.on_gpu or self.single_tile or self._low_memory)

    def make_trail(self, most: int) -> None:
        """Make room for so many recorded events in tiles."""
        self._check_addresses(most)
        self.grid.most_trail = most
        self.make("trail_time", most)
        self.make("trail", most)

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
            if self.uses.shear:  # all alike
                side = round((high[axis] - low[axis]) / tiles[axis] / q) * q
                edges.append(low[axis] + side * np.arange(tiles[axis] + 1))
            else:
                edges.append(np.round(np.linspace(low[axis], high[axis], tiles[axis] + 1) / q) * q)
        self.edges: list[NDArray[np.float64]] = edges
        self.grid.tiles_x, self.grid.tiles_y = tiles
        if self.uses.shear:
            self.scale.drift = self.box.shear_rate * edges[1][1]
        total: int = tiles[0] * tiles[1]
        self.tiles: int = total
        self.own: NDArray[np.intp] = np.arange(total)
        if (1 + MOST_MOMENTS) * total * self.columns > ADDRESSABLE:
            raise EngineError(
                f"sums of walls: {self.columns} columns in each of {total} tiles are more than the {ADDRESSABLE} "
                "numbers that 32-bit indices of kernels reach; make polylines of walls, or do without wall_sums"
            )
        for axis, name in enumerate(("edge_x", "edge_y")):
            self.make(name, len(edges[axis]))
            from_numpy(getattr(self, name), edges[axis])
        self._make_table("tile", total)
        self.make("listed", total)
        from_numpy(self.listed, np.zeros(total, dtype=np.int32))  # tile 0, if one tile is the whole box
        self.make("dense", total if self.on_gpu else 1)
        self._make_table("reach", total)
        blocks = -(-total // k.BLOCK_OF_TILES)
        self.make("blocks", blocks)  # that this process adds up
        from_numpy(self.blocks, np.arange(blocks, dtype=np.int32))
        self.total: NDArray[np.float64] = np.zeros(0)
        self._make_sums()
        self.scale.length_x, self.scale.length_y = (edge[-1] - edge[0] for edge in edges)
        self.scale.least_side = self.least_side

    @property
    def costliest_first(self) -> NDArray[np.intp]:
        """Tiles of this process; on a CPU in the order of their collisions in the last window, most first.

        Threads take tiles one by one: if a thread began a dense cluster late, all others would wait for it.
        """
        if self.on_gpu:
            return self.own
        collisions = self.values("tally")[self.own, k.AT_END, TALLY.collisions]
        return self.own[np.argsort(-collisions, kind="stable")]

    @property
    def least_side(self) -> float:
        """Largest distance around a tile within which the eight tiles around it have all disks [length]."""
        sides = [float(np.diff(edge).min()) for edge in self.edges]
        if self.uses.shear:
            sides[0] /= 2.0  # rows above and below lie askew by up to half a tile
        return min(sides)

    def _make_sums(self) -> None:
        """Make room for the sums of tiles over a window, to its end and to each moment; present sums stay."""
        total, times = self.tiles, 1 + max(self.parts - 2, 1)
        columns, known = TOTAL.width + times * self.columns, self.total
        if len(known) == columns:
            return
        self.replace("tally", self.new_array(ti.f64, total, times, self.columns))
        self.replace("found", self.new_array(ti.f64, -(-total // k.BLOCK_OF_TILES), columns))
        self.total = np.zeros(columns)
        self.total[: min(len(known), columns)] = known[:columns]

    def load(self, disks: Disks, state: State) -> None:
        """Divide the box, or the region of an open gas, into tiles, and begin a window from a state."""
        low, high = filled_region(self.box, state, self.widest)
        self.area: float = float(np.prod(high - low))
        tiling = Tiling.of(
            disks,
            high - low,
            self.widest,
            self._split,
            self.uses,
            self._device,
            self._order,
            self._tile_disks,
        )
        self.single_tile: bool = tiling.single_tile
        changes = tiling.thin != self.uses.thin
        self.uses = self.uses.replace(thin=tiling.thin, layers=self._split is not None and not tiling.thin)
        self.scale.cell_side, self.grid.coarse = tiling.cell_side, tiling.coarse
        if self._split is not None:
            self.scale.split = self._split
        self.scale.chain = tiling.chain_halo
        self.divide(tiling.tiles, low, high)
        window_side, shorter = tiling.window_side, 1.0
        if self.uses.shear:  # no last resort: windows are short enough for the tiles
            side = min(float(np.diff(edge).min()) for edge in self.edges)
            window_side, shorter = min(window_side, side / 3.0), min(1.0, side / (30.0 * self.widest))
        self.clock.tile_side = window_side
        self.clock.path = self.clock.free_path = tiling.path * shorter
        self.clock.in_window = 0.5 * self.n * (tiling.collisions * shorter)
        self.clock.local_collisions = tiling.local_collisions
        self._plan_launches()
        self._make_lanes(float(np.prod(np.maximum((high - low) / tiling.cell_side, 1.0))), anew=changes)
        self.load_state(state)

    def _plan_launches(self) -> None:
        """Set how many lanes, tiles and windows one launch has."""
        lanes = 1 if self.single_tile else min(backend.lanes(), self.tiles)
        fits = self.uses.blockwise and int(self.grid.walls) <= k.MOST_BLOCK_WALLS
        self.blockwise: bool = self.on_gpu and not self.single_tile and fits
        if self.blockwise:
            lanes = min(BLOCK_LANES, self.tiles)  # of the few tiles that no block can run
            self._make_blocks(min(backend.gpu_blocks(), self.tiles))
        self.grid.lanes, self.grid.single_tile = lanes, int(self.single_tile)
        spread = min(max(GPU_THREADS // self.tiles, 1), k.TEAM)
        self.grid.stride = 1 << (spread.bit_length() - 1)
        self.batch = lanes if self.on_gpu else self.tiles  # tiles that one launch runs at most
        # Windows that follow one another without a look by the host, which would cost a GPU as long as a small gas.
        self.burst = BURST if self.single_tile else 1
        if self.on_gpu:
            followed = (
                self.uses.shear or self.single_tile or self.uses.ranks
            )  # by something that the host does
            self.burst = 1 if followed else min(BURST, 1 + GPU_BURST // max(self.n, 1))

    def _make_blocks(self, blocks: int) -> None:
        """Make scratch space for so many blocks of a GPU, at least for one that runs dense tiles."""
        blocks = max(blocks, -(-k.DENSE_SLOTS // k.BLOCK_SLOTS))
        if self.grid.blocks == blocks:
            return
        self.grid.blocks = blocks
        rows = blocks * k.BLOCK_SLOTS
        self.make("block_integers", rows * BLOCK_INTEGERS.width)
        self.make("block_reals", rows * BLOCK_REALS.width)
        self._make_block_sums()
        self.make("near", rows * k.NEAR_WORDS)
        self.make("near_image", rows if self.uses.walls else 1)
        self.make("image_list", rows if self.uses.walls else 1)

    def _make_block_sums(self) -> None:
        """Make the part of the scratch space of blocks that only some gases have."""
        uses, rows = self.uses, int(self.grid.blocks) * k.BLOCK_SLOTS
        needed = uses.angle or uses.dissipated or uses.actions
        self.make("block_sums", rows * BLOCK_SUMS.width if needed else 1)

    def _make_lanes(self, cells_of_all: float, *, anew: bool) -> None:
        """Make scratch space for the lanes, `anew` or if there is not enough; the whole region has so many cells."""
        n, lanes = self.n, int(self.grid.lanes)
        if self.single_tile:
            lane_slots, cells = n, int(1.3 * cells_of_all) + 64
        else:
            lane_slots, cells = min(2 * n // self.tiles + 64, 9 * n), 64
        if anew or lane_slots > self.grid.lane_slots or cells > self.grid.cells or lanes != self._lanes:
            self._lanes = lanes
            self.scratch(lane_slots, cells, 256 if self.uses.walls else 0)

    def open_walls(self, opened: NDArray[np.bool_]) -> None:
        """Take those walls, by their number, out of the gas: gates that are open."""
        rows = self.wall_rows.copy()
        wall = named(rows, "walls")
        wall.kind[opened[wall.owner.astype(np.int64)]] = GONE
        from_numpy(self.walls, rows.astype(self.real))

    def change_wall(self, number: int, wall: Wall) -> None:
        """Set another force on the piston that is this wall; `open_walls` then copies it to the device."""
        rows = named(self.wall_rows, "walls")
        rows.piston.push[rows.owner == number] = named(wall.rows(), "walls").piston.push

    def take_lists(self, found: Mapping[str, Any]) -> None:
        """Load lists that `lists` gave, as the beginning of a window."""
        self.domain.load_lists({name: found[name] for name in self.kept_names}, found["listed"])

    def lists(self, part: int) -> dict[str, Table]:
        """Rows of the state at a part, by array and in order of ids; and `listed`, the tile and the place in its list.

        Of ranks, those of the own slice (`mpi/distribution.py`); else block by block, until the engine goes on.
        """
        if not self.uses.ranks:
            return self._lists_by_block(part)
        held, tile = self.rows_held(part)
        held.pop("kind", None)
        slot = np.arange(len(tile)) - np.searchsorted(tile, tile)
        held["listed"] = np.stack([tile, slot], axis=1).astype(np.int32)
        ids = named(held["meta"], "meta").id.astype(np.int64) - self.domain.first_id
        return dict(zip(held, self.domain.comm.by_id(self.n, ids, list(held.values())), strict=True))

    def _lists_by_block(self, part: int) -> dict[str, Table]:
        """As `lists`, of all disks."""
        row_of = np.full(self.n, -1, dtype=np.int32)
        ids_of = named(self.values("meta"), "meta").id
        total = 0
        for rows, _ in self.row_blocks(part):
            row_of[ids_of[rows]] = rows
            total += len(rows)
        if total != self.n or row_of.min(initial=0) < 0:
            raise EngineError("a disk is in no list, or in two: please report this")
        lists = named(self.values("tile"), "tile")
        first, count = part * self.room + lists.start[:, part].astype(np.int64), lists.count[:, part]
        order = np.lexsort((count, first))  # an empty list comes before one that begins at the same slot
        begins = first[order]

        def listed(ids: slice) -> NDArray[np.int32]:
            tile = order[np.searchsorted(begins, row_of[ids], side="right") - 1]
            return np.stack([tile, row_of[ids] - first[tile]], axis=1).astype(np.int32)

        whole = {name: self.values(name) for name in self.kept_names} if self.on_gpu else None

        def rows_by_id(name: str, ids: slice) -> NDArray[Any]:
            # Arrays of a CPU may be replaced meanwhile, by some that have room for more moments.
            found: NDArray[Any] = (self.values(name) if whole is None else whole[name])[row_of[ids]]
            return found

        tables: dict[str, Table] = {}
        for name in self.kept_names:
            one = self.values(name) if whole is None else whole[name]
            tables[name] = RowsByBlock(self.n, functools.partial(rows_by_id, name), one.dtype, one.shape[1:])
        return tables | {"listed": RowsByBlock(self.n, listed, np.dtype(np.int32), (2,))}

    @property
    def kept_names(self) -> list[str]:
        """Names of the arrays of a state that this gas keeps, except the kinds of disks, which follow from ids."""
        return [name for name in self.state_names() if name != "kind"]

    def values(self, name: str) -> NDArray[Any]:
        """Content of an array; on a CPU not to be changed, for it is the array itself."""
        array = getattr(self, name)
        found: NDArray[Any] = to_numpy(array) if self.on_gpu else view(array)
        return found

    def watch(self, chosen: NDArray[np.bool_]) -> None:
        """Set the disks, by id, whose collisions are recorded."""
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
        """Positions and velocities in the frames of rows of tiles (`kernels/disks/shear.py`), and boxes crossed.

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
        if self.uses.shear:
            self.displace_rows(state.time)
        self.domain.load_state(state)

    def places_of(
        self, state: State, known: NDArray[np.integer] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.integer]]:
        """Places from the corner of the tile that each disk is in, velocities, boxes crossed, and tiles, if not `known`."""
        velocity, crossed = state.velocity, np.zeros((state.n, 2))
        if self.uses.shear:
            position, velocity, crossed = self._in_frames(state)
        else:
            position = state.position
            position = self.box.wrap(position)
            for axis, length in enumerate(self.box.lengths):
                along = state.position[:, axis]
                if (
                    self.box.periodic[axis]
                    and not 0.0 <= along.min(initial=0.0) <= along.max(initial=0.0) < length
                ):
                    crossed[:, axis] = np.floor(along / length)
        # First onto the grid: differences are exact then, whatever the tiles.
        position /= self.spacing
        np.round(position, out=position)
        position *= self.spacing
        counts = (int(self.grid.tiles_x), int(self.grid.tiles_y))
        if known is None:
            index = [
                np.clip(np.searchsorted(edge, position[:, axis], side="right") - 1, 0, counts[axis] - 1)
                for axis, edge in enumerate(self.edges)
            ]
            known = index[0] * counts[1] + index[1]
        else:
            index = [*np.divmod(known, counts[1])]
        for axis, edge in enumerate(self.edges):
            position[:, axis] -= edge[index[axis]]
        return position, velocity, crossed, known

    def rows_from(
        self, state: State, first: int, known: NDArray[np.integer] | None = None
    ) -> tuple[dict[str, NDArray[Any]], NDArray[np.integer]]:
        """Rows of the arrays for a state of disks with ids from `first` on, by the arrays' names; and the tile of each.

        The tiles may be `known`.
        """
        local, velocity, crossed, tile = self.places_of(state, known)
        events = state.collisions + state.wall_collisions.astype(np.int64)
        image = state.image + crossed  # of real numbers, which hold all that 32 bits do
        farthest = self.domain.comm.largest(float(np.abs(image).max(initial=0.0)))
        if farthest > MOST_COUNTED:
            raise EngineError(
                f"t = {state.time:.9g}: a disk has come {farthest:.6g} boxes far, more than its counter of 32 bits "
                "can hold: begin a new run from an earlier state, whose counts begin at 0"
            )
        kept: dict[str, Callable[[], NDArray[Any]]] = {
            "disk": lambda: np.column_stack([local, velocity, state.spin]),
            "meta": lambda: np.column_stack(
                [
                    np.arange(first, first + state.n) + self.domain.first_id,
                    events,
                    image,
                ]
            ),
            "past": lambda: np.column_stack([state.latest_collision - state.time, state.angle]),
            "hits": lambda: np.column_stack([state.wall_collisions, state.last_partner]),
            "dissipated": lambda: state.dissipated,
            # Either is to be judged.
            "asleep": lambda: np.where(state.asleep, k.ASLEEP_UNVERIFIED, k.WOKEN),
            "held": lambda: np.full((state.n, TABLES["held"].width), k.NO_PARTNER),
        }
        types = {"real": self.real, "f64": np.float64, "i32": np.int32}
        found: dict[str, NDArray[Any]] = {
            name: kept[name]().astype(types[TYPES[name]], copy=False) for name in self.kept_names
        }
        return found, tile

    def set_lists(self, part: int, count: NDArray[np.int64]) -> None:
        """Set the number of disks in the list of each tile; lists follow one another."""
        with self.written("tile") as (tile,):
            lists = named(tile, "tile")
            lists.count[:, part] = count
            lists.start[:, part] = np.cumsum(count) - count

    def relist(self) -> None:
        """List the disks by the tiles they are in; positions stay, to the last bit."""
        self.domain.relist()

    def take_to_tiles(
        self, held: Mapping[str, NDArray[Any]], listed: NDArray[np.integer]
    ) -> NDArray[np.int64]:
        """Measure rows of the state, by array, from the corners of the tiles that they are in, which are returned.

        `listed` is the tile that lists each.
        """
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
        found: NDArray[np.int64] = index[:, 0] * counts[1] + index[:, 1]
        return found

    def rows_held(self, part: int) -> tuple[dict[str, NDArray[Any]], NDArray[np.intp]]:
        """Rows of the state at a part, by array, list after list; and the tile that lists each."""
        rows, tile = self.rows_of(part)
        return {name: self.domain.state_rows(name, rows) for name in self.state_names()}, tile

    def rows_of(
        self, part: int, tiles: NDArray[np.integer] | None = None
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows of a part in the arrays of the state, list after list, and the tile that lists each; own ones only."""
        tiles = self.own if tiles is None else tiles
        lists = named(self.values("tile"), "tile")
        first, count = lists.start[tiles, part], lists.count[tiles, part]
        return part * self.room + concatenated_ranges(first, count), np.repeat(tiles, count)

    def row_blocks(self, part: int) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """As `rows_of`, of so many tiles at a time that they list about BLOCK disks."""
        count = named(self.values("tile"), "tile").count[self.own, part]
        cuts = np.flatnonzero(np.diff(np.cumsum(count, dtype=np.int64) // BLOCK)) + 1
        for tiles in np.split(self.own, cuts):
            yield self.rows_of(part, tiles)

    def state_names(self) -> list[str]:
        """Names of the arrays of a state that this gas keeps."""
        return [name for name, kept in self.state_arrays().items() if kept]

    def state_arrays(self) -> dict[str, bool]:
        """Names of the arrays that hold a state, and whether this gas keeps them."""
        uses = self.uses
        dated, counted = uses.latest_collision or uses.angle, uses.walls or uses.last_partner
        return {
            "disk": True, "meta": True, "past": dated, "hits": counted, "dissipated": uses.dissipated,
            "asleep": uses.rest, "held": uses.rest, "kind": uses.several_kinds and uses.ranks,
        }  # fmt: skip

    # ------------------------------------------------------------------ kernels

    def launch(self, kernel: Callable[..., Any], *numbers: float, **given: Any) -> None:
        """Run a kernel: its first arguments are `numbers`, the others arrays, `given` or found here by their names."""
        if not self.on_gpu:
            self._call(kernel, numbers, given)
            return
        with self.sent():
            self._call(kernel, numbers, given | self._twins)

    @contextmanager
    def sent(self) -> Iterator[Callable[..., Any]]:
        """Yield a function that launches kernels; the host gets the small arrays after the last one."""
        if not self.on_gpu:
            yield self.launch
            return
        for name in SMALL:
            if name not in self._twins or self._twins[name].shape[0] != len(self._raw(name)):
                if name in self._twins:  # more moments in a window have more sums
                    backend.free_array(self._twins[name])
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

    def _call(self, kernel: Callable[..., Any], numbers: tuple[float, ...], given: dict[str, Any]) -> None:
        if kernel not in self._launchers:
            launcher = Launcher(kernel, len(numbers), given)
            paths = [
                f"{name}.array" if isinstance(getattr(self, name), Named) else name
                for name in launcher.held_names
            ]
            self._launchers[kernel] = launcher, operator.attrgetter(*paths)
        launcher, held_of = self._launchers[kernel]
        launcher(numbers, held_of(self), given)

    def _raw(self, name: str) -> Any:
        """An array as kernels take it."""
        found = getattr(self, name)
        return found.array if isinstance(found, Named) else found

    def set_law(self, law_table: NDArray[np.float64], collision_law: Any) -> None:
        """Set another law for later collisions."""
        if law_table.shape != tuple(self.law.shape):
            self.replace("law", ti.ndarray(self._type, law_table.shape))
        from_numpy(self.law, law_table.astype(self.real))
        self.uses = self.uses.replace(collision_law=collision_law)

    def set_forces(self, forces: tuple[k.CompiledForce, ...]) -> None:
        """Set the forces that act within windows, between two of these; what they have given is 0."""
        self.uses = self.uses.replace(forces=forces)
        self.make("action", int(self.grid.lanes * self.grid.lane_slots) if self.uses.actions else 1)
        if self.blockwise:
            self._make_block_sums()
        self.extra_tally = dataclasses.replace(self.extra_tally, n_forces=len(forces))
        if (columns := self.extra_tally.width) != self.columns:
            self.columns, self.total = columns, np.zeros(0)
            self.sums = np.zeros(columns)
            self._make_sums()

    def set_kicks(self, rows: NDArray[np.float64]) -> None:
        """Set the steps of forces that act within windows, shape (steps, columns of `columns.KICK` and totals)."""
        self._set_numbers("kicks", rows)

    def set_force_values(self, values: NDArray[np.float64]) -> None:
        """Set the parameters of forces that act within windows (`columns.FORCE_VALUES`)."""
        self._set_numbers("force_values", values)

    def _set_numbers(self, name: str, values: NDArray[np.float64]) -> None:
        if name not in vars(self) or tuple(getattr(self, name).shape) != values.shape:
            self.replace(name, self.new_array(ti.f64, *values.shape))
        from_numpy(getattr(self, name), values)

    def set_gravity(
        self, gravity: tuple[float, float], resting_speed: float, rotated_at: float = -math.inf
    ) -> None:
        """Set another gravity, at a window's beginning. Windows are as long as resting disks may fall.

        Sleeping disks are checked again where gravity `rotated_at` [time] that the window begins.
        """
        self.scale.gx, self.scale.gy = gravity
        self.clock.rotated = rotated_at
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
        """Bytes of some device arrays."""
        wide = {"f64": 8, "u64": 8, "i64": 8}
        return sum(
            wide.get(str(array.dtype), 4) * math.prod(array.shape) * math.prod(array.element_shape)
            for array in (getattr(self, name) for name in names)
        )

    def release(self) -> None:
        """Give all device memory back."""
        self._launchers.clear()
        for name, array in self._on_device().items():
            backend.free_array(array)
            setattr(self, name, None)
        for value in self._twins.values():
            backend.free_array(value)
