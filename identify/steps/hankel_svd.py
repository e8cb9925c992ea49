"""State space from Markov parameters: the Hankel realizations behind every impulse-response method."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.numerics.simulate import observability


def hankel_of(markov: np.ndarray, rows: int) -> np.ndarray:
    """Block-Hankel matrix (rows ny, columns m) of Markov parameters h_1, h_2, … given as (count, ny, m)."""
    count, ny, m = markov.shape
    columns = count - rows + 1
    index = np.arange(rows)[:, None] + np.arange(columns)[None, :]
    return markov[index].transpose(0, 2, 1, 3).reshape(rows * ny, columns * m)


@dataclass(frozen=True, eq=False)
class HankelSvd:
    """SVD of a Hankel matrix, H = U S V^T ~ (U S^1/2)(S^1/2 V^T) = Gamma Delta, with blocks of ny rows and m columns.

    One decomposition serves all orders.
    """

    left: np.ndarray
    values: np.ndarray
    right: np.ndarray
    ny: int
    m: int

    def gamma(self, order: int) -> np.ndarray:
        """Extended observability matrix (rows ny, n); C is its first block."""
        return self.left[:, :order] * np.sqrt(self.values[:order])

    def delta(self, order: int) -> np.ndarray:
        """Extended controllability matrix (n, columns m); B is its first block."""
        return np.sqrt(self.values[:order])[:, None] * self.right[:order]


def hankel_svd(markov: np.ndarray, rows: int) -> HankelSvd:
    """Factor the Hankel matrix of h_1, h_2, … (count, ny, m) with `rows` block rows."""
    return HankelSvd(*la.svd(hankel_of(markov, rows), full_matrices=False, check_finite=False), *markov.shape[1:])


def onto(A: np.ndarray, C: np.ndarray, markov: np.ndarray) -> np.ndarray:
    """Return the input matrix (n, m) whose response C A^(k-1) (…) comes nearest to markov (count, ny, m), h_1 first."""
    gamma = observability(A, C, len(markov)).reshape(-1, len(A))
    return la.lstsq(gamma, markov.reshape(len(gamma), -1), check_finite=False)[0]
