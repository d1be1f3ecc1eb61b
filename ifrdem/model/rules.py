"""Exclusions of a gas: each once, as a row of `RULES`, for `Simulation` and for cases.

A row sees `Facts`, which a case knows before any disk is made; those of a `Setup` are `Setup.facts`. Names are those of
Python's arguments; `Simulation` (`simulation.start.checks.check_exclusions`) and cases (`case.exclusions`) say them in
their own words. Limits that need places or sizes of disks are no rows: they are functions of `simulation.start.checks`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..kernels.columns import ADDRESSABLE, SINGLE_TILE


@dataclass(frozen=True)
class Facts:
    """Facts of a gas that the rules ask for; by default two disks in a periodic box, and nothing else.

    Attributes
    ----------
    is_open, periodic, shear_rate
        Of its `Box`; an open one is not periodic.
    walls, pistons : int
        Numbers of walls among the disks, without the sides of the box, and of the pistons among these.
    gravity : tuple of two floats
        At the start, or as it is to be set [length/time^2].
    rotating : bool
        True if gravity rotates.
    forces : frozenset of str
        Names of the classes of forces, those of the classes they derive from included.
    collapse : str
        Name of the class of the remedy for inelastic collapse, "" without.
    law : str
        Name of the class of laws, "" for `IFRLaw`.
    record : frozenset of str
        What is recorded.
    device, precision, low_memory
        Of its `Device`.
    histories : bool
        True if disks are tracked.
    n : int
        Number of disks.
    immovable : bool
        True if a disk has an infinite mass.
    ranks : int
        Ranks of MPI.
    order : str
        Of `Engine`, "" by default.
    """

    is_open: bool = False
    periodic: tuple[bool, bool] = (True, True)
    shear_rate: float = 0.0
    walls: int = 0
    pistons: int = 0
    gravity: tuple[float, float] = (0.0, 0.0)
    rotating: bool = False
    forces: frozenset[str] = frozenset()
    collapse: str = ""
    law: str = ""
    record: frozenset[str] = frozenset()
    device: str = "cpu"
    precision: str = "f64"
    low_memory: bool = False
    histories: bool = False
    n: int = 2
    immovable: bool = False
    ranks: int = 1
    order: str = ""

    @property
    def walled(self) -> bool:
        """True if there are walls, among the disks or at sides of the box."""
        return self.walls > 0 or not (self.is_open or all(self.periodic))

    @property
    def rests(self) -> bool:
        """True if disks may rest."""
        return self.collapse == "Rest"

    @property
    def along_a_period(self) -> bool:
        """True if gravity that does not rotate acts along a periodic direction."""
        return not self.rotating and any(
            pull and one for pull, one in zip(self.gravity, self.periodic, strict=True)
        )


@dataclass(frozen=True)
class Rule:
    """An exclusion.

    Attributes
    ----------
    at, with_ : str
        The argument at which a gas is refused, and the one that excludes it.
    when : function of Facts
        True of a gas that has both.
    why : str
        The reason, and what to do instead.
    """

    at: str
    with_: str
    when: Callable[[Facts], bool]
    why: str


_FALL = "disks would fall for ever"
_FLOOR = f"{_FALL} along a periodic direction, which has no floor; make it not periodic"
_DIGITS = "frames would differ in their last digits"
_ONE_PROCESS = "run it without mpiexec"
_CPU = "run it on a CPU in double precision"
_ORDER = "every disk looks for a piston after each of its hits, in the whole box in order"
_HELD = "only gravity holds disks on their supports; give one, or leave the remedy out"
_INSTEAD = "use walls (Wall.post) instead"


def _of_fluxes(with_: str, when: Callable[[Facts], bool], why: str) -> tuple[Rule, Rule]:
    """The rules of a record of the stress, and of one of the heat flux, which includes it."""
    return (
        Rule(
            "record.stress",
            with_,
            lambda g: {"stress", "heat_flux"} & g.record == {"stress"} and when(g),
            why,
        ),
        Rule("record.heat_flux", with_, lambda g: "heat_flux" in g.record and when(g), why),
    )


RULES: tuple[Rule, ...] = (
    # Open space.
    Rule("gravity", "box.open", lambda g: g.is_open and any(g.gravity),
         f"{_FALL}; use a box that is not periodic, with a floor"),
    Rule("walls", "box.open", lambda g: g.is_open and g.walls > 0,
         "use a box with sides, large enough for the disks not to reach them"),
    *_of_fluxes("box.open", lambda g: g.is_open, "open space has no area that a stress could refer to"),
    Rule("comm", "box.open", lambda g: g.is_open and g.ranks > 1, _ONE_PROCESS),
    # Gravity.
    Rule("gravity", "box.periodic", lambda g: g.along_a_period, _FLOOR),
    Rule("gravity.rate", "box.periodic", lambda g: g.rotating and any(g.periodic),
         f"{_FALL} along a periodic direction; no side may be periodic"),
    Rule("histories", "gravity.rate", lambda g: g.rotating and g.histories,
         "no paths are kept where gravity rotates; use more frames"),
    Rule("comm", "gravity.rate", lambda g: g.rotating and g.ranks > 1, _ONE_PROCESS),
    Rule("walls.piston", "gravity.rate", lambda g: g.rotating and g.pistons > 0,
         "its weight would change; leave one of them out"),
    Rule("forces.TableFriction", "gravity", lambda g: any(g.gravity) and "TableFriction" in g.forces,
         "along a table, a coin would have to stay where friction holds it; leave one of them out"),
    # Shear.
    Rule("box.shear_rate", "box.periodic", lambda g: g.shear_rate != 0.0 and not all(g.periodic),
         "a sheared box is periodic along x and y; shear between walls by walls that move, or have a surface_speed"),
    Rule("walls", "box.shear_rate", lambda g: g.shear_rate != 0.0 and g.walls > 0,
         "flow and images would pass through them; leave shear_rate out: walls that move shear too"),
    Rule("histories", "box.shear_rate", lambda g: g.shear_rate != 0.0 and g.histories,
         "with walls that move instead, shear can be tracked"),
    Rule("disks.mass", "box.shear_rate", lambda g: g.shear_rate != 0.0 and g.immovable,
         "the flow carries everything along"),
    # What is recorded.
    Rule("record.wall_sums", "walls", lambda g: "wall_sums" in g.record and not g.walled, "there are no walls"),
    *_of_fluxes("collapse.Rest", lambda g: g.rests,
                "forces between resting disks, which are no collisions, carry a part of it"),
    *_of_fluxes("walls.piston", lambda g: g.pistons > 0, "a piston changes the area of the gas"),
    Rule("record.heat_flux", "box.shear_rate", lambda g: g.shear_rate != 0.0 and "heat_flux" in g.record,
         "energies relative to the flow change between collisions too; with walls that move instead, it is recorded"),
    # Rest.
    Rule("collapse.Rest", "device.name", lambda g: g.rests and g.device != "cpu", _CPU),
    Rule("collapse.Rest", "device.precision", lambda g: g.rests and g.precision != "f64", _CPU),
    Rule("collapse.Rest", "disks.n", lambda g: g.rests and g.n > SINGLE_TILE,
         f"only gases that one thread computes as a whole can rest, of up to {SINGLE_TILE} disks"),
    Rule("collapse.Rest", "gravity", lambda g: g.rests and not any(g.gravity), _HELD),
    Rule("collapse.Rest", "law", lambda g: g.rests and g.law != "",
         "a contact that lasts needs mu and rho of the IFR law"),
    Rule("collapse.Rest", "forces", lambda g: g.rests and bool(g.forces),
         "disks at rest would not feel them; leave one of them out"),
    Rule("comm", "collapse.Rest", lambda g: g.rests and g.ranks > 1, _ONE_PROCESS),
    # Pistons.
    Rule("walls.piston", "device.name", lambda g: g.pistons > 0 and g.device != "cpu", f"{_ORDER}; {_CPU}"),
    Rule("walls.piston", "device.precision", lambda g: g.pistons > 0 and g.precision != "f64", f"{_ORDER}; {_CPU}"),
    Rule("walls.piston", "order", lambda g: g.pistons > 0 and g.order == "tiled", f"{_ORDER}; leave order out"),
    Rule("walls.piston", "disks.n", lambda g: g.pistons > 0 and g.n > SINGLE_TILE,
         f"{_ORDER}; take up to {SINGLE_TILE} disks"),
    Rule("walls.piston", "collapse.Rest", lambda g: g.pistons > 0 and g.rests,
         "disks do not rest on a wall that moves freely; leave one of them out"),
    Rule("comm", "walls.piston", lambda g: g.pistons > 0 and g.ranks > 1, _ONE_PROCESS),
    # Forces.
    Rule("forces.RandomKicks", "disks.n", lambda g: g.n < 2 and "RandomKicks" in g.forces,
         "random kicks keep the total momentum: they need 2 disks at least"),
    Rule("forces", "disks.mass", lambda g: bool(g.forces) and g.immovable, _INSTEAD),
    Rule("gravity", "disks.mass", lambda g: (any(g.gravity) or g.rotating) and g.immovable, _INSTEAD),
    # Memory.
    Rule("device.low_memory", "walls", lambda g: g.low_memory and g.walled, _DIGITS),
    Rule("device.low_memory", "forces", lambda g: g.low_memory and bool(g.forces), _DIGITS),
    Rule("device.low_memory", "box.shear_rate", lambda g: g.low_memory and g.shear_rate != 0.0, _DIGITS),
    Rule("device.low_memory", "collapse", lambda g: g.low_memory and g.collapse in ("ContactTime", "Rest"), _DIGITS),
    # Ranks.
    Rule("comm", "device.precision", lambda g: g.ranks > 1 and g.precision != "f64", _ONE_PROCESS),
    Rule("comm", "order", lambda g: g.ranks > 1 and g.order == "serial", _ONE_PROCESS),
    Rule("comm", "histories", lambda g: g.ranks > 1 and g.histories and g.n > ADDRESSABLE,
         f"of more than {ADDRESSABLE} disks none can be tracked on ranks; {_ONE_PROCESS}"),
)  # fmt: skip


def refusals(gas: Facts) -> Iterator[Rule]:
    """The rules that a gas breaks, all of them."""
    return (rule for rule in RULES if rule.when(gas))
