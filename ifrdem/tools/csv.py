"""Rows of CSV files with the lines that they stand in."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from ..errors import InputError
from . import text_file


def read(path: Path, *, most: int, delimiter: str = ",") -> tuple[list[list[str]], list[int]]:
    """Rows of texts and their line numbers, from 1; empty lines and those that begin with # are left out.

    The file has `most` bytes at most; `delimiter` separates its columns.

    Raises InputError as `text_file.read`, or if it is not CSV. The message does not name the file.
    """
    text = text_file.read(path, most=most, bom=True)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        numbered = [
            (row, reader.line_num)
            for row in reader
            if any(text.strip() for text in row) and not row[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}") from None
    return [row for row, _ in numbered], [line for _, line in numbered]


def is_number(text: str) -> bool:
    """True if a text is a number, NaN and infinity included."""
    try:
        float(text)
    except ValueError:
        return False
    return True
