"""Functions that all ranks call together: one that a rank leaves out is an error on all, and nobody waits for ever."""

from __future__ import annotations

import inspect
import operator
import threading
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

import ifrdem
from ifrdem.mpi import Communicator
from ifrdem.tools import checked


class Ranks:
    """Two ranks as two threads; messages are matched by their order, as MPI does."""

    def __init__(self) -> None:
        self._meet, self._sent = threading.Barrier(2, timeout=20.0), [None, None]

    def rank(self, number: int) -> Any:
        """The communicator of mpi4py that this rank would have."""

        class Rank:
            rank, size = number, 2

            def allgather(_, value: Any) -> list[Any]:
                self._sent[number] = value
                self._meet.wait()
                found = list(self._sent)
                self._meet.wait()
                return found

            def allreduce(self, value: Any) -> Any:
                return reduce(operator.add, self.allgather(value))

        return Rank()

    def run(self, work: Callable[[int], Any]) -> list[Any]:
        """What both ranks return or raise in a block of theirs."""
        found: list[Any] = [None, None]

        def one(number: int) -> None:
            try:
                with Communicator(self.rank(number), distributed=True):
                    found[number] = work(number)
            except (ifrdem.InputError, threading.BrokenBarrierError) as error:
                found[number] = error

        threads = [threading.Thread(target=one, args=(number,)) for number in range(2)]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
        return found


def box(packing_fraction: float) -> float:
    return ifrdem.Box.from_packing_fraction(np.full(8, 0.5), packing_fraction).lengths[0]


def test_a_call_that_a_rank_leaves_out_is_an_error_on_all() -> None:
    """Found: without it rank 0 waits for the sum of areas until somebody ends the job."""
    found = Ranks().run(lambda number: box(0.2) if number == 0 else None)
    for error in found:
        assert isinstance(error, ifrdem.InputError)
        assert "rank 0 calls Box.from_packing_fraction, rank 1 leaves the block" in str(error)


def test_different_calls_are_an_error_on_all() -> None:
    def work(number: int) -> object:
        return box(0.2) if number == 0 else ifrdem.initial.maxwellian(np.ones(8), speed_rms=1.0, seed=1)

    for error in Ranks().run(work):
        assert "rank 0 calls Box.from_packing_fraction, rank 1 calls maxwellian" in str(error)


def test_an_error_of_a_rank_is_that_of_all() -> None:
    for error in Ranks().run(lambda number: box(0.2 if number == 0 else 2.0)):
        assert "packing_fraction = 2.0" in str(error)


def test_public_functions_that_speak_with_ranks_are_collective() -> None:
    """Found: one that is not is left out in silence. `Simulation` takes ranks as an argument, and compares its own."""
    speaking = {
        function.__qualname__
        for function in checked.VALIDATED
        if function.__module__.startswith("ifrdem.")
        and "current" in function.__code__.co_names
        and not hasattr(function, "collective")
    }
    assert speaking == {"Simulation.__init__", "Simulation.from_checkpoint"}


def test_the_docstring_of_a_collective_function_says_so() -> None:
    for function in (ifrdem.Box.from_packing_fraction, ifrdem.initial.maxwellian):
        assert "\n\nCollective in a block `with` ranks" in inspect.getdoc(function)
