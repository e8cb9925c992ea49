"""What every method that ends in a state space has in common: regions for the eigenvalues of A."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from identify.method import Method, Taken
from identify.steps.regions import Stable, region
from identify.steps.shift import Region, Shift, dynamics


@dataclass(frozen=True)
class StateSpaceMethod(Method[Taken, int]):
    """A method whose A comes through the one door, `steps.shift`."""

    order_is: ClassVar[str | None] = "states"

    stability_guard: bool = field(
        default=False,
        metadata={
            "meaning": "replace an unstable A by a stable one (Maciejowski 1995); not for unstable or integrating plants"
        },
    )
    regions: tuple[str | Region, ...] = field(
        default=(), metadata={"meaning": 'regions of the z-plane that hold the eigenvalues of A, by name: ["stable"]'}
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for each in self.regions:
            region(each)  # an unknown name is refused

    def dynamics(self, shift: Shift) -> tuple[np.ndarray, tuple[str, ...]]:
        """Return A, inside the regions that the settings ask for, and what they changed."""
        guard = (Stable(),) if self.stability_guard and "stable" not in self.regions else ()
        return dynamics(shift, (*guard, *map(region, self.regions)))
