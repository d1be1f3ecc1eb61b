"""A run resumed from a checkpoint has the bits of the uninterrupted run."""

from __future__ import annotations

import os
from collections.abc import Callable

import h5py
import numpy as np
import pytest
from support import gases
from support.gases import equal_disks, gas_of, mixture

from ifrdem import ContactTime, Device, Rest, RotatingGravity, VelocityCutoff
from ifrdem.errors import EngineError, InputError, NoMoreCollisions
from ifrdem.initial.placement import check_no_overlap
from ifrdem.kernels.compiler import runtime
from ifrdem.model import forces, setup
from ifrdem.model.box import Box
from ifrdem.model.forces import (
    Drag,
    Force,
    Langevin,
    PoissonKicks,
    PoissonSpinKicks,
    RandomKicks,
    Rescale,
    SpinKicks,
    TableFriction,
)
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.laws.law import CollisionLaw
from ifrdem.model.laws.records import LAWS
from ifrdem.model.laws.table import TableLaw
from ifrdem.model.laws.viscoelastic import Viscoelastic
from ifrdem.model.laws.walton import Walton
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Piston, Turn
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.simulation.simulation import Simulation
from ifrdem.tools.not_recorded import NotRecorded
from ifrdem.tools.versions import revision

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
STATE = (
    "position", "velocity", "spin", "collisions", "image", "wall_collisions", "latest_collision", "last_partner",
    "angle",
)  # fmt: skip


RECORD = ["ledger", "last_partner", "angle"]
OPENS = 200


def equal(a: State, b: State, name: str) -> bool:
    """True if a quantity has the same bits in both, or is recorded in neither."""
    one, other = getattr(a, name), getattr(b, name)
    if isinstance(one, NotRecorded):
        return isinstance(other, NotRecorded)
    return np.array_equal(one, other)


def same_bits(one: Simulation, other: Simulation) -> None:
    a, b = one.state, other.state
    assert a.time == b.time
    for name in STATE:
        assert equal(a, b, name), name
    p, q = one.measure(), other.measure()
    for name in ("energy_input", "wall_work", "wall_heat", "collisions", "wall_collisions"):
        assert getattr(p, name) == getattr(q, name), name
    assert np.array_equal(p.dissipated, q.dissipated)
    assert np.array_equal(p.regimes, q.regimes)
    assert one.statistics == other.statistics
    assert one.dissipated_energy == other.dissipated_energy


def dense(precision: str = "f64", **options: object) -> Callable[..., Simulation]:
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
        record=[*RECORD, "wall_sums"],
    )  # fmt: skip


def pushed(threads: int | None = None) -> Simulation:
    """Two materials with laws of their own, each with its k; a piston; a bath, and a slow collision is elastic."""
    disks, box = mixture(60), Box((14.0, 12.0), periodic=(True, False))
    disks = Disks(60, disks.mass, disks.radius, disks.k, material=np.arange(60) % 2)
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.arange(10), np.arange(6)), axis=-1).reshape(-1, 2) * 1.3 + 1.0
    hoops = IFRLaw(e_n=0.8, e_t=-0.5, mu=0.4, sticking="contact_point", rho=0.01, k=1.0)
    force = Langevin(0.05, temperature=1.0, rate=0.1)
    force.temperature = 1.5
    return Simulation(
        disks, box, [[COIN, hoops], [hoops, COIN]], State(grid, rng.normal(size=(60, 2)), rng.normal(size=60)),
        walls=[Wall.line((0.0, 11.0), (0.0, -1.0), material=1, group="lid", piston=Piston(20.0, force=9.0, low=-0.5))],
        device=Device(threads=threads), forces=[force], collapse=VelocityCutoff(0.05), seed=2**63,
        record=["ledger", "last_partner", "angle", "dissipated", "wall_sums"], histories=[3, 7],
    )  # fmt: skip


def heap(threads: int | None = None) -> Simulation:
    """Disks that fall and rest, while gravity rotates."""
    disks, box = equal_disks(20), Box((6.0, 8.0), periodic=(False, False))
    grid = np.stack(np.meshgrid(np.arange(4), np.arange(5)), axis=-1).reshape(-1, 2) * 1.2 + 0.9
    velocity = np.random.default_rng(5).normal(scale=0.2, size=(20, 2))
    return Simulation(
        disks, box, IFRLaw(e_n=0.3, e_t=-0.5, mu=0.4), State(grid, velocity, np.zeros(20)), collapse=Rest(0.05),
        gravity=RotatingGravity((0.0, -1.0), rate=0.05, step=0.01), device=Device(threads=threads),
        record=["ledger", "last_partner", "angle"],
    )  # fmt: skip


def sheared(threads: int | None = None) -> Simulation:
    disks = equal_disks(300)
    box, state = gases.sheared(disks, 0.4, rate=0.7)
    return Simulation(disks, box, COIN, state, device=Device(threads=threads), record=RECORD)


def freed(threads: int | None = None) -> Simulation:
    return gas_of(100, 0.4, COIN, Box.open(), device=Device(threads=threads), record=RECORD)


def driven(threads: int | None = None) -> Simulation:
    return gas_of(
        equal_disks(300), 0.3, COIN, device=Device(threads=threads), record=RECORD, seed=9,
        forces=[RandomKicks(0.05, power=0.5), Drag(0.08, rate=0.1)],
    )  # fmt: skip


FORCES = (
    Drag(0.1, rate=0.2, quadratic=0.1, spin_rate=0.3),
    Langevin(0.1, temperature=1.0, rate=0.2, spin_temperature=2.0, spin_rate=0.1),
    PoissonKicks(3.0, power=0.1),  # a step of 1/3
    PoissonSpinKicks(7.0, diffusion=0.1),
    RandomKicks(0.1, power=0.2),
    Rescale(0.1, energy=1.0),
    SpinKicks(0.1, diffusion=0.3),
    TableFriction(0.1, mu=0.2, gravity=9.81),
)


class Named(Drag):
    """A force that keeps more than numbers, and has other arguments than attributes."""

    def __init__(self, name: str) -> None:
        super().__init__(0.1, rate=0.2)
        self._name, self._places = name, (1.0, 2.0)


@pytest.mark.parametrize(
    "law",
    [
        IFRLaw(e_n=0.8, e_t=-0.5, mu=0.4, sticking="contact_point", rho=0.01, k=1.0),
        Walton(e_n=0.9, beta_0=0.4, mu=0.2),
        Viscoelastic(A=0.05, Y=3.0, e_t=-0.9, mu=0.2, sticking="contact_point", rho=0.01, k=1.5),
        *(
            law.make(**{name: key.example for name, key in law.keys.items()})
            for law in LAWS.values()
            if law.kind not in (IFRLaw, Walton, Viscoelastic, TableLaw)
        ),
        TableLaw(slip=[0.1, 0.5], ratio=[0.03, 0.1], e_n=0.9),
    ],
    ids=lambda law: type(law).__name__,
)
def test_every_force_and_law_of_the_program_comes_back_with_all_of_its_attributes(tmp_path, monkeypatch, law):
    assert {type(each) for each in FORCES} == set(setup._force_classes())
    monkeypatch.setattr(forces, "Named", Named, raising=False)
    monkeypatch.setattr(forces, "__all__", [*forces.__all__, "Named"])
    disks, given = Disks(2, mass=1.0, radius=0.5, k=1.0), [*FORCES, Named("a")]
    state = State([[2.0, 2.0], [5.0, 5.0]], [[1.0, 0.5], [0.0, 0.0]], [1.0, 2.0])
    Simulation(disks, Box((9.0, 9.0)), law, state, forces=given).save_checkpoint(tmp_path / "gas.h5")
    again = Simulation.from_checkpoint(tmp_path / "gas.h5")
    assert [(type(one), vars(one)) for one in again.forces] == [(type(one), vars(one)) for one in given]
    ((found,),) = again.setup.law
    assert type(found) is type(law)
    np.testing.assert_equal(vars(found), vars(law))


@pytest.mark.full(keep=("walled",))
@pytest.mark.parametrize(
    "make",
    [dense(), walled, pushed, heap, sheared, freed, driven, pytest.param(dense(precision="f32"), id="f32")],
)
def test_a_run_resumes_to_the_bit(tmp_path, make):
    """In the same gas made again, and in one made from the file."""
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
    for goes_on in (again, Simulation.from_checkpoint(tmp_path / "a.h5")):
        assert goes_on.time == 0.9
        goes_on.run(t_end=2.0)
        assert whole.collisions > (OPENS if make is walled else 0)
        same_bits(whole, goes_on)
        assert np.array_equal(whole.pistons, goes_on.pistons)
        assert equal(whole.state, goes_on.state, "dissipated")
        if whole.measure().walls is not None:
            assert np.array_equal(whole.wall_sums.values, goes_on.wall_sums.values)


def at_rest(boxes: int = 0) -> Simulation:
    """Two disks at rest, which kicks turn and never move, with so many boxes behind them."""
    state = State([[1.0, 1.0], [1.0, 5.0]], [[0.0, 0.0]] * 2, [0.0] * 2)
    state.image = np.full((2, 2), boxes, dtype=np.int32)
    return Simulation(equal_disks(2), Box((8.0, 8.0)), COIN, state, forces=[SpinKicks(0.1, power=1.0)])


def test_a_gas_without_collisions_is_given_up_as_late_as_without_the_checkpoint(tmp_path, monkeypatch):
    """After 20 steps of the force in which nothing met. Counted anew from the checkpoint, at 2.55."""
    monkeypatch.setattr("ifrdem.simulation.engine.PATIENCE", 20)
    whole = at_rest()
    whole.run(t_end=0.65)
    whole.save_checkpoint(tmp_path / "a.h5")
    again = at_rest()
    again.load_checkpoint(tmp_path / "a.h5")
    for gas in (whole, again):
        with pytest.raises(NoMoreCollisions, match=r"t = 1\.95: "):
            gas.run(collisions_per_disk=1.0)


def test_counters_that_are_nearly_full_are_looked_at_after_a_checkpoint(tmp_path):
    """Boxes travelled, of which a gas that was made with none expects some 2^31 windows that all is well."""
    full = at_rest(2**31 - 3)
    full.save_checkpoint(tmp_path / "a.h5")
    gas = at_rest()
    gas.load_checkpoint(tmp_path / "a.h5")
    with pytest.raises(EngineError, match="2147483647"):
        gas.run(t_end=10.0)


@pytest.mark.full
@pytest.mark.parametrize("down", [-1.0, 0.0])
def test_a_checkpoint_in_single_precision_is_taken_back(tmp_path, down):
    """At the time of a collision two disks touch, to the rounding of their places: some 1e-7 of the box.

    Such files were refused, as disks overlapped by more than double precision explains; with a floor, by the wall too.
    """
    disks, single = equal_disks(300), Device(precision="f32")
    box, state = gases.start(disks, 0.4)
    if down:
        state.position = box.wrap(state.position) + np.array([0.0, 0.6])
        box = Box((box.lengths[0], box.lengths[1] + 1.2), (True, False))
    gas = Simulation(disks, box, COIN, state, gravity=(0.0, down), device=single)
    overlap = 0
    for collisions in range(10, 90, 10):
        gas.run(collisions_per_disk=2.0 * collisions / disks.n)
        try:
            check_no_overlap(box, disks.radius, gas.state.position)
        except InputError:
            overlap += 1
        gas.save_checkpoint(tmp_path / "a.h5")
        again = Simulation.from_checkpoint(tmp_path / "a.h5")
        same_bits(gas, again)
        Simulation(disks, box, COIN, gas.state, gravity=(0.0, down), device=single)
    assert overlap > 0


@pytest.mark.full
def test_a_gas_from_a_checkpoint_is_unchanged(tmp_path):
    gas = pushed()
    gas.set_law(IFRLaw(e_n=0.7, e_t=-0.5, mu=0.3))
    gas.set_piston_force(0, 5.0)
    gas.run(t_end=0.4)
    gas.save_checkpoint(tmp_path / "a.h5")
    again = Simulation.from_checkpoint(tmp_path / "a.h5", device=Device(threads=1))
    assert str(again) == str(gas)
    assert (again.box, again.gravity) == (gas.box, gas.gravity)
    assert [(type(each), each.step, each.values) for each in again.forces] == [
        (Langevin, 0.05, {"temperature": 1.5, "rate": 0.1, "spin_temperature": 1.0, "spin_rate": 0.0})
    ]
    (wall,) = again.walls
    assert (wall.group, wall.material, wall.piston.force, wall.piston.low) == ("lid", 1, 5.0, -0.5)
    assert again.tracked.tolist() == [3, 7]
    for name in ("mass", "radius", "k", "material"):
        assert np.array_equal(getattr(again.disks, name), getattr(gas.disks, name))


class Smooth(CollisionLaw):
    coefficients = ("e_n",)

    @staticmethod
    def collide(pair, law):
        return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0


class Uniform(Force):
    parameters = ("acceleration",)

    @staticmethod
    def act(disk, step, p):
        return disk.vx + p.acceleration * step.dt, disk.vy, disk.spin


@pytest.mark.full
def test_custom_laws_and_forces_are_given_again(tmp_path):
    path, disks = tmp_path / "a.h5", equal_disks(60)
    box, state = gases.start(disks, 0.3)
    law, forces = Smooth(e_n=0.9), [Uniform(0.05, acceleration=0.3), Drag(0.08, rate=0.1)]
    whole = Simulation(disks, box, law, state, forces=forces, record=["ledger", "last_partner", "angle"])
    whole.run(t_end=0.7)
    whole.save_checkpoint(path)
    whole.run(t_end=1.5)
    for given, message in (
        ({"forces": forces}, r"law = None: must be the custom Smooth\(e_n=0\.9\)"),
        ({"law": law}, "forces = None: must be the forces of the gas, custom Uniform, Drag"),
        ({"law": Smooth(e_n=0.8), "forces": forces}, "another gas: it differs in law"),
        ({"law": law, "forces": [Uniform(0.05, acceleration=0.4), forces[1]]}, "another gas: it differs in forces"),
        ({"law": law, "forces": forces, "device": Device(precision="f32")}, r"device = .*f32.*: must be .*f64"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=message):
            Simulation.from_checkpoint(path, **given)
    again = Simulation.from_checkpoint(path, law=law, forces=forces)
    again.run(t_end=1.5)
    same_bits(whole, again)


@pytest.mark.full
def test_so_does_one_in_tiles_on_another_number_of_threads(tmp_path, monkeypatch):
    monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)
    make = dense(histories=[0, 5])
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
        assert equal(found, again.state, name), name
    for name, column in again.take_events().columns().items():
        assert np.array_equal(column, events.columns()[name]), name


@pytest.mark.full
def test_writing_a_checkpoint_changes_nothing(tmp_path):
    plain, stored = driven(), driven()
    for end in (0.3, 0.6, 0.9):
        plain.run(t_end=end)
        stored.run(t_end=end)
        stored.save_checkpoint(tmp_path / "a.h5")
    same_bits(plain, stored)


def test_a_return_to_the_beginning_of_a_window_forgets_that_it_was_run(tmp_path):
    """The window that followed was taken for one that is run again, and `statistics` did not count it."""
    one, other = (gas_of(100, 0.3, COIN) for _ in range(2))
    one.save_checkpoint(tmp_path / "begin.h5")
    one.run(t_end=0.01)
    one.load_checkpoint(tmp_path / "begin.h5")
    one.run(t_end=0.02)
    other.run(t_end=0.02)
    assert one.statistics == other.statistics
    assert one.statistics.windows == 1


def test_the_checkpoint_of_another_gas_is_refused(tmp_path):
    make = dense()
    make().save_checkpoint(tmp_path / "a.h5")
    for other, what in (
        (dense(seed=2), "seed"),
        (driven, "disks, box, forces, seed"),
        (dense(precision="f32"), "device"),
    ):
        with pytest.raises(InputError, match=f"another gas: it differs in {what}$"):
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
    assert record["git"] == revision()
    remedy = (
        "Begin a new run"
        if package == "ifrdem"
        else rf"`pip install {package}==0\.0\.1`.*, or begin a new run"
    )
    message = rf"written by {package} 0\.0\.1, this is {package} {present}.*\. .*{remedy}"
    with pytest.raises(InputError, match=message):
        checkpoint.check_versions(record, path)


def test_a_checkpoint_of_a_later_format_is_refused(tmp_path):
    path = tmp_path / "a.h5"
    checkpoint.write(path, {"a": np.arange(3)}, {"n": 1})
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = 99
    with pytest.raises(InputError, match=f"format 99; this ifrdem reads {checkpoint.FORMAT}"):
        checkpoint.read(path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((3,), "path = 3: must be a text or a path"),
        (("",), "path = '': must be a text or a path, not empty"),
        ((".",), "path = '.': must be the path of a file"),
        (("a.h5", {"when": {1, 2}}), r"extra\['when'\] = \{1, 2\}: JSON cannot hold it"),
        (("a.h5", {(1, 2): 3}), r"extra\[\(1, 2\)\] = 3: JSON cannot hold it"),
        (("a.h5", [1]), r"extra = \[1\]: must be a mapping by name"),
        (("a.h5", None, {"extra_x": ["a"]}), r"arrays\['extra_x'\] = \['a'\]: must be an array of numbers"),
        (("a.h5", None, 5), "arrays = 5: must be a mapping by name"),
    ],
)
def test_what_a_checkpoint_cannot_hold_is_named_and_leaves_no_file(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    simulation = freed()
    with pytest.raises(InputError, match=message):
        simulation.save_checkpoint(*arguments)
    assert os.listdir(tmp_path) == []
