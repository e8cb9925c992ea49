"""The command line, one file a command group."""

import sys


def main() -> None:
    """Run the command line and exit with its code; Ctrl-C while the packages load ends it as quietly as later."""
    try:
        from scenarios.cli.main import status
    except KeyboardInterrupt:
        sys.stderr.write("excite: interrupted\n")
        sys.exit(130)
    sys.exit(status())
