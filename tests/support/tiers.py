"""Plugin of pytest: which tests run without `--full`, in which order, and what they may cost."""

from __future__ import annotations

import re
import resource
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from support import own_folders

BEGIN = pytest.StashKey[float]()
START = time.monotonic()
"""When this process began, for `--minutes`."""
RESTARTS = re.compile("thread|precision|f32|profiled?_")
"""In names of tests that restart the runtime, with which kernels are lost: they come last in their files."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="run tests marked `full` too")
    parser.addoption("--rest", action="store_true", help="run only what a run without `--full` leaves out")
    parser.addoption(
        "--budget", type=float, metavar="SECONDS",
        help="fail if all tests take more CPU time, or one test more than a twentieth of it, at the speed of the "
        "reference machine",
    )  # fmt: skip
    parser.addoption(
        "--minutes",
        type=float,
        help="skip, and say so, tests that would begin after so long: for a slow machine",
    )
    parser.addoption(
        "--costs",
        action="store_true",
        help="write the CPU time of each file to tests/costs.txt: all of them with --full",
    )


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Costs(config))


def costs_of(config: pytest.Config) -> Path:
    """The file of CPU times: lines of seconds and the name of a file of tests."""
    return config.rootpath / "tests" / "costs.txt"


def stored_costs(config: pytest.Config) -> dict[str, float]:
    """CPU time [s] of each file of tests, by its name; none without the file of CPU times."""
    table = costs_of(config)
    if not table.exists():
        return {}
    return {name: float(seconds) for seconds, name in map(str.split, table.read_text().splitlines())}


def file_of(test: str) -> str:
    """Name of the file of a test, as in the file of CPU times."""
    return test.split("::")[0].removeprefix("tests/")


def beyond(items: list[pytest.Item]) -> Iterator[pytest.Item]:
    """Tests that need `--full`: those marked, but for parameters that `keep` names, or so many from first to last.

    UsageError if `keep` names none of the parameters.
    """
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
                for parameter in keep:
                    if not any(f"{name}[{parameter}]" == other.name for other in each):
                        raise pytest.UsageError(f"{path}: {name} has no parameter {parameter!r} to keep")
            if not kept:
                yield item


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what needs `--full`, unless the command names its file; begin with the files that take longest."""
    if config.getoption("--rest") or not config.getoption("--full"):
        named = {Path(word.split("::")[0]).resolve() for word in config.args if ".py" in word}
        out = set(beyond([item for item in items if item.path not in named]))
        if config.getoption("--rest"):
            out = set(items) - out
        config.hook.pytest_deselected(items=[item for item in items if item in out])
        items[:] = [item for item in items if item not in out]
    costs = stored_costs(config)
    place = {path: number for number, path in enumerate(dict.fromkeys(item.path for item in items))}
    items.sort(
        key=lambda item: (
            -costs.get(file_of(item.nodeid), 0.0),
            place[item.path],
            RESTARTS.search(item.name) is not None,
        )
    )


def cpu_time() -> float:
    """CPU time of this process and of children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[BEGIN] = cpu_time()
    minutes = item.config.getoption("--minutes")
    if minutes is not None and time.monotonic() - START > 60.0 * minutes:
        pytest.skip(f"this machine is too slow: not begun within --minutes {minutes:g}")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    if call.when == "teardown" and BEGIN in item.stash:
        item.user_properties.append(("cpu", cpu_time() - item.stash[BEGIN]))


class Speed:
    """Speed of this machine beside that of the reference, where STEPS steps of `measure` take REFERENCE seconds.

    Machines that run the tests differ by a factor of 3, and one changes with its neighbours' load: the CPU time of the
    default run of then and that of such a loop by the same factor (1,229 and 3,414 s; .66 and 1.8 s for 1e7 steps).
    So it runs between tests, while the workers do.
    """

    REFERENCE = 0.003
    STEPS = 100_000

    def __init__(self) -> None:
        self.seconds = list[float]()

    def measure(self) -> None:
        total, begin = 0, time.process_time()
        for number in range(self.STEPS):
            total += number
        self.seconds.append(time.process_time() - begin)

    def at_reference(self, seconds: float) -> float:
        """CPU time on the reference machine of work that took so many seconds on this one."""
        return seconds * self.REFERENCE / statistics.median(self.seconds)


class Costs:
    """CPU time of tests and number of kernels that were compiled: reported at the end, and limited by `--budget`."""

    EVERY = 20
    """Tests from one measurement of the machine's speed to the next."""

    def __init__(self, config: pytest.Config) -> None:
        self.budget: float | None = config.getoption("--budget")
        self.table: Path | None = costs_of(config) if config.getoption("--costs") else None
        self.before = self.kernels()
        self.speed = Speed()
        self.speed.measure()
        self.tests = dict[str, float]()

    @staticmethod
    def kernels() -> int:
        """Number of compiled kernels that are stored."""
        return sum(1 for _ in own_folders.kernels().rglob("*.tic"))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.tests.update(
            (report.nodeid, seconds) for name, seconds in report.user_properties if name == "cpu"
        )
        if report.when == "teardown" and len(self.tests) % self.EVERY == 0:
            self.speed.measure()

    def excess(self) -> list[str]:
        """Lines on what is above the budget."""
        if self.budget is None:
            return []
        costs = {"all tests": cpu_time(), **self.tests}
        return [
            f"{name}: {self.speed.at_reference(taken):.1f} s"
            for name, taken in costs.items()
            if self.speed.at_reference(taken) > self.budget / (1.0 if name == "all tests" else 20.0)
        ]

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.excess():
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        new = self.kernels() - self.before
        taken = cpu_time()
        terminalreporter.write_line(
            f"CPU time {taken:.0f} s ({self.speed.at_reference(taken):.0f} s at the speed of the reference machine), "
            f"{new} kernels compiled and stored"
        )
        for line in self.excess():
            terminalreporter.write_line(f"above the budget of CPU time (mark it `full`?): {line}", red=True)
        if self.table is not None:
            files = dict[str, float]()
            for test, taken in self.tests.items():
                files[file_of(test)] = files.get(file_of(test), 0.0) + taken
            lines = [
                f"{taken:7.1f} {file}\n" for file, taken in sorted(files.items(), key=lambda each: -each[1])
            ]
            self.table.write_text("".join(lines))
