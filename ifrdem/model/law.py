"""Collision laws: what the engine needs of one, how users write their own, and the laws of all pairs of materials.

`check_by_sampling` checks a custom law on random pairs: whether it keeps disks apart, and whether it adds energy.
"""

from __future__ import annotations

import functools
import inspect
import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError, nearest
from ..tools.checked import Array, Number
from ..tools.read_only import ReadOnlyAttributes
from .custom_code import (
    FromKernels,
    check_constants,
    check_signature,
    declared_names,
    named_numbers,
    why_not_compiled,
)
from .state import Disks

PAIRS = 4096
OF_PAIR = (
    "g_n", "g_t", "m_n", "m_t", "inverse_mass_i", "radius_i", "k_i", "spin_i",
    "inverse_mass_j", "radius_j", "k_j", "spin_j",
)  # fmt: skip
"""Names of the quantities of a pair that a law gets."""
_ROUND_OFF = 1e-9  # of an impulse or energy, in single precision too where its sums do not go into the state


class EnergyWarning(UserWarning):
    """The tangential impulses alone can add energy; only the loss along the line of centres outweighs it."""


class CollisionLaw(ReadOnlyAttributes):
    """A collision law of one's own: subclasses say in `collide` which impulses a pair of disks exchanges.

    `ifrdem.IFRLaw` is one too, and passes through the same code. InputError if a coefficient is missing, unknown or
    not a finite number.

    Parameters
    ----------
    **values : float
        A finite number for each of the names in `coefficients`: one row for each pair of materials. They are not
        compiled in, and are attributes of these names; `set_law` of a simulation gives it other ones.

    Attributes
    ----------
    coefficients : tuple of str
        Names of the law's coefficients, by which `collide` gets them.
    ranges : mapping
        Checks of coefficients by name (`Number(low, high, text)`), beyond that they are finite.
    is_proved : bool
        True if `check` proves that no collision adds energy; simulations sample other laws.

    Notes
    -----
    Momentum is kept whatever `collide` returns, because the engine applies the impulses to both disks; so is, without
    T, the angular momentum. Whether the law can add energy is *not* known beforehand, as it is for the IFR law: a
    simulation tries it on random pairs and warns if one gains (`EnergyWarning`), and `Simulation.dissipated_energy`
    tells what became of it. One class of laws serves a whole simulation; its rows may differ from pair to pair of
    materials. Variables from outside, such as module globals, are compiled in as constants: InputError from a later
    simulation or run if they have changed.

    Examples
    --------
    >>> import ifrdem
    >>> class Smooth(ifrdem.CollisionLaw):
    ...     coefficients = ("e_n",)
    ...     @staticmethod
    ...     def collide(pair, law):
    ...         return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0
    ...
    >>> law = Smooth(e_n=0.9)
    >>> law.coefficients
    ('e_n',)
    """

    coefficients: ClassVar[tuple[str, ...]] = ()
    ranges: ClassVar[Mapping[str, Number]] = MappingProxyType({})
    is_proved: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.assignable = declared_names(cls, CollisionLaw)

    def __init__(self, **values: float) -> None:
        row = named_numbers(type(self).__name__, "coefficient", self.coefficients, values)
        for name, in_range in self.ranges.items():
            in_range(name, row[name])
        self._row = tuple(row.values())

    def __getattr__(self, name: str) -> float:
        if name not in type(self).coefficients:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}{nearest(name, dir(self))}")
        return self._row[self.coefficients.index(name)]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.coefficients})

    def __repr__(self) -> str:
        """The law and its coefficients."""
        values = zip(self.coefficients, self.table_row(), strict=True)
        return f"{type(self).__name__}({', '.join(f'{name}={value:g}' for name, value in values)})"

    def __eq__(self, other: object) -> bool:
        """True for the same law with the same coefficients."""
        return type(self) is type(other) and self.table_row() == other.table_row()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash((type(self), self.table_row()))

    @staticmethod
    def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
        """The impulses of one collision, in the language of Taichi's functions (decorated by `ti.func` or not).

        Parameters
        ----------
        pair : struct
            g_n, g_t: relative velocity at the contact [length/time], along n (from i to j; 0 or more: the pair
            approaches) and along t = (-n_y, n_x), spins included; m_n, m_t: effective masses [mass], so that an impulse
            P along n changes g_n by -P/m_n, and one along t changes g_t by -P/m_t; and of either disk (i and j)
            inverse_mass_i (0 for a wall), radius_i, k_i and spin_i.
        law : struct
            The coefficients of the pair's materials, by name.

        Returns
        -------
        P_n, P_t : float
            Impulses that i gives to j along n and t [mass length/time]. P_n must be m_n g_n or more: with less the
            disks would go through each other. m_n g_n (1 + e_n) makes them separate at e_n g_n.
        T : float
            Angular impulse that brakes either spin, at most to rest [mass length^2/time]; 0.0 without rolling friction.

        Notes
        -----
        It must not matter which disk is i: exchanging them leaves g_n, g_t, m_n and m_t as they are.
        """
        # Abstract: `checked_class` refuses a law without its own, by name, before anything is compiled.
        raise NotImplementedError

    parts: ClassVar[Callable[..., Any] | None] = None
    """`collide` with a ledger, a static method: it also returns the part of P_t that tangential restitution gives, and
    1.0 or 0.0 if friction stopped the slip, and if the rolling torque was its greatest. Without it all of P_t counts
    as restitution."""

    def table_row(self) -> tuple[float, ...]:
        """The coefficients in their order."""
        return self._row

    @property
    def is_dissipative(self) -> bool:
        """True if every collision is known to take energy."""
        return False

    def check(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> None:
        """Refuse disks with which the law cannot be used: k, and masses [any one unit]. Here none."""


@functools.cache
def compiled(kind: type[CollisionLaw]) -> Any:
    """Compiled form of a class of laws, a `kernels.layout.CompiledLaw`; one object for each class."""
    from ..kernels.language import declared
    from ..kernels.layout import CompiledLaw

    if not isinstance(inspect.getattr_static(kind, "collide"), FromKernels):
        check_signature(f"law {kind.__name__}", kind.collide, ("pair", "law"))
    owners = [next(each for each in kind.__mro__ if name in vars(each)) for name in ("parts", "collide")]
    parts = kind.parts if issubclass(*owners) else None  # not of a law whose `collide` another one replaces
    names = tuple(kind.coefficients) or ("none",)
    return CompiledLaw(declared(kind.collide), names, parts and declared(parts))


def checked_class(laws: list[list[CollisionLaw]]) -> type[CollisionLaw]:
    """The one class of all laws of a table.

    InputError if one is no law, or says not how disks collide, or there are several classes.
    """
    kinds: list[type[CollisionLaw]] = []
    for law in (law for row in laws for law in row):
        kind: Any = type(law)
        if not isinstance(law, CollisionLaw) or kind.collide is CollisionLaw.collide:
            raise InputError(
                f"law = {law!r}: must be an IFRLaw, or an object of a class derived from ifrdem.CollisionLaw with a "
                "method collide"
            )
        if kind not in kinds:
            kinds.append(kind)
    if len(kinds) > 1:
        raise InputError(
            f"law table: laws of {len(kinds)} classes, {', '.join(kind.__name__ for kind in kinds)}: one class serves "
            "a whole simulation; write one whose collide tells them apart by a coefficient"
        )
    return kinds[0]


def check_by_sampling(
    kind: type[CollisionLaw], table: Array, disks: Disks, walls: Sequence[int], speed: float
) -> None:
    """Try a law on pairs drawn from these disks and walls, always the same ones.

    Angles are uniform, spins up to twice the speed at the rim, and speeds spread over 1e-3 to 10 times `speed`.
    InputError if impulses are not finite, or too small to keep two disks from going through each other. EnergyWarning
    if some of these collisions added energy: how many, and how much; others are not checked.

    Parameters
    ----------
    kind : class of laws
    table : array (M, M, c)
        Its coefficients for each pair of materials.
    disks : Disks
    walls : sequence of int
        Materials of the walls.
    speed : float
        The fastest at the start [length/time].
    """
    from ..kernels.contact import sample_law
    from ..kernels.language import CompilationError
    from ..kernels.layout import Uses

    check_constants(f"law {kind.__name__}", kind, "collide")
    movable = np.flatnonzero(disks.movable)
    if not len(movable):
        return
    draw = np.random.default_rng(1)
    i, j = draw.choice(movable, PAIRS), draw.choice(disks.n, PAIRS)
    # One pair in 8 is with a wall, if there are walls: an infinite mass with the disk's own radius.
    wall = draw.random(PAIRS) < (0.125 if len(walls) else 0.0)
    of_wall = draw.choice(walls, PAIRS) if len(walls) else np.zeros(PAIRS)
    v = max(speed, 1e-30) * 10.0 ** draw.uniform(-3.0, 1.0, PAIRS)
    psi = np.radians(draw.uniform(-89.9, 89.9, PAIRS))
    rim = v * draw.uniform(-2.0, 2.0, (2, PAIRS))
    R_j = np.where(wall, disks.radius[i], disks.radius[j])
    still = wall | ~disks.movable[j]
    pairs = np.column_stack((
        disks.material[i], np.where(wall, of_wall, disks.material[j]),
        1.0 / disks.mass[i], disks.radius[i], disks.k[i],
        np.where(wall, 0.0, 1.0 / disks.mass[j]), R_j, disks.k[j],
        v * np.cos(psi), v * np.sin(psi), rim[0] / disks.radius[i], np.where(still, 0.0, rim[1] / R_j),
    ))  # fmt: skip
    found = np.zeros((PAIRS, 8))
    law: Any = kind  # mypy does not take a class for hashable
    try:
        sample_law(Uses(collision_law=compiled(law)), np.ascontiguousarray(table), pairs, found)
    except CompilationError as error:
        reason = why_not_compiled(
            error,
            [kind.collide],
            {"pair": OF_PAIR, "law": kind.coefficients},
            "collide must return P_n, P_t and T",
        )
        raise InputError(f"law {kind.__name__}: cannot compile its collide: {reason}") from error
    _refuse_too_weak(kind, pairs, found)
    gain = _energy(pairs, found[:, 2:]) / _energy(pairs, _before(pairs)) - 1.0
    if gaining := np.count_nonzero(gain > _ROUND_OFF):
        most = f"one of them {100.0 * gain.max():.3g} % of the pair's"
        text = f"of {PAIRS} random collisions {gaining} added energy, {most}"
        more = "Simulation.dissipated_energy tells what becomes of it"
        warnings.warn(f"law {kind.__name__}: {text}. {more}", EnergyWarning, stacklevel=5)


def _refuse_too_weak(kind: type[CollisionLaw], pairs: Array, found: Array) -> None:
    P_n, least = found[:, 0], found[:, 1]
    wrong = ~np.isfinite(found).all(axis=1) | ~(P_n >= least * (1.0 - _ROUND_OFF))
    if wrong.any():
        c = int(np.argmax(wrong))
        raise InputError(
            f"law {kind.__name__}: disks of materials {pairs[c, 0]:.0f} and {pairs[c, 1]:.0f} that approach with "
            f"g_n = {pairs[c, 8]:.4g} get P_n = {P_n[c]:.4g}: a finite number, not below m_n g_n = {least[c]:.4g}, is "
            f"needed, and finite P_t and T; or they would go through each other ({np.count_nonzero(wrong)} of {PAIRS} "
            "random pairs)"
        )


def _before(pairs: Array) -> Array:
    zero = np.zeros(len(pairs))
    return np.column_stack((pairs[:, 8], pairs[:, 9], pairs[:, 10], zero, zero, pairs[:, 11]))


def _energy(pairs: Array, motion: Array) -> Array:
    """Kinetic energy of each pair, of which j may be a wall."""
    energy = np.zeros(len(pairs))
    for inverse, radius, k, first in ((2, 3, 4, 0), (5, 6, 7, 3)):
        vx, vy, spin = motion[:, first : first + 3].T
        finite = pairs[:, inverse] > 0.0
        twice = vx**2 + vy**2 + (pairs[:, radius] * spin) ** 2 / pairs[:, k]
        energy += np.divide(0.5 * twice, pairs[:, inverse], where=finite, out=np.zeros(len(pairs)))
    return energy


def law_table(
    law: CollisionLaw | Sequence[Sequence[CollisionLaw]], disks: Disks, most_of_walls: int = 0
) -> list[list[CollisionLaw]]:
    """The table [material][material] of one law for all, or of a table that is checked.

    InputError if it is neither, not square, too small for the materials that are there, or not symmetric.

    Parameters
    ----------
    law : CollisionLaw or sequence of sequences of CollisionLaw
    disks : Disks
    most_of_walls : int
        The highest material of walls.
    """
    materials = max(int(disks.material.max()) if disks.n else 0, most_of_walls) + 1
    if isinstance(law, CollisionLaw):
        return [[law] * materials for _ in range(materials)]
    if not isinstance(law, Sequence) or isinstance(law, str):
        checked_class([[law]])  # refuses it by name
    if not all(isinstance(row, Sequence) for row in law):
        raise InputError("law table: must be a list of lists of laws, [[law]], or one law for all")
    table = [list(row) for row in law]
    if len(table) < materials or any(len(row) != len(table) for row in table):
        raise InputError(f"law table: must be a square table of at least {materials} materials")
    checked_class(table)
    for a, row in enumerate(table):
        for b, one in enumerate(row):
            if one.table_row() != table[b][a].table_row():
                raise InputError(f"law table: [{a}][{b}] and [{b}][{a}] differ; a pair has one law")
    return table


def check_energy(laws: list[list[CollisionLaw]], disks: Disks, of_walls: Iterable[int] = ()) -> None:
    """Refuse a law that could add energy for a pair that is there, walls of the materials `of_walls` included.

    Of disks with one k and material, the lightest and the heaviest decide: see `pairing`.
    """
    kinds, which = np.unique(np.stack([disks.material, disks.k], axis=1), axis=0, return_inverse=True)
    lightest, heaviest = np.full(len(kinds), np.inf), np.zeros(len(kinds))
    np.minimum.at(lightest, which.ravel(), disks.mass)
    np.maximum.at(heaviest, which.ravel(), disks.mass)
    for one, (a, k_a) in enumerate(kinds):
        for other in range(one, len(kinds)):
            b, k_b = kinds[other]
            for m_a, m_b in {(lightest[one], heaviest[other]), (heaviest[one], lightest[other])}:
                if math.isinf(m_a) and math.isinf(m_b):
                    continue  # neither moves: they never meet
                laws[int(a)][int(b)].check(k_a, k_b, m_a, m_b)
    for material in set(of_walls):
        for a, k_a in kinds:
            # Beside a wall's infinite mass, the pair's mean k is the disk's own.
            laws[int(a)][material].check(k_a, k_a)


def coefficient_table(laws: list[list[CollisionLaw]]) -> Array:
    """The coefficients as kernels take them, shape (M, M, c). A law without any has a column of zeros."""
    return np.array([[one.table_row() or (0.0,) for one in row] for row in laws])
