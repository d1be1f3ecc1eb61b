"""Collision laws that a fit chooses among: their coefficients, the ranges of these, and the angle of transition.

The IFR law is `ifrdem.kernels.laws.law.collide_pair` itself, called with arrays; other laws are `CollisionLaw`
classes, whose `collide` gives the impulses between the same two steps that every collision has.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, nearest, option_name, refuse, shortened
from ..model.laws import files as law_files
from ..model.laws.collision import impulses
from ..model.laws.files import is_law
from ..model.laws.ifr import REQUIRED_COEFFICIENTS, STICKING, EnergyWarning, IFRLaw
from ..model.laws.law import CollisionLaw
from ..model.laws.walton import Walton
from ..tools.checked import Number, validated

Array = NDArray[np.float64]
Range = tuple[float, float]

RANGES: Mapping[str, Range] = MappingProxyType(
    {
        name: (key.allowed.low, key.allowed.high)
        for kind in (IFRLaw, Walton)
        for name, key in kind.keys.items()
        if isinstance(key.allowed, Number) and name != "rho"  # a length
    }
    | {"mu": (0.0, 10.0)}
)
"""Lowest and highest values of coefficients by name: those of the laws; a real mu is well below 10."""

_START_RANGES: Mapping[str, Range] = {
    "e_n": (0.3, 0.98),
    "A": (0.02, 0.5),
    "e_t": (-0.98, 0.1),
    "mu": (0.02, 0.7),
    "beta_0": (-0.5, 0.8),
}
_STEEP = 1e12  # a friction coefficient with which every impact sticks
SMALLEST, LARGEST = 1e-7, 0.5 * math.pi - 1e-7
"""Angles of incidence [rad] as good as 0 and 90 degrees, where ratios of slips have only a limit."""


@dataclass(frozen=True, eq=False)
class Law:
    """A law with its free and fixed coefficients."""

    name: str
    about: str
    """name, about: as `--model` has it, and in words."""
    kind: type[CollisionLaw]
    """The law itself."""
    ranges: Mapping[str, Range]
    """Lowest and highest value of every coefficient."""
    fixed: Mapping[str, float] = field(default_factory=dict)
    """Coefficients that are not fitted."""
    start_ranges: Mapping[str, Range] = field(default_factory=dict)
    """Values from which searches start."""
    sticking: str | None = None
    """Of an IFR law."""
    units: Mapping[str, float] = field(default_factory=dict)
    """Size of coefficients that have a unit, so that a fit does not depend on it; 1 of the others."""

    @property
    def sizes(self) -> Array:
        """Sizes (p,) of the free coefficients, which steps and tolerances are parts of."""
        return np.array([self.units.get(name, 1.0) for name in self.free])

    def measured_in(self, name: str, unit: float) -> Law:
        """The law with ranges of a coefficient, if it has it, in `unit`, its size."""
        if name not in self.ranges:
            return self
        low, high = self.ranges[name]
        start_low, start_high = self.start_ranges.get(name, (0.0, 0.0))
        return replace(
            self,
            ranges={**self.ranges, name: (low * unit, high * unit)},
            start_ranges={**self.start_ranges, name: (start_low * unit, start_high * unit)},
            units={**self.units, name: unit},
        )

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the coefficients that are fitted, the last axis of every array of them."""
        return tuple(name for name in self.ranges if name not in self.fixed)

    @property
    def low(self) -> Array:
        """Lowest values (p,)."""
        return np.array([self.ranges[name][0] for name in self.free])

    @property
    def high(self) -> Array:
        """Highest values (p,)."""
        return np.array([self.ranges[name][1] for name in self.free])

    def full(self, values: Array) -> dict[str, Array]:
        """Every coefficient by name, each (..., 1), from the free ones (..., p)."""
        found = {name: np.asarray(values[..., i, None]) for i, name in enumerate(self.free)}
        return {name: found.get(name, np.array([self.fixed.get(name, math.nan)])) for name in self.ranges}

    def start_points(self, number: int) -> Array:
        """Starts (number, p) of searches, spread evenly over `start_ranges`."""
        from scipy.stats import qmc

        low, high = (np.array([self.start_ranges[name][i] for name in self.free]) for i in (0, 1))
        points = qmc.Sobol(len(self.free), scramble=False).random(number)
        return np.asarray(low + (high - low) * points)

    @property
    def depends_on_speed(self) -> bool:
        """True if e_n is 1 - A g_n^(1/5), the first terms of that of viscoelastic spheres."""
        return "A" in self.ranges and "A" not in self.kind.coefficients

    def e_n(self, of: Mapping[str, Array], g_n: Array | float) -> Array:
        """Normal restitution (..., n) of impacts with normal velocities g_n [length/time]."""
        if not self.depends_on_speed:
            return of["e_n"]
        return np.clip(1.0 - of["A"] * np.maximum(g_n, 0.0) ** 0.2, 0.0, 1.0)

    def collide(self, values: Array, motion: Sequence[Array]) -> tuple[Array, ...]:
        """Velocities and spins after (vx_i, vy_i, w_i, vx_j, vy_j, w_j), P_n, P_t, sticking, rolling.

        `values` (..., p) are not examined: a fit passes through any. `motion` has the arguments of `relative_motion`,
        each (..., n).
        """
        return self._collide(self.full(values), motion)

    def _collide(self, of: Mapping[str, Array], motion: Sequence[Array]) -> tuple[Array, ...]:
        from ..kernels.laws import law  # imports Taichi, which is slow

        if self.sticking is not None:
            contact = float(self.sticking == STICKING[1])
            e_n = self.e_n(of, law.relative_motion(*motion)[0]) if self.depends_on_speed else of["e_n"]
            row = (e_n, of["e_t"], of["mu"], contact, of["rho"])
            found: tuple[Array, ...] = law.collide_pair(*row, *motion)
            return found
        g_n, g_t, m_n, m_t = law.relative_motion(*motion)
        _, _, im_i, R_i, k_i, _, _, w_i, im_j, R_j, k_j, _, _, w_j = motion
        pair = (g_n, g_t, m_n, m_t, im_i, R_i, k_i, w_i, im_j, R_j, k_j, w_j, law.reduced_radius(R_i, R_j))
        of = {**of, "e_n": self.e_n(of, g_n)} if self.depends_on_speed else of
        P_n, P_t, T = impulses(self.kind, pair, [of[name] for name in self.kind.coefficients])
        none = np.zeros(np.shape(P_n))
        return (*law.after_impulses(P_n, P_t, T, *motion), P_n, P_t, none, none)

    def stick(self, values: Array, probe: Sequence[Array]) -> Array:
        """c = P_stick / (m_n |g_t|) of friction that stops the slip, (..., n): by the law itself.

        `probe` is a motion with g_n = g_t = 1. Transition: mu (1 + e_n) = c tan(angle of incidence).
        """
        of = {**self.full(values), "e_n": np.zeros(1), "mu": np.array([_STEEP])}
        if self.depends_on_speed:
            of["A"] = np.ones(1)  # e_n = 0 at the speed of the probe
        if "e_t" in of:
            of |= {"e_t": np.array([-1.0]), "rho": np.zeros(1)}
        *_, P_n, P_t, _, _ = self._collide(of, probe)
        return np.asarray(P_t / P_n)

    @property
    def has_transition(self) -> bool:
        """True for a law with Coulomb friction that another impulse bounds."""
        if self.sticking is not None:
            return True
        return (
            self.kind.has_averages
            and not self.kind.depends_on_speed
            and {"e_n", "mu"} <= {*self.kind.coefficients}
        )

    def transitions(self, values: Array, probe: Sequence[Array], speed: Array | float = 1.0) -> list[Array]:
        """Angles of incidence [rad], each (..., n), at which the law changes its regime; `probe` as for `stick`.

        `speed` is |g| (n,) of the impacts as measured, which only a law that depends on speed takes; its transition
        moves a little with the true speed.
        """
        if not self.has_transition:
            return []
        of, c = self.full(values), self.stick(values, probe)
        e_n = self.e_n(of, speed)
        found = [np.arctan2(of["mu"] * (1.0 + e_n), c)]  # c = 0 for beta_0 = -1
        if self.depends_on_speed:
            for _ in range(3):  # g_n = |g| cos(chi) at the transition itself
                e_n = self.e_n(of, speed * np.cos(found[0]))
                found = [np.arctan2(of["mu"] * (1.0 + e_n), c)]
        if "rho" in self.free or self.fixed.get("rho", 0.0) > 0.0:
            contact = replace(self, sticking=STICKING[1])
            lever = reach(probe) * contact.stick(values, probe)  # r m_t / m_n, by Eq. 12
            found.append(np.arctan2(of["rho"] * (1.0 + e_n), lever))  # Eqs. 31 and 32 equal
        return found


def reach(motion: Sequence[Array]) -> Array:
    """r = 2 R_1 R_2 / (R_1 + R_2), (n,) or (1,), which rolling friction rho is compared with."""
    return np.asarray(2.0 * motion[3] * motion[9] / (motion[3] + motion[9]))


def _ifr(name: str, about: str, sticking: str, **fixed: float) -> Law:
    ranges = {**{key: RANGES[key] for key in REQUIRED_COEFFICIENTS}, "rho": (0.0, math.inf)}
    return Law(name, about, IFRLaw, ranges, {"rho": 0.0, **fixed}, dict(_START_RANGES), sticking)


def _walton() -> Law:
    ranges = {name: RANGES[name] for name in Walton.coefficients}
    about = "Walton: constant restitution of the slip"
    return Law("walton", about, Walton, ranges, start_ranges=dict(_START_RANGES))


def _viscoelastic(law: Law, name: str, about: str) -> Law:
    ranges = {"A": (0.0, 5.0), **{k: v for k, v in law.ranges.items() if k != "e_n"}}
    return replace(law, name=name, about=f"{about}, e_n = 1 - A g_n^(1/5)", ranges=ranges)


LAWS: Mapping[str, Law] = MappingProxyType(
    {
        law.name: law
        for law in (
            _ifr("ifr-percussion", "IFR, percussion centre (Eq. 15)", STICKING[0]),
            _ifr("ifr-contact", "IFR, contact point (Eq. 12)", STICKING[1]),
            _walton(),
            _ifr(
                "brach",
                "Brach: sliding until the slip stops (IFR, contact point, e_t = -1)",
                STICKING[1],
                e_t=-1.0,
            ),
            _ifr("smooth", "smooth disks (IFR, e_t = -1, mu = 0)", STICKING[1], e_t=-1.0, mu=0.0),
            _viscoelastic(_ifr("", "", STICKING[0]), "ifr-viscoelastic", "IFR, percussion centre"),
            _viscoelastic(_walton(), "walton-viscoelastic", "Walton"),
        )
    }
)
"""The laws of `--model`, by name."""

IFR = ("ifr-percussion", "ifr-contact")


def ifr_law(coefficients: Mapping[str, float], sticking: str, k: float = 2.0) -> IFRLaw:
    """The IFR law of coefficients, without its warning: a fit reports by `admissibility` whether they add energy.

    Raises InputError if the law is refused.
    """
    with warnings.catch_warnings(action="ignore", category=EnergyWarning):
        return IFRLaw(**coefficients, sticking=sticking, k=k)  # type: ignore[arg-type]


@validated
def own(kind: type[CollisionLaw], ranges: Mapping[str, Range] | None = None) -> Law:
    """A custom law to fit.

    Raises InputError if it is no law, a range is missing, of an unknown coefficient, or empty.

    Parameters
    ----------
    kind : type of CollisionLaw
        With a `collide` that can be called with numbers.
    ranges : mapping of str to (float, float), optional
        Lowest and highest finite value of each coefficient, also where searches start; not needed for e_n,
        e_t, mu, beta_0.

    Examples
    --------
    >>> from ifrdem import fit, laws
    >>> fit.own(laws.Walton).free
    ('e_n', 'beta_0', 'mu')
    """
    if not is_law(kind) or kind.collide is CollisionLaw.collide:
        raise InputError(
            f"kind = {shortened(kind)}: must be a class derived from ifrdem.CollisionLaw with a method collide"
        )
    if not kind.coefficients or kind.has_table:
        raise InputError(f"{kind.__name__}: has no coefficients to fit")
    given = dict(ranges or {})
    problems = [
        f"no coefficient '{name}'{nearest(name, kind.coefficients)}; it has {', '.join(kind.coefficients)}"
        for name in given
        if name not in kind.coefficients
    ]
    problems += [
        f"range of {name} = {low:g}:{high:g}: must be two finite numbers, the lower first"
        for name, (low, high) in given.items()
        if not (low < high and math.isfinite(low) and math.isfinite(high))
    ]
    missing = [name for name in kind.coefficients if name not in given and name not in RANGES]
    problems += [
        f"range of {name}: missing ({option_name(f'--range {name}=LOW:HIGH', f'ranges[{name!r}] = (LOW, HIGH)')})"
        for name in missing
    ]
    refuse(problems, kind.__name__)
    whole = {name: given.get(name, RANGES.get(name, (0.0, 0.0))) for name in kind.coefficients}
    start_ranges = {name: given.get(name, _START_RANGES.get(name, (0.0, 0.0))) for name in kind.coefficients}
    return Law(kind.__name__, f"{kind.__name__}, a custom law", kind, whole, {}, start_ranges)


def own_from_file(text: str, ranges: Mapping[str, Range] | None = None) -> Law:
    """`own` of FILE.py:CLASS, whose code is executed.

    Raises InputError if there is no such file or class.
    """
    try:
        kind = law_files.find(text).kind
    except InputError as error:
        raise InputError(f"{option_name(f'--law {text}', text)}: {error}") from None
    return own(kind, ranges)


def chosen(
    names: Iterable[str], fixed: Mapping[str, float] | None = None, own_laws: Iterable[Law] = ()
) -> dict[str, Law]:
    """Laws by name, "all" for every one of `LAWS`, with coefficients fixed; of laws that become one, the first.

    Raises InputError if a name is unknown, or a value to fix is outside of what a law allows, or of no law.
    """
    found: dict[str, Law] = {}
    problems = []
    for name in names:
        if name == "all":
            found |= LAWS
        elif name in LAWS:
            found[name] = LAWS[name]
        else:
            allowed = (*LAWS, "all")
            problems.append(
                f"model = {shortened(name)}: must be one of {', '.join(allowed)}{nearest(str(name), allowed)}"
            )
    found |= {law.name: law for law in own_laws}
    if not found and not problems:
        problems.append(f"model: must name at least one of {', '.join(LAWS)}, all")
    fixed = dict(fixed or {})
    known = {name for law in found.values() for name in law.ranges}
    for name, value in fixed.items():
        ranges = [law.ranges[name] for law in found.values() if name in law.ranges]
        if found and not ranges:
            named = f"{nearest(name, known)}; there are {', '.join(sorted(known))}"
            problems.append(f"{name} = {value:g} cannot be fixed: no such coefficient{named}")
        elif any(not low <= value <= high for low, high in ranges):
            low, high = ranges[0]
            problems.append(f"{name} = {value:g} must be a value from {low:g} to {high:g}")
    refuse(problems)
    laws = {}
    for name, law in found.items():
        further = {k: v for k, v in fixed.items() if k in law.free or (k == "rho" and k in law.ranges)}
        laws[name] = replace(law, fixed={**law.fixed, **further})
    empty = [name for name, law in laws.items() if not law.free]
    if empty:
        raise InputError(f"model {empty[0]}: every coefficient is fixed, nothing is left to fit")
    return laws
