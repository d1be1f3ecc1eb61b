"""Objects whose attributes cannot be set by mistake, and those that cannot be copied."""

from __future__ import annotations

from typing import Any, ClassVar, NoReturn

from ..errors import AttributeRefused, InputError, nearest


class ReadOnlyAttributes:
    """Base of classes whose public attributes are read-only, and of which unknown ones are refused.

    Attributes
    ----------
    assignable : frozenset of str
        Names of the public attributes that can be set after all.
    """

    assignable: ClassVar[frozenset[str]] = frozenset()

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_") or name in self.assignable:
            object.__setattr__(self, name, value)
            return
        known = [each for each in dir(self) if not each.startswith("_")]
        kind = type(self).__name__
        if f"set_{name}" in known:
            raise AttributeRefused(f"{kind}.{name} cannot be assigned: use set_{name}(...)")
        if name in known:
            raise AttributeRefused(f"{kind}.{name} is read-only")
        raise AttributeRefused(f"{kind} has no attribute {name!r}{nearest(name, known)}")

    def _set(self, **values: Any) -> None:
        """Set public attributes, in methods of the class."""
        for name, value in values.items():
            object.__setattr__(self, name, value)


class NotCopied:
    """Base of classes whose objects cannot be copied or pickled: a gas on a device, a file that is written."""

    _instead: ClassVar[str]
    """Sentence on what to do instead."""

    def __reduce_ex__(self, _protocol: object) -> NoReturn:
        """Raise InputError: `copy.copy` would give a second name to the same device arrays or file."""
        raise InputError(f"a {type(self).__name__} cannot be copied or pickled. {self._instead}")
