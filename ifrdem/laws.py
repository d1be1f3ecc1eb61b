"""Collision laws: the independent friction-restitution law, its measured coins, and the base class of custom laws."""

from .model.coin_table import Coin, coins
from .model.ifr import Admissibility, Collision, EnergyWarning, IFRLaw, Regime, collide
from .model.law import CollisionLaw

__all__ = [
    "Admissibility", "Coin", "Collision", "CollisionLaw", "EnergyWarning", "IFRLaw", "Regime", "coins", "collide",
]  # fmt: skip
