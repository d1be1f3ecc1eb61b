"""Pairs of points that are near each other, across the periodic sides of a box too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..tools.checked import Array
from .box import Box

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
Finder = Callable[..., Pairs]

AT_ONCE = 200_000
"""Points whose neighbours are looked for at a time."""
_MOST_CELLS = 2**31  # along an axis


def near_pairs(box: Box, reach: float, points: Array, others: Array | None = None) -> Pairs:
    """Indices i of points and j of others no further apart than `reach` [length]; without others, i < j.

    The search uses cells, and not scipy, whose import takes longer than a usual search. Pairs at a distance of `reach`
    to rounding may be missing.

    Parameters
    ----------
    points, others : arrays (n, 2), (m, 2)
        Positions [length], wrapped into the box.
    """
    owner, images = _with_images(box, reach, points if others is None else others)
    if not len(points) or not len(images):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    low = np.minimum(points.min(axis=0), images.min(axis=0))
    side = np.maximum(reach, (np.maximum(points.max(axis=0), images.max(axis=0)) - low) / _MOST_CELLS)
    cell = ((images - low) / side).astype(np.int64)
    rows = int(cell[:, 1].max()) + 3  # an empty row below and above, as columns follow one another
    key = cell[:, 0] * rows + cell[:, 1]
    order = np.argsort(key, kind="stable")
    key, owner, images = key[order], owner[order], images[order]
    own = ((points - low) / side).astype(np.int64) @ (rows, 1)
    sequence = np.argsort(own, kind="stable")
    found = [(np.empty(0, np.intp), np.empty(0, np.intp))]
    for begin in range(0, len(points), AT_ONCE):
        some = sequence[begin : begin + AT_ONCE]
        for column in (-rows, 0, rows):
            first = np.searchsorted(key, own[some] + (column - 1))
            count = np.searchsorted(key, own[some] + (column + 1), side="right") - first
            i = np.repeat(some, count)
            k = np.repeat(first - (np.cumsum(count) - count), count) + np.arange(len(i))
            apart_x, apart_y = points[i, 0] - images[k, 0], points[i, 1] - images[k, 1]
            near = apart_x * apart_x + apart_y * apart_y <= reach * reach
            i, j = i[near], owner[k[near]]
            found.append((i, j) if others is not None else (i[i < j], j[i < j]))
    i, j = (np.concatenate(each) for each in zip(*found, strict=True))
    if 2.0 * reach > box.shortest_period:  # some may be near across both sides
        i, j = np.unique(np.stack([i, j]), axis=1)
    return i, j


def _with_images(box: Box, reach: float, points: Array) -> tuple[NDArray[np.intp], Array]:
    """Points and their images within `reach` of the periodic sides of a box: indices, and positions."""
    owner, images = np.arange(len(points)), points
    for axis, period in enumerate(box.periods):
        if period:
            low = np.flatnonzero(images[:, axis] <= reach)
            high = np.flatnonzero(images[:, axis] >= period - reach)
            shift = np.zeros(2)
            shift[axis] = period
            images = np.concatenate([images, images[low] + shift, images[high] - shift])
            owner = np.concatenate([owner, owner[low], owner[high]])
    return owner, images


def near_pairs_by_trees(box: Box, reach: float, points: Array, others: Array | None = None) -> Pairs:
    """The pairs of `near_pairs` in the order of scipy's trees, on which the bits of packings depend."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points, boxsize=box.periods)
    if others is None:
        i, j = tree.query_pairs(reach, output_type="ndarray").T
        return i, j
    close = tree.sparse_distance_matrix(cKDTree(others, boxsize=box.periods), reach, output_type="ndarray")
    return close["i"], close["j"]
