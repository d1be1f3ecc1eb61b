"""The benchmark of what output costs: what it times, and that it says so. No time is tested."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from ifrdem.cli import main as cli
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.speed import output_cost
from ifrdem.validation.speed.output_cost import FRAMES, LEAD, OutputCost, between

pytestmark = pytest.mark.unoptimised

SMALL = ["bench", "--n", "300", "--phi", "0.3", "--threads", "1", "--runs", "2", "--output"]


def test_each_turn_times_the_same_collisions_bare_with_the_ledger_and_with_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two turns, in other orders, after one that is not timed. A piece ends with an epoch, soon after a frame."""
    pieces: list[tuple[bool, int]] = []
    lengths: list[float] = []
    follow = Simulation.follow

    def followed(self: Simulation, course, observers=(), **options) -> None:  # type: ignore[no-untyped-def]
        frames: list[float] = []
        before = self.measure()
        try:
            watching = [*observers, lambda _state, measure: frames.append(measure.time)] if observers else []
            follow(self, course, observers=watching, **options)
        finally:
            after = self.measure()
            if "stored" in options:  # not a warming up
                assert before.regimes is not None
                assert after.regimes is not None
                pieces.append((after.regimes.sum() > before.regimes.sum(), len(frames)))
                lengths.append(2.0 * (after.collisions - before.collisions) / 300)

    monkeypatch.setattr(Simulation, "follow", followed)
    monkeypatch.setattr(output_cost, "LEAST_SECONDS", 1e-9)  # how long these pieces take does not matter
    assert cli.main([*SMALL, "none", "--json"]) == 0
    own = json.loads(capsys.readouterr().out)
    bare, tallied, written = (False, 0), (True, 0), (True, LEAD + FRAMES)
    assert pieces == [bare, tallied, written, written, bare, tallied, written, bare, written, tallied]
    assert all(LEAD + FRAMES <= length < LEAD + FRAMES + 1 for length in lengths)
    for name in ("seconds_bare", "seconds_with_ledger", "seconds_writing", "seconds_plain_write"):
        assert len(own[name]) == 2
        assert min(own[name]) > 0.0
    assert own["series_rows"] > 3 * FRAMES  # one at the end of each epoch
    # 24 bytes a disk, and what HDF5 needs for 20 frames of so few disks: indexes, and whole chunks of the series.
    assert 24 * 300 < own["frame_bytes"] < 24 * 300 + 15_000
    assert (own["n"], own["phi"], own["compression"]) == (300, 0.3, "none")


def test_shares_are_medians_over_pieces_side_by_side() -> None:
    cost = OutputCost(
        1000, 0.3, "gzip", [10.0, 20.0, 10.0], [11.0, 21.0, 10.0], [12.1, 23.1, 12.0], [0.1] * 3, 4, 9, 1e4
    )  # fmt: skip
    assert cost.ledger_share == pytest.approx(0.05)
    assert cost.writing_share == pytest.approx(0.1)
    assert cost.share == pytest.approx(0.2)
    text = cost.report()
    assert "compression gzip by somebody" in text
    assert "all output costs       20 % of a run without, 2.1e+03 ms a frame (too few turns to say" in text
    assert "10 s (median; 10 to 20 s)" in text
    assert "3 turns of pieces of 4 frames" in text
    assert cost.figures()["share_between"] is None
    longer = replace(cost, bare=[10.0] * 9, tallied=[10.0] * 9, writing=[10.0 + k for k in range(9)])
    assert (
        "all output costs       40 % of a run without, 4e+03 ms a frame (with 95 % confidence 10 to 70 %)"
        in (longer.report())
    )
    assert longer.figures()["share_between"] == pytest.approx((0.1, 0.7))


def test_how_sure_a_median_is_comes_from_the_binomial_distribution() -> None:
    """Of 9 values, the median lies between the second and the eighth with 1 - 2 (1 + 9) / 2^9 = 96.1 %, and between
    the third and the seventh with 1 - 2 (1 + 9 + 36) / 2^9 = 82.0 % only; of 5, the extremes enclose it with 93.8 %."""
    values = [3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0]
    assert between(values) == (sorted(values)[1], sorted(values)[7])
    assert between(values[:5]) is None


def test_pieces_of_small_gases_have_more_frames(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 300 disks, four frames take some hundredths of a second."""
    monkeypatch.setattr(output_cost, "LEAST_SECONDS", 0.2)
    assert cli.main([*SMALL[:-3], "--runs", "1", "--output", "none", "--json"]) == 0
    own = json.loads(capsys.readouterr().out)
    assert own["frames"] > FRAMES
    assert own["frames"] * own["seconds_writing"][0] > 0.05
