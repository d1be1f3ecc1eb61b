"""Coefficients drawn from the errors that a case gives them: an axis of a study."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..case.case import CaseSections
from ..errors import InputError, counted
from ..tools import seeds

COEFFICIENTS = "coefficients"
"""Dimension of the draws of a study."""
MOST_TRIES = 1000
"""Draws of one set of coefficients, at most, until the laws allow one."""
DIGITS = 10
"""Of drawn coefficients, as they stand in the results."""


class Draws(NamedTuple):
    """Sets of coefficients: their keys in the case, a row of values for each set, and how many draws were refused."""

    keys: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    refused: int

    @property
    def text(self) -> str:
        """A sentence on the distribution."""
        found = f"{counted(len(self.values), 'set')} of coefficients, Gaussian with the errors of the case"
        if self.refused:
            more = f"{self.refused} of {len(self.values) + self.refused} draws were outside of what the laws allow"
            found += f", truncated: {more}, and were repeated"
        return found


def drawn(case: CaseSections, number: int, allowed: Callable[[Sequence[str]], bool]) -> Draws:
    """Sets of all coefficients that have errors, the first ones the same for any number of them.

    `allowed` says of changes of the case, "KEY=VALUE", whether the laws allow them; other draws are repeated.

    Raises InputError if no coefficient has an error, or hardly a draw is allowed.
    """
    parts = [each for each in _sections(case) if each[0]]
    if not parts:
        raise InputError(
            f"{COEFFICIENTS} = {number}: no coefficient has an error: give errors in [[material]] or [[pair]], such as "
            "errors = { e_n = 0.002 }; `ifrdem fit --write-case` writes them"
        )
    keys = tuple(key for each, _, _ in parts for key in each)
    rows, refused = [], 0
    for i in range(number):
        random = seeds.stream(case.run.seed, seeds.COEFFICIENTS, i + 1)
        for _ in range(MOST_TRIES):
            row = np.concatenate([mean + root @ random.standard_normal(len(mean)) for _, mean, root in parts])
            values = tuple(float(f"{each:.{DIGITS}g}") for each in row)
            if allowed([f"{key}={value!r}" for key, value in zip(keys, values, strict=True)]):
                break
            refused += 1
        else:
            raise InputError(
                f"{COEFFICIENTS} = {number}: of {MOST_TRIES} draws the laws allow none: coefficients are too close to "
                "the limits of their laws, or errors too large"
            )
        rows.append(values)
    return Draws(keys, tuple(rows), refused)


def _sections(
    case: CaseSections,
) -> Iterator[tuple[tuple[str, ...], NDArray[np.float64], NDArray[np.float64]]]:
    """Keys, means (p,) and a root of the covariance (p, p) of each material and pair."""
    for name in ("material", "pair"):
        for i, section in enumerate(getattr(case, name)):
            names, covariance = section.covariance
            means = np.array([section.coefficient(each) for each in names])
            yield tuple(f"{name}[{i}].{each}" for each in names), means, _root(covariance)


def _root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """L (p, p) with L L^T = C, by Cholesky; columns of 0 where rounded correlations leave no variance."""
    found = np.zeros_like(covariance)
    for j, variance in enumerate(np.diag(covariance)):
        left = covariance[j:, j] - found[j:, :j] @ found[j, :j]
        if left[0] > 1e-9 * variance:
            found[j:, j] = left / np.sqrt(left[0])
    return found
