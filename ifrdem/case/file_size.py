"""How large a trajectory file becomes: its data in whole chunks, HDF5's trees of chunks, and groups.

HDF5's default format ("File Format Specification", version 1 of its B-trees): a chunk is stored whole, however few
rows of it are used; the tree of a dataset of rank r has nodes for 64 chunks, of 24 + 64 x 8 + 65 x (8 + 8 (r + 1))
bytes, and where chunks come in order each is left nine tenths full. What groups, links and headers take was measured on
files with 2 to 20,000 frames and rows (HDF5 of h5py 3.16, 2026-11-21): some 1,510 bytes a dataset, whatever it holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..trajectory import layout

GROUP_BYTES = 1510
"""Of each dataset with a group of its own, links and header."""
SHARED_BYTES = 690
"""Of those that share a group, the columns of histories."""
RECORD_BYTES = 14_000
"""Of the record (`parameters`), the constant properties and the box, beside the texts of the case."""
COPIES = 2
"""Of the case's text: as it was written, and in full."""
NODE = 64
FILLED = 0.9 * NODE


def disk_bytes(fields: Sequence[str], precision: str) -> int:
    """Bytes per disk and frame of these fields in a trajectory file without compression."""
    size = np.dtype(layout.PRECISIONS[precision]).itemsize
    chosen = [layout.FIELDS[name] for name in fields]
    return sum(field.components * (4 if field.count else size) for field in chosen)


def trajectory_bytes(
    n: int,
    fields: Sequence[str],
    precision: str,
    *,
    frames: int,
    observables: Mapping[str, int],
    rows: int,
    series: Mapping[str, int],
    tracked: int,
    events: int,
    text: int,
) -> int:
    """Bytes of a trajectory file without compression.

    Parameters
    ----------
    n : int
        Disks.
    fields, precision
        What a frame holds of each.
    frames, rows, events : int
        Of the trajectory, of the time series, of the histories.
    observables, series : mapping
        Name -> number of components, of 8 bytes each.
    tracked : int
        Disks with histories.
    text : int
        Characters of the case.
    """
    stored = [_dataset(frames, layout.CHUNK_FRAMES, width, 8) for width in (1, 1, 3, *observables.values())]
    per_chunk, item = layout.chunk_disks(n), np.dtype(layout.PRECISIONS[precision]).itemsize
    for name in fields:
        field = layout.FIELDS[name]
        chunks = frames * -(-n // per_chunk)
        size = per_chunk * field.components * (4 if field.count else item)
        stored.append(chunks * size + _tree(chunks, 1 + field.components) + GROUP_BYTES)
    if rows:
        stored += [_dataset(rows, max(1, layout.CHUNK_ROWS // width), width, 8) for width in series.values()]
    if tracked:
        most, few = layout.CHUNK_EVENTS, layout.FEW_EVENTS
        chunk = most if tracked >= layout.MANY else min(most, few)
        for column in layout.EVENT_COLUMNS.values():
            size = _dataset(events, chunk, column.components, np.dtype(column.dtype).itemsize)
            stored.append(size - GROUP_BYTES + SHARED_BYTES)
        # Where they begin: position, velocity, spin, image, and which they are.
        stored.append((2 * 8 + 2 * 8 + 8 + 2 * 4 + 4) * tracked + 8 * SHARED_BYTES)
    # The constant properties once: radius, mass, k in 8 bytes, the material in 4.
    return sum(stored) + 28 * n + RECORD_BYTES + COPIES * text


def _dataset(rows: int, chunk: int, width: int, item: int) -> int:
    """Bytes of rows of `width` items, with so many rows in a chunk."""
    chunks = math.ceil(rows / chunk)
    return chunks * chunk * width * item + _tree(chunks, 1 if width == 1 else 2) + GROUP_BYTES


def _tree(chunks: int, rank: int) -> int:
    """Bytes of the tree of so many chunks of a dataset of this rank."""
    node = 24 + NODE * 8 + (NODE + 1) * (8 + 8 * (rank + 1))
    if chunks <= NODE:
        return node if chunks else 0
    leaves = math.ceil(chunks / FILLED)
    return node * leaves + _tree(leaves, rank)
