"""Writers on disks of many sizes, in one process: `python -m support.full_disks FOLDER disk|limit LEVELS [NAME ...]`.

`disk`: FOLDER is a file system of 4 MiB, on which a filler leaves so much room. `limit`: no file may be larger. Each
attempt is a line of JSON: writer, bytes of room, its message ("" if it succeeded), and what is wrong, if anything.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import resource
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.fit import figure as fit_figure
from ifrdem.plots import run as plots
from ifrdem.runs.status import Status
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.study import task
from ifrdem.study.results import Results
from ifrdem.study.task import Variable
from ifrdem.tools import files
from ifrdem.trajectory.repair import repair
from ifrdem.trajectory.views import write_views
from ifrdem.validation.report import page

from .layout_files import write

PAGE = 4096
ROOM = 4 << 20
OLD = b"what was there before\n" * 400
"""Content of the files that writers replace; it takes three pages, which no writer may count upon."""
FULL = {"disk": (errno.ENOSPC, "free some space"), "limit": (errno.EFBIG, "ulimit -f")}
"""What a message says: the error of the system, and what helps."""


class Refused(Exception):
    """A command ended with exit status 2 and this message."""


def command(*words: str | Path) -> None:
    """Run a command; Refused with its message if it ends with status 2, and any other status is a fault."""
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        status = main([*map(str, words)])
    if status == 2:
        raise Refused(errors.getvalue().strip())
    if status:
        raise AssertionError(f"exit status {status}: {errors.getvalue()}")


def save_figure(path: Path, how: Callable[[Figure, Path], object]) -> None:
    """Save a small figure."""
    figure = Figure((2.0, 2.0))
    figure.subplots().plot(np.random.default_rng(1).normal(size=300))
    how(figure, path)


def results() -> Results:
    """Results of a study, of two values of a key and three seeds."""
    rng = np.random.default_rng(1)
    variables = {
        "e_n": Variable(("e_n",), np.array([0.7, 0.9]), ""),
        "seed": Variable(("seed",), np.arange(3), ""),
    }
    for name in ("temperature", "theta"):
        variables[name] = Variable(("e_n", "seed"), rng.uniform(size=(2, 3)), "")
    return Results(variables, {"axes": '{"e_n": ["e_n"]}', "keys": '{"e_n": "material[0].e_n"}'})


def write_status(path: Path) -> None:
    """Write a status file, which tells of a failure by `trouble`."""
    status = Status(path.with_name("gas.h5"), name="gas " * 3000)
    if status.trouble:
        raise InputError(status.trouble)


def write_repaired(source: Path, output: Path) -> None:
    """Repair a file; its damage is known, so a copy must come of it."""
    assert repair(source, output, log=lambda _text: None)


CHECKPOINT = {"arrays": {"x": np.random.default_rng(1).normal(size=3000)}, "record": {"n": 1}}
WRITERS: dict[str, tuple[str, Callable[[Path, Path], object]]] = {
    "checkpoint": ("c.checkpoint.h5", lambda path, _: checkpoint.write(path, **CHECKPOINT)),
    "checkpoint of ranks": (
        "p.checkpoint.h5", lambda path, _: checkpoint.write_parts(path, small=CHECKPOINT["arrays"], **CHECKPOINT),
    ),
    "results": ("s.nc", lambda path, _: results().write(path)),
    "result of a run": ("r.npz", lambda path, _: task.save(path, results().variables, seconds=1.0)),
    "status": ("gas.status.json", lambda path, _: write_status(path)),
    **{
        each: (f"f.{each}", lambda path, _: save_figure(path, plots.save)) for each in ("png", "pdf", "svg")
    },
    "figure of a fit": (
        "fit.pdf", lambda path, _: save_figure(path, lambda figure, one: fit_figure.save(figure, [one])),
    ),
    "report": ("report.html", lambda path, _: page.write(path.parent, [], {})),
    "text": ("t.json", lambda path, _: files.write_text(path, "text " * 3000)),
    "new": ("driven.toml", lambda path, _: command("new", "driven", "-o", path, "--force")),
    **{
        f"export to {each}": (
            f"e.{each}",
            lambda path, made, each=each: command("export", made / "run.h5", "--to", each, "-o", path, "--force"),
        )
        for each in ("h5", "csv", "extxyz", "gsd")
    },
    "repair": ("w.h5", lambda path, made: write_repaired(made / "bad.h5", path)),
    "repair of an end": ("w.h5", lambda path, made: write_repaired(made / "cut.h5", path)),
    "views": ("v.nc", lambda path, _: write_views(path.with_name("v.h5"))),
    "page": ("p.html", lambda path, made: command("view", made / "run.h5", "--html", path, "--force")),
    **{
        f"movie in {each}": (
            f"m.{each}",
            lambda path, made, each=each: command(
                "movie", made / "run.h5", "-o", path, "--force", "--frames", ":2", "--size", "160x160"
            ),
        )
        for each in ("webp", "gif", "mp4")
    },
    "analysis": (
        "a/run.json", lambda path, made: command("analyse", made / "run.h5", "velocity", "-o", path.parent, "--force"),
    ),
}  # fmt: skip
"""The file that each writes, and how: with its path, and a folder of files to be read."""
SLOW = ("page", "movie in mp4", "movie in gif", "movie in webp", "analysis", "new")
"""Those that take long or have many lines: fewer sizes."""


def make(folder: Path) -> None:
    """Write what is read: a trajectory, one with a damaged frame, one that lacks its end."""
    write(folder / "run.h5", n=60, frames=4)
    write(folder / "bad.h5", n=60, frames=4)
    import h5py

    with h5py.File(folder / "bad.h5", "r+") as file:
        file["particles/all/position/step"].resize(3, axis=0)
    shutil.copy(folder / "run.h5", folder / "cut.h5")
    os.truncate(folder / "cut.h5", (folder / "cut.h5").stat().st_size - 3000)


class Place:
    """A folder on which so many bytes are free, or no file may be larger."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.folder, self.kind, self.filler = folder / "full", kind, folder / "filler"

    def fresh(self, name: str, made: Path) -> None:
        """Empty the folder, but for an old file in the place of the new one, and what views refer to."""
        self.filler.unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        if name.startswith("v."):
            shutil.copy(made / "run.h5", self.folder / "v.h5")
        else:
            (self.folder / name).parent.mkdir(exist_ok=True)
            (self.folder / name).write_bytes(OLD)

    @contextlib.contextmanager
    def left(self, room: int) -> Iterator[None]:
        """Leave so many bytes."""
        if self.kind == "limit":
            before = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
            try:
                yield
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, before)
            return
        with open(self.filler, "wb", buffering=0) as file:
            with contextlib.suppress(OSError):
                while file.write(bytes(PAGE)):
                    pass
            file.truncate(file.tell() // PAGE * PAGE - room)
        yield

    def content(self) -> dict[str, bytes]:
        """What is in the folder."""
        return {
            str(each.relative_to(self.folder)): each.read_bytes()
            for each in sorted(self.folder.rglob("*"))
            if each.is_file()
        }


def try_one(place: Place, made: Path, name: str, room: int) -> tuple[str, str]:
    """Message, and what is wrong, of a writer that has so much room."""
    target, act = WRITERS[name]
    place.fresh(target, made)
    before, wrong, message = place.content(), "", ""
    try:
        with place.left(room):
            act(place.folder / target, made)
    except (InputError, Refused) as error:
        message = str(error)
        wrong = fault(place, name, message, before)
    except BaseException:
        wrong = traceback.format_exc()
    if not message and not wrong and (place.content().get(target) in (None, OLD, b"")):
        wrong = "nothing was written, and no message"
    if any(each.endswith(".part") for each in place.content()):
        wrong = f"left {[*place.content()]}"
    return message, wrong


def fault(place: Place, name: str, message: str, before: dict[str, bytes]) -> str:
    """What is wrong with a message, or with what is left."""
    after = place.content()
    number, remedy = FULL[place.kind]
    if name == "status":  # the run goes on without it
        remedy = ""
    if os.strerror(number) not in message or remedy not in message:
        return f"message without cause or remedy: {message}"
    if "\n" in message or str(place.folder) not in message:
        return f"message in several lines, or without a path: {message}"
    return "" if all(after.get(each) == old for each, old in before.items()) else "the old file is lost"


def walk(folder: Path, kind: str, levels: int, names: list[str]) -> None:
    """Print a line for each writer and size: so many sizes between nothing and what it takes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write beyond the limit is an error then, not a death
    made = folder / "made"
    made.mkdir(exist_ok=True)
    make(made)
    place = Place(folder, kind)
    for name in names or WRITERS:
        most = 2 * PAGE
        while try_one(place, made, name, most)[0] and most < ROOM:
            most *= 2
        many = min(levels, 3) if name in SLOW else levels
        rooms = {int(each) // PAGE * PAGE for each in np.linspace(0, most, many)}
        for room in sorted({*rooms, most}):
            print(json.dumps([name, room, None, None]), flush=True)  # of which it may die
            message, wrong = try_one(place, made, name, room)
            print(json.dumps([name, room, message, wrong]), flush=True)
        if kind == "disk":
            place.filler.unlink(missing_ok=True)


if __name__ == "__main__":
    walk(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4:])
