"""Commands that run cases: `run`, `resume`, `tail`."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError, Stopped, TrajectoryError
from ..tools import world
from .console import FAILED, complain, note, ranks, say, warn
from .options import (
    Arch,
    Case,
    Force,
    MaxHours,
    NoPicture,
    Precision,
    Seed,
    Set,
    Threads,
    flag,
    max_hours,
    number,
    option,
    overrides,
)  # fmt: skip


def run(
    case: Case,
    /,
    *,
    set: Set = None,
    arch: Arch = None,
    seed: Seed = None,
    threads: Threads = None,
    precision: Precision = None,
    output: Annotated[
        str | None,
        option(
            "PLACE",
            "folder for NAME.h5 and NAME.png, or the files' path without its ending (default: this folder)",
            "--output",
            "-o",
        ),
    ] = None,
    force: Force = False,
    no_picture: NoPicture = False,
    maxh: MaxHours = None,
) -> int:
    """Run a case: writes NAME.h5 and NAME.png.

    Bad input is told before anything is written. Ctrl-C and SIGTERM end a run in good order, with a checkpoint
    from which `ifrdem resume` goes on. `mpiexec -n P ifrdem run CASE` shares the gas among P processes.
    """
    _spare_threads()
    changes = overrides(set, arch=arch, seed=seed, threads=threads, precision=precision)
    hours = max_hours(maxh)
    # Which files there will be is known only from the case, so a wrong case comes first.
    from ..case import file as case_file
    from ..case import shipped
    from ..run.outputs import Outputs

    comm = ranks()
    file = case_file.read_on_ranks(lambda: shipped.find(case), changes, comm)

    def planned() -> Outputs:
        outputs = Outputs.plan(file.case, output, picture=not no_picture)
        outputs.check(force=force)  # before the imports below, which take a second
        return outputs

    outputs = world.from_first(comm, planned)

    from ..run import job

    return _ended(
        lambda: job.run(file, outputs, force=force, max_hours=hours, say=note, warn=warn, comm=comm)
    )


def resume(
    place: Annotated[
        str, Parameter(name="PLACE", help="the trajectory (NAME.h5), or the folder that it is in")
    ],
    /,
    *,
    threads: Annotated[str | None, option("N", "CPU threads; the result does not depend on it")] = None,
    ignore_case_changes: Annotated[
        bool, flag("go on with the case as it was, though its file has changed")
    ] = False,
    no_picture: NoPicture = False,
    maxh: MaxHours = None,
) -> int:
    """Go on with a run that was stopped.

    From the checkpoint of a run that was interrupted, terminated, killed or out of time: the trajectory becomes
    bitwise that of a run that was never stopped.
    """
    _spare_threads()
    hours = max_hours(maxh)
    if threads is not None and not (threads.isdecimal() and int(threads) > 0):
        raise InputError(f"--threads {threads}: a whole number, 1 or more, is needed")
    from ..run import resume as resuming

    comm = ranks()
    world.on_first(comm, lambda: resuming.find(place))  # before anything takes a second
    return _ended(
        lambda: resuming.resume(
            place, ignore_case_changes=ignore_case_changes, threads=int(threads) if threads else None, max_hours=hours,
            picture=not no_picture, say=note, warn=warn, comm=comm,
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
        return world.end(error.status if isinstance(error, Stopped) else FAILED, str(error), complain)
    return 0


def tail(
    path: Annotated[
        str,
        Parameter(
            name="PATH", help="the trajectory (NAME.h5), NAME.status.json, or a folder: its newest run"
        ),
    ],
    /,
    *,
    once: Annotated[bool, flag("print one line and end")] = False,
    interval: Annotated[str, option("S", "seconds between two looks (default: 1)")] = "1",
) -> int:
    """Follow a run from another terminal.

    A line at each news of the run until it ends, from the status file beside its trajectory. The run may be
    anybody's who can write to the same disk; nothing is locked. A run that died is told as such.
    """
    need = "a number of seconds from 0.01 to 3600"
    seconds = number("--interval", interval, need, lambda value: 0.01 <= value <= 3600.0)
    from ..run import status

    return (
        0 if status.tail(path, say, follow=not once, interval=seconds) in (status.RUNNING, "done") else FAILED
    )
