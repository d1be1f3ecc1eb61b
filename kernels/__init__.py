"""Taichi kernels: the collision law and the event engine. No I/O, no `ti.init`, no printing here."""

import os
import tempfile

# Taichi aborts the process without HOME, as batch systems and containers may leave it.
if "HOME" not in os.environ:
    home = os.path.expanduser("~")  # "~" itself for a user without an entry
    os.environ["HOME"] = home if os.path.isabs(home) else tempfile.gettempdir()
