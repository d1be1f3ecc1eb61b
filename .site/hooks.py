"""Pages that are made for the site: the docstrings of each public name, run notebooks."""

from __future__ import annotations

import inspect
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from ifrdem.cli import api, reference

sys.path.insert(0, str(Path(__file__).parent))
import notebooks  # beside this file


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
    """Put docstrings into the page of Python, and keep signs of comparison in that of keys."""
    before, _, rest = markdown.partition(reference.BEGIN)
    generated, _, after = rest.partition(reference.END)
    if page.file.src_uri == "api.md":  # docstrings in full
        return before + python() + after
    if page.file.src_uri == "case.md":
        return before + generated.replace("<", "&lt;") + after
    return markdown
