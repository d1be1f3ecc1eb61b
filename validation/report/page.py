"""The report: one HTML file with its pictures inside, and every figure as PNG and PDF."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ...tools.files import write_bytes, write_text
from .registry import Drawing, Picture, Table, Verdict, group_of
from .terminal import number

GREEK = {name: f"&{name};" for name in ("psi", "delta", "alpha", "omega", "mu", "rho")} | {"eps": "&epsilon;"}
SYMBOLS = "|".join((*GREEK, *"evmRkdPTV"))  # what may have a subscript


def write(place: Path, outcomes: Sequence[Verdict], record: Mapping[str, str]) -> None:
    """Write report.html and the figures into a folder.

    Raises InputError if one of the files cannot be written.
    """
    for drawing in (each for outcome in outcomes for each in outcome.drawings):
        for ending in ("png", "pdf"):
            write_bytes(place / f"{drawing.name}.{ending}", drawing.files[ending])
    write_text(place / "report.html", page(outcomes, record))


def page(outcomes: Sequence[Verdict], record: Mapping[str, str]) -> str:
    """The text of report.html, from the template of this name."""
    environment = Environment(
        loader=PackageLoader(__package__, "."), autoescape=True, undefined=StrictUndefined
    )
    environment.filters.update(
        rich=lambda cell: rich(cell) if isinstance(cell, str) else number(float(cell)),
        number=number,
        numbers=number_columns,
        letter=lambda index: chr(ord("a") + index),
        base64=lambda data: base64.b64encode(data).decode(),
    )
    groups = {group_of(each.name) for each in outcomes}
    group = groups.pop() if len(groups) == 1 else "paper"
    return environment.get_template("report.html").render(outcomes=outcomes, record=record, group=group)


def draw(picture: Picture) -> Drawing:
    """Render a picture, as PNG, PDF and SVG."""
    figure = picture.figure
    # One layout serves the three files.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    files = {}
    # Without the date, the same results give the same files.
    for ending, no_date in (("png", {}), ("pdf", {"CreationDate": None}), ("svg", {"Date": None})):
        file = io.BytesIO()
        figure.savefig(file, format=ending, metadata=no_date)
        files[ending] = file.getvalue()
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return Drawing(picture.name, picture.caption, (width, height), files)


def number_columns(table: Table) -> list[int]:
    """Columns of a table that hold numbers."""
    return [i for i, cell in enumerate(table.rows[0]) if not isinstance(cell, str)] if table.rows else []


def rich(text: str) -> Markup:
    """HTML of a text with the paper's symbols: Greek letters by name, an underscore before a subscript."""
    escaped = re.sub(rf"\b({SYMBOLS})_([a-z0-9]+)\b", r"\1<sub>\2</sub>", html.escape(text))
    symbols = rf"(?<![\w/])({'|'.join(GREEK)})(?![\w.])"
    return Markup(re.sub(symbols, lambda found: GREEK[found[1]], escaped))
