"""What all sections of a case file have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, get_args

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError


@dataclass(frozen=True)
class Choice:
    """Keys that belong together: all of `needed`, and any of `also` beside them."""

    needed: tuple[str, ...]
    also: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " + ".join(self.needed)


class Section(BaseModel):
    """Common behaviour of all sections: no unknown keys, no conversion of types, no NaN or infinity.

    `choices` lists alternatives of which exactly one is to be given (at most one if `choice_optional`).
    """

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)
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
            errors += [
                InitErrorDetails(
                    type=each["type"], loc=each["loc"], input=each["input"], ctx=each.get("ctx", {})
                )
                for each in error.errors(include_url=False)
            ]
        raise ValidationError.from_exception_data(cls.__name__, errors)

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
