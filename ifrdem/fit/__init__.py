"""The inverse problem: the law's coefficients from measured impacts of one disk on another at rest.

data = fit.read("data.csv", {"angles": 0.7})
found = fit.fit(data, M=1.0)
print(fit.table(found))
"""

from ..tools import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__, __file__)
