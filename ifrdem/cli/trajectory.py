"""Commands about trajectories: `info`, `view`, `link`, `export`, `movie`, `repair`, `history`."""

from __future__ import annotations

import contextlib
import os
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from cyclopts import Parameter

from ..errors import InputError
from ..tools.values import Integer
from ..trajectory.formats import FORMATS, TABLES, Format
from .console import echo, note
from .options import (
    Color,
    File,
    Force,
    Frames,
    From,
    Output,
    Style,
    counted,
    flag,
    invalid_value,
    one_trajectory,
    opened,
    option,
    output_path,
    selected_frames,
    styled,
)

if TYPE_CHECKING:
    from cyclopts import Token

SHOWN = 10
"""Collisions of a history that are printed."""
LEAST, MOST = 160, 7680
"""Width and height of a movie, in pixels."""


def info(
    file: Annotated[
        str,
        Parameter(
            name="FILE",
            help="a trajectory (.h5), or the folder that it is in, or the results of a study (.nc)",
        ),
    ],
    /,
    *what: Annotated[
        str, Parameter(name="WHAT", help="of a study: only these quantities, such as T or stress")
    ],
    start: From = None,
    csv: Annotated[bool, flag("of a study: the table alone, with every digit, separated by commas")] = False,
) -> None:
    """Describe the content of a trajectory, or of a study with its numbers.

    Of a study (NAME.nc): a table of means over seeds with standard errors, a line for each point and quantity. Series
    are means over the steady window of each run, or `--from` a place on; of gases that cool they have their value at the
    end of the runs.
    """
    if file.endswith(".nc"):
        from ..study.contents import describe as describe_study

        echo(describe_study(file, start, what=what, csv=csv))
        return
    if start is not None:
        raise InputError(
            "--from: of the results of a study (.nc); `ifrdem analyse --from` averages a trajectory"
        )
    if what or csv:
        raise InputError(f"{'--csv' if csv else what[0]}: of the results of a study (.nc)")
    from ..runs.info import describe

    echo(describe(one_trajectory(file)))


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
        str | None, option(str, "OUT", "write the page with the frames inside into a file, to send")
    ] = None,
    frames: Frames = None,
    port: Annotated[
        int, option(Annotated[int, Integer(0, 65535)], "N", "port of this machine (default: any free one)")
    ] = 0,
    no_browser: Annotated[bool, flag("print the address only")] = False,
    force: Force = False,
) -> None:
    """Look at a trajectory in a browser: play, zoom, colours, a disk's collisions, energies.

    Opens a page of this machine, which is reached only with the token in its address, and serves it until Ctrl-C. A
    run that is still going is followed. --html writes one file instead, which needs no server; --frames says which
    frames it holds.
    """
    if html is None and (frames is not None or force):
        raise InputError(f"{'--frames' if frames is not None else '--force'} requires --html")
    if study and html is not None:
        raise InputError("--html: cannot be combined with --study; write the page of one of its trajectories")
    if html is not None:
        from ..viewer import page

        with opened(one_trajectory(file)) as trajectory:
            numbers = selected_frames(frames, len(trajectory))
            out = output_path(file, html, ".html", force=force, option="--html with another name")
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
        server = Server(shown, port)
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror}; without --port, any free one is taken") from error
    with server, contextlib.suppress(KeyboardInterrupt), contextlib.ExitStack() as stack:
        note("the page is served until Ctrl-C, at")
        echo(server.address)
        # Every user of this machine sees the arguments of a browser, and with them what is in an address.
        if not no_browser and not webbrowser.open(stack.enter_context(server.redirecting_file()).as_uri()):
            note("no browser was found: open the address in one of this machine")
        server.serve_forever()


def link(file: File, /) -> None:
    """Let ParaView, OVITO, xarray and ASE open a trajectory.

    Writes NAME.vtkhdf (ParaView, PyVista, VTK) and NAME.nc (OVITO, xarray, ASE) next to NAME.h5. They point at its data
    and copy none: keep the three files together, and write them again when the run has added frames. Existing views
    are replaced.
    """
    from ..trajectory.views import write_views

    for path in write_views(file):
        note(f"wrote {path}")


What = Literal["frames", "collisions"]


def export(
    file: Annotated[
        str,
        Parameter(
            name="FILE",
            help="a trajectory (.h5), or the folder that it is in, or the results of a study (.nc)",
        ),
    ],
    /,
    *,
    to: Annotated[
        Format,
        option(Format, "FORMAT", ", ".join(get_args(Format))),
    ],
    what: Annotated[
        What,
        option(What, "WHAT", f"frames, or collisions of tracked disks ({', '.join(TABLES)})"),
    ] = "frames",
    frames: Frames = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Copy a trajectory into another format, or collisions or a study into a table.

    Copies frames into a file of another format: gsd (HOOMD, OVITO, freud; single precision, origin in the middle of
    the box), extxyz (ASE, OVITO), csv (a line for each disk and frame) or h5 (a trajectory in one file, such as of one
    in parts; it needs -o). --what collisions writes a line for each collision of the tracked disks. Of a study
    (NAME.nc), csv and parquet have a line for each run, with its keys, its seed and its numbers. To open a trajectory in ParaView,
    OVITO, xarray or ASE without a copy, see `ifrdem link`.
    """
    from ..trajectory import export as exporting

    if file.endswith(".nc"):
        if what != "frames" or frames is not None:
            raise InputError(f"{'--frames' if frames is not None else '--what'}: of a trajectory only")
        _export_study(file, to, output, force=force)
        return
    file = one_trajectory(file)
    if what == "frames" and to not in FORMATS:
        raise InputError(f"--to {to} requires --what collisions, or the results of a study (.nc)")
    if what == "collisions" and (to not in TABLES or frames is not None):
        option_given = "--frames" if frames is not None else f"--to {to}"
        raise InputError(
            f"{option_given}: cannot be combined with --what collisions, a table ({', '.join(TABLES)})"
        )
    with opened(file) as trajectory:
        if what == "collisions":
            out = output_path(file, output, f"-collisions.{to}", force=force)
            count = exporting.export_collisions(trajectory, out, to)
            note(f"wrote {out}: {count} collision{'' if count == 1 else 's'}")
            return
        numbers = selected_frames(frames, len(trajectory))
        out = output_path(file, output, f".{to}", force=force)
        exporting.export(trajectory, out, to, numbers, progress=counted("export"))
    note(f"wrote {out}: {len(numbers)} frame{'' if len(numbers) == 1 else 's'}")


def _export_study(file: str, to: str, output: str | None, *, force: bool) -> None:
    """Write a line for each run of a study."""
    from ..study.contents import runs
    from ..study.results import Results
    from ..tools.files import check_files
    from ..trajectory.export import write_table

    if to not in TABLES:
        raise InputError(f"--to {to}: the results of a study are exported to {', '.join(TABLES)}")
    out = Path(output or f"{file.removesuffix('.nc')}.{to}")
    check_files([out], force=force, elsewhere="-o writes elsewhere")
    table = runs(Results.read(file))
    write_table(out, table, to)
    count = len(next(iter(table.values())))
    note(f"wrote {out}: {count} run{'' if count == 1 else 's'}")


def _pixels(_kind: object, tokens: Sequence[Token]) -> tuple[int, int]:
    try:
        width, height = (int(part) for part in tokens[-1].value.lower().split("x"))
    except ValueError:
        width = height = 0
    if not all(LEAST <= side <= MOST and side % 2 == 0 for side in (width, height)):
        text = f"must be width x height in pixels, even numbers from {LEAST} to {MOST}, such as 1280x720"
        raise invalid_value(tokens, text)
    return width, height


def movie(
    file: File,
    /,
    *,
    frames: Frames = None,
    fps: Annotated[int, option(Annotated[int, Integer(1, 240)], "N", "frames per second (default: 25)")] = 25,
    size: Annotated[
        tuple[int, int] | None,
        option(
            str,
            "WxH",
            "pixels, even numbers (default: as the box is, 1200x1080 at most)",
            converter=_pixels,
            n_tokens=1,
        ),
    ] = None,
    color: Color = None,
    style: Style = None,
    quality: Annotated[
        int, option(Annotated[int, Integer(1, 100)], "Q", "of a WebP file, 1 to 100 (default: 70)")
    ] = 70,
    output: Output = None,
    force: Force = False,
) -> None:
    """Make a movie of a trajectory.

    Writes NAME.mp4: the disks of each frame, coloured by spin or something else; of more than 1e5 disks a map of the
    area fraction. Needs the extra: pip install 'ifrdem[movie]'. Without it, -o NAME.webp and -o NAME.gif write
    animations for web pages.
    """
    from ..plots import movie as making

    with opened(file) as trajectory, styled(style):
        numbers = selected_frames(frames, len(trajectory))
        out = output_path(file, output, ".mp4", force=force)
        bytes_there = making.write(
            trajectory, out, numbers, fps=fps, size=size, color=color or "spin", quality=quality,
            progress=counted("movie"),
        )  # fmt: skip
    note(f"wrote {out}: {len(numbers)} pictures, {len(numbers) / fps:.3g} s, {bytes_there / 1e6:.2g} MB")


def repair(
    file: File,
    /,
    *,
    output: Annotated[
        str | None, option(str, "OUT", "file to write (default: NAME.repaired.h5)", "--output", "-o")
    ] = None,
    in_place: Annotated[bool, flag("replace FILE by what is whole of it")] = False,
    force: Annotated[bool, flag("replace OUT if it exists")] = False,
) -> None:
    """Make a valid trajectory of a damaged one.

    Says what is wrong with a trajectory, and writes what is whole of it to NAME.repaired.h5: frames that can be read,
    series and histories up to their first damaged part. Uncommitted ends are cut off. Views that are missing or stale
    are written again. Damage of compressed data is detected; that of uncompressed data is not.
    """
    from ..trajectory import repair as repairing
    from ..trajectory.views import stale, write_views

    given = Path(file)
    if in_place and (output is not None or force):
        raise InputError("--in-place: cannot be combined with -o or --force, which write another file")
    if not given.exists():
        raise InputError(f"{given}: there is no such file")
    if in_place:
        if given.is_symlink():  # which stays one: what it points to is replaced
            given = Path(os.path.realpath(given))
        out = given
    else:
        out = output_path(file, output, ".repaired.h5", force=force)
    echo(f"{given}:")
    wrote = repairing.repair(given, out, log=echo)
    if wrote:
        note(f"wrote {out}")
    else:
        echo("  nothing is wrong")
    sound = out if wrote else given
    if stale(sound):
        try:
            made = write_views(sound)
        except InputError as error:  # such as one without positions, which has nothing to show
            echo(f"  no views: {error}")
        else:
            note(f"wrote {', '.join(map(str, made))}")


def history(
    file: File,
    /,
    *,
    id: Annotated[int, option(Annotated[int, Integer(0)], "ID", "id of the disk, from 0")],
    output: Annotated[
        str | None, option(str, "CSV", "file to write: a line for each event, every digit", "--output", "-o")
    ] = None,
    force: Force = False,
) -> None:
    """Show the collisions of a tracked disk.

    The history of a disk of a run with output.histories: its collisions with times, partners, places, velocities,
    spins, impulses, angles and regimes. Prints a summary and the latest ten, and writes all with -o.
    """
    from ..trajectory.export import write_history

    with opened(file) as trajectory:
        found = trajectory.history(id)
        out = None if output is None else output_path(file, output, ".csv", force=force)
        for line in summary(trajectory, found):
            echo(line)
    if out is not None:
        write_history(found, out)
        note(f"wrote {out}: {len(found)} events")


def summary(trajectory: Any, history: Any) -> list[str]:
    """Lines on the history of a disk."""
    import numpy as np

    from ..model.laws.ifr import regime_name
    from ..trajectory.history import KICK

    def time(value: float) -> str:
        return str(trajectory.with_unit(f"{value:.6g}", "time"))

    kicks = len(history) - history.collisions
    walls = int((history.partner < KICK).sum())
    first = f"disk {history.disk}: {history.collisions} collisions from t = {history.start:.6g} to {time(history.end)}"
    first += f", {walls} of them with walls" if walls else ""
    lines = [first + (f"; {kicks} kicks by forces" if kicks else "")]
    if history.collisions > 1:
        lines.append(f"  mean free time {time(history.mean_free_time)}")
    # Kicks would fill the list of a driven disk.
    shown = np.flatnonzero(history.partner != KICK)[-SHOWN:]
    if len(shown):
        if len(shown) < history.collisions:
            lines.append(f"  the latest {len(shown)} (-o writes all; psi in rad):")
        rows = [("time", "partner", "regime", "psi", "P_n", "P_t", "spin after")]
        units = trajectory.units
        if "time" in units:
            momentum, angle = (f"({units[one]})" if one in units else "" for one in ("momentum", "angle"))
            spin = f"({units.get('angle', 'rad')}/{units['time']})"
            rows.append((f"({units['time']})", "", "", angle, momentum, momentum, spin))
        form = "  {:>14} {:>8} {:<20} {:>7} {:>11} {:>11} {:>12}"
        lines += [form.format(*row) for row in rows]
    for i in shown:
        partner = int(history.partner[i])
        label = str(partner) if partner >= 0 else f"wall {-2 - partner}"
        impulse = history.impulse[i]
        lines.append(
            f"  {history.time[i]:>14.8g} {label:>8} {regime_name(int(history.regime[i])):<20} {history.psi[i]:>7.4f} "
            f"{impulse[0]:>11.4g} {impulse[1]:>11.4g} {history.columns['spin_after'][i]:>12.5g}"
        )
    return lines
