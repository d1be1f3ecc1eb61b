"""Event-exact simulation of granular gases of rough disks with the independent friction-restitution law.

The names below are imported when they are first used, so that `import ifrdem` is quick and starts nothing.
"""

from __future__ import annotations

import importlib
import os
import sys
import types
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# Taichi, imported later by whomever, prints a banner unless told not to, and in a notebook a line for each kernel.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_ENABLE_PYBUF", "0")

# Public name -> (module, attribute); without an attribute, the module itself.
_PUBLIC: dict[str, tuple[str, str | None]] = {
    "Box": ("box", "Box"),
    "CollisionLaw": ("collision_law", "CollisionLaw"),
    "DSMC": ("dsmc", "DSMC"),
    "Disks": ("state", "Disks"),
    "EnergyWarning": ("law", "EnergyWarning"),
    "EngineError": ("errors", "EngineError"),
    "History": ("history", "History"),
    "IFRLaw": ("law", "IFRLaw"),
    "InputError": ("errors", "InputError"),
    "Ledger": ("recorder", "Ledger"),
    "Regime": ("law", "Regime"),
    "Simulation": ("simulation", "Simulation"),
    "State": ("state", "State"),
    "Trajectory": ("trajectory", "Trajectory"),
    "TrajectoryWriter": ("trajectory_writer", "TrajectoryWriter"),
    "Motion": ("walls", "Motion"),
    "Wall": ("walls", "Wall"),
    "analysis": ("analysis", None),
    "bullet": ("bullet", None),
    "collide": ("law", "collide"),
    "forces": ("forces", None),
    "fit": ("fit", None),
    "growth": ("growth", None),
    "observables": ("observables", None),
    "placement": ("placement", None),
    "plot": ("plot", None),
    "radii": ("radii", None),
    "theory": ("theory", None),
    "views": ("views", None),
}

__all__ = [
    "DSMC",
    "Box",
    "CollisionLaw",
    "Disks",
    "EnergyWarning",
    "EngineError",
    "History",
    "IFRLaw",
    "InputError",
    "Ledger",
    "Motion",
    "Regime",
    "Simulation",
    "State",
    "Trajectory",
    "TrajectoryWriter",
    "Wall",
    "__version__",
    "analysis",
    "bullet",
    "coins",
    "collide",
    "fit",
    "forces",
    "growth",
    "observables",
    "placement",
    "plot",
    "radii",
    "theory",
    "views",
]

if TYPE_CHECKING:
    from . import analysis as analysis
    from . import bullet as bullet
    from . import fit as fit
    from . import forces as forces
    from . import growth as growth
    from . import observables as observables
    from . import placement as placement
    from . import plot as plot
    from . import radii as radii
    from . import theory as theory
    from . import views as views
    from .box import Box
    from .coins import coins
    from .collision_law import CollisionLaw
    from .dsmc import DSMC
    from .errors import EngineError, InputError
    from .history import History
    from .law import EnergyWarning, IFRLaw, Regime, collide
    from .recorder import Ledger
    from .simulation import Simulation
    from .state import Disks, State
    from .trajectory import Trajectory
    from .trajectory_writer import TrajectoryWriter
    from .walls import Motion, Wall


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        from .errors import nearest

        raise AttributeError(f"module 'ifrdem' has no attribute '{name}'{nearest(name, __all__)}")
    module, attribute = _PUBLIC[name]
    found = importlib.import_module(f".{module}", __name__)
    return found if attribute is None else getattr(found, attribute)


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(types.ModuleType):
    """Keeps `ifrdem.coins` the mapping of coins, although a submodule has that name too."""

    @property
    def coins(self) -> Any:
        return importlib.import_module(".coins", __name__).coins

    @coins.setter
    def coins(self, module: types.ModuleType) -> None:
        """Ignore that the import of the submodule wants to set its parent's attribute."""


sys.modules[__name__].__class__ = _Package
