"""State space from Markov parameters: the Hankel realizations behind every impulse-response method."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from identify.steps.shift import shift_invariance


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


def kung(H: HankelSvd, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C, Kung (1978): A by least squares from the shift of Gamma alone, which costs its last block row."""
    A, C = shift_invariance(H.gamma(order), H.ny)
    return A, H.delta(order)[:, : H.m], C


def era(H: HankelSvd, shifted: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C, Juang and Pappa (1985): A = S^-1/2 U^T H' V S^-1/2, H' the Hankel matrix `shifted` by one sample."""
    root = np.sqrt(H.values[:order])
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)  # nothing to read where H has no rank
    A = inverse[:, None] * (H.left[:, :order].T @ shifted @ H.right[:order].T) * inverse
    return A, H.delta(order)[:, : H.m], H.gamma(order)[: H.ny]
