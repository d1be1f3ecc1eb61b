"""What output costs a run: the same gas with frames, time series and ledger, and without, in turn."""

from __future__ import annotations

import contextlib
import itertools
import math
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any

from scipy.stats import quantile_test

from . import bench, equilibrium, writer_process
from .cadence import Cadence, Span
from .case_output import ROWS_PER_FRAME
from .course import Course
from .gas import Gas
from .queued_writer import QueuedWriter
from .recorder import Ledger, Recorder
from .trajectory_writer import DEFAULT_FIELDS

FRAMES = 4
"""Frames in a timed piece, one for each collision that a disk has on average."""
LEAD = 1
"""Frames before it, not timed."""
BARE, TALLIED, WRITING = WAYS = ("bare", "with ledger", "writing")


class _LongEnough(Exception):
    """A piece is over."""


@dataclass(frozen=True)
class OutputCost:
    """Times that a collision per disk takes [s]: bare, with the energy ledger, and with all output, in turns.

    Attributes
    ----------
    n : int
        Disks.
    phi : float
        Packing fraction.
    compression : str
        Of the frames; `compressor` says by whom.
    bare, tallied, writing : list of float
        Seconds of each piece for one collision per disk.
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
            "writing_share": self.writing_share, "share_between": between(_shares(self.writing, self.bare)),
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
                f"  without output         {_spread(self.bare, 's')} for a collision per disk",
                f"  with the ledger        {_spread(self.tallied, 's')}",
                f"  and frames and series  {_spread(self.writing, 's')}, {self.rows} rows of series",
                f"  a plain writing        {_spread(self.plainly, 's')} for the bytes of a frame, alone",
                f"  the ledger costs       {_cost(self.tallied, self.bare)}",
                f"  frames, series cost    {_cost(self.writing, self.tallied)}",
                f"  all output costs       {_cost(self.writing, self.bare)}",
            ]
        )


def _shares(with_it: list[float], without: list[float], whole: float = 1.0) -> list[float]:
    return [whole * (w / b - 1.0) for w, b in zip(with_it, without, strict=True)]


def _spread(values: list[float], unit: str) -> str:
    middle = statistics.median(values)
    return f"{middle:.3g} {unit} (median of {len(values)}; {min(values):.3g} to {max(values):.3g} {unit})"


def between(values: list[float]) -> tuple[float, float] | None:
    """Where the median of all such values lies, with 95 % confidence, by the binomial test; None if they are few."""
    low, high = quantile_test(values, p=0.5).confidence_interval(0.95)
    return (float(low), float(high)) if math.isfinite(low) and math.isfinite(high) else None


def _cost(with_it: list[float], without: list[float]) -> str:
    shares = _shares(with_it, without, 100.0)
    found = between(shares)
    sure = "" if found is None else f"; 95 % sure: {found[0]:.3g} to {found[1]:.3g} %"
    return _spread(shares, "%") + sure


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

    One simulation does all three: where its arrays come to lie in memory can make one faster than its equal by 5 %. The
    pieces are short and take turns in every order, so that a change of the machine's speed hits all.

    Raises
    ------
    InputError
        If the device is not there, or the disks do not fit.
    TrajectoryError
        If the temporary file cannot be written.
    """
    case = equilibrium.elastic_gas(n, phi, arch=arch, threads=threads, seed=seed)
    case = case.model_copy(update={"output": case.output.model_copy(update={"ledger": True})})
    gas = Gas.from_case(case)
    simulation = gas.simulation(case, gas.start(case))
    seconds: dict[str, list[float]] = {way: [] for way in WAYS}
    plainly: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"
        with (
            QueuedWriter(writer_process.begin(path, gas.disks, gas.box, compression=compression)) as writer,
            (Path(folder) / "plain").open("wb", buffering=0) as beside,
        ):
            recorder = Recorder(writer, Ledger())
            told: dict[str, Any] = {"observers": [recorder.frame], "samplers": [recorder.row]}

            def piece(way: str) -> float:
                """Seconds for a collision per disk, of FRAMES after LEAD; from one end of an epoch to another."""
                simulation.switch_ledger(way != BARE)
                saying = told if way == WRITING else {}
                before = simulation.collisions
                last = LEAD + FRAMES + 1  # never reached
                span = Span.to(n, simulation.time, before, collisions_per_disk=2.0 * before / n + last)
                course = Course(
                    span, Cadence(number=last), Cadence(number=ROWS_PER_FRAME * last, exact=False),
                    next_frame=1, next_row=1,
                )  # fmt: skip
                marks: list[tuple[float, int]] = []

                def after_epoch(_time: float, collisions: int) -> None:
                    if collisions - before >= (LEAD + FRAMES * len(marks)) * n / 2.0:
                        marks.append((time.perf_counter(), collisions))
                    if len(marks) == 2:
                        raise _LongEnough

                with contextlib.suppress(_LongEnough):
                    simulation.follow(course, progress=after_epoch, stored=DEFAULT_FIELDS, **saying)
                # What a run has to do with frames goes on while the next one comes. So it does here, from a frame
                # before the piece to its last one.
                recorder.write_rows()
                writer.flush()
                (began, first), (ended, collisions) = marks
                return (ended - began) / (collisions - first) * n / 2.0

            simulation.run(t_end=simulation.time + equilibrium.mixing_time(gas))
            bench.warm_up(simulation)
            for way in WAYS:
                piece(way)  # compiles its kernels
            orders = list(itertools.permutations(WAYS))
            for i in range(runs):
                for way in orders[i % len(orders)]:
                    seconds[way].append(piece(way))
                plainly.append(_write(beside, path.stat().st_size // len(writer)))
                note(
                    f"turn {i + 1} of {runs}: {seconds[BARE][-1]:.3g} s without output, {seconds[TALLIED][-1]:.3g} s "
                    f"with the ledger, {seconds[WRITING][-1]:.3g} s with all"
                )
            frames, rows, compressor = len(writer), writer.series_rows, writer.compressor
        size = path.stat().st_size
    return OutputCost(
        n, phi, compression, compressor, seconds[BARE], seconds[TALLIED], seconds[WRITING], plainly, rows,
        (size - 28 * n) / frames,
    )  # fmt: skip
