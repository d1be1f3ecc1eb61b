"""Kinetic theory of homogeneous gases of rough disks.

`contact`: contact values, equations of state. `collisions`: collision rates, and what a collision by the IFR law
changes on average. `cooling_gas`: equal disks that cool, Haff's law. `mixtures`: any number of species. `driven_gas`,
`sheared_gas`: steady states of heated and sheared gases. `sonine`, `rough_gas`: departures from Gaussian velocities
of smooth disks, and of rough ones with constant coefficients.
`hydrodynamics`: shear waves, and for how long a cooling gas stays homogeneous. `choose`: the theory that belongs to a
gas. Which laws can add energy: `IFRLaw.admissibility`.
"""

from __future__ import annotations

from .choose import Prediction, constant_beta, prediction
from .collisions import collision_rate, mean_free_path, mixture_collision_rates
from .contact import VIRIAL, compressibility, contact_value, mixture_contact_values
from .cooling_gas import (
    CoolingRatio,
    changes_per_collision,
    checked_times,
    cooling,
    cooling_rates,
    cooling_ratio,
    cooling_ratios,
    haff,
    haff_time,
    rough_rates,
)
from .driven_gas import Driving
from .hydrodynamics import (
    ShearModes,
    clustering_length,
    self_diffusion,
    shear_length,
    shear_mode_energy,
    shear_mode_time,
    shear_viscosity,
    thermal_conductivity,
)
from .mixtures import (
    Mixture,
    MixtureTemperatures,
    mixture_cooling,
    mixture_cooling_rates,
    mixture_cooling_ratios,
    mixture_driven,
)
from .rough_gas import RoughCooling, RoughSonine, rough_cooling, rough_sonine
from .sheared_gas import SteadyFlow, steady_flow
from .sonine import collision_factor, cooling_factor, cooling_sonine, heated_sonine, sonine_coefficient

__all__ = [
    "VIRIAL", "CoolingRatio", "Driving", "Mixture", "MixtureTemperatures", "Prediction", "RoughCooling", "RoughSonine", "ShearModes", "SteadyFlow", "changes_per_collision",
    "checked_times", "clustering_length", "collision_factor", "collision_rate", "compressibility", "constant_beta", "contact_value",
    "cooling", "cooling_factor", "cooling_rates", "cooling_ratio", "cooling_ratios", "cooling_sonine", "haff",
    "haff_time", "heated_sonine", "mean_free_path", "mixture_collision_rates", "mixture_contact_values",
    "mixture_cooling", "mixture_cooling_rates", "mixture_cooling_ratios", "mixture_driven", "prediction", "rough_cooling", "rough_rates", "rough_sonine",
    "self_diffusion", "shear_length", "shear_mode_energy", "shear_mode_time", "shear_viscosity", "sonine_coefficient",
    "steady_flow", "thermal_conductivity",
]  # fmt: skip
