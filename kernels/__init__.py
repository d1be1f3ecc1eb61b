"""Taichi kernels: the collision law and the event engine. No I/O, no `ti.init`, no printing here."""

import os
import tempfile

# Taichi prints a banner when it is imported; a library has no business doing that.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

# Taichi aborts the process without HOME, as batch systems and containers may leave it.
if "HOME" not in os.environ:
    home = os.path.expanduser("~")
    os.environ["HOME"] = (
        home if os.path.isabs(home) else tempfile.gettempdir()
    )  # "~": a user without an entry
