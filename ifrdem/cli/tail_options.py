"""The verb `ifrdem tail`: how far a run is, from the status file beside its trajectory."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ..errors import InputError

DESCRIPTION = """\
Follow a run from another terminal: a line at each news until it ends. The run may be anybody's who can
write to the same disk; nothing is locked. A run that died is told as such.
"""


def add_to(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ifrdem tail`."""
    parser.description = DESCRIPTION
    parser.add_argument(
        "path", metavar="PATH", help="the trajectory (NAME.h5), NAME.status.json, or a folder: its newest run"
    )
    parser.add_argument("--once", action="store_true", help="print one line and end")
    parser.add_argument("--interval", metavar="S", default="1", help="seconds between two looks (default: 1)")


def run(given: argparse.Namespace, *, say: Callable[[str], object]) -> bool:
    """Do what `ifrdem tail` was asked for; False if the run did not end well.

    Raises
    ------
    InputError
        If an option is wrong, or there is no status file.
    """
    try:
        interval = float(given.interval)
    except ValueError:
        interval = 0.0
    if not 0.01 <= interval <= 3600.0:
        raise InputError(f"--interval {given.interval}: 0.01 to 3600 seconds are needed")
    from ..run.status import RUNNING, tail

    return tail(given.path, say, follow=not given.once, interval=interval) in (RUNNING, "done")
