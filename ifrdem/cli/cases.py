"""Commands about cases and devices: `check`, `new`, `cases`, `backends`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from ..tools import world
from .console import note, ranks, say, warn
from .options import Case, Force, Set, option


def check(case: Case, /, *, set: Set = None) -> None:
    """Look at a case without running it.

    Reports the mistakes of a case, all of a kind at once; of a good one its packing fraction, mean free paths,
    whether its laws can add energy, its file size and memory. With mpiexec, also what so many ranks cannot do.
    """
    from ..case import file as case_file
    from ..case import shipped, summary
    from ..case.estimate import RunEstimate

    comm = ranks()
    gas = case_file.read_on_ranks(lambda: shipped.find(case), set or [], comm).gas

    def report() -> None:
        estimate = RunEstimate.of(gas)
        summary.refuse_cadences(gas, estimate)
        crushes = gas.crushes()
        say(summary.report(gas, estimate))
        for text in (*crushes, *gas.cautions):
            warn(text)
        try:
            summary.refuse_beyond_disk(estimate.file_bytes, Path())
        except InputError as error:  # it may run elsewhere
            warn(f"{error}: `ifrdem run` would refuse it here")

    world.on_first(comm, report)


KIND = (
    "cooling (one kind of coins), driven (random kicks), mixture (two), walls (a shaken floor), study (many gases at "
    "once), or cases/NAME.toml"
)


def new(
    kind: Annotated[str, Parameter(name="KIND", help=KIND)],
    /,
    *,
    output: Annotated[
        str | None,
        option(
            "FILE",
            "file to write (default: KIND.toml; - prints it)",
            "--output",
            "-o",
            allow_leading_hyphen=True,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write a commented case file to start from.

    A template with every key there is, or a shipped case (cases/NAME.toml, see `ifrdem cases`).
    """
    from ..case import shipped
    from ..study import template
    from ..tools.files import check_files

    text = template.TEXT if kind == "study" else shipped.new(kind)
    if output == "-":
        print(text, end="")
        return
    path = Path(output or f"{Path(kind).stem}.toml")
    data = sorted(
        shipped.FOLDER.glob(f"{Path(kind).stem}*.csv")
    )  # start and measured places of a shipped case
    check_files([path.with_name(each.name) for each in data], force=force)
    try:
        with path.open("w" if force else "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path}: exists already; --force replaces it, -o writes elsewhere") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    for each in data:
        path.with_name(each.name).write_bytes(each.read_bytes())
    quoted = shlex.quote(str(path))
    look, run = ("study --dry-run", "study") if kind == "study" else ("check", "run")
    note(f"wrote {path}: look at it with `ifrdem {look} {quoted}`, run it with `ifrdem {run} {quoted}`")


def cases() -> None:
    """List the shipped cases."""
    from ..case import shipped

    say(shipped.listing())


def backends() -> None:
    """List the devices that can compute."""
    from .. import bullet
    from ..kernels import language  # noqa: F401  (an error where Taichi cannot be loaded)
    from ..simulation import device

    for each in device.available():
        say(f"{each.arch:<8} {each.description}")
    absence = device.cuda_absence()
    if absence is not None:
        say(f"cuda     not usable: {absence}")
    say(f"pybullet {bullet.describe()}")
