"""Versions of this package, its source, and the packages that its numbers depend on."""

from __future__ import annotations

import functools
from pathlib import Path

__version__ = "1.0.0"  # read by pyproject.toml, too


def shown() -> str:
    """Line of `ifrdem --version`. Functions import what they need, so that it is printed at once."""
    return described(__version__, revision())


def described(version: object, commit: object) -> str:
    """The program with its version and commit, as files state them; None where a file states none."""
    return f"ifrdem {version or 'of an unknown version'}{f' (commit {commit})' if commit else ''}"


def package_versions() -> dict[str, str]:
    """Versions of Python, this package, the runtime of kernels (by its name), NumPy and h5py; imports none of them."""
    from ..kernels.compiler import runtime

    return dict(_versions(runtime.chosen()))


@functools.cache
def _versions(of_kernels: str) -> dict[str, str]:
    import importlib.metadata
    import platform

    versions = {"python": platform.python_version(), "ifrdem": __version__}
    for package in (of_kernels, "numpy", "h5py"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:  # a trajectory can be written without a runtime
            versions[package] = "not installed"
    return versions


ROOT = Path(__file__).resolve().parents[2]
"""The source tree, if this file is in one; it works alone, too: setup.py runs it before the package is installed."""
COMMIT_FILE = Path("ifrdem", "tools", "commit.txt")
"""File that names the commit, below `ROOT` and in packages.

In a clone it has a mark, which `git archive` replaces (.gitattributes), and setup.py in the packages that it builds.
"""
UNKNOWN = "unknown"


@functools.cache
def revision() -> str:
    """The git commit of the program's source, with "-dirty" if files were changed since, or "unknown".

    Asked of git in a clone, otherwise read from the file that was stored when the package was built.
    """
    if not (ROOT / ".git").exists():
        try:
            stored = (ROOT / COMMIT_FILE).read_text(encoding="utf-8").strip()
        except OSError:
            return UNKNOWN
        return stored if stored and "$" not in stored else UNKNOWN
    import subprocess

    # A clone of another user, as in containers, is read, too; a tag does not take the place of the commit.
    git = ["git", "-c", "safe.directory=*", "-C", str(ROOT)]
    command = [*git, "describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    return found.stdout.strip()
