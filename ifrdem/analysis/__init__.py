"""Analyses of granular gases: functions of NumPy arrays from any source, returning arrays with errors.

Lengths, times and masses are in whatever units the arrays are in, temperatures are energies (k_B = 1). g(r), clusters
and psi_6 need the package freud, S(k) finufft: `pip install 'ifrdem[analysis]'`.
"""

from ..tools import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__, __file__)
