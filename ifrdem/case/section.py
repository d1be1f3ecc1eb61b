"""What all sections of a case file have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, get_args

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, field_validator, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError, ValidationError

LEAST, MOST = 1e-50, 1e50
"""Range of the magnitude of numbers other than 0: products of six of them can be computed with."""


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
class Choice:
    """Keys that belong together: all of `needed`, and any of `also` beside them."""

    needed: tuple[str, ...]
    also: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " + ".join(self.needed)


class Section(BaseModel):
    """Common behaviour of all sections: no unknown keys, no conversion of types, numbers from `LEAST` to `MOST`.

    `choices` lists alternatives of which exactly one is to be given (at most one if `choice_optional`).
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, frozen=True
    )
    choices: ClassVar[tuple[Choice, ...]] = ()
    choice_optional: ClassVar[bool] = False

    @model_validator(mode="wrap")
    @classmethod
    def _all_errors_at_once(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        # An "after" validator would stay silent as long as any single key is wrong.
        wrong = cls.wrong_choice(data) if isinstance(data, dict) else None
        if wrong is None:
            return handler(data)
        errors = [InitErrorDetails(type=PydanticCustomError("choice", "{text}", {"text": wrong}), input=data)]
        try:
            handler(data)
        except ValidationError as error:
            errors += [_again(each) for each in error.errors(include_url=False)]
        raise ValidationError.from_exception_data(cls.__name__, errors)

    @field_validator("*")
    @classmethod
    def _of_usual_magnitude(cls, value: Any) -> Any:
        for each in value if isinstance(value, list) else (value,):
            if isinstance(each, float) and each != 0.0 and not LEAST <= abs(each) <= MOST:
                text = f"must be of a magnitude from {LEAST:g} to {MOST:g}: other units are needed"
                raise PydanticCustomError("magnitude", "{text}", {"text": text})
        return value

    @classmethod
    def about(cls, key: str) -> tuple[str, Any]:
        """Description (with its unit) and an example value of a key."""
        found = cls.model_fields[key]
        if found.description is None:  # `Annotated[float, Field(...)] | None` keeps them one level down
            inner = (get_args(found.annotation) or (found.annotation,))[0]
            found = next(each for each in get_args(inner) if isinstance(each, FieldInfo))
        examples = found.examples or []
        return found.description or "", examples[0] if examples else None

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """What is wrong with the combination of keys, or None."""
        if not cls.choices:
            return None
        choosable = list(dict.fromkeys(key for choice in cls.choices for key in choice.needed))
        given = [key for key in choosable if key in data]
        if cls.choice_optional and not given:
            return None
        for choice in cls.choices:
            if set(given) == set(choice.needed):
                foreign = {key for other in cls.choices for key in other.also} - set(choice.also)
                misplaced = sorted(foreign & set(data))
                return f"{', '.join(misplaced)} cannot stand beside {choice}" if misplaced else None
        allowed = ", or ".join(str(choice) for choice in cls.choices)
        return f"exactly one is needed of: {allowed}; given: {', '.join(given) or 'none'}"


def _again(error: ErrorDetails) -> InitErrorDetails:
    """An error of pydantic's as what a further one is made of."""
    context = error.get("ctx", {})
    kind: str | PydanticCustomError = error["type"]
    if "text" in context:  # one of our own
        kind, context = PydanticCustomError(error["type"], "{text}", context), {}
    return InitErrorDetails(type=kind, loc=error["loc"], input=error["input"], ctx=context)
