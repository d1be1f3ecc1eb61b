"""The analyses of trajectory files by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..trajectory.reader import Trajectory
from . import file_changes, file_frames
from .outcome import Outcome


@dataclass(frozen=True)
class Analysis:
    """An analysis: its title, and what does it, given a file and the frames chosen (None: those that suit it)."""

    title: str
    of: Callable[[Trajectory, Sequence[int] | None], Outcome]


ANALYSES = {
    "velocity": Analysis("velocities and spins: Sonine coefficients", file_frames.of_velocity),
    "g": Analysis("pair correlation g(r)", file_frames.of_pairs),
    "S": Analysis("structure factor S(k)", file_frames.of_structure),
    "msd": Analysis("mean-square displacement", file_changes.of_msd),
    "vacf": Analysis("velocity autocorrelation", file_changes.of_vacf),
    "fields": Analysis("coarse-grained fields", file_frames.of_fields),
    "clusters": Analysis("clusters", file_frames.of_clusters),
    "psi6": Analysis("hexatic order psi_6", file_frames.of_psi6),
    "pressure": Analysis("pressure", file_changes.of_pressure),
    "cooling": Analysis("Haff's law and the ratio of temperatures", file_changes.of_cooling),
    "impact": Analysis("angles of impact and regimes", file_changes.of_impact),
}
"""Name -> analysis."""
