"""Forces that act within windows: the motion of those that end them, to rounding; the same bits for any division."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from support.force_examples import Push, Trap
from support.gases import COIN, ROLLING, equal_disks, gas_of, mixture, run_to, sheared, start

from ifrdem import Device
from ifrdem.errors import EngineError
from ifrdem.kernels.compiler.language import ti
from ifrdem.model.box import Box
from ifrdem.model.forces import (
    Drag,
    Force,
    Langevin,
    PoissonForce,
    RandomKicks,
    Rescale,
    SpinKicks,
    TableFriction,
)
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Piston
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation import backend
from ifrdem.simulation.checkpoints import snapshot
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.steps import force_steps
from ifrdem.validation.rows import engine_of

ALL_SUMS = ["dissipated", "last_partner", "angle"]
Make = Callable[[], Engine]


def gas(
    disks: Disks, forces: list[Force], law: Any = ROLLING, box: Box | None = None, **options: Any
) -> Engine:
    filled, state = start(disks, 0.3)
    options = dict[str, Any](seed=3, record=ALL_SUMS) | options
    return engine_of(disks, box or filled, state, np.array([[law]]), forces=forces, **options)


def two_forces() -> list[Force]:
    """Kicks that keep the momentum, and friction with noise, whose steps coincide at times."""
    return [RandomKicks(0.05, power=1.0), Langevin(0.15, temperature=1.0, rate=0.3, spin_rate=0.2)]


def idle_forces() -> list[Force]:
    """Forces that never act: with them a gas has the kernels of `mixture in tiles` below."""
    return [SpinKicks(1e6, power=1.0), Drag(1e6, rate=1.0)]


def bounded(**options: Any) -> Engine:
    """Between a shaken floor and a thermal lid, under gravity."""
    disks, box, rng = mixture(400), Box((30.0, 34.0), (True, False)), np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(24) * 1.25 + 0.6, np.arange(20) * 1.25 + 1.2)
    position = np.stack([x, y], axis=-1).reshape(-1, 2)[:400]
    state = State(position, rng.normal(size=(400, 2)), rng.normal(size=400))
    walls = [
        Wall.line((0.0, 0.4), (0.0, 1.0), motion=Motion("sine", amplitude=0.3, frequency=0.7)),
        Wall.line((0.0, 33.0), (0.0, -1.0), temperature=2.0),
    ]
    options = dict[str, Any](record=[*ALL_SUMS, "wall_sums"], seed=3) | options
    return engine_of(disks, box, state, np.array([[COIN]]), walls=walls, gravity=(0.0, -0.5), **options)


def with_piston() -> Engine:
    disks, box, rng = equal_disks(150), Box((20.0, 40.0), (True, False)), np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(15) * 1.25 + 0.6, np.arange(10) * 1.25 + 1.2)
    state = State(np.stack([x, y], axis=-1).reshape(-1, 2), rng.normal(size=(150, 2)), rng.normal(size=150))
    walls = [
        Wall.line((0.0, 0.2), (0.0, 1.0)),
        Wall.line((0.0, 20.0), (0.0, -1.0), piston=Piston(40.0, force=20.0)),
    ]
    forces = [Langevin(0.05, temperature=1.0, rate=0.3)]
    return engine_of(
        disks,
        box,
        state,
        np.array([[COIN]]),
        walls=walls,
        gravity=(0.0, -0.2),
        forces=forces,
        seed=3,
    )


def in_shear(**options: Any) -> Engine:
    disks = mixture(700)
    box, state = sheared(disks, 0.3, rate=0.4)
    forces = [Drag(0.05, rate=0.2), RandomKicks(0.05, power=0.5)]
    return engine_of(
        disks, box, state, np.array([[COIN]]), forces=forces, seed=3, record=["ledger"], **options
    )


CASES: dict[str, Make] = {
    "mixture in tiles": lambda: gas(
        mixture(700),
        [*two_forces(), SpinKicks(0.07, power=0.3), Drag(0.05, rate=0.2, quadratic=0.1)],
        order="tiled",
        tile_disks=60,
    ),
    # At the times of the thermostat all forces act between windows.
    "with a thermostat": lambda: gas(equal_disks(300), [*two_forces(), Rescale(0.15, energy=1.5)]),
    "table": lambda: gas(equal_disks(300), [TableFriction(0.05, mu=0.05, gravity=2.0)]),
    "walls": lambda: bounded(forces=two_forces()),
    "piston": with_piston,
    "shear": in_shear,
    "of the position": lambda: gas(
        equal_disks(300), [Trap(0.05, stiffness=0.5, x=9.0, y=8.0, frequency=1.0)], order="tiled", tile_disks=60
    ),
}  # fmt: skip


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("name", CASES)
def test_the_motion_is_that_of_forces_that_end_windows(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows begin elsewhere, and with them rounding: errors of 1e-16 have grown for up to 6 collisions per disk."""
    ends = []
    for within in (True, False):
        with monkeypatch.context() as patched:
            if not within:
                patched.setattr(force_steps, "acts_within", lambda *_: False)
            engine = CASES[name]()
            end = run_to(engine, 0.9)
            assert engine.arrays.uses.forced == within
            ends.append((end, engine.force_steps.energy_inputs, engine.flow_work))
            engine.release()
    (one, given, flow_work), (other, expected, expected_work) = ends
    np.testing.assert_array_equal(one.collisions, other.collisions)
    assert one.collisions.sum() > 150
    for column in ("velocity", "spin", "angle", "dissipated"):
        np.testing.assert_allclose(getattr(one, column), getattr(other, column), atol=1e-9)
    np.testing.assert_array_equal(one.last_partner, other.last_partner)
    np.testing.assert_allclose(given, expected, rtol=1e-9)
    assert flow_work == pytest.approx(expected_work, rel=1e-9)


def bits(engine: Engine, t_end: float, *stops: float) -> dict[str, NDArray[Any]]:
    """All that a gas is at a time, run with stops on the way; the engine ends."""
    for stop in stops:
        run_to(engine, stop)
    end = run_to(engine, t_end)
    names = ("position", "velocity", "spin", "angle", "image", "collisions", "last_partner", "dissipated")
    found = {name: getattr(end, name) for name in names}
    found["energy"] = engine.force_steps.energy_inputs
    engine.release()
    return found


def check_equal(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> None:
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], err_msg=name)


def many(**options: Any) -> Engine:
    one = dict[str, Any](device=Device(threads=1))
    return gas(mixture(1200), [*two_forces(), *idle_forces()], **(one | options))


@pytest.mark.full
def test_tiles_threads_stops_and_a_restart_change_no_bit() -> None:
    """0.175 is a time at which a force acts, 0.3333 is none; stops by collisions are within windows."""
    reference = bits(many(order="serial"), 0.8)
    assert reference["collisions"].sum() > 2400
    stops = (0.1, 0.175, 0.3333, 0.525)
    for options in ({"order": "serial"}, {"order": "tiled", "tile_disks": 100}):
        check_equal(bits(many(**options), 0.8, *stops), reference)
        engine = many(**options)
        for count in (250, 650):
            while engine.collisions < count:
                engine.advance(collisions=count)
        kept = snapshot.take(engine)
        engine.release()
        restored = many(**options)
        snapshot.restore(restored, kept)
        assert restored.collisions == 650
        check_equal(bits(restored, 0.8), reference)
    if backend.cores() > 1:
        check_equal(
            bits(many(order="tiled", tile_disks=100, device=Device(threads=2)), 0.8, 0.3333), reference
        )


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("power", [50.0, 5000.0])
def test_strong_kicks_are_exact_in_tiles(power: float) -> None:
    """Each kick heats the gas many times over, or it begins at rest: halos get as wide as they need to be."""
    for speed in (1.0, 0.0):
        found = []
        for order in ("serial", "tiled"):
            disks = mixture(1000)
            box, state = start(disks, 0.3)
            state = State(state.position, speed * state.velocity, speed * state.spin)
            forces = [
                RandomKicks(0.05, power=power),
                Langevin(1e6, temperature=1.0, rate=1.0),
                *idle_forces(),
            ]
            engine = engine_of(
                disks, box, state, np.array([[ROLLING]]), forces=forces, seed=3, order=order, tile_disks=60, record=ALL_SUMS,
            )  # fmt: skip
            found.append(bits(engine, 0.3))
        if not speed:  # the first kick, between windows, is added up tile by tile
            one, other = (each.pop("energy") for each in found)
            np.testing.assert_allclose(one, other, rtol=1e-15)
        check_equal(*found)


@pytest.mark.full
def test_the_energy_of_a_gas_between_walls_is_what_was_put_in() -> None:
    """Under gravity, and in both precisions: kinetic and potential energy, work, heat and losses close."""
    precisions: list[tuple[Literal["f64", "f32"], float]] = [("f64", 1e-11), ("f32", 2e-5)]
    for precision, close in precisions:
        engine = bounded(
            forces=[Langevin(0.05, temperature=3.0, rate=0.5), SpinKicks(0.05, power=1.0)],
            device=Device(threads=1, precision=precision),
        )
        totals = engine.totals()
        begin = totals[0] + totals[1] - totals[5]
        run_to(engine, 2.0)
        given = engine.force_steps.energy_inputs
        totals = engine.totals()
        end = totals[0] + totals[1] - totals[5]
        change = given.sum() + engine.wall_work + engine.wall_heats.sum() - engine.dissipated()[0].sum()
        assert abs(given).sum() > 100.0
        assert end - begin == pytest.approx(change, abs=close * (abs(given).sum() + abs(begin)))
        engine.release()


def test_parameters_set_between_runs_act_from_then_on() -> None:
    """In the middle of a window too, without forces' steps that are planned already."""
    smooth = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    for order in (500, 400):
        simulation = gas_of(equal_disks(order), 0.3, smooth, forces=[Push(0.05, acceleration=2.0), *never()])
        simulation.run(t_end=0.52)  # 10 steps
        simulation.forces[0].acceleration = -1.0
        simulation.run(t_end=0.98)  # 10 more
        start_velocity = start(equal_disks(order), 0.3)[1].velocity.mean(axis=0)
        change = simulation.state.velocity.mean(axis=0) - start_velocity
        np.testing.assert_allclose(change, [10 * 0.05 * 2.0 - 10 * 0.05 * 1.0, 0.0], atol=1e-13)
        simulation.set_forces([Push(0.05, acceleration=4.0), *never()])
        simulation.run(t_end=1.48)
        change = simulation.state.velocity.mean(axis=0) - start_velocity
        np.testing.assert_allclose(change, [0.5 + 10 * 0.05 * 4.0, 0.0], atol=1e-13)


@pytest.mark.full
def test_the_energy_ledger_goes_on_where_forces_are_set() -> None:
    simulation = gas_of(
        equal_disks(300), 0.3, IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2), forces=[RandomKicks(0.05, power=1.0)]
    )
    simulation.run(t_end=1.0)
    first = simulation.energy_input
    simulation.set_forces([Drag(0.05, rate=0.1), Langevin(0.05, temperature=2.0, rate=1.0)])
    assert simulation.energy_input == pytest.approx(first, rel=1e-14)
    assert not simulation.energy_inputs.any()
    simulation.run(t_end=2.0)
    assert simulation.energy_input == pytest.approx(first + simulation.energy_inputs.sum(), rel=1e-14)


def test_a_force_that_diverges_within_a_window_is_named() -> None:
    forces = [Push(0.05, acceleration=0.0), Diverging(0.05, at=0.51)]
    gas = gas_of(equal_disks(300), 0.3, IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2), forces=forces)
    with pytest.raises(
        EngineError, match=r"t = 0\.525: force 2, Diverging, made a velocity or spin that is not"
    ):
        gas.run(t_end=1.0)


class Diverging(Force):
    """An infinite velocity from a time on."""

    parameters = ("at",)

    @staticmethod
    def act(disk, step, p):
        vx = disk.vx
        if step.time > p.at:
            vx = vx / (0.0 * vx)
        return vx, disk.vy, disk.spin


def never() -> list[Force]:
    """A force that never acts: with it a gas has the kernels of one that diverges."""
    return [Diverging(1e6, at=1e6)]


class Lying(Force):
    """Says that its total does not depend on the motion, and sums velocities."""

    totals = 1
    totals_ahead = True

    @staticmethod
    def act(disk, step, p):
        return disk.vx + 0.0 * step.totals[0], disk.vy, disk.spin

    @staticmethod
    def measure(disk, step, p):
        return ti.Vector([disk.vx])


def test_totals_that_do_depend_on_the_motion_are_seen() -> None:
    gas = gas_of(equal_disks(300), 0.3, IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2), forces=[Lying(0.05)])
    with pytest.raises(EngineError, match="measure must read no position, velocity or spin"):
        gas.run(t_end=1.0)


@ti.func
def chosen(disk, p):  # type: ignore[no-untyped-def]
    """Rate of change of the spin of a disk: of species 1, disk 7, and material 1."""
    rate = 0.0 * disk.spin
    if disk.species == 1:
        rate += p.of_species
    if disk.id == 7:
        rate += p.of_disk
    if disk.material == 1:
        rate += p.of_material
    return rate


class Selective(Force):
    """Torques on disks that are chosen."""

    parameters = ("of_species", "of_disk", "of_material")

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        return disk.vx, disk.vy, disk.spin + chosen(disk, p) * step.dt


class Shared(Force):
    """The same divided by a total, the number of disks of species 1 and one for disk 7: between windows."""

    parameters = Selective.parameters
    totals = 1

    @staticmethod
    def measure(disk: Any, step: Any, p: Any) -> Any:
        return ti.Vector([1.0 * (disk.species == 1) + 1.0 * (disk.id == 7)])

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        return disk.vx, disk.vy, disk.spin + chosen(disk, p) * step.dt / step.totals[0]


class SharedAhead(Shared):
    """The same within windows."""

    totals_ahead = True


class Sudden(PoissonForce):
    """The same torques at random times."""

    parameters = Selective.parameters
    act = Selective.act


@pytest.mark.full
@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_forces_may_choose_disks_by_species_id_and_material(order: str) -> None:
    """Ids of species are 0 to 99, 100 to 259 and 260 to 299; every second disk has material 1.

    Smooth disks keep their spins in collisions. Until the time 2.1 forces in steps change them by 2.1 times the rates,
    those with a total by a 161st part of that. At random times, with a mean interval of 0.05, a spin of the second
    species jumps by 1024 x 0.05, on average 42 times, with a standard error of sqrt(42 / 160) = 0.51 over 160 disks.
    """
    n, ids = 300, np.arange(300)
    disks = Disks(
        n, mass=1.0, radius=0.5, material=ids % 2, species={"light": 100, "driven": 160, "rest": 40}
    )
    box, state = start(disks, 0.3)
    forces = [
        Selective(0.05, of_species=0.5, of_disk=4.0, of_material=0.0625),
        Shared(0.07, of_species=1.5, of_disk=0.0, of_material=0.25),
        SharedAhead(0.05, of_species=0.0, of_disk=2.0, of_material=0.75),
        Sudden(20.0, of_species=1024.0, of_disk=1024.0, of_material=0.0),
    ]
    smooth = np.broadcast_to((0.9, -1.0, 0.0, 0.0, 0.0), (2, 2, 5)).copy()
    engine = engine_of(disks, box, state, smooth, forces=forces, seed=3, order=order, tile_disks=60)
    run_to(engine, 2.1)
    assert engine.collisions > 100
    species = (ids >= 100) & (ids < 260)
    rates = [
        each["of_species"] * species + each["of_disk"] * (ids == 7) + each["of_material"] * (ids % 2)
        for each in (force.values for force in forces[:3])
    ]
    gained = engine.state().spin - state.spin - 2.1 * (rates[0] + (rates[1] + rates[2]) / 161.0)
    jumps = np.rint(gained / 51.2)
    np.testing.assert_allclose(gained, 51.2 * jumps, atol=1e-9)
    assert not jumps[~species & (ids != 7)].any()
    assert jumps[7] > 0
    assert jumps[species].mean() == pytest.approx(42.0, abs=4.0 * 0.51)


def test_without_named_species_all_disks_are_of_number_0() -> None:
    disks = equal_disks(60)
    box, state = start(disks, 0.2)
    force = Shared(0.05, of_species=1.0, of_disk=2.0, of_material=0.0)
    engine = engine_of(disks, box, state, np.array([[(0.9, -1.0, 0.0, 0.0, 0.0)]]), forces=[force])
    run_to(engine, 1.0)
    np.testing.assert_allclose(engine.state().spin - state.spin, 2.0 * (np.arange(60) == 7), atol=1e-12)
