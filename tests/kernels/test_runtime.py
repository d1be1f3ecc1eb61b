"""The runtime of a process: chosen once, before kernels are imported; one message for a missing one."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ifrdem
from ifrdem import InputError
from ifrdem.kernels.compiler import runtime
from ifrdem.model.laws.law import compiled
from ifrdem.simulation import backend
from ifrdem.tools.versions import package_versions

BOTH = all(runtime.version(name) is not None for name in runtime.NAMES)
both = pytest.mark.skipif(not BOTH, reason="one of the runtimes is not installed")


@pytest.fixture
def unloaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a process that has imported no kernels, with both runtimes installed."""
    monkeypatch.setattr(runtime, "_loaded", None)
    monkeypatch.setattr(runtime, "version", {"taichi": "1.7.4", "quadrants": "1.3.3"}.get)
    monkeypatch.setenv(runtime.VARIABLE, "")


@pytest.mark.usefixtures("unloaded")
def test_the_environment_chooses_and_an_option_goes_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert runtime.chosen() == "taichi"
    monkeypatch.setenv(runtime.VARIABLE, "quadrants")
    assert runtime.chosen() == "quadrants"
    assert (runtime.variable("ARCH"), runtime.cache_name()) == ("QD_ARCH", "qdcache")
    assert "quadrants" in package_versions()
    assert "taichi" not in package_versions()
    runtime.choose(None)
    assert runtime.chosen() == "quadrants"
    runtime.choose("taichi")
    assert runtime.chosen() == "taichi"
    assert runtime.describe() == "taichi 1.7.4 (also installed: quadrants 1.3.3)"


@pytest.mark.usefixtures("unloaded")
def test_without_taichi_it_is_quadrants(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "version", {"quadrants": "1.4.0"}.get)
    assert runtime.chosen() == "quadrants"
    for first, remedy in (
        ((9, 0), "`pip install taichi`, or use quadrants"),
        ((3, 0), "Python: use quadrants"),
    ):
        monkeypatch.setattr(runtime, "_FIRST_WITHOUT_TAICHI", first)
        with pytest.raises(InputError, match=rf"run.runtime = 'taichi': .*{remedy}"):
            runtime.check("taichi", "run.runtime")


@pytest.mark.usefixtures("unloaded")
def test_an_unknown_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"--runtime quadrant: must be .*did you mean 'quadrants'"):
        runtime.choose("quadrant", "--runtime")
    monkeypatch.setenv(runtime.VARIABLE, "taichy")
    with pytest.raises(InputError, match=r"IFRDEM_RUNTIME = 'taichy': must be .*did you mean 'taichi'"):
        runtime.choose(None)  # before any work, as a run does


@pytest.mark.usefixtures("unloaded")
def test_a_process_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "_loaded", "taichi")
    monkeypatch.setenv(runtime.VARIABLE, "quadrants")
    assert runtime.chosen() == "taichi"
    runtime.choose("taichi")
    with pytest.raises(InputError, match="runtime = 'quadrants': must be 'taichi' in this process"):
        runtime.choose("quadrants")


def test_bits_are_the_same_on_a_cpu_where_both_were_compared() -> None:
    ours, theirs, new = ("taichi", "1.7.4"), ("quadrants", "1.3.3"), ("quadrants", "9.0")
    assert runtime.have_same_bits(ours, theirs, "cpu")
    assert not runtime.have_same_bits(ours, theirs, "cuda")
    assert not runtime.have_same_bits(ours, new, "cpu")
    assert runtime.have_same_bits(new, new, "cuda")


@pytest.mark.usefixtures("unloaded")
def test_a_run_chooses_its_runtime_before_it_looks_for_a_gpu(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A search for a runtime imports it, and it stays that of the process."""
    found = []

    def check(_device: object) -> None:
        found.append(runtime.chosen())
        raise InputError("no GPU")

    monkeypatch.setattr(backend, "check", check)
    with pytest.raises(InputError, match="no GPU"):
        ifrdem.Case.read("clusters", set={"run.runtime": "quadrants"}).run_to(tmp_path)
    study = ifrdem.Study("clusters", set=["run.runtime=quadrants"], seeds=2, output=tmp_path / "study")
    monkeypatch.setenv(runtime.VARIABLE, "")
    with pytest.raises(InputError, match="no GPU"):
        study.check()
    assert found == ["quadrants", "quadrants"]


def test_a_law_in_the_language_of_the_other_runtime_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    other = next(name for name in runtime.NAMES if name != runtime.chosen())
    monkeypatch.setitem(globals(), "language", type(sys)(other))

    class Foreign(ifrdem.CollisionLaw):
        @staticmethod
        def collide(pair, law):  # type: ignore[no-untyped-def]
            return language.max(pair.m_n, 0.0), 0.0, 0.0  # type: ignore[name-defined]  # noqa: F821

    with pytest.raises(InputError, match=f"`language` must be {runtime.chosen()}.*not {other}"):
        compiled(Foreign)


STATE = """
import hashlib, logging, sys
import numpy as np
import ifrdem
from ifrdem.kernels.compiler import runtime
n = 300
disks = ifrdem.Disks(n, mass=1.0, radius=0.5)
box = ifrdem.Box.from_packing_fraction(disks.radius, 0.3)
position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
start = ifrdem.State(position, velocity, np.zeros(n))
law, device = ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15), ifrdem.Device(threads=1)
bath = ifrdem.forces.Langevin(0.1, temperature=1.0, rate=0.3)
gas = ifrdem.Simulation(disks, box, law, start, forces=[bath], device=device, seed=2)
if sys.argv[1] == "go on":
    logging.basicConfig(level=logging.INFO, stream=sys.stderr)
    gas.load_checkpoint("gas.h5")
gas.run(t_end=float(sys.argv[2]))
if sys.argv[1] == "begin":
    gas.save_checkpoint("gas.h5")
hash = hashlib.sha256(gas.state.position.tobytes() + gas.state.velocity.tobytes()).hexdigest()
print(runtime.chosen(), gas.collisions, hash)
"""


@pytest.mark.full
@both
def test_a_checkpoint_resumes_bitwise_on_the_other_runtime(tmp_path: Path) -> None:
    logged = ""

    def done(name: str, *arguments: str) -> list[str]:
        nonlocal logged
        run = subprocess.run(
            [sys.executable, "-c", STATE, *arguments],
            cwd=tmp_path,
            env={**os.environ, runtime.VARIABLE: name},
            capture_output=True,
            text=True,
            check=True,
        )
        found, logged = run.stdout.split(), run.stderr
        assert found[0] == name
        return found[1:]

    whole = done("taichi", "whole", "2.0")
    done("quadrants", "begin", "1.0")
    assert done("taichi", "go on", "2.0") == whole
    assert re.search(r"gas\.h5 was written by quadrants \S+; taichi \S+ gives the same bits", logged)
    assert whole == done("quadrants", "whole", "2.0")
    assert "was written by" not in logged
    assert int(whole[0]) > 100


RESUME = """
import sys
import numpy as np
from ifrdem import Trajectory
from ifrdem.kernels.compiler import runtime
from ifrdem.runs.resume import resume
import ifrdem.kernels.compiler.language
resume("clusters.h5", picture=False, log=lambda _line: None)
with Trajectory("clusters.h5") as trajectory:
    print(runtime.chosen(), trajectory.parameters["versions/runtimes"], sep="|")
"""


@pytest.mark.full
@both
def test_a_run_resumes_in_a_process_of_the_other_runtime(tmp_path: Path) -> None:
    """Its kernels are imported: it cannot change to the runtime of the checkpoint. The file names both."""
    small = [
        "--set",
        "species[0].number=60",
        "--set",
        "output.frames=3",
        "--set",
        "run.collisions_per_disk=5",
    ]
    for command in (
        [
            "-m",
            "ifrdem",
            "run",
            "clusters",
            "--runtime",
            "quadrants",
            "--max-hours",
            "1e-9",
            "--no-picture",
            *small,
        ],
        ["-c", RESUME],
    ):
        environment = {**os.environ, runtime.VARIABLE: ""}
        done = subprocess.run(
            [sys.executable, *command],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == (0 if command[0] == "-c" else 3), done.stderr
    name, recorded = done.stdout.split("|")
    assert name == "taichi"
    assert recorded.strip() == ", ".join(f"{one} {runtime.version(one)}" for one in ("quadrants", "taichi"))
