"""What output costs a run: the same gas with frames, time series and ledger, and without, in turn."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import bench, equilibrium
from .cadence import Cadence
from .case_output import ROWS_PER_FRAME
from .gas import Gas
from .queued_writer import QueuedWriter
from .recorder import Ledger, Recorder
from .simulation import Simulation
from .trajectory_writer import TrajectoryWriter

FRAMES = 3
"""Frames in a timed piece, one for each collision that a disk has on average."""


@dataclass(frozen=True)
class OutputCost:
    """Times of pieces of a run [s], with output and without, in turn.

    Attributes
    ----------
    n : int
        Disks.
    phi : float
        Packing fraction.
    compression : str
        Of the frames; `compressor` says by whom.
    bare, writing : list of float
        Seconds of each piece, FRAMES collisions per disk.
    rows : int
        Rows of the time series in all.
    frame_bytes : float
        Of a frame in the file.
    """

    n: int
    phi: float
    compression: str
    compressor: str | None
    bare: list[float]
    writing: list[float]
    rows: int
    frame_bytes: float

    @property
    def share(self) -> float:
        """What output costs, as a part of the run without: the median over pieces side by side."""
        return statistics.median(w / b - 1.0 for w, b in zip(self.writing, self.bare, strict=True))

    def figures(self) -> dict[str, Any]:
        """All figures, as JSON knows them."""
        return {
            "n": self.n, "phi": self.phi, "compression": self.compression, "compressor": self.compressor,
            "seconds_bare": self.bare, "seconds_writing": self.writing, "share": self.share,
            "series_rows": self.rows, "frame_bytes": self.frame_bytes, "environment": bench.environment(),
        }  # fmt: skip

    def report(self) -> str:
        """For people."""
        shares = [w / b - 1.0 for w, b in zip(self.writing, self.bare, strict=True)]
        by = f" by {self.compressor}" if self.compressor else ""
        return "\n".join(
            [
                f"elastic gas: {self.n} disks, packing fraction {self.phi:g}; a frame for each collision that a disk "
                "has, time series and ledger",
                f"  a frame                {self.frame_bytes / 1e6:.3g} MB in the file, compression "
                f"{self.compression}{by}",
                f"  without output         {statistics.median(self.bare):.3g} s for {FRAMES} collisions per disk "
                f"(median of {len(self.bare)}; {min(self.bare):.3g} to {max(self.bare):.3g})",
                f"  with it                {statistics.median(self.writing):.3g} s "
                f"({min(self.writing):.3g} to {max(self.writing):.3g}), {self.rows} rows of series",
                f"  output costs           {100.0 * self.share:.1f} % (median; {100.0 * min(shares):.1f} to "
                f"{100.0 * max(shares):.1f} %)",
            ]
        )


def measure(
    n: int,
    phi: float,
    *,
    arch: str = "cpu",
    threads: int | None = None,
    seed: int = 1,
    runs: int = 5,
    compression: str = "none",
    note: Callable[[str], None] = lambda _: None,
) -> OutputCost:
    """Time pieces of an elastic gas at equilibrium, bare and writing in turn.

    Two simulations of the same start run side by side, so that a change of the machine's speed hits both.

    Raises
    ------
    InputError
        If the device is not there, or the disks do not fit.
    TrajectoryError
        If the temporary file cannot be written.
    """
    case = equilibrium.elastic_gas(n, phi, arch=arch, threads=threads, seed=seed)
    gas = Gas.from_case(case)
    state = gas.start(case)
    plain = gas.simulation(case, state)
    kept = case.output.model_copy(update={"ledger": True})
    telling = gas.simulation(case.model_copy(update={"output": kept}), state)
    for simulation in (plain, telling):
        simulation.run(t_end=simulation.time + equilibrium.mixing_time(gas))
    bare: list[float] = []
    writing: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"
        with QueuedWriter(TrajectoryWriter(path, gas.disks, gas.box, compression=compression)) as writer:
            recorder = Recorder(writer, Ledger())

            def piece(simulation: Simulation, **options: Any) -> float:
                began = time.perf_counter()
                done = 2.0 * simulation.collisions / n
                simulation.run(collisions_per_disk=done + FRAMES, **options)
                recorder.write_rows()
                writer.flush()
                return time.perf_counter() - began

            told: dict[str, Any] = {
                "frames": FRAMES,
                "observers": [recorder.frame],
                "series": Cadence(number=ROWS_PER_FRAME * FRAMES, exact=False),
                "samplers": [recorder.row],
            }
            piece(plain)
            piece(telling, **told)  # compiles the kernels of output
            for i in range(runs):
                bare.append(piece(plain))
                writing.append(piece(telling, **told))
                note(f"piece {i + 1} of {runs}: {bare[-1]:.3g} s without output, {writing[-1]:.3g} s with it")
            frames, rows, compressor = len(writer), writer.series_rows, writer.compressor
        size = path.stat().st_size
    return OutputCost(n, phi, compression, compressor, bare, writing, rows, (size - 28 * n) / frames)
