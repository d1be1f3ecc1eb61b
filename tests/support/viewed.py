"""A small trajectory for the viewer: forty disks that turn, one of them tracked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from support import layout_files

from ifrdem.model.state import Disks, State
from ifrdem.trajectory.writer import TrajectoryWriter

DISKS, FRAMES, TRACKED = 40, 4, 7
RADIUS = np.where(np.arange(DISKS) % 2, 0.4, 0.8)
FIELDS = ("position", "velocity", "angle", "angular_velocity", "collisions")
UNITS = {"length": "m", "time": "s", "mass": "kg", "energy": "J", "angle": "rad"}
EVENTS = [  # of disk 7: with disk 3, wall 1, a kick, disk 9
    {"time": 0.05, "id": TRACKED, "partner": 3, "psi": 0.2, "regime": 1},
    {"time": 0.12, "id": TRACKED, "partner": -3, "psi": 0.3, "regime": 2},
    {"time": 0.14, "id": TRACKED, "partner": -1},
    {"time": 0.25, "id": TRACKED, "partner": 9, "psi": 0.1, "regime": 1},
]
EVENTS[0] |= {"velocity_before": [1.0, 2.0], "velocity_after": [-1.0, 2.5]}


def state(frame: int) -> State:
    """Places on a lattice in the box of 30 x 20, which moves to the right and cuts disks at the sides."""
    i = np.arange(DISKS)
    found = layout_files.some_state(DISKS, frame)
    found.position[:] = np.mod(
        np.column_stack([(i % 8) * 3.75 + 0.3 + frame, (i // 8) * 4.0 + 0.2]), (30.0, 20.0)
    )
    found.angle = 0.5 * frame * i
    return found


def writer(path: Path) -> TrajectoryWriter:
    disks = Disks(DISKS, mass=1.0, radius=RADIUS, material=np.arange(DISKS) % 2)
    return TrajectoryWriter(path, disks, layout_files.BOX, fields=FIELDS, units=UNITS)


def add(file: TrajectoryWriter, frame: int) -> None:
    file.write(
        state(frame),
        {"temperature": 1.0 / (1 + frame), "rotational_temperature": 0.2, "collisions": 10 * frame},
    )


def write(path: Path) -> Path:
    with writer(path) as file:
        for frame in range(FRAMES):
            add(file, frame)
    first = state(0)
    start = {
        "time": 0.0,
        **{name: getattr(first, name)[[TRACKED]] for name in ("position", "velocity", "spin", "image")},
    }
    layout_files.add_histories(path, [TRACKED], start, EVENTS, [(len(EVENTS), 0.3)])
    return path
