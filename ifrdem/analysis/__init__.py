"""Analyses of granular gases: functions of NumPy arrays from any source, returning arrays with errors.

Lengths, times and masses are in whatever units the arrays are in, temperatures are energies (k_B = 1). Some need the
extra `analysis` (`ifrdem docs install`).
"""

from ..tools import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__, __file__)
