"""Runs that end early: by `stop`, by an error of a callback, by Ctrl-C; and runs where none is possible."""

from __future__ import annotations

import contextlib
import contextvars
import copy
import functools
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.gases import MakeGas, gas_of

from ifrdem import Box, ContactTime, Disks, EngineError, IFRLaw, InputError, Simulation, State
from ifrdem.kernels.events.events import MOST_EVENTS_OF_A_LAUNCH
from ifrdem.model.observables import Measure
from ifrdem.model.walls.wall import Wall
from ifrdem.mpi.communicator import SERIAL, Communicator, current
from ifrdem.simulation import backend
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.windows.runner import TileRunner


class Halt(Exception):
    """What an observer of these tests raises."""


def halting(end: Callable[[], None], frame: int, observed: list[State]) -> Callable[[State, Measure], None]:
    def observer(state: State, measure: Measure) -> None:
        observed.append(state)
        if len(observed) == frame + 1:
            end()

    return observer


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def halt() -> None:
    raise Halt


def assert_same_motion(one: State, other: State) -> None:
    for name in ("time", "position", "velocity", "spin", "collisions", "image"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("end", [{"t_end": 2.0}, {"collisions_per_disk": 6.0}])
@pytest.mark.parametrize(
    ("way", "raised"), [("stop", None), ("raise", Halt), ("interrupt", KeyboardInterrupt)]
)
@pytest.mark.parametrize(
    "options",
    [{}, {"collapse": ContactTime(1e-9)}],
    ids=["plain", "contact_time"],
)
def test_a_run_ends_at_the_frame_of_the_observer_that_ends_it(
    gas: MakeGas, end: dict[str, float], way: str, raised: type[BaseException] | None, options: dict[str, Any]
) -> None:
    """One window of 100 disks holds many of these frames.

    From there on it must be the uninterrupted gas: the same frames to the last bit, and the same collisions.
    """
    whole, part = (
        gas(record=["ledger"], histories=[3], **options),
        gas(record=["ledger"], histories=[3], **options),
    )
    frames: list[State] = []
    whole.run(**end, frames=50, frame_callbacks=[lambda state, measure: frames.append(state)])
    observed: list[State] = []
    observer = halting({"stop": part.stop, "raise": halt, "interrupt": interrupt}[way], 20, observed)
    if raised is None:
        part.run(**end, frames=50, frame_callbacks=[observer])
    else:
        with pytest.raises(raised):
            part.run(**end, frames=50, frame_callbacks=[observer])
    assert len(observed) == 21
    assert part.time == observed[-1].time == frames[20].time
    assert part.collisions == int(frames[20].collisions.sum()) // 2
    assert_same_motion(part.state, frames[20])
    early = part.take_events()
    assert len(early) == 0 or early.time[-1] <= part.time
    assert len(early) == frames[20].collisions[3]
    part.run(**end)
    assert_same_motion(part.state, frames[-1])
    assert len(part.take_events()) + len(early) == len(whole.take_events()) == frames[-1].collisions[3]
    lost, at_once = part.measure().dissipated, whole.measure().dissipated
    assert lost is not None
    assert at_once is not None
    np.testing.assert_array_equal(lost, at_once)


@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_stopping_within_a_window_changes_no_bit_in_any_order_of_the_engine(
    order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = gas_of(400)
    frames: list[State] = []
    whole.run(t_end=1.0, frames=32, frame_callbacks=[lambda state, measure: frames.append(state)])
    monkeypatch.setattr(
        "ifrdem.simulation.simulation.Engine", functools.partial(Engine, order=order, tile_disks=60)
    )
    part = gas_of(400)
    observed: list[State] = []
    for stops_at in (7, 6, 11):  # frames at 7/32, 13/32 and 24/32 of the way: exact numbers
        observed.clear()
        part.run(
            t_end=1.0,
            frames=round(32 * (1.0 - part.time)),
            frame_callbacks=[halting(part.stop, stops_at, observed)],
        )
        at = round(32 * part.time)
        assert part.time == at / 32
        assert_same_motion(part.state, frames[at])
    assert at == 24


def test_a_stop_from_a_callback_or_progress_ends_the_run_at_the_end_of_a_window(gas: MakeGas) -> None:
    one = gas(2000)
    one.run(collisions_per_disk=5000.0, progress=lambda time, collisions: one.stop())
    assert 0 < one.collisions < 5_000_000
    here = one.collisions
    one.run(collisions_per_disk=5000.0, series=1000, series_callbacks=[lambda measure: one.stop()])
    assert here < one.collisions < 5_000_000
    one.run(t_end=one.time + 0.01)  # an earlier stop does not end a later run


def test_ctrl_c_during_a_window_takes_effect_at_its_end_and_the_gas_stays_usable(
    gas: MakeGas,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, other = gas(), gas()
    windows = one._engine.windows
    run = windows.run

    def interrupted(*args: Any, **options: Any) -> None:
        interrupt()  # as if the user pressed Ctrl-C just before the kernel runs
        run(*args, **options)

    monkeypatch.setattr(windows, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        one.run(t_end=3.0)
    monkeypatch.undo()
    assert 0.0 < one.time <= 3.0
    if one.time < 3.0:
        one.run(t_end=3.0)
    other.run(t_end=3.0)
    assert_same_motion(one.state, other.state)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.full
@pytest.mark.parametrize("way", ["interrupt", "stop"])
def test_a_run_stops_within_a_window_of_more_than_a_million_events(
    way: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A disk crosses a slot of 1.5e-6 at a speed of 1; its windows last for 3.8, until it has moved on along the slot.

    The first Ctrl-C, and `stop` from another thread, acted at the window's end. It runs on from where it stopped, and
    so does its checkpoint, for which the whole window was run.
    """
    walls = [Wall.line((0.0, 4.5), (0.0, 1.0)), Wall.line((0.0, 5.5 + 1.5e-6), (0.0, -1.0))]
    box, start = Box((10.0, 10.0), (True, False)), State([[5.0, 5.0 + 7.5e-7]], [[0.3, 1.0]], [0.0])
    one = Simulation(
        Disks(1, mass=1.0, radius=0.5), box, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), start, walls=walls
    )
    work_on = TileRunner._work_on
    launches: list[None] = []

    def asked(self: TileRunner, *given: int) -> None:
        (interrupt if way == "interrupt" else one.stop)()
        work_on(self, *given)

    monkeypatch.setattr(TileRunner, "_work_on", asked)
    with pytest.raises(KeyboardInterrupt) if way == "interrupt" else contextlib.nullcontext():
        one.run(t_end=1.6)
    monkeypatch.undo()
    assert one.time == pytest.approx(0.5 * MOST_EVENTS_OF_A_LAUNCH * 1.5e-6, rel=1e-3)
    assert one._engine.windows.end > 3.0
    assert one.state.position[0, 0] == pytest.approx(5.0 + 0.3 * one.time)
    assert one.wall_collisions == pytest.approx(one.time / 1.5e-6, abs=1.0)
    one.save_checkpoint(tmp_path / "slot.checkpoint.h5")
    one.run(t_end=1.6)
    assert one.wall_collisions == pytest.approx(1.6 / 1.5e-6, abs=1.0)
    if way == "interrupt":
        call = TileRunner._call_kernels
        monkeypatch.setattr(TileRunner, "_call_kernels", lambda *given: (launches.append(None), call(*given)))
        again = Simulation.from_checkpoint(tmp_path / "slot.checkpoint.h5")
        assert len(launches) == 2  # of a million events, and to that moment: no further
        again.run(t_end=1.6)
        assert_same_motion(again.state, one.state)
        assert again.wall_collisions == one.wall_collisions


def test_a_second_ctrl_c_ends_a_window_at_once_and_the_lost_state_is_refused(
    gas: MakeGas,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = gas()

    def interrupted(*args: Any, **options: Any) -> Any:
        interrupt()
        interrupt()

    monkeypatch.setattr(one._engine.windows, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        one.run(t_end=3.0)
    with pytest.raises(EngineError, match="interrupted half-way"):
        one.run(t_end=3.0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_thread_is_refused_while_another_one_runs_a_simulation(gas: MakeGas) -> None:
    one = gas()
    raised: list[BaseException] = []

    def elsewhere() -> None:
        for act in (gas, lambda: one.state, lambda: one.run(t_end=9.0)):
            try:
                act()
            except EngineError as error:
                raised.append(error)

    def observer(state: State, measure: Measure) -> None:
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join()

    one.run(t_end=0.1, frames=1, frame_callbacks=[observer])
    assert len(raised) == 6
    assert all("another thread" in str(error) and '"spawn"' in str(error) for error in raised)
    thread = threading.Thread(target=lambda: one.run(t_end=0.2))  # one after the other they can
    thread.start()
    thread.join()
    assert one.time == 0.2


@pytest.mark.full
def test_a_gas_that_was_made_in_another_thread_runs_in_this_one_and_the_other_way_round(gas: MakeGas) -> None:
    """Taichi ends its work with an assertion if its first kernel is launched by another thread than started it."""
    made: list[Simulation] = []

    def in_thread(act: Callable[[], object]) -> None:
        thread = threading.Thread(target=act)
        thread.start()
        thread.join()

    backend.stop()
    in_thread(lambda: made.append(gas()))
    made[0].run(t_end=0.1)
    expected = made[0].state
    backend.stop()
    made.append(gas())
    in_thread(lambda: made[1].run(t_end=0.1))
    assert_same_motion(made[1].state, expected)


def test_blocks_of_communicators_in_two_threads_do_not_meet() -> None:
    """Two threads make gases at once: each is in blocks of its own, that may end in any order."""
    one, other = contextvars.copy_context(), contextvars.copy_context()
    outer = Communicator()
    with outer:
        one.run(SERIAL.__enter__)
        other.run(SERIAL.__enter__)
        one.run(SERIAL.__exit__)
        assert other.run(current) is SERIAL
        other.run(SERIAL.__exit__)
        assert current() is outer
    assert current() is SERIAL


def test_a_simulation_is_not_copied_and_says_what_to_do(gas: MakeGas) -> None:
    """`copy.copy` gave a second name to the same arrays on the device: both moved at once."""
    one = gas()
    for act in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(InputError, match=r"cannot be copied or pickled\. Store it by save_checkpoint"):
            act(one)


@pytest.mark.full
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_copy_of_a_process_with_a_simulation_is_refused_and_does_not_hang() -> None:
    """Of one process, a copy for each act."""
    program = f"""
import os, signal, sys
sys.path[:0] = [{os.path.dirname(os.path.dirname(__file__))!r}]
from support.gases import gas_of
from ifrdem import ContactTime, EngineError
from ifrdem.simulation import backend
one = gas_of()
one.run(t_end=0.1)
acts = [gas_of, lambda: one.run(t_end=2.0), lambda: one.state, backend.stop]
for number, act in enumerate(acts):
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        try:
            act()
        except EngineError as error:
            os._exit(0 if 'get_context("spawn")' in str(error) else 2)
        os._exit(3)
    assert os.waitpid(child, 0)[1] == 0, number
one.run(t_end=0.2)
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)


def test_run_for_adds_to_what_has_been_and_run_is_a_total(gas: MakeGas) -> None:
    """100 disks: 1.5 collisions of each are 75; after 75, and 75 more, the total is 3 per disk."""
    total, added = gas(), gas()
    total.run(collisions_per_disk=3.0)
    for _ in range(2):
        added.run_for(collisions_per_disk=1.5)
    assert added.collisions == total.collisions == 150
    np.testing.assert_array_equal(added.state.position, total.state.position)
    begin = added.time
    added.run_for(time=0.25)
    total.run(t_end=begin + 0.25)
    assert added.time == total.time == begin + 0.25
    np.testing.assert_array_equal(added.state.velocity, total.state.velocity)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({}, "exactly one of time and collisions_per_disk"),
        ({"time": 1.0, "collisions_per_disk": 1.0}, "exactly one of"),
        ({"time": 0.0}, "time = 0.0: must be"),
        ({"time": float("inf")}, "time = inf: must be"),
        ({"collisions_per_disk": -1.0}, "collisions_per_disk = -1.0: must be"),
        ({"collisions_per_disk": "x"}, "collisions_per_disk = 'x': must be"),
    ],
)
def test_run_for_nothing_is_refused(gas: MakeGas, more: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        gas(4).run_for(**more)


def test_a_simulation_prints_what_it_is_and_its_progress(gas: MakeGas) -> None:
    made = gas(16, record=["ledger"])
    made.run(t_end=0.5)
    what, where = str(made).splitlines()
    assert what.startswith("Simulation: 16 disks, box ")
    assert "IFRLaw" in what
    count = made.collisions
    assert where == f"t = 0.5, {count} collision{'s' * (count != 1)} ({count / 8:g} per disk)"
