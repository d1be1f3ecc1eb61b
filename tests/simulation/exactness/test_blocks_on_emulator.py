"""Tiles by blocks of threads have the bits of the CPU, in any order of threads and without a race.

On a stand-in for an NVIDIA driver, which runs the code of a GPU on the CPU (`tests/emulator`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from emulator.device import CAN_RUN, EMULATE, NEEDS

SUPPORT = Path(__file__).parents[2] / "support"
SETTINGS = {
    "STUB_SM": "2",
    "STUB_ORDER": "7",  # threads in a shuffled order
    "STUB_RACE": "1",
}

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not CAN_RUN, reason=NEEDS),
]


@pytest.fixture(scope="module")
def gases(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str]:
    """Report of `emulated_gases.py` for each gas, and messages of the emulator."""
    own = {"EMULATE_DIR": str(tmp_path_factory.mktemp("emulator")), "EMULATOR_PYTHON": sys.executable}
    done = subprocess.run(
        [EMULATE, sys.executable, SUPPORT / "emulated_gases.py"],
        env=os.environ | SETTINGS | own,
        capture_output=True,
        text=True,
        timeout=1200,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


def test_threads_do_not_race(gases: tuple[dict[str, Any], str]) -> None:
    _, messages = gases
    assert "emulator:" not in messages  # which reports each race


@pytest.mark.parametrize(
    ("name", "points", "dense"), [("small tiles", 1, False), ("dense tiles", 1, True), ("moments", 36, False)]
)
def test_blocks_have_the_bits_of_the_cpu(
    gases: tuple[dict[str, Any], str], name: str, points: int, dense: bool
) -> None:
    found = gases[0][name]
    assert found["blockwise"]
    assert (found["dense"] > 0) == dense
    assert found["points"] == points
    assert found["windows"] > 1
    assert found["collisions"] >= 500
    assert found["wall collisions"] >= 20
    assert found["differing"] == []
    assert found["energy inputs"]
    assert found["least energy input"] > 10.0
    assert found["histograms"]
    assert found["counts"] > 3 * found["collisions"]
    assert found["regimes"]
    assert found["regions"]
    assert found["disks in the region"] > 20
    assert found["energy transfer"]
    assert found["largest energy transfer"] > 10.0
    assert found["losses"]
