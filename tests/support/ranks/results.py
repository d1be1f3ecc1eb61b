"""Differences between a trajectory that ranks wrote and that of one process."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

RECORD = {"case", "overrides", "case_in_full", "started", "threads", "ranks", "device"}
"""Parameters of a run, not of the gas."""


def differing(one: Path, other: Path) -> list[str]:
    """Datasets of a file that are not, bit for bit, those of another one."""
    found: list[str] = []
    with h5py.File(one) as a, h5py.File(other) as b:

        def look(name: str, item: object) -> None:
            if isinstance(item, h5py.Dataset) and name.rpartition("/")[2] not in RECORD:
                x, y = np.asarray(item[()]), np.asarray(b[name][()])
                if x.dtype != y.dtype or x.tobytes() != y.tobytes():
                    found.append(name)

        a.visititems(look)
    return found
