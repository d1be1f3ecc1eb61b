"""The public Python interface as text: signature and first line of each function, class and method."""

from __future__ import annotations

import enum
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

from pydantic import BaseModel

MODULES = (
    "ifrdem", "ifrdem.initial", "ifrdem.initial.radii", "ifrdem.forces", "ifrdem.laws", "ifrdem.observables",
    "ifrdem.theory", "ifrdem.analysis", "ifrdem.fit", "ifrdem.plots", "ifrdem.engines", "ifrdem.bullet",
)  # fmt: skip
"""Public modules, in the order of the manual."""


def reference() -> str:
    """All public names in Markdown: a heading for each module, a line for each function, class and method."""
    return "\n".join(line for name in MODULES for line in _module(name))


def public_names(module: ModuleType) -> dict[str, object]:
    """Public classes and functions of a module by name."""
    lazily = dir(module) if "__getattr__" in vars(module) else []
    own = [
        name for name, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__
    ]
    listed = getattr(module, "__all__", None) or lazily or own
    found = {name: getattr(module, name) for name in sorted(listed) if not name.startswith("_")}
    return {
        name: value for name, value in found.items() if inspect.isclass(value) or inspect.isfunction(value)
    }


def _module(name: str) -> Iterator[str]:
    module = import_module(name)
    yield from (f"## {name}", "", _first_line(module), "")
    for key, value in public_names(module).items():
        yield f"- `{name}.{key}{_signature(value)}`: {_first_line(value)}"
        if inspect.isclass(value):
            yield from (f"    - {line}" for line in _members(value))
    yield ""


def _members(cls: type) -> Iterator[str]:
    """Lines on the public methods and properties that a class defines."""
    bases = [each for each in cls.__mro__ if each.__module__.startswith("ifrdem.")]
    shown: set[str] = set()
    for base in bases:
        for name, value in vars(base).items():
            plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
            is_property = isinstance(plain, property)
            if name.startswith("_") or name in shown or hasattr(BaseModel, name):
                continue
            if not (is_property or inspect.isfunction(plain)):
                continue
            shown.add(name)
            written = name if is_property else f"{name}{_signature(getattr(cls, name))}"
            yield f"`{written}`: {_first_line(plain)}"


def _signature(value: object) -> str:
    """Names and defaults of the arguments; empty for classes that users do not call."""
    if isinstance(value, type) and issubclass(value, Exception | enum.Enum):
        return ""
    if isinstance(value, type) and issubclass(value, BaseModel):
        return "(" + ", ".join(f"{name}=..." for name in value.model_fields) + ")"
    found = inspect.signature(value)  # type: ignore[arg-type]
    arguments = [each for each in found.parameters.values() if each.name != "self"]
    plain = [each.replace(annotation=inspect.Parameter.empty) for each in arguments]
    text = str(found.replace(parameters=plain, return_annotation=inspect.Signature.empty))
    return re.sub(r"<factory>|<function [^<>]*(<[^<>]*>[^<>]*)*>", "...", text)


def _first_line(value: object) -> str:
    return (inspect.getdoc(value) or "").partition("\n")[0]
