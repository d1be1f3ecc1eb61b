"""Copies in the formats of other codes hold the numbers, and open in these codes."""

from __future__ import annotations

import csv
import io
import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from support.layout_files import BOX, some_disks, some_state, write
from test_frame import flip

from ifrdem.cli.main import main
from ifrdem.cli.options import counted, selected_frames
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.tools.progress import time_left
from ifrdem.trajectory.export import export
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter
from ifrdem.viewer.content import Content

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")
N, FRAMES = 30, 6


@pytest.fixture
def three_frames(tmp_path: Path) -> Path:
    write(tmp_path / "run.h5", n=N, frames=FRAMES)
    return tmp_path / "run.h5"


def exported(three_frames: Path, to: str, frames=range(FRAMES)) -> Path:
    place = three_frames.with_suffix(f".{to}")
    with Trajectory(three_frames) as trajectory:
        export(trajectory, place, to, frames)
    return place


def test_gsd_holds_a_gas_in_two_dimensions_about_the_origin(three_frames):
    import gsd.hoomd

    with gsd.hoomd.open(str(exported(three_frames, "gsd", range(0, FRAMES, 2)))) as file:
        assert len(file) == 3
        for snapshot, i in zip(file, (0, 2, 4), strict=True):
            state, disks = some_state(N, i), some_disks(N)
            assert snapshot.configuration.dimensions == 2
            assert snapshot.configuration.step == i
            assert snapshot.configuration.box.tolist() == [*BOX.lengths, 0.0, 0.0, 0.0, 0.0]
            particles = snapshot.particles
            # GSD is in single precision: 2^-24 of half a box, twice
            assert np.allclose(particles.position[:, :2] + [15.0, 10.0], state.position, rtol=0.0, atol=4e-6)
            assert not particles.position[:, 2].any()
            assert np.array_equal(particles.velocity[:, :2], state.velocity.astype(np.float32))
            assert np.array_equal(particles.image[:, :2], state.image)
            assert np.array_equal(particles.diameter, (2.0 * disks.radius).astype(np.float32))
            assert np.array_equal(particles.mass, disks.mass.astype(np.float32))
            assert np.array_equal(particles.typeid, disks.material)
            # I = m R^2 / k about z
            inertia = disks.mass * disks.radius**2 / disks.k
            assert np.allclose(particles.moment_inertia[:, 2], inertia, rtol=1e-6)
            assert np.array_equal(snapshot.log["particles/angular_velocity"], state.spin.astype(np.float32))
            assert snapshot.log["time"] == 0.1 * i


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton's product of quaternions (real, i, j, k), shape (n, 4)."""
    real = a[:, 0] * b[:, 0] - np.sum(a[:, 1:] * b[:, 1:], axis=1)
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.column_stack((real, vector))


def test_gsd_holds_orientations_and_angular_momenta_as_hoomd_defines_them(tmp_path):
    """HOOMD takes from p the momentum L = Im(q* p) / 2 in the axes of the body; of a disk, p = 4 I dq/dt."""
    import gsd.hoomd

    rng = np.random.default_rng(4)
    mass = np.array([1.0, 2.0, 3.0, np.inf, 0.5])
    disks = Disks(5, mass, radius=[0.3, 0.2, 0.4, 0.3, 0.1], k=2.0)
    angle, spin = np.array([0.7, -3.5, 40.0, 0.0, np.pi]), np.array([1.5, -2.0, 0.3, 0.0, -7.0])
    path = tmp_path / "run.h5"
    fields = ("position", "velocity", "angular_velocity", "angle")
    with TrajectoryWriter(path, disks, BOX, fields=fields, precision="f64") as writer:
        writer.write(State(rng.uniform(1.0, 19.0, (5, 2)), np.zeros((5, 2)), spin, angle=angle))
    with gsd.hoomd.open(str(exported(path, "gsd", [0]))) as file:
        particles, log = file[0].particles, file[0].log
    q, p = particles.orientation.astype(float), particles.angmom.astype(float)
    # what q does to the body's x axis: q i q*
    turned = product(product(q, np.tile([0.0, 1.0, 0.0, 0.0], (5, 1))), q * [1.0, -1.0, -1.0, -1.0])
    expected = np.column_stack((np.zeros(5), np.cos(angle), np.sin(angle), np.zeros(5)))
    assert np.allclose(turned, expected, atol=1e-6)  # single precision
    momentum = np.where(np.isfinite(mass), mass, 0.0) * disks.radius**2 / 2.0 * spin
    body = 0.5 * product(q * [1.0, -1.0, -1.0, -1.0], p)
    assert np.allclose(body, np.column_stack((np.zeros((5, 3)), momentum)), atol=1e-6)

    def orientation(t):
        half = 0.5 * (angle + spin * t)
        return np.column_stack((np.cos(half), np.zeros((5, 2)), np.sin(half)))

    movable = np.isfinite(mass)
    rate = (orientation(1e-5) - orientation(-1e-5)) / 2e-5
    assert np.allclose(p[movable], 4.0 * disks.inertia[movable, None] * rate[movable], atol=1e-6)
    assert np.array_equal(log["particles/angle"], angle)


def test_gsd_without_angles_has_the_momenta_of_disks_that_have_not_turned(three_frames):
    import gsd.hoomd

    with gsd.hoomd.open(str(exported(three_frames, "gsd", [2]))) as file:
        particles = file[0].particles
    assert np.array_equal(particles.orientation, np.tile([1.0, 0.0, 0.0, 0.0], (N, 1)))
    momentum = some_disks(N).inertia * some_state(N, 2).spin
    expected = np.column_stack((np.zeros((N, 3)), 2.0 * momentum))
    assert np.allclose(particles.angmom, expected, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_exported_files_have_the_permissions_that_the_umask_gives(three_frames, umask):
    before = os.umask(umask)
    try:
        modes = {
            to: stat.S_IMODE(exported(three_frames, to, [0]).stat().st_mode)
            for to in ("gsd", "extxyz", "csv")
        }
    finally:
        os.umask(before)
    assert modes == dict.fromkeys(modes, 0o666 & ~umask)


SPECIES = [{"name": "small ones", "number": 10}, {"name": "large", "number": 20}]


@pytest.mark.parametrize(
    ("parameters", "names", "of_disk"),
    [
        ({"species": SPECIES, "materials": ["a", "b", "c"]}, ["small ones", "large"], [0] * 10 + [1] * 20),
        ({"species": SPECIES[:1], "materials": ["a", "b", "c"]}, ["a", "b", "c"], None),  # of another gas
        ({"species": {"name": 1}, "materials": ["a", "b"]}, None, None),
        ({"species": [], "materials": "abc"}, None, None),
        ({}, None, None),
    ],
)
def test_types_are_the_names_of_species_if_the_file_has_them(tmp_path, parameters, names, of_disk):
    import ase.io
    import gsd.hoomd

    texts = {name: json.dumps(value) for name, value in parameters.items()}
    write(tmp_path / "run.h5", n=N, parameters=texts)
    kind = some_disks(N).material if of_disk is None else np.array(of_disk)
    with gsd.hoomd.open(str(exported(tmp_path / "run.h5", "gsd", [0]))) as file:
        particles = file[0].particles
    assert particles.types == (names or ["M0", "M1", "M2"])
    assert np.array_equal(particles.typeid, kind)
    atoms = ase.io.read(exported(tmp_path / "run.h5", "extxyz", [0]), format="extxyz")
    assert set(atoms.get_chemical_symbols()) == {"X"}
    if names is None:
        assert "kind" not in atoms.arrays
    else:  # words of a line end at blanks
        assert atoms.get_array("kind").tolist() == [names[i].replace(" ", "_") for i in kind]


def test_gsd_of_a_sheared_box_is_its_parallelogram(tmp_path):
    """HOOMD's box: x from -Lx/2 + xy y to Lx/2 + xy y; at t = 0.2, xy = shear_rate t modulo Lx/Ly, in the middle."""
    import gsd.hoomd

    box = Box((30.0, 20.0), shear_rate=5.0)
    write(tmp_path / "run.h5", n=N, box=box)
    with gsd.hoomd.open(str(exported(tmp_path / "run.h5", "gsd", [2]))) as file:
        snapshot = file[0]
    tilt = 5.0 * 0.2  # Ly = 20 and 20 to the right: -10 to the left
    tilt -= 30.0 / 20.0
    assert snapshot.configuration.box[3] == pytest.approx(tilt, rel=1e-6)
    x, y, _ = snapshot.particles.position.T
    assert (np.abs(x - tilt * y) <= 15.0 * (1.0 + 1e-6)).all()
    off = (x + 15.0 - some_state(N, 2, box).position[:, 0]) / 30.0
    assert np.allclose(off, np.round(off), rtol=0.0, atol=1e-6)


def test_gsd_of_an_open_plane_gets_a_square_around_all(tmp_path):
    import gsd.hoomd

    write(tmp_path / "run.h5", n=N, box=Box.open())
    with gsd.hoomd.open(str(exported(tmp_path / "run.h5", "gsd", [1]))) as file:
        snapshot = file[0]
    assert (np.abs(snapshot.particles.position[:, :2]) < 0.5 * snapshot.configuration.box[0]).all()
    between = some_state(N, 1, Box.open()).position
    assert np.allclose(
        snapshot.particles.position[3] - snapshot.particles.position[4],
        [*(between[3] - between[4]), 0.0],
        rtol=0.0,
        atol=1e-5,
    )


def test_extxyz_comes_back_through_ase(three_frames):
    import ase.io

    place = exported(three_frames, "extxyz")
    assert "np." not in place.read_text()  # NumPy 2 writes its numbers as np.float64(0.0) where repr is asked
    frames = ase.io.read(place, index=":", format="extxyz")
    assert len(frames) == FRAMES
    for i, atoms in enumerate(frames):
        state = some_state(N, i)
        assert atoms.pbc.tolist() == [True, True, False]
        assert np.array_equal(np.diag(atoms.cell), [30.0, 20.0, 1.0])
        assert np.array_equal(atoms.positions[:, :2].astype(np.float32), state.position.astype(np.float32))
        assert np.array_equal(
            atoms.get_array("angular_velocity").astype(np.float32), state.spin.astype(np.float32)
        )
        assert np.array_equal(atoms.get_array("collisions"), state.collisions)
        assert np.array_equal(atoms.get_array("radius"), some_disks(N).radius)
        assert atoms.info["time"] == 0.1 * i
        assert atoms.info["frame"] == i


@pytest.mark.parametrize(("precision", "dtype"), [("f32", np.float32), ("f64", np.float64)])
def test_csv_keeps_every_digit(tmp_path, precision, dtype):
    write(tmp_path / "run.h5", n=N, frames=FRAMES, precision=precision)
    with exported(tmp_path / "run.h5", "csv", [4, 1]).open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * N
    for block, i in ((rows[:N], 4), (rows[N:], 1)):
        state = some_state(N, i)
        assert [int(row["id"]) for row in block] == list(range(N))
        assert {(row["frame"], float(row["time"])) for row in block} == {(str(i), 0.1 * i)}
        assert np.array_equal([dtype(row["velocity_y"]) for row in block], state.velocity[:, 1].astype(dtype))
        assert np.array_equal([dtype(row["angular_velocity"]) for row in block], state.spin.astype(dtype))
        assert np.array_equal([int(row["image_x"]) for row in block], state.image[:, 0])


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        (None, range(10)),
        ("3", [3]),
        ("-1", [9]),
        ("2:5", [2, 3, 4]),
        ("::4", [0, 4, 8]),
        ("-3:", [7, 8, 9]),
        ("8:2:-3", [8, 5]),
        ("5:99", [5, 6, 7, 8, 9]),
    ],
)
def test_frames_are_chosen_as_python_slices(text, numbers):
    assert list(selected_frames(text, 10)) == list(numbers)


@pytest.mark.parametrize("text", ["", "a", "1:2:3:4", "1:b", "1.5", "::0"])
def test_wrong_choices_of_frames_are_refused(text):
    with pytest.raises(InputError, match="must be a number or a:b:c"):
        selected_frames(text, 10)


@pytest.mark.parametrize("text", ["10", "-11", "20:30", "5:5"])
def test_choices_without_frames_are_refused(text):
    with pytest.raises(InputError, match=r"names none of the 10 frames \(0 to 9\)"):
        selected_frames(text, 10)


def test_plain_lines_give_the_progress_and_the_remaining_time():
    """Each look at the clock finds 2 s gone: 6 s after the beginning 2 frames are done, so 8 take 24 s more."""
    stream, seconds = io.StringIO(), iter(range(-2, 1000, 2))
    show = counted("export", stream=stream, interval=5.0, clock=lambda: float(next(seconds)))
    assert list(show(range(10, 20))) == list(range(10, 20))
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0] == "export: 2 of 10 frames, ETA 0:24"


def test_no_time_left_is_shown_before_the_pace_is_known():
    """Below 5 % of the work, or 2 s of it. Two of 30 took 18 s, so that 28 take 252 s."""
    stream, seconds = io.StringIO(), iter(range(0, 1000, 6))
    list(counted("compare", "run", stream=stream, clock=lambda: float(next(seconds)))(range(30)))
    assert stream.getvalue().splitlines()[:2] == ["compare: 1 of 30 runs", "compare: 2 of 30 runs, ETA 4:12"]
    assert time_left(1.9, 0.5) == ""


def test_the_command_writes_next_to_the_trajectory_and_keeps_existing_files(three_frames, capsys):
    assert main(["export", str(three_frames), "--to", "extxyz", "--frames", "::2"]) == 0
    place = three_frames.with_suffix(".extxyz")
    assert f"wrote {place}: 3 frames" in capsys.readouterr().out
    assert place.read_text().count("Lattice") == 3
    before = place.read_bytes()
    for arguments, reason in (
        (["--to", "extxyz"], "exists already; --force replaces it"),
        (
            ["--to", "extzyx"],
            "--to extzyx: must be one of 'gsd', 'extxyz', 'csv', 'h5', 'parquet' (did you mean 'extxyz'?)",
        ),
        (["--to", "csv", "--frames", "9"], "names none of the 6 frames"),
        (["--to", "csv", "-o", str(three_frames)], "is the trajectory itself"),
        (["--to", "csv", "-o", str(three_frames.parent / "absent" / "x.csv")], "does not exist"),
        (["--to", "csv", "-o", " "], "-o ' ': must be the path of a file"),
        ([], "--to"),
    ):
        assert main(["export", str(three_frames), *arguments]) == 2
        assert reason in capsys.readouterr().err
    assert place.read_bytes() == before
    assert sorted(os.listdir(three_frames.parent)) == ["run.extxyz", "run.h5"]
    assert main(["export", str(three_frames), "--to", "extxyz", "--force", "--frames=-1"]) == 0
    assert place.read_text().count("Lattice") == 1


def test_fields_that_are_needed_and_not_stored_are_named(tmp_path):
    write(tmp_path / "run.h5", fields=("velocity",))
    with pytest.raises(InputError, match="no field 'position'"):
        exported(tmp_path / "run.h5", "gsd", [0])
    assert (
        exported(tmp_path / "run.h5", "csv", [0])
        .read_text()
        .startswith("frame,time,id,velocity_x,velocity_y")
    )


def test_damaged_data_end_a_command_with_a_message_and_no_file(tmp_path, capsys):
    path = tmp_path / "run.h5"
    write(path, n=300, frames=3, compression="gzip")
    flip(path, "particles/all/position/value_2d", 1)
    for arguments in (
        ["export", "--to", "extxyz"],
        ["export", "--to", "gsd"],
        ["movie", "--size", "320x300"],
    ):
        assert main([arguments[0], str(path), *arguments[1:]]) == 2
        error = capsys.readouterr().err
        assert "run.h5 is damaged: /particles/all/position/value_2d cannot be read" in error
        assert "Traceback" not in error
    assert os.listdir(tmp_path) == ["run.h5"]
    assert main(["export", str(path), "--to", "extxyz", "--frames", "0"]) == 0  # that one is whole


@pytest.mark.parametrize(("mass", "shown"), [(2e30, "4.9e.47"), (1e-48, "mass.0. = 1e-48"), (np.inf, None)])
def test_gsd_refuses_numbers_beyond_single_precision(tmp_path: Path, mass: float, shown: str | None) -> None:
    """A star, m R^2 / 2 = 4.9e47 kg m^2, and a disk of 1e-48 kg: GSD would hold inf and 0. Immovable disks are inf."""
    disks = Disks(1, mass=mass, radius=7e8)
    with TrajectoryWriter(tmp_path / "run.h5", disks, Box((1e12, 1e12)), precision="f64") as file:
        file.write(State([[1e11, 1e11]], [[0.0, 0.0]], [0.0]))
    if shown is None:
        assert exported(tmp_path / "run.h5", "gsd", range(1)).exists()
        return
    with pytest.raises(InputError, match=f"{shown}: single precision holds .*export to extxyz, csv or h5"):
        exported(tmp_path / "run.h5", "gsd", range(1))
    assert not (tmp_path / "run.gsd").exists()


def test_viewer_and_mdanalysis_refuse_numbers_beyond_single_precision(tmp_path: Path) -> None:
    with TrajectoryWriter(
        tmp_path / "run.h5", Disks(1, 1.0, 1e39), Box((1e40, 1e40)), precision="f64"
    ) as file:
        file.write(State([[1e39, 1e39]], [[0.0, 0.0]], [0.0]))
    with Trajectory(tmp_path / "run.h5") as run:
        with pytest.raises(InputError, match=r"radius\[0\] = 1e\+39: .*ifrdem plot FILE disks"):
            Content(run)
        with pytest.raises(InputError, match=r"position\[0, 0\] = 1e\+39: .*MDAnalysis"):
            run.universe()
