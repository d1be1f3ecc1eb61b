"""Analyses of gases that drift: they subtract the drift, and warn of files that include it in T."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ifrdem import Box, Disks, State, Trajectory, TrajectoryWriter
from ifrdem.analysis import catalogue, result
from ifrdem.plots import temperatures

N, DRIFT = 100, np.array([20.0, 0.0])


def write_drifting(path: Path, *, inside: bool = False, held: bool = False) -> Path:
    """Free flight with T = 1 about a drift, in a box of 1000; T as old files have it, or with momentum that changes."""
    rng = np.random.default_rng(3)
    disks, box = Disks(N, mass=2.0, radius=0.1), Box((1000.0, 1000.0))
    begin, velocity = 1000.0 * rng.random((N, 2)), rng.normal(size=(N, 2))
    velocity -= velocity.mean(axis=0)
    velocity *= np.sqrt(1.0 / np.mean(np.sum(velocity**2, axis=1)))
    with TrajectoryWriter(
        path, disks, box, fields=("position", "velocity", "image"), precision="f64"
    ) as writer:
        for k, time in enumerate(np.linspace(0.0, 10.0, 11)):
            place = begin + (velocity + DRIFT) * time
            image = np.floor(place / box.lengths)
            totals: dict[str, Any] = {
                "temperature": 401.0 if inside else 1.0,
                "rotational_temperature": 0.0,
                "translational_energy": 401.0 * N,
                "collisions": 100 * k,
                "momentum": 2.0 * N * DRIFT * (1.0 + 1e-3 * k * held),
            }
            state = State(
                place - image * box.lengths, velocity + DRIFT, np.zeros(N), time, image=image.astype(np.int32)
            )
            writer.write(state, totals)
    return path


def test_displacements_and_correlations_are_about_the_drift(tmp_path: Path) -> None:
    """<v^2> = 1 and <x^2> = t^2 about it: m v^2 / 2 = 1 with m = 2. In the lab they are 401 times that."""
    with Trajectory(write_drifting(tmp_path / "run.h5")) as run:
        drift = result.drift(run, range(11))
        np.testing.assert_allclose(drift.velocity, DRIFT, rtol=1e-15)
        assert drift.share == pytest.approx(400.0 / 401.0, rel=1e-14)
        msd, vacf = (catalogue.FUNCTIONS[name](run, None) for name in ("msd", "vacf"))
        lag = msd.tables[""]["lag"]
        np.testing.assert_allclose(msd.tables[""]["msd"][1:], lag[1:] ** 2, rtol=1e-9)
        np.testing.assert_allclose(vacf.tables[""]["vacf"], 1.0, rtol=1e-11)
        assert all("99.75 % of its kinetic energy" in " ".join(found.notes) for found in (msd, vacf))


def test_a_momentum_that_changes_is_no_drift(tmp_path: Path) -> None:
    """Walls or a medium hold the gas then; nothing is taken off."""
    with Trajectory(write_drifting(tmp_path / "run.h5", held=True)) as run:
        assert not result.drift(run, range(11))
        (msd,) = (catalogue.FUNCTIONS["msd"](run, None),)
        assert msd.tables[""]["msd"][1] == pytest.approx(401.0, rel=0.1)
        assert not any("drift" in note for note in msd.notes)


@pytest.mark.parametrize("inside", [False, True])
def test_a_file_with_the_drift_in_its_temperatures_is_doubted(tmp_path: Path, inside: bool) -> None:
    with Trajectory(write_drifting(tmp_path / "run.h5", inside=inside)) as run:
        found = catalogue.FUNCTIONS["pressure"](run, None)
        assert [("temperatures of this file include it" in warning) for warning in found.warnings] == [
            True
        ] * inside
        assert any("temperatures are relative to its mean velocity" in note for note in found.notes) != inside


def test_theory_of_a_mixture_begins_at_temperatures_about_the_drift(tmp_path: Path) -> None:
    """Velocities (+-1, 0) about a drift of 20: T = m / 2 of each kind, 1/2 and 1; in the lab 200.5 and 401."""
    mass, radius = np.repeat([1.0, 2.0], 4), np.repeat([0.2, 0.3], 4)
    velocity = np.stack((20.0 + np.resize([1.0, -1.0], 8), np.zeros(8)), axis=1)
    position = np.stack((1.0 + np.arange(8), np.ones(8)), axis=1)
    law = {
        "law": "ifr",
        "e_n": 0.9,
        "e_t": -1.0,
        "mu": 0.0,
        "rho": 0.0,
        "sticking": "contact_point",
        "k": 2.0,
    }
    with TrajectoryWriter(
        tmp_path / "run.h5",
        Disks(8, mass=mass, radius=radius),
        Box((10.0, 10.0)),
        parameters={"laws": json.dumps([[law]])},
    ) as writer:
        for k in range(3):
            totals = {
                "temperature": 0.75, "rotational_temperature": 0.0, "collisions": k,
                "momentum": np.array([12.0 * 20.0, 0.0]), "translational_energy": 0.75 * 8 + 0.5 * 12.0 * 400.0,
            }  # fmt: skip
            writer.write(State(position, velocity, np.zeros(8), time=1e-3 * k), totals)
    with Trajectory(tmp_path / "run.h5") as run:
        curves, _, _ = temperatures.theory(run)
    assert curves is not None
    assert curves[1][0] == pytest.approx(0.75, rel=1e-3)  # of all disks; it cools from there
