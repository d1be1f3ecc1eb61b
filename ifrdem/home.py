"""The home folder of the user, which the runtimes of the kernels ask for."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile

_made_home: str | None = None


def has_home() -> bool:
    """True if the user has a home folder. The variable HOME is set, without which the runtimes abort the process.

    Batch systems and containers may leave it out. For a user who has no entry either, it names a new private folder,
    which is removed when this process ends: a fixed name in a folder for all could be made by another user.
    """
    global _made_home
    if not os.environ.get("HOME"):
        home = os.path.expanduser("~")  # "~" itself for a user without an entry
        if not os.path.isabs(home):
            home = _made_home = tempfile.mkdtemp(prefix="ifrdem-home-")
            atexit.register(shutil.rmtree, home, ignore_errors=True)
        os.environ["HOME"] = home
    return os.environ["HOME"] != _made_home
