"""EDMD and DynamO as peers: programs of hard spheres, on the gas of disks as a thin gas of spheres in one plane.

Spheres of diameter 1 whose centres lie in one plane, without velocity across it, stay there and collide as disks do: a
thin box of three dimensions, periodic along each, then holds the gas of disks at its packing fraction by area. What
remains of the third dimension is its cost: coordinates, and cells above and below that are empty.
Neither program comes with ifrdem; each is timed where its executable is given. Both use one thread.

**EDMD** (F. Smallenburg, "Efficient event-driven simulations of hard spheres", Eur. Phys. J. E 45, 22 (2022),
doi:10.1140/epje/s10189-022-00180-8; `Single` of https://github.com/FSmallenburg/EDMD, with `mt19937ar.c` of `Grow`).
Parameters and velocities stand in its source: it draws Maxwellian velocities of all three components, and a thermostat
is on. Two lines have to be changed; shells of 1.8 diameters, with room for fewer neighbours, were the fastest in a
plane at packing fraction 0.3; and it is compiled with the flags of its Makefile:

    sed -i -e 's/usethermostat = 1/usethermostat = 0/' -e 's/p->vz = imsq .*/p->vz = 0;/' mdSingle.c
    sed -i -e 's/shellsize = 1.5/shellsize = 1.8/' -e 's/MAXNEIGH 24/MAXNEIGH 16/' mdSingle.c
    gcc -Ofast -funroll-loops -march=native mdSingle.c -o edmd -lm

It reads our positions (`init.sph`), draws velocities, runs for its `maxtime` (10) and prints its number of collisions
every `writeinterval` (1). The time between the first and the last of these lines is what counts: reading and set-up
are not in it. It scales velocities to <v^2> = 3, T = 3/2 in two dimensions, and moves elastic spheres only. At the end
every sphere must be in the plane (`snapshot_end.sph`), which finds out a program without the two changes.

**DynamO** (M. N. Bannerman, R. Sargant, L. Lue, J. Comput. Chem. 32, 3329 (2011), doi:10.1002/jcc.21915;
https://github.com/dynamomd/DynamO): `dynarun`, with a configuration of version 1.5.0 (ranges as `IDRange` tags) that
holds our positions and velocities. Its own clock counts, of its events without the set-up (`EventsPerSec` in
`output.xml`), with the averages of its plugin `Misc`, which measures them.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ...errors import InputError
from ...model.box import Box
from ...model.state import State

EDMD = "`Single` of EDMD with usethermostat = 0 and velocities p->vz = 0"
DYNAMO = "`dynarun` of DynamO, for configurations of version 1.5.0"

# EDMD visits the cells below and above (of `shellsize` diameters, larger in thin gases): three are needed.
EDMD_THICKNESS = 10.0
# DynamO makes four cells at least, none smaller than a diameter.
DYNAMO_THICKNESS = 4.1


@dataclass(frozen=True)
class SpheresRun:
    """One run of spheres in a plane."""

    collisions: int
    seconds: float  # wall time
    time: float  # simulated, in units in which <v^2> / 2 = 1 at the start
    temperature: float  # <v^2> / 2 at the end, over that at the start


def executable(option: str, text: str) -> Path:
    """The path of a program given by an option; InputError if there is none that can be run."""
    found = shutil.which(text)
    if found is None:
        raise InputError(f"{option} = {text}: no such program, or it may not be executed")
    return Path(found).resolve()


def edmd(program: Path, folder: Path, box: Box, state: State) -> SpheresRun:
    """A run of EDMD from these positions, for as long as it was compiled for.

    Raises
    ------
    InputError
        If the program cannot be started, fails, is another one, or moves out of the plane.
    """
    z = EDMD_THICKNESS / 2.0
    position = box.wrap(state.position).tolist()
    lines = [f"{state.n}", f"{box.lengths[0]!r} {box.lengths[1]!r} {EDMD_THICKNESS!r}"]
    lines += [f"a {x!r} {y!r} {z!r} 0.5" for x, y in position]
    (folder / "init.sph").write_text("\n".join(lines) + "\n", encoding="ascii")
    end = folder / "snapshot_end.sph"
    end.unlink(missing_ok=True)
    printed, status = _timed_output([str(program)], folder, "--edmd")
    text = "\n".join(line for _, line in printed)
    layers = re.search(r"^Cells: \d+, \d+, (\d+)$", text, re.MULTILINE)
    progress = r"Simtime: (\S+), Collisions: (\d+), .*\bT: (\S+),"
    at = [(when, match) for when, line in printed if (match := re.match(progress, line))]
    if status != 0 or layers is None or len(at) < 2 or not end.exists():
        raise _failure("--edmd", program, EDMD, status, text)
    if int(layers[1]) < 3:
        raise InputError(
            f"--edmd = {program}: it made {layers[1]} layers of cells and needs three: "
            "a denser gas (--phi) or a smaller `shellsize` is needed"
        )
    (begin, first), (stop, last) = at[0], at[-1]
    try:
        height = np.loadtxt(end, skiprows=2, usecols=3, ndmin=1)
        run = SpheresRun(
            collisions=int(last[2]) - int(first[2]),
            seconds=stop - begin,
            time=math.sqrt(1.5) * (float(last[1]) - float(first[1])),
            temperature=float(last[3]),  # <v^2> / 3, 1 at the start
        )
    except (ValueError, LookupError):
        raise _failure("--edmd", program, EDMD, status, text) from None
    if len(height) != state.n or np.abs(height - z).max() > 1e-9:  # it writes 12 digits
        raise InputError(
            f"--edmd = {program}: its {len(height)} spheres do not stay in the plane; {EDMD} is needed"
        )
    return run


def dynamo(program: Path, folder: Path, box: Box, e_n: float, state: State, collisions: int) -> SpheresRun:
    """A run of DynamO from this state for so many collisions.

    Raises
    ------
    InputError
        If the program cannot be started, fails, or writes another output.
    """
    temperature = 0.5 * float(np.mean(np.sum(state.velocity**2, axis=1)))
    _write_configuration(folder / "config.xml", box, e_n, state)
    output = folder / "output.xml"
    output.unlink(missing_ok=True)
    options = ["-c", str(collisions), "-o", "end.xml", "--out-data-file", output.name]
    printed, status = _timed_output([str(program), *options, "config.xml"], folder, "--dynamo")
    try:
        if status != 0:
            raise ValueError("it failed")
        (misc,) = ElementTree.parse(output).findall("./Misc")
        events, pairs, end, per_second, kT = (
            float(misc.findall(tag)[0].attrib[name])
            for tag, name in (
                ("Duration", "Events"),
                ("Duration", "TwoParticleEvents"),
                ("Duration", "Time"),
                ("Timing", "EventsPerSec"),
                ("Temperature", "Current"),
            )
        )
        return SpheresRun(
            collisions=int(pairs),
            seconds=events / per_second,
            time=math.sqrt(temperature) * end,
            temperature=1.5 * kT / temperature,  # kT is <v^2> / 3
        )
    except (OSError, ValueError, LookupError, ZeroDivisionError, ElementTree.ParseError):
        text = "\n".join(line for _, line in printed)
        raise _failure("--dynamo", program, DYNAMO, status, text) from None


def _write_configuration(path: Path, box: Box, e_n: float, state: State) -> None:
    """Write DynamO's configuration of the gas; its box is centred on the origin."""
    Lx, Ly = box.lengths
    position = box.wrap(state.position) - np.array([Lx, Ly]) / 2.0
    particles = "\n".join(
        f'<Pt ID="{i}"><P x="{x!r}" y="{y!r}" z="0"/><V x="{v!r}" y="{w!r}" z="0"/></Pt>'
        for i, ((x, y), (v, w)) in enumerate(zip(position.tolist(), state.velocity.tolist(), strict=True))
    )
    every = '<IDRange Type="All"/>'
    path.write_text(
        f"""\
<?xml version="1.0"?>
<DynamOconfig version="1.5.0">
<Simulation>
<Scheduler Type="NeighbourList"><Sorter Type="BoundedPQMinMax3"/></Scheduler>
<SimulationSize x="{Lx!r}" y="{Ly!r}" z="{DYNAMO_THICKNESS!r}"/>
<Genus><Species Mass="1" Name="Bulk" IntName="Bulk" Type="Point">{every}</Species></Genus>
<BC Type="PBC"/>
<Topology/>
<Interactions>
<Interaction Type="HardSphere" Diameter="1" Elasticity="{e_n!r}" Name="Bulk"><IDPairRange Type="All"/></Interaction>
</Interactions>
<Locals/>
<Globals><Global Type="Cells" Name="SchedulerNBList" NeighbourhoodRange="1">{every}</Global></Globals>
<SystemEvents/>
<Dynamics Type="Newtonian"/>
</Simulation>
<Properties/>
<ParticleData>
{particles}
</ParticleData>
</DynamOconfig>
""",
        encoding="ascii",
    )


def _timed_output(command: Sequence[str], folder: Path, option: str) -> tuple[list[tuple[float, str]], int]:
    """Lines that a program prints, each with its time, and the exit status of the program."""
    if sys.platform == "win32":
        raise InputError(f"{option}: not on Windows, where a program's lines cannot be timed as they come")
    # At a terminal, C programs hand over each line when it is complete, else thousands at once.
    reader, writer = os.openpty()
    output: list[tuple[float, str]] = []
    with open(reader, encoding="utf-8", errors="replace") as lines:
        try:
            process = subprocess.Popen(
                command, cwd=folder, stdin=subprocess.DEVNULL, stdout=writer, stderr=writer
            )
        except OSError as error:
            raise InputError(f"{option} = {command[0]}: it cannot be started: {error.strerror}") from None
        finally:
            os.close(writer)
        with process:
            try:
                for line in lines:
                    output.append((time.perf_counter(), line.rstrip()))
            except OSError:  # how Linux ends a terminal, once its program has ended
                pass
            except KeyboardInterrupt:
                process.kill()
                raise
    return output, process.returncode


def _failure(option: str, program: Path, wanted: str, status: int, text: str) -> InputError:
    said = "; ".join([line.strip() for line in text.splitlines() if line.strip()][-3:])
    return InputError(
        f"{option} = {program}: it ended with status {status} and not the output of {wanted}; "
        f"its last output: {said[-300:] or 'none'}"
    )
