"""Style of the report's figures."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np

from ...tools.colours import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Where Matplotlib's own STIX fonts are missing, DejaVu takes their place: not worth a line for each text.
logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
BLACK, GREY = "#000000", "#777777"

RC: Any = {
    "font.size": 9.0,
    "mathtext.fontset": "stix",
    "font.family": ["STIXGeneral", "DejaVu Serif"],
    "axes.grid": False,
    "axes.linewidth": 0.7,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "path",  # the report needs no fonts
    "savefig.dpi": 200,
}
"""Settings of matplotlib while figures are drawn and saved."""


def panels(
    columns: int = 1, rows: int = 1, *, width: float = 3.6, height: float = 2.9
) -> tuple[Figure, list[Axes]]:
    """An empty figure, and its axes row by row; `width` and `height` of each in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * width, rows * height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def points(axes: Axes, x: Any, y: Any, colour: str, label: str | None = None, marker: str = "o") -> None:
    """Simulated values: open markers, so that the line shows through."""
    axes.plot(x, y, marker, mfc="none", mec=colour, mew=0.9, color=colour, label=label, ls="none", zorder=3)


def errorbars(
    axes: Axes, x: Any, values: Any, colour: str, label: str | None = None, marker: str = "o", **look: Any
) -> None:
    """Means over replicas, the first axis of the values, with their standard errors: open markers."""
    mean, error = np.mean(values, axis=0), np.std(values, axis=0, ddof=1) / np.sqrt(len(values))
    axes.errorbar(x, mean, error, fmt=marker, mfc="none", color=colour, label=label, **look)


def titles(*panels: Axes) -> None:
    """Name panels a, b, ... above their upper left corners."""
    for axes, name in zip(panels, "abcd", strict=False):
        axes.set_title(name, loc="left", weight="bold", fontsize=9)


def letters(*panels: Axes) -> None:
    """Name panels (a), (b), ... in their upper left corners."""
    for axes, name in zip(panels, "abcdef", strict=False):
        axes.annotate(f"({name})", (0.0, 1.0), (4, -4), xycoords="axes fraction", textcoords="offset points", va="top",
                      weight="bold")  # fmt: skip
