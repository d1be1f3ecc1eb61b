"""Estimates of `ifrdem check` for large gases, compared with runs of them (`ifrdem/docs/results/starts.md`)."""

from __future__ import annotations

import re

import pytest
from support.cases import MakeCase, case_text
from support.manual import page

from ifrdem.case import estimate
from ifrdem.case.estimate import RunEstimate
from ifrdem.case.gas import CaseGas
from ifrdem.kernels.columns import bytes_per_disk

CASE = case_text({
    "run.t_end": None, "run.collisions_per_disk": 1.0, "run.low_memory": True, "box.packing_fraction": 0.2,
    "species[0].number": 100, "output.frames": 1,
})  # fmt: skip

PEAKS = {300_000: 0.328, 3_000_000: 0.899, 30_000_000: 5.553, 100_000_000: 17.99}
"""Largest memory [GB] of runs with `low_memory` to a collision per disk, by the number of disks."""
STARTS = {300_000: 1.04, 3_000_000: 6.45, 30_000_000: 68.1}
"""Processor time of their starts [s]."""


@pytest.mark.parametrize("n", PEAKS)
def test_memory_of_a_run_is_that_of_runs(n: int, case: MakeCase) -> None:
    """Within 10 %; and less than 1.4 times what the engine holds, beyond the libraries."""
    gas = CaseGas.from_case(case(f"species[0].number={n}"), start=False)
    peak = RunEstimate.of(gas).peak_bytes(gas)
    assert peak == pytest.approx(1e9 * PEAKS[n], rel=0.1)
    assert peak - estimate.PROCESS_BYTES - estimate.KEPT_BYTES < 1.4 * n * bytes_per_disk(low_memory=True)


@pytest.mark.parametrize("n", STARTS)
def test_time_of_a_start_is_that_of_starts(n: int) -> None:
    """Within a factor of 1.5, which such times vary by on a machine with other work."""
    assert 1.0 / 1.5 < estimate.start_seconds(n, "random", 1) / STARTS[n] < 1.5


def test_the_manual_says_bytes_per_disk_once() -> None:
    """Of what the engine holds: other pages refer to that one."""
    said = re.findall(r"(\d[\d,.]*) bytes per disk", page("performance.md"))
    assert said == [str(bytes_per_disk()), str(bytes_per_disk(low_memory=True))]
    for name in ("ranks.md", "limits.md", "starts.md"):
        assert not re.search(r"\d bytes per disk", page(name)), name
    for number in (estimate.START_BYTES_PER_DISK, estimate.FRAME_BYTES):
        assert f"{number} bytes for each disk" in page("performance.md")
    assert f"{estimate.GROWTH_BYTES_PER_DISK:,} bytes for each disk" in page("performance.md")
    assert f"| **sum** | **{bytes_per_disk()}** |" in page("results/bench.md")
