"""The random numbers of forces: Philox4x32-10 to the last bit, and distributions made of its words."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.scene import Scene

from ifrdem.kernels.layout import Uses
from ifrdem.simulation import backend

# Philox in Python for words of any width, from Salmon et al. (doi:10.1145/2063384.2063405), Sec. 3.3 and Random123:
# multipliers and additions of Philox4x32 and Philox4x64.
CONSTANTS = {
    32: ((0xD2511F53, 0xCD9E8D57), (0x9E3779B9, 0xBB67AE85)),
    64: ((0xD2E7470EE14C6C93, 0xCA5A826395121157), (0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B)),
}


def philox(counter: list[int], key: list[int], bits: int) -> list[int]:
    (m_0, m_1), (w_0, w_1) = CONSTANTS[bits]
    low = 2**bits - 1
    a, b, c, d = counter
    for r in range(10):
        p, q = m_0 * a, m_1 * c
        a, b, c, d = (
            q >> bits ^ b ^ (key[0] + r * w_0 & low),
            q & low,
            p >> bits ^ d ^ (key[1] + r * w_1 & low),
            p & low,
        )
    return [a, b, c, d]


def on_device(streams: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
    """Words, and a pair of uniform and one of normal numbers, of each stream's draw 0."""
    backend.start("cpu")
    from support.kernels.draws import draw

    words = np.zeros((len(streams), 4), dtype=np.uint32)
    numbers = np.zeros((len(streams), 4))
    draw(streams, words, numbers)
    return words, numbers


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ],
)
def test_words_are_those_of_random123(counter: str, key: str, words: str) -> None:
    """Known answers of Random123 1.14.0, tests/kat_vectors, philox4x32 10."""
    stream = np.array([[int(word, 16) for word in (counter + " " + key).split()]], dtype=np.uint32)
    assert [f"{word:08x}" for word in on_device(stream)[0][0]] == words.split()


def test_words_are_those_of_the_algorithm_that_numpy_has_in_64_bits() -> None:
    """NumPy has Philox4x64 only: one Python function for both widths is compared with it, the kernel with that."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        counter, key = ([int(x) for x in rng.integers(0, 2**63, n)] for n in (4, 2))
        numpy_s = np.random.Philox(
            counter=np.array(counter, dtype=np.uint64), key=np.array(key, dtype=np.uint64)
        )
        counter[0] += 1  # NumPy counts first
        assert philox(counter, key, 64) == [int(x) for x in numpy_s.random_raw(4)]
    streams = rng.integers(0, 2**32, (200, 6), dtype=np.uint32)
    expected = [philox([int(x) for x in row[:4]], [int(x) for x in row[4:]], 32) for row in streams]
    np.testing.assert_array_equal(on_device(streams)[0], expected)


def test_numbers_are_uniform_and_normal_and_independent() -> None:
    """Of 300,000 disks in one step; tolerances are five standard errors."""
    n = 300_000
    streams = np.zeros((n, 6), dtype=np.uint32)
    streams[:, 0] = np.arange(n)
    streams[:, 4] = 7
    words, numbers = on_device(streams)
    u, g = numbers[:, :2], numbers[:, 2:]
    # Box and Muller's pair from the words, in NumPy.
    w = words.astype(np.float64)
    unit = 1.0 - (np.floor(w[:, ::2] / 32.0) * 2.0**26 + np.floor(w[:, 1::2] / 64.0)) / 2.0**53
    np.testing.assert_array_equal(u, unit)
    turn = np.sqrt(-2.0 * np.log(unit[:, 0])) * np.exp(2j * np.pi * unit[:, 1])
    np.testing.assert_allclose(g, np.stack([turn.real, turn.imag], axis=1), atol=1e-13)
    assert u.min() > 0.0
    assert u.max() <= 1.0
    np.testing.assert_allclose(u.mean(axis=0), 0.5, atol=5.0 / np.sqrt(12.0 * n))
    # Moments of a normal number: 0, 1, 0, 3, with variances 1, 2, 15, 96.
    for power, (mean, variance) in enumerate([(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0)], start=1):
        np.testing.assert_allclose((g**power).mean(axis=0), mean, atol=5.0 * np.sqrt(variance / n))
    assert abs(np.mean(g[:, 0] * g[:, 1])) < 5.0 / np.sqrt(n)
    assert abs(np.mean(g[1:, 0] * g[:-1, 0])) < 5.0 / np.sqrt(n)  # disks with ids side by side


def test_thermal_walls_draw_from_streams_that_no_force_has() -> None:
    """Counter: id, collisions before, 0, and the index 2^16 - 1 above the draw: forces have lower ones, from 0 on.

    Of the index of a force, a disk would get the same numbers from both. Draw 0 gives sqrt(-2 ln u) along the normal,
    draw 1 the pair of Box and Muller along the wall, to the left of the normal, and to the spin. m = R = 1, I = 1/2.
    """
    backend.start("cpu")
    from support.kernels.draws import leave

    scene, out = Scene(2, kinds=1), np.zeros((2, 3))
    scene.kinds.inverse_mass, scene.kinds.radius, scene.kinds.k = 1.0, 1.0, 2.0
    scene.event_info.id, scene.event_info.number = (3, 8), (1, 2)
    scene.image_info.events_before = (0, 40)
    scene.grid.seed_low, scene.grid.seed_high = 5, 6
    scene.call(leave, Uses(), "uses grid kinds event_info image_info", out)

    def units(disk: int, collisions: int, draw: int) -> tuple[float, float]:
        w = philox([disk, collisions, 0, (0xFFFF << 16) + draw], [5, 6], 32)
        one, other = (1.0 - ((w[i] >> 5) * 2**26 + (w[i + 1] >> 6)) / 2**53 for i in (0, 2))
        return one, other

    for row, (disk, collisions) in zip(out, ((3, 0), (8, 41)), strict=True):
        u, _ = units(disk, collisions, 0)
        radius, turns = units(disk, collisions, 1)
        along = np.sqrt(-2.0 * np.log(radius)) * np.exp(2j * np.pi * turns)
        expected = [-along.real, np.sqrt(-2.0 * np.log(u)), np.sqrt(2.0) * along.imag]
        np.testing.assert_allclose(row, expected, rtol=1e-12)
