"""The law at a contact: which coefficients hold there.

Two remedies for inelastic collapse make collisions elastic:

- a *velocity cut-off*: those whose normal speed of approach is below it;
- the *tc rule*: those of which either partner's latest collision, with a disk or a wall, was less than the contact time
  ago. S. Luding and S. McNamara, Granul. Matter 1, 113 (1998), doi:10.1007/s100350050017.
"""

import taichi as ti

from .layout import CONTACT_TIME, CUTOFF, HEAD, ID, TIME, N

ELASTIC = 4  # in REGIME: the collision was elastic by one of the two


@ti.func
def just_collided(i, t, gas: ti.template()):
    """1 if disk i's latest collision was less than the contact time before time t of the epoch, else 0."""
    head = gas.link[i][HEAD]
    since = ti.cast(t, ti.f64)
    if head >= 0:
        since -= gas.log_real[head][TIME]
    else:
        since += gas.latest[gas.grid[N]] - gas.latest[gas.meta[i][ID]]
    return ti.cast(since < gas.scale[CONTACT_TIME], ti.i32)


@ti.func
def coefficients(p, q, g_n, lasting, gas: ti.template()):
    """e_n, e_t, mu, contact_point and rho of materials p and q for an approach at g_n; and ELASTIC or 0.

    With `lasting` > 0 (the tc rule), or below the cut-off, disks collide like smooth elastic ones: a bounce is not
    followed by ever smaller ones in a finite time.
    """
    e_n, e_t, mu = gas.law[p, q, 0], gas.law[p, q, 1], gas.law[p, q, 2]
    contact_point, rho = gas.law[p, q, 3], gas.law[p, q, 4]
    elastic = g_n < gas.scale[CUTOFF]
    if ti.static(gas.remembers):
        elastic = elastic or lasting > 0
    remedy = 0
    if elastic:
        e_n = 1.0
        e_t = -1.0
        mu = 0.0
        rho = 0.0
        remedy = ELASTIC
    return e_n, e_t, mu, contact_point, rho, remedy
