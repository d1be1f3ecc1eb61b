"""Starts of quadrants without syntax trees: programs looked up by keys of sources, features and types of arguments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ifrdem.kernels.compiler import runtime

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(runtime.version("quadrants") is None, reason="quadrants is not installed"),
]

RUN = """
import hashlib, json, sys
import numpy as np
import ifrdem
from ifrdem.kernels import layout
from ifrdem.kernels.compiler import frontends
from ifrdem.kernels.laws import law
from ifrdem.kernels.compiler.language import ti

made, changed = {}, sys.argv[1]
generator = sys.modules["quadrants.lang.kernel"].ASTGenerator
build = generator.__call__

def built(self, cxx):
    name = self.current_kernel.func.__name__
    made.setdefault(name, not self.only_parse_function_def)
    return build(self, cxx)

generator.__call__ = built
if changed == "sources":
    frontends._sources = lambda: "others"

class Own(ifrdem.CollisionLaw):
    coefficients = {"e": "0"}

    @staticmethod
    def collide(pair, law):
        return (1.0 + law.e) * pair.m_n * pair.g_n, 0.0, 0.0

n = 200
disks = ifrdem.Disks(n, mass=1.0, radius=0.5)
box = ifrdem.Box.from_packing_fraction(disks.radius, 0.3)
position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
start = ifrdem.State(position, velocity, np.zeros(n))
one = Own(e=0.9) if changed == "law" else ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15)
record = ["ledger"] if changed == "features" else []
gas = ifrdem.Simulation(disks, box, one, start, device=ifrdem.Device(threads=1), record=record)
gas.run(t_end=0.5)
found = hashlib.sha256(gas.state.position.tobytes() + gas.state.velocity.tobytes()).hexdigest()
print(json.dumps({"traced": sorted(k for k, v in made.items() if v), "kernels": sorted(made), "bits": found}))
"""


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A folder of programs, and what the run found that filled it."""
    folder = tmp_path_factory.mktemp("programs")
    return folder, traced(folder, "nothing")


def traced(folder: Path, changed: str) -> dict[str, Any]:
    """Kernels that a gas in a process of its own uses, those of them that were traced, and a hash of its state."""
    environment = {
        **os.environ, runtime.VARIABLE: "quadrants", "QD_OFFLINE_CACHE_FILE_PATH": str(folder),
        "QD_OFFLINE_CACHE_CLEANING_POLICY": "never",
    }  # fmt: skip
    (folder / "gas.py").write_text(RUN, encoding="utf-8")  # quadrants reads the source of a law in a file
    command = [sys.executable, str(folder / "gas.py"), changed]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_a_second_run_traces_no_kernel_and_gives_the_same_bits(filled: tuple[Path, dict[str, Any]]) -> None:
    folder, first = filled
    again = traced(folder, "nothing")
    assert len(first["kernels"]) > 2
    assert first["traced"] == first["kernels"] == again["kernels"]
    assert again["traced"] == []
    assert again["bits"] == first["bits"]


@pytest.mark.parametrize("changed", ["sources", "features"])
def test_what_decides_a_kernel_is_in_its_key(filled: tuple[Path, dict[str, Any]], changed: str) -> None:
    assert "run_windows" in traced(filled[0], changed)["traced"]


def test_kernels_of_a_custom_law_are_traced_at_each_start(filled: tuple[Path, dict[str, Any]]) -> None:
    """Its functions may use variables of their file."""
    for _ in range(2):
        assert "run_windows" in traced(filled[0], "law")["traced"]


def test_a_kernel_with_a_force_has_no_key() -> None:
    """The function of a force is of another package: its address in the key would be another one in each process."""
    from ifrdem.kernels.compiler.frontends import _name
    from ifrdem.kernels.compiler.language import declared
    from ifrdem.kernels.layout import CompiledForce
    from ifrdem.model.forces import Drag

    assert _name((CompiledForce(declared(Drag.act), 0, ("rate",), 0, 0),)) is None
