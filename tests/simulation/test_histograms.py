"""Histograms of collisions that the engine counts, against those made of the histories of all disks."""

from __future__ import annotations

import numpy as np
import pytest
from support.gases import COIN, ROUGH, equal_disks, gas_of, mixture, start

from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.histograms import NAMES, histogram, histogram_edges
from ifrdem.model.state import Disks, State
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of


def by_histories(events, disks, name):
    """Counts of a histogram, shape (pairs, bins), of the events of all disks in order of time: each twice in them."""
    ends = np.cumsum([*disks.species.values()])
    species, other = (np.searchsorted(ends, each, side="right") for each in (events.id, events.partner))
    high, low = np.maximum(species, other), np.minimum(species, other)
    pair, pairs = high * (high + 1) // 2 + low, len(ends) * (len(ends) + 1) // 2
    u = events.velocity_before - events.partner_velocity_before
    since, latest = np.empty(len(events)), np.full(disks.n, np.nan)
    for row, (i, t) in enumerate(zip(events.id, events.time, strict=True)):
        since[row], latest[i] = t - latest[i], t
    values = {
        "impact_angle": events.psi, "normal_speed": np.sum(u * events.normal, axis=1), "free_time": since,
        "regime": events.regime - 1,
    }  # fmt: skip
    counted = (events.partner >= 0) & (
        np.isfinite(since) if name == "free_time" else events.id < events.partner
    )
    edges = histogram_edges(name)
    value = np.clip(values[name], edges[0], np.nextafter(edges[-1], 0.0))
    return np.array([np.histogram(value[counted & (pair == p)], edges)[0] for p in range(pairs)])


@pytest.mark.full(keep=1)
def test_histograms_are_those_of_the_histories_of_all_disks(device):
    """Three pairs of two species of unlike disks between walls, at which free times end; counted from a time on, too."""
    disks = mixture(600)
    disks = Disks(600, disks.mass, disks.radius, disks.k, species={"left": 250, "right": 350})
    box, state = start(disks, 0.4)
    box = Box((box.lengths[0], box.lengths[1] + 1.0), (True, False))
    state = State(state.position + np.array([0.0, 0.5]), state.velocity, state.spin)
    gas = Simulation(disks, box, ROUGH, state, device=device, histories=range(600), record=["free_times"])
    gas.run(collisions_per_disk=4.0)
    before, events = gas.measure(), gas.take_events()
    assert (events.partner < 0).sum() > 20
    for name in NAMES:
        found = histogram(name, before).counts
        assert found.sum() > 1000
        np.testing.assert_array_equal(found, by_histories(events, disks, name), err_msg=name)
    gas.run(collisions_per_disk=6.0)
    later = histogram("regime", gas.measure(), before)
    assert later.total.sum() == gas.collisions - before.collisions


@pytest.mark.full(keep=1)
def test_copies_in_tiles_are_not_counted(device):
    """The counts of a gas in 16 tiles on two threads, whose windows are repeated where a tile missed something."""
    disks = equal_disks(600)
    box, state = start(disks, 0.4)
    found = []
    for options in ({}, {"order": "tiled", "tile_disks": 40}):
        engine = engine_of(
            disks, box, state, np.array([[COIN]]), record=["free_times"], device=device, **options
        )
        while engine.collisions < 2000:
            engine.advance(collisions=2000)
        found.append(engine.histograms)
    assert found[0].sum() == 5 * 2000 - 599  # free times but the first of each disk; one has not collided
    np.testing.assert_array_equal(*found)


def test_a_measure_without_histograms_and_a_later_one_before_are_refused():
    gas = gas_of(20, record=["histograms"])
    measured = gas.measure()
    with pytest.raises(InputError, match="must be later than before"):
        histogram("regime", measured, measured)
    with pytest.raises(InputError, match=r"record=\[\"histograms\"\]"):
        histogram("regime", gas_of(20).measure())
    with pytest.raises(InputError, match=r"record=\[\"free_times\"\]"):
        histogram("free_time", measured)
