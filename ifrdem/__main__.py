"""`python -m ifrdem`, the same as the command `ifrdem`."""

from __future__ import annotations

import sys

from .cli.main import main

sys.exit(main())
