"""Collision laws of one's own."""

from __future__ import annotations

import taichi as ti

from ifrdem.collision_law import CollisionLaw
from ifrdem.kernels.law import ifr_impulses


class Viscoelastic(CollisionLaw):
    """The IFR law with e_n = e - c g_n^(1/5); with c = 0 it is the IFR law itself."""

    coefficients = ("e", "c", "e_t", "mu", "contact_point", "rho")

    @staticmethod
    def collide(pair, coefficients):  # type: ignore[no-untyped-def]
        e_n = coefficients[0] - coefficients[1] * ti.pow(pair.g_n, 0.2)
        P_n, P_t, T, _, _ = ifr_impulses(
            e_n, coefficients[2], coefficients[3], coefficients[4], coefficients[5],
            pair.g_n, pair.g_t, pair.m_n, pair.m_t, pair.radius_i, pair.radius_j,
        )  # fmt: skip
        return P_n, P_t, T


class Other(Viscoelastic):
    """Another class with the same coefficients."""


class Silent(CollisionLaw):
    """Says nothing of impulses."""
