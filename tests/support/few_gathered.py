"""`mpiexec -n P python few_gathered.py run CASE ...`: commands of ifrdem, where more than 1000 disks are many."""

from __future__ import annotations

import sys

from ifrdem.tools import slices

slices.GATHERED = 1000

if __name__ == "__main__":
    from ifrdem.cli.main import main

    sys.exit(main(sys.argv[1:]))
