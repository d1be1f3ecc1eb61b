"""Operator splitting: times at which each force acts, and its changes of the energy.

Imports the kernels, and the runtime with them: import this module only after `backend.start`.

Forces that act at one and the same time do so in the order given at every other such time and in the reverse order at
those between. Forces that do not commute would else make an error of first order in the step: drag before kicks is
a colder gas than kicks before drag. Alternating makes two steps together symmetric in time, hence second order.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InputError
from ..kernels.forces import LEVELS, kernels_of
from ..kernels.language import CompilationError
from ..model.custom_code import check_constants, check_signature, why_not_compiled
from ..model.forces import OF_DISK, OF_STEP, Force
from ..model.state import Disks
from .arrays import DeviceArrays
from .schedule import first_after, reached, time_of

_kernels = functools.cache(kernels_of)  # compiled once for all objects of a class


class ForceSteps:
    """The forces of one engine, in the order in which they act at a time at which several do.

    What was to act until the present `time` [time] has acted. InputError if a force cannot act on these disks.

    Attributes
    ----------
    next_steps : list of int
        Number of the step in which each force acts next.
    energy_inputs : array (forces,)
        Energy that each has put in [energy].
    """

    def __init__(
        self, forces: Sequence[Force], arrays: DeviceArrays, disks: Disks, seed: int, time: float
    ) -> None:
        self.forces: tuple[Force, ...] = tuple(forces)
        for i, force in enumerate(self.forces):
            if force.totals and type(force).measure is Force.measure:
                raise InputError(
                    f"forces[{i}] = {force!r}: totals = {force.totals} requires a static method measure(disk, step, p) "
                    "that returns a ti.Vector of as many numbers"
                )
            force.check(disks)
            _check_compiles(i, force)
        self.arrays = arrays
        self._seed = seed
        self._steps = [force.step for force in self.forces]
        self.next_steps: list[int] = [first_after(time, step) for step in self._steps]
        self.energy_inputs: NDArray[np.float64] = np.zeros(len(self.forces))
        self._sizes = [np.zeros(force.totals, np.int64) for force in self.forces]

    @property
    def next_time(self) -> float:
        """Time at which the next force acts [time]; infinite without forces."""
        return min(
            (time_of(k, step) for k, step in zip(self.next_steps, self._steps, strict=True)), default=math.inf
        )

    @property
    def keeps_rest(self) -> bool:
        """True if none of the forces, if there are any, sets in motion what is at rest."""
        return bool(self.forces) and all(force.keeps_rest for force in self.forces)

    @property
    def keep_momentum(self) -> bool:
        """True if none of the forces changes the total momentum."""
        return all(force.keeps_momentum for force in self.forces)

    def skip_to(self, time: float) -> None:
        """Skip the steps until `time` [time], in which the forces have no effect."""
        if math.isfinite(time):
            self.next_steps = [
                max(k, first_after(time, step)) for k, step in zip(self.next_steps, self._steps, strict=True)
            ]

    def acting(self, now: float) -> list[int]:
        """Indices of the forces that act at `now` [time], in the order in which they do."""
        if now < self.next_time:  # by rounding too: a readout just before changes nothing
            return []
        found = [i for i, step in enumerate(self._steps) if reached(time_of(self.next_steps[i], step), now)]
        return found[::-1] if found and self.next_steps[found[0]] % 2 else found

    def apply(self, index: int, now: float, free: tuple[bool, bool]) -> float:
        """Apply a force due at `now` [time], where a window begins; what frames of rows see of it beyond its energy.

        `free` is True for x and y along which the whole gas can drift (`model.walls.wall.free_directions`).

        EngineError if it makes a velocity or spin that is not finite.
        """
        force, step, k = self.forces[index], self._steps[index], self.next_steps[index]
        parameters = np.array([*force.values.values(), 0.0])  # one entry at least
        kind: Any = type(force)  # mypy does not take a class for hashable
        sum_totals, apply_force, _ = _kernels(kind)
        given: dict[str, Any] = {
            "when": np.array([time_of(k, step), step, *free]),
            "counter_words": _words(k, index, self._seed),
            "parameters": parameters,
        }

        def sums_by_tile(kernel: Any, columns: int, **more: Any) -> NDArray[np.float64]:
            tile_sums = np.zeros((self.arrays.tiles, columns))
            self.arrays.launch(kernel, tile_sums=tile_sums, **given, **more)
            return tile_sums

        totals = np.zeros(1)
        if sum_totals is not None:
            n, size = force.totals, self._sizes[index]
            while True:  # once, where sizes are as in the last step
                found = sums_by_tile(sum_totals, (1 + LEVELS) * n, rounders=_rounders(size, self.arrays.n))
                size = _size(self.arrays.domain.largest(found)[:n])
                if np.array_equal(size, self._sizes[index]):
                    break
                self._sizes[index] = size
            sums = self.arrays.domain.sums(found)[n:].reshape(LEVELS, n)
            totals = np.array([math.fsum(each) for each in sums.T])
        gained = self.arrays.domain.sums(sums_by_tile(apply_force, 2, totals=totals))
        self.next_steps[index] = k + 1
        if not math.isfinite(gained[0]):
            raise EngineError(
                f"t = {now:.9g}: force {index + 1}, {type(force).__name__}, made a velocity or spin that is not finite"
            )
        self.energy_inputs[index] += gained[0]
        return float(gained[1])


def _check_compiles(i: int, force: Force) -> None:
    """Compile a custom force by itself; InputError if the runtime cannot, such as for a parameter that it lacks."""
    kind: Any = type(force)
    if kind.__module__ == Force.__module__:
        return
    owner, functions = f"forces[{i}] = {kind.__name__}", [kind.act] + [kind.measure] * (force.totals > 0)
    for function in functions:
        check_signature(owner, function, ("disk", "step", "p"))
    check_constants(owner, kind, "act", "measure")
    try:
        _kernels(kind)[2](np.ones(2), np.ones(len(force.parameters) + 1))
    except CompilationError as error:
        of_step = (*OF_STEP, *["totals (in act)"] * (force.totals > 0))
        returns = "act must return three numbers, vx, vy and spin"
        if force.totals:
            returns += f", and measure a ti.Vector of length {force.totals}, as totals = {force.totals}"
        owners = {"disk": OF_DISK, "step": of_step, "p": force.parameters}
        reason = why_not_compiled(error, functions, owners, returns)
        if not force.totals and "'totals'" in reason:
            reason += "; totals require a class attribute totals (their number) and a static method measure"
        raise InputError(f"{owner}: cannot compile it: {reason}") from error


def _size(largest: NDArray[np.float64]) -> NDArray[np.int64]:
    """The power of two below which sizes of terms are: one in eight, none near 1, so that it is mostly what it was."""
    found: NDArray[np.int64] = 4 - (4 - np.frexp(largest)[1].astype(np.int64)) // 8 * 8
    return found


def _rounders(size: NDArray[np.int64], n: int) -> NDArray[np.float64]:
    """Numbers that round n terms below 2^size to parts when added, shape (LEVELS, totals).

    Adding 1.5 x 2^52 rounds to whole numbers, and so on. Parts of n terms are below 2^52 of these in all. The last ones
    are multiples of the smallest number there is (2^-1074), if terms are so small.
    """
    bits = 52 - n.bit_length()
    size = np.maximum(size, LEVELS * bits - 1074)
    found: NDArray[np.float64] = np.ldexp(1.5, 52 + size - bits * np.arange(1, LEVELS + 1)[:, None])
    return found


def _words(k: int, index: int, seed: int) -> NDArray[np.uint32]:
    """Key of the random numbers: see `kernels/forces.py`."""
    low = 2**32 - 1
    return np.array([k & low, k >> 32 & low, index, seed & low, seed >> 32], dtype=np.uint32)
