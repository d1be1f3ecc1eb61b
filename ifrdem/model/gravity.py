"""Gravity: a constant acceleration, or one whose direction rotates in exact small steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any

from ..errors import InputError
from ..tools import checked
from ..tools.checked import LEAST, Number, validated

DEFAULT_STEP, MAX_STEP = 0.005, 0.1  # rad
EARTH = 9.81
"""Acceleration of gravity where none is given [m/s^2]."""


Step = Annotated[float, Number(LEAST, MAX_STEP, f"an angle above 0 and up to {MAX_STEP} rad")]
"""Angle of the steps in which gravity rotates [rad]."""


@validated
@dataclass(frozen=True)
class RotatingGravity:
    """Gravity that rotates at a constant rate, as in the frame of a slow drum (`ifrdem docs heaps`).

    Parameters
    ----------
    start : two floats
        Acceleration at time 0 [length/time^2].
    rate : float
        Rate [rad/time], positive counter-clockwise: that of a drum with the opposite sign.
    step : float
        Angle of the steps [rad], up to 0.1: gravity is constant between two steps, and collisions are exact.

    Raises
    ------
    InputError
        If a number is out of range, or `start` is (0, 0).

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.RotatingGravity((0.0, -9.81), rate=0.02).step
    0.005
    """

    start: tuple[float, float]
    rate: float = field(kw_only=True)
    step: Step = field(default=DEFAULT_STEP, kw_only=True)

    def __post_init__(self) -> None:
        if not any(self.start):
            raise InputError(f"start = {self.start}: must not be (0, 0), which has no direction to rotate")
        if self.rate == 0.0:
            raise InputError(f"rate = 0: must not be 0; for constant gravity give {self.start} itself")

    @property
    def steps_per_turn(self) -> float:
        """Steps of a whole turn."""
        return 2.0 * math.pi / self.step


Gravity = tuple[float, float] | RotatingGravity
"""A constant acceleration [length/time^2], or one that rotates."""


def validate(gravity: Any) -> Gravity:
    """The checked gravity of a user; InputError if it is neither two numbers nor a `RotatingGravity`."""
    return gravity if isinstance(gravity, RotatingGravity) else checked.PAIR("gravity", gravity)
