"""The entry point of the command `excite`."""

import io
import sys

from scenarios.cli.loading import loading


def main() -> None:
    """Run the command line and exit with its code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal of few characters shows ? for the others, and no crash
    with loading():
        from scenarios.cli.main import status
    sys.exit(status())
