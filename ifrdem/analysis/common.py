"""Frames as arrays, boxes, neighbours, standard errors of correlated series, for all analyses."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import Array

PACKAGES = {"freud": "freud-analysis", "finufft": "finufft"}
"""Name to import -> name to install."""


def load(name: str, purpose: str) -> ModuleType:
    """Import one of them.

    InputError if it is absent: the message says what needs it and how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f'{purpose} needs the package {PACKAGES[name]}: `pip install "ifrdem[analysis]"` adds it ({error})'
        ) from None


Positions = Array | Iterable[Array]
"""One frame, shape (n, 2), or several: an array (frames, n, 2) or anything that yields frames one by one."""


def as_box(box: Box | ArrayLike) -> Box:
    """A box as it is, or the periodic one of these two side lengths [length]."""
    if isinstance(box, Box):
        return box
    lengths = np.asarray(box, dtype=float)
    if lengths.shape != (2,):
        raise InputError(f"box: a Box or two side lengths are needed, not an array of shape {lengths.shape}")
    return Box((float(lengths[0]), float(lengths[1])))


def each(values: Positions, components: int = 2) -> Iterator[Array]:
    """The frames of `values`, checked: shape (n, 2), or (n,) where there is one component."""
    axes = 1 if components == 1 else 2
    if isinstance(values, np.ndarray) and values.ndim == axes:
        values = values[None]
    for value in values:
        frame = np.asarray(value, dtype=np.float64)
        if frame.ndim != axes or (axes == 2 and frame.shape[1] != components):
            wanted = "(n,)" if axes == 1 else f"(n, {components})"
            raise InputError(f"a frame has shape {frame.shape}: {wanted} is needed")
        if not np.all(np.isfinite(frame)):
            raise InputError("a frame holds numbers that are not finite")
        yield frame


def times_of(time: float | Iterable[float]) -> Iterator[float]:
    """The times of frames: those given, or the same one again and again."""
    if isinstance(time, int | float | np.number):
        while True:
            yield float(time)
    yield from (float(one) for one in time)
    raise InputError("there are fewer times than frames")


class FreudFrame(NamedTuple):
    """A frame as freud takes it."""

    box: Any
    points: NDArray[np.float32]


def freud_frame(position: Array, box: Box, reach: float, time: float, purpose: str) -> FreudFrame:
    """Positions [length] in a box of freud whose sides are all periodic, for neighbours up to `reach` [length].

    Where the box is not periodic it is wider by `reach`, so that nothing has neighbours through a side. A sheared box
    is a skewed one. freud computes in single precision. InputError if the reach is more than half the shortest side,
    where neighbours would be counted twice.
    """
    freud = load("freud", purpose)
    low, lengths = np.zeros(2), np.array(box.lengths)
    if box.is_open:
        low = position.min(axis=0)
        lengths = np.ptp(position, axis=0)
    periodic = np.array(box.periodic)
    lengths = np.where(periodic, lengths, lengths + 2.5 * reach)
    low = np.where(periodic, low, low - 1.25 * reach)
    if reach >= 0.5 * lengths.min():
        raise InputError(
            f"{purpose}: neighbours up to {reach:.4g} are asked for, and half the shortest side of the box is "
            f"{0.5 * lengths.min():.4g}: choose a shorter distance"
        )
    shift = box.image_above(time) if box.shear_rate else 0.0
    shift -= lengths[0] if shift > 0.5 * lengths[0] else 0.0
    made = freud.box.Box(lengths[0], lengths[1], xy=shift / lengths[1], is2D=True)
    points = np.zeros((len(position), 3), dtype=np.float32)
    points[:, :2] = position - (low + 0.5 * lengths)
    return FreudFrame(made, made.wrap(points))


def neighbours(
    position: Array, box: Box, reach: float, time: float = 0.0, purpose: str = "neighbours"
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Pairs i < j of centres nearer than `reach` [length], and the vectors from i to j [length], (p,), (p,), (p, 2).

    Found by freud in single precision with a margin, measured in double.
    """
    if len(position) < 2:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), np.zeros((0, 2))
    freud = load("freud", purpose)
    span = 1.0 if box.is_open else max(box.lengths)
    margin = reach + 1e-6 * span
    frame = freud_frame(position, box, margin, time, purpose)
    query = freud.locality.AABBQuery(frame.box, frame.points)
    found = query.query(frame.points, {"r_max": margin, "exclude_ii": True}).toNeighborList()
    i = np.asarray(found.query_point_indices, dtype=np.intp)
    j = np.asarray(found.point_indices, dtype=np.intp)
    once = i < j
    i, j = i[once], j[once]
    vector = box.minimum_image(position[j] - position[i], time)
    near = np.einsum("ij,ij->i", vector, vector) < reach * reach
    return i[near], j[near], vector[near]


def correlation_time(series: ArrayLike) -> float:
    """Integrated autocorrelation time of a series in steps, at least 1/2; the error of its mean is sqrt(2 tau / n) std.

    The sum of the autocorrelation, stopped at the first lag above five times itself (Madras and Sokal, J. Stat. Phys.
    50, 109 (1988), doi:10.1007/BF01022990).

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> round(analysis.correlation_time(rng.normal(size=10_000)), 1)  # independent numbers
    0.5
    """
    x = np.array(series, dtype=float)
    x -= x.mean()
    n = len(x)
    if n < 4 or not np.any(x):
        return 0.5
    padded = np.fft.rfft(x, 2 * n)
    covariance = np.fft.irfft(np.abs(padded) ** 2)[:n]
    tau = 0.5 + np.cumsum(covariance[1:] / covariance[0])
    lags = np.arange(1, n)
    # The last lag is one: over all lags the autocorrelation about the mean adds up to -1/2, and tau to 0.
    stop = int(np.argmax(lags >= 5.0 * np.maximum(tau, 0.5)))
    return max(0.5, float(tau[stop]))


def mean_with_error(series: ArrayLike) -> tuple[float, float]:
    """Mean of a series and its standard error by `correlation_time`; nan for one value.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> mean, error = analysis.mean_with_error(rng.normal(5.0, 1.0, size=10_000))
    >>> bool(abs(mean - 5.0) < 4.0 * error), round(error, 2)
    (True, 0.01)
    """
    x = np.asarray(series, dtype=float)
    if len(x) < 2:
        return float(x.mean()), float("nan")
    return float(x.mean()), float(np.std(x, ddof=1) * np.sqrt(2.0 * correlation_time(x) / len(x)))
