"""Collision laws: what the engine needs of one, and how users write their own."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, nearest, shortened
from ...tools.checked import Array, Number
from ...tools.read_only import ReadOnlyAttributes
from ..custom_code import (
    FromKernels,
    check_constants,
    check_signature,
    declared_names,
    is_custom,
    named_numbers,
)

OF_PAIR = (
    "g_n", "g_t", "m_n", "m_t", "inverse_mass_i", "radius_i", "k_i", "spin_i",
    "inverse_mass_j", "radius_j", "k_j", "spin_j", "reduced_radius",
)  # fmt: skip
"""Names of the quantities of a pair that a law gets."""


class EnergyWarning(UserWarning):
    """The tangential impulses alone can add energy; only the loss along the line of centres outweighs it."""


class Admissibility(NamedTuple):
    """Verdict on a law: whether it can add energy in the collisions of one kind of pair."""

    admissible: bool
    strict: bool
    """admissible, strict: no collision adds energy; not even the tangential impulses taken alone do."""
    message: str
    """The reason, with the inequality that decides and its numbers."""


class Key(NamedTuple):
    """A key of a law in cases, which is also an argument of the law."""

    allowed: Number | tuple[str, ...] | type[str]
    """The range of a number, or the choices of a text; any text is the path of a file."""
    text: str
    """Description of the quantity, with the unit in brackets, for the list of keys (`ifrdem docs case`)."""
    example: float | str


_OF_COLLIDE = ("is_passive", "has_averages", "has_ifr_symbols", "depends_on_speed", "has_table")
"""Attributes that say something of the `collide` of a class."""


class CollisionLaw(ReadOnlyAttributes):
    """Base class of custom collision laws: `collide` gives the impulses that a pair of disks exchanges.

    `ifrdem.IFRLaw` is one too, and passes through the same code. InputError if a coefficient is missing, unknown or
    not a finite number.

    Parameters
    ----------
    **values : float
        A finite number for each of the names in `coefficients`: one row for each pair of materials. They are not
        compiled in, and are attributes of these names; `set_law` of a simulation gives it other ones.

    Attributes
    ----------
    name_in_cases : str
        Name of the law in cases and records, `law = "walton"`; empty for a custom law, whose name is that of its file.
    keys : mapping of str to Key
        Of a law with such a name, its keys in cases: arguments of the class, whose defaults they have.
    takes_k : bool
        True if the class takes k, the shape number of the disks for which a law is examined.
    coefficients : tuple of str
        Names of the law's coefficients, by which `collide` gets them.
    ranges : mapping
        Checks of coefficients by name (`Number(low, high, text)`), beyond that they are finite; those of `keys`, if the
        class has some.
    is_passive : bool
        True if it is proved that no collision adds energy, of disks that `check` takes. Simulations try a custom law on
        random pairs all the same, and refuse it if one of them gains.
    has_table : bool
        True if the numbers of a table follow the coefficients in `table_row`, which `collide` and `parts`, that there
        must be, then get as a third argument.
    has_averages : bool
        True if the impulses have the form that `slip_coefficients` gives, whose averages kinetic theory knows.
    depends_on_speed : bool
        True if e_n depends on the speed of approach: `restitutions` then gives it to kinetic theory.
    has_ifr_symbols : bool
        True if those coefficients that are named e_n, e_t and mu mean what they mean in `IFRLaw`: normal and
        tangential restitution of every impact, and friction. A law with mu = 0 and e_t = -1 is then smooth.

    Notes
    -----
    Momentum is kept whatever `collide` returns, because the engine applies the impulses to both disks; so is, without
    T, the angular momentum. Whether the law can add energy is *not* known beforehand, as it is for the IFR law: a
    simulation tries it on random pairs and warns if one gains (`EnergyWarning`), and `Simulation.dissipated_energy`
    gives what became of it. One class of laws serves a whole simulation; its rows may differ from pair to pair of
    materials. Variables from outside, such as module globals, are compiled in as constants: InputError from a later
    simulation or run if they have changed.

    The attributes that begin with is, has and depends describe the `collide` of their class. In a class with a
    `collide` of its own they are False again, unless it sets them.

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

    name_in_cases: ClassVar[str] = ""
    keys: ClassVar[Mapping[str, Key]] = MappingProxyType({})
    takes_k: ClassVar[bool] = False
    coefficients: ClassVar[tuple[str, ...]] = ()
    ranges: ClassVar[Mapping[str, Number]] = MappingProxyType({})
    is_passive: ClassVar[bool] = False
    has_averages: ClassVar[bool] = False
    has_ifr_symbols: ClassVar[bool] = False
    depends_on_speed: ClassVar[bool] = False
    has_table: ClassVar[bool] = False
    _source: ClassVar[Any]  # `law_files.LawSource` of a class from a file

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "is_proved" in vars(cls):
            raise InputError(
                f"{cls.__name__}: is_proved = {shortened(vars(cls)['is_proved'])}: must be replaced by those of "
                f"{', '.join(_OF_COLLIDE[:3])} that hold: no collision adds energy; kinetic theory has its averages; "
                "e_n, e_t and mu mean what they mean in IFRLaw"
            )
        if vars(cls).get("has_averages") and cls.slip_coefficients is CollisionLaw.slip_coefficients:
            raise InputError(
                f"{cls.__name__}: has_averages = True: requires a method slip_coefficients(self, inverse_a)"
            )
        if "collide" in vars(cls):
            for name in _OF_COLLIDE:
                if name not in vars(cls):
                    setattr(cls, name, False)
        cls.name_in_cases = vars(cls).get("name_in_cases", "")
        if "keys" in vars(cls):
            numbers = {name: key.allowed for name, key in cls.keys.items() if isinstance(key.allowed, Number)}
            cls.ranges = MappingProxyType(numbers)
        cls.assignable = declared_names(cls, CollisionLaw)

    def __init__(self, **values: float) -> None:
        row = named_numbers(type(self).__name__, "coefficient", self.coefficients, values, self.ranges)
        self._row = tuple(row.values())

    def __reduce_ex__(self, protocol: Any) -> str | tuple[Any, ...]:
        """Of a law from a file, which other processes cannot import by a name: its source and its attributes."""
        if (source := vars(type(self)).get("_source")) is None:
            return super().__reduce_ex__(protocol)
        from .files import restored

        return restored, (source,), dict(vars(self))

    def __getattr__(self, name: str) -> float:
        if name not in type(self).coefficients:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}{nearest(name, dir(self))}")
        return self.table_row()[self.coefficients.index(name)]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.coefficients})

    def __repr__(self) -> str:
        """The law and its coefficients."""
        values = zip(self.coefficients, self.table_row(), strict=True)
        return f"{type(self).__name__}({', '.join(f'{name}={value:g}' for name, value in values)})"

    def __eq__(self, other: object) -> bool:
        """True for the same law with the same coefficients."""
        return (
            isinstance(other, CollisionLaw)
            and type(self) is type(other)
            and self.table_row() == other.table_row()
        )

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
            P along n changes g_n by -P/m_n, and one along t changes g_t by -P/m_t; reduced_radius: of Hertz's contact
            [length], R_i R_j / (R_i + R_j), at a flat wall R_i, outside a circle of radius r R_i r / (r + R_i), inside
            R_i r / (r - R_i); and of either disk (i and j) inverse_mass_i (0 for a wall), radius_i (of a wall that of
            the disk, whose lever it is), k_i and spin_i.
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
        # Abstract: `PairLaws` refuses a law without its own, by name, before anything is compiled.
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

    @classmethod
    def column(cls, table: Array, name: str) -> Array:
        """The column of a coefficient in a table of rows (`table_row`), shape (..., coefficients)."""
        found: Array = table[..., cls.coefficients.index(name)]
        return found

    def slip_coefficients(self, inverse_a: Array) -> tuple[Array, Array]:
        """h and c of a law that `has_averages`, of which kinetic theory follows (`ifrdem.theory`).

        Impulses are P_n = (1 + e_n) m_n g_n, and P_t = sign(g_t) [h m_n |g_t| + min(c m_n |g_t|, mu P_n)] with the
        law's attributes e_n and mu, or e_n by `restitutions` if it `depends_on_speed`; mu = 0 without friction.

        Parameters
        ----------
        inverse_a : array
            m_t / m_n of pairs, any shape.

        Returns
        -------
        h, c : arrays
            Of the shape of inverse_a; h is 0 or more, c above 0.
        """
        # Abstract for laws that have averages: a class without its own is refused as it is made.
        raise NotImplementedError

    def restitutions(self, g_n: ArrayLike, m_n: ArrayLike, R: float) -> Array:
        """e_n of pairs that approach at g_n [length/time]; an array.

        m_n, R : effective mass [mass] and radius R_i R_j / (R_i + R_j) [length] of the pairs.
        """
        return np.full(np.broadcast_shapes(np.shape(g_n), np.shape(m_n)), self.e_n)

    def check_speed(self, g_n: float, m_n: float, R: float) -> None:
        """Refuse a law that does not hold at a typical speed of approach g_n [length/time]. Here none.

        m_n, R : effective mass [mass] and radius R_i R_j / (R_i + R_j) [length] of the pair.
        """

    def check(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> None:
        """Refuse disks with which the law cannot be used: k, and masses [any one unit]. Here none."""

    def admissibility(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> Admissibility:
        """Verdict on collisions of disks with these k and masses; InputError if `check` refuses them."""
        self.check(k_i, k_j, m_i, m_j)
        about = (
            "no collision adds energy" if self.is_passive else "whether collisions add energy is not proved"
        )
        return Admissibility(True, True, f"{self}: {about}")


def parts_of(kind: type[CollisionLaw]) -> Callable[..., Any] | None:
    """`parts` of a class of laws; None without, and of a base whose `collide` another one replaces."""
    owners = [next(each for each in kind.__mro__ if name in vars(each)) for name in ("parts", "collide")]
    return kind.parts if issubclass(*owners) else None


def check_law_constants(kind: type[CollisionLaw]) -> None:
    """Raise InputError if a variable from outside of a class of laws has changed since its first use."""
    if is_custom(kind):
        methods = ("collide",) if parts_of(kind) is None else ("collide", "parts")
        check_constants(f"law {kind.__name__}", kind, *methods)


@functools.cache
def compiled(kind: type[CollisionLaw]) -> Any:
    """Compiled form of a class of laws, a `kernels.layout.CompiledLaw`; one object for each class."""
    from ...kernels.compiler.language import declared
    from ...kernels.layout import CompiledLaw

    if not isinstance(inspect.getattr_static(kind, "collide"), FromKernels):
        check_signature(f"law {kind.__name__}", kind.collide, ("pair", "law"))
    parts = parts_of(kind)
    names = tuple(kind.coefficients) or ("none",)
    return CompiledLaw(declared(kind.collide), names, parts and declared(parts), kind.has_table)
