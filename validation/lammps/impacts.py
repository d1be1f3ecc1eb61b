"""Single Hertz-Mindlin impacts in LAMMPS, against laws of impacts, and what laws of few coefficients make of them."""

from __future__ import annotations

import math

import numpy as np

from ...model.laws.ifr import IFRLaw
from ...model.laws.law import CollisionLaw
from ...model.laws.walton import Walton
from ...plots.style import dashes
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import contacts, library, world
from .contacts import COLOURS, MU
from .world import M_N, M_T

QUESTION = "Which impacts do Hertz-Mindlin contacts give, and which laws describe them?"
REFERENCE = "laws of impacts of ifrdem at the same coefficients; Hertz's scaling with speed"

OVERLAP, SHORTEST = 1e-3, 3e-4
SPEEDS = np.array([0.1, 0.5, 1.0, 1.77, 3.0, 5.0])
PSI = np.radians([50.0, 60.0, 70.0, 80.0])
STICKING = [20.0, 25.0, 30.0, 35.0]
"""Angles [degrees] at which e_t* is positive, so that both laws have such a coefficient."""
POISSON, FRICTION, RESTITUTION, IMPACTS = (
    (0.0, 0.2, 0.33, 0.5),
    (0.1, 0.2, 0.5, 1.0),
    (0.5, 0.7, 0.8, 0.9, 0.97),
    1000,
)
"""Poisson's ratios, coefficients of friction and restitution, and impacts of a gas for each."""
SHAPES = {"disks": world.DISK, "spheres": world.SPHERE}
LOSS = (1e-4, 1.2e-3)
"""How much less e_n is where a contact pulls at its end: seen 1.6e-4 to 1.06e-3."""


def run(quick: bool) -> Result:
    library.load()
    result = Result()
    _restitution(result)
    _sliding(result)
    _sticking(result)
    _viscoelastic(result)
    _scaling(result)
    found = contacts.fitted(contacts.hertz_mindlin(OVERLAP))
    _fits(result, found)
    if not quick:
        _coefficients(result)
    result.pictures.append(_figure(found))
    return result


def _restitution(result: Result) -> None:
    for e_n in (0.5, 0.7, 0.9):
        contact = contacts.hertz_mindlin(OVERLAP)._replace(eta=e_n)
        (found,) = world.impacts(contact, [1.0], [1e-4], steps=200).e_n
        reason = "the phase of the step at first touch: seen 6e-4"
        source = "LAMMPS manual, pair granular"
        result.near(f"e_n of `damping coeff_restitution {e_n:g}`", found, e_n, 1e-3, reason, source)


def _sliding(result: Result) -> None:
    reason = "overlap, and the phase of the step at first touch: seen 1.5e-3"
    laws: tuple[CollisionLaw, ...] = (
        Walton(e_n=contacts.E_N, beta_0=0.28, mu=MU),
        IFRLaw(e_n=contacts.E_N, e_t=-1.0, mu=MU),
    )
    for shape, k in SHAPES.items():
        psi = PSI[np.tan(PSI) > (1.0 + k) * MU * (1.0 + contacts.E_N)]  # those that slide to the end
        found = world.impacts(contacts.hertz_mindlin(SHORTEST), np.cos(psi), np.sin(psi), k=k)
        for law in laws:
            slip, _ = contacts.after(law, found)
            text = (
                f"g_t' / g_t of {shape} while contacts slide, up to 80 degrees, against {law.name_in_cases}"
            )
            source = "impacts by ifrdem's laws at the same e_n, mu and k"
            result.all_near(text, found.h_t / found.g_t, slip / found.g_t, 3e-3, reason, source)
        # m_n / m_t is 3 of disks and 7/2 of spheres: the comparison would see the other one.
        for other in {*SHAPES} - {shape}:
            ratio = 1.0 + SHAPES[other]
            theirs = 1.0 - ratio * MU * (1.0 + contacts.E_N) * found.g_n / found.g_t
            result.at_least(
                f"distance of g_t' / g_t of {shape} from that of {other}", np.abs(found.h_t / found.g_t - theirs).min(),
                0.03, "guards the comparison itself: `disc` of `fix nve/sphere` makes I = m R^2 / 2", "momentum balance",
            )  # fmt: skip


def _sticking(result: Result) -> None:
    """Impacts that stick: a law with the e_t* of LAMMPS gives its slip and spins, if its m_t and I are right.

    P_t = (1 + e_t*) m_t g_t, with beta_0 = e_t* in Walton's law and e_t = e_t* - 1 in the IFR law (contact point).
    """
    psi = np.radians(STICKING)
    for shape, k in SHAPES.items():
        found = world.impacts(contacts.hertz_mindlin(SHORTEST), np.cos(psi), np.sin(psi), 0.5, k=k)
        for name, law_of in (
            ("walton", lambda e_t: Walton(e_n=contacts.E_N, beta_0=e_t, mu=1.0)),
            ("ifr", lambda e_t: IFRLaw(e_n=contacts.E_N, e_t=e_t - 1.0, mu=1.0, sticking="contact_point")),
        ):
            ours = np.array(
                [
                    contacts.after(law_of(float(e_t)), one)
                    for e_t, one in zip(found.e_t, found.each(), strict=True)
                ]
            )
            theirs = np.stack((found.h_t, found.spins_after), axis=-1)
            text = (
                f"slip and spins over g_t of {shape} after contacts stick, 20 to 35 degrees, against {name}"
            )
            result.all_near(
                text, theirs / found.g_t[:, None], ours / found.g_t[:, None], 1e-4,
                "overlap turns the line of centres: seen 1e-5", "ifrdem.collide by the law with the e_t* of LAMMPS",
            )  # fmt: skip


def _viscoelastic(result: Result) -> None:
    ours = contacts.law_of(contacts.viscoelastic(OVERLAP))
    expected = np.array([ours.restitution(float(g_n), mass=1.0, radius=0.5) for g_n in SPEEDS])
    one, other = (
        world.impacts(contacts.viscoelastic(OVERLAP, limit=limit), SPEEDS, 1e-4 * SPEEDS, steps=200).e_n
        for limit in (True, False)
    )
    source = "laws.Viscoelastic with Y = E / (1 - nu^2), A = eta m_n / Y: nothing is fitted"
    text = f"e_n of `damping viscoelastic limit_damping`, g_n {SPEEDS[0]:g} to {SPEEDS[-1]:g}"
    result.all_near(text, one, expected, 2e-4, "the approximant of the law: seen 1e-4", source)
    for name, less, bound in (
        ("least", (expected - other).min(), LOSS[0]),
        ("most", (expected - other).max(), LOSS[1]),
    ):
        sign = 1.0 if name == "least" else -1.0
        result.at_least(
            f"{'' if sign > 0 else 'minus '}what e_n is lower by without limit_damping, {name}", sign * less, sign * bound,
            "an expected difference: the contact then pulls at its end", source,
        )  # fmt: skip


def _scaling(result: Result) -> None:
    psi = np.radians([5.0, 15.0, 25.0, 35.0, 45.0, 60.0])
    speed, share = (each[..., None] for each in np.meshgrid([0.3, 1.0, 3.0], [0.0, 0.5, 1.0], indexing="ij"))
    g_n, g_t = speed * np.cos(psi), speed * np.sin(psi)
    found = world.impacts(
        contacts.hertz_mindlin(OVERLAP), *(each.ravel() for each in np.broadcast_arrays(g_n, g_t, share))
    )  # fmt: skip
    e_t = found.e_t.reshape(9, len(psi))
    result.all_near(
        "e_t* at six angles, speeds 0.3, 1, 3, by centres or spins", e_t, e_t.mean(axis=0), 5e-3,
        "Hertz's contact has no scale of speed; seen 3e-3", "their mean: what allows a table",
    )  # fmt: skip


def _fits(result: Result, found: dict[str, CollisionLaw]) -> None:
    all_ = contacts.impacts_of_gas(contacts.hertz_mindlin(OVERLAP))
    P_t = all_.ratio * M_N * (all_.g_n - all_.h_n)

    def loss(impulse: Array) -> float:
        """Energy that tangential impulses take."""
        return float(np.sum(impulse * (all_.g_t - 0.5 * impulse / M_T)))

    for name, coefficient, expected in (
        (contacts.WALTON, "beta_0", _by_definition(all_, P_t, walton=True)),
        (contacts.CONTACT_POINT, "e_t", _by_definition(all_, P_t, walton=False)),
    ):
        result.near(
            f"{coefficient} of {name}, fitted to impacts of a gas", getattr(found[name], coefficient), expected, 1e-3,
            "convergence of least squares", "the definition of the law, fitted to the same impacts",
        )  # fmt: skip

    lines: list[tuple[str | float, ...]] = []
    table = contacts.tabulated(OVERLAP)
    for name, law in {contacts.TABLE: table, **found}.items():
        ours = contacts.tangential(law, np.array(law.table_row()), all_.g_n, all_.g_t)
        off = math.sqrt(float(np.sum((ours - P_t) ** 2) / np.sum(P_t**2)))
        what = f"{len(table.slip)} points" if name == contacts.TABLE else contacts.named(law)
        lines.append((name, what, f"{100.0 * off:.1f}", f"{100.0 * (loss(ours) / loss(P_t) - 1.0):+.1f}"))
        if name == contacts.TABLE:
            text = "energy that P_t takes in impacts of a gas, of the table over Hertz-Mindlin"
            reason = "the table is linear between its points; overlaps of other speeds"
            result.near(text, loss(ours) / loss(P_t), 1.0, 0.01, reason, "impacts of LAMMPS")
    result.table(
        "Laws fitted to Hertz-Mindlin impacts of a gas with T = T_rot", ("law", "coefficients", "rms error of P_t (%)",
        "energy that P_t takes, less that of Hertz-Mindlin (%)"), lines,
        f"{len(all_.g_n)} impacts, e_n = {contacts.E_N}, mu = {MU}, Poisson's ratio {world.NU}; least squares of P_t.",
    )  # fmt: skip


def _coefficients(result: Result) -> None:
    """beta_0 of Walton's law by Poisson's ratio and friction, and by Poisson's ratio and restitution."""
    for name, of, fixed in (("mu", FRICTION, f"e_n = {contacts.E_N}"), ("e_n", RESTITUTION, f"mu = {MU}")):
        lines: list[tuple[str | float, ...]] = []
        for nu in POISSON:
            line: list[str | float] = [f"{nu:g}"]
            for value in of:
                contact = contacts.hertz_mindlin(OVERLAP)._replace(nu=nu)
                contact = contact._replace(mu=value) if name == "mu" else contact._replace(eta=value)
                law = contacts.fitted(contact, (contacts.WALTON,), IMPACTS)[contacts.WALTON]
                assert isinstance(law, Walton)
                line.append(f"{law.beta_0:.2f}")
            lines.append(tuple(line))
        result.table(
            f"beta_0 of Walton's law for Hertz-Mindlin contacts of disks, {fixed}", ("nu", *(f"{name} = {one:g}" for one in of)),
            lines, f"Fitted to {IMPACTS} impacts of a gas with T = T_rot; least squares of P_t.",
        )  # fmt: skip


def _by_definition(impacts: world.SingleImpacts, P_t: Array, *, walton: bool) -> float:
    """beta_0 of Walton's law, or e_t of the IFR law with contact-point sticking, by least squares of their impulses.

    |P_t| = min(mu P_n, (1 + beta_0) m_t |g_t|), or (1 + e_t) m_t |g_t| + min(mu P_n, m_t |g_t|).
    """
    from scipy.optimize import least_squares

    P_n, stop = M_N * (impacts.g_n - impacts.h_n), M_T * np.abs(impacts.g_t)

    def off(values: Array) -> Array:
        one, mu = values
        each = (
            np.minimum(mu * P_n, (1.0 + one) * stop)
            if walton
            else (1.0 + one) * stop + np.minimum(mu * P_n, stop)
        )
        return np.asarray(each - np.abs(P_t) * np.sign(P_t * impacts.g_t))

    return float(least_squares(off, (0.0 if walton else -0.8, MU), diff_step=1e-6).x[0])


def _figure(found: dict[str, CollisionLaw]) -> Picture:
    figure, (axes,) = style.panels(width=4.4, height=3.2)
    table = contacts.tabulated(OVERLAP)
    psi = np.degrees(np.arctan(table.slip))
    factor = M_N * (1.0 + contacts.E_N) / M_T
    axes.plot(psi, factor * table.ratio / table.slip - 1.0, "k.", ms=4, label="LAMMPS, Hertz-Mindlin")
    fine = np.radians(np.linspace(0.5, 80.0, 400))
    sliding = fine[fine > np.radians(contacts.LAST)]
    axes.plot(np.degrees(sliding), factor * MU / np.tan(sliding) - 1.0, color="k", lw=0.6)
    for name, law in found.items():
        P_t = contacts.tangential(law, np.array(law.table_row()), np.cos(fine), np.sin(fine))
        e_t = P_t / (M_T * np.sin(fine)) - 1.0
        axes.plot(np.degrees(fine), e_t, label=f"{name}: {contacts.named(law)}", **dashes(COLOURS[name]))
    axes.axhline(0.0, color=style.GREY, lw=0.6)
    axes.set(xlabel=r"angle of incidence, $\arctan(|g_t| / g_n)$ (degrees)", ylabel=r"$e_t^* = -g_t' / g_t$",
             xlim=(0.0, 80.0))  # fmt: skip
    axes.legend(loc="lower left", fontsize=7)
    caption = (
        "Apparent tangential restitution of Hertz-Mindlin contacts in LAMMPS, the same at all speeds, and of laws that "
        "were fitted to impacts of a gas. The sticking of the IFR law has no free coefficient: e_t + 3/2 or e_t + 1."
    )
    return Picture("lammps-impacts", caption, figure)
