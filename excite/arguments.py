"""The one checker of what a user gives: each function returns the value it accepts, or refuses it by its place.

Every refusal reads ``place: value; remedy``. `place` is what the reader calls the value: "prbs: order", "[data] seed".
"""

import math
from collections.abc import Callable, Collection
from typing import Any, TypeGuard

import numpy as np

from excite.errors import ExciteError, did_you_mean

LARGEST_WHOLE = 2**63  # what a file holds in 64 bits
LARGEST = 1e300  # of real numbers: sums of a few stay finite
SAME_DT = 1e-6


def bad(place: str, value: object, remedy: str, fault: str = "") -> ExciteError:
    """Return the error that names place, value and remedy; `fault` says of the value what is wrong with it."""
    return ExciteError(f"{place}: {value!r}{fault and ' '}{fault}; {remedy}")


def is_whole(value: object) -> TypeGuard[int]:
    """Whether a value is a whole number; true and false are none, and 1.0 is none."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a real number, finite or not; true and false are none."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def whole(value: object, place: str, least: int = 1, most: float = LARGEST_WHOLE, remedy: str = "") -> int:
    """Return a whole number from `least` to `most`.

    Example
    -------
    >>> whole(7, "prbs: order", 2)
    7
    """
    if not is_whole(value) or value < least:
        raise bad(place, value, remedy or f"give a whole number of at least {least}")
    if value > most:
        limit = "64 bits" if most == LARGEST_WHOLE else most
        raise bad(place, value, remedy or f"give a whole number of at most {limit}")
    return int(value)


def number(
    value: object, place: str, least: float = -np.inf, above: float = -np.inf, most: float = np.inf, remedy: str = ""
) -> float:
    """Return a finite real number of at least `least`, beyond `above` and of at most `most`."""
    if not is_number(value):
        raise bad(place, value, *((remedy,) if remedy else ("give one", "is not a number")))
    found = _float(value)
    if not math.isfinite(found):
        raise bad(place, value, *((remedy,) if remedy else ("give a finite number", "is not finite")))
    if not (least <= found <= most and found > above):
        raise bad(place, value, remedy or f"give a number, {_range(least, above, most)}")
    return found


def positive(value: object, place: str) -> float:
    """Return a positive finite number."""
    if not (is_number(value) and 0 < _float(value) < np.inf):
        raise bad(place, value, "give a number above 0", "is not a positive finite number")
    return _float(value)


def flag(value: object, place: str) -> bool:
    """Return true or false."""
    if not isinstance(value, (bool, np.bool_)):
        raise bad(place, value, "give true or false")
    return bool(value)


def text(value: object, place: str) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise bad(place, value, "give text")
    return value


def choice(value: object, place: str, known: Collection[str]) -> str:
    """Return one of the known words; another is refused with the nearest of them."""
    if not isinstance(value, str) or value not in known:
        raise bad(place, value, did_you_mean(str(value), known))
    return value


def numbers(value: object, place: str) -> list[float]:
    """Return a list of finite numbers, each checked at a place of its own: ``place[2]``."""
    if not isinstance(value, (list, tuple)):
        raise bad(place, value, "give a list of numbers")
    return [number(each, f"{place}[{i}]") for i, each in enumerate(value)]


def one_per_channel(
    value: object,
    place: str,
    count: int,
    holds: Callable[[np.ndarray], Any] = np.isfinite,
    remedy: str = "every number must be finite",
    of: str = "channels",
) -> list[float]:
    """Return a number for each of `count` channels, from one number or a sequence of as many.

    holds : which values of an array are allowed, elementwise; remedy : what the others are told; of : what is counted.
    """
    try:
        levels = np.asarray(value)
        if levels.dtype.kind not in "fiu":
            raise TypeError
    except (TypeError, ValueError):
        raise bad(place, value, f"give a number, or one for each of the {count} {of}") from None
    if levels.shape not in ((), (1,), (count,)):
        raise bad(place, value, f"give one number, or one for each of the {count} {of}")
    levels = levels.astype(np.float64)
    if not ((np.abs(levels) <= LARGEST) & holds(levels)).all():
        raise bad(place, value, remedy)
    return np.broadcast_to(levels, count).tolist()


def same_dt(a: float, b: float) -> bool:
    """Whether two sampling times are the same: within a millionth, a sample apart after a million of them.

    Sampling times come from files, where they are printed with a few digits, or are differences of time stamps.
    """
    return abs(a - b) <= SAME_DT * abs(b)


def multiple(dt: float, step: float) -> int | None:
    """Return how many steps make `dt`, at least one; None where they are no whole number by the rule of `same_dt`."""
    count = round(dt / step)
    return count if count >= 1 and same_dt(dt, count * step) else None


def _float(value: Any) -> float:
    """Return a number as a float, infinite where it is a whole number that no float holds."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _range(least: float, above: float, most: float) -> str:
    low = f"above {above:g}" if above > -np.inf else f"at least {least:g}" if least > -np.inf else ""
    return " and ".join(filter(None, (low, f"at most {most:g}" if most < np.inf else "")))
