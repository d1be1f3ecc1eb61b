"""Transport coefficients of a steady gas: shear viscosity, heat conductivity, self-diffusion.

Of a flux J of the whole gas (a component of the pressure tensor, or of the heat flux) and G, its integral over time,

    Green-Kubo:          L = f int_0^inf <J(0) J(t)> dt
    Helfand (Einstein):  L = f lim <(G(t) - G(0))^2> / (2 t)

with f = A / T for eta, from P_xy and (P_xx - P_yy) / 2, and f = A / T^2 for kappa, from q_x and q_y (units of T are
energies). D is the same of velocities and displacements of disks, with f = 1. M. S. Green, J. Chem. Phys. 22, 398
(1954), doi:10.1063/1.1740082; R. Kubo, J. Phys. Soc. Jpn. 12, 570 (1957); E. Helfand, Phys.
Rev. 119, 1 (1960), doi:10.1103/PhysRev.119.1; of hard disks R. Garcia-Rojo, S. Luding, J. J. Brey, Phys. Rev. E 74,
061305 (2006), doi:10.1103/PhysRevE.74.061305.

Collisions last no time: their part of the flux is a sum of delta functions, and only its mean over a time is a number.
Rows hold such means J_k over steps h, with the correlations C_k. <(G(k h) - G(0))^2> follows from these exactly, and
half its slope from k h to (k + 1) h is h (C_0 / 2 + C_1 + ... + C_k): the integral up to (k + 1/2) h. So nothing is
lost by the length of steps but in the kinetic part, the mean of both ends of a step: with the decay exp(-t / s), that
part is 1 + (h / s)^2 / 12 times as large.

The collisional part is white noise, which is in C_0 alone. The integral ends where it has come to 5 times the decay
time of the rest, sum_k>=1 C_k h / C_1 (as A. Sokal, in Functional Integration, Springer 1997,
doi:10.1007/978-1-4899-0319-8_6, does for C_0). In two dimensions correlations have tails in 1 / t, and coefficients
grow as the logarithm of that lag and of the box: by little in a dilute gas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..quantities import COMPONENTS, HEAT_SERIES, STRESS_SERIES
from ..tools.checked import Array, Column, Numbers, Positive, validated
from ..tools.intervals import student_t
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import displacement, motion
from . import result as stored
from .common import LEVEL, MeanValue, mean_errors
from .displacement import EVEN, Correlation
from .gas_theory import gas_of
from .result import Columns, Evaluation, Reading, all_frames, times, unit
from .steadiness import is_stationary, stationarity_warning
from .stress import means_between
from .window import is_driven, steady_frames

DECAYS = 5.0
"""Decay times of the correlation at which the integral ends: exp(-5) of an exponential is left."""
BLOCK = 10
"""Of that lag, the length of a block; blocks count as independent."""
BLOCKS = (5, 50)
"""Number of blocks, at least and at most."""
SHOWN = 2
"""Of that lag, the longest lag of the results: Helfand's line is fitted from 1 to 2 of them."""
FEWEST_LAGS = 3
COARSE = 0.5
"""Collisions per disk from row to row above which the kinetic part is marked: that of the stress relaxes in 1 in a dilute
gas, by Enskog's theory, so that h^2 / (12 s^2) is 2 %."""


@dataclass(frozen=True, eq=False, repr=False)
class TransportCoefficient(Brief, ResultPlot):
    """A transport coefficient by both formulas, and how they approach it.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> noise = np.random.default_rng(1).normal(size=(1000, 2))
    >>> found = analysis.transport_coefficient(np.arange(1001.0), noise, lag=5.0)
    >>> found.lags[:2].tolist(), found.square_lags[:2].tolist()  # the integral ends between rows
    ([0.5, 1.5], [1.0, 2.0])
    """

    green_kubo: MeanValue
    """The integral up to `lag`, its standard error by the spread over blocks and components, and their number."""
    helfand: MeanValue
    """Half the slope of the mean square from `lag` to twice of it, with the same."""
    lag: float
    """Lag at which the integral ends [time]."""
    lags: Array
    integral: Array
    integral_error: Array
    """lags, integral, integral_error: ends of integrals [time], the integral up to there, its error, (lags,)."""
    square_lags: Array
    square: Array
    square_error: Array
    """square_lags, square, square_error: lags [time], the mean square over twice the lag there, its error, (lags,)."""


class _Formulas(NamedTuple):
    """Correlation of a flux and mean square of its integral, over the same blocks, and a factor of both."""

    correlation: Correlation
    square: Correlation
    factor: float

    def coefficient(self, lag: float) -> TransportCoefficient:
        """The coefficient with the integral up to this lag, and Helfand's line from there to its double."""
        lags, integral, error = integrals(self.correlation, self.factor)
        at = int(np.argmin(np.abs(lags - lag)))
        samples = self.correlation.disks
        found = displacement.diffusion_coefficient(self.square, first=lag, last=SHOWN * lag)
        shown = lags <= SHOWN * lag
        later = (self.square.lag > 0.0) & (self.square.lag <= SHOWN * lag)
        t = self.square.lag[later]
        scale = self.factor / (2.0 * self.square.components * t)
        return TransportCoefficient(
            MeanValue(float(integral[at]), float(error[at]), samples), found.mean.times(self.factor), lag,
            lags[shown], integral[shown], error[shown], t, self.square.value[later] * scale, self.square.error[later] * scale,
        )  # fmt: skip


def integrals(found: Correlation, factor: float = 1.0) -> tuple[Array, Array, Array]:
    """Integrals of an autocorrelation for each of its directions: their ends (k + 1/2) h [time], values, errors."""
    step = float(found.lag[1] - found.lag[0])
    weights = np.tril(np.full((len(found.lag), len(found.lag)), step))
    weights[:, 0] = 0.5 * step
    weights *= factor / found.components
    error = np.sqrt(np.maximum(np.sum(weights @ found.covariance * weights, axis=1), 0.0))
    return found.lag + 0.5 * step, weights @ found.value, error


def decay_lag(correlation: Array) -> int | None:
    """Steps up to which an autocorrelation at lags of 0, 1, ... steps is summed: 5 decay times; None if it is short."""
    first = correlation[1]
    if not first > 0.0:  # noise
        return int(DECAYS) if len(correlation) > DECAYS else None
    decay = np.maximum(np.cumsum(correlation[1:]) / first, 1.0)
    ends = np.flatnonzero(np.arange(1, len(correlation)) >= DECAYS * decay)
    return int(ends[0]) + 1 if len(ends) else None


@validated
def transport_coefficient(
    time: Column,
    flux: Annotated[ArrayLike, Numbers(("rows", "components"))],
    *,
    factor: Positive = 1.0,
    lag: Positive | None = None,
) -> TransportCoefficient:
    """A transport coefficient from rows of a flux of the whole gas whose mean is 0 (the module's text).

    Errors are by the spread over blocks of time, of 10 lags or longer, and components: these count as independent.

    Parameters
    ----------
    time : array (rows + 1,)
        Rising times [time].
    flux : array (rows, components)
        Means from each time to the next; components are equivalent, and do not know of each other.
    factor : float
        f, such as A / T of the pressure tensor in an area A.
    lag : float, optional
        Where the integral ends [time]; by default 5 decay times.

    Raises
    ------
    InputError
        If times do not rise, or there are fewer than 50 lags or 3 rows in a lag.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> noise = np.random.default_rng(1).normal(size=(20_000, 2))  # integral of the correlation: 1 / 2
    >>> found = analysis.transport_coefficient(np.arange(20_001.0), noise, lag=6.0)
    >>> bool(abs(found.green_kubo.mean - 0.5) < 4.0 * found.green_kubo.error < 0.2)
    True
    """
    t, J = np.asarray(time, dtype=float), np.asarray(flux, dtype=float)
    if len(t) < 2 or not np.all(np.diff(t) > 0.0):
        raise InputError("time: must be two or more times, each later than the one before")
    if len(J) != len(t) - 1:
        raise InputError(f"flux has {len(J)} rows: must have {len(t) - 1}, one less than time")
    n, step = len(J), (t[-1] - t[0]) / len(J)
    if np.ptp(np.diff(t)) > EVEN * step:
        edges = np.linspace(t[0], t[-1], n + 1)
        t, J = edges, means_between(t, J, edges)
    longest = n // (BLOCKS[0] * BLOCK)
    if lag is None:
        padded = np.fft.rfft(J, 2 * n, axis=0)
        sums = np.fft.irfft(np.abs(padded) ** 2, axis=0)[: longest + 1].sum(axis=1)
        steps = decay_lag(sums / (n - np.arange(longest + 1))) if longest > 1 else None
    else:
        steps = round(lag / step)
        if steps < FEWEST_LAGS:
            raise InputError(f"lag = {lag:g}: must be {FEWEST_LAGS * step:.3g} or more, {FEWEST_LAGS} rows")
    if steps is None or steps > longest:
        long = "" if lag is None else f"lag = {lag:g}: "
        raise InputError(
            f"{long}{n} rows, {t[-1] - t[0]:.4g} in time, are too short for a correlation that lasts "
            f"{'longer than ' if steps is None else ''}{(steps or longest) * step:.3g}: must be "
            f"{BLOCKS[0] * BLOCK} times as long"
        )
    steps = max(steps, FEWEST_LAGS)
    rows = max(BLOCK * steps, n // BLOCKS[1])
    blocks = J[: n // rows * rows].reshape(n // rows, rows, -1).transpose(1, 0, 2).reshape(rows, -1, 1)
    paths = np.concatenate((np.zeros_like(blocks[:1]), np.cumsum(blocks, axis=0))) * step
    when = step * np.arange(rows + 1)
    most = SHOWN * steps + 1
    found = _Formulas(
        displacement.velocity_autocorrelation(when[:-1], blocks, most_lags=most),
        displacement.mean_square_displacement(when, paths, most_lags=most),
        factor,
    )
    return found.coefficient(steps * step)


# -- of a trajectory ---------------------------------------------------------------------------------------

NAMES = {"eta": "shear viscosity eta", "kappa": "heat conductivity kappa", "D": "self-diffusion D"}
UNITS = {"eta": "mass/time", "kappa": "1/time", "D": "length^2/time"}


def of_transport(
    trajectory: Trajectory, frames: Sequence[int] | None, *, lag: float | None = None
) -> Evaluation:
    _check_gas(trajectory)
    frames = steady_frames(trajectory, frames)
    used, series = all_frames(trajectory, frames), trajectory.series
    T_of_frames = motion.temperatures(trajectory, list(used))
    span = times(trajectory, used)
    inside = (series.time >= span[0]) & (series.time <= span[1])
    inside[1:] &= np.diff(series.time) > 0.0
    T = series["temperature"][inside] if "temperature" in series and inside.sum() > 1 else T_of_frames
    if T is None:
        raise InputError(f"{trajectory.path} holds no temperatures, over which fluctuations are taken")
    if not is_stationary(T):
        raise InputError(
            f"{stationarity_warning(trajectory, T)}: fluctuations give transport coefficients of a gas at one "
            "temperature. Drive the gas, take elastic disks, or choose frames over which T changes by less than a tenth"
        )
    mean_T, area = float(np.mean(T)), trajectory.box.area
    results: dict[str, TransportCoefficient] = {}
    notes: list[str] = []
    warnings: list[str] = []
    when = series.time[inside]
    for name, (flux, factor) in _fluxes(trajectory, inside, mean_T, area, notes).items():
        try:
            results[name] = transport_coefficient(when, flux[1:], factor=factor, lag=lag)
        except InputError as error:
            notes.append(f"no {name}: {error}")
            continue
        warnings += _not_zero(name, flux[1:])
    if results:
        warnings += _coarse(trajectory, inside)
    try:
        results["D"] = _self_diffusion(trajectory, used, lag)
    except InputError as error:
        notes.append(f"no D: {error}")
    if not results:
        raise InputError(f"{trajectory.path}: {'; '.join(notes)}")
    if is_driven(trajectory):
        warnings.append(
            "the gas is driven: the formulas hold in equilibrium. These are integrals of its correlations, and no "
            "coefficients that a flow or a temperature gradient would show"
        )
    enskog = _enskog(trajectory, mean_T, notes)
    rows: list[Reading] = []
    tables: dict[str, Columns] = {}
    for name, found in results.items():
        of = unit(trajectory, UNITS[name])
        if np.isfinite(found.green_kubo.mean):
            rows.append(Reading.of(f"{NAMES[name]}, Green-Kubo", found.green_kubo, of, name))
        rows.append(Reading.of(f"{NAMES[name]}, Helfand", found.helfand, of, f"{name}_helfand"))
        if name in enskog:
            rows.append(Reading(f"{NAMES[name]}, Enskog", enskog[name], unit=of, key=f"{name}_enskog"))
        rows.append(Reading(f"lag of {name}", found.lag, unit=unit(trajectory, "time"), key=f"{name}_lag"))
        tables[f"{name}-integral"] = {
            "lag": found.lags, name: found.integral, "error": found.integral_error,
        }  # fmt: skip
        tables[f"{name}-square"] = {"lag": found.square_lags, name: found.square, "error": found.square_error}
    notes.append("errors by the spread over blocks of time; of D over disks")
    return Evaluation(results, rows, tables, notes, span, warnings)


def _check_gas(trajectory: Trajectory) -> None:
    """Refuse gases whose fluxes are not those of a homogeneous gas at rest."""
    box = trajectory.box
    if box.shear_rate:
        raise InputError(
            "transport coefficients by fluctuations are those of a gas without a flow; in a sheared box `analyse "
            "stress` gives the viscosity, and `analyse msd` D"
        )
    if box.is_open or trajectory.free_area.all_walls or not trajectory.disks.movable.all():
        raise InputError(
            "transport coefficients of a homogeneous gas in a periodic box only: this one has walls, immovable disks "
            "or no sides; between walls `analyse profiles` gives stress and heat flux beside the gradients"
        )


def _fluxes(
    trajectory: Trajectory, inside: NDArray[np.bool_], T: float, area: float, notes: list[str]
) -> dict[str, tuple[Array, float]]:
    """Fluxes (rows, components) and factors f, by the names of coefficients; notes say which the file does not give."""
    series, found = trajectory.series, {}
    if STRESS_SERIES[0] in series:
        xx, xy, yx, yy = (series[f"{STRESS_SERIES[0]}/{name}"][inside] for name in COMPONENTS)
        found["eta"] = (np.stack((0.5 * (xy + yx), 0.5 * (xx - yy)), axis=1), area / T)
    else:
        notes.append("no eta: set output.stress = true in the case and run it again")
    if HEAT_SERIES[0] not in series:
        notes.append("no kappa: set output.heat_flux = true in the case and run it again")
    elif len(stored.kinds(trajectory)) > 1:
        notes.append("no kappa: the heat flux of a mixture includes that of diffusion")
    else:
        found["kappa"] = (series[HEAT_SERIES[0]][inside], area / T**2)
    return found


def _not_zero(name: str, flux: Array) -> list[str]:
    """Warning if the mean of a flux is not 0 by more than chance: then its fluctuations are not about 0."""
    error, n_eff = mean_errors(flux)
    beyond = np.abs(flux.mean(axis=0)) > student_t(n_eff, 1.0 - LEVEL / flux.shape[1]) * error
    text = "the gas is not isotropic, or not homogeneous"
    return [f"{name}: the mean of its flux is not 0: {text}"] if beyond.any() else []


def _coarse(trajectory: Trajectory, inside: NDArray[np.bool_]) -> list[str]:
    """Warning if many collisions lie between two rows."""
    if "collisions" not in trajectory.series:
        return []
    tau = trajectory.series["collisions_per_disk"][inside]
    between = float(tau[-1] - tau[0]) / (len(tau) - 1)
    if between <= COARSE:
        return []
    return [
        f"rows are {between:.2g} collisions per disk apart: kinetic parts of the fluxes change in between, and are too "
        f"large by some {100.0 * between**2 / 12.0:.2g} % in eta; take 0.25"
    ]


def _self_diffusion(trajectory: Trajectory, used: Sequence[int], lag: float | None) -> TransportCoefficient:
    """D of all disks from displacements, and from velocities if frames are so close that these are correlated."""
    if len(stored.kinds(trajectory)) > 1:
        raise InputError("`analyse msd` gives D of each kind of disks")
    of_square = motion.of_msd(trajectory, used)
    (square,) = (one.msd for one in of_square.result.values())
    if square.origins != "all":
        raise InputError("frames must be evenly spaced in time (output.frames_interval)")
    nothing = np.full(0, np.nan)
    steps = found = None
    if "velocity" in trajectory.fields:
        (found,) = motion.of_vacf(trajectory, used).result.values()
        steps = decay_lag(found.value) if found.value[1] > RESOLVED * found.value[0] else None
    if found is not None and steps is not None and SHOWN * steps < len(found.lag):
        end = steps * float(found.lag[1]) if lag is None else lag
        if len(np.flatnonzero((square.lag >= end) & (square.lag <= SHOWN * end))) >= FEWEST_LAGS:
            return _Formulas(found, square, 1.0).coefficient(end)
    fit = displacement.diffusion_coefficient(square)
    t = square.lag[1:]
    scale = 0.5 / (square.components * t)
    return TransportCoefficient(
        MeanValue(np.nan, np.nan, np.nan), fit.mean, fit.lags[0], nothing, nothing, nothing,
        t, square.value[1:] * scale, square.error[1:] * scale,
    )  # fmt: skip


RESOLVED = 0.5
"""Of <v^2>, the correlation from frame to frame above which velocities are integrated."""


def _enskog(trajectory: Trajectory, T: float, notes: list[str]) -> dict[str, float]:
    """Values of Enskog's theory of equal smooth elastic disks, by name; empty, with a note, of others."""
    gas = gas_of(trajectory)
    if isinstance(gas, str):
        notes.append(gas)
        return {}
    spins = bool(np.any(trajectory.observables["rotational_temperature"]))
    if not (found := gas.enskog(T, spins=spins)):
        notes.append("Enskog's values are those of equal smooth elastic disks: not of these")
        return {}
    if spins:
        notes.append(
            "no value of Enskog for kappa: spins, which smooth disks never change, carry energy too; start them at 0"
        )
    notes.append(
        "Enskog: first Sonine approximation; further ones add 2 % to eta and 3 % to kappa (D. M. Gass, "
        "doi:10.1063/1.1675116)"
    )
    return found
