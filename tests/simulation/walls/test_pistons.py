"""Pistons: closed forms, conservation laws, stops, checkpoints to the bit, refusals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem import Device, Rest
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import Measure
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Piston, Turn
from ifrdem.model.walls.wall import Wall, from_json, to_json
from ifrdem.simulation.simulation import Simulation

ELASTIC = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
ROUGH = IFRLaw(e_n=0.9, e_t=-0.6, mu=0.3, rho=0.01)
BOX = Box((10.0, 20.0), (False, False))


def piston_gas(
    disks: Disks, box: Box, law: IFRLaw, state: State, walls: list[Wall], **options: Any
) -> Simulation:
    """With all that one of the tests records, so that they share kernels."""
    recorded = {"record": ["dissipated", "wall_sums"]}
    return Simulation(disks, box, law, state, walls=walls, **(recorded | options))


def piston_wall(height: float = 12.0, **options: Any) -> Wall:
    """A line with the disks below it."""
    return Wall.line((0.0, height), (0.0, -1.0), piston=Piston(**options))


def under_pistons(law: IFRLaw, walls: list[Wall], n: int = 30, **options: Any) -> Simulation:
    disks = Disks(n, mass=1.0, radius=0.5)
    position = ifrdem.initial.random_positions(BOX, disks.radius, seed=1, walls=walls)
    velocity = ifrdem.initial.maxwellian(disks.mass, speed_rms=1.4, seed=2)
    state = State(position, velocity, np.random.default_rng(3).normal(size=n))
    return piston_gas(disks, BOX, law, state, walls, **options)


def whole_energy(simulation: Simulation) -> float:
    """Energy of disks and pistons, kinetic and potential."""
    found = simulation.measure()
    assert found.pistons is not None
    return found.energy + found.potential_energy + float(found.pistons[:, 2].sum())


@pytest.mark.full
@pytest.mark.parametrize(("ratio", "count"), [(1.0, 3), (100.0, 31), (1e4, 314), (1e6, 3141)])
def test_a_piston_on_one_disk_makes_as_many_hits_as_digits_of_pi(ratio: float, count: int) -> None:
    # A block of mass M comes upon a ball of mass m at rest before a wall, all elastic. In the plane of sqrt(m) y and
    # sqrt(M) s the path is a straight line in a wedge of the angle atan(sqrt(m/M)), which it leaves after as many
    # reflections as that angle fits into pi: floor(pi sqrt(M/m)) for powers of 100. G. Galperin, Regul. Chaotic Dyn. 8,
    # 375 (2003), doi:10.1070/RD2003v008n04ABEH000252.
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[5.0, 4.0]], np.zeros((1, 2)), np.zeros(1))
    piston = piston_wall(6.0, mass=ratio, velocity=1.0)
    box = Box((10.0, 1000.0), (False, False))  # which the piston leaves later
    simulation = piston_gas(disks, box, ELASTIC, start, [piston])
    simulation.run(t_end=500.0)
    assert simulation.wall_collisions == count
    # All energy was the piston's, and it keeps all of it but what is left to the disk.
    assert whole_energy(simulation) == pytest.approx(0.5 * ratio, rel=1e-12)  # 1e4 roundings of 1e-16


def test_the_recoil_of_an_oblique_piston_is_along_its_normal() -> None:
    """Impulse along n = (1, 3) / sqrt(10): a disk of mass 1 comes with -3 / sqrt(10), a piston of mass 3 with 1/2.

    The elastic impulse 2 (3 / 4) (1/2 + 3 / sqrt(10)) takes a third of that from its speed. Of pistons along an
    axis one component of the surface's velocity is 0.
    """
    disks, n = Disks(1, mass=1.0, radius=0.5), np.array([1.0, 3.0]) / math.sqrt(10.0)
    start = State(np.array([[5.0, 8.0]]) + 2.0 * n, [[-0.3, -0.9]], np.zeros(1))
    piston = Wall.line((5.0, 8.0), (1.0, 3.0), piston=Piston(mass=3.0, velocity=0.5))
    simulation = piston_gas(disks, BOX, ELASTIC, start, [piston])
    simulation.run(t_end=1.5)  # the gap of 1.5 closes at 1.04
    assert simulation.wall_collisions == 1
    impulse = 1.5 * (0.5 + 0.3 * math.sqrt(10.0))
    assert simulation.pistons[0, 1] == pytest.approx(0.5 - impulse / 3.0, abs=1e-14)  # -.22434
    np.testing.assert_allclose(simulation.state.velocity[0], [-0.3, -0.9] + impulse * n, atol=1e-14)


@pytest.mark.full
def test_momentum_and_energy_hold_over_a_hundred_thousand_hits() -> None:
    simulation = under_pistons(ELASTIC, [piston_wall(mass=3.0, force=6.0)], n=8)
    before = whole_energy(simulation)
    simulation.run(t_end=75_000.0, progress=False)
    s, speed, *_ = simulation.pistons[0]
    of_piston = simulation.wall_sums.values[0]
    assert of_piston[5] > 1e5
    # Energy: at most 1e-16 for each of 4e5 collisions, all of one sign.
    assert whole_energy(simulation) == pytest.approx(before, rel=4e-11)
    # Momentum along the normal, (0, -1): M v = F t - what it gave to the disks, of 1e5 hits of some 4 each.
    given = -of_piston[1]
    assert 3.0 * speed == pytest.approx(6.0 * simulation.time - given, abs=1e-6)
    # Its work is what its own energy has lost, F s included.
    assert of_piston[3] == pytest.approx(-simulation.pistons[0, 2], abs=1e-8)
    assert abs(s) < 8.0


@pytest.mark.full
@pytest.mark.parametrize("stop", [None, -5.0])
def test_a_soft_spring_is_as_good_as_none(stop: float | None) -> None:
    # The middle of the oscillation is at force / spring, up to 1e16 box heights away; in t = 10 the spring changes
    # displacements of 15 by 15 spring t^2 / M: below 1e-9 for 1e-12.
    found = []
    for spring in (0.0, 1e-16, 1e-12):
        simulation = under_pistons(ELASTIC, [piston_wall(mass=2.0, force=1.0, spring=spring, low=stop)], n=5)
        before = whole_energy(simulation)
        simulation.run(t_end=3.0)
        assert whole_energy(simulation) == pytest.approx(before, rel=1e-13)
        found.append(simulation.pistons[0, :2])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-7)


@pytest.mark.full
def test_two_pistons_under_friction_lose_what_the_ledger_says() -> None:
    walls = [
        piston_wall(mass=4.0, force=3.0, spring=0.5),
        Wall.line((0.5, 0.0), (1.0, 0.0), piston=Piston(mass=8.0, spring=3.0, low=-0.4)),
    ]
    simulation = under_pistons(ROUGH, walls, gravity=(0.0, -0.2))
    before = whole_energy(simulation)
    simulation.run(t_end=12.0, progress=False)
    measured = simulation.measure()
    assert measured.dissipated is not None
    assert measured.dissipated[5] > 1.0  # at walls
    assert whole_energy(simulation) + measured.dissipated.sum() == pytest.approx(before, rel=1e-12)
    # What walls did to the disks is what the pistons lost; the other walls are at rest.
    assert simulation.wall_work == pytest.approx(-simulation.pistons[:, 2].sum(), rel=1e-12)
    assert simulation.dissipated_energy == pytest.approx(measured.dissipated.sum(), rel=1e-10)


@pytest.mark.full
def test_the_mean_height_of_a_piston_on_one_disk_is_that_of_the_virial() -> None:
    # h = height of the piston above the disk's lowest place, less the disk's highest: with y' in [0, h],
    # d/dt (m y' v_y + M h V) = m v_y^2 + M V^2 - F h, as the forces of floor and contact work out to 0 and cancel. It
    # is bounded, so that <m v_y^2 + M V^2> = F <h>; with E = (m v_y^2 + M V^2)/2 + F h, <h> = 2 E / 3 F.
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[5.0, 2.0]], [[0.3, 1.1]], np.zeros(1))
    simulation = piston_gas(disks, BOX, ELASTIC, start, [piston_wall(5.0, mass=1.618, force=0.5)])
    energy = 0.5 * 1.1**2 + 0.5 * (5.0 - 1.0)
    heights: list[float] = []

    def look(measured: Measure) -> None:
        assert measured.pistons is not None
        heights.append(5.0 - float(measured.pistons[0, 0]) - 1.0)

    simulation.run(t_end=3000 * 7.3, series=3000, series_callbacks=[look], progress=False)
    assert len(heights) == 3001
    # Scatter of h about 0.7 <h>; some 3000 values, correlated over a few: 0.7 / sqrt(600) = 3 %.
    assert np.mean(heights) == pytest.approx(2.0 * energy / (3.0 * 0.5), rel=0.06)


def test_a_piston_bounces_between_its_stops_and_rests_where_it_is_pressed() -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[5.0, 1.0]], np.zeros((1, 2)), np.zeros(1))

    def at(t: float, **options: Any) -> np.ndarray:
        simulation = piston_gas(disks, BOX, ELASTIC, start, [piston_wall(mass=2.0, **options)])
        simulation.run(t_end=t)
        return simulation.pistons[0]

    # Freely: 3.5 of way at a speed of 1 between 0 and 0.5: seven times there and back, less none.
    np.testing.assert_allclose(at(3.4, velocity=1.0, low=0.0, high=0.5)[:2], (0.4, 1.0), atol=1e-14)
    # From rest against a = 2: 0.25 = t^2 until the stop after t = 0.5, and back; a period of 1.
    np.testing.assert_allclose(at(7.25, force=4.0, high=0.25)[:2], (0.0625, 0.5), atol=1e-13)
    # Thrown from 0.25 at 0.5 against a = -1: at the stop at 0 with a speed v of v^2 = 0.5^2 + 0.5, after 0.5 + v.
    v = math.sqrt(0.75)
    found = at(1.5 + v, displacement=0.25, velocity=0.5, force=-2.0, low=0.0)[:2]
    np.testing.assert_allclose(found, (v - 0.5, v - 1.0), atol=1e-13)
    # A spring with period 2 pi, relaxed at 0, a stop there too: it takes half as long.
    found = at(10.0 * math.pi + 0.3, spring=2.0, displacement=0.5, low=0.0)[:2]
    np.testing.assert_allclose(found, (0.5 * math.cos(0.3), -0.5 * math.sin(0.3)), atol=1e-13)
    np.testing.assert_array_equal(at(50.0, force=-3.0, low=0.0), (0.0, 0.0, 0.0, -3.0))
    # So near to its stop that its fall of 1e-14 is none.
    np.testing.assert_array_equal(at(50.0, displacement=1e-14, force=-3.0, low=0.0)[:2], (0.0, 0.0))


@pytest.mark.parametrize("spring", [0.0, 1e-12, 1e-3])
def test_a_piston_at_its_stop_that_is_hit_from_inside_returns_at_once(spring: float) -> None:
    """m = 1 at speed 1 onto M = 2 at rest: -1/3 and 2/3 outwards, which the stop turns; both move inwards, the piston
    faster: they meet at once again, and leave at 7/9 and 4/9. A spring that is relaxed there has done no work yet.
    """
    start = State([[5.0, 10.0]], [[0.0, 1.0]], np.zeros(1))
    wall = piston_wall(mass=2.0, low=0.0, spring=spring)  # the gap of 1.5 takes as long
    simulation = piston_gas(Disks(1, mass=1.0, radius=0.5), BOX, ELASTIC, start, [wall])
    simulation.run(t_end=1.5 + 1e-3)
    assert simulation.wall_collisions == 2
    np.testing.assert_allclose(simulation.state.velocity, [[0.0, -7.0 / 9.0]], atol=1e-12)
    # A spring of 1e-3 takes k s dt / M = 1e-3 * 4e-4 * 1e-3 / 2 of the speed in that time.
    np.testing.assert_allclose(simulation.pistons[0, :2], (4e-3 / 9.0, 4.0 / 9.0), rtol=1e-9)


def test_gravity_pulls_the_piston_too() -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[5.0, 1.0]], np.zeros((1, 2)), np.zeros(1))
    simulation = piston_gas(
        disks, BOX, ELASTIC, start, [piston_wall(mass=2.0, force=3.0)], gravity=(0.3, -1.0)
    )
    simulation.run(t_end=0.5)
    # Down along its normal with 1 + 3/2.
    np.testing.assert_allclose(simulation.pistons[0, :2], (0.5 * 2.5 * 0.25, 1.25), rtol=1e-14)


@pytest.mark.parametrize("cut", [3.7, 8.000001])
def test_a_run_resumes_from_a_checkpoint_to_the_bit(tmp_path: Path, cut: float) -> None:
    walls = [piston_wall(mass=4.0, force=3.0, spring=0.5, low=-1.0, high=1.0)]
    whole, first, second = (under_pistons(ROUGH, walls, gravity=(0.0, -0.2)) for _ in range(3))
    whole.run(t_end=15.0, frames=7)
    first.run(t_end=cut)
    first.save_checkpoint(tmp_path / "one.ckpt")
    second.load_checkpoint(tmp_path / "one.ckpt")
    np.testing.assert_array_equal(second.pistons, first.pistons)
    second.run(t_end=15.0, series=11, series_callbacks=[lambda measure: None])
    np.testing.assert_array_equal(whole.pistons, second.pistons)
    assert whole.pistons[0, 0] != first.pistons[0, 0]
    for name in ("position", "velocity", "spin"):
        np.testing.assert_array_equal(getattr(whole.state, name), getattr(second.state, name))
    np.testing.assert_array_equal(whole.wall_sums.values, second.wall_sums.values)


def test_a_run_that_jumps_by_collisions_has_the_same_bits() -> None:
    one, other = (under_pistons(ROUGH, [piston_wall(mass=4.0, force=3.0)]) for _ in range(2))
    for count in (7, 30, 31, 100):
        one.collide(count)
    other.run(t_end=one.time)
    np.testing.assert_allclose(one.pistons, other.pistons, rtol=1e-13)  # the time itself is rounded
    for each in (one, other):
        each.run(t_end=20.0)
    np.testing.assert_array_equal(one.pistons, other.pistons)
    np.testing.assert_array_equal(one.state.position, other.state.position)


def test_another_force_acts_from_a_time_on() -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[5.0, 1.0]], np.zeros((1, 2)), np.zeros(1))
    simulation = piston_gas(disks, BOX, ELASTIC, start, [piston_wall(mass=2.0, force=3.0)])
    simulation.run(t_end=1.0)
    simulation.set_piston_force(0, -1.0)
    simulation.run(t_end=3.0)
    # s = a t^2 / 2 and v = a t with a = 3/2 for t = 1, then with -1/2 for 2.
    np.testing.assert_allclose(simulation.pistons[0], (0.75 + 3.0 - 1.0, 0.5, 0.25 + 2.75, -1.0), rtol=1e-13)
    assert simulation.walls[0].piston == Piston(mass=2.0, force=-1.0)
    for wall, needed in ((1, "the number of a piston; there are: 0"), (-1, "an integer from 0")):
        with pytest.raises(InputError, match=f"wall = {wall}: must be {needed}"):
            simulation.set_piston_force(wall, 1.0)
    with pytest.raises(InputError, match="force = nan: must be"):
        simulation.set_piston_force(0, math.nan)


def test_walls_with_pistons_come_back_from_their_text() -> None:
    walls = (piston_wall(mass=2.0, force=1.0, high=0.5), Wall.post((1.0, 1.0), 0.1))
    assert from_json(to_json(walls)) == walls


SEGMENT = Wall.segment((0.0, 5.0), (10.0, 5.0))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Piston(mass=0.0), r"mass = 0\.0: must be"),
        (lambda: Piston(mass=-1.0), r"mass = -1\.0: must be"),
        (lambda: Piston(mass=math.inf), r"mass = inf: must be"),
        (
            lambda: Piston(mass=1.0, spring=-2.0),
            r"spring = -2\.0: must be",
        ),
        (
            lambda: Piston(mass=1.0, force=math.nan),
            r"force = nan: must be a finite number, at most 1e\+50 in size",
        ),
        (lambda: Piston(mass=1.0, low=1.0, high=0.5), "low must be below high"),
        (lambda: Piston(mass=1.0, low=0.1), "displacement = 0: it must not be below low, 0.1"),
        (lambda: Wall.post((1.0, 1.0), 0.5, piston=Piston(1.0)), "only a line or a segment"),
        (lambda: Wall.line((0, 1), (0, 1), piston=1.0), "piston = 1.0: must be a Piston"),  # type: ignore[arg-type]
        (lambda: piston_wall_with(motion=Motion("steady", speed=1.0)), "leave out motion"),
        (lambda: piston_wall_with(temperature=1.0), "leave out temperature"),
        (lambda: piston_wall_with(opens_at=1.0), "leave out opens_at"),
        (lambda: piston_wall_with(moves_from=1.0), "leave out moves_from"),
        (
            lambda: Wall.segment((0, 1), (10, 1), turn=Turn("steady", rate=1.0), piston=Piston(1.0)),
            "leave out turn",
        ),
    ],
)
def test_an_invalid_piston_is_refused(make: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


def piston_wall_with(**options: Any) -> Wall:
    return Wall.line((0.0, 12.0), (0.0, -1.0), piston=Piston(1.0), **options)


@pytest.mark.parametrize(
    ("wall", "options", "says"),
    [
        (Wall.segment((0.0, 5.0), (9.0, 5.0), piston=Piston(1.0)), {}, "from side to side of the box"),
        (Wall.segment((0.0, 5.0), (10.0, 6.0), piston=Piston(1.0)), {}, "from side to side of the box"),
        (
            piston_wall(mass=1.0),
            {"device": Device(precision="f32")},
            r'walls\[0\]\.piston: cannot be combined with device\.precision = "f32"',
        ),
        (
            piston_wall(mass=1.0),
            {"collapse": Rest(1e-3), "gravity": (0.0, -1.0)},
            r"piston: cannot be combined with collapse = Rest\(speed=0\.001\)",
        ),
    ],
)
def test_a_piston_where_it_cannot_be_is_refused(wall: Wall, options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        under_pistons(ELASTIC, [wall], n=3, **options)


def test_a_piston_through_a_periodic_side_is_refused() -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[5.0, 1.0]], np.zeros((1, 2)), np.zeros(1))
    wall = Wall.segment((0.0, 5.0), (10.0, 5.0), piston=Piston(1.0))
    with pytest.raises(InputError, match="as a piston it would leave through a periodic side"):
        Simulation(disks, Box((10.0, 10.0), (False, True)), ELASTIC, start, walls=[wall])
