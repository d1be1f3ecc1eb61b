"""Initial states: places without overlaps, velocities, spins, distributions of radii.

`random_positions`, `hexagonal_positions` and `grow` (dense random packings) place disks; `separate` parts disks that
overlap slightly; `maxwellian` and `gaussian_spins` draw velocities and spins; `radii` draws radii.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
