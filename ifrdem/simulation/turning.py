"""Gravity that turns, in exact small steps: the world as a slowly turning drum sees it.

In the frame of a drum that turns by -Omega, its walls are at rest and gravity turns by Omega. Between steps gravity is
constant, so that disks fly along parabolas and every collision is exact. Step k = 0, 1, ... is at (k + 1/2) delta /
|Omega|, delta the angle of a step: from then on gravity has the direction that it had at t = 0 turned by (k + 1) delta,
never more than delta / 2 from the true one, and the right one on average: the error is of second order in delta.

Energy. A step changes the potential energy -sum m g.x by -sum m (g' - g).x, which counts as put in. It is the work of
the drum, seen from its frame: where the energy of the disks does not change on average, collisions dissipate as much.

What such a frame has beside this, and what is left out: centrifugal acceleration, Omega^2 R at most (over g, the
*Froude number*), and Coriolis acceleration 2 Omega v. In steady flow a layer of thickness h carries the flux
Omega R^2 / 2, so v = Omega R^2 / 2 h, and that is Omega^2 R^2 / h: the Froude number times R / h. Both vanish as
Omega^2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..errors import InputError
from .schedule import first_after, time_of

if TYPE_CHECKING:
    from .engine import EngineOptions

USUAL_STEP, MOST_STEP = 0.005, 0.1  # rad
FASTEST_DRUM = 0.01
"""Froude number above which the frame of a drum is more than gravity that turns: the centrifugal acceleration in g."""


class TurningGravity:
    """Direction of gravity, step after step.

    It is `gravity` [length/time^2] at t = 0, and turns counter-clockwise at a `rate` Omega [rad/time], 0 if it stays,
    in steps of an angle [rad]; those until the present `time` [time] are done.

    Attributes
    ----------
    next_step : int
        Number of the step that comes next.
    work : float
        Energy that the steps have put in [energy].
    """

    def __init__(self, gravity: tuple[float, float], rate: float, step: float, time: float) -> None:
        self._gravity, self._rate, self._step = gravity, rate, step
        self.next_step: int = first_after(time, self._interval) if rate else 0
        self.work: float = 0.0

    @property
    def _interval(self) -> float:
        return self._step / abs(self._rate)

    @property
    def steps_per_turn(self) -> float:
        """Steps of a whole turn; 0 for gravity that stays."""
        return 2.0 * math.pi / self._step if self._rate else 0.0

    @property
    def next_time(self) -> float:
        """Time of the next step [time]; infinite for gravity that stays."""
        return time_of(self.next_step, self._interval) if self._rate else math.inf

    @property
    def turned_at(self) -> float:
        """Time of the latest step [time]; minus infinity if there was none."""
        return time_of(self.next_step - 1, self._interval) if self.next_step > 0 else -math.inf

    @property
    def gravity(self) -> tuple[float, float]:
        """Present gravity [length/time^2]."""
        if not self.next_step:
            return self._gravity
        angle = math.copysign(self.next_step * self._step, self._rate)
        (x, y), c, s = self._gravity, math.cos(angle), math.sin(angle)
        return c * x - s * y, s * x + c * y


def check_turning(options: EngineOptions, periodic: tuple[bool, bool], tracked: bool, ranks: int) -> None:
    """Refuse gravity that cannot turn: InputError."""
    gravity, rate, step = options.gravity, options.gravity_rotation_rate, options.gravity_rotation_step
    if not math.isfinite(rate):
        raise InputError(f"gravity_rotation_rate = {rate}: must be a finite number [rad/time]")
    if not 0.0 < step <= MOST_STEP:
        raise InputError(
            f"gravity_rotation_step = {step}: must be an angle above 0 and up to {MOST_STEP} rad"
        )
    if not rate:
        return
    name = f"gravity_rotation_rate = {rate:g}"
    if not any(gravity):
        raise InputError(f"{name}: gravity = {gravity}, and nothing turns; give one")
    if any(periodic):
        along = " and ".join(axis for axis, each in zip("xy", periodic, strict=True) if each)
        raise InputError(
            f"{name}: disks would fall for ever along {along}, which is periodic; use a box that is not"
        )
    if tracked:
        raise InputError(f"{name}: disks cannot be tracked (histories) where gravity turns; use more frames")
    if ranks > 1:
        raise InputError(f"{name}: not supported on several ranks (here are {ranks}); run it without mpiexec")
