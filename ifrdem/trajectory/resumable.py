"""Whether a trajectory file is the one that a resumed run has to go on with."""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from ..errors import InputError
from ..model.box import Box
from ..model.state import Disks
from . import layout


def check(
    file: h5py.File,
    path: str,
    *,
    disks: Disks,
    box: Box,
    fields: Sequence[str],
    precision: str,
    compression: str,
    walls: str | None,
) -> None:
    """Raise InputError that says in what the file differs from what the run has; `walls` as JSON."""
    version = tuple(int(part) for part in file["h5md/modules/ifrdem"].attrs["version"])
    if version != layout.LAYOUT_VERSION:
        raise InputError(
            f"{path} has layout {version[0]}.{version[1]}: a run can go on only with files of layout "
            f"{layout.LAYOUT_VERSION[0]}.{layout.LAYOUT_VERSION[1]}; begin a new file"
        )
    _check_disks(file, path, disks)
    stored_box = file[f"{layout.PARTICLES}/box"].attrs
    expected = layout.box_attributes(box)
    for name in dict.fromkeys((*expected, *stored_box)):
        given, stored = expected.get(name), stored_box.get(name)
        if given is None or stored is None or not np.array_equal(given, stored):
            raise InputError(f"{path} has another box: its {name} is {stored}, the run's is {given}")
    held = file["parameters/walls"].asstr()[()] if "parameters/walls" in file else None
    if held != walls:
        raise InputError(f"{path} has other walls: {held or 'none'}, the run has {walls or 'none'}")
    _check_fields(file, path, fields, precision, compression)


def _check_disks(file: h5py.File, path: str, disks: Disks) -> None:
    n = len(file[f"{layout.PARTICLES}/radius"])
    if n != disks.n:
        raise InputError(f"{path} has {n} disks, the run has {disks.n}")
    for name in layout.STATIC:
        given, stored = getattr(disks, name), file[f"{layout.PARTICLES}/{name}"][()]
        different = given != stored
        if different.any():
            i = int(np.argmax(different))
            raise InputError(
                f"{path} has other disks: {name} of disk {i} is {stored[i]}, the run's is {given[i]}"
            )


def _check_fields(
    file: h5py.File, path: str, fields: Sequence[str], precision: str, compression: str
) -> None:
    stored = layout.stored_fields(file)
    if set(stored) != set(fields):
        raise InputError(f"{path} holds the fields {', '.join(stored)}, the run has {', '.join(fields)}")
    for name in stored:
        dataset = layout.field_dataset(file, name)
        if not layout.FIELDS[name].count and dataset.dtype != layout.PRECISIONS[precision]:
            raise InputError(
                f"{path} holds {name} as {dataset.dtype}, the run has precision {precision!r}: "
                f"{np.dtype(layout.PRECISIONS[precision])}"
            )
        held = dataset.compression or "none"
        if held != compression:
            raise InputError(f"{path} has compression {held!r}, the run has {compression!r}")
