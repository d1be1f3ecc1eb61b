"""Trajectories and their views open, unmodified, in other people's tools, and show every number as it is stored."""

from __future__ import annotations

import json
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, add_series, some_disks, some_state, write

import ifrdem
from ifrdem.case.case import UNITS
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.trajectory.export import export
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.views import write_views

# Packages of others warn of each other's and Python's future; that is theirs.
pytestmark = pytest.mark.filterwarnings("ignore")
N, FRAMES = 40, 5
PRECISIONS = [("f32", np.float32, "none"), ("f64", np.float64, "gzip")]


@pytest.fixture(scope="module", params=PRECISIONS, ids=["f32", "f64 gzip"])
def viewed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, type]:
    """A trajectory with its views, moved together after they were written, and the type of its floats."""
    made = tmp_path_factory.mktemp("made")
    precision, dtype, compression = request.param
    write(made / "run.h5", n=N, frames=FRAMES, precision=precision, compression=compression)
    add_series(made / "run.h5")
    write_views(made / "run.h5")
    moved = made.with_name(f"{made.name}-moved")
    made.rename(moved)
    return moved / "run.h5", dtype


def stored(name: str, frame: int, dtype: type) -> np.ndarray:
    """Expected values of a field at a frame; vectors with z = 0."""
    value = getattr(some_state(N, frame), "spin" if name == "angular_velocity" else name)
    value = value.astype(dtype) if value.dtype.kind == "f" else value
    return np.column_stack([value, np.zeros(N, value.dtype)]) if value.ndim == 2 else value


def test_mdanalysis_reads_positions_and_velocities(viewed):
    import MDAnalysis

    path, dtype = viewed
    universe = MDAnalysis.Universe.empty(N, trajectory=True, velocities=True)
    universe.load_new(str(path), format="H5MD", convert_units=False)
    assert len(universe.trajectory) == FRAMES
    for i, step in enumerate(universe.trajectory):
        # MDAnalysis holds coordinates in single precision
        assert np.array_equal(step.positions, stored("position", i, dtype).astype(np.float32))
        assert np.array_equal(step.velocities, stored("velocity", i, dtype).astype(np.float32))
        assert step.time == 0.1 * i
        assert np.allclose(step.dimensions[:2], BOX.lengths)


def test_a_trajectory_is_a_universe_of_mdanalysis(viewed):
    path, dtype = viewed
    with Trajectory(path) as trajectory:
        universe, disks = trajectory.universe(), trajectory.disks
    assert len(universe.trajectory) == FRAMES
    assert np.array_equal(universe.atoms.masses, disks.mass)
    assert np.array_equal(universe.atoms.radii, disks.radius)
    assert universe.atoms.types.tolist() == [str(one) for one in disks.material]
    for i, step in enumerate(universe.trajectory):
        assert np.array_equal(universe.atoms.positions, stored("position", i, dtype).astype(np.float32))
        assert np.array_equal(universe.atoms.velocities, stored("velocity", i, dtype).astype(np.float32))
        assert np.allclose(step.dimensions[:2], BOX.lengths)


@pytest.mark.parametrize("shear", [0.0, 0.7])
def test_freud_takes_frames_as_systems(tmp_path, shear):
    """Its neighbours are those of minimum images, in a sheared box too, at any time."""
    import freud

    box = Box((30.0, 20.0), shear_rate=shear)
    write(tmp_path / "run.h5", n=N, frames=FRAMES, box=box, precision="f64")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        for frame in trajectory:
            expected = np.linalg.norm(
                box.minimum_image(frame.position[:, None] - frame.position[None], frame.time), axis=-1
            )
            for system in (frame, (frame.box, frame.points)):
                query = freud.locality.AABBQuery.from_system(system)
                found = query.query(query.points, {"r_max": 4.0, "exclude_ii": True}).toNeighborList()
                assert len(found) == np.count_nonzero((expected < 4.0) & (expected > 0.0))
                i, j = found[:].T
                # freud computes in single precision
                assert np.allclose(found.distances, expected[i, j], atol=1e-4)
            freud.density.RDF(10, 4.0).compute(frame)
    write(tmp_path / "open.h5", box=Box.open())
    with (
        Trajectory(tmp_path / "open.h5") as trajectory,
        pytest.raises(InputError, match="an open box has no sides"),
    ):
        freud.locality.AABBQuery.from_system(trajectory[0])


def test_pyh5md_reads_every_field(viewed):
    import pyh5md

    path, dtype = viewed
    with pyh5md.File(str(path), "r") as file:
        group = file.particles_group("all")
        for name in FIELDS:
            element = pyh5md.element(group, name)
            assert len(element.value) == FRAMES
            for i in range(FRAMES):
                assert np.array_equal(element.value[i], stored(name, i, dtype))
            assert np.array_equal(element.time, [0.1 * i for i in range(FRAMES)])


def test_vtk_reads_every_step(viewed):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    path, dtype = viewed
    reader = vtkHDFReader()
    reader.SetFileName(str(path.with_suffix(".vtkhdf")))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == FRAMES
    for i in (*range(FRAMES), 1):  # and back again
        reader.SetStep(i)
        reader.Update()
        assert reader.GetTimeValue() == 0.1 * i
        data = reader.GetOutput()
        assert data.IsA("vtkPolyData")
        assert data.GetNumberOfVerts() == data.GetNumberOfPoints() == N
        assert np.array_equal(vtk_to_numpy(data.GetPoints().GetData()), stored("position", i, dtype))
        arrays = data.GetPointData()
        for name in FIELDS:
            if name != "position":
                assert np.array_equal(vtk_to_numpy(arrays.GetArray(name)), stored(name, i, dtype)), name
        with Trajectory(path) as trajectory:
            assert np.array_equal(vtk_to_numpy(arrays.GetArray("radius")), trajectory.disks.radius)
            assert np.array_equal(vtk_to_numpy(arrays.GetArray("material")), trajectory.disks.material)
        assert np.array_equal(vtk_to_numpy(arrays.GetArray("id")), np.arange(N))


def test_every_reader_and_export_has_the_species(tmp_path):
    """MDAnalysis got materials in their place, and tables none; here no species has the number of its material."""
    import ase.io
    import gsd.hoomd
    import pyh5md
    import xarray
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    numbers, path = {"light": 10, "heavy": N - 10}, tmp_path / "run.h5"
    record = [{"name": name, "number": number} for name, number in numbers.items()]
    parameters = {"species": json.dumps(record), "materials": json.dumps(["a", "b", "c"])}
    write(path, n=N, frames=2, parameters=parameters)
    write_views(path)
    number, names = np.repeat([0, 1], [10, N - 10]), np.repeat(["light", "heavy"], [10, N - 10])
    disks = some_disks(N)
    assert not np.array_equal(disks.material, number)
    with pyh5md.File(str(path), "r") as file:
        assert np.array_equal(pyh5md.element(file.particles_group("all"), "species").value[()], number)
    reader = vtkHDFReader()
    reader.SetFileName(str(path.with_suffix(".vtkhdf")))
    reader.Update()
    assert np.array_equal(vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("species")), number)
    with xarray.open_dataset(path.with_suffix(".nc"), engine="netcdf4") as data:
        assert np.array_equal(data.species, number)
    with Trajectory(path) as run:
        assert run.universe().atoms.types.tolist() == names.tolist()
        assert np.array_equal(run.to_pandas("frame").species, number)
        assert np.array_equal(run.to_pandas("frame").k, disks.k)
        assert np.array_equal(run.to_xarray().disk_species, number)
        assert run.constants("species", slice(8, 12)).tolist() == [0, 0, 1, 1]
        for to in ("csv", "extxyz", "gsd", "h5"):
            export(run, tmp_path / f"new.{to}", to, [1])
    rows = np.genfromtxt(tmp_path / "new.csv", delimiter=",", names=True)
    assert np.array_equal(rows["species"], number)
    assert np.array_equal(rows["k"], disks.k)
    assert np.array_equal(rows["material"], disks.material)
    atoms = ase.io.read(tmp_path / "new.extxyz", format="extxyz")
    assert atoms.get_array("kind").tolist() == names.tolist()
    with gsd.hoomd.open(str(tmp_path / "new.gsd")) as file:
        assert np.array_equal(np.array(file[0].particles.types)[file[0].particles.typeid], names)
    with Trajectory(tmp_path / "new.h5") as run:
        assert np.array_equal(run.constants("species"), number)
    with h5py.File(tmp_path / "new.h5", "r+") as file:  # layout 1.5 had materials there
        file["h5md/modules/ifrdem"].attrs["version"] = (1, 5)
        file["particles/all/species"][...] = disks.material
    with Trajectory(tmp_path / "new.h5") as run:
        assert np.array_equal(run.constants("species"), number)
        assert run.constants("species", 12) == 1


@pytest.mark.parametrize("engine", ["netcdf4", "h5netcdf"])
def test_xarray_reads_every_frame(viewed, engine):
    import xarray

    path, dtype = viewed
    with xarray.open_dataset(path.with_suffix(".nc"), engine=engine) as data:
        assert data.attrs["Conventions"] == "AMBER"
        assert data.coordinates.dims == ("frame", "atom", "spatial")
        assert np.array_equal(data.time, [0.1 * i for i in range(FRAMES)])
        names = {"position": "coordinates", "velocity": "velocities"}
        for name in FIELDS:
            for i in range(FRAMES):
                assert np.array_equal(data[names.get(name, name)][i].values, stored(name, i, dtype)), name
        assert data.coordinates.dtype == dtype


@pytest.mark.parametrize("stated", ["SI", "reduced", None])
def test_every_variable_of_netcdf_has_units_and_a_long_name(tmp_path: Path, stated: str | None) -> None:
    units = {
        "time": "s", "cell_lengths": "m", "coordinates": "m", "velocities": "m s-1", "angular_velocity": "rad s-1",
        "radius": "m", "mass": "kg",
    }  # fmt: skip
    write(tmp_path / "run.h5", n=N, frames=2, units=UNITS[stated] if stated else None)
    write_views(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.nc") as file:
        shown = {name: each for name, each in file.items() if isinstance(each, h5py.Dataset)}
        variables = {name: each for name, each in shown.items() if len(each.dims) and not each.is_scale}
        assert {*units, "material", "species", "image", "collisions"} <= set(variables)
        assert all("long_name" in shown[name].attrs for name in ("spatial", "cell_spatial"))
        for name, variable in variables.items():
            assert variable.attrs["long_name"], name
            unit = variable.attrs.get("units", b"").decode()
            other = "degree" if name == "cell_angles" else "1"
            stated_one = {"SI": units.get(name), "reduced": "reduced", None: ""}[stated]
            assert unit == (stated_one if name in units else other), name


def test_ase_reads_every_frame(viewed):
    from ase.io.netcdftrajectory import NetCDFTrajectory

    path, dtype = viewed
    frames = NetCDFTrajectory(str(path.with_suffix(".nc")), "r")
    assert len(frames) == FRAMES
    for i in range(FRAMES):
        atoms = frames[i]
        assert np.array_equal(atoms.positions, stored("position", i, dtype).astype(np.float64))
        assert atoms.pbc.tolist() == [True, True, True]
        assert np.allclose(atoms.cell.lengths(), [30.0, 20.0, 30.0])
        assert np.array_equal(atoms.get_array("collisions"), stored("collisions", i, dtype))
        with Trajectory(path) as trajectory:
            assert np.array_equal(atoms.get_array("radius"), trajectory.disks.radius)
    frames.close()


def test_ovito_reads_every_frame(viewed):
    reason = "ovito is not installed: pip install ovito (250 MB)"
    import_file = pytest.importorskip("ovito.io", reason=reason, exc_type=ImportError).import_file
    path, dtype = viewed
    pipeline = import_file(str(path.with_suffix(".nc")))
    assert pipeline.source.num_frames == FRAMES
    with Trajectory(path) as trajectory:
        disks = trajectory.disks
    for i in (*range(FRAMES), 1):  # and back again
        data = pipeline.compute(i)
        observed = data.particles
        assert np.array_equal(observed["Position"], stored("position", i, dtype))
        assert np.array_equal(observed["Velocity"], stored("velocity", i, dtype))
        assert np.array_equal(observed["collisions"], stored("collisions", i, dtype))
        assert np.array_equal(
            observed["Radius"], disks.radius.astype(np.float32)
        )  # OVITO holds radii in single
        assert np.array_equal(observed["Mass"], disks.mass)
        assert data.attributes["time"] == 0.1 * i
        assert data.cell.pbc == (True, True, True)
        assert np.allclose(np.diag(data.cell[:2, :2]), BOX.lengths)


def test_ovito_s_reader_of_netcdf_finds_its_names(viewed):
    """Also where OVITO is not installed: the names, axes and types that its AMBER reader needs, by netCDF4."""
    import netCDF4

    path, _ = viewed
    with netCDF4.Dataset(path.with_suffix(".nc")) as file:
        assert file.Conventions == "AMBER"
        assert file.ConventionVersion == "1.0"
        assert {name: len(axis) for name, axis in file.dimensions.items()} == {
            "frame": FRAMES, "spatial": 3, "atom": N, "cell_spatial": 3, "cell_angular": 3
        }  # fmt: skip
        assert file["cell_lengths"].dimensions == ("frame", "cell_spatial")
        assert file["cell_lengths"][:].tolist() == [[30.0, 20.0, 30.0]] * FRAMES
        assert (file["cell_angles"][:] == 90.0).all()


def test_views_hold_no_copy_of_the_data(tmp_path):
    n, frames = 20_000, 4
    write(tmp_path / "run.h5", n=n, frames=frames, fields=("position", "velocity"))
    vtkhdf, nc = write_views(tmp_path / "run.h5")
    for place, name in ((vtkhdf, "VTKHDF/Points"), (nc, "coordinates")):
        with h5py.File(place) as file:  # a name without a folder: they can be moved together
            assert {each.file_name for each in file[name].virtual_sources()} == {"run.h5", "."}
        # The positions alone take 640 kB. VTK wants two lists of the cells and ids, 20 bytes a disk.
        assert place.stat().st_size < 30_000 + (20 * n if place.suffix == ".vtkhdf" else 0)


def test_views_show_committed_frames_and_are_replaced(tmp_path):
    path = tmp_path / "run.h5"
    write(path, frames=4)
    with h5py.File(path, "r+") as file:  # as after a kill between the phases: the last frame has no step
        file["particles/all/position/step"].resize(3, axis=0)
    vtkhdf, nc = write_views(path)
    with h5py.File(nc) as file:
        assert file["coordinates"].shape == (3, 5, 3)
        assert np.array_equal(file["coordinates"][2, :, :2], some_state(5, 2).position.astype(np.float32))
    write(path, frames=6, force=True)
    write_views(path)
    with h5py.File(vtkhdf) as file:
        assert file["VTKHDF/Steps"].attrs["NSteps"] == 6
        assert file["VTKHDF/Points"].shape == (30, 3)
    assert sorted(os.listdir(tmp_path)) == ["run.h5", "run.nc", "run.vtkhdf"]


def test_a_view_without_its_trajectory_shows_no_numbers(tmp_path):
    write(tmp_path / "run.h5")
    vtkhdf, nc = write_views(tmp_path / "run.h5")
    (tmp_path / "run.h5").unlink()
    with h5py.File(nc) as file:
        assert np.isnan(file["coordinates"][..., :2]).all()
        assert (file["collisions"][()] == np.iinfo(np.int32).min).all()
    with h5py.File(vtkhdf) as file:
        assert np.isnan(file["VTKHDF/Points"][:, :2]).all()


def test_collisions_per_disk_are_a_second_coordinate_for_xarray(tmp_path):
    import xarray

    disks = ifrdem.Disks(4, mass=1.0, radius=0.5)
    for name, counts in (("a", (0, 2, 6)), ("b", (0, 4, 8))):
        with ifrdem.TrajectoryWriter(tmp_path / f"{name}.h5", disks, Box((30.0, 20.0))) as file:
            for i, count in enumerate(counts):
                state = ifrdem.State(np.full((4, 2), 1.0), np.zeros((4, 2)), np.zeros(4), time=float(i))
                file.write(state, {"collisions": count, "temperature": 1.0 / (1 + i)})
                file.write_series(float(i), {"collisions": count, "temperature": 1.0 / (1 + i)})
    with Trajectory(tmp_path / "a.h5") as trajectory:
        data = trajectory.to_xarray()
        assert data.collisions_per_disk.dims == ("time",)
        assert data.collisions_per_disk.values.tolist() == [
            0.0,
            1.0,
            3.0,
        ]  # two disks to a collision, four in all
        assert data.series_collisions_per_disk.values.tolist() == [0.0, 1.0, 3.0]
    _, nc = write_views(tmp_path / "a.h5")
    with xarray.open_dataset(nc, engine="h5netcdf", decode_times=False) as data:
        assert data.collisions_per_disk.values.tolist() == [0.0, 1.0, 3.0]
    both = ifrdem.concat([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert both.collisions_per_disk.values.tolist() == [0.0, 1.0, 3.0]
    assert both.run.values.tolist() == ["a", "b"]
    # b has 2 and 4 collisions per disk at times 1 and 2: 1 and 3 of them halfway between its rows.
    assert both.time.values.tolist() == [[0.0, 1.0, 2.0], [0.0, 0.5, 1.5]]


@pytest.mark.parametrize("box", [Box((30.0, 20.0), (True, False)), Box.open()], ids=["walls", "open"])
def test_boxes_without_periods_have_no_cell_length(tmp_path, box):
    import netCDF4

    write(tmp_path / "run.h5", box=box)
    _, nc = write_views(tmp_path / "run.h5")
    with netCDF4.Dataset(nc) as file:
        assert file["cell_lengths"][0].tolist() == ([30.0, 0.0, 30.0] if box.periodic[0] else [0.0] * 3)


@pytest.mark.parametrize(
    ("options", "missing"), [({"n": 0}, "disks"), ({"fields": ("velocity",)}, "positions")]
)
def test_files_without_anything_to_show_are_refused(tmp_path, options, missing):
    write(tmp_path / "run.h5", **options)
    with pytest.raises(InputError, match=f"a view requires {missing}, and there are none"):
        write_views(tmp_path / "run.h5")
    assert os.listdir(tmp_path) == ["run.h5"]


def test_quantities_with_other_columns_in_another_file_are_not_joined(tmp_path):
    """Sums of two walls and of three have no common array; the temperature has."""
    disks, box = ifrdem.Disks(4, 1.0, 0.5), Box((30.0, 20.0))
    for name, walls in (("a", 2), ("b", 3)):
        with ifrdem.TrajectoryWriter(tmp_path / f"{name}.h5", disks, box) as file:
            for i in range(2):
                state = ifrdem.State(np.full((4, 2), 1.0), np.zeros((4, 2)), np.zeros(4), time=float(i))
                file.write(state, {"collisions": 2 * i, "temperature": 1.0, "wall_sums": np.ones(walls)})
    joined = ifrdem.concat([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert joined.temperature.values.tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert "wall_sums" not in joined


@pytest.mark.parametrize("ending", [".nc", ".vtkhdf"])
def test_views_replace_views_and_nothing_else(tmp_path: Path, ending: str) -> None:
    """The results of a study are called NAME.nc too."""
    write(tmp_path / "run.h5")
    place = tmp_path / f"run{ending}"
    with h5py.File(place, "w") as file:
        file["coordinates"] = np.ones(3)
    before = place.read_bytes()
    with pytest.raises(InputError, match=f"output .*run{ending}: is no view of a trajectory"):
        write_views(tmp_path / "run.h5")
    assert place.read_bytes() == before
    place.unlink()
    write_views(tmp_path / "run.h5")
    write_views(tmp_path / "run.h5")
