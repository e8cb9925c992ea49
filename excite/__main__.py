"""`python -m excite` is the command `excite`."""

from scenarios.cli import main

main()
