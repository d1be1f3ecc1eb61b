"""The coins and disks that the paper collided, by name.

Source: A. Domenech-Carbo et al., "Independent friction-restitution modeling of two-disk collisions": masses and
diameters from Sec. III, coefficients from Table II, in SI units.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...errors import NameMissing, nearest
from .ifr import IFRLaw


@dataclass(frozen=True)
class Coin:
    """A coin or disk of the paper.

    Attributes
    ----------
    name, material : str
        As the paper abbreviates it, and what it is made of.
    mass, diameter : float
        Mass [kg], to 0.01 g (polyester 0.02 g), and diameter [m].
    k : float
        Shape number in I = m R^2 / k: 2, because the paper treats its coins as homogeneous disks.
    law : IFRLaw
        Coefficients against a coin of the same kind, with the paper's percussion-centre sticking, without rolling
        friction.
    """

    name: str
    mass: float
    diameter: float
    k: float
    material: str
    law: IFRLaw

    @property
    def radius(self) -> float:
        """Radius [m]."""
        return 0.5 * self.diameter


class Coins(Mapping[str, Coin]):
    """Read-only mapping of the paper's coins by name.

    A missing name raises an error that is both `InputError` and `KeyError`.
    """

    def __init__(self, coins: tuple[Coin, ...], mixed: Mapping[frozenset[str], IFRLaw]) -> None:
        self._coins: dict[str, Coin] = {coin.name: coin for coin in coins}
        self._mixed = dict(mixed)

    def __getitem__(self, name: str) -> Coin:
        try:
            return self._coins[name]
        except KeyError:
            known = ", ".join(self._coins)
            hint = nearest(str(name), self._coins)
            raise NameMissing(f"coin = {name!r}: unknown{hint}; known are {known}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._coins)

    def __len__(self) -> int:
        return len(self._coins)

    def __repr__(self) -> str:
        return f"Coins({', '.join(self._coins)})"

    def pair(self, a: str, b: str) -> IFRLaw:
        """The law for collisions between coins named `a` and `b`, in either order.

        InputError if a name is unknown, or Table II has no coefficients for the pair: it has like pairs, and 500 pts
        with 100 pts.
        """
        coin_a, coin_b = self[a], self[b]
        if coin_a is coin_b:
            return coin_a.law
        try:
            return self._mixed[frozenset((a, b))]
        except KeyError:
            raise NameMissing(
                f"coins {a!r} and {b!r}: Table II of the paper has no coefficients for this pair, only for "
                "coins of one kind and for '500 pts' with '100 pts'; give the pair's own e_n, e_t and mu"
            ) from None


# 500 pts with 100 pts, 100 pts with 500 pts and 100 pts with 100 pts: one row of coefficients in Table II.
_LARGE_BRONZE = IFRLaw(e_n=0.90, e_t=-0.90, mu=0.15)

coins: Coins = Coins(
    (
        Coin("1 pta", 1.19e-3, 21.00e-3, 2.0, "aluminium", IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)),
        Coin("5 pts", 3.00e-3, 17.50e-3, 2.0, "bronze-aluminium", IFRLaw(e_n=0.80, e_t=-0.98, mu=0.11)),
        # Table II calls it "25 cts", but Sec. III lists a 50 cts coin of this alloy and no 25 cts coin.
        Coin("50 cts", 7.80e-3, 24.25e-3, 2.0, "copper-nickel", IFRLaw(e_n=0.86, e_t=-0.99, mu=0.19)),
        Coin("100 pts", 9.23e-3, 24.50e-3, 2.0, "bronze-aluminium", _LARGE_BRONZE),
        Coin("200 pts", 10.50e-3, 25.50e-3, 2.0, "copper-nickel", IFRLaw(e_n=0.77, e_t=-0.96, mu=0.15)),
        # Table II has no row for two 500 pts coins; its rows with one 500 pts coin stand in.
        Coin("500 pts", 12.00e-3, 28.00e-3, 2.0, "bronze-aluminium", _LARGE_BRONZE),
        Coin("polyester", 4.03e-3, 30.00e-3, 2.0, "polyester resin", IFRLaw(e_n=0.67, e_t=-0.95, mu=0.14)),
    ),
    mixed={frozenset(("500 pts", "100 pts")): _LARGE_BRONZE},
)
"""The paper's coins and disks: `coins["1 pta"]`, `coins.pair("500 pts", "100 pts")`."""
