"""Rows of series and events of histories for tests of writers, determined by their numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from support.layout_files import some_state

from ifrdem.model.state import State
from ifrdem.quantities import EVENT

TRACKED = (2, 5, 11)
SERIES_COLUMNS = {"dissipated_by_mechanism": ("normal", "sliding")}
EVENTS_A_BATCH = 50


def partnered(n: int, frame: int) -> State:
    """A state that knows each disk's latest partner."""
    state = some_state(n, frame)
    state.last_partner = np.random.default_rng(frame).integers(-3, n, n, dtype=np.int32)  # type: ignore[attr-defined]
    return state


def row(number: int) -> dict[str, object]:
    """The values of a row of the series, whose time is 0.03 * number."""
    return {"energy": 1.0 / (1 + number), "collisions": 7 * number, "dissipated_by_mechanism": [number, 0.25]}


def batch(number: int, count: int = EVENTS_A_BATCH) -> tuple[dict[str, NDArray], float]:
    """Events between the times number and number + 1, and the time up to which they are complete."""
    rng = np.random.default_rng((99, number))
    events: dict[str, NDArray] = {}
    for name, column in EVENT.items():
        shape = (count, *column.tail)
        if not column.whole:
            events[name] = rng.normal(size=shape)
        else:
            events[name] = rng.integers(-1, 10, shape).astype(column.dtype())
    events["id"] = rng.choice(TRACKED, count).astype(np.int32)
    events["time"] = np.sort(number + rng.uniform(0.0, 1.0, count))
    return events, number + 1.0
