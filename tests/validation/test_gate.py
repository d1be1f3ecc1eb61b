"""The gate of instructions a collision: what passes, what fails, what it needs."""

from __future__ import annotations

import platform
from pathlib import Path

import pytest

from ifrdem.errors import EngineError
from ifrdem.tools.arguments import script
from ifrdem.validation.speed import gate


def test_a_gas_that_needs_more_than_the_margin_fails() -> None:
    before = {"one": 1000.0, "other": 2000.0}
    assert gate.compared(before, {"one": 1029.0, "other": 1500.0}, 3.0)[1]
    rows, good = gate.compared(before, {"one": 1031.0, "other": 1500.0}, 3.0)
    assert not good
    assert rows[2:] == ["| one | 1,000 | 1,031 | +3.1 % TOO MANY |", "| other | 2,000 | 1,500 | -25.0 % |"]


def test_a_gas_of_one_commit_alone_is_shown() -> None:
    rows, good = gate.compared({"old": 1.0}, {"new": 2.0}, 3.0)
    assert good
    assert rows[2:] == ["| old | 1 | | |", "| new | | 2 | |"]


@pytest.mark.parametrize("line", ["totals: 123456", "summary: 123456"])
def test_a_dump_says_how_many_instructions_there_were(tmp_path: Path, line: str) -> None:
    """Lines as callgrind 3.19 writes them."""
    (tmp_path / "dump.1").write_text(f"version: 1\ncreator: callgrind-3.19.0\nevents: Ir\n\n{line}\n")
    assert gate.instructions_in(tmp_path / "dump.1") == 123456


def test_a_dump_without_a_sum_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "dump.1").write_text("version: 1\n")
    with pytest.raises(EngineError, match=r"dump\.1"):
        gate.instructions_in(tmp_path / "dump.1")


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the instructions are those of x86-64")
def test_requests_do_nothing_without_valgrind() -> None:
    assert gate.Callgrind().request(0x1001) == 0  # RUNNING_ON_VALGRIND


def test_without_valgrind_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(gate.platform, "system", lambda: "Linux")
    monkeypatch.setattr(gate.platform, "machine", lambda: "x86_64")
    assert script(gate.gate, ["HEAD"]) == 2
    assert capsys.readouterr().err == (
        "gate: valgrind is not installed: apt install valgrind, or dnf install valgrind\n"
    )
