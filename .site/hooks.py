"""Makes the navigation of the site, pages of docstrings and notebooks with their results."""

from __future__ import annotations

import inspect
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from ifrdem.cli import api, manual, reference

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


def on_config(config: Any) -> Any:
    """Take the outline of the manual as navigation; each notebook has a page behind the list of them."""
    outline: list[Any] = [f"{manual.START}.md"]
    for group, topics in manual.groups().items():
        pages = [f"{topic}.md" for topic in topics]
        if "notebooks" in topics:
            place = topics.index("notebooks") + 1
            pages[place:place] = [f"notebooks/{name}.md" for name in manual.notebooks()]
        outline.append({group: pages})
    config["nav"] = outline
    return config


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
