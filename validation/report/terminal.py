"""Progress lines of `ifrdem validate`: case started, its table, running cases, and the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ...tools.progress import clock_face
from . import registry
from .registry import Verdict

Log = Callable[[str], None]
ENOUGH = 0.1
"""Part of the whole work that must be done before its pace says when the rest will be."""


class Pace:
    """Progress of the cases, `jobs` at a time, in the order in which they begin, and the time that is left.

    `log` takes the lines to show; `clock` gives seconds of real time, another one in tests.
    """

    def __init__(
        self,
        names: Sequence[str],
        *,
        quick: bool,
        jobs: int,
        log: Log,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._expected = {name: registry.seconds(name, quick) for name in names}
        self._todo = list(names)
        self._jobs, self._log, self._clock = jobs, log, clock
        self._running: dict[str, float] = {}
        self._took: dict[str, float] = {}

    def begun(self, name: str) -> None:
        """Print which case starts."""
        self._todo.remove(name)
        self._running[name] = self._clock()
        number = len(self._expected) - len(self._todo)
        self._log(f"[{number}/{len(self._expected)}] {name}: {registry.load(name).QUESTION}")

    def ended(self, outcome: Verdict) -> None:
        """Print the table of a finished case."""
        self._took[outcome.name] = self.seconds(outcome.name)
        del self._running[outcome.name]
        self._log(table(outcome))

    def seconds(self, name: str) -> float:
        """Time since a running case started [s]."""
        return self._clock() - self._running[name]

    def waiting(self) -> None:
        """Print the running cases, and the estimated time left if there is one."""
        running = ", ".join(f"{name} ({clock_face(self.seconds(name))})" for name in self._running)
        left = self.seconds_left
        self._log(f"  in work: {running}" + ("" if left is None else f"; ETA {clock_face(left)}"))

    @property
    def seconds_left(self) -> float | None:
        """Estimated time left [s], from finished cases; None before a tenth of the work is done."""
        done = sum(self._expected[name] for name in self._took)
        if done < ENOUGH * sum(self._expected.values()):
            return None
        pace = sum(self._took.values()) / done
        left = [max(0.0, pace * self._expected[name] - self.seconds(name)) for name in self._running]
        left += [0.0] * (self._jobs - len(left))
        for name in self._todo:
            left.sort()
            left[0] += pace * self._expected[name]
        return max(left)


def number(value: float | None) -> str:
    """A number as the tables show it."""
    if value is None:
        return ""
    return f"{value:.6g}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:.2e}"


def table(outcome: Verdict) -> str:
    """The rows of a case, as the terminal shows them."""
    lines = []
    for row in outcome.result.rows:
        mark = "ok  " if row.passed else "FAIL"
        printed = "" if row.printed is None else f"  (printed {number(row.printed)})"
        right = f"{number(row.expected)} +- {number(row.tolerance)}"
        if row.least:
            right = f"at least {number(row.expected)}"
        lines.append(
            f"  {mark} {row.quantity}: {number(row.measured)}, expected {right}{printed}  [{row.source}]"
        )
        if not row.passed:
            lines.append(f"       off by {number(abs(row.measured - row.expected))}; tolerance: {row.reason}")
        if row.blunt and row.sampling is not None:
            widest = number(row.sampling.widest)
            lines.append(f"       wider than {widest}: it says nothing; more replicas are needed")
    if outcome.error:
        lines.append(f"  FAIL {outcome.error}")
        lines += [f"       {line}" for line in outcome.details.splitlines()]
    if outcome.skipped:
        lines.append(f"  SKIP {outcome.skipped}")
    lines.append(f"  {outcome.name} {outcome.status} in {outcome.seconds:.1f} s")
    return "\n".join(lines)


def closing(outcomes: Sequence[Verdict], place: Path, seconds: float, status: int) -> str:
    """Closing lines: rows, failures, place of the report."""
    rows = sum(len(each.result.rows) for each in outcomes)
    failed = sum(len(each.failures) for each in outcomes)
    lines = [f"{rows} rows in {seconds:.1f} s: {rows - failed} passed, {failed} failed"]
    for word in ("failed", "skipped"):
        some = [each.name for each in outcomes if each.status == word]
        if some:
            lines.append(f"cases {word}: {', '.join(some)}")
    lines.append(f"report: {place / 'report.html'}" + ("" if status == 0 else "  (not everything passed)"))
    return "\n".join(lines)
