"""Commands `analyse` and `plot`: results of analyses of a trajectory, as tables, files and pictures."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ..analysis.names import ANALYSES, OPTIONS
from ..errors import DamageError, InputError, there_are
from ..plots.names import PICTURES
from ..tools import text_file
from .console import FAILED, echo, note, warn
from .options import (
    Average,
    Axis,
    Bins,
    Cells,
    Color,
    Dpi,
    Force,
    Frames,
    From,
    Lag,
    NoTitle,
    Panels,
    Phases,
    Size,
    Style,
    Theory,
    TheoryName,
    Windows,
    Xlim,
    Ylim,
    chosen_frames,
    flag,
    one_trajectory,
    opened,
    option,
    styled,
)

if TYPE_CHECKING:
    from ..analysis.result import Columns, Evaluation
    from ..trajectory.reader import Trajectory

ELSEWHERE = "; --force replaces it, -o DIR writes elsewhere"
MOST_SUMMARY = 100_000_000  # bytes of a summary at most
RUN = ("name", "seed", "started")
"""Parameters of a trajectory that identify its run."""


def _list(texts: Mapping[str, str]) -> str:
    """Lines of names and texts."""
    return "\n".join(f"{name:<{max(map(len, texts))}}  {text}" for name, text in texts.items())


PICTURE_LIST, ANALYSIS_LIST = _list(PICTURES), _list({name: each.text for name, each in ANALYSES.items()})


def _known(kind: str, name: str, names: Sequence[str]) -> None:
    if name not in names:
        raise InputError(f"no {kind} is called '{name}'{there_are(name, names)}")


def analyse(
    *words: Annotated[
        str,
        Parameter(
            name="FILE WHAT",
            help="trajectories (.h5), or the folder of one, then names of analyses (default: all)",
        ),
    ],
    frames: Frames = None,
    start: From = None,
    axis: Axis = None,
    bins: Bins = None,
    cells: Cells = None,
    average: Average = False,
    windows: Windows = None,
    phases: Phases = None,
    lag: Lag = None,
    theory: Theory = None,
    output: Annotated[
        str | None, option(str, "DIR", "folder for the files (default: FILE-analysis)", "--output", "-o")
    ] = None,
    json: Annotated[bool, flag("print the JSON instead of the table")] = False,
    list: Annotated[bool, flag("list the names and analyse nothing")] = False,
    force: Force = False,
) -> int:
    """Analyse a trajectory: distributions, g(r), S(k), diffusion, clusters.

    Prints a table with standard errors, and writes a CSV file for each analysis and one JSON file.

    Without names, all that the file allows; the exit status is 1 if damage of it keeps one from being done. Analyses of
    single frames take up to 20 of the second half, and fewer of large gases. Averages over time of a gas that is
    driven, sheared or between walls begin where it is steady, in the first half of the run. --frames or --from says
    which frames are used. A folder that is there gets the analyses that it lacks; --force replaces those that it has.
    Of several files, the mean over them of every number is printed too, with its standard error.
    """
    if list:
        echo(ANALYSIS_LIST)
        return 0
    files_end = (i for i, word in enumerate(words) if not (word.endswith(".h5") or Path(word).exists()))
    count = next(files_end, len(words))
    sources, what = words[:count], words[count:]
    if not sources:
        raise InputError(f"{words[0]}: there is no such file or folder" if words else "TRAJECTORY is missing")
    for name in what:
        _known("analysis", name, tuple(ANALYSES))
    options = _options(
        what or tuple(ANALYSES),
        axis=axis,
        bins=bins,
        cells=cells,
        average=average,
        windows=windows,
        phases=phases,
        lag=lag,
    )
    files = [one_trajectory(source) for source in sources]
    with _theory_by(theory):
        records = [_analyse(file, what, frames, start, options, output, json, force) for file in files]
    if len(files) > 1 and not json:
        for line in _means(records):
            echo(line)
    return FAILED if any(record["damaged"] for record in records) else 0


def _theory_by(name: TheoryName | None) -> contextlib.AbstractContextManager[None]:
    """The context of `--theory`; without it none, which would import the runtime."""
    if name is None:
        return contextlib.nullcontext()
    from ..simulation.by_dsmc import theory_by

    return theory_by(dsmc=name == "dsmc")


def _options(what: Sequence[str], **given: Any) -> dict[str, dict[str, Any]]:
    """Options that are given, by the analysis that takes them; InputError if that is not among those to do."""
    found: dict[str, dict[str, Any]] = {}
    for name, value in given.items():
        if value is None or value is False:
            continue
        if OPTIONS[name] not in what:
            raise InputError(f"--{name} requires {OPTIONS[name]}")
        found.setdefault(OPTIONS[name], {})[name] = value
    return found


def _means(records: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines on the mean over files of every number that all of them have, and its standard error."""
    import numpy as np

    from ..analysis.catalogue import number
    from ..analysis.result import Reading
    from ..tools.intervals import PERCENT

    n = len(records)
    yield f"mean over {n} files, with the standard error of the scatter between them, and the {PERCENT} interval"
    for name in ANALYSES:
        values = [record["analyses"][name]["values"] for record in records if name in record["analyses"]]
        for key, found in values[0].items() if len(values) == len(records) else ():
            each = [one[key]["value"] for one in values if one.get(key, {}).get("value") is not None]
            if len(each) == len(values):
                error = float(np.std(each, ddof=1) / len(each) ** 0.5)
                mean = Reading(found["name"], float(np.mean(each)), error, found["unit"], n_eff=len(each))
                mean = mean._replace(ends=mean.interval if error > 0.0 else None)
                yield f"  {name}: {mean.name:<40} {number(mean)}"


def _analyse(
    file: str,
    what: Sequence[str],
    frames: str | None,
    start: float | None,
    options: dict[str, dict[str, Any]],
    output: str | None,
    json: bool,
    force: bool,
) -> dict[str, Any]:
    """Analyse one trajectory; the record that its JSON file holds."""
    from ..tools.files import check_apart, check_files

    with opened(file) as trajectory:
        numbers = chosen_frames(trajectory, frames, start)
        stem = trajectory.path.stem
        folder = Path(output or f"{stem}-analysis")
        summary = folder / f"{stem}.json"
        if not folder.parent.is_dir():
            raise InputError(f"output folder {folder}: {folder.parent} does not exist")
        if os.path.lexists(folder) and not folder.is_dir():
            raise InputError(f"output {folder}: must be a folder; -o DIR writes elsewhere")
        check_files([summary if folder.is_dir() else folder], force=True)  # which others may be added to
        if folder.is_dir():
            check_apart(summary, trajectory.path)
        record = _summary_record(trajectory, summary, force=force)
        names, kept = _wanted(what, record, summary, force=force)

        from ..analysis.catalogue import FUNCTIONS, report
        from ..analysis.result import span_text

        skipped: dict[str, str] = {}
        damaged: dict[str, str] = {}
        written: dict[Path, Columns] = {}
        for name in names:
            try:
                evaluation = FUNCTIONS[name](trajectory, numbers, **options.get(name, {}))
            except InputError as error:
                if what:
                    raise InputError(f"{name}: {error}") from None
                (damaged if isinstance(error, DamageError) else skipped)[name] = str(error)
                continue
            files = {
                folder / f"{stem}-{name}{f'-{part}' if part else ''}.csv": table
                for part, table in evaluation.tables.items()
            }
            written |= files
            record["analyses"][name] = _record(evaluation, [path.name for path in files])
            if not json:
                echo(report(name, ANALYSES[name].title, evaluation, span_text(trajectory, evaluation)))
        found = record["analyses"]
        record["analyses"] = {name: found[name] for name in ANALYSES if name in found}
        reasons = record["not_possible"] | skipped
        record["not_possible"] = {name: reason for name, reason in reasons.items() if name not in found}
        record["damaged"] = damaged
        if folder.exists():
            for path in written:
                check_apart(path, trajectory.path)
            check_files(list(written), force=force, elsewhere="-o DIR writes elsewhere")
    text = _write(folder, summary, record, written)
    if json:
        echo(text)
        return record
    for name, reason in (skipped | damaged).items():
        echo(f"{name}: not possible: {reason}")
    for name in kept:
        note(f"{name}: is there already, and stays as it is; --force replaces it")
    for path in (*written, summary):
        note(f"wrote {path}")
    return record


def _summary_record(trajectory: Trajectory, summary: Path, *, force: bool) -> dict[str, Any]:
    """The record of existing results of this trajectory in the folder; empty without any, or by force.

    Raises InputError if the file that exists is a summary of another trajectory, or no summary.
    """
    from ..analysis.catalogue import json_number

    run = {key: trajectory.parameters[key] for key in RUN if key in trajectory.parameters}
    new: dict[str, Any] = {
        "file": str(trajectory.path),
        "disks": trajectory.n,
        "run": {key: value if isinstance(value, str) else json_number(value) for key, value in run.items()},
        "analyses": {},
        "not_possible": {},
        "damaged": {},  # analyses that need a part of the file that cannot be read; it may be mended
    }
    if not summary.exists():
        return new
    try:
        old = json.loads(text_file.read(summary, most=MOST_SUMMARY))
        held = {key: dict(old[key]) for key in ("analyses", "not_possible")}
        rows = [row for one in held["analyses"].values() for row in one["values"].values()]
        if not all({"name", "value", "unit"} <= row.keys() for row in rows):
            raise KeyError("values")
        if all(old[key] == new[key] for key in ("disks", "run")):
            return {**new, **held}
        problems = f"holds analyses of another run ({old['file']})"
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        problems = "is not a summary that `ifrdem analyse` wrote"
    if force:
        return new
    raise InputError(f"output {summary}: {problems}{ELSEWHERE}")


def _wanted(
    what: Sequence[str], record: dict[str, Any], summary: Path, *, force: bool
) -> tuple[list[str], list[str]]:
    """Analyses to do, and existing ones that are kept."""
    requested = list(dict.fromkeys(what)) or list(ANALYSES)
    there = [name for name in requested if name in record["analyses"]]
    if force or not there:
        return requested, []
    missing = [name for name in requested if name not in there]
    if what or not set(missing) - set(record["not_possible"]):
        held = ", ".join(there) if what else "all that the file allows"
        raise InputError(f"output {summary}: holds {held} already{ELSEWHERE}")
    return missing, there


def _record(evaluation: Evaluation, files: list[str]) -> dict[str, Any]:
    from ..analysis.catalogue import json_number
    from ..analysis.result import identifier

    return {
        "frames": evaluation.frames,
        "times": list(evaluation.times),
        "values": {
            identifier(row.key or row.name): {
                "name": row.name,
                "value": json_number(row.value),
                "error": json_number(row.error),
                "n_eff": json_number(row.n_eff),
                "interval_95": [json_number(end) for end in row.interval],
                "unit": row.unit,
            }
            for row in evaluation.rows
        },
        "warnings": evaluation.warnings,
        "notes": evaluation.notes,
        "files": files,
    }


def _write(folder: Path, summary: Path, record: dict[str, Any], tables: dict[Path, Columns]) -> str:
    """Write the tables, then the summary that names them, each whole or not at all; returns the summary."""
    from ..tools.files import write_aside, write_text
    from ..trajectory.export import write_csv

    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"output {folder}: cannot be made: {error.strerror}") from error
    for path, table in tables.items():
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        write_aside(path, partial(write_csv, names=table, rows=rows))
    text = json.dumps(record, indent=2)
    write_text(summary, f"{text}\n")
    return text


def plot(
    *words: Annotated[
        str,
        Parameter(
            name="FILE WHAT",
            help="trajectories (.h5) or the results of a study (.nc), and a name from `ifrdem plot --list`",
        ),
    ],
    over: Annotated[
        str | None,
        option(
            str,
            "AXIS",
            "of a quantity: tau (collisions per disk), t (time), or a swept key (default: the rows)",
        ),
    ] = None,
    by: Annotated[
        str | None, option(str, "KEY", "of a study: a curve for each value of this key (default: the first)")
    ] = None,
    map: Annotated[
        bool,
        flag(
            "of a study: colours over two swept keys, --over along and --by upwards (default: the first two)"
        ),
    ] = False,
    list: Annotated[bool, flag("list the names and draw nothing")] = False,
    frames: Frames = None,
    start: From = None,
    axis: Axis = None,
    bins: Bins = None,
    cells: Cells = None,
    average: Average = False,
    windows: Windows = None,
    phases: Phases = None,
    lag: Lag = None,
    output: Annotated[
        str | None,
        option(
            str,
            "PICTURE",
            "NAME.png, .svg or .pdf, or NAME (default: FILE-WHAT.png, with the keys of --over and --by)",
            "--output",
            "-o",
        ),
    ] = None,
    color: Color = None,
    style: Style = None,
    size: Size = None,
    dpi: Dpi = 200,
    xlim: Xlim = None,
    ylim: Ylim = None,
    panels: Panels = None,
    theory: Theory = None,
    no_title: NoTitle = False,
    force: Force = False,
) -> None:
    """Draw a trajectory, several, or a study: temperatures, disks, velocity, rdf, structure-factor, msd.

    Of a study (FILE.nc), and of several trajectories, WHAT is a quantity of the whole gas: T, T_rot, theta, energy,
    and so on; of a study, with the 95 % interval of the mean over seeds, and kinetic theory; --over a swept key, means
    over the steady window of each run, or --from a place on. Of one trajectory, temperatures, energy, ledger, mechanisms, walls, piston and
    species can be drawn `--over tau` or `t`.
    For a column of a journal: `--size 3.4in --dpi 300 --no-title --style paper -o NAME.pdf`.
    """
    if list:
        echo(PICTURE_LIST)
        return
    if len(words) == 1 and words[0].endswith(".nc"):
        from ..study.figure import drawable
        from ..study.results import Results

        names = ", ".join(drawable(Results.read(words[0])))
        raise InputError(f"WHAT is missing: a quantity of the study; there are {names}")
    if len(words) < 2:
        raise InputError("TRAJECTORY or WHAT is missing: `ifrdem plot --list` lists the plots")
    *sources, what = words
    options = _options(
        [what], axis=axis, bins=bins, cells=cells, average=average, windows=windows, phases=phases, lag=lag
    ).get(what, {})
    together = len(sources) > 1 or sources[0].endswith(".nc")
    form: dict[str, Any] = {"size": size, "dpi": dpi, "title": not no_title, "xlim": xlim, "ylim": ylim}
    with styled(style), _theory_by(theory):
        if together or by is not None or (over is not None and what not in PICTURES):
            if frames is not None:
                raise InputError("--frames: of one trajectory only")
            form |= {"start": start, "as_map": map, "shown": panels}
            _plot_together(sources, what, over, by, output, force=force, form=form)
        else:
            if map:
                raise InputError("--map: of the results of a study")
            _plot_one(
                sources[0],
                what,
                frames,
                start,
                output,
                force=force,
                over=over,
                color=color,
                panels=panels,
                **form,
                **options,
            )


def _plot_one(
    source: str,
    what: str,
    frames: str | None,
    start: float | None,
    output: str | None,
    *,
    force: bool,
    color: str | None,
    **options: Any,
) -> None:
    """A picture of one trajectory."""
    file = one_trajectory(source)
    _known("picture", what, tuple(PICTURES))
    if color is not None:
        from ..plots.disks import colour_of

        colour_of(color, "--color")
    from ..tools.files import check_apart, check_files

    if start is not None and what not in ANALYSES:
        raise InputError(f"--from: cannot be combined with {what}; it is an option of {', '.join(ANALYSES)}")
    with opened(file) as trajectory:
        numbers = chosen_frames(trajectory, frames, start)
        path = Path(output or _default_name(trajectory.path.stem, what, over=options["over"]))
        check_apart(path, trajectory.path)
        path = _as_picture(path)
        check_apart(path, trajectory.path)
        check_files([path], force=force)
        from ..plots import pictures, run

        run.save(pictures.figure(trajectory, what, frames=numbers, color=color, **options), path)
    note(f"wrote {path}")


def _plot_together(
    sources: Sequence[str],
    what: str,
    over: str | None,
    by: str | None,
    output: str | None,
    *,
    force: bool,
    form: dict[str, Any],
) -> None:
    """A quantity of a study or of several trajectories."""
    from ..study import figure, results
    from ..tools.files import check_files

    if any(source.endswith(".nc") for source in sources):
        if len(sources) > 1:
            raise InputError(
                f"{len(sources)} files: the results of one study, or trajectories only, are drawn together"
            )
        found = results.Results.read(sources[0])
    elif form["start"] is not None:
        raise InputError("--from: of the results of a study, or of one trajectory")
    else:
        with contextlib.ExitStack() as stack:
            files = [one_trajectory(source) for source in sources]
            found = figure.of_trajectories([stack.enter_context(opened(file)) for file in files])
    path = _as_picture(Path(output or _default_name(Path(sources[0]).stem, what, over=over, by=by)))
    check_files([path], force=force)
    drawn = figure.draw(found, what, over, by, note=warn, **form)
    from ..plots import run

    run.save(drawn, path)
    if count := results.warnings_of(found)[:1]:
        warn(f"{count[0]}: `ifrdem info {sources[0]}` lists them")
    note(f"wrote {path}")


def _default_name(stem: str, what: str, **axes: str | None) -> str:
    """The name of a picture without -o, such as en-T-over-t-by-e_n.png: pictures over other axes have other names."""
    given = (f"-{word}-{_plain_name(key)}" for word, key in axes.items() if key is not None)
    return f"{stem}-{what}{''.join(given)}.png"


def _plain_name(key: str) -> str:
    """A key as part of the name of a file: material[0].e_n as material-0-e_n."""
    return re.sub(r"[^\w]+", "-", key).strip("-")


def _as_picture(path: Path) -> Path:
    """The file of a picture: with .png behind a name that has no ending, as in NAME of `ifrdem fit --picture`.

    Raises InputError if the ending is that of another format.
    """
    from ..plots.run import FORMATS

    if path.suffix.lower()[1:] in FORMATS or path.is_dir() or (path.exists() and not path.is_file()):
        return path  # the latter two are refused by `check_files`
    # Behind "mu0.21" there is no ending: what follows its point is no word.
    if path.suffix[1:].isalpha():
        allowed = ", ".join(f".{each}" for each in FORMATS)
        raise InputError(f"-o {path}: the name of a picture ends in {allowed}, or has no ending")
    return path.with_name(f"{path.name}.png")
