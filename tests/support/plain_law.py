"""The collision law as ordinary Python on floats: `kernels/laws/law.py` without declarations of the runtime.

The same bits as `ifrdem.kernels.laws.law.collide_pair`; serial codes are twice as fast by it, because declared
functions look at each argument.
"""

from __future__ import annotations

import importlib.util
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

from ifrdem.kernels.compiler import language
from ifrdem.kernels.laws import law


def _as_it_is(function: Any) -> Any:
    return function


def _undeclared(module: ModuleType) -> ModuleType:
    """Another copy of a module of kernels, whose functions are those of its source."""
    plain = SimpleNamespace(pyfunc=_as_it_is, func=_as_it_is, min=min, max=max, abs=abs)
    spec = importlib.util.spec_from_file_location(f"{module.__name__}_undeclared", module.__file__ or "")
    assert spec is not None
    assert spec.loader is not None
    copy = importlib.util.module_from_spec(spec)
    with mock.patch.object(language, "ti", plain):
        spec.loader.exec_module(copy)
    return copy


collide_pair = _undeclared(law).collide_pair
