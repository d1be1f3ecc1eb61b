"""Labels of logarithmic axes of pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def few_labels(axes: Axes, which: Literal["x", "y"] = "x") -> None:
    """Label a logarithmic axis so that labels neither collide nor lack, however short it is.

    Matplotlib labels powers of ten and, below a decade or so, some of the ticks between them, without regard
    to their width. Below two decades the steps here are those of rulers: 1, 2, 5, or finer.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    first, last = axes.get_xlim() if which == "x" else axes.get_ylim()
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_minor_formatter(NullFormatter())
    if last / first >= 100.0:
        return
    # Two labels at least: any factor of 5 holds two of the first, any of 2.1 two of the others, and frames
    # that begin at 0 and are evenly spaced span a factor of 2, and the margins.
    steps = (1.0, 2.0, 5.0) if last / first >= 5.0 else (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _short(value)))


def _short(value: float) -> str:
    """0.05 and 2000, but 5 x 10^-6 in full."""
    if 1e-3 <= value < 1e4:
        return f"{value:.6g}"
    factor, exponent = f"{value:.5e}".split("e")
    return rf"${float(factor):g} \times 10^{{{int(exponent)}}}$"
