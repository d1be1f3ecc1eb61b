"""Event-exact simulation of granular gases of rough disks with the independent friction-restitution law.

A gas is `Disks` in a `Box` with a law (`IFRLaw`, the paper's `coins`) and a `State` (`ifrdem.initial` makes one);
`Simulation` moves it collision by collision, `DSMC` solves its kinetic equation. `TrajectoryWriter` and `Trajectory`
write and read H5MD files. `theory`, `analysis`, `fit` and `plots` say what to expect, what came out, which
coefficients an experiment has, and how it looks; `forces` act between collisions, `bullet` brings the law to PyBullet.
From a shell: `ifrdem --help`; the manual: `ifrdem docs`.

Names are imported when they are first used (`__init__.pyi` lists them), so that `import ifrdem` is quick.
"""

import os

import lazy_loader

# Taichi, imported later by whomever, prints a banner unless told not to, and in a notebook a line for each kernel.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_ENABLE_PYBUF", "0")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
