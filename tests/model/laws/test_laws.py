"""Laws by name: Walton's, viscoelastic spheres, rough and smooth disks, in one collision, in gases and in theory."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ifrdem
from ifrdem import InputError, laws, theory
from ifrdem.model.custom_code import FromKernels
from ifrdem.model.laws import records
from ifrdem.theory import collisions

VISCOELASTIC = laws.Viscoelastic.of_restitution(0.9, g_n=1.0, mass=1.0, radius=0.5, e_t=-0.9, mu=0.2)
WALTON = laws.Walton(e_n=0.9, beta_0=0.4, mu=0.2)
VISCOELASTIC_WALTON = laws.Viscoelastic(
    A=VISCOELASTIC.A, Y=VISCOELASTIC.Y, mu=0.2, friction="walton", beta_0=0.4
)  # of the kernels of VISCOELASTIC
TABLE = laws.TableLaw(slip=[0.2, 0.5, 0.9], ratio=[0.06, 0.15, 0.2], e_n=[0.95, 0.85], g_n=[0.1, 3.0])
RECORDED: Any = {
    "record": ["ledger"],
    "histories": [0],
}  # what all gases without walls record: they share kernels
EACH = pytest.mark.parametrize(
    "law",
    [WALTON, VISCOELASTIC, VISCOELASTIC_WALTON, TABLE],
    ids=["Walton", "Viscoelastic", "Viscoelastic, Walton's friction", "table"],
)
WITH_THEORY = pytest.mark.parametrize(
    "law", [WALTON, VISCOELASTIC, VISCOELASTIC_WALTON], ids=["Walton", "Viscoelastic", "Walton's friction"]
)


def impulses(law: laws.CollisionLaw, **pair: float) -> Any:
    named = SimpleNamespace(**dict(zip(law.coefficients, law.table_row(), strict=not law.has_table)))
    given = {"g_n": 1.0, "g_t": 0.0, "m_n": 0.5, "m_t": 0.5 / 3.0, "radius_i": 0.5, "radius_j": 0.5}
    given |= pair
    given["reduced_radius"] = given["radius_i"] * given["radius_j"] / (given["radius_i"] + given["radius_j"])
    table = [np.array(law.table_row())] if law.has_table else []
    return law.collide(SimpleNamespace(**given), named, *table)  # type: ignore[call-arg]


def test_walton_reverses_the_slip_up_to_coulomb_s_limit() -> None:
    """g_t' = g_t - P_t / m_t is -beta_0 g_t while |P_t| <= mu P_n = 0.2 x 1.9 x 0.5 = 0.19."""
    P_n, P_t, T = impulses(WALTON, g_t=-0.3)
    assert P_n == pytest.approx(0.95)
    assert -0.3 - P_t * 6.0 == pytest.approx(0.4 * 0.3)
    assert T == 0.0
    assert impulses(WALTON, g_t=5.0)[1] == pytest.approx(0.19)


def overlap(b: float) -> float:
    """e_n from the equation of motion of viscoelastic spheres, in units in which K / m_n = 1 and g_n = 1.

    xi'' = -xi^(3/2) - (3/2) A sqrt(xi) xi', b = (3/2) A, until the force would be attractive.
    """

    def force(xi: float, v: float) -> float:
        root = math.sqrt(max(xi, 0.0))
        return root * (xi + b * v)

    def separation(t: float, y: Any) -> float:
        return force(*y) if t > 1e-3 else 1.0

    separation.terminal, separation.direction = True, -1.0  # type: ignore[attr-defined]
    motion = solve_ivp(
        lambda _, y: [y[1], -force(*y)],
        (0.0, 100.0),
        [1e-12, 1.0],
        events=separation,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.05,
    )
    return -float(motion.y[1, -1])


@pytest.mark.parametrize(
    ("b", "within"), [(0.01, 1e-6), (0.06, 1.5e-5), (0.3, 1e-3), (1.0, 5e-3), (3.0, 9e-3), (7.0, 7e-3)]
)
def test_viscoelastic_restitution_is_that_of_the_equation_of_motion(b: float, within: float) -> None:
    """K / m_n = 2 Y sqrt(R) / (3 m_n) = 1 with Y = 3/4, R = 1/4, m_n = 1/4, of two disks of mass 1/2, radius 1/2."""
    law = laws.Viscoelastic(A=b / 1.5, Y=0.75)
    assert law.restitution(1.0, mass=0.5, radius=0.5) == pytest.approx(overlap(b), abs=within)


def test_unequal_viscoelastic_disks_meet_with_their_effective_radius() -> None:
    """Hertz: 1 / R = 1 / R_i + 1 / R_j, so that 0.3 and 1.5 have R = 1/4 as above (their mean would give 0.45)."""
    law = laws.Viscoelastic(A=0.3 / 1.5, Y=0.75)
    P_n, _, _ = impulses(law, m_n=0.25, radius_i=0.3, radius_j=1.5)
    assert P_n / 0.25 - 1.0 == pytest.approx(overlap(0.3), abs=1e-3)  # of the approximant, as above
    equal, one, other = (collisions.Collider(1.0, 2.0, 1.3, 0.4, radius) for radius in (0.5, 0.3, 1.5))
    expected = collisions.energy_changes(law, equal, equal)
    np.testing.assert_allclose(collisions.energy_changes(law, one, other), expected, rtol=1e-14)


WALLS = {
    "line": (ifrdem.Wall.line((0.0, 0.0), (1.0, 0.0)), 0.25),
    "segment": (ifrdem.Wall.segment((0.0, -1.0), (0.0, 1.0)), 0.25),
    "post": (ifrdem.Wall.post((-1.0 / 12.0, 0.0), 1.0 / 12.0), 1.0 / 16.0),
    "edge": (ifrdem.Wall.segment((-1.0, 0.0), (0.0, 0.0)), 0.25),
    "container": (ifrdem.Wall.container((1.0 / 3.0, 0.0), 1.0 / 3.0), 1.0),
    "inside of an arc": (ifrdem.Wall.arc((1.0 / 3.0, 0.0), 1.0 / 3.0, (2.0, 4.0)), 1.0),
    "outside of an arc": (ifrdem.Wall.arc((-1.0 / 12.0, 0.0), 1.0 / 12.0, (-1.0, 1.0)), 1.0 / 16.0),
}
"""Walls through the origin, whose normal there is along x, and the radius of contact with a disk of radius 1/4."""


@pytest.mark.full
@pytest.mark.parametrize("name", WALLS)
def test_walls_meet_viscoelastic_disks_with_their_own_curvature(name: str) -> None:
    """Hertz: 1 / R = 1 / R_i + 1 / r, r infinite of a flat wall, negative where the disk is inside of a circle.

    With m_n = m = 1, A = 1/5, Y = 3 and R_i = 1/4, K / m_n = 2 Y sqrt(R) / 3 = 2 sqrt(R), and of a speed of 1 b = (3/2)
    A (2 sqrt(R))^(2/5) = 0.3, 0.227 and 0.396 for R = 1/4, 1/16 and 1. A flat wall once counted as a sphere of the
    disk's radius, R = 1/8: b was smaller by 2^(-1/5), 0.261. An edge has no radius, and counts as flat.
    """
    wall, R = WALLS[name]
    center, law = (2.0, 3.0), laws.Viscoelastic(A=0.2, Y=3.0)
    moved = replace(wall, origin=(wall.origin[0] + center[0], wall.origin[1] + center[1]))
    speed, gap = 1.0, 0.05
    state = ifrdem.State([[center[0] + 0.25 + gap, center[1]]], [[-speed, 0.0]], [0.0])
    gas = ifrdem.Simulation(
        ifrdem.Disks(1, mass=1.0, radius=0.25),
        ifrdem.Box((9.0, 9.0), (False, False)),
        law,
        state,
        # With the others, far away, all of these gases have the same kernels.
        walls=[
            moved,
            ifrdem.Wall.segment((7.0, 1.0), (8.0, 1.0)),
            ifrdem.Wall.arc((7.5, 8.0), 0.5, (1.0, 2.0)),
        ],
    )
    gas.run(t_end=0.06)
    e_n = float(gas.state.velocity[0, 0])
    b = 0.3 * (2.0 * math.sqrt(R)) ** 0.4
    assert e_n == pytest.approx(overlap(b), abs=1.5e-3)  # of the approximant, as above
    assert e_n == pytest.approx(float(law.restitutions(1.0, 1.0, R)), abs=1e-12)
    for shift in (0.0, 9.0):  # across a periodic side, too
        at, normal = np.array((center[0] + 0.25 + shift, center[1])), np.array((-1.0, 0.0))
        assert moved.reduced_radius(0.25, at, normal, 0.05, ifrdem.Box((9.0, 9.0))) == pytest.approx(
            R, rel=1e-12
        )
    flat, r = {0.25: (math.inf, None), 1.0 / 16.0: (1.0 / 12.0, None), 1.0: (1.0 / 3.0, R)}[R]
    after = ifrdem.collide(
        law, [-1.0, 0.0], [1.0, math.inf], [0.25, flat], [2.0, 1.0], [[-1.0, 0.0], [0.0, 0.0]], [0.0, 0.0], r
    )
    assert after.velocity[0, 0] == pytest.approx(e_n, abs=1e-12)


def test_laws_that_keep_the_normal_energy_are_not_called_dissipative() -> None:
    """A = 0 is e_n = 1 at any speed: two smooth disks of mass 1 exchange their normal velocities."""
    elastic = laws.Viscoelastic(A=0.0, Y=1.0)
    assert impulses(elastic, g_n=0.7)[0] == pytest.approx(2.0 * 0.5 * 0.7, rel=1e-15)
    kept = (elastic, laws.smooth_disks(1.0), laws.Walton(e_n=1.0, beta_0=0.4, mu=0.2))
    assert [law.is_dissipative for law in (*kept, VISCOELASTIC, laws.smooth_disks(0.9), WALTON)] == [
        False, False, False, True, True, True
    ]  # fmt: skip


HEAVY = {"A": 1e40, "Y": 1.0}  # e_n of 1e-60 or so at any speed


def test_laws_outside_of_the_range_of_their_series_are_refused_before_any_work() -> None:
    disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
    law, box = laws.Viscoelastic(**HEAVY), ifrdem.Box((10.0, 10.0))
    message = r"A = 1e\+40, Y = 1: e_n = .*e-\d\d at the approach speed 0.8862: must be at least 0.05"
    with pytest.raises(InputError, match=message):  # sqrt(pi / 2) of the rms speed, sqrt(1 / 2)
        ifrdem.Simulation(disks, box, law, start)
    with pytest.raises(InputError, match=r"must be at least 0\.05"):
        ifrdem.DSMC(disks, law, 0.1, [[1.0, 0.0], [0.0, 0.0]], seed=1)
    gas = ifrdem.Simulation(disks, box, VISCOELASTIC, start)
    with pytest.raises(InputError, match=r"must be at least 0\.05"):
        gas.set_law(law)
    assert gas.setup.law[0][0] == VISCOELASTIC
    resting = ifrdem.State(start.position, np.zeros((2, 2)), start.spin)
    ifrdem.Simulation(disks, box, law, resting)  # without a speed no e_n is known
    # A wall does not move: the variance of the normal velocity is half of that of a pair, and 0.8862 / sqrt(2) is 0.6267.
    wall = [[VISCOELASTIC, law], [law, VISCOELASTIC]]
    with pytest.raises(InputError, match=r"at the approach speed 0\.6267: must be at least 0\.05"):
        ifrdem.Simulation(disks, box, wall, start)


COIN = {"normal": [1.0, 0.0], "mass": [1.0, 1.0], "radius": [0.5, 0.5], "k": [2.0, 2.0], "spin": [0.0, 0.0]}


@pytest.mark.full(keep=("Walton",))
@EACH
def test_collide_takes_any_law_and_is_the_engine_s(law: laws.CollisionLaw) -> None:
    """Two disks of mass 1 that meet along x, with slips that stick and slide; then the same by the engine."""
    for slip, regime in ((0.01, ifrdem.Regime.STICKING), (0.9, ifrdem.Regime.SLIDING)):
        after = ifrdem.collide(law, velocity=[[1.0, slip], [0.0, 0.0]], **COIN)
        assert after.regime == regime
        np.testing.assert_allclose(after.velocity.sum(axis=0), [1.0, slip], atol=1e-15)
        P_n, P_t, _ = impulses(law, g_n=1.0, g_t=slip)
        assert (after.P_n, after.P_t) == (P_n, P_t)
        disks, box = ifrdem.Disks(2, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0))
        start = ifrdem.State([[3.0, 5.0], [4.5, 5.0 + 0.5 * slip]], [[1.0, slip], [0.0, 0.0]], [0.0, 0.0])
        gas = ifrdem.Simulation(disks, box, law, start, **RECORDED)
        gas.run(t_end=1.0)
        np.testing.assert_allclose(gas.state.velocity, after.velocity, atol=1e-13)
        np.testing.assert_allclose(gas.state.spin, after.spin, atol=1e-13)
    apart = ifrdem.collide(law, velocity=[[-1.0, 0.3], [0.0, 0.0]], **COIN)
    assert (apart.regime, float(apart.P_n), float(apart.P_t)) == (0, 0.0, 0.0)


def test_collide_takes_laws_by_name_and_custom_ones() -> None:
    velocity = np.array([[[1.0, 0.2], [0.0, 0.0]], [[1.0, 2.0], [0.0, 0.0]]])
    named = ifrdem.collide({"law": "walton", "e_n": 0.9, "beta_0": 0.4, "mu": 0.2}, velocity=velocity, **COIN)
    np.testing.assert_array_equal(named.spin, ifrdem.collide(WALTON, velocity=velocity, **COIN).spin)

    class Own(ifrdem.CollisionLaw):
        coefficients = ("e_n",)

        @staticmethod
        def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
            return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0

    own = ifrdem.collide(Own(e_n=0.5), velocity=velocity, **COIN)
    np.testing.assert_allclose(own.velocity[:, 0, 0], 0.25)  # (1 - e_n) / 2 of the speed of approach
    assert own.regime.tolist() == [-1, -1]
    for law, message in (
        ({"law": "wlton"}, "must be one of 'ifr', 'walton'.*did you mean 'walton'"),
        ({"law": "walton", "e_n": 0.9}, "coefficient 'beta_0' is missing"),
        ("walton", r"law = 'walton': must be a law, or a mapping"),
    ):
        with pytest.raises(InputError, match=message):
            ifrdem.collide(law, velocity=velocity, **COIN)


def test_histories_have_the_regimes_that_the_ledger_counts() -> None:
    disks = ifrdem.Disks(50, mass=1.0, radius=0.5)
    box = ifrdem.Box.from_packing_fraction(disks.radius, 0.2)
    position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    start = ifrdem.State(position, velocity, np.zeros(50))
    gas = ifrdem.Simulation(disks, box, WALTON, start, histories=range(50), record=["ledger"])
    gas.run(collisions_per_disk=4)
    regime, counted = gas.take_events().regime, gas.measure().regimes
    assert counted is not None
    for name, column in ((ifrdem.Regime.SLIDING, 0), (ifrdem.Regime.STICKING, 1)):
        assert np.count_nonzero(regime == name) == 2 * counted[column] > 0


@pytest.mark.parametrize("g_n", [1e-9, 1e-3, 1.0, 1e4])
def test_kernel_and_numpy_have_one_restitution(g_n: float) -> None:
    P_n, _, _ = impulses(VISCOELASTIC, g_n=g_n)
    e_n = P_n / (0.5 * g_n) - 1.0
    assert e_n == pytest.approx(VISCOELASTIC.restitution(g_n, mass=1.0, radius=0.5), abs=1e-12)


def test_restitution_at_a_speed_is_the_given_one() -> None:
    for e_n in (0.05, 0.5, 0.99, 1.0):
        law = laws.Viscoelastic.of_restitution(e_n, g_n=3.0, mass=2e-3, radius=0.01, Y=1e7)
        assert law.restitution(3.0, mass=2e-3, radius=0.01) == pytest.approx(e_n, abs=1e-12)


@pytest.mark.full(keep=1)
@EACH
def test_ledger_closes_and_no_collision_adds_energy(law: laws.CollisionLaw) -> None:
    """Kinetic energy at the start less that at the end is what the mechanisms took."""
    n, rng = 200, np.random.default_rng(3)
    position = np.stack(np.meshgrid(np.arange(20) + 0.5, np.arange(10) + 0.5), -1).reshape(-1, 2) * 1.5
    disks = ifrdem.Disks(n, mass=1.0, radius=0.5)
    start = ifrdem.State(position, rng.normal(size=(n, 2)), rng.normal(size=n))
    gas = ifrdem.Simulation(disks, ifrdem.Box((30.0, 15.0)), law, start, **RECORDED)
    before = gas.measure()
    energies = [before.energy]
    for _ in range(5):
        gas.run_for(collisions_per_disk=2)
        energies.append(gas.measure().energy)
    assert np.all(np.diff(energies) < 0.0)
    by_mechanism = gas.measure().dissipated
    assert by_mechanism is not None
    assert by_mechanism.sum() == pytest.approx(energies[0] - energies[-1], rel=1e-10)
    assert by_mechanism[:3].min() > 0.0  # normal, tangential restitution, friction


@pytest.mark.full(keep=1)
@WITH_THEORY
def test_cooling_by_theory_is_that_of_the_monte_carlo_of_its_equation(law: laws.CollisionLaw) -> None:
    """Velocities are Gaussian until disks have collided: changes agree within the noise of 400,000 disks, about 1 %."""
    n = 400_000
    disks = ifrdem.Disks(n, mass=1.0, radius=0.5)
    velocity, spin = (
        ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=5),
        np.random.default_rng(6).normal(size=n),
    )
    gas = ifrdem.DSMC(disks, law, 0.1, velocity, 2.0 * spin, seed=5)  # I = m R^2 / 2 = 1/8: T_rot = 1/2
    found = gas.run(collisions_per_disk=0.4, samples=1)
    expected = theory.prediction(
        disks, law, 0.1, found.temperature[0], found.rotational_temperature[0], found.time
    )
    for one, other in zip(
        (found.temperature, found.rotational_temperature),
        (expected.temperature, expected.rotational_temperature),
        strict=True,
    ):
        assert one[1] - one[0] == pytest.approx(other[1] - other[0], rel=0.025)


def test_walton_that_stops_the_slip_is_ifr_with_its_contact_point() -> None:
    """Of beta_0 = 0 and e_t = -1 P_t = min(mu P_n, m_t |g_t|), in kernels and theory."""
    ifr = laws.IFRLaw(e_n=0.8, e_t=-1.0, mu=0.3, sticking="contact_point")
    walton = laws.Walton(e_n=0.8, beta_0=0.0, mu=0.3)
    for g_t in (0.1, 0.7, 3.0):
        assert impulses(walton, g_t=g_t) == pytest.approx(impulses(ifr, g_t=g_t))
    at = np.array([0.3, 1.0, 2.0])
    for a, b in zip(
        theory.changes_per_collision(at, ifr, 2.0), theory.changes_per_collision(at, walton, 2.0), strict=True
    ):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_walton_s_friction_of_viscoelastic_disks_is_walton_s() -> None:
    """At the e_n of the speed: |P_t| = min(mu P_n, (1 + beta_0) m_t |g_t|); theory likewise, at A = 0 with e_n = 1."""
    for g_n, g_t in ((1.0, 0.3), (0.2, -0.1), (2.0, 3.0), (0.7, -5.0)):
        e_n = VISCOELASTIC_WALTON.restitution(g_n, mass=1.0, radius=0.5)
        walton = laws.Walton(e_n=e_n, beta_0=0.4, mu=0.2)
        expected = impulses(walton, g_n=g_n, g_t=g_t)
        assert impulses(VISCOELASTIC_WALTON, g_n=g_n, g_t=g_t) == pytest.approx(expected, rel=1e-12)
    elastic = laws.Viscoelastic(A=0.0, Y=1.0, friction="walton", beta_0=0.4, mu=0.2)
    disks, t = ifrdem.Disks(2, mass=1.0, radius=0.5), [1.0, 10.0]
    one, other = (
        theory.prediction(disks, law, 0.1, 1.0, 0.5, t).temperature
        for law in (elastic, laws.Walton(e_n=1.0, beta_0=0.4, mu=0.2))
    )
    np.testing.assert_allclose(one, other, rtol=1e-6)  # of sums over speeds
    kept, smooth = (
        theory.prediction(disks, law, 0.1, 1.0, 0.5, t).temperature
        for law in (
            laws.Viscoelastic(A=0.1, Y=1.0, friction="walton", beta_0=-1.0, mu=0.2),
            laws.Viscoelastic(A=0.1, Y=1.0),
        )
    )
    np.testing.assert_allclose(kept, smooth, rtol=1e-9)


def test_records_of_viscoelastic_laws_without_friction_are_those_of_earlier_versions() -> None:
    old = {
        "law": "viscoelastic",
        "A": 0.1,
        "Y": 1.0,
        "e_t": -0.9,
        "mu": 0.2,
        "sticking": "contact_point",
        "rho": 0.0,
        "k": 2.0,
    }
    given = {key: value for key, value in old.items() if key != "law"}
    assert records.from_record(old) == laws.Viscoelastic(**given)
    with pytest.raises(InputError, match="must have A, Y"):
        records.from_record({key: value for key, value in old.items() if key != "A"})


def test_viscoelastic_gas_cools_with_the_power_five_thirds() -> None:
    """dT/dt ~ -T^(3/2) (1 - e_n^2) with 1 - e_n ~ T^(1/10): T ~ t^(-5/3)."""
    law = laws.Viscoelastic.of_restitution(0.95, g_n=1.0, mass=1.0, radius=0.5)
    late = theory.prediction(
        ifrdem.Disks(2, mass=1.0, radius=0.5), law, 0.1, 1.0, 0.0, [1e7, 1e9]
    ).temperature
    assert math.log(late[1] / late[0]) / math.log(1e2) == pytest.approx(-5.0 / 3.0, abs=3e-3)


def test_small_dissipation_cools_at_the_first_order_in_b() -> None:
    """(1 - e_n^2) y^2 averaged with y exp(-y^2/2): 2 x 1.15345 b_1 2^1.1 Gamma(2.1), where b = b_1 y^(1/5).

    A collision takes m_n V <(1 - e_n^2) y^2> / 2 from a pair, half of it from either disk: with V = 2 T / m, T/4 of it.
    """
    law = laws.Viscoelastic(A=1e-6, Y=1.0)
    b_1 = 1.5e-6 * (2.0 * 0.5 / (3.0 * 0.5)) ** 0.4 * math.sqrt(2.0) ** 0.2
    loss = 0.25 * 2.0 * 1.15345 * b_1 * 2.0**1.1 * math.gamma(2.1)
    mixture = theory.Mixture([1.0], [0.5], law, 0.1)
    rate = float(mixture.collision_rates([1.0])[0, 0])
    assert theory.mixture_cooling_rates(mixture, 1.0, 0.0)[0][0] == pytest.approx(-rate * loss, rel=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: laws.Walton(e_n=0.9, beta_0=1.1, mu=0.1), r"beta_0 = 1\.1: must be"),
        (lambda: laws.Walton(e_n=0.9, beta=0.1, mu=0.1), r"'beta' \(did you mean 'beta_0'"),
        (lambda: laws.Viscoelastic(A=-1.0, Y=1.0), r"A = -1\.0: must be"),
        (lambda: laws.Viscoelastic(A=0.1, Y=1.0, friction="waltn"), "friction.*'waltn'.*'walton'"),
        (lambda: laws.Viscoelastic(A=0.1, Y=1.0, beta_0=0.3), r"beta_0 = 0\.3: requires friction = 'walton'"),
        (
            lambda: laws.Viscoelastic(A=0.1, Y=1.0, e_t=-0.9, friction="walton"),
            r"e_t = -0\.9: requires friction = 'ifr'",
        ),
        (lambda: laws.Viscoelastic(A=0.1, Y=1.0, e_t=0.5, mu=0.3), "would add energy"),
        (lambda: theory.cooling_ratio(VISCOELASTIC, 2.0, 0.0), "must be a law whose e_n is a constant"),
    ],
)
def test_impossible_laws_are_refused_by_key_and_value(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_law_whose_collide_replaces_another_does_not_inherit_its_ledger() -> None:
    from ifrdem.model.laws.law import compiled

    class Elastic(laws.Walton):
        @staticmethod
        def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
            return 2.0 * pair.m_n * pair.g_n, 0.0, 0.0

    assert isinstance(vars(laws.Walton)["parts"], FromKernels)
    assert compiled(Elastic).parts is None
    assert compiled(laws.Walton).parts is not None
    # Nor what is said of the other's impulses: theory would have taken the averages of Walton's law.
    with pytest.raises(InputError, match="must be a law that says has_averages"):
        theory.cooling_ratio(Elastic(e_n=0.9, beta_0=0.4, mu=0.2), 2.0, 0.0)
    assert not Elastic.is_passive


def test_theory_of_a_custom_law_follows_from_what_its_class_says() -> None:
    """h and c of the IFR law, percussion centre: h = (1 + e_t) m_t / m_n, c = 1/2 (Eqs. 8 and 15).

    The same with the e_n of viscoelastic spheres, by `restitutions`.
    """

    class Own(laws.CollisionLaw):
        coefficients = ("e_n", "e_t", "mu")
        has_averages = True

        def slip_coefficients(self, inverse_a: Any) -> Any:
            return (1.0 + self.e_t) * inverse_a, 0.5 + 0.0 * inverse_a

    class OfSpeed(Own):
        depends_on_speed = True

        def restitutions(self, g_n: Any, m_n: Any, R: float) -> Any:
            return VISCOELASTIC.restitutions(g_n, m_n, R)

    disks, of_ifr = ifrdem.Disks(2, mass=1.0, radius=0.5), {"e_n": 0.8, "e_t": -0.9, "mu": 0.2}
    for own, known in ((Own, laws.IFRLaw(**of_ifr)), (OfSpeed, VISCOELASTIC)):
        one, other = (
            theory.prediction(disks, law, 0.1, 1.0, 0.5, [3.0, 10.0]).temperature
            for law in (own(**of_ifr), known)
        )
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("says", "message"),
    [
        (
            {"is_proved": True},
            r"is_proved = True: must be replaced by those of is_passive, has_averages, has_ifr",
        ),
        ({"has_averages": True}, r"has_averages = True: requires a method slip_coefficients"),
    ],
    ids=["former", "method"],
)
def test_classes_of_laws_that_say_too_little_are_refused(says: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        type("Own", (laws.CollisionLaw,), says)


def test_averages_require_the_numbers_that_they_are_made_of() -> None:
    kind = type(
        "Own", (laws.CollisionLaw,), {"has_averages": True, "mu": 0.0, "slip_coefficients": laws.Walton}
    )
    with pytest.raises(InputError, match=r"has_averages = True requires an attribute e_n; Own\(\) has none"):
        theory.cooling_ratio(kind(), 2.0, 0.0)


def test_coefficients_are_attributes_and_equal_laws_are_equal() -> None:
    assert WALTON.beta_0 == 0.4
    assert laws.Walton(e_n=0.9, beta_0=0.4, mu=0.2) == WALTON
    assert laws.rough_disks(0.9, beta=0.5) == laws.IFRLaw(e_n=0.9, e_t=0.5, mu=0.0)
    assert laws.smooth_disks(0.9).contact_point == 0.0
    with pytest.raises(AttributeError, match="did you mean 'beta_0'"):
        WALTON.beta  # noqa: B018


@pytest.mark.parametrize(
    "law", [laws.smooth_disks(0.9), laws.Viscoelastic(A=1e-3, Y=1.0)], ids=["ifr", "viscoelastic"]
)
def test_along_walls_without_friction_a_drift_is_no_heat(law: laws.CollisionLaw) -> None:
    """Two disks of mass 1 whose mean velocity along the channel is 1/2: 1/4 of energy is their drift's."""
    disks, channel = ifrdem.Disks(2, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0), (True, False))
    start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
    assert ifrdem.Simulation(disks, channel, law, start).measure().drift_energy == 0.25
