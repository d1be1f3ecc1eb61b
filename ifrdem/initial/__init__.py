"""Initial states: places without overlaps, velocities, spins, distributions of radii.

`random_positions`, `hexagonal_positions` and `grown_positions` (dense random packings) place disks; `separate` parts
disks that overlap slightly; `maxwellian` and `gaussian_spins` draw velocities and spins; `radii` draws radii.
"""

from ..tools import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__, __file__)
