"""Commands about the program: `validate`, `bench`, `devices`, `docs`."""

from __future__ import annotations

import json as json_format
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ..errors import InputError, there_are
from .console import progress, ranks, say
from .options import Precision, Set, Wrong, flag, number, option, overrides, whole

DENSEST = 0.9068  # packing fraction, nearly that of equal disks that touch on a hexagonal lattice
THINNEST = 1e-5  # thinner gases hardly ever collide
MANUAL = Path(__file__).parents[1] / "docs"
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


def bench(
    *,
    n: Annotated[str | None, option("N", "disks of the elastic gas (default: 1e5)")] = None,
    phi: Annotated[str | None, option("PHI", "its packing fraction (default: 0.3)")] = None,
    device: Annotated[str | None, option("DEVICE", "device: cpu or cuda (see `ifrdem devices`)")] = None,
    precision: Precision = None,
    threads: Annotated[str | None, option("N", "CPU threads (default: all cores)")] = None,
    runs: Annotated[str | None, option("R", "timed runs (default: 5)")] = None,
    seconds: Annotated[str | None, option("S", "least length of a timed run (default: 0.5)")] = None,
    seed: Annotated[str | None, option("N", "seed of the random numbers")] = None,
    json: Annotated[bool, flag("print one JSON object with every figure")] = False,
    profile: Annotated[bool, flag("measure the share of each kernel too")] = False,
    case: Annotated[str | None, option("FILE", "time the gas of a case file instead")] = None,
    after: Annotated[
        str | None, option("C", "collisions per disk that the case has before it is timed (default: 0)")
    ] = None,
    set: Set = None,
) -> None:
    """Measure how fast it runs here.

    Times warm kernels: an elastic gas at equilibrium, or a case (--case). Prints the median of several runs and their
    range; progress goes to the standard error stream. Under `mpiexec -n P` it times one gas on P ranks, and counts what
    they send. A grid of gases, start times and the cost of output are scripts (`ifrdem docs performance`).
    """
    from ..kernels.columns import MOST_DISKS
    from ..simulation import backend
    from ..simulation.device import Device
    from ..validation.speed import bench as timing

    wrong = Wrong(_conflicts({"n": n, "phi": phi}, {"after": after, "set": set}, case))
    chosen: dict[str, Any] = {
        "runs": timing.RUNS,
        "seconds": timing.SECONDS,
        "profile": profile,
        "note": progress,
    }
    chosen["n"] = wrong.parse(100_000, whole, "--n", n, 2, MOST_DISKS, "whole number of disks")
    need = f"a packing fraction from {THINNEST} to {DENSEST}"
    chosen["phi"] = wrong.parse(0.3, number, "--phi", phi, need, lambda value: THINNEST <= value <= DENSEST)
    chosen["runs"] = wrong.parse(timing.RUNS, whole, "--runs", runs, 1, 10_000)
    need = "a positive number of seconds"
    chosen["seconds"] = wrong.parse(
        timing.SECONDS, number, "--seconds", seconds, need, lambda value: 0.0 < value < math.inf
    )
    chosen["seed"] = wrong.parse(1, whole, "--seed", seed, 0, 2**63 - 1)
    need = "a number of collisions per disk, 0 or more,"
    chosen["after"] = wrong.parse(0.0, number, "--after", after, need, lambda value: 0.0 <= value < math.inf)
    chosen["threads"] = wrong.parse(None, whole, "--threads", threads, 1, backend.cores())
    chosen["device"], chosen["precision"] = device or "cpu", precision or "f64"
    comm = ranks()
    try:
        backend.check(replace(Device.of(chosen["device"]), precision=chosen["precision"]))
    except InputError as error:
        wrong.append(f"--{error}")
    wrong.end()
    if case is not None:
        chosen["overrides"] = overrides(set, device=device, seed=seed, threads=threads, precision=precision)
    found = timing.bench(case, comm=comm, **chosen)
    if not comm.is_root:
        return
    say(json_format.dumps(found.figures(), indent=2) if json else found.report())


def _conflicts(of_gas: dict[str, Any], of_case: dict[str, Any], case: str | None) -> list[str]:
    """A line for each option that says nothing beside the others."""
    if case is None:
        return [f"--{name}: only beside --case" for name, value in of_case.items() if value]
    keys = {"n": "number of a species", "phi": "box.packing_fraction"}
    return [
        f"--{name}: not beside --case; --set changes the case's {keys[name]}"
        for name, value in of_gas.items()
        if value is not None
    ]


def devices() -> None:
    """List the devices that can compute."""
    from .. import bullet
    from ..kernels import language  # noqa: F401  (an error where Taichi cannot be loaded)
    from ..simulation import backend

    for each in backend.available():
        say(f"{each.name:<8} {each.description}")
    absence = backend.cuda_absence()
    if absence is not None:
        say(f"cuda     not usable: {absence}")
    say(f"pybullet {bullet.describe()}")


def docs(
    topic: Annotated[
        str | None, Parameter(name="TOPIC", help="page to print (default: the list of pages)")
    ] = None,
    /,
) -> None:
    """Read the manual."""
    say(page(topic))


def topics() -> dict[str, str]:
    """Titles of the manual's pages by topic: the start page, the others, measured figures (`results/NAME`)."""
    pages = {
        page.relative_to(MANUAL).with_suffix("").as_posix(): page
        for pattern in ("index.md", "*.md", "*/*.md")
        for page in sorted(MANUAL.glob(pattern))
    }
    return {
        topic: page.read_text(encoding="utf-8").splitlines()[0].lstrip("# ") for topic, page in pages.items()
    }


def page(topic: str | None) -> str:
    """Text of a page of the manual; without a topic, the list of topics.

    Raises InputError if no page has this name.
    """
    known = topics()
    if topic is None:
        width = max(map(len, known))
        lines = [f"{name:<{width}}  {title}" for name, title in known.items()]
        return "\n".join((*lines, "", f"`ifrdem docs TOPIC` prints a page; the files are in {MANUAL}"))
    if topic not in known:
        raise InputError(f"the manual has no topic '{topic}'{there_are(topic, known)}")
    text = (MANUAL / f"{topic}.md").read_text(encoding="utf-8")
    return re.sub(r"^<!--.*-->\n", "", text, flags=re.MULTILINE)  # marks for the tests and the site
