"""What physics forbids in a case, beyond types and ranges: everything that is wrong, at once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import pairing, placement, start_file
from .box import Box
from .coins import coins
from .draft import Draft, Problem, Species, box_around
from .errors import InputError, nearest

LARGEST_DISK = (
    1.0 / 3.0
)  # of the shorter side: the engine's limit, which keeps a disk from meeting its own image


def problems(draft: Draft, folder: Path) -> list[Problem]:
    """What is wrong with a case beyond types and ranges, as far as its valid sections tell.

    A start file's path begins at `folder`.
    """
    found = list(_wrong_names(draft))
    species = draft.known_species()
    found += [
        Problem(each.key, None, each.message)
        for each in _once(pairing.verdicts(draft, species))
        if not each.admissible
    ]
    if len(species) == len(draft.species) and species:  # all of them are needed to know the disks
        radius = np.concatenate([np.full(each.number, each.radius) for each in species])
        found += _wrong_motion(draft, species)
        found += _wrong_forces(draft, species)
        box = None
        if draft.box is not None:
            try:
                box = box_around(draft.box, radius)
            except InputError as error:
                found.append(Problem("box", None, str(error)))
        if box is not None:
            found += _wrong_room(draft, species, radius, box)
        found += _wrong_start(draft, species, radius, box, folder)
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
    pairs: dict[frozenset[str], int] = {}
    for i, pair in enumerate(draft.pair):
        if pair is None:
            continue
        a, b = pair.materials
        value = f'["{a}", "{b}"]'
        known = names + [each.coin for each in draft.species if each is not None and each.coin is not None]
        for name in pair.materials:
            if name not in known and all_known:
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


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"


def _once(verdicts: Iterator[pairing.PairVerdict]) -> list[pairing.PairVerdict]:
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
        t_end = draft.run.t_end if draft.run is not None else None
        if t_end is not None and 0.5 * force.step > t_end:
            text = (
                f"the force acts at the middle of each step, which never comes before run.t_end = {t_end:g}"
            )
            yield Problem(f"force[{i}].step", f"{force.step:g}", text)


def _wrong_room(
    draft: Draft, species: list[Species], radius: NDArray[np.float64], box: Box
) -> Iterator[Problem]:
    shortest = min(box.lengths)
    fits = True
    for each in species:
        if 2.0 * each.radius > LARGEST_DISK * shortest:
            fits = False
            yield Problem(
                "box",
                f"{box.lengths[0]:.6g} x {box.lengths[1]:.6g}",
                f"a disk of species '{each.name}' has diameter {2.0 * each.radius:.6g}, more than a third of "
                "the shorter side: a larger box is needed, or more disks at this packing fraction",
            )
    if draft.start is None or not fits:
        return
    covered = box.packing_fraction(radius)
    dense = "box.packing_fraction" if draft.box is not None and draft.box.lengths is None else "box.lengths"
    if covered >= 1.0:
        yield Problem(dense, f"{covered:.4g} of the area", "the disks cover more than the box has")
    elif draft.start.file is None and draft.start.positions == "hexagonal":
        try:
            placement.hexagonal_positions(box, radius)
        except InputError as error:
            yield Problem("start.positions", '"hexagonal"', str(error))
    elif draft.start.file is None:
        # Few disks can be denser: the limit holds for many (see placement.random_positions).
        limit = placement.SATURATION + 0.5 / np.sqrt(len(radius))
        if np.ptp(radius) == 0.0 and covered > limit:
            yield Problem(
                dense,
                f"{covered:.4g}",
                f"too dense for a random start, which ends at {placement.SATURATION}: "
                'a lower one is needed, or start.positions = "hexagonal"',
            )


def _wrong_start(
    draft: Draft, species: list[Species], radius: NDArray[np.float64], box: Box | None, folder: Path
) -> Iterator[Problem]:
    if draft.start is None or draft.start.file is None:
        return
    value = f'"{draft.start.file}"'
    try:
        file = start_file.read(folder / draft.start.file, len(radius), box)
        if box is not None:
            placement.check_no_overlap(box, radius, file.position)
    except InputError as error:
        yield from (Problem("start.file", value, line) for line in str(error).splitlines())
        return
    by_collisions = draft.run is not None and draft.run.collisions_per_disk is not None
    if draft.run is not None and by_collisions and len(radius) > 1 and not draft.sets_in_motion:
        rest = None
        if file.velocity is None and not any(each.speed_rms > 0.0 for each in species):
            rest = "has no velocities: the columns vx, vy, spin or a species' speed_rms above 0 are needed"
        elif file.velocity is not None and not np.any(file.velocity):
            rest = "has only velocities vx = vy = 0: others are needed"
        if rest is not None:
            text = f"nothing moves at the start, so nothing ever collides; start.file = {value} {rest}"
            yield Problem("run.collisions_per_disk", f"{draft.run.collisions_per_disk:g}", text)
    if file.velocity is None:
        return
    for i, each in enumerate(draft.species):
        for key in ("speed_rms", "spin_rms"):
            if each is not None and key in each.model_fields_set:
                text = f"cannot stand beside velocities in the start file '{draft.start.file}'"
                yield Problem(f"species[{i}].{key}", f"{getattr(each, key):g}", text)
