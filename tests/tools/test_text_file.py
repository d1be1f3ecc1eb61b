"""Text files of users: regular, of a bounded size, in UTF-8."""

from __future__ import annotations

import io
import os
import re
import threading
from pathlib import Path

import h5py
import matplotlib
import numpy as np
import pytest

import ifrdem
from ifrdem import plots
from ifrdem.analysis import catalogue
from ifrdem.case import file as case_file
from ifrdem.cli import main as cli
from ifrdem.cli import options
from ifrdem.errors import MOST_LINE, MOST_WORD, InputError
from ifrdem.fit import data
from ifrdem.initial import from_csv
from ifrdem.model.laws import files as law_files
from ifrdem.model.walls import outlines
from ifrdem.study import plan
from ifrdem.tools import text_file


def styled(path: Path) -> None:
    with options.styled(str(path)):
        pass


def drawn(path: str) -> None:
    plots.cooling("run.h5", path)


READERS = [
    case_file.read, data.read, lambda path: from_csv.read(path, 3), outlines.of_csv, outlines.of_svg, styled,
    plan._digest, lambda path: law_files.find(f"{path}.py:Law"),
]  # fmt: skip


@pytest.mark.parametrize("read", READERS)
def test_devices_and_pipes_are_refused_at_once(read, tmp_path: Path) -> None:
    """Reading a pipe without a writer would never end, and /dev/zero would fill the memory."""
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "zero.py").symlink_to("/dev/zero")
    for path in (tmp_path / "pipe", tmp_path / "zero"):
        observed: list[str] = []

        def refused(path: Path = path, observed: list[str] = observed) -> None:
            with pytest.raises(InputError, match="is a device or pipe: must be a regular file") as caught:
                read(path)
            observed.append(str(caught.value))

        thread = threading.Thread(target=refused, daemon=True)
        thread.start()
        thread.join(10.0)
        assert observed


def test_a_file_may_be_as_large_as_the_limit_and_no_larger(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("é" * 5, encoding="utf-8")
    assert text_file.read(tmp_path / "text", most=10) == "é" * 5
    with pytest.raises(InputError, match="is larger than 9e-06 MB"):
        text_file.read(tmp_path / "text", most=9)


def test_a_case_file_beyond_10_MB_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "large.toml"
    path.write_text("# " + "x" * 10_000_000, encoding="utf-8")
    assert cli.main(["check", str(path)]) == 2
    assert f"{path}: is larger than 10 MB" in capsys.readouterr().err


@pytest.mark.full(keep=4)
@pytest.mark.parametrize(
    ("name", "line", "read"),
    [
        ("wide.csv", "1.0," * 1_000_000, lambda path: from_csv.read(path, 3)),
        ("wide.csv", "psi," * 1_000_000, data.read),
        ("words.csv", "x,y\n" + "word" * 20_000 + ",1", lambda path: from_csv.read(path, 1)),
        ("names.csv", "x,y\n" + "1," * 40_000, lambda path: from_csv.read(path, 1)),
        ("columns.csv", ",".join(f"c{i}" for i in range(10_000)), lambda path: from_csv.read(path, 1)),
        ("points.csv", "1 2\n" + "3 " * 1_000_000, outlines.of_csv),
        ("path.svg", "<svg viewBox='0 0 1 1'><path d='" + "x" * 1_000_000 + "'/></svg>", outlines.of_svg),
        ("tree.svg", "<svg>" * 50_000, outlines.of_svg),
        ("key.toml", f"'{'k' * 1_000_000}' = 1", case_file.read),
        ("value.toml", f"[run]\nname = '{'k' * 1_000_000}'", case_file.read),
        ("study.toml", f"case = 'cooling'\n'{'k' * 1_000_000}' = 1", plan.read),
        ("seeds.toml", f"case = 'cooling'\n[ensemble]\nseeds = '{'k' * 1_000_000}'", plan.read),
    ],
)
def test_messages_quote_no_more_than_a_beginning(name: str, line: str, read, tmp_path: Path) -> None:
    """A line of 1e6 columns gave messages of 4 MB."""
    (tmp_path / name).write_text(f"{line}\n")
    with pytest.raises(InputError) as caught:
        read(tmp_path / name)
    assert len(str(caught.value)) < 10_000
    assert max(map(len, str(caught.value).splitlines())) <= MOST_LINE


def test_lines_of_tables_are_bounded_and_named(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("a\n" + "b" * text_file.MOST_LINE)
    assert [len(line) for line in text_file.lines(path, most=10**6)] == [2, text_file.MOST_LINE]
    path.write_text("a\n" + "b" * text_file.MOST_LINE + "c")
    with pytest.raises(InputError, match="line 2: has more than 100000 characters"):
        list(text_file.lines(path, most=10**6))
    path.write_bytes("\ufeffé\r\n".encode() + "é\n".encode("latin-1"))  # 0xe9 in Latin-1, ISO 8859-1
    with pytest.raises(InputError, match=r"line 2: not a text file in UTF-8 \(byte 0xe9\)"):
        list(text_file.lines(path, most=100))
    with pytest.raises(InputError, match=r"line 2: not a text file in UTF-8 \(byte 0xe9\)"):
        text_file.read(path, most=100)


def test_names_longer_than_file_systems_take_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    allowed = r"path\w* = .*: must be a path of 4095 bytes at most, each name of 255$"
    for name in ("n" * 300, "é" * 128, f"{'n' * 300}/x.toml", "n/" * 3000):
        for use in (ifrdem.Case.read, ifrdem.Trajectory, ifrdem.Study, drawn):
            with pytest.raises(InputError, match=allowed):
                use(name)
        if "/" in name:
            continue
        for words in (["check", name], ["info", name], ["resume", name], ["fit", name], ["status", name]):
            assert cli.main(words) == 2
            shown = capsys.readouterr().err
            assert "too long" in shown or "255" in shown or "there is no" in shown
            assert len(shown) < 2 * MOST_LINE


def test_messages_have_both_ends_of_long_names_only(capsys: pytest.CaptureFixture[str]) -> None:
    """The name was repeated whole in six lines: 12,000 characters on a picture that `fit` cannot write."""
    words = ["fit", "nosuch.csv", "--M", "1", "--error", "1", "--picture", "n" * 5000]
    assert cli.main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(len(line) < MOST_WORD + 100 and "nnn..." in line for line in lines[:-1])
    text = f"{'a' * 200}/{'b' * 200}.csv: there is no such file"
    assert re.fullmatch(r"a{148}\.\.\.b{143}\.csv: there is no such file", str(InputError(text)))
    assert str(InputError("c" * MOST_WORD)) == "c" * MOST_WORD


def test_links_in_a_loop_are_refused_where_laws_are_read_and_tables_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The law ended in a traceback; `analyse` computed all, and could not write it then."""
    (tmp_path / "loop.py").symlink_to("loop.py")
    with pytest.raises(InputError, match=r"loop\.py cannot be read: Too many levels"):
        law_files.find("loop.py:Law", tmp_path)
    with pytest.raises(InputError, match=r"there is no file .*n\.\.\.n"):
        law_files.find(f"{'n' * 300}.py:Law", tmp_path)
    monkeypatch.setattr(catalogue, "FUNCTIONS", {})  # none is called
    disks = ifrdem.Disks(1, mass=1.0, radius=0.5)
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box((9.0, 9.0))) as file:
        file.write(ifrdem.State(np.ones((1, 2)), np.ones((1, 2)), np.ones(1)))
    assert cli.main(["analyse", f"{tmp_path}/a.h5", "velocity", "-o", f"{tmp_path}/loop.py"]) == 2
    assert "loop.py: must be a folder" in capsys.readouterr().err


def test_an_empty_file_is_no_trajectory(tmp_path: Path) -> None:
    """HDF5 waits for ever for /proc/kmsg, whose size is 0 as that of all files there."""
    (tmp_path / "a.h5").touch()
    with pytest.raises(InputError, match=r"a.h5 is empty: must be a trajectory file"):
        ifrdem.Trajectory(tmp_path / "a.h5")


def test_a_style_is_not_loaded_from_the_web() -> None:
    for name in ("https://example.com/a.mplstyle", "package.style"):
        with pytest.raises(InputError, match="neither a style of Matplotlib nor a file"):
            styled(Path(name))


def test_a_name_with_a_null_character_is_no_file() -> None:
    with pytest.raises(InputError, match="null character"):
        text_file.read(Path("a\0b"), most=10)


def test_a_file_that_the_system_has_no_content_of_yet_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading /proc/kmsg, a regular file that is not waited for, gave None, and a TypeError."""

    class Waiting(io.RawIOBase):
        def readable(self) -> bool:
            return True

        def readinto(self, _: object) -> None:
            return None

    monkeypatch.setattr(text_file, "opened", lambda _path: io.BufferedReader(Waiting()))
    with pytest.raises(InputError, match="cannot be read: the system waits for its content"):
        text_file.read(Path("kmsg"), most=10)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,2\n", r"Missing colon in file '.*', line 1 \('x,y'\) \(and 1 more\)"),
        ("lines.linewidth: thick\n", "Bad value in file"),
        ("line.linewidth: 2\n", "Bad key line.linewidth"),
        ("1" * 5000, "Missing colon"),
    ],
)
def test_a_style_whose_lines_are_no_settings_is_refused(text, message, tmp_path, caplog) -> None:
    """A table of numbers was taken for a style: Matplotlib logged each line, whole, and drew without it."""
    path = tmp_path / "a.mplstyle"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        styled(path)
    assert len(str(caught.value)) < len(str(path)) + 400
    assert not caplog.records
    path.write_text("# ours\nlines.linewidth: 2.5\n")
    with options.styled(str(path)):
        assert matplotlib.rcParams["lines.linewidth"] == 2.5


def test_hdf5_files_are_named_as_such(tmp_path: Path) -> None:
    """A trajectory in place of a case was to be saved as UTF-8."""
    path = tmp_path / "gas.h5"
    with h5py.File(path, "w"):
        pass
    for reader in (text_file.read, lambda *given, **most: [*text_file.lines(*given, **most)]):
        with pytest.raises(InputError, match=r"^is an HDF5 file, .*: must be a text file$"):
            reader(path, most=100)
