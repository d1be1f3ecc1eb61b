"""The benchmark of output: its pieces and its confidence. No time is tested."""

from __future__ import annotations

import json

import pytest

from ifrdem.case.gas import CaseGas
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.steps.schedule import RunPlan
from ifrdem.tools.arguments import script
from ifrdem.validation.speed import bench, output_cost
from ifrdem.validation.speed.output_cost import FRAMES, between, cost


@pytest.mark.full
def test_each_turn_times_the_same_time_bare_with_the_ledger_and_with_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two turns, in other orders, after one that is not timed; a piece goes from its last frame to its own last one."""
    pieces: list[tuple[bool, int]] = []
    lengths: list[float] = []
    follow = Simulation.follow

    def sampled_run(self: Simulation, plan: RunPlan, *, frame_callbacks=(), **options) -> None:  # type: ignore[no-untyped-def]
        if plan.next_frame == 0:  # a warming up
            follow(self, plan, frame_callbacks=frame_callbacks, **options)
            return
        frames: list[float] = []
        before = self.measure()
        watching = (
            [*frame_callbacks, lambda _state, measure: frames.append(measure.time)] if frame_callbacks else []
        )
        follow(self, plan, frame_callbacks=watching, **options)
        after = self.measure()
        assert before.regimes is not None
        assert after.regimes is not None
        pieces.append((after.regimes.sum() > before.regimes.sum(), len(frames)))
        lengths.append(after.time - before.time)

    monkeypatch.setattr(Simulation, "follow", sampled_run)
    arguments = ["--n", "300", "--phi", "0.3", "--every", "1", "--threads", "1", "--turns", "2"]
    assert script(output_cost.output_cost, arguments) == 0
    own = json.loads(capsys.readouterr().out)
    bare, tallied, written = (False, 0), (True, 0), (True, FRAMES)
    assert pieces == [bare, tallied, written, bare, tallied, written, bare, written, tallied]
    expected = FRAMES * bench.mean_free_time(CaseGas.from_case(bench.elastic_gas(300, 0.3)))
    assert lengths == pytest.approx([expected] * 9, rel=1e-9)
    assert {way: len(found) for way, found in own["seconds"].items()} == {
        "bare": 2, "with ledger": 2, "with all": 2,
    }  # fmt: skip
    assert min(min(found) for found in own["seconds"].values()) > 0.0
    # 24 bytes a disk, and what HDF5 needs for twelve frames of so few disks: indexes, whole chunks of the series; each
    # frame's three pieces (2400 and 1200 bytes) and new nodes of indexes fill up a page of 4096 bytes at most.
    assert 24 * 300 < own["frame_bytes"] < 24 * 300 + 25_000 + 3 * 4096
    assert (own["n"], own["phi"], own["every"], own["compression"]) == (300, 0.3, 1.0, "none")


def test_shares_are_medians_over_pieces_side_by_side() -> None:
    """1.1, 1.05 and 1.2 times the time: 10 % more."""
    assert cost([11.0, 21.0, 12.0], [10.0, 20.0, 10.0]) == {"share": pytest.approx(0.1), "between": None}
    longer = cost([10.0 + k for k in range(9)], [10.0] * 9)
    assert longer == {"share": pytest.approx(0.4), "between": pytest.approx((0.1, 0.7))}


def test_how_sure_a_median_is_comes_from_the_binomial_distribution() -> None:
    """Of 9 values, the median lies between the second and the eighth with 1 - 2 (1 + 9) / 2^9 = 96.1 %, and between
    the third and the seventh with 1 - 2 (1 + 9 + 36) / 2^9 = 82.0 % only; of 5, the extremes enclose it with 93.8 %."""
    values = [3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0]
    assert between(values) == (sorted(values)[1], sorted(values)[7])
    assert between(values[:5]) is None
