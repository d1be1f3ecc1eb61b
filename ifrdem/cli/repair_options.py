"""The verb `ifrdem repair`."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any


def add_to(verbs: Any) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "repair",
        help="make a trajectory that opens out of a damaged one",
        description="Say what is wrong with a trajectory, and write what is whole of it to NAME.repaired.h5: frames "
        "that can be read, series and histories up to their first damaged part. Uncommitted ends are cut off. Views "
        "that are missing or stale are written again. Compressed data tell when they are damaged; uncompressed ones "
        "do not.",
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a trajectory (.h5)")
    parser.add_argument("-o", "--output", metavar="OUT", help="file to write (default: NAME.repaired.h5)")
    parser.add_argument("--in-place", action="store_true", help="replace FILE by what is whole of it")
    parser.add_argument("--force", action="store_true", help="replace OUT if it exists")
    parser.set_defaults(act=act)


def act(options: argparse.Namespace) -> int:
    """Do it."""
    from ..errors import InputError
    from ..trajectory import repair, views
    from . import export

    given = Path(options.file)
    if options.in_place and (options.output is not None or options.force):
        raise InputError("--in-place: not beside -o or --force, which write another file")
    if not given.exists():
        raise InputError(f"{given}: there is no such file")
    if options.in_place:  # a link stays one: what it points to is replaced
        given = place = Path(os.path.realpath(given))
    else:
        place = export.place(options, ".repaired.h5")
    print(f"{given}:", flush=True)
    wrote = repair.repair(given, place, say=lambda line: print(line, flush=True))
    if wrote:
        print(f"wrote {place}", flush=True)
    else:
        print("  nothing is wrong", flush=True)
    whole = place if wrote else given
    if repair.stale_views(whole):
        try:
            made = views.write_views(whole)
        except InputError as error:  # such as one without positions, which has nothing to show
            print(f"  no views: {error}", flush=True)
        else:
            print(f"wrote {', '.join(map(str, made))}", flush=True)
    return 0
