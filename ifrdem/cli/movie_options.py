"""The verb `ifrdem movie`."""

from __future__ import annotations

import argparse
from typing import Any

LEAST, MOST = 160, 7680  # pixels


def add_to(verbs: Any) -> None:
    """Add the verb."""
    from .export import add_frames

    parser = verbs.add_parser(
        "movie",
        help="make a movie of a trajectory",
        description="Write NAME.mp4: the disks of each frame, coloured by spin or temperature; of more than 1e5 disks "
        'a map of the area fraction. Needs the extra: pip install "ifrdem[movie]".',
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a trajectory (.h5)")
    add_frames(parser)
    parser.add_argument("--fps", metavar="N", default="25", help="pictures a second (default: 25)")
    parser.add_argument(
        "--size", metavar="WxH", default="1200x1080", help="pixels, even numbers (default: 1200x1080)"
    )
    parser.add_argument("--colour", metavar="BY", default="spin", help="spin or temperature (default: spin)")
    parser.add_argument("-o", "--output", metavar="OUT", help="file to write (default: NAME.mp4 beside FILE)")
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    parser.set_defaults(act=act)


def act(options: argparse.Namespace) -> int:
    """Do it."""
    from ..errors import InputError, nearest
    from ..plots import movie
    from ..tools.arguments import whole
    from ..trajectory.reader import Trajectory
    from . import frame_numbers
    from .export import place

    fps = whole("--fps", options.fps, 1, 240)
    size = _size(options.size)
    if options.colour not in movie.COLOURS:
        allowed = ", ".join(movie.COLOURS)
        raise InputError(
            f"--colour {options.colour}: allowed are {allowed}{nearest(options.colour, movie.COLOURS)}"
        )
    with Trajectory(options.file) as trajectory:
        frames = frame_numbers.chosen(options.frames, len(trajectory))
        out = place(options, ".mp4")
        movie.write(
            trajectory,
            out,
            frames,
            fps=fps,
            size=size,
            colour=options.colour,
            progress=frame_numbers.counted("movie"),
        )
    print(f"wrote {out}: {len(frames)} pictures, {len(frames) / fps:.3g} s", flush=True)
    return 0


def _size(text: str) -> tuple[int, int]:
    from ..errors import InputError

    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        width = height = 0
    if not all(LEAST <= side <= MOST and side % 2 == 0 for side in (width, height)):
        raise InputError(
            f"--size {text}: width x height in pixels are needed, even numbers from {LEAST} to {MOST}, such as 1280x720"
        )
    return width, height
