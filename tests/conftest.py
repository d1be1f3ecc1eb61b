"""Fixtures that all tests share; how their kernels are compiled. Which tests run: `support/tiers.py`."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from support import own_folders  # isort: skip  # noqa: F401 (before matplotlib and Taichi)

import pytest
from hypothesis import HealthCheck, Phase, settings
from matplotlib.figure import Figure
from support import cases, gases

import ifrdem
from ifrdem.kernels.compiler import runtime
from ifrdem.plots import run
from ifrdem.simulation import backend

pytest_plugins = ["support.tiers"]

# Python looks for cycles among its objects each 700 new ones: with those of thousands of tests and of compiled kernels
# a tenth of all time, a third of the time to rewrite assertions.
gc.set_threshold(50_000, 20, 20)

# A shell starts background jobs deaf to SIGINT, and children inherit that; tests interrupt some of theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Kernels without the optimiser, here and in processes that tests start: the same bits, half the time to compile.
OPTIMIZATION = ("TI_ADVANCED_OPTIMIZATION", "QD_ADVANCED_OPTIMIZATION")
os.environ.update(dict.fromkeys(OPTIMIZATION, "0"))

CUDA = any(device.name == "cuda" for device in backend.available())
# Examples of drawn tests are the same in each run, however long one takes; fixtures are shared among them.
for profile in ("default run", "full"):
    settings.register_profile(
        profile, derandomize=True, deadline=None, print_blob=False, suppress_health_check=list(HealthCheck),
        phases=(Phase.explicit, Phase.generate, Phase.shrink),
    )  # fmt: skip


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--runtime", choices=runtime.NAMES, help="what compiles the kernels, also in processes of tests"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Gases run on one thread unless a test says otherwise: kernels are compiled for a number of threads.

    With that of the cores, each test that asks for one thread would restart the runtime and compile its own kernels.
    """
    runtime.choose(config.getoption("--runtime"), "--runtime")
    settings.load_profile("full" if config.getoption("--full") else "default run")
    backend.limit_threads(1)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Give each test the usual Ctrl-C: modules of others that a test imports may take it (dask_jobqueue does)."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


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


@pytest.fixture(scope="module")
def base(request: pytest.FixtureRequest) -> str:
    """Text with which the cases of a module begin: its own CASE, or else the smallest case."""
    return getattr(request.module, "CASE", cases.SMALLEST)


@pytest.fixture
def case(base: str) -> cases.MakeCase:
    """Makes cases with other values: `case({"output.stress": True})`, `case("run.seed=3", text=...)`."""
    return lambda *changes, text=base: ifrdem.Case(**cases.changed(*changes, text=text))


@pytest.fixture
def problems(base: str) -> cases.Problems:
    """Lists all that is wrong with a case with other values: `problems("run.sede=3", folder=tmp_path)`."""
    return partial(cases.problems, text=base)


@pytest.fixture
def toml(base: str, tmp_path: Path) -> Path:
    """The file of the case of the module, alone in a folder and named as its run."""
    path = tmp_path / f"{cases.changed(text=base)['run'].get('name', 'case')}.toml"
    path.write_text(base, encoding="utf-8")
    return path


@pytest.fixture
def gas(request: pytest.FixtureRequest) -> gases.MakeGas:
    """Makes gases with the law of the module, its LAW, on a lattice: `gas(100, 0.3, forces=[...])`."""
    return partial(gases.gas_of, law=getattr(request.module, "LAW", gases.ROUGH))


@pytest.fixture
def written(case: cases.MakeCase, tmp_path: Path) -> cases.Written:
    """Runs cases with other values, and opens their trajectories: `written({"output.frames": 4})`."""
    return lambda *changes: case(*changes).run_to(
        tmp_path / f"run{len([*tmp_path.iterdir()])}.h5", picture=False
    )
