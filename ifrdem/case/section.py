"""Common behaviour of the sections of a case file."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError, ValidationError

from ..errors import InputError
from ..tools.checked import PAIR

Name = Annotated[str, Field(min_length=1, max_length=100)]
Pair = Annotated[list[float], PAIR]
"""A vector [x, y]."""


def field(example: object, default: Any = ..., /, **limits: Any) -> Any:
    """A key of a section: an example of its value, and its default if any; its docstring has the unit in brackets."""
    return Field(default, examples=[example], **limits)


def refusal(text: str, kind: str = "choice") -> PydanticCustomError:
    """An error with this text, for validators."""
    return PydanticCustomError(kind, "{text}", {"text": text})


def plain(value: Any) -> Any:
    """A value with lists for tuples and for arrays of NumPy, and Python's numbers for those of NumPy."""
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


class Section(BaseModel):
    """A section: no unknown keys, no conversion of types; numbers have the types of `tools.checked`.

    Of each group of keys in `one_of`, exactly one is to be given. Attributes are validated when they are set, each by
    itself; what `problems` finds belongs to several keys, and is found when a whole section is validated.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, validate_assignment=True, defer_build=True
    )
    one_of: ClassVar[tuple[tuple[str, ...], ...]] = ()
    choices: ClassVar[tuple[str, ...]] = ()
    """Alternatives that are no such groups, as the templates of cases say them."""
    kind_key: ClassVar[str] = "kind"
    """The key that selects the kind of a section, where there are several."""
    kind_name: ClassVar[str | None] = None
    """The name of the kind, where it is not the only value of that key."""

    is_generated: ClassVar[bool]
    """Set in a class that no source declares: its fields have descriptions."""

    @model_validator(mode="wrap")
    @classmethod
    def _all_errors_at_once(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        # An "after" validator would stay silent as long as any single key is wrong.
        problems = "; ".join(cls.problems(data)) if isinstance(data, dict) else ""
        if not problems:
            return handler(data)
        errors = [InitErrorDetails(type=refusal(problems), input=data)]
        try:
            handler(data)
        except ValidationError as error:
            errors += [_again(each) for each in error.errors(include_url=False)]
        raise ValidationError.from_exception_data(cls.__name__, errors)

    def __setattr__(self, name: str, value: Any) -> None:
        found = type(self).model_fields.get(name)
        if value is None and found is not None and not found.is_required():  # as if the key were not given
            self.__dict__[name] = found.get_default(call_default_factory=True)
            self.model_fields_set.discard(name)
            return
        try:
            super().__setattr__(name, plain(value))
        except ValidationError as error:
            from .messages import of_attribute

            raise InputError(of_attribute(self, name, error)) from None

    @classmethod
    def about(cls, key: str) -> tuple[str, Any]:
        """Description (with its unit) and an example value of a key."""
        found, written = cls.model_fields[key], _docstrings(cls).get(key)
        if found.description is None and written is None:
            # `Annotated[float, Field(...)] | None` keeps them one level down.
            inner = (get_args(found.annotation) or (found.annotation,))[0]
            found = next(each for each in get_args(inner) if isinstance(each, FieldInfo))
        examples = found.examples or (get_args(found.annotation) if key == cls.kind_key else ())
        text = " ".join((found.description or written or "").split()).removesuffix(".")
        text = text[:1].lower() + text[1:] if text[1:2].islower() or text[1:2] == " " else text
        return text, examples[0] if examples else None

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes in the combination of keys."""
        problems = []
        for group in cls.one_of:
            given = [key for key in group if key in data]
            if len(given) != 1:
                text = f"must have exactly one of {', '.join(group)}; given: {', '.join(given) or 'none'}"
                problems.append(text)
        return problems


def exclusive_with(data: Mapping[str, Any], key: str, *others: str) -> list[str]:
    """A mistake for `others` that are given together with a key of the same meaning."""
    given = [each for each in others if each in data]
    return [f"{', '.join(given)} cannot be combined with {key}"] if key in data and given else []


@functools.cache
def _docstrings(model: type[Section]) -> dict[str, str]:
    """Docstrings below the keys of a section, those of its bases included.

    pydantic would read them at every start, needed or not.
    """
    found: dict[str, str] = {}
    for each in reversed(model.__mro__):
        if not issubclass(each, Section) or "is_generated" in vars(each):
            continue
        (tree,) = ast.parse(inspect.getsource(each)).body
        found |= {
            ast.unparse(one.target): str(text.value.value)
            for one, text in itertools.pairwise(tree.body)  # type: ignore[attr-defined]
            if isinstance(one, ast.AnnAssign)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        }
    return found


def _again(error: ErrorDetails) -> InitErrorDetails:
    """An error of pydantic in the form from which another one is made."""
    context = error.get("ctx", {})
    kind: str | PydanticCustomError = error["type"]
    if "text" in context:  # one of our own
        kind, context = refusal(context["text"], error["type"]), {}
    return InitErrorDetails(type=kind, loc=error["loc"], input=error["input"], ctx=context)
