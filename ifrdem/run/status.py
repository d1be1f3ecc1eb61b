"""The live state of a run, in a small file beside its trajectory: NAME.status.json for NAME.h5.

The file is renamed into place, so that a reader never sees half of it. It always has the size `RESERVED`, blanks at its
end: where a full disk leaves no room for another one, the file that is there is written over, which needs no more.
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
from typing import Any

from ..errors import InputError, printable
from ..tools import files
from .progress import clock_face

FORMAT = 1
ENDING = ".status.json"
RUNNING = "running"
VALUES = (
    "time",
    "collisions",
    "collisions_per_disk",
    "fraction",
    "collisions_per_second",
    "eta_seconds",
    "frames",
    "series_rows",
    "temperature",
    "rotational_temperature",
    "energy",
    "dissipated_energy",
    "ledger_residual",
)
"""Values that a run reports as it goes; null in the file while unknown."""
RESERVED = 4096
"""Bytes of the file: a block of common file systems."""
TEXTS = ("name", "state", "message", "updated", "started", "host", "trajectory", "device")
MOST = 1 << 20  # bytes of a status file that are read
MOST_VALUE = 1e300  # of a number, so that ratios of them are finite
QUIET = 600.0
"""Seconds without news after which a run on another machine is taken for dead."""


def path_of(trajectory: str | os.PathLike[str]) -> Path:
    """The status file of a trajectory file."""
    path = Path(trajectory)
    return path.with_name(path.name.removesuffix(".h5") + ENDING)


class Status:
    """Writes the status file of a run.

    On a full disk, the file that is there is written over in place. A folder that is gone, or a disk that was full from
    the beginning, does not end the run: the status is not written then, and `trouble` says why.

    Parameters
    ----------
    trajectory : str or path
        The trajectory file, which the status file stands beside.
    name : str
        Name of the run.
    t_end, collisions_per_disk_end : float or None
        What ends the run.
    device : str
        What it runs on.
    interval : float
        Seconds between two writings at least; `finish` always writes.
    clock : callable
        Seconds of real time; another one in tests.
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
        self._written = -math.inf
        now = _now()
        self._content: dict[str, Any] = {
            "format": FORMAT,
            "name": name,
            "state": RUNNING,
            "message": "",
            "updated": now,
            "started": now,
            "pid": os.getpid(),
            "host": _host(),
            "trajectory": Path(trajectory).name,
            "t_end": t_end,
            "collisions_per_disk_end": collisions_per_disk_end,
            "device": device,
            **dict.fromkeys(VALUES),
        }
        self._write()

    def update(self, **values: float | None) -> None:
        """Take note of some of `VALUES`, and write them if the last time is long enough ago.

        Raises
        ------
        TypeError
            If a name is not one of them.
        """
        for name, value in values.items():
            if name not in VALUES:
                raise TypeError(f"status has no value {name!r}: there are {', '.join(VALUES)}")
            self._content[name] = _plain(value)
        if self._clock() - self._written >= self._interval:
            self._write()

    def finish(self, state: str, message: str = "") -> None:
        """Write the end of the run: "done", "interrupted", "failed", "full disk", ..., and the reason."""
        self._content.update(state=state, message=message, eta_seconds=None)
        self._write()

    def _write(self) -> None:
        self._written = self._clock()
        self._content["updated"] = _now()
        content = _padded(self._content)
        try:
            with files.replacing(self.path) as new:
                new.write_bytes(content)
            self.trouble = None
        except OSError as error:
            self._overwrite(content, error)

    def _overwrite(self, content: bytes, reason: OSError) -> None:
        """Write the file in place, in the room that it has, because of what keeps another one from being written."""
        try:
            descriptor = os.open(self.path, os.O_WRONLY | getattr(os, "O_BINARY", 0))
            try:
                os.write(descriptor, content)
                os.fsync(descriptor)  # here, where a disk that is full after all is told of
            finally:
                os.close(descriptor)
            self.trouble = None
        except OSError:
            self.trouble = f"{self.path} could not be written: {reason.strerror}"


def _padded(content: dict[str, Any]) -> bytes:
    """The text of the file, of `RESERVED` bytes: a message that is too long for it is cut."""
    text = json.dumps(content, indent=1)
    while len(text) >= RESERVED and content["message"]:
        content = {**content, "message": content["message"][:-100]}
        text = json.dumps(content, indent=1)
    return text.ljust(RESERVED - 1).encode() + b"\n"


def find(path: str | os.PathLike[str]) -> Path:
    """The status file that a path means: itself, that of a trajectory, or the only or newest one in a folder.

    Raises
    ------
    InputError
        If there is none.
    """
    given = Path(path)
    if os.path.isdir(given):
        found = sorted(given.glob(f"*{ENDING}"), key=lambda one: one.stat().st_mtime)
        if not found:
            raise InputError(f"{path}: no run has written its status (*{ENDING}) in this folder")
        return found[-1]
    status = given if given.name.endswith(ENDING) else path_of(given)
    if not os.path.isfile(status):
        raise InputError(f"{path}: there is no status file {status}; a run writes it beside its trajectory")
    return status


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Content of the status file of a run; `path` as for `find`.

    The state of a run that says it is running, and whose process is gone, is "dead" here.

    Raises
    ------
    InputError
        If there is no such file, or it is not one of ours.
    """
    place = find(path)
    try:
        with place.open("rb") as file:
            content = json.loads(file.read(MOST + 1)[:MOST].decode())
    except OSError as error:
        raise InputError(f"{place} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{place} is not a status file of ifrdem: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT or not content.get("state"):
        raise InputError(f"{place} is not a status file of ifrdem of format {FORMAT}")
    _check(content, place)
    if content["state"] == RUNNING and not _lives(content):
        content["state"] = "dead"
        content["message"] = (
            f"process {content.get('pid')} is gone without a word; "
            f"{content.get('trajectory')} holds the {content.get('frames') or 'first'} frames it had committed"
        )
    return content


def _check(content: dict[str, Any], place: Path) -> None:
    """Refuse a status that no run of ours wrote, by the types of its values; escape control characters of its texts."""
    for name in TEXTS:
        if not isinstance(content.setdefault(name, ""), str):
            raise InputError(f"{place} is damaged: {name} = {content[name]!r}: a text is needed")
        content[name] = printable(content[name]).replace("\n", "\\n")
    for name in (*VALUES, "t_end", "collisions_per_disk_end"):
        value = content.setdefault(name, None)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (value is None or (number and abs(value) < MOST_VALUE)):
            raise InputError(f"{place} is damaged: {name} = {value!r}: a finite number or null is needed")
    if content["state"] != RUNNING:  # nobody asks then whether it lives
        return
    pid = content.get("pid")
    if not isinstance(pid, int) or not 0 < pid < 2**31:
        raise InputError(f"{place} is damaged: pid = {pid!r}: the number of a process is needed")
    try:
        if datetime.fromisoformat(content["updated"]).tzinfo is None:
            raise ValueError("it has no time zone")
    except ValueError as error:
        raise InputError(f"{place} is damaged: updated = {content['updated']!r}: {error}") from None


def line(content: dict[str, Any]) -> str:
    """Progress of a run in one line: what is known of it, and time left or its end."""
    part, T, T_rot = (content.get(name) for name in ("fraction", "temperature", "rotational_temperature"))
    values = (
        ("{:5.1f} %", None if part is None else 100.0 * part),
        ("t = {:.5g}", content.get("time")),
        ("{:.2f} collisions per disk", content.get("collisions_per_disk")),
        ("T = {:.4g}", T),
        ("T_rot/T = {:.4f}", T_rot / T if T and T_rot is not None else None),
        ("residual {:.1e}", content.get("ledger_residual")),
        ("{:.3g} collisions/s", content.get("collisions_per_second")),
    )
    eta = content.get("eta_seconds")
    ending = f"ETA {clock_face(math.inf if eta is None else eta)}"
    if content["state"] != RUNNING:
        ending = f"{content['state']}: {content['message']}" if content.get("message") else content["state"]
    return ", ".join([*(text.format(value) for text, value in values if value is not None), ending])


def tail(
    path: str | os.PathLike[str],
    say: Callable[[str], object] = print,
    *,
    follow: bool = True,
    interval: float = 1.0,
    sleep: Callable[[float], None] = time.sleep,
) -> str:
    """Print a line at each news of a run until it ends; without `follow`, one line.

    Parameters
    ----------
    path : str or path
        The trajectory, its status file, or a folder.
    say : callable
        Takes the lines.
    follow : bool
        Go on until the run ends.
    interval : float
        Seconds between two looks.
    sleep : callable
        Waits so many seconds; another one in tests.

    Returns
    -------
    str
        The run's state at last: "running", "done", "dead", ...

    Raises
    ------
    InputError
        As `read`.
    """
    place = find(path)
    latest: dict[str, Any] = {}
    content = read(place)
    say(f"{content.get('name')}: {content.get('trajectory')}, started {content.get('started')}")
    while True:
        if content != latest:
            say(line(content))
            latest = content
        if not follow or content["state"] != RUNNING:
            return str(content["state"])
        sleep(interval)
        content = read(place)


def _lives(content: dict[str, Any]) -> bool:
    """True if the process of a run is there; of a run on another machine, if its last news is recent."""
    if os.name != "posix" or content.get("host", "") != _host():
        age = datetime.now(UTC) - datetime.fromisoformat(content["updated"])
        return age.total_seconds() < QUIET
    try:
        os.kill(int(content["pid"]), 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it is there, and somebody else's
        return True
    return True


def _host() -> str:
    return platform.node()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _plain(value: float | None) -> float | int | None:
    """A number as JSON has it: no NumPy types, and null for what is not finite."""
    if value is None or not math.isfinite(value):
        return None
    return float(value) if isinstance(value, float) else int(value)
