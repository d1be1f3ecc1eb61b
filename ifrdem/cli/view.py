"""The command `view`."""

from __future__ import annotations

import contextlib
import webbrowser
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from .console import note, say
from .options import Force, Frames, chosen, counted, flag, one_trajectory, opened, option, place, whole


def view(
    file: Annotated[
        str,
        Parameter(
            name="FILE",
            help="a trajectory (.h5), or the folder that it is in; with --study, NAME.nc or NAME.runs",
        ),
    ],
    /,
    *,
    study: Annotated[
        bool, flag("show the points of a study, and the disks of runs whose trajectories it kept")
    ] = False,
    html: Annotated[
        str | None, option("OUT", "write the page with the frames inside into a file, to send")
    ] = None,
    frames: Frames = None,
    port: Annotated[str, option("N", "port of this machine (default: any free one)")] = "0",
    no_browser: Annotated[bool, flag("print the address only")] = False,
    force: Force = False,
) -> None:
    """Look at a trajectory in a browser: play, zoom, colours, a disk's collisions, energies.

    Opens a page of this machine, which nobody reaches without the token in its address, and serves it until Ctrl-C. A
    run that is still going is followed. --html writes one file instead, which needs no server; --frames says which
    frames it holds.
    """
    number = whole("--port", port, 0, 65535)
    if html is None and (frames is not None or force):
        raise InputError(f"{'--frames' if frames is not None else '--force'}: only with --html")
    if study and html is not None:
        raise InputError("--html: not beside --study; write the page of one of its trajectories")
    if html is not None:
        from ..viewer import page

        with opened(one_trajectory(file)) as trajectory:
            numbers = chosen(frames, len(trajectory))
            out = place(file, html, ".html", force=force, option="--html with another name")
            page.write(trajectory, out, numbers, progress=counted("view"))
        note(f"wrote {out}: {len(numbers)} frame{'' if len(numbers) == 1 else 's'}")
        return
    from ..viewer.content import Content
    from ..viewer.server import Server

    if study:
        from ..viewer.points import StudyPoints

        shown: Content | StudyPoints = StudyPoints(Path(file))
    else:
        shown = Content(opened(one_trajectory(file)))
    try:
        server = Server(shown, number)
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror}; without --port, any free one is taken") from error
    with server, contextlib.suppress(KeyboardInterrupt):
        note("the page is served until Ctrl-C, at")
        say(server.address)
        if not no_browser and not webbrowser.open(server.address):
            note("no browser was found: open the address in one of this machine")
        server.serve_forever()
