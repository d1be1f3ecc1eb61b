"""Notebook displays and pictures of objects, drawn by the plots (`tools/renderer.py`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..errors import InputError, nearest, shortened
from .checked import validated
from .renderer import plots

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def refuse_unknown(given: Mapping[str, Any], known: Sequence[str]) -> None:
    """Raise InputError if a picture gets an argument of another name, such as colour."""
    for name, value in given.items():
        text = f"there is no such argument{nearest(name, known)}; there are {', '.join(known)}"
        raise InputError(f"{name} = {shortened(value)}: {text}")


class NotebookRepr:
    """An object that a notebook shows as a small table and a thumbnail."""

    def _repr_html_(self) -> str:
        return str(plots().html(self))


class DisksRepr(NotebookRepr):
    """Disks at one time, which can be drawn."""

    @validated
    def plot(self, ax: Axes | None = None, *, color: str = "spin", **unknown: Any) -> Axes:
        """Draw the disks and walls to scale; of more than 1e5 disks a map of where they are.

        Parameters
        ----------
        ax : Axes, optional
            Axes of Matplotlib to draw into; by default those of a new figure of `pyplot`.
        color : str
            "spin", "speed", "direction" (of the velocity), "temperature" (m c^2 / 2 of each disk), "radius",
            "material", "collisions" or "none".

        Returns
        -------
        Axes

        Raises
        ------
        InputError
            If the colour is another word, or takes a field that is not stored; or an argument has another name.
        """
        refuse_unknown(unknown, ("ax", "color"))
        axes: Axes = plots().disks(self, ax, color)
        return axes


class ResultPlot:
    """Result of an analysis, which can be drawn."""

    def plot(self, ax: Any = None) -> Any:
        """Draw the result.

        Parameters
        ----------
        ax : Axes or two of them, optional
            Axes of Matplotlib to draw into, two for results of two panels (velocities and spins; density and
            temperature); by default those of a new figure of `pyplot`.

        Returns
        -------
        Axes, or an array of two

        Raises
        ------
        InputError
            If there are not as many axes as panels.
        """
        return plots().result(self, ax)
