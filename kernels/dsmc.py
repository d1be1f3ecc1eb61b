"""Direct simulation Monte Carlo of a homogeneous gas: random pairs collide, at the rate at which they would meet.

Candidates c = 0, 1, 2, ... of a batch are pairs drawn in order. A candidate is resolved when no earlier unresolved one
has a disk of it. So the result is that of resolving them one by one, for any number of threads. Random numbers are
drawn by counter (`random.py`), for candidate c of a batch. See `ifrdem.simulation.dsmc`.
"""

import math

from .columns import BODY, DSMC_TABLES
from .laws.contact import collided
from .laws.law import reduced_radius
from .compiler.language import spread_of_loops, ti
from .compiler.records import NamedVector
from .layout import BLOCK
from .random import DRAWS, library_normals, unit, words
from .compiler.signature import Arrays, kernel

NONE = 1 << 30  # later than any candidate
# In streams of random numbers, indices that no force has
PAIRS, KICKS = 0xFFFD * DRAWS, 0xFFFE * DRAWS


@ti.func
def stream_of(item, index: ti.template(), gas: ti.template()):
    """The stream of random numbers of a candidate or disk (`random.py`)."""
    return ti.Vector([
        ti.cast(item, ti.u32), gas.key.number_low, gas.key.number_high, ti.u32(index), gas.key.seed_low,
        gas.key.seed_high,
    ], ti.u32)  # fmt: skip


@kernel
def prepare(
    gas: Arrays("uses disk before hits hits_before first fastest transfer transfer_before", DSMC_TABLES),
):
    """Keep the state before a batch, and find the square of the highest speed."""
    for _ in range(1):
        gas.fastest[0] = 0.0
    for d in range(gas.disk.shape[0]):
        gas.before[d] = ti.Vector([gas.disk[d].vx, gas.disk[d].vy, gas.disk[d].spin])
        gas.hits_before[d] = gas.hits[d]
        gas.first[d] = NONE
        if ti.static(gas.uses.stress):
            gas.transfer_before[d] = gas.transfer[d]
        speed2 = gas.disk[d].vx * gas.disk[d].vx + gas.disk[d].vy * gas.disk[d].vy
        if speed2 > gas.fastest[0]:
            ti.atomic_max(gas.fastest[0], speed2)


@kernel
def restore(gas: Arrays("uses disk before hits hits_before first transfer transfer_before", DSMC_TABLES)):
    """Return to the state before the batch."""
    for d in range(gas.disk.shape[0]):
        for j in ti.static(range(3)):
            gas.disk[d][j] = gas.before[d][j]
        gas.hits[d] = gas.hits_before[d]
        gas.first[d] = NONE
        if ti.static(gas.uses.stress):
            gas.transfer[d] = gas.transfer_before[d]


@kernel
def draw(count: ti.i32, gas: Arrays("disk pair todo key", DSMC_TABLES)):
    """Draw the pairs of `count` candidates, each of all ordered pairs with the same probability."""
    for c in range(count):
        n = gas.disk.shape[0]
        w = words(stream_of(c, PAIRS, gas), 0)
        # 1 - (0, 1] is [0, 1); rounding can give n.
        i = ti.min(ti.cast((1.0 - unit(w[0], w[1])) * n, ti.i32), n - 1)
        j = ti.min(ti.cast((1.0 - unit(w[2], w[3])) * (n - 1), ti.i32), n - 2)
        if j >= i:
            j += 1
        gas.pair[c] = ti.Vector([i, j])
        gas.todo[0, c] = c


@ti.func
def meet(c, i, j, gas: ti.template()):
    """Collide the pair (i, j) of candidate c, with its probability and a random direction of contact.

    Of all directions n in which j may lie, the rate of collisions is proportional to g_n > 0, g = v_i - v_j: the sine
    of the angle between n and g is uniform, and the rate of all together 2 g_ij sigma_ij |g| / area. In a mean flow,
    in which j is faster along x by the shear rate times sigma_ij n_y, any n is as probable, and g_n counts.
    """
    of_i, of_j = gas.disk[i].vector, gas.disk[j].vector
    a, b = NamedVector(of_i, BODY), NamedVector(of_j, BODY)
    gx, gy = a.vx - b.vx, a.vy - b.vy
    speed = ti.sqrt(gx * gx + gy * gy)
    section = gas.contact_value.one * (a.radius + b.radius) + gas.contact_value.two * a.radius * b.radius
    w = words(stream_of(c, PAIRS, gas), 1)
    n_x, n_y, vx_j, ahead = gx, gy, b.vx, 0.0 * gx
    hit = False
    if ti.static(gas.uses.shear):
        angle = ti.cast(2.0 * math.pi * unit(w[2], w[3]), float)
        n_x, n_y = ti.cos(angle), ti.sin(angle)
        ahead = gas.contact_value.shear_rate * (a.radius + b.radius) * n_y
        vx_j += ahead
        g_n = (gx - ahead) * n_x + gy * n_y
        hit = unit(w[0], w[1]) * gas.contact_value.majorant <= math.pi * section * g_n
    else:
        hit = unit(w[0], w[1]) * gas.contact_value.majorant <= section * speed and speed > 0.0
    if hit:
        if ti.static(not gas.uses.shear):
            sine = ti.cast(2.0 * unit(w[2], w[3]) - 1.0, float)
            cosine = ti.sqrt(ti.max(1.0 - sine * sine, 0.0))
            n_x, n_y = (gx * cosine - gy * sine) / speed, (gy * cosine + gx * sine) / speed
        new, _regime, _lost = collided(
            ti.cast(a.material, ti.i32), ti.cast(b.material, ti.i32), n_x, n_y,
            a.inverse_mass, a.radius, a.k, a.vx, a.vy, a.spin,
            b.inverse_mass, b.radius, b.k, vx_j, b.vy, b.spin, reduced_radius(a.radius, b.radius), 0, gas,
        )  # fmt: skip
        if ti.static(gas.uses.shear):
            new.vx_j -= ahead
        if ti.static(gas.uses.stress):
            along = ti.cast(-(a.radius + b.radius) / a.inverse_mass, ti.f64)
            x, y = along * ti.cast(new.vx_i - a.vx, ti.f64), along * ti.cast(new.vy_i - a.vy, ti.f64)
            gas.transfer[i] += ti.Vector([x * n_x, x * n_y, y * n_x, y * n_y], ti.f64)
        gas.disk[i].vx, gas.disk[i].vy, gas.disk[i].spin = new.vx_i, new.vy_i, new.w_i
        gas.disk[j].vx, gas.disk[j].vy, gas.disk[j].spin = new.vx_j, new.vy_j, new.w_j
        gas.hits[i] += 1
        gas.hits[j] += 1
        ti.atomic_add(gas.counter.collisions, 1)
        if (
            ti.max(new.vx_i * new.vx_i + new.vy_i * new.vy_i, new.vx_j * new.vx_j + new.vy_j * new.vy_j)
            > gas.contact_value.cap
        ):
            ti.atomic_min(gas.counter.cut, c)


@kernel
def resolve_pairs(
    now: ti.i32,
    gas: Arrays("uses disk hits first pair todo counter law scale contact_value key transfer", DSMC_TABLES),
):
    """Resolve the open candidates of list `now` that are the first of both their disks; list the others again."""
    for e in range(gas.counter[now]):
        c = gas.todo[now, e]
        ti.atomic_min(gas.first[gas.pair[c][0]], c)
        ti.atomic_min(gas.first[gas.pair[c][1]], c)
    for _ in range(1):
        gas.counter[1 - now] = 0
    for e in range(gas.counter[now]):
        c = gas.todo[now, e]
        i, j = gas.pair[c][0], gas.pair[c][1]
        if gas.first[i] == c and gas.first[j] == c:
            meet(c, i, j, gas)
            # No other candidate is c: that another thread may see this too early changes nothing for it.
            gas.first[i] = NONE
            gas.first[j] = NONE
        else:
            gas.todo[1 - now, ti.atomic_add(gas.counter[1 - now], 1)] = c


@kernel
def resolve_pairs_serially(
    count: ti.i32,
    gas: Arrays("uses disk hits pair counter law scale contact_value key transfer", DSMC_TABLES),
):
    """Resolve all candidates one after the other, which is fastest on one thread and gives the same bits."""
    for _ in range(1):
        for c in range(count):
            meet(c, gas.pair[c][0], gas.pair[c][1], gas)


@kernel
def strain(gas: Arrays("disk factors gains", DSMC_TABLES)):
    """Velocities relative to a mean flow after a time in it; sums of the energy that they get, by blocks of disks."""
    apart = ti.static(spread_of_loops())
    for item in range(apart * ((gas.disk.shape[0] + BLOCK - 1) // BLOCK)):
        if item % apart == 0:
            b = item // apart
            gain = ti.cast(0.0, ti.f64)
            for d in range(b * BLOCK, ti.min(gas.disk.shape[0], (b + 1) * BLOCK)):
                body = gas.disk[d]
                vx = body.vx - ti.cast(gas.factors.strain, float) * body.vy
                gain += 0.5 * ti.cast((vx - body.vx) * (vx + body.vx) / body.inverse_mass, ti.f64)
                body.vx = vx
            gas.gains[b] = gain


@kernel
def kick(only: ti.i32, gas: Arrays("disk group key factors gains", DSMC_TABLES)):
    """Linear friction and noise on every disk of a group over a time; sums of the energy that they give, by blocks."""
    apart = ti.static(spread_of_loops())
    for item in range(apart * ((gas.disk.shape[0] + BLOCK - 1) // BLOCK)):
        if item % apart == 0:
            b = item // apart
            gain = ti.cast(0.0, ti.f64)
            for d in range(b * BLOCK, ti.min(gas.disk.shape[0], (b + 1) * BLOCK)):
                if gas.group[d] != only:
                    continue
                body = gas.disk[d]
                stream = stream_of(d, KICKS, gas)
                along, turn = library_normals(stream, 0), library_normals(stream, 1)
                mass = 1.0 / body.inverse_mass
                inertia = mass * body.radius * body.radius / body.k
                spread = ti.sqrt(ti.cast(gas.factors.energy, float) / mass)
                vx = ti.cast(gas.factors.velocity, float) * body.vx + spread * along[0]
                vy = ti.cast(gas.factors.velocity, float) * body.vy + spread * along[1]
                spin = ti.cast(gas.factors.spin, float) * body.spin
                spin += ti.sqrt(2.0 * ti.cast(gas.factors.spin_energy, float) / inertia) * turn[0]
                gain += 0.5 * ti.cast(
                    mass * ((vx - body.vx) * (vx + body.vx) + (vy - body.vy) * (vy + body.vy))
                    + inertia * (spin - body.spin) * (spin + body.spin), ti.f64,
                )  # fmt: skip
                body.vx, body.vy, body.spin = vx, vy, spin
            gas.gains[b] = gain
