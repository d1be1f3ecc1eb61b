"""Pages that are made for the site: the help of each command, the docstrings of each public name, run notebooks."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import ifrdem

sys.path.insert(0, str(Path(__file__).parent))
import notebooks  # beside this file

FACES = [
    ("ifrdem", ifrdem),
    ("ifrdem.initial", ifrdem.initial),
    ("ifrdem.initial.radii", ifrdem.initial.radii),
    ("ifrdem.forces", ifrdem.forces),
    ("ifrdem.observables", ifrdem.observables),
    ("ifrdem.theory", ifrdem.theory),
    ("ifrdem.analysis", ifrdem.analysis),
    ("ifrdem.fit", ifrdem.fit),
    ("ifrdem.plots", ifrdem.plots),
    ("ifrdem.bullet", ifrdem.bullet),
]


def command_help(name: str) -> str:
    """Text of `ifrdem NAME --help`."""
    environment = os.environ | {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.run(
        [sys.executable, "-m", "ifrdem", name, "--help"],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    return done.stdout.rstrip()


def commands(markdown: str) -> str:
    """The help of each command in the page's table."""
    names = re.findall(r"^\| `ifrdem (\w+)", markdown, flags=re.MULTILINE)
    return "\n\n".join(f"## ifrdem {name}\n\n```text\n{command_help(name)}\n```" for name in names)


def public_names(face: ModuleType) -> dict[str, str]:
    """Classes and functions of a module by name, and the module that defines each."""
    listed = getattr(face, "__all__", None) or [
        name for name, value in vars(face).items() if getattr(value, "__module__", "") == face.__name__
    ]
    found = {name: getattr(face, name) for name in sorted(listed) if not name.startswith("_")}
    return {
        name: value.__module__
        for name, value in found.items()
        if inspect.isclass(value) or inspect.isfunction(value)
    }


def api() -> str:
    """A heading for each face and a mkdocstrings directive for each of its public names."""
    lines = []
    for label, face in FACES:
        lines += [f"## {label}", "", inspect.getdoc(face) or "", ""]
        for name, module in public_names(face).items():
            lines += [
                f"::: {module}.{name}",
                "    options:",
                f"      heading: {label}.{name}",
                f"      toc_label: {name}",
                "",
            ]
    return "\n".join(lines)


def on_files(files: Any, config: Any) -> Any:
    """Run the notebooks, and add a page of each."""
    from mkdocs.structure.files import File

    for path in sorted(notebooks.FOLDER.glob("*.py")):
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=notebooks.page(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_options: Any) -> str:
    """Put the generated references into their pages."""
    if page.file.src_uri == "cli.md":
        return markdown.replace("<!-- help of every command -->", commands(markdown))
    if page.file.src_uri == "api.md":
        return markdown.replace("<!-- docstrings of every public name -->", api())
    return markdown
