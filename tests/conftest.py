"""Fixtures that all tests share."""

from __future__ import annotations

import signal

import pytest

from ifrdem import backend

# A shell starts background jobs deaf to SIGINT, and children inherit that; tests interrupt some of theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)

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
