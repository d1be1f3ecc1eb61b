"""Panels of the temperatures of species, with kinetic theory."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..analysis.result import Evaluation
from ..errors import InputError, option_name
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .series import AXES
from .style import KINDS, foreground, from_zero, grid, label, legend_above, plain, positive, some_marks


def temperatures(
    upper: Axes, lower: Axes, trajectory: Trajectory, evaluation: Evaluation, over: str | None = None
) -> None:  # fmt: skip
    """T of each species against collisions per disk, and ratios to the first one and theta below.

    Against time if that is what `over` says, or the file does not count collisions.
    """
    found = evaluation.result
    tau = None if over == "t" else found.collisions_per_disk
    if over == "tau" and tau is None:
        raise InputError(
            f"{option_name('--over', 'over =')} tau: {trajectory.path} does not count collisions; must be t"
        )
    x = found.time if tau is None else tau
    thetas: list[tuple[Array, dict[str, Any]]] = []
    names = [*map(plain, found.names)]
    for i, name in enumerate(names):
        style: dict[str, Any] = {"color": KINDS[i % len(KINDS)], "lw": 1.2}
        marked = some_marks(KINDS[i % len(KINDS)], i)
        T, T_rot = found.temperature[:, i], found.rotational_temperature[:, i]
        upper.plot(x, positive(T), label=f"$T$ of {name}", **style | marked)
        curves = [(T, T_rot, found.temperature[:, 0], "-")]
        if found.theory is not None:
            by_theory, rotational = (each[:, i] for each in found.theory)
            upper.plot(x, positive(by_theory), "--", **style)
            curves.append((by_theory, rotational, found.theory[0][:, 0], "--"))
        for one, spin, first, line in curves:
            shown = line == "-"
            with np.errstate(divide="ignore", invalid="ignore"):
                if i:
                    text = f"$T$ of {name} / $T$ of {names[0]}"
                    lower.plot(
                        x,
                        one / first,
                        label=text if shown else None,
                        **style | (marked if shown else {"ls": line}),
                    )
                if np.any(spin > 0.0):
                    kept = (
                        style
                        | {"lw": 0.8, "alpha": 0.7, "ls": line}
                        | (marked | {"ls": ":"} if shown else {})
                    )
                    text = rf"$\theta$ of {name}"
                    thetas.append((spin / one, {**kept, "label": text if shown else None}))
    for theta, kept in thetas:  # in the legend after all ratios
        lower.plot(x, theta, **kept)
    if found.theory is not None:
        upper.plot([], [], "--", color=foreground(upper), label="kinetic theory")
    T = found.temperature
    if np.all(T > 0.0) and T.max() > 10.0 * T.min():
        upper.set_yscale("log")
    upper.set_ylabel(label(trajectory, "temperature $T$", "energy"))
    lower.set_xlabel(label(trajectory, AXES["t"], "time") if tau is None else AXES["tau"])
    lower.set_ylabel("ratio")
    from_zero(lower)
    legend_above(upper)
    legend_above(lower)
    grid(upper, lower)
