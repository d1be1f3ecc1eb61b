"""Temperatures and collisions of species: by the engine, by NumPy, and as series of a run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import mpi

import ifrdem

SPECIES = {"light": 300, "heavy": 200}


def two_species(**options: Any) -> ifrdem.Simulation:
    mass, radius = np.repeat([1.0, 4.0], [300, 200]), np.repeat([0.5, 0.8], [300, 200])
    disks = ifrdem.Disks(500, mass, radius, species=options.pop("species", SPECIES))
    box = options.pop("box", ifrdem.Box((60.0, 60.0)))
    position = ifrdem.initial.random_positions(box, radius, seed=1, walls=options.get("walls", ()))
    velocity = ifrdem.initial.maxwellian(mass, temperature=1.0, seed=1) + options.pop("drift", np.zeros(2))
    start = ifrdem.State(position, velocity, ifrdem.initial.gaussian_spins(500, spin_rms=1.0, seed=2))
    law = ifrdem.IFRLaw(e_n=0.8, e_t=-0.5, mu=0.3)
    return ifrdem.Simulation(disks, box, law, start, **options)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("options", [
    {},
    {"drift": np.array([20.0, -7.0])},
    {"box": ifrdem.Box((60.0, 60.0), shear_rate=0.1)},
    {"box": ifrdem.Box((60.0, 60.0), periodic=(True, False))},
], ids=["periodic", "drift", "sheared", "walls"])  # fmt: skip
def test_sums_over_a_species(options: dict[str, Any]) -> None:
    """Sums in the kernel are those of NumPy over its disks, written out here."""
    simulation, frames = two_species(**options), []
    callbacks = [lambda state, measure: frames.append((state, measure))]
    simulation.run(collisions_per_disk=2.0, frames=2, frame_callbacks=callbacks)
    found, state, disks = simulation.measure(), simulation.state, simulation.disks
    v = state.peculiar_velocity
    walled = not all(simulation.box.periodic)
    u = np.average(v, axis=0, weights=disks.mass) * (1.0, 0.0 if walled else 1.0)
    if walled:  # friction at walls changes the momentum along them
        u = np.zeros(2)
    for i, own in enumerate((slice(0, 300), slice(300, 500))):
        T = 0.5 * np.mean(disks.mass[own] * np.sum((v[own] - u) ** 2, axis=1))
        T_rot = np.mean(disks.inertia[own] * state.spin[own] ** 2)
        assert found.species_temperature[i] == pytest.approx(T, rel=1e-9)
        assert found.species_rotational_temperature[i] == pytest.approx(T_rot, rel=1e-9)
        assert found.species_collisions[i] == state.collisions[own].sum()
    mean = np.array([0.6, 0.4]) @ found.species_temperature
    assert mean == pytest.approx(found.temperature, rel=1e-9)
    assert found.species_collisions.sum() == 2 * found.collisions
    for then, measured in ((state, found), *frames):  # in the middle of the run, too
        by_numpy = ifrdem.observables.measure(disks, then, about_mean=(not walled, not walled))
        for name in ("species_temperature", "species_rotational_temperature", "species_collisions"):
            assert getattr(by_numpy, name) == pytest.approx(getattr(measured, name), rel=1e-9)


@pytest.mark.parametrize(("species", "message"), [
    ({"light": 300}, "must add up to 500 disks"),
    ({1: 500}, "key of species = 1: must be a name"),
    ({"": 500}, "a name is '': must be a text"),
    ({"light": -1, "heavy": 501}, "species\\['light'\\] = -1"),
    ([300, 200], "species = \\[300, 200\\]: must be"),
])  # fmt: skip
def test_refusals(species: Any, message: str) -> None:
    with pytest.raises(ifrdem.InputError, match=message):
        two_species(species=species)


CASE = {
    "run": {"name": "two", "collisions_per_disk": 2.0},
    "box": {"packing_fraction": 0.2},
    "material": [{"name": "a", "e_n": 0.8, "e_t": -0.5, "mu": 0.3}],
    "species": [
        {"name": "light", "number": 60, "material": "a", "mass": 1.0, "radius": 0.5, "temperature": 1.0},
        {"name": "heavy", "number": 40, "material": "a", "mass": 4.0, "radius": 0.8, "temperature": 2.0},
    ],
    "output": {"frames": 4, "series": 8},
}


def test_series_of_a_run(tmp_path: Path) -> None:
    """The series has a column of each species by its name."""
    case = ifrdem.Case(**CASE)
    with case.run_to(tmp_path / "two.h5", picture=False) as run:
        series = run.series
        first, last = run[0], run[-1]
        for name, mass, own in (("light", 1.0, slice(60)), ("heavy", 4.0, slice(60, 100))):
            for row, frame in ((0, first), (-1, last)):  # the momentum of the gas is 0
                T = 0.5 * mass * np.mean(np.sum(frame.velocity[own].astype(float) ** 2, axis=1))
                assert series[f"species_temperature/{name}"][row] == pytest.approx(T, rel=1e-5)
        assert series["species_collisions/light"][-1] == last.collisions[:60].sum()
        data = run.to_xarray()
        assert data.series_species_temperature.dims == ("series_time", "species")
        assert list(data.species.values) == ["light", "heavy"]
        assert json.loads(run.parameters["species"])[1]["name"] == "heavy"


def test_species_are_not_added_up_by_the_beginning_of_their_names(tmp_path: Path) -> None:
    """As parts of a wall are, which are numbered."""
    species = [one | {"name": f"light {i} {one['name']}"} for i, one in enumerate(CASE["species"])]  # type: ignore[attr-defined]
    case = ifrdem.Case(**(CASE | {"species": species}))
    with case.run_to(tmp_path / "two.h5", picture=False) as run:
        T = 0.5 * np.mean(np.sum(run[0].velocity[:60].astype(float) ** 2, axis=1))
        assert run.series["species_temperature/light 0 light"][0] == pytest.approx(T, rel=1e-5)
        with pytest.raises(KeyError, match=r"species_temperature.*'light'"):
            run.series["species_temperature/light"]


def test_one_species_has_no_columns(tmp_path: Path) -> None:
    sections = CASE | {"species": CASE["species"][:1]}  # type: ignore[index]
    with ifrdem.Case(**sections).run_to(tmp_path / "one.h5", picture=False) as run:
        assert not [name for name in run.series if name.startswith("species")]


def test_checkpoint_keeps_species(tmp_path: Path) -> None:
    simulation = two_species()
    simulation.run(collisions_per_disk=1.0)
    simulation.save_checkpoint(tmp_path / "gas.h5")
    expected = simulation.measure().species_temperature
    again = ifrdem.Simulation.from_checkpoint(tmp_path / "gas.h5")
    assert again.measure().species_temperature == pytest.approx(expected, rel=1e-13)


@pytest.mark.full
@mpi.needed
def test_series_of_a_run_on_ranks(tmp_path: Path) -> None:
    """Of two ranks, which have a part of each species, the series of one process to rounding of sums."""
    species = [one | {"number": 350 * one["number"]} for one in CASE["species"]]
    text = ifrdem.Case(**CASE | {"species": species, "run": {"name": "two", "t_end": 0.05}}).to_toml()
    (tmp_path / "two.toml").write_text(text)
    words = [sys.executable, "-m", "ifrdem", "run", tmp_path / "two.toml", "--no-picture"]
    done = mpi.on(2, *words, "-o", tmp_path / "ranks.h5")
    assert done.returncode == 0, done.stderr
    subprocess.run([*map(str, words), "-o", str(tmp_path / "one.h5")], check=True, capture_output=True)
    with ifrdem.Trajectory(tmp_path / "ranks.h5") as ranks, ifrdem.Trajectory(tmp_path / "one.h5") as one:
        for name in ("species_temperature", "species_rotational_temperature", "species_collisions"):
            assert ranks.series[name] == pytest.approx(one.series[name], rel=1e-11)
