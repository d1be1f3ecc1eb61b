r"""The same coins under the IFR law and under Walton's law fitted to the same impacts: where gases tell them apart.

*Single impacts.* A coin hits one like it, at rest and without spin, at 18 angles of incidence psi from 4 to 72 degrees,
by the IFR law with the coefficients of Table II. Walton's law is fitted to the exact angles of rebound with errors of
0.7 degrees, those of the paper's photographs (`ifrdem fit --model walton`). What chi-square has then is what such an
experiment would see of the difference, beyond its noise. Of k = 2, both laws are one where impacts stick, with beta_0 =
e_t + 3/2. Where they slide, IFR adds (1 + e_t) m_t g_t to mu P_n: more, the more grazing the impact.

*Gases.* Equal seeds have equal starts under both laws; spins are cold. In a gas the slip comes from spins, too, and
impacts are as grazing as chance has it. Kinetic theory (`theory.prediction`) and DSMC of each law know nothing of
clusters. Densities and streams are in cells: <(N - <N>)^2> / <N> of the numbers in cells, and the part of the kinetic
energy in the mean motion of cells, less what chance gives.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ... import fit, theory
from ...model.forces import RandomKicks
from ...model.laws.coin_table import coins
from ...model.laws.collision import collide
from ...model.laws.ifr import IFRLaw
from ...model.laws.law import CollisionLaw
from ...model.laws.walton import Walton
from ...model.observables import Measure
from ...model.state import State
from ...plots.style import KINDS, dashes, some_marks
from ...simulation.dsmc import DSMC
from ...theory import driven_gas
from ...tools.checked import Array
from ...tools.intervals import PERCENT, student_t
from ..report import style
from ..report.registry import Picture, Result
from .sample import Mean, compare, fluid, ratio, sampled_run, seeds_of, thermal

QUESTION = "Where do two laws that agree on single impacts differ in a gas?"
REFERENCE = "closed kinetic theory and DSMC of each law (ifrdem/theory/collisions.py)"

MATERIALS = ("1 pta", "5 pts", "50 cts", "100 pts", "200 pts", "polyester")
COIN = "1 pta"  # of the simulated gases: that with the most tangential restitution and friction
PSI = np.linspace(4.0, 72.0, 18)
ERROR = 0.7  # of angles, degrees
PHI = 0.2
NAMES = ("IFR", "Walton")
LOOK = dict(zip(NAMES, (style.BLUE, style.VERMILION), strict=True))
END, QUICK_END, DISKS = 120.0, 20.0, 4000
CELLS = 12  # along a side: 28 disks each
AT = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 20.0])  # collisions per disk of DSMC
DISKS_OF_DSMC = 10_000
REPLICAS_OF_DSMC = {name: 20 if name == COIN else 8 for name in MATERIALS}
POWER, STEP, DRIVEN_DISKS = 0.25, 0.2, 3000
DRIVEN_END, REPLICAS = 60.0, 10
MELTING = 5.0


Laws = tuple[IFRLaw | Walton, IFRLaw | Walton]
"""IFR and Walton's."""


class FittedLaw(NamedTuple):
    """Both laws of a coin, and what single impacts see of their difference."""

    laws: Laws
    chi_square: float
    difference: Array
    """Walton less IFR of delta_1 and delta_2 [degrees], shape (2, angles) of `FINE`."""


FINE = np.linspace(1.0, 85.0, 169)


def angles(law: CollisionLaw, psi: Array) -> Array:
    """Angles of rebound delta_1, delta_2 [degrees] of equal disks without spin, shape (2, n)."""
    at = np.radians(psi)
    first = np.column_stack((np.cos(at), np.sin(at)))
    velocity = np.stack((first, np.zeros_like(first)), axis=-2)
    after = collide(law, [1.0, 0.0], [1.0, 1.0], [0.5, 0.5], [2.0, 2.0], velocity, [0.0, 0.0]).velocity
    return np.degrees(np.arctan2(np.abs(after[..., 1]), after[..., 0])).T


def fitted(law: IFRLaw) -> FittedLaw:
    """Walton's law fitted to the impacts of an IFR law."""
    rows = zip(PSI, *angles(law, PSI), strict=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "impacts.csv"
        lines = [",".join(f"{value:.9f}" for value in row) for row in rows]
        path.write_text("\n".join(("psi,delta_1,delta_2", *lines)), encoding="utf-8")
        found = fit.fit(fit.read(path, {"angles": ERROR}), M=1.0, model=["walton"]).laws["walton"]
    walton = Walton(**{name: float(found.coefficients[name]) for name in Walton.coefficients})
    return FittedLaw((law, walton), float(found.chi2), angles(walton, FINE) - angles(law, FINE))


def run(quick: bool, seed: int) -> Result:
    result = Result()
    found = {name: fitted(coins[name].law) for name in MATERIALS}
    homogeneous = {
        name: [
            _by_dsmc(law, seeds_of(seed, REPLICAS_OF_DSMC[name], 7000 + 20 * i)) for law in found[name].laws
        ]
        for i, name in enumerate((COIN,) if quick else MATERIALS)
    }
    laws, seeds = found[COIN].laws, seeds_of(seed, REPLICAS, 7400)
    gases = [_cooling(law, seeds, QUICK_END if quick else END) for law in laws]
    _compare_cooling(result, seeds, gases, homogeneous[COIN])
    driven = [] if quick else [_driven(law, seeds_of(seed, REPLICAS, 7500)) for law in laws]
    if driven:
        _compare_driven(result, seeds_of(seed, REPLICAS, 7500), laws, driven)
    _table(result, found, homogeneous)
    _gas_table(result, gases, driven)
    result.pictures.append(_picture(found[COIN], gases, driven))
    return result


class CoolingSeries(NamedTuple):
    """A cooling gas in time: rows (replicas, frames)."""

    tau: Array
    T: Array
    theta: Array
    clumping: Array
    streaming: Array


def _by_dsmc(law: CollisionLaw, seeds: range) -> Array:
    """T and T_rot of the homogeneous gas, (2, replicas, AT)."""
    found = []
    for seed in seeds:
        disks, velocity, spin = thermal(DISKS_OF_DSMC, seed)
        gas = DSMC(disks, law, PHI, velocity, spin, seed=seed)
        one = gas.run(collisions_per_disk=AT[-1], samples=AT)
        found.append((one.temperature[-len(AT) :], one.rotational_temperature[-len(AT) :]))
    return np.array(found).transpose(1, 0, 2)


def _cooling(law: CollisionLaw, seeds: range, end: float) -> CoolingSeries:
    found, frames = [], round(end)
    for seed in seeds:
        gas = fluid(DISKS, PHI, seed, law, melting=MELTING)
        states, rows = sampled_run(gas, frames, collisions_per_disk=end)
        T = np.array([one.temperature for one in rows])
        T_rot = np.array([one.rotational_temperature for one in rows])
        cells = np.array([_in_cells(state, gas.box.lengths[0]) for state in states])
        found.append((T / T[0], T_rot / T, *cells.T))
    tau = np.linspace(0.0, end, frames + 1)
    return CoolingSeries(tau, *np.array(found).transpose(1, 0, 2))


def _in_cells(state: State, length: float) -> tuple[float, float]:
    """Scatter of the numbers of disks in cells over their mean, and the part of the energy in streams."""
    cell = np.floor(state.position / length * CELLS).astype(int) % CELLS
    index = cell[:, 0] * CELLS + cell[:, 1]
    count = np.bincount(index, minlength=CELLS**2)
    sums = [np.bincount(index, state.velocity[:, axis], minlength=CELLS**2) for axis in (0, 1)]
    squares = float(np.sum(np.square(state.velocity)))
    filled = count > 0
    streams = sum(float(np.sum(each[filled] ** 2 / count[filled])) for each in sums) / squares
    chance = np.count_nonzero(filled) / len(index)
    return float(count.var() / count.mean()), (streams - chance) / (1.0 - chance)


def _driven(law: Any, seeds: range) -> Array:
    """T and T_rot of the steady state under random kicks, in time, (replicas, 2, rows); the first half starts it."""
    found = []
    for seed in seeds:
        kicks = RandomKicks(STEP, power=POWER)
        gas = fluid(DRIVEN_DISKS, PHI, seed, law, melting=MELTING, forces=[kicks])
        rows: list[tuple[float, float]] = []

        def take(one: Measure, rows: list[tuple[float, float]] = rows) -> None:
            rows.append((one.temperature, one.rotational_temperature))

        gas.run(t_end=DRIVEN_END, series=60, series_callbacks=[take])
        found.append(np.array(rows).T)
    return np.array(found)


def _compare_cooling(
    result: Result, seeds: range, gases: list[CoolingSeries], homogeneous: list[Array]
) -> None:
    for what, first, last in (("T", 2, 2), ("T", 5, 5), ("theta", 1, 3)):
        frames, own = slice(first, last + 1), (first <= AT) & (last >= AT)
        simulated = [getattr(gas, what)[:, frames].mean(axis=1) for gas in gases]
        each = [(one[0] if what == "T" else one[1] / one[0])[:, own].mean(axis=1) for one in homogeneous]
        text = f"after {first}" if first == last else f"mean of {first} to {last}"
        compare(
            result, f"{what} of Walton's law over that of IFR, {COIN}, {text} collisions per disk",
            ratio(simulated[1], simulated[0]), Mean.of(ratio(each[1], each[0])), disks=DISKS, seeds=seeds,
            systematic=0.01, widest=0.045, source="DSMC of both laws",
            why="1 %: disks that meet again, which DSMC leaves out, change both laws alike",
        )  # fmt: skip


def _steady(law: IFRLaw | Walton) -> tuple[float, float]:
    """T and T_rot of the driven gas by theory."""
    driving = driven_gas.Driving.of([{"kind": "random_kicks", "step": STEP, "power": POWER}], 1.0, 0.125)
    assert driving is not None
    steady = driven_gas.steady_state(law, 1.0, 0.5, 2.0, PHI, driving)
    assert steady is not None
    return steady


def _compare_driven(result: Result, seeds: range, laws: Laws, driven: list[Array]) -> None:
    means = [_means(each) for each in driven]
    expected = [_steady(law) for law in laws]
    for what, at in (("T", 0), ("theta = T_rot / T", 1)):
        right = [one[0] if at == 0 else one[1] / one[0] for one in expected]
        compare(
            result, f"{what} of Walton's law over that of IFR, {COIN}, driven by random kicks",
            ratio(means[1][at], means[0][at]), right[1] / right[0], disks=DRIVEN_DISKS, seeds=seeds, systematic=0.01,
            widest=0.05, source="closed kinetic theory of both laws",
            why="1 %: velocities and spins are not quite Gaussian, of both laws alike",
        )  # fmt: skip


def _means(driven: Array) -> tuple[Array, Array]:
    """Means of T and of theta over the second half of each replica."""
    T, T_rot = driven[:, :, driven.shape[2] // 2 :].mean(axis=2).T
    return T, T_rot / T


def _table(result: Result, found: dict[str, FittedLaw], homogeneous: dict[str, list[Array]]) -> None:
    lines: list[tuple[str | float, ...]] = []
    for name, one in found.items():
        walton = one.laws[1]
        assert isinstance(walton, Walton)
        most = float(np.abs(one.difference[:, PSI[-1] >= FINE]).max())
        within = f"{walton.e_n:.3f}, {walton.beta_0:.3f}, {walton.mu:.3f}"
        cells: list[str | float] = [name, within, round(one.chi_square, 1), round(most, 2)]
        if name in homogeneous:
            T, T_rot = (np.array([each[i].mean(axis=0)[-1] for each in homogeneous[name]]) for i in (0, 1))
            theta = T_rot / T
            cells += [f"{each:.3f}" for each in theta]
            cells += [f"{100.0 * (each[1] / each[0] - 1.0):+.1f}" for each in (T, theta)]
        else:
            cells += ["left out by --quick"] * 4
        lines.append(tuple(cells))
    result.table(
        "What single impacts see of the difference, and what gases of DSMC do",
        ("coin", "e_n, beta_0, mu of Walton's law", f"chi2 of {2 * len(PSI)} angles of rebound by the difference alone",
         "largest difference of an angle (degrees)", f"theta, tau = {AT[-1]:g}, IFR", "the same, Walton",
         "T, Walton less IFR (%)", "theta, Walton less IFR (%)"),
        lines, f"Angles of incidence 4 to 72 degrees, errors of {ERROR} degrees. tau: collisions per disk. DSMC: "
        f"8 gases or more of {DISKS_OF_DSMC} disks for each law, from cold spins.",
    )  # fmt: skip


def _gas_table(result: Result, gases: list[CoolingSeries], driven: list[Array]) -> None:
    lines: list[tuple[str | float, ...]] = []
    for tau in (each for each in (5.0, 10.0, 20.0, 30.0, 50.0, END) if each <= gases[0].tau[-1]):
        at = round(tau)
        for text, what in (
            ("T / T(0)", "T"),
            ("theta", "theta"),
            ("scatter of numbers in cells", "clumping"),
            ("part of the energy in streams", "streaming"),
        ):
            both = [getattr(gas, what)[:, at] for gas in gases]
            lines.append((f"cooling, tau = {tau:g}: {text}", *_cells(both)))
    for text, at in (("T", 0), ("theta", 1)) if driven else ():
        lines.append((f"driven: {text}", *_cells([_means(each)[at] for each in driven])))
    result.table(
        f"{COIN}, simulated", ("quantity", "IFR", "Walton", "Walton less IFR (%)"), lines,
        f"Means and standard errors over seeds. Cooling: {DISKS} disks, packing fraction {PHI}, {CELLS} x {CELLS} "
        f"cells. Driven: {DRIVEN_DISKS} disks, kicks of the power {POWER} each {STEP}; mass and diameter are 1.",
    )  # fmt: skip


def _cells(both: list[Array]) -> tuple[str, ...]:
    off = Mean.of(ratio(both[1], both[0]))
    return (
        *(f"{each.value:.4g} +- {each.error:.1g}" for each in map(Mean.of, both)),
        f"{100.0 * (off.value - 1.0):+.1f} +- {100.0 * off.error:.1f}",
    )


def _band(axes: Any, x: Array, values: Array, colour: str, label: str | None = None, **look: Any) -> None:
    """Mean over replicas, the first axis, with a band of its 95 % interval; markers by the colour."""
    mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))
    half = student_t(len(values)) * error
    axes.fill_between(x, mean - half, mean + half, color=colour, alpha=0.25, lw=0.0)
    axes.plot(x, mean, label=label, **some_marks(colour, 4 * KINDS.index(colour), **look))


def _picture(impacts: FittedLaw, gases: list[CoolingSeries], driven: list[Array]) -> Picture:
    figure, axes = style.panels(3, 2, width=3.2, height=2.8)
    _draw_impacts(axes[0], impacts)
    _draw_cooling(axes[1:4], impacts.laws, gases)
    _draw_clusters(axes[4], gases)
    _draw_driven(axes[5], impacts.laws, driven)
    titles = (
        "single impacts",
        "cooling",
        "cooling: spins",
        "cooling: ratio of the laws",
        "clusters",
        "driven by kicks",
    )
    for letter, title, one in zip("abcdef", titles, axes, strict=True):
        one.set_title(f"({letter}) {title}", loc="left", fontsize=9)
    caption = (
        f"{COIN} under the IFR law of Table II and under Walton's law fitted to the same impacts. (a) Single impacts: "
        "the difference of both laws, and the error of a measured angle. (b), (c) Cooling from cold spins; T contains "
        "streams. (d) The ratio of both at equal collisions per disk. (e) Scatter of the numbers in cells over their "
        f"mean, and energy in streams, in cells of ten diameters. (f) Driven by random kicks. Bands: {PERCENT} "
        f"intervals of means over {REPLICAS} seeds. Lines without markers: kinetic theory of a homogeneous gas."
    )
    return Picture("gas_laws", caption, figure)


def _draw_impacts(axes: Any, one: FittedLaw) -> None:
    axes.axhspan(-ERROR, ERROR, color=style.GREY, alpha=0.2, lw=0.0, label="error of a measurement")
    for i, colour in enumerate((style.GREEN, style.PURPLE)):
        axes.plot(FINE, one.difference[i], label=rf"$\delta_{i + 1}$", **some_marks(colour, 4 * i))
    axes.axvline(PSI[-1], color=style.GREY, ls=":", lw=0.9, label="last angle of the fit")
    axes.set(
        xlabel=r"angle of incidence $\psi$ (degrees)", ylabel="Walton less IFR (degrees)", xlim=(0.0, 85.0)
    )
    axes.legend(loc="lower left")


def _draw_cooling(axes: Any, laws: Laws, gases: list[CoolingSeries]) -> None:
    tau = gases[0].tau
    times = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 2000)])
    for name, law, gas in zip(NAMES, laws, gases, strict=True):
        _band(axes[0], tau, gas.T, LOOK[name], name)
        _band(axes[1], tau, gas.theta, LOOK[name], name)
        T, T_rot, counted = theory.cooling(law, 1.0, 0.5, 2.0, PHI, 1.0, 0.0, times)
        shown = counted <= min(60.0, tau[-1])
        drawn = dashes(LOOK[name], lw=0.9)
        axes[0].plot(counted[shown], T[shown], label=f"{name}, kinetic theory", **drawn)
        axes[1].plot(counted[shown], (T_rot / T)[shown], **drawn)
    for what, colour, label in (("T", style.GREEN, "$T$"), ("theta", style.PURPLE, r"$\theta$")):
        above, below = (getattr(gases[i], what)[:, 1:] for i in (1, 0))
        whole = above.mean(axis=0) / below.mean(axis=0)
        each = whole + (above - whole * below) / below.mean(axis=0)
        _band(axes[2], tau[1:], 100.0 * (each - 1.0), colour, label)
    axes[2].axhline(0.0, color=style.BLACK, lw=0.7)
    labels = ("$T / T(0)$", r"$\theta = T_\mathrm{rot} / T$", "Walton / IFR $-$ 1 (%)")
    for one, label, corner in zip(axes, labels, ("upper right", "upper right", "upper left"), strict=True):
        one.set(xlabel=r"collisions per disk $\tau$", ylabel=label, xlim=(0.0, tau[-1]))
        one.legend(loc=corner)
    axes[0].set(yscale="log")
    axes[1].set(ylim=(0.0, 0.78))


def _draw_clusters(axes: Any, gases: list[CoolingSeries]) -> None:
    right = axes.twinx()
    for name, gas in zip(NAMES, gases, strict=True):
        _band(axes, gas.tau, gas.clumping, LOOK[name], f"{name}, numbers in cells")
        _band(right, gas.tau, gas.streaming, LOOK[name], ls=":")
        axes.plot([], [], label=f"{name}, energy in streams (right)", **some_marks(LOOK[name], 0, ls=":"))
    axes.tick_params(right=False)
    axes.set(xlabel=r"collisions per disk $\tau$", xlim=(0.0, gases[0].tau[-1]), ylim=(0.0, 46.0))
    axes.set(ylabel=r"$\langle (N - \langle N \rangle)^2 \rangle / \langle N \rangle$, $N$ in a cell")
    right.set(ylabel="part of the energy in streams", ylim=(0.0, 1.5), yticks=(0.0, 0.25, 0.5, 0.75, 1.0))
    axes.legend(fontsize=7, loc="upper left")


def _draw_driven(axes: Any, laws: Laws, driven: list[Array]) -> None:
    if not driven:
        axes.text(0.5, 0.5, "left out by --quick", transform=axes.transAxes, ha="center")
        return
    time = np.linspace(0.0, DRIVEN_END, driven[0].shape[2])
    for name, law, one in zip(NAMES, laws, driven, strict=True):
        T, T_rot = _steady(law)
        _band(axes, time, one[:, 0], LOOK[name], f"{name}: $T$")
        _band(axes, time, one[:, 1] / one[:, 0], LOOK[name], rf"{name}: $\theta$", ls=":")
        for value in (T, T_rot / T):
            axes.axhline(value, **dashes(LOOK[name], lw=0.9))
    axes.set(xlabel="time (diameters / speed of a disk at $T = 1$)", ylabel=r"$T$ (units of $T(0)$), $\theta$",
             ylim=(0.0, 1.1), xlim=(0.0, DRIVEN_END))  # fmt: skip
    axes.legend(loc="center right")
