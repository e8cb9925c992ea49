"""Plain values: what files, JSON and comparisons between runs are made of."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.types.channel import Channel


def plain(value: Any, place: str | None = None, finite: bool = True) -> Any:
    """Return a copy in plain types: numbers, text, true, false, None, lists, and dictionaries with text for keys.

    Arrays and tuples become lists, channels text, and what has a `to_dict` (a recipe) is written by it.

    Parameters
    ----------
    value : anything made of mappings, sequences, arrays and numbers.
    place : what the value is called. Given, a value of another type is refused by its place; None passes it through.
    finite : whether NaN and infinities become None, as strict JSON has it.

    Raises
    ------
    ExciteError for a value that has no plain form, where `place` is given.

    Example
    -------
    >>> plain({"f_hz": np.array([1.0, np.nan])})
    {'f_hz': [1.0, None]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item, place and f"{place}.{key}", finite) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item, place and f"{place}[{i}]", finite) for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        return None if finite else value
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Channel):
        return str(value)
    if hasattr(value, "to_dict"):
        return plain(value.to_dict(), place, finite)
    if place is None:
        return value
    raise ExciteError(f"{place}: a {type(value).__name__} cannot be written; give numbers, text, lists and tables")
