"""Taichi says nothing to the terminal of who uses ifrdem."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "use",
    ["import taichi", "from ifrdem import forces", "from ifrdem.simulation import backend; backend.start()"],
)
def test_taichi_prints_neither_its_banner_nor_a_line_on_notebooks(use: str) -> None:
    """A wrapped sys.stdout is what Taichi takes a notebook by."""
    program = (
        "import io, sys; sys.stdout = io.StringIO(); "
        f"import ifrdem; {use}; sys.__stdout__.write(sys.stdout.getvalue())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    assert (done.stdout, done.stderr) == ("", "")
