"""Forces between collisions: random forces, heat baths, drag, thermostats, friction on a table, and custom ones.

`Force` is the base class of custom forces. The module imports Taichi.
"""

from .model.forces import (
    Drag,
    Force,
    Langevin,
    PoissonForce,
    PoissonKicks,
    PoissonSpinKicks,
    RandomKicks,
    Rescale,
    SpinKicks,
    TableFriction,
    normals,
    uniforms,
)

__all__ = [
    "Drag", "Force", "Langevin", "PoissonForce", "PoissonKicks", "PoissonSpinKicks", "RandomKicks", "Rescale",
    "SpinKicks", "TableFriction", "normals", "uniforms",
]  # fmt: skip
