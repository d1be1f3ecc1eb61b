"""Forces at random times of each disk: their statistics, exact collisions between them, equal bits, refusals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.bounds import check_bounds
from support.force_examples import SMOOTH, still
from support.gases import COIN, equal_disks, gas_of, mixture, run_to, start
from support.scene import Scene

from ifrdem import Device
from ifrdem.errors import EngineError, InputError
from ifrdem.kernels.columns import FORCE_VALUES
from ifrdem.kernels.compiler.language import ti
from ifrdem.kernels.layout import Uses
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, Force, PoissonForce, PoissonKicks, PoissonSpinKicks, RandomKicks
from ifrdem.model.gravity import Gravity
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation import backend
from ifrdem.simulation.measuring.tracking import KICK, Tracking
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.steps.force_steps import _compiled
from ifrdem.validation.rows import engine_of

LOSSY = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)


class Andersen(PoissonForce):
    """Velocities that are forgotten at random times."""

    parameters = ("temperature",)
    draws_pair = True

    @staticmethod
    def act(disk, step, p):  # type: ignore[no-untyped-def]
        v = ti.sqrt(p.temperature / disk.mass) * step.pair
        return v[0], v[1], disk.spin


class Note(PoissonForce):
    """Velocities become the time and the mean time between two actions; spins grow by the eighth power of a number."""

    parameters = ("number",)

    @staticmethod
    def act(disk, step, p):  # type: ignore[no-untyped-def]
        square = p.number * p.number
        return 1e-3 * step.time, 1e-3 * step.dt, disk.spin + square * square * square * square


IDLE = (
    PoissonKicks(1e-9, diffusion=1e-12), PoissonSpinKicks(1e-9, diffusion=1e-12), Drag(1e6, rate=1.0), Note(1e-9, number=0.0)
)  # fmt: skip
RECORD = ["ledger", "last_partner"]


def among_all(*given: Force) -> list[Force]:
    """Forces among those of this file, in the order of `IDLE`, the others of which do not act before a time of 1e5.

    Kernels are compiled for a list of forces and for what is recorded: with the same ones, once for all gases.
    """
    acting: dict[type[Force], Force] = {type(force): force for force in given}
    assert acting.keys() <= {type(force) for force in IDLE}
    return [acting.get(type(force), force) for force in IDLE]


# --- statistics ---------------------------------------------------------------------------------------------


@pytest.mark.full
def test_times_are_a_poisson_process_of_each_disk() -> None:
    """400 disks, rate 3, 20 time units: numbers of mean and variance 60, free times of density 3 exp(-3 t).

    The mean number scatters by sqrt(60 / 400), a variance of 400 numbers by sqrt(2 / 400) of it, and Kolmogorov's
    distance of m samples stays below 1.95 / sqrt(m) but once in a thousand.
    """
    disks, box, state = still(400, mass=1.0 + np.arange(400) % 2)
    simulation = Simulation(
        disks,
        box,
        SMOOTH,
        state,
        forces=among_all(Note(3.0, number=1.0)),
        record=RECORD,
        histories=range(400),
        seed=7,
    )
    simulation.run(t_end=20.0)
    events = simulation.take_events()
    times = [events.time[events.id == i] for i in range(400)]
    numbers = np.array([len(each) for each in times])
    assert numbers.mean() == pytest.approx(60.0, abs=5.0 * math.sqrt(60.0 / 400.0))
    assert numbers.var() == pytest.approx(60.0, rel=5.0 * math.sqrt(2.0 / 400.0))
    np.testing.assert_array_equal(simulation.state.spin, numbers)  # each acts once, at its time
    np.testing.assert_allclose(1e3 * events.velocity_after[:, 0], events.time, rtol=1e-12)
    np.testing.assert_allclose(1e3 * events.velocity_after[:, 1], 1.0 / 3.0, rtol=1e-12)
    for found, below in (
        (np.concatenate([np.diff(each[:31]) for each in times]), lambda t: 1.0 - np.exp(-3.0 * t)),
        (np.concatenate(times), lambda t: t / 20.0),
        (np.concatenate(times) * 3.0 % 1.0, lambda u: u),  # within slices of the mean time between two
    ):
        found = np.sort(found)
        distance = np.abs(below(found) - (np.arange(len(found)) + 0.5) / len(found)).max()
        assert distance < 1.95 / math.sqrt(len(found))
    assert simulation.collisions == simulation.state.collisions.sum() == 0


def test_no_action_is_lost_in_the_longest_of_runs() -> None:
    """Searches from the moment before an action find it, at 2^43 mean times after the beginning.

    There n + u has steps of 1/512, and the time over the length is n + 1 for the last of a slice: a search that began
    in that slice would miss them. Of 20,000 disks some 20 have their first action there.
    """
    backend.start("cpu")
    from support.kernels.actions import find

    n, length = 20_000, 0.1
    uses = Uses(forces=(_compiled(Note, 0, 0, 0),))
    scene = Scene(n)
    scene.event_info.id, scene.grid.seed_low = np.arange(n), 7
    scene.arrays["force_values"] = np.array([*np.zeros(FORCE_VALUES.width), length, 3.0])
    names = "uses grid event_info action force_values"
    begin = (2.0**43 + np.random.default_rng(1).random(n)) * length
    scene.call(find, uses, names, begin, np.full(n, -1.0))
    first = scene.action.array.copy()
    time, number, draw = scene.action.time.copy(), scene.action.slice.copy(), scene.action.draw.copy()
    assert np.all((time >= begin) & (time < begin + 40.0 * length))
    assert np.count_nonzero(time / length >= number + 1.0) > 5
    scene.call(find, uses, names, time, draw - 1.0)
    np.testing.assert_array_equal(scene.action.array, first)


@pytest.mark.parametrize("strength", [{"power": 0.6}, {"diffusion": 0.3}])
def test_free_disks_get_the_power_and_the_cumulants_of_a_compound_poisson_process(
    strength: dict[str, float],
) -> None:
    """<v_x^2> = 2 D t; excess kurtosis of v_x 3 / (rate t), and <v_x^2 v_y^2> / <v_x^2>^2 - 1 a third of that.

    20,000 disks of mass 1, D = 0.3: <v_x^2> of all scatters by sqrt((2 + kurtosis) / N), a kurtosis near 0 by
    sqrt(24 / N); five of these are allowed, of the kurtosis ten, because tails make it scatter more at first.
    """
    n, rate = 20_000, 5.0
    disks, box, state = still(n)
    forces = [PoissonKicks(rate, **strength), IDLE[1]]
    simulation = Simulation(disks, box, SMOOTH, state, forces=forces, seed=5)
    for t in (0.4, 2.0, 8.0):
        simulation.run(t_end=t)
        v = simulation.state.velocity
        squares, excess = np.mean(v**2, axis=0), 3.0 / (rate * t)
        np.testing.assert_allclose(squares, 0.6 * t, rtol=5.0 * math.sqrt((2.0 + excess) / n))
        error = 10.0 * math.sqrt(24.0 / n) * (1.0 + excess)
        np.testing.assert_allclose(np.mean(v**4, axis=0) / squares**2 - 3.0, excess, atol=error)
        both = np.mean(v[:, 0] ** 2 * v[:, 1] ** 2) / squares.prod() - 1.0
        assert both == pytest.approx(excess / 3.0, abs=error / 3.0)
        # A free gas drifts with a part of 1 / N of the energy, which temperatures do not count.
        found = simulation.measure()
        assert found.temperature == pytest.approx(0.5 * np.sum(np.var(v, axis=0)), rel=1e-10)
        assert simulation.energy_input == pytest.approx(found.translational_energy, rel=1e-10)


def test_spin_kicks_give_the_power_at_times_of_their_own() -> None:
    """I w^2 / 2 of 4000 disks, of kurtosis 3 + 3 / 20, scatters by sqrt(2.15 / 4000) = 2.3 %.

    Kicks of velocities with the same rate are independent of them: neither the numbers nor the times are the same. At
    t = 1/2 a disk has been kicked once on average. With the same numbers v_x and w would be one; with the same times
    v_x^2 and w^2, of variance 5 and covariance 1 in units of a kick's, would correlate by 0.2.
    """
    disks, box, state = still(4000)
    forces = [PoissonKicks(2.0, diffusion=1e-6), PoissonSpinKicks(2.0, power=3e-7)]
    simulation = Simulation(disks, box, SMOOTH, state, forces=forces, seed=2)
    simulation.run(t_end=0.5)
    (v_x, v_y), w = simulation.state.velocity.T, simulation.state.spin
    for one, other in ((v_x, w), (v_y, w), (v_x**2, w**2)):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5.0 / math.sqrt(4000)
    simulation.run(t_end=10.0)
    kicks, spin_kicks = simulation.energy_inputs
    assert spin_kicks / disks.n == pytest.approx(3e-6, rel=0.12)
    assert measure(disks, simulation.state).translational_energy == pytest.approx(kicks, rel=1e-10)


@pytest.mark.full
def test_kicks_and_drag_have_the_steady_state_of_shot_noise() -> None:
    """Campbell's theorem: cumulants of v_x are rate <w^n> times the integral of exp(-n gamma t).

    In steps h of the drag, seen half a step after one: (h / 2) coth(n gamma h / 2) in place of 1 / (n gamma). Of 20,000
    disks at three times, each of which has forgotten the one before: errors as above.
    """
    n, rate, gamma, step = 20_000, 2.0, 0.5, 0.2
    disks, box, state = still(n)
    forces = [PoissonKicks(rate, diffusion=0.3), Drag(step, rate=gamma)]
    simulation = Simulation(disks, box, SMOOTH, state, forces=forces, seed=3)
    variance = 2.0 * 0.3 / rate  # of a kick

    def cumulant(order: int, moment: float) -> float:
        return rate * moment * 0.5 * step / math.tanh(0.5 * order * gamma * step)

    second, fourth = cumulant(2, variance), cumulant(4, 3.0 * variance**2)
    found = []
    for t in (24.0, 36.0, 48.0):
        simulation.run(t_end=t)
        v = simulation.state.velocity
        found.append([np.mean(v**2), np.mean(v**4)])
    squares, fourths = np.mean(found, axis=0)
    assert squares == pytest.approx(second, rel=5.0 * math.sqrt(4.0 / (6 * n)))
    assert fourths / squares**2 - 3.0 == pytest.approx(
        fourth / second**2, abs=10.0 * math.sqrt(24.0 / (6 * n))
    )
    assert fourth / second**2 == pytest.approx(3.0 * gamma / rate, rel=0.01)  # what it tends to without steps


@pytest.mark.full
def test_andersens_thermostat_sets_the_temperature_of_a_lossy_gas() -> None:
    """20 actions on a disk for each of its collisions. 40 frames of 1000 disks, each new: 0.5 % of T; five allowed."""
    gas = gas_of(equal_disks(1000), 0.1, LOSSY, forces=[Andersen(20.0, temperature=1.7)], seed=4)
    found: list[float] = []
    gas.run(t_end=1.0)
    gas.run(t_end=9.0, frames=40, frame_callbacks=[lambda _, m: found.append(m.temperature)])
    # Between actions a disk loses a part of some 1 / 20 of its share of a collision's 12 % of T.
    assert np.mean(found) == pytest.approx(1.7, rel=0.03)
    assert gas.collisions > 1000


# --- exactness ----------------------------------------------------------------------------------------------


@pytest.mark.full
def test_collisions_are_those_of_a_run_that_gets_the_same_kicks_from_outside() -> None:
    """Histories tell each kick; another gas without forces is stopped at each and gets the new velocities."""
    n = 40
    disks = mixture(n)
    box, state = start(disks, 0.4)
    kicked = Simulation(
        disks, box, LOSSY, state, forces=among_all(PoissonKicks(2.0, power=1.0), PoissonSpinKicks(1.0, power=0.5)),
        record=RECORD, histories=range(n), seed=3,
    )  # fmt: skip
    kicked.run(t_end=2.0)
    events = kicked.take_events()
    check_bounds(kicked, events.time, events.id, events.velocity_after)
    kicks = np.flatnonzero(events.partner == KICK)
    assert len(kicks) > 200
    reference = Simulation(disks, box, LOSSY, state)
    for row in kicks:
        reference.run(t_end=events.time[row])
        present, i = reference.state, events.id[row]
        present.velocity[i], present.spin[i] = events.velocity_after[row], events.spin_after[row]
        reference.set_velocities(present.velocity, present.spin)
    reference.run(t_end=2.0)
    end, expected = kicked.state, reference.state
    assert expected.collisions.sum() > 400
    np.testing.assert_array_equal(end.collisions, expected.collisions)
    # Rounding of positions, which 11 collisions of each disk magnify to 1e-9.
    np.testing.assert_allclose(end.position, expected.position, atol=1e-7)
    np.testing.assert_allclose(end.velocity, expected.velocity, atol=1e-6)
    assert kicked.energy_input == pytest.approx(reference.energy_input, rel=1e-9)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_energy_is_balanced_and_numbers_of_collisions_do_not_count_kicks(precision: Any) -> None:
    gas = gas_of(
        mixture(500), 0.3, LOSSY, forces=among_all(PoissonKicks(5.0, power=1.0), Drag(0.1, rate=0.5)), seed=1,
        device=Device(precision=precision), record=RECORD, histories=[0],
    )  # fmt: skip
    begin = gas.measure().energy
    gas.run(t_end=4.0)
    found = gas.measure()
    assert gas.state.collisions.sum() == 2 * gas.collisions > 1000
    lost = float(np.sum(found.dissipated))
    throughput = lost + float(np.abs(gas.energy_inputs).sum())
    rounding = 1e-12 if precision == "f64" else 1e-6
    assert begin + gas.energy_input - lost == pytest.approx(found.energy, abs=rounding * throughput)


def one_followed(disks: Disks) -> Tracking:
    """The histories of disk 0, for an engine: those of a `Simulation` with `histories=[0]`."""
    columns = disks.mass, disks.radius, disks.k, disks.material

    def disks_of(ids: NDArray[np.int32]) -> Disks:
        return Disks(len(ids), *(each[ids] for each in columns))

    return Tracking(np.zeros(1, np.int32), disks.n, disks_of, ((LOSSY,),), ())


def ends(
    forces: list[Any], *, n: int = 3000, t_end: float = 0.5, speed: float = 1.0, **options: Any
) -> dict[str, Any]:
    """End of a gas in one tile and in tiles."""
    disks = mixture(n)
    box, state = start(disks, 0.3)
    state.velocity *= speed
    state.spin *= speed
    found = {}
    for order in ("serial", "tiled"):
        engine = engine_of(
            disks,
            box,
            state,
            np.array([[COIN]]),
            order=order,
            tile_disks=300,
            forces=forces,
            seed=9,
            record=RECORD,
            tracking=one_followed(disks),
            **options,
        )
        found[order] = run_to(engine, t_end), engine.force_steps.energy_inputs
    return found


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    ("forces", "speed"),
    [
        (among_all(PoissonKicks(10.0, power=1.0)), 1.0),
        (among_all(PoissonKicks(10.0, power=3.0)), 0.0),
        (among_all(PoissonKicks(2.0, power=300.0)), 1.0),  # each may be much faster than the gas was
        ([PoissonKicks(4.0, power=1.0), RandomKicks(0.05, power=1.0), PoissonSpinKicks(3.0, power=1.0)], 1.0),
    ],
)
def test_tiles_give_the_same_bits(forces: list[Any], speed: float) -> None:
    found = ends(forces, speed=speed)
    for name in ("position", "velocity", "spin", "collisions"):
        np.testing.assert_array_equal(getattr(found["tiled"][0], name), getattr(found["serial"][0], name))
    np.testing.assert_array_equal(found["tiled"][1], found["serial"][1])
    assert found["serial"][0].collisions.sum() > 500


@pytest.mark.full
@pytest.mark.skipif(backend.cores() < 2, reason="needs two cores")
def test_threads_give_the_same_bits() -> None:
    forces = among_all(PoissonKicks(10.0, power=1.0))
    one, two = (ends(forces, n=6000, t_end=0.3, device=Device(threads=threads)) for threads in (1, 2))
    for order, (end, energy) in one.items():
        np.testing.assert_array_equal(end.velocity, two[order][0].velocity)
        np.testing.assert_array_equal(energy, two[order][1])


def walled(**options: Any) -> Simulation:
    """Disks that fall between walls, one of which moves."""
    disks = mixture(80)
    box = Box((20.0, 20.0), (True, False))
    position = np.stack([np.arange(80) % 10 * 2.0 + 0.7, np.arange(80) // 10 * 2.2 + 1.0], axis=1)
    state = State(position, np.zeros((80, 2)), np.zeros(80))
    gravity: Gravity = (0.0, -1.0)
    return Simulation(disks, box, LOSSY, state, gravity=gravity, seed=2, **options)


@pytest.mark.full
def test_stops_in_a_window_change_no_bit_also_under_gravity_between_walls() -> None:
    options: dict[str, Any] = {
        "forces": [PoissonKicks(3.0, power=2.0)], "walls": [Wall.post((10.0, 18.0), 0.5)], "record": ["ledger"],
    }  # fmt: skip
    whole, parts = walled(**options), walled(**options)
    whole.run(t_end=3.0)
    for stop in (0.1, 0.35, 0.3500001, 1.0, 2.2):
        parts.run(t_end=stop)
    parts.run_for(collisions_per_disk=0.5)
    parts.run(t_end=3.0)
    assert whole.collisions == parts.collisions > 50
    np.testing.assert_array_equal(whole.state.position, parts.state.position)
    np.testing.assert_array_equal(whole.state.velocity, parts.state.velocity)
    np.testing.assert_array_equal(whole.energy_inputs, parts.energy_inputs)
    found = whole.measure()
    lost = float(np.sum(found.dissipated))
    height = np.sum(whole.disks.mass * (whole.state.position[:, 1] - walled(**options).state.position[:, 1]))
    assert found.energy + height == pytest.approx(whole.energy_input - lost, abs=1e-10 * whole.energy_input)


def test_a_restart_in_a_window_changes_no_bit(tmp_path: Path) -> None:
    def make() -> Simulation:
        forces = among_all(PoissonKicks(3.0, power=2.0), Drag(0.08, rate=0.2))
        return gas_of(mixture(200), 0.3, LOSSY, forces=forces, seed=2**40, record=RECORD, histories=[0])

    whole, stopped = make(), make()
    whole.run(t_end=3.0)
    stopped.run(t_end=1.234)
    stopped.save_checkpoint(tmp_path / "in.h5")
    again = Simulation.from_checkpoint(tmp_path / "in.h5", forces=stopped.forces)
    assert repr(again.forces) == repr(stopped.forces)
    again.run(t_end=3.0)
    np.testing.assert_array_equal(whole.state.velocity, again.state.velocity)
    np.testing.assert_array_equal(whole.energy_inputs, again.energy_inputs)


@pytest.mark.full
def test_a_sheared_gas_closes_its_balance_of_energy() -> None:
    disks = equal_disks(400)
    box, state = start(disks, 0.2)
    box = Box(box.lengths, shear_rate=0.4)
    state = State(state.position, state.velocity + box.flow(state.position), state.spin)
    gas = Simulation(
        disks, box, LOSSY, state, forces=[PoissonKicks(6.0, power=1.0)], seed=5, record=["ledger"]
    )
    begin = gas.measure().energy
    gas.run(t_end=3.0)
    found = gas.measure()
    lost = float(np.sum(found.dissipated))
    assert begin + gas.energy_input - lost == pytest.approx(found.energy, abs=1e-10 * lost)
    assert gas.energy_inputs[0] / (disks.n * 3.0) == pytest.approx(1.0, rel=0.2)


def test_one_disk_is_kicked_although_it_meets_none() -> None:
    disks = Disks(1, mass=2.0, radius=0.5)
    state = State([[20.0, 20.0]], np.zeros((1, 2)), np.zeros(1))
    forces = [PoissonKicks(50.0, power=1.0), IDLE[1]]
    gas = Simulation(disks, Box((40.0, 40.0)), SMOOTH, state, forces=forces, seed=1)
    gas.run(t_end=20.0)
    # 1000 kicks: an exponential distribution of the energy
    assert 0.01 < gas.energy_input / 20.0 < 7.0
    assert gas.state.velocity.any()


# --- what is refused ----------------------------------------------------------------------------------------


class WithTotals(PoissonForce):
    """Asks for sums at random times, which there are none of."""

    totals = 1


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: PoissonKicks(0.0, power=1.0), r"rate = 0\.0: must be a positive number"),
        (lambda: PoissonKicks(1.0), "exactly one of power and diffusion"),
        (lambda: PoissonSpinKicks(1.0, power=-1.0), r"power = -1\.0"),
        (lambda: Andersen(1.0, temperture=1.0), "did you mean 'temperature'"),
        (lambda: WithTotals(1.0), "WithTotals: totals = 1: must be 0"),
    ],
)  # fmt: skip
def test_a_force_that_cannot_be_is_refused(make: Any, text: str) -> None:
    with pytest.raises(InputError, match=text):
        make()


def test_custom_ones_are_refused_in_sheared_boxes() -> None:
    disks = equal_disks(100)
    box, state = start(disks, 0.2)
    box = Box(box.lengths, shear_rate=0.4)
    with pytest.raises(InputError, match=r"forces\[0\] = <Andersen: rate 1, temperature 1>: random times"):
        Simulation(disks, box, LOSSY, state, forces=[Andersen(1.0, temperature=1.0)])


@pytest.mark.full
def test_one_that_makes_a_velocity_infinite_stops_the_run() -> None:
    disks, box, state = still(4, mass=1.0 + np.arange(4) % 2)
    forces = among_all(PoissonKicks(1.0, power=1.0), Note(1.0, number=1e50))
    gas = Simulation(disks, box, SMOOTH, state, forces=forces, record=RECORD, histories=[0])
    with pytest.raises(EngineError, match=r"t = 0 to .*: force 4, Note, made a velocity or spin that is not"):
        gas.run(t_end=10.0)
