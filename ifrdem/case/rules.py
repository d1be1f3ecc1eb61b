"""What physics forbids in a case, beyond types and ranges: everything that is wrong, at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, nearest
from ..initial import from_csv, from_trajectory, placement, radii
from ..kernels.limits import CROWD
from ..model.box import Box
from ..model.coin_table import coins
from ..model.free_area import Room
from ..model.walls import check as check_walls
from . import pair_rules
from .case import IMPACT_SCAN, is_trajectory
from .draft import Draft, Problem, Species, box_around, patch_of, walls_of
from .problems_output import problems_of_output
from .problems_walls import problems_of_walls

LARGEST_DISK = (
    1.0 / 3.0
)  # of the shorter side: the engine's limit, which keeps a disk from meeting its own image

WIDEST_RATIO = math.sqrt(CROWD) - 1.25
"""Of the largest to the smallest radius, at most: more of the smallest disks than CROWD could stand around the largest,
with a quarter of their diameter to spare, which is the least that the engine lists beyond contact."""


def problems(draft: Draft, folder: Path, *, start: bool = True) -> list[Problem]:
    """What is wrong with a case beyond types and ranges, as far as its valid sections tell.

    A start file's path begins at `folder`. Without `start`, it is looked at no more.
    """
    found = [*_wrong_names(draft), *_wrong_radii(draft)]
    species = draft.known_species()
    judged = (*pair_rules.verdicts(draft, species), *pair_rules.wall_verdicts(draft, species))
    found += [Problem(each.key, None, each.message) for each in _once(judged) if not each.admissible]
    if len(species) == len(draft.species) and species:  # all of them are needed to know the disks
        radius = np.concatenate([each.radius for each in species])
        found += _wrong_motion(draft, species)
        found += _wrong_forces(draft, species)
        box = patch = None
        if draft.box is not None:
            try:
                box, patch = box_around(draft.box, radius), patch_of(draft.box, radius)
            except InputError as error:
                found.append(Problem("box", None, str(error)))
        if box is not None:
            wrong_walls = [*problems_of_walls(draft, box, radius)]
            found += wrong_walls
            walls = () if wrong_walls else tuple(walls_of(draft.wall))
            room = Room(box, walls)
            if start:
                found += _wrong_room(draft, species, radius, None if patch is None else Room(patch, walls))
            found += _wrong_open(draft, box, patch)
        found += problems_of_output(draft, len(radius), box)
        if not start:
            return found
        found += _wrong_scan(draft, species, box)
        found += _wrong_start(draft, species, radius, None if box is None else room, folder)
    return found


def _wrong_names(draft: Draft) -> Iterator[Problem]:
    names = list(draft.material_names)
    # A section without a readable name may be the one that is meant.
    all_known = len(names) == len(draft.material)
    for kind, sections in (("material", draft.material), ("species", draft.species)):
        seen: dict[str, int] = {}
        for i, each in enumerate(sections):
            if each is not None and seen.setdefault(each.name, i) != i:
                text = f"the name of {kind}[{seen[each.name]}] too; each needs its own"
                yield Problem(f"{kind}[{i}].name", f'"{each.name}"', text)
            coin = getattr(each, "coin", None)
            if coin is not None and coin not in coins:
                text = f"no such coin{nearest(coin, coins)}; there are {', '.join(coins)}"
                yield Problem(f"{kind}[{i}].coin", f'"{coin}"', text)
    for i, section in enumerate(draft.species):
        if section is None:
            continue
        key = f"species[{i}].material"
        if section.coin is not None and draft.run is not None and draft.run.units != "SI":
            yield Problem(
                f"species[{i}].coin",
                f'"{section.coin}"',
                'its mass and diameter are in SI: run.units = "SI" is needed',
            )
        if section.material is None and section.coin is None:
            yield Problem(key, None, f"missing: the name of a material is needed; there are {_listed(names)}")
        elif section.material is None and section.coin in names:
            text = f"missing: a [[material]] is called '{section.coin}' like the coin, so say which is meant"
            yield Problem(key, None, text)
        elif section.material is not None and section.material not in names and all_known:
            text = f"no such material{nearest(section.material, names)}; there are {_listed(names)}"
            yield Problem(key, f'"{section.material}"', text)
    walls_known = draft.box is not None and None not in draft.wall
    pairs: dict[frozenset[str], int] = {}
    for i, pair in enumerate(draft.pair):
        if pair is None:
            continue
        a, b = pair.materials
        value = f'["{a}", "{b}"]'
        known = names + [each.coin for each in draft.species if each is not None and each.coin is not None]
        known = list(dict.fromkeys([*known, *draft.materials_of_walls()]))
        for name in pair.materials:
            if name not in known and all_known and walls_known:
                text = f"no material is called '{name}'{nearest(name, known)}; there are {_listed(known)}"
                yield Problem(f"pair[{i}].materials", value, text)
        if a == b:
            yield Problem(
                f"pair[{i}].materials", value, "two different names are needed; [[material]] is for one"
            )
        if pairs.setdefault(frozenset((a, b)), i) != i:
            yield Problem(
                f"pair[{i}].materials", value, f"the materials of pair[{pairs[frozenset((a, b))]}] too"
            )


def _wrong_radii(draft: Draft) -> Iterator[Problem]:
    for i, section in enumerate(draft.species):
        if section is not None and section.radii is not None:
            try:
                radii.check(section.radii.distribution, **section.radii.parameters)
            except InputError as error:
                yield Problem(f"species[{i}].radii", None, str(error))


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"


def _once(verdicts: Iterable[pair_rules.PairVerdict]) -> list[pair_rules.PairVerdict]:
    """Without those that say the same of further species."""
    return list({(each.key, each.message): each for each in verdicts}.values())


def _wrong_motion(draft: Draft, species: list[Species]) -> Iterator[Problem]:
    if draft.run is None or draft.run.collisions_per_disk is None:
        return
    value = f"{draft.run.collisions_per_disk:g}"
    if sum(each.number for each in species) < 2:
        yield Problem("run.collisions_per_disk", value, "one disk alone never collides; give t_end instead")
    elif (
        not any(each.speed_rms > 0.0 for each in species)
        and not draft.sets_in_motion
        and draft.start is not None
        and draft.start.file is None
        and not is_trajectory(draft.start.positions)
        and draft.start.positions != IMPACT_SCAN
    ):
        text = "nothing moves at the start, so nothing ever collides: a species' speed_rms above 0 is needed"
        yield Problem("run.collisions_per_disk", value, text)


def _wrong_forces(draft: Draft, species: list[Species]) -> Iterator[Problem]:
    for i, force in enumerate(draft.force):
        if force is None:
            continue
        if force.kind == "kicks" and sum(each.number for each in species) < 2:
            text = "random kicks keep the total momentum, so 2 disks at least are needed"
            yield Problem(f"force[{i}].kind", '"kicks"', text)
        if force.kind == "table_friction" and draft.box is not None and any(draft.box.gravity):
            text = "along a table, table friction is not supported: leave out box.gravity"
            yield Problem(f"force[{i}].kind", '"table_friction"', text)
        reduced = draft.run is not None and draft.run.units != "SI"
        if force.kind == "table_friction" and force.gravity is None and reduced:
            yield Problem(f"force[{i}].gravity", None, "missing: 9.81 m/s^2 is meant in SI units only")
        t_end = draft.run.t_end if draft.run is not None else None
        if t_end is not None and 0.5 * force.step > t_end:
            text = (
                f"the force acts at the middle of each step, which never comes before run.t_end = {t_end:g}"
            )
            yield Problem(f"force[{i}].step", f"{force.step:g}", text)


def _wrong_room(
    draft: Draft, species: list[Species], radius: NDArray[np.float64], room: Room | None
) -> Iterator[Problem]:
    """`room` is where disks start: that of the box, or of a part of an open one, if any."""
    assert draft.box is not None
    sides = room.box.lengths if room is not None else (math.inf, math.inf)
    fits = True
    for each in species if not draft.box.open else ():
        largest = 2.0 * float(each.radius.max())
        if largest > LARGEST_DISK * min(sides):
            fits = False
            yield Problem(
                "box",
                f"{sides[0]:.6g} x {sides[1]:.6g}",
                f"a disk of species '{each.name}' has diameter {largest:.6g}, more than a third of "
                "the shorter side: a larger box is needed, or more disks at this packing fraction",
            )
    ratio = float(radius.max() / radius.min())
    if ratio >= WIDEST_RATIO:
        yield Problem(
            "species",
            f"radii from {radius.min():.6g} to {radius.max():.6g}",
            f"the largest disk is {ratio:.4g} times as wide as the smallest: less than {WIDEST_RATIO:.0f} times is "
            "needed, or a distribution that is cut off (low, high)",
        )
    if draft.start is None or not fits or room is None:
        return
    box, covered = room.box, room.packing_fraction(radius)
    dense = "box.packing_fraction" if draft.box.lengths is None else "box.lengths"
    if covered >= 1.0:
        place = "room between walls" if room.all_walls else "box"
        text = f"the disks cover more than the {place} has" + _attainable(species, radius, room)
        yield Problem(dense, f"{covered:.4g} of the area", text)
    elif draft.start.file is None and draft.start.positions == "hexagonal":
        try:
            placement.hexagonal_positions(box, radius, walls=room.walls)
        except InputError as error:
            yield Problem("start.positions", '"hexagonal"', str(error))
    elif draft.start.file is None and draft.start.positions == "random":
        # Few disks can be denser: the limit holds for many (see placement.random_positions).
        limit = placement.SATURATION + 0.5 / np.sqrt(len(radius))
        if np.ptp(radius) == 0.0 and covered > limit:
            yield Problem(
                dense,
                f"{covered:.4g}",
                f"too dense for a random start, which ends at {placement.SATURATION}: "
                'a lower one is needed, or start.positions = "growth" or "hexagonal"',
            )


def _attainable(species: list[Species], radius: NDArray[np.float64], room: Room) -> str:
    """How many of one kind of disks would find room, by area."""
    if len(species) > 1 or np.ptp(radius) > 0.0:
        return ""
    most = int(placement.SATURATION * len(radius) / room.packing_fraction(radius))
    return f": some {most} of them find room at random"


def _wrong_open(draft: Draft, box: Box, patch: Box | None) -> Iterator[Problem]:
    start = draft.start
    if not box.is_open or start is None:
        return
    placed = start.file is None and not is_trajectory(start.positions) and start.positions != IMPACT_SCAN
    if placed and patch is None:
        text = (
            f'disks that start at "{start.positions}" places need a rectangle to start in: packing_fraction or lengths '
            "beside it"
        )
        yield Problem("box.open", "true", text)
    if not placed and patch is not None:
        key = (
            "box.lengths"
            if draft.box is not None and draft.box.lengths is not None
            else "box.packing_fraction"
        )
        yield Problem(
            key, None, "cannot stand beside box.open = true where the start says where the disks are"
        )


def _wrong_scan(draft: Draft, species: list[Species], box: Box | None) -> Iterator[Problem]:
    start = draft.start
    if start is None or start.file is not None or start.positions != IMPACT_SCAN:
        return
    key, value = "start.positions", f'"{IMPACT_SCAN}"'
    if box is not None and not box.is_open:
        yield Problem(key, value, "pairs that fly apart need box.open = true")
    if len(species) != 2 or species[0].number != species[1].number:
        found = ", ".join(f"{each.number} of '{each.name}'" for each in species)
        text = f"two species with equal numbers are needed, those that hit and those that are hit; there are {found}"
        yield Problem(key, value, text)
    if draft.force:
        yield Problem(
            key, value, "no [[force]] can act in a scan: impacts are told from velocities before and after"
        )
    for i, each in enumerate(draft.species):
        for speed in ("speed_rms", "spin_rms"):
            if each is not None and speed in each.model_fields_set:
                text = f"cannot stand beside {key} = {value}: start.speed is the speed of those that hit"
                yield Problem(f"species[{i}].{speed}", f"{getattr(each, speed):g}", text)


def _wrong_start(
    draft: Draft, species: list[Species], radius: NDArray[np.float64], room: Room | None, folder: Path
) -> Iterator[Problem]:
    start = draft.start
    if start is None:
        return
    box, walls = (None, ()) if room is None else (room.box, room.walls)
    frame = start.file is None and is_trajectory(start.positions)
    if start.file is None and not frame:
        return
    name = start.positions if frame else start.file
    key = "start.positions" if frame else "start.file"
    value = f'"{name}"'
    assert name is not None
    try:
        if frame:
            given = from_trajectory.read(
                folder / name, start.frame, radius, box, motion=start.motion, walls=walls
            )
        else:
            given = from_csv.read(folder / name, len(radius), box)
            if room is not None:
                placement.check_no_overlap(room.box, radius, given.position)
                check_walls(room.all_walls, room.box, given.position, radius)
    except InputError as error:
        yield from (Problem(key, value, line) for line in str(error).splitlines())
        return
    by_collisions = draft.run is not None and draft.run.collisions_per_disk is not None
    if draft.run is not None and by_collisions and len(radius) > 1 and not draft.sets_in_motion:
        rest = None
        if given.velocity is None and not any(each.speed_rms > 0.0 for each in species):
            more = "start.motion = true" if frame else "the columns vx, vy, spin"
            rest = f"has no velocities: {more} or a species' speed_rms above 0 are needed"
        elif given.velocity is not None and not np.any(given.velocity):
            rest = "has only velocities vx = vy = 0: others are needed"
        if rest is not None:
            text = f"nothing moves at the start, so nothing ever collides; {key} = {value} {rest}"
            yield Problem("run.collisions_per_disk", f"{draft.run.collisions_per_disk:g}", text)
    if given.velocity is None:
        return
    for i, each in enumerate(draft.species):
        for speed in ("speed_rms", "spin_rms"):
            if each is not None and speed in each.model_fields_set:
                where = (
                    f"start.motion = true ({value})" if frame else f"velocities in the start file '{name}'"
                )
                yield Problem(
                    f"species[{i}].{speed}", f"{getattr(each, speed):g}", f"cannot stand beside {where}"
                )
