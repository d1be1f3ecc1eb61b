"""Energy that each disk's collisions take, by mechanism: its shares, and a complete sum."""

import dataclasses

import numpy as np
import pytest
from support.gases import run_to

import ifrdem
from ifrdem import Device
from ifrdem.errors import InputError
from ifrdem.model.laws.pairs import PairLaws
from ifrdem.plots import dissipation, pictures
from ifrdem.trajectory.export import export
from ifrdem.validation.rows import engine_of

LAW = ifrdem.IFRLaw(e_n=0.8, e_t=-0.5, mu=0.2, rho=0.05)


def two_sizes(n=1500, *, walls=(), law=LAW, **options):
    disks = ifrdem.Disks(n, mass=1.0, radius=np.where(np.arange(n) % 2, 0.4, 0.5))
    box = ifrdem.Box((60.0, 45.0), periodic=(True, not walls))
    position = ifrdem.initial.random_positions(box, disks.radius, seed=1, walls=walls)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=2)
    start = ifrdem.State(position, velocity, np.zeros(n))
    return ifrdem.Simulation(disks, box, law, start, walls=walls, record=["dissipated"], **options)


def test_half_of_what_a_head_on_collision_takes_belongs_to_either_disk():
    # Masses 1 and 3 that approach at g = 2: m_n = 3/4, and (1 - e_n^2) m_n g^2 / 2 = 0.36 * 1.5 = 0.54 is lost.
    disks = ifrdem.Disks(2, mass=[1.0, 3.0], radius=0.5)
    box = ifrdem.Box((20.0, 20.0))
    start = ifrdem.State([[5.0, 10.0], [9.0, 10.0]], [[2.0, 0.0], [0.0, 0.0]], np.zeros(2))
    law = ifrdem.IFRLaw(e_n=0.8, e_t=-0.5, mu=0.2)
    run = ifrdem.Simulation(disks, box, law, start, record=["dissipated"])
    run.run(t_end=3.0)
    assert run.collisions == 1
    np.testing.assert_allclose(run.state.dissipated, [[0.27, 0, 0, 0, 0, 0, 0]] * 2, rtol=1e-14)


@pytest.mark.full
def test_a_wall_leaves_all_of_it_to_the_disk():
    # Normal restitution 0.8 at v = 2: (1 - 0.64) 2^2 / 2 = 0.72.
    disks = ifrdem.Disks(
        2, mass=1.0, radius=0.5, k=[2.0, 1.0]
    )  # two kinds, as everywhere here; one does not move
    box = ifrdem.Box((20.0, 10.0), periodic=(True, False))
    start = ifrdem.State([[5.0, 5.0], [15.0, 5.0]], [[0.0, -2.0], [0.0, 0.0]], [0.0, 0.0])
    run = ifrdem.Simulation(
        disks, box, ifrdem.IFRLaw(e_n=0.8, e_t=-0.5, mu=0.2), start, record=["dissipated"]
    )
    run.run(t_end=3.0)
    np.testing.assert_allclose(run.state.dissipated, [[0, 0, 0, 0, 0, 0.72, 0], [0] * 7], rtol=1e-14)


@pytest.mark.full
def test_disks_lose_together_what_the_ledger_says():
    post = ifrdem.Wall.post((30.0, 20.0), 4.0)
    run = two_sizes(walls=(post,))
    run.run(collisions_per_disk=12.3)
    ledger = run.measure().dissipated
    assert ledger[:6].all()  # sticking gives energy of the surfaces back; nothing rests
    np.testing.assert_allclose(run.state.dissipated.sum(axis=0), ledger, rtol=1e-11)


@pytest.mark.full
def test_it_depends_neither_on_frames_nor_changes_the_motion():
    at_once, in_steps = two_sizes(), two_sizes()
    at_once.run(t_end=2.0)
    for t in (0.3, 0.71, 1.9, 2.0):
        in_steps.run(t_end=t)
    assert np.array_equal(at_once.state.dissipated, in_steps.state.dissipated)
    without = ifrdem.Simulation(at_once.disks, at_once.box, LAW, two_sizes().state)
    without.run(t_end=2.0)
    assert np.array_equal(without.state.position, at_once.state.position)
    assert np.array_equal(without.state.velocity, at_once.state.velocity)
    with pytest.raises(AttributeError, match=r'State.dissipated.*record=\["dissipated"\]'):
        without.state.dissipated.sum(axis=0)


@pytest.mark.full
@pytest.mark.parametrize("threads", [1, 2])
def test_tiles_know_what_one_tile_knows(threads):
    start = two_sizes()
    state, table = dataclasses.replace(start.state), PairLaws.of(LAW, start.disks).coefficients
    found = []
    for order in ("serial", "tiled"):
        engine = engine_of(
            start.disks,
            start.box,
            state,
            table,
            order=order,
            tile_disks=200,
            device=Device(threads=threads),
            record=["ledger", "dissipated"],
        )
        found.append(run_to(engine, 2.0).dissipated)
    assert found[0].any()
    assert np.array_equal(*found)


def test_a_run_that_continues_from_a_state_continues_its_sums():
    whole, first = two_sizes(), two_sizes()
    whole.run(t_end=0.6)
    first.run(t_end=0.3)
    second = ifrdem.Simulation(first.disks, first.box, LAW, first.state, record=["dissipated"])
    second.run(t_end=0.6)
    assert second.collisions > 1.5 * first.collisions
    np.testing.assert_allclose(second.state.dissipated, whole.state.dissipated, rtol=1e-9, atol=1e-10)


def test_a_ledger_that_records_losses_of_disks_cannot_be_switched_off():
    with pytest.raises(InputError, match='"dissipated" needs "ledger"'):
        two_sizes(100).switch_ledger(False)


@pytest.fixture
def trajectory(tmp_path):
    run = two_sizes(200)
    fields = ["position", "velocity", "angular_velocity", "dissipated"]
    with ifrdem.TrajectoryWriter(tmp_path / "g.h5", run.disks, run.box, fields=fields) as writer:
        run.run(t_end=4.0, frames=4, frame_callbacks=[lambda state, _: writer.write(state)])
    with ifrdem.Trajectory(tmp_path / "g.h5") as trajectory:
        np.testing.assert_allclose(trajectory[-1].dissipated, run.state.dissipated, rtol=1e-6, atol=1e-7)
        yield trajectory


def test_tables_name_the_mechanisms(trajectory):
    assert "dissipated_sliding" in trajectory.to_pandas("frame").columns
    assert trajectory.to_xarray()["dissipated"].sel(mechanism="sliding").shape == (5, 200)


@pytest.mark.parametrize("form", ["csv", "extxyz", "gsd"])
def test_copies_for_others_hold_it(trajectory, tmp_path, form):
    pytest.importorskip("gsd.hoomd")
    place = tmp_path / f"g.{form}"
    export(trajectory, place, form, [4])
    if form == "gsd":
        import gsd.hoomd

        with gsd.hoomd.open(str(place)) as file:
            found = file[0].log["particles/dissipated"]
    elif form == "csv":
        table = np.genfromtxt(place, delimiter=",", names=True)
        found = np.column_stack([table[name] for name in table.dtype.names if name.startswith("dissipated_")])
    else:
        lines = place.read_text().splitlines()
        width = [int(each) for each in lines[1].split("Properties=")[1].split(" ")[0].split(":")[2::3]]
        names = lines[1].split("Properties=")[1].split(" ")[0].split(":")[0::3]
        at = sum(width[: names.index("dissipated")])
        found = np.array([line.split()[at : at + 7] for line in lines[2:]], dtype=float)
    np.testing.assert_allclose(found, trajectory[4].dissipated, rtol=1e-6, atol=1e-12)


def test_the_map_holds_all_that_was_lost(trajectory):
    found = dissipation.of(trajectory)
    cell = float(np.prod(np.ptp(found.region, axis=1))) / found.power.size
    begin, end = found.times
    lost = trajectory[-1].dissipated - trajectory[0].dissipated
    assert found.power.sum() * cell * (end - begin) == pytest.approx(lost.sum(), rel=1e-5)
    np.testing.assert_allclose(found.mechanisms, lost.sum(axis=0), rtol=1e-5, atol=1e-9)


def test_the_picture_has_the_map_and_a_bar_for_each_mechanism(trajectory):
    figure = pictures.figure(trajectory, "dissipation")
    left, right, *_ = figure.axes
    assert left.get_xlabel() == "$x$"
    assert [label.get_text() for label in right.get_yticklabels()][:3] == [
        "normal",
        "tangential restitution",
        "sliding",
    ]
    shares = [bar.get_width() for bar in right.patches]
    assert len(shares) == 5  # of seven: nothing rolls, and there are no walls
    assert sum(shares) == pytest.approx(100.0)
    figure.draw_without_rendering()


def test_a_map_of_one_frame_or_without_the_field_is_refused(trajectory, tmp_path):
    with pytest.raises(InputError, match="must have two frames"):
        dissipation.of(trajectory, [2])
    run = two_sizes(50)
    with ifrdem.TrajectoryWriter(tmp_path / "p.h5", run.disks, run.box) as writer:
        writer.write(run.state)
    with ifrdem.Trajectory(tmp_path / "p.h5") as plain, pytest.raises(InputError, match="'dissipated'"):
        dissipation.of(plain)
