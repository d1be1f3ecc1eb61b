"""Arrays of a gas for functions of kernels that a test calls by themselves. Import kernels after `backend.start`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ifrdem.kernels import columns
from ifrdem.kernels.columns import AXES, TABLES, TYPES, named
from ifrdem.kernels.layout import Uses


class Scene:
    """Arrays of a gas by name, zeros at first; `call` gives a kernel those that it takes."""

    def __init__(self, rows: int = 1, **shapes: int) -> None:
        self.rows, self.shapes = rows, shapes
        self.arrays: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if name not in self.arrays:
            if name in columns.SINGLE:
                self.arrays[name] = columns.blank(
                    name, np.int32 if name in ("grid", "counter") else np.float64
                )
            else:
                kind = (
                    np.int32 if TYPES[name] == "i32" else np.float32 if TYPES[name] == "f32" else np.float64
                )
                width = (TABLES[name].width,) if name in TABLES else ()
                made = np.zeros((self.shapes.get(name, self.rows), *width), kind)
                self.arrays[name] = named(made, name) if name in TABLES else made
        return self.arrays[name]

    def call(self, kernel: Any, uses: Uses, names: str, *given: Any) -> None:
        """Run a kernel on the arrays that it takes, by its names, and other arguments before them."""
        from ifrdem.kernels.compiler.language import from_numpy, ti, to_numpy

        passed, copies = [], []
        for name in names.split():
            if name == "uses":
                passed.append(uses)
                continue
            array = getattr(self, name)
            array = getattr(array, "array", array)
            if name in TABLES and name not in columns.SINGLE and AXES.get(name, 1) == 1:
                of = {np.dtype(np.int32): ti.i32, np.dtype(np.float64): ti.f64}[array.dtype]
                vectors = ti.Vector.ndarray(array.shape[1], of, len(array))
                from_numpy(vectors, array)
                copies.append((array, vectors))
                array = vectors
            passed.append(array)
        kernel(*given, *passed)
        for array, vectors in copies:
            array[...] = to_numpy(vectors)
