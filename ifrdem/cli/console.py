"""Lines for people on the standard streams, exit statuses, and the layout of `--help`."""

from __future__ import annotations

import logging
import os
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..errors import printable
from ..mpi import Communicator
from ..mpi.communicator import world

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130  # what shells use for SIGINT
UNFINISHED = 3

LOG = logging.getLogger("ifrdem")
WIDTH = 100
"""Columns of `--help` where it is not shown on a terminal."""


def say(message: str) -> None:
    """Print a result."""
    print(message, flush=True)


def note(message: str) -> None:
    """Print a line on what was done; `--quiet` leaves it out."""
    LOG.info(message)


def progress(message: str) -> None:
    """Print a line on what is being done to the standard error stream; `--quiet` leaves it out."""
    LOG.info(message, extra={"progress": True})


def warn(message: str) -> None:
    """Print a warning to the standard error stream."""
    LOG.warning(message)


def complain(message: str) -> None:
    """Print an error to the standard error stream."""
    LOG.error(message)


def forget_output() -> None:
    """Drop output that can no longer be written, which Python would try again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _Streams(logging.Handler):
    """Notes on the standard output; progress, details, warnings and errors on the standard error stream."""

    def emit(self, record: logging.LogRecord) -> None:
        message = record.getMessage()
        if record.levelno == logging.INFO and not hasattr(record, "progress"):
            say(message)
            return
        sys.stdout.flush()
        warning = "warning: " if record.levelno == logging.WARNING else ""
        for line in f"{warning}{message}".splitlines():  # messages quote files, which may hold anything
            print(f"ifrdem: {printable(line)}", file=sys.stderr)


@contextmanager
def shown() -> Iterator[None]:
    """Show what the package logs on the standard streams."""
    handler, before = _Streams(), (LOG.level, LOG.propagate)
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
    LOG.propagate = False
    try:
        yield
    finally:
        LOG.removeHandler(handler)
        LOG.level, LOG.propagate = before


def set_level(*, quiet: bool, verbose: bool) -> None:
    """Show warnings and errors only, or details too."""
    LOG.setLevel(logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO)


def ranks() -> Communicator:
    """Ranks of MPI that share the gas, of which the first one speaks; of size 1 without a launcher of MPI."""
    comm = world()
    if not comm.is_root:
        LOG.setLevel(logging.ERROR)
    if comm.size > 1:
        from ..simulation import backend

        backend.show_gpu(comm.local_rank)
    return comm


class Help:
    """Layout of `--help`: plain text in two columns, the same on a terminal and in a pipe."""

    def render_usage(self, console: Any, options: Any, usage: Any) -> None:
        """Print the line of usage."""
        print(f"Usage: {_plain(usage).removeprefix('Usage: ')}\n")

    def render_description(self, console: Any, options: Any, description: Any) -> None:
        """Print paragraphs; lines that are indented stay as they are."""
        print(f"{_filled(_plain(description), _width(console))}\n")

    def __call__(self, console: Any, options: Any, panel: HelpPanel) -> None:
        """Print a group of commands or options."""
        rows = [(", ".join(entry.display_labels_with_metavar), entry) for entry in panel.entries]
        if not rows:
            return
        column = min(max(len(label) for label, _ in rows), 30) + 4
        print(f"{_plain(panel.title)}:")
        for label, entry in rows:
            text = " ".join(_plain(entry.description).split()) + (" [needed]" if entry.required else "")
            lines = textwrap.wrap(text, _width(console) - column) or [""]
            if len(label) + 4 > column:
                print(f"  {label}")
                label = ""
            print(f"  {label:<{column - 2}}{lines[0]}".rstrip())
            for line in lines[1:]:
                print(f"{'':{column}}{line}")
        print()


def _width(console: Any) -> int:
    return min(console.width, WIDTH) if console.is_terminal else WIDTH


def _plain(text: Any) -> str:
    """Text of what cyclopts hands over: a string, or a text of rich, or one that wraps it."""
    text = getattr(text, "primary_renderable", text)
    return str(getattr(text, "plain", "" if text is None else text)).strip("\n")


def _filled(text: str, width: int) -> str:
    parts = text.split("\n\n")
    return "\n\n".join(part if part.startswith(" ") else textwrap.fill(part, width) for part in parts)
