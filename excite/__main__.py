"""`python -m excite` is the command `excite`."""

from scenarios.cli.main import main

main()
