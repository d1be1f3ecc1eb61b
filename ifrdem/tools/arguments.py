"""Command lines of scripts: options from the arguments of a function, messages that never fail."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TextIO

from ..errors import EngineError, InputError, printable


class Unfailing:
    """Stream for messages that drops what cannot be written (full disk): the exit status stays the same."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text, or drop it."""
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write buffered text, or leave it."""
        with contextlib.suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def unfailing_messages() -> Iterator[None]:
    """Ignore errors of writing messages to standard error; if it is closed (`2>&-`), they are dropped.

    What the encoding of the standard output lacks, such as signs of units on an ASCII terminal, is written by its
    number.
    """
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")
    with contextlib.ExitStack() as stack:
        stream = sys.stderr or stack.enter_context(open(os.devnull, "w", encoding="utf-8"))
        stack.enter_context(contextlib.redirect_stderr(Unfailing(stream)))
        try:
            yield
        finally:
            try:
                stream.flush()
            except OSError:
                with contextlib.suppress(OSError):  # not a file
                    forget(stream)


def forget(stream: TextIO) -> None:
    """Drop what the file of a stream cannot take: Python would try again at its end, and exit with status 120."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@unfailing_messages()
def script(function: Callable[..., int | None], arguments: Sequence[str] | None = None) -> int:
    """Exit status of a function that is called with a command line: its keyword arguments are the options.

    It is what the function returns, 0 for None; 2 of bad input, 1 if the engine stops, 130 when interrupted.
    """
    from cyclopts import App, CycloptsError

    app = App(default_command=function, result_action="return_value", version_flags=[])
    try:
        given = sys.argv[1:] if arguments is None else arguments
        return app(given, exit_on_error=False, print_error=False) or 0
    except (InputError, CycloptsError, EngineError) as error:
        print(f"{function.__name__}: {printable(str(error))}", file=sys.stderr)
        return 1 if isinstance(error, EngineError) else 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of the output went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
