"""The command line, one file a command group."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager


def main() -> None:
    """Run the command line and exit with its code."""
    with loading():
        from scenarios.cli.main import status
    sys.exit(status())


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
