"""A gas on several ranks of MPI is, to the last bit, that of one rank; and the errors of a gas without verification."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from support import mpi

from ifrdem.simulation import backend

GASES = Path(__file__).parents[2] / "support" / "ranks" / "gases.py"


RUNS = ["1:elastic", "2:sizes"]  # on two, both neighbours are one rank
RUNS += [f"3:{name}" for name in ("cooling", "mixture", "walls", "shear", "driven", "fast", "spreading")]
RUNS += ["2:driven sizes", "3:fast sizes", "3:spreading sizes", "4:sizes", "4:elastic:ids_below_0"]
FAULTS = (
    "no_foresight",
    "half_a_ring",
    "half_a_halo",
    "no_hashes",
    "no_verification",
    "other_order",
    "wrong_owner",
)


@pytest.fixture(scope="module")
def results(request: pytest.FixtureRequest) -> dict[str, dict[str, Any]]:
    """Results of each run that is tested, by its words."""
    here = [item.name for item in request.session.items if item.path == request.path]
    words = [run for run in RUNS if any(name.endswith(f"[{run}]") for name in here)]
    if test_faults_are_found_out.__name__ in here:
        words += [*(f"2:cooling:{fault}" for fault in FAULTS), "2:sizes:wrong_row"]
    ranks = max(int(word[0]) for word in words)
    done = mpi.on(ranks, sys.executable, "-m", "mpi4py", GASES, *words, timeout=600.0)
    assert done.returncode == 0, done.stderr + done.stdout
    found = {line["word"]: line for line in map(json.loads, done.stdout.splitlines())}
    assert list(found) == words
    return found


@mpi.needed
@pytest.mark.full(keep=("2:sizes",))
@pytest.mark.parametrize("run", RUNS)
def test_all_bits_are_those_of_one_rank(run: str, results: dict[str, dict[str, Any]]) -> None:
    """State, past of disks, sums, ledger, windows, what forces put in, and 250 collisions in their order.

    Ids may begin below 0 on ranks: gases of more than 2^31 disks have such.
    """
    each, (ranks, name, *_) = results[run], run.split(":")
    assert each["differ"] == [], each
    assert (0 < each["own"] < each["tiles"]) == (ranks != "1")
    if name == "cooling":  # what ranks had to exchange again
        assert each["run_again"] > 0
    if (
        name.endswith("sizes") and "driven" not in name
    ):  # tables of kinds were full and started again, beyond those of lists that were sent
        assert each["tables"] > 3 + each["relisted"] + each["moved"], each
    if "spreading" in name:  # blocks moved, and halos that had to be wider are known to their new owners
        assert each["moved"] > 0
        assert each["run_again"] > 0
    if "fast" in name:  # disks went to other ranks in all ways
        assert each["in_order"] > 0
        assert each["relisted"] > 0


@mpi.needed
@pytest.mark.skipif(backend.cuda_absence() is not None, reason="no CUDA device on this machine")
def test_a_gpu_a_rank_has_the_bits_of_one_gpu() -> None:
    """Of a state with latest partners, after tiles ran again; three ranks share GPUs as requested."""
    script = GASES.with_name("gpus.py")
    observed = {"CUDA_VISIBLE_DEVICES": "0,0"}
    done = mpi.on(3, sys.executable, "-m", "mpi4py", script, timeout=300.0, **observed)
    assert done.returncode == 0, done.stderr + done.stdout
    found = json.loads(done.stdout)
    assert found["differ"] == []
    assert found["tiles"] >= 9
    assert found["run_again"] > 0
    assert found["seen"] == ["0", "0", "0"]


@pytest.mark.full
@mpi.needed
def test_faults_are_found_out(results: dict[str, dict[str, Any]]) -> None:
    """Faults: half a ring, a narrow one, no hashes or verification, other sums, an unowned tile, wrong masses.

    Rings that turn out to be too narrow are no fault: they come whole then. (Sums may change in their last digit: where
    a window is left to the whole box, disks stand in another order in their lists.)
    """
    found = {fault: results[f"2:cooling:{fault}"] for fault in FAULTS}
    for fault in ("half_a_ring", "no_hashes", "wrong_owner"):
        assert "were run by no rank" in found[fault]["error"]
    assert set(found["no_foresight"]["differ"]) <= {"totals"}
    assert found["no_foresight"]["whole"] > 0
    assert found["half_a_halo"]["differ"]
    # Tiles that are not run again although they are bad: their halos are wider when the window is repeated.
    assert "has other disks when it is repeated" in found["no_verification"]["error"]
    assert {"sums", "totals"} == set(found["other_order"]["differ"])  # in their last digits
    wrong_row = results["2:sizes:wrong_row"]["differ"]  # of a table of kinds
    assert {"position", "velocity", "spin", "totals"} <= set(wrong_row)


@pytest.mark.parametrize("n", [1, 2**31 - 1, 2**31, 3 * 10**9, 2**32 - 1])
def test_ids_of_up_to_2_to_the_32_disks_have_32_bits(n: int) -> None:
    from ifrdem.simulation.windows import ranks  # imports Taichi

    first = ranks.first_id(n)
    assert -(2**31) <= first <= first + n - 1 < 2**31
    assert first == 0 or n > 2**31 - 1  # random numbers of smaller gases stay what they are


@pytest.mark.full
def test_a_plain_run_imports_no_mpi() -> None:
    code = (
        "import sys, ifrdem, numpy as np; d = ifrdem.Disks(2, mass=1.0, radius=0.5);"
        "s = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], np.zeros(2));"
        "ifrdem.Simulation(d, ifrdem.Box((10.0, 10.0)), ifrdem.IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0), s).run(t_end=4.0);"
        "assert 'mpi4py' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
