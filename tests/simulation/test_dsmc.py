"""DSMC against conservation laws, kinetic theory where it is exact, published cumulants; the same on any threads."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from ifrdem import Device
from ifrdem.errors import InputError, NoMoreCollisions
from ifrdem.initial import placement
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.laws.law import CollisionLaw
from ifrdem.model.state import Disks
from ifrdem.simulation import backend, dsmc
from ifrdem.simulation.dsmc import DSMC
from ifrdem.theory import collision_rate, cooling, haff, steady_flow
from ifrdem.theory.collisions import mixture_collision_rates
from ifrdem.theory.contact import Contact, mixture_contact_values
from ifrdem.theory.driven_gas import Driving, driven
from ifrdem.theory.mixtures import Mixture, mixture_cooling
from ifrdem.theory.sonine import cooling_factor, heated_sonine

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
ELASTIC_ROUGH = IFRLaw(e_n=1.0, e_t=0.0, mu=1e9, sticking="contact_point")  # g_t' = -g_t
SMOOTH = IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0)


@pytest.fixture(autouse=True, scope="module")
def ended() -> Iterator[None]:
    yield
    backend.stop()


def homogeneous(n: int, law: IFRLaw, *, T_rot: float = 0.0, **given) -> DSMC:
    """n equal disks of mass 1, diameter 1 at T = 1 and phi = 0.2."""
    disks = Disks(n, 1.0, 0.5)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=5)
    spin = placement.gaussian_spins(n, spin_rms=math.sqrt(T_rot * 8.0), seed=5)  # I = 1/8
    return DSMC(disks, law, 0.2, velocity, spin, **({"seed": 2, "device": Device(threads=1)} | given))


def test_elastic_collisions_keep_energy_and_momentum_and_share_it_out() -> None:
    start = homogeneous(3000, ELASTIC_ROUGH)
    found = start.run(collisions_per_disk=15.0, samples=3)
    np.testing.assert_allclose(found.energy, found.energy[0], rtol=1e-12)  # 22,500 collisions of round-off
    np.testing.assert_allclose(start.velocity.sum(axis=0), 0.0, atol=1e-10)
    # T + T_rot / 2 = 1 at the start: both 2/3 at the end, within 4 of 1 / sqrt(n) and sqrt(2 / n).
    assert found.temperature[-1] == pytest.approx(2.0 / 3.0, rel=4.0 / math.sqrt(3000))
    assert found.rotational_temperature[-1] == pytest.approx(2.0 / 3.0, rel=4.0 * math.sqrt(2.0 / 3000))
    assert abs(found.a_2[-1]) < 4.0 / math.sqrt(3000)


@pytest.mark.full
def test_a_gas_in_equilibrium_collides_at_enskog_s_rate() -> None:
    """To half a percent: counting half a million collisions leaves 0.14 %, so that 1 % in the rate is seen surely."""
    n, t_end = 4000, 400.0
    found = homogeneous(n, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)).run(t_end=t_end, samples=1)
    assert found.time[-1] == t_end
    # (n - 1) / n of it, because a disk does not meet itself. T is 1 throughout: elastic.
    expected = t_end * collision_rate(0.2, 1.0, 1.0, 0.5) * (1.0 - 1.0 / n)
    assert 0.5 * n * expected > 5e5
    assert found.collisions_per_disk[-1] == pytest.approx(expected, rel=0.005)
    of_disks = homogeneous(n, COIN)
    of_disks.run(t_end=1.0, samples=1)
    assert of_disks.collisions_of_disks.sum() == 2 * of_disks.collisions


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("contact", ["virial", "dilute"])
def test_disks_of_all_sizes_have_the_collision_rates_of_theory_on_one_thread(contact: Contact) -> None:
    """Elastic, in equilibrium: disk i meets each j at the rate g_ij sigma_ij sqrt(2 pi (T/m_i + T/m_j)) / area."""
    n, phi = 1500, 0.4
    rng = np.random.default_rng(1)
    radius, mass = np.sort(rng.uniform(0.2, 1.0, n)), rng.uniform(0.5, 2.0, n)
    disks = Disks(n, mass, radius)
    velocity = placement.maxwellian(mass, temperature=1.0, seed=5)
    one = DSMC(
        disks,
        IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0),
        phi,
        velocity,
        seed=3,
        contact=contact,
        device=Device(threads=1),
    )
    time = one.run(collisions_per_disk=16.0, samples=1).time[-1]
    density = np.full(n, 1.0 / one.area)
    g = mixture_contact_values(phi, radius, None, contact)
    rates = mixture_collision_rates(np.ones(n), mass, radius, density, g)
    np.fill_diagonal(rates, 0.0)
    expected = time * rates.sum(axis=1)
    for own in np.split(
        np.arange(n), 3
    ):  # small, middle, large: 500 disks, 6,000 collisions of theirs or more
        assert one.collisions_of_disks[own].sum() == pytest.approx(expected[own].sum(), rel=0.04)
    assert expected[-500:].sum() > 1.5 * expected[:500].sum()


def test_young_coins_cool_by_the_closed_form() -> None:
    """Half a collision per disk: velocities are Gaussian still; the theory is exact but for the sample's size."""
    found = homogeneous(40_000, COIN).run(collisions_per_disk=0.5, samples=1)
    T, T_rot, tau = cooling(COIN, 1.0, 0.5, 2.0, 0.2, 1.0, 0.0, found.time)
    # 10^4 collisions: 1 % of their number, and some 2 % of what they change.
    assert found.collisions_per_disk[-1] == pytest.approx(tau[-1], rel=0.03)
    assert found.temperature[-1] - 1.0 == pytest.approx(T[-1] - 1.0, rel=0.05)
    assert found.rotational_temperature[-1] == pytest.approx(T_rot[-1], rel=0.05)
    assert T_rot[-1] > 0.05


def test_smooth_disks_follow_haff_with_the_cumulant_that_theory_says() -> None:
    """e = 0.8: a_2 = -0.0260 (`sonine`), and losses that are 1 + 3/16 a_2 of a Gaussian's."""
    n = 20_000
    found = homogeneous(n, SMOOTH).run(collisions_per_disk=30.0, samples=30)
    later = found.collisions_per_disk > 8.0
    # a_2 scatters by 1 / sqrt(n) and forgets it in 2 collisions per disk: 22 samples leave 0.003, three of which:
    assert np.mean(found.a_2[later]) == pytest.approx(-0.0260, abs=0.009)
    rate0 = collision_rate(0.2, 1.0, 1.0, 0.5) * float(cooling_factor(-0.0260))
    expected = haff(1.0, 0.8, rate0, found.time)
    np.testing.assert_allclose(found.temperature, expected, rtol=0.03)  # T falls to 1 / 200
    assert found.temperature[-1] < 0.01
    np.testing.assert_array_equal(found.rotational_temperature, 0.0)


def test_heated_smooth_disks_follow_the_driven_theory() -> None:
    n = 5000
    driving = Driving(power=1.0)
    found = homogeneous(n, SMOOTH, driving=driving).run(t_end=6.0, samples=30)
    late = slice(12, None)
    T, _, _ = driven(SMOOTH, 1.0, 0.5, 2.0, 0.2, driving, 1.0, 0.0, found.time)
    np.testing.assert_allclose(
        found.temperature, T, rtol=0.06
    )  # 1 / sqrt(n), and as much from each unit of time's kicks
    assert T[-1] > 2.4
    # What is lost, with the noise of what was given taken out: (1 - e^2) / 2 of T at each collision, and 3/16 a_2.
    # Six runs with 10^4 disks scattered by 0.5 %.
    lost = np.ptp((found.energy_input - found.energy)[late][[0, -1]]) / n / np.ptp(found.time[late])
    rate = collision_rate(0.2, 1.0, 1.0, 0.5) * np.mean(found.temperature[late] ** 1.5)
    expected = 0.18 * rate * float(cooling_factor(heated_sonine(0.8)))
    assert lost == pytest.approx(expected, rel=0.03)


def test_a_heat_bath_alone_brings_disks_to_its_temperature() -> None:
    bath = Driving(power=2.0 * 0.5 * 3.0, rate=0.5, spin_power=0.5 * 2.0, spin_rate=0.5)  # T = 3, T_rot = 2
    found = homogeneous(4_000, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), driving=bath).run(t_end=8.0, samples=1)
    assert found.temperature[-1] == pytest.approx(3.0, rel=0.06)  # 1 / sqrt(n), and exp(-8)
    assert found.rotational_temperature[-1] == pytest.approx(2.0, rel=0.09)
    gained = found.energy[-1] - found.energy[0]  # elastic: all of it is the bath's
    assert found.energy_input[-1] == pytest.approx(gained, rel=1e-10)


@pytest.mark.full
def test_species_of_a_young_mixture_follow_the_mixture_theory_on_one_thread() -> None:
    n = 30_000
    big = np.arange(n) % 3 == 0
    disks = Disks(n, np.where(big, 5.0, 1.0), np.where(big, 1.0, 0.5), material=big.astype(np.int32))
    rough = IFRLaw(e_n=0.7, e_t=-0.6, mu=0.5)
    laws = [[COIN, rough], [rough, IFRLaw(e_n=0.95, e_t=-0.9, mu=0.1, sticking="contact_point")]]
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=5)
    found = DSMC(disks, laws, 0.3, velocity, seed=4, device=Device(threads=1)).run(
        collisions_per_disk=1.0, samples=1
    )
    mixture, which = Mixture.of(disks, laws, 0.3)
    assert which[0] == 1  # big ones
    theory = mixture_cooling(mixture, 1.0, 0.0, found.time)
    np.testing.assert_allclose(found.collisions_per_disk_of[-1], theory.collisions_per_disk[-1], rtol=0.03)
    assert theory.collisions_per_disk[-1, 1] > 1.05 * theory.collisions_per_disk[-1, 0]
    np.testing.assert_allclose(found.temperature_of[-1] - 1.0, theory.temperature[-1] - 1.0, rtol=0.08)
    np.testing.assert_allclose(
        found.rotational_temperature_of[-1], theory.rotational_temperature[-1], rtol=0.06
    )


@pytest.mark.full
@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.skipif(backend.cores() < 2, reason="one core only")
def test_one_and_two_threads_give_the_same_bits(precision: str) -> None:
    """One thread settles candidates in order, two in rounds."""
    ends = []
    for threads in (1, 2):  # the tests before this one have one
        one = homogeneous(4000, COIN, device=Device(threads=threads, precision=precision), T_rot=1.0)
        found = one.run(collisions_per_disk=2.0, samples=2)
        ends.append((one.velocity, one.spin, one.collisions_of_disks, found.time, found.energy))
    for a, b in zip(*ends, strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.abs(ends[0][0].sum(axis=0)).max() < (1e-10 if precision == "f64" else 0.05)


def test_a_batch_that_makes_a_disk_too_fast_is_cut_and_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hot spins speed up cold disks. With so wide a margin that nothing is cut, as many collisions are seen."""
    ends = []
    for margin in (1.15, 30.0):
        monkeypatch.setattr(dsmc, "MARGIN", margin)
        hot = homogeneous(4000, ELASTIC_ROUGH, T_rot=200.0)
        found = hot.run(t_end=0.1, samples=1)
        np.testing.assert_allclose(found.energy, found.energy[0], rtol=1e-12)
        ends.append((found.collisions_per_disk[-1], found.temperature[-1], hot.cut_for_speed))
    (few, cold, cut), (many, warm, uncut) = ends
    assert cut > 2
    assert uncut == 0
    # 350 collisions each, whose effects add up: eight pairs of runs to a later time scattered by 7 % and 5 %.
    assert few == pytest.approx(many, rel=0.25)
    assert cold == pytest.approx(warm, rel=0.25)


class Wood(CollisionLaw):
    """Smooth disks of restitution e, as a custom law."""

    coefficients = ("e",)

    @staticmethod
    def collide(pair, law):
        return (1.0 + law.e) * pair.m_n * pair.g_n, 0.0, 0.0


def test_a_custom_law_runs_and_is_checked_for_energy() -> None:
    ifr = homogeneous(200, SMOOTH)
    own = homogeneous(200, Wood(e=0.8))  # whose trial says nothing: no collision gains
    for one in (ifr, own):
        one.run(collisions_per_disk=2.0, samples=1)
    np.testing.assert_array_equal(ifr.velocity, own.velocity)


def test_a_gas_resumed_from_a_checkpoint_has_the_same_bits() -> None:
    given = {"driving": Driving(power=1.0, spin_power=0.2), "T_rot": 0.5}
    whole, first, second = (homogeneous(300, COIN, **given) for _ in range(3))
    whole.run(t_end=2.0, samples=2)
    first.run(t_end=1.0, samples=1)
    second.resume(first.checkpoint())
    found = second.run(t_end=2.0, samples=1)
    for name in ("velocity", "spin", "collisions_of_disks", "time", "collisions", "energy_input"):
        np.testing.assert_array_equal(getattr(second, name), getattr(whole, name))
    assert found.time.tolist() == [1.0, 2.0]
    with pytest.raises(InputError, match="checkpoint has 300 disks"):
        homogeneous(200, COIN).resume(first.checkpoint())


def test_seeds_differ_and_repeat() -> None:
    ends = [homogeneous(200, COIN, seed=seed) for seed in (1, 1, 2)]
    for one in ends:
        one.run(collisions_per_disk=2.0, samples=1)
    np.testing.assert_array_equal(ends[0].velocity, ends[1].velocity)
    assert not np.array_equal(ends[0].velocity, ends[2].velocity)


def test_what_a_flow_gives_to_rough_elastic_disks_is_its_work_and_their_turning() -> None:
    """Nothing is lost: energy grows by -rate P_xy A dt, with the strain of velocities in free flight, and the spins get
    (P_xy - P_yx) A dt of angular momentum, both to rounding."""
    gas = homogeneous(400, ELASTIC_ROUGH, T_rot=0.3, shear_rate=0.7)
    spin = [gas.spin.sum() / 8.0]
    for per_disk in (1.0, 3.0):
        found = gas.run(collisions_per_disk=per_disk, samples=2)
        spin.append(gas.spin.sum() / 8.0)
        np.testing.assert_allclose(found.energy - found.energy_input, 400.0 * 1.15, rtol=2e-3)
        np.testing.assert_allclose(np.ptp(found.energy - found.energy_input), 0.0, atol=1e-9)
        turned = (found.collisional_stress[1:, 0, 1] - found.collisional_stress[1:, 1, 0]) @ np.diff(
            found.time
        )
        assert turned * gas.area == pytest.approx(spin[-1] - spin[-2], rel=1e-9)
    assert found.energy[-1] > 1.05 * found.energy[0]
    np.testing.assert_allclose(gas.velocity.sum(axis=0), 0.0, atol=1e-10)


def test_a_sheared_gas_has_the_stresses_of_theory() -> None:
    """Steady state of smooth disks, 1,000 over 16 collisions each: stresses over n T scatter by 2 to 3 %, and are within
    2 % of anisotropic Gaussians (`theory.steady_flow`). T of 1,000 sheared disks takes 20 collisions to forget noise."""
    flow = steady_flow(SMOOTH, 1.0, 0.5, 2.0, 0.2, 0.5)
    assert flow is not None
    disks = Disks(1000, 1.0, 0.5)
    velocity = placement.maxwellian(disks.mass, temperature=flow.temperature, seed=5)
    gas = DSMC(disks, SMOOTH, 0.2, velocity, seed=3, shear_rate=0.5, device=Device(threads=1))
    begin = gas.run(collisions_per_disk=6.0, samples=1).time[-1]
    found = gas.run(collisions_per_disk=22.0, samples=32)
    assert found.temperature[1:].mean() == pytest.approx(flow.temperature, rel=0.1)
    stress = found.stress(begin)
    units = 0.5 * np.trace(stress.kinetic), 0.5 * np.trace(flow.stress.kinetic)
    np.testing.assert_allclose(stress.kinetic / units[0], flow.stress.kinetic / units[1], atol=0.06)
    np.testing.assert_allclose(stress.collisional / units[0], flow.stress.collisional / units[1], rtol=0.12)
    assert stress.friction == pytest.approx(flow.stress.friction, rel=0.08)
    with pytest.raises(InputError, match="before the last sample"):
        found.stress(found.time[-1])
    with pytest.raises(InputError, match="shear_rate"):
        homogeneous(50, SMOOTH).run(collisions_per_disk=1.0, samples=1).stress()


def test_speeds_of_a_maxwellian_are_counted() -> None:
    """|c| has the density 2 c exp(-c^2): of 20,000 disks each bin within 4 Poisson errors, and all are counted."""
    found = homogeneous(20_000, SMOOTH).run(t_end=1e-6, samples=1)
    assert found.speed_counts.shape == (2, 1, len(dsmc.SPEED_EDGES) - 1)
    assert found.speed_counts.sum(axis=2).tolist() == [[20_000], [20_000]]
    below = np.exp(-(dsmc.SPEED_EDGES**2))
    expected = 20_000 * (below[:-1] - below[1:])
    assert np.all(np.abs(found.speed_counts[0, 0] - expected) < 4.0 * np.sqrt(expected) + 3.0)
    middle = found.speed_density()[0, :-1]
    assert middle @ np.diff(dsmc.SPEED_EDGES[:-1]) == pytest.approx(1.0, abs=1e-12)
    assert np.argmax(middle) in (6, 7)  # 1 / sqrt(2)


def test_each_species_has_its_own_driving() -> None:
    """Hardly any collision: T of each species rises by its power times the time; kicks of 4,000 disks add 2 %."""
    disks = Disks(8000, 1.0, 0.5, material=np.repeat([1, 0], 4000))
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=5)
    driving = [Driving(power=2.0), Driving(power=0.5, spin_power=1.0)]
    gas = DSMC(disks, [[SMOOTH] * 2] * 2, 1e-5, velocity, driving=driving, device=Device(threads=1))
    found = gas.run(t_end=2.0, samples=1)
    assert found.temperature_of[-1] == pytest.approx([5.0, 2.0], rel=0.08)
    assert found.rotational_temperature_of[-1] == pytest.approx([0.0, 4.0], rel=0.1, abs=1e-12)
    with pytest.raises(InputError, match=r"driving: must be a Driving, or a list of 2"):
        DSMC(disks, [[SMOOTH] * 2] * 2, 1e-5, velocity, driving=driving[:1])


def test_impossible_gases_are_refused() -> None:
    two = Disks(2, 1.0, 0.5)
    still = np.zeros((2, 2))
    for disks, law, given, message in (
        (Disks(1, 1.0, 0.5), COIN, {"velocity": [[1.0, 0.0]]}, "must be two or more"),
        (Disks(2, [1.0, math.inf], 0.5), COIN, {"velocity": still}, "finite mass"),
        (two, COIN, {"velocity": [[1.0, 0.0]]}, "velocity has shape"),
        (two, COIN, {"velocity": still, "species": [1]}, "species has shape"),
        (two, CollisionLaw(), {"velocity": still}, "with a method collide"),
        (two, COIN, {"velocity": still, "contact": "dilut"}, "'dilute'"),
        (Disks(2, 1.0, 0.5, k=1.0), [[COIN, COIN], [SMOOTH, COIN]], {"velocity": still}, "differ"),
    ):
        with pytest.raises(InputError, match=message):
            DSMC(disks, law, 0.2, **given)
    with pytest.raises(InputError, match="disks do not meet"):
        DSMC(two, COIN, 0.0, still)
    at_rest = DSMC(two, COIN, 0.2, still)
    with pytest.raises(NoMoreCollisions, match="nothing moves"):
        at_rest.run(t_end=1.0)
    for end in ({}, {"t_end": 1.0, "collisions_per_disk": 1.0}):
        with pytest.raises(InputError, match="exactly one"):
            at_rest.run(**end)
    with pytest.raises(InputError, match=r"t_end = -1\.0: must be"):
        at_rest.run(t_end=-1.0)
    with pytest.raises(InputError, match="increasing order"):
        at_rest.run(t_end=1.0, samples=[0.5, 0.2])
