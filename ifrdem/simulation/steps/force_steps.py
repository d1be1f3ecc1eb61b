"""Forces in steps: when each acts, within windows or between them, and its changes of the energy.

Imports the kernels, and the runtime with them: import this module only after `backend.start`.

Forces that act at one and the same time do so in the order given at every other such time and in the reverse order at
those between. Forces that do not commute would else make an error of first order in the step: drag before kicks is
a colder gas than kicks before drag. Alternating makes two steps together symmetric in time, hence second order.

A force at random times (`PoissonForce`) acts on each disk independently, at times that kernels find
(`kernels/disks/force_times.py`). It always acts within windows, and its times are not planned here.

A force *within windows* looks at one disk only, and its totals, if it has some, do not depend on the motion. It acts as
an event of the window (`kernels/forces/force_events.py`), in steps that are planned up to a time at which a window ends
anyway. Other forces end the window; those that are due at that time then act between windows, all in their order. So
does any force where no window is run, because nothing can collide.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError, InputError
from ...kernels import layout as k
from ...kernels.columns import KICK, LEVELS
from ...kernels.compiler.language import CompilationError, declared
from ...kernels.forces.forces import ForceKernels, kernels_of
from ...model.custom_code import check_constants, check_signature, why_not_compiled
from ...model.forces import OF_DISK, OF_STEP, Force, PoissonForce
from ...model.state import Disks
from ..windows.arrays import DeviceArrays
from .schedule import first_after, reached, time_of

if TYPE_CHECKING:
    from ..windows.windows import Windows

AHEAD = 256
"""Steps of the shortest length that are planned together: windows end after so many."""
MOST_SHARES = 12_000_000
"""Largest number of stored shares of disks in totals of steps ahead (96 MB): each random number is then drawn once."""
HEADROOM = 24
"""Binary digits by which energies that forces give may exceed those at the window's beginning, with exact sums."""
_kernels = functools.cache(kernels_of)  # compiled once for all objects of a class


def _is_ours(kind: type[Force]) -> bool:
    return kind.__module__ == Force.__module__


@functools.cache
def _compiled(kind: Any, number: int, first: int, n_bounds: int) -> k.CompiledForce:
    """The part of a class of forces that acts within windows."""
    alone = issubclass(kind, PoissonForce)
    measure = declared(kind.measure) if kind.totals else None
    names = (*kind.parameters, *kind.constants)
    return k.CompiledForce(
        declared(kind.act),
        kind.totals,
        names,
        number,
        first,
        alone=alone,
        measure=measure,
        draws_pair=kind.draws_pair,
        n_bounds=n_bounds,
    )


def acts_within(force: Force, arrays: DeviceArrays) -> bool:
    """True if a force acts within windows of this gas, in which it looks at one disk only.

    In a sheared box positions depend on the tile, to rounding, which a custom force may see.
    """
    return (not force.totals or force.totals_ahead) and (_is_ours(type(force)) or not arrays.uses.shear)


class ForceSteps:
    """The forces of one engine, in the order in which they act at a time at which several do.

    Steps until the present `time` [time] count as done; `species` has their numbers of disks, in the order of ids.
    InputError if a force cannot act on these disks.
    """

    def __init__(
        self, forces: Sequence[Force], arrays: DeviceArrays, disks: Disks, seed: int, time: float,
        species: Mapping[str, int],
    ) -> None:  # fmt: skip
        self.forces: tuple[Force, ...] = tuple(forces)
        self._bounds = [float(first) for first in accumulate(species.values())][:-1]
        for i, force in enumerate(self.forces):
            if force.totals and type(force).measure is Force.measure:
                raise InputError(
                    f"forces[{i}] = {force!r}: totals = {force.totals} requires a static method measure(disk, step, p) "
                    "that returns a ti.Vector of as many numbers"
                )
            force.check(disks)
            if isinstance(force, PoissonForce) and not acts_within(force, arrays):
                raise InputError(
                    f"forces[{i}] = {force!r}: random times are not supported for a custom force in a sheared box: use "
                    "a force in steps"
                )
            _check_compiles(i, force)
        self.arrays = arrays
        self._seed = seed
        self._steps = [force.step for force in self.forces]
        self._within = [i for i, force in enumerate(self.forces) if acts_within(force, arrays)]
        # Those that act at random times are never due at a step.
        self._in_steps = [i for i, force in enumerate(self.forces) if not isinstance(force, PoissonForce)]
        self._block = AHEAD * min((self._steps[i] for i in self._within), default=math.inf)
        self._next: list[int] = [first_after(time, step) for step in self._steps]  # without planned ones
        self._given: NDArray[np.float64] = np.zeros(len(self.forces))  # between windows
        self._sizes = [np.zeros(force.totals, np.int64) for force in self.forces]
        self._planned = np.zeros((0, KICK.width))  # rows of `kicks`
        self._until = math.nan  # to which steps are planned
        self._free, self._values = (False, False), np.zeros(0)

    def install(self, windows: Windows, heaviest: float) -> None:
        """Install the forces, between two windows; `heaviest` is the largest mass of a disk [mass]."""
        arrays, first, compiled = self.arrays, 0, []
        for number, i in enumerate(self._within):
            kind: Any = type(self.forces[i])
            compiled.append(_compiled(kind, number, first, len(self._bounds_for(i))))
            first += len(self._numbers_of(i))
        windows.set_forces(self, tuple(compiled))
        self._windows = windows
        if not self._within:
            return
        terms = (arrays.n * 2 * AHEAD).bit_length()
        exponent = math.frexp(heaviest)[1] + 20 + HEADROOM - (52 - terms)
        arrays.clock.gain_unit = math.ldexp(1.5, 52 + exponent)
        arrays.clock.gain_step = math.ldexp(1.0, terms - 52)
        arrays.clock.shortest_step = self._block / AHEAD
        arrays.clock.recent = 0.0

    # ------------------------------------------------------------------ when they act

    @property
    def next_steps(self) -> list[int]:
        """Number of the step in which each force acts next, at the present time."""
        return self._after(self._n_acted(self._windows.moment))

    @property
    def next_steps_of_window(self) -> list[int]:
        """The same at the beginning of the present window."""
        return self._after(int(self.arrays.clock.acted))

    def _after(self, acted: int) -> list[int]:
        """Number of the next step of each force after so many planned ones."""
        found = self._next.copy()
        for number in self._planned[:acted, KICK.force].astype(np.int64):
            found[self._within[number]] += 1
        return found

    def _n_acted(self, moment: float | None) -> int:
        """Planned steps that have acted until a moment of the present window; without one, until its beginning.

        Times are compared in the precision of the run, as kernels do.
        """
        acted = int(self.arrays.clock.acted)
        if moment is None or not len(self._planned):
            return acted
        times = (self._planned[:, KICK.time] - float(self.arrays.clock.begin)).astype(self.arrays.real)
        return max(acted, int(np.searchsorted(times, moment, side="right")))

    def _times(self, chosen: Sequence[int]) -> float:
        """Time at which one of the chosen forces acts next [time]; infinite without any."""
        steps = self.next_steps
        times = (time_of(steps[i], self._steps[i]) for i in chosen if i in self._in_steps)
        return min(times, default=math.inf)

    @property
    def next_time(self) -> float:
        """Time at which the next force acts [time]; infinite without forces."""
        return self._times(range(len(self.forces))) if self.forces else math.inf

    @property
    def ends_window(self) -> float:
        """Time at which forces end the window [time]: a force that does acts, or the planned steps are used up."""
        if not self.forces:
            return math.inf
        others = [i for i in range(len(self.forces)) if i not in self._within]
        end = math.inf
        if self._within:
            now = self._windows.now
            end = (math.floor(now / self._block) + 1) * self._block
            end += self._block * (end <= now)
        return min(end, self._times(others))

    @property
    def keeps_rest(self) -> bool:
        """True if none of the forces, if there are any, sets in motion what is at rest."""
        return bool(self.forces) and all(force.keeps_rest for force in self.forces)

    @property
    def allow_drift(self) -> bool:
        """True if all forces keep the momentum or are Galilean invariant: temperatures are about the mean velocity."""
        return all(force.keeps_momentum or force.galilean_invariant for force in self.forces)

    def skip_to(self, time: float) -> None:
        """Skip the steps until `time` [time], in which the forces have no effect, between two windows."""
        if math.isfinite(time):
            self._next = [
                max(number, first_after(time, step))
                for number, step in zip(self._next, self._steps, strict=True)
            ]

    def acting(self, now: float) -> list[int]:
        """Indices of the forces that act at `now` [time], in the order in which they do."""
        if not self.forces or now < self.next_time:  # by rounding too: a readout just before changes nothing
            return []
        steps = self.next_steps
        found = [i for i in self._in_steps if reached(time_of(steps[i], self._steps[i]), now)]
        return found[::-1] if found and steps[found[0]] % 2 else found

    # ------------------------------------------------------------------ within windows

    def take_values(self, free: tuple[bool, bool]) -> bool:
        """Take the present parameters, and directions along which the gas can drift: True if any have changed.

        The window then has to end.
        """
        given = [value for i in self._within for value in self._numbers_of(i)]
        values = np.array([*free, *given], dtype=np.float64)
        changed = not np.array_equal(values, self._values)
        self._free, self._values = free, values
        return changed

    def _numbers_of(self, index: int) -> list[float]:
        """Values of a force within windows, in the order of `columns.FORCE_VALUES`."""
        force = self.forces[index]
        alone = [force.step, float(index)] if isinstance(force, PoissonForce) else []
        return [*alone, *force.values.values(), *force.derived(), *self._bounds_for(index)]

    def _bounds_for(self, index: int) -> list[float]:
        """First ids of all species but the first, for a custom force; those of the program take all disks alike."""
        return [] if _is_ours(type(self.forces[index])) else self._bounds

    def _kernels_of(self, index: int) -> ForceKernels:
        kind: Any = type(self.forces[index])  # mypy does not take a class for hashable
        return _kernels(kind, len(self._bounds_for(index)))

    def _parameters_of(self, index: int) -> NDArray[np.float64]:
        """Parameters of a force and first ids for its kernels, with one entry at least."""
        force = self.forces[index]
        return np.array([*force.values.values(), *force.derived(), *self._bounds_for(index), 0.0])

    @property
    def n_kernels(self) -> int:
        """Number of kernels of the forces outside windows: that of each class, and those of its totals."""
        within = {type(self.forces[i]) for i in self._within}
        between = {type(force) for i, force in enumerate(self.forces) if i not in self._within}
        return len(between) + sum(bool(kind.totals) for kind in [*within, *between])

    @property
    def any_within(self) -> bool:
        """True if forces act within windows."""
        return bool(self._within)

    @property
    def any_alone(self) -> bool:
        """True if forces act on single disks at random times, which are found within windows."""
        return len(self._in_steps) < len(self.forces)

    def begin_window(self, moment: float | None) -> None:
        """Drop the planned steps: a window begins at a moment of the present one, or (None) where that begins."""
        clock = self.arrays.clock
        if moment is not None:  # as where one window follows another (`kernels/windows/planner.py`)
            clock.recent = max(self._windows.now - float(clock.begin), 0.5 * float(clock.recent))
        self._fold(moment)

    def _fold(self, moment: float | None) -> None:
        """Drop the planned steps; those until a moment of the present window have acted."""
        self._next = self._after(self._n_acted(moment))
        self._planned, self._until, self.arrays.clock.acted = np.zeros((0, KICK.width)), math.nan, 0.0

    def plan(self, until: float) -> None:
        """Plan the steps before a time `until` [time] at which a window ends; what is due then is left out."""
        if not self._within or until == self._until:
            return
        self._fold(self._windows.moment)
        a = self.arrays
        rows: list[tuple[float, ...]] = []
        totals = max(self.forces[i].totals for i in self._within)
        for number, i in enumerate(self._within):
            if i not in self._in_steps:
                continue
            step = self._steps[i]
            at, time = self._next[i], time_of(self._next[i], step)
            while time < until and not reached(until, time):
                rows.append((time, number, i, at, step))
                at, time = at + 1, time_of(at + 1, step)
        planned = np.zeros((len(rows), KICK.width + max(totals - 1, 0)))
        planned[:, KICK.shares] = -1.0
        if rows:
            planned[:, : len(rows[0])] = self._in_order(rows)
        a.set_force_values(self._values)
        a.clock.action_square = self._action_square()
        stored = 0
        self._make_room_for_shares(planned)
        for number, i in enumerate(self._within):
            if n := self.forces[i].totals:
                chosen = planned[:, KICK.force] == number
                begin, stored = stored, stored + int(chosen.sum()) * a.n * n
                if stored > a.shares.shape[0]:
                    begin, stored = -1, begin
                else:
                    planned[chosen, KICK.shares] = begin + a.n * n * np.arange(chosen.sum())
                columns = slice(KICK.totals.first, KICK.totals.first + n)
                planned[chosen, columns] = self._sum_ahead(i, planned[chosen, KICK.number], begin)
        self._planned, self._until = planned, until
        capacity = max(len(planned) + 1, int(a.kicks.shape[0]))
        table = np.full((capacity, planned.shape[1]), k.FAR)
        table[: len(planned)] = planned
        a.set_kicks(table)

    def _make_room_for_shares(self, planned: NDArray[np.float64]) -> None:
        """Make room for the shares of all disks in totals of planned steps, if that is not too much."""
        a = self.arrays
        counts = np.bincount(planned[:, KICK.force].astype(np.int64), minlength=len(self._within))
        needed = a.n * sum(
            int(count) * self.forces[i].totals for count, i in zip(counts, self._within, strict=True)
        )
        if needed <= MOST_SHARES and needed > a.shares.shape[0] and not a.uses.ranks:
            a.make("shares", needed)

    def _action_square(self) -> float:
        """The largest square of a speed that forces at random times have given to disks at rest, in a few draws.

        It sets a scale of speeds for a gas at rest, and for kicks that are strong.
        """
        found = np.zeros(1)
        for i, force in enumerate(self.forces):
            if isinstance(force, PoissonForce):
                self.arrays.launch(
                    self._kernels_of(i).kick_from_rest,
                    force.step,
                    parameters=self._parameters_of(i),
                    found=found,
                )
        return self.arrays.domain.comm.largest(float(found[0]))

    @staticmethod
    def _in_order(rows: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
        """Planned steps in the order in which they act; those at one time, but for rounding, get the very same one."""
        rows.sort()
        found: list[tuple[float, ...]] = []
        begin = 0
        while begin < len(rows):
            end = begin + 1
            while end < len(rows) and reached(rows[end][0], rows[begin][0]):
                end += 1
            group = sorted(rows[begin:end], key=lambda row: row[2])
            if group[0][3] % 2:
                group.reverse()
            found += [(rows[begin][0], *row[1:]) for row in group]
            begin = end
        return found

    def _sum_ahead(self, index: int, numbers: NDArray[np.float64], stored: int) -> NDArray[np.float64]:
        """Totals of a force in steps with these numbers, shape (steps, totals); shares are `stored` from there on."""
        force, n, steps = self.forces[index], self.forces[index].totals, len(numbers)
        if not steps:
            return np.zeros((0, n))
        found = np.zeros((self.arrays.tiles, steps, n * (1 + LEVELS)))

        def launch(rounders: NDArray[np.float64]) -> NDArray[np.float64]:
            self.arrays.launch(
                self._kernels_of(index).sum_ahead, stored, when=np.array([math.nan, force.step, *self._free]),
                counter_words=_words(0, index, self._seed), parameters=self._parameters_of(index), steps=numbers,
                tile_sums=found, rounders=rounders,
            )  # fmt: skip
            return found.reshape(self.arrays.tiles, -1)

        rows = self._rounded_sums(
            index, launch, lambda largest: largest.reshape(steps, -1)[:, :n].max(axis=0)
        )
        parts = rows.reshape(steps, 1 + LEVELS, n)[:, 1:]
        sums = np.array([[math.fsum(parts[m, :, j]) for j in range(n)] for m in range(steps)])
        if not np.isfinite(sums).all():
            raise EngineError(
                f"forces[{index}] = {type(force).__name__}: measure must read no position, velocity or spin, and "
                "give finite numbers, as totals_ahead = True"
            )
        return sums

    def _rounded_sums(self, index: int, launch: Any, largest_of: Any) -> NDArray[np.float64]:
        """Sums over tiles of what a kernel finds, with `rounders` for the sizes of terms that it finds."""
        domain = self.arrays.domain
        while True:  # once, where sizes are as in the last step
            found = launch(_rounders(self._sizes[index], self.arrays.n))
            largest = largest_of(domain.largest(found))
            size = _size(largest) if np.isfinite(largest).all() else self._sizes[index]
            if np.array_equal(size, self._sizes[index]):
                return domain.sums(found)
            self._sizes[index] = size

    def name_of(self, mark: int) -> tuple[str, str]:
        """Time of the action of a force, as text, and its name, from a mark in `counter.stalled`."""
        if mark >= k.NOT_FINITE_ALONE:
            index = self._within[mark - k.NOT_FINITE_ALONE]
            clock = self.arrays.clock
            when = f"{float(clock.begin):.9g} to {float(clock.end):.9g}"
        else:
            row = mark - k.NOT_FINITE
            index = int(self._planned[row, KICK.index])
            when = f"{float(self._planned[row, KICK.time]):.9g}"
        return when, f"force {index + 1}, {type(self.forces[index]).__name__}"

    # ------------------------------------------------------------------ between windows

    def apply(self, index: int, now: float, free: tuple[bool, bool]) -> float:
        """Apply a force due at `now` [time], where a window begins; what frames of rows see of it beyond its energy.

        `free` is True for x and y along which the whole gas can drift (`model.walls.wall.free_directions`).

        EngineError if it makes a velocity or spin that is not finite.
        """
        force, step, number = self.forces[index], self._steps[index], self._next[index]
        kernels = self._kernels_of(index)
        given: dict[str, Any] = {
            "when": np.array([time_of(number, step), step, *free]),
            "counter_words": _words(number, index, self._seed),
            "parameters": self._parameters_of(index),
        }

        def sums_by_tile(kernel: Any, columns: int, **more: Any) -> NDArray[np.float64]:
            tile_sums = np.zeros((self.arrays.tiles, columns))
            self.arrays.launch(kernel, tile_sums=tile_sums, **given, **more)
            return tile_sums

        totals = np.zeros(1)
        if n := force.totals:
            found = self._rounded_sums(
                index,
                lambda rounders: sums_by_tile(kernels.sum_totals, (1 + LEVELS) * n, rounders=rounders),
                lambda largest: largest[:n],
            )
            totals = np.array([math.fsum(each) for each in found[n:].reshape(LEVELS, n).T])
        gained = self.arrays.domain.sums(sums_by_tile(kernels.apply_force, 2, totals=totals))
        self._next[index] = number + 1
        if not math.isfinite(gained[0]):
            raise EngineError(
                f"t = {now:.9g}: force {index + 1}, {type(force).__name__}, made a velocity or spin that is not finite"
            )
        self._given[index] += gained[0]
        return float(gained[1])

    # ------------------------------------------------------------------ energy

    @property
    def energy_inputs(self) -> NDArray[np.float64]:
        """Energy that each force has put in [energy], shape (forces,)."""
        found = self._given.copy()
        if self._within:
            found[self._within] += [math.fsum(parts) for parts in self._windows.gains]
        return found

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """State of the forces at the beginning of the present window."""
        clock = self.arrays.clock
        found = {
            "next_steps": np.array(self.next_steps_of_window, dtype=np.int64),
            "energy_inputs": self._given.copy(),
        }
        if self._within:
            found["forces_in_window"] = np.array([self._until, clock.recent])
        return found

    def restore(self, found: dict[str, NDArray[Any]]) -> None:
        """Restore what `snapshot` gave, at the beginning of a window."""
        self._next, self._given = found["next_steps"].tolist(), found["energy_inputs"].copy()
        if self._within:
            until, self.arrays.clock.recent = found["forces_in_window"].tolist()
            if math.isfinite(until):
                self.plan(until)


def _check_compiles(i: int, force: Force) -> None:
    """Compile a custom force by itself; InputError if the runtime cannot, such as for a parameter that it lacks."""
    kind: Any = type(force)
    if _is_ours(kind):
        return
    owner, functions = f"forces[{i}] = {kind.__name__}", [kind.act] + [kind.measure] * (force.totals > 0)
    for function in functions:
        check_signature(owner, function, ("disk", "step", "p"))
    check_constants(owner, kind, "act", "measure")
    try:
        _kernels(kind).sample_force(np.ones(2), np.ones(len(force.parameters) + len(force.constants) + 1))
    except CompilationError as error:
        of_step = (
            *OF_STEP,
            *["totals (in act)", "share (in act)"] * (force.totals > 0),
            *["pair (in act)"] * force.draws_pair,
        )
        returns = "act must return three numbers, vx, vy and spin"
        if force.totals:
            returns += f", and measure a ti.Vector of length {force.totals}, as totals = {force.totals}"
        owners = {"disk": OF_DISK, "step": of_step, "p": (*force.parameters, *force.constants)}
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


def _words(number: int, index: int, seed: int) -> NDArray[np.uint32]:
    """Key of the random numbers: see `kernels/forces/forces.py`."""
    low = 2**32 - 1
    return np.array([number & low, number >> 32 & low, index, seed & low, seed >> 32], dtype=np.uint32)
