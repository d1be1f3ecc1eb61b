"""Templates of case files, written from the models: what a template says is what the models check."""

from __future__ import annotations

import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_origin

from ..errors import InputError, there_are
from ..tools.toml import toml
from .case import CaseSections
from .messages import common_base, kind_of, models_in
from .section import Section


@dataclass(frozen=True)
class Template:
    """An example case: what it shows, and the values that differ from the defaults, as TOML."""

    title: str
    text: str

    @property
    def values(self) -> dict[str, Any]:
        """The tables and keys."""
        return tomllib.loads(self.text)


_COIN = 'name = "coins", material = "aluminium", mass = 1.19e-3, diameter = 21.0e-3'
_ALUMINIUM = 'material = [{ name = "aluminium", e_n = 0.87, e_t = -0.88, mu = 0.21 }]'
_REST = 'start = { positions = "random" }\noutput = { frames = 100 }'

TEMPLATES: Mapping[str, Template] = {
    "cooling": Template(
        "A gas of aluminium coins that starts without spin, moves freely and cools by its collisions.",
        f"""
run = {{ name = "cooling", seed = 1, collisions_per_disk = 50.0, device = "cpu", units = "SI" }}
box = {{ packing_fraction = 0.25 }}
{_ALUMINIUM}
species = [{{ {_COIN}, number = 50000, speed_rms = 1.0 }}]
{_REST}""",
    ),
    "driven": Template(
        "A gas of aluminium coins that starts at rest and is heated by random kicks until it loses as much.",
        f"""
run = {{ name = "driven", seed = 1, t_end = 1.5, device = "cpu", units = "SI" }}
box = {{ packing_fraction = 0.2 }}
{_ALUMINIUM}
species = [{{ {_COIN}, number = 20000, speed_rms = 0.0 }}]
force = [{{ kind = "random_kicks", step = 2e-3, power = 2e-3 }}]
{_REST}""",
    ),
    "walls": Template(
        "A gas of aluminium coins under gravity between walls, on a floor that shakes: it moves as a sine.",
        f"""
box = {{ lengths = [0.8, 1.2], periodic = [false, false], material = "steel", gravity = [0.0, -9.81] }}
{_ALUMINIUM}
pair = [{{ materials = ["aluminium", "steel"], e_n = 0.9, e_t = -0.9, mu = 0.2 }}]
species = [{{ {_COIN}, number = 200, speed_rms = 0.5 }}]
{_REST}
[run]
name = "walls"
seed = 1
t_end = 2.0
device = "cpu"
units = "SI"
collapse = "velocity_cutoff"
velocity_cutoff = 1e-3
[[wall]]
shape = "line"
material = "steel"
point = [0.0, 0.01]
normal = [0.0, 1.0]
motion = {{ kind = "sine", amplitude = 0.01, frequency = 20.0 }}""",
    ),
    "two_species": Template(
        "Two kinds of coins in one box, with the paper's coefficients for each of the three kinds of pairs.",
        """
run = { name = "two_species", seed = 1, collisions_per_disk = 20.0, device = "cpu", units = "SI" }
box = { packing_fraction = 0.2 }
material = [{ name = "small", coin = "100 pts" }, { name = "large", coin = "500 pts" }]
pair = [{ materials = ["small", "large"], e_n = 0.9, e_t = -0.9, mu = 0.15 }]
species = [
    { name = "100 pts", number = 5000, material = "small", coin = "100 pts", speed_rms = 1.0 },
    { name = "500 pts", number = 5000, material = "large", coin = "500 pts", speed_rms = 1.0 },
]
start = { positions = "random" }
output = { frames = 50 }""",
    ),
}


def _template(kind: str) -> Template:
    """A template by its name; an InputError says that there is none."""
    if kind not in TEMPLATES:
        raise InputError(f"no template is called '{kind}'{there_are(kind, TEMPLATES)}")
    return TEMPLATES[kind]


def write(kind: str) -> str:
    """The text of a commented case file, by a key of `TEMPLATES`; an InputError says that there is none."""
    template = _template(kind)
    values = template.values
    blocks = [
        _comment(template.title)
        + _comment(
            "Units stand in brackets; [1] is a pure number. Keys behind a # are optional or alternatives."
        )
        + "# ifrdem check FILE looks at it without running it; ifrdem run FILE runs it.\n"
    ]
    for name, field in CaseSections.model_fields.items():
        given, kinds = values.get(name), models_in(field.annotation)
        if get_origin(field.annotation) is list:
            # A list that the example leaves out is shown once, all of it behind a #.
            tables = [_table(f"[[{name}]]", kinds, each) for each in given or []]
            blocks += tables or [_behind_hash(_table(f"[[{name}]]", kinds, _examples(kinds[0])))]
        else:
            blocks.append(_table(f"[{name}]", kinds, given or {}))
    return "\n".join(blocks)


def write_short(kind: str) -> str:
    """The text of a case file with the keys of a template alone, each with its unit, by a key of `TEMPLATES`."""
    template = _template(kind)
    values = template.values
    more = f"`ifrdem new {kind}` explains every key, `ifrdem docs case` too."
    blocks = [_comment(template.title) + _comment(more)]
    for name, field in CaseSections.model_fields.items():
        if name not in values:
            continue
        kinds = models_in(field.annotation)
        listed = get_origin(field.annotation) is list
        for given in values[name] if listed else [values[name]]:
            model = next((each for each in kinds if kind_of(each) == given.get(each.kind_key)), kinds[0])
            lines = [f"[[{name}]]\n" if listed else f"[{name}]\n"]
            for key, value in given.items():
                unit = _unit(model.about(key)[0])
                lines.append(f"{f'{key} = {toml(value)}':<31} {unit}".rstrip() + "\n")
            blocks.append("".join(lines))
    return "\n".join(blocks)


def _unit(about: str) -> str:
    """The unit in a key's text as a comment; empty for a pure number, and for what is no number."""
    found = re.search(r"\[(?:kg|m|s|rad|1/|J|N|W|Pa)\S*\]", about)
    return f"# {found[0]}" if found else ""


def _table(heading: str, kinds: Sequence[type[Section]], given: Mapping[str, Any]) -> str:
    """The keys of a section: those of its kind, then, behind a #, further keys of other kinds."""
    own = next((each for each in kinds if kind_of(each) == given.get(each.kind_key)), kinds[0])
    purpose = common_base(kinds)
    lines = [f"{heading}\n", _comment((purpose.__doc__ or "").strip().splitlines()[0])]
    choices = [", or ".join(group) for group in own.one_of] if len(kinds) == 1 else []
    lines += [_comment(f"{text}.") for text in [f"Exactly one of: {each}" for each in choices] or own.choices]
    shown: set[str] = set()
    for each in (own, *(each for each in kinds if each is not own)):
        keys = [key for key in each.model_fields if key not in shown]
        if each is not own and keys:
            lines.append(_comment(f'With {each.kind_key} = "{kind_of(each)}": {_purpose(each)}'))
        for key in keys:
            about, example = each.about(key)
            lines.append(_comment(about))
            lines.append(f"{key} = {toml(given[key])}\n" if key in given else f"# {key} = {toml(example)}\n")
        shown.update(keys)
    return "".join(lines)


def _purpose(model: type[Section]) -> str:
    text = (model.__doc__ or "").strip().splitlines()[0]
    return text[:1].lower() + text[1:]


def _examples(model: type[Section]) -> dict[str, Any]:
    """Example values of the keys that have no default."""
    found = {key: model.about(key)[1] for key, field in model.model_fields.items() if field.is_required()}
    return found | ({model.kind_key: kind_of(model)} if model.kind_key in found else {})


def _comment(text: str, width: int = 100) -> str:
    return textwrap.fill(text, width, initial_indent="# ", subsequent_indent="#   ") + "\n"


def _behind_hash(text: str) -> str:
    return "".join(line if line.startswith("#") else f"# {line}" for line in text.splitlines(keepends=True))


def sections(values: Mapping[str, Any]) -> Iterator[str]:
    """The sections of a parsed case as texts in TOML."""
    for name, value in values.items():
        for each in value if isinstance(value, list) else (value,):
            heading = f"[[{name}]]" if isinstance(value, list) else f"[{name}]"
            yield "".join((f"{heading}\n", *(f"{key} = {toml(one)}\n" for key, one in each.items())))
