"""The reference of all keys of a case file, generated from the models: type, unit, default and range of each."""

from __future__ import annotations

import re
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from ..tools.checked import LEAST, MOST, Each, Integer, Number
from ..tools.toml import toml
from ..trajectory.descriptions import REDUCED
from .case import CaseSections
from .messages import common_base, kind_of, models_in
from .section import Section

_PLAIN = {float: "number", int: "integer", str: "text", bool: "true or false"}
_UNIT = re.compile(r" ?\[((?:1|m|s|kg|rad|Pa|J|N|W|degrees|minutes)(?:[/^][\w^]+)*)\]")
_TYPE = re.compile(r" ?\[(?:whole number|text|true or false)\]")


def reference() -> str:
    """All keys in Markdown: a heading for each section, a line for each key."""
    lines: list[str] = []
    for name, found in CaseSections.model_fields.items():
        heading = f"[[{name}]]" if get_origin(found.annotation) is list else f"[{name}]"
        lines += [f"## {heading}", "", *_section(models_in(found.annotation), name)]
    return "\n".join(lines).rstrip()


def about(key: str, *, reduced: bool = False) -> tuple[str, str]:
    """Description and unit of a key that is spelled as for `--set`; no unit for pure numbers, and none unless known.

    Examples
    --------
    >>> about("species[0].speed_rms")
    ('root mean square speed at the start', 'm s-1')
    """
    *sections, name = re.sub(r"\[-?\d*\]", "", key).split(".")
    models: list[type[Section]] = [CaseSections]
    for section in sections:
        models = [
            inside
            for model in models
            if section in model.model_fields
            for inside in models_in(model.model_fields[section].annotation)
        ]
    text = next((model.about(name)[0] for model in models if name in model.model_fields), "")
    first = re.split(r"[:;,]", _TYPE.sub("", _UNIT.sub("", text)))[0]
    found = _UNIT.search(text)
    if found is None or found[1] == "1":
        return first, ""
    above, *below = found[1].split("/")
    factors = [*([] if above == "1" else [above.replace("^", "")])]
    factors += [f"{unit}-{power or 1}" for unit, _, power in (each.partition("^") for each in below)]
    return first, REDUCED if reduced else " ".join(factors)


def _section(models: list[type[Section]], path: str) -> Iterator[str]:
    """Lines on a section: the keys of all its kinds, those of each kind, and the tables that its keys hold."""
    common = common_base(models)
    yield _first_line(common)
    yield ""
    for group in common.one_of:
        yield f"Exactly one of {', '.join(f'`{key}`' for key in group)} must be given."
        yield ""
    kind_key = models[0].kind_key
    tables: dict[str, list[type[Section]]] = {}
    shown = {kind_key} if len(models) > 1 else set()
    if len(models) > 1 and kind_key in models[0].model_fields:
        kinds = ", ".join(f'"{kind_of(each)}"' for each in models)
        optional = [kind_of(each) for each in models if not each.model_fields[kind_key].is_required()]
        yield f"- `{kind_key}`: {kinds}; {f'default {toml(optional[0])}' if optional else 'required'}."
    for model in dict.fromkeys((common, *models)):
        keys = [key for key in model.model_fields if key not in shown]
        if model is not common:
            if not keys:
                continue
            yield ""
            yield f'### {path}, {kind_key} = "{kind_of(model)}"'
            yield ""
            yield _first_line(model)
            yield ""
        for key in keys:
            yield _key(model, key)
            if inside := models_in(model.model_fields[key].annotation):
                tables[key] = inside
        if model is common:
            shown.update(keys)
    yield ""
    for key, inside in tables.items():
        yield f"### {path}.{key}"
        yield ""
        yield from _section(inside, f"{path}.{key}")


def _first_line(model: type[Section]) -> str:
    return (model.__doc__ or "").strip().splitlines()[0]


def _key(model: type[Section], key: str) -> str:
    """The line on a key of a section: name, type, unit, default, range, description."""
    found, text = model.model_fields[key], model.about(key)[0]
    kind = "table" if models_in(found.annotation) else _type(found.annotation)
    unit = _UNIT.search(text) if "number" in kind else None
    if unit is not None:
        text = text.replace(unit[0], "", 1)
    text = _TYPE.sub("", text)
    facts = [kind + (f" [{unit[1]}]" if unit else "")]
    alternatives = _alternatives(model, key)
    if alternatives:
        facts.append(alternatives)
    elif found.is_required():
        facts.append("required")
    else:
        default = found.get_default(call_default_factory=True)
        facts.append("optional" if default is None or kind == "table" else f"default {toml(default)}")
    facts += dict.fromkeys(_limits(found))
    return f"- `{key}`: {'; '.join(facts)}. {text[:1].upper()}{text[1:]}."


def _alternatives(model: type[Section], key: str) -> str:
    """The keys that may stand instead of one; empty if there are none."""
    groups = (group for group in model.one_of if key in group)
    others = [" or ".join(f"`{each}`" for each in group if each != key) for group in groups]
    return f"required unless {' or '.join(others)} is given" if others else ""


def _type(annotation: Any) -> str:
    """The type of a plain value, in words."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(inner[0])
    if origin is Literal:
        return ", ".join(toml(each) for each in inner)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type(each) for each in inner if each is not types.NoneType))
    if origin in (list, tuple):
        of = _type(inner[0])
        return f"list of {of if ',' in of else _plural(of)}"
    if origin is dict:
        return "table"
    return _PLAIN[annotation]


def _plural(word: str) -> str:
    return {"text": "texts", "true or false": "true or false"}.get(
        word, f"lists of {word[8:]}" if word.startswith("list of ") else f"{word}s"
    )


def _limits(found: FieldInfo) -> Iterator[str]:
    """The range of a value, as its constraints state it."""
    inner = [each for one in (found.annotation, *get_args(found.annotation)) for each in _nested(one)]
    for each in (*found.metadata, *inner):
        check = each.one if isinstance(each, Each) else each
        if isinstance(check, Number | Integer):
            yield from _ends(check)


def _ends(check: Number | Integer) -> Iterator[str]:
    """The ends of a range, but for those of all numbers (`LEAST`, `MOST`) and of all integers."""
    if isinstance(check, Number) and check.low == LEAST:
        yield ">= 0" if check.zero else "> 0"
    elif check.low not in (-MOST, -(2**63)):
        yield _end(check.low, ">")
    if check.high not in (MOST, 2**31 - 1, 2**63 - 1):
        yield _end(check.high, "<")


def _end(limit: float, sign: str) -> str:
    """An end of a range; a number next to a round one stands for all up to that."""
    text = f"{limit:{'.10g' if isinstance(limit, int) else '.6g'}}"
    return f"{sign}{'=' * (float(text) == limit)} {text}"


def _nested(annotation: Any) -> Iterator[Any]:
    """Constraints inside an annotation: those of list elements and of alternatives."""
    if get_origin(annotation) is Annotated:
        for each in annotation.__metadata__:
            yield from each.metadata if isinstance(each, FieldInfo) else (each,)
    for inner in get_args(annotation) if get_origin(annotation) is not Literal else ():
        yield from _nested(inner)
