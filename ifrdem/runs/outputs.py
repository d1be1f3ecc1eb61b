"""The files that a run writes, and checks that it may write them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..case.case import CaseSections
from ..errors import InputError, option_name
from ..tools.files import CHECKPOINT, VIEWS, check_files, checkpoint_of
from ..trajectory import parts
from ..trajectory.file import check_views, views_of


@dataclass(frozen=True)
class Outputs:
    """Paths of a run's files; `picture` is None if none is drawn, `views` (`views.py`) are none or two."""

    trajectory: Path
    picture: Path | None
    views: tuple[Path, ...] = ()

    @classmethod
    def plan(cls, case: CaseSections, output: str | None = None, *, picture: bool = True) -> Outputs:
        """NAME.h5, and NAME.png, NAME.vtkhdf and NAME.nc if the case wants them.

        `output` is a folder that exists, or a text that ends in a separator: the files get the run's name there.
        Anything else is the files' path without its ending (".h5" or ".png" at its end is taken off). Without it, they
        are in the present folder. Without `picture`, none is drawn.

        Raises InputError if `output` is an empty text, or a device or pipe.
        """
        prefix = Path(case.run.name)
        if output is not None:
            special = os.path.exists(output) and not (os.path.isdir(output) or os.path.isfile(output))
            if special or not output.strip() or "\0" in output:
                name = option_name("-o", "output =")
                raise InputError(
                    f"{name} {output!r}: must be a folder, or the path of files without their ending"
                )
            folder = os.path.isdir(output) or output.endswith(("/", os.sep))
            stem = Path(output.removesuffix(".h5").removesuffix(".png"))
            prefix = Path(output) / prefix if folder else stem
        # Not with_suffix: a name such as "mu0.21" would lose its end.
        trajectory, drawn, *views = (prefix.with_name(prefix.name + each) for each in (".h5", ".png", *VIEWS))
        has_views = case.output.views and "position" in case.output.fields
        return cls(
            trajectory, drawn if picture and case.output.picture else None, tuple(views) if has_views else ()
        )

    @property
    def checkpoint(self) -> Path:
        """Path of the file from which `ifrdem resume` continues; it exists until the run is done."""
        return checkpoint_of(self.trajectory)

    def check(self, *, force: bool) -> None:
        """Refuse outputs that exist (unless `force`), that a process is writing, or that cannot be written.

        Raises InputError with a line for each thing that is wrong. Nothing is left behind.
        """
        views = [view for view in views_of(self.trajectory) if view not in self.views]  # of one that was here
        check_files([*self._paths, *views], force=force)
        check_views(self.views)
        parts.check_unused(self.trajectory)
        if (old_parts := parts.existing(self.trajectory)) and not force:
            replaces = option_name("--force replaces it, -o", "force=True replaces it, another output")
            raise InputError(
                f"output {old_parts[0].parent}: holds parts of a trajectory; {replaces} writes elsewhere"
            )

    def sizes(self) -> dict[Path, int]:
        """Bytes of each file that is there."""
        paths = [*self._paths, *parts.existing(self.trajectory)]
        return {path: path.stat().st_size for path in paths if path.exists()}

    @property
    def _paths(self) -> list[Path]:
        return [path for path in (self.trajectory, self.picture, *self.views) if path is not None]


def trajectory_in(path: Path) -> Path:
    """The trajectory of a path: itself, or the only one in a folder.

    Raises InputError if the folder has none, or several.
    """
    if not path.is_dir():
        return path
    found = [each for each in path.glob("*.h5") if not each.name.endswith(CHECKPOINT)]
    if not found:
        raise InputError(f"{path} is a folder without a trajectory (*.h5)")
    return only(found, f"{path}: several trajectories are here")


def only(found: Sequence[Path], several: str) -> Path:
    """The only one of the files that were found; InputError with this text and their names if there are more."""
    if len(found) > 1:
        names = (f"{each.name.removesuffix(CHECKPOINT).removesuffix('.h5')}.h5" for each in found)
        raise InputError(f"{several}: name one of {', '.join(sorted(names))}")
    return found[0]
