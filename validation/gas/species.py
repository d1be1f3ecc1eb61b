r"""Cooling mixtures, and self-diffusion of a cooling gas in its own time.

Smooth disks that differ in mass have different temperatures. Once the ratios are constant, all temperatures fall at the
same rate: V. Garzo and J. Dufty, Phys. Rev. E 60, 5706 (1999), doi:10.1103/PhysRevE.60.5706. With Maxwellian
velocities the rate of species i is, up to a common factor,

    zeta_i = sum_j x_j g_ij s_ij mu_ji (1 + e) [(th_i + th_j) / (th_i th_j)]^(1/2)
             {1 - mu_ji (1 + e) (th_i + th_j) / (2 th_j)},  th_i = m_i / T_i, mu_ji = m_j / (m_i + m_j).

The velocity autocorrelation of a cooling gas decays at a constant rate per collision. By Enskog's theory that of
c = v / <v^2>^(1/2) of equal smooth disks is proportional to exp(-((1 + e) / 2)^2 tau), and D m nu / T = 4 / (1 + e)^2,
which would be 1 without correlation of velocities: J. J. Brey et al., Phys. Fluids 12, 876 (2000),
doi:10.1063/1.870342.

Gases are small and cool for a few collisions only, so that no streams form.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from ... import analysis
from ...analysis.motion import thermal_path
from ...initial import placement
from ...model.box import Box
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks, State
from ...simulation.simulation import Simulation
from ...theory.contact import mixture_contact_values
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import compare, fluid, sampled_run, seeds_of

QUESTION = "Do cooling mixtures have the temperature ratios of theory, and cooling gases its self-diffusion?"
REFERENCE = "Garzo and Dufty, doi:10.1103/PhysRevE.60.5706; Brey et al., doi:10.1063/1.870342"

MASS, RADIUS, FRACTION = np.array([1.0, 8.0]), np.array([0.5, 0.5]), np.array([0.5, 0.5])
PHI, N = 0.05, 200
SETTLED, END, FRAMES = 10.0, 20.0, 40
"""Collisions per disk from which temperature ratios are averaged, at which runs end, and frames of a run."""
E_N, QUICK_E_N = (0.7, 0.8, 0.9), (0.8,)
LAGS = 6.0
"""Collisions per disk up to which displacements grow with a slope that theory knows, from half of it on."""


def equal_rates(e_n: float, mass: Array = MASS, phi: float = PHI) -> float:
    """T_2 / T_1 at which both species cool at the same rate."""
    g = mixture_contact_values(phi, RADIUS, FRACTION)

    def difference(ratio: float) -> float:
        th, zeta = mass / np.array([1.0, ratio]), np.zeros(2)
        for i in (0, 1):
            for j in (0, 1):
                mu, both = mass[j] / mass.sum() if i != j else 0.5, th[i] + th[j]
                often = FRACTION[j] * g[i, j] * (RADIUS[i] + RADIUS[j]) * np.sqrt(both / (th[i] * th[j]))
                zeta[i] += often * mu * (1.0 + e_n) * (1.0 - 0.5 * mu * (1.0 + e_n) * both / th[j])
        return float(zeta[0] - zeta[1])

    return float(brentq(difference, 1e-2, 1e2))


def temperature_ratio(e_n: float, seed: int) -> float:
    """T_2 / T_1 of a gas in the steady ratio of temperatures, from the sums of the engine over each species."""
    number = (N * FRACTION).astype(int)
    species = {"light": int(number[0]), "heavy": int(number[1])}
    disks = Disks(N, np.repeat(MASS, number), np.repeat(RADIUS, number), species=species)
    box = Box.from_packing_fraction(disks.radius, PHI)
    state = State(
        placement.random_positions(box, disks.radius, seed=seed),
        placement.maxwellian(disks.mass, temperature=1.0, seed=seed), np.zeros(N),
    )  # fmt: skip
    gas = Simulation(disks, box, IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), state)
    ratios = []
    for tau in np.arange(SETTLED, END, 0.5):
        gas.run(collisions_per_disk=float(tau))
        T = gas.measure().species_temperature
        assert T is not None
        ratios.append(np.log(T[1] / T[0]))
    return float(np.exp(np.mean(ratios)))


def own_time(e_n: float, seed: int) -> tuple[Array, Array, float]:
    """Lags tau, <c(0) . c(tau)>, and D m nu / T of a cooling gas of equal disks."""
    gas = fluid(800, PHI, seed, IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), melting=2.0)
    states, _ = sampled_run(gas, FRAMES, collisions_per_disk=0.5 * END)
    tau = np.linspace(0.0, 0.5 * END, FRAMES + 1)
    v, when = np.array([one.velocity for one in states]), np.array([one.time for one in states])
    speed = np.sqrt(0.5 * np.mean(np.sum(v**2, axis=2), axis=1))
    vacf = analysis.velocity_autocorrelation(tau, v / (np.sqrt(2.0) * speed[:, None, None]))
    paths = np.array([gas.box.unwrap(one.position, one.image, one.time) for one in states])
    msd = analysis.mean_square_displacement(tau, paths)
    D = analysis.diffusion_coefficient(msd, first=0.5 * LAGS, last=LAGS).D
    return tau, vacf.value, D / thermal_path(when, tau, speed) ** 2


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, axes = style.panels(3, width=2.9)
    values = QUICK_E_N if quick else E_N
    fine = np.linspace(0.6, 0.99, 40)
    axes[0].plot(fine, [equal_rates(e) for e in fine], color=style.BLACK, label="theory")
    axes[2].plot(fine, 4.0 / (1.0 + fine) ** 2, color=style.BLACK, label="theory")
    for i, e_n in enumerate(values):
        seeds = seeds_of(seed, 24 if quick else 48, 7000 + 100 * i)
        ratios = np.array([temperature_ratio(e_n, one) for one in seeds])
        compare(
            result, f"T_2 / T_1 of a cooling mixture, m_2 / m_1 = 8, e_n = {e_n}", ratios, equal_rates(e_n), disks=N,
            seeds=seeds, systematic=0.03 * equal_rates(e_n), widest=0.12, source="equal cooling rates, Garzo and Dufty",
            why="3 %: velocities that are not quite Maxwellian, streams and finite density",
        )  # fmt: skip
        style.errorbars(axes[0], e_n, ratios, style.BLUE, "simulated" if i == 0 else None)
        seeds = seeds_of(seed, 8 if quick else 16, 7050 + 100 * i)
        found = [own_time(e_n, one) for one in seeds]
        tau, decay = found[0][0], ((1.0 + e_n) / 2.0) ** 2
        one = int(np.searchsorted(tau, 1.0))
        compare(
            result, f"<c(0) . c(1)> a collision later, cooling, e_n = {e_n}", [each[1][one] for each in found],
            float(np.exp(-decay * tau[one])), disks=800, seeds=seeds, systematic=0.02, widest=0.12,
            source="Enskog's theory, first Sonine approximation",
            why="0.02: the decay is exponential in the first Sonine approximation only",
        )  # fmt: skip
        D = [each[2] for each in found]
        compare(
            result, f"D m nu / T of a cooling gas, e_n = {e_n}", D, 1.0 / decay, disks=800, seeds=seeds,
            systematic=0.05 / decay, widest=0.2, source="Brey et al. 2000, in two dimensions",
            why="5 %: first Sonine approximation, and lags at which velocities are not quite forgotten",
        )  # fmt: skip
        style.errorbars(axes[2], e_n, D, style.BLUE, "simulated" if i == 0 else None)
    mean = np.mean([each[1] for each in found], axis=0)
    axes[1].plot(tau, mean, "o", ms=3, color=style.BLUE, mfc="none", label="simulated")
    axes[1].plot(tau, np.exp(-decay * tau), color=style.BLACK, label="theory")
    axes[0].set(xlabel=r"$e_n$", ylabel="$T_2 / T_1$")
    axes[1].set(
        xlabel=r"$\tau$", ylabel=r"$\langle c(0) \cdot c(\tau) \rangle$", title=f"$e_n$ = {values[-1]}"
    )
    axes[2].set(xlabel=r"$e_n$", ylabel=r"$D m \nu / T$")
    axes[0].legend(fontsize=7)
    caption = (
        "Cooling smooth disks: temperature ratio of a mixture of two masses, decay of the velocity autocorrelation per "
        "collision, and self-diffusion in the gas's own time, with kinetic theory."
    )
    result.pictures.append(Picture("gas_species", caption, figure))
    return result
