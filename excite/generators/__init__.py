"""Generators: functions that return a Signal; one line in `excite.generators.registry` adds one everywhere."""

from importlib import import_module
from typing import Any

# At once, since these functions are called as their files are: the import of a file, whoever does it, puts the module
# under that name here, and `from excite.generators import prbs` must give the function.
from excite.generators.compose import in_sequence, rest, side_by_side, with_ramps
from excite.generators.multisine import multisine
from excite.generators.multistep import log_times, multistep
from excite.generators.noise import noise
from excite.generators.prbs import prbs
from excite.generators.sweep import sweep

__all__ = [
    "GENERATORS",
    "in_sequence",
    "log_times",
    "multisine",
    "multistep",
    "noise",
    "prbs",
    "regenerate",
    "rest",
    "side_by_side",
    "sweep",
    "with_ramps",
]


def __getattr__(name: str) -> Any:
    """Import the table when it is asked for (PEP 562): it needs limits and their shaping."""
    if name not in ("GENERATORS", "regenerate"):
        raise AttributeError(f"module 'excite.generators' has no attribute '{name}'")
    return getattr(import_module("excite.generators.registry"), name)
