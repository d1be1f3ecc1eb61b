"""Arrays are copied between NumPy and Taichi by memory on a CPU: the same numbers as by Taichi's own kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ifrdem.kernels import language
from ifrdem.kernels.language import ti
from ifrdem.simulation import device

pytestmark = pytest.mark.unoptimised


@pytest.mark.parametrize("kind", ["f64", "f32", "i32"])
@pytest.mark.parametrize("vector", [None, 3])
@pytest.mark.parametrize("shape", [(7,), (4, 5), (2, 3, 4)])
def test_copies_by_memory_are_those_of_kernels(
    kind: str, vector: int | None, shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    device.start("cpu", threads=1)

    def made(values: np.ndarray) -> Any:
        of = getattr(ti, kind)
        found = ti.ndarray(of, shape) if vector is None else ti.Vector.ndarray(vector, of, shape)
        found.from_numpy(values)
        return found

    whole = shape if vector is None else (*shape, vector)
    values = (
        np.arange(np.prod(whole), dtype=np.float64).reshape(whole)[::-1] * 1.5
    )  # neither its type nor contiguous
    array = made(values)
    expected = values.astype({"f64": np.float64, "f32": np.float32, "i32": np.int32}[kind])
    np.testing.assert_array_equal(array.to_numpy(), expected)
    assert array.to_numpy().dtype == expected.dtype
    with pytest.raises(ValueError, match="an array of shape"):
        array.from_numpy(values[1:])
    monkeypatch.setattr(language, "on_gpu", lambda: True)
    np.testing.assert_array_equal(array.to_numpy(), expected)
    np.testing.assert_array_equal(made(expected).to_numpy(), expected)
    monkeypatch.undo()
    np.testing.assert_array_equal(made(expected).to_numpy(), expected)
