"""placeholder until the models branch is merged"""

from dataclasses import dataclass

import numpy as np

from excite.models.model import Model


@dataclass(frozen=True, eq=False)
class FrequencyResponse(Model):
    f_hz: np.ndarray
    values: np.ndarray
    dt: float | None
    inputs: tuple
    outputs: tuple

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        return self.values
