"""Innovations and Kalman gain from state sequences."""

import numpy as np
import scipy.linalg as la

from identify.ground.compression import regress

NOISE_FREE = 1e-9  # innovations below this fraction of the output are rounding, not noise


def state_regression(
    X: np.ndarray, X_next: np.ndarray, U: np.ndarray, Y: np.ndarray, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return A, C, K and the innovation rows E from compressed state, input and output rows.

    Y = C X + D U + E gives C and E, then X+ = A X + B U + K E gives A and K, both by least squares; B and D come
    from `input_matrices` on all samples. Without noise (E at rounding level) K is zero.
    """
    C = regress(Y, X, U)[0] if feedthrough else regress(Y, X)[0]
    E = Y - C @ X
    if feedthrough:
        E = E - regress(E, U)[0] @ U
    if np.linalg.norm(E) < NOISE_FREE * np.linalg.norm(Y):
        return regress(X_next, X, U)[0], C, np.zeros((len(X), len(Y))), E
    A, _, K = regress(X_next, X, U, E)
    return A, C, K, E


def spectral_radius(A: np.ndarray) -> float:
    """Largest eigenvalue modulus."""
    return float(np.abs(la.eigvals(A)).max(initial=0.0))
