"""Design of the next experiment: the information of further impacts at an angle on coefficients and law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..tools.checked import Count, Numbers, validated
from .likelihood import Array, Likelihood
from .maximum import covariance_of
from .result import Fit, Fitted

Angles = Annotated[
    ArrayLike, Numbers(("n",), 1e-3, 90.0 - 1e-3, "an angle between 0 and 90 degrees", least=1)
]


@dataclass(frozen=True, eq=False)
class Design:
    """Expected outcome of `number` further impacts at each angle, with the errors of those that were fitted."""

    psi: Array
    """Angles of incidence [deg]; shape (a,)."""
    number: int
    """Impacts that are added at one angle."""
    errors: Mapping[str, Array]
    """Standard errors of the coefficients of the best law with them, by the expected information; shape (a,)."""
    now: Mapping[str, float]
    """Standard errors as they are."""
    against: Mapping[str, Array]
    """For each other law, by how much its -2 ln L would exceed that of the best law, beyond what it does now, if the
    best law is true; its coefficients fitted again; shape (a,)."""

    def table(self) -> str:
        """The figures as text, with the best angle of each column marked by *."""
        names = [*self.errors, *(f"vs {name}" for name in self.against)]
        columns = [*self.errors.values(), *self.against.values()]
        best = [int(np.argmin(each)) for each in self.errors.values()]
        best += [int(np.argmax(each)) for each in self.against.values()]
        width = max(12, *(len(name) + 2 for name in names))
        lines = [
            f"{self.number} further impacts at one angle: expected standard errors, and expected gain "
            "in -2 ln L over other laws",
            f"  {'psi [deg]':>10}" + "".join(f"{name:>{width}}" for name in names),
            f"  {'now':>10}" + "".join(f"{self.now[name]:>{width}.4f}" for name in self.errors),
        ]
        for i, psi in enumerate(self.psi):
            each = zip(columns, best, strict=True)
            cells = (f"{column[i]:.4f}{'*' if i == at else ' '}" for column, at in each)
            lines.append(f"  {psi:>10.0f}" + "".join(f"{cell:>{width}}" for cell in cells))
        return "\n".join(lines)


@validated
def design(fit: Fit, number: Count = 10, psi: Angles | None = None) -> Design:
    """Expected information of `number` further impacts at each angle of incidence psi.

    Parameters
    ----------
    psi : array (a,), optional
        Angles [deg]; every 5 degrees from 5 to 85 without it.

    Examples
    --------
    >>> from ifrdem import fit
    >>> data = fit.read("data.csv", {"angles": 0.7})  # of `ifrdem fit --example > data.csv`
    >>> found = fit.fit(data, M=1.0, model=["brach"])
    >>> list(fit.design(found).errors)
    ['e_n', 'mu']
    """
    angles = np.arange(5.0, 86.0, 5.0) if psi is None else np.asarray(psi, dtype=np.float64)
    best = fit.laws[fit.best]
    problem = best.problem.at(best.law, best.values, np.radians(angles))
    known = Likelihood(best.problem, best.law, fit.robust).at(best.values).known
    new = Likelihood(problem, best.law).at(best.values).jacobian
    information = known + number * np.einsum("nqa,nqb->nab", new, new)
    errors = np.array([np.sqrt(np.diag(covariance_of(each))) for each in information])
    others = {name: each for name, each in fit.laws.items() if name != fit.best}
    return Design(
        psi=angles,
        number=number,
        errors={name: errors[:, i] for i, name in enumerate(best.law.free)},
        now={name: best.estimates[name].standard_error for name in best.law.free},
        against={name: _gain(best, each, angles, number, fit.robust) for name, each in others.items()},
    )


def _gain(best: Fitted, other: Fitted, angles: Array, number: int, robust: float | None) -> Array:
    """Gain (a,) of -2 ln L over another law, fitted again to what is known and to exact further impacts.

    All with the errors of the best law, and with the weights that a robust fit gives the impacts under the other law.
    """
    before = Likelihood(best.problem, other.law, robust).at(other.values)
    found = []
    for angle in np.radians(angles):
        one = best.problem.at(best.law, best.values, np.array([angle]))
        points = Likelihood(one, other.law, robust).at(other.values)
        # One Gauss-Newton step on both together: a refit that costs nothing.
        information = before.bread + number * points.information
        gradient = number * np.einsum("n,nqp,nq->p", points.weight, points.jacobian, points.residual)
        covariance = covariance_of(information)
        step = -covariance @ gradient if np.isfinite(covariance).all() else np.zeros_like(gradient)
        change = number * points.loss + gradient @ step
        found.append(max(float(change), 0.0))
    return np.array(found)
