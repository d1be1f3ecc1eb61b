"""A kernel that shows the random numbers of `kernels/random.py`. Import it only after `backend.start`."""

from ifrdem.kernels.compiler.language import ti
from ifrdem.kernels.random import normals, uniforms, words


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
