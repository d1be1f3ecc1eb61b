"""The report: one HTML file with its pictures inside, and every figure as PNG and PDF beside it."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError
from .registry import BULLET, GAS, Picture, Row, Table
from .terminal import number

if TYPE_CHECKING:
    from .runner import Outcome

CSS = """
body { font: 15px/1.45 Georgia, serif; max-width: 62em; margin: 2em auto; padding: 0 1em; color: #111; }
h1, h2, h3 { font-weight: normal; } h2 { border-bottom: 1px solid #999; margin-top: 2.5em; }
table { border-collapse: collapse; font: 12.5px/1.35 Helvetica, Arial, sans-serif; margin: 1em 0; }
th, td { padding: .18em .7em .18em 0; text-align: left; vertical-align: top; border-bottom: 1px solid #e2e2e2; }
th { border-bottom: 1px solid #666; }
td.n, th.n { text-align: right; } td.n { white-space: nowrap; font-variant-numeric: tabular-nums; }
.passed { color: #00664a; } .failed { color: #fff; background: #b3261e; padding: 0 .3em; } .skipped { color: #8a5a00; }
tr.bad td { background: #fbe3e1; }
figure { margin: 1.5em 0; } figure img { max-width: 100%; }
figcaption { font-size: 13.5px; color: #333; max-width: 50em; }
pre { background: #f4f4f4; padding: .6em; overflow-x: auto; font-size: 12px; }
.note { font-size: 13.5px; color: #333; }
"""


GREEK = {name: f"&{name};" for name in ("psi", "delta", "alpha", "omega", "mu", "rho")} | {"eps": "&epsilon;"}
SYMBOLS = "|".join((*GREEK, *"evmRkdPTV"))  # what may have a subscript


INTRODUCTION = {
    "paper": (
        "The IFR law, reproduced through the kernels",
        "Every measured value below comes from disks that the engine of ifrdem flew into each other, written to a "
        "trajectory and read back; coins on a table were flown by the table kernels. Expected values come from the "
        "closed forms of A. Domenech-Carbo, <i>Independent friction-restitution modeling of two-disk collisions</i>, "
        "with its misprints corrected, or from where the row says. Markers in the figures are simulated, lines are "
        "theory. Cases called bullet compare with code that nobody here wrote.",
    ),
    "bullet": (
        "The engine against code that nobody here wrote",
        "PyBullet and pymunk are general-purpose physics engines. Where their law, Newton's restitution and Coulomb's "
        "friction, is a limit of ours (e<sub>t</sub> = -1, contact-point sticking), they must agree with our kernels; "
        'where it is not, they cannot, and <a href="#bullet_anomaly">bullet_anomaly</a> says by how much and what '
        "agreement proves. Neither code has periodic boundaries, exact times of impact or the IFR law itself; "
        '<a href="#bullet_ifr">bullet_ifr</a> brings the law into PyBullet.',
    ),
    "gas": (
        "Gases of many disks, held against the literature",
        "Every measured value below is the mean of independent simulations (replicas), with its standard error "
        "from their scatter; expected values come from publications and from kinetic theory. A row passes if they "
        "differ by no more than the statistical tolerance, which is the same number of standard errors for all "
        "rows (4 of a Gaussian; Student's t), and the systematic one, which is what the expected value itself "
        "may be off by. results.json has all of it.",
    ),
}
"""Title and first paragraph of a report of the group's cases, as HTML."""


def write(place: Path, outcomes: Sequence[Outcome], record: Mapping[str, str]) -> None:
    """Write report.html and the figures into a folder.

    Raises
    ------
    InputError
        If one of the files cannot be written.
    """
    try:
        body = [_head(outcomes, record)]
        for outcome in outcomes:
            body.append(_case(place, outcome))
        text = (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f"<title>ifrdem: validation</title>\n<style>{CSS}</style>\n</head>\n<body>\n"
            + "\n".join(body)
            + "\n</body>\n</html>\n"
        )
        (place / "report.html").write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{error.filename or place}: cannot be written: {error.strerror}") from error


def _head(outcomes: Sequence[Outcome], record: Mapping[str, str]) -> str:
    summary = _rows(
        ("case", "question", "rows", "failed", "status", "s"),
        (
            (
                f'<a href="#{_text(each.name)}">{_text(each.name)}</a>',
                _text(each.question),
                str(len(each.result.rows)),
                str(len(each.failures)),
                f'<span class="{each.status}">{each.status}</span>',
                f"{each.seconds:.1f}",
            )
            for each in outcomes
        ),
        numbers=(2, 3, 5),
    )
    where = _rows(("", ""), ((_text(key), _text(value)) for key, value in record.items()))
    kinds = {"bullet" if each.name in BULLET else "gas" if each.name in GAS else "paper" for each in outcomes}
    title, text = INTRODUCTION[kinds.pop() if len(kinds) == 1 else "paper"]
    return f"<h1>{title}</h1>\n<p>{text}</p>\n{summary}\n<h3>Environment</h3>\n{where}"


def _case(place: Path, outcome: Outcome) -> str:
    parts = [
        f'<h2 id="{_text(outcome.name)}">{_text(outcome.name)} '
        f'<span class="{outcome.status}">{outcome.status}</span></h2>',
        f"<p>{rich(outcome.question)}<br><span class='note'>Reference: {rich(outcome.reference)}</span></p>",
    ]
    if outcome.skipped:
        parts.append(f'<p class="skipped">Skipped: {_text(outcome.skipped)}</p>')
    if outcome.error:
        parts.append(f'<p><span class="failed">failed</span> {_text(outcome.error)}</p>')
        parts.append(f"<pre>{_text(outcome.details)}</pre>")
    parts += [_figure(place, drawing) for drawing in outcome.drawings]
    parts += [_table(table) for table in outcome.result.tables]
    if outcome.result.rows:
        parts.append(_comparisons(outcome))
    return "\n".join(parts)


def _comparisons(outcome: Outcome) -> str:
    """The rows of a case; the reasons of the tolerances below, by letter."""
    rows = outcome.result.rows
    letters = {
        reason: chr(ord("a") + i) for i, reason in enumerate(dict.fromkeys(row.reason for row in rows))
    }
    with_printed = any(row.printed is not None for row in rows)
    sampled = any(row.sampling is not None for row in rows)
    header = (
        "", "quantity", "measured", "expected", "tolerance", *(("printed",) * with_printed),
        *(("standard error", "systematic", "disks", "seeds") if sampled else ()), "source",
    )  # fmt: skip
    cells = []
    for row in rows:
        status = "passed" if row.passed else "failed"
        cells.append(
            (
                f'<span class="{status}">{status}</span>',
                rich(row.quantity),
                number(row.measured),
                number(row.expected),
                f"{'at least' if row.least else number(row.tolerance)} <sup>{letters[row.reason]}</sup>",
                *((number(row.printed),) * with_printed),
                *(_sampling(row) if sampled else ()),
                rich(row.source),
            )
        )
    reasons = "<br>".join(f"<sup>{letter}</sup> {rich(reason)}" for reason, letter in letters.items())
    bad = [not row.passed for row in rows]
    table = _rows(header, cells, numbers=range(2, 5 + with_printed + 3 * sampled), bad=bad)
    return f'{table}<p class="note">Reasons of the tolerances:<br>{reasons}</p>'


def _sampling(row: Row) -> tuple[str, str, str, str]:
    """Standard error, systematic tolerance, disks and seeds of a row; empty if nothing was random."""
    s = row.sampling
    if s is None:
        return "", "", "", ""
    return (
        number(s.error),
        number(s.systematic),
        f"{s.replicas} x {s.disks}",
        f"{s.seeds[0]}&#8211;{s.seeds[1]}",
    )


@dataclass(frozen=True)
class Drawing:
    """A picture as it is written: its files by their endings, and its width and height in pixels on the page."""

    name: str
    caption: str
    size: tuple[int, int]
    files: dict[str, bytes]


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


def _figure(place: Path, drawing: Drawing) -> str:
    for ending in ("png", "pdf"):
        (place / f"{drawing.name}.{ending}").write_bytes(drawing.files[ending])
    data = base64.b64encode(drawing.files["svg"]).decode()
    width, height = drawing.size
    return (
        f'<figure id="{_text(drawing.name)}"><img width="{width}" height="{height}" alt="{_text(drawing.caption)}" '
        f'src="data:image/svg+xml;base64,{data}"><figcaption>{rich(drawing.caption)}</figcaption></figure>'
    )


def _table(table: Table) -> str:
    cells = [
        tuple(rich(cell) if isinstance(cell, str) else number(float(cell)) for cell in row)
        for row in table.rows
    ]
    numbers = [i for i, cell in enumerate(table.rows[0]) if not isinstance(cell, str)] if table.rows else []
    note = f'<p class="note">{rich(table.note)}</p>' if table.note else ""
    return f"<h3>{rich(table.title)}</h3>\n{_rows(table.header, cells, numbers=numbers)}{note}"


def _rows(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    numbers: Iterable[int] = (),
    bad: Sequence[bool] | None = None,
) -> str:
    """A table; cells are HTML already."""
    right = set(numbers)
    kinds = [' class="n"' if column in right else "" for column in range(len(header))]
    head = "".join(f"<th{kind}>{rich(cell)}</th>" for cell, kind in zip(header, kinds, strict=True))
    lines = ["<table>", f"<tr>{head}</tr>"]
    for i, row in enumerate(rows):
        mark = ' class="bad"' if bad is not None and bad[i] else ""
        cells = "".join(f"<td{kind}>{cell}</td>" for cell, kind in zip(row, kinds, strict=True))
        lines.append(f"<tr{mark}>{cells}</tr>")
    return "\n".join([*lines, "</table>"])


def _text(text: str) -> str:
    return html.escape(text)


def rich(text: str) -> str:
    """HTML of a text with the paper's symbols: Greek letters by name, an underscore before a subscript."""
    escaped = re.sub(rf"\b({SYMBOLS})_([a-z0-9]+)\b", r"\1<sub>\2</sub>", html.escape(text))
    return re.sub(rf"(?<![\w/])({'|'.join(GREEK)})(?![\w.])", lambda found: GREEK[found[1]], escaped)
