"""Small trajectory files of layout 1.1, built with h5py alone from the text of the layout."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.trajectory.writer import TrajectoryWriter

BOX = Box((30.0, 20.0))
FIELDS = ("position", "velocity", "angular_velocity", "collisions", "image")
MECHANISMS = ("normal", "tangential_restitution", "sliding", "sticking", "rolling", "walls")
REGIMES = ("sliding", "sticking", "rolling_sliding", "rolling_sticking", "elastic")
EVENT_COLUMNS = {
    "time": "f8",
    "id": "i4",
    "partner": "i4",
    "position": "2f8",
    "image": "2i4",
    "normal": "2f8",
    "velocity_before": "2f8",
    "velocity_after": "2f8",
    "spin_before": "f8",
    "spin_after": "f8",
    "partner_velocity_before": "2f8",
    "partner_velocity_after": "2f8",
    "partner_spin_before": "f8",
    "partner_spin_after": "f8",
    "impulse": "2f8",
    "psi": "f8",
    "regime": "i1",
}


def some_disks(n: int) -> Disks:
    rng = np.random.default_rng(1)
    return Disks(
        n,
        mass=rng.uniform(1.0, 2.0, n),
        radius=rng.uniform(0.1, 0.2, n),
        k=rng.uniform(1.0, 2.0, n),
        material=rng.integers(0, 3, n),
    )


def some_state(n: int, frame: int, box: Box = BOX) -> State:
    """A state that its number determines."""
    rng = np.random.default_rng(frame)
    return State(
        rng.uniform(0.0, 1.0, (n, 2)) * (box.lengths if not box.is_open else (30.0, 20.0)),
        rng.normal(size=(n, 2)),
        rng.normal(size=n),
        time=0.1 * frame,
        collisions=rng.integers(0, 1000, n, dtype=np.int32),
        image=np.zeros((n, 2), np.int32) if box.is_open else rng.integers(-5, 5, (n, 2), dtype=np.int32),
    )


def write(path: Path, n: int = 5, frames: int = 3, *, box: Box = BOX, **options) -> None:
    with TrajectoryWriter(path, some_disks(n), box, **options) as writer:
        for frame in range(frames):
            writer.write(
                some_state(n, frame, box),
                {"energy": 0.1 * frame, "collisions": 10 * frame, "momentum": np.array([1.0, frame])},
            )


def add_series(path: Path, rows: int = 7) -> dict[str, np.ndarray]:
    """Series of a file, the last row of each uncommitted; returns the committed ones."""
    rng = np.random.default_rng(3)
    series = {
        "energy": rng.uniform(size=rows),
        "momentum": rng.normal(size=(rows, 2)),
        "dissipated_by_mechanism": rng.uniform(size=(rows, 6)),
        "collisions_by_regime": rng.integers(0, 99, (rows, 5)),
        "ledger_residual": 1e-15 * rng.normal(size=rows),
    }
    with h5py.File(path, "r+") as file:
        group = file.create_group("timeseries")
        group.create_dataset("step", data=np.arange(rows), maxshape=(None,), chunks=(64,))
        group.create_dataset(
            "time", data=np.append(0.02 * np.arange(rows), 9.0), maxshape=(None,), chunks=(64,)
        )
        for name, value in series.items():
            one = group.create_group(name)
            for shared in ("step", "time"):
                one[shared] = group[shared]
            padded = np.concatenate([value, value[-1:]])
            one.create_dataset("value", data=padded, maxshape=(None, *value.shape[1:]), chunks=True)
        group["dissipated_by_mechanism"].attrs["columns"] = list(MECHANISMS)
        group["collisions_by_regime"].attrs["columns"] = list(REGIMES)
        file["h5md/modules/ifrdem"].attrs["version"] = np.array((1, 1), dtype=np.int32)
    return series


def add_histories(
    path: Path,
    tracked: list[int],
    start: dict[str, np.ndarray],
    events: list[dict],
    commits: list[tuple[int, float]],
) -> None:
    """Histories: each event a dict of columns (those not given are 0), commits as (events, time)."""
    with h5py.File(path, "r+") as file:
        group = file.create_group("histories")
        group["tracked"] = np.array(tracked, dtype=np.int32)
        for name, dtype in (
            ("time", "f8"),
            ("position", "f8"),
            ("velocity", "f8"),
            ("spin", "f8"),
            ("image", "i4"),
        ):
            group[f"start/{name}"] = np.asarray(start[name], dtype=dtype)
        for i, (name, dtype) in enumerate((("events", np.int64), ("time", np.float64))):
            column = np.array([commit[i] for commit in commits], dtype=dtype)
            group.create_dataset(f"committed/{name}", data=column, maxshape=(None,), chunks=(64,))
        for name, dtype in EVENT_COLUMNS.items():
            tail = (2,) if dtype.startswith("2") else ()
            column = np.array([each.get(name, np.zeros(tail)) for each in events]).reshape(len(events), *tail)
            group.create_dataset(
                f"events/{name}",
                data=column.astype(dtype.removeprefix("2")),
                maxshape=(None, *tail),
                chunks=(16384, *tail),
            )
        file["h5md/modules/ifrdem"].attrs["version"] = np.array((1, 1), dtype=np.int32)
