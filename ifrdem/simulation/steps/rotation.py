"""Rotating gravity, in exact small steps: gravity in the frame of a slowly rotating drum.

In the frame of a drum that turns by -Omega, its walls are at rest and gravity turns by Omega. Between steps gravity is
constant, so that disks fly along parabolas and every collision is exact. Step k = 0, 1, ... is at (k + 1/2) delta /
|Omega|, delta the angle of a step: from then on gravity has the direction that it had at t = 0 turned by (k + 1) delta,
never more than delta / 2 from the true one, and the right one on average: the error is of second order in delta.

Energy. A step changes the potential energy -sum m g.x by -sum m (g' - g).x, which counts as put in. It is the work of
the drum, seen from its frame: where the energy of the disks does not change on average, collisions dissipate as much.

Such a frame has two more accelerations, which are left out: the centrifugal one, Omega^2 R at most (over g, the
*Froude number*), and Coriolis acceleration 2 Omega v. In steady flow a layer of thickness h carries the flux
Omega R^2 / 2, so v = Omega R^2 / 2 h, and that is Omega^2 R^2 / h: the Froude number times R / h. Both vanish as
Omega^2.
"""

from __future__ import annotations

import math

from ...model.gravity import Gravity, RotatingGravity
from .schedule import first_after, time_of

FASTEST_DRUM = 0.01
"""Froude number above which the frame of a drum is more than gravity that turns: the centrifugal acceleration in g."""


class GravityRotation:
    """Gravity at the present time of a run, step after step; steps until `time` [time] are done.

    Attributes
    ----------
    next_step : int
        Number of the step that comes next.
    work : float
        Energy that the steps have put in [energy].
    """

    def __init__(self, gravity: Gravity, time: float) -> None:
        self.rotating: RotatingGravity | None = gravity if isinstance(gravity, RotatingGravity) else None
        self._start = gravity.start if isinstance(gravity, RotatingGravity) else gravity
        self.next_step: int = first_after(time, self._interval) if self.rotating else 0
        self.work: float = 0.0

    @property
    def _interval(self) -> float:
        return self.rotating.step / abs(self.rotating.rate) if self.rotating else math.inf

    @property
    def steps_per_turn(self) -> float:
        """Steps of a whole turn; 0 for constant gravity."""
        return self.rotating.steps_per_turn if self.rotating else 0.0

    @property
    def next_time(self) -> float:
        """Time of the next step [time]; infinite for constant gravity."""
        return time_of(self.next_step, self._interval) if self.rotating else math.inf

    @property
    def rotated_at(self) -> float:
        """Time of the latest step [time]; minus infinity if there was none."""
        return time_of(self.next_step - 1, self._interval) if self.next_step > 0 else -math.inf

    @property
    def gravity(self) -> tuple[float, float]:
        """Present gravity [length/time^2]."""
        if not self.next_step or self.rotating is None:
            return self._start
        angle = math.copysign(self.next_step * self.rotating.step, self.rotating.rate)
        (x, y), c, s = self._start, math.cos(angle), math.sin(angle)
        return c * x - s * y, s * x + c * y
