"""Rows of CSV files with the lines that they stand in."""

from __future__ import annotations

import csv
from pathlib import Path

from ..errors import InputError, nearest


def read(path: Path) -> tuple[list[list[str]], list[int]]:
    """Rows of texts and their line numbers, from 1; empty lines and those that begin with # are left out.

    Raises
    ------
    InputError
        If there is no such file, or it is not CSV in UTF-8. The message does not name the file.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            numbered = [
                (row, reader.line_num)
                for row in reader
                if any(text.strip() for text in row) and not row[0].lstrip().startswith("#")
            ]
    except FileNotFoundError:
        names = [each.name for each in path.parent.glob("*.csv")] if path.parent.is_dir() else []
        raise InputError(f"there is no such file{nearest(path.name, names)}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"not a text file in UTF-8: {error.reason} at byte {error.start}") from None
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}") from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from None
    return [row for row, _ in numbered], [line for _, line in numbered]


def is_number(text: str) -> bool:
    """Whether a text is a number, NaN and infinity included."""
    try:
        float(text)
    except ValueError:
        return False
    return True
