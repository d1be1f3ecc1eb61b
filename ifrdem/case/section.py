"""Common behaviour of the sections of a case file."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError, ValidationError

LEAST, MOST = 1e-50, 1e50
"""Range of the magnitude of numbers other than 0: products of six of them can be computed with."""


def field(example: object, default: Any = ..., /, **limits: Any) -> Any:
    """A key of a section: an example of its value, and its default if any; its docstring has the unit in brackets."""
    return Field(default, examples=[example], **limits)


def refusal(text: str, kind: str = "choice") -> PydanticCustomError:
    """An error with this text, for validators."""
    return PydanticCustomError(kind, "{text}", {"text": text})


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where, what stands there (as text; None where nothing does), why."""

    key: str
    value: str | None
    text: str

    def __str__(self) -> str:
        place = self.key if self.value is None else f"{self.key} = {self.value}"
        return f"{place}: {self.text}"


@dataclass(frozen=True)
class Keys:
    """Keys that belong together: all `needed`, exactly `one` of some, at least one of `some`, any of `also`."""

    needed: tuple[str, ...] = ()
    one: tuple[str, ...] = ()
    some: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " + ".join(self.needed)

    @property
    def all(self) -> tuple[str, ...]:
        """Every key."""
        return self.needed + self.one + self.some + self.also

    def mistakes(self, data: Mapping[str, Any], of_others: set[str]) -> list[str]:
        """Keys that are missing in a section, or belong to others."""
        wrong = []
        if foreign := [key for key in data if key in of_others.difference(self.all)]:
            wrong.append(f"{', '.join(foreign)} cannot stand here; known for it: {', '.join(self.all)}")
        if missing := [key for key in self.needed if key not in data]:
            wrong.append(f"{', '.join(missing)} missing")
        given = [key for key in self.one if key in data]
        if self.one and len(given) != 1:
            text = f"exactly one of {' or '.join(self.one)} is needed; given: {', '.join(given) or 'none'}"
            wrong.append(text)
        if self.some and not any(data.get(key) for key in self.some):
            wrong.append(f"at least one of {', '.join(self.some)} above 0 is needed")
        return wrong


class Section(BaseModel):
    """A section: no unknown keys, no conversion of types, numbers from `LEAST` to `MOST`.

    `choices` lists alternatives of which exactly one is to be given (at most one if `choice_optional`); `kinds` the
    keys that belong to each value of the key `selector`.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, frozen=True
    )
    choices: ClassVar[tuple[Keys, ...]] = ()
    choice_optional: ClassVar[bool] = False
    kinds: ClassVar[Mapping[str, Keys]] = {}
    selector: ClassVar[str] = "kind"

    @model_validator(mode="wrap")
    @classmethod
    def _all_errors_at_once(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        # An "after" validator would stay silent as long as any single key is wrong.
        wrong = "; ".join(cls.mistakes(data)) if isinstance(data, dict) else ""
        if not wrong:
            return handler(data)
        errors = [InitErrorDetails(type=refusal(wrong), input=data)]
        try:
            handler(data)
        except ValidationError as error:
            errors += [_again(each) for each in error.errors(include_url=False)]
        raise ValidationError.from_exception_data(cls.__name__, errors)

    @field_validator("*")
    @classmethod
    def _of_usual_magnitude(cls, value: Any, info: ValidationInfo) -> Any:
        for each in value if isinstance(value, list) else (value,):
            if isinstance(each, float) and each != 0.0 and not LEAST <= abs(each) <= MOST:
                text = f"must be of a magnitude from {LEAST:g} to {MOST:g}: other units are needed"
                if "[1]" in cls.about(str(info.field_name))[0]:  # a pure number
                    small = abs(each) < LEAST
                    text = f"must be at {'least' if small else 'most'} {LEAST if small else MOST:g} in size"
                raise refusal(text, "magnitude")
        return value

    @classmethod
    def about(cls, key: str) -> tuple[str, Any]:
        """Description (with its unit) and an example value of a key."""
        found, written = cls.model_fields[key], _docstrings(cls).get(key)
        if found.description is None and written is None:
            # `Annotated[float, Field(...)] | None` keeps them one level down.
            inner = (get_args(found.annotation) or (found.annotation,))[0]
            found = next(each for each in get_args(inner) if isinstance(each, FieldInfo))
        examples = found.examples or []
        text = " ".join((found.description or written or "").split()).removesuffix(".")
        text = text[:1].lower() + text[1:] if text[1:2].islower() or text[1:2] == " " else text
        return text, examples[0] if examples else None

    @classmethod
    def mistakes(cls, data: dict[str, Any]) -> list[str]:
        """Mistakes in the combination of keys."""
        kind = data.get(cls.selector)
        if isinstance(kind, str) and kind in cls.kinds:
            of_kinds = {key for each in cls.kinds.values() for key in each.all}
            wrong = cls.kinds[kind].mistakes(data, of_kinds)
            return [f'{cls.selector} = "{kind}": {"; ".join(wrong)}'] if wrong else []
        choosable = dict.fromkeys(key for choice in cls.choices for key in choice.needed)
        given = [key for key in choosable if key in data]
        if not cls.choices or (cls.choice_optional and not given):
            return []
        for choice in cls.choices:
            if set(given) == set(choice.needed):
                foreign = {key for other in cls.choices for key in other.also} - set(choice.also)
                misplaced = sorted(foreign & set(data))
                return [f"{', '.join(misplaced)} cannot stand beside {choice}"] if misplaced else []
        allowed = ", or ".join(str(choice) for choice in cls.choices)
        return [f"exactly one is needed of: {allowed}; given: {', '.join(given) or 'none'}"]


@functools.cache
def _docstrings(model: type[Section]) -> dict[str, str]:
    """Docstrings below the keys of a section; pydantic would read them at every start, whoever asks."""
    (tree,) = ast.parse(inspect.getsource(model)).body
    return {
        ast.unparse(one.target): str(text.value.value)
        for one, text in itertools.pairwise(tree.body)  # type: ignore[attr-defined]
        if isinstance(one, ast.AnnAssign)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    }


def _again(error: ErrorDetails) -> InitErrorDetails:
    """An error of pydantic's as what a further one is made of."""
    context = error.get("ctx", {})
    kind: str | PydanticCustomError = error["type"]
    if "text" in context:  # one of our own
        kind, context = refusal(context["text"], error["type"]), {}
    return InitErrorDetails(type=kind, loc=error["loc"], input=error["input"], ctx=context)
