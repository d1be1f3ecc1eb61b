"""Ctrl-C during a run from Python: it takes effect where the gas is in a whole state."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType


class Deferred:
    """Delay of Ctrl-C: KeyboardInterrupt is raised at the end of the block; a context manager.

    A second Ctrl-C raises it at once. Nothing is delayed in a thread other than the main one, or where a handler other
    than Python's own is installed for SIGINT, such as that of the command `ifrdem run`.
    """

    def __init__(self) -> None:
        self._came = self._ours = False

    def __enter__(self) -> Deferred:
        self._came = False
        self._ours = (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        )
        if self._ours:
            signal.signal(signal.SIGINT, self._heard)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            if self._came and kind is None:
                raise KeyboardInterrupt

    @contextmanager
    def lifted(self) -> Iterator[None]:
        """Let a further Ctrl-C take effect at once, within the block: code of the user's."""
        if not self._ours:
            yield
            return
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, self._heard)

    def _heard(self, number: int, _frame: FrameType | None) -> None:
        if self._came:
            raise KeyboardInterrupt
        self._came = True
