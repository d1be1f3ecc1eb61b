"""Objects of a simulation that sections of a case describe."""

from __future__ import annotations

from ..kernels.compiler import runtime
from ..model.collapse import Collapse
from ..model.device import Device
from ..model.gravity import Gravity, RotatingGravity
from .case import REMEDIES, BoxSection, CaseSections, RunSection


def choose_runtime(run: RunSection) -> None:
    """Have kernels compiled by the runtime of a run. InputError if it is not there."""
    runtime.choose(run.runtime, "run.runtime")


def device_of(run: RunSection) -> Device:
    """The device of a run."""
    return Device(run.device, threads=run.threads, precision=run.precision, low_memory=run.low_memory)


def collapse_of(run: RunSection) -> Collapse | None:
    """The remedy for inelastic collapse of a run; None without."""
    if run.collapse not in REMEDIES:
        return None
    key, kind = REMEDIES[run.collapse]
    return kind(getattr(run, key))


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
