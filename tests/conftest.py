"""Fixtures that all tests share; which tests run without `--full`, in which order, and what they may cost."""

from __future__ import annotations

import os
import re
import resource
import signal
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from support import own_folders  # isort: skip (before matplotlib and Taichi)

import pytest
from hypothesis import HealthCheck, Phase, settings
from matplotlib.figure import Figure
from support import cases, gases

import ifrdem
from ifrdem.kernels.compiler import runtime
from ifrdem.plots import run
from ifrdem.simulation import backend

# A shell starts background jobs deaf to SIGINT, and children inherit that; tests interrupt some of theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Kernels without the optimiser, here and in processes that tests start: the same bits, half the time to compile.
OPTIMIZATION = ("TI_ADVANCED_OPTIMIZATION", "QD_ADVANCED_OPTIMIZATION")
os.environ.update(dict.fromkeys(OPTIMIZATION, "0"))

CUDA = any(device.name == "cuda" for device in backend.available())
COSTS = Path(__file__).with_name("costs.txt")
for name in (
    "default run",
    "full",
):  # examples: the same in each run, of fixtures that they share, however long
    settings.register_profile(
        name,
        derandomize=True,
        deadline=None,
        print_blob=False,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.explicit, Phase.generate, Phase.shrink),
    )


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--runtime", choices=runtime.NAMES, help="what compiles the kernels, also in processes of tests"
    )
    parser.addoption("--full", action="store_true", help="run tests marked `full` too")
    parser.addoption(
        "--budget", type=float, metavar="SECONDS",
        help="fail if all tests take more CPU time, or one test more than a twentieth of it",
    )  # fmt: skip
    parser.addoption("--costs", action="store_true", help=f"write the CPU time of each file to {COSTS.name}")


def pytest_configure(config: pytest.Config) -> None:
    runtime.choose(config.getoption("--runtime"), "--runtime")
    settings.load_profile("full" if config.getoption("--full") else "default run")
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Costs(config))


def beyond(items: list[pytest.Item]) -> Iterator[pytest.Item]:
    """Tests that need `--full`: those marked, but for parameters that `keep` names, or so many from first to last."""
    functions = dict[tuple[Path, str], list[pytest.Item]]()
    for item in items:
        if item.get_closest_marker("full") is not None:
            functions.setdefault((item.path, getattr(item, "originalname", item.name)), []).append(item)
    for (path, name), each in functions.items():
        for number, item in enumerate(each):
            mark = item.get_closest_marker("full")
            keep = mark.kwargs.get("keep", 0) if mark is not None else 0
            if isinstance(keep, int):
                kept = number in {round(k * (len(each) - 1) / max(keep - 1, 1)) for k in range(keep)}
            else:
                kept = item.name in [f"{name}[{parameter}]" for parameter in keep]
                if not any(f"{name}[{keep[0]}]" == other.name for other in each):
                    raise pytest.UsageError(f"{path}: {name} has no parameter {keep[0]!r} to keep")
            if not kept:
                yield item


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what needs `--full`, unless the command names its file; begin with the files that take longest.

    Tests of threads, precision and profiles come last in their files: they restart the runtime, kernels are lost.
    """
    if not config.getoption("--full"):
        named = {Path(word.split("::")[0]).resolve() for word in config.args if ".py" in word}
        out = {item for item in beyond(items) if item.path not in named}
        config.hook.pytest_deselected(items=[item for item in items if item in out])
        items[:] = [item for item in items if item not in out]
    costs = {name: float(seconds) for seconds, name in map(str.split, COSTS.read_text().splitlines())}
    files = list(dict.fromkeys(item.path for item in items))
    place = {path: number for number, path in enumerate(files)}
    name = {path: path.relative_to(COSTS.parent).as_posix() for path in files}
    items.sort(
        key=lambda item: (
            -costs.get(name[item.path], 0.0),
            place[item.path],
            re.search("thread|precision|f32|profiled?_", item.name) is not None,
        )
    )


def cpu_time() -> float:
    """CPU time of this process and of children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[BEGIN] = cpu_time()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    if call.when == "teardown" and BEGIN in item.stash:
        item.user_properties.append(("cpu", cpu_time() - item.stash[BEGIN]))


BEGIN = pytest.StashKey[float]()


class Costs:
    """CPU time of tests and number of kernels that were compiled: reported at the end, and limited by `--budget`."""

    def __init__(self, config: pytest.Config) -> None:
        self.budget: float | None = config.getoption("--budget")
        self.write: bool = config.getoption("--costs")
        self.before = self.kernels()
        self.tests = dict[str, float]()

    @staticmethod
    def kernels() -> int:
        return sum(1 for _ in own_folders.kernels().rglob("*.tic"))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.tests.update(
            (report.nodeid, seconds) for name, seconds in report.user_properties if name == "cpu"
        )

    def excess(self) -> list[str]:
        """What is above the budget."""
        if self.budget is None:
            return []
        found = [f"all tests: {cpu_time():.0f} s"] * (cpu_time() > self.budget)
        return found + [
            f"{test}: {taken:.1f} s" for test, taken in self.tests.items() if taken > self.budget / 20.0
        ]

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.excess():
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        new = self.kernels() - self.before
        terminalreporter.write_line(f"CPU time {cpu_time():.0f} s, {new} kernels compiled and stored")
        for line in self.excess():
            terminalreporter.write_line(f"above the budget of CPU time (mark it `full`?): {line}", red=True)
        if self.write:
            files = dict[str, float]()
            for test, taken in self.tests.items():
                file = test.split("::")[0].removeprefix("tests/")
                files[file] = files.get(file, 0.0) + taken
            lines = [
                f"{taken:7.1f} {file}\n" for file, taken in sorted(files.items(), key=lambda each: -each[1])
            ]
            COSTS.write_text("".join(lines))


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
    """What the cases of a module begin with: its own text CASE, or else the smallest case."""
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
