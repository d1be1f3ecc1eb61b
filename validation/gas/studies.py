r"""The shipped studies of published results: each is run as a user runs it, and compared with what its paper says.

None of the papers has these disks in a table, so the expected values are their formulas, in two dimensions.

*Rough disks.* S. Luding, M. Huthmann, S. McNamara and A. Zippelius, Phys. Rev. E 58, 3416 (1998). With q = 4 I / (m
sigma^2), eta = q (1 + beta) / (2 q + 2), A = (1 - e^2) / 4 + eta (1 - eta) / 2, B = eta^2 / (2 q) and C = eta (1 - eta /
q) / (2 q), and in collisions per disk,

    dT/dtau = -2 A T + 2 B T_rot,    dT_rot/dtau = 4 B T - 4 C T_rot:

two linear equations. Velocities are Gaussian in them; what Sonine's expansion adds (`theory.rough_sonine`) lowers
the ratio by up to 6 % at e_n = 0.9.

*Viscoelastic disks.* N. V. Brilliantov and T. Poeschel, Phys. Rev. E 61, 5573 (2000): with e = 1 - C_1 d g^(1/5) + (3/5)
C_1^2 d^2 g^(2/5), C_1 = 1.15344, 1 - e^2 is 2 C_1 d g^(1/5) - (11/5) C_1^2 d^2 g^(2/5). Colliding pairs have the density g
exp(-m g^2 / 4 T) of normal speeds, so that <g^2> = 4 T / m and <g^(2 + p)> = (4 T / m)^(1 + p/2) Gamma(2 + p/2); a disk
loses half of (m / 4) <(1 - e^2) g^2> in each collision:

    dT/dtau = -C_1 d Gamma(2.1) (4 / m)^0.1 T^1.1 + (11/10) C_1^2 d^2 Gamma(2.2) (4 / m)^0.2 T^1.2.

The first term alone gives T = T_0 (1 + t / t_0)^(-5/3).

*Mixtures.* V. Garzo and J. Dufty, Phys. Rev. E 60, 5706 (1999): `species.equal_rates`.

*Shear.* A. Santos, V. Garzo and J. W. Dufty, Phys. Rev. E 69, 061303 (2004): with zeta = (1 - e^2) / 2 and beta = (1 + e)
(3 + e) / 8, per collision, P_xx / p = (beta + 2 zeta) / (beta + zeta), P_yy / p = beta / (beta + zeta) and (P_xy / P_yy)^2
= zeta / beta, to first order of Grad's expansion. Anisotropic Gaussians (`theory.steady_flow`) have N_1 larger by
1 to 6 %, and friction by 0.5 to 4 %.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import gamma

from ...case import shipped
from ...study.figure import draw
from ...study.plan import VARIANT
from ...study.results import Results, averaged, stored_case
from ...study.study import Study
from ...theory.collisions import collision_rate
from ...theory.rough_gas import rough_sonine
from ...tools.checked import Array
from ..report.registry import Picture, Result
from . import species
from .sample import compare, ratio, seeds_of

QUESTION = "Do the shipped studies find what the papers say that they are about?"
REFERENCE = (
    "rough disks: doi:10.1103/PhysRevE.58.3416; viscoelastic disks: doi:10.1103/PhysRevE.61.5573; mixtures: "
    "doi:10.1103/PhysRevE.60.5706; shear: doi:10.1103/PhysRevE.69.061303"
)

LUDING = "Luding et al. (1998), doi:10.1103/PhysRevE.58.3416, A, B and C in two dimensions"
BRILLIANTOV = "Brilliantov and Poeschel (2000), doi:10.1103/PhysRevE.61.5573, in two dimensions"
GARZO = "Garzo and Dufty (1999), doi:10.1103/PhysRevE.60.5706, in two dimensions"
SANTOS = "Santos, Garzo and Dufty (2004), doi:10.1103/PhysRevE.69.061303, in two dimensions"
QUICK = ("rough_cooling", "viscoelastic_cooling")
"""Studies without analyses, which take the least time."""


def study_of(name: str, seeds: range, folder: str) -> Results:
    """Results of a shipped study with these seeds, in this process."""
    it = Study(name, seeds=",".join(map(str, seeds)), output=f"{folder}/{name}.nc")
    with contextlib.redirect_stderr(io.StringIO()):  # lines of progress
        failed = it.run(workers=0)
    if failed:
        raise RuntimeError(f"{name}: {len(failed)} runs failed: {next(iter(failed.values()))}")
    return it.results()


def case_of(found: Results, **fixed: int) -> Any:
    """The case of a point of a study: of the first one, but for positions on its dimensions."""
    return stored_case(found, dict.fromkeys(found.axes, 0) | fixed).case


def run(quick: bool, seed: int) -> Result:
    result = Result()
    with tempfile.TemporaryDirectory() as folder:
        for i, (name, (compared, pictures)) in enumerate(STUDIES.items()):
            if quick and name not in QUICK:
                continue
            plan = Study(name, output=f"{folder}/{name}.nc").plan
            seeds = seeds_of(seed, len(plan.seeds), 7600 + 50 * i)
            found = study_of(name, seeds, folder)
            compared(result, found, seeds)
            for j, words in enumerate(pictures):
                caption = f"{shipped.title(name)}: the shipped study {name}, with its theory."
                figure = draw(found, *words, size=(4.0,), title=False)
                result.pictures.append(Picture(f"gas_studies_{name}_{j}", caption, figure))
    return result


def luding(e: float, beta: float, tau: float, T: float, T_rot: float) -> Array:
    """T and T_rot after tau collisions per disk, of homogeneous disks."""
    q = 0.5
    eta = q * (1.0 + beta) / (2.0 * q + 2.0)
    A, B, C = 0.25 * (1.0 - e**2) + 0.5 * eta * (1.0 - eta), 0.5 * eta**2 / q, 0.5 * eta * (1.0 - eta / q) / q
    return np.asarray(expm(tau * np.array([[-2.0 * A, 2.0 * B], [4.0 * B, -4.0 * C]])) @ [T, T_rot])


def rough(result: Result, found: Results, seeds: range) -> None:
    """The ratio of temperatures at the end, and how far T has fallen by 10 collisions per disk."""
    case, tau = case_of(found), found.row_places
    e = case.material[0].e_n
    T, T_rot = found.values("temperature"), found.values("rotational_temperature")
    middle = int(np.flatnonzero(tau == 10.0)[0])
    for i, beta in enumerate(found.values("beta").tolist()):
        start = float(T[i, :, 0].mean()), float(T_rot[i, :, 0].mean())
        right = luding(e, beta, float(tau[-1]), *start)
        theta, sonine = ratio(T_rot[i, :, -1], T[i, :, -1]), rough_sonine(e, beta).theta
        options: Any = {"disks": case.species[0].number, "seeds": seeds, "source": LUDING}
        expected = float(right[1] / right[0])
        compare(
            result, f"T_rot / T of rough disks, e_n = {e}, beta = {beta}, tau = {tau[-1]:g}", theta, expected,
            systematic=abs(sonine / limit(e, beta) - 1.0) * expected + 0.02 * expected, widest=0.2,
            why="what cumulants change (Sonine's expansion), and 2 %", **options,
        )  # fmt: skip
        fallen = ratio(T[i, :, middle], T[i, :, 0])
        expected = float(luding(e, beta, float(tau[middle]), *start)[0] / start[0])
        compare(
            result, f"T over T(0) of rough disks, e_n = {e}, beta = {beta}, tau = {tau[middle]:g}", fallen, expected,
            systematic=0.03 * expected, why="3 %: cumulants", widest=0.12, **options,
        )  # fmt: skip


def limit(e: float, beta: float) -> float:
    """T_rot / T that the equations of Luding et al. tend to."""
    T, T_rot = luding(e, beta, 400.0, 1.0, 1.0)
    return float(T_rot / T)


def viscoelastic(result: Result, found: Results, seeds: range) -> None:
    """T of both laws at the end, in time, and how steeply it falls there."""
    names = found.values("variant").tolist()
    cases = {name: case_of(found, **{VARIANT: i}) for i, name in enumerate(names)}
    case, of_speed = cases["viscoelastic"], cases["viscoelastic"].material[0]
    nu = collision_rate(case.box.packing_fraction, 1.0, 1.0, 0.5)
    # d of e = 1 - C_1 d g^(1/5) + ..., of the law: (3/2) A (k / m_n)^(2/5), k = 2 Y sqrt(R) / 3
    x = 1.15344 * 1.5 * of_speed.A * (2.0 * of_speed.Y * np.sqrt(0.25) / 3.0 / 0.5) ** 0.4
    e_n = cases["constant e_n"].material[0].e_n
    rates: dict[str, Callable[[float], float]] = {
        "viscoelastic": lambda T: (
            x * gamma(2.1) * 4.0**0.1 * T**1.1 - 1.1 * x**2 * gamma(2.2) * 4.0**0.2 * T**1.2
        ),
        "constant e_n": lambda T: 0.5 * (1.0 - e_n**2) * T,
    }
    T, when = found.values("temperature"), found.values("time")
    tau = found.row_places
    late = int(np.argmin(np.abs(tau - 0.5 * tau[-1])))
    for name, rate in rates.items():
        i = names.index(name)
        whole = solve_ivp(
            lambda _, y, rate=rate: [-rate(y[0]) * nu * np.sqrt(y[0]), nu * np.sqrt(y[0])], (0.0, 1e7),
            (float(T[i, :, 0].mean()), 0.0), method="LSODA", rtol=1e-9, atol=1e-12, dense_output=True,
            events=_after(float(tau[-1])),
        )  # fmt: skip
        by_tau = solve_ivp(
            lambda _, y, rate=rate: [-rate(y[0])],
            (0.0, float(tau[late])),
            (1.0,),
            method="LSODA",
            rtol=1e-9,
            atol=1e-12,
        )
        ends = when[i].mean(axis=0)[[late, -1]]
        right = whole.sol(np.minimum(ends, whole.t[-1]))[0]
        options: Any = {
            "disks": case.species[0].number,
            "seeds": seeds,
            "source": BRILLIANTOV if name in SPEED else "Haff's law",
        }
        compare(
            result, f"T over T(0) at tau = {tau[late]:g}, {name}", ratio(T[i, :, late], T[i, :, 0]), float(by_tau.y[0, -1]),
            systematic=0.04 * float(by_tau.y[0, -1]), why="4 %: cumulants, streams", widest=0.1, **options,
        )  # fmt: skip
        exponent = np.log(T[i, :, -1] / T[i, :, late]) / np.log(when[i, :, -1] / when[i, :, late])
        expected = float(np.log(right[1] / right[0]) / np.log(ends[1] / ends[0]))
        goes_to = "-5/3" if name in SPEED else "-2"
        compare(
            result, f"exponent of T over t between tau = {tau[late]:g} and {tau[-1]:g}, {name}, which tends to {goes_to}",
            exponent, expected, systematic=0.02, why="0.02: cumulants, streams", widest=0.04, **options,
        )  # fmt: skip


SPEED = ("viscoelastic",)
"""Variants whose e_n depends on the speed."""


def _after(tau: float) -> Any:
    """An event at which so many collisions per disk are over, and a little more."""

    def over(_: float, y: Array) -> float:
        return float(y[1]) - 1.2 * tau

    over.terminal = True  # type: ignore[attr-defined]
    return over


def mixtures(result: Result, found: Results, seeds: range) -> None:
    """The ratio of temperatures of light over heavy disks."""
    values, case = found.values("species_T_ratio_light"), case_of(found)
    phi, disks = case.box.packing_fraction, sum(each.number for each in case.species)
    for i, e_n in enumerate(found.values("e_n").tolist()):
        for j, mass in enumerate(found.values("mass").tolist()):
            expected = 1.0 / species.equal_rates(e_n, np.array([case.species[1].mass, mass]), phi)
            compare(
                result, f"T of light / T of heavy disks of a cooling mixture, m_2 / m_1 = {mass:g}, e_n = {e_n}",
                values[i, j], expected, disks=disks, seeds=seeds, systematic=0.03 * expected, widest=0.2, source=GARZO,
                why="3 %: velocities that are not quite Maxwellian, streams",
            )  # fmt: skip


def sheared(result: Result, found: Results, seeds: range) -> None:
    """Ratios of stresses of the steady flow."""
    means, case = averaged(found), case_of(found)
    for i, e in enumerate(found.values("e_n").tolist()):
        zeta, beta = 0.5 * (1.0 - e**2), (1.0 + e) * (3.0 + e) / 8.0
        for name, key, expected in (
            ("N_1", "stress_N_1", 2.0 * zeta / (beta + zeta)),
            ("T_x / T_y", "stress_T_x_over_T_y", 1.0 + 2.0 * zeta / beta),
            ("-P_xy / P_yy", "stress_friction", float(np.sqrt(zeta / beta))),
        ):
            by_theory = float(means.variables[f"{key}_theory_mean"].values[i])
            compare(
                result, f"{name} of sheared smooth disks, phi = {case.box.packing_fraction}, e_n = {e}", means.values(key)[i], expected,
                disks=case.species[0].number, seeds=seeds, systematic=abs(by_theory - expected) + 0.03 * expected, widest=0.25,
                source=SANTOS, why="what Grad's first order leaves out (theory.steady_flow); 3 %: density, waves",
            )  # fmt: skip


STUDIES: dict[str, tuple[Callable[[Result, Results, range], None], tuple[tuple[str, ...], ...]]] = {
    "rough_cooling": (rough, (("theta", "beta"), ("T", "tau", "beta"))),
    "viscoelastic_cooling": (viscoelastic, (("T", "t", "variant"),)),
    "mixture_cooling": (mixtures, (("species_T_ratio_light", "e_n", "mass"),)),
    "shear_stress": (sheared, (("stress_N_1", "e_n"), ("stress_friction", "e_n"))),
}
"""Formulas that each study is compared with, and its pictures: quantity, axis and curves."""
