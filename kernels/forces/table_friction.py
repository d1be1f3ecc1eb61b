"""A disk that slides and spins on a table to rest, under Coulomb friction spread evenly over its face.

Every element of the face is dragged against its own velocity, by mu_s times its share of the weight. With v the
speed of the centre, u = R |w| that of the rim and eps = v/u, the sum is a force F mu_s m g against v and a torque
T mu_s m g R against w (Z. Farkas, G. Bartels, T. Unger, D. E. Wolf, Phys. Rev. Lett. 90, 248302 (2003),
doi:10.1103/PhysRevLett.90.248302), so that with I = m R^2 / k and a = mu_s g

    dv/dt = -a F(eps),    du/dt = -k a T(eps);    the direction of v and the sense of w stay.

Two things make this awkward to integrate, and both go away in other variables:

- *Rest*: both motions stop at one time, where the right-hand sides jump. With v = q sin(theta), u = q cos(theta) and
  a stretched time, ds = a dt / q, F and T depend on theta alone and

      dtheta/ds = -(F cos(theta) - k T sin(theta)),    d(ln q)/ds = -(F sin(theta) + k T cos(theta)),
      d(a t)/ds = q,    d(a x)/ds = q^2 sin(theta).

  Rest is s -> infinity: theta settles on the root of F = k T eps (eps = 0.653 for k = 2), q falls exponentially, and
  what is left to fly at small q is a uniform deceleration, known in closed form.
- *eps = 1*: F and T have terms like x ln|x| there, x = eps - 1. Steps are of adaptive size, and become small where
  they cross it.

F and T with complete elliptic integrals of parameter m = min(eps, 1/eps)^2:

    eps <= 1:  F = 4 eps/(3 pi) B,  T = 4/(9 pi) [(4 - 2 m) E - (1 - m) K]
    eps >= 1:  F = 4/(3 pi) B,      T = 4/(9 pi eps) [C + 3 K - 4 D],       B = 2 K - (1 + m) D

with D = (K - E)/m and C = (2 D - K)/m, which the arithmetic-geometric mean gives without cancellation at m -> 0
(M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions, 17.6); E = K - m D.
"""

from ..compiler.language import Rows, is_single_precision, ti

AGM_STEPS = 9  # halve the digits that are missing; enough for 1 - m as small as TINY
TINY = 1.0e-30  # least 1 - m: K has a logarithm there, which enters multiplied by 1 - m
MOST_STEPS = 20000
NEVER = 1.0e30  # a time to fly that ends at rest


def step_tolerance() -> float:
    """Error of a step that suits the precision that kernels compute in (`advance`)."""
    return 1.0e-5 if is_single_precision() else 1.0e-11


@ti.func
def elliptic(m, m1):
    """K, D = (K - E)/m and C = (2 D - K)/m of parameter m = 1 - m1, 0 <= m <= 1.

    The mean runs a' = (a + b)/2, b' = sqrt(a b) from 1, sqrt(m1); c' = (a - b)/2 = c^2/(4 a') is kept divided by m,
    so that m = 0 is an ordinary value. K = pi/(2 a), (K - E)/K = sum 2^(n-1) c_n^2 with c_0^2 = m.
    """
    b = ti.sqrt(ti.max(m1, TINY))
    a = 0.5 * (1.0 + b)
    b = ti.sqrt(b)
    c = 0.25 / a
    power = 2.0
    total = power * c * c
    for _ in ti.static(range(AGM_STEPS)):
        a_next = 0.5 * (a + b)
        b = ti.sqrt(a * b)
        a = a_next
        c = 0.25 * m * c * c / a
        power *= 2.0
        total += power * c * c
    K = 0.5 * ti.math.pi / a
    return K, 0.5 * K * (1.0 + m * total), K * total


@ti.func
def friction(sine, cosine):
    """F and T of Sec. II F at eps = sine/cosine, both 0 or more and not both 0: eps from 0 to infinity."""
    F = sine * 0.0
    T = sine * 0.0
    large = ti.max(sine, cosine)
    ratio = ti.min(sine, cosine) / large
    m = ratio * ratio
    m1 = (large - ti.min(sine, cosine)) * (sine + cosine) / (large * large)
    K, D, C = elliptic(m, m1)
    B = 4.0 / (3.0 * ti.math.pi) * (2.0 * K - (1.0 + m) * D)
    if sine <= cosine:
        F = ratio * B
        T = 4.0 / (9.0 * ti.math.pi) * ((4.0 - 2.0 * m) * (K - m * D) - m1 * K)
    else:
        F = B
        T = 4.0 / (9.0 * ti.math.pi) * ratio * (C + 3.0 * K - 4.0 * D)
    return F, T


@ti.func
def rates(theta, log_q, k):
    """Derivatives by s of (theta, ln q, a t, a x)."""
    sine, cosine = ti.max(ti.sin(theta), 0.0), ti.max(ti.cos(theta), 0.0)
    F, T = friction(sine, cosine)
    q = ti.exp(log_q)
    return ti.Vector([-(F * cosine - k * T * sine), -(F * sine + k * T * cosine), q, q * q * sine])


@ti.func
def slide(theta, k, end, tolerance):
    """Fly from q = 1 at `theta` for the time `end`, or to rest; returns theta, log_q = ln q, t and x
    times a, and at_rest, 1.0 there.

    Steps of Dormand and Prince's pair of orders 5 and 4 (J. Comput. Appl. Math. 6, 19 (1980)), each of which may err
    by `tolerance` in theta and ln q, and in units of q^2/a and q/a at the start in x and t. A step that would pass
    `end` is shortened to what a constant rate of ln q needs; the rest of it is a step again, cubically smaller.
    """
    y = ti.Vector([theta, 0.0 * theta, 0.0 * theta, 0.0 * theta])
    h = 0.05 + 0.0 * theta
    rest_at = ti.log(tolerance)
    at_rest = 0.0 * theta
    active = 1
    steps = 0
    while active == 1:
        k1 = rates(y[0], y[1], k)
        left = end - y[2]
        part = -k1[1] * left / k1[2]
        step = h
        last = 0
        if part < 1.0:
            needed = ti.log(1.0 - part) / k1[1]
            if part < 1.0e-3:
                # Where the logarithm has lost its digits, or is 0 in single precision and the step would never end.
                needed = -part * (1.0 + part * (1.0 / 2.0 + part * (1.0 / 3.0 + part / 4.0))) / k1[1]
            if needed < h:
                step = needed
                last = 1
        # A name for each stage: Taichi 1.7.4 computed wrong ones where a single name was assigned again.
        z2 = y + step * (k1 / 5.0)
        k2 = rates(z2[0], z2[1], k)
        z3 = y + step * (3.0 / 40.0 * k1 + 9.0 / 40.0 * k2)
        k3 = rates(z3[0], z3[1], k)
        z4 = y + step * (44.0 / 45.0 * k1 - 56.0 / 15.0 * k2 + 32.0 / 9.0 * k3)
        k4 = rates(z4[0], z4[1], k)
        z5 = y + step * (
            19372.0 / 6561.0 * k1 - 25360.0 / 2187.0 * k2 + 64448.0 / 6561.0 * k3 - 212.0 / 729.0 * k4
        )
        k5 = rates(z5[0], z5[1], k)
        z6 = y + step * (
            9017.0 / 3168.0 * k1 - 355.0 / 33.0 * k2 + 46732.0 / 5247.0 * k3 + 49.0 / 176.0 * k4 - 5103.0 / 18656.0 * k5
        )  # fmt: skip
        k6 = rates(z6[0], z6[1], k)
        new = y + step * (
            35.0 / 384.0 * k1 + 500.0 / 1113.0 * k3 + 125.0 / 192.0 * k4 - 2187.0 / 6784.0 * k5 + 11.0 / 84.0 * k6
        )  # fmt: skip
        k7 = rates(new[0], new[1], k)
        error = step * (
            71.0 / 57600.0 * k1 - 71.0 / 16695.0 * k3 + 71.0 / 1920.0 * k4 - 17253.0 / 339200.0 * k5
            + 22.0 / 525.0 * k6 - 1.0 / 40.0 * k7
        )  # fmt: skip
        off = ti.abs(error).max() / tolerance
        factor = ti.min(ti.max(0.9 * ti.pow(ti.max(off, 1.0e-10), -0.2), 0.2), 4.0)
        steps += 1
        if off <= 1.0:
            y = new
            if last == 0:
                h = step * factor
            elif ti.abs(end - y[2]) <= 0.1 * tolerance * end:
                active = 0
            if y[1] < rest_at and active == 1:
                # A uniform deceleration from here: d(ln q)/ds keeps its value, so t = q/rate and x = q^2 sin/(2 rate).
                final = rates(y[0], y[1], k)
                y[2] -= final[2] / final[1]
                y[3] -= 0.5 * final[3] / final[1]
                if y[2] <= end:
                    at_rest += 1.0
                active = 0
        else:
            h = ti.abs(step) * factor
        if steps >= MOST_STEPS:
            y *= ti.math.nan  # never seen; a wrong number would be worse
            active = 0
    return ti.Struct(theta=y[0], log_q=y[1], t=y[2], x=y[3], at_rest=at_rest)


@ti.func
def advance(v, u, k, a, dt, tolerance):
    """Move one disk on the table by dt [time], or to rest (`NEVER`): v, u, x, t, eps.

    v is the speed of the centre, 0 or more, u = R w has a sign [length/time]; k in I = m R^2 / k; a = mu_s g
    [length/time^2], positive. `tolerance` is the error allowed a step, relative: 1e-12 in double precision, 1e-5 in
    single; that of v, u and the distance is a few of it, of the start's q = sqrt(v^2 + u^2) and q^2/a.

    Both speeds are 0 at rest; x is the distance moved along v [length], t the time in motion, dt or less, eps = v / |u|
    at the end, at rest its limit.
    """
    q = ti.sqrt(v * v + u * u)
    v_new = 0.0 * v
    u_new = 0.0 * u
    x = 0.0 * v
    t = 0.0 * v
    eps = 0.0 * v
    if q > 0.0:
        flown = slide(ti.atan2(v, ti.abs(u)), k, a * dt / q, tolerance)
        if flown.at_rest == 0.0:
            q_new = q * ti.exp(flown.log_q)
            v_new = q_new * ti.max(ti.sin(flown.theta), 0.0)
            u_new = q_new * ti.max(ti.cos(flown.theta), 0.0) * (1.0 * (u > 0.0) - 1.0 * (u < 0.0))
        x = flown.x * q * q / a
        t = ti.min(flown.t * q / a, dt)
        eps = ti.tan(flown.theta)
    return ti.Struct(v=v_new, u=u_new, x=x, t=t, eps=eps)


@ti.kernel
def friction_of(v: Rows, u: Rows, F: Rows, T: Rows):
    """F and T, shape (n,), for speeds v and rim speeds u [any one unit], 0 or more and not both 0."""
    for i in range(v.shape[0]):
        F[i], T[i] = friction(v[i], u[i])


@ti.kernel
def slide_coins(
    dt: ti.f64, tolerance: ti.f64, a: Rows, k: Rows, v: Rows, u: Rows, x: Rows, t: Rows, eps: Rows
):
    """Move n independent disks by dt (`NEVER`: to rest); see `advance`. v and u change in place."""
    for i in range(v.shape[0]):
        # In the precision of the arrays: v + 0 gives the scalars their type.
        zero = 0.0 * v[i]
        new = advance(v[i], u[i], k[i], a[i], zero + dt, zero + tolerance)
        v[i], u[i], x[i], t[i], eps[i] = new.v, new.u, new.x, new.t, new.eps
