"""Nothing of the user's is touched: kernels, examples and settings of matplotlib are in a folder of the clone.

Imported before Taichi and matplotlib. Variables that are set stay what they are.
"""

from __future__ import annotations

import os
from pathlib import Path

OWN = Path(__file__).parents[2] / "build" / "tests"
SETTINGS = {"MPLCONFIGDIR": str(OWN / "matplotlib"), "HYPOTHESIS_STORAGE_DIRECTORY": str(OWN / "hypothesis")}
for prefix in ("TI", "QD"):  # Taichi by itself throws kernels away at 100 MB, a third of what tests ask for
    SETTINGS[f"{prefix}_OFFLINE_CACHE_FILE_PATH"] = str(OWN / "kernels")
    SETTINGS[f"{prefix}_OFFLINE_CACHE_CLEANING_POLICY"] = "never"
os.environ.update({name: value for name, value in SETTINGS.items() if name not in os.environ})


def kernels() -> Path:
    """The folder of compiled kernels."""
    return Path(os.environ["TI_OFFLINE_CACHE_FILE_PATH"])
