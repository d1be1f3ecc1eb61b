"""The benchmark of what output costs: what it times, and that it says so. No time is tested."""

from __future__ import annotations

import json

import pytest

from ifrdem import bench_output, cli
from ifrdem.bench_output import FRAMES, OutputCost
from ifrdem.simulation import Simulation

pytestmark = pytest.mark.unoptimised

SMALL = ["bench", "--n", "300", "--phi", "0.3", "--threads", "1", "--runs", "2", "--output"]


def test_each_round_times_the_same_collisions_bare_with_the_ledger_and_with_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two rounds, and a piece before the first that is not timed; whose turn it is changes between them."""
    pieces: list[tuple[bool, bool, int]] = []
    follow = Simulation.follow

    def followed(self: Simulation, course, **options) -> None:  # type: ignore[no-untyped-def]
        before = self.collisions
        follow(self, course, **options)
        if "stored" in options:  # not a warming up
            pieces.append(
                (self.measure().dissipated is not None, "observers" in options, self.collisions - before)
            )

    monkeypatch.setattr(Simulation, "follow", followed)
    assert cli.main([*SMALL, "none", "--json"]) == 0
    own = json.loads(capsys.readouterr().out)
    bare, tallied, written = (False, False), (True, False), (True, True)
    assert [piece[:2] for piece in pieces] == [written, bare, tallied, written, bare, written, tallied]
    assert {count - FRAMES * 300 // 2 for _, _, count in pieces} <= {
        0,
        1,
    }  # a sum of collisions per disk is rounded
    for name in ("seconds_bare", "seconds_with_ledger", "seconds_writing", "seconds_plain_write"):
        assert len(own[name]) == 2
        assert min(own[name]) > 0.0
    assert own["series_rows"] > 3 * FRAMES
    # 24 bytes a disk, and what HDF5 needs for 60 frames of so few disks: indexes, and whole chunks of the series.
    assert 24 * 300 < own["frame_bytes"] < 24 * 300 + 8000
    assert (own["n"], own["phi"], own["compression"], own["compressor"]) == (300, 0.3, "none", None)


def test_shares_are_medians_over_pieces_side_by_side() -> None:
    cost = OutputCost(
        1000, 0.3, "gzip", "somebody", [10.0, 20.0, 10.0], [11.0, 21.0, 10.0], [12.1, 23.1, 12.0], [0.1] * 3, 9, 1e4
    )  # fmt: skip
    assert cost.ledger_share == pytest.approx(0.05)
    assert cost.writing_share == pytest.approx(0.1)
    assert cost.share == pytest.approx(0.2)
    text = cost.report()
    assert "compression gzip by somebody" in text
    assert "all output costs       20 % (median of 3; 15.5 to 21 %)" in text
    assert f"10 s (median of 3; 10 to 20 s) for {bench_output.FRAMES} collisions per disk" in text
