"""Numbers that analyses of files show, of motions whose answers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.analysis import catalogue


def test_velocities_that_turn_forget_their_direction_where_the_cosine_does(tmp_path: Path) -> None:
    """All turn by 0.3 between frames: <v(0) v(t)> = <v^2> cos(0.3 t), 0.62 after three, 0.362 < 1/e after four."""
    disks = ifrdem.Disks(40, mass=1.0, radius=0.5)
    position = 1.0 + 2.0 * np.argwhere(np.ones((8, 5)))
    speed, angle = np.random.default_rng(1).uniform(0.5, 1.5, 40), 2.0 * np.pi * np.arange(40) / 40
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box((20.0, 20.0))) as file:
        for time in range(12):
            turned = angle + 0.3 * time
            velocity = speed[:, None] * np.stack((np.cos(turned), np.sin(turned)), axis=1)
            state = ifrdem.State(position, velocity, np.zeros(40), float(time))
            file.write(state, {"temperature": ifrdem.observables.measure(disks, state).temperature})
    found = catalogue.of_vacf(ifrdem.Trajectory(tmp_path / "a.h5"), None)
    rows = {row.name: row.value for row in found.rows}
    assert rows["<v^2>"] == pytest.approx(np.mean(speed**2), rel=1e-6)  # stored in f32
    assert rows["first lag below 1/e"] == 4.0
