"""What output costs a run: the same gas with frames, time series and ledger, and without, in turn."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any

from . import bench, equilibrium, writer_process
from .cadence import Cadence, Span
from .case_output import ROWS_PER_FRAME
from .course import Course
from .gas import Gas
from .queued_writer import QueuedWriter
from .recorder import Ledger, Recorder
from .simulation import Simulation
from .trajectory_writer import DEFAULT_FIELDS

FRAMES = 20
"""Frames in a timed piece, one for each collision that a disk has on average."""


@dataclass(frozen=True)
class OutputCost:
    """Times of pieces of a run [s]: bare, with the energy ledger, and with all output, in turn.

    Attributes
    ----------
    n : int
        Disks.
    phi : float
        Packing fraction.
    compression : str
        Of the frames; `compressor` says by whom.
    bare, tallied, writing : list of float
        Seconds of each piece, FRAMES collisions per disk.
    plainly : list of float
        Seconds that a plain writing of as many bytes as a frame has took beside each piece, with nothing else going on.
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
    tallied: list[float]
    writing: list[float]
    plainly: list[float]
    rows: int
    frame_bytes: float

    @property
    def share(self) -> float:
        """What output costs, as a part of the run without: the median over pieces side by side."""
        return statistics.median(_shares(self.writing, self.bare))

    @property
    def ledger_share(self) -> float:
        """What of that the energy ledger costs, likewise."""
        return statistics.median(_shares(self.tallied, self.bare))

    @property
    def writing_share(self) -> float:
        """What frames and time series cost, as a part of the run that keeps the ledger, likewise."""
        return statistics.median(_shares(self.writing, self.tallied))

    def figures(self) -> dict[str, Any]:
        """All figures, as JSON knows them."""
        return {
            "n": self.n, "phi": self.phi, "compression": self.compression, "compressor": self.compressor,
            "seconds_bare": self.bare, "seconds_with_ledger": self.tallied, "seconds_writing": self.writing,
            "seconds_plain_write": self.plainly, "share": self.share, "ledger_share": self.ledger_share,
            "writing_share": self.writing_share,
            "series_rows": self.rows, "frame_bytes": self.frame_bytes, "environment": bench.environment(),
        }  # fmt: skip

    def report(self) -> str:
        """For people."""
        by = f" by {self.compressor}" if self.compressor else ""
        return "\n".join(
            [
                f"elastic gas: {self.n} disks, packing fraction {self.phi:g}; a frame for each collision that a disk "
                "has, time series and ledger",
                f"  a frame                {self.frame_bytes / 1e6:.3g} MB in the file, compression "
                f"{self.compression}{by}",
                f"  without output         {_spread(self.bare, 's')} for {FRAMES} collisions per disk",
                f"  with the ledger        {_spread(self.tallied, 's')}",
                f"  and frames and series  {_spread(self.writing, 's')}, {self.rows} rows of series",
                f"  a plain writing        {_spread(self.plainly, 's')} for the bytes of a frame, alone",
                f"  the ledger costs       {_spread(_shares(self.tallied, self.bare, 100.0), '%')}",
                f"  frames, series cost    {_spread(_shares(self.writing, self.tallied, 100.0), '%')}",
                f"  all output costs       {_spread(_shares(self.writing, self.bare, 100.0), '%')}",
            ]
        )


def _shares(with_it: list[float], without: list[float], whole: float = 1.0) -> list[float]:
    return [whole * (w / b - 1.0) for w, b in zip(with_it, without, strict=True)]


def _spread(values: list[float], unit: str) -> str:
    middle = statistics.median(values)
    return f"{middle:.3g} {unit} (median of {len(values)}; {min(values):.3g} to {max(values):.3g} {unit})"


def _write(file: FileIO, size: int) -> float:
    """Seconds that a plain writing of so many bytes takes."""
    data = bytes(size)
    began = time.perf_counter()
    file.write(data)
    return time.perf_counter() - began


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
    """Time pieces of an elastic gas at equilibrium, bare, with the ledger and writing, in turn.

    Two simulations of the same start run side by side, so that a change of the machine's speed hits both. Where their
    arrays come to lie in memory can make one of them faster than the other by some 5 %: each round builds both anew,
    now the one first and now the other.

    Raises
    ------
    InputError
        If the device is not there, or the disks do not fit.
    TrajectoryError
        If the temporary file cannot be written.
    """
    case = equilibrium.elastic_gas(n, phi, arch=arch, threads=threads, seed=seed)
    gas = Gas.from_case(case)
    kept = case.output.model_copy(update={"ledger": True})
    cases = {"bare": case, "telling": case.model_copy(update={"output": kept})}
    state = gas.start(case)
    bare: list[float] = []
    tallied: list[float] = []
    writing: list[float] = []
    plainly: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"
        with (
            QueuedWriter(writer_process.begin(path, gas.disks, gas.box, compression=compression)) as writer,
            (Path(folder) / "plain").open("wb", buffering=0) as beside,
        ):
            recorder = Recorder(writer, Ledger())
            told: dict[str, Any] = {"observers": [recorder.frame], "samplers": [recorder.row]}

            def piece(simulation: Simulation, *, first: bool = False, **told: Any) -> float:
                done = 2.0 * simulation.collisions / n
                span = Span.to(n, simulation.time, simulation.collisions, collisions_per_disk=done + FRAMES)
                course = Course(
                    span, Cadence(number=FRAMES if told else 1),
                    Cadence(number=ROWS_PER_FRAME * FRAMES, exact=False) if told else None,
                    next_frame=0 if first else 1, next_row=0 if first else 1,
                )  # fmt: skip
                began = time.perf_counter()
                simulation.follow(course, stored=DEFAULT_FIELDS, **told)
                ended = time.perf_counter()
                # A run goes on while its latest frame is written; the next piece must not.
                recorder.write_rows()
                writer.flush()
                return ended - began

            for i in range(runs):
                built = {
                    name: gas.simulation(cases[name], state) for name in sorted(cases, reverse=i % 2 == 1)
                }
                for simulation in built.values():
                    simulation.run(t_end=simulation.time + (equilibrium.mixing_time(gas) if i == 0 else 0.0))
                    bench.warm_up(simulation)
                    simulation.run(collisions_per_disk=2.0 * simulation.collisions / n + 2.0)
                if i == 0:
                    piece(built["telling"], first=True, **told)  # compiles the kernels of output
                bare.append(piece(built["bare"]))
                for seconds, said in [(tallied, {}), (writing, told)][:: 1 - 2 * (i % 2)]:
                    seconds.append(piece(built["telling"], **said))
                plainly.append(_write(beside, path.stat().st_size // len(writer)))
                note(
                    f"piece {i + 1} of {runs}: {bare[-1]:.3g} s without output, {tallied[-1]:.3g} s with the ledger, "
                    f"{writing[-1]:.3g} s with all"
                )
                state = built["telling"].state
                del built, simulation  # their memory, before there are others
            frames, rows, compressor = len(writer), writer.series_rows, writer.compressor
        size = path.stat().st_size
    return OutputCost(
        n, phi, compression, compressor, bare, tallied, writing, plainly, rows, (size - 28 * n) / frames
    )
