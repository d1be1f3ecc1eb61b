"""The paper's coins, by name."""

from __future__ import annotations

import pytest

from ifrdem.errors import InputError
from ifrdem.model.laws.coin_table import coins
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.validation.paper.equations import TABLE_II

# Sec. III of the paper: mass [g], diameter [mm], alloy
SECTION_3 = {
    "5 pts": (3.00, 17.50, "bronze-aluminium"),
    "100 pts": (9.23, 24.50, "bronze-aluminium"),
    "500 pts": (12.00, 28.00, "bronze-aluminium"),
    "50 cts": (7.80, 24.25, "copper-nickel"),
    "200 pts": (10.50, 25.50, "copper-nickel"),
    "1 pta": (1.19, 21.00, "aluminium"),
    "polyester": (4.03, 30.00, "polyester resin"),
}


def test_coins_are_those_of_section_3_in_si_units():
    assert set(coins) == set(SECTION_3)
    assert len(coins) == 7
    for name, (grams, millimetres, material) in SECTION_3.items():
        coin = coins[name]
        assert coin.name == name
        assert coin.mass == pytest.approx(grams * 1e-3, rel=1e-12)
        assert coin.diameter == pytest.approx(millimetres * 1e-3, rel=1e-12)
        assert coin.radius == pytest.approx(millimetres * 0.5e-3, rel=1e-12)
        assert coin.material == material
        assert coin.k == 2.0


@pytest.mark.parametrize("row", TABLE_II, ids=lambda row: row.disks)
def test_pairs_have_the_coefficients_of_table_2(row):
    law = coins.pair(*row.coins)
    assert law == IFRLaw(e_n=row.e_n, e_t=row.e_t, mu=row.mu, sticking="percussion_center", rho=0.0)
    assert law == coins.pair(*reversed(row.coins))


def test_every_coin_collides_with_its_like_and_adds_no_energy():
    """Strictly: e_t <= -1/2 for homogeneous disks."""
    for name, coin in coins.items():
        assert coins.pair(name, name) == coin.law
        assert coin.law.admissibility(coin.k, coin.k).strict


def test_pair_that_the_paper_did_not_measure_is_refused():
    with pytest.raises(
        InputError, match=r"coins '1 pta' and '5 pts': Table II .* no coefficients for this pair"
    ):
        coins.pair("1 pta", "5 pts")


@pytest.mark.parametrize("error", [InputError, KeyError])
def test_unknown_coin_is_refused_with_the_nearest_name(error):
    with pytest.raises(error) as refused:
        coins["1 pts"]
    assert str(refused.value).startswith("coin = '1 pts': unknown (did you mean '1")
    assert "polyester" in str(refused.value)
    with pytest.raises(error):
        coins.pair("1 pta", "polyster")


def test_coins_are_a_read_only_mapping():
    assert "1 pta" in coins
    assert "25 cts" not in coins
    assert coins.get("25 cts") is None
    with pytest.raises(TypeError):
        coins["1 pta"] = coins["5 pts"]
