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

**Is it the same gas?** An untimed run of LAMMPS, sampled every contact time, is held against ifrdem:

- its energy per disk, kinetic and springs, against ifrdem's T(t) at ten times, within 1 %;
- for e_n = 1, energy is kept within 1e-3 (seen: 1e-5);
- its own count of contacts against ifrdem's collisions, within 5 % + 3 / sqrt(collisions). It is systematically lower
  in dilute gases (2 % at packing fraction 0.1), where 1/100 of a mean free path is a notable overlap.

A comparison that fails is said and ends with exit status 1; a code that is not installed is `not measured`.

EDMD and DynamO are held against ifrdem in each run: elastic, T within 1e-3 and collisions per disk and time, scaled to
T = 1, within 1 % + 5 / sqrt(collisions); else ln T at the end within 5 % + 5 / sqrt(collisions).

Event-driven codes have the same collisions until rounding separates them, after some ten per disk; from then on a
cooling gas has the same T only on average, and in a small one they differ visibly.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
import statistics
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

from ...errors import EngineError, InputError
from ...simulation import device
from ...tools.arguments import Parser, whole
from ...tools.versions import __version__
from . import soft_disks, spheres
from .side_by_side import Options, Timing, compare

FEWEST_RUNS = 5
SPHERES = "how: python -m pydoc ifrdem.validation.speed.spheres"
BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130


def report(options: Options, rows: Sequence[Timing]) -> dict[str, Any]:
    """The figures that `--json` prints."""
    ours = statistics.median(rows[0].rates)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "cpu": device.cpu_name(),
        "cores": device.cores(),
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
    for package in ("taichi", "numpy", "numba", "lammps", "mpich"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


# --- the command line -------------------------------------------------------------------------------------------------


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
    parser = Parser(
        prog="python -m ifrdem.validation.speed.peers",
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
    parser.add_argument(
        "--edmd",
        metavar="PATH",
        help=f"time EDMD too, as a thin 3D gas in a plane: {spheres.EDMD}, compiled ({SPHERES})",
    )
    parser.add_argument(
        "--dynamo",
        metavar="PATH",
        help=f"time DynamO too, as a thin 3D gas in a plane: {spheres.DYNAMO} ({SPHERES})",
    )
    parser.add_argument("--seed", metavar="S", default="1", help="seed of the start (1)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    given = parser.parse_args(list(arguments))

    n = whole("--n", given.n, 100)
    threads = device.cores()
    if given.threads is not None:
        threads = whole("--threads", given.threads, 1, threads)
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
        runs=whole("--runs", given.runs, FEWEST_RUNS),
        collisions=length,
        soft_collisions=soft_length,
        steps_per_contact=whole("--steps-per-contact", given.steps_per_contact, 10, 1000),
        edmd=None if given.edmd is None else spheres.executable("--edmd", given.edmd),
        dynamo=None if given.dynamo is None else spheres.executable("--dynamo", given.dynamo),
        seed=whole("--seed", given.seed, 0),
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
