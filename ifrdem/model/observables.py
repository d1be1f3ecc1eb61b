"""Observables of a gas at one time: energies, temperatures, momentum, collisions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..kernels.columns import READOUT, SPECIES, Named
from ..mpi import SERIAL, collective, current
from ..mpi.distribution import RowsByBlock
from ..quantities import MECHANISMS, REGIMES
from ..tools.checked import Array, Integer, Numbers, Positive, Real, validated
from .state import Disks, State

TANGENTIAL = ("tangential_restitution", "sliding", "sticking")
"""Those of the tangential impulse. By convention restitution acts first. So each may be negative; their sum is not, if
no tangential impulse adds energy."""


@dataclass(frozen=True, eq=False)
class Measure:
    """Totals and averages of a gas at one time.

    Attributes
    ----------
    time, collisions, wall_collisions : float, int, int
        The time [time]; collisions between two disks so far, each once; collisions with walls.
    translational_energy, rotational_energy : float
        Sums of m v^2 / 2 and of I w^2 / 2 [energy].
    temperature, rotational_temperature : float
        T = <m v^2> / 2, the energy of two degrees of freedom at T / 2 each, and T_rot = <I w^2>, of one [energy].
        Averages are over the disks that can move; 0 without disks. v is about the mean velocity where the whole gas can
        drift (see below).
    momentum : array (2,)
        Sum of m v [mass length/time].
    drift_energy : float
        Part of `translational_energy` that is that of the mean velocity, and not in the temperature [energy].
    energy_input, wall_work, wall_heat : float
        Energy since the start that forces and a mean flow have put in, less what they took out, that moving walls have
        given as work, and thermal walls as heat [energy].
    potential_energy : float
        Sum of -m g.x, g the gravity: 0 at the box's lower left corner [energy].
    asleep : int
        Disks that sleep.
    dissipated : array (7,) or None
        Energy that collisions have taken since the start, by mechanism (`quantities.MECHANISMS`) [energy]; None without
        a ledger.
    regimes : array (5,) or None
        Collisions of two disks since the start, by regime (`quantities.REGIMES`).
    walls : array (W, 6) or None
        Sums of each wall, the sides of the box last (`WallSums`); None unless they are requested.
    pistons : array (P, 4) or None
        Displacement, velocity, energy and force of each piston (`Simulation.pistons`); None without pistons.
    momentum_flux : array (2, 2)
        Kinetic part of the pressure tensor times the area: the sum of m v_a v_b, v as in the temperature [energy].
    regions : array (regions, 3) or None
        Number, mass and kinetic energy of the movable disks whose centres are in each of `Simulation.regions`; None
        without any [1, mass, energy].
    center_of_mass : array (2,) or None
        Of the movable disks, by their places inside the box [length]; None without walls and sides.
    species_temperature, species_rotational_temperature : array (s,) or None
        Temperatures of each species, about the same mean velocity as that of all, so that their mean over disks is the
        temperature of all [energy]; None where `Disks` has no species.
    species_collisions : array (s,) or None
        Collisions with disks that the disks of each species have had, each counted at each of its disks.
    energy_flux : array (2,)
        Kinetic part of the heat flux times the area: the sum of (m v^2 + I w^2) v_b / 2, v as in the temperature
        [energy length/time].
    mean_velocity : array (2,)
        The velocity that temperatures are about [length/time].
    virial : array (2, 2) or None
        Collisional part of the pressure tensor times the area, integrated over time since the start: the sum of
        (dp_i)_a (r_i - r_j)_b over collisions [energy time]. None unless recorded ("stress"). See `stress`.
    energy_transfer : array (2,) or None
        The same of energy in the lab: the sum of de_i (r_i - r_c)_b over both disks of collisions, r_c the contact
        [energy length]. None unless recorded ("heat_flux"). See `heat_flux`.
    histograms : array (pairs, bins) or None
        Counts of collisions since the start, of each pair of species: of all histograms, one after another. None unless
        recorded ("histograms"). See `histogram`.

    Notes
    -----
    Temperatures are about the mean velocity u = sum m v / sum m in each direction in which nothing changes the total
    momentum, so that they are the same for a gas that moves as a whole: N T = sum m v^2 / 2 - |P|^2 / (2 M), the last
    term being `drift_energy`; T of a single disk is 0. These are directions without walls (smooth walls along them do
    not count) in gases without immovable disks, whose forces all keep the momentum or are `Force.galilean_invariant`.
    Everywhere else walls, or the medium of a drag or heat bath, are at rest, and so velocities are those in the lab. N
    is the number of disks, as in starts (`initial.maxwellian`). Velocities about their mean have 2 (N - 1) degrees of
    freedom, of which each has T N / (N - 1) / 2 in equilibrium.

    In a sheared box velocities are peculiar ones, relative to the mean flow (`State.flow`).
    """

    time: float
    collisions: int
    translational_energy: float
    rotational_energy: float
    temperature: float
    rotational_temperature: float
    momentum: Array
    momentum_flux: Array
    energy_flux: Array = field(default_factory=lambda: np.zeros(2))
    mean_velocity: Array = field(default_factory=lambda: np.zeros(2))
    energy_input: float = 0.0
    wall_work: float = 0.0
    wall_heat: float = 0.0
    potential_energy: float = 0.0
    wall_collisions: int = 0
    asleep: int = 0
    drift_energy: float = 0.0
    dissipated: Array | None = None
    regimes: NDArray[np.int64] | None = None
    walls: Array | None = None
    pistons: Array | None = None
    virial: Array | None = None
    energy_transfer: Array | None = None
    histograms: NDArray[np.int64] | None = None
    regions: Array | None = None
    center_of_mass: Array | None = None
    species_temperature: Array | None = None
    species_rotational_temperature: Array | None = None
    species_collisions: NDArray[np.int64] | None = None

    @property
    def theta(self) -> float:
        """Ratio of the rotational to the translational temperature; nan at rest."""
        return self.rotational_temperature / self.temperature if self.temperature else math.nan

    @property
    def unspent(self) -> float:
        """Energy that is there less all that was put in: it falls by what collisions dissipate [energy]."""
        return self.energy + self.potential_energy - (self.energy_input + self.wall_work + self.wall_heat)

    @property
    def energy(self) -> float:
        """Kinetic energy, translational and rotational [energy]."""
        return self.translational_energy + self.rotational_energy


@validated
def drift_text(velocity: Annotated[ArrayLike, Numbers((2,))]) -> str:
    """Text of a mean velocity; a component that is only rounding is shown as 0.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.observables.drift_text([20.0, 1e-17])
    '(20, 0)'
    """
    x, y = np.where(np.abs(velocity) > 1e-6 * np.max(np.abs(velocity)), velocity, 0.0).tolist()
    return f"({x:.4g}, {y:.4g})"


@validated
def measure(
    disks: Disks,
    state: State,
    *,
    energy_input: Real = 0.0,
    wall_work: Real = 0.0,
    wall_heat: Real = 0.0,
    gravity: tuple[Real, Real] = (0.0, 0.0),
    dissipated: Annotated[ArrayLike, Numbers((len(MECHANISMS),))] | None = None,
    regimes: Annotated[ArrayLike, Numbers((len(REGIMES),), low=0.0, each="0 or more")] | None = None,
    about_mean: tuple[bool, bool] = (True, True),
) -> Measure:
    """Measure a gas; energy put in before [energy] and gravity [length/time^2] are not part of a state.

    `about_mean` is True for x and y if temperatures along them are about the mean velocity. It is not used if disks are
    immovable, and must be False where walls stop the gas (`Measure`). InputError if the disks and the state differ in
    their number.

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(2, mass=2.0, radius=0.5)
    >>> state = ifrdem.State([[1.0, 1.0], [3.0, 1.0]], [[1.0, 0.0], [-1.0, 0.0]], [0.0, 0.0])
    >>> ifrdem.observables.measure(disks, state).temperature
    1.0
    """
    with SERIAL:
        totals = sums(disks, state, gravity)
        of_species = species_sums(disks, state) if disks.species else None
    energy_terms: Any = {"energy_input": energy_input, "wall_work": wall_work, "wall_heat": wall_heat}
    counted: Any = {"dissipated": dissipated, "regimes": regimes}
    wall_collisions = int(np.sum(state.wall_collisions, dtype=np.int64))
    return measure_of_totals(
        disks, totals, float(state.time), wall_collisions, about_mean=about_mean, species=of_species,
        **energy_terms, **counted,
    )  # fmt: skip


def species_sums(disks: Disks, state: State) -> Array:
    """Sums over the disks of each species that `from_totals` takes, shape (species, columns of SPECIES)."""
    numbers = np.array(list(disks.species.values()), dtype=np.int64)
    movable = disks.movable
    mass, inertia = np.where(movable, disks.mass, 0.0), np.where(movable, disks.inertia, 0.0)
    v = state.peculiar_velocity
    columns = [
        0.5 * mass * np.sum(v**2, axis=1), 0.5 * inertia * state.spin**2, mass * v[:, 0], mass * v[:, 1], mass,
        movable, state.collisions,
    ]  # fmt: skip
    ends = np.cumsum(numbers)
    own = [slice(end - n, end) for end, n in zip(ends, numbers, strict=True)]
    return np.array([[np.sum(each[rows], dtype=float) for each in columns] for rows in own])


@validated
@collective
def sums(disks: Disks, state: State, gravity: tuple[Real, Real] = (0.0, 0.0)) -> Array:
    """Sums over all disks that `from_totals` takes; of ranks of MPI, each gives those of its slice (`Communicator`).

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(2, mass=2.0, radius=0.5)
    >>> state = ifrdem.State([[1.0, 1.0], [3.0, 1.0]], [[1.0, 0.0], [-1.0, 0.0]], [0.0, 0.0])
    >>> float(ifrdem.observables.sums(disks, state)[0])  # the energy of their motion
    2.0
    """
    if disks.n != state.n:
        raise InputError(f"state has {state.n} disks, disks {disks.n}: must be the same number")

    def mass(rows: slice) -> Array:
        """Masses, 0 of immovable disks: these are at rest, and an infinite mass would make a NaN of that."""
        return np.where(np.isfinite(disks.mass[rows]), disks.mass[rows], 0.0)

    def inertia(rows: slice) -> Array:
        return mass(rows) * disks.radius[rows] ** 2 / disks.k[rows]

    # np.sum adds pairwise along a contiguous axis: its rounding grows like log n, not like n.
    def v(axis: int, rows: slice) -> Array:
        velocity = state.velocity[rows, axis]
        return velocity.copy() if state.flow is None else velocity - state.flow[rows, axis]

    def energy(rows: slice) -> Array:
        """Twice the kinetic energies."""
        return mass(rows) * (v(0, rows) ** 2 + v(1, rows) ** 2) + inertia(rows) * state.spin[rows] ** 2

    columns: list[Callable[[slice], NDArray[Any]]] = [
        lambda rows: mass(rows) * (v(0, rows) ** 2 + v(1, rows) ** 2),
        lambda rows: inertia(rows) * state.spin[rows] ** 2,
        lambda rows: mass(rows) * v(0, rows),
        lambda rows: mass(rows) * v(1, rows),
        lambda rows: mass(rows) * v(0, rows) * v(1, rows),
        lambda rows: mass(rows) * (state.position[rows] @ np.array(gravity)),
        lambda rows: state.collisions[rows].astype(np.int64) + state.wall_collisions[rows],
        mass,
        lambda rows: mass(rows) * v(0, rows) ** 2,
        lambda rows: 0.5 * energy(rows) * v(0, rows),
        lambda rows: 0.5 * energy(rows) * v(1, rows),
        lambda rows: mass(rows) * state.position[rows, 0],
        lambda rows: mass(rows) * state.position[rows, 1],
    ]
    with np.errstate(over="ignore", invalid="ignore"):  # cubes of speeds, which only a heat flux asks for
        found = [float(current().total(RowsByBlock(disks.n, each))) for each in columns]
    totals = np.array([0.5 * found[0], 0.5 * found[1], *found[2:7], 0.0, *found[7:]])
    assert len(totals) == READOUT.width
    return totals


@validated
def from_totals(
    disks: Disks,
    totals: Annotated[Array, Numbers((READOUT.width,), -math.inf, math.inf)],
    time: float,
    wall_collisions: Annotated[int, Integer(0, 2**63 - 1)],
    *,
    about_mean: tuple[bool, bool] = (True, True),
    species: Annotated[Array, Numbers(("species", SPECIES.width), -math.inf, math.inf)] | None = None,
    **energy_terms: Any,
) -> Measure:
    """The measure of a gas from sums over all disks, which `Engine.totals` gives; `about_mean` as for `measure`.

    `species` are sums over each species (`species_sums`).

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    >>> totals = np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    >>> found = ifrdem.observables.from_totals(disks, totals, time=1.0, wall_collisions=0)
    >>> found.temperature, found.collisions
    (0.5, 2)
    """
    return measure_of_totals(
        disks, totals, time, wall_collisions, about_mean=about_mean, species=species, **energy_terms
    )


def measure_of_totals(
    disks: Disks,
    totals: Array,
    time: float,
    wall_collisions: int,
    *,
    about_mean: tuple[bool, bool] = (True, True),
    placed: bool = False,
    species: Array | None = None,
    **energy_terms: Any,
) -> Measure:
    """Measure of a gas as by `from_totals`, for the engine: without validating arguments, which takes as long.

    With a center of mass, if it is `placed`.
    """
    translational, rotational, *momentum, xy, fall, events, _, mass, xx, flux_x, flux_y, m_x, m_y = (
        totals.tolist()
    )
    n = max(disks.n_movable, 1)
    if disks.n_movable < disks.n:  # immovable disks hold the gas
        about_mean = (False, False)
    mean = [P / mass if about and mass > 0.0 else 0.0 for P, about in zip(momentum, about_mean, strict=True)]
    # Rounding could make it larger than the whole.
    drift_energy = min(0.5 * (momentum[0] * mean[0] + momentum[1] * mean[1]), translational)
    return Measure(
        time=time,
        # Each collision is counted at both of its disks, those with walls once.
        collisions=(round(events) - wall_collisions) // 2,
        translational_energy=translational,
        rotational_energy=rotational,
        temperature=(translational - drift_energy) / n,
        rotational_temperature=2.0 * rotational / n,
        momentum=np.array(momentum),
        drift_energy=drift_energy,
        momentum_flux=_about_mean(xx, xy, 2.0 * translational - xx, momentum, mean, mass),
        energy_flux=_energy_flux(
            (flux_x, flux_y),
            (xx, xy, 2.0 * translational - xx),
            translational + rotational,
            momentum,
            mean,
            mass,
        ),
        mean_velocity=np.array(mean),
        center_of_mass=np.array([m_x, m_y]) / mass if placed and mass > 0.0 else None,
        potential_energy=-fall or 0.0,
        wall_collisions=wall_collisions,
        **({} if species is None else _of_species(species, np.array(mean))),
        **energy_terms,
    )


def _of_species(totals: Array, mean: Array) -> dict[str, Any]:
    """Quantities of species in a measure; velocities are about this mean [length/time]."""
    found = Named(totals, SPECIES)
    drift = found.momentum_x * mean[0] + found.momentum_y * mean[1] - 0.5 * found.mass * float(mean @ mean)
    n = np.maximum(found.movable, 1.0)
    return {
        "species_temperature": np.maximum(found.translational - drift, 0.0) / n,
        "species_rotational_temperature": 2.0 * found.rotational / n,
        "species_collisions": np.rint(found.collisions).astype(np.int64),
    }


def _about_mean(
    xx: float, xy: float, yy: float, momentum: list[float], mean: list[float], mass: float
) -> Array:
    """Sum of m (v_a - u_a) (v_b - u_b) from those of m v_a v_b, shape (2, 2)."""
    (p_x, p_y), (u_x, u_y) = momentum, mean
    return np.array([
        [xx - p_x * u_x - p_x * u_x + mass * (u_x * u_x), xy - p_x * u_y - p_y * u_x + mass * (u_x * u_y)],
        [xy - p_y * u_x - p_x * u_y + mass * (u_y * u_x), yy - p_y * u_y - p_y * u_y + mass * (u_y * u_y)],
    ])  # fmt: skip


def _energy_flux(
    flux: tuple[float, float], of_momentum: tuple[float, float, float], energy: float, momentum: list[float],
    mean: list[float], mass: float,
) -> Array:  # fmt: skip
    """Sum of (m |v - u|^2 + I w^2) (v - u)_b / 2 from sums in the lab, shape (2,): those are e v_b, m v_a v_b and e."""
    (xx, xy, yy), (p_x, p_y), (u_x, u_y) = of_momentum, momentum, mean
    square = u_x * u_x + u_y * u_y
    own = energy - (u_x * p_x + u_y * p_y) + 0.5 * mass * square
    return np.array([
        flux[0] - (u_x * xx + u_y * xy) + 0.5 * square * p_x - u_x * own,
        flux[1] - (u_x * xy + u_y * yy) + 0.5 * square * p_y - u_y * own,
    ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stress:
    """Mean pressure tensor of a gas over a time, in two dimensions a force on a length [energy/length^2].

    P_ab is the flux of momentum along a through a line whose normal is along b. It is positive in compression, so the
    stress in the sense of elasticity is -P.

    Attributes
    ----------
    kinetic, collisional : array (2, 2)
        What disks carry and what collisions transfer.
    """

    kinetic: Array
    collisional: Array

    @property
    def total(self) -> Array:
        """Kinetic and collisional part together, shape (2, 2) [energy/length^2]."""
        return self.kinetic + self.collisional

    @property
    def pressure(self) -> float:
        """Mean of both normal components, (P_xx + P_yy) / 2 [energy/length^2]."""
        return 0.5 * float(np.trace(self.total))

    @property
    def friction(self) -> float:
        """Shear over normal stress on lines along x, -P_xy / P_yy: positive for a flow u_x that grows along y.

        nan without a normal stress.
        """
        return -float(self.total[0, 1]) / (float(self.total[1, 1]) or math.nan)

    @property
    def normal_difference(self) -> float:
        """First normal stress difference over the pressure, N_1 = (P_xx - P_yy) / p; nan without a pressure.

        M. Alam and S. Luding, Phys. Fluids 15, 2298 (2003), doi:10.1063/1.1587723.
        """
        return float(self.total[0, 0] - self.total[1, 1]) / (self.pressure or math.nan)

    @property
    def temperature_ratio(self) -> float:
        """Ratio T_x / T_y of the temperatures of the motion along x and y; nan without motion along y."""
        return float(self.kinetic[0, 0]) / (float(self.kinetic[1, 1]) or math.nan)


@validated
def stress(before: Measure, after: Measure, area: Positive) -> Stress:
    """Mean pressure tensor of a gas between two measures of one simulation, in an area [length^2].

    P_ab A = sum m V_a V_b + (1 / dt) sum_c (dp_i)_a (r_i - r_j)_b, over disks and over the collisions between the two
    times; r_i - r_j is the vector to a disk's centre from its partner's, or from the contact on a wall. The collisional
    part is exact; the kinetic part is the mean of both times. V is relative to the mean velocity or the flow, as in the
    temperature. Between walls the area is the free area, in which the walls' part is included: then the mean of P_nn is
    the pressure on them.

    C. S. Campbell and A. Gong, J. Fluid Mech. 164, 107 (1986), doi:10.1017/S0022112086002495.

    InputError if a measure holds no virial (record=["stress"]), or the second is not later.

    Examples
    --------
    >>> import ifrdem
    >>> disks, box = ifrdem.Disks(2, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0))
    >>> start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [-1.0, 0.0]], [0.0, 0.0])
    >>> law = ifrdem.IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    >>> gas = ifrdem.Simulation(disks, box, law, start, record=["stress"])
    >>> first = gas.measure()
    >>> gas.run(t_end=2.0)
    >>> found = ifrdem.observables.stress(first, gas.measure(), box.area)
    >>> float(found.kinetic[0, 0]), float(found.collisional[0, 0])  # 2 m v^2 / A; impulse 2, distance 1, time 2
    (0.02, 0.01)
    """
    if before.virial is None or after.virial is None:
        raise InputError('stress: not recorded; make the simulation with record=["stress"]')
    if not after.time > before.time:
        raise InputError(f"after.time = {after.time:g}: must be later than before.time = {before.time:g}")
    kinetic = 0.5 * (before.momentum_flux + after.momentum_flux) / area
    return Stress(kinetic, (after.virial - before.virial) / ((after.time - before.time) * area))


@dataclass(frozen=True, eq=False)
class HeatFlux:
    """Mean heat flux of a gas over a time, in two dimensions a power through a length [energy/(length time)].

    Attributes
    ----------
    kinetic, collisional : array (2,)
        What disks carry and what collisions transfer.

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> ifrdem.observables.HeatFlux(np.array([1.0, 0.0]), np.array([0.5, 0.0])).total.tolist()
    [1.5, 0.0]
    """

    kinetic: Array
    collisional: Array

    @property
    def total(self) -> Array:
        """Kinetic and collisional part together, shape (2,) [energy/(length time)]."""
        return self.kinetic + self.collisional


@validated
def heat_flux(before: Measure, after: Measure, area: Positive) -> HeatFlux:
    """Mean heat flux of a gas between two measures of one simulation, in an area [length^2].

    q_b A = sum e_i V_b + (1 / dt) sum_c sum_i de_i (r_i - r_c)_b, e = (m V^2 + I w^2) / 2: over disks, and over both
    disks of the collisions between the two times; de_i is what a disk gains, r_i - r_c the vector to its centre from
    the contact. Energy thus runs from the centre of one disk to that of the other, and what is dissipated ends at the
    contact. The collisional part is exact; the kinetic part is the mean of both times. V is relative to the mean
    velocity, as in the temperature. Walls give heat and work at their contacts, in the area as for `stress`.

    J. H. Irving and J. G. Kirkwood, J. Chem. Phys. 18, 817 (1950), doi:10.1063/1.1747782.

    InputError if a measure holds no transfer of energy (record=["heat_flux"]), or the second is not later.

    Examples
    --------
    >>> import ifrdem
    >>> disks, box = ifrdem.Disks(2, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0), (False, True))
    >>> start = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[3.0, 0.0], [1.0, 0.0]], [0.0, 0.0])
    >>> law = ifrdem.IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    >>> gas = ifrdem.Simulation(disks, box, law, start, record=["heat_flux"])
    >>> first = gas.measure()
    >>> gas.run(t_end=2.0)
    >>> found = ifrdem.observables.heat_flux(first, gas.measure(), box.area)
    >>> float(found.kinetic[0]), float(found.collisional[0])  # (4.5 3 + 0.5) / A; energy 4, distance 1, time 2
    (0.14, 0.02)
    """
    if before.energy_transfer is None or after.energy_transfer is None:
        raise InputError('heat_flux: not recorded; make the simulation with record=["heat_flux"]')
    passed = stress(before, after, area).collisional  # of momentum
    kinetic = 0.5 * (before.energy_flux + after.energy_flux) / area
    u = 0.5 * (before.mean_velocity + after.mean_velocity)
    in_lab = (after.energy_transfer - before.energy_transfer) / ((after.time - before.time) * area)
    return HeatFlux(kinetic, in_lab - u @ passed)
