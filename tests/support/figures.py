"""Texts and curves of a figure."""

from __future__ import annotations

import matplotlib.text
from matplotlib.figure import Figure


def texts(figure: Figure) -> str:
    """All texts of a figure, line by line."""
    return "\n".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))
