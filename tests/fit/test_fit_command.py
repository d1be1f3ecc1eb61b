"""`ifrdem fit`: its output, and refusals before any work."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support import manual

from ifrdem import fit
from ifrdem.cli.main import main
from ifrdem.tools.progress import Stage

ROOT = Path(__file__).parents[2]
FIT_EXAMPLE = ("fit", "data.csv", "--M", "1", "--error", "0.7")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own working folder with the example in it."""
    (tmp_path / "data.csv").write_text(fit.example(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(arguments: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The complaints of a command that must fail and leave nothing behind."""
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert main(["fit", *arguments]) == 2
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    shown = capsys.readouterr()
    assert shown.out == ""
    lines = shown.err.splitlines()
    assert all(line.startswith("ifrdem: ") for line in lines)
    return [line.removeprefix("ifrdem: ") for line in lines]


def test_example_is_printed_unchanged(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "--example"]) == 0
    assert capsys.readouterr().out == fit.example()


def test_fit_writes_the_requested_files(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ["--write-material", "coins.toml", "--material-name", "al"]
    assert main([*FIT_EXAMPLE, "--json", "fit.json", "--model", "ifr-percussion", *more]) == 0
    shown = capsys.readouterr().out
    assert "ifr-percussion: IFR, percussion centre (Eq. 15)" in shown
    assert "wrote fit.json, coins.toml" in shown
    found = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    written = tomllib.loads((folder / "coins.toml").read_text(encoding="utf-8"))["material"][0]
    estimates = found["laws"]["ifr-percussion"]["estimates"]
    assert written["name"] == "al"
    assert written["sticking"] == "percussion_center"
    for name in ("e_n", "e_t", "mu"):
        assert written[name] == pytest.approx(estimates[name]["value"], abs=1e-6)


def test_material_fits_into_a_case_that_check_likes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*FIT_EXAMPLE, "--model", "ifr-percussion", "--write-material", "coins.toml"]) == 0
    case = (ROOT / "cases" / "cooling.toml").read_text(encoding="utf-8")
    begin, end = case.index("[[material]]"), case.index("# The coin of 1 pta")
    case = case[:begin] + (folder / "coins.toml").read_text(encoding="utf-8") + case[end:]
    (folder / "case.toml").write_text(
        case.replace('material = "aluminium"', 'material = "data"'), encoding="utf-8"
    )
    capsys.readouterr()
    assert main(["check", "case.toml"]) == 0
    written = tomllib.loads((folder / "coins.toml").read_text(encoding="utf-8"))["material"][0]
    shown = capsys.readouterr().out
    assert re.search(rf"e_n = {written['e_n']:g}", shown)


@pytest.mark.full
def test_coins_of_the_paper_give_mass_ratio_and_radii(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["fit", "data.csv", "--pair", "500 pts", "100 pts", "--error", "1", "--model", "ifr-contact"])
        == 0
    )
    shown = capsys.readouterr().out
    assert "M = 1.30011, k_1 = 2, k_2 = 2, R_1 = 0.014, R_2 = 0.01225" in shown  # 12.00 g / 9.23 g
    assert "percussion" not in shown


def test_law_that_adds_energy_is_shown_but_gives_no_material(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """tan(delta_2) = (1 + e_t)/(3 (1 + e_n)) tan(psi) + mu with e_n = 0.95, e_t = 0.5, mu = 0.8; see test_fit.py."""
    from test_fit import impacts

    data = impacts((0.95, 0.5, 0.8), error=0.2)
    rows = zip(data.psi, data.measured["delta_1"], data.measured["delta_2"], strict=True)
    text = "psi,delta_1,delta_2\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows)
    (folder / "hot.csv").write_text(text, encoding="utf-8")
    arguments = ["hot.csv", "--M", "1", "--error", "0.2", "--model", "ifr-percussion"]
    assert main(["fit", *arguments, "--write-material", "hot.toml"]) == 1
    shown = capsys.readouterr()
    assert "SOME COLLISIONS ADD ENERGY" in shown.out
    assert "no material is written" in shown.err
    assert not (folder / "hot.toml").exists()


def test_errors_are_estimated_without_the_option(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The example has errors of 0.7 degrees in 54 values, with 33 degrees of freedom: 12 %."""
    assert main(["fit", "data.csv", "--M", "1", "--model", "ifr-percussion"]) == 0
    found = re.search(
        r"errors estimated from the residuals \(one sigma\): angles (\S+)", capsys.readouterr().out
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(0.7, rel=0.3)


def test_progress_is_shown_from_two_seconds_on(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that gains half a second at each look."""
    seconds = iter(np.arange(0.0, 1e4, 0.5))
    monkeypatch.setattr(
        Stage.__init__, "__kwdefaults__", {"interval": 5.0, "clock": lambda: float(next(seconds))}
    )
    assert main(["fit", "data.csv", "--M", "1", "--error", "0.7", "--model", "ifr-percussion"]) == 0
    shown = capsys.readouterr().err
    parts = [float(each) for each in re.findall(r"fit: (\d+) % done", shown)]
    assert len(parts) > 3
    assert not re.search(r"fit: [0-4] % done, ETA", shown)
    assert parts == sorted(parts)


@pytest.mark.full
def test_disks_of_several_kinds_have_one_fit_each(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Head-on impacts on a disk at rest: e_n is the velocity of parting over that of approach, whatever the masses."""
    lines = [
        "nx,ny,vx_1,vy_1,vx_2,vy_2,vx_1_after,vy_1_after,vx_2_after,vy_2_after,mass_1,radius_1,mass_2,radius_2"
    ]
    for e_n, masses in ((0.9, (1.0, 1.0)), (0.6, (1.0, 2.0)), (0.6, (2.0, 1.0))):
        for v in (0.8, 1.0, 1.2):
            after = v * masses[0] / sum(masses)
            first, second = (
                after - e_n * v * masses[1] / sum(masses),
                after + e_n * v * masses[0] / sum(masses),
            )
            lines.append(f"1,0,{v},0.1,0,0,{first},0.1,{second},0,{masses[0]},0.1,{masses[1]},0.1")
    (folder / "hits.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    options = ["fit", "hits.csv", "--model", "smooth", "--error", "velocities=0.01"]
    options += ["--error", "normal=1e-4"]  # with 0.01 the search takes four times as long
    assert main(options) == 0
    shown = capsys.readouterr().out
    assert "pair of kinds of disks 1 of 2 (--kind 1):" in shown
    table = shown.splitlines()[-2:]
    assert re.search(r"1, 2 +0.1, 0.1 +6  smooth: e_n 0\.6 ", table[0])
    assert re.search(r"1, 1 +0.1, 0.1 +3  smooth: e_n 0\.9 ", table[1])
    assert main([*options, "--kind", "2"]) == 0
    assert "of 2" not in capsys.readouterr().out
    assert main([*options, "--kind", "0"]) == 0
    assert "9 collisions" in capsys.readouterr().out
    assert main([*options, "--json", "a.json"]) == 2
    assert "there are 2 pairs of kinds of disks" in capsys.readouterr().err
    assert main([*options, "--kind", "3"]) == 2
    assert "--kind 3: must be an integer from 0 to 2" in capsys.readouterr().err


@pytest.mark.full(keep=10)
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], ["DATA is missing"]),
        (["data.csv", "--error", "1"], ["--M is missing"]),
        (["data.csv", "--M", "-1"], ["--M -1: must be"]),
        (["data.csv", "--M", "x"], ["--M x: must be"]),
        (["data.csv", "--M", "1", "--k-1", "0"], ["--k-1 0: must be a positive"]),
        (["data.csv", "--pair", "1 pta", "1 peta"], [r"--pair '1 peta': no such coin \(did you mean '1 pta'"]),
        (["data.csv", "--pair", "1 pta", "1 pta", "--M", "1"], ["--M: cannot be combined with --pair"]),
        (["data.csv", "--M", "1", "--rolling"], ["--R-1 is missing", "--R-2 is missing"]),
        (["data.csv", "--M", "1", "--R-1", "1"], ["must be given together"]),
        (["data.csv", "--M", "1", "--error", "delta_3=1"], [r"no column is called 'delta_3' \(did you mean 'delta_"]),
        (["data.csv", "--M", "1", "--error", "0"], ["--error 0: must be"]),
        (["data.csv", "--M", "1", "--error", "psi=0"], ["--error psi = 0: must be"]),
        (["data.csv", "--M", "1", "--error", "before=0"], ["the file has no column before"]),
        (["data.csv", "--M", "1", "--error", "1", "--error", "2"], ["--error 2: given twice"]),
        (["data.csv", "--M", "1", "--model", "contact"], [r"model = 'contact': .*did you mean 'ifr-contact'"]),
        (["data.csv", "--M", "1", "--fix", "e_t"], ["--fix e_t: must be NAME=VALUE"]),
        (["data.csv", "--M", "1", "--disk-1", "1,1"], ["--M: cannot be combined with --disk-1"]),
        (["data.csv", "--disk-1", "1", "--disk-2", "wal"], ["--disk-1 1: must be MASS", "--disk-2 wal: must be MASS"]),
        (["data.csv", "--M", "1", "--decimal", ","], ["--delimiter and decimal are both ','"]),
        (["data.csv", "--M", "1", "--law", "a.txt:B"], ["--law a.txt:B: must be FILE.py:CLASS"]),
        (["data.csv", "--M", "1", "--level", "100"], ["--level 100: must be a percentage between 0 and 100"]),
        (["data.csv", "--M", "1", "--bootstrap", "5"], ["--bootstrap 5: must be an integer from 40"]),
        (["data.csv", "--M", "1", "--seed", "5"], ["--seed requires --bootstrap or --draw"]),
        (["data.csv", "--M", "1", "--material-name", "a"], ["--material-name requires --write-material"]),
        (["data.csv", "--M", "1", "--json", "no/f.json"], ["output folder no: does not exist"]),
        (["data.csv", "--M", "1", "--json", "data.csv"], ["is the data file", "exists already"]),
        (["data.csv", "--M", "1", "--json", "a", "--write-material", "a"], ["output a: is given twice"]),
        (["data.csv", "--M", "1", "--jsn", "a"], [r"unknown option --jsn.*did you mean '--json'"]),
        (["data.cvs", "--M", "1"], [r"data.cvs: there is no such file \(did you mean 'data.csv'"]),
        (["data.csv", "--M", "1", "--error", "psi=1"], ["delta_1: missing from errors", "delta_2: missing"]),
        (["data.csv", "--M", "1", "--kind", "1"], ["--kind: cannot be combined with a table of angles"]),
        (["data.csv", "--M", "1", "--error", "1", "--rolling", "--R-1", "1", "--R-2", "1"], ["Rw_1 or Rw_2 or e_t_apparent"]),
    ],
)  # fmt: skip
def test_bad_input_is_refused_all_at_once(
    arguments: list[str], says: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = refused(arguments, folder, capsys)
    for text in says:
        assert any(re.search(text, line) for line in lines), lines


def test_existing_files_are_kept_unless_forced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "fit.pdf").write_text("mine", encoding="utf-8")
    (line,) = refused([*FIT_EXAMPLE[1:], "--picture", "fit"], folder, capsys)
    assert line.startswith("output fit.pdf: exists already; --force")
    assert main([*FIT_EXAMPLE, "--model", "smooth", "--json", "fit.pdf", "--force"]) == 0
    assert json.loads((folder / "fit.pdf").read_text(encoding="utf-8"))["best"] == "smooth"


def test_help_and_refusals_start_no_heavy_import(folder: Path) -> None:
    code = (
        "import sys\nfrom ifrdem.cli.main import main\n"
        "status = main(['fit', *sys.argv[1:]])\n"
        "assert not {'taichi', 'quadrants', 'scipy', 'matplotlib'} & set(sys.modules)\nsys.exit(status)\n"
    )
    for arguments, status in ((["--help"], 0), (["data.csv", "--M", "0", "--error", "psi=1"], 2)):
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == status, done.stderr


@pytest.mark.full
def test_readme_example_works(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:

    for line in manual.block("fit").splitlines():
        words = line.removeprefix("ifrdem ").split(" > ")[0].split()
        assert main(words) == 0
    shown = capsys.readouterr().out
    assert "preferred by the data" in shown
    assert "wrote fit.png, fit.pdf, fit_corner.png, fit_corner.pdf, coins.toml" in shown
    assert (folder / "fit.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "fit_corner.pdf").read_bytes().startswith(b"%PDF")
    options = re.findall(r"`(--[\w-]+)", manual.page("fit.md"))
    assert len(options) > 10
    shown = ""
    for command in ("fit", "collisions", "compare"):
        assert main([command, "--help"]) == 0
        shown += capsys.readouterr().out
    assert [option for option in options if option not in shown] == []


OWN = '''
import ifrdem


class Own(ifrdem.CollisionLaw):
    """Walton's law, written otherwise."""

    coefficients = ("e_n", "beta_0", "mu")

    @staticmethod
    def collide(pair, law):
        P_n = (1.0 + law.e_n) * pair.m_n * pair.g_n
        P_t = (1.0 + law.beta_0) * pair.m_t * pair.g_t
        most = law.mu * P_n
        return P_n, max(-most, min(most, P_t)), 0.0
'''


@pytest.mark.full
def test_a_custom_law_from_a_file_is_written_as_a_material_with_its_file(folder: Path) -> None:
    (folder / "own.py").write_text(OWN, encoding="utf-8")
    written = []
    for name, law in (("own", ["--law", "own.py:Own"]), ("walton", ["--model", "walton"])):
        assert main([*FIT_EXAMPLE, *law, "--write-material", f"{name}.toml"]) == 0
        text = (folder / f"{name}.toml").read_text(encoding="utf-8")
        written += tomllib.loads(text)["material"]
    assert (written[0].pop("law"), written[1].pop("law")) == ("own.py:Own", "walton")
    for each in written:  # of which there are no nested tables in `approx`
        each |= {f"error of {name}": error for name, error in each.pop("errors").items()}
        pairs = each.pop("correlations").items()
        each |= {f"{a} {b}": value for a, others in pairs for b, value in others.items()}
    assert len(written[0]) == 10
    own, walton = ({k: v for k, v in each.items() if k != "name"} for each in written)
    assert own == pytest.approx(walton, abs=5e-4)
