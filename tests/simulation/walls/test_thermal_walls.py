"""Thermal walls: velocities after a collision, equilibrium, heat, and random numbers that do not depend on tiles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.integrate import cumulative_trapezoid, solve_ivp
from support.gases import COIN, ELASTIC, run_to

from ifrdem import Device
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation import backend
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of

ORDERS = ("serial", "tiled")
LAW = np.array([[ELASTIC]])
ROUGH = np.array(
    [[(1.0, 1.0, 0.0, 0.0, 0.0)]]
)  # perfectly rough, e_t = 1: keeps energy, exchanges it with spins


def lattice(box: Box, n: int, seed: int, temperature: float = 1.0) -> State:
    """Disks on a square lattice well inside of the box, Maxwellian with mass 1; spins with I = 1/8."""
    rng = np.random.default_rng(seed)
    columns = math.ceil(math.sqrt(n * box.lengths[0] / box.lengths[1]))
    i = np.arange(n)
    spacing = np.array([box.lengths[0] / columns, box.lengths[1] / math.ceil(n / columns)])
    position = (np.column_stack((i % columns, i // columns)) + 0.5) * spacing
    velocity = rng.normal(0.0, math.sqrt(temperature), (n, 2))
    return State(position, velocity, rng.normal(0.0, math.sqrt(8.0 * temperature), n))


def between(
    hot: float,
    cold: float,
    box: Box,
    disks: Disks,
    state: State,
    law: NDArray[np.float64] = LAW,
    **options: object,
) -> Engine:
    """Thermal walls at the left and right side of a box that is periodic along y."""
    walls = [
        Wall.line((0.0, 0.0), (1.0, 0.0), temperature=hot),
        Wall.line((box.lengths[0], 0.0), (-1.0, 0.0), temperature=cold),
    ]
    return engine_of(disks, box, state, law, walls=walls, **options)  # type: ignore[arg-type]


def test_disks_leave_with_a_rayleigh_and_two_gaussian_components_in_the_frame_of_the_surface() -> None:
    """10,000 disks of two kinds side by side hit a tilted wall that moves, with a surface that moves along it.

    Both components of the surface's velocity are far from 0. Scaled by their own sqrt(T/m) and sqrt(T/I), all are drawn
    from the same three distributions. Kolmogorov-Smirnov at a level of 0.001 each; the mean square is more sensitive to
    a wrong temperature, at five standard errors.
    """
    n, T = 10_000, 3.0
    heavy = np.arange(n) % 2 == 0
    mass, radius, k = np.where(heavy, 2.0, 0.3), np.where(heavy, 0.5, 0.4), np.where(heavy, 2.0, 1.0)
    disks = Disks(n, mass=mass, radius=radius, k=k)
    angle = 0.3
    normal, tangent = (
        np.array([math.cos(angle), math.sin(angle)]),
        np.array([-math.sin(angle), math.cos(angle)]),
    )
    at = np.array([4000.0, 10.0])
    wall = Wall.line(
        tuple(at), tuple(normal), temperature=T, surface_speed=-0.7,
        motion=Motion("steady", direction=tuple(normal), speed=0.2),
    )  # fmt: skip
    position = at + np.outer(1.2 * np.arange(1, n + 1), tangent) + np.outer(radius + 1.0, normal)
    velocity = np.outer(np.full(n, -0.8), normal) + np.outer(np.full(n, 0.3), tangent)
    box = Box((4100.0, 11_600.0), (False, False))
    engine = engine_of(disks, box, State(position, velocity, np.ones(n)), LAW, walls=[wall], seed=7)
    end = run_to(engine, 1.0005)  # the gap of 1 closes at speed 1
    np.testing.assert_array_equal(end.wall_collisions, 1)
    assert engine.collisions == 0
    off = end.velocity - 0.2 * normal + 0.7 * tangent
    scale = np.sqrt(mass / T)
    drawn = {
        "normal": (scale * (off @ normal), stats.rayleigh, 2.0),
        "tangential": (scale * (off @ tangent), stats.norm, 1.0),
        "spin": (end.spin * np.sqrt(disks.inertia / T), stats.norm, 1.0),
    }
    for name, (values, distribution, mean_square) in drawn.items():
        assert stats.kstest(values, distribution.cdf).pvalue > 1e-3, name
        # Variance of the square: 4 for Rayleigh's, 2 for the normal distribution.
        error = math.sqrt((4.0 if name == "normal" else 2.0) / n)
        assert np.mean(values**2) == pytest.approx(mean_square, abs=5.0 * error), name
    table = np.corrcoef([values for values, _, _ in drawn.values()])
    assert np.abs(table - np.eye(3)).max() < 5.0 / math.sqrt(n)
    v_n = drawn["normal"][0]
    assert abs(np.corrcoef(v_n[1:], v_n[:-1])[0, 1]) < 5.0 / math.sqrt(n)


def furnished(order: str, *, seed: int = 3, law: tuple[float, ...] = COIN, **options: object) -> Engine:
    """A dense enough gas around every shape of wall, thermal or not, some moving, under gravity."""
    box = Box((24.0, 30.0), (False, False))
    state = options.pop("state", None)
    if state is None:
        state = lattice(Box((24.0, 26.0)), 250, seed=1)
        state.position += [0.0, 1.2]
    walls = [
        Wall.line(
            (0.0, 0.3), (0.0, 1.0), motion=Motion("sine", amplitude=0.2, frequency=0.8), temperature=2.0
        ),
        Wall.line((24.0, 0.0), (-1.0, 0.0), temperature=0.5, surface_speed=0.4),
        Wall.segment((5.0, 28.9), (12.0, 28.7), temperature=1.0),
        Wall.post((18.0, 29.2), 0.1),
    ]
    return engine_of(
        Disks(250, mass=1.0, radius=0.5), box, state, np.array([[law]]), order=order, tile_disks=40, walls=walls,
        gravity=(0.0, -0.1), seed=seed, **options,
    )  # fmt: skip


@pytest.mark.full
def test_every_way_of_running_draws_the_same_numbers() -> None:
    """To the last bit. Tiles that were run again drew them again."""
    engines = {order: furnished(order) for order in ORDERS}
    ends = {order: run_to(engine, 3.0) for order, engine in engines.items()}
    assert ends["serial"].wall_collisions.sum() > 40
    for order in ORDERS[1:]:
        for name in ("position", "velocity", "spin", "collisions", "wall_collisions"):
            np.testing.assert_array_equal(getattr(ends[order], name), getattr(ends["serial"], name))
    other = run_to(furnished("serial", seed=4), 3.0)
    assert np.abs(other.velocity - ends["serial"].velocity).max() > 0.1


@pytest.mark.full
@pytest.mark.skipif(backend.cores() < 2, reason="needs two cores")
def test_two_threads_give_the_same_bits() -> None:
    found = []
    for threads in (2, 1):  # another number restarts Taichi, which takes seconds
        engines = [furnished(order, device=Device(threads=threads)) for order in ORDERS]
        ends = [run_to(engine, 4.0) for engine in engines]
        found.append(
            [
                *(engine.wall_heats for engine in engines),
                *(
                    getattr(end, name)
                    for end in ends
                    for name in ("position", "velocity", "spin", "collisions", "wall_collisions")
                ),
            ]
        )
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_run_from_a_stored_state_draws_on() -> None:
    """The numbers of hits and collisions stand in the state; without the hits, other numbers would be drawn."""
    engine = furnished("serial")
    half = run_to(engine, 2.0)
    end = run_to(engine, 3.5)
    again = run_to(furnished("serial", state=half), 3.5)
    np.testing.assert_array_equal(again.wall_collisions, end.wall_collisions)
    np.testing.assert_array_equal(again.collisions, end.collisions)
    np.testing.assert_allclose(again.velocity, end.velocity, atol=1e-6)  # windows begin elsewhere
    forgot = run_to(furnished("serial", state=replace(half, wall_collisions=None)), 3.5)
    assert np.abs(forgot.velocity - end.velocity).max() > 0.1


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(("precision", "error"), [("f64", 1e-11), ("f32", 1e-4)])
def test_heat_and_work_are_what_elastic_disks_gain(precision: str, error: float) -> None:
    engine = furnished("tiled", law=ELASTIC, device=Device(precision=precision))
    begin = measure(engine.disks, engine.state(), gravity=engine.gravity)
    end = measure(
        engine.disks, run_to(engine, 12.0), gravity=engine.gravity, wall_work=engine.wall_work,
        wall_heat=float(engine.wall_heats.sum()),
    )  # fmt: skip
    heats = engine.wall_heats
    assert engine.wall_collisions > 200
    assert abs(engine.wall_work) > 1.0
    assert np.all(np.abs(heats[:3]) > 1.0)
    assert np.all(heats[3:] == 0.0)
    assert end.unspent == pytest.approx(begin.unspent, abs=error * np.abs(heats).sum())


def test_a_rough_gas_between_walls_of_one_temperature_has_it_everywhere() -> None:
    """Rough elastic disks that start at half of it: T and T_rot of the walls, in five strips.

    600 frames, 4 time units apart: most of a crossing time of 20 / sqrt(2). Of 900 disks' two velocity components and
    one spin, each strip has 1e5: errors of 0.3 and 0.4 % if all were independent. The energy of the whole gas changes
    slowly: means over pieces of 20 frames, of two seeds, give an error of 0.2 to 0.3 % of the mean of all.
    """
    box = Box((20.0, 90.0), (False, True))
    n, T = 900, 2.0
    disks = Disks(n, mass=1.0, radius=0.1)
    engine = between(T, T, box, disks, lattice(box, n, 1, T / 2.0), ROUGH)
    run_to(engine, 150.0)
    kinetic, turning, count = np.zeros(5), np.zeros(5), np.zeros(5)
    for frame in range(1, 601):
        state = run_to(engine, 150.0 + 4.0 * frame)
        strip = np.minimum((state.position[:, 0] / 4.0).astype(int), 4)
        count += np.bincount(strip, minlength=5)
        kinetic += np.bincount(strip, 0.5 * np.sum(state.velocity**2, axis=1), minlength=5)
        turning += np.bincount(strip, disks.inertia * state.spin**2, minlength=5)
    assert engine.wall_collisions > 1e5
    np.testing.assert_allclose(kinetic / count, T, rtol=0.015)
    np.testing.assert_allclose(turning / count, T, rtol=0.015)
    assert kinetic.sum() / count.sum() == pytest.approx(T, rel=0.007)
    assert turning.sum() / count.sum() == pytest.approx(T, rel=0.007)


@pytest.mark.full
def test_heat_flows_through_a_gas_without_collisions_as_kinetic_theory_says() -> None:
    """Between walls at T_1 and T_2, a distance L apart, a disk flies to and fro, each way with what it left with.

    The mean of 1/v_n over Rayleigh's distribution is sqrt(pi m / (2 T)), so that a flight to and fro takes
    L sqrt(pi m / 2) (T_1^-1/2 + T_2^-1/2) on average, and carries 3/2 (T_1 - T_2) + (T_1 - T_2) / 2, with the spin's.
    Seen at any time, and everywhere, disks coming from wall i have <m v^2> / 2 = T_i, as many as the flights last:
    T = (T_1^1/2 + T_2^1/2) / (T_1^-1/2 + T_2^-1/2) = sqrt(T_1 T_2).

    The energy of a flight has a variance of 2 T^2 (T^2 from v_n, T^2 / 2 from v_t and the spin): 7000 flights to and
    fro leave an error of 2 % of the heat, and 3000 samples one of 2.6 % of T in each half. Of 50 disks, so small that
    next to none of them meet.
    """
    hot, cold, n = 2.0, 1.0, 50
    disks = Disks(n, mass=1.0, radius=1e-6)
    box = Box((10.0, 10.0), (False, True))
    engine = between(hot, cold, box, disks, lattice(box, n, 1))
    run_to(engine, 100.0)
    heats, energy = engine.wall_heats, measure(disks, engine.state()).energy
    temperature, count = np.zeros(2), np.zeros(2)
    for frame in range(1, 61):
        state = run_to(engine, 100.0 + 50.0 * frame)
        side = (state.position[:, 0] > 5.0).astype(int)
        temperature += np.bincount(side, 0.5 * np.sum(state.velocity**2, axis=1), minlength=2)
        count += np.bincount(side, minlength=2)
    assert engine.collisions < 5
    taken = engine.wall_heats - heats
    cycle = 10.0 * math.sqrt(math.pi / 2.0) * (hot**-0.5 + cold**-0.5)
    assert taken[0] == pytest.approx(1.5e5 / cycle * 2.0 * (hot - cold), rel=0.08)
    # What the hot wall gives the cold one takes, up to what the disk holds.
    assert taken[0] + taken[1] == pytest.approx(measure(disks, state).energy - energy, abs=1e-9 * taken[0])
    np.testing.assert_allclose(temperature / count, math.sqrt(hot * cold), rtol=0.1)


def column_density(
    n: int, width: float, height: float, T: float, g: float, y: NDArray[np.float64]
) -> NDArray:
    """Part of n disks of mass and diameter 1 below each height y in a column under gravity, by the local pressure.

    Hydrostatics, dP/dy = -m g rho, with Henderson's P = rho T Z(phi), Z = (1 + phi^2 / 8) / (1 - phi)^2,
    doi:10.1080/00268977500102511, phi = pi rho / 4: d(ln rho)/dy = -(m g / T) / (Z + phi Z'). To first order in phi,
    Z + phi Z' = 1 + 4 phi: the barometric law with the correction of finite density. Disks touch floor and ceiling
    at 1/2 and height - 1/2.
    """

    def slope(_: float, ln_rho: NDArray[np.float64]) -> NDArray[np.float64]:
        phi = math.pi / 4.0 * np.exp(ln_rho)
        Z = (1.0 + phi * phi / 8.0) / (1.0 - phi) ** 2
        dZ = (phi / 4.0) / (1.0 - phi) ** 2 + 2.0 * Z / (1.0 - phi)
        return -(g / T) / (Z + phi * dZ)

    fine = np.linspace(0.5, height - 0.5, 4001)

    def cumulated(ln_rho_0: float) -> NDArray[np.float64]:
        found = solve_ivp(slope, (0.5, height - 0.5), [ln_rho_0], t_eval=fine, rtol=1e-8).y[0]
        return width * cumulative_trapezoid(np.exp(found), fine, initial=0.0)

    low, high = -20.0, 0.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cumulated(middle)[-1] < n else (low, middle)
    whole = cumulated(low)
    return np.interp(y, fine, whole / whole[-1])


@pytest.mark.full
@pytest.mark.parametrize("floor", ["thermal", "elastic"])
def test_an_elastic_gas_under_gravity_follows_the_barometric_law(floor: str) -> None:
    """Chi-square of 500 disks' heights in 15 strips, 150 frames that are independent, at a level of 0.001.

    Scale height H = T / (m g) = 40 diameters, phi = 0.027 at the floor. Frames are 8 sqrt(H / g) apart.
    An elastic floor keeps the energy instead of T: the start has the mean energy of a column at T, so that its T is
    the same up to 1 / n.
    """
    n, T, g, width, height = 500, 1.0, 0.025, 350.0, 480.0
    box = Box((width, height), (True, False))
    disks = Disks(n, mass=1.0, radius=0.5)
    rng = np.random.default_rng(2)
    i = np.arange(n)
    position = np.column_stack(((i % 60 + 0.5) * width / 60, 5.0 + 8.0 * (i // 60)))
    velocity = rng.normal(0.0, 1.0, (n, 2))
    # The energy of a column at T: n T of velocities, and the mean of m g y.
    y = np.linspace(0.5, height - 0.5, 4001)
    below = column_density(n, width, height, T, g, y)
    mean = float(np.sum(np.diff(below) * 0.5 * (y[1:] + y[:-1])))
    wanted = n * T + n * g * (mean - position[:, 1].mean())
    velocity *= math.sqrt(2.0 * wanted / np.sum(velocity**2))
    walls = [Wall.line((0.0, 0.0), (0.0, 1.0), temperature=T)] if floor == "thermal" else []
    engine = engine_of(
        disks, box, State(position, velocity, np.zeros(n)), LAW, walls=walls, gravity=(0.0, -g), seed=1
    )
    edges = np.interp(np.linspace(0.0, 1.0, 16), below, y)
    edges[0], edges[-1] = 0.0, height
    every = 8.0 * math.sqrt(T / g / g)
    counts = np.zeros(15)
    run_to(engine, 10.0 * every)
    for frame in range(1, 151):
        state = run_to(engine, (10.0 + frame) * every)
        counts += np.histogram(state.position[:, 1], edges)[0]
    expected = np.diff(column_density(n, width, height, T, g, edges)) * counts.sum()
    assert stats.chisquare(counts, expected).pvalue > 1e-3
    # The test is sensitive: it fails without the correction for the finite density, or with T 4 % off.
    plain = np.exp(-np.clip(edges, 0.5, height - 0.5) * g / T)
    ideal = (plain[:-1] - plain[1:]) / (plain[0] - plain[-1]) * counts.sum()
    warmer = np.diff(column_density(n, width, height, 1.04 * T, g, edges)) * counts.sum()
    for wrong in (ideal, warmer):
        assert stats.chisquare(counts, wrong).pvalue < 1e-4


def test_the_simulation_gives_heat_by_wall_and_in_its_measures() -> None:
    box = Box((12.0, 12.0), (False, True))
    disks = Disks(60, mass=1.0, radius=0.5)
    run = Simulation(
        disks, box, IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1), lattice(box, 60, 1),
        walls=[Wall.line((0.0, 0.0), (1.0, 0.0), temperature=2.0), Wall.post((6.0, 0.5), 0.1)], seed=2,
    )  # fmt: skip
    observed = []
    run.run(t_end=20.0, frames=4, frame_callbacks=[lambda _, m: observed.append(m)])
    assert run.wall_heats.shape == (2,)
    assert run.wall_heats[1] == 0.0
    assert observed[-1].wall_heat == run.wall_heat == run.wall_heats[0] > 0.0
    lost = [one.unspent for one in observed]
    assert np.all(np.diff(lost) < 0.0)  # collisions only dissipate


@pytest.mark.parametrize("temperature", [0.0, -1.0, math.nan, math.inf])
def test_a_temperature_that_cannot_be_is_refused(temperature: float) -> None:
    with pytest.raises(InputError, match=r"temperature = .*: must be"):
        Wall.line((0.0, 0.0), (1.0, 0.0), temperature=temperature)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5])
def test_a_seed_that_cannot_be_is_refused(seed: float) -> None:
    box = Box((10.0, 10.0), (False, True))
    with pytest.raises(InputError, match=r"seed = .*: must be"):
        between(1.0, 1.0, box, Disks(4, mass=1.0, radius=0.5), lattice(box, 4, 1), seed=seed)


def test_heat_is_not_taken_for_energy_that_collisions_add() -> None:
    box = Box((20.0, 20.0), periodic=(True, False))
    walls = [
        Wall.line((0.0, 0.0), (0.0, 1.0), temperature=4.0),
        Wall.line((0.0, 20.0), (0.0, -1.0), temperature=4.0),
    ]
    disks = Disks(100, mass=1.0, radius=0.5)
    gas = Simulation(disks, box, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), lattice(box, 100, 1), walls=walls)
    gas.run(t_end=20.0)
    assert gas.wall_heat > 50.0  # from T = 1 towards 4
    assert gas.dissipated_energy == pytest.approx(0.0, abs=1e-9 * gas.wall_heat)
