"""The energy ledger: losses by mechanism add up to the missing energy, in every kind of gas."""

from __future__ import annotations

import numpy as np
import pytest
from support import gases
from support.gases import equal_disks, gas_of, mixture, run_to, start
from support.law_examples import Driving, Weak

from ifrdem import Device, VelocityCutoff
from ifrdem.errors import EngineError, InputError
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, RandomKicks
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import IFRLaw, Regime
from ifrdem.model.observables import Measure
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.quantities import MECHANISMS, REGIMES
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.steps.schedule import Trigger
from ifrdem.validation.rows import engine_of

ROLLING = IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15, sticking="contact_point", rho=0.02)
COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)


def residual(first: Measure, last: Measure) -> float:
    """Relative residual of the ledger."""
    assert last.dissipated is not None
    turned = first.energy + abs(last.energy_input) + abs(last.wall_work) + abs(last.wall_heat)
    return (first.unspent - last.unspent - float(last.dissipated.sum())) / turned


def test_each_mechanism_takes_what_one_collision_shows(device):
    """One pair, slowly approaching and with spins, against the law's own numbers.

    P_n takes P_n (g_n - P_n / 2 m_n), and so on; the pieces are computed here from `law.collide`, which the engine does
    not use, and the known slip: m_n = 1/2, m_t = 1/6 for two disks of mass 1 and k = 2.
    """
    disks = Disks(2, mass=1.0, radius=0.5)
    v, w = np.array([[1.0, 0.3], [-0.5, 0.0]]), np.array([0.8, -0.1])
    position = np.array([[4.0, 5.0], [6.0, 5.3 - 0.3]])
    simulation = Simulation(
        disks, Box((10.0, 10.0)), ROLLING, State(position, v, w), device=device, record=["ledger"]
    )
    simulation.run(t_end=2.0)
    assert simulation.collisions == 1
    contact = simulation.measure()
    # The collision's normal: from where they touched, by the time at which |r| = 1.
    r, u = position[0] - position[1], v[0] - v[1]
    b, c = r @ u, r @ r - 1.0
    t = c / (-b + np.sqrt(b * b - u @ u * c))
    n = -(r + u * t)
    after = collide(ROLLING, n / np.hypot(*n), [1.0, 1.0], [0.5, 0.5], [2.0, 2.0], v, w)
    n = n / np.hypot(*n)
    g_n, g_t = u @ n, (u[1] * n[0] - u[0] * n[1]) + 0.5 * (w[0] + w[1])
    P_n, P_t = float(after.P_n), float(after.P_t)
    P_et = 0.1 / 6.0 * g_t  # (1 + e_t) m_t g_t
    normal = P_n * (g_n - P_n)  # m_n = 1/2
    restitution = P_et * (g_t - 3.0 * P_et)  # m_t = 1/6
    friction = P_t * (g_t - 3.0 * P_t) - restitution
    total = 0.5 * (np.sum(v**2) + 0.125 * np.sum(w**2)) - 0.5 * (
        np.sum(after.velocity**2) + 0.125 * np.sum(after.spin**2)
    )
    expected = dict.fromkeys(MECHANISMS, 0.0) | {
        "normal": normal, "tangential_restitution": restitution, "rolling": total - normal - restitution - friction,
    }  # fmt: skip
    sticks = int(after.regime) in (Regime.STICKING_ROLLING, Regime.STICKING_NONROLLING)
    expected["sticking" if sticks else "sliding"] = friction
    assert expected["rolling"] > 0.0
    assert contact.dissipated == pytest.approx(np.array(list(expected.values())), rel=1e-12, abs=1e-15)


def test_collisions_are_counted_by_their_regime(device):
    """Pairs of two materials that meet head on with spins s, so that the slip is s: what each is, `law.collide` says.

    The last pair is slower than the cut-off, below which collisions are elastic.
    """
    spins = [0.1, 5.0, 0.1, 0.5, 5.0, 0.1]
    material = np.repeat([0, 0, 1, 1, 1, 0], 2)
    speed = np.repeat([0.5, 0.5, 0.5, 0.5, 0.5, 1e-3], 2) * np.tile([1.0, -1.0], 6)
    disks = Disks(12, mass=1.0, radius=0.5, material=material)
    place = np.column_stack((np.tile([4.5, 5.51], 6), np.repeat(2.0 + 3.0 * np.arange(6), 2)))
    velocity = np.column_stack((speed, np.zeros(12)))
    smooth = IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15, sticking="contact_point")
    laws = [[smooth, smooth], [smooth, ROLLING]]
    expected = dict.fromkeys(REGIMES, 0)
    for pair in range(5):
        law, two = laws[material[2 * pair]][material[2 * pair]], slice(2 * pair, 2 * pair + 2)
        found = collide(
            law, [1.0, 0.0], [1.0, 1.0], [0.5, 0.5], [2.0, 2.0], velocity[two], np.full(2, spins[pair])
        )
        name = Regime(int(found.regime)).name.lower().removesuffix("_nonrolling")
        expected["_".join(reversed(name.split("_")))] += 1
    expected["elastic"] += 1
    assert all(expected.values())
    simulation = Simulation(
        disks, Box((10.0, 20.0)), laws, State(place, velocity, np.repeat(spins, 2)), device=device, record=["ledger"],
        collapse=VelocityCutoff(0.01),
    )  # fmt: skip
    simulation.collide(6)
    assert dict(zip(REGIMES, simulation.measure().regimes.tolist(), strict=True)) == expected


def test_the_ledger_closes_where_spins_hold_nearly_all_energy(device):
    """10^12 times that of flights: sums of small losses must not be lost next to the large one."""
    disks = equal_disks(300)
    box, state = start(disks, 0.3)
    state.spin[::2] *= 1e6
    measures: list[Measure] = []
    simulation = Simulation(disks, box, COIN, state, device=device, record=["ledger"])
    simulation.run(collisions_per_disk=2.0, series=2, series_callbacks=[measures.append])
    assert measures[-1].dissipated.sum() > 0.1 * measures[0].energy
    assert abs(residual(measures[0], measures[-1])) < 1e-13


@pytest.mark.parametrize(
    ("masses", "law"), [("one heavy", COIN), ("all scales", COIN), ("all scales", ROLLING)]
)
def test_the_ledger_closes_where_heavy_disks_are_slow_among_light_ones(device, masses, law):
    """At one temperature, so that energies are alike where masses differ by 1e6 and 1e12."""
    mass = np.ones(300) if masses == "one heavy" else 10.0 ** np.linspace(-6.0, 6.0, 300)
    mass[0] = 1e6
    disks = Disks(300, mass=mass, radius=0.5)
    box, state = start(disks, 0.3)
    state.spin[:] = 0.0
    measures: list[Measure] = []
    simulation = Simulation(disks, box, law, state, device=device, record=["ledger"])
    simulation.run(collisions_per_disk=5.0, series=3, series_callbacks=[measures.append])
    assert measures[-1].dissipated.sum() > 0.1 * measures[0].energy
    assert max(abs(residual(measures[0], each)) for each in measures) < 1e-12


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::ifrdem.model.laws.ifr.EnergyWarning")
@pytest.mark.parametrize(("part", "speed"), [(3e7, 1.0), (1e16, 1e135)])
def test_losses_beyond_all_energy_are_counted_and_such_a_gas_is_refused(device, part, speed):
    """A law that hands out 3e7 times the impulse and more. g_n = 2 and m_n = 1/2: P_n = part takes P_n (2 - P_n)."""
    disks = Disks(2, mass=1.0, radius=0.5)
    state = State(
        np.array([[4.0, 5.0], [6.0, 5.0]]), speed * np.array([[1.0, 0.0], [-1.0, 0.0]]), np.zeros(2)
    )
    simulation = Simulation(
        disks, Box((10.0, 10.0)), Weak(part=part), state, device=device, record=["ledger"]
    )
    simulation.collide(1)
    lost = part * (2.0 - part) * speed**2
    assert simulation.measure().dissipated.sum() == pytest.approx(lost, rel=1e-14)
    if speed > 1.0:
        with pytest.raises(EngineError, match="an energy beyond all bounds"):
            simulation.run(t_end=simulation.time + 1.0)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::ifrdem.model.laws.ifr.EnergyWarning")
def test_the_ledger_closes_where_a_law_drives_spins(device):
    """A negative T gives spins energy: a loss below 0."""
    measures: list[Measure] = []
    simulation = gas_of(300, 0.3, Driving(), device=device, record=["ledger"])
    simulation.run(collisions_per_disk=3.0, series=3, series_callbacks=[measures.append])
    assert measures[-1].dissipated[MECHANISMS.index("rolling")] < -1e-3
    assert abs(residual(measures[0], measures[-1])) < 1e-13


@pytest.mark.parametrize("n", [300, 2000])
@pytest.mark.parametrize("law", [ROLLING, COIN])
def test_the_ledger_closes_in_a_cooling_gas(device, n, law):
    measures: list[Measure] = []
    simulation = gas_of(mixture(n), 0.3, law, device=device, record=["ledger"])
    simulation.run(collisions_per_disk=5.0, series=5, series_callbacks=[measures.append])
    assert measures[-1].dissipated[0] > 0.0
    assert measures[-1].regimes.sum() == simulation.collisions
    # Sums of some 5e3 rounded numbers.
    assert max(abs(residual(measures[0], each)) for each in measures) < 1e-13


@pytest.mark.full
def test_the_ledger_closes_between_walls_that_shake_and_heat_under_gravity(device):
    disks = mixture(150)
    box = Box((20.0, 40.0), periodic=(False, False))
    _, state = start(disks, 0.2)
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(12), np.arange(13)), axis=-1).reshape(-1, 2)[:150] * 1.4 + 2.0
    state = State(grid, rng.normal(size=(150, 2)), rng.normal(size=150))
    walls = [
        Wall.line((0.0, 0.5), (0.0, 1.0), motion=Motion("sine", amplitude=0.3, frequency=2.0)),
        Wall.line((0.0, 19.4), (0.0, -1.0), temperature=2.0),
    ]
    measures: list[Measure] = []
    simulation = Simulation(
        disks, box, COIN, state, device=device, walls=walls, gravity=(0.0, -1.0), record=["ledger"],
        collapse=VelocityCutoff(1e-3),
    )  # fmt: skip
    simulation.run(t_end=6.0, series=3, series_callbacks=[measures.append])
    last = measures[-1]
    assert last.dissipated[MECHANISMS.index("walls")] > 0.0
    assert last.wall_heat != 0.0
    assert abs(residual(measures[0], last)) < 1e-12


@pytest.mark.full(keep=1)
def test_the_ledger_closes_with_forces_and_in_a_sheared_gas(device):
    disks, forces = equal_disks(400), [RandomKicks(0.05, power=0.5), Drag(0.05, rate=0.1)]
    driven = gas_of(disks, 0.3, COIN, device=device, record=["ledger"], forces=forces)
    box, state = gases.sheared(disks, 0.3, rate=0.5)
    sheared = Simulation(disks, box, COIN, state, device=device, record=["ledger"])
    for simulation in (driven, sheared):
        measures: list[Measure] = []
        simulation.run(t_end=2.0, series=4, series_callbacks=[measures.append])
        assert measures[-1].energy_input != 0.0
        assert abs(residual(measures[0], measures[-1])) < 1e-12


@pytest.mark.full
def test_the_ledger_has_the_same_bits_for_any_number_of_threads():
    """Sums of tiles are added in the order of tiles; one tile adds in the order of events, off by rounding."""
    disks = mixture(3000)
    box, state = start(disks, 0.4)
    found = []
    for threads, order in ((2, "tiled"), (1, "tiled"), (1, "serial")):
        engine = engine_of(
            disks,
            box,
            state,
            np.array([[gases.COIN]]),
            record=["ledger"],
            device=Device(threads=threads),
            order=order,
            tile_disks=500,
        )
        run_to(engine, collisions=1500)
        found.append(engine.dissipated())
    (two, counts), (one, counts_of_one), (alone, counts_alone) = found
    assert counts.sum() == 1500
    assert np.array_equal(one, two)
    assert alone == pytest.approx(one, rel=1e-12)
    assert np.array_equal(counts_of_one, counts)
    assert np.array_equal(counts_alone, counts)


def test_series_at_the_ends_of_windows_change_nothing(device):
    ends, rows = [], []
    for series in (None, Trigger(number=200, exact=False)):
        simulation = gas_of(600, 0.5, COIN, device=device, record=["ledger"])
        simulation.run(collisions_per_disk=40.0, series=series, series_callbacks=[rows.append])
        ends.append(simulation.state)
    assert len(rows) > 5
    assert np.array_equal(ends[0].position, ends[1].position)
    assert np.array_equal(ends[0].velocity, ends[1].velocity)


def test_exact_series_have_rows_where_they_are_due(device):
    rows: list[Measure] = []
    simulation = gas_of(50, 0.3, COIN, device=device)
    simulation.run(t_end=1.0, series=40, series_callbacks=[rows.append])
    assert [row.time for row in rows] == pytest.approx(np.linspace(0.0, 1.0, 41), abs=1e-15)
    assert rows[0].dissipated is None  # no ledger was requested
    simulation.run(t_end=1.1, series=3)  # without callbacks it ends as well
    assert simulation.time == 1.1


def test_totals_on_the_device_are_those_of_the_state(device):
    disks = Disks(
        300, mass=np.where(np.arange(300) == 7, np.inf, 2.0), radius=0.4, k=np.linspace(1.0, 2.0, 300)
    )
    box, state = start(equal_disks(300), 0.3)
    state.velocity[7], state.spin[7] = 0.0, 0.0
    simulation = Simulation(disks, box, COIN, state, device=device, record=["ledger"])
    observed: list[Measure] = []
    simulation.run(
        collisions_per_disk=2.0, frame_callbacks=[lambda _state, measure: observed.append(measure)]
    )
    device, host = simulation.measure(), observed[-1]
    for name in (
        "time", "collisions", "translational_energy", "rotational_energy", "temperature", "rotational_temperature",
        "momentum", "momentum_flux", "potential_energy", "wall_collisions", "energy_input",
    ):  # fmt: skip
        assert getattr(device, name) == pytest.approx(getattr(host, name), rel=1e-12, abs=1e-11), name


def test_a_ledger_that_is_switched_off_misses_just_that_time(device):
    """Switched on again, it continues; the collisions are the same to the bit."""
    whole, parts = (gas_of(300, 0.4, COIN, device=device, record=["ledger"]) for _ in range(2))
    expected = np.zeros(len(MECHANISMS))
    for k, on in enumerate([True, False, True]):
        parts.switch_ledger(on)
        before = whole.measure().dissipated
        for simulation in (whole, parts):
            simulation.run(t_end=0.3 * (k + 1))
        gained = whole.measure().dissipated - before
        assert gained.sum() > 1.0
        expected += gained if on else 0.0
    assert parts.measure().dissipated == pytest.approx(expected, rel=1e-12)
    assert np.array_equal(whole.state.velocity, parts.state.velocity)


def test_a_simulation_without_a_ledger_has_none_to_switch(device):
    simulation = gas_of(10, 0.4, COIN, device=device)
    with pytest.raises(InputError, match="the ledger is not recorded"):
        simulation.switch_ledger(True)
