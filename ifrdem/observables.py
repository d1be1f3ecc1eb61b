"""Temperatures, energies and momentum of a state of disks."""

from .model.observables import Measure, drift_text, from_totals, measure, sums

__all__ = ["Measure", "drift_text", "from_totals", "measure", "sums"]
