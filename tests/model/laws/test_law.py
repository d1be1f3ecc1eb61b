"""Custom collision laws: the same interface and results as the IFR law."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from support.gases import gas_of, mixture, run_to, start
from support.law_examples import Half, Misnamed, Numbered, Short, Silent, Viscoelastic, Weak

from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import EnergyWarning, IFRLaw
from ifrdem.model.laws.law import CollisionLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of


def viscoelastic(c: float = 0.0) -> Viscoelastic:
    return Viscoelastic(c=c, e_t=-1.0, mu=0.0)


def quiet(*arguments: Any, **options: Any) -> Simulation:
    """A simulation whose law is known not to be judged."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyWarning)
        return Simulation(*arguments, **options)


@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_the_ifr_law_as_a_custom_law_gives_the_same_bits(order: str) -> None:
    """Unequal rough disks that slide and stick; e_n = 1 - 0 g_n^(1/5) is 1 exactly."""
    disks = mixture(300)
    box, state = start(disks, 0.4)

    def end(table: tuple[float, ...], law: type[CollisionLaw]) -> State:
        engine = engine_of(disks, box, state, np.array([[table]]), law=law, order=order, tile_disks=60)
        reached = run_to(engine, 0.5)
        assert engine.collisions > 300
        return reached

    built_in, own = end((1.0, -0.9, 0.15, 1.0, 0.0), IFRLaw), end((0.0, -0.9, 0.15), Viscoelastic)
    for name in ("position", "velocity", "spin", "collisions"):
        np.testing.assert_array_equal(getattr(own, name), getattr(built_in, name))


@pytest.mark.full
def test_restitution_of_a_viscoelastic_law_falls_with_the_speed_of_approach() -> None:
    """Head-on pairs of unequal masses: g_n' = -e(g) g with e = 1 - 0.1 g^(1/5), at speeds over six decades.

    The law to lowest order of Brilliantov, Spahn, Hertzsch and Poeschel (1996), doi:10.1103/PhysRevE.53.5382. Momentum
    is kept to rounding.
    """
    disks = Disks(2, mass=np.array([1.0, 3.0]), radius=0.5)
    for g in 10.0 ** np.arange(-3.0, 4.0):
        begin = State([[10.0, 5.0], [12.0, 5.0]], [[g, 0.0], [0.0, 0.0]], [0.0, 0.0])  # type: ignore[arg-type]
        pair = quiet(disks, Box((30.0, 30.0)), viscoelastic(0.1), begin)
        pair.run(t_end=2.0 / g)
        assert pair.collisions == 1
        velocity, e = pair.state.velocity[:, 0], 1.0 - 0.1 * g**0.2
        assert velocity[0] - velocity[1] == pytest.approx(-e * g, rel=1e-12)
        assert disks.mass @ velocity == pytest.approx(g, rel=1e-14)
        assert pair.dissipated_energy == pytest.approx(
            0.5 * 0.75 * g**2 * (1.0 - e**2), rel=1e-12
        )  # m_n = 3/4


def test_a_law_that_adds_energy_is_reported_before_and_after_a_run() -> None:
    """e_n = 1 + 0.2 g_n^(1/5): every collision adds energy."""
    disks = mixture(100)
    box, state = start(disks, 0.2)
    with pytest.warns(
        EnergyWarning, match=r"law Viscoelastic: of 4096 random collisions 4096 added"
    ) as begin:
        gas = Simulation(disks, box, viscoelastic(-0.2), state)
    before = measure(disks, state).energy
    with pytest.warns(EnergyWarning, match=r"collisions have added energy, \d") as end:
        gas.run(collisions_per_disk=2.0)
    assert {each.filename for each in (*begin, *end)} == {
        __file__
    }  # the lines that called, not those that warn
    gained = measure(disks, gas.state).energy - before
    assert gained > 0.2 * before
    assert gas.dissipated_energy == pytest.approx(-gained, rel=1e-12)


def test_a_law_that_lets_disks_through_each_other_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"law Weak: .* get P_n = .*, not below m_n g_n = .*through each other"
    ):
        gas_of(mixture(100), 0.2, Weak(part=0.5))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: viscoelastic(), None),
        (lambda: Viscoelastic(c=1.0, d=0.1), r"Viscoelastic: unknown coefficient 'd'.*are c, e_t, mu"),
        (lambda: Viscoelastic(c=1.0), r"Viscoelastic: coefficient 'e_t' is missing"),
        (lambda: viscoelastic(float("nan")), r"Viscoelastic: c = nan: must be a finite number"),
        (lambda: Silent(), r"law = .*Silent.*: must be an IFRLaw, or .* with a method collide"),
        (lambda: 0.9, r"law = 0.9: must be an IFRLaw"),
        (
            lambda: [
                [viscoelastic(), viscoelastic()],
                [viscoelastic(), Weak(part=1.0)],
            ],
            r"law table: laws of 2 classes, Viscoelastic, Weak",
        ),
    ],
)
def test_what_is_no_law_is_refused_by_name(make: Any, message: str | None) -> None:
    disks = mixture(10)
    box, state = start(disks, 0.2)
    if message is None:
        assert quiet(disks, box, make(), state).collisions == 0
        return
    with pytest.raises(InputError, match=message):
        Simulation(disks, box, make(), state)


def test_collide_in_numpy_takes_a_custom_law() -> None:
    """At g_n = 1 the law is the IFR law with e_n = 1 - c, contact point."""
    law, pair = viscoelastic(), ([1, 0], [1, 1], [1, 1], [2, 2], [[1, 0.3], [0, 0]], [0, 0])
    same = IFRLaw(e_n=1.0 - law.c, e_t=law.e_t, mu=law.mu, sticking="contact_point")
    found, expected = collide(law, *pair), collide(same, *pair)
    np.testing.assert_array_equal(found.velocity, expected.velocity)
    np.testing.assert_array_equal(found.spin, expected.spin)
    assert (found.P_n, found.P_t) == (expected.P_n, expected.P_t)


@pytest.mark.full
def test_a_law_needs_no_coefficients() -> None:
    disks = mixture(100)
    box, state = start(disks, 0.4)
    gas = quiet(disks, box, Half(), state)
    gas.run(t_end=0.2)
    assert gas.collisions > 50
    assert gas.dissipated_energy > 0.0


def test_a_law_that_returns_too_little_is_refused_by_name() -> None:
    disks = mixture(100)
    box, state = start(disks, 0.4)
    with pytest.raises(InputError, match=r"law Short: cannot compile .* must return P_n, P_t and T"):
        quiet(disks, box, Short(), state)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (
            Misnamed(e_n=0.9),
            r"line \d+, in collide: .*there is no 'e_N' \(did you mean 'e_n'\?\); law has e_n$",
        ),
        (Numbered(e_n=0.9), r"\[1\]: must be a name after a dot; pair has g_n, .*; law has e_n$"),
    ],
    ids=["name", "number"],
)
def test_an_unknown_coefficient_is_reported(law: CollisionLaw, message: str) -> None:
    """Of a vector, Taichi would end the process where a number lies beyond the coefficients."""
    disks = mixture(100)
    box, state = start(disks, 0.4)
    with pytest.raises(InputError, match=message):
        quiet(disks, box, law, state)
