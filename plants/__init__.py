"""Simulated plants, their noise and their truth. `from plants import list_plants, load_plant`."""

from typing import TYPE_CHECKING

from excite.lazy import face

if TYPE_CHECKING:
    from plants.registry import list_plants, load_plant

__all__ = ["list_plants", "load_plant"]
__getattr__, __dir__ = face(__name__, {"list_plants": "plants.registry", "load_plant": "plants.registry"})
