"""Properties of the collision law: what it conserves, its symmetries, its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ifrdem.model.laws.collision import Collision, collide
from ifrdem.model.laws.ifr import IFRLaw, Regime

LAWS = {
    "1 pta": IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21),
    "contact point": IFRLaw(e_n=0.60, e_t=-0.30, mu=0.40, sticking="contact_point"),
    "rolling": IFRLaw(e_n=0.90, e_t=-0.90, mu=0.15, rho=0.05),
    "contact point, rolling": IFRLaw(e_n=0.50, e_t=-0.70, mu=0.30, sticking="contact_point", rho=0.30),
}
ANY_LAW = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
WITHOUT_ROLLING = pytest.mark.parametrize("law", [law for law in LAWS.values() if law.rho == 0.0])

# f64 round-off of some twenty operations on numbers of order 1 to 10
ROUND_OFF = {"rtol": 1e-12, "atol": 1e-12}


@dataclass
class Pairs:
    """Arguments of `collide` but the law."""

    normal: np.ndarray
    mass: np.ndarray
    radius: np.ndarray
    k: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

    def collide(self, law: IFRLaw) -> Collision:
        return collide(law, self.normal, self.mass, self.radius, self.k, self.velocity, self.spin)

    @property
    def tangent(self) -> np.ndarray:
        return np.stack([-self.normal[:, 1], self.normal[:, 0]], axis=-1)

    def after(self, law: IFRLaw) -> Pairs:
        collision = self.collide(law)
        return replace(self, velocity=collision.velocity, spin=collision.spin)

    @property
    def g_n(self) -> np.ndarray:
        return np.sum((self.velocity[:, 0] - self.velocity[:, 1]) * self.normal, axis=-1)

    @property
    def g_t(self) -> np.ndarray:
        sliding = np.sum((self.velocity[:, 0] - self.velocity[:, 1]) * self.tangent, axis=-1)
        return sliding + np.sum(self.radius * self.spin, axis=-1)

    def with_slip(self, g_t: np.ndarray) -> Pairs:
        """The same pairs with another slip, by another tangential velocity of the first disk."""
        velocity = self.velocity.copy()
        velocity[:, 0] += (g_t - self.g_t)[:, None] * self.tangent
        return replace(self, velocity=velocity)

    @property
    def m_n(self) -> np.ndarray:
        return 1.0 / np.sum(1.0 / self.mass, axis=-1)

    @property
    def m_t(self) -> np.ndarray:
        return 1.0 / np.sum((1.0 + self.k) / self.mass, axis=-1)


def random_pairs(n: int = 4000, *, seed: int, approaching: bool = True) -> Pairs:
    """Pairs with everything at random; both disks move and spin."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    pairs = Pairs(
        normal=np.stack([np.cos(angle), np.sin(angle)], axis=-1),
        mass=10.0 ** rng.uniform(-1.0, 1.0, (n, 2)),
        radius=rng.uniform(0.3, 3.0, (n, 2)),
        k=rng.uniform(1.0, 2.0, (n, 2)),
        velocity=rng.normal(size=(n, 2, 2)),
        spin=rng.normal(size=(n, 2)),
    )
    sign = np.sign(pairs.g_n) if approaching else -np.sign(pairs.g_n)
    return replace(pairs, normal=pairs.normal * sign[:, None])


def assert_same(a: Collision, b: Collision) -> None:
    for name in ("velocity", "spin", "P_n", "P_t"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), **ROUND_OFF, err_msg=name)
    np.testing.assert_array_equal(a.regime, b.regime)


# -- Conservation ------------------------------------------------------------------------------------------


@ANY_LAW
def test_collision_conserves_momentum(law):
    pairs = random_pairs(seed=1)
    after = pairs.after(law)
    momentum = np.sum(pairs.mass[..., None] * pairs.velocity, axis=1)
    np.testing.assert_allclose(np.sum(pairs.mass[..., None] * after.velocity, axis=1), momentum, **ROUND_OFF)
    assert np.max(np.abs(after.velocity - pairs.velocity)) > 1.0


def angular_momentum(pairs: Pairs, first: np.ndarray, point: np.ndarray) -> np.ndarray:
    """About `point` of the pair whose first disk's centre is at `first`."""
    distance = np.sum(pairs.radius, axis=-1)
    second = first + distance[:, None] * pairs.normal
    total = np.sum(pairs.mass * pairs.radius**2 / pairs.k * pairs.spin, axis=-1)
    for disk, centre in enumerate((first, second)):
        x, v = centre - point, pairs.velocity[:, disk]
        total += pairs.mass[:, disk] * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])
    return total


@WITHOUT_ROLLING
def test_collision_conserves_angular_momentum_about_any_point(law):
    pairs = random_pairs(seed=2)
    rng = np.random.default_rng(3)
    first, point = rng.normal(size=(2, 4000, 2)) * 3.0
    before, after = (angular_momentum(p, first, point) for p in (pairs, pairs.after(law)))
    np.testing.assert_allclose(after, before, rtol=1e-12, atol=1e-11)  # numbers up to 1e3
    assert np.max(np.abs(after)) > 100.0


def test_rolling_friction_brakes_spins_and_nothing_else():
    """Against the same law with rho = 0: same velocities, each spin smaller, none reversed."""
    law = LAWS["contact point, rolling"]
    pairs = random_pairs(seed=4)
    with_rolling, without = pairs.collide(law), pairs.collide(replace(law, rho=0.0))
    np.testing.assert_array_equal(with_rolling.velocity, without.velocity)
    np.testing.assert_array_equal(with_rolling.P_t, without.P_t)
    assert np.all(with_rolling.spin * without.spin >= 0.0)
    assert np.all(np.abs(with_rolling.spin) <= np.abs(without.spin))
    assert np.mean(with_rolling.spin == 0.0) > 0.1  # many are stopped
    # The torque on each is the smaller of rho P_n and r m_t |g_t|, if that does not stop it.
    r = 2.0 * np.prod(pairs.radius, axis=-1) / np.sum(pairs.radius, axis=-1)
    torque = np.minimum(law.rho * with_rolling.P_n, r * pairs.m_t * np.abs(pairs.g_t))
    inertia = pairs.mass * pairs.radius**2 / pairs.k
    slowed = inertia * (np.abs(without.spin) - np.abs(with_rolling.spin))
    free = with_rolling.spin != 0.0
    np.testing.assert_allclose(slowed[free], np.stack([torque, torque], -1)[free], rtol=1e-11, atol=1e-12)
    # Both torques oppose the spins, so the pair's angular momentum is not kept: the limit its docstring
    # states.
    zero = np.zeros((4000, 2))
    before = angular_momentum(pairs, zero, zero)
    after = angular_momentum(
        replace(pairs, velocity=with_rolling.velocity, spin=with_rolling.spin), zero, zero
    )
    assert np.mean(np.abs(after - before)) > 0.1


# -- Restitution -------------------------------------------------------------------------------------------


@ANY_LAW
def test_normal_velocity_is_reversed_and_multiplied_by_e_n(law):
    pairs = random_pairs(seed=5)
    np.testing.assert_allclose(pairs.after(law).g_n, -law.e_n * pairs.g_n, **ROUND_OFF)


def test_slip_is_reversed_and_multiplied_by_e_t_without_friction():
    """The paper's definition of e_t, below Eq. 7."""
    law = IFRLaw(e_n=0.8, e_t=0.6, mu=0.0)
    pairs = random_pairs(seed=6)
    np.testing.assert_allclose(pairs.after(law).g_t, -0.6 * pairs.g_t, **ROUND_OFF)


def test_no_restitution_and_no_friction_is_a_smooth_disk():
    """e_t = -1, mu = 0: spins untouched, the textbook impulse (1 + e_n) m_n g_n along n."""
    pairs = random_pairs(seed=7)
    got = pairs.collide(IFRLaw(e_n=0.7, e_t=-1.0, mu=0.0))
    np.testing.assert_array_equal(got.spin, pairs.spin)
    np.testing.assert_array_equal(got.P_t, 0.0)
    impulse = (1.7 * pairs.m_n * pairs.g_n)[:, None] * pairs.normal
    np.testing.assert_allclose(
        got.velocity[:, 0], pairs.velocity[:, 0] - impulse / pairs.mass[:, :1], **ROUND_OFF
    )
    np.testing.assert_allclose(
        got.velocity[:, 1], pairs.velocity[:, 1] + impulse / pairs.mass[:, 1:], **ROUND_OFF
    )


@ANY_LAW
def test_separating_pairs_come_back_unchanged(law):
    pairs = random_pairs(seed=8, approaching=False)
    got = pairs.collide(law)
    assert got.velocity.tobytes() == pairs.velocity.tobytes()
    assert got.spin.tobytes() == pairs.spin.tobytes()
    np.testing.assert_array_equal(got.P_n, 0.0)
    np.testing.assert_array_equal(got.P_t, 0.0)
    np.testing.assert_array_equal(got.regime, Regime.SEPARATING)


@ANY_LAW
def test_collided_pairs_separate(law):
    """Colliding a second time changes nothing: e_n > 0 leaves the pair separating."""
    once = random_pairs(seed=9).after(law)
    np.testing.assert_array_equal(once.collide(law).regime, Regime.SEPARATING)


# -- Symmetries --------------------------------------------------------------------------------------------


@ANY_LAW
def test_law_is_the_same_in_every_direction(law):
    pairs = random_pairs(seed=10)
    angle = 0.83
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    turned = replace(pairs, normal=pairs.normal @ turn.T, velocity=pairs.velocity @ turn.T).collide(law)
    straight = pairs.collide(law)
    assert_same(turned, straight._replace(velocity=straight.velocity @ turn.T))


@ANY_LAW
def test_law_is_the_same_in_a_mirror(law):
    """y -> -y reverses spins, and the tangential impulse because t turns over."""
    pairs = random_pairs(seed=11)
    flip = np.array([1.0, -1.0])
    observed = replace(pairs, normal=pairs.normal * flip, velocity=pairs.velocity * flip, spin=-pairs.spin)
    straight = pairs.collide(law)
    mirrored = straight._replace(velocity=straight.velocity * flip, spin=-straight.spin, P_t=-straight.P_t)
    assert_same(observed.collide(law), mirrored)


@ANY_LAW
def test_law_is_the_same_for_a_moving_observer(law):
    pairs = random_pairs(seed=12)
    drift = np.array([3.0, -7.0])
    straight = pairs.collide(law)
    observed = replace(pairs, velocity=pairs.velocity + drift).collide(law)
    assert_same(observed, straight._replace(velocity=straight.velocity + drift))


@ANY_LAW
def test_law_does_not_care_which_disk_is_first(law):
    """To the last bit: the engine may name a pair in either order."""
    pairs = random_pairs(seed=13)
    exchanged = Pairs(-pairs.normal, *(a[:, ::-1] for a in (pairs.mass, pairs.radius, pairs.k)), None, None)
    exchanged = replace(exchanged, velocity=pairs.velocity[:, ::-1], spin=pairs.spin[:, ::-1])
    a, b = pairs.collide(law), exchanged.collide(law)
    np.testing.assert_array_equal(b.velocity[:, ::-1], a.velocity)
    np.testing.assert_array_equal(b.spin[:, ::-1], a.spin)
    np.testing.assert_array_equal(b.P_n, a.P_n)
    np.testing.assert_array_equal(b.P_t, a.P_t)
    np.testing.assert_array_equal(b.regime, a.regime)


@ANY_LAW
def test_law_has_no_units_of_its_own(law):
    """Mass in units of 4, length of 1/8, time of 2: powers of two, so to the last bit. rho is a length."""
    pairs = random_pairs(seed=14)
    scaled = replace(
        pairs,
        mass=pairs.mass * 4.0,
        radius=pairs.radius / 8.0,
        velocity=pairs.velocity / 8.0 / 2.0,
        spin=pairs.spin / 2.0,
    ).collide(replace(law, rho=law.rho / 8.0))
    straight = pairs.collide(law)
    np.testing.assert_array_equal(scaled.velocity, straight.velocity / 16.0)
    np.testing.assert_array_equal(scaled.spin, straight.spin / 2.0)
    np.testing.assert_array_equal(scaled.P_n, straight.P_n * 4.0 / 16.0)
    np.testing.assert_array_equal(scaled.P_t, straight.P_t * 4.0 / 16.0)


# -- Continuity --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1.0, -1.0])
@ANY_LAW
def test_law_is_continuous_where_sliding_turns_into_sticking(law, side):
    """mu P_n = m_n |g_t| / 2 (Eqs. 9, 15) or m_t |g_t| (Eqs. 9, 12)."""
    pairs = random_pairs(seed=15)
    limit = pairs.m_t if law.sticking == "contact_point" else 0.5 * pairs.m_n
    slip = side * law.mu * (1.0 + law.e_n) * pairs.m_n * pairs.g_n / limit
    sticks = pairs.with_slip(slip * (1.0 - 1e-9)).collide(law)
    slides = pairs.with_slip(slip * (1.0 + 1e-9)).collide(law)
    assert np.all(
        np.isin(sticks.regime, [Regime.STICKING, Regime.STICKING_ROLLING, Regime.STICKING_NONROLLING])
    )
    assert np.all(np.isin(slides.regime, [Regime.SLIDING, Regime.SLIDING_ROLLING, Regime.SLIDING_NONROLLING]))
    # The slips differ by 2e-9 of about 10, and a light small disk turns k m_n/(m R) < 10 times as fast.
    np.testing.assert_allclose(slides.velocity, sticks.velocity, atol=3e-7)
    np.testing.assert_allclose(slides.spin, sticks.spin, atol=3e-7)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_law_is_continuous_where_rolling_turns_into_nonrolling(side):
    """rho P_n = r m_t |g_t| (Eqs. 31, 32)."""
    law = LAWS["rolling"]
    pairs = random_pairs(seed=16)
    r = 2.0 * np.prod(pairs.radius, axis=-1) / np.sum(pairs.radius, axis=-1)
    slip = side * law.rho * (1.0 + law.e_n) * pairs.m_n * pairs.g_n / (r * pairs.m_t)
    nonrolling = pairs.with_slip(slip * (1.0 - 1e-9)).collide(law)
    rolling = pairs.with_slip(slip * (1.0 + 1e-9)).collide(law)
    assert np.all(np.isin(nonrolling.regime, [Regime.SLIDING_NONROLLING, Regime.STICKING_NONROLLING]))
    assert np.all(np.isin(rolling.regime, [Regime.SLIDING_ROLLING, Regime.STICKING_ROLLING]))
    np.testing.assert_allclose(rolling.velocity, nonrolling.velocity, atol=3e-7)  # as above
    np.testing.assert_allclose(rolling.spin, nonrolling.spin, atol=3e-7)


@ANY_LAW
def test_law_is_continuous_where_the_slip_changes_sign(law):
    pairs = random_pairs(seed=17)
    up, down = (pairs.with_slip(np.full(4000, slip)).collide(law) for slip in (1e-9, -1e-9))
    np.testing.assert_allclose(up.velocity, down.velocity, atol=3e-8)
    np.testing.assert_allclose(up.P_t, down.P_t, atol=3e-8)
    np.testing.assert_allclose(up.spin, down.spin, atol=3e-7)


# -- Walls -------------------------------------------------------------------------------------------------


@ANY_LAW
def test_wall_is_the_limit_of_a_heavy_disk(law):
    """The difference falls as 1/m_j, to a collision that leaves the wall exactly as it was."""
    pairs = random_pairs(seed=18)

    def against(mass: float) -> Collision:
        return replace(pairs, mass=np.stack([pairs.mass[:, 0], np.full(4000, mass)], -1)).collide(law)

    wall = against(np.inf)
    np.testing.assert_array_equal(wall.velocity[:, 1], pairs.velocity[:, 1])
    np.testing.assert_array_equal(wall.spin[:, 1], pairs.spin[:, 1])
    masses = [1e3, 1e4, 1e5, 1e6]
    off = [
        max(
            np.max(np.abs(getattr(against(m), name) - getattr(wall, name)))
            for name in ("velocity", "spin", "P_t")
        )
        for m in masses
    ]
    # first order in 1/m_j: ten times closer with ten times the mass, to a few times m_i/m_j <= 1 %
    np.testing.assert_allclose(np.divide(off[:-1], off[1:]), 10.0, rtol=0.05)
    assert off[-1] < 1e-3


def test_disk_rebounds_from_a_flat_wall():
    """By hand, k = 2, M = 0: v_n' = -e_n v_n; sticking v_t' = v_t (1 - (5 + 2 e_t)/6) (Eq. 16)."""
    law = LAWS["1 pta"]
    v_n, v_t = 1.0, 0.3  # tan(psi) = 0.3 is below 2 mu (1 + e_n) = 0.785
    got = collide(
        law, [0.0, -1.0], [2.0, math.inf], [0.5, math.inf], 2.0 * np.ones(2), [[v_t, -v_n], [0, 0]], [0, 0]
    )
    assert got.regime == Regime.STICKING
    np.testing.assert_allclose(
        got.velocity[0], [v_t * (1.0 - (5.0 - 2.0 * 0.88) / 6.0), 0.87 * v_n], rtol=1e-14
    )
    np.testing.assert_array_equal(got.velocity[1], [0.0, 0.0])
    # P_t = m v_t (5 + 2 e_t)/6 turns it by k P_t / (m R); it moves to the right over a floor: clockwise
    np.testing.assert_allclose(got.spin, [-2.0 * v_t * (5.0 - 2.0 * 0.88) / 6.0 / 0.5, 0.0], rtol=1e-14)


@ANY_LAW
def test_flat_wall_may_be_either_disk_and_move(law):
    pairs = random_pairs(seed=19)
    pairs.mass[:, 1], pairs.radius[:, 1], pairs.spin[:, 1] = np.inf, np.inf, 0.0
    got = pairs.collide(law)
    assert np.all(np.isfinite(got.velocity))
    assert np.all(np.isfinite(got.spin))
    np.testing.assert_array_equal(got.velocity[:, 1], pairs.velocity[:, 1])
    np.testing.assert_array_equal(got.spin[:, 1], 0.0)
    # seen from the wall it is at rest
    at_rest = replace(pairs, velocity=pairs.velocity - pairs.velocity[:, 1:]).collide(law)
    assert_same(got, at_rest._replace(velocity=at_rest.velocity + pairs.velocity[:, 1:]))
    first = collide(
        law,
        -pairs.normal,
        *(a[:, ::-1] for a in (pairs.mass, pairs.radius, pairs.k, pairs.velocity, pairs.spin)),
    )
    np.testing.assert_array_equal(first.velocity[:, ::-1], got.velocity)
    np.testing.assert_array_equal(first.spin[:, ::-1], got.spin)


def test_flat_wall_counts_as_the_partners_radius_for_rolling_friction():
    """r = 2 R_i R_j / (R_i + R_j) = R_i; the wall does not turn, so its radius enters nowhere else."""
    law = LAWS["contact point, rolling"]
    pairs = random_pairs(seed=20)
    pairs.mass[:, 1], pairs.spin[:, 1] = np.inf, 0.0
    pairs.radius[:, 1] = np.inf
    flat = pairs.collide(law)
    pairs.radius[:, 1] = pairs.radius[:, 0]
    assert_same(flat, pairs.collide(law))
    assert np.any(flat.regime == Regime.STICKING_NONROLLING)


# -- Arrays ------------------------------------------------------------------------------------------------


@ANY_LAW
def test_one_pair_at_a_time_gives_the_same_numbers_as_many(law):
    pairs = random_pairs(24, seed=21)
    many = collide(
        law,
        pairs.normal.reshape(4, 6, 2),
        *(a.reshape(4, 6, 2) for a in (pairs.mass, pairs.radius, pairs.k)),
        pairs.velocity.reshape(4, 6, 2, 2),
        pairs.spin.reshape(4, 6, 2),
    )
    assert many.velocity.shape == (4, 6, 2, 2)
    assert many.spin.shape == (4, 6, 2)
    assert many.P_n.shape == many.P_t.shape == many.regime.shape == (4, 6)
    for q in range(24):
        one = collide(law, *(getattr(pairs, name)[q] for name in Pairs.__dataclass_fields__))
        assert one.velocity.shape == (2, 2)
        assert one.P_n.shape == one.regime.shape == ()
        for name in Collision._fields:
            where = divmod(q, 6)
            np.testing.assert_array_equal(getattr(one, name), getattr(many, name)[where], err_msg=name)


def test_leading_axes_broadcast():
    law = LAWS["rolling"]
    pairs = random_pairs(5, seed=22)
    got = collide(law, pairs.normal, [1.0, 2.0], [0.5, 0.4], [2.0, 1.0], pairs.velocity, [0.0, 0.1])
    full = [np.broadcast_to(a, (5, 2)) for a in ([1.0, 2.0], [0.5, 0.4], [2.0, 1.0], [0.0, 0.1])]
    expected = collide(law, pairs.normal, *full[:3], pairs.velocity, full[3])
    for name in Collision._fields:
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))
    assert collide(law, np.ones((0, 2)), [1, 1], [1, 1], [2, 2], np.ones((0, 2, 2)), [0, 0]).P_n.shape == (0,)
