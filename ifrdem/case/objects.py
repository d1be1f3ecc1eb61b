"""Objects of a simulation that sections of a case describe."""

from __future__ import annotations

from ..kernels.compiler import runtime
from ..model.collapse import Collapse, ContactTime, Rest, VelocityCutoff
from ..model.gravity import Gravity, RotatingGravity
from ..simulation.device import Device
from ..simulation.engine import EngineOptions
from .case import BoxSection, CaseSections, RunSection


def choose_runtime(run: RunSection) -> None:
    """Have kernels compiled by the runtime of a run. InputError if it is not there."""
    runtime.choose(run.runtime, "run.runtime")


def device_of(run: RunSection) -> Device:
    """The device of a run."""
    return Device(run.device, threads=run.threads, precision=run.precision, low_memory=run.low_memory)


def collapse_of(run: RunSection) -> Collapse | None:
    """The remedy for inelastic collapse of a run; None without."""
    if run.velocity_cutoff is not None:
        return VelocityCutoff(run.velocity_cutoff)
    if run.contact_time is not None:
        return ContactTime(run.contact_time)
    return None if run.resting_speed is None else Rest(run.resting_speed)


def gravity_of(box: BoxSection) -> Gravity:
    """Gravity in a box."""
    gravity = (box.gravity[0], box.gravity[1])
    if not box.gravity_rotation_rate:
        return gravity
    return RotatingGravity(gravity, rate=box.gravity_rotation_rate, step=box.gravity_rotation_step)


def record_of(case: CaseSections) -> list[str]:
    """Names of what a simulation records for the output of a case."""
    fields, output = case.output.fields, case.output
    quantities = {
        "energy": output.ledger, "partner": "last_partner" in fields, "angle": "angle" in fields,
        "disk_energy": "dissipated" in fields, "wall": output.wall_sums,
        "stress": output.stress,
    }  # fmt: skip
    return [name for name, enabled in quantities.items() if enabled]


def options_of(case: CaseSections) -> EngineOptions:
    """Options of the engine of a case, but for its seed and what it records."""
    return EngineOptions(device_of(case.run), gravity=gravity_of(case.box), collapse=collapse_of(case.run))
