"""The cases against PyBullet and pymunk: comparisons, sensitivity to errors, and messages without PyBullet."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from support import manual

from ifrdem import Box, Disks, IFRLaw, Simulation, State, Wall, bullet
from ifrdem.cli import main as cli
from ifrdem.initial import placement
from ifrdem.validation.engines import flight, pymunk_world, stepped
from ifrdem.validation.engines.bullet_world import BulletWorld, Surface
from ifrdem.validation.engines.pymunk_world import PymunkWorld
from ifrdem.validation.heaps import rigid_grains
from ifrdem.validation.paper import predicted
from ifrdem.validation.paper.equations import Impact
from ifrdem.validation.report import registry

ABSENT, NO_PYMUNK = bullet.absence(), pymunk_world.absence()
needs_pybullet = pytest.mark.skipif(ABSENT is not None, reason=f"PyBullet is {ABSENT}")
needs_pymunk = pytest.mark.skipif(NO_PYMUNK is not None, reason=str(NO_PYMUNK))

# Bullet's contact normals are good to 8e-7 for R = 1; pymunk's circles to rounding.
CODES = [
    pytest.param(BulletWorld, 2e-6, marks=needs_pybullet, id="PyBullet"),
    pytest.param(PymunkWorld, 1e-13, marks=needs_pymunk, id="pymunk"),
]


def impacts(n: int = 60) -> tuple[Impact, np.ndarray]:
    """Everything unequal, both disks spinning."""
    rng = np.random.default_rng(2)
    psi = np.radians(np.tile(np.linspace(5.0, 85.0, n // 3), 3))
    M, R_2, k_2 = (
        np.repeat(values, n // 3) for values in ([1.0, 0.4, 3.0], [1.0, 1.5, 1.2], [2.0, 1.0, 2.5])
    )
    c = Impact(psi, 0.8, -1.0, 0.2, M=M, R_2=R_2, k_2=k_2, w_o=rng.uniform(-0.5, 0.5, n))
    return c, rng.uniform(-0.5, 0.5, n)


@pytest.mark.parametrize(("world", "tolerance"), CODES)
def test_codes_from_outside_collide_by_the_closed_forms_of_the_coulomb_limit(world, tolerance):
    c, w_2o = impacts()
    off = stepped.deviation(stepped.touch(world, c, w_2o=w_2o), predicted.after(c, "contact_point", w_2o))
    assert off.max() < tolerance
    # IFR at another e_t, and the other closure, are far away: the comparison distinguishes laws.
    other = predicted.after(Impact(**{**vars(c), "e_t": -0.99}), "contact_point", w_2o)
    percussion = predicted.after(c, "percussion_center", w_2o)
    got = stepped.touch(world, c, w_2o=w_2o)
    assert np.median(stepped.deviation(got, other)) > 1e-3
    assert stepped.deviation(got, percussion).max() > 1e-2


@needs_pybullet
def test_bullets_law_is_ours_to_rounding_where_its_contact_normals_are_exact():
    c, w_2o = impacts()
    got = stepped.touch(BulletWorld, c, w_2o=w_2o, along_y=True)
    assert stepped.deviation(got, predicted.after(c, "contact_point", w_2o)).max() < 1e-13


@pytest.mark.parametrize(("world", "tolerance"), CODES)
@pytest.mark.parametrize("step", [1e-1, 1e-3])
def test_late_impacts_are_those_at_a_line_of_centres_that_has_turned(world, tolerance, step):
    c = Impact(np.radians(np.linspace(5.0, 85.0, 30)), 0.87, -1.0, 0.21, M=1.3)
    off = stepped.deviation(stepped.fly(world, c, step, seed=4), predicted.after(c, "contact_point"))
    np.testing.assert_allclose(off, flight.late(c, step, seed=4), atol=tolerance)
    assert off.max() > 0.05 * step


@pytest.mark.parametrize(("world", "tolerance"), CODES)
def test_collisions_and_wall_hits_are_counted_once_each(world, tolerance):
    """A disk, another at rest, a wall behind it: they meet, the second comes back, they meet again. Steps of 0.01."""
    disks, walls = Disks(2, mass=1.0, radius=1.0), [Wall.line((7.0, 0.0), (-1.0, 0.0))]
    start = State([[0.0, 0.0], [3.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
    record = stepped.gas(
        world, disks, Surface(1.0, 0.3), walls, start, time_step=0.01, steps=[50, 200, 300, 500, 900]
    )
    # Met at 1, wall at 1 + 3, met again at x = 3 after 3 more.
    assert record.collisions.tolist() == [0, 1, 1, 1, 2]
    assert record.wall_collisions.tolist() == [0, 0, 0, 1, 1]
    moving, turning = record.energy(disks)
    np.testing.assert_allclose(moving, 0.5, rtol=1e-6)
    np.testing.assert_allclose(turning, 0.0, atol=1e-10)


@needs_pybullet
def test_ifr_in_pybullet_has_the_collisions_of_our_engine_in_order():
    """100 disks of two sizes in the middle of a box so large that none reaches its sides: PyBullet has none."""
    n, law = 100, IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    small = np.arange(n) % 2 == 0
    radius = np.where(small, 0.7, 1.0)
    disks = Disks(n, mass=radius**2, radius=radius)
    position = placement.random_positions(Box((30.0, 30.0)), np.ones(n), seed=1) + 35.0
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=1)
    spin = placement.gaussian_spins(n, spin_rms=0.5, seed=1)
    state = State(position, velocity, spin)
    ours = Simulation(disks, Box((100.0, 100.0)), law, state)
    expected = ours.collide_until(3.0)
    assert len(expected.time) > 80
    with BulletWorld(disks, Surface(1.0, 0.0), time_step=0.1) as world:
        world.place(state.position, state.velocity, state.spin)
        bodies = bullet.Bodies.read(world.client, world.disks)
        index = {disk.body: i for i, disk in enumerate(world.disks)}
        hits = [
            (0.1 * step + hit.time, *sorted((index[hit.a], index[hit.b])))
            for step in range(30)
            for hit in bullet.step(world.client, bodies, law)
        ]
        end = world.state()
    np.testing.assert_array_equal([hit[1:] for hit in hits], expected.pair)
    # Rounding, 1e-14 of the box, grows some ten times by each of the four or so collisions of the busiest disks.
    np.testing.assert_allclose([hit[0] for hit in hits], expected.time, atol=1e-9)
    np.testing.assert_allclose(end.position, ours.state.position, atol=1e-9)
    np.testing.assert_allclose(end.velocity, ours.state.velocity, atol=1e-9)
    np.testing.assert_allclose(end.spin, ours.state.spin, atol=1e-9)


# --- where it is absent


def test_without_pybullet_every_case_is_skipped_with_what_to_do_and_the_command_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "pybullet" else find(name, *rest)
    )
    assert cli.main(["validate", "bullet", "--quick", "-o", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert out.count("SKIP PyBullet is not installed") == len(registry.BULLET)
    assert f"cases skipped: {', '.join(registry.BULLET)}" in out
    rows = json.loads((tmp_path / "results.json").read_text())
    assert [row["status"] for row in rows] == ["skipped"] * len(registry.BULLET)
    assert "PyBullet is not installed" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_without_names_the_cases_of_the_paper_run_and_bullet_is_listed_as_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert registry.chosen([]) == list(registry.PAPER)
    assert registry.chosen(["bullet", "angles", "bullet_box"]) == [*registry.BULLET, "angles"]
    monkeypatch.setattr(registry, "CASES", registry.BULLET)  # nothing of the paper left
    assert cli.main(["validate", "-o", str(tmp_path)]) == 1
    assert f"`ifrdem validate bullet` does ({bullet.describe()})" in capsys.readouterr().out


@needs_pybullet
def test_without_pymunk_the_report_says_that_it_was_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "pymunk" else find(name, *rest)
    )
    result = flight.run(True)
    assert result.rows
    assert not any("pymunk" in row.quantity for row in result.rows)
    assert any("pymunk is not installed: `pip install" in table.note for table in result.tables)


def test_manual_has_the_command_and_the_picture() -> None:
    text = manual.page("validation.md")
    assert "pip install 'ifrdem[bullet]' && ifrdem validate bullet -o bullet-report\n" in text
    assert "](gallery/bullet.png)" in text
    assert (manual.DOCS / "gallery" / "bullet.png").read_bytes().startswith(b"\x89PNG")


@needs_pymunk
def test_rigid_grains_rebound_from_a_floor_and_roll_as_predicted() -> None:
    """One falls by 2 and comes back to e_n^2 of it; one begins to slide at 1, and rolls at 2/3 of it (m R^2 / 2)."""
    disks = Disks(2, mass=np.array([1.0, 0.5]), radius=np.array([0.5, 0.4]))
    start = State([[1.0, 2.5], [3.0, 0.4]], [[0.0, 0.0], [1.0, 0.0]], [0.0, 0.0])
    law = IFRLaw(e_n=0.5, e_t=-1.0, mu=0.5)
    floor = Wall.segment((0.0, 0.0), (20.0, 0.0))
    at = rigid_grains.run(disks, law, start, t_end=4.0, every=0.01, walls=[floor])
    assert at.shape == (401, 2, 2)
    height = at[:, 0, 1] - 0.5
    hit = int((height < 0.01).argmax())
    # A step of 1e-3 at speed 2: the hit is late by 2e-3 of the height, and so is the way up.
    assert height[hit + 5 : hit + 200].max() / 2.0 == pytest.approx(0.25, abs=0.01)
    speed = np.polyfit(0.01 * np.arange(300, 401), at[300:, 1, 0], 1)[0]
    assert speed == pytest.approx(2.0 / 3.0, rel=0.01)
