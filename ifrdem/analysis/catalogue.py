"""The analyses of trajectory files by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..trajectory.reader import Trajectory
from . import over_time, per_frame
from .result import Outcome


@dataclass(frozen=True)
class Analysis:
    """An analysis: its title, and what does it, given a file and the frames chosen (None: those that suit it)."""

    title: str
    of: Callable[[Trajectory, Sequence[int] | None], Outcome]


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
