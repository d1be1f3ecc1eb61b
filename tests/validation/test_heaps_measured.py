"""The estimators of angles and packings of drums and heaps, by shapes whose values are known; LAMMPS's disks alone."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.validation.heaps import drum, heap, soft_grains
from ifrdem.validation.lammps.library import absence


def lattice(width: float, height: float) -> np.ndarray:
    """Places of touching disks of diameter 1 about the origin, rows along x."""
    rows = np.arange(-height, height, math.sqrt(0.75))
    columns = np.arange(-width, width)
    return np.array([(x + 0.5 * (i % 2), y) for i, y in enumerate(rows) for x in columns])


@pytest.mark.parametrize("turned", [0.0, -2.0])
@pytest.mark.parametrize("angle", [0.0, 25.0])
def test_a_straight_surface_has_its_angle_by_both_ways(angle: float, turned: float) -> None:
    """Rows of touching disks up to a line through the axis, which gravity, turned with its frame, sees at the angle."""
    tilt = math.radians(angle) + turned
    at = lattice(12.0, 12.0)
    at = at[(at[:, 1] < 0.0) & (np.hypot(*at.T) < drum.RADIUS - 0.5)]
    turn = np.array([[math.cos(tilt), -math.sin(tilt)], [math.sin(tilt), math.cos(tilt)]])
    disks = Disks(len(at), mass=1.0, radius=0.5)
    surface, centre = drum.angles(disks, turned, at @ turn.T + drum.CENTRE)
    # Rows end up to a diameter apart on both sides, so that the centre is up to 1/4 of one from the middle of some
    # 4.9 below the axis: 3 degrees at most, for the two lowest rows less.
    assert surface == pytest.approx(angle, abs=0.5)
    assert centre == pytest.approx(angle, abs=2.0)


def test_a_triangle_of_touching_disks_has_its_slope_and_packing() -> None:
    """Rows of touching disks below a roof of 25 degrees."""
    at = lattice(15.0, 20.0) + np.array((heap.MIDDLE, 0.0))
    at[:, 1] += heap.PLATE + 0.5 - at[:, 1].min()
    roof = heap.PLATE + 8.5 - math.tan(math.radians(25.0)) * abs(at[:, 0] - heap.MIDDLE)
    at = at[at[:, 1] < roof]
    found = heap.of(Disks(len(at), mass=1.0, radius=0.5), at, 3)
    assert found.angle == pytest.approx(25.0, abs=1.0)  # steps of a row
    # The rectangle holds whole columns, and 3 / 0.866 = 3.46 rows: some parts of rows are denser than others.
    assert found.packing_fraction == pytest.approx(math.pi / math.sqrt(12.0), abs=0.02)
    assert found.awake == 3


def test_what_a_disk_covers_is_its_area() -> None:
    x, y, radius = np.array([heap.MIDDLE]), np.array([heap.BASE + 1.5]), np.array([0.6])
    assert heap.covered(x, y, radius) == pytest.approx(math.pi * 0.36 / 30.0, rel=0.01)
    side = np.array([heap.MIDDLE + heap.SIDE])  # half of it
    assert heap.covered(side, y, radius) == pytest.approx(math.pi * 0.18 / 30.0, rel=0.02)


def test_measured_pieces_of_both_codes_belong_to_the_same_speeds_and_starts() -> None:
    lammps, ours = drum.measured("LAMMPS"), drum.measured("ifrdem")
    assert len(lammps) >= 5
    assert set(ours) == set(lammps)
    for rate, pieces in lammps.items():
        assert len(pieces) >= 12
        assert len(ours[rate]) >= 3  # starts
        assert all(10.0 < one.surface < 50.0 for one in pieces)


@pytest.mark.skipif(absence() is not None, reason="LAMMPS is not installed")
def test_soft_disks_rebound_from_a_floor_and_roll_as_predicted(tmp_path: Path) -> None:
    """One falls by 2 and comes back to e_n^2 of it, e_n to 0.02; one begins to slide at 1, and rolls at 2/3 of it.

    Sliding without spin it ends rolling: m v R = (m R^2 + I) v' / R with I = m R^2 / 2.
    """
    disks = Disks(2, mass=np.array([1.0, 0.5]), radius=np.array([0.5, 0.4]))
    start = State([[1.0, 2.5], [3.0, 0.4]], [[0.0, 0.0], [1.0, 0.0]], [0.0, 0.0])
    law = IFRLaw(e_n=0.5, e_t=-1.0, mu=0.5)
    time, at = soft_grains.run(
        tmp_path, disks, Box((20.0, 6.0), (False, False)), law, start, t_end=4.0, every=0.01
    )
    height = at[:, 0, 1] - 0.5
    hit = int((height < 0.01).argmax())
    assert math.sqrt(height[hit + 5 : hit + 250].max() / 2.0) == pytest.approx(0.5, abs=0.02)
    late = time > 3.0
    speed = np.polyfit(time[late], at[late, 1, 0], 1)[0]
    assert speed == pytest.approx(2.0 / 3.0, rel=0.02)
