"""The picture of an impact scan: tan(delta_2) against tan(psi), simulated and by the law."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import bisect

from ..errors import InputError
from ..initial import impact_scan as scan
from ..model.laws.collision import collide
from ..model.laws.ifr import IFRLaw, Regime
from ..model.state import Disks
from ..tools.checked import Array, validated
from ..trajectory.reader import Trajectory
from .run import PicturePath, Run, save
from .style import RATIO, ROTATION, TRANSLATION, grid, legend, marks, plain


@validated
def impact_scan(run: Run, path_png: PicturePath = None) -> Figure:
    """Draw the disks that were hit: the tangent of their angle from the line of centres against that of the impact.

    As `run.cooling`, of a case with start.positions = "impact_scan", with positions and velocities. Points are the
    velocities of the last frame, seen from the line of centres that the first frame leads to; the line is the law,
    `ifrdem.collide`. Below, their difference. InputError also for fewer than two frames, or a pair that has not
    collided exactly once.

    Examples
    --------
    >>> from ifrdem import plots
    >>> figure = plots.impact_scan("impact_scan.h5")  # doctest: +SKIP
    """
    with contextlib.nullcontext(run) if isinstance(run, Trajectory) else Trajectory(run) as trajectory:
        law, disks = _law(trajectory), trajectory.disks
        tan_psi, tan_delta = measured(trajectory)
        name = trajectory.parameters.get("name", trajectory.path.stem)
    figure = Figure(figsize=(8.0, 7.0), dpi=200, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    fine = np.linspace(tan_psi.min(), tan_psi.max(), 2000)
    by_law, sticking = predicted(law, disks, fine)
    upper.plot(fine, by_law, "-", color=RATIO, lw=1.0, label="the law", zorder=1)
    _, stuck = predicted(law, disks, tan_psi)
    for chosen, colour, label in (
        (stuck, TRANSLATION, "simulated, sticking"),
        (~stuck, ROTATION, "simulated, sliding"),
    ):
        upper.plot(tan_psi[chosen], tan_delta[chosen], ms=4, label=label, zorder=2, **marks(colour))
    changes = np.flatnonzero(sticking[1:] != sticking[:-1])
    for at in (_change(law, disks, fine[i], fine[i + 1]) for i in changes):
        name_of = rf"sticking and sliding meet, $\tan\psi$ = {at:.4g}"
        upper.axvline(at, ls=":", lw=1.0, color=RATIO, label=name_of)
        lower.axvline(at, ls=":", lw=1.0, color=RATIO)
    off = tan_delta - predicted(law, disks, tan_psi)[0]
    lower.plot(tan_psi, off, ".", ms=4, color=RATIO)
    upper.set_ylabel(r"$\tan\delta_2$ of the disk that was hit")
    lower.set_ylabel("simulated $-$ law")
    lower.set_xlabel(r"$\tan\psi$, $\psi$: angle of impact from the line of centres")
    grid(upper, lower)
    legend(upper)
    upper.set_title(
        f"{plain(str(name))}: {len(tan_psi)} impacts, $e_n$ = {law.e_n:g}, $e_t$ = {law.e_t:g}, $\\mu$ = {law.mu:g}; "
        f"largest deviation {np.abs(off).max():.1g}"
    )
    if path_png is not None:
        save(figure, Path(path_png))
    return figure


def measured(trajectory: Trajectory) -> tuple[Array, Array]:
    """tan(psi) and tan(delta_2) of each pair of a scan, shape (n,)."""
    if len(trajectory) < 2:
        raise InputError(f"{trajectory.path}: must have two frames or more, before and after the impacts")
    first, last = trajectory[0], trajectory[-1]
    once = last.collisions == 1
    if not once.all():
        i = int(np.argmin(once))
        raise InputError(
            f"{trajectory.path}: disk {i} has collided {last.collisions[i]} times at t = {last.time:.6g}: once is "
            "needed for an impact scan"
        )

    def pairs(values: Array) -> Array:
        return np.swapaxes(values.reshape(2, -1, 2), 0, 1)

    sigma = trajectory.disks.radius.reshape(2, -1).sum(axis=0)
    before, after = pairs(first.velocity), pairs(last.velocity)
    normal = scan.line_of_centres(pairs(first.position), before, sigma)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)

    def tangent_of(velocity: Array) -> Array:
        found: Array = np.sum(velocity * tangent, axis=1) / np.sum(velocity * normal, axis=1)
        return found

    return tangent_of(before[:, 0]), tangent_of(after[:, 1])


def predicted(law: IFRLaw, disks: Disks, tan_psi: Array) -> tuple[Array, NDArray[np.bool_]]:
    """tan(delta_2) by the law, and whether the impact sticks; of the first disk that hits and the first that is hit."""
    pair = [0, disks.n // 2]
    velocity = np.zeros((len(tan_psi), 2, 2))
    velocity[:, 0, 0], velocity[:, 0, 1] = 1.0, tan_psi
    columns = disks.mass[pair], disks.radius[pair], disks.k[pair]
    after = collide(law, [1.0, 0.0], *columns, velocity, [0.0, 0.0])
    sticking = np.isin(after.regime, [Regime.STICKING, Regime.STICKING_ROLLING, Regime.STICKING_NONROLLING])
    return after.velocity[:, 1, 1] / after.velocity[:, 1, 0], sticking


def _change(law: IFRLaw, disks: Disks, low: float, high: float) -> float:
    """Tangent of psi, between two, at which sticking turns into sliding, or back."""
    return float(bisect(lambda at: predicted(law, disks, np.array([at]))[1][0] - 0.5, low, high, xtol=1e-15))


def _law(trajectory: Trajectory) -> IFRLaw:
    disks = trajectory.disks
    a, b = int(disks.material[0]), int(disks.material[disks.n // 2])
    law = "custom" if trajectory.has_custom_laws else trajectory.laws[a][b]
    if not isinstance(law, IFRLaw):
        raise InputError(f"{trajectory.path}: law of materials {a} and {b} is {law}: must be an IFRLaw")
    return law
