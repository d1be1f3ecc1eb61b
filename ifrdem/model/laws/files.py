"""Custom laws in files of Python, FILE.py:CLASS: their classes, made from a text that has a hash."""

from __future__ import annotations

import hashlib
import importlib.abc
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...errors import InputError, nearest, there_are
from ...tools import checked, text_file
from .law import CollisionLaw

FORM = "FILE.py:CLASS"
"""Form of the name of a law in a file."""
MOST_BYTES = 1_000_000
_FAILURES = (
    ImportError, SyntaxError, NameError, AttributeError, TypeError, ValueError, LookupError, ArithmeticError, OSError,
    RuntimeError, AssertionError,
)  # fmt: skip
_REFERENCE = re.compile(r".+\.py:\w+", re.DOTALL)
_loaded: dict[tuple[str, str, str], type[CollisionLaw]] = {}
"""Classes by path, hash of the text and name: a text is executed once in a process."""


@dataclass(frozen=True)
class LawSource:
    """The source of a custom law: an absolute path, the name of the class, and the text of the file."""

    path: str
    name: str
    text: str = field(repr=False)

    @property
    def sha256(self) -> str:
        """Hash of the text, as `sha256sum` prints it."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def law(self) -> str:
        """Name of the law, FILE.py:CLASS without folders."""
        return f"{Path(self.path).name}:{self.name}"

    @property
    def kind(self) -> type[CollisionLaw]:
        """The class of the law. The text is executed if this process has not done so.

        InputError if that fails, or there is no such law.
        """
        key = self.path, self.sha256, self.name
        if key not in _loaded:
            _loaded[key] = _executed(self)
        return _loaded[key]


class _Loader(importlib.abc.SourceLoader):
    """Loader of a module from a text, which the compiler of kernels reads again; the file may have changed then."""

    def __init__(self, source: LawSource) -> None:
        self._text, path = source.text, Path(source.path)
        self._shown = str(path.parent / source.sha256[:12] / path.name)  # another text, another name

    def get_filename(self, fullname: str) -> str:
        return self._shown

    def get_data(self, path: str | bytes) -> bytes:
        return self._text.encode()


def is_reference(text: object) -> bool:
    """True of a text that has the form FILE.py:CLASS."""
    return isinstance(text, str) and _REFERENCE.fullmatch(text) is not None


def find(reference: str, folder: Path | str = ".") -> LawSource:
    """The source of FILE.py:CLASS, a path from `folder`.

    InputError, which does not repeat the reference, if it has another form, or the file cannot be read.
    """
    if not is_reference(reference):
        raise InputError(f"must be {FORM}")
    name, _, title = reference.rpartition(":")
    path = Path(os.path.realpath(Path(folder) / name))  # `Path.resolve` raises for links in a loop
    try:
        text = text_file.read(path, most=MOST_BYTES)
    except InputError as error:
        missing = "" if os.path.lexists(path) else f"there is no file {path}"
        raise InputError(missing or f"{path} {error}") from None
    return LawSource(str(path), title, text)


def source_of(law: CollisionLaw | type[CollisionLaw]) -> LawSource | None:
    """The source of a law from a file; None of others."""
    kind = law if isinstance(law, type) else type(law)
    return vars(kind).get("_source")


def made(
    kind: type[CollisionLaw], values: Mapping[str, Any]
) -> tuple[CollisionLaw | None, list[tuple[str, str]]]:
    """The law with these coefficients, and what is wrong: a coefficient ("" for all) and a text for each mistake."""
    names, source = kind.coefficients, source_of(kind)
    owner = kind.__name__ if source is None else source.law
    there = f"{owner} has " + (f"the coefficients {', '.join(names)}" if names else "no coefficients")
    wrong = [
        (key, f"unknown coefficient{nearest(key, names)}; {there}") for key in values if key not in names
    ]
    wrong += [(key, f"missing: must be a finite number; {there}") for key in names if key not in values]
    for key in names:
        try:
            if key in values:
                kind.ranges.get(key, checked.FINITE)("", values[key])
        except InputError as error:
            wrong.append((key, error.reason))
    if wrong:
        return None, wrong
    try:
        return kind(**values), []
    except (InputError, TypeError) as error:
        return None, [("", str(error))]


def restored(source: LawSource) -> CollisionLaw:
    """A law without its coefficients, as copies and messages to other processes begin."""
    kind = source.kind
    return kind.__new__(kind)


def is_law(value: object) -> bool:
    """True of a class of laws."""
    return isinstance(value, type) and issubclass(value, CollisionLaw)


def _executed(source: LawSource) -> type[CollisionLaw]:
    path = Path(source.path)
    name = f"{re.sub(r'[^0-9A-Za-z_]', '_', path.stem)}_{source.sha256[:12]}"
    spec = importlib.util.spec_from_loader(name, loader := _Loader(source))
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    module.__file__ = source.path
    sys.modules[name] = module  # where `inspect`, dataclasses and pickles look it up
    try:
        loader.exec_module(module)
    except _FAILURES as error:
        del sys.modules[name]
        line = f", line {number}" if (number := _line(error, loader.get_filename(name))) else ""
        reason = f"{type(error).__name__}: {error.msg if isinstance(error, SyntaxError) else error}"
        raise InputError(f"{path}{line}: the file cannot be executed: {reason}") from error
    kinds = [key for key, value in vars(module).items() if is_law(value) and value is not CollisionLaw]
    if source.name not in kinds:
        raise InputError(f"no law '{source.name}' in {path}{there_are(source.name, kinds)}")
    kind: type[CollisionLaw] = getattr(module, source.name)
    if kind.collide is CollisionLaw.collide:
        raise InputError(f"{source.name} in {path}: must have a static method collide(pair, law)")
    kind._source = source
    return kind


def _line(error: BaseException, shown: str) -> int | None:
    """Line of a file in which an error arose."""
    if isinstance(error, SyntaxError):
        return error.lineno
    lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == shown]
    return lines[-1] if lines else None
