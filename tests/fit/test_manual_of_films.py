"""Commands of the manual's page on fits, as they stand, with the files that the program makes for them."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from support.manual import block

from ifrdem.cli.main import main
from ifrdem.runs import compare
from ifrdem.tools.tables import TableFormat
from ifrdem.validation import fit_video


def test_rest_positions_have_the_names_that_compare_reads(tmp_path: Path) -> None:
    """They were coin, rest x (mm), ...: the command of the manual failed on the manual's file."""
    (tmp_path / "rest.csv").write_text("\n".join(fit_video.rest([[0.0, 1.0], [2.0, 3.0]])), encoding="utf-8")
    found = compare.read(tmp_path / "rest.csv", {"positions": 1e-4}, TableFormat())
    assert found.position.tolist() == [[0.0, 1.0], [2.0, 3.0]]


@pytest.mark.full
def test_commands_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the video to the comparison of rest positions; the table of the film slows down by 0.2 * 9.81 m/s2."""
    monkeypatch.chdir(tmp_path)
    fit_video.main(tmp_path)
    shown = ""
    for marker in ("video", "picture fit", "picture compared"):
        for line in block(marker).splitlines():
            program, *arguments = shlex.split(line, comments=True)
            assert program == "ifrdem"
            assert main(arguments) == 0, line
            shown += capsys.readouterr().out
    assert "found 25 collisions: 25 of two disks" in shown
    assert "coins slide and spin on their faces with mu g = 1.96" in shown
    assert "of 12 places" in shown


@pytest.mark.full
def test_commands_from_a_film_to_a_gas(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As they stand, of a film of fewer impacts and with fewer and smaller runs; then the block of Python."""
    monkeypatch.chdir(tmp_path)
    fit_video.main(tmp_path, "12")
    smaller = ["species[0].number=50", "run.collisions_per_disk=2"]
    shown = ""
    for marker in ("film to gas", "picture film_to_gas"):
        for line in block(marker).splitlines():
            program, *arguments = shlex.split(line)
            if program == "python":
                continue
            if arguments[0] == "study":
                arguments += ["--workers", "0", *(word for each in smaller for word in ("--set", each))]
            assert main(arguments) == 0, line
            shown += capsys.readouterr().out
    assert "20 sets of coefficients, Gaussian with the errors of the case" in shown
    assert Path("gas_T.png").exists()
    # The study of the script has other cases, of which no run is done: that of the test has its results.
    code = block("script film_to_gas").replace("seeds=10", f"seeds=5, set={smaller}")
    exec(compile(code, "film_to_gas.py", "exec"), {})
    assert Path("film_to_gas.png").exists()
