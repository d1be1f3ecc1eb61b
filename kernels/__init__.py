"""Taichi kernels: the collision law and the event engine. No I/O, no `ti.init`, no printing here."""
