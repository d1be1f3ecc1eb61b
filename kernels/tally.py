"""What is kept of an epoch when it ends, before its log is lost: collisions with walls, their energy, latest times,
angles."""

from .history import flight_between, previous, side_of
from .language import ti
from .layout import (
    BEFORE,
    DURATION,
    GX,
    GY,
    HEAD,
    HORIZON,
    ID,
    INVERSE_MASS,
    KIND,
    PREVIOUS,
    RADIUS,
    SLOT,
    SPIN,
    TIME,
    VX,
    VY,
    K,
    N,
)
from .walls import HEAT, wall_met


@ti.func
def note_latest(i, gas: ti.template()):
    """Note when disk i's latest collision was, of those that stand."""
    head = gas.link[i][HEAD]
    if head >= 0:
        gas.latest[gas.meta[i][ID]] = gas.latest[gas.grid[N]] + ti.cast(gas.log_real[head][TIME], ti.f64)


@ti.func
def partner_in(entry, i, gas: ti.template()):
    """Whom disk i hit in a record of its own: an id, or -2 - w for wall w; before the epoch, for no record (-1)."""
    partner = gas.last_partner[gas.meta[i][ID]]
    if entry >= 0:
        other = gas.log_int[entry][SLOT + 1 - side_of(entry, i, gas)]
        partner = other - 1  # wall w is -1 - w in the log
        if other >= 0:
            partner = gas.meta[other][ID]
    return partner


@ti.func
def note_partner(i, gas: ti.template()):
    """Note whom disk i hit last, if anybody in this epoch."""
    gas.last_partner[gas.meta[i][ID]] = partner_in(gas.link[i][HEAD], i, gas)


@ti.func
def turned(i, until, gas: ti.template()):
    """How far disk i turns in the epoch that is over until a time of it [rad]; in double precision."""
    spin = ti.cast(gas.flight[i][SPIN], ti.f64)
    end = ti.cast(until, ti.f64)
    angle = 0.0 * end
    entry = gas.link[i][HEAD]
    while entry >= 0:
        began = ti.cast(gas.log_real[entry][TIME], ti.f64)
        if began < end:
            angle += spin * (end - began)
            end = began
        side = side_of(entry, i, gas)
        spin = ti.cast(gas.log_real[entry][BEFORE + 5 * side + 4], ti.f64)
        entry = gas.log_int[entry][PREVIOUS + side]
    return angle + spin * end


@ti.func
def note_turn(i, gas: ti.template()):
    """Note how far disk i has turned, at the end of the epoch."""
    gas.angle[gas.meta[i][ID]] = gas.angle[gas.meta[i][ID]] + turned(i, gas.scale[DURATION], gas)


@ti.func
def heat_given(i, vx, vy, spin, vx_0, vy_0, spin_0, gas: ti.template()):
    """Kinetic energy after less that before, of disk i with velocities in the wall's frame. In double precision."""
    kind = gas.meta[i][KIND]
    mass = 1.0 / ti.cast(gas.kinds[kind][INVERSE_MASS], ti.f64)
    radius = ti.cast(gas.flight[i][RADIUS], ti.f64)
    inertia = mass * radius * radius / ti.cast(gas.kinds[kind][K], ti.f64)
    # Each difference of squares as a product.
    along_x = ti.cast(vx - vx_0, ti.f64) * ti.cast(vx + vx_0, ti.f64)
    along_y = ti.cast(vy - vy_0, ti.f64) * ti.cast(vy + vy_0, ti.f64)
    turning = ti.cast(spin - spin_0, ti.f64) * ti.cast(spin + spin_0, ti.f64)
    return 0.5 * (mass * (along_x + along_y) + inertia * turning)


@ti.func
def tally_walls(i, gas: ti.template()):
    """Add up disk i's collisions with walls in the epoch that ends, and the energy that they gave, in their order.

    A wall works on what it pushes: the impulse times its own velocity. What a thermal wall gives beyond that is heat,
    the kinetic energy gained in its own frame.
    """
    hits = 0
    work = 0.0 * gas.scale[HORIZON]
    vx, vy, spin = gas.flight[i][VX], gas.flight[i][VY], gas.flight[i][SPIN]
    entry = gas.link[i][HEAD]
    while entry >= 0:
        before = previous(entry, i, gas)
        other = gas.log_int[entry][SLOT + 1]
        spin_0 = gas.log_real[entry][BEFORE + 5 * side_of(entry, i, gas) + 4]
        x, y, vx_0, vy_0, began, t, _number, _second = flight_between(
            i, before, entry, gas.scale[HORIZON], gas
        )
        if other < 0:
            hits += 1
            w = -1 - other
            _nx, _ny, ux, uy = wall_met(i, w, x + vx_0 * (t - began), y + vy_0 * (t - began), t, gas)
            inverse_mass = gas.kinds[gas.meta[i][KIND]][INVERSE_MASS]
            work += ((vx - vx_0) * ux + (vy - vy_0) * uy) / inverse_mass
            if ti.static(gas.uses.thermal):
                column = ti.cast(gas.walls[w][HEAT], ti.i32)
                if column >= 0:
                    heat = heat_given(
                        i, vx + gas.scale[GX] * t - ux, vy + gas.scale[GY] * t - uy, spin,
                        vx_0 + gas.scale[GX] * t - ux, vy_0 + gas.scale[GY] * t - uy, spin_0, gas,
                    )  # fmt: skip
                    gas.wall_heat[gas.meta[i][ID], column] = gas.wall_heat[gas.meta[i][ID], column] + heat
        vx, vy, spin = vx_0, vy_0, spin_0
        entry = before
    if hits > 0:
        gas.wall_hits[gas.meta[i][ID]] = gas.wall_hits[gas.meta[i][ID]] + hits
        gas.wall_work[gas.meta[i][ID]] = gas.wall_work[gas.meta[i][ID]] + work
