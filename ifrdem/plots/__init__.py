"""Pictures of runs: each function reads a trajectory and writes a PNG file.

`cooling`, `driven`, `walled`, `sheared`: the picture that `ifrdem run` makes of such a gas.
"""

from ..tools import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__, __file__)
