"""PyBullet is optional: without it, a message; with it, its bodies collide by the IFR law."""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support import manual

from ifrdem import IFRLaw, InelasticCollapse, InputError, bullet, collide
from ifrdem import bullet as bullet_package

ABSENT = bullet.absence()
needs_pybullet = pytest.mark.skipif(ABSENT is not None, reason=f"PyBullet is {ABSENT}")
ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("python", "advice"),
    [((3, 11), r"pip install 'ifrdem\[bullet\]'"), ((3, 12), "no wheel for Python 3.12")],
)
def test_absent_pybullet_is_explained(
    python: tuple[int, int], advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    monkeypatch.setattr(sys, "version_info", (*python, 0, "final", 0))
    with pytest.raises(InputError, match=advice):
        bullet.load()
    with pytest.raises(InputError, match=advice):
        bullet.step(0, [], IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0))
    assert bullet.describe() == bullet_package.absence()


@needs_pybullet
def test_present_pybullet_is_loaded_and_named() -> None:
    assert hasattr(bullet.load(), "GEOM_CYLINDER")
    assert bullet.describe().startswith("PyBullet 3.")


# --- the adapter


@pytest.fixture
def client() -> Iterator[int]:
    p = bullet.load()
    number = p.connect(p.DIRECT)
    p.setGravity(0.0, 0.0, 0.0, physicsClientId=number)
    yield number
    p.disconnect(number)


def set_step(client: int, dt: float) -> None:
    bullet.load().setPhysicsEngineParameter(fixedTimeStep=dt, physicsClientId=client)


PERCUSSION = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
CONTACT = IFRLaw(e_n=0.7, e_t=-0.95, mu=0.1, sticking="contact_point", rho=0.02)


@needs_pybullet
@pytest.mark.parametrize("law", [PERCUSSION, CONTACT])
@pytest.mark.parametrize("dt", [1e-3, 0.1])
def test_two_cylinders_end_where_the_law_sends_them_whatever_the_step(
    client: int, law: IFRLaw, dt: float
) -> None:
    """Straight flight, the law at the time of contact, straight flight: no detail of PyBullet enters."""
    set_step(client, dt)
    m, R, k = np.array([1.0, 1.3]), np.array([1.0, 1.4]), np.array([2.0, 1.0])
    pair = [bullet.add_disk(client, m[i], R[i], k=k[i]) for i in range(2)]
    rng = np.random.default_rng(1)
    for psi in np.radians([5.0, 30.0, 60.0, 85.0]):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        n = np.array([np.cos(angle), np.sin(angle)])
        t = np.array([-n[1], n[0]])
        v = np.array([np.cos(psi) * n + np.sin(psi) * t, [0.0, 0.0]]) + rng.normal(size=2)
        w = rng.normal(size=2)
        contact = (2.0 + rng.uniform()) * dt
        x = np.array([[0.0, 0.0], R.sum() * n])
        for i, disk in enumerate(pair):
            bullet.place(client, disk.body, x[i] - v[i] * contact, v[i], w[i])
        hits = [bullet.step(client, pair, law) for _ in range(5)]
        assert [len(one) for one in hits] == [0, 0, 1, 0, 0]
        after = collide(law, n, m, R, k, v, w)
        (hit,) = hits[2]
        assert (hit.a, hit.b) == (pair[0].body, pair[1].body)
        assert hit.time + 2.0 * dt == pytest.approx(contact, abs=1e-12)
        assert (hit.P_n, hit.P_t) == pytest.approx((float(after.P_n), float(after.P_t)), abs=1e-12)
        position, velocity, spin, _ = bullet.Bodies.read(client, pair).state(client)
        # f64 round-off; an angle of 85 degrees enlarges that of the contact time by 10.
        np.testing.assert_allclose(velocity, after.velocity, atol=1e-12)
        np.testing.assert_allclose(spin, after.spin, atol=1e-12)
        np.testing.assert_allclose(position[:, :2], x + after.velocity * (5.0 * dt - contact), atol=1e-12)


@needs_pybullet
def test_orientation_turns_with_the_spin_before_and_after_the_contact(client: int) -> None:
    set_step(client, 0.1)
    law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.3, sticking="contact_point")
    pair = [bullet.add_disk(client, 1.0, 1.0) for _ in range(2)]
    bullet.place(client, pair[0].body, (-2.05, 0.0), (1.0, 0.0), 0.5)
    bullet.place(client, pair[1].body, (0.0, 0.0), (0.0, 0.0), -0.1)
    bullet.step(client, pair, law)
    # g_t = 0.5 - 0.1: sticking takes m_t g_t = g_t / 6 = 1/15, each spin changes by k P_t / (m R) = 2/15.
    _, _, spin, angle = bullet.Bodies.read(client, pair).state(client)
    np.testing.assert_allclose(spin, [0.5 - 2.0 / 15.0, -0.1 - 2.0 / 15.0], atol=1e-12)
    np.testing.assert_allclose(angle, 0.05 * (np.array([0.5, -0.1]) + spin), atol=1e-12)


@needs_pybullet
def test_one_disk_meets_two_others_and_a_wall_within_one_step(client: int) -> None:
    """Equal smooth elastic disks in a row hand the velocity on; the last one comes back from the wall: a cradle."""
    set_step(client, 4.0)
    law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    row = [bullet.add_disk(client, 1.0, 1.0) for _ in range(3)]
    wall = bullet.add_wall(client, (6.5, 0.0), (-1.0, 0.0))
    for disk, x in zip(row, (0.0, 2.25, 4.75), strict=True):
        bullet.place(client, disk.body, (x, 0.3), (0.0, 0.0), 0.0)
    bullet.place(client, row[0].body, (0.0, 0.3), (1.0, 0.0), 0.0)
    hits = bullet.step(client, [*row, wall], law)
    # Gaps of 0.25, 0.5, 0.75 to the wall, then back over 0.75 + 0.5 (all at speed 1), and 0.25 more.
    assert [round(hit.time, 12) for hit in hits] == [0.25, 0.75, 1.5, 2.25, 2.75]
    assert [(hit.a, hit.b) for hit in hits] == [
        (row[0].body, row[1].body), (row[1].body, row[2].body), (row[2].body, wall.body),
        (row[1].body, row[2].body), (row[0].body, row[1].body),
    ]  # fmt: skip
    position, velocity, _, _ = bullet.Bodies.read(client, row).state(client)
    np.testing.assert_allclose(velocity, [[-1.0, 0.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(position[:, 0], [0.25 - 1.25, 2.75 - 0.5, 5.5 - 0.75], atol=1e-12)


@needs_pybullet
def test_a_disk_that_became_fast_is_not_lost_in_the_same_step(client: int) -> None:
    """Elastic, masses 100, 10, 1, 1 in a row: speeds 1, then 2 x 100/110, then that x 2 x 10/11, three times the first.

    Before, the last disk was out of reach of all: further than any two could close in a step at the speed of 1.
    """
    set_step(client, 1.0)
    gaps = (0.05, 0.05, 2.6)
    row = [bullet.add_disk(client, mass, 1.0) for mass in (100.0, 10.0, 1.0, 1.0)]
    law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    # In Bullet's tree the box of a body that jumped spans the whole way for a while: let it be away from the others.
    for far in (100.0, 200.0):
        for i, disk in enumerate(row):
            bullet.place(client, disk.body, (far if i == 3 else -far * (i + 1), 0.0), (0.0, 0.0), 0.0)
        bullet.step(client, row, law)
    for i, disk in enumerate(row):
        bullet.place(client, disk.body, (2.0 * i + sum(gaps[:i]), 0.0), (0.0, 0.0), 0.0)
    bullet.place(client, row[0].body, (0.0, 0.0), (1.0, 0.0), 0.0)
    hits = bullet.step(client, row, law)
    fast = 200.0 / 110.0, 200.0 / 110.0 * 20.0 / 11.0
    first = [0.05, 0.05 + 0.05 / fast[0], 0.05 + 0.05 / fast[0] + 2.6 / fast[1]]
    last = [hit for hit in hits if hit.b == row[3].body]
    assert [hit.time for hit in hits[:2]] == pytest.approx(first[:2], abs=1e-12)
    assert [hit.time for hit in last] == pytest.approx(first[2:], abs=1e-12)


@needs_pybullet
def test_a_collapse_within_a_step_is_an_error_and_not_an_endless_loop(client: int) -> None:
    """A disk between a wall and a disk of 1e30 times its mass that closes in: ever more collisions, ever faster."""
    set_step(client, 1.0)
    disk = bullet.add_disk(client, 1.0, 1.0)
    heavy = bullet.add_disk(client, 1e30, 1.0)
    wall = bullet.add_wall(client, (-1.001, 0.0), (1.0, 0.0))
    bullet.place(client, heavy.body, (2.5, 0.0), (-1.0, 0.0), 0.0)
    with pytest.raises(InelasticCollapse, match="an inelastic collapse"):
        bullet.step(client, [disk, heavy, wall], IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0))


@needs_pybullet
def test_plain_bodies_of_pybullet_are_recognized_and_posts_stay(client: int) -> None:
    """A multibody cylinder, one of mass 0 as a post, and a plane, by their ids; the law by pairs of ids."""
    p = bullet.load()
    set_step(client, 0.5)
    coin = p.createCollisionShape(p.GEOM_CYLINDER, radius=1.0, height=0.4, physicsClientId=client)
    body = p.createMultiBody(2.0, coin, -1, [0.0, 0.0, 0.0], physicsClientId=client)
    post = p.createMultiBody(0.0, coin, -1, [2.01, 0.0, 0.0], physicsClientId=client)
    plane = p.createCollisionShape(p.GEOM_PLANE, planeNormal=[0.0, 1.0, 0.0], physicsClientId=client)
    wall = p.createMultiBody(0.0, plane, -1, [0.0, -1.3, 0.0], physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=client)
    # Bullet's own response would act here already: it makes contacts 0.02 ahead.
    # Its moments of inertia of a cylinder about z: m R^2 / 2.
    assert bullet.Bodies.read(client, [body]).k[0] == pytest.approx(2.0, rel=1e-12)
    p.resetBaseVelocity(body, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], physicsClientId=client)
    lossy, perfect = IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0), IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    (hit,) = bullet.step(client, [body, post, wall], lambda a, b: lossy if post in (a, b) else perfect)
    assert (hit.a, hit.b) == (body, post)
    (v, _) = p.getBaseVelocity(body, physicsClientId=client)
    assert v[:2] == pytest.approx((-0.5, 0.0), abs=1e-12)
    assert p.getBasePositionAndOrientation(post, physicsClientId=client)[0] == (2.01, 0.0, 0.0)
    p.resetBaseVelocity(body, [0.0, -1.0, 0.0], [0.0, 0.0, 0.0], physicsClientId=client)
    (hit,) = bullet.step(client, [body, post, wall], lambda a, b: lossy if post in (a, b) else perfect)
    assert (hit.a, hit.b) == (body, wall)
    assert p.getBaseVelocity(body, physicsClientId=client)[0][1] == pytest.approx(1.0, abs=1e-12)


@needs_pybullet
def test_bodies_that_are_no_disks_are_refused_by_name(client: int) -> None:
    p = bullet.load()
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1.0, 1.0, 1.0], physicsClientId=client)
    coin = p.createCollisionShape(p.GEOM_CYLINDER, radius=1.0, height=0.4, physicsClientId=client)
    cube = p.createMultiBody(1.0, box, -1, [0.0, 0.0, 0.0], physicsClientId=client)
    lying = p.createMultiBody(1.0, coin, -1, [9.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.8], physicsClientId=client)
    disk = bullet.add_disk(client, 1.0, 1.0)
    law = PERCUSSION
    for bodies, message in (
        ([cube], f"body {cube}: neither a cylinder nor a plane"),
        ([lying], f"body {lying}: its axis is not along z"),
        (
            [disk.body],
            rf"body {disk.body}: .*give ifrdem.bullet.DiskBody\(body, radius\)",
        ),
        ([bullet.DiskBody(99, 1.0)], "body 99: there is no such body"),
        ([disk, disk], "one of them is given twice"),
    ):
        with pytest.raises(InputError, match=message):
            bullet.step(client, bodies, law)
    with pytest.raises(InputError, match=r"radius = -1.0: must be"):
        bullet.add_disk(client, 1.0, -1.0)
    with pytest.raises(InputError, match=r"normal = .*: must have"):
        bullet.add_wall(client, (0.0, 0.0), (0.0, 0.0))


@needs_pybullet
def test_example_of_the_manual_keeps_its_coins_between_the_walls(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    exec(compile(manual.block("bullet"), "validation.md", "exec"), names)
    hits, energy = capsys.readouterr().out.split()[-2:]
    assert int(hits) > 10
    assert 0.0 < float(energy) < 1.0
    assert math.isfinite(float(energy))
