"""Runs of several codes on one gas, in turn: what `peers.py` tells about is done here."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ... import theory
from ...initial import placement
from ...model.box import Box
from ...model.ifr import IFRLaw
from ...model.observables import measure
from ...model.state import Disks, State
from ...simulation.simulation import Simulation
from . import serial_events, soft_disks, spheres
from .serial_events import SerialEvents
from .soft_disks import SoftDisks, SoftDisksError
from .spheres import SpheresRun

T = TypeVar("T")
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
    """Figures that are compared; `collisions` and `soft_collisions` are per disk."""

    n: int
    phi: float
    e_n: float
    threads: int
    runs: int
    collisions: float
    soft_collisions: float
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
        return Simulation(self.disks, self.box, self.law, self.state, threads=self.threads)

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
    mixing = Simulation(disks, box, elastic, State(position, velocity, spin), threads=options.threads)
    mixing.run(collisions_per_disk=MIXING)
    mixed = mixing.state
    law = IFRLaw(e_n=options.e_n, e_t=-1.0, mu=0.0)
    return GasAtStart(disks, box, law, State(mixed.position, mixed.velocity, spin), options.threads)


# --- the codes: each fills its row and returns a function that does a run and gives collisions/s, one run being done --


def _ifrdem(row: Timing, gas: GasAtStart, options: Options) -> Callable[[], float]:
    def run() -> float:
        simulation = gas.simulation()
        begin = time.perf_counter()
        simulation.run(collisions_per_disk=options.collisions)
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
        events.run(math.ceil(options.collisions * options.n / 2.0))
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
    contact_times = max(10, 10 * round(options.soft_collisions / soft_disks.CONTACT_TIME / 10.0))
    soft.choose_skin(max(10, contact_times // 5))
    collisions = _same_gas(row, gas, options, soft, contact_times)

    def run() -> float:
        done = soft.run(contact_times)
        row.temperature = done.temperature
        return collisions / done.seconds

    return run


def _same_gas(row: Timing, gas: GasAtStart, options: Options, soft: SoftDisks, contact_times: int) -> int:
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


def _spheres(
    row: Timing, run: Callable[[], SpheresRun], options: Options, ours: Timing
) -> Callable[[], float]:
    def timed() -> float:
        done = run()
        row.temperature, row.expected = done.temperature, ours.temperature
        row.frequency = 2.0 * done.collisions / (options.n * done.time)
        fewest = min(done.collisions, options.collisions * options.n / 2.0)
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


def compare(options: Options, say: Callable[[str], None]) -> list[Timing]:
    """Run all codes in turn and return their rows, ifrdem's first."""
    say(f"start: {options.n} disks, packing fraction {options.phi}, {MIXING} elastic collisions per disk")
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
            collisions = math.ceil(options.collisions * options.n / 2.0)
            job = partial(spheres.dynamo, dynamo, Path(folder), gas.box, options.e_n, gas.state, collisions)
            codes["DynamO"] = row, partial(_spheres, row, job, options, ours)
        if not serial_events.COMPILED:
            serial.not_measured = f"Numba is not installed: {soft_disks.INSTALL}"
        soft.not_measured = soft_disks.absence()
        ready = {}
        for name, (row, make) in codes.items():
            if row.not_measured is not None:
                say(f"{name}: not measured. {row.not_measured}")
                continue
            say(f"{name}: warming up")
            if (once := _attempt(row, make)) is not None:
                ready[name] = row, once
        for run in range(1, options.runs + 1):
            for name, (row, once) in list(ready.items()):
                rate = _attempt(row, once)
                if rate is None:
                    del ready[name]
                    continue
                row.rates.append(rate)
                say(f"run {run} of {options.runs}: {name} {rate:.3g} collisions/s")
        for row in rows:
            if row.failed is not None:
                say(f"{row.code}: {row.failed}")
    return rows


def _attempt(row: Timing, work: Callable[[], T]) -> T | None:
    """The result of a code's work; None, and told in its row, if the code fails."""
    try:
        return work()
    except SoftDisksError as error:
        row.failed, row.rates = str(error), []
        return None
