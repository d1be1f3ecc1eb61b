"""Thermal walls: a disk leaves with a random velocity, as if it had come from a gas behind the wall.

Why the normal component is not Gaussian: of a gas with the Maxwellian density f(v) ~ exp(-m v^2 / 2 T), those disks
that pass a line in a time dt come from a distance v_n dt, so that their velocities are distributed as v_n f(v),
v_n > 0. The factors separate. Along the wall v_t stays Gaussian with variance T/m, the spin, whatever v is, with T/I;
the normal component has the density (m v_n / T) exp(-m v_n^2 / 2 T), Rayleigh's. Its part above v_n is
exp(-m v_n^2 / 2 T): set equal to a uniform u, v_n = sqrt(-2 (T/m) ln u). A gas of the same temperature sends to the
wall just what it gets back, and stays what it is. R. Tehver et al., Phys. Rev. E 57, R17 (1998),
doi:10.1103/PhysRevE.57.R17, tell what goes wrong with other densities.
"""

from .language import ti
from .layout import EVENTS, ID, INVERSE_MASS, KIND, RADIUS, SEED_HIGH, SEED_LOW, K
from .random import DRAWS, normals, rayleigh

PLACE = 0xFFFF * DRAWS  # in streams of random numbers: the index that no force has


@ti.func
def thermal_velocity(i, number, temperature, nx, ny, ux, uy, gas: ti.template()):
    """Velocity and spin of disk i after its collision `number` of the epoch, with a wall of this temperature [energy].

    (nx, ny) is the wall's normal towards the disk, (ux, uy) the velocity of its surface.

    The random numbers depend on the seed, the disk, and how many collisions it has had before, with disks and walls,
    in the epoch and before: on nothing that threads, cuts or rollbacks change.
    """
    stream = ti.Vector([
        ti.cast(gas.meta[i][ID], ti.u32), ti.cast(gas.meta[i][EVENTS] + number, ti.u32), ti.u32(0),
        ti.u32(PLACE), ti.cast(gas.grid[SEED_LOW], ti.u32), ti.cast(gas.grid[SEED_HIGH], ti.u32),
    ], ti.u32)  # fmt: skip
    kind = gas.meta[i][KIND]
    spread = ti.sqrt(temperature * gas.kinds[kind][INVERSE_MASS])
    v_n = spread * rayleigh(stream, 0)
    along = normals(stream, 1)
    v_t = spread * along[0]
    # sqrt(T/I), I = m R^2 / k
    spin = spread * ti.sqrt(gas.kinds[kind][K]) / gas.flight[i][RADIUS] * along[1]
    return ux + v_n * nx - v_t * ny, uy + v_n * ny + v_t * nx, spin
