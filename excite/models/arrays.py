"""The arrays that models hold: checked once, float64 or complex128, read-only."""

import numpy as np
from numpy.typing import ArrayLike

from excite.errors import ExciteError


def read_only(array: np.ndarray) -> np.ndarray:
    """Return the array itself, read-only from now on."""
    array.flags.writeable = False
    return array


def finite(value: object, shape: tuple[int | None, ...], place: str, kind: type = float) -> np.ndarray:
    """Return a read-only copy of `value` with finite entries and this shape, of which None leaves an axis free.

    kind : float or complex. An array without entries takes a shape that has none either.
    """
    try:
        array = np.array(value)
        if array.size and array.dtype.kind not in ("fiub" if kind is float else "fiubc"):
            raise TypeError
        array = array.astype(kind)
    except (TypeError, ValueError):
        numbers = "real numbers" if kind is float else "numbers"
        raise ExciteError(f"{place}: not an array of {numbers}; expected shape {_words(shape)}") from None
    if array.size == 0 and None not in shape and 0 in shape:
        array = array.reshape([size or 0 for size in shape])
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits or not np.isfinite(array).all():
        raise ExciteError(f"{place}: shape {array.shape}, expected {_words(shape)} with finite values")
    return read_only(array)


def _words(shape: tuple[int | None, ...]) -> str:
    """Say a shape, its free axes as N."""
    return str(shape).replace("None", "N")


def input_samples(u: ArrayLike, size: int, place: str) -> np.ndarray:
    """Return input samples (N, size); raises ExciteError where they have another shape."""
    u = np.asarray(u, float)
    if u.ndim != 2 or u.shape[1] != size:
        raise ExciteError(f"{place}: u of shape {u.shape}; give (N, {size}), one column per input")
    return u


def offset(value: ArrayLike | None, size: int, place: str) -> np.ndarray:
    """Return an operating point (size,), zero where None is given."""
    return finite(np.zeros(size) if value is None else np.ravel(value), (size,), place)


def covariance(value: ArrayLike | None, size: int, place: str) -> np.ndarray | None:
    """Return a covariance (size, size), or None."""
    return None if value is None else finite(np.atleast_2d(value), (size, size), place)
