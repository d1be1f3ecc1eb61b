"""Inelastic collapse, infinitely many collisions in a finite time, and the remedies for it.

Elastic means here like smooth elastic disks: e_n = 1, without friction or other change of spins, so that the collision
costs no energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..tools.checked import Positive, must_be, validated


@validated
@dataclass(frozen=True)
class VelocityCutoff:
    """Remedy for inelastic collapse: slow collisions are elastic.

    Parameters
    ----------
    speed : float
        Normal speed of approach below which a collision is elastic [length/time].

    Raises
    ------
    InputError
        If it is not positive.

    Notes
    -----
    A gas that has cooled below the cut-off stops cooling.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.VelocityCutoff(1e-3)
    VelocityCutoff(speed=0.001)
    """

    speed: Positive


@validated
@dataclass(frozen=True)
class ContactTime:
    """Remedy for inelastic collapse: collisions in quick succession are elastic (the TC model).

    A collision is elastic if the latest collision of either partner, with a disk or a wall, was less than the contact
    time ago. Luding and McNamara (1998), doi:10.1007/s100350050017.

    Parameters
    ----------
    time : float
        Contact time [time].

    Raises
    ------
    InputError
        If it is not positive.

    Notes
    -----
    Some 1e-2 of the mean free time at the start changes little.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.ContactTime(1e-4)
    ContactTime(time=0.0001)
    """

    time: Positive


@validated
@dataclass(frozen=True)
class Rest:
    """Remedy for inelastic collapse under gravity: slow contacts last, with friction, and disks at rest fall asleep.

    It needs gravity, an `IFRLaw`, a CPU in double precision and no forces (`ifrdem docs heaps`).

    Parameters
    ----------
    speed : float
        Normal speed below which contacts last [length/time].

    Raises
    ------
    InputError
        If it is not positive.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.Rest(0.05)
    Rest(speed=0.05)
    """

    speed: Positive


Collapse = VelocityCutoff | ContactTime | Rest
"""A remedy for inelastic collapse."""


def validate(collapse: Any) -> Collapse | None:
    """The checked remedy of a user; InputError if it is not a remedy."""
    if collapse is None or isinstance(collapse, Collapse):
        return collapse
    raise must_be("collapse", collapse, "VelocityCutoff(speed), ContactTime(time), Rest(speed) or None")


def advice(
    collapse: Collapse | None, *, e_n: float | None, can_rest: bool, rebounds: bool, at_wall: bool
) -> str:
    """Sentence on remedies against inelastic collapse; of the one in use, only a larger value is advised.

    `e_n` is the smallest coefficient of the collisions in question, those `at_wall` or all; None for other laws. With
    `can_rest` the gas may have disks at rest; with `rebounds` every hit leaves a disk some speed.
    """
    if e_n == 1.0:
        return (
            "All these collisions are elastic: look for disks without space to move, such as between walls one "
            "diameter apart"
        )
    if collapse is not None:
        value = {VelocityCutoff: "velocity cut-off", ContactTime: "contact time", Rest: "resting speed"}
        remedies = [f"a larger {value[type(collapse)]} than in collapse = {collapse}"]
    else:
        names = ["ContactTime(time)", "VelocityCutoff(speed)"] * rebounds + ["Rest(speed)"] * can_rest
        remedies = [f"collapse = {' or '.join(names)} (run.collapse in a case)"] * bool(names)
    if e_n is not None:
        remedies.append("a larger e_n")
    remedies += ["a lower packing fraction"] * (not at_wall) + ["an earlier end of the run"]
    return f"Remedies: {', '.join(remedies[:-1])} or {remedies[-1]}"
