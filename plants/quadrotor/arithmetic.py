"""What differs between the numbers of one flight, floats, and those of many flown together, arrays over flights.

Everything that happens in a step is written once, with operators and the functions below. Python floats are an order of
magnitude faster for one flight than arrays of length one; arrays are several times faster for many. Both give the same
bits: operators and square roots are exact by IEEE 754, and angles, which are not, come from the same library; a last digit
more or less would decide, once in many flights, how a motor command is rounded.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Arithmetic:
    """clip(x, low, high); floor, sqrt, asin elementwise; atan2(y, x); all: whether a condition holds in every flight."""

    clip: Callable[[Any, float, float], Any]
    floor: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    asin: Callable[[Any], Any]
    atan2: Callable[[Any, Any], Any]
    all: Callable[[Any], bool]


def _clip(x: float, low: float, high: float) -> float:
    return low if x < low else high if x > high else x


def _clip_each(x: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.minimum(np.maximum(x, low), high)


def _each(function: Callable[..., float]) -> Callable[..., np.ndarray]:
    def apply(*arrays: np.ndarray) -> np.ndarray:
        return np.fromiter(map(function, *(array.tolist() for array in arrays)), float, len(arrays[0]))

    return apply


FLOATS = Arithmetic(_clip, math.floor, math.sqrt, math.asin, math.atan2, bool)
ARRAYS = Arithmetic(_clip_each, np.floor, np.sqrt, _each(math.asin), _each(math.atan2), np.all)
