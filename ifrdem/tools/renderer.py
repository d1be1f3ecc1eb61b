"""Access of lower layers to the plots, a higher layer.

Apart from `notebook.py`, which imports NumPy: `ifrdem/__init__.py` sets the access, and its import is quick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_load: Callable[[], Any] | None = None


def set_renderer(load: Callable[[], Any]) -> None:
    """Set the function that imports and returns the module of the plots that draws objects."""
    global _load
    _load = load


def plots() -> Any:
    """The module of the plots that draws objects."""
    assert _load is not None  # `ifrdem/__init__.py` has run before any of its modules
    return _load()
