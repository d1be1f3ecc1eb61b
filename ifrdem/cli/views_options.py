"""The verb `ifrdem views`."""

from __future__ import annotations

import argparse
from typing import Any


def add_to(verbs: Any) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "views",
        help="let ParaView, OVITO, xarray and ASE open a trajectory",
        description="Write NAME.vtkhdf (ParaView, PyVista, VTK) and NAME.nc (OVITO, xarray, ASE) beside NAME.h5. They "
        "point at its data and copy none: keep the three files together, and write them again when the run has added "
        "frames. Existing views are replaced.",
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a trajectory (.h5)")
    parser.set_defaults(act=act)


def act(options: argparse.Namespace) -> int:
    """Do it."""
    from ..trajectory import views

    for path in views.write_views(options.file):
        print(f"wrote {path}", flush=True)
    return 0
