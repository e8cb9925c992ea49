"""The entry point of the command `excite`."""

import sys

from scenarios.cli.loading import loading


def main() -> None:
    """Run the command line and exit with its code."""
    with loading():
        from scenarios.cli.main import status
    sys.exit(status())
