"""Cases as objects of Python: read, change, check, simulate and run them as `ifrdem run` does."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import PrivateAttr

from ..case import file as case_file
from ..case import report, shipped, template
from ..case.case import CaseSections as Sections
from ..case.file import CaseFile
from ..case.report import Report
from ..case.section import Section, plain
from ..errors import InputError, RunWarning, shortened
from ..simulation.simulation import Simulation
from ..tools.checked import Positive, validated
from ..tools.toml import toml
from ..trajectory.reader import Trajectory
from .outputs import Outputs
from .run import run as run_file

Changes = Mapping[str, Any] | Sequence[str]


def _warn(text: str) -> None:
    warnings.warn(text, RunWarning, stacklevel=4)


class Case(Sections):
    """Everything that a case file says, as an object: its sections and keys are attributes, with the names of the file.

    A value is checked when it is set. What concerns several keys is checked by `check`, `simulation` and `run_to`.
    A key that is set to None is left out. `print(case)` shows the case as a case file.

    Parameters
    ----------
    run, box, species, ... : dict or list of dict
        The sections of a case file. `Case.read` has them from a file.

    Raises
    ------
    InputError
        If keys are unknown or missing, or values are of a wrong type or range: a line for each.

    Examples
    --------
    >>> import ifrdem
    >>> case = ifrdem.Case.read("cooling", set={"species[0].number": 500})
    >>> case.run.seed = 3
    >>> case.run.collisions_per_disk = 2.0
    >>> gas = case.simulation()
    >>> gas.run(collisions_per_disk=1)
    >>> gas.disks.n, gas.collisions
    (500, 250)
    >>> case.run.seed = -1
    Traceback (most recent call last):
    ...
    ifrdem.errors.InputError: run.seed = -1: must be an integer from 0 to 9223372036854775807 (seed of every random number [whole number]; one seed, one result)
    """

    _path: Path = PrivateAttr(Path("<Python>"))
    _text: str = PrivateAttr("")
    _overrides: tuple[str, ...] = PrivateAttr(())

    def __init__(self, **sections: Any) -> None:
        sections = plain(sections)
        found, problems = case_file.validated(sections)
        if found is None or problems:
            raise InputError("\n".join(map(str, problems)))
        super().__init__(**sections)

    @classmethod
    @validated
    def read(cls, path: str | os.PathLike[str], *, set: Changes = ()) -> Case:
        """The case of a file, or a shipped case by its name (`ifrdem cases`).

        Parameters
        ----------
        path : str or path
            A case file (TOML), or the name of a shipped case.
        set : mapping or sequence of str
            Keys to change, {"run.seed": 3, "species[0].number": 100} or ["run.seed=3"]. None removes a key.

        Raises
        ------
        InputError
            If the file cannot be read, or a key or value is wrong: a line for each.
        """
        source, changes = shipped.find(os.fspath(path)), tuple(assignments(set))
        text, raw = case_file.load(source)
        found = cls(**case_file.changed(raw, source, changes))
        found._path, found._text, found._overrides = source, text, changes
        return found

    def check(self) -> Report:
        """Report of `ifrdem check`: quantities with their units, and warnings. `print` shows it as a table.

        Raises
        ------
        InputError
            If the case cannot be run: a line for each mistake.
        """
        return report.check(self.file().gas, Path())

    def simulation(self) -> Simulation:
        """The gas of the case at its start.

        Raises
        ------
        InputError
            As `check`; and if the device of the case is not there.
        """
        return self.file().gas.simulation()

    @validated
    def run_to(
        self,
        output: str | os.PathLike[str] | None = None,
        *,
        force: bool = False,
        max_hours: Positive | None = None,
        picture: bool = True,
        log: Callable[[str], None] = lambda _text: None,
        warn: Callable[[str], None] = _warn,
    ) -> Trajectory:
        """Run the case to its end, and write its files, as `ifrdem run` does.

        Parameters
        ----------
        output : str or path, optional
            NAME.h5, or a folder for files with the name of the run; by default the present folder.
        force : bool
            Replace files that exist.
        max_hours : float, optional
            Stop after so many hours, with a checkpoint from which `ifrdem resume` continues.
        picture : bool
            False: draw no picture, whatever the case says.
        log, warn : callable
            Get the lines on the run, and the warnings; by default warnings are `RunWarning`.

        Returns
        -------
        Trajectory
            The trajectory of the run, open.

        Raises
        ------
        InputError
            As `check`; and if files exist or cannot be written.
        Stopped
            If a signal or `max_hours` ends the run; the frames until then, and a checkpoint, are kept.
        EngineError
            If the gas cannot be run further.
        """
        file = self.file()
        outputs = Outputs.plan(file.case, None if output is None else os.fspath(output), picture=picture)
        run_file(file, outputs, force=force, max_hours=max_hours, log=log, warn=warn)
        return Trajectory(outputs.trajectory)

    def to_toml(self) -> str:
        """The case as the text of a case file, with the keys that are set."""
        return "\n".join(template.sections(self._set()))

    __str__ = to_toml

    def file(self) -> CaseFile:
        """The case with its gas, as a case file with overrides that says the same; every rule is checked.

        Raises
        ------
        InputError
            A line for each mistake.
        """
        _, problems = case_file.validated(self._set())  # lists may have been changed in place
        if problems:
            raise InputError("\n".join(f"{self._path}: {each}" for each in problems))
        if not self._text:
            return case_file.of_text(self.to_toml(), self._path)
        raw = case_file.changed(case_file.load_text(self._text, self._path), self._path, self._overrides)
        changes = (*self._overrides, *differences(raw, self._set()))
        return case_file.of_text(self._text, self._path, changes, where="in Python")

    def _set(self) -> dict[str, Any]:
        """The keys that are set, as in a parsed file."""
        for name, value in self:  # sections that were not given, but changed in place since
            if value.model_fields_set if isinstance(value, Section) else value:
                self.model_fields_set.add(name)
        return self.model_dump(exclude_unset=True, exclude_none=True, warnings=False)


def assignments(changes: Changes) -> Iterator[str]:
    """Changes of a case as "key=value", the form of the command line.

    Examples
    --------
    >>> list(assignments({"run.seed": 3, "run.t_end": None, "start.positions": "hexagonal"}))
    ['run.seed=3', 'run.t_end=', 'start.positions="hexagonal"']
    """
    if not isinstance(changes, Mapping):
        yield from changes
        return
    for key, value in changes.items():
        try:
            yield f"{key}={'' if value is None else toml(plain(value))}"
        except TypeError:  # what JSON does not know
            raise InputError(f"set: {key} = {shortened(value)}: must be a value of a case file") from None


def differences(old: Any, new: Any, key: str = "") -> Iterator[str]:
    """Assignments that make one parsed case out of another.

    Examples
    --------
    >>> list(differences({"run": {"seed": 1, "t_end": 2.0}}, {"run": {"seed": 3}, "wall": []}))
    ['run.seed=3', 'run.t_end=', 'wall=[]']
    """
    if old == new:
        return
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for name, value in new.items():
            inner = f"{key}.{name}" if key else name
            yield from differences(old[name], value, inner) if name in old else assignments({inner: value})
        yield from (f"{key}.{name}=" if key else f"{name}=" for name in old if name not in new)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new) and key.count("[") == 0:
        for i, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from differences(one, other, f"{key}[{i}]")
    else:
        yield from assignments({key: new})


@validated
def run(
    case: str | os.PathLike[str] | Case,
    output: str | os.PathLike[str] | None = None,
    *,
    set: Changes = (),
    force: bool = False,
    max_hours: Positive | None = None,
    picture: bool = True,
    log: Callable[[str], None] = lambda _text: None,
    warn: Callable[[str], None] = _warn,
) -> Trajectory:
    """Run a case file, a shipped case, or a `Case`, and write its files, as `ifrdem run` does.

    Parameters
    ----------
    case : str, path or Case
        A case file (TOML), the name of a shipped case, or a `Case`.
    set : mapping or sequence of str
        Keys to change, {"run.seed": 3, "species[0].number": 100} or ["run.seed=3"]. None removes a key.
    output, force, max_hours, picture, log, warn
        As for `Case.run_to`.

    Returns
    -------
    Trajectory
        The trajectory of the run, open.

    Raises
    ------
    InputError, Stopped, EngineError
        As `Case.run_to`.

    Examples
    --------
    >>> import ifrdem
    >>> small = {"species[0].number": 200, "run.collisions_per_disk": 2.0, "output.frames": 4}
    >>> with ifrdem.run("cooling", "small.h5", set=small, picture=False) as trajectory:
    ...     len(trajectory)
    ...
    5
    """
    changes = tuple(assignments(set))
    if isinstance(case, Case):
        found = case.model_copy(deep=True)
        if changes:
            raise InputError(
                "set: cannot be combined with a Case: change its attributes, such as case.run.seed = 3"
            )
    else:
        found = Case.read(case, set=changes)
    return found.run_to(output, force=force, max_hours=max_hours, picture=picture, log=log, warn=warn)
