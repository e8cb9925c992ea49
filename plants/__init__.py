"""Simulated plants with honest noise and a known truth. `from plants import list_plants, load_plant`."""

from plants.plant import list_plants, load_plant

__all__ = ["list_plants", "load_plant"]
