"""Lines for people on the standard streams, and exit statuses."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from .. import mpi
from ..errors import printable

if TYPE_CHECKING:
    from ..mpi import Communicator

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130  # what shells use for SIGINT
UNFINISHED = 3

LOG = logging.getLogger("ifrdem")


def echo(message: str, end: str = "\n") -> None:
    """Print a result: it may quote files, in which anything can stand that terminals obey."""
    print(printable(message), end=end, flush=True)


def note(message: str) -> None:
    """Print a line on a finished step; not with `--quiet`."""
    LOG.info(message)


def progress(message: str) -> None:
    """Print a line on the present step to the standard error stream; not with `--quiet`."""
    LOG.info(message, extra={"progress": True})


def warn(message: str) -> None:
    """Print a warning to the standard error stream."""
    LOG.warning(message)


def complain(message: str) -> None:
    """Print an error to the standard error stream."""
    LOG.error(message)


class _Streams(logging.Handler):
    """Notes on the standard output; progress, details, warnings and errors on the standard error stream."""

    def emit(self, record: logging.LogRecord) -> None:
        message = record.getMessage()
        if record.levelno == logging.INFO and not hasattr(record, "progress"):
            echo(message)
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
    comm = mpi.communicator.world()
    if not comm.is_root:
        LOG.setLevel(logging.ERROR)
    if comm.size > 1:
        from ..simulation import backend

        backend.show_gpu(comm.local_rank)
    return comm
