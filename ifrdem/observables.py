"""Temperatures, energies, momentum and stress of a state of disks."""

from .model.observables import Measure, Stress, drift_text, from_totals, measure, stress, sums

__all__ = ["Measure", "Stress", "drift_text", "from_totals", "measure", "stress", "sums"]
