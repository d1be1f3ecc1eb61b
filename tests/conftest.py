"""Fixtures that all tests share; how their kernels are compiled. Which tests run: `support/tiers.py`."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator

from support import own_folders  # isort: skip  # noqa: F401 (before matplotlib and Taichi)

import pytest
from matplotlib.figure import Figure

from ifrdem.kernels.compiler import runtime
from ifrdem.plots import run
from ifrdem.simulation import backend

pytest_plugins = ["support.tiers"]

# A shell starts background jobs deaf to SIGINT, and children inherit that; tests interrupt some of theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Kernels without the optimiser, here and in processes that tests start: the same bits, half the time to compile.
OPTIMIZATION = ("TI_ADVANCED_OPTIMIZATION", "QD_ADVANCED_OPTIMIZATION")
os.environ.update(dict.fromkeys(OPTIMIZATION, "0"))

CUDA = any(device.name == "cuda" for device in backend.available())


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--runtime", choices=runtime.NAMES, help="what compiles the kernels, also in processes of tests"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Gases run on one thread unless a test says otherwise: kernels are compiled for a number of threads.

    With that of the cores, each test that asks for one thread would restart the runtime and compile its own kernels.
    """
    runtime.choose(config.getoption("--runtime"), "--runtime")
    backend.limit_threads(1)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish() -> None:
    """Have the runtime store the kernels that this process compiled, before they are counted."""
    backend.stop()


@pytest.fixture(
    params=[
        "cpu",
        pytest.param("cuda", marks=pytest.mark.skipif(not CUDA, reason="no CUDA device on this machine")),
    ]
)
def device(request: pytest.FixtureRequest) -> str:
    """Every device of this machine that the engine runs on."""
    return str(request.param)


@pytest.fixture(autouse=True, scope="module")
def compiler(request: pytest.FixtureRequest) -> Iterator[None]:
    """With `--full`, files marked `optimised` run what users run; all others have one runtime, with its kernels."""
    if request.node.get_closest_marker("optimised") is None or not request.config.getoption("--full"):
        yield
        return
    backend.stop()
    os.environ.update(dict.fromkeys(OPTIMIZATION, "1"))
    yield
    backend.stop()
    os.environ.update(dict.fromkeys(OPTIMIZATION, "0"))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Collects the figures instead of rendering them, which takes a second each."""
    figures: list[Figure] = []
    monkeypatch.setattr(run, "save", lambda figure, path: figures.append(figure))
    return figures


@pytest.fixture(autouse=True)
def figures() -> Iterator[None]:
    """Close figures of pyplot after each test: it warns of more than twenty, and warnings are errors."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
