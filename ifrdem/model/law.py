"""Collision laws: what the engine needs of one, and how users write their own."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, ClassVar

from ..errors import InputError, nearest
from ..tools import checked


class CollisionLaw:
    """A collision law of one's own: subclasses say in `collide` which impulses a pair of disks exchanges.

    `ifrdem.IFRLaw` is one too, and passes through the same code. InputError if a coefficient is missing, unknown or
    not a finite number.

    Parameters
    ----------
    **values : float
        A finite number for each of the names in `coefficients`: one row for each pair of materials. They are not
        compiled in.

    Attributes
    ----------
    coefficients : tuple of str
        Names of the law's coefficients, in the order in which `collide` gets them.

    Notes
    -----
    Momentum is kept whatever `collide` returns, because the engine applies the impulses to both disks; so is, without
    T, the angular momentum. Whether the law can add energy is *not* known beforehand, as it is for the IFR law: a
    simulation tries it on random pairs and warns if one gains (`EnergyWarning`), and `Simulation.dissipated_energy`
    tells what became of it. One class of laws serves a whole simulation; its rows may differ from pair to pair of
    materials.

    Examples
    --------
    >>> import ifrdem
    >>> class Smooth(ifrdem.CollisionLaw):
    ...     coefficients = ("e_n",)
    ...     @staticmethod
    ...     def collide(pair, coefficients):
    ...         return (1.0 + coefficients[0]) * pair.m_n * pair.g_n, 0.0, 0.0
    ...
    >>> law = Smooth(e_n=0.9)
    >>> law.coefficients
    ('e_n',)
    """

    __slots__ = ("_row",)

    coefficients: ClassVar[tuple[str, ...]] = ()

    def __init__(self, **values: float) -> None:
        name = type(self).__name__
        for key in values:
            if key not in self.coefficients:
                allowed = ", ".join(self.coefficients) or "none"
                raise InputError(
                    f"{name}: unknown coefficient '{key}'{nearest(key, self.coefficients)}; it has: {allowed}"
                )
        row = []
        for key in self.coefficients:
            if key not in values:
                raise InputError(f"{name}: {key} is missing; it has: {', '.join(self.coefficients)}")
            value = checked.real(f"{name}: {key}", values[key], "a finite number is needed")
            if not math.isfinite(value):
                raise InputError(f"{name}: {key} = {value!r}: a finite number is needed")
            row.append(value)
        self._row = tuple(row)

    @staticmethod
    def collide(pair: Any, coefficients: Any) -> tuple[Any, Any, Any]:
        """The impulses of one collision, in the language of Taichi's functions (decorated by `ti.func` or not).

        Parameters
        ----------
        pair : struct
            g_n, g_t: relative velocity at the contact [length/time], along n (from i to j; 0 or more: the pair
            approaches) and along t = (-n_y, n_x), spins included; m_n, m_t: effective masses [mass], so that an impulse
            P along n changes g_n by -P/m_n, and one along t changes g_t by -P/m_t; and of either disk (i and j)
            inverse_mass_i (0 for a wall), radius_i, k_i and spin_i.
        coefficients : vector
            The numbers of the pair's materials.

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

    @classmethod
    def impulses(cls) -> Callable[..., Any]:
        """The function that the engine compiles: `collide`."""
        return cls.collide

    @classmethod
    def parts(cls) -> Callable[..., Any] | None:
        """Function that gives restitution's part of P_t for the ledger, and the regime; None of a law without."""
        return None

    def table_row(self) -> tuple[float, ...]:
        """The coefficients in their order."""
        return self._row

    def check(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> None:
        """Refuse disks with which the law cannot be used: k, and masses [any one unit]. Here none."""


@functools.cache
def compiled(kind: type[CollisionLaw]) -> Any:
    """Compiled form of a class of laws, a `kernels.layout.CompiledLaw`; one object for each class."""
    from ..kernels.language import ti
    from ..kernels.layout import CompiledLaw, plain

    function = kind.impulses()
    if not hasattr(function, "_is_taichi_function"):
        function = ti.func(plain(function))
    return CompiledLaw(function, max(len(kind.coefficients), 1), kind.parts())


def checked_class(laws: list[list[CollisionLaw]]) -> type[CollisionLaw]:
    """The one class of all laws of a table.

    InputError if one is no law, or says not how disks collide, or there are several classes.
    """
    kinds: list[type[CollisionLaw]] = []
    for law in (law for row in laws for law in row):
        kind: Any = type(law)
        if not isinstance(law, CollisionLaw) or kind.impulses() is CollisionLaw.collide:
            raise InputError(
                f"law = {law!r}: an IFRLaw, or an object of a class derived from ifrdem.CollisionLaw with a method "
                "collide, is needed"
            )
        if kind not in kinds:
            kinds.append(kind)
    if len(kinds) > 1:
        raise InputError(
            f"law table: laws of {len(kinds)} classes, {', '.join(kind.__name__ for kind in kinds)}: one class serves "
            "a whole simulation; write one whose collide tells them apart by a coefficient"
        )
    return kinds[0]
