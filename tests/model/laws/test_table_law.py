"""Tabulated laws: interpolation, energy, files, cases."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cases import case_text

import ifrdem
from ifrdem import InputError, laws
from ifrdem.cli import main as cli
from ifrdem.model.laws.law import EnergyWarning
from ifrdem.model.laws.records import from_record, to_record

M_N, M_T = 0.5, 0.5 / 3.0  # of two disks of mass 1, k = 2
DISKS: Any = {"normal": [1.0, 0.0], "mass": [1.0, 1.0], "radius": [0.5, 0.5], "k": [2.0, 2.0]}
TABLE = laws.TableLaw(
    slip=[0.2, 0.5, 1.0, 1.6, 3.0], ratio=[0.03, 0.12, 0.18, 0.2, 0.2], e_n=[0.95, 0.85], g_n=[0.1, 3.0]
)
FILE = "slip,ratio,g_n,e_n\n0.2,0.03,0.1,0.95\n0.5,0.12,3.0,0.85\n1.0,0.18,,\n1.6,0.2,,\n3.0,0.2,,\n"


def impacts(law: laws.CollisionLaw, g_n: Any, g_t: Any) -> ifrdem.Collision:
    """Two disks, the second at rest, without spin."""
    first = np.stack(np.broadcast_arrays(np.asarray(g_n, float), np.asarray(g_t, float)), axis=-1)
    return ifrdem.collide(
        law, velocity=np.stack([first, np.zeros_like(first)], axis=-2), spin=np.zeros(first.shape), **DISKS
    )


def test_ratio_and_e_n_are_linear_between_points_and_constant_beyond() -> None:
    """At slips 0.2, 0.35, 2 and 1e4 r is 0.03, half of 0.03 + 0.12, and 0.2; e_n(1.55) = 0.90, halfway."""
    found = impacts(TABLE, 1.0, [0.2, 0.35, 2.0, 1e4, 0.1, 0.0])
    np.testing.assert_allclose(found.P_t / found.P_n, [0.03, 0.075, 0.2, 0.2, 0.015, 0.0], rtol=1e-13)
    speeds = np.array([1e-6, 0.1, 1.55, 3.0, 1e4])
    np.testing.assert_allclose(
        impacts(TABLE, speeds, 0.0).P_n / (M_N * speeds) - 1.0, [0.95, 0.95, 0.9, 0.85, 0.85]
    )
    # Beyond 1.6, from where on r is what it is at the last point, impacts slide.
    assert impacts(TABLE, 1.0, [1.59, 1.61]).regime.tolist() == [
        ifrdem.Regime.STICKING,
        ifrdem.Regime.SLIDING,
    ]


def test_walton_s_law_is_a_table_of_one_point() -> None:
    """mu P_n = (1 + beta_0) m_t |g_t| where |g_t| / g_n = 3 mu (1 + e_n) / (1 + beta_0)."""
    walton = laws.Walton(e_n=0.9, beta_0=0.4, mu=0.2)
    table = laws.TableLaw(slip=[3.0 * 0.2 * 1.9 / 1.4], ratio=[0.2], e_n=0.9)
    rng = np.random.default_rng(1)
    velocity, spin = rng.normal(size=(1000, 2, 2)), rng.normal(size=(1000, 2))
    one, other = (ifrdem.collide(law, velocity=velocity, spin=spin, **DISKS) for law in (walton, table))
    np.testing.assert_allclose(one.velocity, other.velocity, atol=2e-15)
    np.testing.assert_allclose(one.spin, other.spin, atol=1e-14)
    np.testing.assert_array_equal(one.regime, other.regime)
    assert {*one.regime.tolist()} == {0, 1, 2}


def gain(slip: Any, ratio: Any, e_n: float, a: float) -> float:
    """Largest change of the energy of a pair, in m_n g_n^2 / 2, over 8,000 slips."""
    x = np.concatenate((np.linspace(0.0, 1.5 * slip[-1], 4000), np.geomspace(1e-4, 100.0, 4000)))
    q = (1.0 + e_n) * np.interp(x, np.r_[0.0, slip], np.r_[0.0, ratio])
    return float(np.max(-(1.0 - e_n**2) + a * q**2 - 2.0 * q * x))


def refusal(**table: Any) -> str:
    """Why a table is refused; nothing if it is not."""
    try:
        laws.TableLaw(**table)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.filterwarnings("ignore::ifrdem.EnergyWarning")
def test_a_table_is_refused_exactly_if_an_impact_gains_energy() -> None:
    """Random tables and k, by the energies of slips that lie densely; those within 1e-3 of the edge may be missed."""
    rng, refused = np.random.default_rng(2), 0
    for _ in range(150):
        slip = np.sort(rng.uniform(0.02, 3.0, 3))
        ratio, k, e_n = rng.uniform(-0.1, 1.3, 3) * slip / slip[-1], *rng.uniform(0.5, (3.0, 1.0))
        ratio[-1] = abs(ratio[-1])
        most, said = gain(slip, ratio, e_n, 1.0 + k), refusal(slip=slip, ratio=ratio, e_n=e_n, k=k)
        assert ("would add energy" in said) == bool(said)
        assert most > -1e-3 if said else most <= 1e-9
        refused += bool(said)
    assert 15 < refused < 135


def test_energy_is_examined_for_the_disks_that_are_there() -> None:
    """P_t = 2 m_t |g_t|, the most that takes no energy: r = 2 x / (a (1 + e_n)), at a = 3, is too much for k = 3."""
    law = laws.TableLaw(slip=[0.3], ratio=[2.0 * 0.3 / (3.0 * 2.0)], e_n=1.0)
    assert law.admissibility(2.0, 2.0).strict
    with pytest.raises(InputError, match=r"ratio\[0\].*would add energy at slip = 0\.3.*kbar = 4"):
        ifrdem.collide(law, velocity=np.zeros((2, 2)), spin=[0.0, 0.0], **{**DISKS, "k": [3.0, 3.0]})
    with pytest.warns(EnergyWarning, match="tangential impulses alone add energy"):
        laws.TableLaw(slip=[0.3], ratio=[0.11], e_n=0.9, k=3.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("slip,ratio\n0.5,0.1\n0.2,0.05\n", "law.csv: line 3: slip = 0.2 after 0.5: must ascend"),
        (
            "psi,ratio\n20,0.1\n95,0.2\n",
            "law.csv: line 3: psi = 95: must be an angle from 0 to below 90 degrees",
        ),
        ("slip,ratio\n0,0.1\n0.5,0.2\n", "law.csv: line 2: ratio = 0.1 at slip = 0: must be 0"),
        (
            "slip,ratio\n# gains\n0.1,0.05\n0.2,0.6\n0.5,0.7\n",
            "law.csv: line 5: a collision would add energy",
        ),
        ("slip,ratio\n0.5,0.1\n0.7,\n", "law.csv: line 3: must have both slip and ratio, or neither"),
        ("slip,rato\n0.5,0.1\n", "ratio"),
        ("slip,ratio,e_n\n0.5,0.1,0.9\n", "e_n = 0.9: is given, and the file has a column e_n"),
        ("slip,ratio\n0.5,0.1\n1.0,-0.1\n", "line 3: ratio = -0.1: must be 0 or more at the last point"),
        (
            "slip,ratio\n" + "".join(f"{i + 1},0.2\n" for i in range(128)),
            "slip has 128 points: must be 127 at most",
        ),
    ],
    ids=["order", "angle", "origin", "energy", "gap", "name", "both", "end", "many"],
)
def test_mistakes_of_a_file_are_named_by_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "law.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        laws.TableLaw.read(tmp_path / "law.csv", e_n=0.9)
    assert message in str(error.value)


def test_e_n_of_a_file_needs_speeds_and_a_range(tmp_path: Path) -> None:
    path = tmp_path / "law.csv"
    path.write_text(FILE, encoding="utf-8")
    assert laws.TableLaw.read(path) == TABLE
    path.write_text(FILE.replace("0.85", "1.85"), encoding="utf-8")
    with pytest.raises(InputError, match=r"line 3: e_n = 1\.85: must be a number from 0 to 1"):
        laws.TableLaw.read(path)
    path.write_text("psi (rad),ratio\n0.2,0.04\n0.5,0.1\n", encoding="utf-8")
    np.testing.assert_allclose(laws.TableLaw.read(path, e_n=0.9).slip, np.tan([0.2, 0.5]), rtol=1e-14)
    with pytest.raises(InputError, match="e_n: missing"):
        laws.TableLaw.read(path)


def test_records_and_copies_are_the_law() -> None:
    for law in (TABLE, laws.TableLaw(slip=[0.5], ratio=[0.1], e_n=0.9)):
        assert from_record(json.loads(json.dumps(to_record(law)))) == law
        assert pickle.loads(pickle.dumps(law)) == law
    assert laws.TableLaw(slip=[0.5], ratio=[0.1], e_n=0.8) != law


CASE = {
    "material[0].law": "table", "material[0].e_n": None, "material[0].e_t": None, "material[0].mu": None,
    "material[0].file": "law.csv", "run.collisions_per_disk": 2.0, "run.t_end": None,
}  # fmt: skip


@pytest.mark.full
def test_a_case_runs_by_the_table_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The path is from the case file; the trajectory has the numbers, and needs no file."""
    (path := tmp_path / "gas.toml").write_text(case_text(CASE), encoding="utf-8")
    (tmp_path / "law.csv").write_text(FILE, encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    assert "(law = table, file = law.csv" in capsys.readouterr().out
    assert cli.main(["run", str(path), "-o", str(tmp_path / "gas.h5")]) == 0
    (tmp_path / "law.csv").unlink()
    with ifrdem.Trajectory(tmp_path / "gas.h5") as run:
        assert run.laws == [[TABLE]]
        assert run.observables["energy"][-1] < run.observables["energy"][0]
    capsys.readouterr()
    assert cli.main(["check", str(path)]) == 2
    assert "material[0].file" in (said := capsys.readouterr().err)
    assert "law.csv: there is no such file" in said
