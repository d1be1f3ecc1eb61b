"""The command `ifrdem`, and `python -m ifrdem`, the same."""

from __future__ import annotations

import contextlib
import sys


def main() -> int:
    """Run the command line and return its exit status."""
    if sys.argv[1:] == ["--version"]:  # without the imports of all commands
        with contextlib.suppress(
            OSError, AttributeError
        ):  # no output, or a closed one: reported below as always
            from .tools.versions import shown

            print(shown(), flush=True)
            return 0
    try:
        from .cli.main import main as run
    except KeyboardInterrupt:
        from .cli.console import INTERRUPTED

        print("ifrdem: interrupted before the command began", file=sys.stderr)
        return INTERRUPTED
    return run()


if __name__ == "__main__":
    sys.exit(main())
