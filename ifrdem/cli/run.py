"""Commands about cases and runs: `run`, `resume`, `status`, `study`, `check`, `new`, `cases`."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .. import mpi
from ..errors import InputError, Stopped, TrajectoryError, refuse
from ..tools.files import check_files, write_bytes, write_text
from ..tools.values import Count, Integer, Number, Several
from .console import FAILED, UNFINISHED, complain, echo, note, ranks, warn
from .options import (
    Case,
    Device,
    Force,
    MaxHours,
    NoPicture,
    Precision,
    Runtime,
    Seed,
    Set,
    Threads,
    flag,
    invalid_value,
    option,
    overrides,
)  # fmt: skip

if TYPE_CHECKING:
    from cyclopts import Token


def run(
    case: Case,
    /,
    *,
    set: Set = None,
    device: Device = None,
    seed: Seed = None,
    threads: Threads = None,
    precision: Precision = None,
    runtime: Runtime = None,
    output: Annotated[
        str | None,
        option(
            str,
            "PATH",
            "folder for NAME.h5 and NAME.png, or the files' path without its ending (default: this folder)",
            "--output",
            "-o",
        ),
    ] = None,
    force: Force = False,
    no_picture: NoPicture = False,
    max_hours: MaxHours = None,
) -> int:
    """Run a case: writes NAME.h5 and NAME.png.

    Input errors are reported before anything is written. Ctrl-C and SIGTERM end a run in good order, with a checkpoint
    from which `ifrdem resume` continues. `mpiexec -n P ifrdem run CASE` shares the gas among P processes.
    """
    _spare_threads()
    changes = overrides(set, device=device, seed=seed, threads=threads, precision=precision, runtime=runtime)
    # Which files there will be is known only from the case, so a wrong case comes first.
    from ..case import file as case_file
    from ..case import shipped
    from ..runs.outputs import Outputs

    comm = ranks()
    file = case_file.read_on_ranks(lambda: shipped.find(case), changes, comm)

    def planned() -> Outputs:
        outputs = Outputs.plan(file.case, output, picture=not no_picture)
        outputs.check(force=force)  # before the imports below, which take a second
        return outputs

    outputs = comm.root_result(planned)

    from ..runs import run as running

    return _ended(
        lambda: running.run(file, outputs, force=force, max_hours=max_hours, log=note, warn=warn, comm=comm)
    )


def resume(
    source: Annotated[
        str, Parameter(name="PATH", help="the trajectory (NAME.h5), or the folder that it is in")
    ],
    /,
    *,
    threads: Annotated[
        int | None, option(Count, "N", "CPU threads; the result does not depend on it")
    ] = None,
    runtime: Runtime = None,
    ignore_case_changes: Annotated[
        bool, flag("resume the case as it was, though its file has changed")
    ] = False,
    no_picture: NoPicture = False,
    max_hours: MaxHours = None,
) -> int:
    """Resume a run that was stopped.

    From the checkpoint of a run that was interrupted, terminated, killed or out of time: the trajectory becomes
    bitwise that of a run that was never stopped.
    """
    _spare_threads()
    from ..runs import resume as resuming

    comm = ranks()
    comm.run_on_root(lambda: resuming.find(source))  # before anything takes a second
    return _ended(
        lambda: resuming.resume(
            source, ignore_case_changes=ignore_case_changes, threads=threads, runtime=runtime,
            max_hours=max_hours, picture=not no_picture, log=note, warn=warn, comm=comm,
        )
    )  # fmt: skip


def _spare_threads() -> None:
    """Have NumPy and SciPy, when they are imported, start no threads for large matrices: a run has none."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _ended(work: Callable[[], None]) -> int:
    """Exit status of a run."""
    try:
        work()
    except (TrajectoryError, Stopped) as error:
        return mpi.communicator.end(
            error.status if isinstance(error, Stopped) else FAILED, str(error), complain
        )
    return 0


def status(
    path: Annotated[
        str,
        Parameter(
            name="PATH", help="the trajectory (NAME.h5), NAME.status.json, or a folder: its newest run"
        ),
    ],
    /,
    *,
    follow: Annotated[bool, flag("print a line at each change until the run ends")] = False,
    interval: Annotated[
        float,
        option(
            Annotated[float, Number(0.01, 3600.0, "a number of seconds from 0.01 to 3600")],
            "S",
            "with --follow: seconds between two looks (default: 1)",
        ),
    ] = 1.0,
) -> int:
    """Print the progress of a run or study, and the time left.

    Reads the status file next to the trajectory; nothing is locked, and the run may be that of another user. A run
    whose process is gone without an end is "dead". The exit status is 0 for a run that is done or runs, 3 for one that
    was stopped, and 1 for one that failed or died.
    """
    from ..runs import status as of_run

    ends = {of_run.RUNNING: 0, of_run.DONE: 0, of_run.INTERRUPTED: UNFINISHED}
    return ends.get(of_run.show(path, echo, follow=follow, interval=interval), FAILED)


def _part(_kind: object, tokens: Sequence[Token]) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", tokens[-1].value)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise invalid_value(tokens, "must be K/M, such as 3/10, the third of ten parts")
    return int(match[1]), int(match[2])


def study(
    file: Annotated[
        str,
        Parameter(
            name="STUDY", help="a study file (`ifrdem new study`), a case file, or a shipped study or case"
        ),
    ],
    /,
    *,
    vary: Annotated[
        list[str] | None,
        option(
            str,
            "KEY=VALUES",
            "a key of the case to vary: 0.7,0.8,0.9 or 0.1:0.5:5 (five values, evenly) or 0.01:1:5:log; repeatable "
            '(every combination is run); "KEY=...;KEY=..." vary together',
        ),
    ] = None,
    seeds: Annotated[
        str | None, option(str, "N", "number of seeds, or a list such as 1,2,5 (default: 1)")
    ] = None,
    coefficients: Annotated[
        int | None,
        option(
            Several,
            "N",
            "run N sets of coefficients, drawn from the errors that materials and pairs of the case have",
        ),
    ] = None,
    set: Set = None,
    output: Annotated[
        str | None,
        option(
            str,
            "NC",
            "file of results; runs are kept in NAME.runs (default: STUDY.nc, or CASE-study.nc)",
            "--output",
            "-o",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        option(
            Annotated[int, Integer(0, 10_000)],
            "N",
            "processes of this machine (default: one for each core); 0: none but this one",
        ),
    ] = None,
    scheduler: Annotated[
        str | None, option(str, "ADDRESS", "run on this cluster of Dask, tcp://host:8786")
    ] = None,
    keep_going: Annotated[bool, flag("leave out points that `check` refuses")] = False,
    part: Annotated[
        tuple[int, int] | None,
        option(
            str,
            "K/M",
            "the K-th of M parts of the runs, without results: for array jobs",
            converter=_part,
            n_tokens=1,
        ),
    ] = None,
    dry_run: Annotated[
        bool, flag("say points, runs, disk space and expected time, and start nothing")
    ] = False,
) -> int:
    """Run a case for many values of its keys and many seeds, on all cores or on a cluster.

    Writes one file of results (NetCDF-4, for xarray): series and analyses of all runs, means and standard errors over
    seeds, and kinetic theory. Called again, it resumes where it was stopped, and runs only what is new.
    """
    from ..study.study import Study

    it = Study(file, vary=vary or [], set=set or [], seeds=seeds, coefficients=coefficients, output=output)
    warnings = it.check(keep_going=keep_going, workers=workers, scheduler=scheduler)
    for line in it.summary(workers, scheduler):
        (echo if dry_run else note)(line)
    if dry_run:
        for line in warnings:
            warn(line)
        return 0
    try:
        failed = it.run(
            workers=workers, scheduler=scheduler, keep_going=keep_going, part=part, log=note, warn=warn
        )
    except Stopped as error:
        complain(str(error))
        return error.status
    if part is None and it.output.exists():
        note(
            f"wrote {it.output}: `ifrdem plot {it.output} T --over tau` draws it; xarray.open_dataset opens it"
        )
    if failed:
        complain(f"{len(failed)} of {it.runs} runs failed; the same command tries them again:")
        for name, message in failed.items():
            complain(f"  {name}: {message}")
        return FAILED
    return 0


def check(case: Case, /, *, set: Set = None) -> None:
    """Check a case without running it.

    Reports the mistakes of a case, all of a kind at once; of a good one its packing fraction, mean free paths,
    whether its laws can add energy, its file size and memory. With mpiexec, also what so many ranks cannot do.
    A warning says what `ifrdem run` would refuse on this machine: too little memory, disk or permission. The exit
    status is 0 then, as the case is a good one.
    """
    from ..case import file as case_file
    from ..case import report as reporting
    from ..case import shipped, starts

    comm = ranks()
    gas = case_file.read_on_ranks(lambda: shipped.find(case), set or [], comm).gas
    share, sliced = comm.local_share, gas.is_distributed(comm.size) and starts.is_made_in_slices(gas)

    def report() -> None:
        count, reason = gas.usable_ranks(comm.size)
        found = reporting.check(gas, Path(), share=share, ranks=count, sliced=sliced)
        echo(found.text)
        if count < comm.size:
            echo(f"  {count} of {comm.size} ranks compute, the others wait: {reason}")
        for each in found.warnings:
            warn(each)

    comm.run_on_root(report)


KIND = (
    "kind of file, or a shipped case or study as cases/NAME.toml, studies/NAME.toml (default: list the kinds)"
)


def new(
    kind: Annotated[str | None, Parameter(name="KIND", help=KIND)] = None,
    /,
    *,
    short: Annotated[bool, flag("of a template, only the keys that make the gas")] = False,
    output: Annotated[
        str | None,
        option(
            str,
            "FILE",
            "file to write (default: KIND.toml; - prints it); of notebooks, the folder",
            "--output",
            "-o",
            allow_leading_hyphen=True,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write a commented case file to start from.

    A template with every key there is, or a shipped case or study (cases/NAME.toml, studies/NAME.toml, see `ifrdem
    cases`). `ifrdem new study` writes a study, `ifrdem new notebook` the notebooks of the manual for Jupyter.
    """
    from ..case import shipped

    if kind is None:
        unused = ("--short", short), ("-o", output is not None), ("--force", force)
        refuse([f"{name}: requires a KIND" for name, given in unused if given])
        echo(shipped.kinds())
        return
    if output is not None and not output.strip():
        raise InputError(f"-o {output!r}: must be the path of a file")
    if kind == shipped.NOTEBOOK and not short:
        _new_notebooks(output, force=force)
        return
    if kind == shipped.STUDY and not short:
        from ..study import plan  # imports h5py

        text = plan.TEMPLATE
    else:
        text = shipped.new(kind, short=short)
    if output == "-":
        echo(text, end="")
        return
    path = Path(output or f"{Path(kind).stem}.toml")
    if not path.name:  # the root, or "."
        raise InputError(f"-o {output}: is a folder, must be a file")
    # Start and measured positions of a shipped case.
    data = sorted(shipped.FOLDER.glob(f"{Path(kind).stem}*.csv"))
    check_files([path, *(path.with_name(each.name) for each in data)], force=force)
    write_text(path, text)
    for each in data:
        write_bytes(path.with_name(each.name), each.read_bytes())
    quoted = shlex.quote(str(path))
    try_first, run = ("study --dry-run", "study") if shipped.is_study(kind) else ("check", "run")
    note(f"wrote {path}: look at it with `ifrdem {try_first} {quoted}`, run it with `ifrdem {run} {quoted}`")


def _new_notebooks(output: str | None, *, force: bool) -> None:
    """Write the notebooks of the manual into a folder, or into the current one."""
    from . import notebooks

    folder = Path(output or ".")
    if not folder.is_dir():
        raise InputError(f"-o {output}: must be a folder that exists, for the notebooks")
    sources = sorted(notebooks.FOLDER.glob("*.py"))
    paths = [folder / f"{each.stem}.ipynb" for each in sources]
    check_files(paths, force=force)
    for path, source in zip(paths, sources, strict=True):
        write_text(path, notebooks.as_ipynb(source.read_text(encoding="utf-8")))
    note(f"wrote {', '.join(map(str, paths))}: open them with Jupyter (`pip install jupyterlab`) or VS Code")


def cases() -> None:
    """List the shipped cases and studies."""
    from ..case import shipped

    echo(shipped.listing())
