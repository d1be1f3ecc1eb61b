"""Pairs after their collision by the paper's closed forms, for comparison with `pairs.fly`.

The equations stand in `equations.py`; here the regime is chosen (the smaller friction impulse acts), and what the
paper leaves out is derived.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import equations
from .equations import CLOSURES, Impact
from .pairs import After


def slides(c: Impact, sticking: str) -> NDArray[np.bool_]:
    """True for an impact that slides: Eq. 9's impulse is smaller than that of Eq. 12 or Eq. 15."""
    return np.asarray(equations.SLIDING.P_f(c) < CLOSURES[sticking].P_f(c))


def after(c: Impact, sticking: str, w_2o: ArrayLike = 0.0) -> After:
    """The pair after the impact, without rolling friction; arguments as in `pairs.fly`.

    With two spins and any sign of the slip (the paper has one spin and V_ot > 0). All impulses depend on the
    tangential motion by the slip alone, V_ot = v_o sin(psi) + R_1 omega_o - R_2 omega_2o. So the pair has the
    impulses of one whose disk 2 does not spin and whose disk 1 has the spin omega_o - R_2 omega_2o / R_1; only
    the spins themselves start from elsewhere. A negative slip is the mirror image of a positive one.
    """
    shape = np.broadcast_shapes(np.shape(c.psi), np.shape(c.M), np.shape(c.e_n), np.shape(w_2o))
    c = Impact(**{name: np.broadcast_to(value, shape).astype(float) for name, value in vars(c).items()})
    w_2o = np.broadcast_to(np.asarray(w_2o, dtype=float), shape)
    one = replace(c, w_o=c.w_o - c.R_2 * w_2o / c.R_1)
    sign = np.where(one.V_ot < 0.0, -1.0, 1.0)
    one = replace(one, psi=sign * one.psi, w_o=sign * one.w_o)
    slide, stick = slides(one, sticking), CLOSURES[sticking]
    P_t = sign * (equations.P_et(one) + np.where(slide, equations.SLIDING.P_f(one), stick.P_f(one)))
    return After(
        impact=c,
        w_2o=w_2o,
        v_1n=equations.v_1n(one),
        v_1t=sign * np.where(slide, equations.SLIDING.v_1t(one), stick.v_1t(one)),
        v_2n=equations.v_2n(one),
        v_2t=sign * np.where(slide, equations.SLIDING.v_2t(one), stick.v_2t(one)),
        Rw_1=c.R_1 * c.w_o - c.k_1 * P_t / c.m_1,  # Eq. 3 with I = m R^2 / k
        Rw_2=c.R_2 * w_2o + c.k_2 * P_t * c.M / c.m_1,
    )
