"""State space from Markov parameters: the Hankel realization behind every impulse-response method."""

import numpy as np
import scipy.linalg as la

from identify.ground.shift_invariance import shift_invariance


def hankel_of(markov: np.ndarray, rows: int) -> np.ndarray:
    """Block-Hankel matrix (rows ny, columns m) of Markov parameters h_1, h_2, … given as (count, ny, m)."""
    count, ny, m = markov.shape
    columns = count - rows + 1
    index = np.arange(rows)[:, None] + np.arange(columns)[None, :]
    return markov[index].transpose(0, 2, 1, 3).reshape(rows * ny, columns * m)


def kung(markov: np.ndarray, order: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C from h_1, h_2, … (count, ny, m) with `rows` block rows, Kung (1978).

    The Hankel matrix is factored by its SVD, H = (U S^1/2)(S^1/2 V^T) = Gamma Delta; C and B are the first blocks of
    Gamma and Delta, A its shift.
    """
    ny, m = markov.shape[1:]
    left, values, right = la.svd(hankel_of(markov, rows), full_matrices=False, check_finite=False)
    root = np.sqrt(values[:order])
    A, C = shift_invariance(left[:, :order] * root, ny)
    return A, root[:, None] * right[:order, :m], C
