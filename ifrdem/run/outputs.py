"""The files that a run writes, and whether it may."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..tools.files import CHECKPOINT, VIEWS, check_files, checkpoint_of


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
