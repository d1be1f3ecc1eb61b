"""A case of a gas with fitted coefficients: its species, materials, pairs, and walls."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from itertools import combinations_with_replacement, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, refuse
from ..fit.data import Collisions, Data
from ..fit.report import law_lines, not_in_cases, origin
from ..fit.result import Fit, Fitted
from ..model.laws.law import CollisionLaw
from . import file as case_file

NUMBER, PACKING_FRACTION, COLLISIONS_PER_DISK = 4000, 0.2, 20.0
"""Disks, packing fraction and length of the run that is written: nothing measured says what they are."""
OTHERS = r"[^\w.+-]"
"""Characters that the name of a run cannot have."""
WALL = "wall"
"""Name of the material of walls that have none."""


class Kind(NamedTuple):
    """A kind of disks: the name of its material, "" if it is not known, mass [mass], radius [length] and k."""

    material: str
    mass: float
    radius: float
    k: float


def text_of(fits: Sequence[Fit], name: str, run: str) -> str:
    """A case file with the coefficients of fits, one for each pair of kinds of disks, or of one with walls.

    Each kind of disks (mass, radius, k, material) is a species with a material of its own; coefficients have their
    errors and correlations, from which `ifrdem study --coefficients` draws. Number, packing fraction and duration are
    not measured, and are to be chosen; speeds at the start are those before the measured impacts. `name` is that of
    the material if the data name none, `run` that of the run.

    Raises InputError if a pair of kinds is missing, a table has angles instead of velocities, no class of laws fits all
    pairs, or a law can add energy.
    """
    for each in fits:
        if isinstance(each.data, Data):
            text = "a table of angles has no masses, radii and speeds: --write-material writes the material"
            raise InputError(f"{each.data.source}: {text}")
    pairs = _pairs(fits)
    kinds = sorted({kind for pair in pairs for kind in pair if kind is not None})
    of_walls = [each for each, (_, other) in zip(fits, pairs, strict=True) if other is None]
    names = _names(kinds, name)
    chosen = _one_class(fits)
    disks = {kind.material for kind in kinds}
    wall = next((each for fit in of_walls for each in _materials(fit) if each not in disks), WALL)
    speed, spin = _rms(fits, ("vx", "vy")) or 1.0, _rms(fits, ("spin",)) or 0.0
    lines = [
        "# A gas with measured coefficients, by `ifrdem fit`. Not measured, to be chosen: [run], [box], number of disks.",
        "",
        "[run]",
        f"name = {_text(re.sub(OTHERS, '_', run))}",
        f"collisions_per_disk = {COLLISIONS_PER_DISK}",
        "",
        "[box]",
        f"packing_fraction = {PACKING_FRACTION}",
        *[f"periodic = [false, false]\nmaterial = {_text(wall)}"] * bool(of_walls),
    ]
    order = sorted(range(len(fits)), key=lambda i: pairs[i][0] != pairs[i][1])  # materials first
    for i in order:
        one, other = pairs[i]
        heading = ["[[material]]", f"name = {_text(names[one])}"]
        if one != other:
            heading = [
                "[[pair]]",
                f"materials = [{_text(names[one])}, {_text(wall if other is None else names[other])}]",
            ]
        lines += ["", *origin(fits[i], chosen[i]), *law_lines(heading, chosen[i])]
    for kind in kinds:
        lines += [
            "",
            "[[species]]",
            f"name = {_text(names[kind])}",
            f"material = {_text(names[kind])}",
            f"number = {NUMBER // len(kinds)}",
            f"mass = {kind.mass!r}",
            f"radius = {kind.radius!r}",
            f"k = {kind.k!r}",
            f"speed_rms = {speed!r}  # here and spin_rms: of disks before the measured impacts",
            f"spin_rms = {spin!r}",
        ]
    text = "\n".join(lines) + "\n"
    try:
        case_file.of_text(text, Path(f"{name}.toml"))
    except InputError as error:
        problems = str(error).replace(f"{name}.toml: ", "")
        raise InputError(f"no case is written: {problems}") from None
    return text


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _materials(fit: Fit) -> list[str]:
    """Names of the two materials of a fit, or of one and walls; empty if they are not known."""
    assert isinstance(fit.data, Collisions)
    return fit.data.materials[0].split(", ") if fit.data.materials else []


Size = tuple[float, ...]
"""Mass, radius and k of a kind of disks."""


def _sizes(fit: Fit) -> list[Size]:
    """Sizes of the two disks of a fit, the smaller first, or of the one that hits walls."""
    data = fit.data
    assert isinstance(data, Collisions)
    one, two = (
        np.broadcast_arrays(disk.mass, disk.radius, disk.k, np.empty(len(data)))[:3]
        for disk in (data.disk_1, data.disk_2)
    )
    rows = {
        tuple(sorted((tuple(map(float, a)), tuple(map(float, b)))[: 1 if data.wall else 2]))
        for a, b in zip(zip(*one, strict=True), zip(*two, strict=True), strict=True)
    }
    if len(rows) > 1:
        text = "pairs of kinds of disks were fitted together; a case needs a fit of each"
        raise InputError(f"{data.source}: {len(rows)} {text}")
    return [*rows.pop()]


def _pairs(fits: Sequence[Fit]) -> list[tuple[Kind, Kind | None]]:
    """The two kinds of disks of each fit; None for walls."""
    alike = [fit for fit in fits if len({*_sizes(fit)}) == len({*_materials(fit)} or {""}) == 1]
    known = {Kind((_materials(fit) or [""])[0], *_sizes(fit)[0]) for fit in alike if not _is_wall(fit)}
    found: list[tuple[Kind, Kind | None]] = []
    for fit in fits:
        names, sizes = _materials(fit), _sizes(fit)
        if _is_wall(fit):
            own = [each for each in names if each != WALL]
            ours = [each for each in own if Kind(each, *sizes[0]) in known] or own or [""]
            found.append((Kind(ours[0], *sizes[0]), None))
            continue
        one, other = (Kind(name, *size) for name, size in zip(names or ["", ""], sizes, strict=True))
        if len({*names}) == 2 and not {one, other} & known:  # which name belongs to which size?
            one, other = (Kind(name, *size) for name, size in zip(names, sizes[::-1], strict=True))
        found.append((one, other))
    kinds = sorted({kind for pair in found for kind in pair if kind is not None})
    there = {frozenset(pair) for pair in found}
    walls: list[Kind | None] = [None] * any(map(_is_wall, fits))
    wanted = [*combinations_with_replacement(kinds, 2), *product(kinds, walls)]
    missing = [pair for pair in wanted if frozenset(pair) not in there]
    refuse(
        [f"no impacts of {_shown(one)} on {_shown(other)}: a case needs them" for one, other in missing],
        "no case is written",
    )
    return found


def _is_wall(fit: Fit) -> bool:
    assert isinstance(fit.data, Collisions)
    return fit.data.wall


def _shown(kind: Kind | None) -> str:
    if kind is None:
        return "walls"
    return f"{kind.material or 'disks'} (mass {kind.mass:.5g}, radius {kind.radius:.5g})"


def _names(kinds: Sequence[Kind], name: str) -> dict[Kind, str]:
    """Names of species and materials: that of the material, with a number where several kinds have it."""
    found = {}
    for kind in kinds:
        alike = [each for each in kinds if each.material == kind.material]
        number = f"_{alike.index(kind) + 1}" if len(alike) > 1 else ""
        found[kind] = f"{kind.material or name}{number}"
    return found


def _one_class(fits: Sequence[Fit]) -> list[Fitted]:
    """The best fit of each pair among laws of one class, that whose AIC are lowest together."""
    best = [fit.laws[fit.best] for fit in fits]
    if len({each.law.kind for each in best}) == 1 and not any(map(not_in_cases, best)):
        return best
    sums: dict[type[CollisionLaw], tuple[float, list[Fitted]]] = {}
    for kind in {each.law.kind for each in fits[0].laws.values()}:
        each_fit = [
            [one for one in fit.laws.values() if one.law.kind is kind and not not_in_cases(one)]
            for fit in fits
        ]
        if all(each_fit):
            lowest = [min(laws, key=lambda one: one.AIC) for laws in each_fit]
            sums[kind] = sum(one.AIC for one in lowest), lowest
    if not sums:
        reasons = dict.fromkeys(reason for each in best if (reason := not_in_cases(each)))
        raise InputError(f"no case is written{next(iter(reasons), ': no class of laws fits all pairs')}")
    return min(sums.values(), key=lambda each: each[0])[1]


def _rms(fits: Sequence[Fit], kinds: Sequence[str]) -> float | None:
    """Root mean square of velocities or spins of disks before the measured impacts; None if none is known."""
    squares = 0.0
    for kind in kinds:
        values = [
            fit.data.measured[name]
            for fit in fits
            for name in (f"{kind}_1", f"{kind}_2")
            if name in fit.data.measured and not (_is_wall(fit) and name.endswith("2"))
        ]
        known = np.concatenate([np.asarray(each)[np.isfinite(each)] for each in values] or [np.empty(0)])
        if not len(known):
            return None
        squares += float(np.mean(known**2))
    return float(f"{math.sqrt(squares):.3g}")
