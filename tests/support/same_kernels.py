"""Gate for changes that must leave the compiled program as it is: bits of small gases, and kernels compiled for them.

    TI_OFFLINE_CACHE_FILE_PATH=FOLDER python tests/support/same_kernels.py [OPTIONS] [GAS ...]

OPTIONS: [--device NAME] [--ranks] [--against COMMIT]

(QD_OFFLINE_CACHE_FILE_PATH with IFRDEM_RUNTIME=quadrants.)

Run it once before a change, with an empty folder, and after each step of the change with the same folder. It prints the
SHA-256 of the state and the sums of each gas, and how many kernels were compiled for it: files that the cache gained.
A step leaves the program as it is if all hashes are equal and nothing was compiled. Together the gases use every kernel
and every feature (`kernels/layout.py`, `Uses`). `--ranks` adds gases on two ranks of MPI (`ranks/gases.py`): fill the
folder by two runs, for of ranks that end at the same time only one writes its kernels.

`--against COMMIT` runs the gases at that commit too, prints `same` or `other` beside each hash, and ends with status 1
if one differs: for a change that compiles kernels anew and keeps their bits, and to see whether it was right before.

NumPy computes some functions with other last digits where a processor has AVX-512: it does without here, so that hashes
are those of all x86-64 processors with AVX2.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
# Names of NumPy from 2.4 on, and before; it says once of those that it does not know that it ignores them.
os.environ.setdefault("NPY_DISABLE_CPU_FEATURES", "X86_V4 AVX512_SKX AVX512_ICL AVX512_SPR")

import numpy as np
from support import gases, mpi
from support.gases import COIN, ROLLING, equal_disks, mixture, start

import ifrdem
from ifrdem import ContactTime, Device, Rest
from ifrdem.kernels.compiler import runtime
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, Langevin, PoissonKicks, RandomKicks, Rescale, TableFriction
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Piston, Turn
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation import backend
from ifrdem.simulation.checkpoints import snapshot
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.measuring.tracking import Tracking
from ifrdem.simulation.windows import tiling
from ifrdem.theory.driven_gas import Driving
from ifrdem.validation.rows import engine_of
from ifrdem.validation.speed.gate import checked_out

os.environ[runtime.variable("OFFLINE_CACHE_CLEANING_POLICY")] = "never"
CACHE = Path(os.environ[runtime.variable("OFFLINE_CACHE_FILE_PATH")])
N = 700
tiling.SINGLE_TILE = 100  # windows as short as those of gases in tiles
ALL_SUMS: dict[str, Any] = {"record": ["dissipated", "last_partner", "angle"]}
SINGLE = {"device": Device(threads=1, precision="f32")}
RANK_GASES = ("2:walls", "2:fast sizes", "2:driven", "2:shear")


def lattice(n: int, box: Box, spacing: float, low: tuple[float, float], speed: float = 1.0) -> State:
    """Disks on a square lattice from a corner on, with Gaussian velocities and spins."""
    rng, columns = np.random.default_rng(5), int((box.lengths[0] - 2.0 * low[0]) / spacing) + 1
    place = np.stack([np.arange(n) % columns, np.arange(n) // columns], axis=1) * spacing + low
    return State(place, speed * rng.normal(size=(n, 2)), speed * rng.normal(size=n))


def anywhere(disks: Disks, box: Box, walls: list[Wall]) -> State:
    """Disks all over a box with walls, with Gaussian velocities and spins."""
    rng = np.random.default_rng(5)
    position = ifrdem.initial.random_positions(box, disks.radius, seed=5, walls=walls)
    return State(position, rng.normal(size=(disks.n, 2)), rng.normal(size=disks.n))


def periodic(disks: Disks, packing_fraction: float, row: Any, **options: Any) -> Engine:
    box, state = start(disks, packing_fraction)
    return engine_of(disks, box, state, np.array([[row]]), **options)


def two_sizes(**options: Any) -> Engine:
    """Few large disks, above many small ones: cells have two layers."""
    n, box = 504, Box((30.0, 30.0))
    large = np.arange(n) >= 500
    disks = Disks(n, mass=np.where(large, 9.0, 1.0), radius=np.where(large, 1.5, 0.4))
    state = lattice(n, box, 1.0, (1.0, 1.0))
    state.position[large] = [[4.0, 23.0], [9.0, 23.0], [14.0, 23.0], [19.0, 23.0]]
    return engine_of(disks, box, state, np.array([[COIN]]), **options)


def with_tracking(disks: Disks, box: Box, state: State, walls: list[Wall], **options: Any) -> Engine:
    law = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    columns = disks.mass, disks.radius, disks.k, disks.material

    def disks_of(ids: Any) -> Disks:
        return Disks(len(ids), *(each[ids] for each in columns))

    tracking = Tracking(np.arange(0, disks.n, 5, dtype=np.int32), disks.n, disks_of, [[law]], walls)
    return engine_of(
        disks, box, state, np.array([[law.table_row()]]), walls=walls, tracking=tracking, **options
    )


def walled(**options: Any) -> Engine:
    """Walls of all shapes and motions but pistons."""
    box, shaken = Box((40.0, 60.0), (True, False)), Motion("sine", amplitude=0.3, frequency=0.7)
    gate = Wall.segment((2.0, 52.0), (12.0, 52.0), opens_at=0.3)
    walls = [
        Wall.line((0.0, 0.4), (0.0, 1.0), motion=shaken),
        Wall.line((0.0, 59.0), (0.0, -1.0), temperature=2.0),
        Wall.post((30.0, 50.0), 1.5, motion=Motion("sawtooth", amplitude=0.3, frequency=0.5, rise=0.3)),
        Wall.segment((24.0, 44.0), (28.0, 46.0), surface_speed=0.5, motion=Motion("steady", speed=0.1)),
        Wall.segment((10.0, 46.0), (14.0, 48.0), turn=Turn("steady", center=(12.0, 47.0), rate=0.6)),
        Wall.arc((20.0, 50.0), 4.0, (0.3, 2.0), turn=Turn("sine", (20.0, 50.0), amplitude=0.3, frequency=0.2)),
        gate,
        Wall.polyline([(32.0, 43.0), (34.0, 44.0), (36.0, 43.0)], moves_from=0.1, moves_until=1.0,
                      motion=Motion("steady", speed=0.2, direction=(0.0, 1.0))),
    ]  # fmt: skip
    options = {
        "gravity": (0.0, -0.3), "seed": 4, "collapse": ContactTime(1e-4), "record": [*ALL_SUMS["record"], "wall_sums"],
    } | options  # fmt: skip
    disks = mixture(N)
    return with_tracking(disks, box, anywhere(disks, box, walls), walls, **options)


def contained(**options: Any) -> Engine:
    box = Box((40.0, 40.0), (False, False))
    walls = [Wall.container((20.0, 20.0), 18.0), Wall.segment((8.0, 20.0), (12.0, 20.0))]
    disks = equal_disks(130)
    state = anywhere(disks, box, walls)
    return engine_of(disks, box, state, np.array([[COIN]]), walls=walls, gravity=(0.0, -0.1), **options)


def pistons(**options: Any) -> Engine:
    box = Box((20.0, 40.0), (True, False))
    walls = [
        Wall.line((0.0, 0.2), (0.0, 1.0), piston=Piston(30.0, spring=300.0, low=-0.1, high=0.1)),
        Wall.line((0.0, 26.0), (0.0, -1.0), piston=Piston(40.0, force=20.0)),
    ]
    state = lattice(250, box, 1.2, (0.8, 1.0))
    options = {"gravity": (0.0, -0.2), "record": ["ledger", "wall_sums"], "order": "serial"} | options
    return engine_of(equal_disks(250), box, state, np.array([[COIN]]), walls=walls, **options)


def resting(**options: Any) -> Engine:
    """A bed that falls asleep on a floor, with an arc and a segment in it."""
    box = Box((18.0, 30.0), (False, False))
    walls = [
        Wall.line((0.0, 0.5), (0.0, 1.0)),
        Wall.segment((4.0, 2.0), (8.0, 3.0)),
        Wall.arc((13.0, 4.0), 3.0, (3.3, 6.0)),
        Wall.segment((6.0, 24.0), (8.0, 24.0), turn=Turn("steady", center=(7.0, 24.0), rate=0.3)),
    ]
    state = lattice(60, box, 1.1, (1.2, 6.0), speed=0.3)
    law = (0.4, -0.5, 0.4, 0.0, 0.02)
    options = {"gravity": (0.0, -10.0), "collapse": Rest(0.1)} | ALL_SUMS | options
    return engine_of(mixture(60), box, state, np.array([[law]]), walls=walls, **options)


def resting_bed(**options: Any) -> Engine:
    """A bed of equal disks in a box that is periodic along x, without sums."""
    box = Box((15.0, 20.0), (True, False))
    state = lattice(60, box, 1.1, (0.6, 0.7), speed=0.2)
    options = {"gravity": (0.0, -10.0), "collapse": Rest(0.1)} | options
    return engine_of(equal_disks(60), box, state, np.array([[(0.4, -0.5, 0.4, 0.0, 0.0)]]), **options)


def sheared(**options: Any) -> Engine:
    disks = mixture(N)
    box, state = gases.sheared(disks, 0.3, rate=0.4)
    options = {"forces": [Rescale(0.1, energy=1.2), Drag(0.1, rate=0.2)], **ALL_SUMS} | options
    return engine_of(disks, box, state, np.array([[ROLLING]]), **options)


def driven(**options: Any) -> Engine:
    forces = [RandomKicks(0.05, power=1.0), Langevin(0.08, temperature=1.0, rate=0.3), Rescale(0.13, energy=1.5),
              TableFriction(0.05, mu=0.02, gravity=10.0), PoissonKicks(2.0, power=0.5)]  # fmt: skip
    return periodic(mixture(N), 0.3, ROLLING, forces=forces, seed=2, **options)


def of_own_law(**options: Any) -> Engine:
    from support.law_examples import Viscoelastic

    return periodic(equal_disks(N), 0.4, (0.1, -0.6, 0.2), law=Viscoelastic, record=["ledger"], **options)


GASES: dict[str, Callable[..., Engine]] = {
    "plain": lambda **o: periodic(equal_disks(N), 0.3, COIN, order="serial", **o),
    "plain, tiles": lambda **o: periodic(equal_disks(N), 0.5, COIN, order="tiled", tile_disks=60, **o),
    "mixture": lambda **o: periodic(
        dataclasses.replace(mixture(N), species={"first": 300, "rest": N - 300}),
        0.4,
        ROLLING,
        order="tiled",
        tile_disks=60,
        record=[*ALL_SUMS["record"], "heat_flux"],
        **o,
    ),
    "two sizes": two_sizes,
    "walls": lambda **o: walled(order="serial", **o),
    "walls, tiles": lambda **o: walled(order="tiled", tile_disks=100, **o),
    "container": contained,
    "pistons": pistons,
    "resting": resting,
    "resting bed": resting_bed,
    "shear": sheared,
    "driven": driven,
    "own law": of_own_law,
    "f32": lambda **o: periodic(mixture(N), 0.4, COIN, order="tiled", tile_disks=60, **o | SINGLE),
    "walls, f32": lambda **o: walled(order="serial", **o | SINGLE),
}
ON_GPU = ("plain, tiles", "mixture", "walls, tiles", "shear", "two sizes")


def digest(parts: dict[str, Any]) -> str:
    """Hash of arrays and numbers, by name."""
    found = hashlib.sha256()
    for name in sorted(parts):
        value = np.ascontiguousarray(parts[name])
        found.update(
            name.encode() + (repr(parts[name]).encode() if value.dtype.hasobject else value.tobytes())
        )
    return found.hexdigest()


def numbers_of(engine: Engine) -> dict[str, Any]:
    """All numbers of an engine."""
    state = engine.state()
    found = {each.name: np.asarray(getattr(state, each.name)) for each in dataclasses.fields(state)}
    found |= {f"statistics {name}": value for name, value in vars(engine.statistics).items()}
    if engine.kinds.species:
        found["species"] = engine.species_totals()
    found |= {
        "totals": engine.totals(),
        "sums": engine.windows.sums,
        "work": engine.force_steps.energy_inputs,
    }
    return found


def after(make: Callable[..., Engine], **options: Any) -> str:
    """Hash of a gas that was run to times, to numbers of collisions within a window, and from a snapshot."""
    options = {"device": Device(threads=1)} | options
    engine, end = make(**options), 0.0
    for _ in range(4):
        end += 0.11
        while engine.time < end:
            engine.advance(t_end=end)
    for _ in range(3):
        count = engine.collisions + N // 3
        while engine.collisions < count and engine.time < end + 0.5:
            engine.advance(collisions=count, t_end=end + 0.5)
        found = numbers_of(engine)
    if engine.tracking is not None:
        events = engine.tracking.take().columns()
        assert len(events["time"]) > 100
        found |= {f"event {name}": value for name, value in events.items()}
    else:
        engine.keep_collisions = True
        engine.advance(t_end=engine.time + 0.2)
        assert engine.last_collisions is not None
        found |= {"times": engine.last_collisions.time, "pairs": engine.last_collisions.pair}
    _, sums = engine.observed(stored=np.dtype([("image", np.int32, (2,))]))
    found["sums to be written"] = sums
    found |= {f"kept {name}": value for name, value in snapshot.take(engine).items()}
    engine.release()
    return digest(found)


def dsmc(device: str, threads: int) -> str:
    """Hash of a homogeneous gas without places."""
    disks = Disks(400, mass=1.0, radius=0.5)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    driving = Driving(0.5, 0.1, 0.2)
    law = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    gas = ifrdem.DSMC(
        disks, law, 0.2, velocity, driving=driving, seed=1, device=Device(device, threads=threads)
    )
    found = gas.run(collisions_per_disk=5, samples=5)
    return digest({"T": found.temperature, "velocity": gas.velocity, "spin": gas.spin})


def compiled() -> int:
    """Kernels in the cache."""
    return len([*CACHE.rglob("*.tic"), *CACHE.rglob("*.qdc")])


def at_commit(commit: str, device: str, names: list[str]) -> dict[str, str]:
    """Hashes of gases by name at a commit of this repository, by its own copy of this file."""
    with checked_out(commit) as folder:
        script = folder / "tests" / "support" / "same_kernels.py"
        done = subprocess.run(
            [sys.executable, str(script), "--device", device, *names],
            env=os.environ | {"PYTHONPATH": str(folder)}, cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode:
        sys.exit(f"{commit}: {done.stderr}")
    lines = [line.split(maxsplit=3) for line in done.stdout.splitlines()]
    return {line[3]: line[0] for line in lines if len(line) == 4 and line[2] == "compiled"}


def main() -> None:
    """Print a line for each gas."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--ranks", action="store_true")
    parser.add_argument("--against", metavar="COMMIT")
    parser.add_argument("gases", nargs="*")
    given = parser.parse_args()
    known = {} if given.against is None else at_commit(given.against, given.device, given.gases)
    CACHE.mkdir(parents=True, exist_ok=True)
    runs: dict[str, Callable[[], str]] = {
        name: lambda make=make: after(make, device=given.device)
        for name, make in GASES.items()
        if given.device == "cpu" or name in ON_GPU
    }
    for threads in (1, 2) if given.device == "cpu" else (1,):
        runs[f"dsmc, {threads} threads"] = lambda threads=threads: dsmc(given.device, threads)
    at_start = compiled()
    before, different = at_start, 0
    for name, run in runs.items():
        if not given.gases or name in given.gases:
            found = run()
            backend.stop()  # kernels are written when the runtime ends
            compared = f"  {'same' if known.get(name) == found else 'other'}" if known else ""
            print(f"{found}{compared}  {compiled() - before:3d} compiled  {name}", flush=True)
            different += bool(known) and known.get(name) != found
            before = compiled()
    if given.ranks:
        script = Path(__file__).parent / "ranks" / "gases.py"
        printed = mpi.on(2, sys.executable, script, *RANK_GASES, timeout=600.0)
        for line in printed.stdout.splitlines() or [printed.stderr]:
            print(f"{hashlib.sha256(line.encode()).hexdigest()}  {line}", flush=True)
        print(f"{compiled() - before} compiled on ranks", flush=True)
    print(f"{compiled() - at_start} kernels compiled in all", flush=True)
    if different:
        sys.exit(f"{different} of {len(runs)} gases have other bits than at {given.against}")


if __name__ == "__main__":
    main()
