"""Commands between an experiment and a run: `collisions` and `compare`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import nearest
from ..tools.files import write_text
from .console import note, say
from .fit import TableOptions, _check_files, _positive, _split, disk_of, form_of
from .options import File, Force, Output, Wrong, counted, number, option, whole

if TYPE_CHECKING:
    from ..fit.data import Disk

FORMAT = """\
TRACKS is a CSV file with a line for each disk in each frame: id, x, y, and t or frame (with --fps); angle
where disks are
seen to turn. Units stand in brackets, as in x (mm) or angle (rad); angles are in degrees unless told.

  ifrdem collisions tracks.csv --fps 120 --disk 1.19e-3,10.5e-3,2 -o hits.csv
  ifrdem fit hits.csv
"""


def collisions(
    tracks: Annotated[str, Parameter(name="TRACKS", help="a CSV file of places per frame, see above")],
    /,
    *,
    disk: Annotated[
        list[str] | None,
        option("[ID=]MASS,RADIUS,K", "all disks, or the one with this id; K is 2 unless told; repeatable"),
    ] = None,
    fps: Annotated[str | None, option("N", "frames per second, with a column frame")] = None,
    wall: Annotated[
        str | None,
        option("X1,Y1,X2,Y2", "impacts with the straight wall through two points, instead of pairs"),
    ] = None,
    window: Annotated[
        str | None, option("N", "frames of a flight that are used at most (default: 12)")
    ] = None,
    noise: Annotated[
        str | None,
        option("S", "standard error of a coordinate [m] (default: by the scatter about the flights)"),
    ] = None,
    table: TableOptions = TableOptions(),  # noqa: B008  (frozen)
    output: Output = None,
    force: Force = False,
) -> int:
    """Find collisions in tracked places.

    Finds the impacts, fits the flights before and after each, and writes the table of whole collisions that
    `ifrdem fit` takes,
    with errors and their correlations.
    """
    wrong = Wrong()
    form = form_of(table, wrong)
    rate = wrong.take(None, _positive, "--fps", fps)
    frames = wrong.take(12, whole, "--window", window, 3, 10_000)
    error = wrong.take(None, _positive, "--noise", noise)
    disks = _disks(disk, wrong)
    line = None
    if wall is not None:
        parts = wall.split(",")
        if len(parts) != 4:
            wrong.append(f"--wall {wall}: X1,Y1,X2,Y2 is needed")
        else:
            values = [
                wrong.take(0.0, number, f"--wall {wall}:", each, "a finite number", math.isfinite)
                for each in parts
            ]
            line = (values[0], values[1], values[2], values[3])
    source = Path(tracks)
    place = Path(output) if output is not None else source.with_name(f"{source.stem}_collisions.csv")
    _check_files([place], source, force, wrong)
    wrong.end()

    from ..fit import tracks as of_tracks

    seen = of_tracks.read(source, fps=rate, form=form)
    found = of_tracks.find(seen, disks, wall=line, window=frames, noise=error)
    about = [
        f"{len(found)} collisions in {source.name}, found by `ifrdem collisions`; SI units, angles and spins in rad"
    ]
    shown = [
        f"{source}: {len(seen.time)} disks, {sum(map(len, seen.time.values()))} places; {len(found)} collisions",
        f"standard error of a coordinate {found.noise:.3g}"
        + (f", of an angle {found.angle_noise:.3g} rad" if math.isfinite(found.angle_noise) else ""),
    ]
    if seen.missing:
        shown.append(f"{seen.missing} lines without a place are left out")
    if found.bent:
        shown.append(
            f"{found.bent} collisions have flights that are not straight within the noise: a smaller --window helps"
        )
    shown += [f"left out: {each}" for each in found.left_out[:20]]
    if len(found.left_out) > 20:
        shown.append(f"and {len(found.left_out) - 20} more")
    say("\n".join(shown))
    write_text(place, found.csv("\n".join(about)))
    note(f"\nwrote {place}: `ifrdem fit {place}` fits it")
    return 0


def _disks(texts: list[str] | None, wrong: Wrong) -> Disk | dict[int, Disk]:
    """All disks, or a mapping by id."""
    found: dict[int, Disk] = {}
    every: Disk | None = None
    for text in texts or ():
        name, equals, rest = text.rpartition("=")
        made = disk_of(f"--disk {text}", rest, wrong, ", with ID= before it for one disk,")
        if not equals:
            every = made
        else:
            found[wrong.take(0, whole, f"--disk {text}: id", name.strip(), 0, 2**31)] = made
    if every is not None and found:
        wrong.append("--disk: either all disks at once, or each by its id")
    if every is None and not found and not wrong:
        wrong.append(
            "--disk is missing: mass, radius and k of the disks are needed, such as --disk 1.19e-3,10.5e-3,2"
        )
    return every if every is not None else found


COMPARE = """\
MEASURED is a CSV file with a line for each place: id (the disk's number in the run, from 0, as in its start
file), x, y;
t for a time other than the end; angle for how far a disk has turned; x_error and so on.

  ifrdem compare table.h5 rest.csv --error positions=2e-4 --picture table_compared
  ifrdem compare table.h5 rest.csv --draws draws.csv --members 50 --start-error positions=2e-4
"""


def compare(
    file: File,
    measured: Annotated[str, Parameter(name="MEASURED", help="a CSV file of measured places, see above")],
    /,
    *,
    error: Annotated[
        list[str] | None,
        option(
            "NAME=E",
            "standard error of measured positions [m] or angles [degrees] without a column; repeatable",
        ),
    ] = None,
    case: Annotated[
        str | None,
        option(
            "CASE",
            "case file of the run, whose start file has columns of errors (default: the case that FILE holds)",
        ),
    ] = None,
    members: Annotated[
        str | None, option("N", "runs with drawn start and law, 4 or more (default: 0)")
    ] = None,
    draws: Annotated[str | None, option("FILE", "coefficients that `ifrdem fit --draw` wrote")] = None,
    start_error: Annotated[
        list[str] | None,
        option(
            "NAME=E",
            "standard error of the start's positions [m], velocities [m/s], spins [rad/s], where its "
            "file has no columns "
            "such as x_error; repeatable",
        ),
    ] = None,
    seed: Annotated[str | None, option("N", "seed of the drawn starts (default: 1)")] = None,
    table: TableOptions = TableOptions(),  # noqa: B008  (frozen)
    picture: Annotated[
        str | None, option("NAME", "NAME.png and NAME.pdf: the run, measured places on top")
    ] = None,
    output: Output = None,
    force: Force = False,
) -> int:
    """Compare a run with measured places.

    Gives positions, angles and rest places of a run beside the measured ones, with the spread that the errors
    of the start
    and of the fitted law give.
    """
    wrong = Wrong()
    form = form_of(table, wrong)
    given = _named(error, "--error", ("positions", "angles"), wrong)
    starts = _named(start_error, "--start-error", ("positions", "velocities", "spins"), wrong)
    runs = wrong.take(0, whole, "--members", members, 4, 100_000)
    first = wrong.take(1, whole, "--seed", seed, 0, 2**63 - 1)
    for name, value in (
        ("--draws", draws),
        ("--start-error", start_error),
        ("--seed", seed),
        ("--case", case),
    ):
        if value is not None and not runs:
            wrong.append(f"{name}: only beside --members")
    stem = None if picture is None else picture.removesuffix(".png").removesuffix(".pdf")
    pictures = [] if stem is None else [Path(f"{stem}.png"), Path(f"{stem}.pdf")]
    places = [] if output is None else [Path(output)]
    _check_files([*pictures, *places], Path(measured), force, wrong)
    wrong.end()

    from ..case import shipped
    from ..run import compare as of_runs

    seen = of_runs.read(measured, given, form)
    laws = [] if draws is None else of_runs.read_draws(draws)
    found = of_runs.compare(
        file,
        seen,
        laws=laws,
        errors=starts,
        members=runs,
        seed=first,
        case=None if case is None else shipped.find(case),
        progress=counted("runs"),
    )
    say(found.table())
    if pictures:
        found.draw(pictures)
    for place in places:
        write_text(place, found.csv())
    if written := [*places, *pictures]:
        note(f"\nwrote {', '.join(map(str, written))}")
    return 0


def _named(texts: list[str] | None, option: str, names: tuple[str, ...], wrong: Wrong) -> dict[str, float]:
    """Errors by name."""
    found = {}
    for name, value in _split(option, texts, wrong).items():
        if name not in names:
            wrong.append(f"{option} {name}: must be one of {', '.join(names)}{nearest(name, names)}")
        else:
            found[name] = wrong.take(
                0.0,
                number,
                f"{option} {name} =",
                value,
                "a number of 0 or more",
                lambda each: 0.0 <= each < math.inf,
            )
    return found
