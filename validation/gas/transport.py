r"""Shear viscosity and heat conductivity of elastic smooth disks by their fluctuations, against Enskog's theory.

Units: mass and diameter sigma of a disk, T = 1, k_B = 1. Rows of the pressure tensor and of the heat flux of a gas in
equilibrium, 0.2 collisions per disk apart, give eta and kappa by Green and Kubo, and by Helfand's mean squares
(`analysis.transport_coefficient`). Expected: Enskog's theory in the first Sonine approximation, of which further ones
add 2 % to eta and 3 % to kappa (D. M. Gass, J. Chem. Phys. 54, 1898 (1971), doi:10.1063/1.1675116). It has molecular
chaos: what disks that meet again add is of the order phi, and in a dense gas eta is larger (R. Garcia-Rojo, S. Luding
and J. J. Brey, Phys. Rev. E 74, 061305 (2006), doi:10.1103/PhysRevE.74.061305, who see Enskog's values up to
intermediate densities). Self-diffusion is in `gas_equilibrium`.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from ...analysis import transport_coefficient
from ...model.observables import heat_flux, stress
from ...theory.collisions import collision_rate
from ...theory.hydrodynamics import shear_viscosity, thermal_conductivity
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import compare, fluid, restarted, sampled_run, seeds_of

QUESTION = "Do fluctuations of elastic disks give Enskog's viscosity and heat conductivity?"
REFERENCE = "Enskog's theory; Gass (1971), doi:10.1063/1.1675116"

PHI, QUICK_PHI, N, REPLICAS = (0.05, 0.2, 0.4), 0.2, 128, 16
PER_DISK, APART = 800.0, 0.2
"""Collisions per disk of a gas, and between rows: the kinetic part is then 100 0.2^2 / 12 = 0.3 % too large."""
LAG = 6.0
"""Collisions per disk at which integrals end: stress and heat flux of a dilute gas relax in 1 and 2 of them."""
HIGHER = {"eta": 0.022, "kappa": 0.03}
"""What further Sonine polynomials add."""
SOURCE = "Enskog's theory, first Sonine approximation"


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, axes = style.panels(2)
    at = np.linspace(0.02, 0.5, 100)
    for i, phi in enumerate((QUICK_PHI,) if quick else PHI):
        seeds = seeds_of(seed, REPLICAS, 9000 + 20 * i)
        found = np.array([coefficients(phi, one) for one in seeds])
        for j, (name, expected) in enumerate(enskog(phi).items()):
            for k, way in enumerate(("Green-Kubo", "Helfand")):
                more = HIGHER[name] * expected
                compare(
                    result, f"{name} of elastic disks by {way}, phi = {phi}", found[:, j, k], expected + more, disks=N,
                    seeds=seeds, systematic=(HIGHER[name] + 0.2 * phi) * expected, widest=0.25, source=SOURCE,
                    why=f"{100 * HIGHER[name]:.2g} % of Sonine polynomials, and {20 * phi:.2g} %, phi / 5: disks that meet again",
                )  # fmt: skip
            style.errorbars(axes[j], phi, found[:, j, 0], style.BLUE, "by Green-Kubo" if i == 0 else None)
    for one, name in zip(axes, HIGHER, strict=True):
        one.plot(at, [enskog(float(phi))[name] for phi in at], color=style.BLACK, label="Enskog")
        one.set(xlabel=r"packing fraction $\phi$", ylabel=rf"$\{name}$")
        one.set_ylim(bottom=0.0)
        one.legend(loc="upper left")
    style.titles(*axes)
    caption = (
        "(a) Shear viscosity and (b) heat conductivity of elastic disks in equilibrium by their fluctuations, and by "
        "Enskog's theory."
    )
    result.pictures.append(Picture("gas_transport", caption, figure))
    return result


def enskog(phi: float) -> dict[str, float]:
    """eta and kappa in the first approximation."""
    return {"eta": shear_viscosity(phi, 1.0, 1.0, 0.5), "kappa": thermal_conductivity(phi, 1.0, 1.0, 0.5)}


def coefficients(phi: float, seed: int) -> Array:
    """eta and kappa of a gas, by both formulas, shape (2, 2)."""
    gas = restarted(fluid(N, phi, seed, melting=10.0), record=["heat_flux"])
    T, area = N / (N - 1.0), gas.box.area  # of N disks whose total momentum is 0
    nu = collision_rate(phi, T, 1.0, 0.5)
    _, rows = sampled_run(gas, round(PER_DISK / APART), t_end=PER_DISK / nu)
    pairs = [*itertools.pairwise(rows)]
    tensor = np.array([stress(*pair, area).total for pair in pairs])
    of_stress = np.stack(
        (0.5 * (tensor[:, 0, 1] + tensor[:, 1, 0]), 0.5 * (tensor[:, 0, 0] - tensor[:, 1, 1])), axis=1
    )
    fluxes: Any = (of_stress, area / T), ([heat_flux(*pair, area).total for pair in pairs], area / T**2)
    time, found = [row.time for row in rows], []
    for flux, factor in fluxes:
        one = transport_coefficient(time, flux, factor=factor, lag=LAG / nu)
        found.append((one.green_kubo.mean / T**0.5, one.helfand.mean / T**0.5))
    return np.array(found)
