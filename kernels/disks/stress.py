"""Momentum that collisions transfer: the collisional part of the pressure tensor.

    P_ab A = sum m V_a V_b + (1 / dt) sum_c (dp_i)_a (r_i - r_j)_b

dp_i is the momentum that disk i gains in a collision c, r_i - r_j the vector to its centre from that of its partner j,
or from the contact point on a wall; V is the velocity relative to the flow of a sheared box. P is positive in
compression: disks that repel each other have dp_i along r_i - r_j. P_ab is the flux of momentum along a through a line
with its normal along b. Tangential impulses make P_xy and P_yx of rough disks differ at a moment: what they differ by
turns the spins.

C. S. Campbell and A. Gong, J. Fluid Mech. 164, 107 (1986), doi:10.1017/S0022112086002495.
"""

from ..columns import TALLY, VIRIAL
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
