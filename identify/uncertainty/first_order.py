"""FirstOrder: the covariance of the poles, to first order in the noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Model
from identify.uncertainty.uncertainty import Uncertainty


@dataclass(frozen=True, eq=False)
class FirstOrder(Uncertainty):
    """The poles' covariance alone, from a theory that carries the noise to them and to nothing else.

    pole_covariance : (n, 2, 2), of the real and the imaginary part of each pole, in the order of `model.poles()`.
    """

    model: Model
    pole_covariance: np.ndarray
    kind: str = "asymptotic, first order in the noise"
    withheld: str | None = None

    def of(self, function: Callable[[Model], np.ndarray]) -> np.ndarray:
        """Refuse: the theory tells the poles alone."""
        raise ExciteError(f"uncertainty ({self.kind}): it is known for the poles alone; ask for poles(), or bootstrap")

    def poles(self) -> np.ndarray:
        """Return the covariance (n, 2, 2) of each pole."""
        return self.pole_covariance
