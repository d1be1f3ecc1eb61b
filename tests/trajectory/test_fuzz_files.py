"""Damaged and malicious files give messages: never a traceback, a hang or a crash."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import re
import signal
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.drawn import Whole, damaged, examples, flips
from support.layout_files import BOX, add_histories, add_series, some_disks, some_state

from ifrdem.cli import main as cli
from ifrdem.errors import InputError, TrajectoryError
from ifrdem.laws import IFRLaw
from ifrdem.model.laws.records import to_record
from ifrdem.runs import status
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

N, FRAMES = 12, 3
PARTICLES = "particles/all"
PARAMETERS = {
    "name": "gas",
    "description": "twelve disks",
    "case": "[run]\nseed = 1\n",
    "species": json.dumps([{"name": "coins", "number": N, "material": "steel"}]),
    "materials": json.dumps(["steel", "brass", "glass"]),
    "laws": json.dumps([[to_record(IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1))] * 3] * 3),
    "forces": "[]",
    "gravity": "[0.0, -1.0]",
}
TURN = itertools.count()


@contextlib.contextmanager
def no_hang(seconds: int = 20) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise AssertionError(f"nothing came back in {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def make(path: Path, compression: str = "none") -> Path:
    """A small trajectory with all that one can hold."""
    with TrajectoryWriter(
        path, some_disks(N), BOX, fields=("position", "velocity", "angular_velocity", "image"),
        compression=compression, parameters=PARAMETERS, units={"length": "m", "time": "s"},
    ) as writer:  # fmt: skip
        for frame in range(FRAMES):
            writer.write(some_state(N, frame), {"energy": 0.1 * frame, "momentum": np.array([1.0, frame])})
    add_series(path)
    state = some_state(N, 0)
    first = {"time": 0.0, **{k: getattr(state, k)[[2, 5]] for k in ("position", "velocity", "spin", "image")}}
    events = [{"time": 0.01 * i, "id": 2 + 3 * (i % 2), "partner": i % N, "regime": 1} for i in range(20)]
    add_histories(path, [2, 5], first, events, [(0, 0.0), (20, 0.2)])
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    return {each: Whole(make(folder / f"{each}.h5", each).read_bytes()) for each in ("none", "gzip")}


def read(path: Path) -> None:
    """Read all by `Trajectory`; InputError is what it may raise."""
    with Trajectory(path) as trajectory:
        for frame in trajectory:
            for name in trajectory.fields:
                frame[name]
        for series in (trajectory.observables, trajectory.series):
            for name in series:
                series[name]
        repr(trajectory)
        for name in ("laws", "gravity", "free_area"):
            with contextlib.suppress(InputError):  # parameters that frames do not need
                getattr(trajectory, name)
        for disk in trajectory.tracked:
            trajectory.history(int(disk))


def commands(path: Path) -> list[list[str]]:
    """Info, one of the other readers in turn, and repair."""
    f, folder = str(path), str(path.parent)
    others = [
        ["history", f, "--id", "2"],
        ["export", f, "--to", "csv", "-o", f"{folder}/o.csv"],
        ["export", f, "--to", "extxyz", "-o", f"{folder}/o.xyz"],
        ["export", f, "--to", "gsd", "-o", f"{folder}/o.gsd"],
        ["link", f],
        ["analyse", f, "velocity", "impact", "pressure", "-o", f"{folder}/analysis"],
    ]
    return [["info", f], others[next(TURN) % len(others)], ["repair", f, "-o", f"{folder}/repaired.h5"]]


def ends_well(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every reader gives an answer or a message; what was repaired can be read, and what needs no repair too."""
    with no_hang(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = True
        try:
            read(path)
        except InputError as error:
            whole, named = False, str(path) in str(error)
            assert named
        for words in commands(path):
            found = cli.main(words)
            shown = capsys.readouterr()
            assert found in (0, 2), (words, shown.err)
            assert found == 0 or shown.err.startswith("ifrdem: "), words
            assert "Traceback" not in shown.out + shown.err
        if found == 0:  # of repair, the last
            if "nothing is wrong" in shown.out:
                assert whole
            else:
                read(path.with_name("repaired.h5"))


@pytest.mark.full
@pytest.mark.parametrize("compression", ["none", "gzip"])
@given(st.data())
@examples(3)
def test_flipped_bits_are_reported_or_harmless(tmp_path, capsys, files, compression, data):
    content = files[compression]
    path = tmp_path / "run.h5"
    path.write_bytes(damaged(content, data.draw(st.lists(flips(content), min_size=1, max_size=3))))
    (tmp_path / "repaired.h5").unlink(missing_ok=True)
    ends_well(path, capsys)


@pytest.mark.parametrize("head", [bytes(16), b"\x01" + bytes(7) + b"\xf0" + 7 * b"\xff"])
@pytest.mark.parametrize("heap", [0, 1])
def test_a_heap_without_end_is_reported(tmp_path, capsys, files, heap, head):
    """HDF5 walks for ever through a global heap, of texts and views, whose first object has the length -16 or 0."""
    content = bytearray(files["none"])
    at = [found.start() for found in re.finditer(b"GCOL", content)][heap] + 16
    content[at : at + 16] = head
    path = tmp_path / "run.h5"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"run\.h5 is damaged: .*global heap at byte \d+ has no end"):
        Trajectory(path)
    ends_well(path, capsys)


def replaced(name: str, value: object = None, **settings: object) -> Callable[[h5py.File, Path], None]:
    """Another dataset in the place of one."""

    def harm(file: h5py.File, folder: Path) -> None:
        del file[name]
        file.create_dataset(name, data=value, **settings)

    return harm


def attribute(name: str, key: str, value: object) -> Callable[[h5py.File, Path], None]:
    def harm(file: h5py.File, folder: Path) -> None:
        file[name].attrs[key] = value

    return harm


def linked(name: str, make: Callable[[Path], object]) -> Callable[[h5py.File, Path], None]:
    def harm(file: h5py.File, folder: Path) -> None:
        if name in file:
            del file[name]
        file[name] = make(folder)

    return harm


def pipe(folder: Path) -> h5py.ExternalLink:
    """A link to a pipe without a writer: opening it would never end."""
    os.mkfifo(folder / "pipe")
    return h5py.ExternalLink(str(folder / "pipe"), "/x")


def onto_itself(file: h5py.File, folder: Path) -> None:
    """HDF5 2.0 crashes when the shape of this is read."""
    name = f"{PARTICLES}/radius"
    del file[name]
    layout = h5py.VirtualLayout((N,), "f8", maxshape=(None,))
    source = h5py.VirtualSource(".", f"/{name}", (N,), "f8", maxshape=(None,))
    layout[: h5py.h5s.UNLIMITED] = source[: h5py.h5s.UNLIMITED]
    file.create_virtual_dataset(name, layout)


def other_view(file: h5py.File, folder: Path) -> None:
    name = f"{PARTICLES}/position/value"
    del file[name]
    layout = h5py.VirtualLayout((FRAMES, N, 3), "f4")
    layout[...] = h5py.VirtualSource(str(folder / "other.h5"), "/x", (FRAMES, N, 3), "f4")
    file.create_virtual_dataset(name, layout)


def external(file: h5py.File, folder: Path) -> None:
    del file[f"{PARTICLES}/mass"]
    file.create_dataset(f"{PARTICLES}/mass", (N,), "f8", external=[("/etc/hostname", 0, 8 * N)])


def endless(file: h5py.File, folder: Path) -> None:
    """A group within itself, and soft links in a circle."""
    file["parameters/again"] = file["parameters"]
    file["observables/again"] = file["observables"]
    file["parameters/round"] = h5py.SoftLink("/parameters/trip")
    file["parameters/trip"] = h5py.SoftLink("/parameters/round")


REFUSED = {
    "a virtual dataset onto itself": onto_itself,
    "a view of another file": other_view,
    "numbers in another file": external,
    "a link to another file": linked("parameters/far", lambda folder: h5py.ExternalLink("other.h5", "/x")),
    "a link to a pipe": linked(f"{PARTICLES}/radius", pipe),
    "a parameter behind a pipe": linked("parameters/name", pipe),
}
PAIR = np.zeros(N, dtype=[("a", "f8"), ("b", "i4")])
DAMAGED = {
    "text radii": replaced(f"{PARTICLES}/radius", ["0.1"] * N),
    "radii in two dimensions": replaced(f"{PARTICLES}/radius", np.ones((N, 2))),
    "compound radii": replaced(f"{PARTICLES}/radius", PAIR),
    "no radii": replaced(f"{PARTICLES}/radius", h5py.Empty("f8")),
    "one radius": replaced(f"{PARTICLES}/radius", 1.0),
    "radii without end": replaced(f"{PARTICLES}/radius", shape=(10**12,), dtype="f8", chunks=(1024,)),
    "everything without end": lambda file, folder: [
        replaced(f"{PARTICLES}/{name}", shape=(10**12,), dtype="i4" if name == "material" else "f8", chunks=(1024,))(
            file, folder
        )
        for name in ("radius", "mass", "k", "material")
    ],
    "a radius that is no number": replaced(f"{PARTICLES}/radius", np.full(N, np.nan)),
    "negative masses": replaced(f"{PARTICLES}/mass", np.full(N, -1.0)),
    "negative materials": replaced(f"{PARTICLES}/material", np.full(N, -1, dtype="i4")),
    "materials as floats": replaced(f"{PARTICLES}/material", np.zeros(N)),
    "text steps": replaced(f"{PARTICLES}/box/edges/step", ["0", "1", "2"]),
    "steps without end": replaced(f"{PARTICLES}/box/edges/step", shape=(10**12,), dtype="i8", chunks=(64,)),
    "times that are no numbers": replaced(f"{PARTICLES}/box/edges/time", np.full(FRAMES, np.nan)),
    "one time": replaced(f"{PARTICLES}/box/edges/time", 0.0),
    "positions of fewer disks": replaced(f"{PARTICLES}/position/value_2d", np.zeros((FRAMES, N - 1, 2), "f4")),
    "compound positions": replaced(f"{PARTICLES}/position/value_2d", np.zeros((FRAMES, N, 2), PAIR.dtype)),
    "a version in words": attribute("h5md/modules/ifrdem", "version", "new"),
    "a version of one number": attribute("h5md/modules/ifrdem", "version", 1),
    "no version": attribute("h5md/modules/ifrdem", "version", h5py.Empty("i4")),
    "lengths in words": attribute(f"{PARTICLES}/box", "lengths", ["a", "b"]),
    "one length": attribute(f"{PARTICLES}/box", "lengths", 3.0),
    "three lengths": attribute(f"{PARTICLES}/box", "lengths", [1.0, 2.0, 3.0]),
    "lengths below 0": attribute(f"{PARTICLES}/box", "lengths", [-1.0, 2.0]),
    "a boundary in numbers": attribute(f"{PARTICLES}/box", "boundary", [1, 2, 3]),
    "one boundary": attribute(f"{PARTICLES}/box", "boundary", ["periodic"]),
    "no boundary": attribute(f"{PARTICLES}/box", "boundary", h5py.Empty("f8")),
    "a misspelt boundary": attribute(f"{PARTICLES}/box", "boundary", ["periodic", "peridic", "none"]),
    "a shear rate in words": attribute(f"{PARTICLES}/box", "shear_rate", "fast"),
    "shear between walls": lambda file, folder: [
        attribute(f"{PARTICLES}/box", "shear_rate", 1.0)(file, folder),
        attribute(f"{PARTICLES}/box", "boundary", ["none", "none", "none"])(file, folder),
    ],
    "columns in numbers": attribute("timeseries/collisions_by_regime", "columns", 3),
    "too few columns": attribute("timeseries/collisions_by_regime", "columns", ["one"]),
    "walls that are no JSON": lambda file, folder: linked("parameters/walls", lambda _: "[{")(file, folder),
    **{
        f"walls {text[:40]}": linked("parameters/walls", lambda _, text=text: text)
        for text in (
            "3", "{}x", '[{"shape": "line"}]', "[[]]", '[{"shape": {}, "origin": [0, 0], "motion": {}}]', "[" * 100_000,
            '[{"shape": "post", "origin": ["a", 0], "motion": {}}]',
            '[{"shape": "post", "origin": [1, 1], "radius": "NaN", "motion": {}}]',
            '[{"shape": "post", "origin": [1, 1], "radius": 1, "material": 0.5, "motion": {}}]',
            '[{"shape": "post", "origin": [1, 1], "radius": 1, "motion": {"kind": []}}]',
        )
    },
    "parameters that are a dataset": replaced("parameters", 3.0),
    "observables that are a dataset": replaced("observables", 3.0),
    "an observable in words": replaced("observables/energy/value", ["a", "b", "c"]),
    "an observable of one row": replaced("observables/energy/value", [1.0]),
    "series in words": replaced("timeseries/energy/value", ["a"] * 7),
    "events without end": replaced("histories/committed/events", np.array([10**15, 10**15])),
    "events below 0": replaced("histories/committed/events", np.array([-5, -5])),
    "no commit": replaced("histories/committed/events", np.zeros(0, dtype="i8")),
    "an event column in words": replaced("histories/events/psi", ["a"] * 20),
    "starts of other disks": replaced("histories/start/position", np.zeros((7, 2))),
}  # fmt: skip
HARMLESS = {
    "circles of links": endless,
    "a description that is no text": linked("parameters/description", lambda _: np.bytes_(b"tw\xe9lve")),
    "a list as parameter": linked("parameters/list", lambda _: [1.0, 2.0]),
    "an empty parameter": linked("parameters/empty", lambda _: h5py.Empty("f8")),
    "laws that are none": linked("parameters/laws", lambda _: "[[]]"),
    "gravity in words": linked("parameters/gravity", lambda _: '["down"]'),
    "species without disks": linked("parameters/species", lambda _: '[{"name": "\\ud800", "number": 1e999}]'),
    "other regimes": replaced("histories/events/regime", np.full(20, 77, dtype="i1")),
}


def harmed(folder: Path, content: bytes, harm: Callable[[h5py.File, Path], object]) -> Path:
    path = folder / "run.h5"
    path.write_bytes(content)
    with h5py.File(path, "r+") as file:
        harm(file, folder)
    return path


@pytest.mark.parametrize("name", REFUSED)
def test_data_that_lie_elsewhere_are_refused(tmp_path, capsys, files, name):
    path = harmed(tmp_path, files["none"], REFUSED[name])
    with no_hang(), pytest.raises(InputError, match=r"run\.h5 is refused: .*holds its own data"):
        Trajectory(path)
    ends_well(path, capsys)


@pytest.mark.full(keep=3)
@pytest.mark.parametrize("name", DAMAGED)
def test_a_file_made_to_harm_is_refused(tmp_path, capsys, files, name):
    path = harmed(tmp_path, files["none"], DAMAGED[name])
    with no_hang(), pytest.raises(InputError, match=r"run\.h5"):
        read(path)
    ends_well(path, capsys)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("name", HARMLESS)
def test_frames_are_read_although_parameters_are_damaged(tmp_path, capsys, files, name):
    path = harmed(tmp_path, files["none"], HARMLESS[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Trajectory(path) as trajectory:
            for number, frame in enumerate(trajectory):
                assert np.array_equal(frame.position, some_state(N, number).position.astype(np.float32))
    ends_well(path, capsys)


def test_a_damaged_description_is_reported_and_left_out_by_repair(tmp_path, capsys, files):
    content = bytearray(files["none"])
    content[content.index(b"twelve disks") + 3] ^= 0x80
    path = tmp_path / "run.h5"
    path.write_bytes(content)
    with pytest.warns(UserWarning, match="/parameters/description cannot be read"):
        Trajectory(path).close()
    assert cli.main(["repair", str(path)]) == 0
    assert "parameters/description: cannot be read; the copy lacks it" in capsys.readouterr().out
    with Trajectory(tmp_path / "run.repaired.h5") as trajectory:  # no warning, which would be an error
        assert len(trajectory) == FRAMES
        assert "description" not in trajectory.parameters
        assert trajectory.parameters["name"] == "gas"


WRONG = (None, -1, 0, 1e999, -1e999, 10**400, math.nan, "x", "\x1b]0;owned\x07", [], {}, True)


@pytest.mark.full
@given(st.data(), st.sampled_from((status.RUNNING, "done", "failed")), st.sampled_from(WRONG), st.booleans())
@examples(24)
def test_a_damaged_status_is_reported(tmp_path, capsys, data, state, wrong, flipped):
    one = status.Status(tmp_path / "run.h5", name="gas", t_end=10.0, device="cpu")
    one.update(time=1.0, fraction=0.1, eta_seconds=9.0, temperature=1.0, rotational_temperature=0.5)
    one.finish(state)
    content = json.loads(one.path.read_text())
    text = json.dumps({**content, data.draw(st.sampled_from(list(content))): wrong}).encode()
    one.path.write_bytes(damaged(text, [data.draw(flips(text))] * flipped))
    with no_hang():
        found = cli.main(["status", str(tmp_path)])
    shown = capsys.readouterr()
    assert found in (0, 1, 2)
    assert found != 2 or shown.err.startswith("ifrdem: ")
    assert not any(ord(each) < 32 and each != "\n" for each in shown.out + shown.err)


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "3", "", '{"format": 1}', "\udce9"])
def test_a_file_that_is_no_status_is_reported(tmp_path, capsys, text):
    (tmp_path / "run.status.json").write_text(text, errors="surrogateescape")
    assert cli.main(["status", str(tmp_path)]) == 2
    assert "is not a status file of ifrdem" in capsys.readouterr().err


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("stored") / "run.checkpoint.h5"
    chance = np.random.default_rng(1)
    arrays = {"flight": chance.normal(size=(N, 5)), "clock": np.array([1.0]), "one": np.array(3)}
    checkpoint.write(path, arrays, {"fingerprint": "f", "extra": {"plan": {}, "case": "text" * 50}})
    return Whole(path.read_bytes())


@given(st.data())
@examples(16)
def test_a_flipped_bit_of_a_checkpoint_is_reported_or_harmless(tmp_path, capsys, stored, data):
    path = tmp_path / "run.checkpoint.h5"
    path.write_bytes(stored)
    arrays, record = checkpoint.read(path)
    path.write_bytes(damaged(stored, [data.draw(flips(stored))]))
    with no_hang():
        try:
            again, same = checkpoint.read(path)
        except InputError as error:
            named = str(path) in str(error)
            assert named
        else:  # it was a byte that nothing depends on
            assert same == record
            assert all(np.array_equal(again[name], arrays[name]) for name in arrays)
        assert cli.main(["resume", str(tmp_path)]) == 2  # the record is none of a run in either case
    assert capsys.readouterr().err.startswith("ifrdem: ")


@pytest.mark.parametrize(
    "harm",
    [
        linked("arrays/far", lambda folder: h5py.ExternalLink("other.h5", "/x")),
        linked("arrays/flight", pipe),
        linked("arrays", lambda _: 3.0),
        linked("record", lambda _: [1.0]),
        linked("record", lambda _: "[" * 100_000),
        linked("arrays/flight", lambda _: ["a"]),
        attribute("/", "format", "new"),
        attribute("/", "kind", [1, 2]),
        attribute("/", "digest", 3),
    ],
)
def test_a_checkpoint_made_to_harm_is_refused(tmp_path, capsys, stored, harm):
    path = tmp_path / "run.checkpoint.h5"
    path.write_bytes(stored)
    with h5py.File(path, "r+") as file:
        harm(file, tmp_path)
    with no_hang():
        assert cli.main(["resume", str(tmp_path)]) == 2
    assert str(path) in capsys.readouterr().err


@pytest.mark.parametrize(
    "extra", [3, {}, {"plan": 1}, {"plan": {}, "case_path": 3}, {"plan": {}, "case": []}]
)
def test_a_checkpoint_with_another_record_is_refused(tmp_path, capsys, extra):
    path = tmp_path / "run.checkpoint.h5"
    checkpoint.write(path, {"clock": np.array([1.0])}, {"fingerprint": "f", "extra": extra})
    assert cli.main(["resume", str(tmp_path)]) == 2
    assert str(path) in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["info", "repair", "link"])
def test_a_folder_stands_for_its_only_trajectory(tmp_path, capsys, monkeypatch, files, verb):
    monkeypatch.chdir(tmp_path)
    assert cli.main([verb, "."]) == 2
    assert "is a folder without a trajectory" in capsys.readouterr().err
    (tmp_path / "run.h5").write_bytes(files["none"])
    (tmp_path / "run.checkpoint.h5").write_bytes(b"")
    assert cli.main([verb, "."]) == 0
    assert "run." in capsys.readouterr().out
    (tmp_path / "other.h5").write_bytes(files["none"])
    assert cli.main([verb, "."]) == 2
    assert "name one of other.h5, run.h5" in capsys.readouterr().err


def test_control_characters_in_a_file_do_not_reach_the_terminal(tmp_path, capsys, files):
    def harm(file: h5py.File, folder: Path) -> None:
        file["parameters/note"] = "\x1b]0;owned\x07\x9b2J"
        del file["parameters/units/length"]
        file["parameters/units/length"] = "m\x1b[2J"
        file["observables/\x1b[1m"] = file["observables/energy"]

    path = harmed(tmp_path, files["none"], harm)
    one = status.Status(path, name="gas")
    one.finish("failed", "\x1b[31mred\x07")
    assert cli.main(["info", str(path)]) == 0
    assert cli.main(["history", str(path), "--id", "2"]) == 0
    assert cli.main(["status", str(path)]) == 1
    out = capsys.readouterr().out
    assert all(each.isprintable() or each == "\n" for each in out)
    assert r"\x1b]0;owned\x07" in out
    assert r"\x1b[31mred\x07" in out


def test_a_file_that_grows_up_follows_no_link(tmp_path, monkeypatch, files):
    """A guessed name of a temporary file cannot cause another file to be overwritten."""
    from ifrdem.tools import files

    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / ".run.h5.ab.part").symlink_to(victim)
    monkeypatch.setattr(files.secrets, "token_hex", lambda _: "ab")
    with pytest.raises(FileExistsError):
        files.create(tmp_path / "run.h5")
    with pytest.raises(InputError, match="cannot be written"):
        files.write_aside(tmp_path / "run.h5", lambda place: place.write_text("theirs"))
    assert victim.read_text() == "mine"


@pytest.mark.parametrize("harm", ["deleted or moved", "replaced"])
def test_frames_of_a_deleted_file_are_not_reported_as_kept(tmp_path, harm):
    path = tmp_path / "run.h5"
    writer = TrajectoryWriter(path, some_disks(N), BOX, fields=("position",))
    writer.write(some_state(N, 0))
    assert writer.replaced_or_removed is None
    path.unlink()
    if harm == "replaced":
        path.write_bytes(b"another")
    with pytest.raises(TrajectoryError, match=f"{harm}.*its frames are no longer there") as caught:
        writer.write(some_state(N, 1))
    assert "kept" not in str(caught.value)
    assert harm in str(writer.replaced_or_removed)
    writer.close()
