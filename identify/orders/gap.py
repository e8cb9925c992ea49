"""The order before the largest ratio of successive singular values."""

import numpy as np


def largest_gap(singular_values: np.ndarray) -> tuple[int, float]:
    """Return (order, ratio): the order before the largest ratio of successive singular values.

    Values at rounding level (1e-12 of the first) end the search, so that noise-free data give the true order.
    """
    s = np.asarray(singular_values, float)
    floor = 1e-12 * s[0]
    ratios = s[:-1] / np.maximum(s[1:], floor)
    ratios[s[:-1] <= floor] = 0
    order = int(np.argmax(ratios)) + 1
    return order, float(ratios[order - 1])
