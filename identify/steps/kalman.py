"""Innovations and Kalman gain from state sequences."""

import numpy as np

from identify.steps.compression import lower_factor, regress, solve_lower

NOISE_FREE = 1e-9  # innovations below this fraction of the output are rounding, not noise


def state_regression(
    X: np.ndarray, X_next: np.ndarray, U: np.ndarray, Y: np.ndarray, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return A, C, K and the innovation rows E from compressed state, input and output rows.

    Y = C X + D U + E gives C and E, then X+ = A X + B U + K E gives A and K, both by least squares, in the LQ factor of
    all these rows (E up to a rotation); B and D come from `input_matrices` on all samples. Without noise (E at rounding
    level) K is zero.
    """
    n, ny, d = len(X), len(Y), len(X) + len(U) + len(Y)
    y = n + (len(U) if feedthrough else 0)  # where Y stands among the regressors
    L = lower_factor(np.vstack([X, U, Y, X_next] if feedthrough else [X, Y, U, X_next]))
    C, E = solve_lower(L[:y, :y], L[y : y + ny, :y])[:, :n], L[y : y + ny, y : y + ny]
    if noise_free(E, Y):
        return regress(X_next, X, U)[0], C, np.zeros((n, ny)), E
    known = L[:d, :d].copy()
    known[y : y + ny, :y] = 0  # of Y, X+ takes E alone
    on = solve_lower(known, L[d:, :d])
    return on[:, :n], C, on[:, y : y + ny], E


def spectral_radius(A: np.ndarray) -> float:
    """Largest eigenvalue modulus."""
    return float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))


def noise_free(E: np.ndarray, Y: np.ndarray) -> bool:
    """Whether the innovation rows E are rounding beside the output rows Y, so that no gain can be told from them."""
    return bool(np.linalg.norm(E) < NOISE_FREE * np.linalg.norm(Y))
