"""Withheld: an uncertainty that is not told, and why."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Model
from identify.uncertainty.uncertainty import Uncertainty


@dataclass(frozen=True, eq=False)
class Withheld(Uncertainty):
    """What stands where a number would mislead.

    withheld : the reason.
    """

    model: Model
    withheld: str
    kind: str = "withheld"

    def of(self, function: Callable[[Model], np.ndarray]) -> np.ndarray:
        """Refuse, with the reason."""
        raise ExciteError(f"uncertainty withheld: {self.withheld}")
