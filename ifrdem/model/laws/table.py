"""Laws whose impulses are tabulated: of measured impacts, or of those that another program computed."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError, option_name, outside_level
from ...kernels.columns import POINTS
from ...tools import checked, tables
from ...tools.checked import Array, Numbers, validated
from ..custom_code import FromKernels
from .ifr import ROUND_OFF, IFRLaw, mean_k
from .law import Admissibility, CollisionLaw, EnergyWarning, Key

MOST_POINTS = POINTS - 1
"""Of a table; one that is not used is behind them."""
BEYOND = 1e30
"""Slip ratio or speed of the unused points of a table, beyond all that occur."""
COLUMNS: Mapping[str, str] = {
    "psi": "angle", "slip": "number", "ratio": "number", "g_n": "velocity", "e_n": "number",
}  # fmt: skip
"""Columns of the file of a table, and the kinds of their units (`tools/tables.py`)."""


_Restitution = Annotated[ArrayLike, Numbers(None)]


class _Excess(NamedTuple):
    """A point of the table next to which a collision gains energy, and the inequality that is broken there."""

    point: int
    slip: float
    left: float
    right: float


class TableLaw(CollisionLaw):
    """A law by a table: P_t / P_n against the slip |g_t| / g_n, and a restitution e_n, constant or against g_n.

    P_n = (1 + e_n) m_n g_n and P_t = sign(g_t) P_n r, in the symbols of `CollisionLaw.collide`, where the ratio r is
    that of the table. Between two points r is linear in |g_t| / g_n, so that it lies between its values there; it
    begins at 0, and beyond the last point it stays what it is there. So does e_n against g_n, from its first value.
    InputError with the number of the point if the points are out of order or range, or an impact next to one could
    gain energy.

    Parameters
    ----------
    slip : array (p,)
        |g_t| / g_n, ascending from 0 or more; up to 127 points.
    ratio : array (p,)
        P_t / P_n at these; 0 at a slip of 0, which need not be given.
    e_n : float or array (s,)
        Normal restitution, 0 to 1: a constant, or that at each of the speeds `g_n`.
    g_n : array (s,), optional
        Speeds of approach [length/time], ascending from 0 or more, up to 127 points.
    k : float
        Shape number of the disks for which the law is examined, as of `IFRLaw`.

    Notes
    -----
    Contacts without a scale of speed, such as Hertz's with Mindlin's friction, have one curve r of all speeds; it
    belongs to the ratio of effective masses m_n / m_t = 1 + kbar of the disks, and so to their k.

    No collision adds energy if and only if at every slip x = |g_t| / g_n

        (1 + e_n) (1 + a r^2) <= 2 (1 + x r),   a = m_n / m_t = 1 + kbar,   kbar = (k_i m_j + k_j m_i) / (m_i + m_j).

    Derivation: with q = (1 + e_n) r the change of energy is m_n g_n^2 / 2 times -(1 - e_n^2) + a q^2 - 2 q x, and
    1 - e_n^2 = (1 + e_n) (1 - e_n). The largest e_n decides. Between two points both sides are quadratic in x, and
    their difference is smallest at a point or where its derivative vanishes. The tangential impulse alone adds none
    if (1 + e_n) a r <= 2 x: else there is an EnergyWarning. In the ledger an impact below the transition, the slip
    from which on r stays what it is at the last point, loses by tangential restitution, one beyond by friction.

    Examples
    --------
    Walton's law with e_n = 0.9, beta_0 = 0.4 and mu = 0.2 of homogeneous disks, m_n / m_t = 3, slides from
    |g_t| / g_n = 3 mu (1 + e_n) / (1 + beta_0) on:

    >>> from ifrdem import laws
    >>> law = laws.TableLaw(slip=[3.0 * 0.2 * 1.9 / 1.4], ratio=[0.2], e_n=0.9)
    >>> law.mu, round(law.transition, 4)
    (0.2, 0.8143)
    """

    coefficients: ClassVar[tuple[str, ...]] = ("mu", "transition")
    name_in_cases: ClassVar[str] = "table"
    takes_k: ClassVar[bool] = True
    is_passive: ClassVar[bool] = True
    has_table: ClassVar[bool] = True
    collide = FromKernels("laws.table", "table")
    parts = FromKernels("laws.table", "table_parts")

    @validated
    def __init__(
        self, *, slip: checked.Column, ratio: checked.Column, e_n: _Restitution, g_n: checked.Column | None = None,
        k: checked.Ratio = 2.0,
    ) -> None:  # fmt: skip
        x, r = (np.atleast_1d(np.asarray(each, dtype=np.float64)) for each in (slip, ratio))
        speeds = np.zeros(0) if g_n is None else np.atleast_1d(np.asarray(g_n, dtype=np.float64))
        e = np.atleast_1d(np.asarray(e_n, dtype=np.float64))
        _check_points("slip", x, "ratio", r)
        _check_points("g_n", speeds, "e_n", e, constant=g_n is None)
        for i in np.flatnonzero(~((e >= 0.0) & (e <= 1.0)))[:1]:
            raise PointRefused("e_n", int(i), f"e_n = {e[i]:g}: must be a number from 0 to 1")
        if x[0] == 0.0 and r[0] != 0.0:
            raise PointRefused(
                "ratio", 0, f"ratio = {r[0]:g} at slip = 0: must be 0, the slip has no direction there"
            )
        if r[-1] < 0.0:
            raise PointRefused("ratio", len(r) - 1, f"ratio = {r[-1]:g}: must be 0 or more at the last point")
        self._slip, self._ratio, self._g_n, self._e_n, self._k = x, r, speeds, e, k
        for each in (x, r, speeds, e):
            each.setflags(write=False)
        begins = 0 if x[0] == 0.0 else 1
        self._x, self._r = (np.concatenate((np.zeros(begins), each)) for each in (x, r))
        limit = len(r) - int(np.argmax(np.r_[self._r[::-1] != r[-1], True])) + begins
        transition = float(self._x[min(limit, len(self._x) - 1)])
        if len(speeds) and speeds[0] == 0.0:
            of_speed = _lines(speeds, e)
        else:
            of_speed = _lines(np.r_[0.0, speeds], np.r_[e[:1], e[: len(speeds)]])
        self._row = (float(r[-1]), transition, *_lines(self._x, self._r), *of_speed)
        self.check(k, k)

    @classmethod
    @validated
    def read(
        cls,
        file: str | os.PathLike[str],
        *,
        e_n: checked.NormalRestitution | None = None,
        k: checked.Ratio = 2.0,
    ) -> TableLaw:
        """The law of a CSV file.

        Its first line names the columns: `slip`, |g_t| / g_n, or `psi`, the angle of incidence whose tangent that is
        [degrees, or another unit in brackets]; `ratio`, P_t / P_n; and, if e_n is not given, `e_n` and `g_n`, its
        speeds, which may have fewer values. InputError with the line if a value is wrong, or an impact could gain
        energy there.

        Examples
        --------
        >>> from pathlib import Path
        >>> from ifrdem import laws
        >>> _ = Path("law.csv").write_text("psi,ratio\\n10,0.06\\n20,0.12\\n40,0.2\\n")
        >>> laws.TableLaw.read("law.csv", e_n=0.9).slip.round(3)
        array([0.176, 0.364, 0.839])
        """
        names = {tables.plain(name): name for name in COLUMNS}
        found = tables.read(Path(file), COLUMNS, names, setting=tables.no_setting)
        source, columns = str(file), found.columns
        x = "psi" if "psi" in columns else "slip"
        problems = []
        if {"psi", "slip"} <= {*columns}:
            problems.append("columns psi and slip: must be one of both, slip is the tangent of psi")
        if x not in columns or "ratio" not in columns:
            there = ", ".join([*columns, *found.unused])
            problems.append(f"columns {there}: must have slip or psi, and ratio")
        of_speed = {"g_n", "e_n"} & {*columns}
        if e_n is None and len(of_speed) < 2:
            given = option_name("e_n = 0.9", "e_n=0.9")
            problems.append(f"e_n: missing: must be given ({given}), or the columns g_n and e_n of the file")
        if e_n is not None and of_speed:
            problems.append(
                f"e_n = {e_n:g}: is given, and the file has a column {sorted(of_speed)[0]}: one of both"
            )
        pairs = [(x, "ratio"), *([("g_n", "e_n")] if e_n is None else [])]
        lines: dict[str, NDArray[np.intp]] = {}
        values: dict[str, Array] = {}
        for one, other in pairs if not problems else ():
            a, b = columns[one], columns[other]
            there_a, there_b = ~np.isnan(a), ~np.isnan(b)
            problems += [
                f"line {line}: must have both {one} and {other}, or neither"
                for line in found.line[there_a != there_b][:5]
            ]
            both = there_a & there_b
            values |= {one: a[both], other: b[both]}
            lines |= {one: found.line[both], other: found.line[both]}
        for line, psi in zip(lines.get("psi", ()), values.get("psi", ()), strict=True):
            if not 0.0 <= psi < 90.0:
                problems.append(
                    f"line {line:.0f}: psi = {psi:g}: must be an angle from 0 to below 90 degrees"
                )
        if problems:
            raise InputError("\n".join(f"{source}: {each}" for each in problems))
        slip = np.tan(np.radians(values["psi"])) if x == "psi" else values["slip"]
        lines.setdefault("slip", lines[x])
        try:
            return cls(
                slip=slip,
                ratio=values["ratio"],
                e_n=values["e_n"] if e_n is None else e_n,
                g_n=values.get("g_n"),
                k=k,
            )
        except PointRefused as error:
            at = lines.get(error.column)
            where = f"line {at[error.point]:.0f}: " if at is not None and len(at) else ""
            of_psi = ", slip being tan psi" if x == "psi" and error.column == "slip" else ""
            raise InputError(f"{source}: {where}{error.text}{of_psi}") from None

    @property
    def slip(self) -> Array:
        """Slip ratios |g_t| / g_n of the points, (p,)."""
        return self._slip

    @property
    def ratio(self) -> Array:
        """P_t / P_n at the points, (p,)."""
        return self._ratio

    @property
    def g_n(self) -> Array | None:
        """Speeds of approach [length/time] of the points of e_n, (s,); None of a constant."""
        return self._g_n if len(self._g_n) else None

    @property
    def e_n(self) -> float | Array:
        """The constant normal restitution, or that at the speeds g_n, (s,)."""
        return self._e_n if len(self._g_n) else float(self._e_n[0])

    @property
    def k(self) -> float:
        """Shape number of the disks for which the law was examined."""
        return self._k

    def __repr__(self) -> str:
        """The law and how many points it has."""
        e_n = f"{len(self._e_n)} points of g_n" if len(self._g_n) else f"{self._e_n[0]:g}"
        return f"TableLaw({len(self._slip)} points of slip, mu={self.mu:g}, e_n={e_n})"

    @property
    def is_dissipative(self) -> bool:
        """True if e_n is below 1 at every speed."""
        return bool(self._e_n.max() < 1.0)

    def admissibility(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> Admissibility:
        """Verdict on collisions of disks with these k and masses, as of `IFRLaw`."""
        a = 1.0 + float(mean_k(k_i, k_j, m_i, m_j))
        largest = float(self._e_n.max())
        about = f"{self}, for disks whose mean k (kbar) is {a - 1.0:g}"
        found = self._total(a, largest)
        if found is not None:
            return Admissibility(False, False, f"{about}: {_said(found, largest, a)}")
        # Linear in the slip, so that points decide; at 0 both sides are 0.
        alone = (1.0 + largest) * a * self._r - 2.0 * self._x
        if np.all(alone <= ROUND_OFF) and np.all(self._r >= 0.0):
            return Admissibility(
                True, True, f"{about}: no collision adds energy, nor do its tangential impulses alone"
            )
        below = int(np.argmin(self._r))
        if self._r[below] < 0.0:
            return Admissibility(
                True, False,
                f"{about}: P_t / P_n = {self._r[below]:.4g} at slip = {self._x[below]:.4g} is below 0, and speeds the slip "
                f"up: the tangential impulses alone add energy; only the loss along the line of centres, e_n = {largest:g}, "
                "outweighs it",
            )  # fmt: skip
        i = int(np.argmax(alone))
        return Admissibility(
            True, False,
            f"{about}: the tangential impulses alone add energy: (1 + e_n) a P_t / P_n <= 2 slip is exceeded by "
            f"{alone[i]:.4g} at slip = {self._x[i]:.4g}; only the loss along the line of centres, e_n = {largest:g}, "
            "outweighs it",
        )  # fmt: skip

    def check(self, k_i: float, k_j: float, m_i: float = 1.0, m_j: float = 1.0) -> None:
        """Refuse the law, or warn, for collisions of disks with these k and masses; see `admissibility`."""
        a, largest = 1.0 + float(mean_k(k_i, k_j, m_i, m_j)), float(self._e_n.max())
        if (found := self._total(a, largest)) is not None:
            raise PointRefused("ratio", found.point, _said(found, largest, a))
        verdict = self.admissibility(k_i, k_j, m_i, m_j)
        if not verdict.strict:
            warnings.warn(verdict.message, EnergyWarning, stacklevel=outside_level())

    def _total(self, a: float, e_n: float) -> _Excess | None:
        """The worst place at which a collision gains energy, if there is one."""
        worst: _Excess | None = None
        begins = len(self._x) - len(self._slip)
        ends = np.r_[self._x[1:], self._x[-1]]
        for i, (low, high) in enumerate(zip(self._x, ends, strict=True)):
            slope = 0.0 if low == high else (self._r[i + 1] - self._r[i]) / (high - low)
            value = self._r[i] - slope * low
            # Right less left of the inequality is c_2 x^2 + c_1 x + c_0.
            c_2 = 2.0 * slope - (1.0 + e_n) * a * slope**2
            c_1 = 2.0 * value - 2.0 * (1.0 + e_n) * a * value * slope
            vertex = -0.5 * c_1 / c_2 if c_2 > 0.0 else low
            for x in {low, high, min(max(vertex, low), high)}:
                r = value + slope * x
                left, right = (1.0 + e_n) * (1.0 + a * r * r), 2.0 * (1.0 + x * r)
                if left - right > ROUND_OFF * right and (
                    worst is None or left - right > worst.left - worst.right
                ):
                    nearest = min(max(i + (x > 0.5 * (low + high)) - begins, 0), len(self._slip) - 1)
                    worst = _Excess(int(nearest), float(x), float(left), float(right))
        return worst


KEYS: Mapping[str, Key] = {
    "file": Key(
        str,
        "CSV file with the columns psi [deg] or slip, |g_t| / g_n, and ratio, P_t / P_n [path]",
        "law.csv",
    ),
    "e_n": IFRLaw.keys["e_n"],
}
"""Keys of the law in cases; without e_n the file has columns g_n and e_n."""


class PointRefused(InputError):
    """A point of a table is wrong: `point` of a `column`, and a text for it."""

    def __init__(self, column: str, point: int, text: str) -> None:
        super().__init__(f"{column}[{point}]: {text}")
        self.column, self.point, self.text = column, point, text


def _check_points(x: str, at: Array, y: str, values: Array, *, constant: bool = False) -> None:
    """Refuse points that are not finite, not ascending from 0 or more, too many, or of another number than values."""
    if constant:
        if values.shape != (1,):
            raise InputError(
                f"{y}: has {values.size} values: must be one, or as many as {x}, which is not given"
            )
        return
    if at.shape != values.shape or at.ndim != 1 or not len(at):
        raise InputError(
            f"{x}, {y} have shapes {at.shape} and {values.shape}: must be one or more points of both"
        )
    if len(at) > MOST_POINTS:
        raise PointRefused(x, MOST_POINTS, f"{x} has {len(at)} points: must be {MOST_POINTS} at most")
    for name, each in ((x, at), (y, values)):
        for i in np.flatnonzero(~np.isfinite(each))[:1]:
            raise PointRefused(name, int(i), f"{name} = {each[i]:g}: must be a finite number")
    wrong = np.flatnonzero(np.diff(at, prepend=-math.inf) <= 0.0)
    if at[0] < 0.0 or at[-1] >= BEYOND:
        i = 0 if at[0] < 0.0 else len(at) - 1
        raise PointRefused(x, i, f"{x} = {at[i]:g}: must be from 0 to below {BEYOND:g}")
    if len(wrong):
        i = int(wrong[0])
        raise PointRefused(x, i, f"{x} = {at[i]:g} after {at[i - 1]:g}: must ascend from point to point")


def _said(found: _Excess, e_n: float, a: float) -> str:
    return (
        f"a collision would add energy at slip = {found.slip:.4g}: (1 + e_n) (1 + a r^2) <= 2 (1 + slip r), r = P_t / P_n, "
        f"must hold, but left is {found.left:.4g} and right {found.right:.4g} (e_n = {e_n:g}, a = 1 + kbar = {a:g})"
    )


def _lines(at: Array, values: Array) -> Sequence[float]:
    """Points, and of the lines that begin there the values at 0 and the slopes, each as many as kernels have."""
    slopes = np.r_[np.diff(values) / np.diff(at), 0.0]
    columns = (at, BEYOND), (values - slopes * at, values[-1]), (slopes, 0.0)
    more = POINTS - len(at)
    return [float(each) for column, rest in columns for each in np.r_[column, np.full(more, rest)]]
