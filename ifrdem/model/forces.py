"""Forces between collisions: drives, drag, and what users write themselves.

A force acts on every disk at the middle of each of its steps, at the times (k + 1/2) step counted from time 0. Between
these times disks fly freely and collide exactly. This splitting is symmetric in time, so that what a run shows at
multiples of the step is off by the square of the step (and between them, where the force of up to half a step is still
missing or early, by the step itself). Such a force takes its `step` first, the time between two applications [time].

A force at random times acts on each disk independently, as a Poisson process (`PoissonForce`). It takes its `rate`
first.

The module imports Taichi: `act` and `measure` are compiled to run on the device.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from ..errors import InputError
from ..kernels.compiler.language import ti
from ..kernels.forces.table_friction import advance, step_tolerance
from ..kernels.random import normals, uniforms
from ..tools import checked
from ..tools.checked import NonNegative, Positive, validated
from ..tools.read_only import ReadOnlyAttributes
from .custom_code import declared_names, named_numbers
from .gravity import EARTH
from .state import Disks

__all__ = [
    "Drag", "Force", "Langevin", "PoissonForce", "PoissonKicks", "PoissonSpinKicks", "RandomKicks", "Rescale",
    "SpinKicks", "TableFriction", "normals", "uniforms",
]  # fmt: skip

OF_DISK = ("x", "y", "vx", "vy", "spin", "mass", "radius", "k", "inertia", "id", "species", "material")
OF_STEP = ("time", "dt", "free", "random")
"""Names of what a force gets of a disk and of a step; in `act` a step has totals too, if the force has some."""


class _Parameter:
    """A parameter of a force as an attribute, which can be assigned between runs."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, force: Force | None, _kind: type[Force]) -> Any:
        return self if force is None else force._values[self._name]

    def __set__(self, force: Force, value: float) -> None:
        force._values[self._name] = number(self._name, value, negative=True)


class Force(ReadOnlyAttributes):
    """A force on every disk; subclasses say in `act` what it does to one of them during a step.

    InputError if the step is not a positive finite number, or a parameter is missing, unknown or not finite.

    Parameters
    ----------
    step : float
        Time between two applications [time].
    **values : float
        A finite number for each of the names in `parameters`. Attributes of these names can be assigned between runs:
        the numbers are not compiled in. Of other attributes, only those can be assigned that the class declares, or
        sets in its `__init__`.

    Attributes
    ----------
    parameters : tuple of str
        Names of the numbers that `act` and `measure` get.
    constants : tuple of str
        Names of further numbers that `act` and `measure` get with the parameters: those of `derived`, which follow from
        the parameters and the step, and are computed once instead of for each disk.
    totals : int
        How many sums over all disks `act` needs; `measure` gives each disk's share of them.
    totals_ahead : bool
        True if `measure` reads of the disk no position, velocity or spin, and of the step only `random`, so that totals
        do not depend on the motion. A force with this, or without totals, acts within windows, which is much faster.
    draws_pair : bool
        True if `act` takes `step.pair`, the numbers of `normals(step.random, 0)`, which are drawn faster for all disks
        at once.
    keeps_rest : bool
        True if a disk that neither moves nor spins stays so, whatever the others do. Once all are at rest, a run then
        goes to its end without further steps.
    keeps_momentum : bool
        True if the force changes the total momentum by no more than rounding. Where all forces do, temperatures are
        about the mean velocity of a gas that can drift (`observables.Measure`); a force that does not, such as a drag,
        has a frame of its own, in which temperatures are measured.
    galilean_invariant : bool
        True if the force is the same in all frames that move at constant velocity, such as kicks that do not depend on
        the velocity. Temperatures are then about the mean velocity, too, although the force may change it.

    Notes
    -----
    `act` and `measure` are static methods in the language of Taichi's functions (decorated by `ti.func` or not), in a
    file. A force changes velocities and spins only. It should do exactly, or to second order in dt at least, what it
    would do to a disk during dt if nothing else happened. A thermostat must scale velocities about the mean velocity
    where the gas can drift (`step.free`), as `Rescale` does. Random numbers must come from `normals(step.random,
    number)` or `uniforms(step.random, number)`, pairs of them, one pair for each number 0 to 65535: they depend on the
    seed, the disk, the step and the position of the force in the list, and on nothing else.

    Variables from outside, such as module globals, are compiled in as constants: InputError from a later simulation or
    run if they have changed.

    Examples
    --------
    >>> import ifrdem
    >>> class Uniform(ifrdem.forces.Force):
    ...     parameters = ("acceleration",)
    ...     @staticmethod
    ...     def act(disk, step, p):
    ...         return disk.vx + p.acceleration * step.dt, disk.vy, disk.spin
    ...
    >>> force = Uniform(step=0.05, acceleration=0.3)
    >>> force.acceleration = 0.4
    >>> force.values
    {'acceleration': 0.4}
    """

    parameters: ClassVar[tuple[str, ...]] = ()
    constants: ClassVar[tuple[str, ...]] = ()
    totals: ClassVar[int] = 0
    totals_ahead: ClassVar[bool] = False
    draws_pair: ClassVar[bool] = False
    keeps_rest: ClassVar[bool] = False
    galilean_invariant: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        checked.integer(f"{cls.__name__}: totals", cls.totals, 0, 1000)
        for name in cls.__dict__.get("parameters", ()):
            if not isinstance(name, str) or not name.isidentifier() or hasattr(Force, name):
                raise InputError(
                    f"{cls.__name__}: parameters = {cls.parameters!r}: must be names that a force has not already"
                )
            setattr(cls, name, _Parameter(name))
        cls.assignable = declared_names(cls, Force)

    @property
    def keeps_momentum(self) -> bool:
        """False unless a class says otherwise."""
        return False

    @validated
    def __init__(self, step: Positive, **values: float) -> None:
        self._step = number("step", step, positive=True)
        self._values: dict[str, float] = named_numbers(
            type(self).__name__, "parameter", self.parameters, values
        )

    def __repr__(self) -> str:
        values = "".join(f", {name} {value:g}" for name, value in self._values.items())
        return f"<{type(self).__name__}: step {self._step:g}{values}>"

    @property
    def step(self) -> float:
        """Time between two applications [time]."""
        return self._step

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return self._values.copy()

    def derived(self) -> tuple[float, ...]:
        """The numbers of `constants`, from the present parameters."""
        return ()

    @property
    def hottest(self) -> float:
        """Largest temperature that a thermostat sets [energy]; 0 for other forces."""
        return 0.0

    def check(self, disks: Disks) -> None:
        """Raise InputError if the force cannot act on these disks."""

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        """The new (vx, vy, spin) of one disk after the force has acted on it for `step.dt`.

        Parameters
        ----------
        disk : struct
            x, y [length] in the box; vx, vy [length/time]; spin [rad/time]; mass, radius, k,
            inertia = mass radius^2 / k; id, species and material, whole numbers from 0 on. Species are counted in the
            order of `Disks.species`; without named ones it is 0.
        step : struct
            time of the step's middle, dt its length [time]; random, for `normals` and `uniforms`; totals, a vector, and
            share, what `measure` gave of this disk; pair, with `draws_pair`; free, a vector: 1 for x and y where the
            whole gas can drift, because no walls hold it, else 0.
        p : struct
            The force's parameters and constants, by name.
        """
        # Abstract: `Setup` refuses a force without its own, by name, before anything is compiled.
        raise NotImplementedError

    @staticmethod
    def measure(disk: Any, step: Any, p: Any) -> Any:
        """Share of one disk in the `totals`, a vector of so many entries; called before `act`, with its arguments."""
        # Abstract for forces with totals, of which `ForceSteps` refuses those without their own; others need none.
        raise NotImplementedError


class RandomKicks(Force):
    r"""White-noise heating: independent Gaussian kicks that leave the total momentum as it is.

    A disk's velocity gets random kicks with <dv_x^2> = <dv_y^2> = 2 D dt, D = power / (2 m), of which the mean of all,
    weighted by mass, is subtracted in each step. A factor sqrt(N/(N-1)) makes up for the energy that this takes: the N
    disks get N power dt on average, whatever their masses. Williams and MacKintosh (1996),
    doi:10.1103/PhysRevE.54.R9; van Noije and Ernst, Granul. Matter 1, 57 (1998), whose xi_0^2 is 2 D.

    Parameters
    ----------
    power : float
        Energy that each disk gets per time, on average [energy/time].
    diffusion : float
        Instead of it, D [length^2/time^3], the same for all masses (then right to a part in N for unequal masses).

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.RandomKicks(step=0.05, power=0.1).values
    {'power': 0.1, 'diffusion': 0.0}
    """

    parameters = ("power", "diffusion")
    totals = 4
    totals_ahead = True
    keeps_momentum = True

    @validated
    def __init__(self, step: Positive, *, power: float | None = None, diffusion: float | None = None) -> None:
        super().__init__(step, **_strength(self, power, diffusion))

    @staticmethod
    def measure(disk: Any, step: Any, p: Any) -> Any:
        kick = _velocity_kick(disk, step, p)
        return ti.Vector([disk.mass * kick[0], disk.mass * kick[1], disk.mass, 1.0])

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        n = step.totals[3]
        scale = ti.sqrt(n / (n - 1.0))
        vx = disk.vx + scale * (step.share[0] / disk.mass - step.totals[0] / step.totals[2])
        vy = disk.vy + scale * (step.share[1] / disk.mass - step.totals[1] / step.totals[2])
        return vx, vy, disk.spin


class SpinKicks(Force):
    """White-noise heating of the spins: independent Gaussian kicks with <d omega^2> = 2 D dt, D = power / I.

    Cafiero, Luding and Herrmann, Europhys. Lett. 60, 854 (2002).

    Parameters
    ----------
    power : float
        Energy that each disk gets per time, on average [energy/time].
    diffusion : float
        Instead of it, D [rad^2/time^3], the same for all disks.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.SpinKicks(step=0.05, power=0.1).values
    {'power': 0.1, 'diffusion': 0.0}
    """

    parameters = ("power", "diffusion")
    keeps_momentum = True
    draws_pair = True

    @validated
    def __init__(self, step: Positive, *, power: float | None = None, diffusion: float | None = None) -> None:
        super().__init__(step, **_strength(self, power, diffusion))

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        return disk.vx, disk.vy, disk.spin + _spin_spread(disk, step, p) * step.pair[0]


class PoissonForce(Force):
    """A force that acts on each disk independently, at random times: a Poisson process of each disk, exact in time.

    Subclasses define in `act` what it does to the disk each time. There `step.dt` is the mean time between two actions
    on a disk, 1 / rate, and `step.time` the time of the action. Times and random numbers depend only on the seed, the
    disk, and the position of the force in the list.

    InputError if the rate is not a positive finite number, or the class has totals.

    Parameters
    ----------
    rate : float
        Mean number of actions on a disk per time [1/time].
    **values : float
        The parameters, as of `Force`.

    Examples
    --------
    Andersen's thermostat, J. Chem. Phys. 72, 2384 (1980): a disk forgets its velocity.

    >>> import ifrdem
    >>> from ifrdem import ti
    >>> class Andersen(ifrdem.forces.PoissonForce):
    ...     parameters = ("temperature",)
    ...     @staticmethod
    ...     def act(disk, step, p):
    ...         v = ti.sqrt(p.temperature / disk.mass) * ifrdem.forces.normals(step.random, 0)
    ...         return v[0], v[1], disk.spin
    ...
    >>> Andersen(rate=2.0, temperature=1.0)
    <Andersen: rate 2, temperature 1>
    """

    @validated
    def __init__(self, rate: Positive, **values: float) -> None:
        if self.totals:
            raise InputError(
                f"{type(self).__name__}: totals = {self.totals}: must be 0 for a force at random times"
            )
        super().__init__(1.0 / number("rate", rate, positive=True), **values)

    @property
    def rate(self) -> float:
        """Mean number of actions on a disk per time [1/time]."""
        return 1.0 / self.step

    def __repr__(self) -> str:
        values = "".join(f", {name} {value:g}" for name, value in self._values.items())
        return f"<{type(self).__name__}: rate {self.rate:g}{values}>"


class PoissonKicks(PoissonForce):
    r"""Kicks at random times: each disk gets Gaussian kicks at a `rate`, with <dv_x^2> = <dv_y^2> = 2 D / rate.

    D = power / (2 m), as in `RandomKicks`: for any rate the mean energy of a free disk grows by `power` per time. The
    sum of the kicks in a time t is white noise except for cumulants of fourth and higher order, which vanish at high
    rates: the excess kurtosis of v_x of a free disk is 3 / (rate t). `theory.heated_sonine` gives the difference from
    white noise in the steady state of a gas, with the mean energy of a kick over T, power / (rate T).

    A kick changes the total momentum. The drift energy of the whole gas grows by `power` per time, as that of one disk
    does. Temperatures are about the mean velocity.

    Parameters
    ----------
    rate : float
        Mean number of kicks of a disk per time [1/time].
    power : float
        Energy that each disk gets per time, on average [energy/time].
    diffusion : float
        Instead of power: D [length^2/time^3], the same for all masses.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.PoissonKicks(rate=20.0, power=0.1)
    <PoissonKicks: rate 20, power 0.1, diffusion 0>
    """

    parameters = ("power", "diffusion")
    galilean_invariant = True

    @validated
    def __init__(self, rate: Positive, *, power: float | None = None, diffusion: float | None = None) -> None:
        super().__init__(rate, **_strength(self, power, diffusion))

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        kick = _velocity_kick(disk, step, p)
        return disk.vx + kick[0], disk.vy + kick[1], disk.spin


class PoissonSpinKicks(PoissonForce):
    """Kicks of spins at random times: each disk gets Gaussian kicks at a `rate`, with <d omega^2> = 2 D / rate.

    D = power / I, as in `SpinKicks`.

    Parameters
    ----------
    rate : float
        Mean number of kicks of a disk per time [1/time].
    power : float
        Energy that each disk gets per time, on average [energy/time].
    diffusion : float
        Instead of power: D [rad^2/time^3], the same for all disks.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.PoissonSpinKicks(rate=20.0, power=0.1)
    <PoissonSpinKicks: rate 20, power 0.1, diffusion 0>
    """

    parameters = ("power", "diffusion")
    keeps_momentum = True

    @validated
    def __init__(self, rate: Positive, *, power: float | None = None, diffusion: float | None = None) -> None:
        super().__init__(rate, **_strength(self, power, diffusion))

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        return disk.vx, disk.vy, disk.spin + _spin_spread(disk, step, p) * normals(step.random, 0)[0]


class Langevin(Force):
    """A heat bath: friction and noise that bring every disk to a temperature, dv = -rate v dt + noise.

    The exact solution over a step, an Ornstein-Uhlenbeck process: v exp(-rate dt) plus a Gaussian of variance
    (T/m) (1 - exp(-2 rate dt)) per component; for a spin T_spin/I. Uhlenbeck and Ornstein (1930),
    doi:10.1103/PhysRev.36.823. The total momentum is not kept.

    Parameters
    ----------
    temperature, spin_temperature : float
        Of the bath for velocities and for spins, where it differs [energy], 0 or more.
    rate, spin_rate : float
        Friction rates of velocities and spins [1/time]; 0, the default, leaves them alone.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.Langevin(step=0.05, temperature=1.0, rate=0.2).values
    {'temperature': 1.0, 'rate': 0.2, 'spin_temperature': 1.0, 'spin_rate': 0.0}
    """

    parameters = ("temperature", "rate", "spin_temperature", "spin_rate")
    constants = ("left", "heat", "spin_left", "spin_heat")
    draws_pair = True

    @validated
    def __init__(
        self,
        step: Positive,
        *,
        temperature: NonNegative,
        rate: NonNegative = 0.0,
        spin_temperature: float | None = None,
        spin_rate: NonNegative = 0.0,
    ) -> None:
        _some(rate=rate, spin_rate=spin_rate)
        of_spins = temperature if spin_temperature is None else spin_temperature
        values = (temperature, rate, of_spins, spin_rate)
        given = zip(self.parameters, values, strict=True)
        super().__init__(step, **{name: number(name, value) for name, value in given})

    def derived(self) -> tuple[float, ...]:
        """Factors of velocities and spins, and what noise adds to m <v_x^2> and I <omega^2> [energy], in a step."""
        temperature, rate, spin_temperature, spin_rate = self._values.values()
        heats = (
            -T * math.expm1(-2.0 * r * self.step)
            for T, r in ((temperature, rate), (spin_temperature, spin_rate))
        )
        heat, spin_heat = heats
        return math.exp(-rate * self.step), heat, math.exp(-spin_rate * self.step), spin_heat

    @property
    def hottest(self) -> float:
        """The larger of its temperatures [energy]."""
        return max(self._values["temperature"], self._values["spin_temperature"])

    @property
    def keeps_momentum(self) -> bool:
        """True if it acts on spins only."""
        return self._values["rate"] == 0.0

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        vx, vy, spin = disk.vx, disk.vy, disk.spin
        if p.rate > 0.0:
            spread = ti.sqrt(p.heat / disk.mass)
            kick = step.pair
            vx, vy = p.left * vx + spread * kick[0], p.left * vy + spread * kick[1]
        if p.spin_rate > 0.0:
            spin = p.spin_left * spin + ti.sqrt(p.spin_heat / disk.inertia) * normals(step.random, 1)[0]
        return vx, vy, spin


class Drag(Force):
    r"""Friction with a medium at rest: dv/dt = -rate v - quadratic |v| v, d omega/dt = -spin_rate omega.

    The exact solution over a step: with tau = (1 - exp(-rate dt)) / rate, or dt for rate 0, velocities are multiplied
    by exp(-rate dt) / (1 + quadratic |v| tau).

    Parameters
    ----------
    rate, spin_rate : float
        Of linear drag of velocities, as by a viscous gas, and of spins [1/time].
    quadratic : float
        Quadratic drag over mass [1/length], as by a fast flow.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.Drag(step=0.05, rate=0.2).values
    {'rate': 0.2, 'quadratic': 0.0, 'spin_rate': 0.0}
    """

    parameters = ("rate", "quadratic", "spin_rate")
    constants = ("left", "tau", "spin_left")
    keeps_rest = True

    @validated
    def __init__(
        self,
        step: Positive,
        *,
        rate: NonNegative = 0.0,
        quadratic: NonNegative = 0.0,
        spin_rate: NonNegative = 0.0,
    ) -> None:
        given = {"rate": rate, "quadratic": quadratic, "spin_rate": spin_rate}
        _some(**given)
        super().__init__(step, **{name: number(name, value) for name, value in given.items()})

    @property
    def keeps_momentum(self) -> bool:
        """True if it acts on spins only."""
        return self._values["rate"] == self._values["quadratic"] == 0.0

    def derived(self) -> tuple[float, ...]:
        """exp(-rate dt), tau, exp(-spin_rate dt)."""
        rate, _quadratic, spin_rate = self._values.values()
        tau = -math.expm1(-rate * self.step) / rate if rate > 0.0 else self.step
        return math.exp(-rate * self.step), tau, math.exp(-spin_rate * self.step)

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        factor = p.left
        if p.quadratic > 0.0:
            factor = factor / (1.0 + p.quadratic * ti.sqrt(disk.vx * disk.vx + disk.vy * disk.vy) * p.tau)
        return factor * disk.vx, factor * disk.vy, p.spin_left * disk.spin


class TableFriction(Force):
    """Disks that lie on a table: Coulomb friction spread evenly over their faces, of velocity and spin together.

    The exact solution over a step of dv/dt = -mu g F(eps), d(R omega)/dt = -k mu g T(eps) with eps = v/(R |omega|)
    (`kernels/forces/table_friction.py`; Farkas et al. 2003, doi:10.1103/PhysRevLett.90.248302): rotation reduces the
    braking, and both motions stop together, after a finite time. A disk at rest stays there exactly, and when all are,
    the run goes to its end without further steps.

    Parameters
    ----------
    step : float
        Time between two applications [time]; a small part of the time v / (mu g) to stop.
    mu : float
        Coefficient of sliding friction on the table.
    gravity : float
        Acceleration g by which disks press on the table [length/time^2]; default: the Earth's, in SI units.

    Notes
    -----
    Velocities and spins of disks that do not collide are exact at multiples of the step, distances of second order in
    it: a stopping distance is off by mu g step^2 / 8 at most. A disk that collides does so with a velocity that is off
    by up to mu g step / 2, early or late in the step by turns: a single collision errs by the step itself, and the mean
    over many by its square.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.TableFriction(step=1e-3, mu=0.2, gravity=10.0).values
    {'deceleration': 2.0}
    """

    parameters = ("deceleration",)
    keeps_rest = True

    @validated
    def __init__(self, step: Positive, *, mu: Positive, gravity: Positive = EARTH) -> None:
        deceleration = number("mu", mu, positive=True) * number("gravity", gravity, positive=True)
        super().__init__(step, deceleration=deceleration)

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        speed = ti.sqrt(disk.vx * disk.vx + disk.vy * disk.vy)
        new = advance(
            speed, disk.radius * disk.spin, disk.k, p.deceleration, step.dt, ti.static(step_tolerance())
        )
        left = 0.0 * speed
        if speed > 0.0:
            left = new.v / speed
        return left * disk.vx, left * disk.vy, new.u / disk.radius


class Rescale(Force):
    """A thermostat that multiplies all velocities by one factor, so that the gas has the same energy after each step.

    A gas that loses its energy in collisions reaches the scaled state of free cooling this way: rescaling is free
    cooling in another unit of time (Brey, Ruiz-Montero and Moreno 2004, doi:10.1103/PhysRevE.69.051303).

    Where the whole gas can drift (`step.free`: along directions without walls, whatever other forces act), velocities
    are those about the mean velocity u = sum m v / sum m, v -> u + f (v - u), and the total momentum stays the same to
    rounding. A factor on u too would let rounding errors of the total momentum grow exponentially, until all energy is
    in a drift and the gas in it is frozen (the "flying ice cube": Harvey, Tan and Cheatham, J. Comput. Chem. 19, 726
    (1998)). Between walls, which take up momentum, velocities are those in the lab. Disks that all have one velocity
    keep it.

    Parameters
    ----------
    temperature : float
        Translational temperature after each, the mean over disks of m (v - u)^2 / 2 [energy]; spins are left alone.
    energy : float
        Instead of it, the mean over disks of m (v - u)^2 / 2 + I omega^2 / 2 after each [energy]; spins are multiplied
        too.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.forces.Rescale(step=0.05, temperature=1.0).values
    {'target': 1.0, 'with_spins': 0.0}
    """

    parameters = ("target", "with_spins")
    totals = 6
    keeps_rest = True
    keeps_momentum = True  # where the gas can drift

    @validated
    def __init__(
        self, step: Positive, *, temperature: float | None = None, energy: float | None = None
    ) -> None:
        if (temperature is None) == (energy is None):
            raise InputError("rescale: exactly one of temperature and energy must be given")
        name, value = ("temperature", temperature) if energy is None else ("energy", energy)
        target = number(name, value, positive=True)
        super().__init__(step, target=target, with_spins=0.0 if energy is None else 1.0)

    @property
    def hottest(self) -> float:
        """Its temperature, or mean energy of a disk [energy]."""
        return self._values["target"]

    # In double precision whatever the run computes in: the energy of a drift is subtracted.
    @staticmethod
    def measure(disk: Any, step: Any, p: Any) -> Any:
        vx, vy, spin = ti.cast(disk.vx, ti.f64), ti.cast(disk.vy, ti.f64), ti.cast(disk.spin, ti.f64)
        mass, inertia = ti.cast(disk.mass, ti.f64), ti.cast(disk.inertia, ti.f64)
        return ti.Vector([
            0.5 * mass * (vx * vx + vy * vy), 0.5 * inertia * spin * spin, ti.cast(1.0, ti.f64),
            mass * vx, mass * vy, mass,
        ])  # fmt: skip

    @staticmethod
    def act(disk: Any, step: Any, p: Any) -> tuple[Any, Any, Any]:
        mean_x = step.free[0] * step.totals[3] / step.totals[5]
        mean_y = step.free[1] * step.totals[4] / step.totals[5]
        drift = 0.5 * (step.totals[3] * mean_x + step.totals[4] * mean_y) / step.totals[2]
        present = (step.totals[0] + p.with_spins * step.totals[1]) / step.totals[2] - drift
        factor = ti.cast(1.0, ti.f64)
        if drift + present / 64.0 > drift:  # more than rounding of the drift's energy
            factor = ti.sqrt(p.target / present)
        spin_factor = ti.cast(1.0, ti.f64)
        if p.with_spins > 0.0:
            spin_factor = factor
        vx, vy = mean_x + factor * (disk.vx - mean_x), mean_y + factor * (disk.vy - mean_y)
        return vx, vy, spin_factor * disk.spin


@ti.func
def _velocity_kick(disk, step, p):
    """Independent kick of one disk, before the mean of all is taken off."""
    spread = ti.sqrt((p.power / disk.mass + 2.0 * p.diffusion) * step.dt)
    pair = normals(step.random, 0)
    # On a GPU, products of numbers are rounded by themselves, those of vectors are not.
    return ti.Vector([spread * pair[0], spread * pair[1]])


@ti.func
def _spin_spread(disk, step, p):
    """Spread of kicks of a spin, of energy I d omega^2 / 2: one degree of freedom, so that D = power / I."""
    return ti.sqrt(2.0 * (p.power / disk.inertia + p.diffusion) * step.dt)


def number(name: str, value: float | None, *, positive: bool = False, negative: bool = False) -> float:
    """The value as a float; InputError unless it is a finite number, by default 0 or more."""
    check = checked.POSITIVE if positive else checked.FINITE if negative else checked.NON_NEGATIVE
    return check(name, value)


def _strength(kicks: object, power: float | None, diffusion: float | None) -> dict[str, float]:
    """Parameters of kicks, of which one is 0."""
    if (power is None) == (diffusion is None):
        given = "none" if power is None else "both"
        raise InputError(
            f"{type(kicks).__name__}: must have exactly one of power and diffusion; given: {given}"
        )
    if power is not None:
        return {"power": number("power", power, positive=True), "diffusion": 0.0}
    return {"power": 0.0, "diffusion": number("diffusion", diffusion, positive=True)}


def _some(**given: float) -> None:
    """Raise InputError unless one of the numbers is not 0."""
    if not any(given.values()):
        raise InputError(f"{', '.join(given)}: one of them must be above 0")
