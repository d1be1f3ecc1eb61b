"""Each dataset of a trajectory says what it holds and in which unit."""

from __future__ import annotations

import json
import shutil

import h5py
import numpy as np
import pytest
from support.cases import case_text
from support.layout_files import BOX, some_disks, some_state
from support.manual import block

import ifrdem
from ifrdem.trajectory.descriptions import unit_of
from ifrdem.trajectory.layout import FIELDS

SI = {"length": "m", "mass": "kg", "time": "s", "energy": "J", "momentum": "kg m s-1", "velocity": "m s-1",
      "angular_velocity": "rad s-1", "force": "N", "angle": "rad"}  # fmt: skip
CASE = case_text({
    "run.t_end": 0.2, "run.units": "SI", "box.lengths": [30.0, 20.0], "box.periodic": [True, False],
    "box.material": "a", "box.packing_fraction": None,
    "species": [
        {"name": "small", "number": 12, "material": "b", "mass": 1.0, "radius": 0.2, "speed_rms": 10.0},
        {"name": "large", "number": 8, "material": "a", "mass": 4.0, "radius": 0.4, "speed_rms": 5.0},
    ],
    "material": [
        {"name": "a", "e_n": 0.9, "e_t": -0.5, "mu": 0.1},
        {"name": "b", "e_n": 0.8, "e_t": -0.5, "mu": 0.1},
    ],
    "pair": [{"materials": ["a", "b"], "e_n": 0.8, "e_t": -0.5, "mu": 0.1}],
    "output": {
        "frames": 2, "series": 5, "histories": [0, 3], "stress": True, "wall_sums": True,
        "fields": ["position", "velocity", "angle", "angular_velocity", "collisions", "image", "last_partner", "dissipated"],
    },
})  # fmt: skip


def datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Every dataset by each of its names, without the record of the run."""
    found = {}

    def visit(group: h5py.Group, path: str) -> None:
        for name, each in group.items():
            if isinstance(each, h5py.Group):
                visit(each, f"{path}{name}/")
            else:
                found[f"{path}{name}"] = each

    visit(file, "")
    return {name: each for name, each in found.items() if not name.startswith("parameters/")}


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    folder = tmp_path_factory.mktemp("described")
    (folder / "gas.toml").write_text(CASE)
    case = ifrdem.Case.read(folder / "gas.toml")
    case.run_to(folder / "gas.h5")
    return folder / "gas.h5"


@pytest.mark.full
def test_each_dataset_of_a_run_has_units_and_a_description(described):
    with h5py.File(described) as file:
        found = datasets(file)
        assert len(found) > 80
        for name, dataset in found.items():
            assert dataset.attrs["description"], name
            assert dataset.attrs["units"] not in (b"", b"not stated"), name
            assert "unit" not in dataset.attrs, name  # MDAnalysis would refuse the file
        units = {name: dataset.attrs["units"].decode() for name, dataset in found.items()}
    # By hand: stress in two dimensions is a force per length, angular momentum N m s.
    assert units["particles/all/position/value"] == units["particles/all/radius"] == "m"
    assert units["particles/all/box/edges/step"] == units["particles/all/k"] == "1"
    assert units["timeseries/stress/value"] == "J m-2"
    assert units["timeseries/walls_torque/value"] == "J s"
    assert units["histories/events/impulse"] == "kg m s-1"
    assert units["observables/temperature/value"] == units["particles/all/dissipated/value"] == "J"


@pytest.mark.full
def test_the_example_of_the_manual_prints_a_description(described, tmp_path, monkeypatch, capsys):
    shutil.copy(described, tmp_path / "cooling.h5")
    monkeypatch.chdir(tmp_path)
    exec(compile(block("describe-python"), "format.md", "exec"), {})
    assert capsys.readouterr().out == "angular velocities, counter-clockwise [ rad s-1 ]\n"


@pytest.mark.full
def test_species_are_not_materials(described):
    with h5py.File(described) as file:
        particles = file["particles/all"]
        assert particles["species"][:].tolist() == [0] * 12 + [1] * 8
        names = [one["name"] for one in json.loads(file["parameters/species"].asstr()[()])]
        assert names == ["small", "large"]
        materials = json.loads(file["parameters/materials"].asstr()[()])
        assert [materials[i] for i in particles["material"][:]] == ["b"] * 12 + ["a"] * 8


@pytest.mark.parametrize("number", [1, 2, 7])
def test_parts_have_the_species_of_their_disks(tmp_path, number):
    disks, species = some_disks(20), [{"name": "a", "number": 13}, {"name": "b", "number": 7}]
    parameters = {"species": json.dumps(species)}
    path = tmp_path / "gas.h5"
    with ifrdem.PartsWriter.create(path, disks, disks, BOX, number=number, parameters=parameters) as file:
        file.write(some_state(20, 1), {"temperature": 0.25})
    with h5py.File(path) as file:
        assert file["particles/all/species"][:].tolist() == [0] * 13 + [1] * 7
        assert all(each.attrs["description"] and each.attrs["units"] for each in datasets(file).values())
    for part in range(number):
        with h5py.File(tmp_path / f"gas.parts/{part:04d}.h5") as file:
            held = file["particles/all/species"]
            first = file["part"].attrs["first"]
            assert held[:].tolist() == [int(first + i >= 13) for i in range(len(held))]
    with ifrdem.Trajectory(path) as trajectory:
        assert trajectory.n == 20
        assert trajectory.constants("species").tolist() == [0] * 13 + [1] * 7
        assert trajectory.constants("species", slice(12, 14)).tolist() == [0, 1]


def test_units_that_are_reduced_or_not_stated_say_so(tmp_path):
    for units, length in (({}, b"not stated"), ({"length": "reduced", "mass": "reduced"}, b"reduced")):
        path = tmp_path / f"{len(units)}.h5"
        with ifrdem.TrajectoryWriter(path, some_disks(4), BOX, fields=[*FIELDS][:3], units=units) as file:
            file.write(some_state(4, 1), {"temperature": 0.25, "my own": np.arange(3.0)})
        with h5py.File(path) as file:
            assert file["particles/all/radius"].attrs["units"] == length
            assert file["particles/all/k"].attrs["units"] == b"1"
            assert file["observables/my own/value"].attrs["units"] == b"not stated"
            assert b"my own" in file["observables/my own/value"].attrs["description"]


def test_units_of_products_and_of_quantities_in_terms_of_others():
    assert unit_of("energy length-2", SI) == "J m-2"
    assert unit_of("velocity", {"length": "mm", "time": "ms"}) == "mm ms-1"
    assert unit_of("energy", {"length": "mm", "time": "ms", "mass": "g"}) == "g mm2 ms-2"
    assert unit_of("energy", {"length": "mm"}) is None
    assert unit_of("radian", {}) == "rad"
