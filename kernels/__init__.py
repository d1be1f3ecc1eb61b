"""Taichi kernels: the collision law and the event engine. No I/O, no `ti.init`, no printing here."""

import os

# Taichi prints a banner when it is imported; a library has no business doing that.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
