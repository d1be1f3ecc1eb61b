"""Temperatures, energies, momentum and stress of a state of disks; histograms of their collisions."""

from .model.histograms import Histogram, histogram, histogram_edges
from .model.observables import Measure, Stress, drift_text, from_totals, measure, stress, sums

__all__ = [
    "Histogram",
    "Measure",
    "Stress",
    "drift_text",
    "from_totals",
    "histogram",
    "histogram_edges",
    "measure",
    "stress",
    "sums",
]
