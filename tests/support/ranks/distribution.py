"""`mpiexec -n P python distribution.py`: results of `mpi/distribution.py` on P ranks, as JSON."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from mpi4py import MPI

import ifrdem
from ifrdem import initial
from ifrdem.errors import EngineError
from ifrdem.mpi import SERIAL, Communicator, distribution
from ifrdem.simulation.start.overlaps import check_no_overlap

WORLD = MPI.COMM_WORLD
COMM = Communicator(WORLD)
distribution.BLOCK = 8  # so that blocks lie on several ranks


def rows_of(n: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(3)
    return rng.normal(size=(n, 3)), rng.integers(0, 9, n).astype(np.int32)


def anywhere(n: int) -> Any:
    """Ids that this rank has, in no order: on P ranks the same disks for any P, on others."""
    rng = np.random.default_rng(7)
    owner, order = rng.integers(0, COMM.size, n), rng.permutation(n)
    return order[owner[order] == COMM.rank]


def outcome(ids: Any, n: int) -> str:
    try:
        COMM.by_id(n, ids, [])
    except EngineError as error:
        return str(error)
    return ""


found: dict[str, Any] = {}
for n in (0, 1, 5, 100, 257):
    real, whole = rows_of(n)
    ids, own = anywhere(n), COMM.slice_of(n)
    mine = [real[own.start : own.stop], whole[own.start : own.stop]]
    right = {
        "by_id": COMM.by_id(n, ids, [real[ids], whole[ids]]),
        "scatter": COMM.scatter_rows(n, [real, whole] if COMM.is_root else None),
    }
    for name, got in right.items():
        same = all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in zip(got, mine, strict=True))
        found[f"{name} {n}"] = bool(WORLD.allreduce(int(same), MPI.MIN))
    whole_again = COMM.gather_rows(n, mine)
    if whole_again is not None:
        found[f"gather {n}"] = all(map(np.array_equal, whole_again, (real, whole)))
    total = COMM.total(mine[0])
    found[f"total {n}"] = bool(WORLD.allreduce(int(np.array_equal(total, SERIAL.total(real))), MPI.MIN))
    found[f"digest {n}"] = COMM.digest(mine[1]) == SERIAL.digest(whole)
    numbers, every = list(range(1, n + 2)), np.abs(np.round(real[:, 0], 1))  # some values several times
    nth = COMM.nth_smallest(np.sort(every[own.start : own.stop]), numbers)
    right_nth = nth == [*np.sort(every).tolist(), float("inf")]
    found[f"n-th smallest {n}"] = bool(WORLD.allreduce(int(right_nth), MPI.MIN))
thin = np.broadcast_to(np.float64(0.5), (50, 7))
scattered = COMM.scatter_rows(50, [thin] if COMM.is_root else None)
again = COMM.gather_rows(50, scattered)
found["thin"] = scattered[0].strides[0] == 0 and (
    again is None or (again[0].strides[0] == 0 and len(again[0]) == 50)
)
BOX = ifrdem.Box((100.0, 70.0))
RADII = (
    lambda n: initial.radii.uniform(n, low=1.0, high=2.0, seed=5),
    lambda n: initial.radii.gaussian(n, mean=1.0, deviation=0.2, seed=5),
    lambda n: initial.radii.lognormal(n, mean=1.0, deviation=0.2, seed=5),
    lambda n: initial.radii.bidisperse(n, low=1.0, high=2.0, large_fraction=0.3, seed=5),
)
for n in (3, 100, 257):  # the same start for any number of ranks, of one block and of many
    mass = np.where(np.arange(n) % 3 == 0, 2.0, 1.0)
    radius = 0.4 * mass
    ids = ifrdem.slice_of(n, COMM)
    here = slice(ids.start, ids.stop)
    starts = []
    for own, comm in ((here, COMM), (slice(None), SERIAL)):
        with comm:
            starts.append(
                (
                    initial.hexagonal_positions(BOX, radius[own], seed=5),
                    initial.hexagonal_positions(BOX, radius[own]),
                    initial.maxwellian(mass[own], temperature=2.0, seed=5),
                    initial.gaussian_spins(len(mass[own]), spin_rms=3.0, seed=5),
                    initial.maxwellian(mass[own], temperature=mass[own] - 1.0, seed=5),
                    initial.gaussian_spins(len(mass[own]), spin_rms=mass[own] - 1.0, seed=5),
                    np.array(ifrdem.Box.from_packing_fraction(radius[own], 0.3).lengths),
                    *(draw(len(mass[own])) for draw in RADII),
                )
            )
    same = [np.array_equal(a, b[here] if len(b) == n else b) for a, b in zip(*starts, strict=True)]
    found[f"start {n}"] = bool(WORLD.allreduce(int(all(same)), MPI.MIN))
WALLED = ifrdem.Box((100.0, 70.0), periodic=(True, False))
POSTS = [ifrdem.Wall.post((30.0, 20.0), 12.0), ifrdem.Wall.container((50.0, 35.0), 48.0)]
for n in (3, 900):
    radius = 0.6 * np.random.default_rng(n).uniform(0.6, 1.0, n)
    ids = ifrdem.slice_of(n, COMM)
    here = slice(ids.start, ids.stop)
    starts = []
    for own, comm in ((here, COMM), (slice(None), SERIAL)):
        with comm:
            starts.append(
                (
                    initial.random_positions(BOX, radius[own], seed=5),
                    initial.random_positions(BOX, np.full(n, 0.9)[own], seed=5),
                    initial.random_positions(WALLED, radius[own], seed=5, walls=POSTS),
                    initial.hexagonal_positions(WALLED, radius[own], seed=5, walls=POSTS),
                    initial.hexagonal_positions(WALLED, radius[own], walls=POSTS[:1]),
                )
            )
    for a, b, name in zip(*starts, ("mixture", "random", "random in walls", "dealt", "sites"), strict=True):
        found[f"{name} {n}"] = bool(WORLD.allreduce(int(np.array_equal(a, b[here])), MPI.MIN))


def refused(comm: Communicator, n: int, diameter: float) -> str:
    try:
        with comm:
            initial.hexagonal_positions(WALLED, [diameter / 2] * n, walls=POSTS)
    except ifrdem.InputError as error:
        return str(error)
    return ""


message = refused(SERIAL, 1000, 3.0)
own_part = len(ifrdem.slice_of(1000, COMM))
found["refused"] = (
    message.startswith("1000 disks of diameter 3 do not fit") and refused(COMM, own_part, 3.0) == message
)
HIGH = ifrdem.Box((10.0, 20.0))
FAR = np.stack(np.meshgrid([1.0, 4.0], np.arange(6) * 3.0 + 0.5), axis=-1).reshape(-1, 2)


def pair_is_found(y: float, distance: float) -> bool:
    """Disk 13 above disk 0, across the upper side of the box too, among twelve others."""
    position = np.concatenate([[[8.0, y]], FAR, [[8.0, (y + distance) % 20.0]]])
    ids = ifrdem.slice_of(14, COMM)
    try:
        with COMM:
            check_no_overlap(HIGH, np.full(len(ids), 0.5), position[ids.start : ids.stop])
    except ifrdem.InputError as error:
        return str(error).startswith("disks 0 and 13 overlap by 0.1")
    return False


heights = np.linspace(0.0, 20.0, 41)
found["overlaps"] = all(pair_is_found(y, 0.9) for y in heights)
found["no overlaps"] = not any(pair_is_found(y, 1.01) for y in heights)
fourteen = ifrdem.slice_of(14, COMM)
wide = np.where(np.arange(14) == 13, 5.5, 0.5)[fourteen.start : fourteen.stop]
try:
    with COMM:
        check_no_overlap(HIGH, wide, np.ones((len(wide), 2)))
except ifrdem.InputError as error:
    found["wide"] = str(error).startswith("disk 13 has diameter 11, more than the periodic side 10")
lost, twice = anywhere(50), anywhere(50)
if len(lost):
    lost = lost[:-1]
    twice = np.concatenate([twice[:1], twice[:1], twice[2:]]) if len(twice) > 2 else twice[:0]
found["lost"], found["twice"] = outcome(lost, 50), outcome(twice, 50)
messages = WORLD.gather((found["lost"], found["twice"]))
if COMM.is_root:
    found["alike"] = len(set(messages)) == 1
    print(json.dumps(found))
