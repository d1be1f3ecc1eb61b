"""Trends with speed, laws that depend on speed, mixtures of materials, and quantities that are missing."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from support import track_simulator as simulator
from support.figures import assert_labels_are_apart

from ifrdem import fit
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.fit import figure

NAMES = ("vx_1", "vy_1", "spin_1", "vx_2", "vy_2", "spin_2")


def collided(e_n: np.ndarray, speed: np.ndarray, *, seed: int = 1, noise: float = 0.005) -> fit.Collisions:
    """Collisions (n,) by the law of the track simulator, each with its own e_n and |g|; e_t = -0.9, mu = 0.2."""
    rng, n, R, m = np.random.default_rng(seed), len(e_n), np.array([0.02, 0.02]), np.array([0.03, 0.03])
    rows, normals = [], []
    for one, size in zip(e_n, speed, strict=True):
        phi, psi = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(-70.0, 70.0))
        normal = np.array([np.cos(phi), np.sin(phi)])
        v = np.stack([size * np.array([np.cos(phi + psi), np.sin(phi + psi)]), np.zeros(2)])
        w = rng.normal(0.0, 1.0, 2)
        before = np.column_stack([v, w]).ravel()
        simulator.collide((float(one), -0.9, 0.2), normal, m, R, v, w)
        rows.append(np.concatenate([before, np.column_stack([v, w]).ravel()]))
        normals.append(phi + noise * rng.standard_normal())
    names = (*NAMES, *(f"{name}_after" for name in NAMES))
    errors = {name: noise / R[0] if name.startswith("s") else noise for name in names}
    columns = dict(zip(names, np.array(rows).T, strict=True))
    measured = {name: value + errors[name] * rng.standard_normal(n) for name, value in columns.items()}
    disk = fit.Disk(mass=m[0], radius=R[0])
    return fit.Collisions(
        disk_1=disk,
        disk_2=disk,
        measured={"nx": np.cos(normals), "ny": np.sin(normals), **measured},
        errors={"normal": noise, **errors},
    )


def table(data: fit.Collisions, path: Path, material: list[str] | None = None) -> None:
    names = [*data.measured]
    lines = [",".join([*names, *(["material_1", "material_2"] if material else [])])]
    for i in range(len(data)):
        row = [f"{data.measured[name][i]:.8g}" for name in names]
        lines.append(",".join([*row, *([material[i], material[i]] if material else [])]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.full
def test_restitution_that_falls_with_speed_is_found_and_fitted() -> None:
    """e_n = 1 - A g_n^(1/5) with A = 0.15; head-on and oblique impacts differ in g_n, so e_n is made in two rounds."""
    speed = np.geomspace(0.1, 3.0, 80)
    rng = np.random.default_rng(1)
    psi = []
    for _ in speed:  # the angles that `collided` draws
        rng.uniform(0.0, 2.0 * np.pi)
        psi.append(np.radians(rng.uniform(-70.0, 70.0)))
        rng.normal(0.0, 1.0, 2)
        rng.standard_normal()
    data = collided(1.0 - 0.15 * (speed * np.cos(psi)) ** 0.2, speed)
    found = fit.fit(data, model=["ifr-percussion", "ifr-viscoelastic"], profile=False)
    assert found.best == "ifr-viscoelastic"
    assert found.decided
    A = found.laws["ifr-viscoelastic"].estimates["A"]
    assert A.value == pytest.approx(0.15, abs=4.0 * A.standard_error)
    constant, law = (found.laws[name].trends for name in ("ifr-percussion", "ifr-viscoelastic"))
    assert constant is not None
    assert law is not None
    (trend,) = (each for each in constant.each if each.coefficient == "e_n")
    true = -0.15 * (trend.high**0.2 - trend.low**0.2)
    assert trend.change == pytest.approx(
        true, abs=4.0 * trend.error + 0.1 * abs(true)
    )  # not linear in ln g_n
    assert trend.probability < 1e-4
    assert min(each.probability for each in law.each) > 1e-3
    assert any("e_n depends on g_n" in each for each in found.laws["ifr-percussion"].warnings)


@pytest.mark.full
def test_trends_and_coefficients_of_single_impacts_do_not_believe_wrong_errors() -> None:
    """Errors stated three times too small: a trend's own comes from the scatter. Of 20 a probability below 0.001 has a
    chance of 2 %, and of pulls of three standard errors nearly all tables would have one.
    """
    low = []
    for seed in range(5):
        data = collided(np.full(24, 0.85), np.geomspace(0.3, 2.0, 24), seed=seed)
        stated = replace(data, errors={name: each / 3.0 for name, each in data.errors.items()})
        found = fit.fit(stated, model=["ifr-percussion"], profile=False).laws["ifr-percussion"]
        assert found.trends is not None
        low += [each.probability for each in found.trends.each]
        assert found.trends.clusters is None
    assert len(low) == 20
    assert min(low) > 1e-3
    pulls = (found.trends.value[:, 0] - 0.85) / (3.0 * found.trends.error[:, 0])
    assert 0.7 < np.std(pulls) < 1.3  # of 24: 14 %


@pytest.mark.full
def test_trends_without_cause_have_uniform_probabilities() -> None:
    """Over 20 sets: of 80 probabilities 4 are expected below 0.05; 12 or more have a chance of 5e-4."""
    low = total = 0
    for seed in range(20):
        data = collided(np.full(30, 0.85), np.geomspace(0.3, 2.0, 30), seed=seed)
        found = fit.fit(data, model=["ifr-percussion"], profile=False).laws["ifr-percussion"]
        assert found.trends is not None
        low += sum(each.probability < 0.05 for each in found.trends.each)
        total += len(found.trends.each)
    assert total == 80
    assert low < 12


@pytest.mark.full
def test_a_law_that_depends_on_speed_needs_speeds_and_gives_no_material(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("data.csv").write_text(fit.example(), encoding="utf-8")
    assert main(["fit", "data.csv", "--M", "1", "--model", "ifr-viscoelastic"]) == 2
    assert "model ifr-viscoelastic: requires speeds" in capsys.readouterr().err
    table(collided(np.full(12, 0.85), np.geomspace(0.3, 2.0, 12)), Path("hits.csv"))
    disks = ["--disk-1", "0.03,0.02", "--disk-2", "0.03,0.02"]
    options = [
        *disks,
        "--model",
        "ifr-viscoelastic",
        "--error",
        "normal=0.005",
        "--error",
        "velocities=0.005",
    ]
    assert main(["fit", "hits.csv", *options, "--error", "spins=0.25", "--write-material", "m.toml"]) == 1
    assert "no material is written: no case has the law" in capsys.readouterr().err
    found = fit.fit(collided(np.full(12, 0.85), np.ones(12)), model=["ifr-viscoelastic"], profile=False)
    with pytest.raises(InputError, match="depends on speed"):
        found.law()


@pytest.mark.full
def test_a_mixture_is_noticed_and_a_column_of_materials_separates_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    e_n = np.where(np.arange(60) % 3 == 0, 0.6, 0.9)
    data = collided(e_n, np.full(60, 1.0))
    one = fit.fit(data, model=["ifr-percussion"], profile=False).laws["ifr-percussion"]
    assert one.trends is not None
    assert one.trends.clusters is not None
    assert len(one.trends.clusters) == 2
    (low, below), (high, above) = one.trends.clusters
    assert (below, above) == (20, 40)
    assert (low, high) == pytest.approx((0.6, 0.9), abs=0.05)  # of each impact alone: to first order
    three = np.array([0.7, 0.8, 0.87])[np.arange(30) % 3]
    of_three = fit.fit(collided(three, np.full(30, 1.0)), model=["ifr-percussion"], profile=False)
    found = of_three.laws["ifr-percussion"].trends.clusters  # type: ignore[union-attr]
    assert found is not None
    assert [number for _, number in found] == [10, 10, 10]
    assert [value for value, _ in found] == pytest.approx([0.7, 0.8, 0.87], abs=0.01)
    pure = fit.fit(collided(np.full(30, 0.9), np.full(30, 1.0)), model=["ifr-percussion"], profile=False)
    assert pure.laws["ifr-percussion"].trends.clusters is None  # type: ignore[union-attr]

    table(data, Path("hits.csv"), ["steel" if e < 0.8 else "glass" for e in e_n])
    errors = ["--error", "normal=0.005", "--error", "velocities=0.005", "--error", "spins=0.25"]
    disks = ["--disk-1", "0.03,0.02", "--disk-2", "0.03,0.02", "--model", "ifr-percussion"]
    assert main(["fit", "hits.csv", *disks, *errors]) == 0
    first, second = capsys.readouterr().out.splitlines()[-2:]
    assert first.split()[:2] == ["glass,", "glass"]
    assert second.split()[:2] == ["steel,", "steel"]
    assert "e_n 0.90" in first or "e_n 0.89" in first
    assert "e_n 0.60" in second or "e_n 0.59" in second
    text = Path("hits.csv").read_text(encoding="utf-8").replace("material_2", "other")
    Path("hits.csv").write_text(text, encoding="utf-8")
    assert main(["fit", "hits.csv", *disks, *errors]) == 2
    assert "material_1 and material_2: must both be given" in capsys.readouterr().err


def test_reports_and_pictures_name_the_units_of_a_table_in_si(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a comment as `ifrdem collisions` writes it, or by units of all columns; of other tables they are not known."""
    path, data = tmp_path / "hits.csv", collided(np.full(24, 0.85), np.geomspace(0.2, 0.9, 24))
    table(data, path)
    text = path.read_text(encoding="utf-8")
    head, _, rows = text.partition("\n")
    whole = ",".join(
        f"{name} ({'rad/s' if name[0] == 's' else 'm/s'})" if name[0] in "sv" else name
        for name in head.split(",")
    )
    errors = {name: float(np.max(each)) for name, each in data.errors.items()}
    found = []
    for content in (f"# found; SI units\n{text}", f"{whole}\n{rows}", text):
        path.write_text(content, encoding="utf-8")
        found.append(fit.read(path, errors, disk_1=data.disk_1, disk_2=data.disk_2))
    assert [isinstance(each, fit.Collisions) and each.si for each in found] == [True, True, False]
    figures: list[Figure] = []
    monkeypatch.setattr(figure, "save", lambda one, _: figures.append(one))
    fits = [fit.fit(each, model=["ifr-percussion", "smooth"], profile=False) for each in (found[0], found[2])]
    named, plain = map(fit.table, fits)
    assert "disk 1: mass 0.03 kg, radius 0.02 m, k 2\n" in named
    assert "vx_1 0.005 m/s" in named
    assert "spin_1 0.25 rad/s" in named
    assert re.search(r"change with g_n from 0\.\d+ to 0\.\d+ m/s: ", named)
    assert "disk 1: mass 0.03, radius 0.02, k 2\n" in plain
    assert re.search(r"change with g_n from 0\.\d+ to 0\.\d+: ", plain)
    # The number of coefficients has a name of its own; p is a probability, and none is 0.
    assert re.search(r"law +coefficients +ln L", named)
    assert re.search(r"smooth +1 ", named)
    assert "probability below 1e-16" in named
    for one in fits:
        figure.speeds(one, [])
    (left, right, *_), (other, *_) = (one.axes for one in figures)
    assert left.get_xlabel() == "normal speed $g_n$ (m/s)"
    assert "(m/s)" in right.get_xlabel()
    assert other.get_xlabel() == "normal speed $g_n$ (length/time)"
    assert_labels_are_apart(left)


def test_advice_names_what_was_not_measured() -> None:
    """The slip before and after needs the spins; e_t* alone holds mu (1 + e_n) only (Eq. 26)."""
    data = collided(np.full(30, 0.85), np.full(30, 1.0))
    without = {name: value for name, value in data.measured.items() if not name.startswith("spin")}
    blind = replace(data, measured=without, errors={name: data.errors[name] for name in without})
    warnings = fit.fit(blind, model=["ifr-percussion"], profile=False).laws["ifr-percussion"].warnings
    (advice,) = (each for each in warnings if "not measured" in each)
    assert advice.startswith("spin_1 and spin_2 and spin_1_after and spin_2_after are not measured: ")
    assert "e_t and mu cannot be separated" in advice
    assert not any("measure impacts at larger psi" in each for each in warnings)
    whole = fit.fit(data, model=["ifr-percussion"], profile=False).laws["ifr-percussion"].warnings
    assert not any("not measured" in each for each in whole)
