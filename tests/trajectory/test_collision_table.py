"""The table of collisions: each once, with the energies of the run's ledger and free flights of both disks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas
import pytest
from support.cases import case_text

import ifrdem
from ifrdem.cli.main import main
from ifrdem.quantities import MECHANISMS
from ifrdem.trajectory.collisions import COLUMNS

CASE = case_text({
    "run.collisions_per_disk": 6.0, "run.t_end": None, "box.periodic": [True, False], "box.material": "coin",
    "box.gravity": [0.0, -0.3], "material[0].rho": 0.01, "species[0].number": 20, "species[0].spin_rms": 1.0,
    "output": {"series": 10, "histories_all": True, "picture": False},
}) + """
[[species]]
name = "heavy"
number = 10
material = "coin"
mass = 3.0
radius = 0.8
k = 1.5
speed_rms = 0.5
"""  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rough disks of two kinds with rolling friction that fall between two walls, all of them tracked."""
    folder = tmp_path_factory.mktemp("collisions")
    (folder / "gas.toml").write_text(CASE)
    assert main(["run", str(folder / "gas.toml"), "-o", str(folder / "gas")]) == 0
    return folder / "gas.h5"


def test_each_collision_is_there_once_with_the_energies_of_the_ledger(path):
    with ifrdem.Trajectory(path) as run:
        table = run.to_pandas("collisions")
        series = {
            name: run.series[name] for name in ("dissipated_by_mechanism", "collisions", "wall_collisions")
        }
        lost = dict(zip(MECHANISMS, series["dissipated_by_mechanism"][-1], strict=True))
        energy = run.observables["energy"][0]
    assert [*table.columns] == [*COLUMNS]
    assert (table.partner >= 0).sum() == series["collisions"][-1] > 80
    assert (table.partner < 0).sum() == series["wall_collisions"][-1] > 20
    assert np.all(np.diff(table.time) >= 0.0)
    for name in MECHANISMS[:-1]:  # the last one is of disks that fall asleep
        assert table[f"dissipated_{name}"].sum() == pytest.approx(lost[name], abs=1e-10 * energy), name
    assert lost["rolling"] > 1e-3 * energy
    assert min(lost["sliding"], lost["sticking"], lost["walls"]) > 1e-3 * energy
    parts = table[[f"dissipated_{name}" for name in MECHANISMS[:-1]]].sum(axis=1)
    assert table.dissipated.to_numpy() == pytest.approx(parts.to_numpy(), abs=1e-12 * energy)


def test_disks_of_a_collision_have_their_species_free_times_and_paths(path):
    """Of a disk, times and ways between its collisions are those of its own history."""
    with ifrdem.Trajectory(path) as run:
        table, history = run.to_pandas("collisions"), run.history(25)
        assert {*table.species} | {*table.partner_species} == {"coins", "heavy", "wall 0", "wall 1"}
    mine = table[(table.id == 25) | (table.partner == 25)]
    assert mine.time.to_numpy() == pytest.approx(history.time)
    free_time = np.where(mine.id == 25, mine.free_time, mine.partner_free_time)
    free_path = np.where(mine.id == 25, mine.free_path, mine.partner_free_path)
    assert np.isnan(free_time[0])
    assert free_time[1:] == pytest.approx(np.diff(history.time))
    for i in range(1, 6):  # its way in many small steps
        steps = np.linspace(history.time[i - 1], np.nextafter(history.time[i], 0.0), 2000)
        way = np.hypot(*np.diff(history.unwrapped(steps), axis=0).T).sum()
        assert free_path[i] == pytest.approx(way, rel=1e-4)
    of_disk = mine[mine.id == 25]
    assert {*of_disk.species} <= {"heavy"}


def test_relative_velocities_are_those_of_the_law(path):
    """P_n = (1 + e_n) m_n g_n with e_n = 0.9; tan psi is the ratio of the velocities of the centres."""
    with ifrdem.Trajectory(path) as run:
        table, mass = run.to_pandas("collisions"), run.disks.mass
    pairs = table[table.partner >= 0]
    m_n = 1.0 / (1.0 / mass[pairs.id] + 1.0 / mass[pairs.partner])
    assert pairs.P_n.to_numpy() == pytest.approx(1.9 * m_n * pairs.g_n.to_numpy())
    walls = table[table.partner < 0]
    assert walls.P_n.to_numpy() == pytest.approx(1.9 * mass[walls.id] * walls.g_n.to_numpy())
    assert np.all(pairs.g_n > 0.0)


def test_some_tracked_disks_have_their_collisions_with_others(tmp_path, path):
    """Of two disks one of which is tracked the other has no free time; the collision counts all the same."""
    (tmp_path / "gas.toml").write_text(CASE.replace("histories_all = true", "histories = [3, 25]"))
    assert main(["run", str(tmp_path / "gas.toml"), "-o", str(tmp_path / "gas")]) == 0
    with ifrdem.Trajectory(tmp_path / "gas.h5") as run, ifrdem.Trajectory(path) as whole:
        some, every = run.to_pandas("collisions"), whole.to_pandas("collisions")
    mine = every[every.id.isin([3, 25]) | every.partner.isin([3, 25])]
    assert some.time.to_numpy() == pytest.approx(mine.time.to_numpy())
    assert some.dissipated.to_numpy() == pytest.approx(mine.dissipated.to_numpy(), rel=1e-9, abs=1e-15)
    assert some.partner_free_time[~some.partner.isin([3, 25])].isna().all()
    assert set(some.id) == {3, 25}


def test_tables_are_exported_with_every_digit(path, tmp_path, capsys):
    with ifrdem.Trajectory(path) as run:
        table = run.to_pandas("collisions")
    for to in ("csv", "parquet"):
        out = tmp_path / f"c.{to}"
        assert main(["export", str(path), "--to", to, "--what", "collisions", "-o", str(out)]) == 0
        found = pandas.read_csv(out) if to == "csv" else pandas.read_parquet(out)
        assert [*found.columns] == [*COLUMNS]
        assert np.array_equal(found.dissipated, table.dissipated)
        assert np.array_equal(found.free_time, table.free_time, equal_nan=True)
    assert (tmp_path / "c.csv").read_text().startswith("time,id,partner,")
    capsys.readouterr()
    for words, message in (
        (["--to", "gsd", "--what", "collisions"], "--to gsd: cannot be combined with --what collisions"),
        (["--to", "csv", "--what", "collisions", "--frames", "3"], "--frames: cannot be combined"),
        (["--to", "parquet"], "--to parquet requires --what collisions"),
    ):
        assert main(["export", str(path), *words, "-o", str(tmp_path / "no")]) == 2
        assert message in capsys.readouterr().err
