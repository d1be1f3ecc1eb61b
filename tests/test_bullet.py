"""PyBullet is optional, and its absence is explained."""

from __future__ import annotations

import importlib.util
import sys

import pytest

from ifrdem import bullet
from ifrdem.errors import InputError


@pytest.mark.parametrize(
    ("python", "advice"),
    [((3, 11), r"pip install 'ifrdem\[bullet\]'"), ((3, 12), "no wheel for Python 3.12")],
)
def test_absent_pybullet_is_explained(
    python: tuple[int, int], advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    monkeypatch.setattr(sys, "version_info", (*python, 0, "final", 0))
    with pytest.raises(InputError, match=advice):
        bullet.load()
    assert bullet.describe() == bullet.absence()


@pytest.mark.skipif(bullet.absence() is not None, reason="PyBullet is not installed")
def test_present_pybullet_is_loaded_and_named() -> None:
    assert hasattr(bullet.load(), "GEOM_CYLINDER")
    assert bullet.describe().startswith("PyBullet 3.")
