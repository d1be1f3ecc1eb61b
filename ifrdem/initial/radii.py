"""Radii of disks that are not all equal: samples of a distribution, reproducible by a seed.

Every function returns an array of shape (n,) [length]. Masses that follow the radii are `density * pi * radius**2`
with the mass per area of the disks, `density` [mass/length^2]. Of ranks of MPI (`Communicator`), each gives the number
of disks in its slice (`ifrdem.slice_of`), and gets their radii: to the bit those that one process draws, for each block
of 262,144 disks has random numbers of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated

import numpy as np

from ..errors import InputError
from ..model.state import NumberOfDisks
from ..mpi import collective, current
from ..tools import seeds
from ..tools.checked import Array, Choice, Positive, Seed, validated

TRUNCATION = 3.0
"""Standard deviations from the mean at which a Gaussian is cut off where the case does not say."""

LEAST_SHARE = 1e-3
"""Part of a distribution that must be left between `low` and `high`."""

PARAMETERS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "uniform": (("low", "high"), ()),
    "gaussian": (("mean", "deviation"), ("low", "high")),
    "lognormal": (("mean", "deviation"), ("low", "high")),
    "bidisperse": (("low", "high", "large_fraction"), ()),
}
"""Of each distribution, the parameters that it needs and those that it may have."""


Distribution = Annotated[str, Choice(tuple(PARAMETERS))]


@validated
@collective
def uniform(n: NumberOfDisks, *, low: Positive, high: Positive, seed: Seed) -> Array:
    """Radii that are equally frequent between `low` and `high` [length].

    InputError if not 0 < low < high, or a number is not finite.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radius = radii.uniform(10_000, low=0.4, high=0.6, seed=1)
    >>> round(float(radius.mean()), 2)
    0.5
    """
    return sample("uniform", n, seed=seed, low=low, high=high)


@validated
@collective
def gaussian(
    n: NumberOfDisks,
    *,
    mean: Positive,
    deviation: Positive,
    low: Positive | None = None,
    high: Positive | None = None,
    seed: Seed,
) -> Array:
    """Radii from a normal distribution, cut off at `low` and `high` [length].

    Without these it is cut off three standard deviations from the mean, where 0.27 % of it lie outside; the standard
    deviation of what is left is 1.3 % smaller than `deviation`. InputError if a number is not positive and finite,
    the lower end is not positive (a deviation above a third of the mean needs a `low`), or hardly anything of the
    distribution lies between the ends.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radius = radii.gaussian(10_000, mean=0.5, deviation=0.05, seed=1)
    >>> round(float(radius.mean()), 2)
    0.5
    """
    return sample("gaussian", n, seed=seed, mean=mean, deviation=deviation, low=low, high=high)


@validated
@collective
def lognormal(
    n: NumberOfDisks,
    *,
    mean: Positive,
    deviation: Positive,
    low: Positive | None = None,
    high: Positive | None = None,
    seed: Seed,
) -> Array:
    """Radii whose logarithm is normal; `mean` and `deviation` [length] are those of the radius itself.

    The logarithm has the variance s^2 = ln(1 + (deviation/mean)^2) and the mean ln(mean) - s^2/2. It is cut off only
    at `low` or `high` [length], if given. InputError if a number is not positive and finite, or hardly anything of
    the distribution lies between the ends.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radius = radii.lognormal(10_000, mean=0.5, deviation=0.1, seed=1)
    >>> round(float(radius.mean()), 2)
    0.5
    """
    return sample("lognormal", n, seed=seed, mean=mean, deviation=deviation, low=low, high=high)


@validated
@collective
def bidisperse(
    n: NumberOfDisks, *, low: Positive, high: Positive, large_fraction: Positive, seed: Seed
) -> Array:
    """Radii of two sizes [length], of which the part `large_fraction` of all disks has `high`, in random order.

    Their number is the whole number nearest to `large_fraction * n`, not a random one. InputError if not 0 < low <
    high, or the fraction is not between 0 and 1.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radius = radii.bidisperse(10_000, low=0.5, high=0.7, large_fraction=0.5, seed=1)
    >>> round(float(radius.mean()), 2)
    0.6
    """
    return sample("bidisperse", n, seed=seed, low=low, high=high, large_fraction=large_fraction)


@validated
@collective
def sample(
    distribution: Distribution, n: NumberOfDisks, *, seed: Seed, **parameters: Positive | None
) -> Array:
    """Radii [length], shape (n,), of a distribution by its name (`PARAMETERS`); see the functions of these names.

    InputError as `check`.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radii.sample("uniform", 3, low=0.4, high=0.6, seed=1).round(3)
    array([0.522, 0.477, 0.569])
    """
    comm = current()
    comm.run_on_all(lambda: check(distribution, **parameters))
    ids, number = comm.number(n)
    return of_ids(distribution, number, ids, seed=seed, **parameters)


@validated
def of_ids(
    distribution: Distribution, n: NumberOfDisks, ids: range, *, seed: Seed, **parameters: Positive | None
) -> Array:
    """Radii [length], shape (len(ids),), of some of n disks: those that `sample` gives them among all.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> some = radii.of_ids("uniform", 100, range(7, 9), seed=1, low=0.4, high=0.6)
    >>> bool((some == radii.uniform(100, low=0.4, high=0.6, seed=1)[7:9]).all())
    True
    """
    check(distribution, **parameters)
    given = {name: float(value) for name, value in parameters.items() if value is not None}
    if distribution == "bidisperse":
        large = seeds.permuted(seed, seeds.RADII, n, ids) < round(given["large_fraction"] * n)
        return np.where(large, given["high"], given["low"])
    return seeds.drawn(
        seed, seeds.RADII, ids, lambda random, count: _drawn(distribution, random, count, given)
    )


def _drawn(distribution: str, random: np.random.Generator, n: int, given: Mapping[str, float]) -> Array:
    """Radii of the first disks of a block."""
    if distribution == "uniform":
        return given["low"] + (given["high"] - given["low"]) * random.random(n)
    from scipy.special import ndtri

    centre, width, begin, end = _normal(distribution, given)
    # By the inverse of the normal distribution; 0 itself would give minus infinity.
    share = np.maximum(random.random(n), 2.0**-54)
    radius = centre + width * ndtri(begin + (end - begin) * share)
    radius = np.exp(radius) if distribution == "lognormal" else radius
    low, high = _ends(distribution, given)
    return np.clip(radius, low, high)  # against rounding at the ends


@validated
def check(distribution: Distribution, **parameters: Positive | None) -> None:
    """Refuse parameters that describe no radii.

    InputError if the name is unknown, a parameter is missing or foreign to it, not positive and finite, or the ends
    contradict each other or the rest.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radii.check("uniform", low=0.6, high=0.4)
    Traceback (most recent call last):
        ...
    ifrdem.errors.InputError: low = 0.6: must lie below high = 0.4
    """
    given = {name: value for name, value in parameters.items() if value is not None}
    problem = parameter_problem(distribution, given)
    if problem is not None:
        raise InputError(problem)
    if given.get("large_fraction", 0.5) >= 1.0:
        raise InputError(f"large_fraction = {given['large_fraction']:g}: must lie between 0 and 1")
    low, high = _ends(distribution, given)
    if low <= 0.0 and distribution == "gaussian":
        raise InputError(
            f"deviation = {given['deviation']:g}: above a third of mean = {given['mean']:g}, radii would not all "
            "be positive: choose a smaller one, or a cut-off radius low"
        )
    if not low < high:
        raise InputError(f"low = {low:g}: must lie below high = {high:g}")
    if "mean" in given:
        _, _, begin, end = _normal(distribution, given)
        if end - begin < LEAST_SHARE:
            raise InputError(
                f"low = {low:g}, high = {high:g}: only {end - begin:.2g} of the distribution lies between them: "
                f"must be {LEAST_SHARE:g} or more"
            )


@validated
def parameter_problem(distribution: Distribution, given: Mapping[str, object]) -> str | None:
    """Parameters that a known distribution lacks, or that are foreign to it, in words; None if there are none.

    Examples
    --------
    >>> from ifrdem.initial import radii
    >>> radii.parameter_problem("uniform", {"low": 0.4})
    '"uniform" requires low, high; missing: high'
    """
    needed, also = PARAMETERS[distribution]
    missing = [name for name in needed if name not in given]
    foreign = [name for name in given if name not in needed + also]
    if not missing and not foreign:
        return None
    may = f" and may have {', '.join(also)}" if also else ""
    text = f'"{distribution}" requires {", ".join(needed)}{may}'
    text += f"; missing: {', '.join(missing)}" if missing else ""
    return text + (f"; not for it: {', '.join(foreign)}" if foreign else "")


def _ends(distribution: str, given: Mapping[str, float]) -> tuple[float, float]:
    """The smallest and the largest radius that the distribution may give [length]."""
    low, high = 0.0, math.inf
    if distribution == "gaussian":
        reach = TRUNCATION * given["deviation"]
        low, high = given["mean"] - reach, given["mean"] + reach
    return given.get("low", low), given.get("high", high)


def _normal(distribution: str, given: Mapping[str, float]) -> tuple[float, float, float, float]:
    """Mean and deviation of the underlying normal variable, and its cumulative probabilities at both ends."""
    from scipy.special import ndtr

    low, high = _ends(distribution, given)
    centre, width = given["mean"], given["deviation"]
    if distribution == "lognormal":
        variance = math.log1p((width / centre) ** 2)
        centre, width = math.log(centre) - 0.5 * variance, math.sqrt(variance)
        low = math.log(low) if low > 0.0 else -math.inf
        high = math.log(high)
    begin, end = ndtr((np.array([low, high]) - centre) / width)
    return centre, width, float(begin), float(end)
