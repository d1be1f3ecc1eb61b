"""Direct simulation Monte Carlo: the kinetic equation of a homogeneous gas, solved with the law itself.

No positions: any two disks may meet, at the rate that Enskog's equation gives them, 2 g_ij sigma_ij |v_i - v_j| / area.
What comes out is what a gas does that stays homogeneous and uncorrelated, with all that Gaussian theory leaves out:
tails, cumulants, spins that depend on velocities. The method is G. A. Bird's (Molecular Gas Dynamics and the Direct
Simulation of Gas Flows, Oxford 1994), without a time step: pairs are drawn at the highest rate that may come, and
collide with the probability that makes it theirs, one after the other (Kac's process of N disks).

Seen: 20,000 coins of 1 pta at packing fraction 0.02, 8 collisions per disk after a start without spin, T = 1: T_rot is
0.0779 in an event-driven simulation, 0.0782 here, and 0.0831 by the theory of Gaussians (T: 0.167, 0.167, 0.165).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import EngineError, InputError, NoMoreCollisions
from ..kernels.columns import BODY, DSMC_TABLES, SCALE, Named
from ..kernels.layout import Uses
from ..model.device import Device
from ..model.laws.law import CollisionLaw, compiled
from ..model.laws.pairs import PairLaws
from ..model.observables import Stress
from ..model.state import Disks, State
from ..theory.contact import Contact, PackingFraction, contact_value_coefficients
from ..theory.driven_gas import Driving
from ..theory.sonine import sonine_coefficient
from ..tools import checked, seeds
from ..tools.checked import (
    Column,
    Integer,
    NonNegative,
    NonNegativeColumn,
    Real,
    Seed,
    Vectors,
    check_of,
    validated,
)
from ..tools.read_only import NotCopied, ReadOnlyAttributes
from . import backend
from .steps.schedule import warn_of_end

SPEED_EDGES = np.append(np.arange(0.0, 6.05, 0.1).round(1), np.inf)
"""Edges of the bins of |c|."""


@dataclass(frozen=True)
class Relaxation:
    """Course of a homogeneous gas; q samples, s species.

    Attributes
    ----------
    time : array (q,)
        [time].
    collisions_per_disk : array (q,)
        Twice the collisions over the number of disks.
    temperature, rotational_temperature : array (q,)
        m <v^2> / 2, relative to the mean velocity, and I <w^2>, of all disks [energy].
    a_2, a_2_rot : array (q,)
        <c^4> / (2 <c^2>^2) - 1 with c^2 = m v^2, and <W^4> / (3 <W^2>^2) - 1 with W^2 = I w^2: 0 for Gaussians at one
        temperature; nan where nothing moves.
    temperature_of, rotational_temperature_of, a_2_of, a_2_rot_of, collisions_per_disk_of : array (q, s)
        The same of each species.
    energy : array (q,)
        Kinetic energy of all disks, with spins [energy].
    energy_input : array (q,)
        Energy that the driving and the flow have added since the start, less what they took [energy].
    kinetic_stress : array (q, 2, 2)
        Kinetic part of the pressure tensor [energy/length^2].
    collisional_stress : array (q, 2, 2)
        Its collisional part in a flow, mean since the sample before; nan in the first one, and without a flow.
    speed_counts : array (q, s, b)
        Disks of each species with |c| = |v| / sqrt(2 T / m) in the bins of `SPEED_EDGES`, T that of the species.
    """

    time: NDArray[np.float64]
    collisions_per_disk: NDArray[np.float64]
    temperature: NDArray[np.float64]
    rotational_temperature: NDArray[np.float64]
    a_2: NDArray[np.float64]
    a_2_rot: NDArray[np.float64]
    temperature_of: NDArray[np.float64]
    rotational_temperature_of: NDArray[np.float64]
    a_2_of: NDArray[np.float64]
    a_2_rot_of: NDArray[np.float64]
    collisions_per_disk_of: NDArray[np.float64]
    energy: NDArray[np.float64]
    energy_input: NDArray[np.float64]
    kinetic_stress: NDArray[np.float64]
    collisional_stress: NDArray[np.float64]
    speed_counts: NDArray[np.int64]

    def stress(self, start: float = 0.0) -> Stress:
        """Mean pressure tensor of a sheared gas over the samples after a time [time], which are at even times.

        InputError if there is none.
        """
        after = (self.time > start) & np.isfinite(self.collisional_stress[:, 0, 0])
        if not after.any():
            raise InputError(f"start = {start:g}: must be before the last sample of a gas with a shear_rate")
        return Stress(self.kinetic_stress[after].mean(axis=0), self.collisional_stress[after].mean(axis=0))

    def speed_density(self, start: float = 0.0) -> NDArray[np.float64]:
        """Probability density of |c| in the bins of `SPEED_EDGES`, by the samples from a time [time] on, shape (s, b).

        The last bin, which has no end, has the probability of all higher speeds instead. InputError if there is no
        such sample.
        """
        counts = self.speed_counts[self.time >= start].sum(axis=0)
        if not counts.any():
            raise InputError(f"start = {start:g}: must be at most the time of the last sample")
        width = np.append(np.diff(SPEED_EDGES[:-1]), 1.0)
        return np.asarray(counts / counts.sum(axis=1, keepdims=True) / width)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Ratio of the rotational to the translational temperature, shape (q,)."""
        return self.rotational_temperature / self.temperature


@dataclass(frozen=True)
class Checkpoint:
    """Full state of a gas, without its disks, law and driving: see `DSMC.resume`.

    Attributes
    ----------
    velocity : array (n, 2)
        [length/time].
    spin : array (n,)
        [rad/time].
    collisions_of_disks : array (n,)
        Collisions that each disk has had.
    time : float
        [time].
    energy_input : float
        Energy that the driving has added so far [energy].
    batches, kicks : int
        How often random numbers were drawn, for collisions and for the driving.
    """

    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]
    collisions_of_disks: NDArray[np.int32]
    time: float
    energy_input: float
    batches: int
    kicks: int


def sample(
    disks: Disks,
    velocity: NDArray[np.float64],
    spin: NDArray[np.float64],
    hits: NDArray[np.int32],
    species: NDArray[np.intp],
) -> dict[str, Any]:
    """Quantities of `Relaxation` at one time, without the time and the energy put in; stress times the area.

    Velocities (n, 2) [length/time], spins (n,) [rad/time], collisions (n,) of each disk; `species` (n,), 0 to s - 1:
    what each is summed up with.
    """
    drift = np.sum(disks.mass[:, None] * velocity, axis=0) / disks.mass.sum()
    # Scaled so that their squares are twice the energies: disks of different masses can be summed up.
    c = np.sqrt(disks.mass)[:, None] * (velocity - drift)
    W = np.sqrt(disks.inertia) * spin
    members = [species == each for each in range(int(species.max()) + 1)]
    of = [_moments(c[own], W[own]) for own in members]
    whole = _moments(c, W)
    scales = [math.sqrt(2.0 * each["temperature"]) or 1.0 for each in of]
    speeds = (np.hypot(*c[own].T) / scale for own, scale in zip(members, scales, strict=True))
    return {
        "collisions_per_disk": float(np.mean(hits)),
        **whole,
        **{f"{name}_of": np.array([each[name] for each in of]) for name in whole},
        "collisions_per_disk_of": np.array([float(np.mean(hits[own])) for own in members]),
        "energy": 0.5 * float(np.sum(disks.mass * np.sum(velocity**2, axis=1)) + np.sum(W**2)),
        "kinetic_stress": c.T @ c,
        "speed_counts": np.array([np.histogram(each, SPEED_EDGES)[0] for each in speeds]),
    }


def _moments(c: NDArray[np.float64], W: NDArray[np.float64]) -> dict[str, float]:
    """Temperatures and fourth cumulants of velocities times sqrt(m) and spins times sqrt(I)."""
    T, T_rot = 0.5 * float(np.mean(np.sum(c**2, axis=1))), float(np.mean(W**2))
    a_2_rot = float(np.mean((W**2 / T_rot) ** 2)) / 3.0 - 1.0 if T_rot > 0.0 else math.nan
    return {
        "temperature": T,
        "rotational_temperature": T_rot,
        "a_2": sonine_coefficient(c),
        "a_2_rot": a_2_rot,
    }


MARGIN = 1.15  # how much faster than the fastest disk one may become before a batch is cut short
_LEAST = 32  # candidates of a batch, so that the last collisions of a sample do not take hundreds of launches
_ROUNDS = 4  # between two looks at what is left to settle


def _samples(name: str, value: Any) -> Any:
    of_moments = check_of(NonNegativeColumn)
    assert of_moments is not None
    is_list = isinstance(value, Sequence) or (isinstance(value, np.ndarray) and value.ndim > 0)
    return (
        of_moments(name, value) if is_list and not isinstance(value, str | bytes) else Integer(1)(name, value)
    )


Samples = Annotated[int | ArrayLike, _samples]
"""A number of samples, or the moments at which they are taken, shape (q,)."""


class DSMC(NotCopied, ReadOnlyAttributes):
    """A homogeneous gas of rough disks, without places.

    Parameters
    ----------
    disks : Disks
        Two at least, none immovable. Radii may all differ.
    law : CollisionLaw or sequence of sequences of CollisionLaw
        As for `Simulation`: an `IFRLaw`, rolling friction included, or a custom law.
    packing_fraction : float
        Part of the area that the disks cover; it sets the area and the contact values.
    velocity : array_like (n, 2)
        Velocities at the start [length/time].
    spin : array_like (n,), optional
        Spins at the start [rad/time]; 0 without them.
    seed : int
        Of all random numbers, 0 to 2^64 - 1.
    species : array_like of int (n,), optional
        What disks are summed up together; by default those of one material.
    driving : Driving or sequence of Driving, optional
        Power, spin power and linear friction of every disk, whatever its mass: white noise, or a heat bath
        (`theory.Driving`); or one for each of the species, in ascending order. The total momentum is then not kept.
    shear_rate : float
        du_x/dy of a uniform flow [1/time], to which velocities are relative; the mean of those given is taken off.
        Disks that touch pass on momentum over their distance: Enskog's equation, as J. M. Montanero and A. Santos,
        Phys. Rev. E 54, 438 (1996), doi:10.1103/PhysRevE.54.438, solve it.
    contact : {"virial", "henderson", "dilute"}
        Contact values (`contact.contact_value_coefficients`); "dilute" solves Boltzmann's equation.
    device : Device or str
        As for `Simulation`. What comes out is the same to the last bit for any number of threads.

    Raises
    ------
    InputError
        If shapes do not fit, a disk is immovable, there are fewer than two, the law could add energy for the disks
        present, the packing fraction is impossible, or the device is not there.

    Warns
    -----
    EnergyWarning
        As `Simulation`: a custom law that adds energy.

    Notes
    -----
    Driving and flow act over half a batch before and after its collisions, so that their error is of second order in a
    batch of 0.1 collisions per disk; without them there is no error but that of a finite number of disks, and of
    rounding.
    Disks of very different sizes or speeds make most drawn pairs come to nothing: right, but slow.

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(2000, mass=1.0, radius=0.5)
    >>> law = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    >>> velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    >>> found = ifrdem.DSMC(disks, law, 0.1, velocity, seed=1).run(collisions_per_disk=5, samples=5)
    >>> found.temperature.shape, bool(found.temperature[-1] < 0.7)
    ((6,), True)
    """

    _instead = "Another one with the same arguments has the same collisions"

    disks: Disks
    driving: tuple[Driving, ...]
    shear_rate: float
    area: float
    time: float
    collisions: int
    energy_input: float
    candidates: int
    cut_for_speed: int

    @validated
    def __init__(
        self,
        disks: Disks,
        law: CollisionLaw | Sequence[Sequence[CollisionLaw]],
        packing_fraction: PackingFraction,
        velocity: Vectors,
        spin: Column | None = None,
        seed: Seed = 0,
        *,
        species: Column | None = None,
        driving: Driving | Sequence[Driving] | None = None,
        shear_rate: Real = 0.0,
        contact: Contact = "virial",
        device: Device | str | None = None,
    ) -> None:
        n = disks.n
        if n < 2 or not disks.movable.all():
            raise InputError(f"disks = {n}: must be two or more, of finite mass")
        if packing_fraction == 0.0:
            raise InputError("packing_fraction = 0.0: must be above 0, or disks do not meet")
        spins = np.zeros(n) if spin is None else checked.array("spin", spin, (n,))
        start = State(np.zeros((n, 2)), checked.array("velocity", velocity), spins)  # checks the shape
        self._set(disks=disks, shear_rate=float(shear_rate))
        self._valid = True
        self._seed = seeds.of_device(seed)
        self._species = self._grouped(disks.material if species is None else species)
        self._set(driving=self._driving(driving))
        if shear_rate:
            mean = disks.mass @ start.velocity / disks.mass.sum()
            start = State(start.position, start.velocity - mean, spins)
        device = Device.of(device)
        laws = PairLaws.of(law, disks, precision=device.precision)
        self._set(area=math.pi * float(np.sum(disks.radius**2)) / packing_fraction)
        with backend.sole_use():
            running = backend.start(device)
        self._alone = device.name == "cpu" and running.threads == 1
        self._real: Any = np.float32 if device.precision == "f32" else np.float64
        a, b = contact_value_coefficients(packing_fraction, disks.radius, None, contact)
        largest = float(disks.radius.max())
        self._section = 2.0 * a * largest + b * largest**2  # the largest g_ij sigma_ij
        self._contact_value = np.array([a, b, 0.0, 0.0, shear_rate], dtype=self._real)
        self._flow_apart = (
            abs(self.shear_rate) * largest
        )  # the most by which a flow makes touching disks approach
        self._batch = max(n // (4 if self.driving and not shear_rate else 1), _LEAST)
        kind: Any = laws.kind  # mypy does not take a class for hashable
        self._make_arrays(start, compiled(kind), laws.coefficients)
        fastest = max(float(np.abs(part).max()) for part in (start.velocity, disks.radius * spins))
        laws.check_speed(disks, float(np.sqrt(np.mean(np.sum(np.square(start.velocity), axis=1)))))
        laws.check_by_sampling(disks, [], fastest or 1.0)
        self._set(time=0.0, collisions=0, energy_input=0.0, candidates=0, cut_for_speed=0)
        self._batches = self._kicks = 0

    def _grouped(self, species: ArrayLike) -> NDArray[np.intp]:
        labels = np.asarray(species)
        if labels.shape != (self.disks.n,):
            raise InputError(
                f"species has shape {labels.shape}: must be one for each of {self.disks.n} disks"
            )
        _, which = np.unique(labels, return_inverse=True)
        return which.ravel()

    def _driving(self, given: Driving | Sequence[Driving] | None) -> tuple[Driving, ...]:
        """The driving of each species, none without."""
        count = int(self._species.max()) + 1
        if given is None:
            return ()
        if isinstance(given, Driving):
            return (given,) * count
        found = tuple(given) if isinstance(given, Sequence) else ()
        if len(found) != count or not all(isinstance(each, Driving) for each in found):
            raise InputError(f"driving: must be a Driving, or a list of {count}, one for each species")
        return found

    def _make_arrays(self, start: State, law: Any, table: NDArray[np.float64]) -> None:
        # They import the runtime, which `backend.start` has set going.
        from ..kernels import dsmc as kernels
        from ..kernels.compiler import language
        from ..kernels.compiler.language import ti
        from ..kernels.compiler.signature import parameters_of

        self._kernels: Any = kernels
        self._language: Any = language
        self._parameters_of: Any = functools.cache(parameters_of)
        sheared = self.shear_rate != 0.0
        self._uses = Uses(collision_law=law, shear=sheared, stress=sheared)
        n, disks = self.disks.n, self.disks
        real = ti.f32 if self._real is np.float32 else ti.f64
        # More candidates than the mean number come with a probability below 1e-20.
        self._room = int(self._batch + 10.0 * math.sqrt(self._batch) + 50.0)
        self._disk: Any = ti.Vector.ndarray(BODY.width, real, n)
        self._before: Any = ti.Vector.ndarray(3, real, n)
        self._pair: Any = ti.Vector.ndarray(2, ti.i32, self._room)
        self._todo: Any = ti.ndarray(ti.i32, (2, self._room))
        self._hits: Any = ti.ndarray(ti.i32, (n,))
        self._hits_before: Any = ti.ndarray(ti.i32, (n,))
        self._first: Any = ti.ndarray(ti.i32, (n,))
        self._group: Any = ti.ndarray(ti.i32, (n,))
        self._language.from_numpy(self._group, self._species.astype(np.int32))
        kept = n if sheared else 1
        self._transfer: Any = ti.Vector.ndarray(4, ti.f64, kept)
        self._transfer_before: Any = ti.Vector.ndarray(4, ti.f64, kept)
        self._transfer.fill(0.0)
        self._summed = (0.0, np.zeros(4))  # time and sums of the transfer at the latest sample
        self._law: Any = ti.ndarray(real, table.shape)
        self._language.from_numpy(self._law, table.astype(self._real))
        self._hits.fill(0)
        body = Named(np.empty((n, BODY.width), dtype=self._real), BODY)
        body.vx, body.vy, body.spin = *start.velocity.T, start.spin
        body.inverse_mass, body.radius, body.k, body.material = (
            1.0 / disks.mass, disks.radius, disks.k, disks.material
        )  # fmt: skip
        self._language.from_numpy(self._disk, body.array)
        self._scale = np.zeros(SCALE.width, dtype=self._real)  # no velocity cut-off
        self._counter = np.zeros(DSMC_TABLES["counter"].width, dtype=np.int32)
        self._fastest = np.zeros(1, dtype=self._real)
        self._gains = np.zeros(n // kernels.BLOCK + 1)
        backend.register(self)

    def _launch(self, kernel: Any, *numbers: int, **given: Any) -> None:
        """Run a kernel: its first arguments are `numbers`, the others arrays, `given` or attributes of their names."""
        names = self._parameters_of(kernel)
        arrays = {
            name: given[name] if name in given else getattr(self, f"_{name}")
            for name in names[len(numbers) :]
        }
        kernel(*numbers, *arrays.values())

    def release(self) -> None:
        """Give all device memory back; the gas cannot be used any more."""
        names = "disk before pair todo hits hits_before first group transfer transfer_before law"
        for name in (f"_{each}" for each in names.split()):
            array = getattr(self, name)
            if array is not None:
                backend.free_array(array)
                setattr(self, name, None)

    def _record(self) -> NDArray[np.float64]:
        self._check_alive()
        return np.asarray(self._language.to_numpy(self._disk), dtype=np.float64)

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocities [length/time], shape (n, 2)."""
        self._check_valid()
        return self._record()[:, :2]

    @property
    def spin(self) -> NDArray[np.float64]:
        """Spins [rad/time], shape (n,)."""
        self._check_valid()
        return self._record()[:, 2]

    @property
    def collisions_of_disks(self) -> NDArray[np.int32]:
        """Collisions that each disk has had, shape (n,)."""
        return np.asarray(self._language.to_numpy(self._hits), dtype=np.int32)

    def checkpoint(self) -> Checkpoint:
        """The present state. Another gas of the same disks, law, seed and driving resumes it with the same bits."""
        self._check_valid()
        self._take_transfer()
        record = self._record()
        return Checkpoint(
            record[:, :2].copy(), record[:, 2].copy(), self.collisions_of_disks, self.time, self.energy_input,
            self._batches, self._kicks,
        )  # fmt: skip

    def resume(self, state: Checkpoint) -> None:
        """Resume from a checkpoint.

        Raises
        ------
        InputError
            If it has another number of disks.
        """
        if len(state.spin) != self.disks.n:
            raise InputError(
                f"the checkpoint has {len(state.spin)} disks, this gas {self.disks.n}: they must agree"
            )
        record = self._record()
        record[:, :2], record[:, 2] = state.velocity, state.spin
        self._language.from_numpy(self._disk, np.ascontiguousarray(record, dtype=self._real))
        self._language.from_numpy(self._hits, state.collisions_of_disks.astype(np.int32))
        self._set(
            collisions=int(np.sum(state.collisions_of_disks, dtype=np.int64)) // 2,
            time=state.time,
            energy_input=state.energy_input,
        )
        self._valid = True
        self._batches, self._kicks = state.batches, state.kicks
        self._transfer.fill(0.0)
        self._summed = (state.time, np.zeros(4))

    @validated
    def run(
        self,
        *,
        collisions_per_disk: NonNegative | None = None,
        t_end: NonNegative | None = None,
        samples: Samples = 50,
    ) -> Relaxation:
        """Run, and sample the present state and later ones at even steps.

        Parameters
        ----------
        collisions_per_disk : float
            End when each disk has had so many on average since the start. A sample is taken right after a batch that
            reached it, some collisions later: see `Relaxation.collisions_per_disk`.
        t_end : float
            End [time] instead, exactly. One of the two must be given.
        samples : int or array_like
            Number of samples after the present one; or the collisions per disk, or times, at which to take them, in
            increasing order, the last at most the end.

        Raises
        ------
        InputError
            If not exactly one end is given, or it lies in the past, or samples are not in order.
        NoMoreCollisions
            If nothing moves.
        """
        by_time = t_end is not None
        if by_time == (collisions_per_disk is not None):
            raise InputError("exactly one of t_end and collisions_per_disk must be given")
        end = float(t_end if t_end is not None else collisions_per_disk)  # type: ignore[arg-type]
        now = self.time if by_time else 2.0 * self.collisions / self.disks.n
        if not (math.isfinite(end) and end >= now):
            raise InputError(
                f"{'t_end' if by_time else 'collisions_per_disk'} = {end}: lies in the past ({now:.6g})"
            )
        if end == now > 0.0:
            warn_of_end(t_end=t_end, collisions_per_disk=collisions_per_disk)
        if isinstance(samples, int):
            marks = np.linspace(now, end, int(samples) + 1)[1:]
        else:
            marks = np.asarray(samples, dtype=np.float64)
            if marks.ndim != 1 or np.any(np.diff(marks, prepend=now) < 0.0) or np.any(marks > end):
                raise InputError(f"samples: must be numbers in increasing order from {now:.6g} to {end:.6g}")
        with backend.sole_use():
            found = [self._measure()]
            for mark in marks:
                if by_time:
                    while self.time < mark:
                        self._step(float(mark) - self.time)
                        if math.isclose(self.time, mark, rel_tol=1e-14):
                            self._set(time=float(mark))
                else:
                    while 2.0 * self.collisions < mark * self.disks.n:
                        self._step(math.inf, target=0.5 * mark * self.disks.n - self.collisions)
                found.append(self._measure())
        return Relaxation(**{name: np.array([one[name] for one in found]) for name in found[0]})

    def _step(self, longest: float, target: float = math.inf) -> None:
        """Advance the gas for `longest` [time] at most, and not for many more collisions than `target`."""
        self._check_valid()
        with backend.deferred_interrupts():  # Ctrl-C takes effect between batches
            self._valid = False
            self._batch_of(longest, target)
            self._valid = True

    def _batch_of(self, longest: float, target: float) -> None:
        rate = self._rate()
        # Of all candidates a third collides in a gas of equal disks, at most: larger batches are seldom needed. In a
        # flow it is a tenth.
        count = min(float(self._batch), max((10.0 if self.shear_rate else 3.0) * target, float(_LEAST)))
        duration = min(count / rate, longest)
        if not self.driving and not self.shear_rate:
            self._collide(duration, rate)
            return
        self._drive(0.5 * duration)
        self._strain(0.5 * duration)
        left = duration
        while left > 1e-12 * duration:
            rate = self._rate()
            left -= self._collide(min(left, self._batch / rate), rate)
        self._strain(0.5 * duration)  # in the other order: noise and flow do not commute
        self._drive(0.5 * duration)

    def _rate(self) -> float:
        """Candidates per time [1/time] that are enough for the present speeds; keeps the present state."""
        self._check_alive()
        self._launch(self._kernels.prepare)
        cap = MARGIN * math.sqrt(float(self._fastest[0]))
        if cap == 0.0:
            raise NoMoreCollisions(f"t = {self.time:.9g}: nothing moves; there will be no more collisions")
        if not math.isfinite(cap):
            raise EngineError(f"t = {self.time:.9g}: a velocity is not finite")
        contact_value = Named(self._contact_value, DSMC_TABLES["contact_value"])
        majorant = self._section * 2.0 * cap
        if self.shear_rate:  # any direction is drawn: pi g_ij sigma_ij g_n
            majorant = math.pi * self._section * (2.0 * cap + self._flow_apart)
        contact_value.majorant, contact_value.cap = majorant, cap**2
        n = self.disks.n
        # n (n - 1) / 2 pairs at 2 g_ij sigma_ij |g| / area
        return n * (n - 1) * majorant / self.area

    def _check_alive(self) -> None:
        backend.check_process()
        if self._disk is None:
            raise EngineError("this gas is invalid: the runtime was restarted with other settings")

    def _check_valid(self) -> None:
        self._check_alive()
        if not self._valid:
            raise EngineError(
                "a batch was interrupted half-way, so the state is lost: resume from a checkpoint, or start again"
            )

    def _collide(self, duration: float, rate: float) -> float:
        """Collide for a time [time], or until a disk is too fast for `rate`; return that time."""
        batch = self._batches
        self._batches += 1
        # The host's share of the random numbers of this batch: by counter too.
        bits = np.random.Philox(key=self._seed, counter=[0, 0, batch, 1])
        chance = np.random.Generator(bits)
        count = int(chance.poisson(rate * duration))
        if count > self._room:
            raise EngineError(f"t = {self.time:.9g}: {count} pairs drawn, with room for {self._room}")
        cut = self._resolve(count, batch)
        if cut < count:
            # Until then no disk was too fast, and all earlier candidates were resolved correctly.
            self._launch(self._kernels.restore)
            self._resolve(cut + 1, batch)
            # The candidate is the (cut + 1)th of `count` at uniform times.
            duration *= float(chance.beta(cut + 1, count - cut))
            self._set(cut_for_speed=self.cut_for_speed + 1)
            count = cut + 1
        self._set(
            collisions=self.collisions + int(Named(self._counter, DSMC_TABLES["counter"]).collisions),
            candidates=self.candidates + count,
            time=self.time + duration,
        )
        return duration

    def _resolve(self, count: int, batch: int) -> int:
        """Resolve the first candidates of a batch; return the first that made a disk too fast, or `kernels.NONE`."""
        kernels, counter, key = self._kernels, self._counter, self._key(batch)
        counter[:] = (count, 0, 0, kernels.NONE)
        if count:
            self._launch(kernels.draw, count, key=key)
        if self._alone:
            self._launch(kernels.resolve_pairs_serially, count, key=key)
            return int(Named(counter, DSMC_TABLES["counter"]).cut)
        now = 0
        while counter[now]:
            for _ in range(_ROUNDS):
                self._launch(kernels.resolve_pairs, now, key=key)
                now = 1 - now
        return int(Named(counter, DSMC_TABLES["counter"]).cut)

    def _key(self, number: int) -> NDArray[np.uint32]:
        low = 2**32 - 1
        return np.array([number & low, number >> 32, self._seed & low, self._seed >> 32], dtype=np.uint32)

    def _drive(self, duration: float) -> None:
        """Apply the driving for a time [time]: the exact solution of dv = -rate v dt + noise, and of the spins'."""
        for group, driving in enumerate(self.driving):

            def given(power: float, rate: float) -> float:
                """Energy that noise gives: power dt, less what friction takes of it meanwhile."""
                return power * (
                    -math.expm1(-2.0 * rate * duration) / (2.0 * rate) if rate > 0.0 else duration
                )

            factors = np.array([
                math.exp(-driving.rate * duration), math.exp(-driving.spin_rate * duration),
                given(driving.power, driving.rate), given(driving.spin_power, driving.spin_rate), 0.0,
            ])  # fmt: skip
            self._launch(self._kernels.kick, group, key=self._key(self._kicks), factors=factors)
            self._set(energy_input=self.energy_input + math.fsum(self._gains))
        self._kicks += len(self.driving) > 0

    def _strain(self, duration: float) -> None:
        """Apply the flow for a time [time]: dv_x = -shear_rate v_y dt of velocities relative to it."""
        if self.shear_rate:
            factors = np.array([1.0, 1.0, 0.0, 0.0, self.shear_rate * duration])
            self._launch(self._kernels.strain, factors=factors)
            self._set(energy_input=self.energy_input + math.fsum(self._gains))

    def _take_transfer(self) -> NDArray[np.float64]:
        """Mean collisional stress since the call before, shape (2, 2); its work counts as energy put in from now on."""
        if not self.shear_rate:
            return np.full((2, 2), np.nan)
        (before, taken), now = self._summed, np.asarray(self._language.to_numpy(self._transfer)).sum(axis=0)
        self._summed = self.time, now
        self._set(energy_input=self.energy_input - self.shear_rate * float(now[1] - taken[1]))
        if self.time == before:
            return np.full((2, 2), np.nan)
        return np.asarray((now - taken).reshape(2, 2) / (self.area * (self.time - before)))

    def _measure(self) -> dict[str, Any]:
        record, collisional = self._record(), self._take_transfer()
        found = sample(self.disks, record[:, :2], record[:, 2], self.collisions_of_disks, self._species)
        return found | {
            "time": self.time,
            "energy_input": self.energy_input,
            "kinetic_stress": found["kinetic_stress"] / self.area,
            "collisional_stress": collisional,
        }
