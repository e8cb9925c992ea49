"""Simulated plants with honest noise and a known truth. `from plants import list_plants, load_plant`."""

from importlib import import_module
from typing import Any

__all__ = ["list_plants", "load_plant"]


def __getattr__(name: str) -> Any:
    """Import the registry when it is first asked for (PEP 562): a command that needs no plant does not pay for one."""
    if name not in __all__:
        raise AttributeError(f"module 'plants' has no attribute '{name}'")
    return getattr(import_module("plants.registry"), name)
