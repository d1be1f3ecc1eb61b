"""Commands about the program: `validate`, `bench`, `devices`, `docs`."""

from __future__ import annotations

import json as json_format
from typing import Annotated, Any

from cyclopts import Parameter

from ..errors import InputError, refuse
from ..kernels.compiler.runtime import choose as choose_runtime
from ..tools.values import Count, Integer, Natural, Number, Ratio, RatioOrZero
from . import manual
from .console import echo, progress, ranks
from .options import (
    Device,
    Precision,
    Runtime,
    Set,
    Threads,
    flag,
    option,
    overrides,
)

DENSEST = 0.9068  # packing fraction, nearly that of equal disks that touch on a hexagonal lattice
THINNEST = 1e-5  # thinner gases hardly ever collide
NAMES = "cases or groups to run: paper (default), bullet, lammps, gas, device, or see --list"
JOBS = "cases at a time, each in a process of its own (default: gas and lammps as many as there are cores, others 1)"


def validate(
    *names: Annotated[str, Parameter(name="NAME", help=NAMES)],
    quick: Annotated[bool, flag("fewer samples: under a minute (gas: two minutes)")] = False,
    seed: Annotated[
        int | None,
        option(Annotated[int, Integer(0, 1_000_000)], "N", "of the random gases of gas (default: 1)"),
    ] = None,
    jobs: Annotated[int | None, option(Count, "N", JOBS)] = None,
    runtime: Runtime = None,
    list: Annotated[bool, flag("list the cases and run none")] = False,
    output: Annotated[
        str, option(str, "DIR", "folder (default: validation-report)", "--output", "-o")
    ] = "validation-report",
    force: Annotated[bool, flag("replace a report that is there")] = False,
) -> int:
    """Compare the program with the paper, the literature and other codes.

    Collides disks as the paper does, and compares with its equations, tables and figures; `validate bullet` compares
    with PyBullet and pymunk instead, `validate lammps` with LAMMPS, `validate gas` holds gases of many disks against the literature, `validate device`
    a GPU against the CPU. Writes results.json, report.html and the figures. Exit status 0 only if every row passed.
    """
    choose_runtime(runtime, "--runtime")
    from ..validation.report import runner

    if list:
        echo(runner.listing())
        return 0
    return runner.validate(
        names,
        output,
        quick=quick,
        force=force,
        seed=seed,
        jobs=jobs,
        log=echo,
    )


def bench(
    *,
    n: Annotated[
        int | None, option(Annotated[int, Integer(2)], "N", "disks of the elastic gas (default: 1e5)")
    ] = None,
    phi: Annotated[
        float | None,
        option(
            Annotated[float, Number(THINNEST, DENSEST, f"a packing fraction from {THINNEST} to {DENSEST}")],
            "PHI",
            "its packing fraction (default: 0.3)",
        ),
    ] = None,
    device: Device = None,
    precision: Precision = None,
    runtime: Runtime = None,
    threads: Threads = None,
    runs: Annotated[int, option(Annotated[int, Integer(1, 10_000)], "R", "timed runs (default: 5)")] = 5,
    seconds: Annotated[
        float,
        option(Ratio, "S", "least length of a timed run (default: 0.5)"),
    ] = 0.5,
    seed: Annotated[int | None, option(Natural, "N", "seed of the random numbers")] = None,
    json: Annotated[bool, flag("print one JSON object with every figure")] = False,
    profile: Annotated[bool, flag("measure the share of each kernel too")] = False,
    case: Annotated[str | None, option(str, "FILE", "time the gas of a case file instead")] = None,
    after: Annotated[
        float,
        option(RatioOrZero, "C", "collisions per disk that the case has before it is timed (default: 0)"),
    ] = 0.0,
    set: Set = None,
) -> None:
    """Measure the speed of the program on this machine.

    Times warm kernels: an elastic gas at equilibrium, or a case (--case). Prints the median of several runs and their
    range; progress goes to the standard error stream. Under `mpiexec -n P` it times one gas on P ranks, and counts what
    they send. A grid of gases, start times and the cost of output are scripts (`ifrdem docs performance`).
    """
    choose_runtime(runtime, "--runtime")
    from ..kernels.columns import most_disks
    from ..model.device import Device as OfSimulation
    from ..simulation import backend
    from ..validation.speed import bench as timing

    problems = _conflicts({"n": n, "phi": phi}, {"after": after, "set": set}, case)
    if n is not None and n > most_disks():
        problems.append(f"--n {n}: must be an integer from 2 to {most_disks()}")
    if threads is not None and threads > backend.cores():
        problems.append(
            f"--threads {threads}: must be an integer from 1 to {backend.cores()}, the cores here"
        )
    comm = ranks()
    try:
        backend.check(OfSimulation(device or "cpu", precision=precision or "f64"))
    except InputError as error:
        problems.append(f"--{error}")
    refuse(problems)
    chosen: dict[str, Any] = {
        "n": n or 100_000, "phi": phi or 0.3, "runs": runs, "seconds": seconds, "seed": 1 if seed is None else seed,
        "after": after, "threads": threads, "device": device or "cpu", "precision": precision or "f64",
        "profile": profile, "note": progress,
    }  # fmt: skip
    if case is not None:
        chosen["overrides"] = overrides(set, device=device, seed=seed, threads=threads, precision=precision)
    found = timing.bench(case, comm=comm, **chosen)
    if not comm.is_root:
        return
    echo(json_format.dumps(found.figures(), indent=2) if json else found.report())


def _conflicts(of_gas: dict[str, Any], of_case: dict[str, Any], case: str | None) -> list[str]:
    """A line for each option that has no effect with the others."""
    if case is None:
        return [f"--{name} requires --case" for name, value in of_case.items() if value]
    keys = {"n": "number of a species", "phi": "box.packing_fraction"}
    return [
        f"--{name}: cannot be combined with --case; --set changes the case's {keys[name]}"
        for name, value in of_gas.items()
        if value is not None
    ]


def devices() -> None:
    """List the devices that can compute, and the runtime that compiles for them."""
    from .. import bullet
    from ..kernels.compiler import language  # noqa: F401  (an error where the runtime cannot be loaded)
    from ..kernels.compiler.runtime import describe
    from ..simulation import backend

    for each in backend.available():
        echo(f"{each.name:<8} {each.description}")
    absence = backend.cuda_absence()
    if absence is not None:
        echo(f"cuda     not usable: {absence}")
    echo(f"runtime  {describe()}")
    echo(f"pybullet {bullet.describe()}")


def docs(
    topic: Annotated[
        str | None, Parameter(name="TOPIC", help="page to print (default: the list of pages)")
    ] = None,
    /,
) -> None:
    """Read the manual."""
    echo(manual.page(topic))
