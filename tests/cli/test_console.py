"""`--quiet` and `--verbose`, `--help` in a pipe, shell completion, and `python -m ifrdem`."""

from __future__ import annotations

import errno
import io
import json
import logging
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from support.cases import case_text
from support.layout_files import write

from ifrdem.cli import manual
from ifrdem.cli.main import app, main
from ifrdem.tools import arguments
from ifrdem.tools.progress import Progress, Stage

CASE = case_text({
    "run.name": "tiny", "run.collisions_per_disk": 2.0, "run.threads": 1, "run.t_end": None,
    "run.units": None, "species[0].coin": "1 pta", "species[0].number": 64, "species[0].material": None,
    "species[0].mass": None, "species[0].radius": None, "output": {"frames": 2, "picture": False},
    "material": None,
})  # fmt: skip


@pytest.fixture
def folder(toml: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(toml.parent)
    return toml.parent


def commands() -> list[str]:
    return [name for name in app if not name.startswith("-")]


@pytest.mark.full
def test_a_quiet_run_prints_nothing_and_a_verbose_one_names_device_cache_and_time(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["--quiet", "run", "tiny.toml"], ["run", "tiny.toml", "-q", "--force"]):
        assert main(words) == 0
        shown = capsys.readouterr()
        assert (shown.out, shown.err) == ("", "")
    from ifrdem.simulation import backend

    backend.stop()
    assert main(["run", "tiny.toml", "--verbose", "--force"]) == 0
    shown = capsys.readouterr()
    for text in ("ifrdem: device cpu, 1 threads, f64\n", "ifrdem: kernel cache ", "ifrdem: done in "):
        assert shown.err.count(text) == 1
    assert "ifrdem:" not in shown.out


def test_quiet_leaves_results_warnings_and_errors(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "tiny.toml", "--quiet"]) == 0
    assert re.search(r"packing fraction +0\.2\n", capsys.readouterr().out)
    write(folder / "run.h5", n=9)
    assert main(["--quiet", "export", "run.h5", "--to", "csv"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["export", "run.h5", "--to", "csv", "--force"]) == 0
    assert capsys.readouterr().out.startswith("wrote run.csv: ")
    assert main(["--quiet", "export", "run.h5", "--to", "csv"]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_call_leaves_the_logger_as_it_was(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("ifrdem")
    before = (logger.level, logger.propagate, list(logger.handlers))
    assert main(["cases", "--verbose"]) == 0
    assert main(["--quiet", "rum"]) == 2
    assert (logger.level, logger.propagate, list(logger.handlers)) == before


@pytest.mark.full(keep=8)
@pytest.mark.parametrize("command", commands())
def test_help_names_every_option_in_eighty_columns_and_without_colors_in_a_pipe(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([command, "--help"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    lines = shown.out.splitlines()
    assert lines[0].startswith(f"Usage: ifrdem {command}")
    assert max(map(len, lines)) <= 80
    assert "\x1b" not in shown.out
    assert max(shown.out) < "\U0001f000"  # no emoji, which rich makes of A:B:C
    for argument in app[command].assemble_argument_collection(default_parameter=app.default_parameter):
        assert argument.parameter.help
        for name in {*argument.names} - {"*"}:  # a group of options has no name of its own
            assert f"{name}" in shown.out
    assert "--quiet -q" in shown.out


def test_python_m_shows_the_same_help_as_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ifrdem", "--help"], capture_output=True, text=True, check=True
    )
    assert main(["--help"]) == 0
    assert done.stdout == capsys.readouterr().out
    assert [name for name in commands() if f"\n│ {name} " not in done.stdout] == []


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_offers_commands_and_options(shell: str) -> None:
    script = app.generate_completion(shell=shell)
    for word in (*commands(), "no-picture", "in-place", "write-material"):
        assert word in script


def test_an_ascii_terminal_gets_numbers_for_what_it_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    held = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(held, "ascii", write_through=True))
    assert main(["docs", "law"]) == 0
    page = manual.page("law")
    assert not page.isascii()
    assert held.getvalue() == f"{page}\n".encode("ascii", "backslashreplace")


def test_texts_of_files_cannot_command_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """ESC ] 0 ; sets the title of a window, ESC [ 2 J clears it; some terminals run what other sequences say."""
    text = "a\x1b]0;title\x07\x1b[2J\x9b2J"
    path = tmp_path / f"{text}.toml"
    assert main(["new", "cooling", "-o", str(path)]) == 0
    case = path.read_text(encoding="utf-8").replace('"coins"', json.dumps(text))
    path.write_text(case, encoding="utf-8")
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr()
    assert shown.out.count("\\x1b]0;title") > 3
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", shown.out + shown.err)


@pytest.mark.parametrize(("shell", "start"), [("bash", ".bashrc"), ("zsh", ".zshrc")])
def test_completion_leaves_the_start_file_of_the_shell_alone(
    shell: str,
    start: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("ZSH", "ZSH_CUSTOM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / start).write_text("# mine\n")
    assert main(["--install-completion", "--shell", shell]) == 0
    (script,) = (each for each in tmp_path.rglob("*ifrdem"))
    assert (tmp_path / start).read_text() == "# mine\n"
    shown = capsys.readouterr().out
    assert f"installed to {script}" in shown
    assert shell == "bash" or f"fpath=({script.parent} $fpath)" in shown


def test_completion_takes_the_place_of_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--install-completion", "--shell", "bash", "-o"]
    (tmp_path / "mine").write_text("mine\n")
    (tmp_path / "link").symlink_to("nosuch")
    os.mkfifo(tmp_path / "pipe")  # which was waited for
    for taken in ("mine", "link", "pipe", "."):
        assert main([*words, str(tmp_path / taken)]) == 2
        assert ": exists already; must be a new file\n" in capsys.readouterr().err
    assert (tmp_path / "mine").read_text() == "mine\n"
    assert main([*words, str(tmp_path / "nosuch" / "new")]) == 2
    assert f"output folder {tmp_path / 'nosuch'}: does not exist" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "new")]) == 0
    assert "complete" in (tmp_path / "new").read_text()


@pytest.mark.full
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full here")
def test_messages_that_cannot_be_written_change_no_exit_status(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "ifrdem", "info", str(tmp_path / "nosuch.h5")]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:  # Python writes what is left once more at its end
        assert subprocess.run(words, stderr=full, env=buffered, check=False).returncode == 2
    shell = f"{shlex.join(words)} 2>&-"  # closed: Python has no such stream then
    done = subprocess.run(["sh", "-c", shell], stdout=subprocess.PIPE, check=False)
    assert (done.returncode, done.stdout) == (2, b"")


def test_progress_that_cannot_be_written_ends_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

        def flush(self) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("sys.stderr", Full())
    with arguments.unfailing_messages():
        progress = Progress(10, t_end=1.0, interval=0.0)
        for time in (0.0, 0.5, 1.0):
            progress(time, 10)
        Stage("growth", interval=0.0)(0.5)
        print("message", file=sys.stderr)
    assert isinstance(sys.stderr, Full)
