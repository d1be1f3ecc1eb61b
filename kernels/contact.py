"""The law at a contact: which coefficients hold there."""

import taichi as ti

from .layout import CUTOFF

SLOW = 4  # in REGIME: the collision was elastic because it was slow


@ti.func
def coefficients(p, q, g_n, gas: ti.template()):
    """e_n, e_t, mu, contact_point and rho of materials p and q for an approach at g_n; and SLOW or 0.

    Below the cut-off, disks collide like smooth elastic ones: a bounce is not followed by ever smaller ones in a
    finite time.
    """
    e_n, e_t, mu = gas.law[p, q, 0], gas.law[p, q, 1], gas.law[p, q, 2]
    contact_point, rho = gas.law[p, q, 3], gas.law[p, q, 4]
    slow = 0
    if g_n < gas.scale[CUTOFF]:
        e_n = 1.0
        e_t = -1.0
        mu = 0.0
        rho = 0.0
        slow = SLOW
    return e_n, e_t, mu, contact_point, rho, slow
