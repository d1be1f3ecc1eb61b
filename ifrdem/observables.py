"""Temperatures, energies, momentum, stress and heat flux of a state of disks; histograms of their collisions."""

from .model.histograms import Histogram, histogram, histogram_edges
from .model.observables import (
    HeatFlux,
    Measure,
    Stress,
    drift_text,
    from_totals,
    heat_flux,
    measure,
    stress,
    sums,
)

__all__ = [
    "HeatFlux",
    "Histogram",
    "Measure",
    "Stress",
    "drift_text",
    "from_totals",
    "heat_flux",
    "histogram",
    "histogram_edges",
    "measure",
    "stress",
    "sums",
]
