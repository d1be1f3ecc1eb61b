"""Columns of arrays by name: on the host, in kernels, and in estimates of memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from ifrdem.kernels import columns
from ifrdem.kernels.columns import Columns, Named, Several, named
from ifrdem.quantities import MECHANISMS
from ifrdem.simulation import backend

PAIR = Columns(begin="begin", until="end")
TABLE = Columns(
    a="one", two=("two numbers", 2), part=("a table", PAIR), times=("tables", 3, PAIR), last="another one"
)
ALL_TABLES = {**columns.TABLES, **{f"dsmc {name}": table for name, table in columns.DSMC_TABLES.items()}}


def test_numbers_of_columns_are_counted_in_order() -> None:
    assert (TABLE.a, TABLE.last, TABLE.width) == (0, 11, 12)
    assert [TABLE.two[m] for m in range(2)] == [1, 2]
    assert (TABLE.part.first, TABLE.part.begin, TABLE.part.until) == (3, 3, 4)
    assert [TABLE.times[m] for m in range(3)] == [5, 7, 9]


def test_columns_of_an_array_are_read_and_written_by_name() -> None:
    array = np.arange(24.0).reshape(2, 12)
    rows = Named(array, TABLE)
    assert rows.last.tolist() == [11.0, 23.0]
    assert rows.two.tolist() == [[1.0, 2.0], [13.0, 14.0]]
    assert rows.part.until.tolist() == [4.0, 16.0]
    assert rows.times.begin.tolist() == [[5.0, 7.0, 9.0], [17.0, 19.0, 21.0]]
    rows.last, rows.two, rows.times.until[0, 1] = -1.0, 5.0, -8.0
    assert array[:, 11].tolist() == [-1.0, -1.0]
    assert array[:, 1:3].tolist() == [[5.0, 5.0]] * 2
    assert array[0, 8] == -8.0


def test_a_row_alone_gives_numbers() -> None:
    clock = columns.blank("clock")
    clock.end = 2.5
    assert isinstance(clock.end, np.float64)
    assert clock.end == 2.5
    assert np.flatnonzero(clock.array).tolist() == [columns.CLOCK.end]


def test_an_unknown_name_is_an_error_that_lists_the_columns() -> None:
    row = columns.blank("clock")
    for ask in (lambda: row.ends, lambda: columns.CLOCK.ends):
        with pytest.raises(
            AttributeError, match=r"no column 'ends'; columns are\n  begin: begin of the window\n  end: end"
        ):
            ask()
    with pytest.raises(AttributeError, match="'ends'"):
        row.ends = 1.0


@pytest.mark.parametrize("text", ["", "ends with a point.", "two\nlines", None, 2, ("",)])
def test_a_column_without_a_text_is_refused(text: object) -> None:
    with pytest.raises(ValueError, match=r"other: must have a text of one line"):
        Columns(one="first", other=text)


def names_of(table: Columns) -> Iterator[str]:
    """Names in a table, and in the tables that it contains."""
    for name, column in table.at.items():
        yield name
        inner = column.of if isinstance(column, Several) else column
        if isinstance(inner, Columns):
            yield from names_of(inner)


@pytest.mark.parametrize("table", ALL_TABLES.values(), ids=ALL_TABLES)
def test_no_name_of_a_column_is_that_of_something_else(table: Columns) -> None:
    """`array.copy` is the copy, whatever columns there are."""
    backend.start()
    from ifrdem.kernels.compiler.records import NamedRow

    taken = {*dir(Columns), "at", "first", "width", *dir(Named), *dir(NamedRow)}
    assert not taken & set(names_of(table))


def test_bytes_of_disks_are_those_of_their_columns() -> None:
    """Of a plain disk by hand: three parts of 5 reals and 4 integers, 4 + 2 integers of its history, 8 of ghosts.

    Of one that may rest: three parts of a state and 4 contacts of an id and 4 forces, 3 integers, 3 reals, the forces
    again, and 8 contacts of 21 reals.
    """
    assert columns.bytes_per_disk() == 3 * (5 * 8 + 4 * 4) + 4 * 4 + 8
    assert columns.RESTING_BYTES == 3 * (4 + 20 * 8) + 3 * 4 + 3 * 8 + 20 * 8 + 8 * 21 * 8


def test_kernels_read_and_write_columns_by_name() -> None:
    backend.start()
    from support.kernels.records import move

    from ifrdem.kernels.compiler.language import ti

    disk, scale = ti.Vector.ndarray(5, ti.f64, 2), columns.blank("scale")
    disk.from_numpy(np.arange(10.0).reshape(2, 5))
    tile = ti.ndarray(ti.i32, (1, columns.TILE.width))
    tile.fill(0)
    scale.moment[2] = 0.5
    move(disk, tile, scale.array)
    rows = named(disk.to_numpy(), "disk")
    assert rows.x.tolist() == [0.0 + 0.5 * 2.0, 5.0 + 0.5 * 7.0]
    assert rows.y.tolist() == [1.0, 6.0]
    found = named(tile.to_numpy(), "tile")
    assert found.count.tolist() == [[0, 2]]
    assert found.start.tolist() == [[3, 0]]


def test_a_wrong_name_in_a_kernel_is_reported() -> None:
    backend.start()
    from support.kernels.records import wrong

    from ifrdem.kernels.compiler.language import CompilationError, ti

    disk = ti.Vector.ndarray(5, ti.f64, 2)
    with pytest.raises(CompilationError, match=r"no column 'mass'; columns are\n  x: position .*\n  y: "):
        wrong(disk)


def test_mechanisms_of_kernels_are_those_of_files_in_their_order() -> None:
    """The sums of a ledger are stored column by column: another order would be read as other mechanisms."""
    assert tuple(columns.MECHANISM.texts) == MECHANISMS
