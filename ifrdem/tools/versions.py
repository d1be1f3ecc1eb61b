"""Versions of this package and of those that its numbers depend on."""

from __future__ import annotations

import functools
import importlib.metadata
import platform

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
