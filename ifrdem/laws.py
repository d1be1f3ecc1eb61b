"""Collision laws: independent friction-restitution, its measured coins, other laws of the field, custom laws."""

from .model.laws.coin_table import Coin, coins
from .model.laws.collision import Collision, collide
from .model.laws.ifr import IFRLaw, Regime, rough_disks, smooth_disks
from .model.laws.law import Admissibility, CollisionLaw, EnergyWarning
from .model.laws.table import TableLaw
from .model.laws.viscoelastic import Viscoelastic
from .model.laws.walton import Walton

__all__ = [
    "Admissibility", "Coin", "Collision", "CollisionLaw", "EnergyWarning", "IFRLaw", "Regime", "TableLaw", "Viscoelastic",
    "Walton", "coins", "collide", "rough_disks", "smooth_disks",
]  # fmt: skip
