"""Rows of arrays on a GPU, for the host: those that ranks send one another (`ifrdem/simulation/ranks.py`)."""

from typing import Any

from .language import ti
from .layout import Rows, Table


def width(array: Any) -> int:
    """Number of columns of an array of vectors that a kernel was given; 0 of one of numbers."""
    shape = array.element_shape()
    return int(shape[0]) if len(shape) else 0


@ti.kernel
def take_rows(array: Rows, at: Rows, rows: Table):
    """Copy the rows `at` of an array into a table."""
    for i in range(at.shape[0]):
        if ti.static(width(array) == 0):
            rows[i, 0] = array[at[i]]
        else:
            for column in ti.static(range(width(array))):
                rows[i, column] = array[at[i]][column]


@ti.kernel
def put_rows(array: Rows, at: Rows, rows: Table):
    """Copy a table into the rows `at` of an array."""
    for i in range(at.shape[0]):
        if ti.static(width(array) == 0):
            array[at[i]] = rows[i, 0]
        else:
            for column in ti.static(range(width(array))):
                array[at[i]][column] = rows[i, column]
