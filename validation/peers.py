"""Other codes on the same gas, on the same machine, in the same run: `python -m ifrdem.validation.peers`.

The gas: equal smooth disks of mass and diameter 1 (e_n given, e_t = -1, mu = 0) in a square periodic box. It starts
from a hexagonal lattice with Maxwellian velocities and 20 elastic collisions per disk, by ifrdem, that mix it. Every
run of every code starts from that state, T = 1.

What is timed, and what is not:

| code | timed |
|---|---|
| ifrdem | `Simulation.run` for so many collisions, its kernels compiled before |
| serial events (`serial_events.py`, 1 thread) | as many collisions, compiled before; the set-up untimed |
| LAMMPS, soft disks (`soft_disks.py`, a rank a thread) | the loop over the steps, set-up untimed |

One run of each in turn, and again, so that a slow spell of the machine meets all; medians over the runs.

**Collisions per second of LAMMPS**: the simulated time, in units of ifrdem's collisions, over the wall time: ifrdem
runs to the same time from the same start, and its number of collisions there is divided by LAMMPS's seconds. A step of
LAMMPS costs the same whatever happens in it, so it runs for less long: one collision per disk, fewer above 10,000
disks. For e_n < 1 that is in its favour, for the gas cools, and has fewer collisions a step, later.

**Is it the same gas?** An untimed run of LAMMPS, sampled every contact time, is held against ifrdem:

- its energy per disk, kinetic and springs, against ifrdem's T(t) at ten times, within 1 %;
- for e_n = 1, energy is kept within 1e-3 (seen: 1e-5);
- its own count of contacts against ifrdem's collisions, within 5 % + 3 / sqrt(collisions). It is systematically lower
  in dilute gases (2 % at packing fraction 0.1), where 1/100 of a mean free path is a notable overlap.

A comparison that fails is said and ends with exit status 1; a code that is not installed is `not measured`.

The two event-driven codes have the same collisions until rounding separates them, after some ten per disk; from then
on a cooling gas has the same T only on average, and in a small one the two differ visibly.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from .. import __version__, backend, placement, theory
from ..box import Box
from ..errors import EngineError, InputError
from ..law import IFRLaw
from ..observables import measure
from ..simulation import Simulation
from ..state import Disks, State
from . import serial_events, soft_disks
from .serial_events import SerialEvents
from .soft_disks import SoftDisks, SoftDisksError

FEWEST_RUNS = 5
MIXING = 20
"""Elastic collisions per disk before the start."""

# A collision takes (1 - e_n^2) / 2 of a disk's temperature, so a few percent fewer of them matter by less than 1 %.
ENERGY_TOLERANCE = 1e-2
# An elastic contact keeps its speed to 2e-5; those of three disks, or with larger steps, to less.
DRIFT_TOLERANCE = 1e-3
# Overlaps are some 1/100 of a mean free path: the more dilute the gas, the smaller its disks look.
CONTACT_TOLERANCE = 5e-2

BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130


@dataclass(frozen=True)
class Options:
    """What is compared; `collisions` and `soft_collisions` are per disk."""

    n: int
    phi: float
    e_n: float
    threads: int
    runs: int
    collisions: float
    soft_collisions: float
    steps_per_contact: int
    seed: int


@dataclass
class Row:
    """One code's outcome: `rates` in collisions/s, or why there are none."""

    code: str
    threads: int
    rates: list[float] = field(default_factory=list)
    temperature: float = math.nan
    expected: float = math.nan
    not_measured: str | None = None
    failed: str | None = None
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Gas:
    """The gas at its start, for every code."""

    disks: Disks
    box: Box
    law: IFRLaw
    state: State
    threads: int

    def simulation(self) -> Simulation:
        """A new simulation from the start."""
        return Simulation(self.disks, self.box, self.law, self.state, threads=self.threads)

    def temperature(self, simulation: Simulation) -> float:
        """Its present temperature [energy]."""
        return measure(self.disks, simulation.state).temperature


def start(options: Options) -> Gas:
    """An equilibrated gas at temperature 1, clock and counts at zero."""
    disks = Disks(options.n, mass=np.array(1.0), radius=np.array(0.5))
    box = Box.from_packing_fraction(disks.radius, options.phi)
    position = placement.hexagonal_positions(box, disks.radius, seed=options.seed)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=options.seed)
    spin = np.zeros(options.n)
    elastic = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    mixing = Simulation(disks, box, elastic, State(position, velocity, spin), threads=options.threads)
    mixing.run(collisions_per_disk=MIXING)
    mixed = mixing.state
    law = IFRLaw(e_n=options.e_n, e_t=-1.0, mu=0.0)
    return Gas(disks, box, law, State(mixed.position, mixed.velocity, spin), options.threads)


# --- the codes: each makes its row and yields, then does one timed run each time it is resumed -----------------------


def _ifrdem(row: Row, gas: Gas, options: Options) -> Iterator[None]:
    for timed in _warm_then_timed():
        simulation = gas.simulation()
        begin = time.perf_counter()
        simulation.run(collisions_per_disk=options.collisions)
        seconds = time.perf_counter() - begin
        if timed:
            row.rates.append(simulation.collisions / seconds)
        else:
            row.temperature = row.expected = gas.temperature(simulation)
        yield


def _serial(row: Row, gas: Gas, options: Options, ours: Row) -> Iterator[None]:
    count = math.ceil(options.collisions * options.n / 2.0)
    for timed in _warm_then_timed():
        events = SerialEvents(gas.box, 1.0, options.e_n, gas.state)
        begin = time.perf_counter()
        events.run(count)
        seconds = time.perf_counter() - begin
        if timed:
            row.rates.append(events.collisions / seconds)
        else:
            row.temperature, row.expected = events.temperature, ours.temperature
        yield


def _soft(row: Row, gas: Gas, options: Options, folder: Path) -> Iterator[None]:
    free_time = 1.0 / theory.collision_rate(options.phi, 1.0, 1.0, 0.5)
    soft = SoftDisks(
        folder,
        gas.box,
        1.0,
        options.e_n,
        gas.state,
        free_time=free_time,
        ranks=options.threads,
        steps_per_contact=options.steps_per_contact,
    )
    # Whole contact times, in tens for the ten comparisons.
    contact_times = max(10, 10 * round(options.soft_collisions / soft_disks.CONTACT_TIME / 10.0))
    soft.choose_skin(max(10, contact_times // 5))
    collisions = _same_gas(row, gas, options, soft, contact_times)
    yield
    while True:
        run = soft.run(contact_times)
        row.rates.append(collisions / run.seconds)
        row.temperature = run.temperature
        yield


def _same_gas(row: Row, gas: Gas, options: Options, soft: SoftDisks, contact_times: int) -> int:
    """Hold LAMMPS against ifrdem, and return the latter's number of collisions by the same time."""
    run = soft.run(contact_times, sampled=True)
    simulation = gas.simulation()
    deviation = 0.0
    for i in range(contact_times // 10, contact_times + 1, contact_times // 10):
        simulation.run(t_end=float(run.time[i]))
        row.expected = gas.temperature(simulation)
        deviation = max(deviation, abs(run.energy[i] / row.expected - 1.0))
    drift = float(np.abs(run.energy / run.energy[0] - 1.0).max()) if options.e_n == 1.0 else None
    collisions = simulation.collisions
    contacts = run.contacts / max(collisions, 1) - 1.0
    row.details = {
        "contact_time": soft.contact_time,
        "time_step": soft.time_step,
        "stiffness": soft.stiffness,
        "damping": soft.damping,
        "skin": soft.skin,
        "steps": contact_times * soft.steps_per_contact,
        "collisions_by_ifrdem": collisions,
        "contacts_counted": run.contacts,
        "energy_deviation": deviation,
        "energy_drift": drift,
    }
    wrong = []
    if not deviation <= ENERGY_TOLERANCE:
        wrong.append(f"its energy is up to {deviation:.2%} from ifrdem's")
    if drift is not None and not drift <= DRIFT_TOLERANCE:
        wrong.append(f"elastic, its energy drifts by {drift:.1e}")
    if not abs(contacts) <= CONTACT_TOLERANCE + 3.0 / math.sqrt(max(collisions, 1)):
        wrong.append(f"it has {run.contacts} contacts where ifrdem has {collisions} collisions")
    if wrong:
        row.failed = "not the same gas: " + "; ".join(wrong)
    return collisions


def _warm_then_timed() -> Iterator[bool]:
    """First False, for the run that compiles, then True."""
    yield False
    while True:
        yield True


# --- the comparison -------------------------------------------------------------------------------------------------


def compare(options: Options, say: Callable[[str], None]) -> list[Row]:
    """Run all codes in turn and return their rows, ifrdem's first."""
    say(f"start: {options.n} disks, packing fraction {options.phi}, {MIXING} elastic collisions per disk")
    gas = start(options)
    ours = Row("ifrdem", options.threads)
    serial = Row("serial events", 1)
    soft = Row("LAMMPS, soft disks", options.threads)
    with tempfile.TemporaryDirectory(prefix="ifrdem-peers-") as folder:
        codes = {
            "ifrdem": (ours, _ifrdem(ours, gas, options)),
            "serial": (serial, _serial(serial, gas, options, ours)),
            "LAMMPS": (soft, _soft(soft, gas, options, Path(folder))),
        }
        if not serial_events.COMPILED:
            serial.not_measured = f"Numba is not installed: {soft_disks.INSTALL}"
        soft.not_measured = soft_disks.absence()
        for name in list(codes):
            row, steps = codes[name]
            if row.not_measured is not None:
                say(f"{name}: not measured. {row.not_measured}")
                del codes[name]
                continue
            say(f"{name}: warming up")
            if not _resume(row, steps):
                del codes[name]
        for run in range(1, options.runs + 1):
            for name in list(codes):
                row, steps = codes[name]
                if _resume(row, steps):
                    say(f"run {run} of {options.runs}: {name} {row.rates[-1]:.3g} collisions/s")
                else:
                    del codes[name]
        for row in (ours, serial, soft):
            if row.failed is not None:
                say(f"{row.code}: {row.failed}")
    return [ours, serial, soft]


def _resume(row: Row, steps: Iterator[None]) -> bool:
    """Let a code go on to its next stop; False if it is a peer that failed."""
    try:
        next(steps)
    except SoftDisksError as error:
        row.failed, row.rates = str(error), []
        return False
    return True


def report(options: Options, rows: Sequence[Row]) -> dict[str, Any]:
    """What `--json` prints."""
    ours = statistics.median(rows[0].rates)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "cpu": _cpu(),
        "cores": backend.cores(),
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "versions": _versions(),
        "n": options.n,
        "phi": options.phi,
        "e_n": options.e_n,
        "threads": options.threads,
        "runs": options.runs,
        "collisions_per_disk": options.collisions,
        "steps_per_contact": options.steps_per_contact,
        "seed": options.seed,
        "codes": [_row_report(row, ours) for row in rows],
    }


def _row_report(row: Row, ours: float) -> dict[str, Any]:
    found: dict[str, Any] = {"code": row.code, "threads": row.threads}
    if row.not_measured is not None:
        return {**found, "not_measured": row.not_measured}
    if row.rates:
        median = statistics.median(row.rates)
        found |= {
            "collisions_per_second": median,
            "lowest": min(row.rates),
            "highest": max(row.rates),
            "all": row.rates,
            "ratio_to_ifrdem": median / ours,
            "temperature": row.temperature,
            "temperature_of_ifrdem": row.expected,
        }
    if row.details:
        found["details"] = row.details
    if row.failed is not None:
        found["failed"] = row.failed
    return found


def table(data: dict[str, Any]) -> str:
    """The report as lines to read."""
    versions = ", ".join(f"{name} {version}" for name, version in data["versions"].items())
    lines = [
        f"{data['n']} disks, packing fraction {data['phi']}, e_n = {data['e_n']}; "
        f"medians of {data['runs']} runs in turn",
        f"{data['cpu']}, {data['cores']} cores; {data['date']}",
        versions,
        "",
        f"{'code':<20}{'threads':>8}{'collisions/s':>14}{'lowest':>10}{'highest':>10}{'/ ifrdem':>10}"
        f"{'T at end':>10}{'ifrdem T':>10}",
    ]
    for row in data["codes"]:
        head = f"{row['code']:<20}{row['threads']:>8}"
        if "not_measured" in row:
            lines.append(f"{head}  not measured. {row['not_measured']}")
        elif "collisions_per_second" not in row:
            lines.append(f"{head}  failed: {row['failed']}")
        else:
            lines.append(
                f"{head}{row['collisions_per_second']:>14.3g}{row['lowest']:>10.3g}{row['highest']:>10.3g}"
                f"{row['ratio_to_ifrdem']:>10.3g}{row['temperature']:>10.4f}{row['temperature_of_ifrdem']:>10.4f}"
            )
            if "failed" in row:
                lines.append(f"{'':<20}  {row['failed']}")
        if "details" in row:
            details = row["details"]
            drift = details["energy_drift"]
            lines += [
                "",
                f"LAMMPS: contact time {details['contact_time']:.3g}, step {details['time_step']:.3g}, "
                f"{details['steps']} steps, skin {details['skin']} diameters; against ifrdem: "
                f"{details['contacts_counted']} contacts for {details['collisions_by_ifrdem']} collisions, "
                f"energy within {details['energy_deviation']:.1e}"
                + ("" if drift is None else f", drift {drift:.1e}"),
            ]
    return "\n".join(lines)


def _cpu() -> str:
    """The processor's name."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as info:
        for line in info:
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _versions() -> dict[str, str]:
    found = {"ifrdem": __version__, "Python": platform.python_version()}
    for package in ("taichi", "numpy", "numba", "lammps", "mpich"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


# --- the command line -------------------------------------------------------------------------------------------------


class _Parser(argparse.ArgumentParser):
    """Raises InputError instead of exiting, so that every message leaves in the same way."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see `{self.prog} --help`)")


def _whole(option: str, text: str, least: int, most: float = math.inf) -> int:
    allowed = f"{least} or more" if math.isinf(most) else f"{least} to {most:.0f}"
    try:
        value = int(float(text)) if float(text).is_integer() else None  # 1e5 is a whole number too
    except (ValueError, OverflowError):
        value = None
    if value is None or not least <= value <= most:
        raise InputError(f"{option} = {text}: a whole number, {allowed}, is needed")
    return value


def _number(option: str, text: str, least: float, most: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise InputError(f"{option} = {text}: a number from {least:g} to {most:g} is needed")
    return value


def parse(arguments: Sequence[str]) -> tuple[Options, bool]:
    """Options, and whether JSON is wanted.

    Raises
    ------
    InputError
        Names the option, its value and what is allowed.
    """
    parser = _Parser(
        prog="python -m ifrdem.validation.peers",
        description="Time ifrdem, a serial event-driven code and LAMMPS (soft disks) on the same gas, in turn.",
        epilog=f"The peers are optional: {soft_disks.INSTALL}",
        allow_abbrev=False,
    )
    parser.add_argument("--n", metavar="N", default="10000", help="disks (10000)")
    parser.add_argument("--phi", metavar="PHI", default="0.3", help="packing fraction (0.3)")
    parser.add_argument("--e-n", metavar="E", default="1", help="coefficient of normal restitution (1)")
    parser.add_argument("--threads", metavar="T", help="threads of ifrdem and ranks of LAMMPS (all cores)")
    parser.add_argument("--runs", metavar="R", default="5", help="timed runs of each code, 5 or more (5)")
    parser.add_argument(
        "--collisions-per-disk",
        metavar="C",
        help="length of a run of the event-driven codes (10; more below 10000 disks, for 50000 collisions)",
    )
    parser.add_argument(
        "--soft-collisions-per-disk",
        metavar="C",
        help="length of a run of LAMMPS (1; less above 10000 disks, 0.1 at least)",
    )
    parser.add_argument(
        "--steps-per-contact",
        metavar="K",
        default=str(soft_disks.STEPS_PER_CONTACT),
        help=f"time steps of LAMMPS in a contact ({soft_disks.STEPS_PER_CONTACT})",
    )
    parser.add_argument("--seed", metavar="S", default="1", help="seed of the start (1)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    given = parser.parse_args(list(arguments))

    n = _whole("--n", given.n, 100)
    threads = backend.cores()
    if given.threads is not None:
        threads = _whole("--threads", given.threads, 1, threads)
    length, soft_length = max(10.0, 1e5 / n), min(max(1e4 / n, 0.1), 1.0)
    if given.collisions_per_disk is not None:
        length = _number("--collisions-per-disk", given.collisions_per_disk, 0.1, 1e4)
    if given.soft_collisions_per_disk is not None:
        soft_length = _number("--soft-collisions-per-disk", given.soft_collisions_per_disk, 0.1, 100.0)
    options = Options(
        n=n,
        phi=_number("--phi", given.phi, 0.01, 0.72),
        e_n=_number("--e-n", given.e_n, 0.5, 1.0),
        threads=threads,
        runs=_whole("--runs", given.runs, FEWEST_RUNS),
        collisions=length,
        soft_collisions=soft_length,
        steps_per_contact=_whole("--steps-per-contact", given.steps_per_contact, 10, 1000),
        seed=_whole("--seed", given.seed, 0),
    )
    return options, bool(given.json)


def _say(message: str) -> None:
    print(message, file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare and print; returns 0, 1 (a code failed or moved another gas), 2 (bad input) or 130 (interrupted)."""
    try:
        options, as_json = parse(sys.argv[1:] if arguments is None else arguments)
        rows = compare(options, _say)
        data = report(options, rows)
        print(json.dumps(data, indent=1) if as_json else table(data), flush=True)
        return FAILED if any(row.failed is not None for row in rows) else 0
    except InputError as error:
        _say(f"peers: {error}")
        return BAD_INPUT
    except EngineError as error:
        _say(f"peers: the engine stopped: {error}")
        return FAILED
    except KeyboardInterrupt:
        _say("peers: interrupted")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
