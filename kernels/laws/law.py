"""The collision law: the one implementation of its formula, and what every law shares.

A collision has three steps: how the contact moves (`relative_motion`), which impulses act (`ifr_impulses`, or a
custom law), and what they do to both disks (`after_impulses`), which keeps the momentum for any impulses.

Source: A. Domenech-Carbo et al., "Independent friction-restitution modeling of two-disk collisions". "Eq. n" below
is that paper's equation; where a line is more general than the print (two spins, any direction of the line
of centres, a wall), its comment derives it.

Symbols: n is the unit vector from the centre of disk i to that of disk j, t = (-n_y, n_x), a moment of
inertia is I = m R^2 / k, spins are counter-clockwise, and im = 1/m is 0 for a wall.
"""

from ..compiler.language import ti


@ti.pyfunc
def inverse_masses(im_i, k_i, im_j, k_j):
    """1 / m_n and 1 / m_t of a pair, from inverse masses and shape numbers.

    An impulse P along n changes g_n by -P/m_n (Eq. 1). An impulse P along t changes g_t by -P/m_t: it moves each disk
    by P/m (Eq. 2) and turns it by R dw = -k P/m (Eq. 3 with I = m R^2 / k).
    """
    return im_i + im_j, (1.0 + k_i) * im_i + (1.0 + k_j) * im_j


@ti.pyfunc
def relative_motion(n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j):
    """Motion of the contact, from the arguments of `collide_pair`: g_n, g_t, m_n, m_t.

    Relative velocity at the contact along n and t [length/time], g_n > 0 approaches; normal and tangential effective
    mass [mass].
    """
    # Relative velocity at the contact, g = v_i - v_j + (R_i w_i + R_j w_j) t: the paper's V = v + R omega,
    # with its clockwise omega_2 = -w_j, and without its choice that j is at rest.
    dvx = vx_i - vx_j
    dvy = vy_i - vy_j
    g_n = dvx * n_x + dvy * n_y
    g_t = dvy * n_x - dvx * n_y + (R_i * w_i + R_j * w_j)

    inverse_n, inverse_t = inverse_masses(im_i, k_i, im_j, k_j)
    return g_n, g_t, 1.0 / inverse_n, 1.0 / inverse_t


@ti.pyfunc
def reduced_radius(R_i, R_j):
    """R_i R_j / (R_i + R_j), the radius of Hertz's contact of two spheres."""
    return R_i * R_j / (R_i + R_j)


@ti.pyfunc
def ifr_impulses(e_n, e_t, mu, contact_point, rho, g_n, g_t, m_n, m_t, R_i, R_j):
    """The impulses of the IFR law for a pair that approaches, g_n > 0: P_n, P_t, T, sticking, rolling, P_et.

    P_n, P_t : impulses that i gives to j along n and t [mass length/time]; P_et : the part of P_t that tangential
    restitution gives, the rest is friction. T : angular impulse that brakes either spin, at most to rest
    [mass length^2/time]. Arguments and flags as for `collide_pair` and `relative_motion`.
    """
    slip = ti.abs(g_t)
    direction = 1.0 * (g_t > 0.0) - 1.0 * (g_t < 0.0)

    P_n = (1.0 + e_n) * m_n * g_n  # Eq. 5
    P_et = (1.0 + e_t) * m_t * g_t  # Eq. 8: acts in every collision

    # Friction. Stopping the contact points takes m_t |g_t| (Eq. 12). Stopping the percussion centres, R/k
    # from the centres, takes m_n |g_t| / 2 (Eq. 15), whatever k: P changes v + (R/k) w by P/m twice. The
    # smaller of this and the sliding friction acts; they are equal at the angles of Eqs. 24 and 25, so the
    # law is continuous there.
    P_slide = mu * P_n  # Eq. 9
    P_stick = (contact_point * m_t + (1.0 - contact_point) * 0.5 * m_n) * slip  # Eq. 12 or Eq. 15
    P_f = direction * ti.min(P_slide, P_stick)
    P_t = P_et + P_f
    sticking = 1.0 * (P_stick <= P_slide)

    # Rolling friction brakes each spin by the smallest of rho P_n (Eq. 31), r m_t |g_t| (Eq. 32, where k = 2)
    # and what stops it, I |w|: without the last it could reverse a spin and add energy.
    r = 2.0 * (R_i * R_j) / (R_i + R_j)
    T_roll = rho * P_n  # Eq. 31
    T_slip = r * m_t * slip  # Eq. 32
    T = ti.min(T_roll, T_slip)
    rolling = 1.0 * (T_roll <= T_slip)
    return P_n, P_t, T, sticking, rolling, P_et


@ti.pyfunc
def after_impulses(
    P_n, P_t, T, n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j
):  # fmt: skip
    """Velocities and spins (vx_i, vy_i, w_i, vx_j, vy_j, w_j) after i gave j the impulses P_n along n and P_t along t.

    T brakes either spin, at most to rest. The other arguments are those of `collide_pair`.
    """
    # Eqs. 1 and 2 as vectors: i loses what j gains.
    P_x = P_n * n_x - P_t * n_y
    P_y = P_n * n_y + P_t * n_x
    vx_i_new = vx_i - im_i * P_x
    vy_i_new = vy_i - im_i * P_y
    vx_j_new = vx_j + im_j * P_x
    vy_j_new = vy_j + im_j * P_y

    # Eq. 3, I dw = -R P_t, in the form k im / R that is 0 for a wall. Impulse and lever arm both change sign
    # from i to j, so both spins change the same way round.
    turn_i = k_i * im_i / R_i
    turn_j = k_j * im_j / R_j
    w_i_free = w_i - turn_i * P_t
    w_j_free = w_j - turn_j * P_t
    brake_i = ti.min((T * turn_i) / R_i, ti.abs(w_i_free))
    brake_j = ti.min((T * turn_j) / R_j, ti.abs(w_j_free))
    w_i_new = w_i_free - brake_i * (1.0 * (w_i_free > 0.0) - 1.0 * (w_i_free < 0.0))
    w_j_new = w_j_free - brake_j * (1.0 * (w_j_free > 0.0) - 1.0 * (w_j_free < 0.0))
    return vx_i_new, vy_i_new, w_i_new, vx_j_new, vy_j_new, w_j_new


@ti.pyfunc
def collide_pair(
    e_n, e_t, mu, contact_point, rho,
    n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j,
):  # fmt: skip
    """Collide disk i with disk j, or with a wall (im_j = 0).

    Runs inside Taichi kernels on scalars, and in plain Python on floats or on NumPy arrays that broadcast: no
    branch, only arithmetic, minima and comparisons turned into 0.0 or 1.0. Nothing is checked here.

    Parameters
    ----------
    e_n, e_t, mu : float
        Normal restitution, tangential restitution, sliding friction (the paper's, each by itself).
    contact_point : float
        What stops the slip in a sticking collision: 1.0 the contact point, 0.0 the percussion centre.
    rho : float
        Rolling friction [length].
    n_x, n_y : float
        Unit vector n from the centre of i to the centre of j.
    im_i, im_j : float
        Inverse masses [1/mass]; 0.0 for a wall, not both.
    R_i, R_j : float
        Radii [length], positive and finite. For a flat wall pass the partner's radius and no spin.
    k_i, k_j : float
        Shape numbers in I = m R^2 / k: 2 homogeneous disk, 1 hoop. Any finite number for a wall.
    vx_i, vy_i, vx_j, vy_j : float
        Velocities of the centres [length/time].
    w_i, w_j : float
        Spins, counter-clockwise [rad/time].

    Returns
    -------
    vx_i, vy_i, w_i, vx_j, vy_j, w_j : float
        Velocities and spins after the collision. A pair that separates (g_n <= 0) keeps its own.
    P_n, P_t : float
        The impulses [mass length/time] that i gives to j along n and t.
    sticking : float
        1.0 if friction stops the slip, 0.0 if it stays at mu P_n (sliding) or the pair separates.
    rolling : float
        1.0 if the rolling torque rho P_n acts, 0.0 if the smaller r m_t |g_t| does. Means nothing if rho = 0.

    Notes
    -----
    Exchanging i and j (and n with -n) gives the same numbers to the last bit. Rolling friction keeps linear
    momentum but not the pair's angular momentum: its torques brake both spins.

    With spin before the impact the percussion-centre friction keeps the slip of the contact point, as Eq. 15
    prints it. The slip of the percussion centre itself, v + (R/k) w, would push even where nothing slips, and
    could add energy.
    """
    g_n, g_t, m_n, m_t = relative_motion(
        n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j
    )
    approaching = 1.0 * (g_n > 0.0)
    P_n_0, P_t_0, T, sticking, rolling, _ = ifr_impulses(
        e_n, e_t, mu, contact_point, rho, g_n, g_t, m_n, m_t, R_i, R_j
    )
    P_n = approaching * P_n_0
    P_t = approaching * P_t_0
    vx_i_new, vy_i_new, w_i_new, vx_j_new, vy_j_new, w_j_new = after_impulses(
        P_n, P_t, approaching * T,
        n_x, n_y, im_i, R_i, k_i, vx_i, vy_i, w_i, im_j, R_j, k_j, vx_j, vy_j, w_j,
    )  # fmt: skip
    return (
        vx_i_new, vy_i_new, w_i_new, vx_j_new, vy_j_new, w_j_new,
        P_n, P_t, approaching * sticking, approaching * rolling,
    )  # fmt: skip


@ti.pyfunc
def ifr(pair, law):
    """The IFR law as the engine calls laws (`ifrdem.CollisionLaw.collide`): P_n, P_t, T."""
    P_n, P_t, T, _, _, _ = ifr_impulses(
        law.e_n, law.e_t, law.mu, law.contact_point, law.rho,
        pair.g_n, pair.g_t, pair.m_n, pair.m_t, pair.radius_i, pair.radius_j,
    )  # fmt: skip
    return P_n, P_t, T


@ti.pyfunc
def ifr_parts(pair, law):
    """The IFR law with a ledger: P_n, P_t, T; and P_et, the part of P_t from tangential restitution; sticking; rolling.

    Both are 1.0 or 0.0, as `collide_pair` returns them, but rolling is 0.0 without rolling friction.
    """
    P_n, P_t, T, sticking, rolling, P_et = ifr_impulses(
        law.e_n, law.e_t, law.mu, law.contact_point, law.rho,
        pair.g_n, pair.g_t, pair.m_n, pair.m_t, pair.radius_i, pair.radius_j,
    )  # fmt: skip
    return P_n, P_t, T, P_et, sticking, rolling * (law.rho > 0.0)
