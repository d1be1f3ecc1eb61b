"""A sample of `support.attacks`, whose full runs take a minute each."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import attacks
from support.drawn import examples

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    return attacks.made_once(tmp_path_factory.mktemp("made"), ())


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("name", "cases"), [("result_of_a_run", 60), ("results", 3), ("concat", 2), ("heaps", 3)]
)
def test_damaged_files_end_in_answers_or_messages(made, name, cases):
    given(st.data())(examples(cases)(lambda data: attacks.attack(name, made, data)))()


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
def test_folders_that_cannot_be_written_to_are_named(made):
    if not attacks.can_be_read_only():  # a file system is mounted for it, which takes rights
        pytest.skip("no folder can be made read-only here")
    given(st.data())(examples(3)(lambda data: attacks.attack("read_only_folders", made, data)))()


@pytest.mark.full
def test_an_attack_that_crashes_hangs_or_raises_is_reported(tmp_path: Path):
    assert "ended by SIGKILL" in attacks.alone(lambda: os.kill(os.getpid(), 9))
    assert "ZeroDivisionError" in attacks.alone(lambda: 1 / 0)
    assert attacks.alone(lambda: [None for _ in iter(int, 1)], seconds=1) == "no end in 1 s"
    assert attacks.alone(lambda: None) == ""
