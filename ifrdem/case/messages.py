"""Messages on the keys of a case: errors of pydantic as problems that name key, value and what is allowed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import ValidationError

from ..errors import Problem, cut, nearest
from ..tools.checked import Choice
from .case import CaseSections
from .section import Section

KeyPath = tuple[str | int, ...]


class Location(NamedTuple):
    """A key of a case: its path, and the models of sections that its value may be of (none for a plain value)."""

    key: KeyPath
    models: tuple[type[Section], ...]
    owner: type[Section] | None
    """The section that the key stands in, where it is known."""
    siblings: tuple[type[Section], ...] = ()
    """The other kinds of that section."""


def problems(error: ValidationError, root: type[Section] = CaseSections) -> list[Problem]:
    """A problem for each error of pydantic."""
    return [_translated(each, location_of(each["loc"], root)) for each in error.errors(include_url=False)]


def of_attribute(section: Section, name: str, error: ValidationError) -> str:
    """The message on an attribute of a section that cannot have a value.

    A section does not know its place in a list: it is named by its name.
    """
    model = type(section)
    heading = next((key for key, kinds in _sections() if model in kinds), "")
    one_of_list = heading and get_origin(CaseSections.model_fields[heading].annotation) is list
    own = getattr(section, "name", None) if one_of_list else None
    heading = f"{heading}{'' if own is None else f'[{own!r}]'}." if heading else ""
    lines = []
    for each in error.errors(include_url=False):
        location = location_of(each["loc"] or (name,), model)
        if each["type"] == "no_such_attribute":
            each = {**each, "type": "extra_forbidden"}
        problem = _translated(each, location)
        lines.append(str(Problem(heading + problem.key, problem.value, problem.text)))
    return "\n".join(lines)


def _sections() -> Iterator[tuple[str, tuple[type[Section], ...]]]:
    for key, found in CaseSections.model_fields.items():
        yield key, tuple(models_in(found.annotation))


def _translated(error: Mapping[str, Any], location: Location) -> Problem:
    kind, context, key = error["type"], error.get("ctx", {}), location.key
    value: str | None = _shown(error["input"])
    if kind in {"missing", "choice"} or (
        isinstance(error["input"], dict | list)
        and not ("type" in kind or kind == "needed" or kind.startswith("too_"))
    ):
        value = None
    if kind == "extra_forbidden":
        text = _unknown(str(key[-1]), location)
    elif kind == "missing":
        text = f"missing: {_about(location)}"
    elif kind == "choice":
        text = context["text"]
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        name = kind_key_in(error)
        about = location.models[0].about(name)[0]
        key = (*key, name)
        if kind == "union_tag_not_found":
            text = f"missing: {about}"
        else:
            allowed = re.findall(r"'([^']+)'", context["expected_tags"])
            given, value = error["input"][name], _shown(error["input"][name])
            text = f"must be {Choice(tuple(allowed)).instead_of(given)}"
    elif kind in ("model_type", "model_attributes_type"):
        text = f"must be a table ({_table(location)})"
    elif kind == "list_type" and location.models:
        text = f"must be a list of tables ({_table(location)})"
    elif kind in ("too_short", "too_long", "string_too_short", "string_too_long"):
        text = _length(kind, error["input"], context, _about(location))
    elif kind == "literal_error":
        allowed = re.findall(r"'([^']+)'", context["expected"])
        text = f"must be {Choice(tuple(allowed)).instead_of(error['input'])}"
    else:
        text = str(error["msg"]).replace("Input should", "must").replace("be a valid", "be a")
        if kind == "string_pattern_mismatch":
            text = "characters that are not allowed"
        if kind != "unknown_name" and (about := _about(location)):
            text += f" ({about})"
    return Problem(spelled(key), value, text)


def kind_key_in(error: Mapping[str, Any]) -> str:
    """The key of the kind of a section, in an error of pydantic that there is no such kind."""
    return str(error["ctx"]["discriminator"]).strip("'").removesuffix("()")


def _length(kind: str, value: Any, context: Mapping[str, Any], about: str) -> str:
    least = "short" in kind
    given, bound = len(value), context["min_length" if least else "max_length"]
    one, several = ("character", "characters") if "string" in kind else ("entry", "entries")
    entries = one if bound == 1 else several
    text = f"must have at {'least' if least else 'most'} {bound} {entries}, {given or 'none'} given"
    return f"{text} ({about})" if about else text


def _unknown(name: str, location: Location) -> str:
    """Text on a key that its section does not have: the nearest one, or the kinds of section that have it."""
    allowed = [] if location.owner is None else list(location.owner.model_fields)
    known = f"known here: {', '.join(allowed)}"
    of_kinds = [str(kind_of(each)) for each in location.siblings if name in each.model_fields]
    if of_kinds and location.owner is not None:
        key = location.owner.kind_key
        return f"requires {key} = {_listed(of_kinds)}, not with {kind_of(location.owner)!r}; {known}"
    return f"unknown key{nearest(name, allowed)}; {known}"


def kind_of(model: type[Section]) -> str | None:
    """The name of a kind of section; None of a section that has no kinds."""
    if model.kind_name is not None:
        return model.kind_name
    found = model.model_fields.get(model.kind_key)
    return str(get_args(found.annotation)[0]) if found and get_args(found.annotation) else None


def _listed(names: Iterable[str]) -> str:
    """'a', 'b' or 'c'."""
    quoted = [repr(name) for name in names]
    return " or ".join(filter(None, (", ".join(quoted[:-1]), quoted[-1])))


def spelled(key: Iterable[str | int]) -> str:
    """material[0].e_n from ("material", 0, "e_n")."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in key).lstrip(".")


def _shown(value: Any) -> str:
    """A value as TOML spells it: nan and inf as Python does, and all else as JSON."""
    numeric = isinstance(value, float)
    return cut(repr(value) if numeric else json.dumps(value, ensure_ascii=False, default=str))


def location_of(location: KeyPath, root: type[Section] = CaseSections) -> Location:
    """The key that pydantic means by a location, in which kinds of sections stand as steps of their own."""
    key: list[str | int] = []
    models: tuple[type[Section], ...] = (root,)
    owner: type[Section] | None = None
    siblings: tuple[type[Section], ...] = ()
    for step in location:
        if len(models) > 1 and isinstance(step, str):  # the kind
            siblings = tuple(each for each in models if kind_of(each) != step)
            models = tuple(each for each in models if kind_of(each) == step)
            continue
        key.append(step)
        if isinstance(step, int):
            continue
        owner = models[0] if models else None
        found = None if owner is None else owner.model_fields.get(step)
        if found is not None:
            siblings = ()
        models = () if found is None else tuple(models_in(found.annotation))
    return Location(tuple(key), models, owner, siblings)


def models_in(annotation: Any) -> list[type[Section]]:
    """Models of sections in an annotation: those of all kinds."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    return [model for each in get_args(annotation) for model in models_in(each)]


def common_base(models: Sequence[type[Section]]) -> type[Section]:
    """The section itself, or the nearest base of all its kinds."""
    return next(base for base in models[0].__mro__ if all(issubclass(each, base) for each in models))


def _about(location: Location) -> str:
    """The description of a key, or of the section that it leads to."""
    if location.models:
        purpose = (common_base(location.models).__doc__ or "").strip().splitlines()[0]
        return f"{_table(location)}, {purpose.rstrip('.').lower()}"
    name = next((step for step in reversed(location.key) if isinstance(step, str)), "")
    owner = location.owner
    return owner.about(name)[0] if owner is not None and name in owner.model_fields else ""


def _table(location: Location) -> str:
    """Heading of the section of a key, as in the file."""
    names = [step for step in location.key if isinstance(step, str)]
    if len(names) > 1:  # a table inside of a section
        return f"{names[-1]} = {{ ... }}"
    listed = (
        names[0] in CaseSections.model_fields
        and get_origin(CaseSections.model_fields[names[0]].annotation) is list
    )
    return f"[[{names[0]}]]" if listed else f"[{names[0]}]"
