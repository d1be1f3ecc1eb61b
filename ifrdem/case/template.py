"""Templates of case files, written from the models: what a template says is what the models check."""

from __future__ import annotations

import json
import textwrap
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from ..errors import InputError, there_are
from .case import Case
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
force = [{{ kind = "random_force", step = 2e-3, power = 2e-3 }}]
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
    "mixture": Template(
        "Two kinds of coins in one box, with the paper's coefficients for each of the three kinds of pairs.",
        """
run = { name = "mixture", seed = 1, collisions_per_disk = 20.0, device = "cpu", units = "SI" }
box = { packing_fraction = 0.2 }
material = [{ name = "small", coin = "100 pts" }, { name = "large", coin = "500 pts" }]
species = [
    { name = "100 pts", number = 5000, material = "small", coin = "100 pts", speed_rms = 1.0 },
    { name = "500 pts", number = 5000, material = "large", coin = "500 pts", speed_rms = 1.0 },
]
start = { positions = "random" }
output = { frames = 50 }""",
    ),
}


def write(kind: str) -> str:
    """The text of a commented case file, by a key of `TEMPLATES`; an InputError says that there is none."""
    if kind not in TEMPLATES:
        raise InputError(f"no template is called '{kind}'{there_are(kind, TEMPLATES)}")
    template, values = TEMPLATES[kind], TEMPLATES[kind].values
    blocks = [
        _comment(template.title)
        + _comment(
            "Units stand in brackets; [1] is a pure number. Keys behind a # are optional or alternatives."
        )
        + "# ifrdem check FILE looks at it without running it; ifrdem run FILE runs it.\n"
    ]
    for name, field in Case.model_fields.items():
        given = values.get(name)
        if get_origin(field.annotation) is list:
            model = get_args(field.annotation)[0]
            # A list that the example leaves out is shown once, all of it behind a #.
            tables = [_table(f"[[{name}]]", model, each) for each in given or []]
            blocks += tables or [_behind_hash(_table(f"[[{name}]]", model, _examples(model)))]
        else:
            assert isinstance(field.annotation, type)
            blocks.append(_table(f"[{name}]", field.annotation, given or {}))
    return "\n".join(blocks)


def _table(heading: str, model: type[Section], given: Mapping[str, Any]) -> str:
    purpose = (model.__doc__ or "").strip().splitlines()[0]
    lines = [f"{heading}\n", _comment(purpose)]
    for choice in [", or ".join(str(each) for each in model.choices)] if model.choices else []:
        lines.append(_comment(f"{'At most' if model.choice_optional else 'Exactly'} one of: {choice}."))
    for key in model.model_fields:
        about, example = model.about(key)
        lines.append(_comment(about))
        lines.append(f"{key} = {_toml(given[key])}\n" if key in given else f"# {key} = {_toml(example)}\n")
    return "".join(lines)


def _examples(model: type[Section]) -> dict[str, Any]:
    """Example values of the keys that have no default."""
    return {key: model.about(key)[1] for key, field in model.model_fields.items() if field.is_required()}


def _comment(text: str, width: int = 100) -> str:
    return textwrap.fill(text, width, initial_indent="# ", subsequent_indent="#   ") + "\n"


def _behind_hash(text: str) -> str:
    return "".join(line if line.startswith("#") else f"# {line}" for line in text.splitlines(keepends=True))


def _toml(value: Any) -> str:
    """A value as TOML: JSON writes texts, lists, numbers, true and false the same way."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
