"""The runtime prints nothing to the terminal of a user of ifrdem."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import ifrdem
from ifrdem.kernels.compiler import runtime


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    "use",
    [
        f"import {runtime.chosen()}",
        "from ifrdem import forces",
        "from ifrdem.simulation import backend; backend.start()",
    ],
)
def test_the_runtime_prints_neither_its_banner_nor_a_line_on_notebooks(use: str) -> None:
    """A wrapped sys.stdout is what it takes a notebook by."""
    program = (
        "import io, sys; sys.stdout = io.StringIO(); "
        f"import ifrdem; {use}; sys.__stdout__.write(sys.stdout.getvalue())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    assert (done.stdout, done.stderr) == ("", "")


def test_a_misspelt_name_of_the_package_gets_the_nearest() -> None:
    with pytest.raises(AttributeError, match=r"'ifrdem' has no attribute 'Trajectry' .*'Trajectory'"):
        _ = ifrdem.Trajectry
    with pytest.raises(AttributeError, match=r"'ifrdem.initial' has no attribute 'rados' .*'radii'"):
        _ = ifrdem.initial.rados


@pytest.mark.parametrize(
    "name",
    ["forces", "laws", "observables", "initial", "theory", "analysis", "plots", "fit", "bullet"],
)
def test_modules_that_the_manual_lists_can_be_imported_by_their_names(name: str) -> None:
    module = importlib.import_module(f"ifrdem.{name}")
    assert getattr(ifrdem, name) is module
    assert module.__doc__


def test_import_alone_loads_neither_a_runtime_nor_numpy_nor_pydantic() -> None:
    program = (
        "import sys, ifrdem; print({'taichi', 'quadrants', 'numpy', 'pydantic', 'h5py'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout == "set()\n"
