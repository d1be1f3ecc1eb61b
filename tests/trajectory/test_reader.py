"""Trajectory files: data are read as written, in H5MD, whatever ends the run."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, some_disks, some_state, write

import ifrdem
from ifrdem.case.case import UNITS
from ifrdem.errors import DamageError, InputError, TrajectoryError
from ifrdem.kernels.compiler import runtime
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.runs.info import describe
from ifrdem.tools import versions
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.rows import CommitLog
from ifrdem.trajectory.writer import TrajectoryWriter

# --- what is written comes back


@pytest.mark.parametrize("compression", ["none", "gzip"])
@pytest.mark.parametrize(("precision", "dtype"), [("f32", np.float32), ("f64", np.float64)])
def test_frames_come_back_as_written(tmp_path, precision, dtype, compression):
    path = tmp_path / "run.h5"
    write(path, n=7, frames=4, fields=FIELDS, precision=precision, compression=compression)
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 4
        assert trajectory.fields == FIELDS
        for index, frame in enumerate(trajectory):
            state = some_state(7, index)
            # Exact: rounding to the stored type is all that may happen.
            for got, given in (
                (frame.position, state.position),
                (frame.velocity, state.velocity),
                (frame.spin, state.spin),
            ):
                assert got.dtype == np.float64
                assert np.array_equal(got, given.astype(dtype))
            assert frame.time == state.time
            assert np.array_equal(frame.collisions, state.collisions)
            assert np.array_equal(frame.image, state.image)


@pytest.mark.parametrize(
    "selection",
    [(0, [1, 2]), ([0, 1], 2), (slice(0, 2, 0), 0), np.arange(2), (0, True)],
)
def test_selections_that_no_file_reads_are_refused(tmp_path, selection):
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(5), BOX) as writer:
        for frame in range(3):
            writer.write(some_state(5, frame))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        with pytest.raises(InputError, match="of position: must be integers and slices"):
            trajectory.read("position", selection)
        found = trajectory.read("position", (slice(0, 3, 2), np.int64(4)))
        assert np.array_equal(found, [trajectory[0].position[4], trajectory[2].position[4]])
        whole = np.array([frame.position for frame in trajectory])
        for back in (np.s_[::-1], np.s_[2:0:-2, 1], np.s_[::-1, 4::-3], np.s_[1, ::-1, 1], np.s_[0:0:-1]):
            assert np.array_equal(trajectory.read("position", back), whole[back])


REFUSED = {
    "an axis too many": (lambda run: run.read("position", (0, 0, 0, 0)), "3 axes at most"),
    "a frame beyond": (lambda run: run.read("position", 3), "selection 3 of position: there are 3"),
    "a disk beyond": (lambda run: run.read("position", (0, -6)), "selection -6 of position: there are 5"),
    "slice of text": (lambda run: run.read("spin", slice("a", None)), "must be integers and slices"),
    "number for a field": (lambda run: run.read(5, 0), "name = 5: must be a text"),
    "text for a frame": (lambda run: run["a"], "frame = 'a': must be an integer"),
    "half a frame": (lambda run: run[1.5], "frame = 1.5: must be an integer"),
    "list of disks": (lambda run: run.disk([1, 2]), r"disk = \[1, 2\]: must be an integer"),
    "text for a history": (lambda run: run.history("x"), "disk = 'x': must be an integer"),
    "list of constants": (lambda run: run.constants("mass", [1]), r"disks = \[1\]: must be a slice"),
    "number for a constant": (lambda run: run.constants(5), "name = 5: must be a text"),
    "number for frames": (lambda run: run.plot("disks", frames=5), "frames = 5: must be a sequence"),
    "text for frames": (
        lambda run: run.plot("disks", frames=["a"]),
        r"frames\[0\] = 'a': must be an integer",
    ),
    "number for a file": (lambda run: Trajectory(5), "path = 5: must be a text or a path"),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_what_does_not_fit_is_refused_by_name_and_not_called_damage(tmp_path, case):
    act, says = REFUSED[case]
    write(tmp_path / "run.h5")
    with Trajectory(tmp_path / "run.h5") as trajectory, pytest.raises(InputError, match=says) as raised:
        act(trajectory)
    assert not isinstance(raised.value, DamageError)


def test_what_is_not_committed_is_not_read(tmp_path):
    write(tmp_path / "run.h5", frames=3)
    with h5py.File(tmp_path / "run.h5", "r+") as file:  # as after a kill while a frame is written
        file["particles/all/position/step"].resize(2, axis=0)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert len(trajectory.dataset("position")) == 3
        assert trajectory.read("position").shape == (2, 5, 2)
        assert trajectory.read("position", slice(None)).shape == (2, 5, 2)
        assert np.array_equal(trajectory.read("position", -1), trajectory[1].position)


def test_observables_come_back_over_the_frames(tmp_path):
    path = tmp_path / "run.h5"
    write(path, frames=3)
    with Trajectory(path) as trajectory:
        observables = trajectory.observables
        assert set(observables) == {"energy", "collisions", "momentum"}
        assert np.array_equal(observables["energy"], [0.0, 0.1, 0.2])
        assert np.array_equal(observables["collisions"], [0, 10, 20])
        assert observables["collisions"].dtype.kind == "i"
        assert np.array_equal(observables["momentum"], [[1, 0], [1, 1], [1, 2]])


def test_disks_box_and_record_come_back(tmp_path):
    path = tmp_path / "run.h5"
    case = "[run]\nname = 'é'\n"
    write(
        path,
        parameters={"case": case, "seed": 3, "dt": 0.5, f"versions/{runtime.chosen()}": "9.9"},
        units={"length": "m", "time": "s"},
    )
    disks = some_disks(5)
    with Trajectory(path) as trajectory:
        for name in ("mass", "radius", "k", "material"):
            assert np.array_equal(getattr(trajectory.disks, name), getattr(disks, name))
        assert trajectory.box == BOX
        assert trajectory.units == {"length": "m", "time": "s"}
        record = trajectory.parameters
    assert (record["case"], record["seed"], record["dt"]) == (case, 3, 0.5)
    assert record["versions/python"] == ".".join(map(str, sys.version_info[:3]))
    assert record["versions/ifrdem"] == ifrdem.__version__
    assert record["git"] == versions.revision()
    assert record["versions/numpy"] == np.__version__
    assert record["versions/h5py"] == h5py.__version__
    assert (
        record[f"versions/{runtime.chosen()}"] == "9.9"
    )  # what the run says goes before what the writer finds


@pytest.mark.parametrize("compression", ["none", "gzip"])
@pytest.mark.parametrize("n", [0, 1])
def test_no_disk_and_one_disk_are_trajectories_too(tmp_path, n, compression):
    path = tmp_path / "run.h5"
    write(path, n=n, frames=2, fields=FIELDS, compression=compression)
    with Trajectory(path) as trajectory:
        assert trajectory.disks.n == n
        assert [frame.position.shape for frame in trajectory] == [(n, 2), (n, 2)]
        assert trajectory[1].spin.shape == (n,)
    with h5py.File(path) as file:
        assert file["particles/all/position/value"].shape == (2, n, 3)
    text = describe(path)
    assert f"disks             {n}" in text
    assert f"written by        {versions.shown()}" in text


@pytest.mark.parametrize("length", [30.0, 0.1, 0.7])
def test_rounding_leaves_disks_inside_the_box(tmp_path, length):
    """In f4 the last f64 number below the length is the length, or for (0.1, 0.7) a neighbouring number."""
    path = tmp_path / "run.h5"
    state = State([[np.nextafter(length, 0.0), 0.0]], [[0.0, 0.0]], [0.0])
    with TrajectoryWriter(path, Disks(1, mass=1.0, radius=1e-3), Box((length, 1.0))) as writer:
        writer.write(state)
    with Trajectory(path) as trajectory:
        x = trajectory[0].position[0, 0]
    assert x < length
    assert x == pytest.approx(length, rel=1.2e-7)  # one f4 spacing, 2^-23


def test_a_file_holds_its_data_once(tmp_path):
    """50,000 disks: 2 x 8 + 4 + 4 bytes a disk and frame, and nothing for padded chunks or 3D views."""
    path = tmp_path / "run.h5"
    n = 50_000
    write(path, n=n, frames=2)
    with h5py.File(path) as file:
        particles = file["particles/all"]
        for name in ("position", "velocity"):
            assert particles[f"{name}/value_2d"].id.get_storage_size() == 2 * n * 8
            assert particles[f"{name}/value"].is_virtual
        chunk = particles["position/value_2d"].chunks
    assert chunk[0] == 1
    assert chunk[1] <= 16384  # one disk's history must not read whole frames
    static = n * (3 * 8 + 4)  # mass, radius, k in f8 and the material
    assert (
        path.stat().st_size < 2 * n * 32 + static + 250_000
    )  # 0.25 MB for everything that does not grow with n


def test_compression_is_shuffle_and_deflate(tmp_path):
    path = tmp_path / "run.h5"
    write(path, compression="gzip")
    with h5py.File(path) as file:
        for name in ("position/value_2d", "angular_velocity/value", "collisions/value"):
            dataset = file[f"particles/all/{name}"]
            assert (dataset.compression, dataset.compression_opts, dataset.shuffle) == ("gzip", 1, True)


# --- the layout


def test_3d_views_equal_the_raw_data_with_zero_z_as_frames_grow(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(5), BOX) as writer:
        for frames in range(1, 5):
            writer.write(some_state(5, frames))
            with h5py.File(path, locking=False) as file:
                for name in ("position", "velocity"):
                    group = file[f"particles/all/{name}"]
                    assert group["value"].shape == (frames, 5, 3)
                    assert np.array_equal(group["value"][..., :2], group["value_2d"])
                    assert not group["value"][..., 2].any()
                    given = getattr(some_state(5, frames), name)
                    assert np.array_equal(group["value"][-1, :, :2], given.astype(np.float32))
    moved = path.rename(tmp_path / "moved.h5")  # the view belongs to the file, not to its name
    with h5py.File(moved) as file:
        assert file["particles/all/position/value"][3, 2, 0] == np.float32(some_state(5, 4).position[2, 0])


def test_layout_is_h5md_with_steps_and_times_stored_once(tmp_path):
    path = tmp_path / "run.h5"
    units = {"length": "m", "momentum": "kg m s-1"}
    write(path, frames=3, fields=FIELDS, units=units, parameters={"author": "A. Person"})
    with h5py.File(path) as file:
        assert list(file["h5md"].attrs["version"]) == [1, 1]
        assert file["h5md/author"].attrs["name"] == b"A. Person"
        assert file["h5md/creator"].attrs["name"] == b"ifrdem"
        for group, name in (("author", "name"), ("creator", "name"), ("creator", "version")):
            kind = h5py.check_string_dtype(file[f"h5md/{group}"].attrs.get_id(name).dtype)
            assert kind.length is not None  # "of fixed-length string datatype and of scalar dataspace"
        assert file["parameters/units/length"].asstr()[()] == "m"
        assert list(file["particles"]) == ["all"]
        box = file["particles/all/box"]
        assert box.attrs["dimension"] == 3
        assert list(box.attrs["boundary"]) == [b"periodic", b"periodic", b"none"]
        # Of H5MD's two forms that with edge vectors: VMD's reader of time-dependent boxes knows no other.
        assert np.array_equal(box["edges/value"], [np.diag([30.0, 20.0, 30.0])] * 3)
        step, when = box["edges/step"], box["edges/time"]
        assert np.array_equal(step, [0, 1, 2])
        assert np.array_equal(when, [0.0, 0.1, 0.2])
        elements = [f"particles/all/{name}" for name in FIELDS]
        elements += [f"observables/{name}" for name in ("energy", "collisions", "momentum")]
        for name in elements:
            element = file[name]
            assert isinstance(element.get("step", getlink=True), h5py.HardLink)
            assert element["step"] == step  # the same object in the file, not an equal one
            assert element["time"] == when
            assert len(element["value"]) == 3
            assert "unit" not in element["value"].attrs
        assert "unit" not in when.attrs
        particles = file["particles/all"]
        assert particles["collisions/value"].dtype == np.int32
        assert particles["image/value"].dtype == np.int32
        assert particles["material"].dtype == np.int32
        assert particles["species"] == particles["material"]  # no species are named


def test_units_module_declares_si_and_is_absent_without_it(tmp_path):
    # The module (nongnu.org/h5md/modules/units.html): attributes version and system and no other, the system
    # a text of fixed length.
    write(tmp_path / "si.h5", units=UNITS["SI"])
    with h5py.File(tmp_path / "si.h5") as file:
        module = file["h5md/modules/units"]
        assert sorted(module.attrs) == ["system", "version"]
        assert list(module.attrs["version"]) == [1, 0]
        assert module.attrs["system"] == b"SI"
        assert h5py.check_string_dtype(module.attrs.get_id("system").dtype).length == 2
    for name, units in (("none", {}), ("foreign", {"length": "m", "time": "month"}), ("old", {"v": "m/s"})):
        write(tmp_path / f"{name}.h5", units=units)
        with h5py.File(tmp_path / f"{name}.h5") as file:
            assert "units" not in file["h5md/modules"]
        with Trajectory(tmp_path / f"{name}.h5") as trajectory:
            assert trajectory.units == units


def test_units_of_a_case_are_written_in_the_notation_of_h5md():
    # Factors between spaces: a symbol, and a signed power other than 0 behind it; each symbol once.
    for unit in UNITS["SI"].values():
        factors = unit.split(" ")
        assert all(re.fullmatch(r"[A-Za-z]+([+-][1-9]\d*)?", factor) for factor in factors), unit
        assert len({re.sub(r"[^A-Za-z]", "", factor) for factor in factors}) == len(factors)
    assert UNITS["SI"]["momentum"] == "kg m s-1"


def test_reduced_units_are_one_parameter_and_no_unit_of_anything(tmp_path):
    path = tmp_path / "run.h5"
    write(path, units=UNITS["reduced"])
    with h5py.File(path) as file:
        assert "units" not in file["h5md/modules"]
        assert file["parameters/units"].asstr()[()] == "reduced"
    with Trajectory(path) as trajectory:
        assert trajectory.units == {}
        assert trajectory.parameters["units"] == "reduced"
    lines = describe(path).splitlines()
    assert [line for line in lines[1:] if "reduced" in line] == ["  units             reduced"]
    assert "  frames            3, time 0 to 0.2" in lines
    assert "  box               30 x 20, periodic" in lines


# --- reading


def test_repr_names_the_content(tmp_path):
    path = tmp_path / "run.h5"
    write(path, frames=3, units={"time": "s"})
    with Trajectory(path) as trajectory:
        assert repr(trajectory) == f"<Trajectory '{path}': 5 disks, 3 frames from t = 0 to 0.2 s>"
        assert repr(trajectory[-1]) == "<Frame 2 of 3: 5 disks at t = 0.2 s>"
    assert repr(trajectory).endswith("0.2 s, closed>")
    write(tmp_path / "one.h5", frames=1)
    with Trajectory(tmp_path / "one.h5") as trajectory:
        assert repr(trajectory).endswith(": 5 disks, 1 frame from t = 0 to 0>")
        assert repr(trajectory[0]) == "<Frame 0 of 1: 5 disks at t = 0>"


def test_repr_of_what_holds_arrays_is_short(tmp_path):
    write(tmp_path / "a.h5", n=200, frames=3)
    with Trajectory(tmp_path / "a.h5") as trajectory:
        path = trajectory.disk(7)
        assert repr(path) == f"<DiskPath of disk 7: 3 frames, t = 0 to 0.2; {', '.join(trajectory.fields)}>"
        low, high = trajectory.disks.mass.min(), trajectory.disks.mass.max()
        assert f"mass (200,) from {low:.6g} to {high:.6g}" in repr(trajectory.disks)
    state = some_state(200, 0)
    assert "velocity (200, 2) from " in repr(state)
    assert "\n" not in repr(state)
    assert len(repr(state)) < 600


def test_trajectory_indexes_like_a_list(tmp_path):
    path = tmp_path / "run.h5"
    write(path, frames=5)
    with Trajectory(path) as trajectory:
        assert [frame.index for frame in trajectory] == [0, 1, 2, 3, 4]
        assert [frame.index for frame in trajectory[1:4]] == [1, 2, 3]
        assert [frame.index for frame in trajectory[::-2]] == [4, 2, 0]
        assert trajectory[9:] == []
        assert trajectory[-2].index == 3
        assert trajectory[-2].time == some_state(5, 3).time
        assert np.array_equal(trajectory.times, [some_state(5, i).time for i in range(5)])
        path_of_disk = trajectory.dataset("position")[:, 2]
        assert np.array_equal(path_of_disk, [frame.position[2] for frame in trajectory])


def test_missing_frames_and_names_are_refused_with_the_existing_ones(tmp_path):
    path = tmp_path / "run.h5"
    write(path, frames=3, fields=("position",))
    with Trajectory(path) as trajectory:
        for index in (3, -4):
            with pytest.raises(InputError, match=rf"frame {index} of .*3 frames \(0 to 2\)") as caught:
                trajectory[index]
            assert isinstance(caught.value, IndexError)  # so that it is a sequence to everybody
        with pytest.raises(InputError, match=r"no field 'velocity'; there are position"):
            trajectory[0].velocity  # noqa: B018 the reading is the act
        with pytest.raises(InputError, match=r"no observable 'enrgy'.*did you mean 'energy'"):
            trajectory.observables["enrgy"]
        assert "enrgy" not in trajectory.observables


def test_what_is_not_ours_is_refused_with_the_reason(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Trajectory(tmp_path / "absent.h5")
    with pytest.raises(InputError, match="is a folder"):
        Trajectory(tmp_path)
    text = tmp_path / "text.h5"
    text.write_text("x,y\n1,2\n")
    with pytest.raises(InputError, match="not an HDF5 file"):
        Trajectory(text)
    with h5py.File(tmp_path / "plain.h5", "w") as file:
        file["weather"] = 1
    with pytest.raises(InputError, match=r"not H5MD.*it holds weather"):
        Trajectory(tmp_path / "plain.h5")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file.create_group("h5md").attrs["version"] = [1, 1]
        file.create_group("h5md/creator").attrs["name"] = "other"
        file["particles/all/position/value"] = np.zeros((2, 4, 3))
        file["particles/all/box/edges"] = np.ones(3)
    with pytest.raises(InputError, match=r"creator: other.*missing .*box/edges/step.*all/radius.*value_2d"):
        Trajectory(tmp_path / "foreign.h5")
    write(tmp_path / "light.h5")
    with h5py.File(tmp_path / "light.h5", "r+") as file:
        del file["particles/all/mass"]
    with pytest.raises(InputError, match=r"missing particles/all/mass$"):
        Trajectory(tmp_path / "light.h5")


def test_a_file_cut_short_is_refused_as_damaged(tmp_path):
    path = tmp_path / "run.h5"
    write(path)
    os.truncate(path, path.stat().st_size - 100)
    with pytest.raises(InputError, match="damaged"):
        Trajectory(path)
    write(path, force=True)
    with h5py.File(path, "r+") as file:
        file["particles/all/velocity/value_2d"].resize(2, axis=0)
    with pytest.raises(InputError, match="damaged: velocity holds 2 of 3 frames"):
        Trajectory(path)


def test_a_layout_of_the_future_is_refused(tmp_path):
    path = tmp_path / "run.h5"
    write(path)
    with h5py.File(path, "r+") as file:
        file["h5md/modules/ifrdem"].attrs["version"] = [2, 0]
    with pytest.raises(
        InputError,
        match=r"written by a newer ifrdem: its layout is 2\.0, this one reads up to 1\.\d; install a newer",
    ):
        Trajectory(path)


def test_a_newer_layout_that_cannot_be_read_is_no_damage(tmp_path):
    path = tmp_path / "run.h5"
    write(path)
    with h5py.File(path, "r+") as file:
        file["h5md/modules/ifrdem"].attrs["version"] = [1, 99]
    Trajectory(path).close()  # what is there can be read
    with h5py.File(path, "r+") as file:
        file["parameters/walls"] = '[{"shape": "spiral", "origin": [0, 0], "motion": {}}]'
    with pytest.raises(InputError, match=r"written by a newer ifrdem: its layout is 1\.99") as found:
        Trajectory(path)
    assert not isinstance(found.value, DamageError)


def test_walls_of_an_older_layout_are_refused(tmp_path):
    path = tmp_path / "run.h5"
    write(path)
    with h5py.File(path, "r+") as file:
        file["h5md/modules/ifrdem"].attrs["version"] = [1, 4]
    Trajectory(path).close()  # without walls it can be read
    with h5py.File(path, "r+") as file:
        file["parameters/walls"] = '[{"shape": "post", "place": [1.0, 1.0], "radius": 0.5}]'
    with pytest.raises(InputError, match=r"has layout 1\.4: walls can be read from layout 1\.5 on") as found:
        Trajectory(path)
    assert not isinstance(found.value, DamageError)


def test_describe_lists_the_content_of_a_file(tmp_path):
    path = tmp_path / "run.h5"
    disks = Disks(3, mass=2.0, radius=1.0)
    case = "[run]\n" + "x = 1\n" * 20
    with TrajectoryWriter(
        path, disks, Box((10.0, 10.0)), parameters={"case": case, "seed": 7}, units={"length": "m"}
    ) as writer:
        for i in range(2):
            state = State([[1.0, 1.0], [4.0, 4.0], [8.0, 8.0]], np.zeros((3, 2)), np.zeros(3), time=2.5 * i)
            writer.write(state, {"energy": 1.0})
    text = describe(path)
    for part in (
        "frames            2, time 0 to 2.5",
        "radius            1 m",
        "box               10 x 10 m",
        "packing fraction  0.0942",  # 3 pi / 100
        "position          float32 x 2, 24 bytes a frame, 48 bytes stored",
        "collisions        int32, 12 bytes a frame",
        "energy",
        "(21 lines,",
        "versions/numpy",
    ):
        assert part in text
    assert re.search(r"\n  seed +7\n", text)
    assert text.count("x = 1") < 2
    assert describe(path, full=True).count("x = 1") == 20


# --- what must not be overwritten, and what cannot be written


def test_an_existing_file_is_refused_and_kept(tmp_path):
    path = tmp_path / "run.h5"
    path.write_text("precious")
    with pytest.raises(InputError, match="exists"):
        write(path)
    assert path.read_text() == "precious"
    assert os.listdir(tmp_path) == ["run.h5"]


def test_force_replaces_the_old_file_only_when_the_first_frame_is_committed(tmp_path):
    path = tmp_path / "run.h5"
    path.write_text("precious")
    with TrajectoryWriter(path, some_disks(2), BOX, force=True):
        pass  # a run that ends before its first frame
    assert path.read_text() == "precious"
    assert os.listdir(tmp_path) == ["run.h5"]
    with TrajectoryWriter(path, some_disks(2), BOX, force=True) as writer:
        assert path.read_text() == "precious"
        writer.write(some_state(2, 0))
        with Trajectory(path) as trajectory:
            assert len(trajectory) == 1
        writer.write(some_state(2, 1))
    with Trajectory(path) as trajectory:
        assert np.array_equal(trajectory[1].velocity, some_state(2, 1).velocity.astype(np.float32))
    assert os.listdir(tmp_path) == ["run.h5"]


def test_force_without_an_old_file_writes_a_new_one(tmp_path):
    write(tmp_path / "run.h5", frames=2, force=True)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert len(trajectory) == 2
    assert os.listdir(tmp_path) == ["run.h5"]


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path, monkeypatch):
    path = tmp_path / "run.h5"
    create = h5py.File.flush

    def slow(file):
        path.write_text("quicker")
        create(file)

    monkeypatch.setattr(h5py.File, "flush", slow)
    with pytest.raises(InputError, match=r"cannot be written: .*File exists"):
        TrajectoryWriter(path, some_disks(2), BOX)
    assert path.read_text() == "quicker"
    assert os.listdir(tmp_path) == ["run.h5"]


def test_a_writer_without_frames_leaves_no_file(tmp_path):
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(2), BOX):
        pass
    with (
        pytest.raises(ZeroDivisionError),
        TrajectoryWriter(tmp_path / "run.h5", some_disks(2), BOX),
    ):
        1 / 0  # noqa: B018 any error of a run before its first frame
    assert os.listdir(tmp_path) == []


def test_impossible_outputs_are_refused(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    # Everybody, root too, is refused new files in /sys.
    unwritable = Path("/sys") if os.path.isdir("/sys") else tmp_path / "locked"
    if not unwritable.exists():
        unwritable.mkdir(mode=0o500)
    for path, reason in (
        (tmp_path, "is a folder"),
        (tmp_path / "absent" / "run.h5", "does not exist"),
        (file / "run.h5", "does not exist"),
        (unwritable / "run.h5", "cannot be created"),
        (tmp_path / ("x" * 300), "each name of 255"),
        (Path("/dev/null"), "not a regular file"),
    ):
        for force in (False, True):
            with pytest.raises(InputError, match=f"(?i){reason}"):
                write(path, force=force)
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"fields": ("positon",)}, "did you mean 'position'"),
        ({"fields": ("position", "position")}, "once"),
        ({"precision": "f2"}, "must be one of 'f32', 'f64'"),
        ({"compression": "gzp"}, "did you mean 'gzip'"),
        ({"parameters": {"case": ["a"]}}, r"parameters\['case'\] = \['a'\]: must be"),
        ({"parameters": {"": 1}}, "name of parameter"),
        ({"parameters": {"case": "a\0b"}}, "cannot be written"),
        ({"units": {"length": 1}}, r"units\['length'\] = 1: must be"),
        ({"units": {"length": "reduced", "time": "s"}}, "unit of time = 's': must be 'reduced' for all"),
    ],
)
def test_wrong_options_are_refused_and_leave_nothing(tmp_path, options, reason):
    with pytest.raises(InputError, match=reason):
        write(tmp_path / "run.h5", **options)
    assert os.listdir(tmp_path) == []


def test_a_frame_that_does_not_fit_is_refused_and_the_file_unchanged(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        with pytest.raises(InputError, match="name of observable = 'a/b'"):
            writer.write(some_state(3, 0), {"a/b": 1.0})
        writer.write(some_state(3, 1), {"energy": 1.0, "count": 3})
        late = some_state(3, 2)
        overflowing = some_state(3, 2)
        overflowing.velocity[1, 0] = 1e39
        counted = some_state(3, 2)
        counted.collisions = counted.collisions.astype(np.int64) + 2**31
        timeless = some_state(3, 2)
        timeless.time = float("nan")
        for state, observables, reason in (
            (some_state(2, 2), {"energy": 1.0, "count": 3}, "2 disks: must be 3"),
            (some_state(3, 0), {"energy": 1.0, "count": 3}, "time = 0.0: .*not before 0.1"),
            (timeless, {"energy": 1.0, "count": 3}, "time = nan"),
            (
                overflowing,
                {"energy": 1.0, "count": 3},
                r'velocity.* = 1e.39: single precision holds numbers from .*precision "f64"',
            ),
            (counted, {"energy": 1.0, "count": 3}, "collisions: numbers beyond"),
            (late, {"energy": 1.0}, "the first frame has"),
            (late, {"energy": [1.0, 2.0], "count": 3}, "energy has shape"),
            (late, {"energy": "high", "count": 3}, "must be a number or numbers"),
            (late, {"energy": 1.0, "count": 3.5}, "integer in the first frame"),
        ):
            with pytest.raises(InputError, match=reason):
                writer.write(state, observables)
        writer.write(late, {"energy": 2, "count": 4})
        assert len(writer) == 2
    with pytest.raises(TrajectoryError, match="closed"):
        writer.write(late, {"energy": 2, "count": 4})
    with Trajectory(path) as trajectory:
        assert np.array_equal(trajectory.times, [0.1, 0.2])
        assert np.array_equal(trajectory.observables["energy"], [1.0, 2.0])
        assert np.array_equal(trajectory.observables["count"], [3, 4])


# --- whatever ends the run

CHILD = """
import sys
import numpy as np
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests"]
from support.layout_files import BOX, some_disks, some_state
from ifrdem.errors import TrajectoryError
from ifrdem.trajectory.writer import TrajectoryWriter
n, limit, pause = int(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
if limit:
    import resource, signal
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write beyond the limit is an error then, not a death
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
with TrajectoryWriter(sys.argv[2], some_disks(n), BOX) as writer:
    frame = 0
    while True:
        try:
            writer.write(some_state(n, frame), {"energy": 0.5 * frame})
        except TrajectoryError as error:
            print(error, file=sys.stderr)
            break
        frame += 1
        sys.stdout.write(".")
        sys.stdout.flush()
        if frame == pause:
            sys.stdin.read()
"""


def child(path: Path, n: int, *, limit: int = 0, pause: int = 0) -> subprocess.Popen[bytes]:
    """A process that writes frames, a dot on stdout for each that is committed, until something ends it."""
    root = str(Path(__file__).resolve().parents[2])
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, root, str(path), str(n), str(limit), str(pause)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def assert_whole(path: Path, n: int, reported: int) -> None:
    """Every frame that has a step is as its number says, read with h5py alone; none reported is missing."""
    with h5py.File(path, "r") as file:
        frames = len(file["particles/all/position/step"])
        # A frame may be committed and the process killed before it can report it.
        assert reported <= frames <= reported + 1
        particles = file["particles/all"]
        for i in range(frames):
            state = some_state(n, i)
            assert particles["position/step"][i] == i
            assert particles["position/time"][i] == state.time
            position, velocity = particles["position/value"][i], particles["velocity/value"][i]
            assert np.array_equal(position[:, :2], state.position.astype(np.float32))
            assert np.array_equal(velocity[:, :2], state.velocity.astype(np.float32))
            assert np.array_equal(particles["angular_velocity/value"][i], state.spin.astype(np.float32))
            assert np.array_equal(particles["collisions/value"][i], state.collisions)
        assert np.array_equal(particles["box/edges/value"][:frames], [np.diag([30.0, 20.0, 30.0])] * frames)
        assert np.array_equal(file["observables/energy/value"][:frames], 0.5 * np.arange(frames))
    with Trajectory(path) as trajectory:
        assert len(trajectory) == frames
        assert len(trajectory.observables["energy"]) == frames
    with h5py.File(path, "r+") as file:  # and it can be carried on
        file["particles/all/position/step"].resize(frames, axis=0)


@pytest.mark.full(keep=1)
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
@pytest.mark.parametrize("moment", range(8))
def test_a_killed_run_leaves_every_committed_frame(tmp_path, moment):
    path = tmp_path / "run.h5"
    n = (40, 3000)[moment % 2]
    with child(path, n) as process:
        assert process.stdout is not None
        reported = len(process.stdout.read(1))
        time.sleep(np.random.default_rng(moment).uniform(0.0, 0.2))
        process.send_signal(signal.SIGKILL)
        reported += len(process.stdout.read())
    assert process.returncode == -signal.SIGKILL
    assert reported >= 1
    assert_whole(path, n, reported)


def test_a_full_disk_leaves_every_committed_frame(tmp_path):
    """A limit on the size of files stands for the disk: writes beyond it fail alike."""
    pytest.importorskip("resource")
    path = tmp_path / "run.h5"
    with child(path, 3000, limit=1_000_000) as process:
        output, error = process.communicate()
    assert process.returncode == 0  # the error was caught, and closing raised none
    # 3000 disks take 72 kB a frame and 84 kB in all before; at least half of the room is used.
    assert 6 <= len(output) <= 12
    assert b"a frame could not be written (File too large)" in error
    assert f"the {len(output)} frames before it are kept".encode() in error
    assert_whole(path, 3000, len(output))


def test_a_full_disk_before_the_first_frame_keeps_nothing_and_says_so(tmp_path):
    """The file begins with some 110 kB, and a frame of 3000 disks takes 72 kB: there is room for none."""
    pytest.importorskip("resource")
    path = tmp_path / "run.h5"
    with child(path, 3000, limit=140_000) as process:
        output, error = process.communicate()
    assert output == b""
    assert (
        b"a frame could not be written (File too large); there is no frame before it: nothing is kept"
        in error
    )
    assert not list(tmp_path.iterdir())


def test_a_frame_without_its_step_does_not_count(tmp_path):
    """The file after a kill between the two phases."""
    path = tmp_path / "run.h5"
    write(path, frames=2)
    with h5py.File(path, "r+") as file:
        for name in ("position/value_2d", "velocity/value_2d", "angular_velocity/value", "position/time"):
            file[f"particles/all/{name}"].resize(3, axis=0)
        file["observables/energy/value"].resize(3, axis=0)
    with Trajectory(path) as trajectory:
        assert len(trajectory) == len(trajectory.times) == len(trajectory.observables["energy"]) == 2
        with pytest.raises(InputError, match="frame 2"):
            trajectory[2]
    assert "1 uncommitted" in describe(path)


@pytest.mark.parametrize("interrupted", ["time", "angular_velocity/value", "energy/value", "step"])
def test_an_interrupted_write_leaves_no_trace(tmp_path, monkeypatch, interrupted):
    path = tmp_path / "run.h5"
    append = CommitLog._append

    def interrupt(rows, dataset):
        if rows.committed == 2 and dataset.name.endswith(interrupted):
            raise KeyboardInterrupt

    def append_and_interrupt(self, dataset, values):
        append(self, dataset, values)
        interrupt(self, dataset)

    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        monkeypatch.setattr(CommitLog, "_append", append_and_interrupt)
        for frame in range(2):
            writer.write(some_state(3, frame), {"energy": 0.5 * frame})
        with pytest.raises(KeyboardInterrupt):
            writer.write(some_state(3, 2), {"energy": 1.0})
    with h5py.File(path) as file:
        for name in (
            "position/step",
            "position/value",
            "velocity/value_2d",
            "collisions/value",
            "position/time",
        ):
            assert len(file[f"particles/all/{name}"]) == 2
    assert_whole(path, 3, 2)


def test_a_file_can_be_read_while_a_run_writes_it(tmp_path):
    path = tmp_path / "run.h5"
    with child(path, 40, pause=3) as process:
        assert process.stdout is not None
        assert process.stdout.read(3) == b"..."
        with Trajectory(path) as trajectory:
            assert len(trajectory) == 3
            last = trajectory[-1].position
        process.kill()
    assert np.array_equal(last, some_state(40, 2).position.astype(np.float32))
