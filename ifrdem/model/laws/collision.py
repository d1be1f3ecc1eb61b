"""A single collision by any law, in NumPy: `ifrdem.collide`."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError
from ...tools.checked import LEAST, MOST, Array, Numbers, validated
from ..custom_code import FromKernels
from .ifr import mean_k
from .law import OF_PAIR, CollisionLaw, parts_of
from .records import AnyLaw

UNKNOWN = -1
"""Regime of a custom law without `parts`."""

# A normal may be off unit length by what dividing by its length leaves, with room for a few operations more.
_UNIT = 1e-12


class Collision(NamedTuple):
    """The outcome of `collide`; the leading axes `...` are those of its arguments."""

    velocity: Array
    spin: Array
    """velocity, spin: after the collision: velocities [length/time], disk, then component; spins, counter-clockwise
    [rad/time]."""
    P_n: Array
    P_t: Array
    """P_n, P_t: impulses [mass length/time] that the first disk gives to the second along the normal n and along t =
    (-n_y, n_x); shape (...)."""
    regime: NDArray[np.int8]
    """Values of `Regime`; shape (...)."""


_Masses = Annotated[ArrayLike, Numbers(("...", 2), LEAST, math.inf, f"positive, from {LEAST:g}, or inf")]
_Contacts = Annotated[ArrayLike, Numbers(None, LEAST, MOST, f"positive, from {LEAST:g} to {MOST:g}")]
_Shapes = Annotated[ArrayLike, Numbers(("...", 2), LEAST, MOST, f"positive, from {LEAST:g} to {MOST:g}")]
_Pairs = Annotated[ArrayLike, Numbers(("...", 2))]
_Velocities = Annotated[ArrayLike, Numbers(("...", 2, 2))]


@validated
def collide(
    law: AnyLaw,
    normal: _Pairs,
    mass: _Masses,
    radius: _Masses,
    k: _Shapes,
    velocity: _Velocities,
    spin: _Pairs,
    reduced_radius: _Contacts | None = None,
) -> Collision:
    """Collide pairs of disks, or disks with walls.

    All arguments may have leading axes `...`, which broadcast; the axis of length 2 after them is the disk. Computed
    in float64. InputError if a shape does not fit, a value is not finite or not positive where it must be, a normal
    is not a unit vector, both masses are infinite, the law can add energy for these k, or the `collide` of a custom law
    cannot be called with numbers. EnergyWarning if k is larger than an IFR law was made for, and only the loss along
    the line of centres keeps the energy.

    Parameters
    ----------
    law : CollisionLaw or mapping
        The law of the pair's materials: an `IFRLaw`, another law of `ifrdem.laws`, or a custom law, whose energy is not
        checked; or a law by name, such as {"law": "walton", "e_n": 0.9, "beta_0": 0.4, "mu": 0.2}.
    normal : array (..., 2)
        Unit vectors from the centre of the first disk to that of the second.
    mass, radius : array (..., 2)
        Masses [mass] and radii [length]. An infinite mass is a wall, which keeps its velocity and spin; its radius may
        be infinite, a flat wall. For rolling friction that counts as the partner's, so that the paper's r is the
        partner's.
    k : array (..., 2)
        Shape numbers in I = m R^2 / k.
    velocity, spin : arrays (..., 2, 2) and (..., 2)
        Before the collision: velocities [length/time], disk, then component; spins, counter-clockwise [rad/time], 0 for
        a flat wall.

    reduced_radius : array (...), optional
        Radius of Hertz's contact [length], of which the law of viscoelastic spheres takes its e_n; without it
        R_i R_j / (R_i + R_j), and the partner's radius at a flat wall. Inside a circle of radius r, which has no
        positive radius to give, it is R_i r / (r - R_i).

    Returns
    -------
    Collision
        Velocities and spins after, impulses, regime: -1 for an unknown one, of a custom law without `parts`. Pairs that
        separate come back unchanged.

    Notes
    -----
    The collision is instantaneous, without adhesion. Rolling friction (rho > 0) keeps linear momentum but takes angular
    momentum from the pair.

    Examples
    --------
    An aluminium coin of 1.19 g and 21 mm hits an equal one, at rest, at 45 degrees:

    >>> from ifrdem import IFRLaw, Regime, collide
    >>> law = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    >>> n = [0.5**0.5, 0.5**0.5]
    >>> after = collide(law, n, [1.19e-3] * 2, [10.5e-3] * 2, [2, 2], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
    >>> Regime(int(after.regime)).name
    'SLIDING'
    """
    from ...kernels.laws import law as law_kernels  # imports Taichi, which is slow

    n, m, R, k_, w = (np.asarray(value, dtype=np.float64) for value in (normal, mass, radius, k, spin))
    v = np.asarray(velocity, dtype=np.float64)
    wall, flat = np.isinf(m), np.isinf(R)
    _refuse("mass", m, np.all(wall, axis=-1, keepdims=True) & wall, "only one of the two may be infinite")
    try:
        contact = () if reduced_radius is None else ((*np.shape(reduced_radius), 2),)
        shape = np.broadcast_shapes(m.shape, R.shape, k_.shape, w.shape, n.shape, v.shape[:-1], *contact)
    except ValueError:
        shapes = ", ".join(str(array.shape) for array in (n, m, R, k_, v, w))
        raise InputError(
            f"normal, mass, radius, k, velocity, spin have shapes {shapes}: their leading axes must broadcast"
        ) from None
    _refuse("radius", R, flat & ~wall, "only an infinite mass may have an infinite radius")
    _refuse("spin", w, flat & (w != 0.0), "a flat wall (infinite radius) cannot spin")
    off = ~(np.abs(np.hypot(n[..., :1], n[..., 1:]) - 1.0) <= _UNIT)
    _refuse("normal", n, off, "must be a unit vector, to 1e-12")

    largest_k = float(np.max(mean_k(k_[..., 0], k_[..., 1], m[..., 0], m[..., 1]), initial=0.0))
    assert isinstance(law, CollisionLaw)  # `AnyLaw` has made one of a mapping
    # At or below law.k its construction has already said what is to be said.
    if largest_k > getattr(law, "k", 0.0):
        law.check(largest_k, largest_k)

    inverse = 1.0 / m
    R = np.where(flat, R[..., ::-1], R)
    of_two = law_kernels.reduced_radius(R[..., 0], R[..., 1])
    of_contact = (
        np.where(flat.any(axis=-1), R[..., 0], of_two)
        if reduced_radius is None
        else np.asarray(reduced_radius)
    )
    motion = (
        n[..., 0],
        n[..., 1],
        *(inverse[..., 0], R[..., 0], k_[..., 0], v[..., 0, 0], v[..., 0, 1], w[..., 0]),
        *(inverse[..., 1], R[..., 1], k_[..., 1], v[..., 1, 0], v[..., 1, 1], w[..., 1]),
    )
    found = (
        np.broadcast_to(each, shape[:-1])
        for each in _collided(law, motion, np.asarray(of_contact, dtype=np.float64))
    )
    vx_i, vy_i, w_i, vx_j, vy_j, w_j, P_n, P_t, sticks, rolls = found
    regime = 1 + sticks.astype(np.int8)
    if parts_of(type(law)) is None:
        regime = np.full_like(regime, UNKNOWN)
    elif getattr(law, "rho", 0.0) > 0.0:
        regime = np.where(rolls > 0.0, regime + 2, regime + 4)
    after = np.stack([np.stack([vx_i, vy_i], axis=-1), np.stack([vx_j, vy_j], axis=-1)], axis=-2)
    regime = np.where(P_n > 0.0, regime, 0).astype(np.int8)
    return Collision(after, np.stack([w_i, w_j], axis=-1), np.array(P_n), np.array(P_t), regime)


def _collided(law: CollisionLaw, motion: Sequence[Array], reduced_radius: Array) -> tuple[Array, ...]:
    """Velocities and spins after, P_n, P_t, sticking, rolling; `motion` has the arguments of `relative_motion`."""
    from ...kernels.laws.law import after_impulses, relative_motion  # imports Taichi, which is slow

    g_n, g_t, m_n, m_t = relative_motion(*motion)
    _, _, im_i, R_i, k_i, _, _, w_i, im_j, R_j, k_j, _, _, w_j = motion
    pair = (g_n, g_t, m_n, m_t, im_i, R_i, k_i, w_i, im_j, R_j, k_j, w_j, reduced_radius)
    parts = parts_of(type(law))
    found = impulses(type(law), pair, law.table_row(), parts)
    approaching = 1.0 * (g_n > 0.0)
    P_n, P_t, T = (np.where(g_n > 0.0, each, 0.0) for each in found[:3])
    sticking, rolling = (0.0, 0.0) if parts is None else found[4:]
    after = after_impulses(P_n, P_t, T, *motion)
    return (*after, P_n, P_t, approaching * sticking, approaching * rolling)


def impulses(
    kind: type[CollisionLaw],
    pair: Sequence[Array],
    row: Sequence[ArrayLike],
    function: Callable[..., Any] | None = None,
) -> tuple[Array, ...]:
    """Impulses by `collide` of a class of laws, or by another `function` of it, such as its `parts`, of given numbers.

    `pair` has an array for each of `OF_PAIR`, `row` a number or an array for each coefficient. InputError if a function
    of a custom law cannot be called with numbers, or impulses are not finite.
    """
    names = kind.coefficients
    if isinstance(inspect.getattr_static(kind, "collide"), FromKernels):  # takes arrays
        named = SimpleNamespace(**dict(zip(names, row, strict=not kind.has_table)))
        of_pair = SimpleNamespace(**dict(zip(OF_PAIR, pair, strict=True)))
        table = [np.array(row)] if kind.has_table else []
        found: tuple[Array, ...] = (function or kind.collide)(of_pair, named, *table)
        return found
    plain = inspect.unwrap(function or kind.collide)  # that of Python, also of a function of Taichi

    def one(*numbers: float) -> tuple[float, ...]:
        of_pair = SimpleNamespace(**dict(zip(OF_PAIR, numbers, strict=False)))
        law = SimpleNamespace(**dict(zip(names, numbers[len(OF_PAIR) :], strict=True)))
        return tuple(map(float, plain(of_pair, law)))

    try:
        result = np.vectorize(one, otypes=[float] * (3 if function is None else 6))(*pair, *row)
    except (TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise InputError(
            f"{kind.__name__}.{plain.__name__} cannot be called with numbers: {error}"
        ) from error
    if not all(np.isfinite(each).all() for each in result):
        raise InputError(f"{kind.__name__}.{plain.__name__} gives impulses that are not finite")
    return tuple(result)


def _refuse(name: str, value: Array, invalid: NDArray[np.bool_], needed: str) -> None:
    """Raise for the first value that is wrong, if one is."""
    if np.any(invalid):
        value, invalid = np.broadcast_arrays(value, invalid)
        where = tuple(int(axis) for axis in np.argwhere(invalid)[0])
        raise InputError(f"{name}[{', '.join(map(str, where))}] = {value[where]:g}: {needed}")
