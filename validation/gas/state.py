r"""Elastic smooth disks: equation of state, collision rate, and the contact value of g(r).

Expected: the equation of state of J. Kolafa and M. Rottner, Mol. Phys. 104, 3435 (2006),
doi:10.1080/00268970600967963, a fit to their molecular dynamics and to virial coefficients, up to rho sigma^2 = 0.9.
At packing fraction 0.69 also a Monte Carlo of 870 disks by B. Li, Y. Nishikawa, P. Hoellmer, L. Carillo, A. C. Maggs
and W. Krauth, J. Chem. Phys. 157, 234111 (2022), doi:10.1063/5.0126437: 8.96990(8) for P sigma^2 / T, from the table in
github.com/jellyfysh/HistoricDisks.

*N disks instead of infinitely many.* The grand-canonical sum over N peaks like a Gaussian of variance N S, with
1/S = d(rho Z)/d rho, so that F_N / T = N f + ln(2 pi N S) / 2 and, by P = -dF/dV,

    Z_N = Z + (1 / 2N) d ln S / d ln phi.

At 0.69, next to freezing, S changes so fast that this is no small correction any more: 0.25 % for 1024 disks, of which
the Monte Carlo shows a third. There only the Monte Carlo of as many disks is a reference.

*At constant energy and momentum.* With T = E / (N - 1), relative velocities of two disks have the variance 2 T / m, as
in equilibrium at T: Z = 1 + sum sigma P_n / (2 N T t) is that of the canonical ensemble exactly. So are those of P_n a
collision; it is measured for a while, and the rate of collisions for longer. Mean speeds are those
of a vector of 2 (N - 1) components of fixed length, 1 + 1 / (8 (N - 1)) times the Maxwellian ones, and so are rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ... import analysis, theory
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import LOOSE, Mean, add_chi_square, compare, fluid, restarted, sampled_run, seeds_of

QUESTION = "Do elastic disks have the pressure, collision rate and contact value of the literature?"
REFERENCE = (
    "Kolafa and Rottner (2006), doi:10.1080/00268970600967963; Li et al. (2022), doi:10.1063/5.0126437"
)

KOLAFA_ROTTNER = {
    0: 1.0, 1: 2.0, 2: 1.12801775, 3: 0.00181895291, 4: -0.0526134737, 5: 0.0504960168, 6: -0.0325537792,
    7: 0.0134578632, 8: 0.00140888182, 9: -0.00834273601, 10: 0.00694127367, 11: -0.00262254723,
    12: 0.000355746352, 22: -5.24672938e-9, 57: 5.88054639e-23,
}  # fmt: skip
"""Z as a series in phi / (1 - phi), power by power: the fit up to rho sigma^2 = 0.9, Sec. 3.2 of the paper."""

LI = (0.69, 870, 8.969898, 7.5e-5)
"""Packing fraction, disks, P sigma^2 / T and its error: event-chain Monte Carlo in a square box (source: above)."""

PHI = (0.1, 0.2, 0.3, 0.5, 0.6, 0.65)
BY_IMPULSES = 0.6  # packing fraction up to which Z is measured by impulses and g(r) as well
SHARP = 0.003  # of Z: rows with wider tolerances say nothing
N, REPLICAS, REPLICAS_OF_LI = 1024, 30, 32
QUICK_REPLICAS = 24  # at one packing fraction, without impulses
SOURCE = "Kolafa and Rottner (2006), doi:10.1080/00268970600967963"


def compressibility(phi: Any) -> Any:
    """Z of infinitely many disks at packing fractions of any shape."""
    x = np.asarray(phi, dtype=float) / (1.0 - np.asarray(phi, dtype=float))
    return sum(a * x**power for power, a in KOLAFA_ROTTNER.items())


def log_structure(phi: float) -> float:
    """d ln S / d ln phi, S = 1 / (d(phi Z) / d phi) being the structure factor at k = 0."""

    def slope(at: float) -> float:
        step = 1e-4 * at
        more, less = at + step, at - step
        return float(more * compressibility(more) - less * compressibility(less)) / (2.0 * step)

    step = 1e-2
    return -float(np.log(slope(phi * (1.0 + step)) / slope(phi * (1.0 - step)))) / (2.0 * step)


def of_few(phi: float, n: int) -> float:
    """Z of n disks: see the module's text."""
    return float(compressibility(phi)) + log_structure(phi) / (2.0 * n)


@dataclass(frozen=True)
class Found:
    """Results of all replicas: Z by impulses and by the collision rate, and g at contact."""

    virial: Array
    rate: Array
    contact: Array


def run(quick: bool, seed: int) -> Result:
    result = Result()
    found = {}
    for i, phi in enumerate(PHI):
        if quick and phi != 0.3:
            continue
        seeds = seeds_of(seed, QUICK_REPLICAS if quick else REPLICAS, 40 * i)
        found[phi] = measured(phi, N, seeds, impulses=not quick)
        _compare(result, phi, seeds, found[phi])
    for way in () if quick else ("impulses", "the collision rate"):
        add_chi_square(
            result, f"Z by {way}", [row for row in result.rows if f"Z by {way}" in row.quantity], SOURCE
        )
    dense = None
    if not quick:
        phi, n, P, error = LI
        seeds = seeds_of(seed, REPLICAS_OF_LI, 40 * len(PHI))
        dense = measured(phi, n, seeds)
        compare(
            result, f"P sigma^2 / T of {n} disks by the collision rate, phi = {phi}", dense.rate * 4.0 * phi / np.pi, P,
            disks=n, seeds=seeds, systematic=4.0 * error, widest=SHARP,
            why=f"4 errors of the Monte Carlo, {error}: both have {n} disks in a square box",
            source="Li et al. (2022), doi:10.1063/5.0126437, event-chain Monte Carlo",
        )  # fmt: skip
    result.pictures.append(_figure(found, dense))
    return result


def measured(phi: float, n: int, seeds: Sequence[int], *, impulses: bool = True) -> Found:
    """Replicas at one packing fraction."""
    # Impulses make Z - 1, and scatter by 0.7 of their mean: dilute gases need fewer.
    melting, span, tracked = 10.0, 200.0, max(40.0, 300.0 * phi)
    if phi > LOOSE:
        melting, span = 100.0, 500.0
    if phi > 0.55:
        melting, span = 200.0, 1000.0
    if phi > 0.66:  # close to freezing, crystals and fluid change slowly
        melting, span = 1000.0, 9000.0
    if not impulses:
        tracked = 0.0
    return Found(*np.array([_replica(phi, n, seed, melting, span, tracked) for seed in seeds]).T)


def _replica(
    phi: float, n: int, seed: int, melting: float, span: float, tracked: float
) -> tuple[float, float, float]:
    gas = fluid(n, phi, seed, melting=melting)
    T = n / (n - 1.0)  # E / (N - 1), that of the start being 1
    # By time: a frame at the moment of a collision has a pair in contact, and g there would be too large.
    expected = theory.collision_rate(phi, T, 1.0, 0.5, g=(of_few(phi, n) - 1.0) / (2.0 * phi))
    both = phi <= BY_IMPULSES
    states, _ = sampled_run(gas, 100 if phi < 0.25 else 40, t_end=span / expected)
    maxwellian = 1.0 + 1.0 / (8.0 * (n - 1))
    rate = 2.0 * gas.collisions / n / gas.time / maxwellian
    chi = analysis.contact_from_rate(rate, packing_fraction=phi, temperature=T, mass=1.0, radius=0.5)
    if not both:
        return np.nan, analysis.compressibility(phi, chi), np.nan
    contact = analysis.contact_value([state.position for state in states], gas.box, radius=0.5).g
    if not tracked:
        return np.nan, analysis.compressibility(phi, chi), contact
    gas = restarted(gas, histories=range(n))
    gas.run(collisions_per_disk=tracked)
    events = gas.take_events()
    pressure = analysis.pressure_from_impulses(
        events.time, events.normal, events.impulse, np.ones(len(events)), span=(0.0, gas.time),
        area=gas.box.area, disks=n, tracked=n, temperature=T,
    )  # fmt: skip
    rate = 2.0 * gas.collisions / n / gas.time / maxwellian
    now = analysis.contact_from_rate(rate, packing_fraction=phi, temperature=T, mass=1.0, radius=0.5)
    # Impulses of the short while per collision, times the collisions of the long one.
    return 1.0 + (pressure.Z - 1.0) * chi / now, analysis.compressibility(phi, chi), contact


def _compare(result: Result, phi: float, seeds: Sequence[int], found: Found) -> None:
    Z = of_few(phi, N)
    why = "5e-4 of Z, which the fit may be off by"
    options: Any = {"disks": N, "seeds": seeds, "source": SOURCE}
    for way, values in (("impulses", found.virial), ("the collision rate", found.rate)):
        if np.isfinite(values).all():
            compare(
                result, f"Z by {way}, phi = {phi}", values, Z, systematic=5e-4 * Z, why=why, widest=SHARP, **options
            )  # fmt: skip
    if phi <= BY_IMPULSES:
        g = (Z - 1.0) / (2.0 * phi)
        why = "1 % of g: a parabola for ln g from contact to a quarter of a diameter"
        compare(
            result, f"g(r) at contact, phi = {phi}", found.contact, g, systematic=0.01 * g, why=why, widest=0.05,
            **options,
        )  # fmt: skip


def _figure(found: dict[float, Found], dense: Found | None) -> Picture:
    figure, (left, right) = style.panels(2)
    at = np.linspace(0.02, 0.7, 200)
    left.plot(at, compressibility(at), color=style.BLACK, label="Kolafa and Rottner")
    phi = np.array(list(found))
    Z = np.array([of_few(p, N) for p in phi])
    if dense is not None:
        phi, Z = np.append(phi, LI[0]), np.append(Z, LI[2] * np.pi / 4.0 / LI[0])
    each = [*found.values(), *([] if dense is None else [dense])]
    style.points(left, phi, [one.rate.mean() for one in each], style.VERMILION, "collision rate", "s")
    left.set(xlabel=r"packing fraction $\phi$", ylabel=r"$Z = P/(nT)$", xlim=(0.0, 0.72))
    left.legend()
    right.axhline(0.0, color=style.BLACK)
    right.plot(
        at, 100.0 * (1.0 + 2.0 * at * np.array([theory.contact_value(p) for p in at])
                     - compressibility(at)) / compressibility(at),
        "--", color=style.GREEN, label="resummed virial series",
    )  # fmt: skip
    henderson = np.array([theory.contact_value(p, "henderson") for p in at])
    right.plot(
        at, 100.0 * (1.0 + 2.0 * at * henderson - compressibility(at)) / compressibility(at),
        ":", color=style.PURPLE, label="Henderson",
    )  # fmt: skip
    for name, colour, marker, shift in (
        ("virial", style.BLUE, "o", -0.004),
        ("rate", style.VERMILION, "s", 0.004),
    ):
        means = [Mean.of(getattr(one, name)) for one in each]
        if not np.isfinite([m.value for m in means]).any():
            continue
        right.errorbar(
            phi + shift, 100.0 * (np.array([m.value for m in means]) / Z - 1.0),
            100.0 * np.array([m.error for m in means]) / Z, fmt=marker, mfc="none", color=colour, ms=4.5, lw=1.0,
            label={"virial": "impulses", "rate": "collision rate"}[name],
        )  # fmt: skip
    right.set(
        xlabel=r"packing fraction $\phi$",
        ylabel=r"$Z/Z_\mathrm{expected} - 1$ (%)",
        ylim=(-0.5, 0.8),
        xlim=(0.0, 0.72),
    )
    right.legend(loc="upper left")
    style.titles(left, right)
    caption = (
        f"Compressibility factor of elastic disks. (a) By the collision rate, and the equation of state of Kolafa and "
        f"Rottner. (b) The difference, of {N} disks from Z_N, with standard errors, and of two closed forms; at phi = "
        f"{LI[0]}, of {LI[1]} disks from the Monte Carlo of Li et al."
    )
    return Picture("gas_state", caption, figure)
