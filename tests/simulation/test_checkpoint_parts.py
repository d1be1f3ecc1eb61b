"""Checkpoints in parts: the previous one is valid until the new one is, and any number of ranks reads its rows."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.mpi import Communicator
from ifrdem.simulation.checkpoints import checkpoint

N = 23


class Rank:
    """One of so many ranks, as far as it needs no other one."""

    def __init__(self, rank: int = 0, size: int = 1) -> None:
        self.rank, self.size = rank, size

    def bcast(self, value: Any) -> Any:
        return value

    def allgather(self, value: Any) -> list[Any]:
        return [value]

    def allreduce(self, value: Any) -> Any:
        return value


def rows(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {"disk": rng.normal(size=(N, 6)), "meta": rng.integers(0, 9, (N, 2), dtype=np.int32)}


def write_both(path: Path, seed: int) -> None:
    checkpoint.write_parts(path, rows(seed), {"clock": np.array([0.5, seed])}, {"seed": seed})


def check(path: Path, seed: int) -> None:
    """All that `write` wrote is there, and nothing else."""
    arrays, record = checkpoint.read(path)
    assert record["seed"] == seed
    assert set(arrays) == {"disk", "meta", "clock"}
    for name, values in rows(seed).items():
        assert arrays[name].tobytes() == values.tobytes()
    assert len(list(checkpoint.parts_of(path).iterdir())) == 1


def test_a_new_checkpoint_takes_the_place_of_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "run.checkpoint.h5"
    for seed in (1, 2):
        write_both(path, seed)
        check(path, seed)
    assert set(checkpoint.read(path, rows=False)[0]) == {"clock"}
    checkpoint.write(path, {"all": np.ones(3)}, {"seed": 3})  # by one rank, which leaves no parts of before
    assert set(checkpoint.read(path)[0]) == {"all"}
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    write_both(path, 4)
    checkpoint.remove(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fails", [1, 2])
def test_the_checkpoint_before_is_kept_where_one_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    """The part cannot be written, or what names it."""
    path, written, real = tmp_path / "run.checkpoint.h5", [], checkpoint._write
    write_both(path, 1)

    def failing(place: Path, *given: Any) -> None:
        written.append(place)
        if len(written) == fails:
            raise InputError(f"checkpoint {place} cannot be written: no room")
        real(place, *given)

    monkeypatch.setattr(checkpoint, "_write", failing)
    with pytest.raises(InputError, match="no room"):
        write_both(path, 2)
    assert len(written) == fails
    check(path, 1)


def test_a_kill_between_part_and_name_leaves_the_checkpoint_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, real = tmp_path / "run.checkpoint.h5", checkpoint._write
    write_both(path, 1)

    def killed(place: Path, *given: Any) -> None:
        if place == path:
            raise KeyboardInterrupt
        real(place, *given)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "_write", killed)
        with pytest.raises(KeyboardInterrupt):
            write_both(path, 2)
    assert checkpoint.read(path)[1]["seed"] == 1
    assert len(list(checkpoint.parts_of(path).iterdir())) == 2
    write_both(path, 3)  # which removes what was left
    check(path, 3)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_each_of_any_number_of_ranks_gets_the_rows_of_its_slice(tmp_path: Path, size: int) -> None:
    path = tmp_path / "run.checkpoint.h5"
    write_both(path, 1)
    with Communicator(Rank(0, size)):
        arrays, record = checkpoint.read_slice(path)
    found = [arrays]
    for rank in range(1, size):
        with Communicator(Rank(rank, size)):
            found.append(checkpoint._rows(path, record))
    for name, values in rows(1).items():
        own = [each[name] for each in found]
        assert [len(each) for each in own] == [(r + 1) * N // size - r * N // size for r in range(size)]
        assert np.concatenate(own).tobytes() == values.tobytes()


def test_a_part_that_is_missing_damaged_or_of_another_checkpoint_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.checkpoint.h5"
    write_both(path, 1)
    (part,) = checkpoint.parts_of(path).iterdir()
    kept = part.read_bytes()
    part.unlink()
    with pytest.raises(
        InputError, match=rf"its part run\.checkpoint\.parts/{part.name} \(disks 0 to 22\) is missing"
    ):
        checkpoint.read(path)
    number = rows(1)["disk"][7, 3].tobytes()
    assert kept.count(number) == 1
    part.write_bytes(kept.replace(number, bytes(8)))
    with pytest.raises(InputError, match=part.name):
        checkpoint.read(path)
    write_both(tmp_path / "other.checkpoint.h5", 1)
    (other,) = checkpoint.parts_of(tmp_path / "other.checkpoint.h5").iterdir()
    shutil.copy(other, part)
    with pytest.raises(InputError, match="is part of another one"):
        checkpoint.read(path)
