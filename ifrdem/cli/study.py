"""The command `study`."""

from __future__ import annotations

import re
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from .console import FAILED, complain, note, say, warn
from .options import Set, flag, option, whole


def study(
    file: Annotated[
        str,
        Parameter(name="STUDY", help="a study file (`ifrdem new study`), a case file, or a shipped case"),
    ],
    /,
    *,
    vary: Annotated[
        list[str] | None,
        option(
            "KEY=VALUES",
            "a key of the case to vary: 0.7,0.8,0.9 or 0.1:0.5:5 (five values, evenly) or 0.01:1:5:log; repeatable "
            '(every combination is run); "KEY=...;KEY=..." vary together',
        ),
    ] = None,
    seeds: Annotated[str | None, option("N", "number of seeds, or a list such as 1,2,5 (default: 1)")] = None,
    set: Set = None,
    output: Annotated[
        str | None,
        option(
            "NC",
            "file of results; runs are kept in NAME.runs (default: STUDY.nc, or CASE-study.nc)",
            "--output",
            "-o",
        ),
    ] = None,
    workers: Annotated[
        str | None,
        option("N", "processes of this machine (default: one for each core); 0: none but this one"),
    ] = None,
    scheduler: Annotated[
        str | None, option("ADDRESS", "run on this cluster of Dask, tcp://host:8786")
    ] = None,
    keep_going: Annotated[bool, flag("leave out points that `check` refuses")] = False,
    part: Annotated[
        str | None, option("K/M", "the K-th of M parts of the runs, without results: for array jobs")
    ] = None,
    dry_run: Annotated[
        bool, flag("say points, runs, disk space and expected time, and start nothing")
    ] = False,
) -> int:
    """Run a case for many values of its keys and many seeds, on all cores or on a cluster.

    Writes one file of results (NetCDF-4, for xarray): series and analyses of all runs, means and standard errors over
    seeds, kinetic theory beside them. Called again, it goes on where it was stopped, and runs only what is new.
    """
    share = None
    if part is not None:
        match = re.fullmatch(r"(\d+)/(\d+)", part)
        if match is None or not 1 <= int(match[1]) <= int(match[2]):
            raise InputError(f"--part {part}: K/M is needed, such as 3/10, the third of ten parts")
        share = int(match[1]), int(match[2])
    count = None if workers is None else whole("--workers", workers, 0, 10_000)
    from ..run.signals import Stopped
    from ..study.study import Study

    it = Study(file, vary=vary or [], set=set or [], seeds=seeds, output=output)
    wrong = it.check(keep_going=keep_going, workers=count, scheduler=scheduler)
    for line in it.summary(count, scheduler):
        (say if dry_run else note)(line)
    if dry_run:
        for line in wrong:
            warn(f"left out: {line}")
        return 0
    try:
        failed = it.run(
            workers=count, scheduler=scheduler, keep_going=keep_going, part=share, say=note, warn=warn
        )
    except Stopped as error:
        complain(str(error))
        return error.status
    if share is None and it.output.exists():
        note(
            f"wrote {it.output}: `ifrdem plot {it.output} T --over tau` draws it; xarray.open_dataset opens it"
        )
    if failed:
        complain(f"{len(failed)} of {it.runs} runs failed; the same command tries them again:")
        for name, message in failed.items():
            complain(f"  {name}: {message}")
        return FAILED
    return 0
