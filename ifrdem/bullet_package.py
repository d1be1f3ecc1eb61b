"""PyBullet, the outside witness: an optional package, and what to do where it is absent."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from importlib.metadata import version
from types import ModuleType

from .errors import InputError

LAST_PYTHON = (3, 11)  # PyBullet publishes wheels for Python 3.9 to 3.11


def absence() -> str | None:
    """Why PyBullet cannot be used here, and what to do about it; None if it can.

    Examples
    --------
    >>> from ifrdem import bullet
    >>> bullet.absence() is None or 'pybullet' in bullet.absence()
    True
    """
    if importlib.util.find_spec("pybullet") is not None:
        return None
    here = sys.version_info[:2]
    if here > LAST_PYTHON:
        return (
            f"not installed, and PyBullet has no wheel for Python {here[0]}.{here[1]} (only up to 3.11): "
            "use Python 3.11 for comparisons with it; everything else works without"
        )
    return "not installed: `pip install 'ifrdem[bullet]'` adds it; everything else works without"


def describe() -> str:
    """PyBullet's version, or why it is absent.

    Examples
    --------
    >>> from ifrdem import bullet
    >>> isinstance(bullet.describe(), str)
    True
    """
    return absence() or f"PyBullet {version('pybullet')}"


def load() -> ModuleType:
    """Import PyBullet.

    Raises
    ------
    InputError
        If it is absent, with what to do. It is never compiled or installed on the way.

    Examples
    --------
    >>> from ifrdem import bullet
    >>> import pybullet
    >>> bullet.load() is pybullet
    True
    """
    reason = absence()
    if reason is not None:
        raise InputError(f"pybullet: {reason}")
    return importlib.import_module("pybullet")
