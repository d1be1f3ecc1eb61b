"""Columns of arrays by name while Taichi compiles: `gas.motion[i].vx` is the expression that `motion[i][2]` is.

Taichi evaluates attributes of objects that it does not know in Python, so nothing of this is in the compiled
program. Only this module calls the subscript function of Taichi.
"""

from collections import namedtuple
from collections.abc import Mapping, Sequence
from typing import Any

from ..columns import SINGLE, Columns, Several
from .language import ti

_subscript = ti.lang.impl.subscript


def _at(value: Any, *index: Any) -> Any:
    """The element `value[index]` of a Taichi array or vector, as an expression that can be assigned too."""
    return _subscript(None, value, *index)


class NamedRow:
    """A row of an array, or an array of one row: columns are attributes by name and items by number.

    A row that is a vector can be assigned as a whole, by `vector`. A variable of a kernel that stands for a row follows
    its index: when the index variable changes, it stands for another row.
    """

    _data_oriented = True  # Taichi then lets a variable of a kernel stand for it
    __slots__ = ("_array", "_columns", "_index", "_offset")

    def __init__(self, array: Any, index: tuple[Any, ...], columns: Columns, offset: Any = None) -> None:
        self._array, self._index, self._columns, self._offset = array, index, columns, offset

    @property
    def shape(self) -> Any:
        """Shape of the array that the row is in."""
        return self._array.shape

    @property
    def vector(self) -> Any:
        """All columns of an array of vectors."""
        return _at(self._array, *self._index)

    def __getattr__(self, name: str) -> Any:
        column = self._columns.column(name)
        if isinstance(column, int):
            return self[column]
        return _Group(self, column)

    def __getitem__(self, column: Any) -> Any:
        if self._offset is not None:  # one of several
            column = self._offset if isinstance(column, int) and column == 0 else self._offset + column
        if not self._index:
            return _at(self._array, column)
        if self._array.element_shape():
            return _at(_at(self._array, *self._index), column)
        return _at(self._array, *self._index, column)


class NamedVector(NamedRow):
    """The numbers of a vector, or of a flat array, by the names of columns."""

    _is_taichi_function = _is_quadrants_function = (
        False  # with either, no warning where a kernel calls the class
    )
    __slots__ = ()

    def __init__(self, vector: Any, columns: Columns) -> None:
        super().__init__(vector, (), columns)


class Records:
    """An `array` whose rows have columns with names: `records[i]` is one of them, or `records[i, j]` with more axes."""

    _data_oriented = True
    __slots__ = ("_columns", "array")

    def __init__(self, array: Any, columns: Columns) -> None:
        self.array, self._columns = array, columns

    @property
    def shape(self) -> Any:
        """Shape of the array."""
        return self.array.shape

    def __getitem__(self, index: Any) -> NamedRow:
        return NamedRow(self.array, index if isinstance(index, tuple) else (index,), self._columns)


class InColumns:
    """Records in a flat array, column after column: column c of row i lies at first + c * rows + i.

    Threads that work on adjacent rows then reach adjacent numbers.
    """

    _data_oriented = True
    __slots__ = ("_array", "_columns", "_first", "_rows")

    def __init__(self, array: Any, columns: Columns, first: Any, rows: int) -> None:
        self._array, self._columns, self._first, self._rows = array, columns, first, rows

    def __getitem__(self, i: Any) -> "_RowInColumns":
        return _RowInColumns(self, i)

    def at(self, i: Any, column: Any) -> Any:
        """A column of row i."""
        return _at(self._array, self._first + column * self._rows + i)


class _RowInColumns:
    """A row of `InColumns`."""

    _data_oriented = True
    __slots__ = ("_index", "_records")

    def __init__(self, records: InColumns, index: Any) -> None:
        self._records, self._index = records, index

    def __getattr__(self, name: str) -> Any:
        return self._records.at(self._index, self._records._columns.column(name))

    def __getitem__(self, column: Any) -> Any:
        return self._records.at(self._index, self._records._columns.first + column)


class From:
    """The numbers of a flat array from a first one on."""

    _data_oriented = True
    __slots__ = ("_array", "_first")

    def __init__(self, array: Any, first: Any) -> None:
        self._array, self._first = array, first

    def __getitem__(self, i: Any) -> Any:
        return _at(self._array, self._first + i)


class Split:
    """Records of which some columns lie in arrays of their own: `columns` has these by name, `rows` the others."""

    _data_oriented = True
    __slots__ = ("_columns", "_rows")

    def __init__(self, rows: Any, columns: Mapping[str, Any]) -> None:
        self._rows, self._columns = rows, columns

    def __getitem__(self, i: Any) -> "_SplitRow":
        return _SplitRow(self._rows[i], self._columns, i)


class _SplitRow:
    """A row of `Split`."""

    _data_oriented = True
    __slots__ = ("_columns", "_index", "_row")

    def __init__(self, row: Any, columns: Mapping[str, Any], index: Any) -> None:
        self._row, self._columns, self._index = row, columns, index

    def __getattr__(self, name: str) -> Any:
        found = self._columns.get(name)
        return getattr(self._row, name) if found is None else _at(found, self._index)


class NamedNumbers:
    """Numbers of an array from a `first` one on by name, in the precision of the run. `n_more` follow (`more_of`)."""

    _data_oriented = True
    __slots__ = ("_array", "_first", "_more", "_names")

    def __init__(self, array: Any, names: Sequence[str], first: int = 0, n_more: int = 0) -> None:
        self._array, self._names, self._first = array, names, first
        self._more = range(first + len(names), first + len(names) + n_more)

    def __getattr__(self, name: str) -> Any:
        if name not in self._names:
            raise AttributeError(f"no number {name!r}; there are {', '.join(self._names) or 'none'}")
        return ti.cast(_at(self._array, self._first + self._names.index(name)), float)

    def __getitem__(self, index: Any) -> Any:
        raise KeyError(index)


def more_of(numbers: NamedNumbers) -> list[Any]:
    """The numbers without a name that follow those of `numbers`, in the precision of their array, for `ti.static`."""
    return [_at(numbers._array, index) for index in numbers._more]


class _Group:
    """Several columns of a row: by number, or those of a table by name."""

    _data_oriented = True
    __slots__ = ("_columns", "_row")

    def __init__(self, row: NamedRow, columns: Several | Columns) -> None:
        self._row, self._columns = row, columns

    def __getattr__(self, name: str) -> Any:
        return self._row[self._columns.column(name)]

    def __getitem__(self, m: Any) -> Any:
        row, column = self._row, self._columns[m]
        of = self._columns.of
        return row[column] if of is None else NamedRow(row._array, row._index, of, column)

    @property
    def other(self) -> "_Other":
        """The other one of two columns: `other[0]` is column 1."""
        return _Other(self._row, self._columns.first)


class _Other:
    """Two columns of a row, in reverse order."""

    __slots__ = ("_first", "_row")

    def __init__(self, row: NamedRow, first: int) -> None:
        self._row, self._first = row, first

    def __getitem__(self, m: Any) -> Any:
        return self._row[self._first + 1 - m]


def gas_of(kernel: str, tables: Mapping[str, Columns], names: Sequence[str], *arrays: Any) -> Any:
    """A bundle, while `kernel` is compiled, of its arrays by these names, with the columns of `tables`."""
    found = []
    for name, array in zip(names, arrays, strict=True):
        if name not in tables:
            found.append(array)
        else:
            found.append(
                NamedRow(array, (), tables[name]) if name in SINGLE else Records(array, tables[name])
            )

    class Bundle(namedtuple("Bundle", names)):  # type: ignore[misc]
        """The arrays of the kernel."""

        __slots__ = ()

        def __getattr__(self, name: str) -> Any:
            raise AttributeError(
                f'kernel {kernel} has no array {name!r}: name it in its list, Arrays("{" ".join(names)}")'
            )

    return Bundle(*found)
