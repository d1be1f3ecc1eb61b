"""Kernels get a parameter for each array that their annotation names."""

from __future__ import annotations

import inspect
import linecache
import re
from pathlib import Path

import numpy as np
import pytest

from ifrdem.kernels import columns
from ifrdem.simulation import backend


def test_each_array_is_a_parameter_in_the_order_of_the_names() -> None:
    backend.start()
    from ifrdem.kernels.compiler.signature import parameters_of
    from ifrdem.kernels.tiles.readout import exchange
    from ifrdem.kernels.tiles.sums import sum_shared

    expected = ["n_blocks", "last", "uses", "grid", "tally", "reach", "found", "total", "blocks"]
    assert parameters_of(sum_shared) == expected
    assert parameters_of(exchange) == ["board", "sending", *columns.SMALL]


def test_small_arrays_go_to_one_board_and_back() -> None:
    """Whole numbers too, one array after another, as a GPU gets them."""
    backend.start()
    from ifrdem.kernels.tiles.readout import exchange

    lengths = (2, 1, 3, 1, 2, 1)
    kinds = (np.int32, np.float64, np.float64, np.float64, np.int32, np.float64)
    arrays = [np.zeros(n, kind) for n, kind in zip(lengths, kinds, strict=True)]
    board = np.arange(1.0, 11.0)
    exchange(board, 1, *arrays)
    assert [array.tolist() for array in arrays] == [[1, 2], [3.0], [4.0, 5.0, 6.0], [7.0], [8, 9], [10.0]]
    for array in arrays:
        array += 1
    exchange(board, 0, *arrays)
    assert board.tolist() == np.arange(2.0, 12.0).tolist()


def test_a_kernel_can_use_variables_of_the_enclosing_scope() -> None:
    backend.start()
    from support.kernels.records import shifting

    from ifrdem.kernels.compiler.language import ti

    for shift in (2.0, 3.0):
        disk = ti.Vector.ndarray(5, ti.f64, 2)
        disk.fill(1.0)
        shifting(shift)(disk)
        assert disk.to_numpy()[:, 0].tolist() == [1.0 + shift] * 2


def test_an_error_in_a_kernel_names_its_file_and_line() -> None:
    backend.start()
    from support.kernels import records

    from ifrdem.kernels.compiler.language import CompilationError, ti

    disk = ti.Vector.ndarray(5, ti.f64, 2)
    with pytest.raises(CompilationError) as caught:
        records.wrong(disk)
    path = Path(records.__file__)
    line = 1 + path.read_text().splitlines().index("        gas.disk[i].mass = 1.0")
    assert re.search(rf'{re.escape(str(path))} \(kernel wrong\)", line {line}, in wrong', str(caught.value))


def test_an_array_that_is_not_in_the_list_of_a_kernel_is_named_with_kernel_and_list() -> None:
    """The error said "'Gas' object has no attribute 'scale'", wherever the function that asks stood."""
    backend.start()
    from support.kernels import records

    from ifrdem.kernels.compiler.language import CompilationError, ti

    with pytest.raises(CompilationError) as caught:
        records.missing(ti.Vector.ndarray(5, ti.f64, 2))
    assert """kernel missing has no array 'scale': name it in its list, Arrays("disk")""" in str(caught.value)


def test_sources_of_kernels_are_those_of_the_start_of_the_process() -> None:
    """An edit of the tree before a kernel compiled ended in an AssertionError of the runtime, or another program."""
    backend.start()
    from ifrdem.kernels.events import events

    path = events.__file__
    assert linecache.cache[path][1] is None  # no time, so that `linecache` does not look at the file
    linecache.checkcache(path)
    assert "def check_progress" in inspect.getsource(events.check_progress)
    assert path in linecache.cache
