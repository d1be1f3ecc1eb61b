"""Options that several commands have, and the values of options from their texts."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TextIO, TypeVar

from cyclopts import Parameter

from ..analysis import options
from ..analysis.options import frames_of
from ..errors import InputError, cut, nearest
from ..plots.names import Ends
from ..tools.values import Count, Integer, Keyed, Natural, NonNegative, Positive, Ratio, check_in, whole_of
from . import console

if TYPE_CHECKING:
    from cyclopts import Token

    from ..trajectory.reader import Trajectory

T = TypeVar("T")


def option(kind: Any, metavar: str, text: str, *names: str, **more: Any) -> Parameter:
    """An option that takes a value: its type, its word in `--help`, its help, its names where they differ.

    The type is one of `tools.values`, or a `Literal`, whose check reads the text; or `str` for any text.
    """
    described: dict[str, Any] = {"help": text} if text else {}  # else it is the docstring of a field
    if kind is not str and "converter" not in more:
        more["converter"] = lambda _kind, tokens: of_text(tokens[-1].keyword, tokens[-1].value, kind)
    return Parameter(name=names or None, metavar=metavar, **described, **more)


def of_text(option: str, text: str, kind: Any) -> Any:
    """The value of this type of a text, or of a part of it; InputError names the option and what it must be."""
    check = check_in(kind)
    assert isinstance(check, Keyed)
    try:
        return check.of_text(option, text)
    except InputError as error:
        raise InputError(f"{option} {text}: {error.reason}") from None


def invalid_value(tokens: Sequence[Token], text: str) -> InputError:
    """The error on a value of an option that is not allowed."""
    return InputError(f"{tokens[-1].keyword} {tokens[-1].value}: {text}")


MOST_STYLE = 1_000_000  # bytes of a file of a style


def flag(text: str, *names: str, **more: Any) -> Parameter:
    """An option without a value."""
    return Parameter(name=names or None, help=text, **more)


def one_trajectory(path: str) -> str:
    """A trajectory as the command line names it: itself, or the only one of a folder."""
    from ..runs.outputs import trajectory_in

    if path.endswith(".nc"):
        raise InputError(
            f"{path}: must be a trajectory, NAME.h5; `ifrdem plot {path} T` draws the results of a study"
        )
    return os.fspath(trajectory_in(Path(path)))


def _trajectory(kind: object, tokens: Sequence[Token]) -> str:
    return one_trajectory(tokens[0].value)


CASE = "a case file (TOML), or a shipped case (`ifrdem cases`); `ifrdem new cooling` writes one"
FILE = Parameter(
    name="FILE", help="a trajectory (.h5), or the folder that it is in", converter=_trajectory, n_tokens=1
)
Case = Annotated[str, Parameter(name="CASE", help=CASE)]
File = Annotated[str, FILE]
Set = Annotated[
    list[str] | None,
    option(
        str,
        "KEY=VALUE",
        "override a key of the case, such as run.seed=3 or species[0].number=100; repeatable. KEY= without a value "
        "removes the key",
        "--set",
    ),
]
Device = Annotated[
    Literal["cpu", "cuda"] | None,
    option(Literal["cpu", "cuda"], "DEVICE", "cpu or cuda (see `ifrdem devices`); sets run.device"),
]
Runtime = Annotated[
    Literal["taichi", "quadrants"] | None,
    option(
        Literal["taichi", "quadrants"],
        "RUNTIME",
        "taichi or quadrants: what compiles the kernels (see `ifrdem devices`)",
    ),
]
Seed = Annotated[int | None, option(Natural, "N", "seed of the random numbers; sets run.seed")]
Threads = Annotated[int | None, option(Count, "N", "CPU threads (default: all cores); sets run.threads")]
Precision = Annotated[
    Literal["f64", "f32"] | None, option(Literal["f64", "f32"], "P", "f64 or f32; sets run.precision")
]
MaxHours = Annotated[
    float | None,
    option(
        Ratio,
        "HOURS",
        f"stop after so many hours, with a checkpoint and exit status {console.UNFINISHED}; `ifrdem resume` continues",
    ),
]
NoPicture = Annotated[bool, flag("draw no picture at the end")]
Frames = Annotated[
    str | None,
    option(
        str,
        "FRAMES",
        "which frames, as in Python: one number; A to B, every C-th, as in 10:50:2; -5: for the last five "
        "(default: all that suit)",
    ),
]
From = Annotated[
    float | None,
    option(
        NonNegative,
        "PLACE",
        "where averages begin: a time, or collisions per disk if the run ends at these (default: in a gas that is "
        "driven, sheared or between walls where it is steady)",
        "--from",
    ),
]
Output = Annotated[
    str | None, option(str, "OUT", "file to write (default: FILE with another ending)", "--output", "-o")
]
Axis = Annotated[
    options.Axis | None,
    option(
        options.Axis,
        "AXIS",
        "of profiles: x, y or r (default: along gravity, or from wall to wall)",
    ),
]
Bins = Annotated[
    int | None,
    option(options.Bins, "N", "of profiles: number of bins (default: 8 to 40)"),
]


def _cells(_kind: object, tokens: Sequence[Token]) -> tuple[int, int]:
    if (found := options.cells_of(tokens[-1].value.split(","))) is None:
        raise invalid_value(tokens, f"{options.CELLS}, such as 20,80")
    return found


Cells = Annotated[
    tuple[int, int] | None,
    option(
        str,
        "A,B",
        "of fields: cells along x and y (default: some 20 disks each)",
        converter=_cells,
        n_tokens=1,
    ),
]
Windows = Annotated[
    int | None,
    option(options.Groups, "N", "of profiles: one for each of so many windows of time"),
]
Phases = Annotated[
    int | None,
    option(options.Groups, "N", "of profiles: one for each of so many phases of walls that move to and fro"),
]
Lag = Annotated[
    float | None,
    option(Positive, "TIME", "of transport: where integrals of correlations end (default: 5 decay times)"),
]
Average = Annotated[bool, flag("of fields: averages over the frames with errors, not a single frame")]
Style = Annotated[
    str | None,
    option(
        str,
        "STYLE",
        "paper (fonts of journals), poster (a snapshot without axes), dark_background or another style of Matplotlib, "
        "or a file of one",
    ),
]
Color = Annotated[
    str | None,
    option(
        str, "BY",
        "of disks: spin, speed, direction, temperature, radius, material, species, collisions, asleep, "
        "dissipated or none "
        "(default: spin)",
        "--color"
    ),
]  # fmt: skip
Force = Annotated[bool, flag("replace files that exist")]


def _inches(_kind: object, tokens: Sequence[Token]) -> tuple[float, ...]:
    """Width and height of a figure, from 3.4in, 8.6cm or 3.4x2.6in."""
    found = re.fullmatch(r"([\d.]+)(?:x([\d.]+))?(in|cm|mm)", tokens[-1].value.lower())
    try:
        sides = [float(each) / UNITS[found[3]] for each in found.groups()[:2] if each] if found else []
    except ValueError:  # 3.4.1
        sides = []
    if not sides or not all(1.0 <= side <= 40.0 for side in sides):
        text = "must be a width from 1 to 40 inches, such as 3.4in or 8.6cm, or width x height, such as 3.4x2.6in"
        raise invalid_value(tokens, text)
    return tuple(sides)


UNITS = {"in": 1.0, "cm": 2.54, "mm": 25.4}
"""Lengths in an inch."""
Size = Annotated[
    tuple[float, ...] | None,
    option(
        str,
        "SIZE",
        "of the figure: 3.4in, 8.6cm, 3.4x2.6in (default: for a screen)",
        converter=_inches,
        n_tokens=1,
    ),
]
Dpi = Annotated[
    int,
    option(Annotated[int, Integer(30, 2400)], "N", "resolution of a PNG in dots per inch (default: 200)"),
]


def _ends(_kind: object, tokens: Sequence[Token]) -> tuple[float | None, float | None]:
    """Ends of an axis, from "0,2"; an end that is left out stays."""
    parts = tokens[-1].value.split(",")
    try:
        found = [float(each) if each.strip() else None for each in parts]
    except ValueError:
        found = []
    known = [each for each in found if each is not None]
    if len(found) != 2 or not known or not all(map(math.isfinite, known)) or len({*known}) < len(known):
        raise invalid_value(
            tokens, "must be two different numbers, such as 0,2, of which one may be left out (0, or ,2)"
        )
    return found[0], found[1]


def _panels(_kind: object, tokens: Sequence[Token]) -> list[int]:
    found = [whole_of(each) for each in tokens[-1].value.split(",")]
    if any(each is None or each < 1 for each in found):
        raise invalid_value(tokens, "must be numbers of panels from 1, such as 1,3")
    return [each for each in found if each is not None]


def _axis_ends(which: str) -> Parameter:
    return option(
        str, "A,B", f"ends of the {which} axis; one may be left out: 0, or ,2", converter=_ends, n_tokens=1
    )


Xlim = Annotated[Ends, _axis_ends("horizontal")]
Ylim = Annotated[Ends, _axis_ends("vertical")]
Panels = Annotated[
    list[int] | None,
    option(
        str, "N,N", "draw only these panels, numbered from 1 in reading order", converter=_panels, n_tokens=1
    ),
]
TheoryName = Literal["closed", "dsmc"]
Theory = Annotated[
    TheoryName | None,
    option(
        TheoryName, "THEORY", "the theory that is drawn: closed (forms of Gaussian or Sonine velocities, the default), or "
        "dsmc, the collision law of the engine by direct simulation Monte Carlo",
    ),
]  # fmt: skip
NoTitle = Annotated[bool, flag("no title; warnings go to the terminal")]


@contextlib.contextmanager
def styled(style: str | None) -> Iterator[None]:
    """Draw in "paper", "poster" or a style of Matplotlib; InputError names near ones if there is none of this name."""
    with contextlib.ExitStack() as stack:
        if style in ("paper", "poster"):
            from matplotlib import rc_context

            from ..plots.style import PAPER, POSTER, is_poster

            stack.enter_context(rc_context(PAPER if style == "paper" else POSTER))
            token = is_poster.set(style == "poster")
            stack.callback(is_poster.reset, token)
        elif style is not None:
            import matplotlib.style

            from ..tools import text_file

            if style not in (
                "default",
                *matplotlib.style.library,
            ):  # Matplotlib would load from addresses of the web
                if not os.path.exists(style):
                    near = nearest(style, ["paper", "poster", *matplotlib.style.available])
                    text = f"neither a style of Matplotlib nor a file of one{near}"
                    raise InputError(f"--style {cut(style)}: {text}")
                try:
                    text_file.read(Path(style), most=MOST_STYLE)
                except InputError as error:
                    raise InputError(f"--style {style}: {error}") from None
                _refuse_strange(style)
            stack.enter_context(matplotlib.style.context(style))
        yield


def _refuse_strange(style: str) -> None:
    """Raise InputError for a file with a line that is no setting of Matplotlib, which only logs it, whole."""
    import matplotlib

    logged: list[str] = []
    logger, handler = logging.getLogger("matplotlib"), logging.Handler()
    handler.emit = lambda record: logged.append(record.getMessage())  # type: ignore[method-assign]
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        matplotlib.rc_params_from_file(style, use_default_template=False)
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate
    if logged:
        further = f" (and {len(logged) - 1} more)" if len(logged) > 1 else ""
        text = cut(" ".join(logged[0].split()), 200)
        raise InputError(
            f"--style {style}: {text}{further}; see `matplotlib.rcParams` for what a style may set"
        )


def overrides(given: list[str] | None, **run: str | int | None) -> list[str]:
    """Changes of a case by the command line, the options with a name of their own included."""
    return [
        *(given or ()),
        *(f"run.{key}={json.dumps(value)}" for key, value in run.items() if value is not None),
    ]


class OptionProblems(list[str]):
    """Messages on wrong options, reported all at once."""

    def parse(self, default: T, read: Callable[..., T], option: str, text: str | None, *more: object) -> T:
        """The value of a text, or the default without one; a mistake is noted."""
        try:
            return default if text is None else read(option, text, *more)
        except InputError as error:
            self += str(error).splitlines()
            return default

    def end(self) -> None:
        """Raise InputError if anything is wrong."""
        if self:
            raise InputError("\n".join(self))


def opened(file: str) -> Trajectory:
    """A trajectory, opened."""
    from ..trajectory.reader import Trajectory

    return Trajectory(file)


def output_path(file: str, output: str | None, ending: str, *, force: bool, option: str = "-o") -> Path:
    """The file to write, checked; without a name for it, one next to the trajectory."""
    from ..tools.files import check_apart, check_files

    given = Path(file)
    if output is not None and not output.strip():
        raise InputError(f"{option} {output!r}: must be the path of a file")
    found = given.with_name(given.name.removesuffix(".h5") + ending) if output is None else Path(output)
    if given.exists():
        check_apart(found, given, option)
    check_files([found], force=force, elsewhere=f"{option} writes elsewhere")
    return found


def selected_frames(text: str | None, frames: int) -> range:
    """Numbers of the frames that `--frames` names among so many; all of them without a text.

    Raises InputError if it names none (`analysis.options.frames_of`).
    """
    if text is None:
        return range(frames)
    try:
        return frames_of(text, frames)
    except InputError as error:
        raise InputError(f"--frames {error}") from None


def chosen_frames(trajectory: Trajectory, frames: str | None, start: float | None) -> list[int] | None:
    """The frames that `--frames` names, or those `--from` a place on; None without either.

    Raises InputError if there is no such frame, or both are given.
    """
    if frames is not None and start is not None:
        raise InputError("--from: cannot be combined with --frames, which names the frames by their numbers")
    if start is not None:
        from ..analysis.window import frames_from

        return frames_from(trajectory, start, "--from")
    return None if frames is None else [*selected_frames(frames, len(trajectory))]


def counted(
    what: str,
    unit: str = "frame",
    *,
    stream: TextIO | None = None,
    interval: float = 5.0,
    clock: Callable[[], float] = time.perf_counter,
) -> Callable[[Sequence[int]], Iterable[int]]:
    """Progress through frames, or other units: a bar on a terminal, elsewhere a line every `interval` seconds; none by `--quiet`."""
    from ..tools.progress import quiet, time_left

    out = sys.stderr if stream is None else stream

    def bar(frames: Sequence[int]) -> Iterable[int]:
        from tqdm import tqdm

        return tqdm(frames, desc=what, unit=unit, leave=False, file=out)

    def lines(frames: Sequence[int]) -> Iterator[int]:
        started = printed = clock()
        for done, frame in enumerate(frames):
            now = clock()
            if now - printed >= interval and done:
                left = time_left(now - started, done / len(frames))
                print(f"{what}: {done} of {len(frames)} {unit}s{left}", file=out, flush=True)
                printed = now
            yield frame

    if quiet():
        return iter
    return bar if out.isatty() else lines
