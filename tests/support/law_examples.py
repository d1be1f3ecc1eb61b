"""Custom collision laws."""

from __future__ import annotations

from ifrdem.kernels.compiler.language import ti
from ifrdem.kernels.laws.law import ifr_impulses
from ifrdem.model.laws.law import CollisionLaw


class Viscoelastic(CollisionLaw):
    """The manual's, which the kernel cache then has: e_n = 1 - c g_n^(1/5); with c = 0 it is an IFR law."""

    coefficients = ("c", "e_t", "mu")

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        e_n = ti.max(1.0 - law.c * pair.g_n**0.2, 0.0)
        P_n, P_t, T, _, _, _ = ifr_impulses(
            e_n, law.e_t, law.mu, 1.0, 0.0,
            pair.g_n, pair.g_t, pair.m_n, pair.m_t, pair.radius_i, pair.radius_j,
        )  # fmt: skip
        return P_n, P_t, T


class Weak(CollisionLaw):
    """P_n = part m_n g_n: with less than 1, disks go through each other."""

    coefficients = ("part",)

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        return law.part * pair.m_n * pair.g_n, 0.0, 0.0


class Driving(CollisionLaw):
    """Smooth disks with e_n = 1/2 and a torque that drives spins instead of braking them."""

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        return 1.5 * pair.m_n * pair.g_n, 0.0, -0.01 * pair.m_n * pair.g_n


class Half(CollisionLaw):
    """Smooth disks with e_n = 1/2; no coefficients."""

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        return 1.5 * pair.m_n * pair.g_n, 0.0, 0.0


class Short(CollisionLaw):
    """Returns too little."""

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        return 1.5 * pair.m_n * pair.g_n, 0.0


class Misnamed(CollisionLaw):
    """Reads a coefficient that it does not have."""

    coefficients = ("e_n",)

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        return (1.0 + law.e_N) * pair.m_n * pair.g_n, 0.0, 0.0


class Numbered(CollisionLaw):
    """Reads a coefficient by a number."""

    coefficients = ("e_n",)

    @staticmethod
    def collide(pair, law):  # type: ignore[no-untyped-def]
        return (1.0 + law[1]) * pair.m_n * pair.g_n, 0.0, 0.0


class Silent(CollisionLaw):
    """Says nothing of impulses."""
