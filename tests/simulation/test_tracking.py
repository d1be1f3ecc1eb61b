"""Every collision of tracked disks: their paths are exact, and each row is one collision of the law."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.bounds import check_bounds
from support.gases import equal_disks, mixture, start

from ifrdem import VelocityCutoff
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.forces import Force, PoissonKicks, RandomKicks, Rescale, SpinKicks
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Turn
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.measuring.tracking import ELASTIC, KICK, UNKNOWN, Events
from ifrdem.simulation.simulation import Simulation

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
ROLLING = IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15, sticking="contact_point", rho=0.02)


def two_kinds(n: int) -> Disks:
    """Equal disks but for their shape numbers: all tests share kernels."""
    return Disks(n, mass=1.0, radius=0.5, k=np.where(np.arange(n) % 2, 1.0, 2.0))


def rows_of(events: Events, disk: int) -> dict[str, np.ndarray]:
    return {name: column[events.id == disk] for name, column in events.columns().items()}


def check_path(
    rows: dict[str, np.ndarray], begin: State, end: State, disk: int, box: Box, gravity=(0.0, 0.0)
) -> None:
    """Fly from row to row by velocities after: that must lead from the start through every row to the end."""
    g, lengths = np.array(gravity), np.where(np.isfinite(box.lengths), box.lengths, 0.0)
    t, x, v, w = begin.time, begin.position[disk], begin.velocity[disk], begin.spin[disk]
    for i in range(len(rows["time"]) + 1):
        last = i == len(rows["time"])
        dt = (end.time if last else rows["time"][i]) - t
        x, v = x + v * dt + 0.5 * g * dt * dt, v + g * dt
        if last:
            assert x == pytest.approx(end.position[disk] + end.image[disk] * lengths, abs=1e-10)
            assert v == pytest.approx(end.velocity[disk], abs=1e-11)
            assert w == end.spin[disk]
            return
        assert x == pytest.approx(rows["position"][i] + rows["image"][i] * lengths, abs=1e-11)
        assert v == pytest.approx(rows["velocity_before"][i], abs=1e-12)
        assert w == rows["spin_before"][i]
        t, v, w = rows["time"][i], rows["velocity_after"][i], rows["spin_after"][i]


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("alone", [True, False])
def test_paths_lead_through_every_collision(device, alone, monkeypatch):
    if not alone:
        monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)
    disks = mixture(900)
    box, state = start(disks, 0.4)
    tracked = [0, 13, 400, 899]
    simulation = Simulation(
        disks, box, ROLLING, state, device=device, histories=tracked, record=["last_partner"]
    )
    simulation.run(collisions_per_disk=12.0)
    events, end = simulation.take_events(), simulation.state
    assert np.all(np.diff(events.time) >= 0.0)
    for disk in tracked:
        rows = rows_of(events, disk)
        assert len(rows["time"]) == end.collisions[disk] > 0
        assert rows["partner"][-1] == end.last_partner[disk]
        check_path(rows, state, end, disk, box)
    assert len(simulation.take_events()) == 0


def test_each_row_is_one_collision_of_the_law(device):
    """Impulses, regime, angle and both sides' velocities of every row against `law.collide`."""
    disks = mixture(500)
    box, state = start(disks, 0.3)
    simulation = Simulation(
        disks, box, ROLLING, state, device=device, histories=range(500), record=["last_partner"]
    )
    simulation.run(collisions_per_disk=3.0)
    e = simulation.take_events()
    assert len(e) == 2 * simulation.collisions  # all disks are tracked: each collision twice
    pair = np.stack([e.id, e.partner], axis=1)
    after = collide(
        ROLLING, e.normal, disks.mass[pair], disks.radius[pair], disks.k[pair],
        np.stack([e.velocity_before, e.partner_velocity_before], axis=1),
        np.stack([e.spin_before, e.partner_spin_before], axis=1),
    )  # fmt: skip
    assert e.velocity_after == pytest.approx(after.velocity[:, 0], abs=1e-12)
    assert e.partner_velocity_after == pytest.approx(after.velocity[:, 1], abs=1e-12)
    assert e.spin_after == pytest.approx(after.spin[:, 0], abs=1e-12)
    assert e.partner_spin_after == pytest.approx(after.spin[:, 1], abs=1e-12)
    assert e.impulse == pytest.approx(np.stack([after.P_n, after.P_t], axis=1), abs=1e-12)
    assert np.array_equal(e.regime, after.regime)
    assert len(set(e.regime)) >= 3  # several kinds were seen
    # The pair touches, along the normal.
    other = box.minimum_image(_positions_of_partners(e) - e.position)
    assert other == pytest.approx(
        (disks.radius[e.id] + disks.radius[e.partner])[:, None] * e.normal, abs=1e-10
    )
    u = e.velocity_before - e.partner_velocity_before
    assert np.cos(e.psi) == pytest.approx(np.sum(u * e.normal, axis=1) / np.hypot(*u.T), abs=1e-12)


def _positions_of_partners(e: Events) -> np.ndarray:
    """Each collision stands twice: where the partner's own row says that it is."""
    own = {(t, i, p): row for row, (t, i, p) in enumerate(zip(e.time, e.id, e.partner, strict=True))}
    return e.position[[own[t, p, i] for t, i, p in zip(e.time, e.id, e.partner, strict=True)]]


def test_collisions_at_one_time_are_in_the_order_in_which_they_happened(device):
    """Disks at rest that two others hit from both sides at once: the path leads through both, in one order only."""
    disks = two_kinds(24)  # one hits, and is hit by, disks of its own kind
    middle = np.column_stack((np.full(8, 8.0), 1.0 + 2.0 * np.arange(8)))
    away = np.array([2.0, 0.0])
    state = State(
        np.concatenate((middle, middle - away, middle + away)),
        np.repeat([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0]], 8, axis=0),
        np.zeros(24),
    )
    box = Box((16.0, 16.0))
    simulation = Simulation(
        disks, box, ROLLING, state, device=device, histories=range(24), record=["last_partner"]
    )
    simulation.run(t_end=1.25)
    events, end = simulation.take_events(), simulation.state
    assert any(np.any(np.diff(rows_of(events, disk)["time"]) == 0.0) for disk in range(8))
    for disk in range(24):
        check_path(rows_of(events, disk), state, end, disk, box)


def between_walls() -> tuple[Box, State]:
    """40 disks in layers above y = 0.5 and below y = 7.1."""
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2) * 1.4 + 1.0
    return Box((12.0, 30.0), periodic=(True, False)), State(
        grid, rng.normal(size=(40, 2)), rng.normal(size=40)
    )


def out_of_reach() -> list[Wall]:
    """Walls that heat and turn, above the others: gases between walls share kernels."""
    blade = Wall.segment((5.0, 20.0), (6.0, 20.0), turn=Turn("steady", (5.5, 20.0), rate=0.1))
    return [Wall.line((0.0, 29.0), (0.0, -1.0), temperature=1.0), blade]


def idle_forces() -> list[Force]:
    """Forces that never act, likewise."""
    return [RandomKicks(1e6, power=1.0), SpinKicks(1e6, power=1.0)]


def test_walls_gravity_and_heat_are_in_the_path(device):
    disks, (box, state) = two_kinds(40), between_walls()
    walls = [
        Wall.line((0.0, 0.3), (0.0, 1.0), motion=Motion("sine", amplitude=0.2, frequency=1.0)),
        Wall.line((0.0, 7.3), (0.0, -1.0), temperature=1.5),
        *out_of_reach(),
    ]
    simulation = Simulation(
        disks, box, COIN, state, device=device, walls=walls, gravity=(0.0, -1.0), histories=range(40),
        collapse=VelocityCutoff(0.3), forces=idle_forces(), record=["last_partner"],
    )  # fmt: skip
    simulation.run(t_end=8.0)
    events, end = simulation.take_events(), simulation.state
    for disk in range(40):
        check_path(rows_of(events, disk), state, end, disk, box, (0.0, -1.0))
    check_bounds(simulation, events.time, events.id, events.velocity_after, (0.0, -1.0))
    assert np.count_nonzero(events.partner <= -2) == simulation.wall_collisions
    floor, ceiling = events.partner == -2, events.partner == -3
    assert floor.any()
    assert ceiling.any()
    assert set(events.regime[ceiling]) == {UNKNOWN}
    assert np.count_nonzero(events.regime == ELASTIC) > 0
    # The floor's velocity at the contact is that of its motion: 2 pi f A cos(2 pi f t).
    speed = 0.2 * 2.0 * np.pi * np.cos(2.0 * np.pi * events.time[floor])
    assert events.partner_velocity_before[floor][:, 1] == pytest.approx(speed, abs=1e-9)
    assert events.normal[floor] == pytest.approx(np.broadcast_to([0.0, -1.0], (floor.sum(), 2)), abs=1e-12)
    # What the disk gives to the floor is what it loses itself, along the normal.
    given = events.velocity_before[floor] - events.velocity_after[floor]
    assert events.impulse[floor][:, 0] == pytest.approx(-given[:, 1], abs=1e-12)


def test_kicks_are_rows_so_that_driven_paths_are_exact_too(device):
    """After a kick a disk may meet its latest partner at once, which is still known as that.

    Until t = 1 there are 10 kicks of velocities, and 14 of spins alone, at 0.07 (k + 1/2).
    """
    disks, (box, state) = two_kinds(40), between_walls()
    walls = [*(Wall.line((0.0, y), (0.0, up)) for y, up in ((0.3, 1.0), (7.3, -1.0))), *out_of_reach()]
    simulation = Simulation(
        disks, box, COIN, state, device=device, histories=range(40), seed=4,
        forces=[RandomKicks(0.1, power=1.0), SpinKicks(0.07, power=1.0)], record=["last_partner"], walls=walls,
    )  # fmt: skip
    simulation.run(t_end=1.0)
    events, end = simulation.take_events(), simulation.state
    assert np.count_nonzero(events.partner == KICK) == 40 * (10 + 14)
    check_bounds(simulation, events.time, events.id, events.velocity_after)
    kicked = set()
    for disk in range(40):
        rows = rows_of(events, disk)
        check_path(rows, state, end, disk, box)
        met = rows["partner"][rows["partner"] != KICK]
        assert end.last_partner[disk] == (met[-1] if len(met) else -1)
        if len(met) and rows["partner"][-1] == KICK:
            kicked.add(met[-1] <= -2)
    assert kicked == {True, False}


@pytest.mark.full
@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize("change", ["rest", "forces", "law"])
def test_a_change_leaves_no_events_of_the_motion_before_it(tmp_path, alone, change, monkeypatch):
    """A window computes events beyond the present time, which a change makes another one's: none of them happens.

    Of disks set at rest, histories had 12 events afterwards. A gas from a checkpoint is no other.
    """
    if not alone:
        monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)
    disks = two_kinds(400)
    box, state = start(disks, 0.4)
    gas = Simulation(disks, box, COIN, state, histories=[5, 6, 7], record=["last_partner"])
    gas.run(t_end=0.02)
    gas.save_checkpoint(tmp_path / "a.h5")
    for each in (gas, Simulation.from_checkpoint(tmp_path / "a.h5")):
        begin = each.state
        earlier = each.take_events()
        assert np.all(earlier.time <= 0.02)
        if change == "rest":
            each.set_velocities(np.zeros((400, 2)), np.zeros(400))
        elif change == "forces":
            each.set_forces([RandomKicks(0.01, power=1.0), *idle_forces()[1:]])
        else:
            each.set_law(ROLLING)
        each.run(t_end=0.3)
        events, end, met = each.take_events(), each.state, []
        assert np.all(events.time >= 0.02)
        for disk in (5, 6, 7):
            rows = rows_of(events, disk)
            check_path(rows, begin, end, disk, box)
            met.append(np.count_nonzero(rows["partner"] != KICK))
            assert met[-1] == end.collisions[disk] - begin.collisions[disk]
        assert (sum(met) > 0) == (change != "rest")


def paused_at_will(gas: Simulation, end: float, path: Path) -> tuple[Simulation, list[Events]]:
    """A gas that stops some forty times on the way, at times and after numbers of collisions; half-way, from a file.

    Each time it has room for three rows of events, so that windows with more begin again. Events are taken in parts.
    """
    rng, taken = np.random.default_rng(3), []
    while gas.time < end:
        gas._engine.arrays.events(3)
        if gas.time < 0.8 * end and rng.random() < 0.4:
            gas.run_for(collisions_per_disk=2.0 * float(rng.integers(1, 4)) / gas.disks.n)
        else:
            gas.run(t_end=min(gas.time + float(rng.uniform(0.0, 0.05)), end))
        if rng.random() < 0.5:
            taken.append(gas.take_events())
        if gas.time > 0.5 * end and not path.exists():
            taken.append(gas.take_events())
            gas.save_checkpoint(path)
            gas = Simulation.from_checkpoint(path)
    return gas, [*taken, gas.take_events()]


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("between", [False, True])
def test_pauses_change_no_byte_of_histories(tmp_path, between):
    """A gas in one tile pauses within windows whatever is tracked: events and states are those of one run to the end.

    Forces act on all disks within windows; then also on single ones there, and on all between windows.
    """
    disks, (box, state) = two_kinds(40), between_walls()
    walls = [*(Wall.line((0.0, y), (0.0, up)) for y, up in ((0.3, 1.0), (7.3, -1.0))), *out_of_reach()]
    forces = [RandomKicks(0.1, power=1.0), SpinKicks(0.07, power=1.0)]
    forces += [PoissonKicks(3.0, power=0.5), Rescale(0.13, energy=1.5)] if between else []

    def made() -> Simulation:
        return Simulation(
            disks, box, COIN, state, histories=range(0, 40, 3), seed=4, forces=forces, record=["last_partner"],
            walls=walls,
        )  # fmt: skip

    whole = made()
    whole.run(t_end=1.5)
    stopped, taken = paused_at_will(made(), 1.5, tmp_path / "a.h5")
    for name, column in whole.take_events().columns().items():
        np.testing.assert_array_equal(np.concatenate([each.columns()[name] for each in taken]), column, name)
    assert np.count_nonzero([len(each) for each in taken]) > 5
    for name in ("position", "image", "velocity", "spin", "collisions", "wall_collisions", "last_partner"):
        np.testing.assert_array_equal(getattr(stopped.state, name), getattr(whole.state, name), name)


def test_what_cannot_be_tracked_is_refused():
    disks = equal_disks(20)
    box, state = start(disks, 0.1)
    for tracked, reason in (
        ([20], "there is no disk 20"),
        ([-1], "there is no disk -1"),
        ([3, 3], "disk 3 is named twice"),
        ([0.5], "a list of disks' numbers"),
    ):
        with pytest.raises(InputError, match=reason):
            Simulation(disks, box, COIN, state, histories=tracked)
    sheared = Box(box.lengths, shear_rate=0.1)
    with pytest.raises(InputError, match=r"histories: cannot be combined with box\.shear_rate"):
        Simulation(disks, sheared, COIN, state, histories=[0])
    with pytest.raises(InputError, match=r"histories=\[0, 1\]"):
        Simulation(disks, box, COIN, state).take_events()


@pytest.mark.full
def test_the_velocity_of_a_turning_wall_is_that_of_its_contact():
    """A drum of radius 5 that turns at the rate 0.3 about its centre: 0.3 x r, r from there to the contact."""
    center, disks = np.array([6.0, 6.0]), two_kinds(2)
    drum = Wall.container(tuple(center), 5.0, turn=Turn("steady", tuple(center), rate=0.3))
    state = State([[6.5, 7.0], [4.0, 4.5]], [[1.0, -0.4], [0.0, 0.0]], [2.0, 0.0])
    simulation = Simulation(
        disks, Box((12.0, 30.0), (True, False)), COIN, state, walls=[drum, *out_of_reach()], histories=[0],
        forces=idle_forces(), record=["last_partner"],
    )  # fmt: skip
    simulation.run(t_end=30.0)
    events = simulation.take_events()
    of_drum = events.partner == -2
    assert np.count_nonzero(of_drum) > 2
    contact = (events.position + disks.radius[0] * events.normal - center)[of_drum]
    assert np.linalg.norm(contact, axis=1) == pytest.approx(5.0, abs=1e-9)
    expected = 0.3 * np.column_stack((-contact[:, 1], contact[:, 0]))
    assert events.partner_velocity_before[of_drum] == pytest.approx(expected, abs=1e-9)
    assert events.partner_velocity_after[of_drum] == pytest.approx(expected, abs=1e-9)
