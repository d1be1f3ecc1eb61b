"""Ranks of MPI: a communicator, and which rows each rank has.

Names are imported when they are first used: they import NumPy, which `ifrdem --help` does not wait for.
"""

from typing import TYPE_CHECKING

import lazy_loader as _lazy_loader

if TYPE_CHECKING:
    from . import communicator as communicator
    from .communicator import SERIAL as SERIAL
    from .communicator import Communicator as Communicator
    from .communicator import collective as collective
    from .communicator import current as current
else:
    __getattr__, __dir__, _ = _lazy_loader.attach(
        __name__,
        submodules=["communicator"],
        submod_attrs={"communicator": ["SERIAL", "Communicator", "collective", "current"]},
    )
