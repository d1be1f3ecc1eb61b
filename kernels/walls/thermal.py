"""Thermal walls: a disk leaves with a random velocity, as if it had come from a gas behind the wall.

Why the normal component is not Gaussian: of a gas with the Maxwellian density f(v) ~ exp(-m v^2 / 2 T), those disks
that pass a line in a time dt come from a distance v_n dt, so that their velocities are distributed as v_n f(v),
v_n > 0. The factors separate. Along the wall v_t stays Gaussian with variance T/m, the spin, whatever v is, with T/I;
the normal component has the density (m v_n / T) exp(-m v_n^2 / 2 T), Rayleigh's. Its part above v_n is
exp(-m v_n^2 / 2 T): set equal to a uniform u, v_n = sqrt(-2 (T/m) ln u). A gas of the same temperature sends to the
wall just what it gets back, and stays what it is. R. Tehver et al., Phys. Rev. E 57, R17 (1998),
doi:10.1103/PhysRevE.57.R17, show what goes wrong with other densities.
"""

from ..compiler.language import ti
from ..disks.particle import collisions_in_window, kind_of
from ..random import DRAWS, library_normals, rayleigh

OF_WALLS = 0xFFFF * DRAWS  # in streams of random numbers: the index that no force has


@ti.func
def thermal_velocity(i, temperature, nx, ny, ux, uy, gas: ti.template()):
    """Velocity and spin of the disk in slot i after a collision with a wall of this temperature [energy].

    (nx, ny) is the wall's normal towards the disk, (ux, uy) the velocity of its surface.

    The random numbers depend on the seed, the disk, and how many collisions it has had before, with disks and walls.
    """
    stream = ti.Vector([
        ti.cast(gas.event_info[i].id, ti.u32),
        ti.cast(gas.image_info[i].events_before + collisions_in_window(i, gas) - 1, ti.u32),
        ti.u32(0), ti.u32(OF_WALLS), ti.cast(gas.grid.seed_low, ti.u32), ti.cast(gas.grid.seed_high, ti.u32),
    ], ti.u32)  # fmt: skip
    kind = kind_of(i, gas)
    spread = ti.sqrt(temperature * gas.kinds[kind].inverse_mass)
    v_n = spread * rayleigh(stream, 0)
    along = library_normals(stream, 1)
    v_t = spread * along[0]
    # sqrt(T/I), I = m R^2 / k
    spin = spread * ti.sqrt(gas.kinds[kind].k) / gas.kinds[kind].radius * along[1]
    return ux + v_n * nx - v_t * ny, uy + v_n * ny + v_t * nx, spin


@ti.func
def heat_given(kind, vx, vy, spin, vx_0, vy_0, spin_0, gas: ti.template()):
    """Kinetic energy after less that before, of a disk with velocities in the wall's frame. In double precision."""
    mass = 1.0 / ti.cast(gas.kinds[kind].inverse_mass, ti.f64)
    radius = ti.cast(gas.kinds[kind].radius, ti.f64)
    inertia = mass * radius * radius / ti.cast(gas.kinds[kind].k, ti.f64)
    # Each difference of squares as a product.
    along_x = ti.cast(vx - vx_0, ti.f64) * ti.cast(vx + vx_0, ti.f64)
    along_y = ti.cast(vy - vy_0, ti.f64) * ti.cast(vy + vy_0, ti.f64)
    turning = ti.cast(spin - spin_0, ti.f64) * ti.cast(spin + spin_0, ti.f64)
    return 0.5 * (mass * (along_x + along_y) + inertia * turning)
