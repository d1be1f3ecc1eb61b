from . import radii as radii
from .packing import grown_positions as grown_positions
from .packing import separate as separate
from .placement import gaussian_spins as gaussian_spins
from .placement import hexagonal_positions as hexagonal_positions
from .placement import maxwellian as maxwellian
from .placement import random_positions as random_positions
