"""Materials and pairs: any number of them, each pair of those in use exactly once."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from support.cases import Problems, case_gas, case_text

from ifrdem import IFRLaw, InputError, Simulation, State
from ifrdem.case import keys
from ifrdem.model.box import Box
from ifrdem.model.state import Disks

NAMES = ("a", "b", "c", "d", "e")


def text_of(pairs: list[tuple[str, str]]) -> str:
    """Five materials and six species, two of them of one material; every pair has an e_n of its own."""
    materials = [{"name": name, "e_n": e_n(name, name), "e_t": -0.9, "mu": 0.1} for name in NAMES]
    one = {"radius": 0.5, "speed_rms": 1.0}
    species = [
        {"name": f"s{i}", "number": 20 + i, "material": name, "mass": 1.0 + i} | one
        for i, name in enumerate((*NAMES, "a"))
    ]
    given = [{"materials": [*pair], "e_n": e_n(*pair), "e_t": -0.9, "mu": 0.1} for pair in pairs]
    return case_text({"material": materials, "species": species, "pair": given})


def e_n(one: str, other: str) -> float:
    """Of a pair, whichever comes first."""
    i, j = sorted((NAMES.index(one), NAMES.index(other)))
    return 0.5 + 0.05 * i + 0.01 * j if i != j else 0.95 - 0.01 * i


EVERY = list(itertools.combinations(NAMES, 2))


def test_every_pair_of_many_materials_collides_by_its_own_law(problems: Problems) -> None:
    shuffled = [pair if i % 2 else pair[::-1] for i, pair in enumerate(reversed(EVERY))]
    assert problems(text=text_of(shuffled)) == []
    gas = case_gas(text=text_of(shuffled))
    assert gas.materials == NAMES
    found = [[law.e_n for law in row] for row in gas.laws]
    np.testing.assert_allclose(found, [[e_n(a, b) for b in NAMES] for a in NAMES], rtol=1e-15)
    assert gas.disks.material.tolist() == np.repeat([0, 1, 2, 3, 4, 0], range(20, 26)).tolist()
    assert len(gas.verdicts) == 21  # of six species


def test_every_missing_pair_is_named_once(problems: Problems) -> None:
    found = problems(text=text_of([pair for pair in EVERY if pair not in (("a", "c"), ("d", "e"))]))
    assert found == [
        f"pair: missing for the materials '{a}' and '{b}': give their e_n, e_t and mu in a [[pair]]"
        for a, b in (("a", "c"), ("d", "e"))
    ]


def test_reference_names_the_keys_that_may_stand_instead() -> None:
    lines = [line for line in keys.reference().splitlines() if line.startswith("- `power`")]
    assert len(lines) == 4
    assert all("required unless `diffusion` is given; > 0" in line for line in lines)


def test_a_material_that_is_not_defined_is_reported_once(problems: Problems) -> None:
    (found,) = problems("species[1].material=unknown", text=text_of(EVERY))
    assert found.startswith('species[1].material = "unknown": no such material')


def test_a_pair_given_twice_is_a_conflict_in_either_order(problems: Problems) -> None:
    (found,) = problems(text=text_of([*EVERY, ("c", "b")]))
    assert found == f'pair[10].materials = ["c", "b"]: the materials of pair[{EVERY.index(("b", "c"))}] too'


def test_a_pair_of_coins_is_given_by_their_names(problems: Problems) -> None:
    text = """
    run.collisions_per_disk = 1
    box.packing_fraction = 0.2
    [[species]]
    name = "p"
    coin = "1 pta"
    number = 10
    speed_rms = 1.0
    [[species]]
    name = "q"
    coin = "5 pts"
    number = 10
    speed_rms = 1.0
    """
    (found,) = problems(text=text)
    assert found.startswith("pair: missing for the materials '1 pta' and '5 pts'")
    pair = '\n[[pair]]\nmaterials = ["5 pts", "1 pta"]\ne_n = 0.8\ne_t = -0.9\nmu = 0.2\n'
    gas = case_gas(text=text + pair)
    assert gas.laws[0][1].table_row() == gas.laws[1][0].table_row() == (0.8, -0.9, 0.2, 0.0, 0.0)


def test_simulation_checks_the_extreme_masses_of_a_mixture() -> None:
    # As in test_radii: with e_n = 1, e_t = -0.25, a mean k above 1.5 can add energy. Disks with k = 1 and k = 2 have
    # that where those with k = 1 are the heavier ones: some of the 300 are, equal masses are not enough to see it.
    n = 300
    k = np.where(np.arange(n) % 2 == 0, 1.0, 2.0)
    safe, pair = IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1), IFRLaw(e_n=1.0, e_t=-0.25, mu=0.2, k=1.0)
    position = np.column_stack((np.arange(n) * 1.5, np.full(n, 2.0)))
    state = State(position, np.ones((n, 2)), np.zeros(n))
    disks = Disks(n, mass=np.linspace(1.0, 2.0, n), radius=0.5, k=k, material=(k == 2.0).astype(int))
    with pytest.raises(InputError, match="would add energy"):
        Simulation(disks, Box((450.0, 4.0)), [[safe, pair], [pair, safe]], state)
