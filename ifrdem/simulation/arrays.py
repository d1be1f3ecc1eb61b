"""The engine's arrays: what lies on the device, how large it is, and how kernels get it.

`kernels/layout.py` says what each array holds; they have the same names here. This module imports Taichi: import it
only after `backend.start`.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError
from ..kernels.language import ti
from ..kernels.layout import (
    ASIDE,
    BLOCK,
    BOXES_ASIDE,
    CELL_X,
    CONTACT_TIME,
    CUTOFF,
    DRIFT,
    GX,
    HEAD,
    HIGHEST_LEVEL,
    LEVELS,
    LOG_CAPACITY,
    MOST_LEVEL,
    N_LOG,
    ORIGIN_X,
    REACH,
    ROLL_BACK,
    ROW_SPEED,
    SEED_LOW,
    SHEAR,
    SKIN,
    SLOT,
    SPIN,
    STANDS,
    TILE_SIDE,
    TILES_ASIDE,
    TILES_X,
    TILES_Y,
    TIME,
    VX,
    VY,
    WALL_SPEED,
    WALLS,
    WIDEST,
    Uses,
)
from ..kernels.layout import ROW as ROW_LENGTH
from ..kernels.ledger import ALL
from ..kernels.levels import reach_at
from ..kernels.limits import (
    ADDRESSABLE,
    FLIGHT,
    IMAGE,
    KIND,
    LINK,
    LISTS,
    LOG_INT,
    LOG_LOSS,
    LOG_REAL,
    MECHANISMS,
    META,
    REGIMES,
    ROW,
    WALL,
)
from ..kernels.shear import displacement
from ..kernels.totals import TOTALS
from ..kernels.walls import HEAT, TEMPERATURE
from ..model.box import Box
from ..model.ifr import IFRLaw
from ..model.law import compiled
from ..model.state import Disks, State
from . import device


def _kinds(disks: Disks) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """What kinds of disks there are, shape (kinds, 6), columns as in `kernels/layout.py`; and each disk's kind."""
    columns = (1.0 / disks.mass, disks.k, disks.radius, disks.material.astype(np.float64))
    code: NDArray[np.int64] = np.zeros(disks.n, dtype=np.int64)
    for column in columns:
        if disks.n and column.min() != column.max():
            values, index = np.unique(column, return_inverse=True)
            _, code = np.unique(code * len(values) + index, return_inverse=True)
    _, first = (
        np.unique(code, return_index=True)
        if code.any()
        else (None, np.zeros(min(disks.n, 1), dtype=np.int64))
    )
    mass = np.where(np.isfinite(disks.mass[first]), disks.mass[first], 0.0)
    inertia = mass * disks.radius[first] ** 2 / disks.k[first]
    return np.stack([*(column[first] for column in columns), mass, inertia], axis=1), code


class DeviceArrays:
    """All arrays of one engine, under the names that kernels give their arguments.

    Parameters
    ----------
    disks, box, state, law_table
        As for `Engine`.
    skin : float
        Extra listing distance [length].
    tile_disks : int or None
        Disks that a tile should hold; None makes the whole box one tile.
    precision : {"f64", "f32"}
        Type of real numbers.
    walls : array (W, 18), optional
        Rows as `kernels/walls.py` describes them.
    wall_speed : float
        The fastest that a wall moves [length/time].
    gravity : two floats
        Acceleration of all disks [length/time^2].
    velocity_cutoff : float
        Normal speed of approach below which collisions are elastic [length/time].
    contact_time : float
        Time since a partner's latest collision below which collisions are elastic [time].
    seed : int
        Of the random numbers of thermal walls, 0 to 2^64 - 1.
    origin : two floats
        Lower left corner of the user's box in this one [length]; only forces are told places in that.
    collision_law : kernels.layout.Law
        What is compiled in of the law (`law.compiled`); the IFR law without it.
    cells_per_disk : int
        Cells, at most.
    tallied : bool
        Keep a ledger of what dissipates energy (`kernels/ledger.py`).
    partnered : bool
        Keep whom each disk hit last.
    turned : bool
        Keep how far each disk has turned.
    """

    def __init__(
        self,
        disks: Disks,
        box: Box,
        state: State,
        law_table: NDArray[np.float64],
        *,
        skin: float,
        tile_disks: int | None,
        precision: str,
        walls: NDArray[np.float64] | None = None,
        wall_speed: float = 0.0,
        gravity: tuple[float, float] = (0.0, 0.0),
        velocity_cutoff: float = 0.0,
        contact_time: float = 0.0,
        seed: int = 0,
        origin: tuple[float, float] = (0.0, 0.0),
        collision_law: Any = None,
        cells_per_disk: int = 1,
        tallied: bool = False,
        partnered: bool = False,
        turned: bool = False,
    ) -> None:
        n = self.n = disks.n
        self.real = np.float32 if precision == "f32" else np.float64
        self._type = getattr(ti, precision)
        self._arguments: dict[Callable[..., None], list[str]] = {}
        diameter = 2.0 * float(disks.radius.max()) if n else 0.0
        tiles, cells = self._divide(box, diameter + skin, tile_disks, cells_per_disk * max(n, 1))
        total = tiles[0] * tiles[1] * cells[0] * cells[1]
        room = max(n, 1)
        kinds, kind = _kinds(disks)
        self.flight = self._vectors(FLIGHT, self._type, room)
        self.kinds = self._vectors(KIND, self._type, max(len(kinds), 1))
        self.meta = self._vectors(META, ti.i32, room)
        self.image = self._vectors(IMAGE, ti.i32, room)
        self.link = self._vectors(LINK, ti.i32, room)
        self.cell = ti.ndarray(ti.i32, (room,))
        self.order = ti.ndarray(ti.i32, (room,))
        self.lists = ti.ndarray(ti.i32, (LISTS, room))
        self.start = ti.ndarray(ti.i32, (total + 1,))
        self.fill = ti.ndarray(ti.i32, (total,))
        self.block = ti.ndarray(ti.i32, (total // BLOCK + 1,))
        self.squares = ti.ndarray(self._type, (room // BLOCK + 1,))
        self.neighbour = ti.ndarray(ti.i32, (room * ROW,))
        self.law = ti.ndarray(self._type, law_table.shape)
        # Small arrays that the host reads after every launch: kernels take NumPy arrays as they are on a CPU.
        self.counter = np.zeros(17, dtype=np.int32)
        self.limit = np.zeros(5, dtype=self.real)
        n_walls = 0 if walls is None else len(walls)
        self.grid = np.array([n, *tiles, *cells, ROW, 0, 0, 1, n_walls, 0, 0, 0, 0], dtype=np.int32)
        words = np.array([seed & 0xFFFFFFFF, seed >> 32], dtype=np.uint32)
        self.grid[SEED_LOW : SEED_LOW + 2] = words.view(np.int32)
        self.scale = np.zeros(22, dtype=self.real)
        self.clock = np.zeros(7)
        self.total = np.zeros(6, dtype=np.int64)
        tile_sides = [length / count for length, count in zip(box.lengths, tiles, strict=True)]
        cell_sides = [side / count for side, count in zip(tile_sides, cells, strict=True)]
        self.scale[CELL_X : CELL_X + 4] = (*cell_sides, *tile_sides)
        self.scale[SKIN] = skin
        self.scale[REACH] = skin / 2.0
        self.scale[WIDEST] = diameter
        self.scale[GX : GX + 2] = gravity
        self.scale[WALL_SPEED] = wall_speed
        self.scale[CUTOFF] = velocity_cutoff
        self.scale[CONTACT_TIME] = contact_time
        self.scale[ORIGIN_X : ORIGIN_X + 2] = origin
        # Two disks of the highest level must still find each other in tiles side by side, and through one image only.
        room_for = min(*tile_sides, min(box.lengths) / 2.0) - diameter
        sheared = box.shear_rate != 0.0
        if sheared:
            # Tiles above and below lie askew by up to half a tile. Rows of cells that move against each other add up to
            # as much again as the reaches, along x.
            room_for = min(room_for, (min(tile_sides[0], box.lengths[0]) / 2.0 - diameter) / 2.0)
            self.scale[SHEAR] = box.shear_rate
            self.scale[DRIFT] = box.shear_rate * tile_sides[1]
            # From the rounded one: displacements and velocities agree.
            self.clock[ROW_SPEED], self.clock[TILE_SIDE] = self.scale[DRIFT], tile_sides[0]
            self.displace_rows(state.time)
        self.flow_work = ti.ndarray(ti.f64, (room if sheared else 1,))
        self.flow_work.fill(0)
        self.grid[MOST_LEVEL] = min(max(int((room_for / skin - 1.0) * LEVELS), 0), HIGHEST_LEVEL)
        self.walls = self._vectors(WALL, self._type, max(n_walls, 1))
        self._thermal: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        if walls is not None and n_walls:
            self._thermal = np.flatnonzero(walls[:, TEMPERATURE] > 0.0)
            rows = walls.astype(self.real)
            rows[:, HEAT] = -1.0
            rows[self._thermal, HEAT] = np.arange(len(self._thermal))
            self.walls.from_numpy(rows)
        self.uses = Uses(
            walled=n_walls > 0,
            thermal=len(self._thermal) > 0,
            remembers=contact_time > 0.0,
            sheared=sheared,
            tallied=tallied,
            partnered=partnered,
            turned=turned,
            collision_law=collision_law if collision_law is not None else compiled(IFRLaw),
        )
        # What the start told of each disk's past; a run that does not keep it up to date gives it back.
        self.before: dict[str, NDArray[Any]] = {
            "wall_hits": state.wall_hits.astype(np.int32), "latest_collision": state.latest_collision.copy(),
            "last_partner": state.last_partner.astype(np.int32), "angle": state.angle.copy(),
        }  # fmt: skip
        # The host reads these often, too.
        self.losses = np.zeros((2, MECHANISMS))
        self.losses_whole = np.zeros((2, MECHANISMS), dtype=np.int64)
        self.sums = np.zeros((room // BLOCK + 1, TOTALS))
        self.regimes = np.zeros(REGIMES, dtype=np.int64)
        self.last_partner = ti.ndarray(ti.i32, (room if partnered else 1,))
        self.last_partner.fill(0)
        if partnered and n:
            self.last_partner.from_numpy(state.last_partner)
        self.angle = ti.ndarray(ti.f64, (room if turned else 1,))
        self.angle.fill(0)
        if turned and n:
            self.angle.from_numpy(state.angle)
        beside_walls = room if n_walls else 1
        self.near_walls = ti.ndarray(ti.i32, (beside_walls,))
        self.wall_hits = ti.ndarray(ti.i32, (beside_walls,))
        self.wall_work = ti.ndarray(self._type, (beside_walls,))
        self.wall_heat = ti.ndarray(ti.f64, (room, len(self._thermal)) if self.uses.thermal else (1, 1))
        self.latest = ti.ndarray(ti.f64, (n + 1,) if self.uses.remembers else (1,))
        for tally in (self.wall_hits, self.wall_work, self.wall_heat, self.latest):
            tally.fill(0)
        if self.uses.walled and n:
            self.wall_hits.from_numpy(state.wall_hits)
        if self.uses.remembers:
            self.latest.from_numpy(np.append(state.latest_collision, state.time))
        self.log_real: Any = None
        self.log_int: Any = None
        self.log_loss: Any = None
        self.make_log(n // 2 + 1024)
        self._put(box, state, disks, kinds, kind, law_table, tiles, cells)

    @staticmethod
    def _vectors(columns: int, of: Any, rows: int) -> Any:
        return ti.Vector.ndarray(columns, of, rows)

    def _divide(
        self, box: Box, reach: float, tile_disks: int | None, most_cells: int
    ) -> tuple[list[int], list[int]]:
        """Tiles along each side of the box, and cells along each side of a tile."""
        # Wider by a trifle: a disk on the border of two cells may count to either.
        least = reach * (1.0 + 100.0 * float(np.finfo(self.real).eps))
        # In a sheared gas, where columns of cells lie askew is rounded too: a number of some hundreds.
        fewest = [1, 1]
        if box.shear_rate:
            least = reach * (1.0 + 1e4 * float(np.finfo(self.real).eps))
            fewest = [2, 1]  # what lies within reach above or below is at most a tile and a half away
        most = [max(low, int(side / least)) for low, side in zip(fewest, box.lengths, strict=True)]
        # More cells than disks would only cost time: a dilute gas gets larger ones.
        thin = math.sqrt(max(1.0, most[0] * most[1] / most_cells))
        most = [max(low, int(count / thin)) for low, count in zip(fewest, most, strict=True)]
        tiles = [1, 1]
        if tile_disks is not None:
            wanted = math.sqrt(tile_disks * most[0] * most[1] / max(self.n, 1))
            tiles = [
                min(count // low, max(1, round(count / wanted)))
                for low, count in zip(fewest, most, strict=True)
            ]
        return tiles, [count // by for count, by in zip(most, tiles, strict=True)]

    def _put(
        self,
        box: Box,
        state: State,
        disks: Disks,
        kinds: NDArray[np.float64],
        kind: NDArray[np.int64],
        law_table: NDArray[np.float64],
        tiles: list[int],
        cells: list[int],
    ) -> None:
        n, room = self.n, max(self.n, 1)
        tile_sides = np.array(box.lengths) / tiles
        position, velocity, crossed = (
            self._in_frames(box, state, tiles[1])
            if self.uses.sheared
            else (box.wrap(state.position), state.velocity, np.floor(state.position / box.lengths))
        )
        tile = np.minimum((position / tile_sides).astype(np.int64), np.array(tiles) - 1)
        local = position - tile * tile_sides
        index = np.clip((local / (tile_sides / cells)).astype(np.int64), 0, np.array(cells) - 1)
        flight = np.zeros((room, FLIGHT), dtype=self.real)
        flight[:n, 0:2] = local
        flight[:n, 2:4] = velocity
        flight[:n, 5] = state.spin
        flight[:n, 6] = disks.radius
        meta = np.zeros((room, META), dtype=np.int32)
        meta[:n, 0] = np.arange(n)
        meta[:n, 1] = kind
        meta[:n, 2] = state.collisions + state.wall_hits
        image = np.zeros((room, IMAGE), dtype=np.int32)
        image[:n] = state.image + crossed.astype(np.int32)
        cell = np.zeros(room, dtype=np.int32)
        cell[:n] = ((tile[:, 0] * tiles[1] + tile[:, 1]) * cells[0] + index[:, 0]) * cells[1] + index[:, 1]
        self.flight.from_numpy(flight)
        if n:
            self.kinds.from_numpy(kinds.astype(self.real))
        self.image.from_numpy(image)
        self.meta.from_numpy(meta)
        self.cell.from_numpy(cell)
        self.law.from_numpy(law_table.astype(self.real))
        link = np.zeros((room, LINK), dtype=np.int32)
        link[:, HEAD] = -1  # nothing is logged yet
        self.link.from_numpy(link)

    def displace_rows(self, time: float) -> None:
        """Note how far rows of tiles in a sheared gas have moved against those below until `time` [time]."""
        boxes, tiles, rest = displacement(
            float(self.clock[ROW_SPEED]), time, float(self.clock[TILE_SIDE]), float(self.grid[TILES_X])
        )
        self.grid[BOXES_ASIDE], self.grid[TILES_ASIDE], self.scale[ASIDE] = boxes, tiles, rest

    def _in_frames(
        self, box: Box, state: State, rows: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Positions and velocities in the frames of rows of tiles (`kernels/shear.py`), and boxes crossed.

        All positions lie in the box, along x as the frame lay upon it at time 0.
        """
        speed = float(self.clock[ROW_SPEED])
        lengths = np.array(box.lengths)
        crossed = np.floor(state.position / lengths)
        position, velocity = state.position.copy(), state.velocity.copy()
        position[:, 1] = box.wrap(state.position, state.time)[:, 1]
        row = np.minimum((position[:, 1] / (lengths[1] / rows)).astype(np.int64), rows - 1)
        # The box above is one of `rows` rows further.
        frame = speed * (row + crossed[:, 1] * rows - 0.5 * (rows - 1))
        velocity[:, 0] -= frame
        position[:, 0] -= frame * state.time
        crossed[:, 0] = np.floor(position[:, 0] / lengths[0])
        position[:, 0] -= crossed[:, 0] * lengths[0]
        position[:, 0] = np.where(position[:, 0] < lengths[0], position[:, 0], 0.0)
        return position, velocity, crossed

    def launch(self, kernel: Callable[..., None], *numbers: float, **given: NDArray[Any]) -> None:
        """Run a kernel: its first arguments are `numbers`, the others arrays, `given` or found here by their names."""
        if kernel not in self._arguments:
            self._arguments[kernel] = list(inspect.signature(kernel).parameters)
        names = self._arguments[kernel][len(numbers) :]
        kernel(*numbers, *(given[name] if name in given else getattr(self, name) for name in names))

    def lengthen_rows(self, needed: int) -> None:
        """Make room for `needed` neighbours of a disk; the lists at hand are lost.

        Raises
        ------
        EngineError
            If 32-bit indices cannot reach so many.
        """
        row = min(needed + needed // 4, ADDRESSABLE // self.n)
        if row < needed:
            raise EngineError(
                f"a disk has {needed} neighbours: for {self.n} disks, 32-bit indices allow {row}; "
                "use a smaller skin"
            )
        self.make_rows(row)

    def make_rows(self, row: int) -> None:
        """Make room for so many neighbours of each disk; the lists at hand are lost."""
        self.grid[ROW_LENGTH] = row
        device.free_array(self.neighbour)
        self.neighbour = ti.ndarray(ti.i32, (max(self.n, 1) * row,))

    @property
    def records(self) -> int:
        """Collisions that the log has room for."""
        return int(self.grid[LOG_CAPACITY])

    @property
    def most_records(self) -> int:
        """Collisions that 32-bit indices allow the log to have room for."""
        return ADDRESSABLE // LOG_REAL

    def make_log(self, records: int) -> None:
        """Make room for so many collisions an epoch; the epoch at hand loses its log. Half the disks at least."""
        for old in (self.log_real, self.log_int, self.log_loss):
            if old is not None:
                device.free_array(old)
        # Sorting needs half the disks; every tile takes records by the chunk.
        tiles = int(self.grid[TILES_X] * self.grid[TILES_Y])
        records = max(records, (self.n + 1) // 2, 64 * (tiles + 1))
        self.grid[LOG_CAPACITY] = records
        self.log_real = self._vectors(LOG_REAL, self._type, records)
        self.log_int = self._vectors(LOG_INT, ti.i32, records)
        self.log_loss = self._vectors(LOG_LOSS, ti.f64, records if self.uses.tallied else 1)

    def standing_records(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Times, shape (c,), and slots, shape (c, 2), of the collisions of two disks that stand, in any order."""
        written = int(self.counter[N_LOG])
        log_int = self.log_int.to_numpy()[:written]
        stands = (log_int[:, STANDS] == 1) & (log_int[:, SLOT + 1] >= 0)
        return self.log_real.to_numpy()[:written][stands, TIME], log_int[stands, SLOT : SLOT + 2]

    def history(self) -> dict[str, NDArray[Any]]:
        """Each disk's past, by the names that `State` has: wall_hits, latest_collision, last_partner, angle; each (n,).

        Up to the latest settling; as they were at the start where there are no walls, no contact time, or nobody asked.
        """
        found = {name: value.copy() for name, value in self.before.items()}
        for name, array, kept in (
            ("wall_hits", self.wall_hits, self.uses.walled),
            ("latest_collision", self.latest, self.uses.remembers),
            ("last_partner", self.last_partner, self.uses.partnered),
            ("angle", self.angle, self.uses.turned),
        ):
            if kept:
                found[name] = array.to_numpy()[: self.n]
        return found

    def dissipated(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Energy that collisions took by mechanism, and their number by regime, up to the latest settling.

        Raises
        ------
        EngineError
            If a collision took no number (NaN), or an infinite one: the law gives or takes energy without bounds.
        """
        if not np.isfinite(self.losses[ALL]).all():
            raise EngineError(
                "a collision took an energy beyond all bounds, or no number: the law does not hold on to energy; with "
                "output.ledger = false (ledger=False) nobody counts"
            )
        return self.losses[ALL].copy(), self.regimes.copy()

    def work_of_walls(self) -> float:
        """Energy that moving walls gave [energy], up to the latest settling."""
        return float(self.wall_work.to_numpy().astype(np.float64).sum()) if self.uses.walled else 0.0

    def heat_of_walls(self) -> NDArray[np.float64]:
        """Heat that each wall gave [energy], shape (walls,), up to the latest settling; 0 where it is not thermal."""
        heat = np.zeros(int(self.grid[WALLS]))
        if self.uses.thermal:
            # Disk by disk along each column: one order for any number of threads.
            heat[self._thermal] = np.ascontiguousarray(self.wall_heat.to_numpy().T).sum(axis=1)
        return heat

    def ids(self) -> NDArray[np.int32]:
        """Id of the disk at each slot, shape (N,)."""
        ids: NDArray[np.int32] = self.meta.to_numpy()[:, 0]
        return ids

    @property
    def furthest(self) -> float:
        """How far a disk may move in an epoch at most [length]."""
        return float(reach_at(float(self.scale[REACH]), self.most_level))

    def at_rest(self) -> bool:
        """Whether no disk moves or spins, as the latest epoch left them."""
        return not self.flight.to_numpy()[: self.n, [VX, VY, SPIN]].any()

    def zeros(self, columns: int, *, real: bool) -> NDArray[Any]:
        """A host array with a row for each disk, one at least, for kernels to write into."""
        return np.zeros((max(self.n, 1), columns), dtype=self.real if real else np.int32)

    def set_law(self, law_table: NDArray[np.float64], collision_law: Any) -> None:
        """Collide by another law from here on."""
        if law_table.shape != tuple(self.law.shape):
            device.free_array(self.law)
            self.law = ti.ndarray(self._type, law_table.shape)
        self.law.from_numpy(law_table.astype(self.real))
        self.uses = self.uses._replace(collision_law=collision_law)

    def set_gravity(self, gravity: tuple[float, float]) -> None:
        """Let disks fall otherwise from here on; all must have settled."""
        self.scale[GX : GX + 2] = gravity

    def set_velocities(
        self, flow: NDArray[np.float64], velocity: NDArray[np.float64], spin: NDArray[np.float64]
    ) -> None:
        """Give disks other velocities, relative to the `flow` of their rows [length/time], and spins; all have settled.

        Arrays (n, 2), (n, 2) and (n,), by id.
        """
        flight, ids = self.flight.to_numpy(), self.ids()[: self.n]
        flight[: self.n, VX : VY + 1] = (velocity - flow)[ids]
        flight[: self.n, SPIN] = spin[ids]
        self.flight.from_numpy(flight)

    def velocities(self) -> NDArray[np.float64]:
        """Velocities in the frames of rows of tiles [length/time], shape (n, 2), by id; all must have settled."""
        found = np.empty((self.n, 2))
        found[self.ids()[: self.n]] = self.flight.to_numpy()[: self.n, VX : VY + 1]
        return found

    def switch_off_rollback(self) -> None:
        """Let collisions that came too early stand."""
        self.grid[ROLL_BACK] = 0

    def switch_ledger(self, on: bool) -> None:
        """Tally from here on or not; all must have settled."""
        self.counter[N_LOG] = 0  # without a ledger nobody strikes out what has settled
        self.uses = self.uses._replace(tallied=on)

    @property
    def most_level(self) -> int:
        """Highest level that the box allows a fast disk (`kernels/extend.py`)."""
        return int(self.grid[MOST_LEVEL])

    def _on_device(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if isinstance(value, ti.Ndarray)}

    @property
    def bytes_allocated(self) -> int:
        """Bytes of all device arrays."""
        return sum(
            (8 if str(array.dtype) == "f64" else 4) * math.prod(array.shape) * math.prod(array.element_shape)
            for array in self._on_device().values()
        )

    def release(self) -> None:
        """Give all device memory back."""
        for name, array in self._on_device().items():
            device.free_array(array)
            setattr(self, name, None)
