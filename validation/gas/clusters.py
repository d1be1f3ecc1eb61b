r"""A million smooth disks that cool until they form clusters.

*Before clusters.* Transverse waves grow relative to thermal velocities (`hydrodynamics`): with the energy S of a mode
in units of its thermal share, S = 1 at the start and x = k^2 xi^2,

    S = 1 + [exp(z tau (1 - x)) - 1] / (1 - x);

T. P. C. van Noije, M. H. Ernst, R. Brito and J. A. G. Orza, Phys. Rev. Lett. 79, 411 (1997),
doi:10.1103/PhysRevLett.79.411. Energies of modes are distributed like exp(-S / <S>): the mean of M has the error
<S> / sqrt(M). All of them together make T fall more slowly than Haff's law (J. Fluid Mech. 134, 401 (1983)); T is
compared when that is more than what is uncertain of it, so that a gas without waves fails (validation/gas/waves.py).

*Short waves.* The stress takes l nu to follow a shear (`sheared_gas.relaxation`), a wave decays at (z/2) x nu: the
less it has time to, the less viscous the gas is. For one relaxation rate (the equation of P. L. Bhatnagar, E. P. Gross
and M. Krook, Phys. Rev. 94, 511 (1954), doi:10.1103/PhysRev.94.511) the rate of decay s of a transverse wave, over
that of relaxation, obeys <1 / (1 - s + i kappa v)> = 1 over normal v, or, order by order, s = kappa^2 - kappa^4 + 4
kappa^6 with kappa^2 = (z/2) x / l, that of Navier and Stokes. So x is replaced by x (1 - kappa^2), and may be off by
4 kappa^4 of itself: 6 % at k xi = 1.

*Clusters.* I. Goldhirsch and G. Zanetti, Phys. Rev. Lett. 70, 1619 (1993), doi:10.1103/PhysRevLett.70.1619: density
follows. There is no theory of numbers for what the gas looks like then; that it is far from homogeneous is tested by
rows that pass from a lower bound on. Cells have a side of 20 diameters: 102 disks each, on average.

Close to collapse, collisions soon after another are elastic (S. Luding and S. McNamara, Granul. Matter 1, 113 (1998),
doi:10.1007/s100350050017), within 1e-3 of the first mean free time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ... import analysis, theory
from ...analysis import common
from ...model.box import Box
from ...model.collapse import ContactTime
from ...model.laws.ifr import IFRLaw
from ...model.state import State
from ...plots.style import dashes
from ...simulation.simulation import Simulation
from ...theory.cooling_gas import changes_per_collision
from ...theory.hydrodynamics import excess
from ...theory.sheared_gas import relaxation
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import ELASTIC, Mean, compare, equal_disks, restarted, scattered, seeds_of
from .waves import streams

QUESTION = "Does a large cooling gas grow shear modes as theory says, and then clusters?"
REFERENCE = (
    "van Noije et al. (1997), doi:10.1103/PhysRevLett.79.411; "
    "Goldhirsch and Zanetti (1993), doi:10.1103/PhysRevLett.70.1619"
)

LAW = IFRLaw(e_n=0.7, e_t=-1.0, mu=0.0)
PHI = 0.2
CELL = 20.0  # diameters
EARLY = (4.0, 8.0)  # collisions per disk at which waves are compared with theory
T_AT = 8.0  # collisions per disk at which T is: earlier, what is uncertain is as much as what waves add
BANDS = ((0.1, 0.25), (0.25, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0), (1.0, 1.2))  # of k xi
QUICK_BANDS = ((0.1, 0.4), (0.4, 0.6), (0.6, 0.9), (0.9, 1.2))  # there are fewer waves in a smaller box
VISCOUS = 0.1  # part of the viscosity that its first approximation may be off by
WAVES = "van Noije et al. (1997), doi:10.1103/PhysRevLett.79.411"


@dataclass(frozen=True)
class Look:
    """The gas at one time."""

    tau: float
    time: float
    T: float
    state: State


def run(quick: bool, seed: int) -> Result:
    result = Result()
    n, end = (100_000, 40.0) if quick else (1_000_000, 60.0)
    bands = QUICK_BANDS if quick else BANDS
    (one,) = seeds_of(seed, 1, 6000)
    box, looks = cooled(n, end, one)
    sampled: Any = {"disks": n, "seeds": [one], "source": WAVES}
    z = -float(changes_per_collision(0.0, LAW, 2.0)[0])
    waves = {}
    for look in looks:
        if look.tau in EARLY:
            waves[look.tau] = _waves(result, look, box, z, bands, sampled)
        if look.tau == T_AT:
            held = streams(look.tau, LAW, PHI, n)
            factor = float(held.factor[0])
            # Wide enough for a gas without waves, it would say nothing.
            compare(
                result, f"T over Haff's law after {look.tau:g} collisions per disk, waves hold {held.share[0]:.3f}",
                Mean(look.T * math.exp(z * look.tau), 1.0 / math.sqrt(n), 1), factor,
                systematic=float(held.factor_error[0]), widest=1.0 - 1.0 / factor,
                why="waves too short for hydrodynamics (validation/gas/waves.py)", **sampled,
            )  # fmt: skip
    _clustered(result, looks, box, z)
    result.pictures += [_fields(looks[-1], box, n), _curves(looks, box, z, waves, n)]
    return result


def cooled(n: int, end: float, seed: int) -> tuple[Box, list[Look]]:
    """The box, and the gas at several times."""
    disks = equal_disks(n)
    box = Box.from_packing_fraction(disks.radius, PHI)
    # Random places have density waves of all lengths from the start; those of a lattice would take long to come.
    gas = Simulation(disks, box, ELASTIC, scattered(disks, box, seed, temperature=1.0))
    gas.run(collisions_per_disk=5.0)
    soon = 1e-3 / theory.collision_rate(PHI, 1.0, 1.0, 0.5)
    gas = restarted(gas, LAW, collapse=ContactTime(soon))
    looks: list[Look] = []
    for tau in sorted({0.0, 2.0, *EARLY, *np.linspace(10.0, end, int(end / 5.0) - 1)}):
        if tau:
            gas.run(collisions_per_disk=tau)
        looks.append(Look(tau, gas.time, gas.measure().temperature, gas.state))
    return box, looks


def transverse(state: State, box: Box, most: float) -> tuple[Array, Array]:
    """|k| of the modes up to `most`, one of k and -k, and |transverse component of sum_j v_j exp(-i k r_j)|^2 / N."""
    finufft = common.load("finufft", "waves of velocities")
    lengths = np.array(box.lengths)
    count = np.ceil(most * lengths / (2.0 * np.pi)).astype(int)
    x, y = np.ascontiguousarray(2.0 * np.pi * (state.position / lengths % 1.0).T - np.pi)
    shape = (2 * int(count[0]) + 1, 2 * int(count[1]) + 1)
    v = np.ascontiguousarray(state.velocity.T.astype(complex))
    # More threads sum up in an order of their own.
    waves = finufft.nufft2d1(x, y, v, shape, isign=-1, eps=1e-9, nthreads=1)
    k_x, k_y = np.meshgrid(
        2.0 * np.pi / lengths[0] * np.arange(-count[0], count[0] + 1),
        2.0 * np.pi / lengths[1] * np.arange(-count[1], count[1] + 1), indexing="ij",
    )  # fmt: skip
    k = np.hypot(k_x, k_y)
    half = ((k_x > 0.0) | ((k_x == 0.0) & (k_y > 0.0))) & (k <= most)
    across = np.abs(-k_y * waves[0] + k_x * waves[1])[half] / k[half]
    return k[half], across**2 / len(state.spin)


def growth(x: Array, z_tau: float) -> Array:
    """S of waves with k^2 xi^2 = x: see the module's text."""
    return np.asarray(1.0 + excess(z_tau, 1.0 - x)[0])


def slowness(x: Array, z: float) -> Array:
    """kappa^2 of waves with k^2 xi^2 = x: see the module's text."""
    return np.asarray(0.5 * z * x / relaxation(0.0, LAW, 2.0))


def _waves(
    result: Result, look: Look, box: Box, z: float, bands: Sequence[tuple[float, float]], sampled: Any
) -> tuple[Array, Array]:
    """Compare waves with theory; k xi and S of each mode."""
    xi = theory.shear_length(LAW, 0.5, PHI) / (2.0 * math.pi)
    k, energy = transverse(look.state, box, 1.2 / xi)
    S = energy / math.exp(-z * look.tau)  # over T / m of a homogeneous gas
    for low, high in bands:
        inside = (k * xi > low) & (k * xi <= high)
        x = (k[inside] * xi) ** 2
        short = slowness(x, z)
        x = x * (1.0 - short)
        expected = float(np.mean(growth(x, z * look.tau)))
        less = float(np.mean(growth((1.0 + VISCOUS + 4.0 * short**2) * x, z * look.tau)))
        compare(
            result, f"energy of transverse waves, k xi from {low} to {high}, after {look.tau:g} collisions per disk",
            Mean(float(np.mean(S[inside])), expected / math.sqrt(np.count_nonzero(inside)), 1), expected,
            systematic=expected - less + 0.02 * expected, widest=0.4,
            why="what a tenth more viscosity would change (its first approximation at e_n = 0.7), the next order of "
            "short waves, and 2 % (a_2; T at the start)", **sampled,
        )  # fmt: skip
    return k * xi, S


def _density(look: Look, box: Box) -> tuple[Array, float]:
    """Packing fractions of cells, and the side of a cell."""
    cells = round(box.lengths[0] / CELL)
    side = box.lengths[0] / cells
    edges = np.linspace(0.0, box.lengths[0], cells + 1)  # the box is a square
    x, y = look.state.position.T
    number = np.histogram2d(x, y, bins=[edges, edges])[0]
    return number * math.pi / 4.0 / side**2, side


def _clustered(result: Result, looks: list[Look], box: Box, z: float) -> None:
    end = looks[-1]
    first, last = _density(looks[0], box)[0], _density(end, box)[0]
    ratio = float(last.var() / first.var())
    in_dense = float(last[last > 2.0 * PHI].sum() / last.sum())
    over = end.T * math.exp(z * end.tau)
    at = f"after {end.tau:g} collisions per disk"
    source = "Goldhirsch and Zanetti (1993), doi:10.1103/PhysRevLett.70.1619"
    # A homogeneous gas has a ratio of 1, and T on Haff's law. Of its cells, whose 102 disks scatter by 10 or less, none
    # has twice the mean.
    for text, value, bound in (
        (f"variance of the density of cells, {at}, over that at the start", ratio, 20.0),
        (
            f"part of the disks in cells of twice the mean density, {at}",
            in_dense,
            0.15 if end.tau > 40.0 else 0.03,
        ),
        (f"T over Haff's law, {at}", over, 100.0 if end.tau > 40.0 else 40.0),
    ):
        result.at_least(
            text, value, bound, "one-sided: no theory says how much; a homogeneous gas has 1, 0 and 1", source
        )


def _fields(look: Look, box: Box, n: int) -> Picture:
    from matplotlib.colors import LogNorm

    cells = round(box.lengths[0] / (CELL / 4.0))
    fields = analysis.coarse_grain(
        look.state.position, look.state.velocity, box=box, cells=(cells, cells), radius=0.5, width=CELL / 4.0
    )
    figure, (left, right) = style.panels(2, width=4.0, height=3.5)
    extent = (0.0, box.lengths[0], 0.0, box.lengths[1])
    T = fields.temperature / look.T
    panels: tuple[tuple[Any, Array, str, dict[str, Any]], ...] = (
        (left, fields.packing_fraction, r"packing fraction $\phi$", {"cmap": "cividis", "vmin": 0.0, "vmax": 0.7}),
        (right, T, r"$T / \langle T \rangle$", {
            "cmap": "magma", "norm": LogNorm(*np.nanquantile(T, (0.01, 0.999))),
        }),
    )  # fmt: skip
    for axes, values, text, options in panels:
        image = axes.imshow(values.T, origin="lower", extent=extent, interpolation="nearest", **options)
        figure.colorbar(image, ax=axes, label=text, shrink=0.85)
        axes.set(xlabel="x (diameters)", ylabel="y (diameters)")
    caption = (
        f"{n:,} smooth disks, e_n = {LAW.e_n}, mean packing fraction {PHI}, after {look.tau:g} collisions per "
        f"disk: density and temperature (relative to the local mean velocity), Gaussians of {CELL / 4.0:g} diameters. "
        "The mean T counts streams as well, which is why most of the gas is below it."
    )
    return Picture("gas_clusters_fields", caption, figure)


def _curves(
    looks: list[Look], box: Box, z: float, waves: dict[float, tuple[Array, Array]], n: int
) -> Picture:
    figure, (left, middle, right) = style.panels(3, width=3.3)
    t = np.array([look.time for look in looks])
    rate = theory.collision_rate(PHI, 1.0, 1.0, 0.5)
    fine = np.concatenate([[0.0], np.geomspace(0.1, max(t[-1] * rate, 1.0), 200)])
    left.plot(1.0 + fine, theory.haff(1.0, LAW.e_n, rate, fine / rate), color=style.BLACK, label="Haff's law")
    style.points(left, 1.0 + t * rate, [look.T for look in looks], style.BLUE, "simulated")
    left.set(
        xscale="log", yscale="log", xlabel=r"$1 + \nu_0 t$", ylabel=r"$T/T_0$", ylim=(0.2 * looks[-1].T, 2.0)
    )
    left.legend()
    x = np.linspace(0.02, 1.2, 300)
    for i, (tau, (k_xi, S)) in enumerate(waves.items()):
        edges = np.linspace(0.05, 1.2, 24)
        place = np.digitize(k_xi, edges)
        kept = [b for b in range(1, len(edges)) if np.count_nonzero(place == b) > 3]
        middle.plot(x, growth(x**2 * (1.0 - slowness(x**2, z)), z * tau), **dashes(style.COLOURS[i]))
        middle.errorbar(
            [k_xi[place == b].mean() for b in kept], [S[place == b].mean() for b in kept],
            [S[place == b].mean() / math.sqrt(np.count_nonzero(place == b)) for b in kept], fmt="os"[i], mfc="none",
            color=style.COLOURS[i], ms=4, lw=0.8, label=rf"$\tau$ = {tau:g}",
        )  # fmt: skip
    middle.set(xlabel=r"$k\xi$", ylabel="transverse waves / thermal", yscale="log")
    middle.legend()
    shown = [looks[0], *[look for look in looks[:-1] if look.tau in (10.0, 20.0, 30.0, 40.0)], looks[-1]]
    for i, look in enumerate(shown):
        found = analysis.structure_factor(look.state.position, box, k_max=1.5, rings=60)
        right.plot(found.k, found.S, label=rf"$\tau$ = {look.tau:g}", **dashes(style.COLOURS[i]))
    right.set(xscale="log", yscale="log", xlabel=r"$k$ (1 / diameter)", ylabel=r"structure factor $S(k)$")
    right.legend(fontsize=7)
    style.titles(left, middle, right)
    caption = (
        f"{n:,} cooling disks. (a) Temperature over time. (b) Transverse velocity waves early on (markers) and "
        "their theory (lines). (c) Structure factor of the density at several "
        "collisions per disk: clusters grow, and become larger."
    )
    return Picture("gas_clusters", caption, figure)
