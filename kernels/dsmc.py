"""Direct simulation Monte Carlo of a homogeneous gas: random pairs collide, at the rate at which they would meet.

Candidates c = 0, 1, 2, ... of a batch are pairs drawn in order. Each is settled when neither of its disks is in an
earlier one that is not: what comes out is that of settling them one by one, for any number of threads. What decides it
is drawn by counter (`random.py`), for candidate c of a batch. See `ifrdem.simulation.dsmc`.
"""

from .contact import collided
from .language import Cube, Rows, Table, spread_of_loops, ti
from .layout import BLOCK, gas_of
from .random import DRAWS, normals, unit, words

# A disk's record
VX, VY, SPIN, INVERSE_MASS, RADIUS, K, MATERIAL = range(7)
RECORD = 7
# `counter`: candidates to settle, in either list by turns; collisions; the first candidate that made a disk too fast
OPEN, COLLISIONS, CUT = 0, 2, 3
# `key`, of random numbers: number of the batch or of the kick (low, high word), seed (low, high word)
NUMBER_LOW, NUMBER_HIGH, SEED_LOW, SEED_HIGH = range(4)
# `crowding`: the two numbers of contact values (`contact.crowding_of_mixture`); the largest g_ij sigma_ij |v_i -
# v_j| that may come; the square of the highest speed for which that holds
FIRST, SECOND, MAJORANT, CAP = range(4)
NONE = 1 << 30  # later than any candidate
# In streams of random numbers, indices that no force has
PAIRS, KICKS = 0xFFFD * DRAWS, 0xFFFE * DRAWS


@ti.func
def stream_of(item, place: ti.template(), key: ti.template()):
    """The stream of random numbers of a candidate or disk (`random.py`)."""
    return ti.Vector([
        ti.cast(item, ti.u32), key[NUMBER_LOW], key[NUMBER_HIGH], ti.u32(place), key[SEED_LOW], key[SEED_HIGH],
    ], ti.u32)  # fmt: skip


@ti.kernel
def prepare(disk: Rows, before: Rows, hits: Rows, hits_before: Rows, first: Rows, fastest: Rows):
    """Keep the state before a batch, and find the square of the highest speed."""
    for _ in range(1):
        fastest[0] = 0.0
    for d in range(disk.shape[0]):
        before[d] = ti.Vector([disk[d][VX], disk[d][VY], disk[d][SPIN]])
        hits_before[d] = hits[d]
        first[d] = NONE
        speed2 = disk[d][VX] * disk[d][VX] + disk[d][VY] * disk[d][VY]
        if speed2 > fastest[0]:
            ti.atomic_max(fastest[0], speed2)


@ti.kernel
def restore(disk: Rows, before: Rows, hits: Rows, hits_before: Rows, first: Rows):
    """Back to the state before the batch."""
    for d in range(disk.shape[0]):
        for j in ti.static(range(3)):
            disk[d][j] = before[d][j]
        hits[d] = hits_before[d]
        first[d] = NONE


@ti.kernel
def draw(count: ti.i32, disk: Rows, pair: Rows, todo: Table, key: Rows):
    """Draw the pairs of `count` candidates, each of all ordered pairs with the same probability."""
    for c in range(count):
        n = disk.shape[0]
        w = words(stream_of(c, PAIRS, key), 0)
        # 1 - (0, 1] is [0, 1); rounding can give n.
        i = ti.min(ti.cast((1.0 - unit(w[0], w[1])) * n, ti.i32), n - 1)
        j = ti.min(ti.cast((1.0 - unit(w[2], w[3])) * (n - 1), ti.i32), n - 2)
        if j >= i:
            j += 1
        pair[c] = ti.Vector([i, j])
        todo[0, c] = c


@ti.func
def meet(c, i, j, disk: ti.template(), hits: ti.template(), crowding: ti.template(), key: ti.template(),
         counter: ti.template(), gas: ti.template()):  # fmt: skip
    """Collide the pair (i, j) of candidate c, with the probability that belongs to it, at a random place.

    Of all directions n in which j may lie, the rate of collisions is proportional to g_n > 0, g = v_i - v_j: the sine
    of the angle between n and g is uniform, and the rate of all together 2 g_ij sigma_ij |g| / area.
    """
    a, b = disk[i], disk[j]
    gx, gy = a[VX] - b[VX], a[VY] - b[VY]
    speed = ti.sqrt(gx * gx + gy * gy)
    section = crowding[FIRST] * (a[RADIUS] + b[RADIUS]) + crowding[SECOND] * a[RADIUS] * b[RADIUS]
    w = words(stream_of(c, PAIRS, key), 1)
    if unit(w[0], w[1]) * crowding[MAJORANT] <= section * speed and speed > 0.0:
        sine = ti.cast(2.0 * unit(w[2], w[3]) - 1.0, float)
        cosine = ti.sqrt(ti.max(1.0 - sine * sine, 0.0))
        n_x, n_y = (gx * cosine - gy * sine) / speed, (gy * cosine + gx * sine) / speed
        vx_i, vy_i, w_i, vx_j, vy_j, w_j, _how, _lost = collided(
            ti.cast(a[MATERIAL], ti.i32), ti.cast(b[MATERIAL], ti.i32), n_x, n_y,
            a[INVERSE_MASS], a[RADIUS], a[K], a[VX], a[VY], a[SPIN],
            b[INVERSE_MASS], b[RADIUS], b[K], b[VX], b[VY], b[SPIN], 0, gas,
        )  # fmt: skip
        disk[i][VX], disk[i][VY], disk[i][SPIN] = vx_i, vy_i, w_i
        disk[j][VX], disk[j][VY], disk[j][SPIN] = vx_j, vy_j, w_j
        hits[i] += 1
        hits[j] += 1
        ti.atomic_add(counter[COLLISIONS], 1)
        if ti.max(vx_i * vx_i + vy_i * vy_i, vx_j * vx_j + vy_j * vy_j) > crowding[CAP]:
            ti.atomic_min(counter[CUT], c)


@ti.kernel
def settle(
    uses: ti.template(), now: ti.i32, disk: Rows, hits: Rows, first: Rows, pair: Rows, todo: Table, counter: Rows,
    law: Cube, scale: Rows, crowding: Rows, key: Rows,
):  # fmt: skip
    """Settle those of the open candidates, list `now`, that are the first of both their disks; list the others anew."""
    gas = ti.static(gas_of(law=law, scale=scale, uses=uses))
    for e in range(counter[now]):
        c = todo[now, e]
        ti.atomic_min(first[pair[c][0]], c)
        ti.atomic_min(first[pair[c][1]], c)
    for _ in range(1):
        counter[1 - now] = 0
    for e in range(counter[now]):
        c = todo[now, e]
        i, j = pair[c][0], pair[c][1]
        if first[i] == c and first[j] == c:
            meet(c, i, j, disk, hits, crowding, key, counter, gas)
            # No other candidate is c: that another thread may see this too early changes nothing for it.
            first[i] = NONE
            first[j] = NONE
        else:
            todo[1 - now, ti.atomic_add(counter[1 - now], 1)] = c


@ti.kernel
def settle_in_order(
    uses: ti.template(), count: ti.i32, disk: Rows, hits: Rows, pair: Rows, counter: Rows,
    law: Cube, scale: Rows, crowding: Rows, key: Rows,
):  # fmt: skip
    """Settle all candidates one after the other: what one thread does fastest, to the same last bit."""
    gas = ti.static(gas_of(law=law, scale=scale, uses=uses))
    for _ in range(1):
        for c in range(count):
            meet(c, pair[c][0], pair[c][1], disk, hits, crowding, key, counter, gas)


@ti.kernel
def kick(disk: Rows, key: Rows, factors: Rows, gains: Rows):
    """Linear friction and noise on every disk over a time; sums of the energy that they give, by blocks of disks.

    `factors`: what is left of a velocity and of a spin; energy that noise gives to the motion and to the spin.
    """
    apart = ti.static(spread_of_loops())
    for item in range(apart * ((disk.shape[0] + BLOCK - 1) // BLOCK)):
        if item % apart == 0:
            b = item // apart
            gain = ti.cast(0.0, ti.f64)
            for d in range(b * BLOCK, ti.min(disk.shape[0], (b + 1) * BLOCK)):
                stream = stream_of(d, KICKS, key)
                along, turn = normals(stream, 0), normals(stream, 1)
                mass = 1.0 / disk[d][INVERSE_MASS]
                inertia = mass * disk[d][RADIUS] * disk[d][RADIUS] / disk[d][K]
                spread = ti.sqrt(ti.cast(factors[2], float) / mass)
                vx = ti.cast(factors[0], float) * disk[d][VX] + spread * along[0]
                vy = ti.cast(factors[0], float) * disk[d][VY] + spread * along[1]
                spin = ti.cast(factors[1], float) * disk[d][SPIN]
                spin += ti.sqrt(2.0 * ti.cast(factors[3], float) / inertia) * turn[0]
                gain += 0.5 * ti.cast(
                    mass * ((vx - disk[d][VX]) * (vx + disk[d][VX]) + (vy - disk[d][VY]) * (vy + disk[d][VY]))
                    + inertia * (spin - disk[d][SPIN]) * (spin + disk[d][SPIN]), ti.f64,
                )  # fmt: skip
                disk[d][VX], disk[d][VY], disk[d][SPIN] = vx, vy, spin
            gains[b] = gain
