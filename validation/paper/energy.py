"""Coefficients that can add energy: a map by simulation, against the inequalities of `ifrdem.model.laws.ifr`."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...model.laws.ifr import EnergyWarning, IFRLaw
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import pairs
from .equations import CLOSURES, Impact

QUESTION = "Does a collision add energy exactly where the inequalities of the law say so?"
REFERENCE = "inequalities of IFRLaw (its docstring derives them)"

E_N = 0.87
GAIN = 1e-12  # relative gain of energy that rounding cannot make
MARGIN = 1.03  # in mu: angles are sampled, so just outside of the set the gain may be missed
MIXED = (1.3, 1.0, 2.5)  # M, k_1, k_2 of a pair of a hoop and a body denser inside


@dataclass(frozen=True)
class Map:
    """A grid of laws, arrays (n,): e_t and mu, the largest gain that was seen, and what the inequalities say."""

    e_t: Array
    mu: Array
    gain: Array  # largest relative gain of energy over all angles
    admissible: NDArray[np.bool_]
    strict: NDArray[np.bool_]
    clearly_refused: NDArray[np.bool_]  # refused with mu smaller by MARGIN as well


def run(quick: bool) -> Result:
    result = Result()
    side, slopes = (15, 40) if quick else (61, 90)
    maps = {}
    for sticking, closure in CLOSURES.items():
        for text, M, k_1, k_2 in (("two disks", 1.0, 2.0, 2.0), ("M = 1.3, k = 1 and 2.5", *MIXED)):
            found = survey(sticking, side, slopes, M=M, k_1=k_1, k_2=k_2)
            _compare(result, f"{text}, {closure.text}", found)
            if k_1 == k_2:
                maps[sticking] = found
    result.pictures.append(_figure(maps))
    return result


def survey(sticking: str, side: int, slopes: int, *, M: float, k_1: float, k_2: float) -> Map:
    """Fly every law of a `side` x `side` grid at `slopes` ratios of slip to normal velocity."""
    grids = np.meshgrid(np.linspace(-1.0, 0.95, side), np.geomspace(0.02, 1.0, side))
    e_t, mu = (grid.reshape(-1) for grid in grids)
    # In units of mu (1 + e_n): closely spaced, and the corners of the law, where sticking ends (Eqs. 24 and 25).
    corners = [2.0, (1.0 + k_1 + M * (1.0 + k_2)) / (1.0 + M)]
    slope = np.concatenate([np.geomspace(0.05, 200.0, slopes), corners]) * (1.0 + E_N)
    slip = mu[:, None] * slope[None, :]
    c = Impact(np.arctan(slip), E_N, e_t[:, None], mu[:, None], M=M, k_1=k_1, k_2=k_2)
    got = pairs.fly(c, sticking, checked=False)
    gain = (got.energy_ratio - 1.0).reshape(slip.shape).max(axis=1)
    verdicts = [_verdict(a, b, sticking, M, k_1, k_2) for a, b in zip(e_t, mu, strict=True)]
    refused = [not _verdict(a, b / MARGIN, sticking, M, k_1, k_2)[0] for a, b in zip(e_t, mu, strict=True)]
    admissible, strict = np.array(verdicts).T
    return Map(e_t, mu, gain, admissible, strict, np.array(refused))


def _verdict(e_t: float, mu: float, sticking: str, M: float, k_1: float, k_2: float) -> tuple[bool, bool]:
    """The verdict on the law for a pair of disks: admissible, and strictly so."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyWarning)
        try:
            # k as small as can be: what it can add is then asked of this pair.
            law = IFRLaw(e_n=E_N, e_t=e_t, mu=mu, sticking=sticking, k=1e-9)  # type: ignore[arg-type]
        except InputError:
            return False, False
    verdict = law.admissibility(k_1, k_2, M, 1.0)
    return verdict.admissible, verdict.strict


def _compare(result: Result, text: str, found: Map) -> None:
    gains = found.gain > GAIN
    for words, laws, wrong in (
        ("admissible laws that gained energy", found.admissible, gains),
        ("laws refused by 3 % of mu or more that gained none", found.clearly_refused, ~gains),
    ):
        quantity, source = (
            f"{words}, of {laws.sum()}, {text}",
            "necessary and sufficient set, ifrdem/model/laws/ifr.py",
        )
        result.near(quantity, np.sum(wrong & laws), 0.0, 0.0, "a count", source)
        if not laws.sum() > 0.05 * len(gains):
            raise RuntimeError(f"{text}: the grid does not have both kinds of laws")


def _figure(maps: dict[str, Map]) -> Picture:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    figure, axes = style.panels(2, height=3.2)
    names = ("gains energy", "admissible by the whole budget", "strictly admissible")
    colours = (style.ORANGE, style.SKY, style.BLUE)
    for ax, (sticking, found), name in zip(axes, maps.items(), "ab", strict=True):
        gains = found.gain > GAIN
        side = round(np.sqrt(len(gains)))
        kind = np.where(gains, 0, np.where(found.strict, 2, 1)).reshape(side, side)
        e_t, mu = found.e_t.reshape(side, side), found.mu.reshape(side, side)
        ax.pcolormesh(e_t, mu, kind, cmap=ListedColormap(colours), vmin=-0.5, vmax=2.5, shading="nearest",
                      rasterized=True)  # fmt: skip
        edge = np.linspace(-1.0, 0.95, 150)
        ax.plot(edge, [_largest_mu(one, sticking) for one in edge], color=style.BLACK, lw=1.2)
        ax.set(xlabel=r"$e_t$", ylabel=r"$\mu$", yscale="log", xlim=(-1.0, 0.95), ylim=(0.02, 1.0))
        ax.set_title(f"({name}) {CLOSURES[sticking].text}", fontsize=9)
    handles = [Patch(color=colour, label=text) for colour, text in zip(colours, names, strict=True)]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8)
    caption = (
        "Two equal homogeneous disks, e_n = 0.87. Orange: some simulated collision gained energy; blue: none did "
        "(dark: not even its tangential impulses alone could). Line: the inequalities of the law."
    )
    return Picture("energy-map", caption, figure)


def _largest_mu(e_t: float, sticking: str) -> float:
    """Largest admissible mu for two equal disks, by bisection of the inequalities; NaN where all below 1 are."""
    from scipy.optimize import bisect

    def sign(log_mu: float) -> float:
        return 1.0 if _verdict(e_t, math.exp(log_mu), sticking, 1.0, 2.0, 2.0)[0] else -1.0

    return math.exp(bisect(sign, math.log(1e-6), 0.0, xtol=1e-6)) if sign(0.0) < 0.0 else math.nan
