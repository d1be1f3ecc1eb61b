"""Input that `IFRLaw` and `collide` refuse, and their messages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import EnergyWarning, IFRLaw
from ifrdem.model.laws.records import LAWS

COIN = {"e_n": 0.87, "e_t": -0.88, "mu": 0.21}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"e_n": 1.2}, r"e_n = 1\.2: .* from 0 to 1"),
        ({"e_n": -0.1}, r"e_n = -0\.1: .* from 0 to 1"),
        ({"e_n": float("nan")}, "e_n = nan"),
        ({"e_n": "0.87"}, r"e_n = '0\.87': must be a number from 0 to 1"),
        ({"e_t": None}, "e_t = None: must be a number from -1 to 1"),
        ({"e_t": -1.5}, r"e_t = -1\.5: .* from -1 to 1"),
        ({"mu": -0.2}, r"mu = -0\.2: must be 0 or more$"),
        ({"mu": float("inf")}, "mu = inf: must be 0, or a number"),
        ({"rho": -1.0}, r"rho = -1\.0: must be 0 or more$"),
        ({"k": 0.0}, r"k = 0\.0: must be a positive number"),
        (
            {"sticking": "contact point"},
            r"sticking = 'contact point': must be one of .*did you mean 'contact_point'",
        ),
        ({"sticking": "glue"}, r"sticking = 'glue': must be one of 'percussion_center', 'contact_point'$"),
    ],
)
def test_wrong_coefficient_is_named_with_what_is_allowed(change, message):
    with pytest.raises(InputError, match=message):
        IFRLaw(**(COIN | change))


def test_law_is_frozen_and_takes_keywords_only():
    law = IFRLaw(**COIN)
    with pytest.raises(dataclasses.FrozenInstanceError):
        law.mu = 0.5
    with pytest.raises(TypeError):
        IFRLaw(0.87, -0.88, 0.21)


def test_default_is_the_papers_choice():
    assert IFRLaw(**COIN) == IFRLaw(**COIN, sticking="percussion_center", rho=0.0)
    assert IFRLaw(**COIN).table_row() == (0.87, -0.88, 0.21, 0.0, 0.0)
    assert IFRLaw(**COIN, sticking="contact_point", rho=0.1).table_row() == (0.87, -0.88, 0.21, 1.0, 0.1)


def test_refusal_names_the_violated_inequality_in_numbers():
    """By hand for kbar = 2, percussion centre: a = 3, c = 1/2, e_s = -0.2 + 1.5 = 1.3;
    a (1 - e_n) = 0.06 and (1.69 - 1) 1.98 0.25 / 0.25 = 1.366; the mu that makes them equal: 0.5
    sqrt(0.06/1.366).
    """
    with pytest.raises(InputError) as refused:
        IFRLaw(e_n=0.98, e_t=-0.2, mu=0.5)
    message = str(refused.value)
    assert message.startswith(
        "a collision would add energy. With e_t <= -0.5 or mu below 0.1048 it would not."
    )
    assert "a (1 - e_n) >= (e_s^2 - 1) (1 + e_n) mu^2 / c^2 must hold" in message
    assert "left is 0.06 and right 1.366 (1.306 more)" in message
    assert "pass their k" in message
    assert "Walton" not in message


def test_refusal_names_the_sliding_inequality_in_numbers():
    """By hand: (1 - e_n) (1 - e_t^2) = 0.5 0.36 = 0.18 and a mu^2 (1 + e_n) = 3 0.09 1.5 = 0.405."""
    with pytest.raises(InputError) as refused:
        IFRLaw(e_n=0.5, e_t=0.8, mu=0.3)
    assert "(1 - e_n) (1 - e_t^2) >= a mu^2 (1 + e_n) must hold" in str(refused.value)
    assert "left is 0.18 and right 0.405 (0.225 more)" in str(refused.value)
    assert 'law = "walton" or "rough"' in str(refused.value)  # e_t above 0 may be meant as theirs
    assert {"walton", "rough"} <= set(LAWS)


def test_what_only_the_total_saves_warns_at_the_callers_line():
    with pytest.warns(EnergyWarning, match=r"e_t <= \(1 - kbar\) / 2 = -0.5 is exceeded by 0.2") as caught:
        IFRLaw(e_n=0.8, e_t=-0.3, mu=0.1)
    assert caught[0].filename == __file__


def test_k_decides_whether_a_law_is_admissible():
    """e_n = 1: percussion centre needs e_t <= (1 - k)/2, 0 for hoops and -1/2 for disks."""
    with pytest.raises(InputError):
        IFRLaw(e_n=1.0, e_t=-0.2, mu=0.5)
    hoop = IFRLaw(e_n=1.0, e_t=-0.2, mu=0.5, k=1.0)
    hoop.check(1.0, 1.0)
    with pytest.raises(InputError, match=r"kbar\) is 2"):
        hoop.check(2.0, 2.0)
    assert hoop.admissibility(1.0, 1.0)[:2] == (True, True)
    assert hoop.admissibility(2.0, 2.0)[:2] == (False, False)


def test_masses_weigh_k_by_the_other_mass():
    """kbar = (k_i m_j + k_j m_i)/(m_i + m_j): (1 3 + 2 1)/4 = 1.25; against a wall that of the disk."""
    law = IFRLaw(e_n=1.0, e_t=-0.2, mu=0.5, k=1.0)  # strict up to kbar = 1.4
    law.check(1.0, 2.0, m_i=1.0, m_j=3.0)
    assert "(kbar) is 1.25:" in law.admissibility(1.0, 2.0, 1.0, 3.0).message
    with pytest.raises(InputError, match=r"kbar\) is 1.75"):
        law.check(1.0, 2.0, m_i=3.0, m_j=1.0)
    law.check(1.0, 9.0, m_j=np.inf)
    law.check(9.0, 1.0, m_i=np.inf)
    with pytest.raises(InputError, match=r"kbar\) is 9"):
        law.check(9.0, 1.0, m_j=np.inf)


def test_equal_k_is_exact_for_any_masses():
    """On the edge of the set with e_n = 1 nothing may be lost to rounding: e_s = -1/2 + 3/2 = 1."""
    law = IFRLaw(e_n=1.0, e_t=-0.5, mu=0.5)
    for m_j in (1 / 3, 0.7, 1e-8, 1e8):
        law.check(2.0, 2.0, m_i=0.1, m_j=m_j)


def test_check_warns_where_only_the_total_energy_budget_holds():
    law = IFRLaw(e_n=0.8, e_t=-0.3, mu=0.1, k=1.0)  # strict for k <= 1.6
    with pytest.warns(EnergyWarning, match="outweighs") as caught:
        law.check(2.0, 2.0)
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    "arguments", [(0.0, 1.0), (1.0, float("nan")), (1, 1, -1, 1), (1, 1, np.inf, np.inf)]
)
def test_admissibility_refuses_invalid_pairs_of_disks(arguments):
    with pytest.raises(InputError, match=r"(k_i|k_j|m_i) = .*(positive|finite)"):
        IFRLaw(**COIN).admissibility(*arguments)


PAIR = {
    "normal": [1.0, 0.0],
    "mass": [1.0, 1.0],
    "radius": [1.0, 1.0],
    "k": [2.0, 2.0],
    "velocity": [[1.0, 0.0], [0.0, 0.0]],
    "spin": [0.0, 0.0],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"normal": [1.0, 1e-3]}, r"normal\[0\] = 1: must be a unit vector"),
        (
            {"normal": [[1.0, 0.0], [0.0, np.nan]]},
            r"normal\[1, 1\] = nan: must be finite, at most 1e\+50 in size",
        ),
        (
            {"normal": [1.0, 0.0, 0.0]},
            r"normal has shape \(3,\): must be an array of real numbers of shape \(\.\.\., 2\)",
        ),
        ({"mass": 1.0}, r"mass has shape \(\)"),
        ({"mass": [1.0, -1.0]}, r"mass\[1\] = -1\.0: must be positive, from 1e-50, or inf"),
        ({"mass": [[1.0, 1.0], [np.nan, 1.0]]}, r"mass\[1, 0\] = nan"),
        ({"mass": [np.inf, np.inf]}, r"mass\[0\] = inf: only one of the two may be infinite"),
        ({"radius": [0.0, 1.0]}, r"radius\[0\] = 0\.0: must be positive, from 1e-50, or inf"),
        ({"radius": [1.0, np.inf]}, r"radius\[1\] = inf: only an infinite mass"),
        ({"mass": [1, np.inf], "radius": [1, np.inf], "spin": [0, 2]}, r"spin\[1\] = 2: a flat wall"),
        ({"k": [2.0, np.inf]}, r"k\[1\] = inf: must be positive, from 1e-50 to 1e\+50"),
        (
            {"velocity": [[1.0, np.nan], [0.0, 0.0]]},
            r"velocity\[0, 1\] = nan: must be finite, at most 1e\+50 in size",
        ),
        (
            {"velocity": [1.0, 0.0]},
            r"velocity has shape \(2,\): must be an array of real numbers of shape \(\.\.\., 2, 2\)",
        ),
        ({"spin": [np.inf, 0.0]}, r"spin\[0\] = inf: must be finite, at most 1e\+50 in size"),
        (
            {"mass": np.ones((3, 2)), "spin": np.ones((4, 2))},
            r"\(3, 2\).*\(4, 2\): their leading axes must broadcast",
        ),
    ],
)
def test_collide_names_the_value_that_is_wrong(change, message):
    with pytest.raises(InputError, match=message):
        collide(IFRLaw(**COIN), **(PAIR | change))


def test_collide_examines_k_that_the_law_was_not_made_for():
    """a = 10, e_s = -0.88 + 5 = 4.12; (4.12^2 - 1) 1.87 0.21^2/0.25 = 5.27 against 10 0.13 = 1.3."""
    with pytest.raises(InputError, match=r"left is 1.3 and right 5.269"):
        collide(IFRLaw(**COIN), **(PAIR | {"k": [9.0, 9.0]}))
    with pytest.warns(EnergyWarning) as caught:
        collide(IFRLaw(**COIN), **(PAIR | {"k": [4.0, 4.0]}))  # e_s = 1.62 > 1; 0.535 against 0.65
    assert caught[0].filename == __file__
    collide(IFRLaw(**COIN), **(PAIR | {"k": [2.0, 9.0], "mass": [1.0, np.inf]}))  # a wall's k does not matter
