"""Other programs find the neighbours of the gas, and read its masses, radii, velocities, spins, box and time."""

from __future__ import annotations

import csv
import functools
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import FIELDS, some_disks, some_state, write

from ifrdem.errors import InputError
from ifrdem.initial import from_csv
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.trajectory.export import export
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.views import write_views
from ifrdem.trajectory.writer import TrajectoryWriter

# Packages of others warn of each other's and Python's future; that is theirs.
pytestmark = pytest.mark.filterwarnings("ignore")
N, FRAMES, REACH = 60, 3, 4.0
BOXES = {
    "periodic": Box((30.0, 20.0)),
    "tall": Box((20.0, 30.0)),
    "walls in y": Box((30.0, 20.0), (True, False)),
    "walls in x": Box((30.0, 20.0), (False, True)),
    "closed": Box((30.0, 20.0), (False, False)),
    "open": Box.open(),
    "sheared": Box((30.0, 20.0), shear_rate=9.0),  # the image above is 18 and 36 = 6 further along x
}
Pairs = dict[tuple[int, int], float]


@pytest.fixture(scope="module", params=BOXES)
def written_for_others(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Box]:
    path = tmp_path_factory.mktemp("made") / "run.h5"
    box = BOXES[request.param]
    write(path, n=N, frames=FRAMES, box=box, fields=FIELDS, precision="f64")
    write_views(path)
    with Trajectory(path) as trajectory:
        for to in ("gsd", "extxyz"):
            export(trajectory, path.with_suffix(f".{to}"), to, range(FRAMES))
    return path, box


@functools.cache
def expected(box: Box, frame: int) -> Pairs:
    """Pairs nearer than REACH, i < j, over the images around; each pair is that near once only.

    By definition, the image above a sheared box is shear_rate Ly t further along x.
    """
    position = some_state(N, frame, box).position
    between, found = position[None] - position[:, None], {}
    for a in (-2, -1, 0, 1, 2) if box.periodic[0] else (0,):
        for b in (-1, 0, 1) if box.periodic[1] else (0,):
            image = np.zeros(2) if box.is_open else np.array([a, b]) * box.lengths
            if box.shear_rate:
                image[0] += b * (9.0 * 20.0 * 0.1 * frame % 30.0)
            distance = np.hypot(*np.moveaxis(between + image, -1, 0))
            for i, j in np.argwhere(np.triu(distance < REACH, 1)).tolist():
                assert (i, j) not in found
                found[i, j] = float(distance[i, j])
    return found


def assert_equal(found: Pairs, box: Box, frame: int, atol: float) -> None:
    wanted = expected(box, frame)
    assert found.keys() == wanted.keys()
    assert np.allclose(list(found.values()), [wanted[pair] for pair in found], rtol=0.0, atol=atol)


def once(pairs: np.ndarray, distances: np.ndarray) -> Pairs:
    """Pairs with i < j; none may be there twice, nor a disk with itself."""
    found = [(int(i), int(j), float(r)) for (i, j), r in zip(pairs, distances, strict=True) if i <= j]
    assert all(i < j for i, j, _ in found)
    assert len({(i, j) for i, j, _ in found}) == len(found)
    return {(i, j): r for i, j, r in found}


@pytest.mark.full(keep=1)
def test_mdanalysis_finds_the_neighbours(written_for_others):
    from MDAnalysis.analysis.rdf import InterRDF
    from MDAnalysis.lib.distances import capped_distance, self_capped_distance, self_distance_array

    path, box = written_for_others
    with Trajectory(path) as trajectory:
        universe = trajectory.universe()
    for frame, step in enumerate(universe.trajectory):
        at = universe.atoms.positions
        assert (step.dimensions is None) == (not any(box.periodic))
        for method in ("bruteforce", "nsgrid", "pkdtree", None):
            pairs, r = self_capped_distance(at, REACH, box=step.dimensions, method=method)
            assert_equal(once(np.sort(pairs, axis=1), r), box, frame, 2e-5)  # single precision
        pairs, r = capped_distance(at, at, REACH, min_cutoff=1e-9, box=step.dimensions)
        assert_equal(once(pairs, r), box, frame, 2e-5)
        r = self_distance_array(at, box=step.dimensions)
        pairs = np.stack(np.triu_indices(N, 1), axis=1)
        assert_equal(once(pairs[r < REACH], r[r < REACH]), box, frame, 2e-5)
    rdf = InterRDF(
        universe.atoms, universe.atoms, nbins=8, range=(0.0, REACH), norm="none", exclusion_block=(1, 1)
    )
    r = np.concatenate([[*expected(box, frame).values()] for frame in range(FRAMES)])
    assert rdf.run().results.count.tolist() == (2 * np.histogram(r, 8, (0.0, REACH))[0]).tolist()


@pytest.mark.full(keep=2)
def test_a_universe_warns_of_walls_next_to_a_periodic_side(written_for_others):
    path, box = written_for_others
    with Trajectory(path) as trajectory, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        trajectory.universe()
    texts = [str(one.message) for one in caught if str(one.message).startswith(str(path))]
    if box.periodic[0] == box.periodic[1]:
        assert texts == []
    else:
        axis, side = ("x", 60) if box.periodic[1] else ("y", 40)
        assert texts[0].startswith(f"{path}: walls along {axis}: MDAnalysis takes all sides as periodic")
        assert f"has {side} there, twice the side" in texts[0]


@pytest.mark.parametrize(("times", "dt"), [((0.0, 0.4, 0.8, 1.2), 0.4), ((0.0, 0.1, 1.0, 10.0), None)])
def test_a_universe_has_the_time_step_of_even_frames(tmp_path, times, dt):
    """Without it MDAnalysis takes 1 for the step, so that lags of all its analyses are wrong."""
    disks, box = Disks(1, 1.0, 0.5), Box((5.0, 5.0))
    with TrajectoryWriter(tmp_path / "a.h5", disks, box) as file:
        for time in times:
            file.write(State([[1.0, 1.0]], [[0.0, 0.0]], [0.0], time))
    with Trajectory(tmp_path / "a.h5") as trajectory, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        universe = trajectory.universe()
        assert [step.time for step in universe.trajectory] == list(times)
        assert universe.trajectory.dt == pytest.approx(dt or 1.0, rel=1e-12)
        said = any("Reader has no dt information" in str(one.message) for one in caught)
        assert said == (dt is None)


@pytest.mark.parametrize("kind", ["extxyz", "nc"])
def test_ase_finds_the_neighbours(written_for_others, kind):
    import ase.io
    from ase.neighborlist import neighbor_list

    path, box = written_for_others
    form = "netcdftrajectory" if kind == "nc" else "extxyz"
    for frame in range(FRAMES):
        atoms = ase.io.read(path.with_suffix(f".{kind}"), index=frame, format=form)
        assert atoms.pbc.tolist()[:2] == list(box.periodic)
        i, j, r = neighbor_list("ijd", atoms, REACH)
        assert_equal(once(np.stack([i, j], axis=1), r), box, frame, 1e-9)


@pytest.mark.parametrize("source", ["gsd", "frame"])
def test_freud_finds_the_neighbours(written_for_others, source):
    import freud
    import gsd.hoomd

    path, box = written_for_others
    if source == "frame" and box.is_open:
        with Trajectory(path) as trajectory, pytest.raises(InputError, match="an open box has no sides"):
            trajectory[0].points  # noqa: B018
        return
    with Trajectory(path) as trajectory, gsd.hoomd.open(str(path.with_suffix(".gsd"))) as file:
        for frame in range(FRAMES):
            system = trajectory[frame] if source == "frame" else file[frame]
            query = freud.locality.AABBQuery.from_system(system)
            near = query.query(query.points, {"r_max": REACH, "exclude_ii": True}).toNeighborList()
            assert_equal(once(near[:], near.distances), box, frame, 2e-5)  # single precision


def test_vtk_finds_the_neighbours_within_the_box(written_for_others):
    """VTK knows no box: its neighbours are those without images."""
    from vtkmodules.vtkCommonCore import vtkIdList
    from vtkmodules.vtkCommonDataModel import vtkStaticPointLocator
    from vtkmodules.vtkIOHDF import vtkHDFReader

    path, _ = written_for_others
    reader = vtkHDFReader()
    reader.SetFileName(str(path.with_suffix(".vtkhdf")))
    reader.UpdateInformation()
    reader.SetStep(1)
    reader.Update()
    locator, near = vtkStaticPointLocator(), vtkIdList()
    locator.SetDataSet(reader.GetOutput())
    locator.BuildLocator()
    position = some_state(N, 1, written_for_others[1]).position
    for i in range(N):
        locator.FindPointsWithinRadius(REACH, (*position[i], 0.0), near)
        found = {near.GetId(k) for k in range(near.GetNumberOfIds())}
        assert found == set(np.flatnonzero(np.hypot(*(position - position[i]).T) < REACH).tolist())


@pytest.mark.parametrize("kind", ["nc", "extxyz", "gsd"])
def test_ovito_finds_the_neighbours(written_for_others, kind):
    reason = "ovito is not installed: pip install ovito (250 MB)"
    io = pytest.importorskip("ovito.io", reason=reason, exc_type=ImportError)
    from ovito.modifiers import CoordinationAnalysisModifier, CreateBondsModifier, VoronoiAnalysisModifier

    path, box = written_for_others
    for frame in range(FRAMES):
        wanted = expected(box, frame)
        counts = np.bincount(np.array([*wanted], dtype=int).reshape(-1), minlength=N)
        pipeline = io.import_file(str(path.with_suffix(f".{kind}")))
        pipeline.modifiers.append(CoordinationAnalysisModifier(cutoff=REACH, number_of_bins=10))
        pipeline.modifiers.append(CreateBondsModifier(cutoff=REACH))
        data = pipeline.compute(frame)
        assert np.array_equal(data.particles["Coordination"], counts)
        assert data.particles.bonds.count == len(wanted)
        assert data.cell is None or bool(data.cell.is2D) == (kind == "gsd")
        if (
            box.periodic == (True, True) and kind != "gsd"
        ):  # the areas of all cells are that of the box; z has its length
            pipeline.modifiers.append(VoronoiAnalysisModifier())
            data = pipeline.compute(frame)
            volume = data.particles["Atomic Volume"][...].sum()
            assert volume / data.cell[2, 2] == pytest.approx(600.0, rel=1e-6)


def from_extxyz(path: Path, frame: int) -> dict:
    import ase.io

    atoms = ase.io.read(path.with_suffix(".extxyz"), index=frame, format="extxyz")
    return {
        "mass": atoms.get_masses(), "radius": atoms.get_array("radius"), "velocity": atoms.get_velocities()[:, :2],
        "spin": atoms.get_array("angular_velocity"), "time": atoms.info["time"],
        "lengths": None if not atoms.cell.any() else (atoms.cell[0, 0], atoms.cell[1, 1]), "periodic": atoms.pbc[:2],
    }  # fmt: skip


def from_nc_by_ase(path: Path, frame: int) -> dict:
    """As the manual says: ASE's reader of AMBER files knows no masses."""
    import ase.io

    atoms = ase.io.read(path.with_suffix(".nc"), index=frame, format="netcdftrajectory")
    assert set(atoms.get_chemical_symbols()) == {"X"}
    velocities = atoms.get_velocities()
    atoms.set_masses(atoms.get_array("mass"))
    atoms.set_velocities(velocities)
    return {
        "mass": atoms.get_masses(), "radius": atoms.get_array("radius"), "velocity": atoms.get_velocities()[:, :2],
        "spin": atoms.get_array("angular_velocity"), "time": atoms.info["time"], "periodic": atoms.pbc[:2],
    }  # fmt: skip


def from_nc_by_xarray(path: Path, frame: int) -> dict:
    import xarray

    with xarray.open_dataset(path.with_suffix(".nc"), engine="netcdf4", decode_times=False) as data:
        at = data.isel(frame=frame)
        return {
            "mass": at.mass.values, "radius": at.radius.values, "velocity": at.velocities.values[:, :2],
            "spin": at.angular_velocity.values, "time": float(at.time), "periodic": at.cell_lengths.values[:2] > 0.0,
        }  # fmt: skip


def from_gsd(path: Path, frame: int) -> dict:
    import gsd.hoomd

    with gsd.hoomd.open(str(path.with_suffix(".gsd"))) as file:
        at = file[frame]
        angmom, inertia = at.particles.angmom[:, 3], at.particles.moment_inertia[:, 2]
        assert np.allclose(0.5 * angmom / inertia, at.log["particles/angular_velocity"], rtol=1e-6)
        return {
            "mass": at.particles.mass, "radius": 0.5 * at.particles.diameter,
            "velocity": at.particles.velocity[:, :2], "spin": at.log["particles/angular_velocity"],
            "time": at.log["time"][0], "cell": at.configuration.box[:2],
        }  # fmt: skip


def from_a_universe(path: Path, frame: int) -> dict:
    with Trajectory(path) as trajectory:
        universe = trajectory.universe()
    step = universe.trajectory[frame]
    cell = {} if step.dimensions is None else {"cell": step.triclinic_dimensions.diagonal()[:2]}
    return {
        "mass": universe.atoms.masses, "radius": universe.atoms.radii, "velocity": step.velocities[:, :2],
        "time": step.time, **cell,
    }  # fmt: skip


def from_vtkhdf(path: Path, frame: int) -> dict:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path.with_suffix(".vtkhdf")))
    reader.UpdateInformation()
    reader.SetStep(frame)
    reader.Update()
    arrays = reader.GetOutput().GetPointData()
    mass, radius, velocity, spin = (
        vtk_to_numpy(arrays.GetArray(name)).copy() for name in ("mass", "radius", "velocity", "angular_velocity")
    )  # fmt: skip
    return {
        "mass": mass, "radius": radius, "velocity": velocity[:, :2], "spin": spin, "time": reader.GetTimeValue()
    }  # fmt: skip


def from_csv_rows(path: Path, frame: int) -> dict:
    with Trajectory(path) as trajectory:
        export(trajectory, path.with_suffix(".csv"), "csv", [frame])
    with path.with_suffix(".csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    def column(name: str) -> list[float]:
        return [float(row[name]) for row in rows]

    return {
        "mass": column("mass"), "radius": column("radius"), "spin": column("angular_velocity"),
        "velocity": np.column_stack([column("velocity_x"), column("velocity_y")]), "time": float(rows[0]["time"]),
    }  # fmt: skip


def from_h5(path: Path, frame: int) -> dict:
    """The frames in other order of layouts: exported, and repaired."""
    whole = path.with_name("whole.h5")
    with Trajectory(path) as trajectory:
        export(trajectory, whole, "h5", range(FRAMES))
    with Trajectory(whole) as trajectory:
        at = trajectory[frame]
        return {
            "mass": trajectory.disks.mass, "radius": trajectory.disks.radius, "velocity": at.velocity,
            "spin": at.spin, "time": at.time, "lengths": None if trajectory.box.is_open else trajectory.box.lengths,
            "periodic": trajectory.box.periodic,
        }  # fmt: skip


READERS = {
    each.__name__: each
    for each in (
        from_extxyz, from_nc_by_ase, from_nc_by_xarray, from_gsd, from_a_universe, from_vtkhdf, from_csv_rows, from_h5,
    )
}  # fmt: skip


@pytest.mark.full(keep=14)
@pytest.mark.parametrize("reader", READERS)
def test_masses_radii_motion_box_boundary_and_time_come_back(written_for_others, reader):
    path, box = written_for_others
    disks, state = some_disks(N), some_state(N, 2, box)
    found = READERS[reader](path, 2)
    single = reader in ("from_gsd", "from_a_universe")
    assert {"mass", "radius", "velocity", "time"} <= found.keys()
    for name, value in (
        ("mass", disks.mass), ("radius", disks.radius), ("velocity", state.velocity), ("spin", state.spin),
        ("time", 0.2),
    ):  # fmt: skip
        if name in found:  # ASE divides momenta by masses: two roundings
            assert np.allclose(found[name], value, rtol=1e-6 if single else 3e-16, atol=0.0), name
    if "lengths" in found:
        assert found["lengths"] is None if box.is_open else tuple(found["lengths"]) == box.lengths
    if "periodic" in found:
        assert list(found["periodic"]) == list(box.periodic)
    if "cell" in found and not box.is_open:  # a side between walls is twice as long
        sides = [
            side if periodic else 2.0 * side for side, periodic in zip(box.lengths, box.periodic, strict=True)
        ]
        assert np.allclose(found["cell"], sides)


def test_immovable_disks_come_back_from_extxyz_at_rest(tmp_path):
    import ase.io

    from ifrdem.model.state import Disks, State
    from ifrdem.trajectory.writer import TrajectoryWriter

    with TrajectoryWriter(tmp_path / "run.h5", Disks(2, [np.inf, 2.0], 0.5), BOXES["periodic"]) as writer:
        writer.write(State([[1.0, 1.0], [3.0, 3.0]], [[0.0, 0.0], [1.0, 2.0]], np.zeros(2)))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        export(trajectory, tmp_path / "run.extxyz", "extxyz", [0])
    atoms = ase.io.read(tmp_path / "run.extxyz", format="extxyz")
    assert atoms.get_masses().tolist() == [np.inf, 2.0]
    assert atoms.get_velocities().tolist() == [[0.0, 0.0, 0.0], [1.0, 2.0, 0.0]]


def test_edges_are_absent_without_a_periodic_side_and_pyh5md_reads_both(written_for_others):
    """H5MD 1.1: "If all values in boundary are none, edges may be omitted"; else those of a side of none are placeholders."""
    import pyh5md

    path, box = written_for_others
    with h5py.File(path) as file:
        group = file["particles/all"]
        assert list(group["box"].attrs["boundary"]) == [
            *(b"periodic" if one else b"none" for one in box.periodic), b"none"
        ]  # fmt: skip
        assert h5py.check_string_dtype(group["box"].attrs.get_id("boundary").dtype).length is not None
        assert ("edges" in group["box"]) == any(box.periodic)
        clock = group["box/edges"] if any(box.periodic) else file["frames"]
        assert group["position/step"] == clock["step"]  # the same object, not an equal one
        assert len(clock["step"]) == FRAMES
        if any(box.periodic):
            assert group["box/edges/value"].shape == (FRAMES, 3, 3)
    with pyh5md.File(str(path), "r") as file:
        group = file.particles_group("all")
        assert np.array_equal(
            pyh5md.element(group, "position").value[2, :, :2], some_state(N, 2, box).position
        )
        if any(box.periodic):
            assert pyh5md.element(group["box"], "edges").value.shape == (FRAMES, 3, 3)


@pytest.mark.parametrize("name", ["walls in y", "closed", "open", "sheared"])
def test_files_of_layout_1_3_open_and_export_rewrites_them(tmp_path, name):
    """Up to 1.3 edges were three lengths, always there (infinite ones in an open box), and z was 1."""
    path, box, edges = tmp_path / "run.h5", BOXES[name], "particles/all/box/edges"
    write(path, n=5, frames=FRAMES, box=box)
    with h5py.File(path, "r+") as file:
        if edges in file:
            del file[f"{edges}/value"]
        else:
            file[edges] = file["frames"]
            del file["frames"]
        old = np.tile([*box.lengths, 1.0], (FRAMES, 1))
        file.create_dataset(f"{edges}/value", data=old, maxshape=(None, 3), chunks=(64, 3))
        attributes = file["particles/all/box"].attrs
        attributes["boundary"] = [one.decode() for one in attributes["boundary"]]
        file["h5md/modules/ifrdem"].attrs["version"] = np.array((1, 3), dtype=np.int32)
    with Trajectory(path) as trajectory:
        assert trajectory.box == box
        assert trajectory.times.tolist() == [0.0, 0.1, 0.2]
        assert np.array_equal(trajectory[1].spin, some_state(5, 1).spin.astype(np.float32))
        with pytest.warns(UserWarning, match=r"has layout 1\.3: .* writes it in the present layout"):
            trajectory.universe()
        export(trajectory, tmp_path / "exported.h5", "h5", range(FRAMES))
    write(tmp_path / "new.h5", n=5, frames=FRAMES, box=box)
    with h5py.File(tmp_path / "exported.h5") as file, h5py.File(tmp_path / "new.h5") as new:
        assert ("frames" in file) == (edges not in file) == (not any(box.periodic))
        if any(box.periodic):
            assert np.array_equal(file[f"{edges}/value"], new[f"{edges}/value"])
    with Trajectory(tmp_path / "exported.h5") as trajectory:
        assert trajectory.box == box


# --- the CSV of `ifrdem export` is a start file


@pytest.mark.parametrize("name", ["periodic", "walls in y", "closed", "open"])
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_an_exported_frame_is_a_start_file(tmp_path, name, precision):
    box, dtype = BOXES[name], {"f32": np.float32, "f64": np.float64}[precision]
    fields = (*FIELDS, "angle", "dissipated", "last_partner")
    write(tmp_path / "run.h5", n=N, frames=2, box=box, fields=fields, precision=precision)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        export(trajectory, tmp_path / "start.csv", "csv", [1])
    found, state = from_csv.read(tmp_path / "start.csv", N, box), some_state(N, 1, box)
    assert found.velocity is not None
    assert found.spin is not None
    for given, wanted in (
        (found.position, state.position),
        (found.velocity, state.velocity),
        (found.spin, state.spin),
    ):
        assert np.array_equal(given.astype(dtype), wanted.astype(dtype))


def test_exports_that_are_no_start_are_refused(tmp_path):
    path = tmp_path / "start.csv"
    write(tmp_path / "run.h5", n=4, frames=2)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        export(trajectory, path, "csv", [0, 1])
    with pytest.raises(InputError, match=r"has 8 disks: must be 4, .* --frames=-1"):
        from_csv.read(path, 4)
    with pytest.raises(InputError, match=r"line 6: id = 0: must be 4: rows are in the order of the species"):
        from_csv.read(path, 8)
    lines = path.read_text().splitlines()[:5]
    path.write_text("\n".join([lines[0], *lines[:0:-1]]) + "\n")  # sorted otherwise
    with pytest.raises(InputError, match=r"line 2: id = 3: must be 0"):
        from_csv.read(path, 4)
    with pytest.raises(InputError, match="cannot start a sheared box"):
        from_csv.read(path, 4, BOXES["sheared"])
    path.write_text("x,y,frame\n1,1,0\n")  # a column that an export has, in another file
    with pytest.raises(InputError, match="unknown column 'frame'"):
        from_csv.read(path, 1)
