"""The live state of a run, in a small file next to its trajectory: NAME.status.json for NAME.h5.

The file is written aside and renamed into place, so that a reader never sees half of it.
"""

from __future__ import annotations

import json
import math
import os
import platform
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from ..errors import InputError, counted, printable
from ..tools import files, text_file
from ..tools.progress import clock_face

ENDING = files.STATUS
RUNNING, DONE, INTERRUPTED = "running", "done", "interrupted"
"""States of a run; of others, such as "failed" or "full disk", the message says more."""
QUIET = 600.0
"""Seconds without news after which a run on another machine is taken for dead."""


def _moment(text: str) -> str:
    if datetime.fromisoformat(text).tzinfo is None:
        raise ValueError("must have a time zone")
    return text


Text = Annotated[str, AfterValidator(lambda text: printable(text).replace("\n", "\\n"))]
# Finite numbers, such that ratios of them are finite, too.
Number = Annotated[int | float, Field(gt=-1e300, lt=1e300)] | None


class Record(BaseModel):
    """Content of the file; numbers are null while unknown."""

    model_config: ClassVar[ConfigDict] = ConfigDict(strict=True, allow_inf_nan=False)

    format: Literal[1]
    name: Text = ""
    state: Annotated[Text, Field(min_length=1)]
    message: Text = ""
    updated: Annotated[str, AfterValidator(_moment)]
    started: Text = ""
    pid: Annotated[int, Field(gt=0, lt=2**31)]
    host: Text = ""
    trajectory: Text = ""
    t_end: Number = None
    collisions_per_disk_end: Number = None
    device: Text = ""
    time: Number = None
    collisions: Number = None
    collisions_per_disk: Number = None
    fraction: Number = None
    collisions_per_second: Number = None
    eta_seconds: Number = None
    frames: Number = None
    series_rows: Number = None
    temperature: Number = None
    rotational_temperature: Number = None
    energy: Number = None
    dissipated_energy: Number = None
    ledger_residual: Number = None
    runs: Number = None
    runs_done: Number = None
    runs_failed: Number = None


def path_of(trajectory: str | os.PathLike[str]) -> Path:
    """The status file of a trajectory file, or of the results of a study."""
    path = Path(trajectory)
    return path.with_name(path.name.removesuffix(".h5").removesuffix(".nc").removesuffix(".runs") + ENDING)


class Status:
    """Writer of the status file of a run, next to its trajectory file.

    A full disk, or a folder that is gone, does not end the run: the status keeps its last content, and `trouble` says
    why.

    The `name` of the run, its end and its device are given once. `interval` are the seconds between two writings at
    least, but `finish` always writes; `clock` gives seconds of real time.
    """

    def __init__(
        self,
        trajectory: str | os.PathLike[str],
        *,
        name: str,
        t_end: float | None = None,
        collisions_per_disk_end: float | None = None,
        device: str = "",
        interval: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path: Path = path_of(trajectory)
        self.trouble: str | None = None
        self._interval = interval
        self._clock = clock
        self._record = Record(
            format=1, name=name, state=RUNNING, updated=_now(), started=_now(), pid=os.getpid(), host=platform.node(),
            trajectory=Path(trajectory).name, t_end=t_end, collisions_per_disk_end=collisions_per_disk_end,
            device=device,
        )  # fmt: skip
        self._write()

    def update(self, **values: float | None) -> None:
        """Set some numbers of the `Record`, and write the file if the last writing is long enough ago.

        Raises TypeError if there is none of a name.
        """
        for name, value in values.items():
            if name not in Record.model_fields:
                raise TypeError(f"status has no value {name!r}: there are {', '.join(Record.model_fields)}")
            number: int | float | None = None
            if value is not None and math.isfinite(value):
                number = float(value) if isinstance(value, float) else int(value)
            setattr(self._record, name, number)
        if self._clock() - self._written >= self._interval:
            self._write()

    def finish(self, state: str, message: str = "") -> None:
        """Write the end of the run: `DONE`, `INTERRUPTED`, "failed", "full disk", ..., and the reason."""
        self._record.state, self._record.message, self._record.eta_seconds = state, message, None
        self._write()

    def _write(self) -> None:
        self._written = self._clock()
        self._record.updated = _now()
        try:
            with files.replacing(
                self.path, synced=False
            ) as new:  # soon replaced, and read while the run goes on
                new.write_text(json.dumps(self._record.model_dump(), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            self.trouble = f"{self.path} could not be written: {files.reason(error)}"
        else:
            self.trouble = None


def find(path: str | os.PathLike[str]) -> Path:
    """The status file of a path: itself, that of a trajectory, or the only or newest one in a folder.

    Raises InputError if there is none.
    """
    given = Path(path)
    if os.path.isdir(given):
        found = sorted(given.glob(f"*{ENDING}"), key=lambda one: one.stat().st_mtime)
        if not found:
            raise InputError(f"{path}: no run has written its status (*{ENDING}) in this folder")
        return found[-1]
    status = given if given.name.endswith(ENDING) else path_of(given)
    if not os.path.isfile(status):
        raise InputError(f"{path}: there is no status file {status}; a run writes it next to its trajectory")
    return status


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Content of the status file of a run; `path` as for `find`.

    The state of a run that says it is running, and whose process is gone, is "dead" here.

    Raises InputError if there is no such file, or it is not one of ours.
    """
    status_file = find(path)
    try:
        given = json.loads(text_file.read(status_file, most=files.MOST_STATUS))
        record = Record.model_validate(given)
    except InputError as error:
        raise InputError(f"{status_file} is not a status file of ifrdem: {error}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = str(next(iter(first["loc"]), ""))
        if name in ("", "format", "state"):
            raise InputError(f"{status_file} is not a status file of ifrdem of format 1") from None
        problem = f"{name} = {first['input']!r}: {first['msg']}" if name in given else f"{name} is missing"
        raise InputError(f"{status_file} is damaged: {printable(problem)}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{status_file} is not a status file of ifrdem: {error}") from error
    if record.state == RUNNING and not _lives(record):
        record.state = "dead"
        held = "it had reported no frame"
        if record.frames:
            held = f"{record.trajectory} holds the {counted(int(record.frames), 'frame')} it had committed"
        record.message = f"process {record.pid} is gone without a word; {held}"
    return record.model_dump()


def line(content: dict[str, Any]) -> str:
    """Progress of a run in one line, with the time left or its end."""
    T, T_rot, runs = content["temperature"], content["rotational_temperature"], content["runs"]
    values = (
        ("{:5.1f} %", None if content["fraction"] is None else 100.0 * content["fraction"]),
        (f"{{}} of {runs} runs", None if runs is None else content["runs_done"]),
        ("{} failed", content["runs_failed"] or None),
        ("t = {:.5g}", content["time"]),
        ("{:.2f} collisions per disk", content["collisions_per_disk"]),
        ("T = {:.4g}", T),
        ("T_rot/T = {:.4f}", T_rot / T if T and T_rot is not None else None),
        ("residual {:.1e}", content["ledger_residual"]),
        ("{:.3g} collisions/s", content["collisions_per_second"]),
    )
    eta = content["eta_seconds"]
    ending = f"ETA {clock_face(math.inf if eta is None else eta)}"
    if content["state"] != RUNNING:
        ending = f"{content['state']}: {content['message']}" if content["message"] else content["state"]
    return ", ".join([*(text.format(value) for text, value in values if value is not None), ending])


def show(
    path: str | os.PathLike[str],
    log: Callable[[str], object] = print,
    *,
    follow: bool = False,
    interval: float = 1.0,
    sleep: Callable[[float], None] = time.sleep,
) -> str:
    """Print the progress of a run; with `follow`, a line at each change until it ends.

    `path` is as for `find`; `interval` are the seconds between two looks. Returns the run's state at last: "running",
    "done", "dead", ...

    Raises InputError as `read`.
    """
    status_file = find(path)
    latest: dict[str, Any] = {}
    content = read(status_file)
    log(f"{content['name']}: {content['trajectory']}, started {content['started']}")
    while True:
        if content != latest:
            log(line(content))
            latest = content
        if not follow or content["state"] != RUNNING:
            return str(content["state"])
        sleep(interval)
        content = read(status_file)


def _lives(record: Record) -> bool:
    """True if the process of a run exists; for a run on another machine, if its last update is recent."""
    if os.name != "posix" or record.host != platform.node():
        return (datetime.now(UTC) - datetime.fromisoformat(record.updated)).total_seconds() < QUIET
    try:
        os.kill(record.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it exists, and belongs to another user
        return True
    return True


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
