"""The verb `ifrdem plot`: one picture of a trajectory by name."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, nearest
from ..tools.files import check_apart, check_files
from . import frame_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..trajectory.reader import Trajectory

PICTURES = {
    "temperatures": "both temperatures and their ratio against time, with kinetic theory where it holds",
    "disks": "the disks of a frame, coloured by spin, or a map of density if there are many",
    "energy": "translational, rotational and potential energy against time",
    "ledger": "present, dissipated and put-in energy against time, and their residual",
    "mechanisms": "energy dissipated by each mechanism",
    "velocity": "distributions of velocities and spins beside Gaussians",
    "g": "pair correlation g(r) and its contact value",
    "S": "structure factor S(k)",
    "msd": "mean-square displacement and the diffusion coefficient",
    "vacf": "velocity autocorrelation",
    "fields": "maps of density, flow and thermal temperature",
    "clusters": "the largest cluster in time, and cluster sizes",
    "psi6": "hexatic order of the disks",
    "cooling": "Haff's law, and the approach of T_rot / T to its end",
    "impact": "angles of impact beside molecular chaos, and regimes",
}
WIDE = ("velocity", "fields", "clusters", "psi6", "cooling", "impact")


def add_to(verbs: Any) -> None:
    """Add the verb to the command line."""
    width = max(len(name) for name in PICTURES)
    parser = verbs.add_parser(
        "plot",
        help="draw a trajectory: temperatures, disks, velocity, g, S, msd, ...",
        description="Draw one picture of a trajectory into a PNG file:\n\n"
        + "\n".join(f"  {name:<{width}}  {text}" for name, text in PICTURES.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", nargs="?", help="a trajectory (.h5)")
    parser.add_argument("what", metavar="WHAT", nargs="?", help="a name from the list above")
    parser.add_argument("--list", action="store_true", help="list the names and draw nothing")
    parser.add_argument("--frames", metavar="A:B:C", help="frames as in Python: -1, 10:, ::10")
    parser.add_argument(
        "-o", "--output", metavar="PNG", help="the picture, NAME.png or NAME (default: FILE-WHAT.png)"
    )
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    parser.set_defaults(act=_act)


def _act(options: argparse.Namespace) -> int:
    return run(options, say=lambda text: print(text, flush=True))


def run(options: argparse.Namespace, *, say: Callable[[str], None]) -> int:
    """Do what the options say, and return the exit status.

    Raises
    ------
    InputError
        For an unknown name, frames that are not there, a file that exists, and what the trajectory does not hold.
    """
    if options.list:
        width = max(len(name) for name in PICTURES)
        for name, text in PICTURES.items():
            say(f"{name:<{width}}  {text}")
        return 0
    if options.file is None or options.what is None:
        raise InputError(
            "a trajectory and what to draw of it are needed: `ifrdem plot --list` says what there is"
        )
    if options.what not in PICTURES:
        raise InputError(
            f"no picture is called '{options.what}'{nearest(options.what, PICTURES)}; "
            f"there are: {', '.join(PICTURES)}"
        )
    from ..trajectory.reader import Trajectory

    with Trajectory(options.file) as trajectory:
        chosen = (
            None if options.frames is None else list(frame_numbers.chosen(options.frames, len(trajectory)))
        )
        path = Path(options.output or f"{trajectory.path.stem}-{options.what}.png")
        check_apart(path, trajectory.path)
        path = _as_png(path)
        check_apart(path, trajectory.path)
        check_files([path], force=options.force)
        from ..plots import run as plot

        plot.save(draw(trajectory, options.what, chosen), path)
    say(f"wrote {path}")
    return 0


def _as_png(path: Path) -> Path:
    """The file of a picture: with .png behind a name that has no ending, as in NAME of `ifrdem fit --picture`.

    Raises
    ------
    InputError
        If the ending is that of another format.
    """
    if path.suffix.lower() == ".png" or path.is_dir() or (path.exists() and not path.is_file()):
        return path  # the latter two are refused by `check_files`
    # Behind "mu0.21" there is no ending: what follows its point is no word.
    if path.suffix[1:].isalpha():
        raise InputError(f"-o {path}: pictures are PNG files: the name must end in .png, or have no ending")
    return path.with_name(f"{path.name}.png")


def draw(trajectory: Trajectory, what: str, chosen: list[int] | None = None) -> Figure:
    """A figure by its name in `PICTURES`, of the frames chosen, or of those that suit it.

    Raises
    ------
    InputError
        If the file does not hold what it takes.
    """
    from matplotlib.figure import Figure

    from ..analysis.catalogue import ANALYSES
    from ..analysis.result import NOT_STEADY, span_text
    from ..plots import analyses, disks, energies
    from ..plots import run as plot

    if len(trajectory) == 0:
        raise InputError(f"{trajectory.path}: no frame to draw")
    title = plot.title(trajectory)
    size = (12.0, 5.2) if what in WIDE else (7.5, 6.2)
    figure = Figure(figsize=size, dpi=200, layout="constrained")
    if what == "temperatures":
        _temperatures(figure, trajectory)
    elif what == "disks":
        disks.last_frame(figure, figure.subplots(), trajectory, chosen[-1] if chosen else -1)
    elif what in ("energy", "ledger", "mechanisms"):
        getattr(energies, what)(figure, trajectory)
    else:
        outcome = ANALYSES[what].of(trajectory, chosen)
        analyses.PANELS[what](figure, trajectory, outcome)
        title += f"\n{span_text(trajectory, outcome)}"
        if any(doubt.startswith(NOT_STEADY) for doubt in outcome.doubts):
            title += f"; {NOT_STEADY}: `ifrdem analyse` says how it changes"
    figure.suptitle(title, fontsize="medium")
    return figure


def _temperatures(figure: Figure, trajectory: Trajectory) -> None:
    """With the theory that belongs to the run: sheared, driven or cooling; none between walls."""
    from ..plots import temperatures

    if trajectory.room.all_walls:
        temperatures.walled(figure.subplots(), trajectory)
        return
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    if trajectory.box.shear_rate:
        temperatures.sheared(upper, lower, trajectory)
    elif trajectory.record("forces", bool, "[]"):
        temperatures.driven(upper, lower, trajectory)
    else:
        temperatures.cooling(upper, lower, trajectory)
