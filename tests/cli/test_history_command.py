"""`ifrdem history`, `views` and `info` on the command line."""

from __future__ import annotations

import csv
import os

import h5py
import numpy as np
import pytest
from support.layout_files import add_histories, some_state, write

from ifrdem.cli.main import main
from ifrdem.model.laws.ifr import Regime, regime_name
from ifrdem.trajectory.reader import Trajectory


@pytest.fixture
def tracked(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=9, units={"length": "m", "time": "s", "momentum": "kg m s-1", "angle": "rad"})
    state = some_state(9, 0)
    start = {"time": 0.0, **{k: getattr(state, k)[[3, 7]] for k in ("position", "velocity", "spin", "image")}}
    rng = np.random.default_rng(4)
    events = [
        {
            "time": 0.1 * (i + 1),
            "id": 7,
            "partner": (3, -1, -3)[i % 3],
            "position": rng.uniform(size=2),
            "impulse": rng.normal(size=2),
            "psi": 0.1,
            "regime": (1, 0, 2)[i % 3],
        }
        for i in range(12)
    ]
    add_histories(path, [3, 7], start, events, [(12, 2.0)])
    return path


def test_history_shows_a_summary_and_the_latest_collisions(tracked, capsys):
    assert main(["history", str(tracked), "--id", "7"]) == 0
    lines = capsys.readouterr().out.splitlines()
    # 12 events: 4 with disk 3, 4 kicks, 4 with wall 1
    assert lines[0] == "disk 7: 8 collisions from t = 0 to 2 s, 4 of them with walls; 4 kicks by forces"
    # collisions at 0.1, 0.3, 0.4, 0.6, ... 1.2: from the first to the eighth 1.1 in 7 steps
    assert lines[1] == f"  mean free time {1.1 / 7.0:.6g} s"
    assert len(lines) == 4 + 8  # kicks would hide the collisions of a driven disk
    assert lines[-1].split()[:4] == ["1.2", "wall", "1", "sticking"]
    assert not any("kick" in line for line in lines[1:])


def test_units_are_printed_under_the_names_of_columns_and_reduced_files_have_none(tracked, capsys):
    assert main(["history", str(tracked), "--id", "7"]) == 0
    names, units, first = capsys.readouterr().out.splitlines()[2:5]
    ends = {unit: units.index(unit) + len(unit) for unit in ("(s)", "(rad)", "(rad/s)")}
    assert names[: ends["(s)"]].endswith("time")
    assert names[: ends["(rad)"]].endswith("psi")
    assert names[: ends["(rad/s)"]].endswith("spin after")
    before, _, after = units.partition("(kg m s-1)")
    assert names[: len(before) + 10].endswith("P_n")
    assert names[: len(before) + 10 + len(after.partition("(kg m s-1)")[0]) + 10].endswith("P_t")
    assert len(names) == len(units) == len(first)
    with h5py.File(tracked, "r+") as file:
        for name in list(file["parameters/units"]):
            del file["parameters/units"][name]
    assert main(["history", str(tracked), "--id", "7"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == names
    assert lines[3] == first


def test_history_reports_that_it_shows_only_the_latest_rows(tracked, monkeypatch, capsys):
    monkeypatch.setattr("ifrdem.cli.trajectory.SHOWN", 3)
    assert main(["history", str(tracked), "--id", "7"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "  the latest 3 (-o writes all; psi in rad):"
    assert len(lines) == 5 + 3


def test_history_writes_every_column_and_digit(tracked, tmp_path, capsys):
    out = tmp_path / "seven.csv"
    assert main(["history", str(tracked), "--id", "7", "-o", str(out)]) == 0
    assert f"wrote {out}: 12 events" in capsys.readouterr().out
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    with Trajectory(tracked) as trajectory:
        history = trajectory.history(7)
    assert np.array_equal([float(row["position_y"]) for row in rows], history["position"][:, 1])
    assert np.array_equal([float(row["impulse_t"]) for row in rows], history.impulse[:, 1])
    assert np.array_equal([int(row["partner"]) for row in rows], history.partner)
    assert "contact_point_x" in rows[0]


def test_histories_that_cannot_be_shown_are_refused(tracked, tmp_path, capsys):
    write(tmp_path / "old.h5")
    for arguments, reason in (
        ([str(tracked), "--id", "5"], "disk 5 of"),
        ([str(tracked), "--id", "9"], "there are 9 disks (0 to 8)"),
        ([str(tracked), "--id", "98765432109876543210"], "98765432109876543210"),
        ([str(tracked), "--id", "1e3"], "disk 1000"),
        ([str(tracked), "--id", "-1"], "--id -1: must be"),
        ([str(tracked), "--id", "7", "-o", str(tracked)], "is the trajectory itself"),
        ([str(tracked)], "--id"),
        ([str(tmp_path / "old.h5"), "--id", "0"], "output.histories"),
    ):
        assert main(["history", *arguments]) == 2
        error = capsys.readouterr().err
        assert reason in error
        assert "Traceback" not in error


def test_every_regime_of_the_law_has_words():
    assert [regime_name(i) for i in (-1, 0, 9)] == ["not known", "-", "elastic"]
    assert [regime_name(each) for each in Regime][1:] == [
        "sliding", "sticking", "sliding rolling", "sticking rolling", "sliding nonrolling", "sticking nonrolling"
    ]  # fmt: skip


def test_views_and_info_go_together(tracked, capsys):
    assert main(["link", str(tracked)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"wrote {tracked.with_suffix('.vtkhdf')}", f"wrote {tracked.with_suffix('.nc')}"
    ]  # fmt: skip
    assert main(["info", str(tracked)]) == 0
    text = capsys.readouterr().out
    assert "histories of 2 disks (3, 7)" in text
    assert "  events            12, time 0 to 2 s" in text
    assert "  link              run.nc\n" in text
    later = tracked.with_suffix(".nc").stat().st_mtime_ns + 10**9
    os.utime(tracked, ns=(later, later))
    assert main(["info", str(tracked)]) == 0
    assert "run.nc, older than the trajectory: `ifrdem link` renews it" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["link", "history --id 0", "export --to csv", "movie", "info"])
def test_files_that_are_not_ours_are_refused(tmp_path, capsys, verb):
    import h5py

    (tmp_path / "text.h5").write_text("no HDF5")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file.create_group("h5md").attrs["version"] = [1, 1]
        file.create_group("h5md/creator").attrs["name"] = "other"
    before = sorted(os.listdir(tmp_path))
    for name, reason in (
        ("text.h5", "is not an HDF5 file"),
        ("foreign.h5", "its creator: other"),
        ("no.h5", "no such"),
    ):
        word, *rest = verb.split()
        assert main([word, str(tmp_path / name), *rest]) == 2
        assert reason in capsys.readouterr().err
    assert sorted(os.listdir(tmp_path)) == before
