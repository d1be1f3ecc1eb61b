"""Runs of several codes on one gas, in turn: what `peers.py` tells about is done here."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ... import theory
from ...initial import placement
from ...model.box import Box
from ...model.ifr import IFRLaw
from ...model.observables import measure
from ...model.state import Disks, State
from ...simulation.simulation import Simulation
from . import serial_events, soft_disks
from .serial_events import SerialEvents
from .soft_disks import SoftDisks, SoftDisksError

MIXING = 20
"""Elastic collisions per disk before the start."""

# A collision takes (1 - e_n^2) / 2 of a disk's temperature, so a few percent fewer of them matter by less than 1 %.
ENERGY_TOLERANCE = 1e-2
# An elastic contact keeps its speed to 2e-5; those of three disks, or with larger steps, to less.
DRIFT_TOLERANCE = 1e-3
# Overlaps are some 1/100 of a mean free path: the more dilute the gas, the smaller its disks look.
CONTACT_TOLERANCE = 5e-2


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


@dataclass
class Timing:
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


# --- the codes: each makes its row and yields, then does one timed run each time it is resumed -----------------------


def _ifrdem(row: Timing, gas: GasAtStart, options: Options) -> Iterator[None]:
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


def _serial(row: Timing, gas: GasAtStart, options: Options, ours: Timing) -> Iterator[None]:
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


def _soft(row: Timing, gas: GasAtStart, options: Options, folder: Path) -> Iterator[None]:
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


def _warm_then_timed() -> Iterator[bool]:
    """First False, for the run that compiles, then True."""
    yield False
    while True:
        yield True


# --- the comparison -------------------------------------------------------------------------------------------------


def compare(options: Options, say: Callable[[str], None]) -> list[Timing]:
    """Run all codes in turn and return their rows, ifrdem's first."""
    say(f"start: {options.n} disks, packing fraction {options.phi}, {MIXING} elastic collisions per disk")
    gas = start(options)
    ours = Timing("ifrdem", options.threads)
    serial = Timing("serial events", 1)
    soft = Timing("LAMMPS, soft disks", options.threads)
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


def _resume(row: Timing, steps: Iterator[None]) -> bool:
    """Let a code go on to its next stop; False if it is a peer that failed."""
    try:
        next(steps)
    except SoftDisksError as error:
        row.failed, row.rates = str(error), []
        return False
    return True
