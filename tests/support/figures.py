"""Texts and curves of a figure."""

from __future__ import annotations

import itertools

import matplotlib.text
from matplotlib.axes import Axes
from matplotlib.figure import Figure


def texts(figure: Figure) -> str:
    """All texts of a figure, line by line."""
    return "\n".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def assert_labels_are_apart(axes: Axes) -> None:
    """At least two labels along the horizontal axis, none within half a space of another."""
    figure = axes.figure
    figure.draw_without_rendering()
    axis, (low, high) = axes.xaxis, axes.get_xlim()
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    shown = [tick.label1 for tick in ticks if low <= tick.get_loc() <= high and tick.label1.get_text()]
    extents = sorted((label.get_window_extent() for label in shown), key=lambda each: each.x0)
    assert len(extents) >= 2
    gap = 0.02 * figure.dpi
    assert all(left.x1 + gap < right.x0 for left, right in itertools.pairwise(extents))
