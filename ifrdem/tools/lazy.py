"""Packages whose names are imported when they are first used, with spelling help for an unknown name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import lazy_loader


def attach(name: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """The `__getattr__`, `__dir__` and `__all__` of a package whose stub, `__init__.pyi`, lists its names."""
    load, listed, names = lazy_loader.attach_stub(name, file)

    def get(attribute: str) -> Any:
        if attribute not in names:
            from ..errors import nearest  # imported with the first mistake: `import ifrdem` is quick

            close = nearest(attribute, names)
            raise AttributeError(f"module {name!r} has no attribute {attribute!r}{close}", name=attribute)
        return load(attribute)

    return get, listed, names
