"""Drawn tables: numbers come back to the last bit, and what is no table is refused by its line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support.drawn import examples

from ifrdem.errors import InputError
from ifrdem.initial import from_csv
from ifrdem.model.box import Box

BOX = Box((8.0, 8.0))
PLACES = st.floats(0.0, 8.0, exclude_max=True, allow_subnormal=False)
MOTION = st.floats(-1e40, 1e40, allow_subnormal=False)  # which kernels flush to 0 in their process


def written(path: Path, header: list[str], rows: list[list[Any]]) -> Path:
    lines = [header, *([each if isinstance(each, str) else repr(each) for each in row] for row in rows)]
    path.write_bytes("\n".join(map(",".join, lines)).encode(errors="surrogateescape") + b"\n")
    return path


@given(
    st.lists(st.tuples(PLACES, PLACES, MOTION, MOTION, MOTION), min_size=1, max_size=4),
    st.permutations(range(5)),
)
@examples(40)
def test_columns_in_any_order_come_back_to_the_last_bit(
    tmp_path: Path, rows: list[tuple[float, ...]], order: list[int]
) -> None:
    names = ["x", "y", "vx", "vy", "spin"]
    table = written(
        tmp_path / "start.csv", [names[i] for i in order], [[row[i] for i in order] for row in rows]
    )
    found = from_csv.read(table, len(rows), BOX)
    assert found.velocity is not None
    assert found.spin is not None
    both = np.column_stack((found.position, found.velocity, found.spin))
    np.testing.assert_array_equal(both, np.array(rows))


ODD = (
    "", "nan", "inf", "1e999", "-1e999", "x", "1_0", "0x1", "1;5", '"', "\x00", "\udce9", "#", "1e-400", "\u0661",
)  # fmt: skip
NAMES = (
    "x",
    "y",
    "vx",
    "vy",
    "spin",
    "id",
    "x (mm)",
    "x [furlong]",
    "X",
    "x_error",
    "z",
    "",
    "\ufeffx",
    "x;y",
)


@st.composite
def tables(draw: Any) -> tuple[list[str], list[list[Any]], int]:
    """Header, rows and number of disks, mostly of one size; a cell in six is at an edge of the box, and one is odd."""
    header = ["x", "y", *draw(st.lists(st.sampled_from(NAMES), max_size=2))]
    cells = st.one_of(*[PLACES] * 4, st.sampled_from((0.0, 8.0, -0.1)), st.sampled_from(ODD))
    width, n = len(header) + draw(st.sampled_from((0, 0, 0, 1, -1))), draw(st.integers(1, 3))
    rows = draw(st.lists(st.lists(cells, min_size=width, max_size=width), min_size=n, max_size=n))
    return header, rows, n + draw(st.sampled_from((0, 0, 0, 1)))


@given(tables())
@examples(120)
def test_any_table_is_a_start_or_is_refused_with_a_reason(
    tmp_path: Path, table: tuple[list[str], list[list[Any]], int]
) -> None:
    header, rows, n = table
    try:
        found = from_csv.read(written(tmp_path / "start.csv", header, rows), n, BOX)
    except InputError as error:
        lines = str(error).splitlines()
        assert all(line.isprintable() and line.strip() for line in lines)
        assert lines
    else:
        assert found.position.shape == (n, 2)
        assert all(0.0 <= each < 8.0 and math.isfinite(each) for each in found.position.ravel())
