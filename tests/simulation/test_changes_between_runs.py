"""Changes between runs: law, forces, gravity and velocities, and the energy that they put in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import gases

from ifrdem import Box, CollisionLaw, IFRLaw, InputError, Simulation, State, Wall, forces

LAW = IFRLaw(e_n=0.9, e_t=-0.5, mu=0.2)
ROUGH = IFRLaw(e_n=0.7, e_t=-0.2, mu=0.1, sticking="contact_point")


class Lossy(CollisionLaw):
    """Smooth disks with restitution e."""

    coefficients = ("e",)

    @staticmethod
    def collide(pair, law):
        return pair.m_n * pair.g_n * (1.0 + law.e), 0.0 * pair.g_t, 0.0


def setting(kind: str, n: int = 60) -> tuple[Box, State, dict[str, Any]]:
    """A box with a start, and options: periodic, sheared, open, or between walls under gravity."""
    disks = gases.equal_disks(n)
    if kind == "sheared":
        return *gases.sheared(disks, 0.3, rate=0.4), {}
    box, state = gases.start(disks, 0.3)
    if kind == "open":
        return Box.open(), state, {}
    if kind == "walls":
        width, height = box.lengths
        box = Box((width + 1.0, height + 1.0), (False, False))
        post = Wall.post((width + 1.0, 0.0), 0.1)
        return box, replace(state, position=state.position % (width, height) + 0.5), {
            "gravity": (0.0, -0.3), "walls": [post],
        }  # fmt: skip
    return box, state, {}


def made(box: Box, state: State, **options: Any) -> Simulation:
    return Simulation(gases.equal_disks(60), box, LAW, state, record=["ledger"], **options)


def assert_same_motion(one: State, other: State) -> None:
    # A new simulation measures positions from other corners: rounding, which collisions multiply.
    np.testing.assert_allclose(one.position, other.position, rtol=0, atol=1e-8)
    np.testing.assert_allclose(one.velocity, other.velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(one.spin, other.spin, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(one.collisions, other.collisions)


def turned(gas: Simulation) -> None:
    """Other velocities for every disk, and spins."""
    state = gas.state
    gas.set_velocities(-1.5 * state.velocity[::-1], 0.5 * state.spin)


CHANGES: dict[str, tuple[Callable[[Simulation], None], dict[str, Any]]] = {
    "law": (lambda gas: gas.set_law(ROUGH), {"law": ROUGH}),
    "forces": (
        lambda gas: gas.set_forces([forces.Langevin(0.1, temperature=2.0, rate=1.0)]),
        {"forces": [forces.Langevin(0.1, temperature=2.0, rate=1.0)]},
    ),
    "velocities": (turned, {}),
    "gravity": (lambda gas: gas.set_gravity((0.2, 0.5)), {"gravity": (0.2, 0.5)}),
}


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (kind, change)
        for kind in ("periodic", "sheared", "open", "walls")
        for change in CHANGES
        if change != "gravity" or kind == "walls"  # elsewhere disks would fall for ever
    ],
)
def test_a_changed_gas_continues_as_a_new_one_from_its_state_and_the_ledger_closes(
    kind: str, change: str
) -> None:
    box, state, options = setting(kind)
    disks = gases.equal_disks(60)
    gas = Simulation(disks, box, LAW, state, record=["ledger"], seed=5, **options)
    gas.run(t_end=1.0)
    act, given = CHANGES[change]
    act(gas)
    fresh = {"law": LAW, "record": ["ledger"], "seed": 5, **options, **given}
    other = Simulation(disks, box, state=gas.state, **fresh)
    assert gas.setup.to_record() == other.setup.to_record()
    assert repr(gas).splitlines()[0] == repr(other).splitlines()[0]
    gas.run(t_end=1.4)
    other.run(t_end=1.4)
    assert gas.collisions > 0
    assert_same_motion(gas.state, other.state)
    # What is missing of what was there and was put in must be what the mechanisms took, all collisions included.
    measure = gas.measure()
    assert measure.dissipated is not None
    assert gas.dissipated_energy == pytest.approx(float(measure.dissipated.sum()), rel=1e-9, abs=1e-10)


def test_the_change_of_energy_by_other_velocities_and_gravity_is_its_definition() -> None:
    """Velocities times 3, spins kept: translational energy grows by 8 times itself; gravity: -m (g' - g) . x."""
    box, state, options = setting("walls")
    gas = made(box, state, **options)
    gas.run(t_end=0.5)
    before, present = gas.measure(), gas.state
    gas.set_velocities(3.0 * present.velocity)
    assert gas.energy_input == pytest.approx(8.0 * before.translational_energy, rel=1e-12)
    assert gas.measure().rotational_energy == pytest.approx(before.rotational_energy, rel=1e-12)
    energy_input = gas.energy_input
    gas.set_gravity((0.1, -0.1))
    fall = -float(np.sum(present.position @ np.array([0.1, 0.2])))  # masses are 1
    assert gas.energy_input - energy_input == pytest.approx(fall, rel=1e-12)
    assert gas.gravity == (0.1, -0.1)


@pytest.mark.full
def test_energy_that_former_forces_put_in_still_counts() -> None:
    box, state, _ = setting("periodic")
    gas = made(box, state, forces=[forces.RandomKicks(0.05, power=1.0)])
    gas.run(t_end=1.0)
    energy_input = gas.energy_input
    assert energy_input > 0.0
    gas.set_forces([])
    assert gas.energy_input == energy_input
    assert gas.forces == ()
    gas.run(t_end=2.0)
    assert gas.energy_input == energy_input


def test_a_gas_that_has_flown_apart_or_rests_moves_again_with_other_velocities() -> None:
    disks = gases.equal_disks(2)
    apart = State([[0.0, 0.0], [2.0, 0.0]], [[-1.0, 0.0], [1.0, 0.0]], [0.0, 0.0])
    gas = Simulation(disks, Box.open(), IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), apart, record=["ledger"])
    gas.run(t_end=10.0)
    assert gas.collisions == 0
    gas.set_velocities([[1.0, 0.0], [-1.0, 0.0]])  # 22 apart, they touch after 10.5
    gas.run(t_end=20.4)
    assert gas.collisions == 0
    gas.run(t_end=20.6)
    assert gas.collisions == 1
    box, state, _ = setting("periodic")
    still = replace(state, velocity=np.zeros((60, 2)), spin=np.zeros(60))
    resting = made(box, still)
    resting.run(t_end=1.0)
    resting.set_velocities(state.velocity, state.spin)
    resting.run(t_end=2.0)
    assert resting.collisions > 0


def test_histories_continue_across_a_change_of_velocities() -> None:
    box, state, _ = setting("periodic")
    gas = made(box, state, histories=[4])
    gas.run(t_end=0.5)
    gas.take_events()
    old = gas.state.velocity[4]
    turned(gas)
    kick = gas.take_events()
    assert kick.partner.tolist() == [-1]
    np.testing.assert_allclose(kick.velocity_before[0], old)
    np.testing.assert_allclose(kick.velocity_after[0], gas.state.velocity[4])


@pytest.mark.full
def test_a_custom_law_is_checked_when_it_is_set_and_used_in_the_next_run() -> None:
    """Smooth disks keep their spins, and lose energy where e < 1."""
    box, state, _ = setting("periodic")
    gas = made(box, state)
    gas.run(t_end=0.5)
    gas.set_law(Lossy(e=0.5))  # whose trial says nothing: no collision gains
    spin, energy = gas.state.spin, gas.measure().energy
    gas.run(t_end=1.5)
    np.testing.assert_array_equal(gas.state.spin, spin)
    assert gas.measure().energy < energy


def test_a_checkpoint_of_a_changed_gas_fits_one_changed_likewise(tmp_path: Path) -> None:
    box, state, _ = setting("periodic")
    gas, other = (made(box, state) for _ in range(2))
    gas.run(t_end=0.5)
    turned(gas)
    gas.set_law(ROUGH)
    gas.save_checkpoint(tmp_path / "a.h5")
    with pytest.raises(InputError, match="another gas"):
        other.load_checkpoint(tmp_path / "a.h5")
    other.set_law(ROUGH)
    other.load_checkpoint(tmp_path / "a.h5")
    gas.run(t_end=1.0)
    other.run(t_end=1.0)
    np.testing.assert_array_equal(gas.state.velocity, other.state.velocity)
    assert gas.energy_input == other.energy_input != 0.0


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda gas: gas.set_velocities(np.zeros((3, 2))), "velocity has shape"),
        (lambda gas: gas.set_velocities(np.full((60, 2), np.nan)), "finite"),
        (
            lambda gas: gas.set_velocities(np.zeros((60, 2)), np.zeros(3)),
            r"spin has shape \(3,\): must .*\(60,\)",
        ),
        (lambda gas: gas.set_velocities(np.full((60, 2), 1e200)), "units"),
        (lambda gas: gas.set_gravity((0.0, -1.0)), r"^gravity = \(0.0, -1.0\): .* box.periodic"),
        (lambda gas: gas.set_gravity(3.0), "gravity = 3.0: must be"),
        (lambda gas: gas.set_forces([1]), r"forces\[0\] = 1"),
        (lambda gas: gas.set_law(3), "IFRLaw"),
        (lambda gas: gas.set_law([[LAW, ROUGH], [LAW, LAW]]), "differ"),
    ],
)
def test_a_refused_change_leaves_the_gas_as_it_was(act: Callable[[Simulation], None], says: str) -> None:
    box, state, _ = setting("periodic")
    gas, other = (made(box, state) for _ in range(2))
    gas.run(t_end=0.3)
    with pytest.raises(InputError, match=says):
        act(gas)
    gas.run(t_end=0.6)
    other.run(t_end=0.3)
    other.run(t_end=0.6)
    np.testing.assert_array_equal(gas.state.velocity, other.state.velocity)
    assert gas.energy_input == 0.0
    assert math.isclose(gas.dissipated_energy, other.dissipated_energy, rel_tol=1e-9)
