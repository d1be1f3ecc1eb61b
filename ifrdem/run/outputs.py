"""The files that a run writes, and whether it may."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..tools import beside

CHECKPOINT = ".checkpoint.h5"
VIEWS = (".vtkhdf", ".nc")
"""Endings of the files that let other programs read a trajectory (`views.py`)."""


@dataclass(frozen=True)
class Outputs:
    """Paths of a run's files; `picture` is None if none is drawn, `views` (`views.py`) are none or two."""

    trajectory: Path
    picture: Path | None
    views: tuple[Path, ...] = ()

    @classmethod
    def plan(
        cls, name: str, place: str | None = None, *, picture: bool = True, views: bool = False
    ) -> Outputs:
        """NAME.h5, NAME.png and NAME.vtkhdf, NAME.nc in a folder, or with a prefix.

        Parameters
        ----------
        name : str
            Name of the run.
        place : str, optional
            A folder that exists, or a text that ends in a separator: the files get the run's name there.
            Anything else is the files' path without its ending (".h5" or ".png" at its end is taken off).
            Without it, the present folder.

        Raises
        ------
        InputError
            If the place is an empty text, or a device or pipe.
        """
        if place is not None and not place.strip():
            raise InputError(
                "-o: an empty text is no place; give a folder, or the files' path without its ending"
            )
        if (
            place is not None
            and os.path.exists(place)
            and not (os.path.isdir(place) or os.path.isfile(place))
        ):
            raise InputError(f"-o {place}: is neither a folder nor a file; files cannot stand beside it")
        if place is None:
            prefix = Path(name)
        elif os.path.isdir(place) or place.endswith(("/", os.sep)):
            prefix = Path(place) / name
        else:
            prefix = Path(place.removesuffix(".h5").removesuffix(".png"))
        # Not with_suffix: a name such as "mu0.21" would lose its end.
        return cls(
            trajectory=prefix.with_name(f"{prefix.name}.h5"),
            picture=prefix.with_name(f"{prefix.name}.png") if picture else None,
            views=tuple(prefix.with_name(prefix.name + ending) for ending in VIEWS) if views else (),
        )

    @property
    def checkpoint(self) -> Path:
        """From what `ifrdem resume` goes on; there while the run is not done."""
        return checkpoint_of(self.trajectory)

    def check(self, *, force: bool) -> None:
        """Refuse what would overwrite files (unless `force`), or cannot be written.

        Raises
        ------
        InputError
            With a line for each thing that is wrong. Nothing is left behind.
        """
        check_files(self._paths, force=force)

    def sizes(self) -> dict[Path, int]:
        """Bytes of each file that is there."""
        return {path: path.stat().st_size for path in self._paths if path.exists()}

    @property
    def _paths(self) -> list[Path]:
        return [path for path in (self.trajectory, self.picture, *self.views) if path is not None]


def checkpoint_of(trajectory: Path) -> Path:
    """The checkpoint that belongs to a trajectory, NAME.checkpoint.h5 for NAME.h5."""
    return trajectory.with_name(trajectory.name.removesuffix(".h5") + CHECKPOINT)


def trajectory_in(place: Path) -> Path:
    """The trajectory that a path means: itself, or the only one in a folder.

    Raises
    ------
    InputError
        If the folder has none, or several.
    """
    if not place.is_dir():
        return place
    return only(
        [each for each in place.glob("*.h5") if not each.name.endswith(CHECKPOINT)],
        several=f"{place}: several trajectories are here",
        none=f"{place} is a folder without a trajectory (*.h5)",
    )


def checkpoint_in(place: Path) -> Path:
    """The only checkpoint in a folder.

    Raises
    ------
    InputError
        If there is none, or there are several.
    """
    return only(
        list(place.glob(f"*{CHECKPOINT}")),
        several=f"{place}: several runs can go on here",
        none=f"{place}: no run can go on here: there is no *{CHECKPOINT}; a run that is done has none",
    )


def only(found: Sequence[Path], *, several: str, none: str) -> Path:
    """The only one of the files that were found; InputError with one of the texts otherwise."""
    if not found:
        raise InputError(none)
    if len(found) > 1:
        names = ", ".join(
            sorted(each.name.removesuffix(CHECKPOINT).removesuffix(".h5") + ".h5" for each in found)
        )
        raise InputError(f"{several}: name one of {names}")
    return found[0]


def check_apart(path: Path, trajectory: Path) -> None:
    """Refuse an output that would replace the trajectory that it is made of.

    Raises
    ------
    InputError
        If both are one file.
    """
    if path.exists() and path.samefile(trajectory):
        raise InputError(f"output {path}: is the trajectory itself; -o writes elsewhere")


def check_files(paths: Sequence[Path], *, force: bool, elsewhere: str = "-o writes elsewhere") -> None:
    """Refuse files that exist (unless `force`) or cannot be written.

    Raises
    ------
    InputError
        With a line for each thing that is wrong; `elsewhere` says how to choose another place. Nothing is left behind.
    """
    wrong = []
    for path in paths:
        if special := not_a_file(path):
            wrong.append(special)
        elif path.exists() and not force:
            wrong.append(f"output {path}: exists already; --force replaces it, {elsewhere}")
    for folder in dict.fromkeys(path.parent for path in paths):
        if not folder.exists():
            wrong.append(f"output folder {folder}: does not exist")
        elif not folder.is_dir():
            wrong.append(f"output folder {folder}: is not a folder")
        else:
            try:  # asking for permissions would be wrong for root, and on read-only file systems
                tempfile.TemporaryFile(dir=folder, prefix=".ifrdem-").close()
            except OSError as error:
                wrong.append(f"output folder {folder}: cannot be written to: {error.strerror}")
    if wrong:
        raise InputError("\n".join(wrong))


def write_aside(place: Path, write: Callable[[Path], object]) -> None:
    """Let `write` write a file beside its place, and rename it into place: it appears whole or not at all.

    Raises
    ------
    InputError
        If the place is a folder, a device or a pipe, which nothing must take the place of, or cannot be written.
    """
    if special := not_a_file(place):
        raise InputError(special)
    try:
        with beside.replacing(place) as new:
            write(new)
    except OSError as error:
        raise InputError(f"output {place}: cannot be written: {error.strerror or error}") from error


def not_a_file(path: Path) -> str | None:
    """Why something that is there can be no output; None for files and where nothing is."""
    if path.is_dir():
        return f"output {path}: is a folder"
    if path.exists() and not path.is_file():
        return f"output {path}: is a device or pipe, no file that could be replaced"
    return None
