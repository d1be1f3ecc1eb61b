"""The gas as the user states it: disks, box, walls, collision laws, forces; and what is measured of a state.

`state`: `Disks`, `State`. `box`: `Box`. `walls`: `Wall`, `Motion`. `laws`: collision laws and the paper's coins.
`forces`: what acts between collisions. `observables`: temperatures, energy, momentum of a state.
"""

from ..tools import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__, __file__)
