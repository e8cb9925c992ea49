"""Sample-wise nonlinear actuators in front of a plant: each element's memory is its own last output."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Element(Protocol):
    """One nonlinearity; `step` takes the input and the element's last output, (…, nu) each, and returns its output."""

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray: ...  # noqa: D102


@dataclass(frozen=True)
class Saturation:
    """v = min(max(u, low), high)."""

    low: float
    high: float

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Clip."""
        return np.clip(u, self.low, self.high)


@dataclass(frozen=True)
class RateLimit:
    """v moves by at most `rate` per sample from its last value; v starts at 0."""

    rate: float

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Clip to the neighbourhood of the last output."""
        return np.clip(u, last - self.rate, last + self.rate)


@dataclass(frozen=True)
class Backlash:
    """Play of the given width: v stays until u drags it along; v starts at 0."""

    width: float

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Keep the last output within half a width of u."""
        return np.clip(last, u - self.width / 2, u + self.width / 2)


@dataclass(frozen=True)
class Quantiser:
    """v = the multiple of `step_size` nearest to u."""

    step_size: float

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Round."""
        return np.round(u / self.step_size) * self.step_size


ELEMENTS: dict[str, type] = {"saturation": Saturation, "rate_limit": RateLimit, "backlash": Backlash, "quantiser": Quantiser}


def actuate(elements: Sequence[Element], u: np.ndarray) -> np.ndarray:
    """Return the actuator's output for a whole sequence u (N, nu)."""
    for element in elements:
        v, last = np.empty_like(u), np.zeros(u.shape[1])
        for k, each in enumerate(u):
            v[k] = last = element.step(each, last)
        u = v
    return u
