"""The optional packages of the extra `analysis`, imported where they are used."""

from __future__ import annotations

import importlib
from types import ModuleType

from ..errors import InputError

PACKAGES = {"freud": "freud-analysis", "finufft": "finufft"}
"""Name to import -> name to install."""


def load(name: str, purpose: str) -> ModuleType:
    """Import one of them.

    Raises
    ------
    InputError
        If it is absent: the message says what needs it and how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f'{purpose} needs the package {PACKAGES[name]}: `pip install "ifrdem[analysis]"` adds it ({error})'
        ) from None
