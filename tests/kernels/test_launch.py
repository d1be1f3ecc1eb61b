"""Launches with a list of arguments that is kept compute what a call of the kernel computes."""

from typing import Any

import numpy as np
import pytest

from ifrdem.simulation import backend


@pytest.fixture
def launcher() -> Any:
    """Of a kernel with two numbers, an array that is held, and a given one."""
    backend.start()
    from ifrdem.kernels.compiler.language import Rows, ti
    from ifrdem.kernels.compiler.launch import Launcher

    @ti.kernel
    def scale(factor: ti.i32, shift: ti.f64, values: Rows, out: Rows):
        for i in range(values.shape[0]):
            out[i] = factor * values[i] + shift

    found = Launcher(scale, 2, {"out"})
    assert found.held_names == ("values",)
    return found


def of_runtime(values: Any) -> Any:
    from ifrdem.kernels.compiler.language import from_numpy, ti

    array = ti.ndarray(ti.f64, len(values))
    from_numpy(array, np.array(values, dtype=np.float64))
    return array


@pytest.mark.parametrize("make", [of_runtime, np.array])
def test_later_launches_take_the_present_numbers_and_arrays(launcher: Any, make: Any) -> None:
    values = make([1.0, 2.0])
    for factor, shift in ((1, 0.0), (2, 0.5), (-3, 0.25)):
        out = np.zeros(2)  # another one each time
        launcher((factor, shift), (values,), {"out": out})
        assert out.tolist() == [factor + shift, 2 * factor + shift]


def test_arrays_that_are_replaced_are_noticed(launcher: Any) -> None:
    """Shapes, too: the kernel loops over the new length. The memory of an old array may be another's."""
    for values in ([1.0, 2.0], [3.0, 4.0, 5.0], [6.0]):
        held = of_runtime(values)
        for _ in range(2):
            out = np.zeros(len(values))
            launcher((1, 0.0), (held,), {"out": out})
            assert out.tolist() == values
        backend.free_array(held)


def test_types_that_change_are_noticed(launcher: Any) -> None:
    values = np.array([1.0, 2.0])
    for kind in (np.float64, np.float64, np.float32, np.float32, np.float64):
        out = np.zeros(2, kind)
        launcher((1, 0.5), (values,), {"out": out})
        assert out.tolist() == [1.5, 2.5]


def test_an_array_with_gaps_is_refused(launcher: Any) -> None:
    """The runtime would copy it; the memory that is listed here has to be the array's own."""
    values = np.array([1.0, 2.0])
    for _ in range(2):
        launcher((1, 0.0), (values,), {"out": np.zeros(2)})
    with pytest.raises(ValueError, match="rows"):
        launcher((1, 0.0), (values,), {"out": np.zeros(4)[::2]})


def test_numbers_of_numpy_are_taken(launcher: Any) -> None:
    """quadrants warns of those in a call."""
    out = np.zeros(1)
    launcher((np.int64(2), np.float64(0.5)), (np.array([1.0]),), {"out": out})
    assert out.tolist() == [2.5]
