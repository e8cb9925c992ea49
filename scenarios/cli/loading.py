"""Ctrl-C while packages load."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def loading() -> Iterator[None]:
    """Let Ctrl-C end the process at once while packages load: some of them make an ImportError of it."""
    handler, main_thread = signal.getsignal(signal.SIGINT), threading.current_thread() is threading.main_thread()
    if handler is not signal.default_int_handler or not main_thread:  # a background job, or somebody else's program
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
