"""Event-exact simulation of granular gases of rough disks with the independent friction-restitution law.

=====================================  =================================================================
`Disks`, `Box`, `State`                constant properties of disks, the space they move in, their motion
`Wall`, `Motion`, `Turn`               walls at rest, moving, turning, thermal
`VelocityCutoff`, `ContactTime`,
`Rest`                                 remedies for inelastic collapse
`Device`, `RotatingGravity`            device and precision; gravity whose direction rotates
`Piston`, `WallSums`                   a wall with a mass; what walls gave to the disks
`forces`, `laws`                       forces between collisions; collision laws
`ti`                                   the language of custom laws and forces
`IFRLaw`, `coins`, `CollisionLaw`      the law, the coins of the paper, a custom law
`collide`, `Regime`, `EnergyWarning`   a single collision, its regime; a law that could add energy
`initial`                              positions, velocities, spins and radii to start from
`Case`, `run`                          a case file as an object; runs one, as `ifrdem run` does
`Simulation`, `DSMC`                   collision by collision; the kinetic equation of a homogeneous gas
`mpi`, `slice_of`                      ranks of MPI that share a gas; which disks each gives and gets
`observables`, `Ledger`                temperatures and energies of a state; energy by mechanism
`TrajectoryWriter`, `Trajectory`       write and read H5MD files
`PartsWriter`                          the same in parts, by all ranks of MPI
`History`                              every collision of a tracked disk
`Study`, `concat`                      many gases at once; trajectories on one axis of collisions per disk
`view`                                 a trajectory in a notebook, to play and to zoom
`theory`, `analysis`, `plots`          kinetic theory, analyses of arrays or files, figures of runs
`fit`, `engines`, `bullet`             coefficients from experiments; laws in other engines, in PyBullet
`InputError`, `EngineError`            input that cannot be used; a run that cannot continue
`InelasticCollapse`                    an EngineError: collisions without end
`NoMoreCollisions`                     an EngineError: no disk will meet another one
`TheoryWarning`, `WallWarning`         a theory used outside of its range; walls that would crush a disk
`RunWarning`                           a run whose end is reached already
=====================================  =================================================================

>>> import ifrdem
>>> coin = ifrdem.coins["1 pta"]
>>> disks = ifrdem.Disks(100, mass=coin.mass, radius=coin.radius, k=coin.k)
>>> box = ifrdem.Box.from_packing_fraction(disks.radius, 0.25)
>>> position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
>>> velocity = ifrdem.initial.maxwellian(disks.mass, speed_rms=1.0, seed=1)
>>> gas = ifrdem.Simulation(disks, box, coin.law, ifrdem.State(position, velocity, spin=[0.0] * 100))
>>> gas.run(collisions_per_disk=2)
>>> gas.collisions
100

`help(ifrdem.Box)` and others have units, shapes and examples. The manual: `ifrdem docs`; the commands: `ifrdem
--help`. Names are imported when they are first used (`__init__.pyi` lists them), so that `import ifrdem` is quick.
"""

import importlib as _importlib
import os as _os

from .tools import lazy as _lazy
from .tools import renderer as _renderer

# The runtime, imported later by any module, prints a banner by default, and in a notebook a line for each kernel.
for _runtime, _prefix in (("TAICHI", "TI"), ("QUADRANTS", "QD")):
    _os.environ.setdefault(f"ENABLE_{_runtime}_HEADER_PRINT", "0")
    _os.environ.setdefault(f"{_prefix}_ENABLE_PYBUF", "0")
# At its start Taichi asks a server for its newest version, and stores an identifier in the user's cache.
_os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

# Objects of lower layers show themselves in notebooks by the plots, which are imported when one is drawn.
_renderer.set_renderer(lambda: _importlib.import_module("ifrdem.plots.objects"))

# There is no __all__: with it, `help(ifrdem)` would print every class in full, 2,500 lines.
__getattr__, __dir__, _ = _lazy.attach(__name__, __file__)
