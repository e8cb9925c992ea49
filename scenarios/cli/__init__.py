"""The command line, one file per command."""

from typing import TYPE_CHECKING

from excite.lazy import face

if TYPE_CHECKING:
    from scenarios.cli.entry import main

__all__ = ["main"]
__getattr__, __dir__ = face(__name__, {"main": "scenarios.cli.entry"})
