"""The events of a window in rounds, as a GPU has them: those of a heap, or the window is marked."""

from __future__ import annotations

import pytest
from support.rounds import gas_of, windows_of


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    ("packing_fraction", "collisions"), [(0.1, 0.2), (0.3, 0.4), (0.3, 1.5), (0.6, 0.4), (0.6, 0.8)]
)
def test_rounds_have_the_bits_of_the_serial_order(packing_fraction: float, collisions: float) -> None:
    windows = windows_of(gas_of(64, packing_fraction, collisions, seed=1), warm_up=5, windows=60)
    unmarked = [window for window in windows if not window.marks.any()]
    assert len(unmarked) > 0.8 * len(windows)
    assert sum(window.collisions for window in unmarked) > 300
    assert not any(window.wrong for window in unmarked)


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(("packing_fraction", "collisions"), [(0.3, 0.4), (0.3, 0.8), (0.6, 0.4)])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_certificate_finds_each_wrong_window_of_the_bare_rule(
    packing_fraction: float, collisions: float, seed: int
) -> None:
    # An event that is the earliest of both of its disks, but not of those in their lists, often comes out of order.
    windows = windows_of(gas_of(64, packing_fraction, collisions, seed), warm_up=5, windows=60, bare=True)
    wrong = [window for window in windows if window.wrong]
    assert len(wrong) > 1
    assert all(window.marks.any() for window in wrong)


def test_the_certificate_must_look_at_stale_events_too() -> None:
    # Disk i waits for an event with k that is stale, as k has collided since. When i looks around again, k or a third
    # disk may have flown past the place where they met, on a flight that is over by then. In this gas some windows are
    # wrong although all collisions in them are certain: a certificate that is asked only after collisions misses them.
    windows = windows_of(gas_of(36, 0.3, 0.8, seed=1), warm_up=10, windows=40, bare=True)
    missed = [window for window in windows if window.wrong and not window.marks.any(stale=False)]
    assert len(missed) > 0
    assert all(window.marks.stale > 0 for window in missed)
