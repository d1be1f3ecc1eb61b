"""Momentum and energy that collisions transfer: the collisional parts of the pressure tensor and of the heat flux.

    P_ab A = sum m V_a V_b + (1 / dt) sum_c (dp_i)_a (r_i - r_j)_b

dp_i is the momentum that disk i gains in a collision c, r_i - r_j the vector to its centre from that of its partner j,
or from the contact point on a wall; V is the velocity relative to the flow of a sheared box. P is positive in
compression: disks that repel each other have dp_i along r_i - r_j. P_ab is the flux of momentum along a through a line
with its normal along b. Tangential impulses make P_xy and P_yx of rough disks differ at a moment: what they differ by
turns the spins.

C. S. Campbell and A. Gong, J. Fluid Mech. 164, 107 (1986), doi:10.1017/S0022112086002495.

    q_b A = sum e_i V_b + (1 / dt) sum_c sum_i (de_i) (r_i - r_c)_b,    e = (m V^2 + I w^2) / 2

de_i is the energy that a disk gains in a collision, r_i - r_c the vector to its centre from the contact: what a disk
loses runs from its centre to the contact, and from there to the centre of its partner goes what that gains. The rest is
dissipated at the contact. Of elastic disks of one size it is de_i (r_i - r_j), as of J. H. Irving and J. G. Kirkwood,
J. Chem. Phys. 18, 817 (1950), doi:10.1063/1.1747782. Kernels add up energies in the lab; relative to a mean velocity u
they are de_i - u.dp_i, so that the virial is all that is needed besides.
"""

from ..columns import TALLY, TRANSFER, VIRIAL
from ..compiler.language import ti
from .particle import add


@ti.func
def add_virial(tile, mass, dvx, dvy, rx, ry, gas: ti.template()):
    """Add a collision to the virial of a tile: a disk of this mass gained (dvx, dvy) from what is at -(rx, ry)."""
    p_x, p_y = ti.cast(mass, ti.f64) * dvx, ti.cast(mass, ti.f64) * dvy
    add(tile, TALLY.width + VIRIAL.xx, p_x * rx, gas)
    add(tile, TALLY.width + VIRIAL.xy, p_x * ry, gas)
    add(tile, TALLY.width + VIRIAL.yx, p_y * rx, gas)
    add(tile, TALLY.width + VIRIAL.yy, p_y * ry, gas)


@ti.func
def add_virial_of_pair(
    tile, a, b, kind_a, kind_b, dvx_a, dvy_a, dvx_b, dvy_b, rx, ry, gas: ti.template()
):  # fmt: skip
    """Add a collision of the disks in slots a and b, (rx, ry) from a to b, if the tile owns a."""
    if gas.event_info[a].own_rank > 0:
        if gas.kinds[kind_a].inverse_mass > 0.0:
            add_virial(tile, gas.kinds[kind_a].mass, dvx_a, dvy_a, -rx, -ry, gas)
        else:  # a is immovable
            add_virial(tile, gas.kinds[kind_b].mass, dvx_b, dvy_b, rx, ry, gas)


@ti.func
def add_energy(tile, kind, dvx, dvy, dw, vx, vy, w, rx, ry, gas: ti.template()):
    """Add to the transfer of energy of a tile: a disk of this kind, at (rx, ry) from the contact, was struck.

    Changes of its velocity and spin, and the sums of these before and after, in the lab.
    """
    moving = ti.cast(gas.kinds[kind].mass, ti.f64) * (dvx * vx + dvy * vy)
    gained = 0.5 * (moving + ti.cast(gas.kinds[kind].inertia, ti.f64) * dw * w)
    add(tile, TALLY.width + TRANSFER.energy_x, gained * rx, gas)
    add(tile, TALLY.width + TRANSFER.energy_y, gained * ry, gas)


@ti.func
def add_energy_of_pair(
    tile, kind_a, kind_b, t, before: ti.template(), after: ti.template(), rx, ry, r, gas: ti.template()
):  # fmt: skip
    """Add a collision at t of disks of two kinds, (rx, ry) from a to b; before and after: vx, vy, w of a, then of b."""
    for side in ti.static(range(2)):
        kind, sign = kind_a, -1.0
        if ti.static(side == 1):
            kind, sign = kind_b, 1.0
        reach = sign * gas.kinds[kind].radius / r
        change, total = after - before, after + before
        # Velocities of flights are those without what gravity has given in this window.
        fall_x, fall_y = 2.0 * gas.scale.gx * t, 2.0 * gas.scale.gy * t
        add_energy(
            tile, kind, change[3 * side], change[3 * side + 1], change[3 * side + 2],
            total[3 * side] + fall_x, total[3 * side + 1] + fall_y, total[3 * side + 2], reach * rx, reach * ry, gas,
        )  # fmt: skip
