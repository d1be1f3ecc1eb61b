"""`mpiexec -n P python small_blocks.py run CASE ...`: commands of ifrdem, where blocks are of 4096 disks."""

from __future__ import annotations

import sys

from ifrdem.tools import slices

slices.BLOCK = 4096

if __name__ == "__main__":
    from ifrdem.cli.main import main

    sys.exit(main(sys.argv[1:]))
