"""Fixtures that all tests share."""

from __future__ import annotations

import pytest

from ifrdem import backend

CUDA = any(device.arch == "cuda" for device in backend.available())


@pytest.fixture(
    params=[
        "cpu",
        pytest.param("cuda", marks=pytest.mark.skipif(not CUDA, reason="no CUDA device on this machine")),
    ]
)
def arch(request: pytest.FixtureRequest) -> str:
    """Every device of this machine that the engine runs on."""
    return str(request.param)
