"""Packages hold the program as it is on disk and its commit, imports start nothing heavy, and kernels only compute."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

import ifrdem
from ifrdem.tools import versions

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
# Top-level folder -> the package it is imported as.
FOLDERS = {
    "ifrdem": "ifrdem",
    "kernels": "ifrdem.kernels",
    "validation": "ifrdem.validation",
    "cases": "ifrdem.cases",
}


def files_on_disk() -> dict[str, Path]:
    """Required content of the wheel: name in the wheel -> file in the tree."""
    found = {}
    for folder, package in FOLDERS.items():
        inside = package.replace(".", "/")
        for path in sorted((ROOT / folder).rglob("*")):
            name = path.relative_to(ROOT / folder)
            linked = any((ROOT / folder / parent).is_symlink() for parent in (name, *name.parents))
            manual = path.suffix in (".md", ".png", ".webp") and name.parts[0] == "docs"
            wanted = (
                path.suffix in (".py", ".pyi", ".toml", ".csv", ".html", ".json")
                or path.name == "py.typed"
                or manual
            )
            if wanted and path.is_file() and not linked:
                found[f"{inside}/{name.as_posix()}"] = path
    return found


@pytest.fixture(scope="module")
def clone(tmp_path_factory) -> tuple[Path, str]:
    """A clone whose links git wrote as text files, as on Windows, and the number of its commit."""
    source = tmp_path_factory.mktemp("source") / "tree"
    unwanted = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "*.h5")
    shutil.copytree(ROOT, source, symlinks=True, ignore=unwanted)
    for link in [path for path in (source / "ifrdem").iterdir() if path.is_symlink()]:
        target = os.readlink(link)
        link.unlink()
        link.write_text(target)
    shutil.copy(ROOT / ".gitattributes", source)
    git(source, "init", "--quiet")
    git(source, "add", "--all")
    git(source, "-c", "user.name=test", "-c", "user.email=test", "commit", "--quiet", "-m", "test")
    git(source, "-c", "user.name=test", "-c", "user.email=test", "tag", "-a", "v9.9.9", "-m", "test")
    return source, git(source, "rev-parse", "HEAD")


@pytest.fixture(scope="module")
def wheel(clone, tmp_path_factory) -> dict[str, bytes]:
    """Contents of the wheel that is built from the source distribution of the clone, by name."""
    out = tmp_path_factory.mktemp("dist")
    built = subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(clone[0])],
        capture_output=True,
        text=True,
        cwd=out,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (path,) = out.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, check=True)
    return done.stdout.strip()


COMMIT_FILE = versions.COMMIT_FILE.as_posix()


@pytest.mark.full
def test_wheel_holds_every_file_of_the_package(wheel):
    for name, path in files_on_disk().items():
        assert name in wheel
        assert wheel[name] == path.read_bytes()


@pytest.mark.full
def test_wheel_holds_nothing_else(wheel):
    package = {name for name in wheel if ".dist-info/" not in name}
    assert package == {*files_on_disk(), COMMIT_FILE}
    assert not any(part in name for name in wheel for part in ("tests", "conftest"))


@pytest.mark.full
def test_wheel_holds_type_marker_cases_licence_and_command(wheel):
    assert "ifrdem/py.typed" in wheel
    shipped = {path.name for path in (ROOT / "cases").rglob("*.toml")}
    assert shipped == {Path(n).name for n in wheel if n.startswith("ifrdem/cases/") and n.endswith(".toml")}
    info = {Path(name).name: content for name, content in wheel.items() if ".dist-info/" in name}
    assert info["LICENSE"] == (ROOT / "LICENSE").read_bytes()
    assert b"ifrdem = ifrdem.__main__:main" in info["entry_points.txt"]


@pytest.mark.full
def test_packages_and_archives_of_git_carry_the_commit(clone, wheel, tmp_path):
    """A build step that is left out, or no mark in the file, would leave every file without its origin."""
    source, commit = clone
    assert wheel[COMMIT_FILE].decode().strip() == commit
    build = [sys.executable, "setup.py", "-q", "build_py", "--build-lib", str(tmp_path)]  # as `pip install .`
    subprocess.run(build, cwd=source, capture_output=True, check=True)
    assert (tmp_path / COMMIT_FILE).read_text().strip() == commit
    assert git(source, "archive", "HEAD", COMMIT_FILE).count(commit) >= 1
    assert (
        git(source, "status", "--porcelain", "--untracked-files=no") == ""
    )  # built without a change of the tree


def test_the_commit_is_that_of_a_clone_or_the_stored_one(clone, tmp_path, monkeypatch):
    source, commit = clone
    revision = versions.revision.__wrapped__
    monkeypatch.setattr(versions, "ROOT", source)
    assert revision() == commit
    changed = source / "README.md"
    text = changed.read_bytes()
    changed.write_bytes(text + b"x")
    assert revision() == f"{commit}-dirty"
    changed.write_bytes(text)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert revision() == "unknown"  # without git
    monkeypatch.setattr(versions, "ROOT", tmp_path)
    assert revision() == "unknown"
    stored = tmp_path / versions.COMMIT_FILE
    stored.parent.mkdir(parents=True)
    for text, found in (("$Format:%H$\n", "unknown"), (f"{commit}\n", commit)):
        stored.write_text(text)
        assert revision() == found


def test_listed_packages_are_the_folders_on_disk():
    listed = PROJECT["tool"]["setuptools"]["packages"]
    found = set()
    for folder, package in FOLDERS.items():
        for init in (ROOT / folder).rglob("__init__.py"):
            inner = init.parent.relative_to(ROOT / folder)
            if not any((ROOT / folder / parent).is_symlink() for parent in (inner, *inner.parents)):
                found.add(".".join((package, *inner.parts)))
    assert sorted(listed) == sorted(found)
    # The links inside ifrdem/ lead to the other folders; with one root an editable install is a plain path.
    assert PROJECT["tool"]["setuptools"]["package-dir"] == {"": "."}


def test_a_bare_clone_finds_the_folders_by_relative_links():
    for folder in ("kernels", "validation", "cases"):
        link = ROOT / "ifrdem" / folder
        assert os.readlink(link) == f"../{folder}"
        assert link.resolve() == ROOT / folder


@pytest.mark.full
def test_a_class_has_its_name_alone():
    """Two classes of one name are two things that a reader takes for one."""
    found: dict[str, list[Path]] = {}
    for folder in ("ifrdem", "kernels", "validation"):
        for path in sorted((ROOT / folder).rglob("*.py")):  # which does not follow links
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    found.setdefault(node.name, []).append(path)
    assert len(found) > 100
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


def test_version_stands_once_but_for_the_citation():
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"] == {
        "attr": "ifrdem.tools.versions.__version__"
    }
    cited = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited == [ifrdem.__version__]


def run_python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, cwd=ROOT)


@pytest.mark.parametrize("module", ["ifrdem", "ifrdem.theory"])
def test_import_starts_nothing_heavy(module: str):
    heavy = "('matplotlib', 'scipy', 'taichi', 'quadrants')"
    code = f"import sys, {module}; print([m for m in {heavy} if m in sys.modules])"
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_help_does_not_start_the_runtime():
    code = (
        "import runpy, sys\n"
        "sys.argv = ['ifrdem', '--help']\n"
        "try:\n"
        "    runpy.run_module('ifrdem', run_name='__main__')\n"
        "finally:\n"
        "    print(bool({'taichi', 'quadrants'} & set(sys.modules)), file=sys.stderr)\n"
    )
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines() == ["False"]
    assert "usage" in done.stdout.lower()


def test_python_range_is_that_of_the_wheels_we_depend_on():
    """Taichi 1.7.4 has wheels up to 3.13, quadrants 1.4.0 for 3.14; tomllib needs 3.11."""
    supported = SpecifierSet(PROJECT["project"]["requires-python"])
    accepted = [minor for minor in range(8, 18) if f"3.{minor}.5" in supported]
    assert accepted == [11, 12, 13, 14]
    named = [c.rsplit(" ", 1)[1] for c in PROJECT["project"]["classifiers"] if "Python :: 3." in c]
    assert named == ["3.11", "3.12", "3.13", "3.14"]


def test_bullet_extra_asks_for_pybullet_only_where_it_has_wheels():
    """pybullet 3.2.7 publishes wheels for CPython 3.9 to 3.11 and no later; pymunk 7 for all that we support."""
    wanted = {
        (r := Requirement(text)).name: r for text in PROJECT["project"]["optional-dependencies"]["bullet"]
    }
    assert list(wanted) == ["pybullet", "pymunk"]
    marker = wanted["pybullet"].marker
    assert isinstance(marker, Marker)
    asked = [v for v in ("3.11", "3.12", "3.13") if marker.evaluate({"python_version": v})]
    assert asked == ["3.11"]
    assert wanted["pymunk"].marker is None


# --- kernels compute; they do not talk, read, write or start anything

# os for its environ alone: Taichi's banner can only be silenced there. The others are what `signature.py` and the
# corrections and patches of Taichi need.
IMPORTS_OF_KERNELS = {
    "taichi",
    "quadrants",
    "hashlib",
    "math",
    "numpy",
    "operator",
    "warnings",
    "os",
    "typing",
    "ast",
    "collections",
    "contextlib",
    "ctypes",
    "dataclasses",
    "functools",
    "importlib",
    "inspect",
    "itertools",
    "linecache",
    "textwrap",
    "sys",
    "types",
}


def outside_effects(source: str) -> list[str]:
    """Calls and imports in a module's source by which it would do more than compute."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            if name in ("print", "open", "input", "exec", "eval") or name.endswith((".print", ".open")):
                found.append(name)
            if name.endswith(".init") or name == "init":
                found.append(name)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "os" and node.attr != "environ":
            found.append(f"os.{node.attr}")
        elif isinstance(node, ast.Import):
            found += [
                alias.name for alias in node.names if alias.name.split(".")[0] not in IMPORTS_OF_KERNELS
            ]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            module = node.module or ""
            if module == "os" or module.split(".")[0] not in IMPORTS_OF_KERNELS:
                found.append(module)
    return found


@pytest.mark.parametrize("path", sorted((ROOT / "kernels").rglob("*.py")), ids=lambda path: path.name)
def test_kernels_have_no_outside_effects(path):
    assert outside_effects(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("path", sorted((ROOT / "kernels").rglob("*.py")), ids=lambda path: path.name)
def test_kernels_keep_their_annotations(path):
    """Postponed annotations are texts, and Taichi cannot compile a kernel from them."""
    imports = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
    assert "__future__" not in [node.module for node in imports]


@pytest.mark.parametrize(
    "source",
    [
        "import taichi as ti\nti.init()",
        "def f():\n    print(1)",
        "open('x')",
        "import pathlib",
        "import os\nos.remove('x')",
        "from os import remove",
        "from h5py import File",
    ],
)
def test_the_check_of_kernels_finds_what_it_looks_for(source):
    assert len(outside_effects(source)) == 1
