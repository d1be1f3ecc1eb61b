"""Pages that are made for the site: the help of each command, the docstrings of each public name, run notebooks."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from ifrdem.case import keys
from ifrdem.cli import api

sys.path.insert(0, str(Path(__file__).parent))
import notebooks  # beside this file


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


def python() -> str:
    """A heading for each public module and a mkdocstrings directive for each of its public names."""
    lines = []
    for label in api.MODULES:
        module = import_module(label)
        lines += [f"## {label}", "", inspect.getdoc(module) or "", ""]
        for name, value in api.public_names(module).items():
            lines += [
                f"::: {value.__module__}.{name}",
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
        return markdown.replace("<!-- docstrings of every public name -->", python())
    if page.file.src_uri == "case.md":
        return markdown.replace("<!-- every key -->", keys.reference().replace("<", "&lt;"))
    return markdown
