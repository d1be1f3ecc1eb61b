"""Versions of this package, its source, and the packages that its numbers depend on."""

from __future__ import annotations

import functools
from pathlib import Path

__version__ = "0.1.0"
SHOWN = f"ifrdem {__version__}"
"""Line of `ifrdem --version`. Functions import what they need, so that it is printed at once."""


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


def revision() -> str:
    """The git commit of the program's own source tree, or why there is none."""
    import subprocess

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
