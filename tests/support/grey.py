"""Difference of the series of a picture without colours, measured on pixels."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray


def lightness(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """L* of colours in sRGB, 0 to 1: of black 0, of white 100 (CIE 1976, IEC 61966-2-1)."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    Y = linear @ (0.2126, 0.7152, 0.0722)
    return np.where(Y > (6.0 / 29.0) ** 3, 116.0 * np.cbrt(Y) - 16.0, Y * 24389.0 / 27.0)


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
