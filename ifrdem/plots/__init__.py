"""Pictures of runs: each function reads a trajectory and writes a PNG file.

`cooling`, `driven`, `walled`, `sheared`: the picture that `ifrdem run` makes of such a gas.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
