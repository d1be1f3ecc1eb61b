"""Cost of output: `python -m ifrdem.validation.speed.output_cost --n 1000000 --every 5 --turns 48`.

One elastic gas runs in short pieces without output, with the energy ledger, and with ledger, frames and time series, in
turns: where its arrays lie in memory can make one simulation faster than its equal by 5 %, and a change of the
machine's speed hits all three. Frames stand at even times.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, cast

from scipy.stats import quantile_test

from ...case.gas import CaseGas
from ...case.output_section import ROWS_PER_FRAME
from ...runs.recorder import Ledger, Recorder
from ...simulation.steps.schedule import RunPlan, RunPoint, Trigger
from ...tools.arguments import script
from ...trajectory.writer import TrajectoryWriter
from . import bench

FRAMES = 4
"""Frames in a timed piece."""
BARE, LEDGER, ALL = WAYS = ("bare", "with ledger", "with all")


def output_cost(
    *, n: int = 100_000, phi: float = 0.3, every: float = 5.0, compression: str = "none", turns: int = 24,
    device: str = "cpu", threads: int | None = None, seed: int = 1,
) -> None:  # fmt: skip
    """Print, as JSON, seconds of each piece for one collision per disk, and shares with their 95 % confidence.

    A frame stands after `every` collisions of a disk on average, by theory.
    """
    case = bench.elastic_gas(n, phi, device=device, threads=threads, seed=seed)
    case = case.model_copy(update={"output": case.output.model_copy(update={"ledger": True})})
    gas = CaseGas.from_case(case)
    simulation = gas.simulation()
    seconds: dict[str, list[float]] = {way: [] for way in WAYS}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"
        with TrajectoryWriter(path, gas.disks, gas.box, compression=compression) as writer:
            recorder = Recorder(cast(Any, writer), Ledger())

            def piece(way: str) -> float:
                """Seconds for a collision per disk."""
                simulation.switch_ledger(way != BARE)
                begin = RunPoint(simulation.time, simulation.collisions)
                end = RunPoint(time=begin.time + FRAMES * every * bench.mean_free_time(gas))
                frames = Trigger(number=FRAMES if way == ALL else 1)
                rows = Trigger(number=ROWS_PER_FRAME * FRAMES, exact=False) if way == ALL else None
                # As in a continued run: the previous piece has its last frame and row.
                plan = RunPlan(n, begin, end, frames, rows, next_frame=1, next_row=1)
                output: dict[str, Any] = {
                    "frame_callbacks": [recorder.frame],
                    "series_callbacks": [recorder.row],
                }
                before, began = simulation.collisions, time.perf_counter()
                simulation.follow(plan, **(output if way == ALL else {}))
                recorder.write()
                return (time.perf_counter() - began) / (simulation.collisions - before) * n / 2.0

            simulation.run(t_end=bench.mixing_time(gas))
            bench.warm_up(simulation)
            for way in WAYS:
                piece(way)  # compiles its kernels
            orders = list(itertools.permutations(WAYS))
            for i in range(turns):
                for way in orders[i % len(orders)]:
                    seconds[way].append(piece(way))
            frames = len(writer)
        size = path.stat().st_size
    print(
        json.dumps(
            {
                "n": n, "phi": phi, "every": every, "compression": compression,
                "seconds": seconds, "frame_bytes": size / frames,
                "ledger": cost(seconds[LEDGER], seconds[BARE]),
                "frames and series": cost(seconds[ALL], seconds[LEDGER]),
                "all output": cost(seconds[ALL], seconds[BARE]), **bench.environment(),
            }, indent=2,
        )
    )  # fmt: skip


def cost(with_it: list[float], without: list[float]) -> dict[str, Any]:
    """The median over pieces side by side of the share that is more, and the interval that encloses it."""
    shares = [w / b - 1.0 for w, b in zip(with_it, without, strict=True)]
    return {"share": statistics.median(shares), "between": between(shares)}


def between(values: list[float]) -> tuple[float, float] | None:
    """Interval of the median with 95 % confidence, by the binomial test; None if the values are few."""
    low, high = quantile_test(values, p=0.5).confidence_interval(0.95)
    return (float(low), float(high)) if math.isfinite(low) and math.isfinite(high) else None


if __name__ == "__main__":
    sys.exit(script(output_cost))
