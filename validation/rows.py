"""Engines whose laws are rows of coefficients, also such as `Simulation` refuses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..model.box import Box
from ..model.laws.ifr import STICKING, IFRLaw
from ..model.laws.law import CollisionLaw
from ..model.setup import Setup
from ..model.state import Disks, State
from ..simulation.engine import Engine
from ..tools.checked import Array

OF_ENGINE = ("tracking", "comm", "order", "tile_disks")
"""Options of an engine that are not of its setup."""


def law_of(row: Iterable[float], kind: type[CollisionLaw] = IFRLaw) -> CollisionLaw:
    """The law of a row of coefficients (`table_row`); of an `IFRLaw`, also one that could add energy."""
    values = dict(zip(kind.coefficients, map(float, row), strict=True))
    if kind is not IFRLaw:
        return kind(**values)
    law = object.__new__(IFRLaw)  # without its checks
    sticking = STICKING[int(values.pop("contact_point"))]
    for name, value in {**values, "sticking": sticking, "k": 2.0}.items():
        object.__setattr__(law, name, value)
    return law


def engine_of(
    disks: Disks, box: Box, state: State, rows: Array, *, law: type[CollisionLaw] = IFRLaw, **options: Any
) -> Engine:
    """An engine whose laws have these rows of coefficients, shape (M, M, c); options of `Engine` and of `Setup`."""
    own = {name: options.pop(name) for name in OF_ENGINE if name in options}
    table = tuple(tuple(law_of(row, law) for row in each) for each in rows)
    return Engine(Setup(box, table, **options), disks, state, **own)
