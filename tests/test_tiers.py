"""The default run leaves out what is marked `full`, and says what it costs (`support/tiers.py`)."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import tiers

pytest_plugins = ["pytester"]

MARKED = """
    import pytest

    def test_plain(): pass

    @pytest.mark.full
    def test_dear(): pass

    @pytest.mark.full(keep=2)
    @pytest.mark.parametrize("n", range(5))
    def test_of_many(n): pass

    @pytest.mark.full(keep=("red", "two-blue"))
    @pytest.mark.parametrize(("n", "colour"), [(1, "red"), (1, "blue"), (2, "blue")], ids=["red", "blue", "two-blue"])
    def test_named(n, colour): pass
"""
DEFAULT = {"test_plain", "test_of_many[0]", "test_of_many[4]", "test_named[red]", "test_named[two-blue]"}
DEAR = {"test_dear", "test_of_many[1]", "test_of_many[2]", "test_of_many[3]", "test_named[blue]"}
OPTIONS = ("-p", "support.tiers", "-p", "no:cacheprovider", "-p", "no:xdist")


@pytest.fixture
def suite(pytester: pytest.Pytester) -> pytest.Pytester:
    """A suite in a folder of its own, with the marker."""
    pytester.makeini("[pytest]\nmarkers = full\naddopts = --strict-markers\n")
    pytester.makepyfile(test_some=MARKED)
    return pytester


def ran(suite: pytest.Pytester, *options: str) -> list[str]:
    """Names of the tests that ran, in order; they passed."""
    run = suite.inline_run(*OPTIONS, *options)
    passed, _, failed = run.listoutcomes()
    assert not failed
    return [report.nodeid.split("::")[1] for report in passed]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), DEFAULT),
        (("--full",), DEFAULT | DEAR),
        (("--full", "-m", "full"), (DEFAULT | DEAR) - {"test_plain"}),
        (("--full", "--rest"), DEAR),
        (("test_some.py",), DEFAULT | DEAR),
        (("test_some.py::test_dear",), {"test_dear"}),
        (("test_some.py::test_named[blue]",), {"test_named[blue]"}),
        (("-k", "test_of_many and 4"), {"test_of_many[4]"}),
        (("-k", "test_of_many and 3"), set()),
    ],
)
def test_a_run_takes_what_is_not_marked_kept_or_named(
    suite: pytest.Pytester, options: tuple[str, ...], expected: set[str]
) -> None:
    assert set(ran(suite, *options)) == expected


def test_one_parameter_to_keep_is_the_first(suite: pytest.Pytester) -> None:
    suite.makepyfile(test_some=MARKED.replace("keep=2", "keep=1"))
    assert set(ran(suite, "-k", "of_many")) == {"test_of_many[0]"}


@pytest.mark.parametrize("wrong", ['("rad", "two-blue")', '("red", "blue-two")'])
def test_a_parameter_to_keep_that_does_not_exist_is_an_error(suite: pytest.Pytester, wrong: str) -> None:
    suite.makepyfile(test_some=MARKED.replace('("red", "two-blue")', wrong))
    run = suite.runpytest_inprocess(*OPTIONS)
    assert run.ret == pytest.ExitCode.USAGE_ERROR
    name = "rad" if "rad" in wrong else "blue-two"
    run.stderr.fnmatch_lines([f"*test_some.py: test_named has no parameter '{name}' to keep"])


def test_files_run_in_the_order_of_their_costs_and_restarts_are_last_in_a_file(
    suite: pytest.Pytester,
) -> None:
    text = "def test_threads(): pass\ndef test_{0}(): pass\n"
    suite.makepyfile(**{f"tests/{name}": text.format(name) for name in ("test_a", "test_b", "test_c")})
    suite.path.joinpath("test_some.py").unlink()
    suite.path.joinpath("tests/costs.txt").write_text(
        "   12.5 test_c.py\n    3.0 test_b.py\n    2.0 gone.py\n"
    )
    assert ran(suite)[::2] == ["test_test_c", "test_test_b", "test_test_a"]
    assert set(ran(suite)[1::2]) == {"test_threads"}


BUSY = """
    import time

    def test_cheap(): pass

    def test_dear():
        end = time.process_time() + 0.4
        while time.process_time() < end: pass
"""


def test_a_budget_names_what_exceeds_it_and_the_run_fails(
    suite: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a process of its own, all of whose CPU time counts."""
    assert suite.inline_run(*OPTIONS, "--budget", "1e9").ret == pytest.ExitCode.OK
    suite.makepyfile(**{"tests/test_busy": BUSY})
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    run = suite.runpytest_subprocess(*OPTIONS, "tests", "--budget", "0.3", "--costs")
    run.assert_outcomes(passed=2)
    assert run.ret == pytest.ExitCode.TESTS_FAILED
    lines = [line.partition("(mark it `full`?): ")[2] for line in run.outlines if "above the budget" in line]
    assert lines[0].startswith("all tests: ")
    assert [line.rpartition(": ")[0] for line in lines[1:]] == ["tests/test_busy.py::test_dear"]
    seconds, name = (suite.path / "tests/costs.txt").read_text().split()
    assert (seconds, name) == ("0.4", "test_busy.py")


def test_a_budget_is_in_seconds_of_the_reference_machine() -> None:
    speed = tiers.Speed()
    speed.seconds = [2.0 * speed.REFERENCE, 2.0 * speed.REFERENCE, 90.0]
    assert speed.at_reference(3.0) == pytest.approx(1.5)
    speed.measure()
    assert 0.1 < speed.seconds[-1] / speed.REFERENCE < 10.0


def test_tests_that_would_begin_too_late_are_skipped_with_the_reason(
    suite: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = suite.runpytest_inprocess(*OPTIONS, "--minutes", "0", "-rs")
    run.assert_outcomes(skipped=len(DEFAULT))
    run.stdout.fnmatch_lines(["*too slow: not begun within --minutes 0"])
    assert set(ran(suite, "--minutes", "1e6")) == DEFAULT
