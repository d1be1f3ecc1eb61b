"""Analyses of granular gases: functions of NumPy arrays from any source, returning arrays with errors.

Lengths, times and masses are in whatever units the arrays are in, temperatures are energies (k_B = 1). g(r), clusters
and psi_6 need the package freud, S(k) finufft: `pip install '.[analysis]'`.
"""

from __future__ import annotations

from .averages import BinAverages, Local, mean_fields, profiles
from .common import correlation_time, mean_with_error
from .cooling import HaffFit, RatioFit, haff_fit, ratio_fit
from .displacement import (
    Correlation,
    Diffusion,
    diffusion_coefficient,
    mean_square_displacement,
    unwrap,
    velocity_autocorrelation,
)
from .fields import Fields, coarse_grain
from .flow import VelocityCorrelation, VelocitySpectrum, velocity_correlation, velocity_spectrum
from .impact import Impacts, impacts
from .pressure import Pressure, compressibility, contact_from_rate, pressure_from_impulses
from .stress import MeanStress, mean_stress
from .structure import (
    Clusters,
    ContactValue,
    Hexatic,
    PairCorrelation,
    StructureFactor,
    clusters,
    contact_value,
    hexatic,
    pair_correlation,
    structure_factor,
)
from .velocities import (
    SonineCoefficients,
    VelocityDistribution,
    gaussian,
    sonine_density,
    velocity_distribution,
)

__all__ = [
    "BinAverages", "Clusters", "ContactValue", "Correlation", "Diffusion", "Fields", "HaffFit", "Hexatic", "Impacts",
    "Local", "MeanStress", "PairCorrelation", "Pressure", "RatioFit", "SonineCoefficients", "StructureFactor",
    "VelocityCorrelation", "VelocityDistribution", "VelocitySpectrum", "clusters", "coarse_grain", "compressibility",
    "contact_from_rate", "contact_value", "correlation_time", "diffusion_coefficient", "gaussian", "haff_fit",
    "hexatic", "impacts", "mean_fields", "mean_square_displacement", "mean_stress", "mean_with_error",
    "pair_correlation", "pressure_from_impulses", "profiles", "ratio_fit", "sonine_density", "structure_factor",
    "unwrap", "velocity_autocorrelation", "velocity_correlation", "velocity_distribution", "velocity_spectrum",
]  # fmt: skip
