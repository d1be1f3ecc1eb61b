"""The command line: its results, its refusals, and no files left behind."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cases import case_text

import ifrdem
from ifrdem import __main__
from ifrdem.case import shipped, starts
from ifrdem.cli import notebooks
from ifrdem.cli.main import app, main
from ifrdem.errors import EngineError, InputError, TrajectoryError
from ifrdem.model.observables import Measure
from ifrdem.model.state import State
from ifrdem.runs.recorder import Recorder
from ifrdem.simulation import backend
from ifrdem.simulation.simulation import Simulation
from ifrdem.tools import progress
from ifrdem.trajectory.reader import Trajectory

ROOT = Path(__file__).parents[2]

CASE = case_text({
    "run.name": "tiny", "run.seed": 2, "run.collisions_per_disk": 4.0, "run.threads": 1, "run.t_end": None,
    "run.units": None, "material[0].name": "aluminium", "material[0].e_n": 0.87, "material[0].e_t": -0.88,
    "material[0].mu": 0.21, "species[0].number": 101, "species[0].material": "aluminium",
    "species[0].mass": 0.00119, "species[0].radius": 0.0105, "output": {"frames": 8},
})  # fmt: skip
N, PER_DISK, FRAMES = 101, 4.0, 8


@pytest.fixture
def folder(toml: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own working folder with the case file in it."""
    monkeypatch.chdir(toml.parent)
    return toml.parent


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def refused(arguments: list[str], folder: Path, capsys: pytest.CaptureFixture[str], status: int = 2) -> str:
    """Run a command that must fail; its message. Nothing may appear in the folder."""
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert main(arguments) == status
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err + shown.out
    assert shown.err.startswith("ifrdem: ")
    return shown.err


# --- verbs ------------------------------------------------------------------------------------------------


def test_help_and_version_start_nothing_heavy() -> None:
    code = (
        "import sys\n"
        "from ifrdem.__main__ import main\n"
        "assert main() == 0\n"
        "heavy = {'taichi', 'quadrants', 'numpy', 'h5py', 'pydantic', 'matplotlib', 'scipy', 'tqdm'}\n"
        "heavy |= {'cyclopts'} if sys.argv[1] == '--version' else set()\n"
        "heavy &= set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    for option, shown in (("--help", "Run a case"), ("--version", f"ifrdem {ifrdem.__version__}")):
        done = subprocess.run(
            [sys.executable, "-c", code, option], capture_output=True, text=True, cwd=ROOT, check=False
        )
        assert done.returncode == 0, done.stderr
        assert shown in done.stdout


def test_an_interrupt_while_packages_load_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupting:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "ifrdem.cli.main":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "ifrdem.cli.main")
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    assert __main__.main() == 130
    assert capsys.readouterr().err == "ifrdem: interrupted before the command began\n"


def test_checking_a_case_does_not_import_the_runtime(folder: Path) -> None:
    code = (
        "import sys\nfrom ifrdem.cli.main import main\n"
        "assert main(['check', sys.argv[1]]) == 0\nassert not {'taichi', 'quadrants'} & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder / "tiny.toml")],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_module_can_be_run_and_a_wrong_case_ends_with_status_2(folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ifrdem", "run", str(folder / "tiny.toml"), "--set", "material[0].e_n=1.2"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()  # one clear message
    assert "material[0].e_n = 1.2: must be a number from 0 to 1" in line
    assert names(folder) == ["tiny.toml"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["rum", "tiny.toml"], r"unknown command 'rum' \(did you mean 'run'\?\); there are run, resume"),
        (["run"], r"CASE: must have a value \(see `ifrdem run --help`\)"),
        (["run", "tiny.toml", "--device"], r"--device: must have a value \(see `ifrdem run --help`\)"),
        (["--versoin"], r"unknown option --versoin \(did you mean '--version'\?\)"),
        (["run", "tiny.toml", "--quite"], r"unknown option --quite \(did you mean '--quiet'\?\)"),
        (["--quiet", "run", "tiny.toml", "--verbose"], "--quiet: cannot be combined with --verbose"),
        (["run", "tiny.toml", "--sed", "3"], r"unknown option --sed \(did you mean '--seed'\?\)"),
        (["run", "tiny.toml", "more"], "unexpected argument 'more'"),
        (["new", "coolin"], r"no template or shipped file is called 'coolin' \(did you mean 'cooling'\?\)"),
        (["new", "nosuch"], r"templates: .*, study, notebook; shipped: "),
        (
            ["new", "cases/mixture.toml", "--short"],
            "--short: goes with a template only, which 'cases/mixture.toml' is not: leave --short out, or name",
        ),
        (["new", "--short", "-o", "x.toml"], "--short: requires a KIND"),
        (["new", "notebook", "-o", "nowhere"], "-o nowhere: must be a folder that exists"),
        (["new", "cooling", "-o", ""], "-o '': must be a text, not empty"),
        (["new", "cooling", "-o", "nowhere/a.toml"], "output folder nowhere: does not exist"),
        (["new", "cooling", "-o", "tiny.toml"], "exists already"),
        (["info", "no.h5"], "no such file"),
        (["info", "tiny.toml"], "not an HDF5 file"),
        (["check", "no.toml"], "there is no such file"),
        (["run", "tiny.toml", "--set", "species[0].speed_rms=1e40"], "a velocity of .* cannot be stored"),
    ],
)
def test_command_that_cannot_be_understood_is_refused(
    arguments: list[str], says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert re.search(says, refused(arguments, folder, capsys))


COMMANDS = [name for name in app if not name.startswith("-")]


@pytest.mark.full(keep=6)
@pytest.mark.parametrize("command", COMMANDS)
def test_an_empty_text_or_a_nul_character_is_refused_for_every_argument_and_option(
    command: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [name for each in app[command].assemble_argument_collection() for name in each.names]
    options = [name for name in options if name.startswith("-")]
    texts = ("", "a\0b")
    for text in texts:
        assert repr(text) in refused([command, text], folder, capsys)
    for number, name in enumerate(options):  # one of the texts for each: a call takes 20 ms
        text = texts[number % 2]
        joined = text != "" and name.startswith("--")
        words = [f"{name}={text}"] if joined else [name, text]
        assert f"{name} {text!r}: must be" in refused([command, "tiny.toml", *words], folder, capsys)


def test_new_writes_a_template_that_check_likes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "cooling"]) == 0
    assert names(folder) == ["cooling.toml", "tiny.toml"]
    assert main(["check", "cooling.toml"]) == 0
    assert main(["new", "two_species", "-o", "-"]) == 0
    printed = capsys.readouterr().out
    assert tomllib.loads(printed[printed.index("# Two kinds") :])["run"]["name"] == "two_species"
    assert main(["new", "two_species", "-o", "cooling.toml", "--force"]) == 0
    assert "two_species" in (folder / "cooling.toml").read_text(encoding="utf-8")


def test_the_program_alone_prints_its_help_and_new_alone_its_kinds(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([]) == 0
    alone = capsys.readouterr().out
    assert main(["--help"]) == 0
    assert capsys.readouterr().out == alone
    assert main(["new"]) == 0
    listed = capsys.readouterr().out
    for kind in shipped.KINDS:
        assert re.search(rf"^{kind} ", listed, re.MULTILINE)
    assert all(f"cases/{name}.toml" in listed for name in shipped.names())
    assert names(folder) == ["tiny.toml"]


def test_notebooks_are_written_for_jupyter(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The keys that nbformat 4.5 requires, and the cells of the manual's text files in their order."""
    assert main(["new", "notebook"]) == 0
    sources = sorted(notebooks.FOLDER.glob("*.py"))
    assert names(folder) == sorted(["tiny.toml", *(f"{each.stem}.ipynb" for each in sources)])
    for source in sources:
        book = json.loads((folder / f"{source.stem}.ipynb").read_text(encoding="utf-8"))
        assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
        cells = [(each["cell_type"] == "markdown", "".join(each["source"])) for each in book["cells"]]
        assert cells == notebooks.cells(source.read_text(encoding="utf-8"))
        assert len({each["id"] for each in book["cells"]}) == len(cells) > 3
        for each in book["cells"]:
            required = {"cell_type", "id", "metadata", "source"}
            code = {"outputs", "execution_count"} if each["cell_type"] == "code" else set()
            assert set(each) == required | code
    assert main(["new", "notebook"]) == 2
    assert "exists already" in capsys.readouterr().err


def test_check_prints_estimates(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "tiny.toml"]) == 0
    shown = capsys.readouterr().out
    rows = {
        name: tuple(re.split("  +", rest))
        for name, rest in re.findall(r"^ +(\S.*?)  +(.+)$", shown, flags=re.MULTILINE)
    }
    assert rows["packing fraction"] == ("0.2",)
    # n = phi / (pi R^2) = 0.2 / (pi 0.0105^2) = 577.4
    assert rows["number density"] == ("577.43", "1/m^2")
    # pi sigma / (8 sqrt 2 phi g), g = (1 - 7 phi/16)/(1 - phi)^2 = 1.4258: 0.0204 m, 0.974 diameters
    assert rows["coins: mean free path at the start"][0].startswith("0.0204")
    assert "strictly admissible" in rows["law of coins, coins"][0]
    assert "202 collisions" in rows["run"][0]  # 101 x 4 / 2
    content = rows["content of the trajectory file"][0]
    assert content.startswith("9 frames x (101 disks x 32 bytes")
    assert "up to 81 rows of series" in content
    assert re.search(r"101 disks x \d+ bytes", rows["memory (engine only, without Python and libraries)"][0])
    assert names(folder) == ["tiny.toml"]


def test_check_reports_every_error_at_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = ["run.sede=1", "box.packing_fraction=0.95", "material[0].e_n=1.2", "species[0].mass=nan"]
    message = refused(
        ["check", "tiny.toml", *(word for each in wrong for word in ("--set", each))], folder, capsys
    )
    assert len(message.splitlines()) == 4
    for line, key in zip(message.splitlines(), wrong, strict=True):
        assert f"tiny.toml: {key.split('=')[0]} = " in line


def test_devices_lists_the_cpu(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["devices"]) == 0
    assert re.search(r"^cpu +\S+", capsys.readouterr().out, flags=re.MULTILINE)


# --- bad input to run -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--set", "run.sede=1"], r"run\.sede = 1: unknown key \(did you mean 'seed'\?\)"),
        (["--set", "species[0].number=many"], r'species\[0\]\.number = "many": must be an integer from 1 to'),
        (["--set", "material[0].e_n=1.2"], r"material\[0\]\.e_n = 1\.2: must be a number from 0 to 1"),
        (
            ["--set", "box.packing_fraction=0.95"],
            r"box\.packing_fraction = 0\.95: must be a number above 0, at most",
        ),
        (
            ["--set", "box.packing_fraction=0.62"],
            r"box\.packing_fraction = 0\.62: too dense for a random start",
        ),
        (["--set", "species[0].mass=nan"], r"species\[0\]\.mass = nan: must be a positive number"),
        (
            ["--set", "start.file=start.csv"],
            r"start\.file = \"start\.csv\": disks 0 and 1 overlap by 0\.004 ",
        ),
        (["--set", "start.file=nan.csv"], r"nan\.csv\": line 3: x = nan: must be a finite number"),
        (["--set", "run.seed"], "must be KEY=VALUE"),
        (["--seed", "three"], "--seed three: must be"),
        (["--threads", "0"], "--threads 0: must be"),
        (
            ["--precision", "f46"],
            r"--precision f46: .*did you mean 'f64'\?\)",
        ),
        (["--device", "gpu"], "--device gpu: must be one of 'cpu', 'cuda'"),
        (["-o", "nowhere/run"], "output folder nowhere: does not exist"),
        (["-o", "tiny.toml/run"], r"output folder tiny\.toml: is not a folder"),
    ],
)
def test_run_refuses_bad_input_and_leaves_nothing(
    options: list[str], says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{0.05 * (i % 11) + 0.02},{0.05 * (i // 11) + 0.02}" for i in range(N)]
    (folder / "nan.csv").write_text("\n".join(["x,y", rows[0], "nan,0.02", *rows[2:]]), encoding="utf-8")
    rows[1] = "0.037,0.02"  # 17 mm from the first coin; they are 21 mm wide
    (folder / "start.csv").write_text("\n".join(["x,y", *rows]), encoding="utf-8")
    if "start" in options[-1]:
        options = [*options, "--set", "box.packing_fraction=", "--set", "box.lengths=[0.6, 0.6]"]
    assert re.search(says, refused(["run", "tiny.toml", *options], folder, capsys))


def test_missing_case_file_names_the_nearest(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "did you mean 'tiny.toml'" in refused(["run", "tinny.toml"], folder, capsys)


def test_missing_device_is_refused_and_nothing_else_takes_over(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(backend, "cuda_absence", lambda: "no driver")
    message = refused(["run", "tiny.toml", "--device", "cuda"], folder, capsys)
    assert re.search("cuda.*no such device on this machine; present: cpu", message)


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder that not even root can write to")
def test_unwritable_folder_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    message = refused(["run", "tiny.toml", "-o", "/proc/self"], folder, capsys)
    assert "output folder /proc/self: cannot be written to" in message


@pytest.mark.parametrize("existing", [["tiny.h5"], ["tiny.png"], ["tiny.h5", "tiny.png"]])
def test_existing_outputs_are_refused_before_any_work(
    existing: list[str], folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(*_: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr(starts, "start", work)
    for name in existing:
        (folder / name).write_text("precious", encoding="utf-8")
    message = refused(["run", "tiny.toml"], folder, capsys)
    assert message.splitlines() == [
        f"ifrdem: output {name}: exists already; --force replaces it, -o writes elsewhere"
        for name in existing
    ]


def test_a_rerun_over_an_interrupted_run_names_resume_first(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("tiny.h5", "tiny.checkpoint.h5"):
        (folder / name).write_text("precious", encoding="utf-8")
    message = refused(["run", "tiny.toml"], folder, capsys)
    assert message.index("`ifrdem resume tiny.h5`") < message.index("--force replaces it")
    with pytest.raises(InputError, match=r"`ifrdem resume tiny.h5` continues it; force=True replaces it"):
        ifrdem.run("tiny.toml")
    assert (folder / "tiny.h5").read_text(encoding="utf-8") == "precious"


def test_refused_run_with_force_keeps_the_old_files(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "tiny.h5").write_text("precious", encoding="utf-8")
    refused(["run", "tiny.toml", "--force", "--set", "material[0].e_n=1.2"], folder, capsys)


# --- a whole run ------------------------------------------------------------------------------------------


def test_run_writes_trajectory_and_picture_and_a_summary(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "tiny.toml"]) == 0
    assert names(folder) == ["tiny.h5", "tiny.nc", "tiny.png", "tiny.status.json", "tiny.toml", "tiny.vtkhdf"]
    shown = capsys.readouterr()
    assert "tiny: 101 disks, packing fraction 0.2, mean free path 0.0204" in shown.out
    assert re.search(
        r"to 4 collisions per disk: 202 collisions, t = [\d.]+ s if it stayed homogeneous", shown.out
    )
    assert re.search(r"^on cpu: ", shown.out, flags=re.MULTILINE)
    assert re.search(r"done in [\d.]+ s: 202 collisions \(4 per disk\)", shown.out)
    assert re.search(r"T/T0 = 0\.\d+, theta = T_rot/T = 0\.\d+", shown.out)
    assert re.search(r"dissipated [\d.e-]+ J, [\d.]+ % of the initial energy", shown.out)
    assert re.search(r"^  momentum drift [\d.e-]+ kg m s-1 \(", shown.out, flags=re.MULTILINE)
    for name in ("tiny.h5", "tiny.png"):
        assert re.search(rf"^  {name} \([\d.]+ kB\)$", shown.out, flags=re.MULTILINE)
    assert re.search(r"100\.0 %  t = .* 4\.00 collisions per disk, .* collisions/s, ETA 0:00", shown.err)
    assert "\r" not in shown.err  # not a terminal: plain lines


def test_trajectory_of_a_run_adds_up(folder: Path) -> None:
    assert main(["run", "tiny.toml", "--no-picture"]) == 0
    assert names(folder) == ["tiny.h5", "tiny.nc", "tiny.status.json", "tiny.toml", "tiny.vtkhdf"]
    with Trajectory("tiny.h5") as trajectory:
        totals = {name: values[:] for name, values in trajectory.observables.items()}
        assert len(trajectory) == FRAMES + 1
        assert trajectory.fields == ("position", "velocity", "angular_velocity", "collisions", "image")
        assert trajectory.parameters["case"] == CASE
        assert trajectory.parameters["seed"] == 2
        assert trajectory.units["energy"] == "J"
        last = trajectory[-1]
        assert int(last.collisions.sum()) == 2 * 202
        mass, inertia = trajectory.disks.mass, trajectory.disks.inertia
        kinetic = 0.5 * float(mass @ np.sum(last.velocity**2, axis=1))
        spinning = 0.5 * float(inertia @ last.spin**2)
    # frames are evenly spaced in collisions, each at the first whole number: 202/8 = 25.25
    assert totals["collisions"].tolist() == [0, 26, 51, 76, 101, 127, 152, 177, 202]
    start = 0.5 * 1.19e-3 * N  # all at 1 m/s rms
    assert totals["energy"][0] == pytest.approx(start, rel=1e-12)  # rounding of a sum
    np.testing.assert_allclose(
        totals["energy"], totals["translational_energy"] + totals["rotational_energy"], rtol=1e-14
    )
    np.testing.assert_allclose(totals["dissipated_energy"], start - totals["energy"], atol=1e-14 * start)
    assert np.all(np.diff(totals["dissipated_energy"]) > 0.0)  # 25 collisions in every interval
    np.testing.assert_allclose(totals["temperature"], totals["translational_energy"] / N, rtol=1e-14)
    np.testing.assert_allclose(
        totals["rotational_temperature"], 2 * totals["rotational_energy"] / N, rtol=1e-14
    )
    assert np.abs(totals["momentum"]).max() < 1e-14 * N * 1.19e-3  # 202 collisions' rounding
    # velocities are stored in 4 bytes: 6e-8 each
    assert kinetic == pytest.approx(totals["translational_energy"][-1], rel=1e-6)
    assert spinning == pytest.approx(totals["rotational_energy"][-1], rel=1e-6)


def test_run_until_a_time_ends_there(folder: Path) -> None:
    options = ["--set", "run.collisions_per_disk=", "--set", "run.t_end=0.04", "--no-picture"]
    assert main(["run", "tiny.toml", *options]) == 0
    with Trajectory("tiny.h5") as trajectory:
        np.testing.assert_allclose(trajectory.times, np.linspace(0.0, 0.04, FRAMES + 1), rtol=1e-14)


def test_the_precision_of_a_run_reaches_its_simulation(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def remember(*_: object, **options: Any) -> None:
        asked.append(options["device"].precision)
        raise EngineError("far enough")

    monkeypatch.setattr("ifrdem.case.gas.Simulation", remember)
    for precision in ("f32", "f64"):
        assert main(["run", "tiny.toml", "--precision", precision, "--no-picture", "--force"]) == 1
    assert asked == ["f32", "f64"]


def test_options_override_the_case_and_set_the_place(folder: Path) -> None:
    (folder / "out").mkdir()
    assert main(["run", "tiny.toml", "--no-picture", "-o", "out", "--seed", "5", "--device", "cpu"]) == 0
    assert main(["run", "tiny.toml", "--no-picture", "-o", "out/b.1", "--set", "run.seed=5"]) == 0
    assert main(["run", "tiny.toml", "--no-picture", "-o", "out/c.h5", "--seed", "6"]) == 0
    assert [name for name in names(folder / "out") if name.endswith(".h5")] == ["b.1.h5", "c.h5", "tiny.h5"]
    ends = []
    for name in ("tiny", "b.1", "c"):
        with Trajectory(f"out/{name}.h5") as trajectory:
            ends.append((trajectory.parameters["seed"], trajectory[-1].position))
    assert [seed for seed, _ in ends] == [5, 5, 6]
    np.testing.assert_array_equal(ends[0][1], ends[1][1])
    assert np.abs(ends[0][1] - ends[2][1]).max() > 0.01  # another start, of a box of 0.4 m


@pytest.mark.full
def test_force_replaces_existing_outputs(folder: Path) -> None:
    for name in ("tiny.h5", "tiny.png"):
        (folder / name).write_text("old", encoding="utf-8")
    assert main(["run", "tiny.toml", "--force"]) == 0
    assert (folder / "tiny.png").read_bytes().startswith(b"\x89PNG")
    with Trajectory("tiny.h5") as trajectory:
        assert len(trajectory) == FRAMES + 1
    assert names(folder) == ["tiny.h5", "tiny.nc", "tiny.png", "tiny.status.json", "tiny.toml", "tiny.vtkhdf"]


def test_info_of_a_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "tiny.toml", "--no-picture"]) == 0
    capsys.readouterr()
    assert main(["info", "tiny.h5"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"frames +9", shown)
    assert re.search(r"disks +101", shown)


@pytest.mark.full
def test_start_file_is_found_from_the_case_files_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    (folder / "two.csv").write_text("x,y,vx,vy,spin\n0.1,0.1,1,0,0\n0.2,0.1,-1,0,0\n", encoding="utf-8")
    two = CASE.replace("packing_fraction = 0.2", "lengths = [0.4, 0.4]").replace("number = 101", "number = 2")
    two = two.replace("collisions_per_disk = 4.0", "t_end = 0.1").replace("speed_rms = 1.0", "")
    (folder / "two.toml").write_text(f'{two}\n[start]\nfile = "two.csv"\n', encoding="utf-8")
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    monkeypatch.chdir(elsewhere)
    assert main(["run", str(folder / "two.toml"), "--no-picture"]) == 0
    with Trajectory(elsewhere / "tiny.h5") as trajectory:
        # They meet head on after (0.1 - 0.021)/2 m at 1 m/s, and leave with e_n = 0.87 of their speed.
        # velocities are stored in 4 bytes
        np.testing.assert_allclose(trajectory[-1].velocity, [[-0.87, 0.0], [0.87, 0.0]], rtol=1e-7, atol=1e-7)
        assert trajectory.observables["collisions"][-1] == 1


def test_law_that_only_the_total_budget_saves_runs_with_one_warning(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--set", "material[0].e_n=0.5", "--set", "material[0].e_t=0", "--set", "material[0].mu=0.1"]
    with warnings.catch_warnings(record=True) as python_warnings:
        warnings.simplefilter("always")
        assert main(["run", "tiny.toml", "--no-picture", *options]) == 0
    assert capsys.readouterr().err.count("ifrdem: warning: e_n = 0.5, e_t = 0") == 1
    assert not [each for each in python_warnings if "tangential" in str(each.message)]


# --- runs that end early ----------------------------------------------------------------------------------


def stop_after(frames: int, error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a run fail in the middle: when `frames` frames are written and the next one is due."""
    write = Recorder.frame

    def fail(self: Recorder, state: State, measure: Measure) -> None:
        if self.ledger.frames == frames:
            raise error
        write(self, state, measure)

    monkeypatch.setattr(Recorder, "frame", fail)


def test_interrupted_run_keeps_the_frames_so_far(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stop_after(3, KeyboardInterrupt(), monkeypatch)
    assert main(["run", "tiny.toml"]) == 130
    message, remedy = capsys.readouterr().err.splitlines()[-2:]
    assert "to resume: ifrdem resume tiny.h5" in remedy
    assert "interrupted: tiny.h5 holds the 3 frames so far" in message
    assert "51 collisions" in message  # the third frame's, as above
    assert names(folder) == ["tiny.checkpoint.h5", "tiny.h5", "tiny.status.json", "tiny.toml"]
    with Trajectory("tiny.h5") as trajectory:
        assert len(trajectory) == 3
    status = json.loads(Path("tiny.status.json").read_text())
    assert (status["state"], status["frames"]) == ("interrupted", 3)  # the number in its message
    assert "holds the 3 frames so far" in status["message"]


def test_the_resume_command_shown_works_from_the_users_folder(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "my runs").mkdir()
    for place in ("my runs/it's one", "-first"):
        with monkeypatch.context() as stopping:
            stop_after(3, KeyboardInterrupt(), stopping)
            assert main(["run", "tiny.toml", "--no-picture", f"--output={place}"]) == 130
        line = capsys.readouterr().err.splitlines()[-1]
        program, *words = shlex.split(line.partition("to resume: ")[2])  # as a shell takes it
        assert program == "ifrdem"
        assert main([*words, "--no-picture"]) == 0
        with Trajectory(f"{place}.h5") as trajectory:
            assert len(trajectory) == FRAMES + 1
        capsys.readouterr()


def test_interrupt_while_it_computes_keeps_the_frames_so_far(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(self: progress.Progress, time: float, collisions: int) -> None:
        if collisions > 30:
            raise KeyboardInterrupt

    monkeypatch.setattr(progress.Progress, "__call__", interrupt)
    assert main(["run", "tiny.toml"]) == 130
    with Trajectory("tiny.h5") as trajectory:
        assert trajectory.observables["collisions"].tolist() == [0, 26]
    assert "holds the 2 frames so far" in capsys.readouterr().err


def test_interrupt_before_the_first_frame_leaves_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stop_after(0, KeyboardInterrupt(), monkeypatch)
    message = refused(["run", "tiny.toml"], folder, capsys, status=130)
    assert "interrupted before the first frame: nothing was written" in message


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (EngineError("collapsed"), "the engine stopped: collapsed"),
        (TrajectoryError("disk full"), "disk full"),
    ],
)
def test_failure_in_the_middle_is_one_message_and_status_1(
    error: Exception,
    says: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stop_after(2, error, monkeypatch)
    assert main(["run", "tiny.toml"]) == 1
    shown = capsys.readouterr().err
    assert shown.splitlines()[-1].startswith(f"ifrdem: {says}")
    assert "Traceback" not in shown
    with Trajectory("tiny.h5") as trajectory:
        assert len(trajectory) == 2


# --- the package ------------------------------------------------------------------------------------------


def test_every_public_name_is_there() -> None:
    for name in dir(ifrdem):
        assert getattr(ifrdem, name) is not None
    assert ifrdem.Simulation is Simulation
    assert {"Box", "Simulation", "theory"} <= set(dir(ifrdem))


def test_coins_stay_a_mapping_when_their_module_is_imported() -> None:
    from ifrdem.model.laws.coin_table import Coin

    assert isinstance(ifrdem.coins["1 pta"], Coin)


def test_a_place_that_is_no_place_and_a_file_larger_than_the_disk_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    case = str(Path(__file__).parents[2] / "cases" / "cooling.toml")
    for arguments, message in (
        (["-o", ""], "-o '': must be a text, not empty"),
        (["-o", " "], "-o ' ': must be a folder, or the path of files"),
        (["-o", os.devnull], "must be a folder, or the path of files"),
        (["--set", "output.frames=10000000"], "output: the trajectory requires about"),
    ):
        assert main(["run", case, *arguments]) == 2
        assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ["collisions", "{}", "--fps", "10", "--disk", "1,1"],
        ["collisions", "tracks.csv", "--fps", "10", "--disk", "1,1", "-o", "{}"],
        ["new", "cases/coins_from_video.toml", "-o", "{}"],
        ["new", "study", "-o", "{}"],
    ],
)
@pytest.mark.parametrize("place", ["/", ".", "./"])
def test_a_folder_without_a_name_is_no_file(words, place, capsys) -> None:
    """Names beside "/" and "." ended in a ValueError of pathlib."""
    assert main([each.format(place) for each in words]) == 2
    assert re.fullmatch(
        rf"ifrdem: (TRACKS|-o) {place}: is a folder, must be a file\n", capsys.readouterr().err
    )


@pytest.mark.parametrize("place", ["/", ".", "..", "plots/", ".png", "plots/.pdf", "plots/.."])
@pytest.mark.parametrize("words", [["fit", "a.csv", "--M", "1"], ["compare", "a.h5", "b.csv"]], ids=" ".join)
def test_a_picture_has_a_name(words, place, capsys) -> None:
    """ ".." wrote ...png, and "/" wrote /.png."""
    assert main([*words, "--picture", place]) == 2
    text = f"ifrdem: --picture {place}: must be the path of a file, with or without .png\n"
    assert text in capsys.readouterr().err
