"""Stand-in for a quantity that was not recorded: an error instead of zeros."""

from __future__ import annotations

from typing import Any

from ..errors import AttributeMissing


class NotRecorded:
    """Value of an attribute that was not recorded; every use of it raises `AttributeMissing` with the remedy.

    Copies and `dataclasses.replace` take it along.
    """

    def __init__(self, name: str, remedy: str) -> None:
        self.name = name
        self.remedy = remedy

    def __repr__(self) -> str:
        return f"not recorded ({self.remedy})"

    def _refuse(self, *_arguments: Any, **_options: Any) -> Any:
        raise AttributeMissing(f"{self.name} was not recorded: make the simulation with {self.remedy}")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # protocols, such as those of copying
            raise AttributeError(name)
        self._refuse()

    __array__ = __getitem__ = __len__ = __iter__ = __bool__ = __float__ = __int__ = _refuse
    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = __neg__ = __abs__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __matmul__ = __rmatmul__ = _refuse
    __truediv__ = __rtruediv__ = __floordiv__ = __mod__ = __pow__ = __rpow__ = _refuse
    __hash__ = object.__hash__
