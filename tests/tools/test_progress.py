"""Progress display of a run."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import select
import struct
import sys
import termios
import types

import numpy as np
import pytest

import ifrdem
from ifrdem.tools import progress as showing
from ifrdem.tools.progress import NARROWEST, Progress


class Clock:
    """Real time that the test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_exactly_one_end_is_needed() -> None:
    with pytest.raises(ValueError, match="exactly one"):
        Progress(10, stream=io.StringIO())
    with pytest.raises(ValueError, match="exactly one"):
        Progress(10, t_end=1.0, collisions_per_disk=1.0, stream=io.StringIO())


def test_plain_line_has_share_time_collisions_per_disk_rate_and_eta() -> None:
    clock, out = Clock(), io.StringIO()
    # 100 disks with 10 collisions each: 500 collisions, since each belongs to two disks.
    progress = Progress(100, collisions_per_disk=10.0, stream=out, interval=5.0, clock=clock)
    progress(0.0, 0)
    clock.now += 10.0
    progress(0.25, 125)
    # 125 collisions in 10 s: a quarter done at 12.5 a second, the other 375 take 30 s.
    assert out.getvalue() == " 25.0 %  t = 0.25 s, 2.50 collisions per disk, 12.5 collisions/s, ETA 0:30\n"
    assert progress.fraction == 0.25
    assert progress.seconds_left == pytest.approx(30.0, rel=1e-12)  # a few operations' rounding
    assert progress.collisions_per_second == pytest.approx(12.5, rel=1e-12)


def test_eta_goes_by_simulated_time_if_that_ends_the_run() -> None:
    clock = Clock()
    progress = Progress(100, t_end=8.0, stream=io.StringIO(), clock=clock)
    progress(0.0, 0)
    clock.now += 3.0
    progress(2.0, 999)
    assert progress.fraction == 0.25
    assert progress.seconds_left == pytest.approx(9.0, rel=1e-12)  # 3 s for 2 of 8: 9 s for the other 6


def test_eta_of_a_gas_that_comes_to_rest_forgets_how_fast_it_began() -> None:
    clock = Clock()
    progress = Progress(100, t_end=100.0, stream=io.StringIO(), clock=clock)
    for second in range(161):  # 1 unit of time a second until t = 40, then a tenth of it
        progress(float(second) if second <= 40 else 40.0 + 0.1 * (second - 40), 10 * second)
        clock.now += 1.0
    # At t = 52: 48 units at a tenth a second. The mean pace since the start would say 148 s.
    assert progress.seconds_left == pytest.approx(480.0, rel=1e-12)


def test_compilation_before_the_first_call_counts_neither_for_rate_nor_eta() -> None:
    clock = Clock()
    progress = Progress(100, collisions_per_disk=10.0, stream=io.StringIO(), clock=clock)
    clock.now += 60.0  # compiles
    progress(0.1, 100)
    clock.now += 2.0
    progress(0.2, 300)
    assert progress.collisions_per_second == pytest.approx(100.0, rel=1e-12)  # 200 in 2 s
    assert progress.seconds_left == pytest.approx(2.0, rel=1e-12)  # the last 200


def test_plain_lines_come_at_the_interval_however_often_it_is_called() -> None:
    clock, out = Clock(), io.StringIO()
    with Progress(100, collisions_per_disk=100.0, stream=out, interval=5.0, clock=clock) as progress:
        for step in range(100):  # 25 s
            progress(0.01 * step, 10 * step)
            clock.now += 0.25
    lines = out.getvalue().splitlines()
    assert len(lines) == 5  # at 5, 10, 15, 20 s, and the last state when it ends
    assert "\r" not in out.getvalue()
    assert "19.80 collisions per disk" in lines[-1]


def test_nothing_is_shown_without_a_call() -> None:
    out = io.StringIO()
    with Progress(100, t_end=1.0, stream=out):
        pass
    assert out.getvalue() == ""


def test_no_time_left_is_shown_before_any_progress() -> None:
    progress = Progress(100, t_end=1.0, stream=io.StringIO(), clock=Clock())
    assert progress.seconds_left == float("inf")
    progress(0.0, 0)
    assert progress.seconds_left == float("inf")


def test_long_eta_shows_hours() -> None:
    clock, out = Clock(), io.StringIO()
    progress = Progress(100, t_end=1000.0, stream=out, clock=clock)
    progress(0.0, 0)
    clock.now += 10.0
    progress(1.0, 5)
    assert out.getvalue().endswith("ETA 2:46:30\n")  # 999 x 10 s


def test_terminal_gets_a_bar_that_is_redrawn_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    clock, out = Clock(), Terminal()
    with Progress(100, collisions_per_disk=10.0, stream=out, clock=clock) as progress:
        progress(0.0, 0)
        clock.now += 10.0
        progress(0.5, 250)
    shown = out.getvalue()
    assert "\r" in shown
    assert "compiling" in shown
    assert " 50.0 %" in shown
    assert "ETA 0:10, 25 collisions/s, 5.00 per disk, t = 0.5 s" in shown
    assert max(len(line) for line in shown.replace("\r", "\n").splitlines()) <= 80


@pytest.mark.parametrize("columns", [NARROWEST, 40, 50, 60, 66, 80, 120])
def test_time_left_and_rate_are_whole_on_every_terminal(
    monkeypatch: pytest.MonkeyPatch, columns: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    clock, out = Clock(), Terminal()
    with Progress(50_000, collisions_per_disk=1e7, stream=out, clock=clock) as progress:
        progress(0.0, 0)
        clock.now += 10.0
        progress(0.012345, 98_700_000)  # 9.87e6 a second: 2.5e11 take 25,329 s, of which 10 are over
    last = [line for line in out.getvalue().replace("\n", "\r").split("\r") if line.strip()][-1].rstrip()
    assert len(last) < columns
    whole = "ETA 7:01:59, 9.87e+06 collisions/s"
    assert whole in last or last.endswith("ETA 7:01:59, 9.87e+06/s")
    # What is there is there to its end.
    *_, end = last.split(", ")
    assert end in ("9.87e+06/s", "9.87e+06 collisions/s", "3948.00 per disk", "t = 0.01235 s")
    assert (end == "t = 0.01235 s") == (columns >= 90)


@pytest.mark.parametrize("columns", [0, NARROWEST - 1])
def test_terminal_without_room_gets_plain_lines(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    reader, writer = pty.openpty()
    fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 0, columns, 0, 0))
    clock = Clock()
    with (
        os.fdopen(writer, "w") as out,
        Progress(100, t_end=1.0, stream=out, clock=clock) as progress,
    ):
        progress(0.0, 0)
        clock.now += 10.0
        progress(0.5, 250)
        assert os.read(reader, 1000).decode().startswith(" 50.0 %  t = 0.5 s, 5.00 collisions per disk")
    os.close(reader)


def test_terminal_with_columns_but_no_rows_shows_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    reader, writer = pty.openpty()
    fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 0, 70, 0, 0))
    with os.fdopen(writer, "w") as out, Progress(100, t_end=1.0, stream=out, clock=Clock()):
        shown = ""
        # The bar may arrive in several pieces.
        while "compiling" not in shown and select.select([reader], [], [], 5.0)[0]:
            shown += os.read(reader, 1000).decode()
        assert "compiling" in shown
    os.close(reader)


def test_the_bar_names_the_kernel_that_is_compiled_until_the_first_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    clock, out = Clock(), Terminal()
    with Progress(100, t_end=1.0, stream=out, kernels=2, clock=clock) as progress:
        for name in ("survey", "plan_window", "run_windows"):
            progress.compiling(name)
            clock.now += 0.75
        progress(0.1, 10)
        progress.compiling("verify")
    shown = out.getvalue()
    assert "compiling kernels: 1 of about 2 (survey)" in shown
    assert "compiling kernels: 3 of about 3 (run_windows)" in shown
    assert "verify" not in shown


@pytest.mark.parametrize(("columns", "brief"), [("0", False), ("80", True)])
def test_kernels_that_are_found_in_the_cache_are_not_named(
    monkeypatch: pytest.MonkeyPatch, columns: str, brief: bool
) -> None:
    """Those are loaded in less than half a second: neither in plain lines nor by the bar of a brief run."""
    monkeypatch.setenv("COLUMNS", columns)
    clock, out = Clock(), Terminal() if brief else io.StringIO()
    with Progress(100, t_end=1.0, stream=out, kernels=4, clock=clock, brief=brief) as progress:
        for seconds, name in ((0.1, "read_out"), (0.3, "survey"), (0.2, "plan_window"), (0.3, "run_windows")):
            progress.compiling(name)
            clock.now += seconds
    named = re.findall(r"compiling kernels: (\d) of about 4 \((\w+)\)", out.getvalue())
    assert [*dict.fromkeys(named)] == [("4", "run_windows")]


@pytest.mark.full
def test_kernels_are_announced_once_for_features_and_types() -> None:
    """Before the first window of a gas those that `n_kernels` counts, and no more for another gas like it."""
    from ifrdem.simulation import backend

    backend.stop()
    for expected in (["survey", "plan_window", "run_windows", "read_out"], []):
        gas, names = small_gas(), []
        with backend.announced(names.append):
            gas.run(collisions_per_disk=2)
            gas.measure()
        assert names == expected
    assert gas.n_kernels == 5  # `read_out` also reads frames


def test_a_short_run_shows_nothing_if_it_is_to_be_brief(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    clock, out = Clock(), Terminal()
    with Progress(100, t_end=1.0, stream=out, clock=clock, brief=True) as progress:
        progress(0.0, 0)
        progress(1.0, 10)
    assert out.getvalue().strip() == ""


def small_gas() -> ifrdem.Simulation:
    disks = ifrdem.Disks(100, mass=1.0, radius=0.5)
    box = ifrdem.Box.from_packing_fraction(disks.radius, 0.2)
    position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    start = ifrdem.State(position, velocity, np.zeros(100))
    return ifrdem.Simulation(disks, box, ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2), start)


def test_runs_from_python_show_no_progress_off_a_terminal_unless_asked(
    capsys: pytest.CaptureFixture[str],
) -> None:
    gas = small_gas()
    gas.run(collisions_per_disk=1)
    gas.run(collisions_per_disk=2, progress=False)
    shown = capsys.readouterr()
    assert shown.out == shown.err == ""
    gas.run(collisions_per_disk=10, progress=True)
    assert "100.0 %" in capsys.readouterr().err
    with pytest.raises(ifrdem.InputError, match="progress = 'yes': must be True, False or a function"):
        gas.run(collisions_per_disk=20, progress="yes")  # type: ignore[arg-type]


def test_a_terminal_sees_a_bar_by_default_which_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(showing, "DELAY", 0.0)
    monkeypatch.setattr(sys, "stderr", Terminal())
    watched, alone = small_gas(), small_gas()
    watched.run(collisions_per_disk=20)
    assert "0.0 %" in sys.stderr.getvalue()  # type: ignore[attr-defined]
    alone.run(collisions_per_disk=20, progress=False)
    for name in ("position", "velocity", "spin"):
        np.testing.assert_array_equal(getattr(watched.state, name), getattr(alone.state, name))


def test_a_notebook_counts_as_interactive_output(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not showing.output_is_interactive(io.StringIO())
    assert showing.output_is_interactive(Terminal())
    kernel = types.SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: kernel))
    assert showing.output_is_interactive(io.StringIO())
    kernel.kernel = None  # IPython in a terminal or a pipe
    assert not showing.output_is_interactive(io.StringIO())
