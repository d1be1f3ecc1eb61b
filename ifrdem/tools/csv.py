"""Rows of CSV files with the lines that they stand in."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError
from . import text_file


def each(path: Path, *, most: int, delimiter: str = ",") -> Iterator[tuple[list[str], int]]:
    """Rows of texts with their line numbers, from 1, read one by one; empty lines and those that begin with # left out.

    The file has `most` bytes at most; `delimiter` separates its columns.

    Raises InputError as `text_file.lines`, or if it is not CSV. The message does not name the file.
    """
    reader = csv.reader(text_file.lines(path, most=most), delimiter=delimiter)
    try:
        for row in reader:
            if any(text.strip() for text in row) and not row[0].lstrip().startswith("#"):
                yield row, reader.line_num
    except csv.Error as error:
        raise InputError(f"line {reader.line_num}: not a CSV file: {error}") from None
