"""From tables of impacts to a case of a gas: species, materials, pairs and walls, with errors of coefficients."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem import fit
from ifrdem.case.fitted import text_of
from ifrdem.cli.main import main
from ifrdem.errors import InputError

SIZES = {"steel": (3.0e-3, 8.75e-3), "brass": (1.19e-3, 10.5e-3)}
LAWS = {
    ("steel", "steel"): (0.9, -0.9, 0.1), ("brass", "brass"): (0.8, -0.8, 0.2), ("brass", "steel"): (0.85, -0.85, 0.15),
    ("steel", "wall"): (0.7, -0.9, 0.12), ("brass", "wall"): (0.6, -0.8, 0.18),
}  # fmt: skip
NOISE = 1e-3
HEAD = "nx,ny," + ",".join(
    f"{name}_{i}{end}" for end in ("", "_after") for i in "12" for name in ("vx", "vy", "spin")
)


def table(pairs: Iterable[tuple[str, str]], n: int = 12, *, materials: bool = True) -> str:
    """Impacts by the public `ifrdem.collide`, with errors of velocities and R w, of both kinds either way round."""
    rng, lines = np.random.default_rng(1), []
    for pair, i in itertools.product(pairs, range(n)):
        two = pair if i % 2 or "wall" in pair else pair[::-1]
        mass, radius = zip(*(SIZES.get(each, (np.inf, 1.0)) for each in two), strict=True)
        psi = np.radians(-70.0 + 140.0 * i / (n - 1))
        v = np.array([[np.cos(psi), np.sin(psi)], [0.0, 0.0]])
        spin = np.array([rng.normal(0.0, 10.0), 0.0])
        law = ifrdem.IFRLaw(**dict(zip(("e_n", "e_t", "mu"), LAWS[pair], strict=True)))
        out = ifrdem.collide(law, (1.0, 0.0), mass, radius, [2.0, 2.0], v, spin)
        moves = np.isfinite(mass)
        row = [1.0, 0.0]
        for velocity, w in ((v, spin), (out.velocity, out.spin)):
            for one in (0, 1):
                noise = NOISE * moves[one] * rng.standard_normal(3)
                row += [*(velocity[one] + noise[:2]), w[one] + noise[2] / radius[one]]
        names = [str(each) for each in two] if materials else []
        lines.append(
            ",".join(
                [
                    *(f"{each:.9g}" for each in row),
                    *(f"{m:g},{r:g}" for m, r in zip(mass, radius, strict=True)),
                    *names,
                ]
            )
        )
    more = ",mass_1,radius_1,mass_2,radius_2" + ",material_1,material_2" * materials
    return "\n".join((HEAD + more, *lines)) + "\n"


OPTIONS = (
    "--error",
    f"velocities={NOISE}",
    "--error",
    "spins=0.1",
    "--error",
    "normal=1e-3",
    "--model",
    "ifr-percussion",
)
ALL = [pair for pair in LAWS if "wall" not in pair]
WALLS = [pair for pair in LAWS if "wall" in pair]


def fits(*tables: str, kinds: bool = True) -> list[fit.Fit]:
    """Fits of tables, without the intervals, which take most of the time of a command."""
    found = []
    for text in tables:
        Path("hits.csv").write_text(text, encoding="utf-8")
        data = fit.read("hits.csv", {"velocities": NOISE, "spins": 0.1, "normal": 1e-3})
        assert isinstance(data, fit.Collisions)
        found += [
            fit.fit(each, model=["ifr-percussion"], profile=False)
            for each in (data.kinds() if kinds else [data])
        ]
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.full
def test_tables_of_disks_and_walls_become_a_gas_that_a_study_draws_from(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every coefficient within 4 of the errors that are written; spins of the generator have the rms 10 of one of two disks."""
    Path("gas.toml").write_text(text_of(fits(table(ALL), table(WALLS)), "gas", "a gas"), encoding="utf-8")
    case = tomllib.loads(Path("gas.toml").read_text(encoding="utf-8"))
    found = {(each["name"],) * 2: each for each in case["material"]}
    found |= {tuple(each["materials"]): each for each in case["pair"]}
    assert {tuple(sorted(pair)) for pair in found} == {tuple(sorted(pair)) for pair in LAWS}
    for pair, each in found.items():
        truth = LAWS.get(pair) or LAWS[pair[::-1]]  # type: ignore[index]
        assert list(each["errors"]) == ["e_n", "e_t", "mu"]
        for name, value in zip(each["errors"], truth, strict=True):
            assert abs(each[name] - value) < 4.0 * each["errors"][name], (pair, name)
            assert 1e-5 < each["errors"][name] < 0.05
        assert set(each["correlations"]["e_n"]) == {"e_t", "mu"}
    assert {each["name"]: (each["mass"], each["radius"]) for each in case["species"]} == SIZES
    assert [each["number"] for each in case["species"]] == [2000, 2000]
    assert case["box"]["material"] == "wall"
    assert case["run"]["name"] == "a_gas"
    assert case["species"][0]["speed_rms"] == pytest.approx(
        np.sqrt(0.6), rel=0.1
    )  # rest and speed 1, and walls
    assert main(["check", "gas.toml"]) == 0
    shown = capsys.readouterr().out
    assert "law of steel, wall (wall)" in shown
    assert main(["study", "gas.toml", "--coefficients", "3", "--dry-run"]) == 0
    shown = capsys.readouterr().out
    assert "3 points x 1 seed" in shown
    assert shown.count("pair[") == 9


def test_disks_without_names_have_that_of_the_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("coins.csv").write_text(table([("brass", "brass")], materials=False), encoding="utf-8")
    assert main(["fit", "coins.csv", *OPTIONS, "--write-case", "gas.toml"]) == 0
    assert "wrote gas.toml" in capsys.readouterr().out
    case = tomllib.loads(Path("gas.toml").read_text(encoding="utf-8"))
    assert (
        [each["name"] for each in case["material"]] == [each["name"] for each in case["species"]] == ["coins"]
    )
    assert "periodic" not in case["box"]
    assert case["species"][0]["number"] == 4000


@pytest.mark.parametrize(
    ("pairs", "kinds", "message"),
    [
        (ALL[:1] + ALL[2:], True, "no impacts of brass (mass 0.00119, radius 0.0105) on brass"),
        (
            ALL[:2],
            True,
            "no impacts of brass (mass 0.00119, radius 0.0105) on steel (mass 0.003, radius 0.00875)",
        ),
        (ALL[:2], False, "2 pairs of kinds of disks were fitted together"),
    ],
)
def test_a_gas_whose_pairs_were_not_all_measured_is_not_written(
    folder: Path, pairs: list[tuple[str, str]], kinds: bool, message: str
) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        text_of(fits(table(pairs, 6), kinds=kinds), "gas", "gas")


def test_a_table_of_angles_is_no_gas(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("data.csv").write_text(ifrdem.fit.example(), encoding="utf-8")
    assert (
        main(
            ["fit", "data.csv", "--M", "1", "--error", "0.7", "--model", "smooth", "--write-case", "gas.toml"]
        )
        == 1
    )
    assert (
        "a table of angles has no masses, radii and speeds: --write-material writes"
        in capsys.readouterr().err
    )
