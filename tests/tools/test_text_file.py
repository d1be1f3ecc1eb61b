"""Text files of users: regular, of a bounded size, in UTF-8."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from ifrdem.case import file as case_file
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.fit import data
from ifrdem.initial import from_csv
from ifrdem.tools import text_file


@pytest.mark.parametrize("read", [case_file.read, data.read, lambda path: from_csv.read(path, 3)])
def test_devices_and_pipes_are_refused_at_once(read, tmp_path: Path) -> None:
    """Reading a pipe without a writer would never end, and /dev/zero would fill the memory."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
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


def test_a_name_with_a_null_character_is_no_file() -> None:
    with pytest.raises(InputError, match="null character"):
        text_file.read(Path("a\0b"), most=10)
