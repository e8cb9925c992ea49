"""Functions of a linear system's matrices that several rooms need: spectral radius, and zero-order hold."""

import numpy as np
import scipy.linalg as la


def spectral_radius(A: np.ndarray) -> float:
    """Return the largest modulus of the eigenvalues of A (n, n), 0 for n = 0; below 1 a discrete system is stable."""
    return float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))


def zero_order_hold(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the discrete A (n, n) and B (n, nu) of x' = A x + B u for u held over each dt, in s.

    They are the upper rows of exp([[A, B], [0, 0]] dt), exact also where A is singular (Van Loan, IEEE Trans. AC 23, 1978).

    Example
    -------
    >>> A, B = zero_order_hold(np.array([[-1.0]]), np.array([[1.0]]), 0.1)  # exp(-0.1) and 1 - exp(-0.1)
    """
    n, nu = B.shape
    both = la.expm(np.block([[A, B], [np.zeros((nu, n + nu))]]) * dt)
    return both[:n, :n], both[:n, n:]
