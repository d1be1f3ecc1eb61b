"""A run that goes on from a checkpoint is bitwise the run that was never interrupted."""

from __future__ import annotations

import os
from collections.abc import Callable

import h5py
import numpy as np
import pytest
from support import gases
from support.gases import equal_disks, gas_of, mixture

from ifrdem import ContactTime, Device
from ifrdem.errors import InputError
from ifrdem.kernels import runtime
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, RandomKicks
from ifrdem.model.ifr import IFRLaw
from ifrdem.model.state import State
from ifrdem.model.wall_motion import Motion, Turn
from ifrdem.model.walls import Wall
from ifrdem.simulation import checkpoint
from ifrdem.simulation.simulation import Simulation

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
STATE = (
    "position", "velocity", "spin", "collisions", "image", "wall_collisions", "latest_collision", "last_partner",
    "angle",
)  # fmt: skip


RECORD = ["energy", "partner", "angle"]
OPENS = 200


def same_bits(one: Simulation, other: Simulation) -> None:
    a, b = one.state, other.state
    assert a.time == b.time
    for name in STATE:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    p, q = one.measure(), other.measure()
    for name in ("energy_input", "wall_work", "wall_heat", "collisions", "wall_collisions"):
        assert getattr(p, name) == getattr(q, name), name
    assert np.array_equal(p.dissipated, q.dissipated)
    assert np.array_equal(p.regimes, q.regimes)
    assert one.statistics == other.statistics
    assert one.dissipated_energy == other.dissipated_energy


def gas(precision: str = "f64", **options: object) -> Callable[..., Simulation]:
    return lambda threads=None: gas_of(
        mixture(1200),
        0.5,
        COIN,
        device=Device(threads=threads, precision=precision),
        record=RECORD,
        **options,
    )


def walled(threads: int | None = None) -> Simulation:
    """Walls that shake, heat and turn, gates that open before and after the checkpoint, gravity, sums of walls."""
    disks, box = equal_disks(60), Box((14.0, 40.0), periodic=(True, False))
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.arange(10), np.arange(6)), axis=-1).reshape(-1, 2) * 1.3 + 1.0
    walls = [
        Wall.line((0.0, 0.3), (0.0, 1.0), motion=Motion("sine", amplitude=0.2, frequency=1.0)),
        Wall.line((0.0, 18.0), (0.0, -1.0), temperature=1.5),
        Wall.segment((1.0, 8.2), (6.0, 8.2), opens_at=0.7),
        Wall.segment((8.0, 8.2), (13.0, 8.2), opens_after=OPENS),
        Wall.arc((7.0, 13.2), 3.0, (3.3, 6.1), turn=Turn("steady", (7.0, 13.2), rate=2.0), moves_until=1.5),
    ]
    return Simulation(
        disks, box, COIN, State(grid, rng.normal(size=(60, 2)), rng.normal(size=60)), walls=walls,
        device=Device(threads=threads), gravity=(0.0, -1.0), collapse=ContactTime(0.01), seed=3,
        record=[*RECORD, "wall"],
    )  # fmt: skip


def sheared(threads: int | None = None) -> Simulation:
    disks = equal_disks(300)
    box, state = gases.sheared(disks, 0.4, rate=0.7)
    return Simulation(disks, box, COIN, state, device=Device(threads=threads), record=RECORD)


def freed(threads: int | None = None) -> Simulation:
    return gas_of(equal_disks(100), 0.4, COIN, Box.open(), device=Device(threads=threads), record=RECORD)


def driven(threads: int | None = None) -> Simulation:
    return gas_of(
        equal_disks(300), 0.3, COIN, device=Device(threads=threads), record=RECORD, seed=9,
        forces=[RandomKicks(0.05, power=0.5), Drag(0.08, rate=0.1)],
    )  # fmt: skip


@pytest.mark.parametrize(
    "make",
    [gas(), walled, sheared, freed, driven, pytest.param(gas(precision="f32"), id="f32")],
)
def test_a_run_goes_on_to_the_bit(tmp_path, make):
    # In time, except that a gas in single precision may as well end by its collisions.
    whole = make()
    whole.run(t_end=0.9)
    whole.save_checkpoint(tmp_path / "a.h5", {"note": 1})
    if make is walled:
        assert 0 < whole.collisions < OPENS
        assert whole.wall_collisions > 0
    whole.run(t_end=2.0)
    again = make()
    assert again.load_checkpoint(tmp_path / "a.h5") == {"note": 1}
    assert again.time == 0.9
    again.run(t_end=2.0)
    assert whole.collisions > (OPENS if make is walled else 0)
    same_bits(whole, again)
    if whole.measure().walls is not None:
        assert np.array_equal(whole.wall_sums.values, again.wall_sums.values)


def test_so_does_one_in_tiles_on_another_number_of_threads(tmp_path, monkeypatch):
    monkeypatch.setattr("ifrdem.simulation.tiling.SINGLE_TILE", 100)
    make = gas(tracked=[0, 5])
    whole = make(2)
    whole.run(collisions_per_disk=3.0)
    whole.save_checkpoint(tmp_path / "a.h5")
    whole.take_events()
    whole.run(collisions_per_disk=6.0)
    found, events = whole.state, whole.take_events()
    again = make(1)
    again.load_checkpoint(tmp_path / "a.h5")
    again.run(collisions_per_disk=6.0)
    for name in STATE:
        assert np.array_equal(getattr(found, name), getattr(again.state, name)), name
    for name, column in again.take_events().columns().items():
        assert np.array_equal(column, events.columns()[name]), name


def test_writing_a_checkpoint_changes_nothing(tmp_path):
    make = gas()
    plain, stored = make(), make()
    for end in (0.3, 0.6, 0.9):
        plain.run(t_end=end)
        stored.run(t_end=end)
        stored.save_checkpoint(tmp_path / "a.h5")
    same_bits(plain, stored)


def test_the_checkpoint_of_another_gas_is_refused(tmp_path):
    make = gas()
    make().save_checkpoint(tmp_path / "a.h5")
    for other in (gas(seed=2), driven, gas(precision="f32")):
        with pytest.raises(InputError, match="another gas"):
            other().load_checkpoint(tmp_path / "a.h5")


def test_what_is_no_checkpoint_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        checkpoint.read(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("text")
    with pytest.raises(InputError, match="damaged, or no checkpoint"):
        checkpoint.read(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(InputError, match="is no checkpoint"):
        checkpoint.read(tmp_path / "other.h5")
    whole = tmp_path / "whole.h5"
    checkpoint.write(whole, {"a": np.arange(100_000)}, {})
    os.truncate(whole, whole.stat().st_size // 2)
    with pytest.raises(InputError, match="damaged"):
        checkpoint.read(whole)


def test_a_checkpoint_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    checkpoint.write(path, {"a": np.arange(3)}, {"n": 1})
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, os.strerror(28))))
    with pytest.raises(InputError, match="No space left on device"):
        checkpoint.write(path, {"a": np.arange(4)}, {"n": 2})
    arrays, record = checkpoint.read(path)
    assert record["n"] == 1
    assert arrays["a"].tolist() == [0, 1, 2]
    assert os.listdir(tmp_path) == ["a.h5"]
    # What a killed process left is tidied up.
    (tmp_path / ".a.h5.123.part").write_text("half")
    monkeypatch.undo()
    checkpoint.write(path, {"a": np.arange(5)}, {"n": 3})
    assert os.listdir(tmp_path) == ["a.h5"]


@pytest.mark.parametrize("package", ["ifrdem", runtime.chosen()])
def test_the_checkpoint_of_another_version_is_refused_with_both(tmp_path, monkeypatch, package):
    path = tmp_path / "a.h5"
    versions = checkpoint.package_versions()
    present = versions[package]
    monkeypatch.setattr(checkpoint, "package_versions", lambda: {**versions, package: "0.0.1"})
    checkpoint.write(path, {"a": np.arange(3)}, {"n": 1})
    monkeypatch.undo()
    _, record = checkpoint.read(path)
    with pytest.raises(InputError, match=rf"written by {package} 0\.0\.1, this is {package} {present}"):
        checkpoint.check_versions(record, path)


def test_a_checkpoint_of_a_later_format_is_refused(tmp_path):
    path = tmp_path / "a.h5"
    checkpoint.write(path, {"a": np.arange(3)}, {"n": 1})
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = 99
    with pytest.raises(InputError, match=f"format 99; this ifrdem reads {checkpoint.FORMAT}"):
        checkpoint.read(path)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((3,), "path = 3: must be the path of a file"),
        (("",), "path = '': must be the path of a file"),
        ((".",), "path = '.': must be the path of a file"),
        (("a.h5", {"when": {1, 2}}), r"extra\['when'\] = \{1, 2\}: JSON cannot hold it"),
        (("a.h5", {(1, 2): 3}), r"extra\[\(1, 2\)\] = 3: JSON cannot hold it"),
        (("a.h5", [1]), r"extra = \[1\]: must be a mapping by name"),
        (("a.h5", None, {"extra_x": ["a"]}), r"arrays\['extra_x'\] = \['a'\]: must be an array of numbers"),
        (("a.h5", None, 5), "arrays = 5: must be a mapping by name"),
    ],
)
def test_what_a_checkpoint_cannot_hold_is_named_and_leaves_no_file(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    simulation = freed()
    with pytest.raises(InputError, match=said):
        simulation.save_checkpoint(*arguments)
    assert os.listdir(tmp_path) == []
