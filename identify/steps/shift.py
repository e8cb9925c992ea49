"""A and C from an extended observability matrix."""

import numpy as np
import scipy.linalg as la


def shift_invariance(gamma: np.ndarray, ny: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A, C from Gamma (f ny, n): C its first block row, A by least squares, seed 000 eq. (3.11)-(3.12)."""
    return la.lstsq(gamma[:-ny], gamma[ny:], check_finite=False)[0], gamma[:ny].copy()
