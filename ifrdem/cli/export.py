"""The verb `ifrdem export`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_to(verbs: Any) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "export",
        help="copy a trajectory into another format",
        description="Copy frames of a trajectory into a file of another format: gsd (HOOMD, OVITO, freud; single "
        "precision, origin in the middle of the box), extxyz (ASE, OVITO) or csv (a line a disk and frame). To open it "
        "in ParaView, OVITO, xarray or ASE without a copy, see `ifrdem views`.",
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a trajectory (.h5)")
    parser.add_argument("--to", metavar="FORMAT", required=True, help="gsd, extxyz or csv")
    add_frames(parser)
    parser.add_argument(
        "-o", "--output", metavar="OUT", help="file to write (default: FILE with the format's ending)"
    )
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    parser.set_defaults(act=act)


def add_frames(parser: argparse.ArgumentParser) -> None:
    """Add the option --frames."""
    parser.add_argument(
        "--frames",
        metavar="A:B:C",
        help="which frames: one number, or from A to before B, every C-th, as in Python (default: all; "
        "write --frames=-5: for the last five)",
    )


def place(options: argparse.Namespace, ending: str) -> Path:
    """The file to write, checked; its default lies beside the trajectory."""
    from ..errors import InputError
    from ..tools.files import check_apart, check_files

    given = Path(options.file)
    if options.output is not None and not options.output.strip():
        raise InputError("-o: an empty text is no file")
    found = given.with_name(given.name.removesuffix(".h5") + ending)
    if options.output is not None:
        found = Path(options.output)
    if given.exists():
        check_apart(found, given)
    check_files([found], force=options.force)
    return found


def act(options: argparse.Namespace) -> int:
    """Do it."""
    from ..errors import InputError, nearest
    from ..trajectory import export
    from ..trajectory.reader import Trajectory
    from . import frame_numbers

    if options.to not in export.FORMATS:
        allowed = ", ".join(export.FORMATS)
        raise InputError(f"--to {options.to}: allowed are {allowed}{nearest(options.to, export.FORMATS)}")
    with Trajectory(options.file) as trajectory:
        frames = frame_numbers.chosen(options.frames, len(trajectory))
        out = place(options, f".{options.to}")
        export.export(
            trajectory,
            out,
            options.to,
            frames,
            progress=frame_numbers.counted("export"),
        )
    print(f"wrote {out}: {len(frames)} frame{'' if len(frames) == 1 else 's'}", flush=True)
    return 0
