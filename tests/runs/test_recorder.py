"""Output of a run that waits to be written together."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

import ifrdem
from ifrdem.quantities import MECHANISMS
from ifrdem.runs.recorder import BYTES_AT_ONCE, WAIT, Recorder
from ifrdem.runs.run import RootOutput, _mechanisms
from ifrdem.trajectory.background import AsyncWriter


class Calls:
    """Stands for a writer: the number of frames and rows of each call."""

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.rows: list[int] = []

    def write_frames(self, frames) -> None:
        self.frames.append(len(frames))

    def write_series_rows(self, rows, columns) -> None:
        self.rows.append(len(rows))


def frame_of(n: int) -> tuple[ifrdem.State, object]:
    disks = ifrdem.Disks(n, mass=1.0, radius=0.5)
    state = ifrdem.State(np.zeros((n, 2)), np.ones((n, 2)), np.zeros(n))
    return state, ifrdem.observables.measure(disks, state)


@pytest.mark.parametrize(("n", "calls"), [(10, [1, 8, 1]), (BYTES_AT_ONCE // 64 + 1, [1] * 10)])
def test_small_frames_are_committed_together_and_large_ones_at_once(n, calls):
    now, callbacks = [0.0], Calls()
    recorder = Recorder(callbacks, ifrdem.Ledger(), clock=lambda: now[0])
    with recorder:
        for i in range(10):
            if i == 8:
                now[0] += WAIT  # the ninth frame finds that the others have waited long enough
            recorder.frame(*frame_of(n))
    assert callbacks.frames == calls


def test_frames_so_far_are_written_when_a_run_fails():
    callbacks = Calls()

    def collapse() -> None:
        with Recorder(callbacks, ifrdem.Ledger(), clock=lambda: 0.0) as recorder:
            for _ in range(3):
                recorder.frame(*frame_of(2))
                recorder.row(frame_of(2)[1])
            raise ifrdem.EngineError("collapse")

    with pytest.raises(ifrdem.EngineError):
        collapse()
    assert sum(callbacks.frames) == sum(callbacks.rows) == 3


@pytest.mark.parametrize("low", [False, True])
def test_a_frame_is_written_before_a_run_with_low_memory_goes_on(low: bool) -> None:
    """So that one frame is in memory, not four."""
    output = object.__new__(RootOutput)
    output.recorder, writer = Mock(), Mock(spec=AsyncWriter)
    case = SimpleNamespace(run=SimpleNamespace(low_memory=low))
    gas = SimpleNamespace(comm=SimpleNamespace(is_distributed=False))
    output.running = SimpleNamespace(simulation=gas, writer=writer, file=SimpleNamespace(case=case))
    output.frame("rows", "measure")
    output.recorder.frame.assert_called_once_with("rows", "measure")
    assert writer.flush.call_count == low


@pytest.mark.parametrize(("part", "shown"), [(1e-13, False), (1e-11, True), (-1e-13, False), (-1e-11, True)])
def test_a_mechanism_that_is_rounding_is_not_printed(part: float, shown: bool) -> None:
    """A part is rounding below 1e-12 of all; one below 0 that is more has a line that says why."""
    dissipated = np.zeros(len(MECHANISMS))
    dissipated[[MECHANISMS.index("normal"), MECHANISMS.index("sliding")]] = 2.0, 2.0 * part
    first, *others = _mechanisms(dissipated, 2.0, " J")
    assert first == f"by mechanism: normal 2{f', sliding {2.0 * part:.4g}' * shown} J"
    assert [line.split(" below 0")[0] for line in others] == ["  sliding"] * (shown and part < 0.0)
    # Of a gas with much more energy than was taken, such as an elastic one, all is rounding.
    assert [*_mechanisms(dissipated, 3e12, " J")] == []
