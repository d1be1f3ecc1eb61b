"""What `ifrdem check` says of walls and gravity."""

from __future__ import annotations

import math

import numpy as np

from ..model.walls import Wall
from .case import Case
from .estimate import Estimate
from .gas import Gas
from .walls_section import WallSection


def lines_of_walls(case: Case, gas: Gas, estimate: Estimate) -> list[tuple[str, str]]:
    """Name and text of each line; none for a periodic gas without gravity."""
    length, time, energy = (case.unit(quantity) for quantity in ("length", "time", "energy"))
    acceleration = f"{length}/{time.strip()}^2" if length else ""
    lines = []
    mass, diameter = float(gas.disks.mass.mean()), 2.0 * float(gas.disks.radius.mean())
    g = math.hypot(*case.box.gravity)
    if g > 0.0:
        x, y = case.box.gravity
        lifted = f"{mass * g * diameter:.4g}{energy} lift the mean disk by its diameter"
        lines.append(("gravity", f"({x:g}, {y:g}){acceleration}: {lifted}"))
    if gas.room.all_walls:
        area = f"{gas.room.area():.5g}{f'{length}^2' if length else ''}"
        part = gas.room.area() / gas.box.area
        lines.append(("room between walls", f"{area}, {100.0 * part:.4g} % of the box; densities are in it"))
    if case.box.material is not None:
        which = " and ".join(
            axis for axis, periodic in zip("xy", case.box.periodic, strict=True) if not periodic
        )
        lines.append(("sides", f"walls of {case.box.material} across {which}"))
    for i, (section, wall) in enumerate(zip(case.wall, gas.walls, strict=True), start=1):
        text = f"{wall.shape}, {_made(section, energy)}"
        if wall.surface_speed:
            text += f", surface at {wall.surface_speed:g}{_speed(case)}"
        if section.motion is not None:
            text += f"; {_motion(case, wall, g, mass)}"
        lines.append((f"wall {i}", text))
    if estimate.wall_hits > 0.0:
        per = f" per{time}" if time else " per unit of time"
        lines.append(
            ("wall hits", f"some {estimate.wall_hits:.3g}{per} at the start, if spread out and Maxwellian")
        )
    if case.run.collapse != "none":
        least = case.run.velocity_cutoff or case.run.contact_time or 0.0
        unit = _speed(case) if case.run.velocity_cutoff is not None else time
        what = "velocity cut-off" if case.run.velocity_cutoff is not None else "contact time"
        lines.append(("collapse", f"{what} {least:g}{unit}: collisions below it are elastic"))
    return lines


def _made(section: WallSection, energy: str) -> str:
    if section.temperature is not None:
        return f"thermal, T = {section.temperature:.4g}{energy}"
    return f"of {section.material}"


def _speed(case: Case) -> str:
    length, time = case.unit("length"), case.unit("time")
    return f"{length}/{time.strip()}" if length else ""


def _motion(case: Case, wall: Wall, g: float, mass: float) -> str:
    """What a wall does, and the energy that it can give."""
    motion, fastest = wall.motion, wall.motion.most_speed
    text = f"{motion.kind}, "
    if motion.kind != "steady":
        length, time = case.unit("length"), case.unit("time")
        per = f"/{time.strip()}" if time else ""
        text += f"amplitude {motion.amplitude:g}{length}, frequency {motion.frequency:g}{per}, "
    text += f"up to {fastest:.4g}{_speed(case)}"
    text += f" (m v^2 / 2 = {0.5 * mass * fastest**2:.4g}{case.unit('energy')} of the mean disk)"
    if motion.kind == "sine" and g > 0.0:
        peak = motion.amplitude * (2.0 * np.pi * motion.frequency) ** 2
        text += f", acceleration up to {peak / g:.4g} g"
    return text
