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

from ...case.gas import Gas
from ...case.output_section import ROWS_PER_FRAME
from ...run.recorder import Ledger, Recorder
from ...simulation.schedule import Cadence, Course, Span
from ...trajectory import writer_process
from ...trajectory.background import QueuedWriter
from ...trajectory.writer import DEFAULT_FIELDS
from . import bench, equilibrium

FRAMES = 4
"""Frames in a timed piece, one for each collision that a disk has on average: so many at least."""
LEAD = 1
"""Frames before it, not timed."""
LEAST_SECONDS = 0.5
"""A piece with all output takes as long at least; of small gases it has more frames."""
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
    frames : int
        Of a piece.
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
    frames: int
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
            "seconds_plain_write": self.plainly, "frames": self.frames,
            "share": self.share, "ledger_share": self.ledger_share,
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
                f"{len(self.bare)} turns of pieces of {self.frames} frames, without output and with; times are for a "
                "collision per disk, which is a frame's share",
                f"  a frame                {self.frame_bytes / 1e6:.3g} MB in the file, with its share of index and "
                f"series; compression {self.compression}{by}",
                f"  without output         {_spread(self.bare)}",
                f"  with the ledger        {_spread(self.tallied)}",
                f"  and frames and series  {_spread(self.writing)}; {self.rows} rows of series",
                f"  for comparison         {_spread(self.plainly)}: a plain write of a frame's bytes, with nothing "
                "else going on",
                f"  the ledger costs       {_cost(self.tallied, self.bare, 'without')}",
                f"  frames, series cost    {_cost(self.writing, self.tallied, 'with the ledger')}",
                f"  all output costs       {_cost(self.writing, self.bare, 'without')}",
            ]
        )


def _shares(with_it: list[float], without: list[float], whole: float = 1.0) -> list[float]:
    return [whole * (w / b - 1.0) for w, b in zip(with_it, without, strict=True)]


def _spread(values: list[float]) -> str:
    return f"{statistics.median(values):.3g} s (median; {min(values):.3g} to {max(values):.3g} s)"


def between(values: list[float]) -> tuple[float, float] | None:
    """Where the median of all such values lies, with 95 % confidence, by the binomial test; None if they are few."""
    low, high = quantile_test(values, p=0.5).confidence_interval(0.95)
    return (float(low), float(high)) if math.isfinite(low) and math.isfinite(high) else None


def _cost(with_it: list[float], without: list[float], of: str) -> str:
    shares = _shares(with_it, without, 100.0)
    found = between(shares)
    sure = "too few turns to say how sure that is"
    if found is not None:
        sure = f"with 95 % confidence {found[0]:.3g} to {found[1]:.3g} %"
    more = 1e3 * statistics.median(w - b for w, b in zip(with_it, without, strict=True))
    return f"{statistics.median(shares):.3g} % of a run {of}, {more:.3g} ms a frame ({sure})"


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

            def piece(way: str, frames: int) -> float:
                """Seconds for a collision per disk, of so many after LEAD; from one end of an epoch to another."""
                simulation.switch_ledger(way != BARE)
                saying = told if way == WRITING else {}
                before = simulation.collisions
                last = LEAD + frames + 1  # never reached
                span = Span.to(n, simulation.time, before, collisions_per_disk=2.0 * before / n + last)
                course = Course(
                    span, Cadence(number=last), Cadence(number=ROWS_PER_FRAME * last, exact=False),
                    next_frame=1, next_row=1,
                )  # fmt: skip
                marks: list[tuple[float, int]] = []

                def after_epoch(_time: float, collisions: int) -> None:
                    if collisions - before >= (LEAD + frames * len(marks)) * n / 2.0:
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
                piece(way, FRAMES)  # compiles its kernels
            once = piece(WRITING, FRAMES)
            frames = max(FRAMES, math.ceil(LEAST_SECONDS / once))
            orders = list(itertools.permutations(WAYS))
            for i in range(runs):
                for way in orders[i % len(orders)]:
                    seconds[way].append(piece(way, frames))
                plainly.append(_write(beside, path.stat().st_size // len(writer)))
                note(
                    f"turn {i + 1} of {runs}: {seconds[BARE][-1]:.3g} s without output, {seconds[TALLIED][-1]:.3g} s "
                    f"with the ledger, {seconds[WRITING][-1]:.3g} s with all"
                )
            written, rows, compressor = len(writer), writer.series_rows, writer.compressor
        size = path.stat().st_size
    return OutputCost(
        n, phi, compression, compressor, seconds[BARE], seconds[TALLIED], seconds[WRITING], plainly, frames,
        rows, (size - 28 * n) / written,
    )  # fmt: skip
