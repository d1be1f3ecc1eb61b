"""Difference of the series of a picture without colours, measured on pixels."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ifrdem.plots.style import lightness


def _drawn(axes: Axes, number: int) -> NDArray[np.float64]:
    """The entry of a series in the legend, as L* of pixels."""
    handles, _ = axes.get_legend_handles_labels()
    figure = Figure((1.2, 0.3), dpi=150)
    figure.legend([handles[number]], [""], loc="center", frameon=False, handlelength=6.0, numpoints=2)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return lightness(np.asarray(canvas.buffer_rgba())[..., :3] / 255.0)


def least_difference(*panels: Axes) -> float:
    """The smallest difference of two series of one panel [L*], averaged over the pixels that either inks.

    Infinite where no panel has two series in its legend.
    """
    least = np.inf
    for axes in panels:
        pictures = [_drawn(axes, i) for i in range(len(axes.get_legend_handles_labels()[1]))]
        for one, other in itertools.combinations(pictures, 2):
            inked = (one < 95.0) | (other < 95.0)
            least = min(least, float(np.abs(one - other)[inked].mean()))
    return least
