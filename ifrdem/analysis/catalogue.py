"""The analyses of trajectory files by name."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..trajectory.reader import Trajectory
from . import over_time, per_frame
from .result import Evaluation, Reading


@dataclass(frozen=True)
class Analysis:
    """An analysis: its title, and what does it, given a file and the frames chosen (None: those that suit it)."""

    title: str
    of: Callable[[Trajectory, Sequence[int] | None], Evaluation]


ANALYSES = {
    "velocity": Analysis("velocities and spins: Sonine coefficients", per_frame.of_velocity),
    "g": Analysis("pair correlation g(r)", per_frame.of_pairs),
    "S": Analysis("structure factor S(k)", per_frame.of_structure),
    "msd": Analysis("mean-square displacement", over_time.of_msd),
    "vacf": Analysis("velocity autocorrelation", over_time.of_vacf),
    "fields": Analysis("coarse-grained fields", per_frame.of_fields),
    "clusters": Analysis("clusters", per_frame.of_clusters),
    "psi6": Analysis("hexatic order psi_6", per_frame.of_psi6),
    "pressure": Analysis("pressure", over_time.of_pressure),
    "cooling": Analysis("Haff's law and the ratio of temperatures", over_time.of_cooling),
    "impact": Analysis("angles of impact and regimes", over_time.of_impact),
}
"""Name -> analysis."""


def report(name: str, title: str, outcome: Evaluation, span: str) -> str:
    """The table of an analysis, as text for people; `span`: of which frames and times."""
    lines = [f"{name}: {title}, {span}", *(f"  ! {doubt}" for doubt in outcome.doubts)]
    width = max((len(row.name) for row in outcome.rows), default=0)
    lines += [f"  {row.name:<{width}}  {number(row)}" for row in outcome.rows]
    lines += [f"  ({note})" for note in outcome.notes]
    return "\n".join(lines)


def number(row: Reading) -> str:
    """A value with its error to two digits and its unit."""
    unit = f" {row.unit}" if row.unit else ""
    if isinstance(row.value, numbers.Integral):
        return f"{row.value}{unit}"
    if not math.isfinite(row.value):
        return "none"
    if not math.isfinite(row.error) or row.error <= 0.0:
        return f"{row.value:.5g}{unit}"
    digits = 1 - math.floor(math.log10(row.error))
    if digits <= 6 and abs(row.value) < 1e5:
        return f"{row.value:.{max(digits, 0)}f} +- {row.error:.{max(digits, 0)}f}{unit}"
    more = max(1, math.floor(math.log10(max(abs(row.value), row.error) / row.error)) + 1)
    return f"{row.value:.{more}e} +- {row.error:.1e}{unit}"


def plain(value: float) -> float | None:
    """A number as JSON has it: counts and seeds are whole, and there is no nan."""
    if isinstance(value, numbers.Integral):
        return int(value)
    return float(value) if math.isfinite(value) else None
