"""Histories of tracked disks: their events come back, and their paths are exact between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.layout_files import BOX, EVENT_COLUMNS, add_histories, some_state, write

from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.trajectory import history
from ifrdem.trajectory.reader import Trajectory

TRACKED = [1, 4, 6]


def start_of(n: int, box: Box = BOX, time: float = 0.0) -> dict[str, np.ndarray]:
    """Where the tracked disks begin."""
    state = some_state(n, 0, box)
    return {
        "time": time,
        **{name: getattr(state, name)[TRACKED] for name in ("position", "velocity", "spin", "image")},
    }


def bounces(e_n: float, height: float, g: float, number: int) -> list[dict]:
    """A disk dropped from a height above the floor, and bouncing: events of disk 1 with wall 0.

    It falls for sqrt(2 h / g), then flies for 2 e_n^j sqrt(2 h / g) after its j-th bounce.
    """
    fall = math.sqrt(2.0 * height / g)
    events, time = [], fall
    for j in range(number):
        speed = g * fall * e_n**j
        events.append(
            {
                "time": time,
                "id": 1,
                "partner": -2,
                "position": [3.0, 0.0],
                "normal": [0.0, -1.0],
                "velocity_before": [0.0, -speed],
                "velocity_after": [0.0, e_n * speed],
                "impulse": [(1.0 + e_n) * speed, 0.0],
                "regime": 1,
            }
        )
        time += 2.0 * e_n ** (j + 1) * fall
    return events


def test_a_bouncing_disk_rises_to_the_heights_of_its_restitution(tmp_path):
    """After the j-th bounce a disk dropped from h rises to e_n^(2 j) h, halfway in time between two bounces."""
    path, e_n, height, g = tmp_path / "run.h5", 0.8, 2.0, 9.81
    events = bounces(e_n, height, g, 6)
    write(path, n=7, box=Box((30.0, 20.0), (True, False)), parameters={"gravity": f"[0.0, {-g}]"})
    start = {
        "time": 0.0,
        "position": [[3.0, height]] * 3,
        "velocity": np.zeros((3, 2)),
        "spin": np.zeros(3),
        "image": np.zeros((3, 2)),
    }
    end = events[-1]["time"]
    add_histories(path, TRACKED, start, events, [(6, end)])
    with Trajectory(path) as trajectory:
        path_of = trajectory.history(1)
    times = np.array([each["time"] for each in events])
    middles = 0.5 * (times[1:] + times[:-1])
    # 1e-14: some roundings of numbers of order 2
    assert np.allclose(
        path_of.position(middles)[:, 1], height * e_n ** (2.0 * np.arange(1, 6)), rtol=0.0, atol=1e-14
    )
    assert np.allclose(path_of.velocity(middles)[:, 1], 0.0, rtol=0.0, atol=1e-13)
    assert path_of.position(0.0).tolist() == [3.0, height]
    # just before the first bounce: all of the energy is in the speed, sqrt(2 g h)
    assert path_of.velocity(np.nextafter(times[0], 0.0))[1] == pytest.approx(
        -math.sqrt(2.0 * g * height), rel=1e-13
    )
    assert path_of.velocity(times[0])[1] == events[0]["velocity_after"][1]  # after the event at its time
    assert path_of.collisions == 6
    assert path_of.mean_free_time == pytest.approx((times[-1] - times[0]) / 5, rel=1e-14)


def random_flight(box: Box, seed: int) -> tuple[dict, list[dict], np.ndarray]:
    """Events of disk 4 at random times with random velocities; also the corners of its path without jumps.

    The path is straight between events and is built here without boxes; the box comes in when it is stored.
    """
    rng = np.random.default_rng(seed)
    lengths = np.array(box.lengths)
    gaps = rng.uniform(0.5, 5.0, 40)
    times = np.concatenate([[1.0], 1.0 + np.cumsum(gaps)])
    velocity = rng.normal(scale=8.0, size=(41, 2))
    corners = np.concatenate(
        [[[7.0, 11.0]], np.array([7.0, 11.0]) + np.cumsum(velocity[:-1] * gaps[:, None], axis=0)]
    )
    image = np.floor(corners / lengths).astype(int)
    spin = rng.normal(size=41)
    events = [
        {
            "time": times[i],
            "id": 4,
            "partner": [2, -1][i % 2],
            "position": corners[i] - image[i] * lengths,
            "image": image[i],
            "velocity_after": velocity[i],
            "spin_after": spin[i],
            "normal": [1.0, 0.0],
        }
        for i in range(1, 41)
    ]
    start = start_of(7)
    start["time"] = 1.0
    for name, value in (
        ("position", corners[0]),
        ("velocity", velocity[0]),
        ("spin", spin[0]),
        ("image", [0, 0]),
    ):
        start[name][1] = value
    return start, events, np.column_stack([times, corners, spin])


def test_a_path_is_exact_between_events_inside_the_box_and_without_jumps(tmp_path):
    path = tmp_path / "run.h5"
    start, events, corners = random_flight(BOX, 3)
    # events of another tracked disk in between must not matter
    others = [{"time": each["time"] + 0.1, "id": 6, "position": [1.0, 1.0]} for each in events]
    write(path, n=7)
    everything = sorted(events + others, key=lambda each: (each["time"], each["id"]))
    end = corners[-1, 0] + 3.0
    add_histories(path, TRACKED, start, everything, [(10, 2.0), (80, end)])
    with Trajectory(path) as trajectory:
        assert trajectory.tracked.tolist() == TRACKED
        whole = trajectory.history(4)
    times = corners[:, 0]
    at = np.random.default_rng(1).uniform(1.0, times[-1], (5, 40))
    unwrapped = np.stack([np.interp(at, times, corners[:, axis]) for axis in (1, 2)], axis=-1)
    lengths = np.array(BOX.lengths)
    assert np.abs(whole.unwrapped(at)).max() > 100.0  # it does leave the box
    assert np.allclose(whole.unwrapped(at), unwrapped, rtol=0.0, atol=1e-10)  # np.interp's rounding
    inside = whole.position(at)
    assert (inside >= 0.0).all()
    assert (inside < lengths).all()
    off = (inside - unwrapped) / lengths
    assert np.allclose(off, np.round(off), rtol=0.0, atol=1e-11)
    assert np.array_equal(whole.position(times[1:]), [each["position"] for each in events])
    # the angle is the integral of the spin, which is constant between events
    turned = np.concatenate([[0.0], np.cumsum(corners[:-1, 3] * np.diff(times))])
    assert np.allclose(whole.angle(at), np.interp(at, times, turned), rtol=0.0, atol=1e-11)
    steps = np.searchsorted(times, at, side="right") - 1
    assert np.array_equal(whole.spin(at), corners[steps, 3])
    assert whole.position(1.5).shape == (2,)
    assert whole.velocity(at).shape == (5, 40, 2)
    assert whole.spin(end) == corners[-1, 3]
    assert (len(whole), whole.collisions) == (40, 20)
    assert (whole.start, whole.end) == (1.0, end)


def test_a_disk_that_leaves_a_sheared_box_above_comes_in_below_slower(tmp_path):
    """Lees and Edwards: at time t it comes in shear_rate Ly t further left, and shear_rate Ly slower.

    shear_rate 0.1, Ly = 20: the image moves with 2. A disk at (10, 15) with velocity (3, 4) from t = 2 on is above at
    t = 3.25, at x = 13.75; it comes in at x = 13.75 - 2 * 3.25 = 7.25 with velocity (1, 4).
    """
    path, box = tmp_path / "run.h5", Box((30.0, 20.0), shear_rate=0.1)
    write(path, n=7, box=box)
    start = start_of(7, box)
    start["time"] = 2.0
    start["position"][0], start["velocity"][0], start["image"][0] = (10.0, 15.0), (3.0, 4.0), (0, 2)
    add_histories(path, TRACKED, start, [], [(0, 10.0)])
    with Trajectory(path) as trajectory:
        whole = trajectory.history(1)
    assert np.allclose(whole.position(3.25 - 1e-9), (13.75, 20.0), atol=1e-8)
    assert np.allclose(whole.position(3.25 + 1e-9), (7.25, 0.0), atol=1e-8)
    assert np.allclose(whole.velocity([3.0, 3.5]), [(3.0, 4.0), (1.0, 4.0)], rtol=1e-15)
    assert np.allclose(whole.position(4.25), (8.25, 4.0), rtol=1e-14)
    # Without jumps it is a straight line with the velocity (3 + 2 boxes * 2, 4).
    line = np.array([10.0 + 2 * 2.0 * 2.0, 15.0 + 40.0]) + np.array([0.0, 1.25, 6.0])[:, None] * (7.0, 4.0)
    assert np.allclose(whole.unwrapped([2.0, 3.25, 8.0]), line, rtol=1e-14)


def test_every_column_comes_back_and_contact_points_lie_on_the_rim(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=7)
    rng = np.random.default_rng(5)
    events = []
    for i in range(30):
        each = {
            name: rng.normal(size=2 if dtype[0] == "2" else None) for name, dtype in EVENT_COLUMNS.items()
        }
        angle = rng.uniform(0.0, 7.0)
        each |= {
            "time": 0.1 * i, "id": TRACKED[i % 3], "partner": int(rng.integers(-3, 7)),
            "image": rng.integers(-3, 3, 2), "normal": [math.cos(angle), math.sin(angle)],
            "regime": int(rng.integers(-1, 10)),
        }  # fmt: skip
        events.append(each)
    add_histories(path, TRACKED, start_of(7), events, [(30, 5.0)])
    with Trajectory(path) as trajectory:
        whole = trajectory.history(6)
        radius = trajectory.disks.radius[6]
    mine = [each for each in events if each["id"] == 6]
    for name in EVENT_COLUMNS:
        if name != "id":
            assert np.array_equal(whole[name], [each[name] for each in mine]), name
    assert np.array_equal(whole.psi, whole["psi"])
    assert np.allclose(np.hypot(*(whole.contact_point - whole["position"]).T), radius, rtol=1e-14)
    with pytest.raises(KeyError, match=r"no column 'impuls'.*did you mean 'impulse'"):
        whole["impuls"]


def test_events_that_are_not_committed_do_not_count(tmp_path):
    path = tmp_path / "run.h5"
    start, events, corners = random_flight(BOX, 8)
    write(path, n=7)
    end = 0.5 * (corners[25, 0] + corners[26, 0])
    add_histories(path, TRACKED, start, events, [(12, corners[12, 0]), (25, end)])
    with Trajectory(path) as trajectory:
        whole = trajectory.history(4)
    assert len(whole) == 25
    assert whole.end == end
    middle = 0.5 * (corners[25, 1:3] + corners[26, 1:3])
    assert np.allclose(whole.unwrapped(end), middle, rtol=0.0, atol=1e-10)
    for t in (0.999, np.nextafter(end, np.inf), math.nan):
        with pytest.raises(InputError, match=r"t = .*: the history of disk 4 is known from 1 to "):
            whole.position([2.0, t])


def test_histories_without_a_commit_are_damaged(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=7)
    add_histories(path, TRACKED, start_of(7), [], [])
    with pytest.raises(InputError, match="its histories have no commit"), Trajectory(path) as trajectory:
        trajectory.history(1)


def test_long_histories_are_read_in_blocks(tmp_path, monkeypatch):
    path = tmp_path / "run.h5"
    write(path, n=7)
    events = [
        {"time": 0.1 * i, "id": 1 if i % 5 else 4, "position": [i, i], "partner": i} for i in range(100)
    ]
    add_histories(path, TRACKED, start_of(7), events, [(97, 9.7)])
    with Trajectory(path) as trajectory:
        monkeypatch.setattr(history, "_BLOCK", 7)
        assert trajectory.history(4).partner.tolist() == list(range(0, 97, 5))
        assert len(trajectory.history(6)) == 0
        assert trajectory.history(6).position(9.7).shape == (2,)


def test_disks_without_history_are_distinguished(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=7)
    with (
        Trajectory(path) as trajectory,
        pytest.raises(InputError, match=r"holds no histories: .*output\.histories"),
    ):
        trajectory.history(1)
    add_histories(path, TRACKED, start_of(7), [], [(0, 0.0)])
    with Trajectory(path) as trajectory:
        with pytest.raises(
            InputError, match=r"disk 3 of .* is not tracked: 3 of 7 disks are \(1, 4, 6\); the nearest is 4"
        ):
            trajectory.history(3)
        for disk in (7, -1):
            with pytest.raises(InputError, match=rf"disk {disk} of .*: there are 7 disks \(0 to 6\)"):
                trajectory.history(disk)
        assert repr(trajectory.history(1)) == "<History of disk 1: 0 collisions, t = 0 to 0>"
