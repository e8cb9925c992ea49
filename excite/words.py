"""Numbers and lists in sentences and tables."""

from collections.abc import Sequence

import numpy as np

NONE = "–"


def number(value: float, decimals: int | None = None) -> str:
    """Return a number as text: fixed decimals, or three digits without needless powers of ten."""
    if not np.isfinite(value):
        return NONE if np.isnan(value) else "∞" if value > 0 else "−∞"
    if decimals is not None:
        return f"{value:.{decimals}f}"
    if value == 0 or 1e-4 <= abs(value) < 999.5:
        return f"{value:.3g}"
    return f"{value:.0f}" if 1 <= abs(value) < 1e5 else f"{value:.1e}"


def extent(values: Sequence[float] | np.ndarray) -> str:
    """Return the smallest and the largest of some numbers, "1 to 1.9", or the one that all of them are."""
    low, high = number(np.min(values)), number(np.max(values))
    return low if low == high else f"{low} to {high}"


def joined(parts: Sequence[str]) -> str:
    """Return "a", "a and b", "a, b and c"."""
    *most, last = parts
    return f"{', '.join(most)} and {last}" if most else last


def capital(sentence: str) -> str:
    """Return a sentence with its first letter raised, and nothing else changed."""
    return sentence[:1].upper() + sentence[1:]
