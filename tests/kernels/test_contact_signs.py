"""The one test before the contact time of two disks, against the conditions in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

from ifrdem import Device
from ifrdem.kernels.compiler.language import Rows, Table, ti
from ifrdem.kernels.disks.flights import contact_signs
from ifrdem.simulation import backend


@ti.kernel
def signs(pair: Table, found: Rows):
    """`contact_signs` of rows (r, v, sigma, within)."""
    for i in range(pair.shape[0]):
        found[i] = ti.cast(
            contact_signs(pair[i, 0], pair[i, 1], pair[i, 2], pair[i, 3], pair[i, 4], pair[i, 5]) < 0, ti.i32
        )


def meets(rx: float, ry: float, vx: float, vy: float, sigma: float, within: float) -> bool:
    """True if b < 0, c <= -2 b within and b^2 - v^2 c >= 0, in exact fractions: the pair meets within that time."""
    x, y, u, w, s, t = (Fraction(float(value)) for value in (rx, ry, vx, vy, sigma, within))
    b, c = x * u + y * w, x * x + y * y - s * s
    return b < 0 and c <= -2 * b * t and b * b - (u * u + w * w) * c >= 0


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_one_sign_is_all_conditions_of_a_contact(precision: str) -> None:
    """Small whole numbers, of which no product is rounded: equality, touching and overlapping pairs occur.

    Where b = 0, the sign of zero decides, and `contact_delay` after it: such pairs are left out.
    """
    backend.start(Device(threads=1, precision=precision))
    pair = np.random.default_rng(1).integers(-4, 5, size=(4000, 6)).astype(precision.replace("f", "float"))
    pair[:, 4:] = np.abs(pair[:, 4:])
    pair = pair[pair[:, 0] * pair[:, 2] + pair[:, 1] * pair[:, 3] != 0.0]
    found = np.zeros(len(pair), np.int32)
    signs(pair, found)
    expected = [meets(*row) for row in pair]
    assert found.tolist() == expected
    assert 0.05 < np.mean(expected) < 0.5
