"""Versions of this package, its source, and the packages that its numbers depend on."""

from __future__ import annotations

import functools
import importlib.metadata
import platform
import subprocess
from pathlib import Path

__version__ = "0.1.0"


@functools.cache
def package_versions() -> dict[str, str]:
    """Versions of Python, this package, Taichi, NumPy and h5py; imports none of them."""
    versions = {"python": platform.python_version(), "ifrdem": __version__}
    for package in ("taichi", "numpy", "h5py"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:  # a trajectory can be written without Taichi
            versions[package] = "not installed"
    return versions


def revision() -> str:
    """The git commit of the program's own source tree, or why there is none."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return "not a git checkout"
    try:
        found = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40"],
            capture_output=True,
            text=True,
            timeout=10.0,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return found.stdout.strip()
