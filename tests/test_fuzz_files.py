"""Files that are damaged or made to do harm end in messages: never in a traceback, a hang or a crash."""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import signal
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from layout_files import BOX, add_histories, add_series, some_disks, some_state

from ifrdem import checkpoint, cli, status
from ifrdem.errors import InputError
from ifrdem.trajectory import Trajectory, TrajectoryWriter

N, FRAMES = 12, 3
PARTICLES = "particles/all"
PARAMETERS = {
    "name": "gas",
    "description": "twelve disks",
    "case": "[run]\nseed = 1\n",
    "species": json.dumps([{"name": "coins", "number": N, "material": "steel"}]),
    "materials": json.dumps(["steel", "brass", "glass"]),
    "laws": json.dumps([[{"e_n": 0.9, "e_t": -0.9, "mu": 0.1, "sticking": True, "rho": 0.0}] * 3] * 3),
    "forces": "[]",
    "gravity": "[0.0, -1.0]",
}
SEEDS = 12  # of each kind of damage at random


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
    return {each: make(folder / f"{each}.h5", each).read_bytes() for each in ("none", "gzip")}


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
        for name in ("laws", "gravity", "room"):
            with contextlib.suppress(InputError):  # parameters that frames do not need
                getattr(trajectory, name)
        for disk in trajectory.tracked:
            trajectory.history(int(disk))


def commands(path: Path) -> list[list[str]]:
    f, folder = str(path), str(path.parent)
    return [
        ["info", f],
        ["history", f, "--id", "2"],
        ["export", f, "--to", "csv", "-o", f"{folder}/o.csv", "--force"],
        ["export", f, "--to", "extxyz", "-o", f"{folder}/o.xyz", "--force"],
        ["export", f, "--to", "gsd", "-o", f"{folder}/o.gsd", "--force"],
        ["views", f],
        ["analyse", f, "velocity", "impact", "pressure", "-o", f"{folder}/analysis", "--force"],
        ["repair", f, "-o", f"{folder}/repaired.h5", "--force"],
    ]


def ends_well(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every reader gives an answer or a message; what was repaired can be read, and what needs no repair too."""
    with no_hang(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = True
        try:
            read(path)
        except InputError as error:
            assert str(path) in str(error)
            whole = False
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


@pytest.mark.parametrize("compression", ["none", "gzip"])
@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_flipped_bit_is_told_or_does_not_matter(tmp_path, capsys, files, compression, seed):
    chance = random.Random(f"{compression}{seed}")
    content = bytearray(files[compression])
    used = [i for i, byte in enumerate(content) if byte]  # most of the rest is empty
    for _ in range(chance.choice((1, 1, 3))):
        content[chance.choice(used)] ^= 1 << chance.randrange(8)
    path = tmp_path / "run.h5"
    path.write_bytes(content)
    ends_well(path, capsys)
