"""The law inside a Taichi kernel gives the same bits as in NumPy: there is one law."""
# No `from __future__ import annotations`: Taichi reads the annotations of kernels.

import numpy as np
import pytest
from support import plain_law

from ifrdem.kernels.compiler.language import ti
from ifrdem.kernels.laws.law import collide_pair
from ifrdem.simulation import backend

N = 20_000


@pytest.fixture
def taichi():
    backend.start("cpu")


@ti.kernel
def collide_all(a: ti.types.ndarray(ndim=2), out: ti.types.ndarray(ndim=2)):
    for p in range(a.shape[0]):
        vx_i, vy_i, w_i, vx_j, vy_j, w_j, P_n, P_t, sticking, rolling = collide_pair(
            a[p, 0],
            a[p, 1],
            a[p, 2],
            a[p, 3],
            a[p, 4],
            a[p, 5],
            a[p, 6],
            a[p, 7],
            a[p, 8],
            a[p, 9],
            a[p, 10],
            a[p, 11],
            a[p, 12],
            a[p, 13],
            a[p, 14],
            a[p, 15],
            a[p, 16],
            a[p, 17],
            a[p, 18],
        )
        out[p, 0], out[p, 1], out[p, 2] = vx_i, vy_i, w_i
        out[p, 3], out[p, 4], out[p, 5] = vx_j, vy_j, w_j
        out[p, 6], out[p, 7], out[p, 8], out[p, 9] = P_n, P_t, sticking, rolling


def arguments() -> np.ndarray:
    """Arguments of `collide_pair`, shape (N, 19): both closures, rolling, walls, separating pairs."""
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, 2.0 * np.pi, N)
    law = [rng.uniform(0, 1, N), rng.uniform(-1, 1, N), rng.uniform(0, 1, N), rng.integers(0, 2, N)]
    rho = rng.uniform(0, 0.3, N) * rng.integers(0, 2, N)
    first = [rng.uniform(0.1, 10, N), rng.uniform(0.1, 3, N), rng.uniform(1, 3, N), *rng.normal(size=(3, N))]
    second = [rng.uniform(0.1, 10, N), rng.uniform(0.1, 3, N), rng.uniform(1, 3, N), *rng.normal(size=(3, N))]
    second[0][::7] = 0.0
    return np.stack([*law, rho, np.cos(angle), np.sin(angle), *first, *second], axis=-1)


@pytest.mark.usefixtures("taichi")
def test_kernel_and_numpy_agree_to_the_last_bit():
    """Both do the same IEEE operations in the same order (fast_math=False on the CPU)."""
    a = arguments()
    out = np.zeros((N, 10))
    collide_all(a, out)
    expected = np.stack(collide_pair(*a.T), axis=-1)
    assert np.all(np.isfinite(expected))
    np.testing.assert_array_equal(out, expected)
    # The sample has every branch: separating, sliding, sticking, rolling, nonrolling.
    approaching = expected[:, 6] > 0.0
    for share in (approaching, expected[approaching, 8], expected[approaching, 9]):
        assert 0.1 < np.mean(share) < 0.9


@pytest.mark.parametrize("collide", [collide_pair, plain_law.collide_pair], ids=["declared", "plain"])
def test_plain_floats_give_the_same_numbers_as_arrays(collide):
    """Serial codes take the plain one."""
    a = arguments()[:2000]
    many = np.stack(collide_pair(*a.T), axis=-1)
    one = np.array([collide(*(float(x) for x in row)) for row in a])
    np.testing.assert_array_equal(one, many)
