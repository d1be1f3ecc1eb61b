"""Collision laws: independent friction-restitution, its measured coins, other laws of the field, custom laws."""

from .model.coin_table import Coin, coins
from .model.collision import Collision, collide
from .model.ifr import Admissibility, EnergyWarning, IFRLaw, Regime, rough_disks, smooth_disks
from .model.law import CollisionLaw
from .model.viscoelastic import Viscoelastic
from .model.walton import Walton

__all__ = [
    "Admissibility", "Coin", "Collision", "CollisionLaw", "EnergyWarning", "IFRLaw", "Regime", "Viscoelastic", "Walton",
    "coins", "collide", "rough_disks", "smooth_disks",
]  # fmt: skip
