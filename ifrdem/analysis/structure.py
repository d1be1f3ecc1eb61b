"""The static structure factor S(k), averaged over directions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import Array
from ..tools.pictured import PicturedResult
from ..tools.reprs import Brief
from . import common as libraries
from .common import Positions, as_box, each, times_of

MOST_MODES = 1024
"""Modes along an axis that one transform computes; beyond, only every p-th k that the box allows is taken."""


@dataclass(frozen=True, eq=False, repr=False)
class StructureFactor(Brief, PicturedResult):
    """S(k) = <|sum_j exp(-i k r_j)|^2> / n in rings of k."""

    k: Array
    S: Array
    S_error: Array
    """k, S, S_error: mean |k| of the modes in each ring [1/length]; mean of S, and standard error S / sqrt(modes
    frames): modes and frames count as independent, each mode as exponentially distributed; shape (rings,)."""
    modes: NDArray[np.int64]
    frames: int
    """modes, frames: modes counted in a frame, of k and -k one; how many frames there were; shape (rings,)."""


def mode_intensities(
    position: Array, box: Box | ArrayLike, modes: tuple[int, int], *, stride: int = 1, time: float = 0.0
) -> tuple[Array, Array]:
    """Vectors k that the box allows [1/length], shape (2 a + 1, 2 b + 1, 2), and |sum_j exp(-i k r_j)|^2 / n at them.

    k = 2 pi stride (i / Lx, j / Ly) with i from -a to a and j from -b to b, `modes` = (a, b), by finufft to 1e-9. The
    lattice of a sheared box is skewed: k_y changes by -k_x times the shift of the image above over Ly.
    """
    box = as_box(box)
    if box.is_open or not all(box.periodic):
        raise InputError("S(k) needs a box that is periodic along x and y")
    finufft = libraries.load("finufft", "S(k)")
    (width, height), (a, b) = box.lengths, modes
    shift = box.image_above(time) if box.shear_rate else 0.0
    shift -= width if shift > 0.5 * width else 0.0
    x = position[:, 0] - position[:, 1] * (shift / height)
    # Multiples of the stride repeat themselves in a stride-th of the box.
    phase = [2.0 * np.pi * ((stride * part) % 1.0) - np.pi for part in (x / width, position[:, 1] / height)]
    amplitude = finufft.nufft2d1(
        phase[0], phase[1], np.ones(len(position), dtype=complex), (2 * a + 1, 2 * b + 1), isign=-1, eps=1e-9
    )
    i, j = np.meshgrid(np.arange(-a, a + 1), np.arange(-b, b + 1), indexing="ij")
    k_x = 2.0 * np.pi * stride / width * i
    k_y = 2.0 * np.pi * stride / height * j - k_x * (shift / height)
    return np.stack((k_x, k_y), axis=-1), np.abs(amplitude) ** 2 / len(position)


def structure_factor(
    position: Positions,
    box: Box | ArrayLike,
    *,
    k_max: float,
    rings: int = 200,
    time: float | Iterable[float] = 0.0,
) -> StructureFactor:
    """S(k) of one or several frames at the k that a periodic box allows, from 2 pi / L to `k_max` [1/length].

    All of them while there are not more than `MOST_MODES` along an axis; above that, every p-th. InputError if the
    box is not periodic, k_max is below 2 pi / L, or finufft is missing.

    Parameters
    ----------
    position : array (n, 2) or frames of them
        Centres in the box [length].
    rings : int
        Rings between 0 and `k_max`; they are no narrower than 2 pi / L, and empty ones are left out.
    time : float or one for each frame
        Needed for sheared boxes [time].

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.structure_factor(20.0 * rng.random((2000, 2)), (20.0, 20.0), k_max=10.0, rings=10)
    >>> bool(abs(found.S[-1] - 1.0) < 0.2)  # points at random: 1
    True
    """
    box = as_box(box)
    if box.is_open or not all(box.periodic):
        raise InputError("S(k) needs a box that is periodic along x and y")
    lengths = np.array(box.lengths)
    least = 2.0 * np.pi / lengths.max()
    if not k_max > least:
        raise InputError(
            f"k_max = {k_max:g}: must be above 2 pi / L = {least:.4g}, the smallest k that the box allows"
        )
    count = min(rings, max(1, int(k_max / least)))
    edges = np.linspace(0.0, k_max, count + 1)
    edges[0] = 1e-9 * least  # k = 0 is no fluctuation
    number, sum_S, sum_k = np.zeros((3, count))
    frames = 0
    for points, when in zip(each(position), times_of(time), strict=False):
        begin = 0.0
        for stride, end in _passes(lengths, k_max):
            modes = np.minimum(np.ceil(end * lengths / (2.0 * np.pi * stride)), MOST_MODES // 2).astype(int)
            if box.shear_rate:  # the skew moves k_y by up to k_x / 2 Lx / Ly
                modes[1] += int(np.ceil(0.5 * modes[0])) + 1
            k, S = mode_intensities(points, box, (int(modes[0]), int(modes[1])), stride=stride, time=when)
            size = np.hypot(k[..., 0], k[..., 1])
            half = np.zeros(size.shape, dtype=bool)  # of k and -k one
            half[modes[0] + 1 :] = True
            half[modes[0], modes[1] + 1 :] = True
            chosen = half & (size > begin) & (size <= end)
            ring = np.clip(np.searchsorted(edges, size[chosen]) - 1, 0, count - 1)
            number += np.bincount(ring, minlength=count)
            sum_S += np.bincount(ring, S[chosen], minlength=count)
            sum_k += np.bincount(ring, size[chosen], minlength=count)
            begin = end
        frames += 1
    if frames == 0:
        raise InputError("no frames: there is no S(k)")
    full = number > 0.0
    number, S, k = number[full], sum_S[full] / number[full], sum_k[full] / number[full]
    return StructureFactor(k, S, S / np.sqrt(number), np.rint(number / frames).astype(np.int64), frames)


def _passes(lengths: Array, k_max: float) -> list[tuple[int, float]]:
    """Strides, and up to which k each goes: 1 as far as the modes reach, then one that reaches k_max."""
    half = MOST_MODES // 2
    reach = 2.0 * np.pi * half / float(lengths.max())
    if reach >= k_max:
        return [(1, k_max)]
    return [(1, reach), (int(np.ceil(k_max / reach)), k_max)]
