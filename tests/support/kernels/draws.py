"""Kernels that show the random numbers of `kernels/random.py`. Import it only after `backend.start`."""

from ifrdem.kernels.compiler.language import Table, ti
from ifrdem.kernels.compiler.signature import Arrays, kernel
from ifrdem.kernels.random import normals, uniforms, words
from ifrdem.kernels.walls.thermal import thermal_velocity


@ti.kernel
def draw(streams: ti.types.ndarray(ndim=2), out: ti.types.ndarray(ndim=2), numbers: ti.types.ndarray(ndim=2)):
    """Words, a pair of uniform and a pair of normal numbers of each stream's draw 0."""
    for i in range(streams.shape[0]):
        stream = ti.Vector([streams[i, j] for j in ti.static(range(6))], ti.u32)
        word, uniform, normal = words(stream, 0), uniforms(stream, 0), normals(stream, 0)
        for j in ti.static(range(4)):
            out[i, j] = word[j]
        for j in ti.static(range(2)):
            numbers[i, j] = uniform[j]
            numbers[i, 2 + j] = normal[j]


@kernel
def leave(out: Table, gas: Arrays("uses grid kinds event_info image_info")):
    """Velocities and spins of disks that leave a wall of temperature 1 and normal (0, 1), at rest."""
    for i in range(out.shape[0]):
        zero = 0.0 * gas.kinds[0].radius
        vx, vy, spin = thermal_velocity(i, 1.0 + zero, zero, 1.0 + zero, zero, zero, gas)
        out[i, 0], out[i, 1], out[i, 2] = vx, vy, spin
