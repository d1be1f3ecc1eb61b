"""The command `validate`."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from .console import say
from .options import flag, option, whole

NAMES = "cases or groups to run: paper (default), bullet, gas, device, or see --list"
JOBS = "cases at a time, each in a process of its own (default: gas as many as there are cores, others 1)"


def validate(
    *names: Annotated[str, Parameter(name="NAME", help=NAMES)],
    quick: Annotated[bool, flag("fewer samples: under a minute (gas: two minutes)")] = False,
    seed: Annotated[str | None, option("N", "of the random gases of gas (default: 1)")] = None,
    jobs: Annotated[str | None, option("N", JOBS)] = None,
    list: Annotated[bool, flag("list the cases and run none")] = False,
    output: Annotated[
        str, option("DIR", "folder (default: validation-report)", "--output", "-o")
    ] = "validation-report",
    force: Annotated[bool, flag("replace a report that is there")] = False,
) -> int:
    """Reproduce the paper through the kernels.

    Collides disks as the paper does, and compares with its equations, tables and figures; `validate bullet` compares
    with PyBullet and pymunk instead, `validate gas` holds gases of many disks against the literature, `validate device`
    a GPU against the CPU. Writes results.json, report.html and the figures. Exit status 0 only if every row passed.
    """
    from ..tools import arguments
    from ..validation.report import runner

    if list:
        say(runner.listing())
        return 0
    return runner.validate(
        names,
        output,
        quick=quick,
        force=force,
        seed=None if seed is None else whole("--seed", seed, 0, runner.MOST_SEED),
        jobs=None if jobs is None else arguments.whole("--jobs", jobs, 1),
        say=say,
    )
