"""Random numbers by counter: the same for the same disk, step and seed, in any order of calls.

Philox4x32-10 turns a counter of four words and a key of two into four random words, without any state: Salmon, Moraes,
Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC '11, doi:10.1145/2063384.2063405.

A *stream* is a vector of six words: id of the disk, number of the force's step (low and high word), 2^16 times the
index of the force, and the seed (low and high word). The first four are the counter, the last two the key; draws
`number` 0 to 65535 of a stream are independent of each other. Thermal walls take the highest index,
and the number of a disk's collisions in place of the step's.
"""

from .compiler.language import ti

# Multipliers, and what is added to the key in each round: golden ratio and sqrt(3) - 1, times 2^32.
MULTIPLY_0, MULTIPLY_1 = 0xD2511F53, 0xCD9E8D57
WEYL_0, WEYL_1 = 0x9E3779B9, 0xBB67AE85
ROUNDS = 10
DRAWS = 1 << 16  # draws of a stream
SQRT_HALF = 0.7071067811865476


@ti.func
def philox(counter, key):
    """Four random words (u32) of a counter of four words and a key of two."""
    c_0, c_1, c_2, c_3 = counter[0], counter[1], counter[2], counter[3]
    k_0, k_1 = key[0], key[1]
    for _ in ti.static(range(ROUNDS)):
        first = ti.u64(MULTIPLY_0) * ti.cast(c_0, ti.u64)
        second = ti.u64(MULTIPLY_1) * ti.cast(c_2, ti.u64)
        c_0 = ti.cast(second >> 32, ti.u32) ^ c_1 ^ k_0
        c_1 = ti.cast(second, ti.u32)
        c_2 = ti.cast(first >> 32, ti.u32) ^ c_3 ^ k_1
        c_3 = ti.cast(first, ti.u32)
        k_0 += ti.u32(WEYL_0)
        k_1 += ti.u32(WEYL_1)
    return ti.Vector([c_0, c_1, c_2, c_3], ti.u32)


@ti.func
def unit(high, low):
    """A double in (0, 1] of 53 bits, from two random words."""
    # 27 bits and 26 bits; 1 - [0, 1) is never 0, so that its logarithm is finite.
    bits = ti.cast(high >> 5, ti.f64) * 67108864.0 + ti.cast(low >> 6, ti.f64)
    return 1.0 - bits * (1.0 / 9007199254740992.0)


@ti.func
def words(stream, number):
    """The four random words of draw `number` of a stream."""
    counter = ti.Vector([stream[0], stream[1], stream[2], stream[3] + ti.cast(number, ti.u32)], ti.u32)
    return philox(counter, ti.Vector([stream[4], stream[5]], ti.u32))


@ti.func
def uniforms(stream, number):
    """Two random numbers, uniform in (0, 1]: draw `number` of a stream, which `normals` would use up too."""
    w = words(stream, number)
    return ti.Vector([ti.cast(unit(w[0], w[1]), float), ti.cast(unit(w[2], w[3]), float)])


@ti.func
def cosine_and_sine(turns):
    """Cosine and sine of 2 pi `turns`, from 0 to 1, in double precision, to 1e-16 or so.

    The angle is reduced to an eighth of a turn without rounding, which the library cannot; polynomials of FreeBSD's
    msun, `k_cos.c` and `k_sin.c`. It takes a sixth of the time of the library.
    """
    quarters = ti.floor(4.0 * turns + 0.5)
    x = ti.f64(6.283185307179586) * (turns - 0.25 * quarters)
    z = x * x
    sine = ti.f64(2.75573137070700676789e-06) + z * (
        ti.f64(-2.50507602534068634195e-08) + z * ti.f64(1.58969099521155010221e-10)
    )
    sine = ti.f64(8.33333333332248946124e-03) + z * (ti.f64(-1.98412698298579493134e-04) + z * sine)
    sine = x + x * z * (ti.f64(-1.66666666666666324348e-01) + z * sine)
    cosine = ti.f64(-2.75573143513906633035e-07) + z * (
        ti.f64(2.08757232129817482790e-09) + z * ti.f64(-1.13596475577881948265e-11)
    )
    cosine = ti.f64(-1.38888888888741095749e-03) + z * (ti.f64(2.48015872894767294178e-05) + z * cosine)
    cosine = 1.0 - (0.5 * z - z * z * (ti.f64(4.16666666666666019037e-02) + z * cosine))
    quarter = ti.cast(quarters, ti.i32)
    swapped = (quarter & 1) == 1
    along, across = ti.select(swapped, sine, cosine), ti.select(swapped, cosine, sine)
    return (
        ti.select(((quarter + 1) & 2) == 2, -along, along),
        ti.select((quarter & 2) == 2, -across, across),
    )


@ti.func
def logarithm(x):
    """Natural logarithm of a double in (0, 1] that is no subnormal, to one unit in its last place: bits of any device.

    Of x = 2^k (1 + f) with 1 + f between sqrt(1/2) and sqrt(2); constants of FreeBSD's msun, `e_log.c`.
    """
    bits = ti.bit_cast(x, ti.i64) - ti.bit_cast(ti.f64(SQRT_HALF), ti.i64)
    exponent = bits >> ti.i64(52)
    f = ti.bit_cast(ti.bit_cast(x, ti.i64) - (exponent << ti.i64(52)), ti.f64) - 1.0
    k = ti.cast(exponent, ti.f64)
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = ti.f64(3.999999999940941908e-01) + w * (
        ti.f64(2.222219843214978396e-01) + w * ti.f64(1.531383769920937332e-01)
    )
    odd = ti.f64(2.857142874366239149e-01) + w * (
        ti.f64(1.818357216161805012e-01) + w * ti.f64(1.479819860511658591e-01)
    )
    series = w * even + z * (ti.f64(6.666666666666735130e-01) + w * odd)
    half = 0.5 * (f * f)
    rest = s * (half + series) + k * ti.f64(1.90821492927058770002e-10)
    return k * ti.f64(6.93147180369123816490e-01) - ((half - rest) - f)


@ti.func
def normals(stream, number):
    """Two independent random numbers, normal with mean 0 and variance 1: draw `number` of a stream (Box-Muller)."""
    w = words(stream, number)
    radius = ti.sqrt(-2.0 * logarithm(unit(w[0], w[1])))
    cosine, sine = cosine_and_sine(unit(w[2], w[3]))
    return ti.Vector([ti.cast(radius * cosine, float), ti.cast(radius * sine, float)])


@ti.func
def library_normals(stream, number):
    """As `normals`, to rounding, with functions of the library: the bits of gases between thermal walls."""
    w = words(stream, number)
    radius = ti.sqrt(-2.0 * ti.log(unit(w[0], w[1])))
    angle = 6.283185307179586 * unit(w[2], w[3])
    return ti.Vector([ti.cast(radius * ti.cos(angle), float), ti.cast(radius * ti.sin(angle), float)])


@ti.func
def rayleigh(stream, number):
    """A random number, 0 or more, with density x exp(-x^2 / 2): draw `number` of a stream, as used up by `normals`."""
    w = words(stream, number)
    return ti.cast(ti.sqrt(-2.0 * ti.log(unit(w[0], w[1]))), float)
