"""Clusters: disks that are near one another, directly or through others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import Array
from ..tools.pictured import PicturedResult
from ..tools.reprs import Brief
from .common import as_box, each, neighbours


@dataclass(frozen=True, eq=False, repr=False)
class Clusters(Brief, PicturedResult):
    """Disks joined wherever the gap between two surfaces is below `gap`; a disk alone is a cluster of one."""

    label: NDArray[np.intp]
    """The cluster of each disk, from 0, the largest first; shape (n,)."""
    sizes: NDArray[np.intp]
    radius_of_gyration: Array
    spans: NDArray[np.bool_]
    """sizes, radius_of_gyration, spans: of each cluster: number of disks, falling; root of the mean square distance
    from the mean of its centres [length], nan where it spans the box; True if it is connected to its own image
    through periodic sides; shape (c,)."""
    gap: float
    """The criterion [length]."""

    @property
    def largest(self) -> float:
        """Share of all disks that the largest cluster holds."""
        return float(self.sizes[0] / self.sizes.sum()) if len(self.sizes) else 0.0

    @property
    def mean_size(self) -> float:
        """Mean size of the cluster that a disk is in: sum s^2 / sum s."""
        return float(np.sum(self.sizes.astype(float) ** 2) / self.sizes.sum()) if len(self.sizes) else 0.0


def clusters(
    position: Array, box: Box | ArrayLike, *, radius: ArrayLike, gap: float, time: float = 0.0
) -> Clusters:
    """Clusters of one frame: neighbours by freud, connected components by SciPy.

    InputError if the gap is negative, or so long that disks would see themselves through periodic sides.

    Parameters
    ----------
    position, radius : array (n, 2), and float or array (n,)
        Centres and radii [length].
    box : Box, or two lengths of a periodic one
    gap : float
        Disks whose surfaces are nearer than this are joined [length]. In a homogeneous gas of equal disks that are to
        be told from clusters, a tenth of a diameter or less.
    time : float
        Needed for sheared boxes [time].

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> position = np.array([[1.0, 1.0], [2.05, 1.0], [6.0, 6.0]])
    >>> analysis.clusters(position, (10.0, 10.0), radius=0.5, gap=0.1).sizes
    array([2, 1])
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    box = as_box(box)
    (x,) = each(position)
    n = len(x)
    radii = np.broadcast_to(np.asarray(radius, dtype=float), n)
    if not gap >= 0.0:
        raise InputError(f"gap = {gap:g}: 0 or more is needed")
    if n == 0:
        none = np.zeros(0, dtype=np.intp)
        return Clusters(none, none, np.zeros(0), np.zeros(0, dtype=bool), gap)
    i, j, vector = neighbours(x, box, 2.0 * float(radii.max()) + gap, time, "clusters")
    # Touching disks of a file in single precision are apart or overlap by its rounding.
    near = np.hypot(vector[:, 0], vector[:, 1]) <= radii[i] + radii[j] + gap
    i, j, vector = i[near], j[near], vector[near]
    graph = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    sizes = np.bincount(label, minlength=count)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty(count, dtype=np.intp)
    rank[order] = np.arange(count)
    label = rank[label]
    sizes = sizes[order]

    # Paths along the tree from one disk of each cluster, all trees hung on one more root.
    first = np.unique(label, return_index=True)[1]
    rows = np.concatenate((i, np.full(count, n)))
    columns = np.concatenate((j, first))
    tree = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n + 1, n + 1))
    _, parent = breadth_first_order(tree.tocsr(), n, directed=False)
    parent = np.where(parent < 0, n, parent).astype(np.intp)
    offset = np.zeros((n + 1, 2))
    inner = parent[:n] != n
    offset[:n][inner] = box.minimum_image(x[inner] - x[parent[:n][inner]], time)
    offset[first] = 0.0
    while np.any(parent != n):  # each step halves what is left of the way to the root
        offset += offset[parent] * (parent != n)[:, None]
        parent = parent[parent]
    place = offset[:n]
    # A bond that does not close is one around the box.
    open_bond = np.any(np.abs(place[j] - place[i] - vector) > 1e-6 * max(1.0, float(radii.max())), axis=1)
    spans = np.zeros(count, dtype=bool)
    spans[label[i[open_bond]]] = True
    mean = np.stack([np.bincount(label, place[:, axis], minlength=count) / sizes for axis in (0, 1)], axis=1)
    square = np.bincount(label, np.sum((place - mean[label]) ** 2, axis=1), minlength=count) / sizes
    return Clusters(label, sizes, np.where(spans, np.nan, np.sqrt(square)), spans, gap)
