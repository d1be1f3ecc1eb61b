"""Inelastic collapse, and the remedies for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import InputError
from ..tools import checked

COLLAPSE = ("none", "tc", "velocity_cutoff", "rest")


@dataclass(frozen=True)
class Collapse:
    """Remedy for inelastic collapse: infinitely many collisions in a finite time.

    InputError if the kind is unknown, or a number is missing, not above 0, or of no use.

    Parameters
    ----------
    kind : {"none", "tc", "velocity_cutoff", "rest"}
        none: nothing; a collapse without end stops the run with InelasticCollapse.
        tc: a collision is elastic if the latest collision of either partner, with a disk or a wall, was less than the
        contact time ago. Luding and McNamara (1998), doi:10.1007/s100350050017.
        velocity_cutoff: a collision is elastic if its normal speed of approach is below the cut-off.
        rest: contacts below the resting speed last, with friction, and disks that lie still sleep (`kernels/rest.py`).
    contact_time, velocity_cutoff, resting_speed : float, optional
        Above 0 [time], [length/time], [length/time]; the kind of this name needs it, and nothing else may have it.

    Notes
    -----
    Elastic means like smooth elastic disks: e_n = 1, without friction or other change of spins, so that it costs no
    energy. tc and velocity_cutoff bias what they touch: some 1e-2 of the mean free time at the start is a contact time
    that does so little; a gas that has cooled below the cut-off stops cooling.
    """

    kind: str = "none"
    contact_time: float | None = None
    velocity_cutoff: float | None = None
    resting_speed: float | None = None

    def __post_init__(self) -> None:
        checked.choice("collapse", self.kind, COLLAPSE)
        for name, kind in (
            ("contact_time", "tc"), ("velocity_cutoff", "velocity_cutoff"), ("resting_speed", "rest"),
        ):  # fmt: skip
            value = getattr(self, name)
            if self.kind == kind:
                if value is None or not (math.isfinite(value) and value > 0.0):
                    raise InputError(f'{name} = {value}: collapse = "{kind}" needs a finite number above 0')
            elif value is not None:
                raise InputError(
                    f'{name} = {value} is used with collapse = "{kind}" only, not with collapse = "{self.kind}"'
                )


def advice(
    *,
    contact_time: float,
    velocity_cutoff: float,
    resting_speed: float,
    e_n: float | None,
    rests: bool,
    rebounds: bool,
    at_wall: bool,
) -> str:
    """Sentence on remedies against inelastic collapse; those in use are not 0, and only a larger value is advised.

    `e_n` is the smallest coefficient of the collisions in question, those `at_wall` or all; None for other laws. With
    `rests` the gas may have a resting speed; with `rebounds` every hit leaves a disk some speed.
    """
    if e_n == 1.0:
        return (
            "All these collisions are elastic: look for disks without space to move, such as between walls one "
            "diameter apart"
        )
    given = {"contact_time": contact_time, "velocity_cutoff": velocity_cutoff, "resting_speed": resting_speed}
    ways = [f"a larger {name}" for name, value in given.items() if value]
    if not ways:
        if rebounds:
            ways += [
                'collapse = "tc" with a contact_time',
                'collapse = "velocity_cutoff" with a velocity_cutoff',
            ]
        if rests:
            ways.append('collapse = "rest" with a resting_speed')
    if e_n is not None:
        ways.append("a larger e_n")
    ways += ["a lower packing fraction"] * (not at_wall) + ["an earlier end of the run"]
    return f"Remedies: {', '.join(ways[:-1])} or {ways[-1]}"
