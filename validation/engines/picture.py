"""Cylinders colliding, seen by Bullet's own renderer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...model.laws.coin_table import coins
from ...model.state import Disks
from ..report.registry import Picture
from .bullet_world import BulletWorld, Surface

PIXELS = (660, 470)  # of a frame
TIMES = (-1.6, 0.0, 1.6, 3.2)  # of frames, from the contact [R / v_o]
PSI = math.radians(40.0)
STEP = 1e-3
SIDES = 96
BLUE, ORANGE, DARK = (0.0, 0.447, 0.698, 1.0), (0.902, 0.624, 0.0, 1.0), (0.1, 0.1, 0.1, 1.0)
HEIGHT = 0.45


def draw() -> Picture:
    """Two aluminium coins before, in and after an impact at 40 degrees, by Bullet's own response."""
    from matplotlib.figure import Figure

    width = 2.1
    figure = Figure(figsize=(width * len(TIMES), width * PIXELS[1] / PIXELS[0] + 0.3), layout="constrained")
    axes = figure.subplots(1, len(TIMES))
    for ax, frame, t, name in zip(axes, _frames(), TIMES, "abcd", strict=True):
        ax.imshow(frame, interpolation="antialiased")
        ax.set_axis_off()
        when = "contact" if t == 0.0 else rf"$t = {t:+.1f}\,R/v_o$"
        ax.set_title(f"({name}) {when}", fontsize=9)
    coin = coins["1 pta"]
    caption = (
        "Two cylinders in PyBullet, drawn by its own renderer: the blue one comes from the left and hits the "
        f"one at rest, psi = 40 degrees (e_n = {coin.law.e_n}, mu = {coin.law.mu}, R = 1). Bars on their tops "
        "show the spins that friction gives to both."
    )
    return Picture("bullet-cylinders", caption, figure)


def _frames() -> list[NDArray[np.uint8]]:
    law = coins["1 pta"].law
    disks = Disks(2, mass=1.0, radius=1.0)  # type: ignore[arg-type]
    # The line of centres at the contact is 40 degrees below the incoming direction, which is along x.
    normal = np.array([math.cos(PSI), -math.sin(PSI)])
    velocity = np.array([[1.0, 0.0], [0.0, 0.0]])
    position = np.array([-2.0 * normal, [0.0, 0.0]]) + velocity * TIMES[0]
    with BulletWorld(disks, Surface(law.e_n, law.mu), time_step=STEP) as world:
        p, client = world.p, world.client
        world.place(position, velocity, np.zeros(2))
        # What is seen lies on the cylinders: Bullet draws these with ten sides.
        seen = [(_coin(p, client, colour), _bar(p, client)) for colour in (BLUE, ORANGE)]
        frames = []
        for since in np.diff([TIMES[0], *TIMES]):
            world.step(round(float(since) / STEP))
            for disk, (coin, bar) in zip(world.disks, seen, strict=True):
                p.changeVisualShape(disk.body, -1, rgbaColor=[0.0, 0.0, 0.0, 0.0], physicsClientId=client)
                (x, y, _), turn = p.getBasePositionAndOrientation(disk.body, physicsClientId=client)
                p.resetBasePositionAndOrientation(coin, [x, y, 0.0], turn, physicsClientId=client)
                p.resetBasePositionAndOrientation(bar, [x, y, HEIGHT], turn, physicsClientId=client)
            frames.append(_frame(p, client))
        return frames


def _coin(p: Any, client: int, colour: tuple[float, ...]) -> int:
    """A round body to see, without mass or collisions: a top and a side."""
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    top = ring + HEIGHT * up
    vertices = np.concatenate([top, top, ring, [HEIGHT * up]])
    normals = np.concatenate([np.tile(up, (SIDES, 1)), ring, ring, [up]])
    i, j = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = np.concatenate(
        [
            np.stack([i, j, np.full(SIDES, 3 * SIDES)], axis=1),
            np.stack([SIDES + i, 2 * SIDES + i, SIDES + j], axis=1),
            np.stack([2 * SIDES + i, 2 * SIDES + j, SIDES + j], axis=1),
        ]
    )
    look = p.createVisualShape(
        p.GEOM_MESH, vertices=vertices.tolist(), indices=faces.ravel().tolist(), normals=normals.tolist(),
        rgbaColor=list(colour), physicsClientId=client,
    )  # fmt: skip
    return int(p.createMultiBody(0.0, -1, look, [0.0, 0.0, 0.0], physicsClientId=client))


def _bar(p: Any, client: int) -> int:
    """A bar to see, without mass or collisions."""
    look = p.createVisualShape(
        p.GEOM_BOX, halfExtents=[0.85, 0.08, 0.02], rgbaColor=list(DARK), physicsClientId=client
    )
    return int(p.createMultiBody(0.0, -1, look, [0.0, 0.0, 0.0], physicsClientId=client))


def _frame(p: Any, client: int) -> NDArray[np.uint8]:
    width, height = PIXELS
    view = p.computeViewMatrix([-0.1, -4.6, 8.0], [-0.1, 0.4, 0.0], [0.0, 1.0, 0.0])
    projection = p.computeProjectionMatrixFOV(34.5, width / height, 0.1, 50.0)
    # The software renderer: it needs no screen.
    image = p.getCameraImage(
        width, height, view, projection, lightDirection=[-2.0, -3.0, 8.0], shadow=0, renderer=p.ER_TINY_RENDERER,
        physicsClientId=client,
    )[2]  # fmt: skip
    return np.asarray(image, dtype=np.uint8).reshape(height, width, 4)[:, :, :3]
