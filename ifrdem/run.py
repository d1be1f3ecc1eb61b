"""Running a case: from its file to the trajectory, the picture and a summary."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import backend, check, plot, scan_picture, table_picture
from .case import IMPACT_SCAN, UNITS, Case
from .case_file import CaseFile
from .estimate import Estimate
from .gas import Gas
from .observables import Measure
from .outputs import Outputs
from .progress import Progress
from .state import State
from .trajectory_writer import TrajectoryWriter


class Interrupted(KeyboardInterrupt):
    """The run was interrupted; the message says what is left of it."""


@dataclass
class Ledger:
    """The first and the latest measure in the trajectory of a run, and how many frames it has."""

    first: Measure | None = None
    latest: Measure | None = None
    frames: int = 0

    def dissipated(self, measure: Measure) -> float:
        """Energy that collisions have taken since the first frame [energy]."""
        assert self.first is not None
        return self.first.unspent - measure.unspent

    def observables(self, measure: Measure) -> dict[str, float | int | NDArray[np.float64]]:
        """What is written of the whole gas at a frame; see `estimate.OBSERVABLES`."""
        if self.first is None:
            self.first = measure
        return {
            "translational_energy": measure.translational_energy,
            "rotational_energy": measure.rotational_energy,
            "energy": measure.energy,
            "temperature": measure.temperature,
            "rotational_temperature": measure.rotational_temperature,
            "momentum": measure.momentum,
            "potential_energy": measure.potential_energy,
            "energy_input": measure.energy_input,
            "wall_work": measure.wall_work,
            "wall_heat": measure.wall_heat,
            # What is missing of what was there and what forces and walls put in was dissipated.
            "dissipated_energy": self.dissipated(measure),
            "collisions": measure.collisions,
            "wall_hits": measure.wall_hits,
        }


def run(
    file: CaseFile,
    outputs: Outputs,
    *,
    force: bool = False,
    say: Callable[[str], None] = print,
    warn: Callable[[str], None] = print,
) -> None:
    """Run a case, and write its trajectory and picture.

    Whatever can be refused is refused before a file is touched.

    Parameters
    ----------
    file : CaseFile
        The case.
    outputs : Outputs
        Where to write.
    force : bool
        Replace files that exist.
    say, warn : callable
        Take the lines to show.

    Raises
    ------
    InputError
        If the case, the device or the outputs cannot be used.
    Interrupted
        If the user interrupts it. The trajectory keeps the frames so far.
    EngineError, TrajectoryError
        If the engine or the disk fails. The trajectory keeps the frames so far.
    """
    case = file.case
    outputs.check(force=force)
    backend.check(case.run.arch, case.run.threads, case.run.precision)
    check.refuse_beyond_memory(sum(each.number for each in case.species), case.run.arch, case.start.positions)
    began = time.perf_counter()
    gas = Gas.from_case(case, file.folder)
    device = next(each for each in backend.available() if each.arch == case.run.arch)
    used = case.run.threads or backend.cores()
    how = f", {used} used" if case.run.arch == "cpu" else ""
    if case.run.precision != "f64":
        how += f", computing in {case.run.precision}"
    estimate = Estimate.of(gas, case)
    check.refuse_beyond_disk(estimate.file_bytes, outputs.trajectory.parent)
    say(check.summary(case, gas, estimate, f"{device.arch}: {device.description}{how}"))
    for text in gas.warnings:
        warn(text)

    ledger = Ledger()
    try:
        simulation = gas.simulation(case)
        with TrajectoryWriter(
            outputs.trajectory,
            gas.disks,
            gas.box,
            fields=case.output.fields,
            parameters=_record(file, gas, f"{device.arch}: {device.description}"),
            units=UNITS[case.run.units],
            precision=case.output.precision,
            compression=case.output.compression,
            force=force,
            walls=gas.walls,
        ) as writer:

            def keep(state: State, measure: Measure) -> None:
                writer.write(state, ledger.observables(measure))
                ledger.latest = measure  # only now is the frame safe
                ledger.frames += 1

            with Progress(
                gas.disks.n,
                t_end=case.run.t_end,
                collisions_per_disk=case.run.collisions_per_disk,
                unit=UNITS[case.run.units]["time"] if case.run.units == "SI" else "",
            ) as progress:
                simulation.run(
                    t_end=case.run.t_end,
                    collisions_per_disk=case.run.collisions_per_disk,
                    frames=case.output.frames,
                    observers=[keep],
                    progress=progress,
                )
        ran = time.perf_counter() - began
        if outputs.picture is not None:
            _draw(case, gas)(outputs.trajectory, outputs.picture)
    except KeyboardInterrupt:
        raise Interrupted(_remains(outputs.trajectory, ledger)) from None
    say(_closing(case, gas, ledger, ran, time.perf_counter() - began, progress.collisions_per_second))
    if simulation.statistics.elastic:
        say(f"  {simulation.statistics.elastic} collisions were elastic, against inelastic collapse")
    for path, size in outputs.sizes().items():
        say(f"  {path} ({check.size(size)})")


def _draw(case: Case, gas: Gas) -> Callable[[Path, Path], None]:
    """What draws the picture of a case."""
    if case.start.file is None and case.start.positions == IMPACT_SCAN:
        return scan_picture.impact_scan
    if any(each.kind == "table_friction" for each in case.force):
        return table_picture.table
    if case.walled:
        return plot.walled
    if gas.box.shear_rate:
        return plot.sheared
    return plot.driven if case.force else plot.cooling


def _remains(trajectory: Path, ledger: Ledger) -> str:
    if ledger.frames == 0 or ledger.latest is None:
        return "interrupted before the first frame: nothing was written"
    return (
        f"interrupted: {trajectory} holds the {ledger.frames} frames so far, "
        f"to t = {ledger.latest.time:.6g} and {ledger.latest.collisions} collisions"
    )


def _closing(case: Case, gas: Gas, ledger: Ledger, ran: float, wall: float, rate: float) -> str:
    """The lines below a run."""
    first, last = ledger.first, ledger.latest
    assert first is not None
    assert last is not None
    done = last.collisions - first.collisions
    per_disk = 2.0 * done / gas.disks.n
    lines = [
        f"done in {wall:.1f} s: {done} collisions ({per_disk:.4g} per disk) "
        f"to t = {last.time:.5g}{case.unit('time')}; "
        f"{rate:.3g} collisions/s once compiled, {done / ran:.3g} in all"
    ]
    if first.temperature > 0.0:
        lines.append(f"  T/T0 = {last.temperature / first.temperature:.5g}")
    if last.temperature > 0.0:
        lines[-1] += f", theta = T_rot/T = {last.rotational_temperature / last.temperature:.4g}"
    lost = ledger.dissipated(last)
    energy = case.unit("energy")
    if case.walled:
        gave = f"{last.wall_work:.6g}{energy} as work"
        if last.wall_heat != 0.0:
            gave += f" and {last.wall_heat:.6g}{energy} as heat"
        lines.append(f"  {last.wall_hits} collisions with walls, which gave {gave}")
    if case.force or case.walled or gas.box.shear_rate:
        source = " and ".join(
            name for name, there in (("forces", case.force), ("the flow", gas.box.shear_rate)) if there
        )
        put_in = f"{source} put in {last.energy_input:.6g}{energy}, " if source else ""
        lines.append(f"  {put_in}collisions dissipated {lost:.6g}{energy}")
    elif first.energy > 0.0:
        lines.append(f"  dissipated {lost:.6g}{energy}, {100.0 * lost / first.energy:.4g} % of the start")
    if first.energy > 0.0:
        # Against the momentum that the disks' typical speed would add up to, all one way.
        scale = np.sqrt(2.0 * first.translational_energy * np.sum(gas.disks.mass))
        if scale > 0.0:
            drift = float(np.linalg.norm(last.momentum - first.momentum))
            what = "change" if case.force or case.walled else "drift"  # heat baths, drag and walls change it
            lines.append(
                f"  momentum {what} {drift:.2g}{case.unit('momentum')}, {drift / scale:.2g} "
                "of what the disks would carry if all flew one way at the start"
            )
    return "\n".join(lines)


def _record(file: CaseFile, gas: Gas, device: str) -> dict[str, str | int | float]:
    """What the trajectory file says of where it comes from."""
    case = file.case
    species = [{"name": each.name, "number": each.number, "material": each.material} for each in gas.species]
    laws = [
        [law and {key: getattr(law, key) for key in ("e_n", "e_t", "mu", "sticking", "rho")} for law in row]
        for row in gas.laws
    ]
    return {
        "name": case.run.name,
        "seed": case.run.seed,
        "case": file.text,
        "overrides": "\n".join(file.overrides),
        "case_in_full": case.model_dump_json(),
        "species": json.dumps(species),
        "materials": json.dumps(gas.materials),
        "laws": json.dumps(laws),
        "forces": json.dumps([each.model_dump(exclude_none=True) for each in case.force]),
        "gravity": json.dumps(case.box.gravity),
        "collapse": case.run.collapse,
        "device": device,
        "threads": case.run.threads or backend.cores(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "git": revision(),
    }


def revision() -> str:
    """The git commit of the program's own source tree, or why there is none."""
    root = Path(__file__).resolve().parents[1]
    if not (root / ".git").exists():
        return "not a git checkout"
    try:
        found = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40"],
            capture_output=True,
            text=True,
            timeout=10.0,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return found.stdout.strip()
