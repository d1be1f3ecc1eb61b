"""Speed and memory of a GPU: elastic gases at equilibrium, and the same on all CPU cores.

Energy is kept by each collision to rounding: after each measurement the temperature is what it was at the start.
"""

from __future__ import annotations

from ...simulation import backend
from ..report.registry import Result, Skip
from ..speed import bench

QUESTION = "How fast is a GPU compared with the cores of this machine, and what memory does it take?"
REFERENCE = "measured; conservation of energy"

SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
DENSITIES = (0.1, 0.3, 0.6)
MOST_QUICK = 100_000
MOST_CPU = 1_000_000  # beyond, the cores take minutes
HEADER = (
    "disks",
    "packing fraction",
    "precision",
    "collisions/s",
    "range",
    "ms a window",
    "run again",
    "bytes a disk",
)


def run(quick: bool, device: str = "cuda") -> Result:
    """Run on this device and on a CPU; without a GPU the case is skipped."""
    absence = backend.cuda_absence() if device == "cuda" else None
    if absence is not None:
        raise Skip(f"no GPU: {absence}")
    result = Result()
    for name in dict.fromkeys((device, "cpu")):
        rows = []
        for n in SIZES:
            if n > MOST_QUICK and (quick or (name == "cpu" and n > MOST_CPU)):
                continue
            for phi in DENSITIES if n == 1_000_000 else (0.3,):
                for precision in ("f64", "f32") if phi == 0.3 and n == 1_000_000 else ("f64",):
                    rows.append(_timed(result, name, n, phi, precision))
        what = backend.describe(name).description
        result.table(
            f"elastic gases on {what}", HEADER, rows, "medians of three runs of half a second or more"
        )
    return result


def _timed(result: Result, device: str, n: int, phi: float, precision: str) -> tuple[str | float, ...]:
    _gas, simulation = bench.prepared(bench.elastic_gas(n, phi, device=device, precision=precision))
    start = simulation.measure().energy
    runs = [bench.timed(simulation, bench.SECONDS) for _ in range(3)]
    rates = sorted(each.rate for each in runs)
    windows = sum(each.done["windows"] for each in runs)
    tolerance = 1e-11 if precision == "f64" else 1e-3
    result.near(
        f"energy after the measurement, {n} disks at {phi:g}, {precision}, {device}",
        simulation.measure().energy / start,
        1.0, tolerance, "rounding of each collision", "conservation",
    )  # fmt: skip
    window = 1e3 * sum(each.seconds for each in runs) / windows
    again = sum(each.done["run_again"] for each in runs)
    scatter, memory = f"{rates[0]:.3g} to {rates[2]:.3g}", f"{simulation.bytes_allocated / n:.0f}"
    return n, phi, precision, f"{rates[1]:.3g}", scatter, f"{window:.3g}", again, memory
