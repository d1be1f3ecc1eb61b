"""The command `bench`."""

from __future__ import annotations

import json as json_format
import math
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import InputError
from .console import progress, say
from .options import Precision, Set, Wrong, flag, number, option, overrides, whole

if TYPE_CHECKING:
    from ..validation.speed.bench import Benchmark
    from ..validation.speed.options import BenchOptions
    from ..validation.speed.output_cost import OutputCost

COMPRESSIONS = ("none", "gzip")


def bench(
    *,
    n: Annotated[str | None, option("N", "disks of the elastic gas (default: 1e5)")] = None,
    phi: Annotated[str | None, option("PHI", "its packing fraction (default: 0.3)")] = None,
    arch: Annotated[str | None, option("ARCH", "device: cpu or cuda (see `ifrdem backends`)")] = None,
    precision: Precision = None,
    threads: Annotated[str | None, option("N", "CPU threads (default: all cores)")] = None,
    skin: Annotated[
        str | None,
        option("S", "extra distance, in diameters of the largest disk, within which neighbours are listed"),
    ] = None,
    runs: Annotated[
        str | None, option("R", "timed runs (default: 5); turns with --output (default: 24)")
    ] = None,
    seconds: Annotated[str | None, option("S", "least length of a timed run (default: 0.5)")] = None,
    seed: Annotated[str | None, option("N", "seed of the random numbers")] = None,
    json: Annotated[bool, flag("print one JSON object with every figure")] = False,
    profile: Annotated[bool, flag("measure the share of each kernel too")] = False,
    no_compile: Annotated[bool, flag("leave out the times of a start, cold and warm")] = False,
    case: Annotated[str | None, option("FILE", "time the gas of a case file instead")] = None,
    after: Annotated[
        str | None, option("C", "collisions per disk that the case has before it is timed (default: 0)")
    ] = None,
    set: Set = None,
    output: Annotated[
        str | None,
        option(
            "C", "time what output costs a run, with its frames uncompressed (C = none) or compressed (gzip)"
        ),
    ] = None,
    table: Annotated[bool, flag("time a grid of gases; prints Markdown")] = False,
    most: Annotated[str | None, option("N", "leave out gases of the table with more disks")] = None,
    clustered: Annotated[
        bool, flag("in the table, a cooling gas in clusters too, which takes minutes")
    ] = False,
) -> None:
    """Measure how fast it runs here.

    Times warm kernels: an elastic gas at equilibrium, a case (--case), or a grid of gases (--table). Prints the median
    of several runs and their range; progress goes to the standard error stream.
    """
    from ..simulation import device
    from ..validation.speed.options import (
        DENSEST,
        MOST_DISKS,
        RUNS,
        SECONDS,
        THINNEST,
        TURNS,
        BenchOptions,
        Timing,
    )  # fmt: skip

    given = {
        "--n": n, "--phi": phi, "--precision": precision, "--skin": skin, "--seconds": seconds, "--profile": profile,
        "--case": case, "--after": after, "--set": set, "--output": output, "--table": table, "--most": most,
        "--clustered": clustered,
    }  # fmt: skip
    wrong = Wrong(_conflicts({name: value for name, value in given.items() if value not in (None, False)}))
    default = BenchOptions()
    disks = wrong.take(default.n, whole, "--n", n, 2, MOST_DISKS, "whole number of disks")
    need = f"a packing fraction from {THINNEST} to {DENSEST}"
    fraction = wrong.take(default.phi, number, "--phi", phi, need, lambda value: THINNEST <= value <= DENSEST)
    turns = wrong.take(RUNS if output is None else TURNS, whole, "--runs", runs, 1, 10_000)
    need = "a positive number of seconds"
    least = wrong.take(SECONDS, number, "--seconds", seconds, need, lambda value: 0.0 < value < math.inf)
    need = "a length from 0.001 to 1000 diameters"
    extra = wrong.take(None, number, "--skin", skin, need, lambda value: 1e-3 <= value <= 1e3)
    first = wrong.take(default.seed, whole, "--seed", seed, 0, 2**63 - 1)
    need = "a number of collisions per disk, 0 or more,"
    before = wrong.take(0.0, number, "--after", after, need, lambda value: 0.0 <= value < math.inf)
    largest = wrong.take(MOST_DISKS, whole, "--most", most, 1000, MOST_DISKS, "whole number of disks")
    used = wrong.take(None, whole, "--threads", threads, 1, device.cores())
    arch_used, precision_used = arch or default.arch, precision or default.precision
    try:
        device.check(arch_used, None, precision_used)
    except InputError as error:
        wrong.append(f"--{error}")
    wrong.end()
    timing = Timing(turns, least, extra, profile, not no_compile)
    changes = (
        overrides(set, arch=arch, seed=seed, threads=threads, precision=precision) if case is not None else []
    )
    chosen = BenchOptions(
        timing, disks, fraction, arch_used, used, precision_used, first, case, tuple(changes), before, table, largest,
        clustered, output, json,
    )  # fmt: skip
    if table:
        from ..validation.speed import table as tables

        tables.measure(chosen, say=say, note=progress)
        return
    found = _measured(chosen)
    say(json_format.dumps(found.figures(), indent=2) if json else found.report())


def _measured(chosen: BenchOptions) -> Benchmark | OutputCost:
    """Time output, a case or an elastic gas."""
    from ..validation.speed import bench, equilibrium, output_cost

    if chosen.output is not None:
        return output_cost.measure(
            chosen.n, chosen.phi, arch=chosen.arch, threads=chosen.threads, seed=chosen.seed, runs=chosen.timing.runs,
            compression=chosen.output, note=progress,
        )  # fmt: skip
    if chosen.case is not None:
        from ..case import file as case_file
        from ..case import shipped

        file = case_file.read(shipped.find(chosen.case), chosen.overrides)
        return bench.measure(file.case, file.folder, timing=chosen.timing, after=chosen.after, note=progress)
    gas = equilibrium.elastic_gas(
        chosen.n,
        chosen.phi,
        arch=chosen.arch,
        threads=chosen.threads,
        precision=chosen.precision,
        seed=chosen.seed,
    )
    try:
        return bench.measure(gas, timing=chosen.timing, note=progress)
    except InputError as error:  # it speaks of a case that the user does not see
        raise InputError(f"--n {chosen.n} --phi {chosen.phi:g}: {error}") from None


def _conflicts(given: dict[str, Any]) -> list[str]:
    """A line for each option that says nothing beside the others."""

    def named(*names: str) -> list[str]:
        return [f"--{name}" for name in names if f"--{name}" in given]

    found = []
    if "--output" in given:
        if given["--output"] not in COMPRESSIONS:
            found.append(f"--output {given['--output']}: allowed are {', '.join(COMPRESSIONS)}")
        other = named("table", "case", "after", "skin", "profile", "seconds", "precision")
        found += [f"{each}: not beside --output" for each in other]
    if "--table" in given:
        other = named("n", "phi", "case", "after", "skin", "profile", "set")
        return found + [f"{each}: not beside --table, which has gases of its own" for each in other]
    found += [f"{each}: only beside --table" for each in named("most", "clustered")]
    if "--case" in given:
        keys = {"--n": "number of a species", "--phi": "box.packing_fraction"}
        other = named("n", "phi")
        return found + [f"{each}: not beside --case; --set changes the case's {keys[each]}" for each in other]
    return found + [f"{each}: only beside --case" for each in named("after", "set")]
